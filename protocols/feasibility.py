"""What a display can do of a protocol, and what comes nearest where it cannot."""

from __future__ import annotations

import math

from protocols.display import FRAME_TOLERANCE, Display
from protocols.errors import Problem, StudyError
from protocols.hashing import sha256_json
from protocols.manifest import Clip, Manifest, Renderer
from protocols.schema import StudyProtocol

CLIPS_IN_MEMORY = 4
"""The pair that is shown, and the next one."""
MIB = 2**20
COMMON_RATES_HZ = (60.0, 72.0, 75.0, 90.0, 100.0, 120.0, 144.0, 165.0, 240.0)
ASSUMED_RT_S = 1.5
"""For estimates of a session's length."""


def check_feasible(
    protocol: StudyProtocol, display: Display, manifest: Manifest | None = None
) -> list[Problem]:
    """Return everything about `protocol` that `display` cannot do.

    Times must be whole frames (they are never rounded), clip frames must last whole refreshes,
    clips must fit the screen and are shown pixel by pixel, and two pairs must fit the memory.
    Every message says the nearest feasible values. The list is empty where all is well.
    """
    problems = _times(protocol, display) + _rate(protocol, display)
    size = _size(protocol, display)
    problems += size
    if not size:
        problems += _memory(protocol, display)
    if manifest is not None:
        problems += _built_size(protocol, display, manifest)
    return problems


def require_feasible(
    protocol: StudyProtocol, display: Display, manifest: Manifest | None = None
) -> None:
    """Raise `StudyError` with one line per problem of `check_feasible`."""
    problems = check_feasible(protocol, display, manifest)
    if problems:
        raise StudyError(
            f"study {protocol.study.name!r} must be feasible on display {display.name!r}:\n"
            + "\n".join(f"  {problem}" for problem in problems)
        )


def clip_size_px(protocol: StudyProtocol, display: Display) -> tuple[int, int]:
    """Return (width, height) of every clip in native pixels of the display."""
    return display.centred_size_px(protocol.clips.width_deg, protocol.clips.height_deg)


def clip_memory_bytes(protocol: StudyProtocol, display: Display) -> int:
    """Return the graphics memory of one clip: four channels a pixel."""
    width, height = clip_size_px(protocol, display)
    channels = 4 * protocol.clips.bit_depth // 8
    return protocol.clips.frames * width * height * channels


def session_duration_s(protocol: StudyProtocol, trials: int) -> float:
    """Return an estimate of how long `trials` take, breaks included, answers in 1.5 s."""
    timing = protocol.trial
    trial_s = (
        timing.fixation_s
        + 2 * protocol.clips.duration_s
        + timing.gap_s
        + ASSUMED_RT_S
        + timing.iti_s
    )
    return trials * trial_s + (protocol.design.blocks - 1) * protocol.design.break_s


def virtual_manifest(protocol: StudyProtocol, display: Display) -> Manifest:
    """Return a manifest without pixels, marked as simulated: hashes of names stand for frames."""
    width, height = clip_size_px(protocol, display)
    clips = []
    for name in protocol.clip_names():
        size = next(size for size in protocol.sizes if size.name == name.size)
        frames = [sha256_json(["virtual", str(name), k]) for k in range(protocol.clips.frames)]
        clips.append(
            Clip(
                scene=name.scene,
                size=name.size,
                method=name.method,
                width_px=width,
                height_px=height,
                fps=protocol.clips.fps,
                bit_depth=protocol.clips.bit_depth,
                seed=protocol.clips.seed,
                parameters={},
                hole_share=size.hole_share or 0.0,
                cache_key=sha256_json(["virtual", str(name)]),
                frames_sha256=tuple(frames),
            )
        )
    return Manifest(
        format=1,
        study=protocol.study.name,
        stimuli_sha256=protocol.stimuli_sha256,
        display=display.name,
        revision="virtual",
        renderer=Renderer(vendor="", renderer="virtual", version=""),
        versions={},
        simulated=True,
        clips=tuple(clips),
    )


def _times(protocol: StudyProtocol, display: Display) -> list[Problem]:
    times = {
        "clips.duration_s": protocol.clips.duration_s,
        "trial.fixation_s": protocol.trial.fixation_s,
        "trial.fixation_timeout_s": protocol.trial.fixation_timeout_s,
        "trial.gap_s": protocol.trial.gap_s,
        "trial.iti_s": protocol.trial.iti_s,
    }
    if protocol.response.timeout_s is not None:
        times["response.timeout_s"] = protocol.response.timeout_s
    problems = []
    for place, duration_s in times.items():
        if display.frames(duration_s) in (None, 0):
            near = " or ".join(f"{near:.6g} s" for near in display.nearest_durations(duration_s))
            rates = [
                f"{rate:g}"
                for rate in COMMON_RATES_HZ
                if abs(duration_s * rate - round(duration_s * rate)) <= FRAME_TOLERANCE
            ]
            also = f", or a display with {' or '.join(rates)} Hz" if rates else ""
            problems.append(
                Problem(
                    place,
                    f"must be whole frames at {display.refresh_hz:g} Hz (got {duration_s:g} s ="
                    f" {duration_s * display.refresh_hz:g} frames); nearest: {near}{also}",
                )
            )
    return problems


