"""Keys through the X server, another window's grab of the keyboard, and kill -9."""

import signal
import subprocess
import sys
import time
from itertools import pairwise

import pytest

from protocols.journal import Attempt, BlockStart, Note, Pause, SessionEnd, SessionResume
from protocols.manifest import read_manifest
from protocols.plan import make_plan
from study_app.observers import ArtificialObserver, PreferenceModel

THIEF = """
import glfw, time
glfw.init()
window = glfw.create_window(64, 64, "thief", None, None)
glfw.focus_window(window)
until = time.monotonic() + 1.0
while time.monotonic() < until:
    glfw.wait_events_timeout(0.05)
glfw.terminate()
"""


def events_of(study, kind=object):
    try:
        return [event for event in study.journal().events if isinstance(event, kind)]
    except Exception:  # not begun yet
        return []


def press_until(screen, wait, condition, what, *keys):
    def attempt():
        screen.keys(*keys)
        time.sleep(0.15)
        return condition()

    wait(attempt, what, timeout_s=60)


@pytest.mark.slow
def test_a_session_by_real_keys_ignores_wrong_ones_asks_before_quitting_and_goes_on(
    screen, make_study, wait
):
    study = make_study({"pairings": '[["metameric", "push-pull"], ["reference", "push-pull"]]'})
    process = screen.start(*screen.session("run", study))
    press_until(
        screen, wait, lambda: events_of(study, BlockStart), "the first block", "space"
    )  # consent, two pages of instructions, start

    # Wrong keys never answer.
    for _ in range(12):
        screen.keys("x", "1", "Up", "space")
        time.sleep(0.1)
    assert not study.journal().attempts
    press_until(screen, wait, lambda: study.journal().attempts, "an answer", "x", "Left")

    # The quit key asks once; the continue key goes on.
    time.sleep(0.4)
    press_until(
        screen, wait, lambda: any(a.void_reason == "quit" for a in study.journal().attempts),
        "the quit key", "Escape",
    )  # fmt: skip
    press_until(
        screen, wait, lambda: len([a for a in study.journal().attempts if a.answer]) >= 2,
        "an answer after all", "space", "j",
    )  # fmt: skip
    assert process.poll() is None

    # Another window takes the keyboard: the attempt is void, and the journal says so.
    subprocess.run([sys.executable, "-c", THIEF], env=screen.env, check=True, timeout=30)
    wait(
        lambda: any(a.void_reason == "focus-lost" for a in study.journal().attempts),
        "a void for lost focus",
    )
    wait(lambda: events_of(study, Note), "a note on lost focus")
    press_until(screen, wait, lambda: events_of(study, Pause), "the end of the pause", "space")

    def end():
        screen.keys("Escape")
        time.sleep(0.4)
        return process.poll() is not None

    wait(end, "the end after the quit key came twice")
    out, err = process.communicate(timeout=30)
    assert process.returncode == 0, err
    assert "quit" in out

    attempts = study.journal().attempts
    answered = [a for a in attempts if a.answer]
    assert {a.key for a in answered} <= {"left", "f", "j"}
    assert {a.key for a in answered[:1]} == {"left"}
    assert all(a.answer == a.answers[a.key == "j"] for a in answered)
    assert all(0 < a.rt_s < 30 for a in answered)
    # It lies over ours, too: whichever was seen first is told.
    told = events_of(study, Note)[0].text
    assert "another window took the keyboard" in told or "lay over the participant's" in told
    assert [e.reason for e in events_of(study, SessionEnd)] == ["quit"]


@pytest.mark.timeout(600)
def test_a_killed_windowed_session_resumes_in_the_same_order_and_loses_nothing(
    screen, make_study, wait, full
):
    study = make_study({"repeats": "4" if full else "1"})
    kills = 5 if full else 1
    process = screen.start(*screen.session("run", study, "--simulate"))
    for kill in range(kills):

        def reached(wanted=kill + 1):
            return len(events_of(study, Attempt)) >= wanted

        wait(reached, f"{kill + 1} attempts", process=process)
        time.sleep(0.35)  # inside the next trial
        process.send_signal(signal.SIGKILL)
        process.communicate(timeout=30)
        before = study.journal().events
        process = screen.start(*screen.session("resume", study, "--simulate"))

        def resumed(wanted=kill + 1):
            return len(events_of(study, SessionResume)) == wanted

        wait(resumed, "the resume", process=process)
        assert study.journal().events[: len(before)] == before
    _, err = process.communicate(timeout=120)
    assert process.returncode == 0, err

    journal = study.journal()
    assert len([e for e in journal.events if isinstance(e, SessionResume)]) == kills
    plan = make_plan(study.protocol, read_manifest(study.stimuli), "P01", 0)
    assert [a.trial for a in journal.attempts] == [trial.id for trial in plan.trials]
    assert [a.position for a in journal.attempts] == list(range(len(plan.trials)))
    # The answers are those of a run that nobody killed.
    observer = ArtificialObserver(PreferenceModel(), study.protocol.response, 0, "P01")
    for attempt, trial in zip(journal.attempts, plan.trials, strict=True):
        assert attempt.key == observer.answer(trial, 1)[0]
    assert journal.start.simulated
    report = study.sessions / journal.start.display_report.file
    assert report.is_file()
    for early, late in pairwise(journal.events):
        assert late.n == early.n + 1
