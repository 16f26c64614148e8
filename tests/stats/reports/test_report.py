"""The report: whole or absent, the same numbers again, hostile text tamed, stamped, readable."""

import csv
import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from undrawn_reports import drawn_wide, undrawn
from well_formed import check_well_formed

from analysis.report.report_source import TableSettings
from analysis.report.wording import big, number, p_number, p_text, printable, share
from analysis.report.write_report import report_decisions, report_sessions
from protocols.errors import StudyError

HOSTILE = (
    '<script>alert(1)</script><img src=x onerror="alert(2)"> {{ 7*7 }} \u202e\x00 "日本" &amp;'
)


@pytest.fixture(scope="module")
def made(tmp_path_factory, demo_protocol, write_journals) -> Path:
    """A report of eight simulated sessions with a hostile free answer."""
    folder = tmp_path_factory.mktemp("report")
    write_journals(folder / "s", people=8, answer=HOSTILE)
    report_sessions(folder / "s", demo_protocol, folder / "r", figure_files="none")
    return folder


@pytest.fixture(scope="module")
def html(made) -> str:
    return (made / "r" / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def numbers(made) -> dict[str, object]:
    loaded: dict[str, object] = json.loads((made / "r" / "results.json").read_text())
    return loaded


@pytest.mark.slow
def test_run_again_every_byte_is_the_same(made, demo_protocol):
    report_sessions(made / "s", demo_protocol, made / "again", figure_files="none")

    for name in ("report.html", "results.json", "tables/decisions.csv", "tables/preferences.csv"):
        assert (made / "again" / name).read_bytes() == (made / "r" / name).read_bytes(), name


@pytest.mark.slow
def test_the_page_needs_nothing_from_outside(html):
    assert "<link" not in html
    assert "<script" not in html
    assert not re.findall(r'(?:src|href)="(?!#|data:)', html)
    outside = set(re.findall(r"https?://[^\"' <)]+", html))
    assert all("www.w3.org" in address for address in outside)  # names of SVG, never fetched


def test_the_page_is_well_formed(html):
    check_well_formed(html)


def test_the_page_for_reviewers_quotes_what_reports_write(html, repository):
    """But for numbers; the demonstration watches no gaze, whose sentence has a test of its own."""
    page = (repository / "docs/reviewers.md").read_text(encoding="utf-8")
    quotes = [one for one in re.findall(r"^> (.+)", page, re.MULTILINE) if "Gaze" not in one]
    number = re.compile(r"\d[\d.]*")
    text = number.sub("#", unescape(html))

    assert len(quotes) == 6
    assert [one for one in quotes if number.sub("#", one).rstrip(".") not in text] == []


def test_hostile_answers_are_shown_as_text(html):
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in html
    assert "<img src=x" not in html
    assert "{{ 7*7 }}" in html
    assert "日本" in html
    assert "\u202e" not in html
    assert "\x00" not in html


def test_simulated_data_is_stamped_on_page_and_every_figure(html, numbers):
    assert numbers["simulated"] is True
    assert '<div class="stamp">SIMULATED DATA</div>' in html
    assert "<title>SIMULATED: " in html
    figures = html.count("<figure ")
    assert figures >= 7
    assert html.count("<strong>Simulated data.</strong>") == figures


@pytest.mark.slow
def test_recorded_data_carries_no_stamp(tmp_path, demo_protocol, write_journals):
    write_journals(tmp_path / "s", people=4, simulated=False)
    with drawn_wide():
        report_sessions(tmp_path / "s", demo_protocol, tmp_path / "r", figure_files="none")

    assert "SIMULATED" not in (tmp_path / "r" / "report.html").read_text().replace("DATA\n", "")
    assert json.loads((tmp_path / "r" / "results.json").read_text())["simulated"] is False


def test_numbers_of_the_page_are_numbers_of_the_json(html, numbers):
    cells = numbers["results"]["preferences"]["table"]["cells"]
    assert len(cells) == 6
    for cell in cells:
        assert f"{cell['chosen']} / {cell['trials']}" in html
        assert share(cell["share"]) in html
    primary = numbers["results"]["preferences"]["primary"]
    assert (primary["method"], primary["against"]) == ("metameric", "push-pull")
    assert f"in {primary['chosen']} of {primary['trials']} trials" in html
    assert sum(cell["trials"] for cell in cells) == 8 * 24


def test_tables_hold_the_numbers_of_the_json(made, numbers):
    found = numbers["results"]

    def table(name: str) -> list[dict[str, str]]:
        with (made / "r" / "tables" / name).open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))

    def same(row: dict[str, str], **wanted: object) -> bool:
        return all(
            row[name] == value if isinstance(value, str) else float(row[name]) == value
            for name, value in wanted.items()
        )

    one = found["choice_models"]["pairs"][0]
    first = {name: one["fit"]["coefficients"][0][name] for name in ("term", "estimate", "p")}
    assert same(table("models.csv")[0], method=one["method"], size=one["size"], **first)
    rows, gaps = table("scale.csv"), table("scale_differences.csv")
    for size in found["scale"]["sizes"]:
        scale, limits = size["scale"], size["intervals"]
        for k, name in enumerate(scale["conditions"]):
            (row,) = [r for r in rows if same(r, size=size["size"], method=name)]
            assert same(row, jod=scale["scores"][k], upper=limits["upper"][k])
        for gap in size["contrasts"]:
            i, j = (scale["conditions"].index(gap[side]) for side in ("first", "second"))
            own = {name: gap[name] for name in ("first", "second", "difference", "clustered_p")}
            (row,) = [r for r in gaps if same(r, size=size["size"], **own)]
            assert same(row, lower=limits["difference_lower"][i][j])
    for row, side in zip(table("bias.csv"), ("order", "side"), strict=True):
        assert same(row, share=found["bias"][side]["share"], p=found["bias"][side]["p"])
    shares = table("shares.csv")
    for of in ("participant", "scene"):
        for key, pairs in found["preferences"][f"{of}_shares"].items():
            names = dict(zip(("method", "against", "size"), key.split(" / "), strict=True))
            own = [(r["name"], float(r["share"])) for r in shares if same(r, of=of, **names)]
            assert own == [tuple(pair) for pair in pairs]


