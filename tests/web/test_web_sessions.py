"""Sessions by the browser's kernel come home: each line becomes what Python would have done."""

import json

import pytest
from web_kernel import running_kernel
from web_study import WEB_CASES, BuiltWebStudy, brought_home, changed

from protocols.journal import Note, SessionResume
from protocols.journal_file import read_journal
from study_app.session_folders import find_sessions
from study_app.verification import verify
from study_app.web.import_lines import import_results
from study_app.web.read_results import read_web_results

WINDOW = {"window_px": [1920, 1080], "device_pixel_ratio": 1.25, "scale": 1, "full_screen": True}
SMALL = WINDOW | {"window_px": [300, 60]}
FAULTS = {"missed": 0.03, "paused": 0.002, "disturbed": 0.002}


@pytest.fixture(scope="module")
def kernel(tmp_path_factory):
    with running_kernel(tmp_path_factory.mktemp("kernel")) as kernel:
        yield kernel


@pytest.mark.parametrize("name", WEB_CASES)
def test_a_session_of_every_task_comes_home_as_an_ordinary_one(kernel, case, tmp_path, name):
    of = case(name)
    told = of.session(kernel, luck=3, **FAULTS)
    assert told["ending"] == "completed"

    (imported,) = brought_home(of, told["results"], tmp_path)

    assert (imported.state, imported.message, imported.reason) == ("imported", "", "completed")
    journal = journal_of(of, tmp_path)
    said = [line for line in map(json.loads, told["results"]) if line["kind"] == "attempt"]
    assert [(one.trial, one.outcome, one.answer) for one in journal.attempts] == [
        (line["trial"], line["outcome"], line["answer"]) for line in said
    ]
    assert {one.void_reason for one in journal.attempts} > {None}
    assert journal.start.remote.machine.browser == "Made up 1"
    (session,) = find_sessions(tmp_path)
    assert (session.state, list(verify(session, of.study).problems)) == ("completed", [])


def journal_of(of: BuiltWebStudy, root, who: str = "W-1"):
    return read_journal(root / of.study.study.name / who / "journal.jsonl")


@pytest.mark.parametrize("rate_hz", [50.0, 72.0, 90.0, 144.0])
def test_a_session_at_another_refresh_rate_keeps_its_times_within_the_tolerance(
    kernel, case, tmp_path, rate_hz
):
    of = case("yes-no")
    told = of.session(kernel, rate_hz=rate_hz)
    assert brought_home(of, told["results"], tmp_path)[0].state == "imported"
    journal = journal_of(of, tmp_path)
    deviation_s = journal.start.remote.deviations_s
    assert all(abs(off_s) <= of.study.web.tolerance_s for off_s in deviation_s.values())
    shown = [p for one in journal.attempts for p in one.phases if p.phase == "stimulus"]
    stated_s = 0.1 + deviation_s.get("task.stimulus_s", 0.0)
    assert shown
    assert all(abs(p.offset_s - p.onset_s - stated_s) < 2e-6 for p in shown)


@pytest.mark.parametrize(("kept", "damaged"), [(0.5, 1), (1.0, 0)])
def test_a_line_behind_what_is_left_of_another_counts(kernel, case, tmp_path, kept, damaged):
    """Texts of two participants, of which the first was cut, or only lost its last line feed."""
    of, path = case("yes-no"), tmp_path / "joined.txt"
    first, second = ("".join(of.session(kernel, f"W{n}", slot=n)["results"]) for n in (0, 1))
    cut = first[: int(kept * len(first))].rstrip("}\n") if damaged else first[:-1]
    path.write_text(cut + second, encoding="utf-8")

    inbox = read_web_results([path])
    found = import_results(inbox, of.study, of.display, of.manifest, tmp_path / "sessions")

    assert len(inbox.damaged) == damaged
    assert [(one.state, one.reason) for one in found] == [
        ("imported", "" if damaged else "completed"), ("imported", "completed"),
    ]  # fmt: skip


def test_pages_that_die_at_any_write_lose_nothing_and_double_nothing(kernel, case, tmp_path, full):
    of, deaths = case("yes-no"), 0
    for luck in range(60 if full else 4):
        whole = of.session(kernel, f"W{luck}", slot=luck, luck=luck, killed=0.04)
        deaths += whole["deaths"]
        (imported,) = brought_home(of, whole["results"], tmp_path / str(luck))
        assert (imported.state, imported.reason) == ("imported", "completed"), imported.message
        journal = journal_of(of, tmp_path / str(luck), f"W{luck}")
        done = [one.trial for one in journal.attempts if one.outcome == "completed"]
        assert len(done) == len(set(done))
        resumed = sum(isinstance(event, SessionResume) for event in journal.events)
        assert resumed <= whole["deaths"]
    assert deaths > (120 if full else 8)


def test_what_comes_twice_torn_mixed_or_from_elsewhere_is_told_apart(kernel, case, tmp_path):
    of = case("yes-no")
    one, two = (of.session(kernel, who, luck=n)["results"] for n, who in enumerate(("A1", "B2")))
    foreign = [line.replace('"study":"short"', '"study":"other"') for line in one[:3]]
    mixed = [line for pair in zip(one, two, strict=False) for line in pair]
    texts = "".join([*foreign, one[4][:40] + "\n", *mixed, *reversed(one), *two])
    folder = tmp_path / "results"
    folder.mkdir()
    (folder / "data.txt").write_text(texts)

    inbox = read_web_results([folder])
    imported = import_results(inbox, of.study, of.display, of.manifest, tmp_path / "sessions")

    assert [(each.participant, each.state) for each in imported] == [
        ("A1", "imported"),
        ("B2", "imported"),
    ]
    assert imported[0].message.startswith(f"{len(one)} lines came more than once")
    (damaged,) = inbox.damaged
    assert damaged.startswith("data.txt: line 4: line: Invalid JSON")
    assert set(inbox.found) == {("other", "A1"), ("short", "A1"), ("short", "B2")}