def _rate(protocol: StudyProtocol, display: Display) -> list[Problem]:
    fps = protocol.clips.fps
    exact = display.refresh_hz / fps
    if round(exact) >= 1 and abs(exact - round(exact)) <= FRAME_TOLERANCE:
        return []
    counts = {max(1, math.floor(exact)), max(1, math.ceil(exact))}
    near = " or ".join(f"{display.refresh_hz / count:g} fps" for count in sorted(counts))
    rates = [
        f"{rate:g}"
        for rate in COMMON_RATES_HZ
        if rate >= fps and abs(rate / fps - round(rate / fps)) <= FRAME_TOLERANCE
    ]
    also = f", or a display with {' or '.join(rates)} Hz" if rates else ""
    return [
        Problem(
            "clips.fps",
            f"every clip frame must last whole refreshes at {display.refresh_hz:g} Hz"
            f" (got {fps:g} fps = {exact:g} refreshes); nearest: {near}{also}",
        )
    ]


def _size(protocol: StudyProtocol, display: Display) -> list[Problem]:
    width, height = clip_size_px(protocol, display)
    problems = []
    for place, wanted, got, pitch_mm in (
        ("clips.width_deg", display.width_px, width, display.pitch_x_mm),
        ("clips.height_deg", display.height_px, height, display.pitch_y_mm),
    ):
        if got > wanted:
            most = 2 * math.degrees(math.atan(wanted * pitch_mm / 2 / display.distance_mm))
            problems.append(
                Problem(
                    place,
                    f"clips must fit the screen pixel by pixel (got {got} px of {wanted} px at"
                    f" {display.distance_mm:g} mm); nearest: {math.floor(most * 100) / 100:g} deg",
                )
            )
    timing = protocol.trial
    for place, angle, extent_mm in (
        ("trial.fixation_x_deg", timing.fixation_x_deg, display.width_mm),
        ("trial.fixation_y_deg", timing.fixation_y_deg, display.height_mm),
    ):
        most = math.degrees(math.atan(extent_mm / 2 / display.distance_mm)) - timing.dot_deg / 2
        if abs(angle) > most:
            problems.append(
                Problem(
                    place,
                    f"the dot must be on the screen (got {angle:g} deg); nearest:"
                    f" {math.copysign(math.floor(most * 100) / 100, angle):g} deg",
                )
            )
    return problems


def _memory(protocol: StudyProtocol, display: Display) -> list[Problem]:
    clip = clip_memory_bytes(protocol, display)
    budget = display.clip_memory_mib * MIB
    if CLIPS_IN_MEMORY * clip <= budget:
        return []
    frames = protocol.clips.frames
    fewer = budget // (CLIPS_IN_MEMORY * clip // frames)
    shrink = math.sqrt(budget / (CLIPS_IN_MEMORY * clip))
    width = 2 * math.floor(clip_size_px(protocol, display)[0] * shrink / 2)
    return [
        Problem(
            "clips",
            f"two pairs must fit {display.clip_memory_mib} MiB of graphics memory (got"
            f" {CLIPS_IN_MEMORY * clip / MIB:.0f} MiB: {CLIPS_IN_MEMORY} clips x {frames} frames);"
            f" nearest: duration_s = {fewer / protocol.clips.fps:.4g} ({fewer} frames), or"
            f" width_deg = {math.floor(display.angle_of_width_deg(width) * 100) / 100:g} with the"
            " same shape",
        )
    ]


def _built_size(protocol: StudyProtocol, display: Display, manifest: Manifest) -> list[Problem]:
    width, height = clip_size_px(protocol, display)
    for clip in manifest.clips:
        if (clip.width_px, clip.height_px) != (width, height):
            return [
                Problem(
                    f"clip {clip.clip_name}",
                    f"clips are shown pixel by pixel and never rescaled: must be {width}x{height}"
                    f" px on this display (got {clip.width_px}x{clip.height_px} px, built for"
                    f" {manifest.display!r}); build the clips for {display.name!r}, or set"
                    f" width_deg = {display.angle_of_width_deg(clip.width_px):.4g}",
                )
            ]
        if clip.fps != protocol.clips.fps:
            return [
                Problem(
                    f"clip {clip.clip_name}",
                    f"must be {protocol.clips.fps:g} fps (got {clip.fps:g} fps); build again",
                )
            ]
    return []