def test_rules_that_were_not_applied_to_a_table_left_nothing_out(made, demo_protocol, tmp_path):
    """Before, its methods text said that they left out 0 participants and 0 single trials."""
    with undrawn():
        table = made / "r" / "tables" / "decisions.csv"
        found = report_decisions(
            table, tmp_path / "out", table=TableSettings(demo_protocol), figure_files="none"
        )
    assert any("were not applied" in note for note in found.warnings)
    assert "Rules fixed before data collection" not in found.content.methods
    assert "Rules fixed before data collection left out" in (made / "r/report.html").read_text()


def test_json_holds_no_number_that_is_not_finite(made):
    text = (made / "r" / "results.json").read_text()

    assert "NaN" not in text
    assert "Infinity" not in text


def test_page_says_methods_quality_flow_and_provenance(html, numbers, demo_protocol):
    for wanted in (
        "Holm-adjusted over 6",
        "two-way clustered score t",
        "crossed random intercepts",
        "Exclusions, by the rules",
        "Dropped refreshes",
        "Gaze lost",
        "Sign-flip p",
        demo_protocol.sha256,
        "We analysed 192",
    ):
        assert wanted in html, wanted
    assert len(numbers["provenance"]["journals_sha256"]) == 8
    assert {"numpy", "scipy", "matplotlib"} <= set(numbers["provenance"]["libraries"])
    assert len(numbers["flow"]) == 5


def test_nothing_on_the_page_reads_nan_or_none(html):
    visible = re.sub(r"<(style|svg).*?</\1>", "", html, flags=re.DOTALL)

    assert not re.search(r"\b(nan|NaN|inf|None|null|undefined)\b", visible)


