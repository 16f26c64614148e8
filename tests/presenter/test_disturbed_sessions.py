"""Disturbances of a session from outside: sleep, an unplugged monitor, slow disks, a second
session. Each has one outcome, and everything before it is kept.
"""

import subprocess

import pytest

from protocols.journal import Note, SessionEnd

# A disk that takes long for every frame; the machine sleeps in the first attempt; in the second the
# monitor goes, which GLFW tells by taking it from the window.
DISTURBED = """
import time, glfw
from study_app import clips, presenter
from study_app.cli import main

read_frame, show, attempts, disturbed = clips.read_frame, presenter.Presenter.show, [], [False]
def slow(*arguments):
    time.sleep(0.03)
    return read_frame(*arguments)
def shown(self, picture):
    if picture.phase.name != "second":
        disturbed[0] = False
    elif picture.refreshes >= 3 and not disturbed[0]:
        disturbed[0] = True
        attempts.append(self._asked.trial.id)
        if len(attempts) == 1:
            self._window._sleep._apart_s -= 3600
        elif len(attempts) == 2:
            glfw.set_window_monitor(self._window._handle, None, 0, 0, 640, 480, 0)
    return show(self, picture)
clips.read_frame, presenter.Presenter.show = slow, shown
main()
"""
# A network that goes away while the second trial's frames are read.
VANISHED = """
import threading
from study_app import clips, presenter
from study_app.cli import main

read_frame, count = clips.read_frame, [0]
def gone(folder, clip, index):
    count[0] += 1
    if count[0] > 20:
        threading.Event().wait()
    return read_frame(folder, clip, index)
clips.read_frame, presenter.CLIP_PATIENCE_S = gone, 1.0
main()
"""
WITHOUT_LIBXCB = """
import ctypes
from study_app.cli import main

class Without(ctypes.CDLL):
    def __init__(self, name, *how, **more):
        if name == "libxcb.so.1":
            raise OSError(f"{name}: cannot open shared object file")
        super().__init__(name, *how, **more)
ctypes.CDLL = Without
main()
"""
SHORT = {"pairings": '[["metameric", "push-pull"], ["reference", "push-pull"]]', "repeats": "1"}


def error_of(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode == 2, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    (message,) = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    return message


def test_sleep_and_an_unplugged_monitor_void_the_attempt_and_the_session_goes_on(
    screen, make_study
):
    study = make_study(SHORT)
    message = error_of(
        screen.run(*screen.session("run", study, "--simulate"), code=DISTURBED, status=None)
    )

    assert "the monitor was disconnected; everything up to here is saved" in message
    journal = study.journal()
    assert [a.void_reason for a in journal.attempts] == ["focus-lost", "focus-lost"]
    assert [e.text for e in journal.events if isinstance(e, Note)] == [
        "the machine slept for 3600 s",
        "the monitor was disconnected",
    ]
    last = journal.events[-1]
    assert isinstance(last, SessionEnd)
    assert (last.reason, last.message) == ("error", message.removeprefix("error: "))

    screen.run(*screen.session("resume", study, "--simulate"))
    completed = [a.trial for a in study.journal().attempts if a.outcome == "completed"]
    assert len(completed) == len(set(completed)) == study.journal().start.trials


def test_a_disk_that_gives_no_frame_any_more_ends_the_run_with_a_word(screen, make_study):
    study = make_study(SHORT)
    message = error_of(
        screen.run(*screen.session("run", study, "--simulate"), code=VANISHED, status=None)
    )

    assert f"{study.stimuli}: the next frame must come from the disk (none came for 1 s)" in message
    journal = study.journal()
    assert [a.outcome for a in journal.attempts] == ["completed"]
    assert journal.events[-1].reason == "error"


def test_a_second_session_on_the_desktop_is_refused_before_anything_is_written(
    screen, make_study, wait
):
    study = make_study(SHORT)
    first = screen.start(*screen.session("run", study))  # waits for consent
    try:
        wait(lambda: (study.session() / "journal.jsonl").exists(), "the journal", process=first)
        second = screen.run(*screen.session("run", study, "--simulate", code="P02"), status=None)
    finally:
        first.kill()
        first.communicate()

    assert "only one window of metamerlab may be open on a desktop" in error_of(second)
    assert not study.session("P02").exists()
    # What was killed holds nothing. Without libxcb it is said what nobody notices.
    words = screen.session("run", study, "--simulate", code="P02")
    done = screen.run(*words, code=WITHOUT_LIBXCB)
    (note,) = [event.text for event in study.journal("P02").events if isinstance(event, Note)]
    assert note.startswith("windows over the participant's and a blank screen are not noticed")
    assert note.endswith("there is no libxcb; install it (Debian, Ubuntu: apt-get install libxcb1)")
    assert " ".join(done.stdout.split()).count(f"note: {note}") == 1


@pytest.mark.parametrize(("number", "reason"), [(116, "Stale"), (5, "Input/output"), (110, "")])
def test_a_frame_that_a_network_disk_fails_to_give_is_one_message(monkeypatch, number, reason):
    from pathlib import Path

    from protocols.disk.whole_file import read_bytes
    from protocols.errors import StudyError

    def failing(_path: Path, _mode: str) -> bytes:
        raise OSError(number, f"{reason} of a network disk")

    monkeypatch.setattr(Path, "open", failing)
    with pytest.raises(StudyError, match=f"must be readable.*{reason}"):
        read_bytes(Path("000000.png"), "a frame of the study")
