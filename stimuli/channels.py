"""Which channel of an OpenEXR file means what: one table for every reader of this package.

Colour is scene-linear. Depth is brought to metres along the optical axis, motion to pixels,
right and down, from where a pixel is to where it goes. What each program writes, and where
that is said:

========  =============================================================================
project   ``R`` ``G`` ``B``, ``Z`` in metres, ``flow.x`` ``flow.y`` as above
Nuke      ``depth.Z``; ``forward.u`` ``forward.v``: pixels to the next frame, right and up
          (Nuke's developers' guide: pixels, the origin at the lower left). ScanlineRender
          writes 1 / distance into ``depth.Z``: a protocol says so by ``depth_is = "inverse"``
Blender   ``LAYER.Combined.R`` ..., ``LAYER.Depth.Z`` (``.V`` from 5.0 on),
          ``LAYER.Vector``: ``X`` ``Y`` the previous place minus this one, ``Z`` ``W`` this
          one minus the next, in pixels, right and up (Cycles, kernel/geom/primitive:
          ``motion_post = motion_center - motion_post``)
Unreal    ``FinalImage.R`` ... or ``R`` ...; ``FinalImageMovieRenderQueue_WorldDepth.R`` in
          centimetres; ``FinalImageMovieRenderQueue_MotionVectors.R`` ``.G``: the way from the
          previous frame to this one, in shares of the picture's width and height, right and
          up, 0.5 being no motion (Epic's page on render passes)
========  =============================================================================

Unreal's motion leads back: from a pixel of this frame to where it was, which is exact, while
the way to the next frame stands in the next file (`stimuli.scenes.follow`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError

EMPTY_DEPTH = 1e10
"""Stored depth from which on a pixel shows nothing: Blender writes 1e10 where others write inf."""

Planes = Mapping[str, NDArray[np.float32]]
Style = Literal["project", "nuke", "blender", "unreal"]


@dataclass(frozen=True)
class Known:
    """A channel's whole name, as a pattern, and the factor that brings it to our unit."""

    pattern: str
    factor: float = 1.0


@dataclass(frozen=True)
class MotionStyle:
    """How a program writes motion.

    Parameters
    ----------
    x, y : str
        Patterns of the two channels' names.
    right, down : float
        Factors from what is stored to pixels (or pictures) right and down.
    zero : float
        What is stored where nothing moves.
    of_picture : bool
        Stored in shares of the picture's width and height, not in pixels.
    to_previous : bool
        It leads to the previous frame, not to the next.
    """

    x: str
    y: str
    right: float = 1.0
    down: float = 1.0
    zero: float = 0.0
    of_picture: bool = False
    to_previous: bool = False


@dataclass(frozen=True)
class Motion:
    """Where each pixel goes: target minus this place in pixels, (H, W, 2), x then y."""

    flow_px: NDArray[np.float32]
    to_previous: bool


KNOWN: dict[str, tuple[Known, ...]] = {
    "r": (Known(r"R"), Known(r"[^.]+\.Combined\.R"), Known(r"FinalImage\.R")),
    "g": (Known(r"G"), Known(r"[^.]+\.Combined\.G"), Known(r"FinalImage\.G")),
    "b": (Known(r"B"), Known(r"[^.]+\.Combined\.B"), Known(r"FinalImage\.B")),
    "depth": (
        Known(r"Z"),
        Known(r"depth\.Z"),
        Known(r"([^.]+\.)?Depth\.(Z|V)"),
        Known(r"[^.]*MovieRenderQueue_WorldDepth\.R", 0.01),
    ),
    "target_depth": (Known(r"target\.Z"),),
}
MOTION: dict[Style, MotionStyle] = {
    "project": MotionStyle(r"flow\.x", r"flow\.y"),
    "nuke": MotionStyle(r"forward\.u", r"forward\.v", down=-1.0),
    "blender": MotionStyle(r"([^.]+\.)?Vector\.Z", r"([^.]+\.)?Vector\.W", right=-1.0),
    "unreal": MotionStyle(
        r"[^.]*MovieRenderQueue_MotionVectors\.R",
        r"[^.]*MovieRenderQueue_MotionVectors\.G",
        right=-1.0,
        zero=0.5,
        of_picture=True,
        to_previous=True,
    ),
}


