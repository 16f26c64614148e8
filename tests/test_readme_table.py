"""The README's table says what the results in `benchmarks/results/` say."""

import json
import shutil

import pytest

from benchmarks.readme import PART, main, table


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
    assert "4321 ms" in text
    assert "old" not in text
    assert text.endswith("the rest\n")


def test_a_page_without_the_markers_is_refused_and_kept(results, tmp_path):
    page = tmp_path / "README.md"
    page.write_text("# A\n")

    with pytest.raises(SystemExit, match="2"):
        main(["--results", str(results), "--readme", str(page)])
    assert page.read_text() == "# A\n"