def test_a_folder_with_other_things_is_refused_and_left_alone(made, demo_protocol, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("precious")

    with pytest.raises(StudyError, match="choose another folder"):
        report_sessions(made / "s", demo_protocol, tmp_path / "mine", replace=True)
    with pytest.raises(StudyError, match="--replace"):
        report_sessions(made / "s", demo_protocol, made / "r")

    assert (tmp_path / "mine" / "thesis.txt").read_text() == "precious"


def test_two_protocols_and_no_decision_left_are_refused_without_a_trace(
    tmp_path, demo_protocol, write_journals
):
    write_journals(tmp_path / "s", people=2, rt_s=0.01)

    with pytest.raises(StudyError, match="at least one decision must remain"):
        report_sessions(tmp_path / "s", demo_protocol, tmp_path / "r")

    assert not (tmp_path / "r").exists()


def _first(_first: str, _second: str, _rng: np.random.Generator) -> bool:
    return True


def _reference(first: str, _second: str, _rng: np.random.Generator) -> bool:
    return first == "reference"


def _unanimous(first: str, second: str, _rng: np.random.Generator) -> bool:
    order = ("push-pull", "metameric", "reference")
    return order.index(first) > order.index(second)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("choose", "people"), [(_first, 1), (_reference, 2), (_unanimous, 4), (_unanimous, 1)]
)
def test_degenerate_studies_give_flagged_reports(
    tmp_path, demo_protocol, write_journals, choose, people
):
    write_journals(tmp_path / "s", people=people, choose=choose)
    with drawn_wide():
        report_sessions(tmp_path / "s", demo_protocol, tmp_path / "r", figure_files="none")
    html = (tmp_path / "r" / "report.html").read_text()
    numbers = json.loads((tmp_path / "r" / "results.json").read_text())

    assert "When not to trust" in html
    visible = re.sub(r"<(style|svg).*?</\1>", "", html, flags=re.DOTALL)
    assert not re.search(r"\b(nan|inf|None)\b", visible)
    for cell in numbers["results"]["preferences"]["table"]["cells"]:
        if cell["chosen"] in (0, cell["trials"]):
            assert cell["p"] == pytest.approx(min(1.0, 2 / 2**people))
            assert any("agree" in note or "one participant" in note for note in cell["warnings"])


def test_an_imported_table_is_reported_without_a_protocol(tmp_path, make_decisions):
    make_decisions(people=5, sizes=("all",)).to_csv(tmp_path / "old.csv", index=False)

    with undrawn():
        made = report_decisions(tmp_path / "old.csv", tmp_path / "r", figure_files="none")

    html = made.html.read_text()
    assert "imported table" in html
    assert "5 participants" in html
    assert "SIMULATED" not in html


@pytest.fixture(scope="module")
def odd_names(tmp_path_factory, make_decisions):
    """Report of a table with markup, a template, broken TeX and letters without a font as names."""
    rows = make_decisions(people=3, scenes=2, sizes=("all",))
    rows = rows.replace(
        {"metameric": r"$\frac{$ <img src=x>", "push-pull": "{{ 7*7 }}", "reference": "\ue123 clip"}
    )
    rows["participant"] = "<script>alert(1)</script>" + rows["participant"]
    rows["scene"] = "$x$ & " + rows["scene"]
    folder = tmp_path_factory.mktemp("odd-names")
    rows.to_csv(folder / "d.csv", index=False)
    with drawn_wide():
        return report_decisions(folder / "d.csv", folder / "r", figure_files="none")


def test_hostile_names_in_a_table_are_shown_as_text(odd_names):
    html = odd_names.html.read_text()

    assert "<script" not in html
    assert "<img src=x" not in html
    assert "$\\frac{$ &lt;img src=x&gt;" in html
    assert "{{ 7*7 }}" in html


def test_letters_without_a_font_are_said_and_stop_nothing(odd_names):
    assert any("in no font of this machine" in note for note in odd_names.warnings)
    assert "in no font of this machine" in odd_names.html.read_text()


def test_a_protocol_given_for_a_table_must_know_its_methods(
    tmp_path, make_decisions, demo_protocol
):
    rows = make_decisions(people=3, quality={"a": 0.0, "b": 1.0})
    rows.to_csv(tmp_path / "old.csv", index=False)

    with pytest.raises(StudyError, match="must be those of the protocol"):
        report_decisions(tmp_path / "old.csv", tmp_path / "r", table=TableSettings(demo_protocol))


