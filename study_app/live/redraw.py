"""A log drawn again: every frame whose pixels were kept must come out as it was shown."""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from protocols.hashing import sha256_json
from study_app.live.log import GRID, LiveChoice, LiveFlip, Pixels, ReadLog
from study_app.live.renderer import Renderer

NEAR = 1
"""Of 255: how far another renderer, or another version of its driver, may be off."""


@dataclass(frozen=True)
class Redrawn:
    """What came of it."""

    flips: int
    drawn: int
    equal: int
    """Bit for bit."""
    problems: tuple[str, ...]


def redraw(
    log: ReadLog, renderer_of: Callable[[LiveChoice], Renderer], *, exactly: bool
) -> Redrawn:
    """Draw frames of a log again.

    Parameters
    ----------
    renderer_of : callable
        Gives what draws the flips after a choice.
    exactly : bool
        On the renderer that drew them first every bit must be the same; on another one pixels
        within `NEAR`.
    """
    pixels, renderer = Pixels(), None
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
        sha256, grid = pixels.of(renderer.draw(line.look))
        drawn += 1
        equal += sha256 == line.pixels
        kept = np.frombuffer(base64.b64decode(line.grid), np.uint8).reshape(GRID, GRID, 3)
        off = int(np.abs(kept.astype(int) - grid).max())
        if (exactly and sha256 != line.pixels) or off > NEAR:
            problems.append(
                f"flip {line.n}: must show what gaze {line.gaze_px[0]:g}, {line.gaze_px[1]:g} and"
                f" seed {line.seed} give (pixels differ, those that were kept by up to {off} of"
                " 255)"
            )
    return Redrawn(flips, drawn, equal, tuple(problems))
