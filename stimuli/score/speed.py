"""Time (ms) that each method takes for one frame of the clips, on this machine."""

from __future__ import annotations

import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import GLUnavailableError, InputError
from pipeline.frame import WarpedFrame
from pipeline.gl.context import create_context, describe, release_context
from pipeline.methods.registry import create_method
from protocols.manifest import Clip
from stimuli.score.pair import ScoredPair

REPEATS = 5


def time_methods(
    clips: tuple[Clip, ...], pair: ScoredPair, protocol_folder: Path
) -> tuple[dict[str, float], str]:
    """Return milliseconds per fill by method, and the renderer's name.

    The frame has the clips' size and the hole mask of the middle of `pair`; its depth and
    motion are even. Wall time, with the copies to and from the GPU; the median of `REPEATS`
    after one warm-up. Methods that cannot be made here (frames from elsewhere, a network whose
    file is away) are left out.
    """
    methods: dict[str, tuple[str, dict[str, Any]]] = {}
    for clip in clips:
        name = str(clip.parameters["method"])
        if name == "reference":
            continue
        kind, colon, path = name.partition(":")
        if colon:
            name = f"{kind}:{protocol_folder / path}"
        given = {
            key.removeprefix("method."): value
            for key, value in clip.parameters.items()
            if key.startswith("method.")
        }
        methods.setdefault(clip.column("method"), (name, given))
    try:
        ctx = create_context()
    except GLUnavailableError:
        return {}, ""
    try:
        frame = _frame(pair)
        found = {}
        for method, (name, parameters) in methods.items():
            try:
                maker = create_method(name, ctx, parameters)
            except (InputError, OSError):
                continue
            try:
                times = []
                for _ in range(REPEATS + 1):
                    start = time.perf_counter()
                    maker.fill(frame, 0)
                    times.append(1000 * (time.perf_counter() - start))
                found[method] = statistics.median(times[1:])
            except (InputError, OSError):
                continue
            finally:
                maker.release()
        return found, str(describe(ctx))
    finally:
        release_context(ctx)


def _frame(pair: ScoredPair) -> WarpedFrame:
    middle = pair.frames // 2
    hole = pair.mask(middle)
    if hole.all() or not hole.any():
        hole = np.zeros_like(hole)
        hole[:, hole.shape[1] // 2 :][:, : max(1, hole.shape[1] // 20)] = True
    size = hole.shape
    flow_px = np.zeros((*size, 2), np.float32)
    flow_px[..., 0] = -0.02 * size[1]
    return WarpedFrame(pair.truth_frame(middle), np.full(size, 10, np.float32), hole, flow_px)
