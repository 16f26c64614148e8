"""The trial machine: no sequence of inputs reaches an undefined state."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from scripts import a_script, asking, shows, watched
from timelines import OBSERVED, TIMELINES, side_by_side, three_stimuli, two_intervals

from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.load import load_display, load_protocol
from protocols.make_script import Scripts
from protocols.phases import ITI as BLANK
from protocols.plan import make_plan
from protocols.script import Dot, Frames, GazeMode, Picture, ScriptPhase, TrialScript
from study_app.trial import FlipObservation, GazeVerdict, Trial, advance

TIMELINE = two_intervals()
FIXATE, FIRST, GAP, SECOND, RESPOND, ITI, DONE = range(7)
"""Places of the phases of two intervals."""


def question(timeline: TrialScript) -> int:
    """The place of the last phase that an answer ends."""
    return max(i for i, phase in enumerate(timeline.phases) if phase.question)


class AnyInputs(RuleBasedStateMachine):
    """Throws every input at the machine, for every timeline."""

    @initialize(timeline=TIMELINES)
    def begin(self, timeline):
        self.timeline = timeline
        self.trial = Trial()
        self.outcomes = 0

    @rule(observed=OBSERVED)
    def flip(self, observed):
        before = self.trial
        if before.done(self.timeline):
            with pytest.raises(ValueError, match="done"):
                advance(before, observed, self.timeline)
            self.trial, self.outcomes = Trial(), 0
            return
        self.trial = after = advance(before, observed, self.timeline)
        self.outcomes += after.over and not before.over
        # One step forward, or to the blank at the end; never back, never skipping.
        step = after.phase - before.phase
        last = len(self.timeline.phases) - 1
        skipped = self.timeline.phases[before.phase : after.phase]
        answered = all(phase.question == skipped[0].question for phase in skipped)
        assert step in (0, 1) or answered or (after.phase == last and after.void_reason)
        if step:
            assert after.frames == 0
        if before.over:  # what was decided stays decided
            assert after[4:8] == before[4:8]
        else:  # one answer at a time, and none is taken back
            given = [(one.answer is not None) + len(one.further) for one in (before, after)]
            assert given[1] - given[0] in (0, 1)
            assert after.further[: len(before.further)] == before.further

    @invariant()
    def is_defined(self):
        trial = getattr(self, "trial", None)
        if trial is None:
            return
        timeline = self.timeline
        assert trial.over == (trial.phase > question(timeline))
        assert not (trial.completed and trial.void_reason)
        names = {phase.question.name for phase in timeline.phases if phase.question}
        given = (trial.answer is not None) + len(trial.further)
        assert trial.completed == (given == len(names))
        assert {trial.answer, *trial.further} <= {None, *timeline.answers[question(timeline)]}
        assert self.outcomes == trial.over  # ends exactly once
        assert trial.frames >= 0
        if trial.done(timeline):
            return
        phase = timeline.phases[trial.phase]
        shown = trial.shown_frames(timeline)
        entries = [entry for entry in phase.show if isinstance(entry, Frames)]
        assert [stimulus for stimulus, _ in shown] == [entry.stimulus for entry in entries]
        for entry, (_, frame) in zip(entries, shown, strict=True):
            last = (phase.frames - 1) // entry.every if entry.every else 0
            assert 0 <= frame <= last


TestAnyInputs = AnyInputs.TestCase
TestAnyInputs.settings = settings(max_examples=100, stateful_step_count=60, deadline=None)


def run(
    *inputs: FlipObservation, timeline: TrialScript = TIMELINE, start: Trial | None = None
) -> Trial:
    trial = start or Trial()
    for observed in inputs:
        trial = advance(trial, observed, timeline)
    return trial


def undisturbed(count: int) -> list[FlipObservation]:
    return [FlipObservation()] * count


@given(TIMELINES, st.lists(OBSERVED, max_size=30))
def test_every_attempt_can_still_end(timeline, inputs):
    """From any reachable state, patience, a held gaze and an answer lead to the end."""
    trial = Trial()
    for observed in inputs:
        if not trial.done(timeline):
            trial = advance(trial, observed, timeline)
    answer = min(timeline.answers[question(timeline)])
    for _ in range(200):
        if not trial.done(timeline):
            trial = advance(trial, FlipObservation(answer=answer), timeline)
    assert trial.done(timeline)


def test_an_undisturbed_attempt_shows_every_phase_for_its_planned_frames():
    """By hand: 3 dot + 4 + 2 gap + 4 + 1 answer + 2 rest = 16 flips."""
    shown, trial = [], Trial()
    while not trial.done(TIMELINE):
        shown.append((trial.phase, trial.shown_frames(TIMELINE)))
        trial = advance(trial, FlipObservation(answer="second"), TIMELINE)

    first, second = (
        [(phase, ((stimulus, frame),)) for frame in (0, 0, 1, 1)]
        for stimulus, phase in enumerate((FIRST, SECOND))
    )
    assert shown == [
        *[(FIXATE, ())] * 3, *first, *[(GAP, ())] * 2, *second,
        (RESPOND, ()), *[(ITI, ())] * 2,
    ]  # fmt: skip
    assert trial.completed
    assert trial.answer == "second"


def test_fixation_hold_starts_over_after_a_glance_away():
    away = FlipObservation(gaze=GazeVerdict.AWAY)

    assert run(*undisturbed(2), away, *undisturbed(2)).phase == FIXATE
    assert run(*undisturbed(2), away, *undisturbed(3)).phase == FIRST


def test_a_dot_that_is_never_fixated_ends_the_attempt():
    trial = run(*[FlipObservation(gaze=GazeVerdict.AWAY)] * 12)

    assert trial.void_reason == "no-fixation"


@pytest.mark.parametrize("flips", [3, 7, 9])  # interval 1, gap, interval 2
@pytest.mark.parametrize(
    ("gaze", "reason"), [(GazeVerdict.VIOLATION, "gaze-break"), (GazeVerdict.LOSS, "data-loss")]
)
def test_gaze_that_leaves_voids_in_enforce_warns_in_warn_and_only_there(flips, gaze, reason):
    disturbed = [*undisturbed(flips), FlipObservation(gaze=gaze)]

    assert run(*disturbed).void_reason == reason
    for mode in (GazeMode.WARN, GazeMode.MONITOR, GazeMode.NONE):
        trial = run(*disturbed, timeline=TIMELINE.model_copy(update={"gaze": mode}))
        assert trial.void_reason is None
        assert trial.warned == (mode is GazeMode.WARN)


def test_gaze_away_for_less_than_the_rule_changes_nothing():
    assert run(*undisturbed(3), *[FlipObservation(gaze=GazeVerdict.AWAY)] * 10).phase == RESPOND


def test_gaze_is_free_once_the_question_is_asked():
    trial = run(
        *undisturbed(13),
        FlipObservation(gaze=GazeVerdict.VIOLATION),
        FlipObservation(gaze=GazeVerdict.LOSS),
    )

    assert trial.phase == RESPOND


def test_a_missed_refresh_skips_a_clip_frame_and_keeps_the_duration():
    """Four refreshes, two per clip frame; the second flip comes one late."""
    trial = run(*undisturbed(3), FlipObservation(), FlipObservation(refreshes=2))
    assert (trial.phase, trial.frames, trial.shown_frames(TIMELINE)) == (FIRST, 3, ((0, 1),))
    assert run(FlipObservation(), start=trial).phase == GAP
    assert trial.dropped == 1


def test_a_late_onset_shortens_nothing():
    """The first flip of interval 1 comes late: the dot stood longer, the clip keeps its time."""
    onset = run(*undisturbed(3))
    trial = run(FlipObservation(refreshes=3), *undisturbed(3), start=onset)

    assert trial.phase == GAP
    assert trial.dropped == 0


def test_a_doubled_flip_repeats_its_clip_frame():
    trial = run(*undisturbed(3), FlipObservation(), FlipObservation(refreshes=0))

    assert (trial.frames, trial.shown_frames(TIMELINE)) == (1, ((0, 0),))


@pytest.mark.parametrize("flips", [4, 7, 10, 13])
def test_more_dropped_refreshes_than_tolerated_void(flips):
    """One is tolerated; a late onset of the question kept interval 2 on the screen."""
    assert run(*undisturbed(flips), FlipObservation(refreshes=2)).void_reason is None
    assert run(*undisturbed(flips), FlipObservation(refreshes=3)).void_reason == "dropped-frames"


def test_a_late_answer_voids_and_one_at_the_last_moment_counts():
    waiting = [*undisturbed(13), *undisturbed(5)]

    assert run(*waiting, FlipObservation(answer="first")).answer == "first"
    assert run(*waiting, FlipObservation()).void_reason == "too-late"
    assert run(*waiting, FlipObservation(), FlipObservation(answer="first")).answer is None
    patient = two_intervals(timeout=None)
    assert run(*undisturbed(500), timeline=patient).phase == RESPOND


def test_an_answer_before_the_question_is_not_taken():
    trial = run(*undisturbed(9), FlipObservation(answer="first"), *undisturbed(3))

    assert trial.phase == RESPOND
    assert trial.answer is None


@pytest.mark.parametrize("reason", ["paused", "quit", "focus-lost"])
@pytest.mark.parametrize("flips", [0, 3, 7, 9, 13])
def test_an_interrupt_voids_at_any_time_before_the_answer(reason, flips):
    assert run(*undisturbed(flips), FlipObservation(interrupt=reason)).void_reason == reason


def test_an_interrupt_after_the_answer_does_not_undo_it():
    trial = run(
        *undisturbed(13), FlipObservation(answer="first"), FlipObservation(interrupt="quit")
    )

    assert trial.completed
    assert trial.void_reason is None


def timeline_of(study, display: str) -> TrialScript:
    """The phases of the first main trial."""
    manifest = virtual_manifest(study, load_display(study.display.display))
    trials = make_plan(study, manifest, "P1", 0).trials
    main = next(trial for trial in trials if trial.role == "main")
    return Scripts(study, load_display(display), "en", manifest).of(main)


def lengths(timeline: TrialScript) -> dict[str, int | None]:
    return {phase.name: phase.frames for phase in timeline.phases}


def test_a_timeline_is_the_protocol_s_times_in_refreshes():
    protocol = load_protocol(Path("demo"))
    timeline = timeline_of(protocol, "laptop14-90hz")

    assert lengths(timeline) == {
        "fixate": 45, "first": 90, "gap": 45, "second": 90, "respond": None, "iti": 45,
    }  # fmt: skip
    assert [phase.watched for phase in timeline.phases] == [False, True, True, True, False, False]
    for place, stimulus in ((FIRST, 0), (SECOND, 1)):
        (shown,) = timeline.phases[place].show  # the dot lies under it
        assert (shown.stimulus, shown.every) == (stimulus, 3)
    (dot,) = timeline.phases[GAP].show
    assert isinstance(dot, Picture)
    assert isinstance(dot.of, Dot)
    with pytest.raises(StudyError, match="whole refreshes at 144 Hz"):
        timeline_of(protocol, "fhd24-144hz")


def test_a_timeline_carries_every_time_and_rule_of_its_protocol():
    protocol = load_protocol(Path("demo"))
    trial = protocol.trial.model_copy(
        update={"fixation_timeout_s": 2.0, "iti_s": 0.1, "dropped_frames_max": 7}
    )
    response = protocol.response.model_copy(update={"timeout_s": 3.0})
    gaze = protocol.gaze.model_copy(update={"mode": "monitor"})
    timed = protocol.model_copy(update={"trial": trial, "response": response, "gaze": gaze})

    timeline = timeline_of(timed, "laptop14-90hz")

    assert timeline.phases[FIXATE].gate_frames == 180
    assert timeline.phases[RESPOND].timeout_frames == 270
    assert timeline.answers[RESPOND] == {"first", "second"}
    assert timeline.phases[ITI].frames == 9
    assert (timeline.dropped_max, timeline.gaze) == (7, GazeMode.MONITOR)
    patient = response.model_copy(update={"timeout_s": None})
    endless = timeline_of(timed.model_copy(update={"response": patient}), "laptop14-90hz")
    assert endless.phases[RESPOND].timeout_frames is None


def test_a_time_that_is_no_whole_number_of_refreshes_names_the_command_that_says_more():
    with pytest.raises(StudyError, match=r"at 144 Hz; run 'metamerlab protocol check'$"):
        timeline_of(load_protocol(Path("demo")), "fhd24-144hz")


def test_only_an_enforced_fixation_has_no_planned_length():
    """The gaze decides when it ends; in every other mode its time does."""
    planned = {
        mode: TIMELINE.model_copy(update={"gaze": mode}).planned(FIXATE) for mode in GazeMode
    }

    assert planned == {
        GazeMode.ENFORCE: None,
        GazeMode.WARN: 3,
        GazeMode.MONITOR: 3,
        GazeMode.NONE: 3,
    }


# --- phases of other tasks -----------------------------------------------------------------


def shown_by(timeline: TrialScript, answer: str) -> list[tuple[str, tuple[tuple[int, int], ...]]]:
    """Every flip of an undisturbed attempt: its phase, and what it shows of the stimuli."""
    shown, trial = [], Trial()
    while not trial.done(timeline):
        shown.append((timeline.phases[trial.phase].name, trial.shown_frames(timeline)))
        trial = advance(trial, FlipObservation(answer=answer), timeline)
    assert trial.answer == answer
    return shown


def test_two_side_by_side_run_in_step():
    """By hand: 3 dot + 4 of both, two refreshes per frame + 1 answer + 2 rest."""
    assert shown_by(side_by_side(), "right") == [
        *[("fixate", ())] * 3,
        *[("both", ((0, frame), (1, frame))) for frame in (0, 0, 1, 1)],
        ("respond", ()), *[("iti", ())] * 2,
    ]  # fmt: skip


def test_a_missed_refresh_skips_the_same_frame_of_both_stimuli():
    trial = run(*undisturbed(4), FlipObservation(refreshes=2), timeline=side_by_side())

    assert trial.shown_frames(side_by_side()) == ((0, 1), (1, 1))


def test_three_stimuli_come_one_by_one_with_blanks_between():
    assert shown_by(three_stimuli(frames=2, gap=1), "b") == [
        *[("fixate", ())] * 3,
        *[("a", ((0, 0),))] * 2, ("gap-1", ()), *[("b", ((1, 0),))] * 2, ("gap-2", ()),
        *[("x", ((2, 0),))] * 2, ("respond", ()), *[("iti", ())] * 2,
    ]  # fmt: skip


@pytest.mark.parametrize("flips", [3, 7, 9, 13, 15])  # A, gap, B, gap, X
def test_gaze_is_watched_from_the_first_stimulus_to_the_last_of_any_task(flips):
    away = FlipObservation(gaze=GazeVerdict.VIOLATION)

    assert run(*undisturbed(flips), away, timeline=three_stimuli()).void_reason == "gaze-break"
    assert run(*undisturbed(19), away, timeline=three_stimuli()).void_reason is None


def test_answers_of_another_task_are_not_taken():
    trial = run(*undisturbed(7), FlipObservation(answer="first"), timeline=side_by_side())

    assert (trial.phase, trial.answer) == (2, None)
    assert (
        run(FlipObservation(answer="left"), timeline=side_by_side(), start=trial).answer == "left"
    )


FEEDBACK = ITI  # its place in two intervals; the blank is then the phase after


def answered(timeline: TrialScript) -> Trial:
    return run(*undisturbed(13), FlipObservation(answer="first"), timeline=timeline)


def test_feedback_follows_the_answer_and_lasts_as_planned():
    timeline = two_intervals(feedback=3)
    trial = answered(timeline)

    assert (trial.phase, trial.over, trial.done(timeline)) == (FEEDBACK, True, False)
    assert run(*undisturbed(2), timeline=timeline, start=trial).phase == FEEDBACK
    assert run(*undisturbed(3), timeline=timeline, start=trial).phase == FEEDBACK + 1


@pytest.mark.parametrize(
    "disturbance",
    [
        FlipObservation(interrupt="quit"),
        FlipObservation(interrupt="paused"),
        FlipObservation(interrupt="focus-lost"),
        FlipObservation(gaze=GazeVerdict.VIOLATION),
        FlipObservation(gaze=GazeVerdict.LOSS),
        FlipObservation(refreshes=5),
        FlipObservation(answer="second"),
    ],
)
def test_nothing_that_happens_during_feedback_undoes_the_answer(disturbance):
    timeline = two_intervals(feedback=3)
    trial = run(disturbance, timeline=timeline, start=answered(timeline))

    assert (trial.phase, trial.answer, trial.void_reason) == (FEEDBACK, "first", None)


def test_a_void_attempt_has_no_feedback():
    timeline = two_intervals(feedback=3)
    trial = run(*undisturbed(7), FlipObservation(interrupt="paused"), timeline=timeline)

    assert trial.phase == FEEDBACK + 1


def test_what_the_next_trial_needs_may_load_from_the_answer_on():
    """Not during anything watched, nor during the fixation before it."""
    timeline = two_intervals(feedback=3)

    assert [timeline.rests(index) for index in range(7)] == [False] * 4 + [True] * 3


FIX = ScriptPhase(name="fixate", frames=3, gate_frames=12)
REST = ScriptPhase(name=BLANK, frames=2)
SHOWN = watched("shown", 4, shows(0))


def asks(name: str, *, frames: int | None = None, **rest) -> ScriptPhase:
    return ScriptPhase(name=name, frames=frames, question=asking("yes", "no", name=name), **rest)


@pytest.mark.parametrize(
    ("phases", "message"),
    [
        ((SHOWN, asks("answer")), "last phase"),
        ((SHOWN, ScriptPhase(name=BLANK, frames=None)), "last phase"),
        ((asks("answer"), REST), "watched phases"),
        (
            (SHOWN, ScriptPhase(name="rest", frames=2), watched("b", 2), asks("answer"), REST),
            "'rest': watched phases must stand together, unless a question",
        ),
        ((SHOWN, REST), "a phase that an answer ends"),
        (
            (SHOWN, asks("answer"), ScriptPhase(name="idle", frames=None), REST),
            "'idle': can never end, for it has no length and asks nothing; give it frames",
        ),
        ((SHOWN, asks("sure"), REST), r"study's own question must be asked \(got sure\)"),
        ((SHOWN, asks("answer"), SHOWN, asks("answer"), REST), "'answer': must be asked once"),
        ((SHOWN, asks("answer", frames=3, gate_frames=9), REST), "waits for gaze .* ask nothing"),
    ],
)
def test_a_list_of_phases_that_the_machine_cannot_run_is_refused(phases, message):
    with pytest.raises(ValueError, match=message):
        a_script(phases, 1, GazeMode.NONE)


# --- several questions ---------------------------------------------------------------------


THREE = a_script(
    (FIX, SHOWN, asks("answer", timeout_frames=6), watched("again", 4, shows(1, 2)),
     asks("seen", timeout_frames=6), asks("sure", timeout_frames=6), REST),
)  # fmt: skip


def test_each_question_takes_its_own_answer_and_the_last_completes():
    trial = run(*undisturbed(7), FlipObservation(answer="yes"), timeline=THREE)
    assert (trial.phase, trial.answer, trial.completed) == (3, "yes", False)
    trial = run(*undisturbed(4), FlipObservation(answer="no"), timeline=THREE, start=trial)
    assert (trial.phase, trial.further, trial.over) == (5, ("no",), False)
    trial = run(FlipObservation(answer="yes"), timeline=THREE, start=trial)
    assert (trial.answer, trial.further, trial.completed) == ("yes", ("no", "yes"), True)
    assert run(*undisturbed(2), timeline=THREE, start=trial).done(THREE)


@pytest.mark.parametrize("flips", range(8, 14))  # of the second stimulus and the questions after
@pytest.mark.parametrize(
    ("disturbance", "reason"),
    [
        ([FlipObservation(interrupt="paused")], "paused"),
        ([FlipObservation(interrupt="quit")], "quit"),
        ([FlipObservation(interrupt="focus-lost")], "focus-lost"),
        ([FlipObservation(gaze=GazeVerdict.VIOLATION)], "gaze-break"),
        ([FlipObservation(gaze=GazeVerdict.LOSS)], "data-loss"),
        ([FlipObservation(), FlipObservation(refreshes=4)], "dropped-frames"),
        ([FlipObservation()] * 20, "too-late"),
    ],
)
def test_whatever_voids_an_attempt_voids_it_between_questions_too(flips, disturbance, reason):
    told = {7: "yes", 12: "no"}  # the flips at which a question waits
    inputs = [FlipObservation(answer=told.get(flip)) for flip in range(flips)]
    trial = run(*inputs, timeline=THREE)
    watches = THREE.phases[trial.phase].watched
    for observed in disturbance:
        if not trial.over:
            trial = advance(trial, observed, THREE)

    if reason in ("gaze-break", "data-loss", "dropped-frames") and not watches:
        assert trial.void_reason is None
    else:
        assert (trial.void_reason, trial.completed) == (reason, False)


def test_an_answer_ends_the_stimulus_that_it_is_about_and_no_other_question_follows():
    speeded = watched("shown", None, shows(0), question=asking("yes", "no"), timeout_frames=30)
    script = a_script((FIX, speeded, REST))

    trial = run(*undisturbed(9), FlipObservation(answer="yes"), timeline=script)

    assert (trial.phase, trial.answer, trial.completed) == (2, "yes", True)
    assert run(*undisturbed(33), timeline=script).void_reason == "too-late"


@pytest.mark.parametrize("flips", [4, 9])
def test_a_question_that_outlasts_its_stimulus_takes_an_answer_during_both(flips):
    question = asking("yes", "no")
    wait = ScriptPhase(name="respond", frames=None, question=question, timeout_frames=5)
    script = a_script((FIX, watched("shown", 4, shows(0), question=question), wait, REST))

    trial = run(*undisturbed(flips), FlipObservation(answer="no"), timeline=script)

    assert (trial.phase, trial.answer, trial.completed) == (3, "no", True)
    assert run(*undisturbed(12), timeline=script).void_reason == "too-late"
    alone = a_script((FIX, watched("shown", 4, shows(0), question=question), REST))
    assert run(*undisturbed(7), timeline=alone).void_reason == "too-late"
