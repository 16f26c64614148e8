"""A simulated session that cannot get on ends: nobody is there who takes the cause away."""

import dataclasses
import itertools
from pathlib import Path

import pytest

from protocols.errors import StudyError
from protocols.journal import Note, SessionEnd
from protocols.journal_file import read_journal
from protocols.load import load_study
from study_app.conduct import IDLE_MOST, conduct
from study_app.observers import ArtificialObserver, default_model
from study_app.opening import begin, resume
from study_app.simulate import SimulatedStudy
from study_app.stage import PageResult
from study_app.virtual import VirtualClock, VirtualStage

NOTICE = "a window lay over the participant's: Dunst"
KEYBOARD = "another window took the keyboard"


class Patient(ArtificialObserver):
    """Goes on at the page that rests, or quits it in the end as an operator does."""

    pauses, quits = 0, False

    def turn_page(self, page):
        if page.name != "paused":
            return super().turn_page(page)
        self.pauses += 1
        quits = self.quits and self.pauses > 2 * IDLE_MOST
        return PageResult("escape" if quits else "space", "", 1.0)


class Disturbed(VirtualStage):
    """Display in which what is said comes between in each attempt, or someone pauses it."""

    said = itertools.repeat(NOTICE)
    pauses = False

    def prepare(self, trial, script, attempt, /):
        super().prepare(trial, script, attempt)
        self.now_said = next(self.said)
        if self.pauses:
            self.press("p", self.now() + 0.1)

    def disturbed(self):
        return "" if self.pauses else self.now_said


@pytest.fixture
def session(tmp_path):
    study, display = load_study(Path("demo"))
    study = study.model_copy(update={"gaze": study.gaze.model_copy(update={"mode": "none"})})
    clock = VirtualClock()
    simulation = SimulatedStudy(study, display)
    observer = Patient(default_model(study), study.response, 0, "S001")
    stage = Disturbed(clock, display.refresh_hz, observer)
    setup = simulation.setup(tmp_path, clock, "S001")

    def run(open_=begin, **how):
        asked = dataclasses.replace(setup, **how)
        recorder, plan = open_(asked, stage, None)
        with recorder:
            return conduct(asked, plan, recorder, stage, None)

    return stage, run, tmp_path / "demo" / "S001" / "journal.jsonl"


@pytest.mark.parametrize(
    ("said", "pauses", "named"),
    [
        (itertools.repeat(NOTICE), False, NOTICE),
        (itertools.cycle([KEYBOARD, NOTICE]), False, NOTICE),
        (itertools.repeat(""), True, "the pause key went down"),
    ],
)
def test_what_never_goes_away_ends_a_simulated_run_with_its_name(session, said, pauses, named):
    stage, run, path = session
    stage.said, stage.pauses = said, pauses
    with pytest.raises(StudyError) as caught:
        run()

    assert f"(its last {IDLE_MOST} attempts are void: {named})" in str(caught.value)
    journal = read_journal(path)
    assert len(journal.attempts) == IDLE_MOST
    end = journal.events[-1]
    assert isinstance(end, SessionEnd)
    assert (end.reason, end.message) == ("error", str(caught.value))
    assert sum(isinstance(event, Note) for event in journal.events) == (0 if pauses else IDLE_MOST)


def test_once_it_is_gone_the_run_goes_on(session):
    stage, run, path = session
    with pytest.raises(StudyError, match="session resume"):
        run()
    stage.said = itertools.repeat("")
    assert run(resume).reason == "completed"
    journal = read_journal(path)
    completed = [each.trial for each in journal.attempts if each.outcome == "completed"]
    assert len(completed) == len(set(completed)) > 20


def test_what_goes_away_in_time_ends_nothing(session):
    stage, run, _ = session
    nearly = [NOTICE] * (IDLE_MOST - 1) + [""]
    stage.said = itertools.chain(nearly, nearly, itertools.repeat(""))
    assert run().reason == "completed"


def test_before_a_person_the_session_rests_until_somebody_quits(session):
    stage, run, path = session
    stage._observer.quits = True
    assert run(simulated=False).reason == "quit"
    assert len(read_journal(path).attempts) > IDLE_MOST
