"""Records that cannot change unnoticed: journals, the files beside them, the plan."""

import json
import random
import shutil
from pathlib import Path

import pytest
from command_line import result_of

from analysis.export import ExportOptions
from analysis.export.write_export import export_study
from analysis.tidy import read_sessions
from protocols.disk.hashing import canonical_json, sha256_bytes
from protocols.errors import StudyError
from protocols.journal import Attempt, Note, event_line
from protocols.journal_file import due, first_link, line_sum, read_journal, sealed
from protocols.load import load_display, load_protocol
from study_app.recorder import Recorder
from study_app.session_folders import find_sessions
from study_app.simulate import SimulatedStudy, simulate_session, simulate_study
from study_app.verification import verify
from study_app.virtual import VirtualClock

DEMO = load_protocol(Path("demo"))
DISPLAY = load_display(DEMO.display.display)
metamerlab = result_of(terminal_width=200)


@pytest.fixture
def sessions(tmp_path, sample_sessions) -> Path:
    """Two sessions of the demo study that a test may change."""
    shutil.copytree(sample_sessions, tmp_path / "sessions")
    return tmp_path / "sessions"


def journal_path(sessions: Path, code: str = "S001") -> Path:
    return sessions / "demo" / code / "journal.jsonl"


def without_checksums(path: Path) -> None:
    """Write a journal as the versions before checksums did."""
    events = read_journal(path).events
    path.write_bytes(
        b"".join(event_line(event.model_copy(update={"chain": None})) for event in events)
    )


def edit(path: Path, old: bytes, new: bytes) -> None:
    data = path.read_bytes()
    assert old in data
    path.write_bytes(data.replace(old, new, 1))


def test_a_checksum_is_the_hash_of_the_one_before_and_of_the_line_without_its_own():
    note = Note(n=0, t_s=0.0, at="2026-01-01T00:00:00Z", text='"chain":null')
    first, line = sealed(note, first_link(b""))
    bare = canonical_json(note.model_copy(update={"chain": None}))

    assert first.chain == sha256_bytes(sha256_bytes(b"").encode() + bare)
    assert json.loads(line) == json.loads(bare) | {"chain": first.chain}
    assert (line_sum(line), due(line[:-1], first_link(b""))) == (first.chain, first.chain)


def test_no_change_of_one_byte_is_accepted(sessions, proof_count):
    """All that an analysis still takes from the journal is what was written."""
    path = journal_path(sessions)
    data, events = path.read_bytes(), read_journal(path).events
    rng = random.Random(5)
    for _ in range(proof_count(1200)):
        place = rng.randrange(len(data))
        byte = rng.choice([b for b in (*range(32, 127), 10, 0, 255) if b != data[place]])
        path.write_bytes(data[:place] + bytes([byte]) + data[place + 1 :])
        read = read_journal(path, lenient=True)

        assert read.damaged or (read.torn and place >= data[:-1].rindex(b"\n"))
        assert set(map(event_line, read.events)) < set(map(event_line, events))
        if read.damaged:
            with pytest.raises(StudyError, match=r"journal\.jsonl: line \d+"):
                read_journal(path)


@pytest.mark.parametrize("kept", [lambda lines: lines[:9] + lines[10:],  # a line is gone
                                  lambda lines: [*lines[:9], lines[10], lines[9], *lines[11:]],
                                  lambda lines: [*lines[:9], lines[9], *lines[9:]]])  # fmt: skip
def test_lines_taken_out_moved_or_doubled_are_noticed(sessions, kept):
    path = journal_path(sessions)
    path.write_bytes(b"".join(kept(path.read_bytes().splitlines(keepends=True))))

    assert read_journal(path, lenient=True).damaged
    assert verify(find_sessions(sessions)[0]).problems


def test_a_checksum_cannot_be_left_out(sessions):
    path = journal_path(sessions)
    lines = path.read_bytes().splitlines(keepends=True)
    attempt = next(n for n, line in enumerate(lines) if b'"kind":"attempt"' in line)
    event = read_journal(path).events[attempt]
    lines[attempt] = event_line(event.model_copy(update={"chain": None}))
    path.write_bytes(b"".join(lines))

    with pytest.raises(StudyError, match=f"line {attempt + 1}: must have a checksum"):
        read_journal(path)
    assert event.trial not in {a.trial for a in read_journal(path, lenient=True).attempts}


def test_a_journal_that_another_program_wrote_anew_is_not_as_it_was_written(sessions):
    path = journal_path(sessions)
    lines = path.read_bytes().splitlines()
    path.write_bytes(b"".join(json.dumps(json.loads(line)).encode() + b"\n" for line in lines))

    with pytest.raises(StudyError, match="line 1: must be as it was written"):
        read_journal(path)


