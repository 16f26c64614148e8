"""Records of an attempt: the journal's event, and its side files of gaze and flips."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from protocols.journal import Attempt, FurtherAnswer, PhaseRecord, ShownStimulus
from protocols.latency import LiveFrames, SaccadeTimes
from protocols.manifest import Manifest
from protocols.phases import STUDY_QUESTION
from protocols.plan import PlannedTrial
from protocols.script import GazeMode, TrialScript
from study_app.attempt import AttemptLog, FlipRecord
from study_app.gaze.saccades import Saccade
from study_app.gaze.source import GazeSample
from study_app.live.in_trials import KeptPixels, LiveFrame, live_entries
from study_app.recorder import Recorder
from study_app.session import RunTrial
from study_app.trial import Trial

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
    planned, stem = step.trial, f"{step.position:04d}"
    gaze_file = None
    if watched.stored and log.samples:
        gaze_file = recorder.side_file(
            f"gaze/{stem}", ".csv", _gaze_csv(log.samples, recorder.start_s)
        )
    flips_file = recorder.side_file(
        f"flips/{stem}", ".csv", _flips_csv(planned, log, script, manifest, recorder.start_s, kept)
    )
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
