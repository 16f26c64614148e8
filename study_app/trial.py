"""One attempt at a trial as a pure state machine, counted in refreshes of the display.

A `Trial` says what the next flip shows. After that flip, `advance` takes what was observed and
returns the next `Trial`. No clock, window, tracker or keyboard is read here: a late flip is a
number of refreshes, gaze is a verdict, an answer is an interval.

::

    FIXATE -> FIRST -> GAP -> SECOND -> RESPOND -> ITI -> DONE
       \\________\\_______\\______\\_________\\________/  void: gaze, loss, time-out, dropped
                                                         frames, pause, quit, focus
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

from protocols.display import Display
from protocols.errors import StudyError
from protocols.journal import Interval, VoidReason
from protocols.schema import StudyProtocol


class Phase(Enum):
    """What is on the screen."""

    FIXATE = "fixate"
    FIRST = "first"
    GAP = "gap"
    SECOND = "second"
    RESPOND = "respond"
    ITI = "iti"
    DONE = "done"


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


WATCHED = (Phase.FIRST, Phase.GAP, Phase.SECOND)
_NEXT = {
    Phase.FIXATE: Phase.FIRST,
    Phase.FIRST: Phase.GAP,
    Phase.GAP: Phase.SECOND,
    Phase.SECOND: Phase.RESPOND,
}


@dataclass(frozen=True)
class Timeline:
    """The protocol's times in refreshes of one display, and its rules for voiding."""

    fixate: int
    fixate_timeout: int
    interval: int
    gap: int
    iti: int
    respond_timeout: int | None
    refreshes_per_clip_frame: int
    dropped_max: int
    gaze: GazeMode

    @classmethod
    def of(cls, protocol: StudyProtocol, display: Display) -> Timeline:
        """Count a protocol's times in refreshes.

        Raises
        ------
        StudyError
            If one is not whole: `protocols.feasibility` says it in full.
        """
        timing, response = protocol.trial, protocol.response

        def frames(duration_s: float) -> int:
            whole = display.frames(duration_s)
            if not whole:
                raise StudyError(
                    f"{duration_s:g} s must be whole frames at {display.refresh_hz:g} Hz;"
                    " run 'metamerlab protocol check'"
                )
            return whole

        return cls(
            fixate=frames(timing.fixation_s),
            fixate_timeout=frames(timing.fixation_timeout_s),
            interval=frames(protocol.clips.duration_s),
            gap=frames(timing.gap_s),
            iti=frames(timing.iti_s),
            respond_timeout=None if response.timeout_s is None else frames(response.timeout_s),
            refreshes_per_clip_frame=frames(1 / protocol.clips.fps),
            dropped_max=timing.dropped_frames_max,
            gaze=GazeMode(protocol.gaze.mode),
        )

    def planned(self, phase: Phase) -> int | None:
        """Return the length of a phase in refreshes; None where the participant decides."""
        return {
            Phase.FIXATE: None if self.gaze is GazeMode.ENFORCE else self.fixate,
            Phase.FIRST: self.interval,
            Phase.GAP: self.gap,
            Phase.SECOND: self.interval,
            Phase.ITI: self.iti,
        }.get(phase)


@dataclass(frozen=True)
class Observed:
    """What happened up to one flip."""

    refreshes: int = 1
    """Refreshes since the flip before: 1 in time, more where some were missed, 0 where two
    flips fell into one."""
    gaze: Watch = Watch.HELD
    choice: Interval | None = None
    interrupt: VoidReason | None = None
    """`paused`, `quit` or `focus-lost`."""


@dataclass(frozen=True)
class Trial:
    """An attempt: what the next flip shows, and how it ended once it has."""

    phase: Phase = Phase.FIXATE
    frames: int = 0
    """Refreshes of this phase before the next flip; for FIXATE, of the present hold."""
    waited: int = 0
    """Refreshes since the dot appeared."""
    dropped: int = 0
    """Refreshes missed from the onset of interval 1 to that of the answer phase."""
    completed: bool = False
    void_reason: VoidReason | None = None
    choice: Interval | None = None
    warned: bool = False

    @property
    def over(self) -> bool:
        """Whether the outcome is fixed; the inter-trial interval may still be running."""
        return self.completed or self.void_reason is not None

    def clip_frame(self, timeline: Timeline) -> int | None:
        """Return which frame of its clip the next flip shows; None where no clip is shown."""
        if self.phase not in (Phase.FIRST, Phase.SECOND):
            return None
        return self.frames // timeline.refreshes_per_clip_frame


