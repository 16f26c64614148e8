"""Two tabs of one link, and pages that go on at another refresh rate: what comes home is whole."""

import json
import random
from itertools import pairwise

import pytest
from web_kernel import running_kernel
from web_study import brought_home

from analysis.tidy import read_sessions
from protocols.journal import SessionResume
from protocols.journal_file import read_journal
from study_app.session_folders import find_sessions
from study_app.verification import verify

LEFT = "lines of another tab or device were left: "


@pytest.fixture(scope="module")
def kernel(tmp_path_factory):
    with running_kernel(tmp_path_factory.mktemp("kernel")) as kernel:
        yield kernel


@pytest.fixture(scope="module")
def of(case):
    """A built study."""
    return case("yes-no")


@pytest.fixture(scope="module")
def tabs(kernel, of):
    """Give lines of a page that was closed, and of two openings that both went on from there."""

    def opened(**page):
        return of.session(kernel, luck=page["opened_s"], page=page)

    def made(first_ends: int | None, second_ends: int | None):
        begun = opened(opened_s=5, most=12)
        one = opened(opened_s=100, past=begun["past"], most=first_ends)
        two = opened(opened_s=107, past=begun["past"], most=second_ends)
        return begun, one, two

    return made


def older(lines: list[str]) -> list[str]:
    """Return lines as pages sent them that did not tell their openings apart."""
    told = [json.loads(line) for line in lines]
    return [
        json.dumps({key: one[key] for key in one if key not in ("opening", "continues")}) + "\n"
        for one in told
    ]


def mixed(*parts: list[str]) -> list[str]:
    lines = [line for part in parts for line in part]
    random.Random(3).shuffle(lines)
    return lines


def journal_in(of, root):
    return (root / of.study.study.name / "W-1" / "journal.jsonl").read_bytes()


@pytest.mark.parametrize("as_sent", [list, older])
@pytest.mark.parametrize(
    ("ends", "kept"),
    [((None, 9), 0), ((9, None), 1), ((9, 14), 1), ((None, None), 0)],
    ids=["the first was completed", "the second", "neither", "both: the earlier"],
)
def test_of_two_tabs_the_run_that_was_completed_is_kept_or_the_longer_one(
    of, tabs, tmp_path, ends, kept, as_sent
):
    begun, *both = tabs(*ends)
    lines = as_sent(mixed(begun["results"], *(one["results"] for one in both)))

    (imported,) = brought_home(of, lines, tmp_path / "both")

    alone = as_sent([*begun["results"], *both[kept]["results"]])
    brought_home(of, alone, tmp_path / "alone")
    assert journal_in(of, tmp_path / "both") == journal_in(of, tmp_path / "alone")
    left = len(both[1 - kept]["results"]) - 1  # the first of them was sent again
    assert imported.state == "imported"
    assert imported.message.endswith(f"{LEFT}{left} of run 1")
    assert imported.reason == ("completed" if None in ends else "")


def test_a_page_goes_on_from_the_tab_whose_history_it_was_told(kernel, of, tabs, tmp_path):
    """The longer tab is left where the page that came later, and ended, knew the other one."""
    begun, longer, told = tabs(20, 9)
    page = {"opened_s": 300, "past": told["past"]}
    last = of.session(kernel, luck=4, page=page)
    lines = mixed(begun["results"], longer["results"], told["results"], last["results"])

    (imported,) = brought_home(of, lines, tmp_path)

    assert (imported.reason, imported.state) == ("completed", "imported")
    assert imported.message.endswith(f"{LEFT}{len(longer['results']) - 1} of run 1")
    (session,) = find_sessions(tmp_path)
    assert list(verify(session, of.study).problems) == []


