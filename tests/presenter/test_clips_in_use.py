"""A real session and a real build in one folder of clips: whoever comes second is refused."""

import signal
from pathlib import Path

import forked
import pytest
from forked import METAMERLAB, Forked

from protocols.disk.locks import only_build

# One window may be on a desktop at a time; the second one here stands for another desktop's.
ANOTHER_DESKTOP = """
import os
os.environ["WAYLAND_DISPLAY"] = "another"
from study_app.desktop import window
before = window.claim_screen
def claimed():
    held = before()
    del os.environ["WAYLAND_DISPLAY"]
    return held
window.claim_screen = claimed
from study_app.cli import main
main()
"""


def error_of(done) -> str:
    assert done.returncode == 2, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    (message,) = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    return message


def files_of(folder: Path) -> dict[str, bytes]:
    found = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


@pytest.fixture
def ended():
    """Give a list of processes that do not outlive the test."""
    processes: list[Forked] = []
    yield processes
    for process in processes:
        process.kill()
        process.communicate()


def test_no_build_gets_at_clips_while_any_session_shows_them(screen, make_study, wait, ended):
    study = make_study()
    before = files_of(study.stimuli)
    for code, how in (("P01", METAMERLAB), ("P02", ANOTHER_DESKTOP)):
        # Each waits for consent, with nobody to give it.
        ended.append(screen.start(*screen.session("run", study, code=code), code=how))
        journal = study.sessions / "demo" / code / "journal.jsonl"
        wait(journal.exists, "the journal", process=ended[-1])

    for session in ended:
        done = forked.run("stimuli", "build", study.path, "--out", study.stimuli, timeout=120)
        assert f"{study.stimuli}: must not change while a session shows" in error_of(done)
        session.send_signal(signal.SIGKILL)
        session.wait(timeout=30)

    assert files_of(study.stimuli) == before
    with only_build(study.stimuli):  # both sessions were killed, and nothing of them is left
        pass


def test_no_session_begins_on_a_folder_that_is_being_built(screen, make_study, wait, ended):
    study = make_study({"pairings": '[["metameric", "push-pull"]]', "repeats": "1"})
    clips = study.folder / "new clips"
    run = screen.session("run", study, "--simulate")
    run[run.index(study.stimuli)] = clips

    ended.append(screen.start("stimuli", "build", study.path, "--out", clips, "--workers", "1"))
    wait((clips / ".build").exists, "the build's first file", process=ended[-1])
    message = error_of(screen.run(*run, status=None))
    ended[-1].send_signal(signal.SIGKILL)
    ended[-1].wait(timeout=30)

    assert f"{clips}: must be finished before a session shows its clips" in message
    assert not study.sessions.exists()
    # The killed build holds nothing: what is said now is what it left.
    assert "must hold a finished batch of clips" in error_of(screen.run(*run, status=None))
