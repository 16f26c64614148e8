"""Time (ms) that each method takes for one frame of the clips, on this machine."""

from __future__ import annotations

import json
import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import GLUnavailableError, InputError
from pipeline.frame import WarpedFrame
from pipeline.gl.context import create_context, describe, release_context
from pipeline.methods.registry import create_method
from protocols.disk.hashing import sha256_bytes
from protocols.disk.whole_file import write_whole
from protocols.manifest import Clip
from protocols.revision import code_revision
from stimuli.score.pair import ScoredPair

REPEATS = 5


def time_methods(
    clips: tuple[Clip, ...], pair: ScoredPair, protocol_folder: Path, cache: Path | None = None
) -> tuple[dict[str, float], str]:
    """Return milliseconds per fill by method, and the renderer's name.

    The frame has the clips' size and the hole mask of the middle of `pair`; its depth and
    motion are even. Wall time, with the copies to and from the GPU; the median of `REPEATS`
    after one warm-up. Methods that cannot be made here (frames from elsewhere, a network whose
    file is away) are left out. What `cache`, a folder, knows is not timed again.
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
        frame, renderer = _frame(pair), str(describe(ctx))
        pixels = sha256_bytes(frame.colour.tobytes() + frame.hole.tobytes())
        asked = json.dumps([methods, frame.size, pixels, renderer, code_revision()])
        key = sha256_bytes(asked.encode())
        kept = None if cache is None else cache / f"{key}.times.json"
        if kept is not None and (known := _read(kept)) is not None:
            return known, renderer
        found: dict[str, float] = {}
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
        if kept is not None:
            kept.parent.mkdir(parents=True, exist_ok=True)
            write_whole(kept, json.dumps(found).encode())
        return found, renderer
    finally:
        release_context(ctx)


def _read(path: Path) -> dict[str, float] | None:
    try:
        return {str(name): float(ms) for name, ms in json.loads(path.read_bytes()).items()}
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        return None


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
