"""Builds and sessions in one folder of clips: who keeps out whom, and what is left behind."""

import signal
import subprocess
import sys

import portalocker
import pytest

from protocols.disk import locks
from protocols.disk.locks import held, kept_for_session, lock_name, only_build
from protocols.errors import StudyError
from study_app.recorder import Recorder

SIT = """
import sys, time
from pathlib import Path
from protocols.disk.locks import kept_for_session
with kept_for_session(Path(sys.argv[1])):
    print("session", flush=True)
    time.sleep(600)
"""


@pytest.fixture
def clips(tmp_path):
    folder = tmp_path / "clips"
    folder.mkdir()
    return folder


def refused_build(clips) -> str:
    with pytest.raises(StudyError) as refusal, only_build(clips):
        pytest.fail("it may not build")
    return str(refusal.value)


def test_sessions_share_a_folder_and_keep_builds_out(clips):
    with kept_for_session(clips), kept_for_session(clips):
        assert refused_build(clips) == (
            f"{clips}: must not change while a session shows its clips (one is running); build"
            " after it ends, or choose another --out"
        )
    with only_build(clips):
        pass
    assert list(clips.iterdir()) == []


def test_a_build_keeps_sessions_and_other_builds_out(clips):
    with only_build(clips):
        with (
            pytest.raises(StudyError, match=r"must be finished before .*a build is at work"),
            kept_for_session(clips),
        ):
            pytest.fail("it may not sit")
        assert "another build is at work in this folder" in refused_build(clips)
    with kept_for_session(clips):
        pass


def test_the_same_folder_by_another_name_is_the_same_folder(clips, tmp_path):
    (tmp_path / "link").symlink_to(clips)
    with kept_for_session(tmp_path / "link"):
        assert "while a session shows its clips" in refused_build(clips)


def test_a_killed_session_leaves_nothing_that_blocks(clips):
    session = subprocess.Popen([sys.executable, "-c", SIT, clips], stdout=subprocess.PIPE)
    with session:
        assert session.stdout.readline() == b"session\n"
        assert "while a session shows its clips" in refused_build(clips)
        session.send_signal(signal.SIGKILL)
    with only_build(clips):
        pass
    assert list(clips.iterdir()) == []


def test_a_read_only_folder_can_be_shown(clips):
    clips.chmod(0o555)
    with kept_for_session(clips):
        assert "while a session shows its clips" in refused_build(clips)


def test_a_file_system_without_locks_stops_neither(clips, monkeypatch):
    def refuse(_handle, _kind):
        raise portalocker.LockException("No locks available")

    monkeypatch.setattr(portalocker, "lock", refuse)
    with held(clips) as alone:
        assert alone is None
    with kept_for_session(clips), only_build(clips):
        pass


@pytest.fixture
def locked_beside(monkeypatch):
    """Locks as on Windows: what is locked cannot be read, and no folder is locked."""
    monkeypatch.setattr(locks, "_LOCKS_LET_READ", False)


@pytest.mark.usefixtures("locked_beside")
def test_where_a_folder_cannot_be_locked_a_file_beside_it_stands_for_it(clips):
    with kept_for_session(clips), kept_for_session(clips):
        assert {entry.name for entry in clips.parent.iterdir()} == {"clips", ".clips.lock"}
        assert "while a session shows its clips" in refused_build(clips)
    with only_build(clips):
        assert "another build is at work" in refused_build(clips)
    assert list(clips.parent.iterdir()) == [clips]
    assert list(clips.iterdir()) == []


@pytest.mark.usefixtures("locked_beside")
def test_a_journal_that_is_written_is_read_by_others_and_opened_by_none(tmp_path):
    with Recorder.create(tmp_path, lambda: 0.0, lambda: "t") as recorder:
        with pytest.raises(StudyError, match="another program has this session open"):
            Recorder.resume(tmp_path, lambda: 0.0, lambda: "t")
        assert (tmp_path / lock_name(recorder.path.name)).stat().st_size == 0
        assert recorder.path.read_bytes() == b""
    assert [entry.name for entry in tmp_path.iterdir()] == [recorder.path.name]


def test_a_journal_is_refused_where_no_file_can_be_locked(tmp_path, monkeypatch):
    def refuse(_handle, _kind):
        raise portalocker.LockException("No locks available")

    monkeypatch.setattr(portalocker, "lock", refuse)
    with pytest.raises(StudyError, match="must lie where files can be locked"):
        Recorder.create(tmp_path, lambda: 0.0, lambda: "t")
