"""Practice with feedback, and rounds of it until enough answers are right."""

from pathlib import Path

import pytest

from protocols.feasibility import virtual_manifest
from protocols.journal import BlockEnd
from protocols.journal_file import read_journal
from protocols.load import load_display, load_protocol
from protocols.make_script import Scripts
from protocols.plan import make_plan
from protocols.study_file.schema import StudyProtocol
from study_app.attempt import run_attempt
from study_app.observers import ArtificialObserver, PreferenceModel
from study_app.session import following, remaining
from study_app.simulate import SimulatedStudy, simulate_session
from study_app.virtual import VirtualClock, VirtualStage

FHD = load_display("fhd27-60hz")
ROUND, ROUNDS = 4, 3


def practised(**practice: object) -> StudyProtocol:
    """The demo, short, with practice on the pair whose answer is known."""
    plain = load_protocol(Path("demo")).model_dump()
    plain["stimuli"]["clips"]["duration_s"] = 0.1
    plain["task"]["gap_s"] = 0.1
    plain["trial"] |= {"fixation_s": 0.1, "iti_s": 0.1, "feedback_s": 0.2}
    plain["design"]["practice"] = {"trials": ROUND, "scenes": ()} | practice
    for texts in plain["text"]["languages"].values():
        texts |= {"right": "Right.", "wrong": "Wrong."}
    return StudyProtocol.model_validate(plain)


STUDY = practised(criterion_share=0.75, rounds_max=ROUNDS, feedback=True)
PLAN = make_plan(STUDY, virtual_manifest(STUDY, FHD), "P1", 0)


@pytest.fixture(scope="module")
def template(sample_sessions):
    """A completed attempt, to be changed into any other."""
    attempts = read_journal(sample_sessions / "demo" / "S001" / "journal.jsonl").attempts
    return next(attempt for attempt in attempts if attempt.outcome == "completed")


@pytest.fixture
def attempted(template):
    """Give the attempts after answers to the first trials of practice."""

    def made(study: StudyProtocol, *answers: bool | str):
        attempts = []
        for answer in answers:
            queue = remaining(study, PLAN, 0, attempts)
            void = answer if isinstance(answer, str) else None
            attempts.append(
                template.model_copy(
                    update={
                        "trial": queue[0].id,
                        "outcome": "void" if void else "completed",
                        "void_reason": void,
                        "correct": None if void else answer,
                        "attempt": 1 + sum(a.trial == queue[0].id for a in attempts),
                    }
                )
            )
        return attempts

    return made


@pytest.fixture
def after(attempted):
    """Give the practice trials left after answers to the first of them."""
    return lambda study, *answers: remaining(study, PLAN, 0, attempted(study, *answers))


@pytest.mark.parametrize(
    ("answers", "follower"),
    [
        ((True, True), PLAN.block(0)[3]),
        ((True, True, True), PLAN.block(1)[0]),  # passed, whatever the fourth answer
        ((True, True, False), None),  # the fourth decides
        ((False, False, True), PLAN.block(0)[ROUND]),  # failed, whatever the fourth
    ],
)
def test_what_follows_a_round_is_known_only_where_its_last_answer_decides_nothing(
    attempted, answers, follower
):
    attempts = attempted(STUDY, *answers)
    (trial, *_) = remaining(STUDY, PLAN, 0, attempts)

    assert following(STUDY, PLAN, attempts, trial) == follower


def test_every_round_that_may_come_is_planned():
    practice = PLAN.block(0)

    assert [trial.role for trial in practice] == ["practice"] * ROUND * ROUNDS
    for trial in practice:
        shown = {trial.condition["first"], trial.condition["second"]}
        assert shown == {"reference", "push-pull"}  # the pair of the catch trials
        assert trial.condition["size"] == "large"
        assert trial.condition[trial.correct] == "reference"


def test_practice_ends_with_the_first_round_that_reaches_the_criterion(after):
    assert after(STUDY, True, True, True, True) == []
    assert after(STUDY, True, False, True, True) == []  # three of four are enough
    assert len(after(STUDY, True, True, True)) == 1 + 2 * ROUND


def test_below_the_criterion_another_round_follows_and_counts_for_itself(after):
    poor = (True, False, False, True)

    assert len(after(STUDY, *poor)) == 2 * ROUND
    assert after(STUDY, *poor, True, True, False, True) == []  # 5 of 8 in all, 3 of 4 in it
    assert len(after(STUDY, *poor, *poor)) == ROUND


