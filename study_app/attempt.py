"""One attempt on a stage: poll, advance, draw, flip, stamp; no disk until it is over."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from protocols.journal import Attempt, GazeQuality, Interval, PhaseName, ShownClip, VoidReason
from protocols.journal import Phase as PhaseRecord
from protocols.manifest import Manifest
from protocols.plan import PlannedTrial
from protocols.session_schema import Response, SideName
from study_app.gaze.fixation import FixationMonitor
from study_app.gaze.source import GazeSample, GazeSource
from study_app.pacing import Flip, Pacer
from study_app.recorder import Recorder
from study_app.stage import KeyPress, Picture, Shown, Stage
from study_app.trial import WATCHED, GazeMode, Observed, Phase, Timeline, Trial, Watch, advance

_CLIP = {Phase.FIRST: 0, Phase.SECOND: 1}
FLIPS_HEADER = "flip,t_s,interval_s,refreshes,kind,late_s,evidence,phase,clip_frame,frame_sha256"


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
        _CLIP.get(state.phase),
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


def attempt_event(
    planned: PlannedTrial,
    number: int,
    position: int,
    trial: Trial,
    log: Log,
    timeline: Timeline,
    manifest: Manifest,
    recorder: Recorder,
    *,
    store_gaze: bool,
) -> Attempt:
    """Return the journal's event of an attempt, after writing its side files.

    Raises
    ------
    DiskError
        If a side file cannot be written.
    """
    stem = f"{position:04d}"
    gaze_file = None
    if store_gaze and log.samples:
        gaze_file = recorder.side_file(
            f"gaze/{stem}", ".csv", _gaze_csv(log.samples, recorder.session_time)
        )
    flips_file = recorder.side_file(
        f"flips/{stem}", ".csv", _flips_csv(planned, log, manifest, recorder.session_time)
    )
    chosen: Interval | None = trial.choice
    onset_s = next((f.t_s for phase, _, f in log.flips if phase is Phase.RESPOND), None)
    rt_s = None
    if chosen and log.answer and onset_s is not None:
        rt_s = round(log.answer.t_s - onset_s, 6)
    return Attempt(
        **recorder.stamps(),
        trial=planned.id,
        attempt=number,
        position=position,
        block=planned.block,
        practice=planned.practice,
        catch=planned.catch,
        repeat=planned.repeat,
        scene=planned.scene,
        size=planned.size,
        first=planned.first,
        second=planned.second,
        expected=planned.expected,
        first_side=planned.first_side,
        outcome="completed" if trial.completed else "void",
        void_reason=trial.void_reason,
        choice=chosen,
        chosen={"first": planned.first, "second": planned.second}[chosen] if chosen else None,
        chosen_side=log.answer_side if chosen else None,
        key=log.answer.key if chosen and log.answer else None,
        rt_s=rt_s,
        phases=_phases(log.flips, timeline, recorder.session_time),
        clips=(
            _shown(planned, 0, log.flips, manifest),
            _shown(planned, 1, log.flips, manifest),
        ),
        dropped=trial.dropped,
        warned=trial.warned,
        gaze=log.quality if timeline.gaze is not GazeMode.NONE else None,
        gaze_file=gaze_file,
        flips_file=flips_file,
    )


def _shown(
    planned: PlannedTrial,
    interval: int,
    flips: Sequence[tuple[Phase, int | None, Flip]],
    manifest: Manifest,
) -> ShownClip:
    clip = manifest.clip(planned.clips[interval])
    phase = (Phase.FIRST, Phase.SECOND)[interval]
    return ShownClip(
        method=clip.method,
        clip=str(clip.clip_name),
        clip_sha256=clip.sha256,
        frames_shown=len({frame for shown, frame, _ in flips if shown is phase}),
        frames_planned=len(clip.frames_sha256),
    )


def _phases(
    flips: Sequence[tuple[Phase, int | None, Flip]],
    timeline: Timeline,
    session_time: Callable[[float], float],
) -> tuple[PhaseRecord, ...]:
    """Sum up the flips by phase; the flip that replaces a phase's last picture ends it."""
    records = []
    for index, (phase, _, flip) in enumerate(flips):
        if phase is Phase.ITI or (index and flips[index - 1][0] is phase):
            continue
        end = next(
            (i for i in range(index, len(flips)) if flips[i][0] is not phase), len(flips) - 1
        )
        inside = [flips[i][2] for i in range(index + 1, end + 1)]
        name: PhaseName = phase.value
        records.append(
            PhaseRecord(
                phase=name,
                onset_s=session_time(flip.t_s),
                offset_s=session_time(flips[end][2].t_s),
                refreshes=sum(entry.refreshes for entry in inside),
                planned=timeline.planned(phase),
                dropped=sum(entry.missed for entry in inside),
            )
        )
    return tuple(records)


def _gaze_csv(samples: Sequence[GazeSample], session_time: Callable[[float], float]) -> bytes:
    text = io.StringIO()
    text.write("t_s,raw_t,x_px,y_px\n")
    for sample in samples:
        place = f"{sample.x_px:.2f},{sample.y_px:.2f}" if sample.valid else ","
        text.write(f"{session_time(sample.t_s):.6f},{sample.raw_t!r},{place}\n")
    return text.getvalue().encode("ascii")


def _flips_csv(
    planned: PlannedTrial,
    log: Log,
    manifest: Manifest,
    session_time: Callable[[float], float],
) -> bytes:
    hashes = [manifest.clip(name).frames_sha256 for name in planned.clips]
    text = io.StringIO()
    text.write(FLIPS_HEADER + "\n")
    before_s: float | None = None
    for (phase, frame, flip), shown in zip(log.flips, log.shown, strict=True):
        interval = "" if before_s is None else f"{flip.t_s - before_s:.6f}"
        clip = "," if frame is None else f"{frame},{hashes[_CLIP[phase]][frame]}"
        text.write(
            f"{shown.number},{session_time(flip.t_s):.6f},{interval},{flip.refreshes},{flip.kind},"
            f"{round(flip.late_s, 6) + 0.0:.6f},{shown.evidence},{phase.value},{clip}\n"
        )
        before_s = flip.t_s
    return text.getvalue().encode("ascii")
