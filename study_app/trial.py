"""One attempt at a trial as a pure state machine, counted in refreshes of the display.

A trial is a list of phases (`protocols.phases`). A `Trial` says where in the list the next flip
is. After that flip, `advance` takes what was observed and returns the next `Trial`. No clock,
window, tracker or keyboard is read here, and no task is known: a late flip is a number of
refreshes, gaze is a verdict, an answer is a name.

::

    fixate -> the task's phases -> respond [-> feedback] -> iti -> done
       \\____________\\_______________/  void: gaze, loss, time-out, dropped frames,
                                        pause, quit, focus
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import NamedTuple

from protocols.display import Display
from protocols.journal import VoidReason
from protocols.phases import ITI, Clip, Image, Phase
from protocols.plan import PlannedTrial, trial_phases
from protocols.schema import StudyProtocol
from protocols.tasks.base import whole_frames


class Watch(Enum):
    """What the gaze says at one frame."""

    HELD = "held"
    """In the window now."""
    AWAY = "away"
    """Not in the window, or no data, but not for long enough to matter."""
    VIOLATION = "violation"
    """Away for longer than the protocol allows."""
    LOSS = "loss"
    """No data for longer than a blink, or too often."""


class GazeMode(Enum):
    """What follows from a violation or a loss."""

    ENFORCE = "enforce"
    WARN = "warn"
    MONITOR = "monitor"
    NONE = "none"


@dataclass(frozen=True)
class Timeline:
    """The phases of one trial on one display, and the rules for voiding it.

    The last phase is the blank that ends it; those that gaze is watched in stand together.
    """

    phases: tuple[Phase, ...]
    dropped_max: int
    gaze: GazeMode

    def __post_init__(self) -> None:
        """Check what the machine relies on."""
        if self.phases[-1].name != ITI or self.phases[-1].frames is None:
            raise ValueError("the last phase must be the inter-trial interval, of a fixed length")
        watched = [index for index, phase in enumerate(self.phases) if phase.watched]
        if not watched or watched != list(range(watched[0], watched[-1] + 1)):
            raise ValueError("a trial must have watched phases, and they must stand together")
        if not any(phase.ends_on for phase in self.phases):
            raise ValueError("a trial must have a phase that an answer ends")

    @classmethod
    def of(cls, protocol: StudyProtocol, display: Display, trial: PlannedTrial) -> Timeline:
        """Return the phases of a trial.

        Raises
        ------
        StudyError
            If a time is not whole refreshes: `protocols.feasibility` says it in full.
        """
        phases = trial_phases(protocol, display, practice=trial.role == "practice")
        return cls(
            (*phases, Phase(ITI, whole_frames(display, protocol.trial.iti_s))),
            protocol.trial.dropped_frames_max,
            GazeMode(protocol.gaze.mode),
        )

    def planned(self, index: int) -> int | None:
        """Return the length of a phase in refreshes; None where the participant decides."""
        phase = self.phases[index]
        gated = phase.gate_frames is not None and self.gaze is GazeMode.ENFORCE
        return None if gated else phase.frames

    @property
    def watched_frames(self) -> int:
        """Refreshes in which gaze is watched."""
        return sum(phase.frames or 0 for phase in self.phases if phase.watched)

    def rests(self, index: int) -> bool:
        """Return whether nothing moves any more, so that the next stimuli may load."""
        return index > self._last_watched

    @cached_property
    def stimuli(self) -> tuple[tuple[Clip | Image, ...], ...]:
        """What of the trial's stimuli each phase shows."""
        return tuple(
            tuple(entry for entry in phase.show if isinstance(entry, Clip | Image))
            for phase in self.phases
        )

    @cached_property
    def _last_watched(self) -> int:
        return max(i for i, phase in enumerate(self.phases) if phase.watched)


class Observed(NamedTuple):
    """What happened up to one flip."""

    refreshes: int = 1
    """Refreshes since the flip before: 1 in time, more where some were missed, 0 where two
    flips fell into one."""
    gaze: Watch = Watch.HELD
    answer: str | None = None
    interrupt: VoidReason | None = None
    """`paused`, `quit` or `focus-lost`."""


