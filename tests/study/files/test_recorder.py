"""The journal: nothing lost, nothing altered, nothing written over."""

import errno
import os
import resource
from pathlib import Path

import pytest

from protocols.disk.hashing import sha256_file
from protocols.errors import StudyError
from protocols.journal import Note
from protocols.journal_file import JOURNAL_NAME, find_journals, first_link, read_journal, sealed
from study_app.recorder import DiskError, Recorder
from study_app.virtual import VirtualClock


@pytest.fixture
def clock():
    return VirtualClock(50.0)


def begin(folder: Path, clock: VirtualClock) -> Recorder:
    return Recorder.create(folder, clock, clock.wall)


def note(recorder: Recorder, text: str) -> None:
    recorder.append(Note(**recorder.stamps(), text=text))


def test_events_are_numbered_stamped_and_on_disk_at_once(tmp_path, clock):
    with begin(tmp_path / "P1", clock) as recorder:
        note(recorder, "one")
        clock.move_to(51.5)
        note(recorder, "two")
        journal = read_journal(recorder.path)  # before it is closed

    assert [(event.n, event.t_s) for event in journal.events] == [(0, 0.0), (1, 1.5)]
    assert journal.events[1].at == "2000-01-01T00:00:51.500000Z"
    assert find_journals(tmp_path) == (recorder.path,)


def test_a_journal_is_never_written_over(tmp_path, clock):
    with begin(tmp_path, clock) as recorder:
        note(recorder, "kept")
    before = recorder.path.read_bytes()

    with pytest.raises(StudyError, match="never written over"):
        begin(tmp_path, clock)

    assert recorder.path.read_bytes() == before


def test_two_programs_cannot_have_one_session_open(tmp_path, clock):
    with begin(tmp_path, clock), pytest.raises(StudyError, match="another program has this"):
        Recorder.resume(tmp_path, clock, clock.wall)
    Recorder.resume(tmp_path, clock, clock.wall).close()


@pytest.mark.parametrize("cut", [1, 2, 30, 60])
def test_a_torn_last_line_is_put_aside_and_the_rest_goes_on(tmp_path, clock, cut):
    with begin(tmp_path, clock) as recorder:
        note(recorder, "whole")
        note(recorder, "torn, or all but its line feed")
    whole = recorder.path.read_bytes()
    torn = whole[:-cut]
    recorder.path.write_bytes(torn)

    with Recorder.resume(tmp_path, clock, clock.wall) as again:
        note(again, "later")
    journal = read_journal(recorder.path)

    texts = [event.text for event in journal.events]
    if cut == 1:  # only the line feed was missing: the event is whole
        assert texts == ["whole", "torn, or all but its line feed", "later"]
        assert again.torn_file is None
    else:
        assert texts == ["whole", "later"]
        last = whole.split(b"\n")[1]
        assert (tmp_path / again.torn_file).read_bytes() == last[: len(last) + 1 - cut]
    assert [event.n for event in journal.events] == list(range(len(texts)))
    assert recorder.path.read_bytes().startswith(torn[: torn.index(b"\n") + 1])


def test_a_damaged_line_stops_a_session_and_is_named_for_an_analysis(tmp_path, clock):
    with begin(tmp_path, clock) as recorder:
        for text in ("a", "b", "c", "d"):
            note(recorder, text)
    lines = recorder.path.read_bytes().splitlines(keepends=True)
    lines[1] = b'{"kind":"note","n":1}\n'
    lines[2] = b"\xff\x00 garbage\n"
    recorder.path.write_bytes(b"".join(lines))

    with pytest.raises(StudyError, match=r"journal.jsonl: line 2: note: t_s: missing"):
        Recorder.resume(tmp_path, clock, clock.wall)
    journal = read_journal(recorder.path, lenient=True)
    assert [event.text for event in journal.events] == ["a", "d"]
    assert [entry.line for entry in journal.damaged] == [2, 3, 4]
    assert journal.damaged[2].reason.startswith("its checksum cannot be checked")
    assert recorder.path.read_bytes() == b"".join(lines)


def test_side_files_are_whole_hashed_and_never_written_over(tmp_path, clock):
    with begin(tmp_path, clock) as recorder:
        first = recorder.side_file("gaze/0001", ".csv", b"one")
        second = recorder.side_file("gaze/0001", ".csv", b"two")

    assert (first.file, second.file) == ("gaze/0001.csv", "gaze/0001-2.csv")
    assert (tmp_path / first.file).read_bytes() == b"one"
    assert sha256_file(tmp_path / second.file) == second.sha256


@pytest.mark.parametrize("part", [0, 7])
def test_a_full_disk_leaves_the_journal_at_its_last_whole_event(tmp_path, clock, monkeypatch, part):
    """The disk takes `part` bytes of a line and then refuses."""
    recorder = begin(tmp_path, clock)
    note(recorder, "saved")
    before = recorder.path.read_bytes()
    real, left = os.write, [part]

    def full(descriptor, data):
        if left[0] == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        left[0] = 0
        return real(descriptor, bytes(data)[:part])

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(DiskError, match=r"No space left on device.*everything up to event 0"):
        note(recorder, "lost")
    monkeypatch.undo()

    assert recorder.path.read_bytes() == before
    note(recorder, "room again")
    recorder.close()
    assert [event.n for event in read_journal(recorder.path).events] == [0, 1]


def test_the_kernel_s_own_refusal_is_told_and_nothing_is_lost(tmp_path, clock):
    """A real limit on file size: the kernel takes part of the line and refuses the rest."""
    recorder = begin(tmp_path, clock)
    note(recorder, "saved")
    before = recorder.path.read_bytes()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 10, hard))
    try:
        with pytest.raises(DiskError, match="File too large"):
            note(recorder, "lost")
        with pytest.raises(DiskError, match="File too large"):
            recorder.side_file("gaze/0001", ".csv", b"x" * 10_000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))

    assert recorder.path.read_bytes() == before
    assert not list((tmp_path / "gaze").iterdir())
    recorder.close()


def test_a_folder_that_cannot_be_written_is_told(tmp_path, clock):
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(StudyError, match=r"a writable folder \(Not a directory\)"):
        begin(tmp_path / "file" / "P1", clock)
    with pytest.raises(StudyError, match="there is no journal"):
        Recorder.resume(tmp_path / "none", clock, clock.wall)
    with pytest.raises(StudyError, match="no such folder"):
        find_journals(tmp_path / "none")


def test_a_line_is_one_write_and_synced(tmp_path, clock, monkeypatch):
    recorder = begin(tmp_path, clock)
    calls = []
    real_write, real_sync = os.write, os.fsync
    monkeypatch.setattr(os, "write", lambda d, b: (calls.append(bytes(b)), real_write(d, b))[1])
    monkeypatch.setattr(os, "fsync", lambda d: (calls.append("sync"), real_sync(d))[1])
    event = Note(**recorder.stamps(), text="once")
    recorder.append(event)
    monkeypatch.undo()
    recorder.close()

    line = sealed(event, first_link(b""))[1]
    assert calls == [line, "sync"]
    assert (tmp_path / JOURNAL_NAME).read_bytes() == line