def advance(trial: Trial, observed: Observed, timeline: Timeline) -> Trial:
    """Return the trial after one more flip.

    A flip that comes late shortens nothing: the clip skips the frames that are late and keeps
    its duration. Where the late flip is the first of a phase, the phase before was longer.

    Raises
    ------
    ValueError
        If the trial is done; start a new one.
    """
    # The first flip of a phase is its onset, however late it came.
    step = 1 if trial.frames == 0 else observed.refreshes
    match trial.phase:
        case Phase.DONE:
            raise ValueError("the trial is done; start a new one")
        case Phase.ITI:
            shown = replace(trial, frames=trial.frames + step)
            return replace(shown, phase=Phase.DONE) if shown.frames >= timeline.iti else shown
        case _ if observed.interrupt is not None:
            return _void(trial, observed.interrupt)
        case Phase.FIXATE:
            return _fixate(trial, observed, step, timeline)
        case Phase.RESPOND:
            return _respond(trial, observed, step, timeline)
        case _:
            return _watched(trial, observed, step, timeline)


def _void(trial: Trial, reason: VoidReason) -> Trial:
    return replace(trial, phase=Phase.ITI, frames=0, void_reason=reason)


def _fixate(trial: Trial, observed: Observed, step: int, timeline: Timeline) -> Trial:
    gated = timeline.gaze is GazeMode.ENFORCE
    held = not gated or observed.gaze is Watch.HELD
    shown = replace(
        trial,
        frames=trial.frames + step if held else 0,  # the hold starts over
        waited=trial.waited + observed.refreshes,
    )
    if shown.frames >= timeline.fixate:
        return replace(shown, phase=Phase.FIRST, frames=0)
    if gated and shown.waited >= timeline.fixate_timeout:
        return _void(shown, "no-fixation")
    return shown


def _watched(trial: Trial, observed: Observed, step: int, timeline: Timeline) -> Trial:
    trial = _count_dropped(trial, observed)
    if observed.gaze in (Watch.VIOLATION, Watch.LOSS):
        if timeline.gaze is GazeMode.ENFORCE:
            return _void(trial, "gaze-break" if observed.gaze is Watch.VIOLATION else "data-loss")
        if timeline.gaze is GazeMode.WARN:
            trial = replace(trial, warned=True)
    if trial.dropped > timeline.dropped_max:
        return _void(trial, "dropped-frames")
    shown = replace(trial, frames=trial.frames + step)
    if shown.frames >= (timeline.planned(trial.phase) or 0):
        return replace(shown, phase=_NEXT[trial.phase], frames=0)
    return shown


def _respond(trial: Trial, observed: Observed, step: int, timeline: Timeline) -> Trial:
    if trial.frames == 0:  # a late onset kept the last frame of interval 2 on the screen
        trial = _count_dropped(trial, observed)
        if trial.dropped > timeline.dropped_max:
            return _void(trial, "dropped-frames")
    if observed.choice is not None:
        return replace(trial, phase=Phase.ITI, frames=0, completed=True, choice=observed.choice)
    shown = replace(trial, frames=trial.frames + step)
    if timeline.respond_timeout is not None and shown.frames >= timeline.respond_timeout:
        return _void(shown, "too-late")
    return shown


def _count_dropped(trial: Trial, observed: Observed) -> Trial:
    """Count missed refreshes; those before the onset of interval 1 only lengthened the dot."""
    if observed.refreshes <= 1 or (trial.phase is Phase.FIRST and trial.frames == 0):
        return trial
    return replace(trial, dropped=trial.dropped + observed.refreshes - 1)
