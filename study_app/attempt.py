"""One attempt on a stage: poll, advance, draw, flip, stamp; no disk until it is over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from protocols.journal import GazeQuality, Interval, VoidReason
from protocols.plan import PlannedTrial
from protocols.session_schema import Response, SideName
from study_app.gaze.fixation import FixationMonitor
from study_app.gaze.source import GazeSample, GazeSource
from study_app.pacing import Flip, Pacer
from study_app.stage import KeyPress, Picture, Shown, Stage
from study_app.trial import WATCHED, Observed, Phase, Timeline, Trial, Watch, advance

CLIP_OF = {Phase.FIRST: 0, Phase.SECOND: 1}
"""Which of the pair a phase shows."""
TRACKER_PATIENCE_S = 2.0
"""A tracker that is silent for longer between two attempts ends the run."""


@dataclass
class Log:
    """What is collected during an attempt, in memory."""

    flips: list[tuple[Phase, int | None, Flip]] = field(default_factory=list)
    shown: list[Shown] = field(default_factory=list)
    """What the stage said of each of `flips`."""
    samples: list[GazeSample] = field(default_factory=list)
    answer: KeyPress | None = None
    answer_side: SideName | None = None
    quality: GazeQuality | None = None


@dataclass(frozen=True)
class Watcher:
    """A gaze source with the rules that judge it."""

    source: GazeSource
    monitor: FixationMonitor

    def stays_silent(self, stage: Stage, silence_s: float) -> bool:
        """Wait between two attempts for a source that fell silent; return whether it stays so."""
        while (silent_s := self.monitor.silent_s(stage.now())) > silence_s:
            if silent_s > max(TRACKER_PATIENCE_S, 2 * silence_s):
                return True
            stage.show(Picture(Phase.ITI))
            self.monitor.feed(self.source.poll())
        return False


@dataclass(frozen=True)
class AttemptResult:
    """How an attempt ended, and what was collected."""

    trial: Trial
    log: Log
    interrupts: tuple[VoidReason, ...]
    """Pause and quit keys, also those during the inter-trial interval."""


def run_attempt(
    planned: PlannedTrial,
    timeline: Timeline,
    response: Response,
    stage: Stage,
    watcher: Watcher | None,
    on_outcome: Callable[[Trial, Log], None],
    mark: Callable[[str, float], None] = lambda _text, _t_s: None,
) -> AttemptResult:
    """Run one attempt to the end of its inter-trial interval.

    Parameters
    ----------
    planned : PlannedTrial
        Its clips must be prepared.
    timeline : Timeline
        Lengths and rules in refreshes.
    response : Response
        Keys.
    stage : Stage
        Display, clock and keys.
    watcher : Watcher or None
        None in mode `none`.
    on_outcome : callable
        Called once, after the first flip of the inter-trial interval: the time to write.
    mark : callable
        Told the name and the onset of every phase, for recordings elsewhere. Must not wait.
    """
    pacer = Pacer(stage.refresh_hz)
    log = Log()
    state = Trial()
    written = False
    onset_s = 0.0  # of the answer phase
    interrupts: list[VoidReason] = []
    stage.key_presses()  # what was pressed before does not count
    while state.phase is not Phase.DONE:
        shown = stage.show(_picture(state, timeline))
        flip = pacer.flip(shown.t_s)
        log.shown.append(shown)
        log.flips.append((state.phase, state.clip_frame(timeline), flip))
        if state.frames == 0:  # the first flip of a phase
            if len(log.flips) == 1 or log.flips[-2][0] is not state.phase:
                mark(state.phase.value, flip.t_s)
            if watcher and state.phase is Phase.FIRST:
                planned_s = (2 * timeline.interval + timeline.gap) / stage.refresh_hz
                watcher.monitor.watch(flip.t_s, planned_s)
            elif state.phase is Phase.RESPOND:
                onset_s = flip.t_s
        gaze = _read_gaze(watcher, stage, log, recording=not state.over)
        if watcher and log.quality is None and state.phase not in (Phase.FIXATE, *WATCHED):
            if any(phase is Phase.FIRST for phase, _, _ in log.flips):
                log.quality = watcher.monitor.quality(flip.t_s)
            watcher.monitor.rest()
        if state.over and not written:
            on_outcome(state, log)
            written = True
        choice, interrupt = _read_keys(stage, state, planned, response, onset_s, log)
        if interrupt:
            interrupts.append(interrupt)
        state = advance(
            state,
            Observed(flip.refreshes if log.flips[1:] else 1, gaze, choice, interrupt),
            timeline,
        )
    return AttemptResult(state, log, tuple(interrupts))


def _picture(state: Trial, timeline: Timeline) -> Picture:
    resting = state.phase is Phase.ITI
    return Picture(
        state.phase,
        CLIP_OF.get(state.phase),
        state.clip_frame(timeline),
        state.void_reason if resting else None,
        state.warned and resting,
    )


def _read_keys(
    stage: Stage,
    state: Trial,
    planned: PlannedTrial,
    response: Response,
    onset_s: float,
    log: Log,
) -> tuple[Interval | None, VoidReason | None]:
    """Return the answer, where one is awaited, and the wish to pause or quit."""
    choice: Interval | None = None
    interrupt: VoidReason | None = None
    for press in stage.key_presses():
        side: SideName | None = None
        if press.key in response.quit_keys:
            interrupt = "quit"
        elif press.key in response.pause_keys:
            interrupt = interrupt or "paused"
        elif press.key in response.left_keys:
            side = "left"
        elif press.key in response.right_keys:
            side = "right"
        awaited = state.phase is Phase.RESPOND and press.t_s >= onset_s
        if side is not None and choice is None and awaited:
            choice = "first" if side == planned.first_side else "second"
            log.answer, log.answer_side = press, side
    if interrupt is None and stage.focus_lost() and state.phase is not Phase.ITI:
        interrupt = "focus-lost"
    return choice, interrupt


def _read_gaze(watcher: Watcher | None, stage: Stage, log: Log, *, recording: bool) -> Watch:
    if watcher is None:
        return Watch.HELD
    samples = watcher.source.poll()
    if recording:
        log.samples.extend(samples)
    watcher.monitor.feed(samples)
    return watcher.monitor.verdict(stage.now())
