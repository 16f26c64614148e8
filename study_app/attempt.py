"""One attempt on a stage: poll, advance, draw, flip, stamp; no disk until it is over."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from protocols.journal import GazeQuality, VoidReason
from protocols.phases import ITI
from protocols.script import ScriptPhase, ScriptQuestion, TrialScript
from study_app.gaze.fixation import FixationMonitor
from study_app.gaze.saccades import SUPPRESSED_AFTER_S, Saccade, SaccadeWatch
from study_app.gaze.source import GazeSample, GazeSource
from study_app.pacing import JudgedFlip, Pacer
from study_app.stage import FlipPicture, FlipReport, FlipStage, KeyPress
from study_app.trial import FlipObservation, GazeVerdict, Trial, advance

BLANK = ScriptPhase(name=ITI, frames=1)
"""Phase that is shown while nothing else is."""
TRACKER_PATIENCE_S = 2.0
"""A tracker that is silent for longer between two attempts ends the run."""


class FlipRecord(NamedTuple):
    """One flip of an attempt."""

    phase: int
    """Index of the phase that it showed."""
    frames: tuple[tuple[int, int], ...]
    """(stimulus, frame) of everything of the trial's that it showed."""
    flip: JudgedFlip


class GivenAnswer(NamedTuple):
    """An answer to a question."""

    answer: str
    press: KeyPress
    onset_s: float
    """Time at which the question was first shown, on the stage's clock."""

    @property
    def rt_s(self) -> float:
        """Time from that onset to the key press, s."""
        return round(self.press.t_s - self.onset_s, 6)


@dataclass
class AttemptLog:
    """Data that are collected during an attempt, in memory."""

    flips: list[FlipRecord] = field(default_factory=list)
    shown: list[FlipReport] = field(default_factory=list)
    """Report of the stage on each of `flips`."""
    samples: list[GazeSample] = field(default_factory=list)
    given: dict[str, GivenAnswer] = field(default_factory=dict)
    """The answers by question, in their order."""
    quality: GazeQuality | None = None
    disturbance: str = ""
    """Disturbance between participant and display, if it voided the attempt."""


@dataclass
class GazeWatcher:
    """A gaze source with the rules that judge it. Two read it, each all: trials, and live frames.

    Attributes
    ----------
    saccades : SaccadeWatch or None
        Finds saccades in all samples.
    seen : GazeSample or None
        The newest sample that saw the eye.
    """

    source: GazeSource
    monitor: FixationMonitor
    saccades: SaccadeWatch | None = None
    seen: GazeSample | None = None
    _early: list[GazeSample] = field(default_factory=list)
    """Live frames had them, the trial did not yet."""
    _newest: GazeSample | None = None
    """The trial had it, live frames did not yet."""
    _ended: list[Saccade] = field(default_factory=list)

    def poll(self) -> Sequence[GazeSample]:
        """Return the newest samples, for a live frame; the trial gets them too. Never waits."""
        new = self._new()
        self._early += new
        before, self._newest = self._newest, None
        return new or ((before,) if before is not None else ())

    def taken(self) -> Sequence[GazeSample]:
        """Return all samples since the last call, for the trial. Never waits."""
        new = self._new()
        if new:
            self._newest = new[-1]
        if not self._early:
            return new
        early, self._early = self._early, []
        return [*early, *new]

    def _new(self) -> Sequence[GazeSample]:
        new = self.source.poll()
        self.seen = next((sample for sample in reversed(new) if sample.valid), self.seen)
        if self.saccades is not None:
            self._ended += self.saccades.take(new)
        return new

    def saccades_since(self, t_s: float) -> list[Saccade]:
        """Return those whose windows reach beyond a time, oldest first; it may not fall.

        The last one may be under way.
        """
        self._ended = [one for one in self._ended if one.offset_s + SUPPRESSED_AFTER_S >= t_s]
        watch = self.saccades
        now = [watch.last] if watch is not None and watch.last and watch.under_way else []
        return [*self._ended, *now]

    def stays_silent(self, stage: FlipStage, silence_s: float) -> bool:
        """Wait between two attempts for a source that fell silent; return whether it stays so."""
        while (silent_s := self.monitor.silent_s(stage.now())) > silence_s:
            if silent_s > max(TRACKER_PATIENCE_S, 2 * silence_s):
                return True
            stage.show(FlipPicture(BLANK, rests=True))
            self.monitor.feed(self.taken())
        return False


