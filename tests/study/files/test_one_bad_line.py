"""One bad line costs one session at most, and what it says reaches nobody's terminal as orders."""

import io
import json
import re
import shutil
from pathlib import Path

import pytest
from command_line import result_of
from rich.table import Table

from analysis.tidy import read_sessions
from protocols.journal_file import read_journal
from protocols.load import load_display, load_protocol
from study_app.cli.terminal import PlainConsole, say, visible
from study_app.session_folders import find_sessions, next_slot
from study_app.simulate import SimulatedStudy, simulate_session

DEMO = load_protocol(Path("demo"))
BAD = {
    "5,000 digits": lambda line: re.sub(rb'"n":\d+', b'"n":' + b"9" * 5000, line),
    "4,000 digits": lambda line: re.sub(rb'"n":\d+', b'"n":' + b"9" * 4000, line),
    "deep brackets": lambda _: b'{"kind":"note","text":' + b"[" * 100_000,
    "deep and closed": lambda _: b"[" * 5000 + b"]" * 5000,
    "a lone surrogate": lambda line: line.replace(b'"at":"', b'"at":"\\ud800'),
    "a lone surrogate as a key": lambda line: line.replace(b"{", b'{"\\udfff":1,', 1),
    "another kind": lambda _: b'{"kind":"\\u001b[2J[red]x"}',
    "a kind that is a list": lambda _: b'{"kind":["a"]}',
    "no object": lambda _: b"[1]",
    "infinite": lambda line: re.sub(rb'"t_s":[0-9.]+', b'"t_s":1e999', line),
    "NaN": lambda line: re.sub(rb'"t_s":[0-9.]+', b'"t_s":NaN', line),
    "huge": lambda line: re.sub(rb'"t_s":[0-9.]+', b'"t_s":1e300', line),
    "a count of any size": lambda line: re.sub(rb'"dropped":\d+', b'"dropped":' + b"9" * 40, line),
    "bytes": lambda line: b"\xff\xfe\x00" + line,
    "empty": lambda _: b"",
}
metamerlab = result_of(terminal_width=200)


@pytest.fixture
def sessions(tmp_path, sample_sessions) -> Path:
    shutil.copytree(sample_sessions, tmp_path / "sessions")
    return tmp_path / "sessions"


def harm(sessions: Path, change, line: int) -> Path:
    path = sessions / "demo" / "S001" / "journal.jsonl"
    lines = path.read_bytes().split(b"\n")
    lines[line] = change(lines[line])
    path.write_bytes(b"\n".join(lines))
    return path


@pytest.mark.parametrize("checked", [True, False])
@pytest.mark.parametrize("what", BAD)
def test_a_bad_line_costs_itself_and_is_named(sessions, what, checked):
    path = sessions / "demo" / "S001" / "journal.jsonl"
    if not checked:
        text = re.sub(rb'"chain":"[0-9a-f]{64}"', b'"chain":null', path.read_bytes())
        path.write_bytes(text)
    harm(sessions, BAD[what], 9)

    tidy = read_sessions(sessions, DEMO)
    assert len(tidy.sessions) == 2
    named = [note for note in tidy.warnings if "S001: line 10 is damaged" in note]
    assert len(named) == 1
    assert named[0].isascii()
    assert not set(named[0]) & set(map(chr, range(32)))
    for arguments in (("list", sessions), ("status", path.parent), ("verify", sessions)):
        done = metamerlab("session", *arguments, status=None)
        assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
        assert "\x1b" not in done.output


@pytest.mark.parametrize("what", ["5,000 digits", "deep brackets", "bytes", "empty"])
def test_a_session_without_its_first_line_is_left_out_and_the_study_goes_on(sessions, what):
    harm(sessions, BAD[what], 0)
    tidy = read_sessions(sessions, DEMO)

    assert list(tidy.sessions["participant"]) == ["S002"]
    assert any("S001: left out" in note for note in tidy.warnings)
    # The slot of S001 is not known, and is not given away.
    assert [s.journal.start.slot for s in find_sessions(sessions) if s.participant == "S002"] == [1]
    assert next_slot(sessions, "demo") == 2
    simulate_session(SimulatedStudy(DEMO, load_display(DEMO.display.display)), sessions, "S003")
    assert read_journal(sessions / "demo" / "S003" / "journal.jsonl").start.slot == 2


