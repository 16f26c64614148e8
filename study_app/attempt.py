"""One attempt on a stage: poll, advance, draw, flip, stamp; no disk until it is over.

Then it is recorded: the journal's event, and its side files of gaze and flips.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from protocols.journal import (
    Attempt,
    FurtherAnswer,
    GazeQuality,
    PhaseRecord,
    ShownStimulus,
    VoidReason,
)
from protocols.latency import LiveFrames, SaccadeTimes
from protocols.manifest import Manifest
from protocols.phases import ITI, STUDY_QUESTION
from protocols.plan import PlannedTrial
from protocols.script import GazeMode, ScriptPhase, ScriptQuestion, TrialScript
from study_app.gaze.fixation import FixationMonitor
from study_app.gaze.saccades import SUPPRESSED_AFTER_S, Saccade, SaccadeWatch
from study_app.gaze.source import GazeSample, GazeSource
from study_app.live.in_trials import KeptPixels, LiveFrame, live_entries
from study_app.pacing import JudgedFlip, Pacer
from study_app.recorder import Recorder
from study_app.session import RunTrial
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
        rests = script.rests(state.phase)
        notice = state.follows(script) if phase.follows else None
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


FLIPS_HEADER = "flip,t_s,interval_s,refreshes,kind,late_s,evidence,phase,clip_frame,frame_sha256"
LIVE_HEADER = (
    ",gaze_x_px,gaze_y_px,field_x_px,field_y_px,age_s,eye,seed,drawn_sha256,pixels_sha256,grid"
    ",suppressed"
)
"""Columns of live attempts: places are pixels of the stimulus that follows the gaze."""
_SEEN, _LOST = "%.6f,%r,%.2f,%.2f\n", "%.6f,%r,,\n"  # filled faster than f-strings are


class WatchedGaze(NamedTuple):
    """Saccades of an attempt, and whether its samples of gaze are kept."""

    saccades: Sequence[Saccade] = ()
    stored: bool = False


def attempt_event(
    step: RunTrial,
    trial: Trial,
    log: AttemptLog,
    script: TrialScript,
    manifest: Manifest,
    recorder: Recorder,
    kept: Mapping[int, KeptPixels],
    watched: WatchedGaze,
) -> Attempt:
    """Return the journal's event of an attempt, after writing its side files.

    Raises
    ------
    DiskError
        If a side file cannot be written.
    """
    planned, stem, begun_s = step.trial, f"{step.position:04d}", recorder.start_s
    gaze_file = None
    if watched.stored and log.samples:
        gaze_file = recorder.side_file(f"gaze/{stem}", ".csv", _gaze_csv(log.samples, begun_s))
    flips = _flips_csv(planned, log, script, manifest, begun_s, kept)
    flips_file = recorder.side_file(f"flips/{stem}", ".csv", flips)
    given = dict(log.given) if trial.completed else {}
    first = given.pop(STUDY_QUESTION.name, None)
    judged = trial.completed and planned.correct is not None
    return Attempt(
        **recorder.stamps(),
        trial=planned.id,
        role=planned.role,
        attempt=step.attempt,
        position=step.position,
        block=planned.block,
        repeat=planned.repeat,
        condition=planned.condition,
        track=planned.track,
        stimuli=_shown(planned, log.flips, manifest),
        answers=planned.answers,
        expected=planned.correct,
        outcome="completed" if trial.completed else "void",
        void_reason=trial.void_reason,
        answer=first.answer if first else None,
        correct=trial.answer == planned.correct if judged else None,
        key=first.press.key if first else None,
        rt_s=first.rt_s if first else None,
        phases=_phases(log.flips, script, recorder.session_time),
        dropped=trial.dropped,
        warned=trial.warned,
        gaze=log.quality if script.gaze is not GazeMode.NONE else None,
        gaze_file=gaze_file,
        flips_file=flips_file,
        live=_live(log, watched.saccades, recorder) if live_entries(script) else None,
        further=tuple(
            FurtherAnswer(question=name, answer=one.answer, key=one.press.key, rt_s=one.rt_s)
            for name, one in given.items()
        ),
    )


def _live(log: AttemptLog, saccades: Sequence[Saccade], recorder: Recorder) -> LiveFrames:
    flips = [shown.live.flip for shown in log.shown if shown.live is not None]
    return LiveFrames.of(
        ((flip.eye, flip.age_s) for flip in flips if flip.follows),
        tuple(
            SaccadeTimes(
                onset_s=recorder.session_time(one.onset_s),
                offset_s=recorder.session_time(one.offset_s),
            )
            for one in saccades
        ),
    )


def _shown(
    planned: PlannedTrial, flips: Sequence[FlipRecord], manifest: Manifest
) -> tuple[ShownStimulus, ...]:
    found = []
    for index, name in enumerate(planned.stimuli):
        clip = manifest.clip(name)
        frames = {frame for entry in flips for shown, frame in entry.frames if shown == index}
        found.append(
            ShownStimulus(
                name=name,
                sha256=clip.sha256,
                frames_shown=len(frames),
                frames_planned=len(clip.frames_sha256),
            )
        )
    return tuple(found)


def _phases(
    flips: Sequence[FlipRecord], script: TrialScript, session_time: Callable[[float], float]
) -> tuple[PhaseRecord, ...]:
    """Sum up the flips by phase; the flip that replaces a phase's last picture ends it."""
    records = []
    for number, (index, _, flip) in enumerate(flips):
        last = index == len(script.phases) - 1  # the blank that ends the trial
        if last or (number and flips[number - 1].phase == index):
            continue
        end = next(
            (i for i in range(number, len(flips)) if flips[i].phase != index), len(flips) - 1
        )
        inside = [flips[i].flip for i in range(number + 1, end + 1)]
        records.append(
            PhaseRecord(
                phase=script.phases[index].name,
                onset_s=session_time(flip.t_s),
                offset_s=session_time(flips[end].flip.t_s),
                refreshes=sum(entry.refreshes for entry in inside),
                planned=script.planned(index),
                dropped=sum(entry.missed for entry in inside),
                stimuli=tuple(stimulus for stimulus, _ in flips[number].frames),
            )
        )
    return tuple(records)