@pytest.mark.parametrize(
    ("kind", "fields", "message"),
    [
        ("attempt", {"trial": "main-9999"}, "trial must be"),
        ("attempt", {"attempt": 7}, "attempt must be 1, as the plan has it"),
        ("attempt", {"position": 0}, "position must be"),
        ("attempt", {"outcome": "void", "void_reason": "too-late", "answer": None}, "outcome must"),
        ("attempt", {"presses": []}, "flips must be such as a screen shows (got"),
        ("attempt", {"flips_us": [5, 5, 5]}, "flips must come after the line before"),
        ("attempt", {"window": SMALL}, "the window must show"),
        ("block-start", {"block": 0}, "must be what comes next, the start of block"),
        ("start", {"seed": 1}, "must be"),
        ("start", {"slot": 1}, "must be"),
        ("start", {"protocol_sha256": "0" * 64}, "the study file must be the one that was"),
        ("start", {"manifest_sha256": "0" * 64}, "the manifest of the stimuli must be the one"),
    ],
    ids=str,
)
def test_a_line_that_does_not_follow_is_named_and_nothing_is_written(
    kernel, case, tmp_path, kind, fields, message
):
    of = case("yes-no")
    results, _ = changed(of.session(kernel)["results"], kind, fields)

    (refused,) = brought_home(of, results, tmp_path / "sessions")

    assert refused.state == "refused"
    assert message in refused.message
    assert not (tmp_path / "sessions").exists()


def test_a_missing_line_is_named_and_one_that_says_two_things_is_left(kernel, case, tmp_path):
    of = case("yes-no")
    results = of.session(kernel)["results"]
    (lacking,) = brought_home(of, results[:5] + results[6:], tmp_path)
    assert lacking.message.startswith(f"1 of {len(results)} lines have not come (numbers 5)")
    assert not list(tmp_path.iterdir())
    twice = [*results, results[5].replace('"t_s":', '"t_s":1')]
    (torn,) = brought_home(of, twice, tmp_path)
    assert (torn.state, torn.reason) == ("imported", "completed")
    assert torn.message == "lines of another tab or device were left: 1 of run 0"


def told(lines: list[dict[str, object]]) -> list[str]:
    """Return lines as a browser sends them."""
    return [json.dumps(line) + "\n" for line in lines]


def test_lines_of_pages_that_looked_at_the_window_once_are_believed_by_that_look(
    kernel, case, tmp_path
):
    of = case("yes-no")
    lines = [json.loads(line) for line in of.session(kernel)["results"]]
    for line in lines:
        line.pop("window", None)
    assert brought_home(of, told(lines), tmp_path)[0].state == "imported"
    assert not [one for one in journal_of(of, tmp_path).events if isinstance(one, Note)]
    lines[0]["machine"] |= SMALL
    (refused,) = brought_home(of, told(lines), tmp_path / "small")
    assert "the window must show" in refused.message
    assert "window of 300 x 60 px, device ratio 1.25, scale 1, in full screen" in refused.message


def test_each_change_of_the_window_is_noted_before_its_attempt(kernel, case, tmp_path):
    of = case("yes-no")
    lines = [json.loads(line) for line in of.session(kernel)["results"]]
    attempts = [line for line in lines if line["kind"] == "attempt"]
    for line in attempts[3:6]:
        line["window"] |= {"window_px": [3840, 2160], "scale": 2, "full_screen": False}
    assert brought_home(of, told(lines), tmp_path)[0].state == "imported"
    events = journal_of(of, tmp_path).events
    noted = [(n, one.text) for n, one in enumerate(events) if isinstance(one, Note)]
    assert [text for _, text in noted] == [
        "window of 3840 x 2160 px, device ratio 1.25, scale 2, not in full screen",
        "window of 1920 x 1080 px, device ratio 1.25, scale 1, in full screen",
    ]
    behind = [next(one.trial for one in events[n:] if hasattr(one, "trial")) for n, _ in noted]
    assert behind == [attempts[n]["trial"] for n in (3, 6)]


def test_what_is_imported_again_is_there_and_what_came_later_is_added(kernel, case, tmp_path):
    of = case("yes-no")
    results = of.session(kernel, **FAULTS)["results"]
    half = len(results) // 2
    assert brought_home(of, results[:half], tmp_path)[0].state == "imported"
    before = (tmp_path / "short/W-1/journal.jsonl").read_bytes()
    assert brought_home(of, results, tmp_path)[0].state == "continued"
    after = (tmp_path / "short/W-1/journal.jsonl").read_bytes()
    assert after.startswith(before)
    assert brought_home(of, results, tmp_path / "at once")[0].state == "imported"
    for path in (tmp_path / "at once/short/W-1").rglob("*"):
        if path.is_file():
            there = tmp_path / path.relative_to(tmp_path / "at once")
            assert there.read_bytes() == path.read_bytes()
    for lines in (results, results[:half]):
        assert brought_home(of, lines, tmp_path)[0].state == "already there"
    other = of.session(kernel, luck=9)["results"]
    (refused,) = brought_home(of, other, tmp_path)
    assert refused.message.startswith("the code is that of another session")
    assert (tmp_path / "short/W-1/journal.jsonl").read_bytes() == after