def test_slots_follow_from_first_lines_alone(sessions, monkeypatch):
    """With every journal read to its end, the hundredth session would begin by reading 99."""
    monkeypatch.delattr("study_app.session_folders.read_journal")
    assert next_slot(sessions, "demo") == 2


def test_a_slot_that_was_changed_is_not_believed(sessions):
    path = sessions / "demo" / "S001" / "journal.jsonl"
    path.write_bytes(path.read_bytes().replace(b'"slot":0', b'"slot":7', 1))
    assert next_slot(sessions, "demo") == 2  # not 0, which a person may have had


def test_a_journal_that_is_no_file_costs_one_session(sessions):
    path = sessions / "demo" / "S001" / "journal.jsonl"
    path.unlink()
    path.mkdir()

    assert list(read_sessions(sessions, DEMO).sessions["participant"]) == ["S002"]
    assert "damaged" in metamerlab("session", "list", sessions, status=None).stdout


def test_an_attempt_that_is_none_of_the_task_is_left_out(sessions):
    """Without checksums, and with a plan that cannot be made again."""
    path = sessions / "demo" / "S001" / "journal.jsonl"
    text = re.sub(rb'"chain":"[0-9a-f]{64}"', b'"chain":null', path.read_bytes())
    text = re.sub(rb'"plan_sha256":"."', b'"plan_sha256":"0', text)
    lines = [json.loads(line) for line in text.splitlines()]
    lines[0]["plan_sha256"] = "0" * 64
    attempt = next(line for line in lines if line["kind"] == "attempt" and line["role"] == "main")
    attempt["condition"] = {"colour": 1}
    path.write_text("".join(json.dumps(line, separators=(",", ":")) + "\n" for line in lines))

    tidy = read_sessions(sessions, DEMO)
    mine = tidy.decisions[tidy.decisions["participant"] == "S001"]
    assert attempt["trial"] not in set(mine["trial"])
    assert any("must be a trial of the study's task" in note for note in tidy.warnings)


HOSTILE = "[red]x[/red] [/] :smile: \x1b]0;title\x07\x1b[2J\x9b31m\udc80 \u202egnp.exe"


def test_text_reaches_the_terminal_as_it_is():
    out = io.StringIO()
    console = PlainConsole(file=out, force_terminal=True, width=200, color_system=None)
    table = Table("name", title=HOSTILE)
    table.add_row(HOSTILE)
    console.print(table)
    console.print(HOSTILE)
    say(HOSTILE, file=out)
    text = out.getvalue()

    assert text.count("[red]x[/red] [/] :smile:") == 4
    for forbidden in ("\x1b]", "\x1b[2J", "\x07", "\x9b", "\udc80", "\u202e"):
        assert forbidden not in text
    assert visible("a\tb\n") == "a\tb\n"


def test_names_of_folders_reach_the_terminal_as_they_are(sessions):
    folder = sessions / "[red]x" / "S\x1b[2J9"
    folder.parent.mkdir()
    shutil.copytree(sessions / "demo" / "S001", folder)

    for arguments in (("list", sessions), ("status", folder), ("verify", sessions)):
        done = metamerlab("session", *arguments)
        assert "\x1b" not in done.output
        assert "[red]x" in done.output
    refused = metamerlab("session", "status", sessions / "\x1b[31mno[red]", status=2)
    assert "\x1b" not in refused.output


@pytest.mark.parametrize("path", sorted(Path("study_app/cli").rglob("*.py")), ids=str)
def test_commands_print_through_one_door(path, repository):
    text = (repository / path).read_text(encoding="utf-8")
    if path.name != "terminal.py":
        assert not re.search(r"(?<![\w.])(print|Console|TextColumn)\(", text)