def find(planes: Planes, key: str, given: str | None = None) -> NDArray[np.float32] | None:
    """Return what `key` of `KNOWN` is in a file, in our unit; None if it is not there.

    Depth is inf where there is nothing.

    `given` is a channel's name that was told, in our unit.
    """
    plane, factor = None, 1.0
    if given is not None:
        plane = planes.get(given)
    else:
        for known in KNOWN[key]:
            name = _matching(planes, known.pattern)
            if name is not None:
                plane, factor = planes[name], known.factor
                break
    if plane is None:
        return None
    if not key.endswith("depth"):
        return plane
    empty = plane >= EMPTY_DEPTH
    return np.where(empty, np.float32(np.inf), plane * np.float32(factor)).astype(np.float32)


def need(
    path: Path, planes: Planes, key: str, given: str | None = None, *, cure: str = ""
) -> NDArray[np.float32]:
    """Return what `find` returns.

    Raises
    ------
    InputError
        If it is not there; `cure` ends the message.
    """
    found = find(planes, key, given)
    if found is None:
        wanted = given or " or ".join(readable(known.pattern) for known in KNOWN[key])
        raise InputError(
            f"{path}: must have a channel {wanted} for {key} (has {', '.join(planes)}){cure}"
        )
    return found


def find_motion(
    planes: Planes,
    given: tuple[str | None, str | None] = (None, None),
    *,
    style: Style | None = None,
) -> Motion | None:
    """Return the motion of a file; None if it has none.

    Parameters
    ----------
    given : (x, y)
        Names that were told; they are meant as `style` says, by default as this project's.
    style : optional
        Look for one program's channels only.
    """
    if any(name is not None for name in given):
        x, y = given
        if x is None or y is None or x not in planes or y not in planes:
            return None
        return _in_pixels(planes[x], planes[y], MOTION[style or "project"])
    for chosen in MOTION.values() if style is None else (MOTION[style],):
        x, y = _matching(planes, chosen.x), _matching(planes, chosen.y)
        if x is not None and y is not None:
            return _in_pixels(planes[x], planes[y], chosen)
    return None


def need_motion(
    path: Path,
    planes: Planes,
    given: tuple[str | None, str | None] = (None, None),
    *,
    style: Style | None = None,
    cure: str = "",
) -> Motion:
    """Return what `find_motion` returns.

    Raises
    ------
    InputError
        If it is not there; `cure` ends the message.
    """
    found = find_motion(planes, given, style=style)
    if found is None:
        raise InputError(
            f"{path}: must have a channel {_lacking(planes, given)} for motion"
            f" (has {', '.join(planes)}){cure}"
        )
    return found


def _lacking(planes: Planes, given: tuple[str | None, str | None]) -> str:
    """What would be enough, to be read by people: the other half where one is there."""
    if any(name is not None for name in given):
        return " and ".join(name or "of your naming" for name in given if name not in planes)
    pairs = [(style.x, style.y) for style in MOTION.values()]
    for pair in pairs:
        there = [_matching(planes, pattern) is not None for pattern in pair]
        if any(there):
            return readable(pair[there.index(False)]) if not all(there) else readable(pair[0])
    return " or ".join(f"{readable(x)} with {readable(y)}" for x, y in pairs)


def readable(pattern: str) -> str:
    """A pattern of `KNOWN` as people write it."""
    for old, new in ((r"([^.]+\.)?", ""), (r"[^.]+", "*"), (r"[^.]*", "*"), ("\\", ""),
                     ("(Z|V)", "Z")):  # fmt: skip
        pattern = pattern.replace(old, new)
    return pattern


def _in_pixels(x: NDArray[np.float32], y: NDArray[np.float32], style: MotionStyle) -> Motion:
    height, width = x.shape
    unit = (width, height) if style.of_picture else (1, 1)
    planes = [
        (plane.astype(np.float64) - style.zero) * factor * size
        for plane, factor, size in ((x, style.right, unit[0]), (y, style.down, unit[1]))
    ]
    return Motion(np.stack(planes, axis=-1).astype(np.float32), style.to_previous)


def _matching(planes: Planes, pattern: str) -> str | None:
    return next((name for name in planes if re.fullmatch(pattern, name)), None)
