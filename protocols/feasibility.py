"""Checks of what a display can do of a protocol, and what comes nearest where it cannot."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from itertools import combinations, islice

from protocols.disk.hashing import sha256_json
from protocols.display import COMMON_RATES_HZ, FRAME_TOLERANCE, Display
from protocols.errors import Problem, StudyError, shortest
from protocols.make_script import example_scripts
from protocols.manifest import Clip as BuiltClip
from protocols.manifest import Manifest, Renderer
from protocols.script import Picture, Ring, StoredPicture
from protocols.study_file.schema import StudyProtocol

TRIALS_IN_MEMORY = 2
"""The one that is shown, and the next one."""
MIB = 2**20
ASSUMED_RT_S = 1.5
"""For estimates of a session's length."""


def check_feasible(
    study: StudyProtocol, display: Display, manifest: Manifest | None = None
) -> list[Problem]:
    """Return everything about `study` that `display` cannot do.

    Times must be whole refreshes (they are never rounded), clip frames must last whole refreshes,
    clips must fit the screen and are shown pixel by pixel, and two pairs must fit the memory.
    Every message says the nearest feasible values. The list is empty where all is well.
    """
    problems = timing_problems(study, display)
    nominal = display.at_nominal_rate()
    if problems and nominal is not None:
        problems = [
            Problem(
                "refresh_hz",
                f"must be the display's nominal rate; write refresh_hz = {nominal.refresh_hz:g} in"
                f" its file (got {display.refresh_hz:g} Hz, as drivers measure it, which"
                " refresh_tolerance_share allows)",
            ),
            *timing_problems(study, nominal),
        ]
    size = list(_size(study, display))
    problems += size
    if not size:
        problems += _memory(study, display)
    if not problems:
        problems += islice(_places(study, display), 1)
    if problems == size:  # also where stimuli are too large: what a smaller screen would show
        problems += study.stimuli.unseen(display)
    if manifest is not None:
        problems += islice(_built_size(study, display, manifest), 1)
    return problems


def require_feasible(
    study: StudyProtocol, display: Display, manifest: Manifest | None = None
) -> None:
    """Raise `StudyError` with one line per problem of `check_feasible`."""
    problems = check_feasible(study, display, manifest)
    if problems:
        raise StudyError(
            f"study {study.study.name!r} must be feasible on display {display.name!r}:\n"
            + "\n".join(f"  {problem}" for problem in problems)
        )


def clip_size_px(study: StudyProtocol, display: Display) -> tuple[int, int]:
    """Return (width, height) of every stimulus in native pixels of the display."""
    return study.stimuli.size_px(display)


def clip_memory_bytes(study: StudyProtocol, display: Display) -> int:
    """Return the graphics memory of one clip: four channels a pixel."""
    width, height = clip_size_px(study, display)
    channels = 4 * study.stimuli.bit_depth // 8
    return study.stimuli.frames * width * height * channels


def session_duration_s(study: StudyProtocol, trials: int) -> float:
    """Return an estimate of the seconds that `trials` take, with breaks, each answer in 1.5 s."""
    timing = study.trial
    shown_s = study.task.shown_s(study.pool)
    answers_s = ASSUMED_RT_S * (1 if study.task.confidence is None else 2)
    trial_s = timing.fixation_s + shown_s + answers_s + timing.iti_s
    return trials * trial_s + (study.design.blocks - 1) * study.design.break_s


def virtual_manifest(study: StudyProtocol, display: Display) -> Manifest:
    """Return a manifest without pixels, marked as simulated: hashes of names stand for frames."""
    width, height = clip_size_px(study, display)
    clips = []
    shown = set(study.shown())
    for stimulus in study.stimuli.pool():
        if stimulus.name not in shown:
            continue
        count = study.stimuli.frames
        frames = [sha256_json(["virtual", stimulus.name, k]) for k in range(count)]
        clips.append(
            BuiltClip(
                name=stimulus.name,
                condition=dict(stimulus.condition),
                width_px=width,
                height_px=height,
                fps=study.stimuli.frame_hz,
                bit_depth=16 if study.stimuli.bit_depth == 16 else 8,
                seed=study.stimuli.seed,
                parameters={},
                hole_share=None,
                cache_key=sha256_json(["virtual", stimulus.name]),
                frames_sha256=tuple(frames),
            )
        )
    return Manifest(
        format=2,
        study=study.study.name,
        stimuli_sha256=study.stimuli_sha256,
        display=display.name,
        revision="virtual",
        renderer=Renderer(vendor="", renderer="virtual", version=""),
        versions={},
        simulated=True,
        clips=tuple(clips),
    )