@dataclass(frozen=True)
class AttemptResult:
    """End of an attempt, and what was collected."""

    trial: Trial
    log: AttemptLog
    interrupts: tuple[VoidReason, ...]
    """Pause and quit keys, also those during the inter-trial interval."""


def run_attempt(
    script: TrialScript,
    stage: FlipStage,
    watcher: GazeWatcher | None,
    on_outcome: Callable[[Trial, AttemptLog], None],
    mark: Callable[[str, float], None] = lambda _text, _t_s: None,
) -> AttemptResult:
    """Run one attempt to the end of its inter-trial interval.

    Parameters
    ----------
    script : TrialScript
        What it shows must be prepared.
    stage : FlipStage
        Display, clock and keys.
    watcher : GazeWatcher or None
        None in mode `none`.
    on_outcome : callable
        Called once, after the first flip of the inter-trial interval: the time to write.
    mark : callable
        Told the name and the onset of every phase, for recordings elsewhere. Must not wait.
    """
    pacer = Pacer(stage.refresh_hz)
    log = AttemptLog()
    state = Trial()
    written, last = False, len(script.phases) - 1
    before: int | None = None  # the phase of the flip before
    onset_s = 0.0  # of the question
    asked: ScriptQuestion | None = None
    pauses = False
    interrupts: list[VoidReason] = []
    stage.key_presses()  # what was pressed before does not count
    while not state.done(script):
        phase = script.phases[state.phase]
        rests, notice = script.rests(state.phase), None
        if phase.follows:
            notice = state.follows(script)
        shown = stage.show(FlipPicture(phase, state.frames, rests, notice))
        flip = pacer.flip(shown.t_s)
        log.shown.append(shown)
        log.flips.append(FlipRecord(state.phase, state.shown_frames(script), flip))
        if before != state.phase:  # the first flip of a phase
            mark(phase.name, flip.t_s)
            watched_before = before is not None and script.phases[before].watched
            if watcher and phase.watched and not watched_before:
                watcher.monitor.watch(flip.t_s, script.watched_frames / stage.refresh_hz)
            pauses = watched_before and not phase.watched and not rests
            if phase.question != asked:
                asked, onset_s = phase.question, flip.t_s
        gaze = _read_gaze(watcher, stage, log, recording=not state.over)
        if watcher and pauses:  # a question comes between two watched stretches
            watcher.monitor.pause(flip.t_s)
            pauses = False
        if watcher and log.quality is None and rests:
            if any(script.phases[entry.phase].watched for entry in log.flips):
                log.quality = watcher.monitor.quality(flip.t_s)
            watcher.monitor.rest()
        if state.phase == last and not written:
            on_outcome(state, log)
            written = True
        answer, interrupt = _read_keys(stage, state, script, onset_s, log)
        if interrupt:
            interrupts.append(interrupt)
        refreshes = 1 if before is None else flip.refreshes
        before = state.phase
        state = advance(state, FlipObservation(refreshes, gaze, answer, interrupt), script)
    return AttemptResult(state, log, tuple(interrupts))


def _read_keys(
    stage: FlipStage, state: Trial, script: TrialScript, onset_s: float, log: AttemptLog
) -> tuple[str | None, VoidReason | None]:
    """Return the answer, where one is awaited, and the wish to pause or quit."""
    answer: str | None = None
    interrupt: VoidReason | None = None
    for press in stage.key_presses():
        if press.key in script.quit_keys:
            interrupt = "quit"
        elif press.key in script.pause_keys:
            interrupt = interrupt or "paused"
        elif answer is None and press.t_s >= onset_s and not state.over:
            question = script.phases[state.phase].question
            answer = question.answer_of(press.key, press.at) if question else None
            if question and answer is not None:
                log.given[question.name] = GivenAnswer(answer, press, onset_s)
    disturbance = stage.disturbed() if interrupt is None else ""
    if disturbance and not state.over:
        interrupt, log.disturbance = "focus-lost", disturbance
    return answer, interrupt


def _read_gaze(
    watcher: GazeWatcher | None, stage: FlipStage, log: AttemptLog, *, recording: bool
) -> GazeVerdict:
    if watcher is None:
        return GazeVerdict.HELD
    samples = watcher.taken()
    if recording:
        log.samples.extend(samples)
    watcher.monitor.feed(samples)
    return watcher.monitor.verdict(stage.now())