def _gaze_csv(samples: Sequence[GazeSample], start_s: float) -> bytes:
    lines = ["t_s,raw_t,x_px,y_px\n"]
    for t_s, raw_t, x_px, y_px in samples:
        if x_px == x_px and y_px == y_px:  # `GazeSample.valid`, for thousands of samples
            lines.append(_SEEN % (t_s - start_s, raw_t, x_px, y_px))
        else:
            lines.append(_LOST % (t_s - start_s, raw_t))
    return "".join(lines).encode("ascii")


def _flips_csv(
    planned: PlannedTrial,
    log: AttemptLog,
    script: TrialScript,
    manifest: Manifest,
    start_s: float,
    kept: Mapping[int, KeptPixels],
) -> bytes:
    hashes = [manifest.clip(name).frames_sha256 for name in planned.stimuli]
    names = [phase.name for phase in script.phases]
    is_live = bool(live_entries(script))
    lines = [FLIPS_HEADER + (LIVE_HEADER if is_live else "") + "\n"]
    before_s: float | None = None
    for (index, frames, flip), shown in zip(log.flips, log.shown, strict=True):
        t_s, refreshes, kind, late_s = flip
        interval = "" if before_s is None else f"{t_s - before_s:.6f}"
        numbers = " ".join([str(frame) for _, frame in frames])
        digests = " ".join([hashes[stimulus][frame] for stimulus, frame in frames])
        lines.append(
            f"{shown.number},{t_s - start_s:.6f},{interval},{refreshes},{kind},"
            f"{round(late_s, 6) + 0.0:.6f},{shown.evidence},{names[index]},"
            f"{numbers},{digests}{_live_columns(shown.live, kept) if is_live else ''}\n"
        )
        before_s = t_s
    return "".join(lines).encode("ascii")


def _live_columns(live: LiveFrame | None, kept: Mapping[int, KeptPixels]) -> str:
    if live is None:
        return "," * LIVE_HEADER.count(",")
    flip, gaze_state = live.flip, live.flip.gaze_state
    places = ",".join(map(repr, (*gaze_state.gaze_px, *gaze_state.field_px)))
    age = "" if math.isnan(flip.age_s) else f"{flip.age_s:.6f}"
    some = ",".join(kept.get(flip.number, ("", "")))
    suppressed = "" if flip.suppressed is None else int(flip.suppressed)
    return f",{places},{age},{flip.eye},{gaze_state.seed},{live.sha256},{some},{suppressed}"
