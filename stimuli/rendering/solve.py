"""The extent of a path that uncovers a wanted share of the frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import moderngl
import numpy as np

from pipeline.errors import InputError
from stimuli.batch.footage import CameraShot, Footage
from stimuli.rendering.scenery import Scenery

PROBE_FRAMES = 12
TOLERANCE = 0.01  # of the wanted share
ACCEPTED = 0.1  # where steps of whole pixels allow no better
ROUNDS = 16


def probe_frames(frames: int) -> list[int]:
    """Return the frames at which the share is measured, spread evenly over the clip."""
    if frames <= PROBE_FRAMES:
        return list(range(frames))
    return sorted({int(k) for k in (np.arange(PROBE_FRAMES) + 0.5) * frames / PROBE_FRAMES})


def solve_extent(
    ctx: moderngl.Context | None, scenery: Scenery, shot: CameraShot, hole_share: float, name: str
) -> float:
    """Return the extent in metres, of six digits, at which `hole_share` of the frame is hole.

    Measured by warping at full size, at `PROBE_FRAMES` frames of the path.

    Raises
    ------
    InputError
        If no extent gives it: with the share that was reached, and a cure.
    """
    probe = probe_frames(shot.frames)

    def measure(extent_m: float) -> float:
        measured = replace(shot, extent_m=extent_m)
        footage = Footage(ctx, scenery, measured, probe=probe, holes_only=True)
        try:
            return float(np.mean([footage.holes(frame).mean() for frame in probe]))
        finally:
            footage.release()

    return search(
        measure, hole_share, 2.0 * hole_share * scenery.typical_depth_m,
        scenery.largest_extent_m, name,
    )  # fmt: skip


def search(
    measure: Callable[[float], float], wanted: float, start_m: float, limit_m: float, name: str
) -> float:
    """Find `extent` with ``measure(extent) == wanted``, a share that grows with the extent.

    The share is nearly proportional to the extent: the first steps use that, and bisection
    takes over where they would leave the bracket.
    """
    low, high = 0.0, limit_m
    extent = _rounded(min(start_m, limit_m))
    best: tuple[float, float, float] | None = None
    for _ in range(ROUNDS):
        share = measure(extent)
        error = abs(share / wanted - 1)
        if best is None or error < best[0]:
            best = (error, extent, share)
        if error <= TOLERANCE:
            return extent
        if share < wanted:
            low = extent
        else:
            high = extent
        step = extent * min(max(wanted / max(share, 1e-9), 0.25), 4.0)
        inside = low < step < high
        if not inside:
            step = (low + high) / 2 if np.isfinite(high) else 2 * low
        extent = _rounded(min(step, limit_m))
        if low >= limit_m or extent in (low, high):
            break
    assert best is not None
    error, extent, share = best
    if error <= ACCEPTED:
        return extent
    raise InputError(
        f"{name}: the path must uncover {100 * wanted:.3g} % of the frame (the nearest is"
        f" {100 * share:.3g} %, at an extent of {extent:.4g} m); give extent_m instead, or choose"
        " another view or path"
    )


def _rounded(extent_m: float) -> float:
    return float(f"{extent_m:.6g}")
