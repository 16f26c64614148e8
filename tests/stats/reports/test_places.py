"""Reports say which sessions ran in browsers, what vouches for them, and what differs by place."""

import json
from math import hypot

import pandas as pd
import pytest
from command_line import metamerlab
from fixed_studies import TABLES
from undrawn_reports import undrawn

from analysis.parts import Estimate
from analysis.parts.places import difference
from analysis.report.write_report import report_decisions, report_sessions
from analysis.tasks import analysis_of
from analysis.tasks.note import write_note
from protocols.results import read_results


def said(folder) -> tuple[dict, str]:
    """Return the numbers of places, and the page without figures."""
    numbers = read_results(folder / "results.json").results
    return numbers.get("places", {}), (folder / "report.html").read_text(encoding="utf-8")


def test_limits_of_a_difference_come_from_those_of_both_places():
    lab = Estimate("share", 0.6, 0.5, 0.65, 0.1, 50)
    browser = Estimate("share", 0.7, 0.6, 0.9, 0.1, 50)
    found = difference(lab, browser)
    assert found.difference == pytest.approx(0.1)
    assert found.lower == pytest.approx(0.1 - hypot(0.1, 0.05))
    assert found.upper == pytest.approx(0.1 + hypot(0.2, 0.1))


@pytest.fixture(scope="module")
def both(tmp_path_factory, demo_protocol, write_journals):
    """A report of four sessions at a desk, and four in browsers."""
    folder = tmp_path_factory.mktemp("both")
    write_journals(folder / "s", people=8, simulated=False, remote=(1, 3, 5, 7))
    with undrawn():
        report_sessions(folder / "s", demo_protocol, folder / "r", figure_files="none")
    return folder / "r"


@pytest.mark.slow
def test_a_report_says_which_sessions_were_remote_and_what_vouches_for_them(both):
    numbers, page = said(both)
    lab, browser = numbers["places"]
    assert (lab["name"], lab["sessions"], browser["name"], browser["sessions"]) == (
        "lab", 4, "browser", 4,
    )  # fmt: skip
    assert browser["refresh_hz"] == {"75": 4}
    assert browser["timing_evidence"] == {"animation frame": 4}
    assert browser["gaze_mode"] == {"none": 4}
    assert lab["gaze_mode"] == {"monitor": 4}
    assert (lab["time_off_s"], browser["time_off_s"]) == (None, 0.0066)
    section = page.split('<h2 id="places">')[1].split("<h2")[0]
    for words in ("75 Hz", "animation frame", "monitor", "none", "No photodiode", "at most 6.6 ms"):
        assert words in section
    assert "4 of 8 sessions ran in participants&#39; browsers, at 75 Hz." in page
    sessions = pd.read_csv(both / "tables/sessions.csv")
    assert sessions["remote"].tolist() == [0, 1] * 4


@pytest.mark.slow
def test_the_primary_result_is_compared_by_place_and_called_exploratory(
    both, demo_protocol, write_journals, tmp_path
):
    numbers, page = said(both)
    (one,) = numbers["differences"]
    assert one["difference"] == pytest.approx(one["browser"]["value"] - one["lab"]["value"])
    assert one["lower"] < one["difference"] < one["upper"]
    assert "<caption>Exploratory: the primary result by place" in page
    assert "Exploratory, " in page.split('id="apa"')[1]
    # Each place's number is that of a report of its sessions alone.
    write_journals(tmp_path / "s", people=8, simulated=False)
    for number in (1, 3, 5, 7):
        (tmp_path / f"s/P{number + 1:02d}/journal.jsonl").unlink()
        (tmp_path / f"s/P{number + 1:02d}").rmdir()
    with undrawn():
        report_sessions(tmp_path / "s", demo_protocol, tmp_path / "r", figure_files="none")
    alone = read_results(tmp_path / "r/results.json").results["preferences"]["primary"]
    assert one["lab"]["value"] == pytest.approx(alone["share"])


@pytest.mark.slow
def test_sessions_of_one_place_are_not_compared(demo_protocol, write_journals, tmp_path):
    for name, remote in (("lab", ()), ("home", range(4))):
        write_journals(tmp_path / name, simulated=False, remote=remote)
        with undrawn():
            report_sessions(
                tmp_path / name, demo_protocol, tmp_path / name / "r", figure_files="none"
            )
        numbers, page = said(tmp_path / name / "r")
        assert bool(numbers) == (name == "home")
        assert ("4 of 4 sessions ran in participants" in page) == (name == "home")
        assert "Exploratory" not in page


DOORS = {
    "preference-plain": ("reaction",),
    "detection": ("detection", "--signal", "inconsistent", "--by", "method"),
    "ratings": ("ratings", "--by", "method"),
    "two-answers": ("reaction", "--by", "method"),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=[pytest.mark.full] * (one == "ratings")) for one in DOORS]
)
def test_tables_with_the_column_remote_are_compared_by_place_too(name, tmp_path):
    kind, options, make = TABLES[name]
    rows = make()
    people = sorted(rows["participant"].unique())
    rows["remote"] = rows["participant"].isin(people[::2]).astype(int)
    rows.to_csv(tmp_path / "rows.csv", index=False)
    write_note(tmp_path / "rows.csv", analysis_of(kind).options(**options))
    with undrawn():
        report_decisions(tmp_path / "rows.csv", tmp_path / "report", figure_files="none")
    numbers, page = said(tmp_path / "report")
    assert [one["name"] for one in numbers["places"]] == ["lab", "browser"]
    assert bool(numbers["differences"]) or "no comparison of places" in page
    assert numbers["differences"] or name == "two-answers"

    command = ["analysis", DOORS[name][0], str(tmp_path / "rows.csv"), *DOORS[name][1:]]
    with undrawn():
        done = metamerlab(*command, env={"COLUMNS": "200"})
    assert (
        f"{len(people[::2])} of {len(people)} sessions ran in participants' browsers"
        in " ".join(done.output.split())
    )


def test_who_took_part_at_both_places_is_named_and_nothing_is_compared(tmp_path):
    rows = TABLES["ratings"][2]()
    rows["remote"] = (rows.index % 2).astype(int)
    rows.to_csv(tmp_path / "rows.csv", index=False)
    write_note(tmp_path / "rows.csv", analysis_of("ratings").options(by="method"))
    with undrawn():
        made = report_decisions(tmp_path / "rows.csv", tmp_path / "r", figure_files="none")
    assert any("took part at both" in note for note in made.warnings)
    assert json.loads(made.json.read_text())["results"]["places"]["differences"] == []