class Trial(NamedTuple):
    """An attempt: what the next flip shows, and how it ended once it has."""

    phase: int = 0
    """Of the phase; past the last one, the attempt is done."""
    frames: int = 0
    """Refreshes of this phase before the next flip; behind a gate, of the present hold."""
    waited: int = 0
    """Refreshes since the gate closed."""
    dropped: int = 0
    """Refreshes missed from the first watched phase to the onset of the answer phase."""
    answer: str | None = None
    void_reason: VoidReason | None = None
    warned: bool = False

    @property
    def completed(self) -> bool:
        """Whether an answer was given."""
        return self.answer is not None

    @property
    def over(self) -> bool:
        """Whether the outcome is fixed; feedback and blank may still be running."""
        return self.completed or self.void_reason is not None

    def done(self, timeline: Timeline) -> bool:
        """Return whether every phase is over."""
        return self.phase == len(timeline.phases)

    def shown_frames(self, timeline: Timeline) -> tuple[tuple[int, int], ...]:
        """Return (stimulus, frame) of everything of the trial's that the next flip shows."""
        stimuli = timeline.stimuli[self.phase]
        if not stimuli:
            return ()
        phase = timeline.phases[self.phase]
        return tuple([(entry.stimulus, phase.clip_frame(entry, self.frames)) for entry in stimuli])


def advance(trial: Trial, observed: Observed, timeline: Timeline) -> Trial:
    """Return the trial after one more flip.

    A flip that comes late shortens nothing: a clip skips the frames that are late and keeps its
    duration. Where the late flip is the first of a phase, the phase before was longer.

    Raises
    ------
    ValueError
        If the trial is done; start a new one.
    """
    if trial.done(timeline):
        raise ValueError("the trial is done; start a new one")
    phase = timeline.phases[trial.phase]
    # The first flip of a phase is its onset, however late it came.
    step = 1 if trial.frames == 0 else observed.refreshes
    if trial.over:
        return _lasted(trial, step, phase)
    if observed.interrupt is not None:
        return _void(trial, observed.interrupt, timeline)
    trial = _count_dropped(trial, observed, timeline)
    if trial.dropped > timeline.dropped_max:
        return _void(trial, "dropped-frames", timeline)
    if phase.watched and observed.gaze in (Watch.VIOLATION, Watch.LOSS):
        if timeline.gaze is GazeMode.ENFORCE:
            reason: VoidReason = "data-loss"
            if observed.gaze is Watch.VIOLATION:
                reason = "gaze-break"
            elif observed.refreshes - 1 > timeline.dropped_max:
                reason = "dropped-frames"  # gaze was not read either while nothing was shown
            return _void(trial, reason, timeline)
        if timeline.gaze is GazeMode.WARN:
            trial = trial._replace(warned=True)
    if phase.gate_frames is not None:
        return _gated(trial, observed, step, timeline)
    if observed.answer is not None and observed.answer in phase.ends_on:
        return trial._replace(phase=trial.phase + 1, frames=0, answer=observed.answer)
    if phase.timeout_frames is not None and trial.frames + step >= phase.timeout_frames:
        return _void(trial, "too-late", timeline)
    return _lasted(trial, step, phase)


def _lasted(trial: Trial, step: int, phase: Phase) -> Trial:
    """Go on by so many refreshes, to the next phase where this one has had its length."""
    index, frames = trial.phase, trial.frames + step
    if phase.frames is not None and frames >= phase.frames:
        index, frames = index + 1, 0
    return Trial(index, frames, *trial[2:])  # for every flip: half of what `_replace` takes


def _void(trial: Trial, reason: VoidReason, timeline: Timeline) -> Trial:
    return trial._replace(phase=len(timeline.phases) - 1, frames=0, void_reason=reason)


def _gated(trial: Trial, observed: Observed, step: int, timeline: Timeline) -> Trial:
    """Wait until gaze was held for the length of the phase."""
    phase = timeline.phases[trial.phase]
    gated = timeline.gaze is GazeMode.ENFORCE
    held = not gated or observed.gaze is Watch.HELD
    shown = trial._replace(
        frames=trial.frames + step if held else 0,  # the hold starts over
        waited=trial.waited + observed.refreshes,
    )
    if shown.frames >= (phase.frames or 0):
        return shown._replace(phase=shown.phase + 1, frames=0, waited=0)
    if gated and shown.waited >= (phase.gate_frames or 0):
        return _void(shown, "no-fixation", timeline)
    return shown


def _count_dropped(trial: Trial, observed: Observed, timeline: Timeline) -> Trial:
    """Count the missed refreshes that kept a picture of a watched phase on the screen."""
    kept = trial.phase if trial.frames else trial.phase - 1
    if observed.refreshes <= 1 or kept < 0 or not timeline.phases[kept].watched:
        return trial
    return trial._replace(dropped=trial.dropped + observed.refreshes - 1)
