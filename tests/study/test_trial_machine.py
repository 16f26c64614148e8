"""The trial machine: no sequence of inputs reaches an undefined state."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from protocols.errors import StudyError
from protocols.load import load_display, load_protocol
from study_app.trial import GazeMode, Observed, Phase, Timeline, Trial, Watch, advance

TIMELINE = Timeline(
    fixate=3,
    fixate_timeout=12,
    interval=4,
    gap=2,
    iti=2,
    respond_timeout=6,
    refreshes_per_clip_frame=2,
    dropped_max=1,
    gaze=GazeMode.ENFORCE,
)
ORDER = list(Phase)
OBSERVED = st.builds(
    Observed,
    refreshes=st.integers(0, 5),
    gaze=st.sampled_from(Watch),
    choice=st.sampled_from([None, None, "first", "second"]),
    interrupt=st.sampled_from([None] * 9 + ["paused", "quit", "focus-lost"]),
)
TIMELINES = st.builds(
    Timeline,
    fixate=st.integers(1, 5),
    fixate_timeout=st.integers(6, 20),
    interval=st.integers(1, 8),
    gap=st.integers(1, 4),
    iti=st.integers(1, 3),
    respond_timeout=st.none() | st.integers(1, 9),
    refreshes_per_clip_frame=st.integers(1, 4),
    dropped_max=st.integers(0, 4),
    gaze=st.sampled_from(GazeMode),
)


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
        if before.phase is Phase.DONE:
            with pytest.raises(ValueError, match="done"):
                advance(before, observed, self.timeline)
            self.trial, self.outcomes = Trial(), 0
            return
        self.trial = after = advance(before, observed, self.timeline)
        self.outcomes += after.over and not before.over
        # One step forward, or to the end, or the hold again; never back, never skipping.
        step = ORDER.index(after.phase) - ORDER.index(before.phase)
        assert step in (0, 1) or after.phase is Phase.ITI
        if step:
            assert after.frames == 0 or after.phase is Phase.DONE
        if before.over:  # what was decided stays decided
            assert (after.completed, after.void_reason, after.choice) == (
                before.completed,
                before.void_reason,
                before.choice,
            )

    @invariant()
    def is_defined(self):
        trial = getattr(self, "trial", None)
        if trial is None:
            return
        assert trial.over == (trial.phase in (Phase.ITI, Phase.DONE))
        assert not (trial.completed and trial.void_reason)
        assert (trial.choice is not None) == trial.completed
        assert self.outcomes == trial.over  # ends exactly once
        assert trial.frames >= 0
        frame = trial.clip_frame(self.timeline)
        assert (frame is not None) == (trial.phase in (Phase.FIRST, Phase.SECOND))
        if frame is not None:
            assert (
                0
                <= frame
                <= (self.timeline.interval - 1) // (self.timeline.refreshes_per_clip_frame)
            )


TestAnyInputs = AnyInputs.TestCase
TestAnyInputs.settings = settings(max_examples=150, stateful_step_count=60, deadline=None)


def run(*inputs: Observed, timeline: Timeline = TIMELINE, start: Trial | None = None) -> Trial:
    trial = start or Trial()
    for observed in inputs:
        trial = advance(trial, observed, timeline)
    return trial


def undisturbed(count: int) -> list[Observed]:
    return [Observed()] * count


@given(TIMELINES, st.lists(OBSERVED, max_size=30))
def test_every_attempt_can_still_end(timeline, inputs):
    """From any reachable state, patience, a held gaze and an answer lead to the end."""
    trial = Trial()
    for observed in inputs:
        if trial.phase is not Phase.DONE:
            trial = advance(trial, observed, timeline)
    for _ in range(100):
        if trial.phase is not Phase.DONE:
            trial = advance(trial, Observed(choice="first"), timeline)
    assert trial.phase is Phase.DONE


def test_an_undisturbed_attempt_shows_every_phase_for_its_planned_frames():
    """By hand: 3 dot + 4 + 2 gap + 4 + 1 answer + 2 rest = 16 flips."""
    shown, trial = [], Trial()
    while trial.phase is not Phase.DONE:
        shown.append((trial.phase, trial.clip_frame(TIMELINE)))
        trial = advance(trial, Observed(choice="second"), TIMELINE)

    first, second = (
        [(phase, 0), (phase, 0), (phase, 1), (phase, 1)] for phase in (Phase.FIRST, Phase.SECOND)
    )
    assert shown == [
        *[(Phase.FIXATE, None)] * 3, *first, *[(Phase.GAP, None)] * 2, *second,
        (Phase.RESPOND, None), *[(Phase.ITI, None)] * 2,
    ]  # fmt: skip
    assert trial.completed
    assert trial.choice == "second"


def test_fixation_hold_starts_over_after_a_glance_away():
    away = Observed(gaze=Watch.AWAY)

    assert run(*undisturbed(2), away, *undisturbed(2)).phase is Phase.FIXATE
    assert run(*undisturbed(2), away, *undisturbed(3)).phase is Phase.FIRST


def test_a_dot_that_is_never_fixated_ends_the_attempt():
    trial = run(*[Observed(gaze=Watch.AWAY)] * 12)

    assert trial.void_reason == "no-fixation"


@pytest.mark.parametrize("flips", [3, 7, 9])  # interval 1, gap, interval 2
@pytest.mark.parametrize(
    ("gaze", "reason"), [(Watch.VIOLATION, "gaze-break"), (Watch.LOSS, "data-loss")]
)
def test_gaze_that_leaves_voids_in_enforce_warns_in_warn_and_only_there(flips, gaze, reason):
    disturbed = [*undisturbed(flips), Observed(gaze=gaze)]

    assert run(*disturbed).void_reason == reason
    for mode in (GazeMode.WARN, GazeMode.MONITOR, GazeMode.NONE):
        trial = run(*disturbed, timeline=replace(TIMELINE, gaze=mode))
        assert trial.void_reason is None
        assert trial.warned == (mode is GazeMode.WARN)


def test_gaze_away_for_less_than_the_rule_changes_nothing():
    assert run(*undisturbed(3), *[Observed(gaze=Watch.AWAY)] * 10).phase is Phase.RESPOND


def test_gaze_is_free_once_the_question_is_asked():
    trial = run(*undisturbed(13), Observed(gaze=Watch.VIOLATION), Observed(gaze=Watch.LOSS))

    assert trial.phase is Phase.RESPOND


def test_a_missed_refresh_skips_a_clip_frame_and_keeps_the_duration():
    """Four refreshes, two per clip frame; the second flip comes one late."""
    trial = run(*undisturbed(3), Observed(), Observed(refreshes=2))
    assert (trial.phase, trial.frames, trial.clip_frame(TIMELINE)) == (Phase.FIRST, 3, 1)
    assert run(Observed(), start=trial).phase is Phase.GAP
    assert trial.dropped == 1


def test_a_late_onset_shortens_nothing():
    """The first flip of interval 1 comes late: the dot stood longer, the clip keeps its time."""
    onset = run(*undisturbed(3))
    trial = run(Observed(refreshes=3), *undisturbed(3), start=onset)

    assert trial.phase is Phase.GAP
    assert trial.dropped == 0


def test_a_doubled_flip_repeats_its_clip_frame():
    trial = run(*undisturbed(3), Observed(), Observed(refreshes=0))

    assert (trial.frames, trial.clip_frame(TIMELINE)) == (1, 0)


@pytest.mark.parametrize("flips", [4, 7, 10, 13])
def test_more_dropped_refreshes_than_tolerated_void(flips):
    """One is tolerated; a late onset of the question kept interval 2 on the screen."""
    assert run(*undisturbed(flips), Observed(refreshes=2)).void_reason is None
    assert run(*undisturbed(flips), Observed(refreshes=3)).void_reason == "dropped-frames"


def test_a_late_answer_voids_and_one_at_the_last_moment_counts():
    waiting = [*undisturbed(13), *undisturbed(5)]

    assert run(*waiting, Observed(choice="first")).choice == "first"
    assert run(*waiting, Observed()).void_reason == "too-late"
    assert run(*waiting, Observed(), Observed(choice="first")).choice is None
    patient = replace(TIMELINE, respond_timeout=None)
    assert run(*undisturbed(500), timeline=patient).phase is Phase.RESPOND


def test_an_answer_before_the_question_is_not_taken():
    trial = run(*undisturbed(9), Observed(choice="first"), *undisturbed(3))

    assert trial.phase is Phase.RESPOND
    assert trial.choice is None


@pytest.mark.parametrize("reason", ["paused", "quit", "focus-lost"])
@pytest.mark.parametrize("flips", [0, 3, 7, 9, 13])
def test_an_interrupt_voids_at_any_time_before_the_answer(reason, flips):
    assert run(*undisturbed(flips), Observed(interrupt=reason)).void_reason == reason


def test_an_interrupt_after_the_answer_does_not_undo_it():
    trial = run(*undisturbed(13), Observed(choice="first"), Observed(interrupt="quit"))

    assert trial.completed
    assert trial.void_reason is None


def test_a_timeline_is_the_protocol_s_times_in_refreshes():
    protocol = load_protocol(Path("demo"))
    timeline = Timeline.of(protocol, load_display("laptop14-90hz"))

    assert (timeline.fixate, timeline.interval, timeline.gap) == (45, 90, 45)
    assert timeline.refreshes_per_clip_frame == 3
    with pytest.raises(StudyError, match="whole frames at 144 Hz"):
        Timeline.of(protocol, load_display("fhd24-144hz"))


def test_a_timeline_carries_every_time_and_rule_of_its_protocol():
    protocol, display = load_protocol(Path("demo")), load_display("laptop14-90hz")
    trial = protocol.trial.model_copy(
        update={"fixation_timeout_s": 2.0, "iti_s": 0.1, "dropped_frames_max": 7}
    )
    response = protocol.response.model_copy(update={"timeout_s": 3.0})
    gaze = protocol.gaze.model_copy(update={"mode": "monitor"})
    timed = protocol.model_copy(update={"trial": trial, "response": response, "gaze": gaze})

    timeline = Timeline.of(timed, display)

    assert (timeline.fixate_timeout, timeline.iti, timeline.respond_timeout) == (180, 9, 270)
    assert (timeline.dropped_max, timeline.gaze) == (7, GazeMode.MONITOR)
    patient = response.model_copy(update={"timeout_s": None})
    endless = Timeline.of(timed.model_copy(update={"response": patient}), display)
    assert endless.respond_timeout is None


def test_a_time_that_is_no_whole_number_of_refreshes_names_the_command_that_says_more():
    with pytest.raises(StudyError, match=r"at 144 Hz; run 'metamerlab protocol check'$"):
        Timeline.of(load_protocol(Path("demo")), load_display("fhd24-144hz"))


def test_only_an_enforced_fixation_has_no_planned_length():
    """The gaze decides when it ends; in every other mode its time does."""
    planned = {mode: replace(TIMELINE, gaze=mode).planned(Phase.FIXATE) for mode in GazeMode}

    assert planned == {
        GazeMode.ENFORCE: None,
        GazeMode.WARN: 3,
        GazeMode.MONITOR: 3,
        GazeMode.NONE: 3,
    }