def test_a_journal_without_checksums_is_read_and_marked(sessions):
    path = journal_path(sessions)
    without_checksums(path)
    tidy = read_sessions(sessions, DEMO)
    lines = len(read_journal(path).events)

    assert not read_journal(path).damaged
    assert list(tidy.sessions["participant"]) == ["S001", "S002"]
    assert list(tidy.sessions["unchecked_lines"]) == [lines, 0]
    assert [note for note in tidy.warnings if "without checksums" in note] == [
        "demo/S001: written without checksums, by an older version; a change to such lines may go"
        " unnoticed"
    ]
    status = metamerlab("session", "status", path.parent, status=None).stdout
    assert f"none of {lines} lines has one" in status
    assert (
        "every line has one"
        in metamerlab("session", "status", path.parents[1] / "S002", status=None).stdout
    )


def test_an_old_journal_that_goes_on_is_vouched_for_from_then_on(tmp_path):
    clock = VirtualClock(0.0)
    with Recorder.create(tmp_path, clock, clock.wall) as recorder:
        for text in ("a", "b"):
            recorder.append(Note(**recorder.stamps(), text=text))
    without_checksums(recorder.path)
    old = recorder.path.read_bytes()
    with Recorder.resume(tmp_path, clock, clock.wall) as again:
        for text in ("c", "d"):
            again.append(Note(**again.stamps(), text=text))

    assert again.path.read_bytes().startswith(old)
    assert read_journal(again.path).unchecked == 2
    edit(again.path, b'"text":"a"', b'"text":"x"')
    with pytest.raises(StudyError, match="line 3: must be as it was written"):
        read_journal(again.path)


def test_time_does_not_run_backwards_within_a_run(sessions):
    path = journal_path(sessions)
    without_checksums(path)
    lines = [json.loads(line) for line in path.read_bytes().splitlines()]
    lines[9]["t_s"] = lines[8]["t_s"] - 0.5
    path.write_bytes(b"".join(canonical_json(line) + b"\n" for line in lines))

    with pytest.raises(StudyError, match="line 10: t_s must not fall"):
        read_journal(path)


def swapped(line: dict[str, object]) -> None:
    line["condition"]["first"], line["condition"]["second"] = (
        line["condition"]["second"], line["condition"]["first"],
    )  # fmt: skip


CHANGES = {
    "the condition": (swapped, "condition must be"),
    "another scene": (lambda line: line["condition"].update(scene="castle"), "condition must be"),
    "what was shown": (lambda line: line["stimuli"].reverse(), "stimuli must be"),
    "the order of the keys": (lambda line: line["answers"].reverse(), "answers must be"),
    "the answer": (
        lambda line: line.update(answer={"first": "second", "second": "first"}[line["answer"]]),
        "must come from one of its keys",
    ),
    "the reaction time": (lambda line: line.update(rt_s=line["rt_s"] + 10), "rt_s must be within"),
    "the role": (lambda line: line.update(role="catch"), "role must be main"),
    "the trial": (lambda line: line.update(trial="main-9999"), "trial must be one of the plan"),
    "the repeat": (lambda line: line.update(repeat=line["repeat"] + 1), "repeat must be"),
    "the phases": (
        lambda line: line["phases"][1].update(onset_s=line["phases"][1]["onset_s"] + 1),
        "must",
    ),
}


@pytest.mark.parametrize("what", CHANGES)
def test_an_attempt_that_contradicts_the_plan_is_left_out_and_named(sessions, what):
    """Also in journals without checksums, and where checksums were computed anew."""
    change, said = CHANGES[what]
    path = journal_path(sessions)
    before = set(read_sessions(sessions, DEMO).decisions["trial"])
    without_checksums(path)
    lines = [json.loads(line) for line in path.read_bytes().splitlines()]
    attempt = next(line for line in lines if line["kind"] == "attempt" and line["role"] == "main")
    trial = attempt["trial"]
    change(attempt)
    path.write_bytes(b"".join(canonical_json(line) + b"\n" for line in lines))

    tidy = read_sessions(sessions, DEMO)
    mine = tidy.decisions[tidy.decisions["participant"] == "S001"]
    assert set(tidy.decisions["trial"]) <= before
    assert trial not in set(mine["trial"])
    notes = [note for note in tidy.warnings if f"line {attempt['n'] + 1} is damaged" in note]
    assert len(notes) == 1
    assert said in notes[0]
    found = metamerlab("session", "verify", path.parent, "--protocol", "demo", status=2)
    assert said in found.stdout