def test_what_was_imported_stays_when_the_other_tab_is_completed_later(of, tabs, tmp_path):
    begun, one, two = tabs(14, None)
    (first,) = brought_home(of, [*begun["results"], *one["results"]], tmp_path)
    before = journal_in(of, tmp_path)

    (again,) = brought_home(of, mixed(begun["results"], one["results"], two["results"]), tmp_path)

    assert (first.state, again.state) == ("imported", "already there")
    assert journal_in(of, tmp_path) == before
    assert f"{LEFT}{len(two['results']) - 1} of run 1" in again.message
    assert "another history was refused: the code is that of another session" in again.message


def test_nothing_is_imported_before_all_of_the_best_history_has_come(of, tabs, tmp_path):
    begun, one, two = tabs(None, 9)
    lost = [*begun["results"], *one["results"][:5], *one["results"][6:], *two["results"]]
    (refused,) = brought_home(of, lost, tmp_path)
    assert refused.message.startswith("1 of ")
    assert not list(tmp_path.iterdir())
    lost = [*begun["results"], *one["results"], *two["results"][:5], *two["results"][6:]]
    assert brought_home(of, lost, tmp_path)[0].reason == "completed"


def test_made_up_histories_cost_nobody_else(kernel, of, tmp_path):
    """Each line thirty times, and from tabs that never were; then an honest participant."""
    lines, chance = of.session(kernel)["results"], random.Random(1)
    forged = []
    for text in lines:
        for _ in range(30):
            line = json.loads(text) | {"t_s": round(chance.uniform(0, 900), 6)}
            told = {"run": chance.randrange(3), "opening": chance.randrange(5)}
            forged.append(json.dumps(line | (told if chance.random() < 0.5 else {})) + "\n")
    honest = of.session(kernel, "W-2", luck=8)["results"]
    told = {one.participant: one for one in brought_home(of, forged + honest, tmp_path)}
    assert (told["W-2"].state, told["W-2"].reason) == ("imported", "completed")


@pytest.mark.parametrize(
    "rates_hz", [(120.0, 60.0), (60.0, 120.0), (60.0, 144.0, 144.0, 60.0)], ids=str
)
def test_who_comes_back_at_another_refresh_rate_is_judged_at_that_one(
    kernel, of, tmp_path, rates_hz
):
    lines, past = [], None
    for number, rate_hz in enumerate(rates_hz):
        most = 13 if number < len(rates_hz) - 1 else None
        page = {"opened_s": 100 * number, "rates_hz": [rate_hz], "past": past, "most": most}
        told = of.session(kernel, rate_hz=rate_hz, luck=number + 1, page=page, missed=0.02)
        lines, past = lines + told["results"], told.get("past")

    (imported,) = brought_home(of, lines, tmp_path)

    assert (imported.state, imported.reason) == ("imported", "completed"), imported.message
    journal = read_journal(tmp_path / of.study.study.name / "W-1" / "journal.jsonl")
    assert {one.void_reason for one in journal.attempts} >= {None, "dropped-frames"}
    now_hz, said = rates_hz[0], []
    for event in journal.events:
        if isinstance(event, SessionResume) and event.refresh_hz:
            now_hz = event.refresh_hz
            said.append(now_hz)
        for phase in getattr(event, "phases", ()):
            lasted = (phase.offset_s - phase.onset_s) * now_hz
            assert abs(lasted - phase.refreshes) < 1e-3
    assert said == [new for old, new in pairwise(rates_hz) if old != new]
    (session,) = find_sessions(tmp_path)
    assert (session.state, list(verify(session, of.study).problems)) == ("completed", [])
    (row,) = read_sessions(tmp_path, of.study).sessions.to_dict("records")
    assert row["refresh_hz"] == rates_hz[0]
    assert row["refresh_changes"] == "; ".join(journal.rate_changes)
    assert [text.split(" from ")[0] for text in journal.rate_changes] == [
        f"{hz:g} Hz" for hz in said
    ]
    off = [0.0, *(abs(s) for s in journal.start.remote.deviations_s.values())]
    off += [
        abs(s)
        for e in journal.events
        if isinstance(e, SessionResume)
        for s in (e.deviations_s or {}).values()
    ]
    assert row["time_off_s"] == pytest.approx(max(off))
