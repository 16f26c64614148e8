"""Questions in any number: asked, timed, recorded, and refused where they cannot be asked."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from attack.kills import THRICE, asked, journal_of, write_study
from command_line import metamerlab

from protocols.against_plan import contradictions, plan_of
from protocols.display import Viewing
from protocols.feasibility import check_feasible, virtual_manifest
from protocols.journal import Attempt
from protocols.journal_file import read_journal
from protocols.load import load_study
from protocols.make_script import Scripts, example_scripts
from protocols.phases import (
    STUDY_QUESTION,
    Bar,
    Bitmap,
    Image,
    MovingImage,
    Phase,
    Question,
    QuestionText,
)
from protocols.plan import make_plan
from protocols.script import Picture, StoredPicture
from protocols.study_file.session_schema import Gaze
from protocols.tasks.pairs import TwoInterval
from study_app.attempt import run_attempt
from study_app.gaze.fixation import FixationMonitor
from study_app.gaze.source import GazeSample
from study_app.observers import ArtificialObserver, default_model
from study_app.paint import bitmaps_of, drawn
from study_app.simulate import SimulatedStudy, simulate_session
from study_app.trial import GazeVerdict
from study_app.virtual import VirtualClock, VirtualStage


@pytest.fixture(scope="module")
def thrice(tmp_path_factory):
    return write_study(tmp_path_factory.mktemp("thrice"), THRICE)


def script_of(simulation):
    study, display = simulation.study, simulation.display
    manifest = virtual_manifest(study, display)
    trial = make_plan(study, manifest, "P1", 0).trials[0]
    return Scripts(study, display, "en", manifest).of(trial), trial


def test_the_common_answer_phase_falls_away_where_the_task_asks_itself(thrice):
    script, _ = script_of(thrice)
    names = [phase.name for phase in script.phases]
    assert names == ["fixate", "speeded", "again", "seen", "sure", "feedback", "iti"]
    asks = [phase.question.name for phase in script.phases if phase.question]
    assert asks == ["answer", "seen", "sure"]
    (words,) = script.phases[3].show
    assert words.of.labels == ("clearly", "barely", "not-at-all")
    assert words.of.keys == ("1", "2", "3")


def test_each_question_has_its_own_keys_and_its_own_reaction_time(thrice):
    """0.2 s of fixation; the keys of one question are none of another's."""
    script, trial = script_of(thrice)
    model = default_model(thrice.study)
    observer = ArtificialObserver(model, thrice.study.response, 0, "P1")
    stage = VirtualStage(VirtualClock(), 60.0, observer)
    script = script.model_copy(update={"gaze": script.gaze.NONE})
    own = thrice.study.response.keys[1][0]
    for key, t_s in (("1", 0.25), (own, 0.4), ("2", 0.45), ("2", 0.9), (own, 1.0), ("1", 1.2)):
        stage.press(key, t_s)
    result = run_attempt(script, stage, None, lambda *_: None)

    assert result.trial.completed
    assert result.trial.answer == trial.answers[1]
    assert result.trial.further == ("barely", "yes")
    onsets = {}
    for phase, _, flip in result.log.flips:
        onsets.setdefault(script.phases[phase].name, flip.t_s)
    for name, phase, t_s in (
        ("answer", "speeded", 0.4),
        ("seen", "seen", 0.9),
        ("sure", "sure", 1.2),
    ):
        assert result.log.given[name].rt_s == pytest.approx(t_s - onsets[phase], abs=1e-6)


def test_further_answers_stand_in_the_journal_beside_the_first(thrice, tmp_path):
    simulate_session(thrice, tmp_path, "S001")
    journal = journal_of(tmp_path)
    completed = [a for a in journal.attempts if a.outcome == "completed"]
    assert completed
    for attempt in completed:
        assert attempt.answer in ("yes", "no")
        assert [one.question for one in attempt.further] == ["seen", "sure"]
        lasted = {phase.phase: phase.offset_s - phase.onset_s for phase in attempt.phases}
        assert 0 < attempt.rt_s <= lasted["speeded"]
        for one in attempt.further:
            assert 0 < one.rt_s <= lasted[one.question]
    plan = plan_of(thrice.study, journal.start)
    assert not list(contradictions(thrice.study, plan, journal.attempts))
    (first, *rest) = completed[0].further
    late = completed[0].model_copy(
        update={"further": (first.model_copy(update={"rt_s": 9e3}), *rest)}
    )
    ((_, why),) = contradictions(thrice.study, plan, [late])
    assert "rt_s of 'seen' must be within the attempt" in why