def test_after_the_last_round_the_session_goes_on_whatever_the_answers(after):
    assert after(STUDY, *[False] * ROUND * ROUNDS) == []


def test_without_a_criterion_there_is_one_round_whatever_the_answers(template):
    plain = practised(feedback=True)
    plan = make_plan(plain, virtual_manifest(plain, FHD), "P1", 0)
    trials = plan.block(0)
    wrong = [template.model_copy(update={"trial": trial.id, "correct": False}) for trial in trials]

    assert len(trials) == ROUND
    assert remaining(plain, plan, 0, wrong) == []


def test_a_void_trial_of_a_round_comes_again_in_that_round(after):
    left = after(STUDY, "gaze-break")

    assert len(left) == ROUND * ROUNDS
    again = [trial.id for trial in left].index(PLAN.block(0)[0].id)
    assert 0 < again < ROUND


def test_trials_that_were_given_up_are_no_answers(after):
    """Three voids each: the round has no answer that could be right, so another follows."""
    once = STUDY.model_copy(update={"design": STUDY.design.model_copy(update={"max_attempts": 1})})

    assert len(after(once, *["gaze-break"] * ROUND)) == 2 * ROUND
    assert after(once, True, "gaze-break", True, True) == []
    assert len(after(once, True, "gaze-break", False, "gaze-break")) == 2 * ROUND


@pytest.mark.parametrize(("utility", "trials"), [(50.0, ROUND), (-50.0, ROUND * ROUNDS)])
def test_a_session_practises_until_it_is_right_or_the_rounds_are_over(tmp_path, utility, trials):
    model = PreferenceModel({"reference": utility}, lapse=0.0, participant_sd=0.0, scene_sd=0.0)
    outcome = simulate_session(SimulatedStudy(STUDY, FHD, model=model), tmp_path, "S001")
    journal = read_journal(tmp_path / "demo" / "S001" / "journal.jsonl")
    practice = [attempt for attempt in journal.attempts if attempt.role == "practice"]

    assert outcome.reason == "completed"
    assert outcome.main_done == 24
    assert len(practice) == trials
    assert {attempt.correct for attempt in practice} == {utility > 0}
    assert [e.block for e in journal.events if isinstance(e, BlockEnd)] == [0, 1, 2]


def test_feedback_is_shown_in_practice_alone_and_for_its_time(tmp_path):
    simulate_session(SimulatedStudy(STUDY, FHD), tmp_path, "S001")
    for attempt in read_journal(tmp_path / "demo" / "S001" / "journal.jsonl").attempts:
        phases = {phase.phase: phase.refreshes for phase in attempt.phases}
        assert ("feedback" in phases) == (attempt.role == "practice")
        assert phases.get("feedback", 12) == 12  # 0.2 s at 60 Hz


def attempt_with_keys(*presses: tuple[str, float]):
    """Run a practice attempt, 37 flips of 1/60 s up to the question, with these keys."""
    observer = ArtificialObserver(PreferenceModel(), STUDY.response, 0, "P1")
    stage = VirtualStage(VirtualClock(), 60.0, observer)
    stage.pictures = []
    trial = PLAN.block(0)[0]
    for key, t_s in presses:
        stage.press(key, t_s)
    script = Scripts(STUDY, FHD, "en", virtual_manifest(STUDY, FHD)).of(trial)
    result = run_attempt(script, stage, None, lambda *_: None)
    told = [one for _, one in stage.pictures if one.phase.name == "feedback"]
    said = {one.notice == one.phase.follows["right"] for one in told}
    return trial, result, said


def test_feedback_says_whether_the_answer_was_right():
    for key in ("left", "right"):
        trial, result, said = attempt_with_keys((key, 0.7))
        assert result.trial.answer == trial.answers[key == "right"]
        assert said == {result.trial.answer == trial.correct}


def test_keys_during_feedback_are_remembered_and_undo_nothing():
    _, result, _ = attempt_with_keys(("left", 0.7), ("right", 0.75), ("escape", 0.8))

    assert result.trial.completed
    assert result.log.given["answer"].press.key == "left"
    assert result.interrupts == ("quit",)
