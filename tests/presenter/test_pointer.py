"""Answers by mouse or touch: a click in a label's column, while a question is asked."""

import subprocess
import time
from types import SimpleNamespace

import pytest

from protocols.against_plan import contradictions, plan_of
from protocols.feasibility import virtual_manifest
from protocols.load import load_study
from protocols.make_script import Scripts
from protocols.plan import make_plan
from protocols.script import ScriptQuestion
from protocols.study_file.session_schema import POINTER
from study_app.attempt import run_attempt
from study_app.desktop.window import Window
from study_app.observers import ArtificialObserver, default_model
from study_app.virtual import VirtualClock, VirtualStage

POINTED = 'keys = [["left", "f"], ["right", "j"]]'


def pointed(study):
    """Let a study's answers be clicked."""
    text = study.path.read_text(encoding="utf-8")
    assert POINTED in text
    study.path.write_text(text.replace(POINTED, f"{POINTED}\npointer = true"), encoding="utf-8")


@pytest.mark.parametrize(("at", "answer"), [(-0.1, "a"), (0.3, "a"), (0.34, "b"), (1.0, "c")])
def test_a_click_gives_the_answer_of_its_column_where_it_may(at, answer):
    question = ScriptQuestion(
        name="which", answers=("a", "b", "c"), keys=(("1",), ("2",), ("3",)), pointer=True
    )
    assert question.answer_of(POINTER, at) == answer
    assert question.answer_of("2", at) == "b"
    assert question.model_copy(update={"pointer": False}).answer_of(POINTER, at) is None


def test_the_journal_says_that_an_answer_was_pointed_at_and_only_where_it_may_be(make_study):
    study = make_study({})
    before = study.protocol
    pointed(study)
    protocol = load_study(study.path)[0]
    assert before.sha256 != protocol.sha256
    assert "pointer" not in before.model_dump()["response"]
    manifest = virtual_manifest(protocol, study.display)
    trial = make_plan(protocol, manifest, "P1", 0).trials[0]
    script = Scripts(protocol, study.display, "en", manifest).of(trial)
    observer = ArtificialObserver(default_model(protocol), protocol.response, 0, "P1")
    stage = VirtualStage(VirtualClock(), 60.0, observer)
    stage.press(POINTER, 0.01, 0.9)
    stage.press(POINTER, 20.0, 0.9)
    result = run_attempt(script.model_copy(update={"gaze": script.gaze.NONE}), stage, None, _none)
    assert result.trial.answer == trial.answers[1]
    assert result.log.given["answer"].press.key == POINTER


def _none(*_):
    return None


def test_the_cursor_is_seen_only_while_a_question_is_asked_unless_it_is_an_eye(monkeypatch):
    modes = []
    glfw = SimpleNamespace(
        CURSOR=1, CURSOR_NORMAL="seen", CURSOR_HIDDEN="hidden",
        set_input_mode=lambda _window, _what, mode: modes.append(mode),
    )  # fmt: skip
    monkeypatch.setattr("study_app.desktop.window.glfw", glfw)
    window = Window.__new__(Window)
    window._handle, window._cursor_shown, window._cursor_kept = None, False, None
    for shown in (False, True, True, False, False):
        window.show_cursor(shown)
    assert modes == ["seen", "hidden"]
    window.show_cursor(True, stays=True)
    window.show_cursor(False)
    assert modes == ["seen", "hidden", "seen"]
    window.show_cursor(False, stays=True)
    window.show_cursor(True)
    assert modes == ["seen", "hidden", "seen", "hidden"]


@pytest.mark.slow
def test_real_clicks_answer_in_the_column_of_a_label_and_nowhere_else(screen, make_study, wait):
    study = make_study({"pairings": '[["metameric", "push-pull"], ["reference", "push-pull"]]'})
    pointed(study)
    process = screen.start(*screen.session("run", study))

    def attempt():
        screen.keys("space")
        screen.point(500, 200)
        subprocess.run(["xdotool", "click", "1"], env=screen.env, check=True)
        time.sleep(0.15)
        try:
            return [a for a in study.journal().attempts if a.answer]
        except Exception:  # not begun yet
            return []

    wait(attempt, "an answer", process=process)
    found = attempt()
    assert {a.key for a in found} == {POINTER}
    assert all(a.answer == a.answers[1] for a in found)
    assert all(a.rt_s > 0 for a in found)
    start = study.journal().start
    plan = plan_of(study.protocol, start)
    assert not list(contradictions(study.protocol, plan, found))
    unpointed = study.protocol.model_copy(
        update={"response": study.protocol.response.model_copy(update={"pointer": False})}
    )
    assert "must come from one of its keys" in str(list(contradictions(unpointed, plan, found)))
    process.kill()
    process.communicate(timeout=30)