def test_a_void_attempt_keeps_no_further_answer_and_old_lines_need_none(thrice, tmp_path):
    simulate_session(thrice, tmp_path, "S001")
    attempts = journal_of(tmp_path).attempts
    void = next(a for a in attempts if a.outcome == "void")
    done = next(a for a in attempts if a.outcome == "completed")
    assert "further" not in void.model_dump()
    with pytest.raises(ValueError, match="void attempt must have no further answers"):
        Attempt(**{**dict(void), "further": done.further})


def test_gaze_during_a_question_counts_neither_for_nor_against_the_stimuli():
    """Held, away for a whole question, held: no violation, and a quality of the held parts."""
    viewing = Viewing(1920, 1080, 0.3, 0.3, 600.0)
    monitor = FixationMonitor(Gaze(mode="enforce"), viewing, (0.0, 0.0), 100.0)
    held, away = (960.0, 540.0), (1500.0, 540.0)

    def feed(first, last, place):
        monitor.feed(GazeSample(k / 100, k / 100, *place) for k in range(first, last))

    monitor.watch(0.0, 0.4)
    feed(0, 20, held)
    monitor.pause(0.2)
    feed(20, 120, away)
    assert monitor.verdict(1.2) is GazeVerdict.AWAY
    paused = monitor.quality(1.2)
    monitor.watch(1.2, 0.4)
    feed(120, 140, held)
    assert monitor.verdict(1.4) is GazeVerdict.HELD
    quality = monitor.quality(1.4)
    assert (paused.samples, quality.samples, quality.violations) == (20, 40, 0)
    assert (quality.max_deg, quality.lost_share) == (0.0, 0.0)
    feed(140, 150, away)
    assert monitor.verdict(1.5) is GazeVerdict.VIOLATION


def test_a_clip_that_lasts_until_an_answer_ends_with_its_last_frame_staying(monkeypatch, tmp_path):
    """Clips of 1 s; answers take longer."""

    def speeded(_task, pool, display):
        each = round(display.refresh_hz / pool.stimuli.frame_hz)
        show = (MovingImage(0, each, x_deg=-6.0), MovingImage(1, each, x_deg=6.0))
        return (Phase("both", None, show, watched=True, asks=STUDY_QUESTION),)

    monkeypatch.setattr(TwoInterval, "phases", speeded)
    study, display = load_study(Path("demo"))
    slow = replace(default_model(study), rt_median_s=1.5, rt_sigma=0.1)
    simulate_session(SimulatedStudy(study, display, model=slow), tmp_path, "S001")
    attempts = read_journal(tmp_path / "demo" / "S001" / "journal.jsonl").attempts
    assert {a.outcome for a in attempts} == {"completed"}
    assert {(s.frames_shown, s.frames_planned) for a in attempts for s in a.stimuli} == {(30, 30)}
    assert {p.planned for a in attempts for p in a.phases if p.phase == "both"} == {None}


@pytest.mark.parametrize(
    ("own", "expected"), [({}, 1200), ({"timeout_frames": 30}, 30), ({"frames": 60}, None)]
)
def test_the_studys_time_limit_holds_where_a_task_asks_its_question_itself(
    monkeypatch, own, expected
):
    """response.timeout_s of the demonstration is 20 s, at 60 Hz."""
    phase = Phase("shown", None, (Image(0),), watched=True, asks=STUDY_QUESTION)
    monkeypatch.setattr(TwoInterval, "phases", lambda *_: (replace(phase, **own),))
    script = example_scripts(*load_study(Path("demo")))[0]
    assert script.phases[1].timeout_frames == expected


# --- mistakes of a task --------------------------------------------------------------------

SHOWN = Phase("shown", 30, (Image(0),), watched=True)
ASK = Phase("ask", None, (QuestionText(),), asks=asked("sure", "yes", "no"))


LANGUAGES = ("en", "de", "ja")


class Gabor:
    """A drawable that no stage knows."""


class Grating(Image):
    """Another one, which would be drawn as what it is based on."""


