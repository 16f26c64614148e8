"""What is written of an attempt: the journal's event, and its side files of gaze and flips."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence

from protocols.journal import Attempt, Interval, PhaseName, ShownClip
from protocols.journal import Phase as PhaseRecord
from protocols.manifest import Manifest
from protocols.plan import PlannedTrial
from study_app.attempt import CLIP_OF, Log
from study_app.gaze.source import GazeSample
from study_app.pacing import Flip
from study_app.recorder import Recorder
from study_app.trial import GazeMode, Phase, Timeline, Trial

FLIPS_HEADER = "flip,t_s,interval_s,refreshes,kind,late_s,evidence,phase,clip_frame,frame_sha256"


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
        clip = "," if frame is None else f"{frame},{hashes[CLIP_OF[phase]][frame]}"
        text.write(
            f"{shown.number},{session_time(flip.t_s):.6f},{interval},{flip.refreshes},{flip.kind},"
            f"{round(flip.late_s, 6) + 0.0:.6f},{shown.evidence},{phase.value},{clip}\n"
        )
        before_s = flip.t_s
    return text.getvalue().encode("ascii")
