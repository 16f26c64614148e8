"""The README's table says what the results in `benchmarks/results/` say."""

import json
import shutil

import pytest

from benchmarks.readme import PART, graphics_cards, main, table


@pytest.fixture
def results(repository):
    folder = repository / "benchmarks/results"
    if not folder.is_dir():
        pytest.skip("needs benchmarks/results, which an archive leaves out")
    return folder


def test_the_table_in_the_readme_is_made_of_the_results(repository, results):
    readme = (repository / "README.md").read_text(encoding="utf-8")
    shown = readme.partition(PART.begin)[2].partition(PART.end)[0].strip()

    assert shown == table(results), "run: script/bench readme"


def test_the_command_puts_new_numbers_into_the_page(results, tmp_path):
    folder = shutil.copytree(results, tmp_path / "results")
    fill = json.loads((folder / "fill.json").read_text())
    for entry in fill["timings"]:
        entry["median_ms"] = 4321.0
    (folder / "fill.json").write_text(json.dumps(fill))
    page = tmp_path / "README.md"
    page.write_text(f"# A\n{PART.begin}\nold\n{PART.end}\nthe rest\n")

    main(["--results", str(folder), "--readme", str(page)])

    text = page.read_text()
    assert "| 4321 |" in text
    assert "old" not in text
    assert text.endswith("the rest\n")


def test_a_page_without_the_markers_is_refused_and_kept(results, tmp_path):
    page = tmp_path / "README.md"
    page.write_text("# A\n")

    with pytest.raises(SystemExit, match="2"):
        main(["--results", str(results), "--readme", str(page)])
    assert page.read_text() == "# A\n"


def card(name, *, software=False, quick=False):
    frames = [("warp", "warp", 1024), ("warp", "warp", 2048), ("foveate", "metamer", 4096)]
    rows = [
        {"bench": bench, "name": what, "edge_px": edge_px, "frame_ms": 0.625}
        for bench, what, edge_px in frames
    ]
    renderer = {"name": name, "software": software}
    return {"renderer": renderer, "quick": quick, "revision": "abc1234", "rows": rows}


def test_a_graphics_card_gets_its_column_and_ends_the_sentence_that_none_was_measured(
    results, tmp_path
):
    folder = shutil.copytree(results, tmp_path / "results")
    shutil.rmtree(folder / "gpu", ignore_errors=True)
    none = "No real GPU has been measured."
    (folder / "gpu").mkdir()
    for number, one in enumerate([card("llvmpipe", software=True), card("A card", quick=True)]):
        (folder / f"gpu/{number}.json").write_text(json.dumps(one))
    assert none in table(folder)

    (folder / "gpu/a-card.json").write_text(json.dumps(card("A card/PCIe/SSE2")))

    text = table(folder)
    assert none not in text
    assert "(A card at abc1234)" in text
    assert "A card was measured before" in text
    head, _, *lines = text.split("\n\n")[0].splitlines()
    assert head.endswith("| A card, 1024² | A card, 2048² | A card, 4096² |")
    assert {line.count("|") for line in lines} == {head.count("|")}
    assert lines[0].endswith("| 0.62 | 0.62 | - |")


def test_pages_say_that_no_graphics_card_was_measured_as_long_as_none_was(repository, results):
    sentences = {
        "README.md": "no GPU, no monitor",
        "docs/foveation.md": "No hardware GPU has been measured",
        "docs/method.md": "No hardware GPU was measured",
    }
    said = {
        page: sentence in (repository / page).read_text(encoding="utf-8")
        for page, sentence in sentences.items()
    }
    assert set(said.values()) == {not graphics_cards(results)}, said


def test_timings_are_of_the_fills_that_there_are(results):
    """A method that left takes its timings along."""
    timings = json.loads((results / "fill.json").read_text())["timings"]
    table = (results / "fills.md").read_text()
    assert not [one["method"] for one in timings if f"\n| {one['method']} | " not in table]