def timing_problems(study: StudyProtocol, display: Display) -> list[Problem]:
    """Return times that are not whole refreshes, also those of a clip's frames."""
    return [*_times(study, display), *_rate(study, display)]


def stated_times_s(study: StudyProtocol) -> dict[str, float]:
    """Return every time of a trial that must be whole refreshes, by its place in the study."""
    times = {
        "trial.fixation_s": study.trial.fixation_s,
        "trial.fixation_timeout_s": study.trial.fixation_timeout_s,
        "trial.iti_s": study.trial.iti_s,
    } | {f"task.{key}": duration_s for key, duration_s in study.task.durations().items()}
    if study.stimuli.clip_s is not None:
        times = {f"{study.stimuli.section}.duration_s": study.stimuli.clip_s} | times
    if study.design.practice is not None and study.design.practice.feedback:
        times["trial.feedback_s"] = study.trial.feedback_s
    if study.response.timeout_s is not None:
        times["response.timeout_s"] = study.response.timeout_s
    return times


def _times(study: StudyProtocol, display: Display) -> Iterator[Problem]:
    for place, duration_s in stated_times_s(study).items():
        if display.frames(duration_s) in (None, 0):
            near = " or ".join(f"{near} s" for near in display.nearest_durations(duration_s))
            also = _other_displays({rate: duration_s * rate for rate in COMMON_RATES_HZ})
            yield Problem(
                place,
                f"must be whole refreshes at {display.refresh_hz:g} Hz (got {duration_s:g} s ="
                f" {duration_s * display.refresh_hz:g} refreshes); nearest: {near}{also}",
            )


def _other_displays(frames: Mapping[float, float]) -> str:
    """Name the refresh rates at which so many frames are whole."""
    rates = [
        f"{rate:g}"
        for rate, count in frames.items()
        if abs(count - round(count)) <= FRAME_TOLERANCE
    ]
    return f", or a display with {' or '.join(rates)} Hz" if rates else ""


def _rate(study: StudyProtocol, display: Display) -> Iterator[Problem]:
    if study.stimuli.clip_s is None:
        return
    fps = study.stimuli.frame_hz
    exact = display.refresh_hz / fps

    def whole(rate: float, n: int = max(1, round(exact))) -> bool:
        return abs(display.refresh_hz / rate - n) <= FRAME_TOLERANCE

    if whole(fps):
        return
    counts = {max(1, math.floor(exact)), max(1, math.ceil(exact))}
    rates = {n: shortest(display.refresh_hz / n, partial(whole, n=n)) for n in sorted(counts)}
    near = " or ".join(f"{rate} fps" for rate in rates.values())
    also = _other_displays({rate: rate / fps for rate in COMMON_RATES_HZ if rate >= fps})
    yield Problem(
        f"{study.stimuli.section}.fps",
        f"every clip frame must last whole refreshes at {display.refresh_hz:g} Hz"
        f" (got {fps:g} fps = {exact:g} refreshes); nearest: {near}{also}",
    )


def _size(study: StudyProtocol, display: Display) -> Iterator[Problem]:
    width, height = clip_size_px(study, display)
    section, unit = study.stimuli.section, study.stimuli.size_unit
    across_deg, down_deg = display.angles_deg(display.width_px, display.height_px)
    for place, wanted, got, most in (
        (f"{section}.width_{unit}", display.width_px, width, across_deg),
        (f"{section}.height_{unit}", display.height_px, height, down_deg),
    ):
        if got > wanted:
            near = f"{math.floor(most * 100) / 100:g} deg" if unit == "deg" else f"{wanted} px"
            yield Problem(
                place,
                f"stimuli must fit the screen pixel by pixel (got {got} px of {wanted} px at"
                f" {display.distance_mm:g} mm); nearest: {near}",
            )
    timing = study.trial
    for place, angle, extent_mm in (
        ("trial.fixation_x_deg", timing.fixation_x_deg, display.width_mm),
        ("trial.fixation_y_deg", timing.fixation_y_deg, display.height_mm),
    ):
        most = math.degrees(math.atan(extent_mm / 2 / display.distance_mm)) - timing.dot_deg / 2
        if abs(angle) > most:
            yield Problem(
                place,
                f"the dot must be on the screen (got {angle:g} deg); nearest:"
                f" {math.copysign(math.floor(most * 100) / 100, angle):g} deg",
            )


