"""One attempt at a trial as a pure state machine, counted in refreshes of the display.

A script (`protocols.script`) lists the phases. A `Trial` says where in the list the next flip is.
After that flip, `advance` takes what was observed and returns the next `Trial`. No clock, window,
tracker or keyboard is read here, and no task is known: a late flip is a number of refreshes, gaze
is a verdict, an answer is a name.

::

    fixate -> the task's phases -> respond -> more questions [-> feedback] -> iti -> done
       \\____________\\_____________\\_____________/  void: gaze, loss, time-out, dropped
                                                    frames, pause, quit, focus
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from protocols.journal import VoidReason
from protocols.phases import STUDY_QUESTION
from protocols.script import GazeMode, Picture, ScriptPhase, TrialScript


class GazeVerdict(Enum):
    """State of gaze at one frame."""

    HELD = "held"
    """In the window now."""
    AWAY = "away"
    """Not in the window, or no data, but not for long enough to matter."""
    VIOLATION = "violation"
    """Away for longer than the protocol allows."""
    LOSS = "loss"
    """No data for longer than a blink, or too often."""


class FlipObservation(NamedTuple):
    """Observations up to one flip."""

    refreshes: int = 1
    """Refreshes since the flip before: 1 in time, more where some were missed, 0 where two
    flips fell into one."""
    gaze: GazeVerdict = GazeVerdict.HELD
    answer: str | None = None
    interrupt: VoidReason | None = None
    """`paused`, `quit` or `focus-lost`."""


class Trial(NamedTuple):
    """An attempt: what the next flip shows, and how it ended once it has."""

    phase: int = 0
    """Index of the phase; past the last one, the attempt is done."""
    frames: int = 0
    """Refreshes of this phase before the next flip; behind a gate, of the present hold."""
    waited: int = 0
    """Refreshes since the gate closed."""
    dropped: int = 0
    """Refreshes missed while a watched phase was shown."""
    answer: str | None = None
    """To the study's own question."""
    further: tuple[str, ...] = ()
    """To all others, in the order in which they were asked."""
    completed: bool = False
    """True if every question has its answer."""
    void_reason: VoidReason | None = None
    warned: bool = False

    @property
    def over(self) -> bool:
        """True if the outcome is fixed; feedback and blank may still be running."""
        return self.completed or self.void_reason is not None

    def done(self, script: TrialScript) -> bool:
        """Return True if every phase is over."""
        return self.phase == len(script.phases)

    def shown_frames(self, script: TrialScript) -> tuple[tuple[int, int], ...]:
        """Return (stimulus, frame) of everything of the trial's that the next flip shows."""
        shown, frames = script.frames[self.phase], self.frames
        return tuple([(one.stimulus, one.frame(frames)) for one in shown]) if shown else ()

    def follows(self, script: TrialScript) -> Picture | None:
        """Return the picture that says how the attempt stands, where the next flip shows one."""
        told = script.phases[self.phase].follows
        judged = self.completed and script.correct is not None
        stands = (
            self.void_reason,
            "warned" if self.warned else None,
            ("right" if self.answer == script.correct else "wrong") if judged else None,
        )
        return next((told[name] for name in stands if name in told), None)


def advance(trial: Trial, observed: FlipObservation, script: TrialScript) -> Trial:
    """Return the trial after one more flip.

    A flip that comes late shortens nothing: a clip skips the frames that are late and keeps its
    duration. Where the late flip is the first of a phase, the phase before was longer.

    Raises
    ------
    ValueError
        If the trial is done; start a new one.
    """
    phases = script.phases
    if trial.phase == len(phases):
        raise ValueError("the trial is done; start a new one")
    phase = phases[trial.phase]
    # The first flip of a phase is its onset, however late it came.
    step = 1 if trial.frames == 0 else observed.refreshes
    if trial.completed or trial.void_reason is not None:
        return _lasted(trial, step, phase)
    if observed.interrupt is not None:
        return _void(trial, observed.interrupt, script)
    if observed.refreshes > 1:
        trial = _count_dropped(trial, observed, script)
    if trial.dropped > script.dropped_max:
        return _void(trial, "dropped-frames", script)
    if phase.watched and observed.gaze in (GazeVerdict.VIOLATION, GazeVerdict.LOSS):
        if script.gaze is GazeMode.ENFORCE:
            reason: VoidReason = "data-loss"
            if observed.gaze is GazeVerdict.VIOLATION:
                reason = "gaze-break"
            elif observed.refreshes - 1 > script.dropped_max:
                reason = "dropped-frames"  # gaze was not read either while nothing was shown
            return _void(trial, reason, script)
        if script.gaze is GazeMode.WARN:
            trial = trial._replace(warned=True)
    if phase.gate_frames is not None:
        return _gated(trial, observed, step, script)
    if phase.question is not None:
        return _asked(trial, observed.answer, step, script)
    return _lasted(trial, step, phase)


def _lasted(trial: Trial, step: int, phase: ScriptPhase) -> Trial:
    """Go on by so many refreshes, to the next phase where this one has had its length."""
    index, frames = trial.phase, trial.frames + step
    if phase.frames is not None and frames >= phase.frames:
        index, frames = index + 1, 0
    # For every flip: a third of what `_replace` takes.
    return tuple.__new__(Trial, (index, frames, *trial[2:]))


def _asked(trial: Trial, answer: str | None, step: int, script: TrialScript) -> Trial:
    """Take an answer, and go on behind the last phase that asks for it; or wait for one."""
    phase, after = script.phases[trial.phase], script.after_answer[trial.phase]
    if answer in script.answers[trial.phase]:
        own = phase.question is not None and phase.question.name == STUDY_QUESTION.name
        told = {"answer": answer} if own else {"further": (*trial.further, answer)}
        given = 1 + (trial.answer is not None) + len(trial.further)
        return trial._replace(phase=after, frames=0, completed=given == script.questions, **told)
    frames = trial.frames + step
    ends = phase.frames is not None and frames >= phase.frames and after == trial.phase + 1
    if ends or (phase.timeout_frames is not None and frames >= phase.timeout_frames):
        return _void(trial, "too-late", script)
    return _lasted(trial, step, phase)


def _void(trial: Trial, reason: VoidReason, script: TrialScript) -> Trial:
    return trial._replace(phase=len(script.phases) - 1, frames=0, void_reason=reason)


def _gated(trial: Trial, observed: FlipObservation, step: int, script: TrialScript) -> Trial:
    """Wait until gaze was held for the length of the phase."""
    phase = script.phases[trial.phase]
    gated = script.gaze is GazeMode.ENFORCE
    held = not gated or observed.gaze is GazeVerdict.HELD
    shown = trial._replace(
        frames=trial.frames + step if held else 0,  # the hold starts over
        waited=trial.waited + observed.refreshes,
    )
    if shown.frames >= (phase.frames or 0):
        return shown._replace(phase=shown.phase + 1, frames=0, waited=0)
    if gated and shown.waited >= (phase.gate_frames or 0):
        return _void(shown, "no-fixation", script)
    return shown


def _count_dropped(trial: Trial, observed: FlipObservation, script: TrialScript) -> Trial:
    """Count the missed refreshes that kept a picture of a watched phase on the screen."""
    kept = trial.phase if trial.frames else trial.phase - 1
    if kept < 0 or not script.phases[kept].watched:
        return trial
    return trial._replace(dropped=trial.dropped + observed.refreshes - 1)
