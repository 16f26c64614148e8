"""Timelines that tests of the trial machine run, and what may happen at a flip."""

from hypothesis import strategies as st
from scripts import a_script, asking, shows, watched

from protocols.phases import ITI as BLANK
from protocols.script import GazeMode, ScriptPhase, TrialScript
from study_app.trial import FlipObservation, GazeVerdict


def a_timeline(
    shown: tuple[ScriptPhase, ...],
    *,
    fixate=3,
    wait=12,
    iti=2,
    timeout=6,
    feedback=0,
    answers=("first", "second"),
    dropped_max=1,
    gaze=GazeMode.ENFORCE,
) -> TrialScript:
    """The task's phases between those that every task has; a feedback of 0 refreshes is none."""
    return a_script(
        (
            ScriptPhase(name="fixate", frames=fixate, gate_frames=wait),
            *shown,
            ScriptPhase(
                name="respond", frames=None, question=asking(*answers), timeout_frames=timeout
            ),
            *([ScriptPhase(name="feedback", frames=feedback)] if feedback else []),
            ScriptPhase(name=BLANK, frames=iti),
        ),
        dropped_max,
        gaze,
    )


def two_intervals(interval=4, gap=2, per_frame=2, **rest) -> TrialScript:
    return a_timeline(
        (
            watched("first", interval, shows(0, per_frame)),
            watched("gap", gap),
            watched("second", interval, shows(1, per_frame)),
        ),
        **rest,
    )


def side_by_side(frames=4, per_frame=2, **rest) -> TrialScript:
    both = watched("both", frames, shows(0, per_frame, -99), shows(1, per_frame, 99))
    return a_timeline((both,), **({"answers": ("left", "right")} | rest))


def three_stimuli(frames=4, gap=2, **rest) -> TrialScript:
    """A, B and X, as stills."""
    return a_timeline(
        (
            watched("a", frames, shows(0)),
            watched("gap-1", gap),
            watched("b", frames, shows(1)),
            watched("gap-2", gap),
            watched("x", frames, shows(2)),
        ),
        **({"answers": ("a", "b")} | rest),
    )


OBSERVED = st.builds(
    FlipObservation,
    refreshes=st.integers(0, 5),
    gaze=st.sampled_from(GazeVerdict),
    answer=st.sampled_from([None, None, "first", "second", "left", "right", "a", "b", "sure"]),
    interrupt=st.sampled_from([None] * 9 + ["paused", "quit", "focus-lost"]),
)
COMMON = {
    "fixate": st.integers(1, 5),
    "wait": st.integers(6, 20),
    "iti": st.integers(1, 3),
    "timeout": st.none() | st.integers(1, 9),
    "feedback": st.integers(0, 3),
    "dropped_max": st.integers(0, 4),
    "gaze": st.sampled_from(GazeMode),
}
LENGTHS, PER_FRAME = st.integers(1, 8), st.integers(1, 4)
ASKED = st.sampled_from(["wait", "speeded", "stimulus, then wait", "stimulus of its own, wait"])
"""Ways to ask a question: alone, or over a stimulus that its answer ends."""


def several(asked, own, frames=3, timeout=6, **rest) -> TrialScript:
    """One to four questions, the study's own among them, with stimuli before and between."""
    shown = [watched("shown", frames, shows(0, 2))]
    for number, how in enumerate(asked):
        name = "answer" if number == own % len(asked) else f"further-{number}"
        question = asking("first", "second", name=name)
        if how == "stimulus of its own, wait":
            shown.append(watched(f"again-{number}", frames, shows(number % 3)))
        elif how == "speeded":
            shown.append(
                watched(
                    f"speeded-{number}", None, shows(1), question=question, timeout_frames=timeout
                )
            )
            continue
        elif how == "stimulus, then wait":
            shown.append(watched(f"while-{number}", frames, shows(1), question=question))
        shown.append(
            ScriptPhase(
                name=f"wait-{number}", frames=None, question=question, timeout_frames=timeout
            )
        )
    plain = a_timeline((shown[0],), timeout=timeout, **rest).phases
    phases = (plain[0], *shown, *plain[3:])
    return a_script(phases, rest.get("dropped_max", 1), rest.get("gaze", GazeMode.ENFORCE))


TIMELINES = st.one_of(
    st.builds(
        two_intervals, interval=LENGTHS, gap=st.integers(1, 4), per_frame=PER_FRAME, **COMMON
    ),
    st.builds(side_by_side, frames=LENGTHS, per_frame=PER_FRAME, **COMMON),
    st.builds(three_stimuli, frames=LENGTHS, gap=st.integers(1, 4), **COMMON),
    *[
        st.builds(
            several,
            asked=st.lists(ASKED, min_size=1, max_size=4),
            own=st.integers(0, 3),
            frames=LENGTHS,
            **COMMON,
        )
    ]
    * 3,
)
