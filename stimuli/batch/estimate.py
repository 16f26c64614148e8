"""Estimate of what a build will make: clips, frames, disk, time."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from stimuli.batch.build_plan import BuildPlan
from stimuli.batch.clip import ENCODERS
from stimuli.batch.footage import CameraShot, Footage
from stimuli.media.png import encode_frame
from stimuli.rendering.paths import make_path

if TYPE_CHECKING:
    from stimuli.rendering.scenery import Scenery

T = TypeVar("T")
TRIED_PX = 512  # longer side of the frame that software draws to be timed


@dataclass(frozen=True)
class BuildEstimate:
    """Sizes are measured on one frame or picture; times are rough."""

    clips: int
    frames: int
    size_px: tuple[int, int]
    disk_bytes: int
    free_bytes: int
    time_s: float
    renderer: str
    measured: str = ""
    """Frame or picture that sizes and times were multiplied from."""


def free_bytes(out: Path) -> int:
    """Return the bytes that are free on the disk of a folder, which may not be there yet."""
    there = next(place for place in (out, *out.absolute().parents) if place.exists())
    return shutil.disk_usage(there).free


def estimated_build(plan: BuildPlan, out: Path, workers: int) -> BuildEstimate:
    """Make one frame of the first scene by every method, time it, and multiply.

    A renderer in software takes time in proportion to pixels, so there a smaller frame is made.

    Raises
    ------
    InputError, OSError
        As a build raises them for that scene.
    """
    from pipeline.gl.context import describe
    from pipeline.methods.registry import create_method
    from stimuli.batch.jobs import SceneContext

    clips = plan.study.warped.clips
    first = plan.clip_names[0]
    bench = SceneContext()
    try:
        started = time.perf_counter()
        scenery = bench.scenery(plan, first)
        opened_s = time.perf_counter() - started
        path = make_path(plan.scene(first).camera, clips.frames, clips.fps)
        extent = min(0.05 * scenery.typical_depth_m, scenery.largest_extent_m)
        slow = bench.ctx is None or describe(bench.ctx).software
        tried = _tried_px(plan, scenery, slow)
        shot = CameraShot(path, tried, extent, clips.margin_share)
        footage = Footage(bench.ctx, scenery, shot, probe=[0])
        frame = min(1, shot.frames - 1)
        footage.warped(frame)  # compiles, as the first fill does
        warped, warp_s = _timed(lambda: footage.warped(frame))
        times: dict[str, float] = {}
        frame_bytes = 0
        for name in plan.clip_names:
            if (name.scene, name.size) != (first.scene, first.size):
                continue
            if plan.method(name).is_reference:
                colour, frame_s = _timed(lambda: footage.truth(frame))  # compiled by the source
            else:
                given = plan.parameters(name)
                fill = create_method(plan.registry_name(name), bench.ctx, given)
                fill.fill(warped, clips.seed)
                colour, fill_s = _timed(lambda: fill.fill(warped, clips.seed))  # noqa: B023
                frame_s = warp_s + fill_s
                fill.release()
            started = time.perf_counter()
            frame_bytes = max(frame_bytes, len(encode_frame(colour, clips.bit_depth)))
            encode_s = (time.perf_counter() - started) / ENCODERS
            times[name.method] = max(frame_s, encode_s) * _pixels(plan.render_px) / _pixels(tried)
        footage.release()
    finally:
        bench.release()
    frames = len(plan.clip_names) * clips.frames
    pixels = _pixels(plan.shown_px)
    frame_bytes = frame_bytes * pixels // _pixels(tried)
    if clips.exr:
        frame_bytes += 3 * 4 * pixels
    scenes = {name.scene for name in plan.clip_names}
    surveys = {(name.scene, name.size) for name in plan.clip_names}
    usual_s = sum(times.values()) / len(times)
    total_s = sum(clips.frames * times.get(name.method, usual_s) for name in plan.clip_names)
    total_s += len(scenes) * opened_s + len(surveys) * (clips.frames + 50) * 0.6 * usual_s
    return BuildEstimate(
        clips=len(plan.clip_names),
        frames=frames,
        size_px=plan.shown_px,
        disk_bytes=round(1.05 * frames * frame_bytes),
        free_bytes=free_bytes(out),
        time_s=total_s / max(workers, 1),
        renderer=bench.renderer.renderer,
        measured=f"one frame of {first.scene} by every method, and opening it",
    )


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    """Return the result of `work`, and the seconds it takes."""
    started = time.perf_counter()
    result = work()
    return result, time.perf_counter() - started


def _tried_px(plan: BuildPlan, scenery: Scenery, software: bool) -> tuple[int, int]:
    """Width and height of the frame that is timed; files may fit the whole size alone."""
    width, height = plan.render_px
    of_files = any(":" in method.registry_name for method in plan.study.warped.methods)
    if not software or of_files or scenery.own_margin_px(plan.render_px) is not None:
        return width, height
    share = min(1.0, TRIED_PX / max(width, height))
    return max(1, round(share * width)), max(1, round(share * height))


def _pixels(size_px: tuple[int, int]) -> int:
    return size_px[0] * size_px[1]