@pytest.mark.slow
def test_figure_files_are_of_one_format_or_all(tmp_path, make_decisions):
    make_decisions(people=4, scenes=2, sizes=("all",)).to_csv(tmp_path / "d.csv", index=False)
    drawn = {"preference", "scale", "participants", "scenes", "bias", "reaction"}
    for files, widths, kinds in (
        ("svg", ("2",), ("svg",)),
        ("pdf", ("2",), ("pdf",)),
        ("all", ("1", "2"), ("svg", "pdf", "png")),
    ):
        out = tmp_path / files
        report_decisions(tmp_path / "d.csv", out, figure_files=files)
        names = {path.name for path in (out / "figures").iterdir()}
        assert drawn <= {name.split("-")[0] for name in names}
        assert {name.split("-", 1)[1] for name in names} == {
            f"{width}-column.{kind}" for width in widths for kind in kinds
        }


def test_apa_wording():
    assert p_text(0.0004) == "p < .001"
    assert p_text(0.0123) == "p = .012"
    assert p_text(1.0) == "p > .999"
    assert p_number(0.05) == ".050"
    assert number(-0.001) == "0.00"
    assert share(1.0) == "1.00"
    assert big(12345678.0) == "1.2e7"
    assert printable("a\x07b\u202ec\n") == "a\ufffdb\ufffdc\n"


BROWSER = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)


def browse(*arguments: str) -> subprocess.CompletedProcess[str]:
    assert BROWSER is not None
    return subprocess.run(
        [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )


@pytest.fixture
def browser() -> None:
    if BROWSER is None:
        pytest.skip("needs Chromium (apt-get install chromium) to look at the page")


@pytest.mark.usefixtures("browser")
@pytest.mark.parametrize(("width", "shown"), [(390, "narrow"), (1280, "wide")])
def test_the_page_fits_phone_and_desktop(html, tmp_path, width, shown):
    """Measured in the browser: nothing sticks out sideways, the right figures show."""
    probe = (
        "<script>onload = () => { const d = document; parent.postMessage(JSON.stringify({"
        "page: d.documentElement.scrollWidth, window: innerWidth,"
        "narrow: [...d.querySelectorAll('.narrow')].filter(e => e.offsetHeight > 20).length,"
        "wide: [...d.querySelectorAll('.wide')].filter(e => e.offsetHeight > 20).length,"
        "figures: d.querySelectorAll('figure').length}), '*'); }</script>"
    )
    inner = re.sub(r"<meta http-equiv[^>]*>", "", html).replace("</body>", probe + "</body>")
    (tmp_path / "inner.html").write_text(inner)
    (tmp_path / "outer.html").write_text(
        f"<body><iframe src=inner.html width={width} height=900 style='border:0'></iframe>"
        "<p id=out>none</p><script>onmessage = e => { out.textContent = e.data; }</script>"
    )
    dump = browse(
        "--virtual-time-budget=5000",
        "--allow-file-access-from-files",
        "--dump-dom",
        f"file://{tmp_path / 'outer.html'}",
    ).stdout
    found = json.loads(re.search(r'<p id="out">(\{.*?\})</p>', dump).group(1))

    assert found["window"] == width
    assert found["page"] <= width
    assert found[shown] == found["figures"] > 0
    assert found["narrow" if shown == "wide" else "wide"] == 0


@pytest.mark.usefixtures("browser")
def test_every_printed_page_is_stamped(made, tmp_path):
    if shutil.which("pdftotext") is None:
        pytest.skip("needs pdftotext (apt-get install poppler-utils) to read the printed pages")
    browse(
        "--no-pdf-header-footer",
        f"--print-to-pdf={tmp_path / 'r.pdf'}",
        f"file://{made / 'r' / 'report.html'}",
    )
    text = subprocess.run(
        ["pdftotext", "-raw", str(tmp_path / "r.pdf"), "-"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    pages = [re.sub(r"\s", "", page) for page in text.split("\f") if page.strip()]

    assert len(pages) >= 3
    assert all("SIMULATEDDATA" in page for page in pages)
