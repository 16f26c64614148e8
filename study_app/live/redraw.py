"""A log drawn again: every frame whose pixels were kept must come out as it was shown."""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import dataclass

import moderngl
import numpy as np

from protocols.disk.hashing import sha256_json
from study_app.live.log import GRID, FrameReadback, LiveChoice, LiveFlip, ReadLog
from study_app.live.renderer import GazeState, LiveRenderer

NEAR = 1
"""Of 255: how far another renderer, or another version of its driver, may be off."""


@dataclass(frozen=True)
class RedrawResult:
    """Result of drawing a log again."""

    flips: int
    drawn: int
    equal: int
    """Bit for bit."""
    problems: tuple[str, ...]


def redraw(
    log: ReadLog, renderer_of: Callable[[LiveChoice], LiveRenderer], *, exactly: bool
) -> RedrawResult:
    """Draw frames of a log again.

    Parameters
    ----------
    renderer_of : callable
        Gives what draws the flips after a choice.
    exactly : bool
        On the renderer that drew them first every bit must be the same; on another one pixels
        within `NEAR`.
    """
    pixels, renderer = FrameReadback(), None
    flips = drawn = equal = 0
    problems = []
    for line in log.lines:
        if isinstance(line, LiveChoice):
            renderer = renderer_of(line)
            found, said = (one.model_dump() for one in (renderer.describe(), line.described))
            wrong = [key for key in said if found[key] != said[key]]
            if wrong:
                problems.append(
                    f"flips from {flips} on: {', '.join(wrong)} must be as in the log (got"
                    f" {', '.join(str(found[key]) for key in wrong)})"
                )
            elif sha256_json(line.described) != line.sha256:
                problems.append(f"flips from {flips} on: their choice must have its hash")
        if not isinstance(line, LiveFlip):
            continue
        flips += 1
        if line.pixels is None or line.grid is None or renderer is None:
            continue
        renderer.prepare(line.seed)
        renderer.hold(line.view)
        same, off = compared(pixels, renderer.draw(line.gaze_state), line.pixels, line.grid)
        drawn += 1
        equal += same
        if (exactly and not same) or off > NEAR:
            problems.append(f"flip {line.n}: {must_show(line.gaze_state, off)}")
    return RedrawResult(flips, drawn, equal, tuple(problems))


def compared(
    pixels: FrameReadback, picture: moderngl.Texture, sha256: str, grid: str
) -> tuple[bool, int]:
    """Return True if a picture is bit for bit what was kept, and by how much some pixels differ."""
    found, some = pixels.of(picture)
    kept = np.frombuffer(base64.b64decode(grid), np.uint8).reshape(GRID, GRID, 3)
    return found == sha256, int(np.abs(kept.astype(int) - some).max())


def must_show(gaze_state: GazeState, off: int) -> str:
    return (
        f"must show what gaze {gaze_state.gaze_px[0]:g}, {gaze_state.gaze_px[1]:g} and seed"
        f" {gaze_state.seed} give (pixels differ, those that were kept by up to {off} of 255)"
    )