MISTAKES = {
    "a drawable that is based on another": (
        [replace(SHOWN, show=(Grating(0),))],
        r"phase 'shown': must show what every stage can draw .* \(got Grating\); draw it as",
    ),
    "a drawable that nobody draws": (
        [replace(SHOWN, show=(Gabor(),))],
        r"phase 'shown': must show what every stage can draw \(Fixation, .*\) \(got Gabor\);"
        " draw it as a Bitmap",
    ),
    "a phase without an end": (
        [SHOWN, Phase("idle", None)],
        "phase 'idle': can never end, .* give it frames, or a question",
    ),
    "a question without answers": (
        [SHOWN, replace(ASK, show=(), asks=Question("sure"))],
        "question 'sure': can never end, it has no answers; name them",
    ),
    "labels without keys": (
        [SHOWN, replace(ASK, asks=replace(ASK.asks, keys=()))],
        "question 'sure' must have a text in 'en', and for each of its 2 answers a label and keys",
    ),
    "an answer without keys": (
        [SHOWN, replace(ASK, show=(), asks=replace(ASK.asks, keys=(("1",), ())))],
        r"question 'sure': must have keys for each of its 2 answers \(yes, no\) \(got 1\); give",
    ),
    "no text in a language": (
        [SHOWN, replace(ASK, asks=replace(ASK.asks, text={"fi": "Varma?"}))],
        r"must have a text in 'en', .* \(got no text",
    ),
    "one key for two answers": (
        [SHOWN, replace(ASK, asks=replace(ASK.asks, keys=(("1", "2"), ("2",))))],
        r"a key must give one answer \(got '2' for 'yes' and 'no'\); give one of them another key",
    ),
    "a key that pauses": (
        [SHOWN, replace(ASK, asks=replace(ASK.asks, keys=(("p",), ("2",))))],
        r"a key must do one thing \(got 'p', which is one of response.pause_keys\); give",
    ),
    "no key of a keyboard": (
        [SHOWN, replace(ASK, asks=replace(ASK.asks, keys=(("shift",), ("2",))))],
        r"question 'sure': must have a key: a letter, .* \(got 'shift'\)",
    ),
    "two questions at once": (
        [SHOWN, replace(ASK, asks=(ASK.asks, replace(ASK.asks, name="other")))],
        "phase 'ask': must ask one question at a time .* ask each in a phase of its own",
    ),
    "a question asked again": (
        [SHOWN, ASK, replace(SHOWN, name="again"), replace(ASK, name="ask-2")],
        "phase 'ask-2': question 'sure': must be asked once",
    ),
    "the text of no question": (
        [replace(SHOWN, show=(Image(0), QuestionText()))],
        "phase 'shown': shows the text of a question and asks none; give it",
    ),
    "a name twice": ([SHOWN, SHOWN], "phase 'shown': names of phases must differ.*; rename it"),
    "a name that is taken": (
        [SHOWN, replace(SHOWN, name="respond")],
        "phase 'respond': names of phases must differ",
    ),
    "nothing that is watched": (
        [replace(SHOWN, watched=False)], "must have watched phases; give a stimulus watched = True"
    ),
    "a stimulus that the trial lacks": (
        [replace(SHOWN, show=(Image(2),))],
        r"phase 'shown': must show one of the trial's 2 stimuli, counted from 0 \(got 2\)",
    ),
    "a time-out of nothing": (
        [replace(SHOWN, timeout_frames=9)],
        "phase 'shown': has a time-out and asks nothing; leave it out",
    ),
    "no length": (
        [replace(SHOWN, frames=0)], r"phase 'shown': frames: must be at least 1 \(got 0\); give"
    ),
    "keys in no lists": (
        [SHOWN, replace(ASK, asks=replace(ASK.asks, keys=("1", "2")))],
        r"phase 'ask': keys.0: must be a list \(got '1'\)",
    ),
    "what are no phases": (
        [SHOWN, "shown"], "phases must be a tuple of protocols.phases.Phase"
    ),
    "a picture of too few bytes": (
        [replace(SHOWN, show=(Image(0), Bitmap(4, 4, bytes(63))))],
        r"a Bitmap of 4x4 px must have 64 bytes, RGBA \(got 63\)",
    ),
    "a place that is no number": (
        [replace(SHOWN, show=(Image(0, float("nan")),))],
        "phase 'shown': x_deg of Image must be at least -90 and below 90 .got nan.; give",
    ),
    "a place behind the participant": (
        [replace(SHOWN, show=(Image(0, 180.0),))],
        "phase 'shown': x_deg of Image must be at least -90 and below 90 .got 180.0.; give",
    ),
    "a bar without a width": (
        [replace(SHOWN, show=(Image(0), Bar(-4.0)))],
        "phase 'shown': width_deg of Bar must be at least 0 and below 180",
    ),
    "a clip that stands": (
        [replace(SHOWN, show=(MovingImage(0, 0),))],
        "phase 'shown': refreshes_per_frame of MovingImage must be at least 1",
    ),
    "a half that is none": (
        [replace(SHOWN, show=(Image(0, half="up"),))],
        "phase 'shown': half of Image must be 'left', 'right' or None .got 'up'.",
    ),
    "a place in words": (
        [replace(SHOWN, show=(Image(0, "left"),))],
        "phase 'shown': every part must be of the type that protocols.phases states",
    ),
    "one drawable in no tuple": (
        [replace(SHOWN, show=Image(0))],
        "phase 'shown': every part must be of the type that protocols.phases states",
    ),
    "pixels that are no bytes": (
        [replace(SHOWN, show=(Image(0), Bitmap(4, 4, [0] * 64)))],
        "phase 'shown': every part must be of the type that protocols.phases states",
    ),
    "a text for no language": (
        [SHOWN, replace(ASK, asks=replace(ASK.asks, text="Sure?"))],
        "phase 'ask': every part must be of the type that protocols.phases states",
    ),
    "a stimulus by half a number": (
        [replace(SHOWN, show=(Image(0.5),))], "phase 'shown': stimulus: must be a whole number"
    ),
    "a text in one of three languages": (
        [SHOWN, replace(ASK, asks=replace(ASK.asks, text={"en": "Sure?"}))],
        "phase 'ask': question 'sure' must have a text in 'de', .* .got no text",
    ),
    "a placeholder that stands for nothing": (
        [SHOWN, replace(ASK, asks=replace(ASK.asks, text=dict.fromkeys(LANGUAGES, "{letf}?")))],
        r"phase 'ask': question 'sure': \{...\} must be one of left, .* .got .letf.*did you mean",
    ),
    "a picture beside the screen": (
        [replace(SHOWN, show=(Image(0), Bitmap(4, 4, bytes(64), x_deg=40.0)))],
        "phase 'shown': every stimulus must be whole on the screen",
    ),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_task_that_cannot_be_run_or_drawn_is_refused_in_one_message(monkeypatch, mistake):
    phases, message = MISTAKES[mistake]
    monkeypatch.setattr(TwoInterval, "phases", lambda *_: tuple(phases))
    study, display = load_study(Path("demo"))

    (problem,) = check_feasible(study, display)

    assert problem.place == "task"
    assert re.search(message, problem.message), problem.message


@pytest.mark.parametrize(
    "words",
    [
        ("protocol", "check", "demo"),
        ("protocol", "preview", "demo"),
        ("protocol", "show", "demo", "--script", "--code", "P1"),
        ("session", "simulate", "demo", "--out", "sessions", "--participants", "1"),
    ],
)
def test_every_command_that_shows_a_trial_refuses_such_a_task(monkeypatch, tmp_path, words):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(TwoInterval, "phases", lambda *_: (replace(SHOWN, show=(Gabor(),)),))

    done = metamerlab(*words, catch_exceptions=False, status=2)

    assert "(got Gabor)" in " ".join(done.output.split())
    assert not list(tmp_path.iterdir())


def test_pictures_that_change_each_time_are_refused(monkeypatch):
    """A session compiles a task's phases several times, and finds pictures by their pixels."""
    count = iter(range(256))

    def noisy(*_):
        return (replace(SHOWN, show=(Image(0), Bitmap(1, 1, bytes([next(count)] * 4), 12.0))),)

    monkeypatch.setattr(TwoInterval, "phases", noisy)
    (problem,) = check_feasible(*load_study(Path("demo")))
    assert "must draw the same Bitmaps each time" in problem.message


def test_what_a_task_draws_itself_is_a_picture_by_its_hash(monkeypatch):
    rgba = bytes(range(64))
    shown = replace(SHOWN, show=(Image(0), Bitmap(4, 4, rgba, x_deg=12.0)), asks=STUDY_QUESTION)
    monkeypatch.setattr(TwoInterval, "phases", lambda *_: (shown,))
    study, display = load_study(Path("demo"))
    assert not check_feasible(study, display)
    manifest = virtual_manifest(study, display)
    trial = make_plan(study, manifest, "P1", 0).trials[0]
    script = Scripts(study, display, "en", manifest).of(trial)
    (_, picture) = script.phases[1].show
    assert isinstance(picture, Picture)
    assert isinstance(picture.of, StoredPicture)
    assert drawn(picture.of, bitmaps_of(study, display)).tobytes() == rgba