def test_a_session_goes_on_only_where_its_journal_fits_the_plan(sessions):
    path = journal_path(sessions)
    without_checksums(path)
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:20]))
    text = path.read_text(encoding="utf-8")
    assert text.count('"repeat":0') > 3
    path.write_text(text[::-1].replace('"repeat":0'[::-1], '"repeat":1'[::-1], 1)[::-1])
    before = path.read_bytes()

    with pytest.raises(StudyError, match="repeat must be 0, as planned"):
        simulate_session(SimulatedStudy(DEMO, DISPLAY), sessions, "S001")
    assert path.read_bytes() == before


def test_another_code_or_slot_is_no_longer_the_plan_of_the_session(sessions):
    path = journal_path(sessions)
    without_checksums(path)
    edit(path, b'"slot":0', b'"slot":6')

    notes = [n for n in read_sessions(sessions, DEMO).warnings if "not compared" in n]
    assert notes == [
        "demo/S001: trials are not compared with the plan, which comes out otherwise than it was"
        " recorded, or needs the study's secret"
    ]
    found = verify(find_sessions(sessions)[0], DEMO)
    assert any("the plan must come out as it did" in problem for problem in found.problems)


@pytest.mark.parametrize("harm", ["was changed", "is missing"])
def test_files_beside_the_journal_are_held_to_their_hashes(sessions, tmp_path, harm):
    folder = journal_path(sessions).parent
    name = "flips/0003.csv"
    metamerlab("session", "verify", sessions, "--protocol", "demo")
    if harm == "is missing":
        (folder / name).unlink()
    else:
        edit(folder / name, b",first,", b",other,")

    wanted = f"files beside the journal are not as they were recorded: {name} {harm}"
    tidy = read_sessions(sessions, DEMO)
    assert sum(wanted in note for note in tidy.warnings) == 1
    assert list(tidy.sessions["wrong_files"]) == [1, 0]
    made = export_study(
        sessions, DEMO, tmp_path / "out", "bids", ExportOptions(displays=(DISPLAY,))
    )
    assert sum(wanted in note for note in made.notes) == 1
    found = metamerlab("session", "verify", sessions, status=2)
    assert f"  {name} {harm}" in found.stdout
    assert "demo/S002: whole" in found.stdout
    assert "1 of 2 sessions must be restored" in found.stderr


def test_the_report_of_the_display_is_held_to_its_hash(tmp_path):
    from study_app.desktop.display_check import REPORTS

    root = tmp_path / "sessions"
    report = root / REPORTS / "fhd.json"
    report.parent.mkdir(parents=True)
    report.write_bytes(b"{}\n")
    simulate_study(SimulatedStudy(DEMO, DISPLAY), root, 1)
    path = journal_path(root)
    events = list(read_journal(path).events)
    pointer = {"file": f"{REPORTS}/fhd.json", "sha256": sha256_bytes(b"{}\n")}
    before, lines = first_link(b""), []
    for number, event in enumerate(events):
        plain = json.loads(event_line(event)) | ({"display_report": pointer} if not number else {})
        event, line = sealed(type(event).model_validate_json(json.dumps(plain)), before)
        before, lines = event.chain, [*lines, line]
    path.write_bytes(b"".join(lines))

    assert verify(find_sessions(root)[0], DEMO).problems == ()
    report.write_bytes(b"{ }\n")
    assert verify(find_sessions(root)[0], DEMO).problems == (f"{REPORTS}/fhd.json was changed",)


def test_a_file_that_lies_elsewhere_is_not_opened(sessions):
    path = journal_path(sessions)
    without_checksums(path)
    edit(path, b'"file":"flips/0001.csv"', b'"file":"../../../f.csv"')

    assert verify(find_sessions(sessions)[0]).problems == (
        "../../../f.csv lies outside the folder of sessions",
    )


def test_trials_in_another_order_are_found_even_with_new_checksums(sessions):
    """All numbers in place, all conditions as planned: only the order is not what was due."""
    path = journal_path(sessions)
    events = list(read_journal(path).events)
    main = [n for n, e in enumerate(events) if isinstance(e, Attempt) and e.role == "main"]
    one, two = main[2], main[3]
    keys = ("trial", "condition", "stimuli", "answers", "expected", "repeat", "answer", "key",
            "correct", "role", "attempt")  # fmt: skip
    first = {key: getattr(events[one], key) for key in keys}
    events[one] = events[one].model_copy(update={key: getattr(events[two], key) for key in keys})
    events[two] = events[two].model_copy(update=first)
    before, lines = first_link(b""), []
    for event in events:
        event, line = sealed(event, before)
        before, lines = event.chain, [*lines, line]
    path.write_bytes(b"".join(lines))

    assert not read_journal(path).damaged
    (problem,) = verify(find_sessions(sessions)[0], DEMO).problems
    assert problem.startswith(f"line {one + 1}: must be {first['trial']}")


def test_verify_says_where_there_is_nothing(tmp_path):
    found = metamerlab("session", "verify", tmp_path, status=2)

    assert "must hold at least one session" in found.stderr