def _places(study: StudyProtocol, display: Display) -> Iterator[Problem]:
    """Return a problem where a trial cannot be run, or what it shows overlaps or leaves the screen.

    Pictures of words are as large as the screen, and the fixation target has its own check.
    """
    try:
        # Of every language: a task's own questions have texts of their own.
        script, *_ = [
            example_scripts(study, display, language)[0] for language in study.text.languages
        ]
    except StudyError as error:
        yield Problem("task", str(error).removeprefix("task: "))
        return
    (across, down), (width, height) = script.size_px, script.stimulus_px
    for phase, frames in zip(script.phases, script.frames, strict=True):
        if width % 2 and any(entry.crop for entry in frames):
            yield Problem(
                "stimuli.width_px",
                f"must be even: halves of the stimuli are shown (got {width} px)",
            )
        rects = [(*entry.at, *(entry.crop or (0, 0, width, height))[2:]) for entry in frames]
        pictures = [
            (*entry.at, *entry.size_px)
            for entry in phase.show
            if isinstance(entry, Picture) and isinstance(entry.of, Ring | StoredPicture)
        ]
        for x, y, wide, high in (*rects, *pictures):
            left, top = x + across // 2, y + down // 2
            if left < -1 or top < -1 or left + wide > across + 1 or top + high > down + 1:
                yield Problem(
                    "task",
                    f"phase {phase.name!r}: every stimulus must be whole on the screen (got one"
                    f" of {wide}x{high} px around pixel {left + wide / 2:.0f},"
                    f" {top + high / 2:.0f} of {across}x{down}); make stimuli smaller, or put"
                    " them nearer to the middle",
                )
        for (x, y, wide, high), (left, top, other_wide, other_high) in combinations(rects, 2):
            apart_x = x + wide <= left or left + other_wide <= x
            apart_y = y + high <= top or top + other_high <= y
            if not (apart_x or apart_y):
                yield Problem(
                    "task",
                    f"phase {phase.name!r}: stimuli must not overlap (got"
                    f" {abs(x + wide / 2 - left - other_wide / 2):.0f} px between the middles"
                    f" of stimuli {wide} px wide); put them farther apart, or make them"
                    " smaller",
                )


def _memory(study: StudyProtocol, display: Display) -> Iterator[Problem]:
    clip = clip_memory_bytes(study, display)
    budget = display.clip_memory_mib * MIB
    count = TRIALS_IN_MEMORY * study.task.stimuli_per_trial
    if count * clip <= budget:
        return
    recipe = study.stimuli
    shrink = math.sqrt(budget / (count * clip))
    width = 2 * math.floor(clip_size_px(study, display)[0] * shrink / 2)
    smaller = (
        f"width_deg = {math.floor(display.angles_deg(width, 1)[0] * 100) / 100:g}"
        if recipe.size_unit == "deg"
        else f"width_px = {width}"
    )
    fewer = int(budget // (count * clip // recipe.frames))
    shorter = (
        f"duration_s = {fewer / recipe.frame_hz:.4g} ({fewer} frames), or " if fewer > 1 else ""
    )
    yield Problem(
        recipe.section,
        f"the stimuli of two trials must fit {display.clip_memory_mib} MiB of graphics memory"
        f" (got {count * clip / MIB:.0f} MiB: {count} stimuli x {recipe.frames} frames);"
        f" nearest: {shorter}{smaller} with the same shape",
    )


def _built_size(study: StudyProtocol, display: Display, manifest: Manifest) -> Iterator[Problem]:
    width, height = clip_size_px(study, display)
    for clip in manifest.clips:
        if (clip.width_px, clip.height_px) != (width, height):
            yield Problem(
                f"clip {clip.name}",
                f"clips are shown pixel by pixel and never rescaled: must be {width}x{height}"
                f" px on this display (got {clip.width_px}x{clip.height_px} px, built for"
                f" {manifest.display!r}); build the clips for {display.name!r}, or set"
                + (
                    f" width_deg = {display.angles_deg(clip.width_px, 1)[0]:.4g}"
                    if study.stimuli.size_unit == "deg"
                    else f" width_px = {clip.width_px}"
                ),
            )
        if clip.fps != study.stimuli.frame_hz:
            yield Problem(
                f"clip {clip.name}",
                f"must be {study.stimuli.frame_hz:g} fps (got {clip.fps:g} fps); build again",
            )
