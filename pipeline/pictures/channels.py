"""Meaning of the channels of OpenEXR files: one table for every reader of this package.

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
the way to the next frame stands in the next file (`stimuli.scenes.sequence`).
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
Layer = tuple[str, str]
"""A part of a file and a layer in it, by name; either may be empty."""


class Planes(dict[str, NDArray[np.float32]]):
    """Every channel of a file by name.

    Attributes
    ----------
    parts : dict
        The part that each channel is in, by the channel's name.
    aliases : dict
        Channels by further names, ``PART.CHANNEL``.
    """

    def __init__(self, planes: Mapping[str, NDArray[np.float32]] | None = None) -> None:
        super().__init__(planes or {})
        self.parts: dict[str, str] = {}
        self.aliases: dict[str, NDArray[np.float32]] = {}

    def named(self, name: str) -> NDArray[np.float32] | None:
        """Return a channel by either of its names; None if there is none."""
        return self.get(name, self.aliases.get(name))

    def own_name(self, name: str) -> str:
        """Return a channel's name in its part."""
        part = self.parts.get(name, "")
        return name.removeprefix(f"{part}.") if name in self.aliases else name


Style = Literal["project", "nuke", "blender", "unreal"]


@dataclass(frozen=True)
class NamedChannel:
    """A channel's whole name, as a pattern, and the factor that brings it to our unit."""

    pattern: str
    factor: float = 1.0


@dataclass(frozen=True)
class MotionStyle:
    """Notation of motion in a program's files.

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
    """Motion of each pixel: target minus this place in pixels, (H, W, 2), x then y."""

    flow_px: NDArray[np.float32]
    to_previous: bool


KNOWN: dict[str, tuple[NamedChannel, ...]] = {
    "r": (
        NamedChannel(r"R"),
        NamedChannel(r"(?P<layer>[^.]+)\.Combined\.R"),
        NamedChannel(r"(?P<layer>FinalImage)\.R"),
    ),
    "g": (
        NamedChannel(r"G"),
        NamedChannel(r"(?P<layer>[^.]+)\.Combined\.G"),
        NamedChannel(r"(?P<layer>FinalImage)\.G"),
    ),
    "b": (
        NamedChannel(r"B"),
        NamedChannel(r"(?P<layer>[^.]+)\.Combined\.B"),
        NamedChannel(r"(?P<layer>FinalImage)\.B"),
    ),
    "depth": (
        NamedChannel(r"Z"),
        NamedChannel(r"depth\.Z"),
        NamedChannel(r"((?P<layer>[^.]+)\.)?Depth\.(Z|V)"),
        NamedChannel(r"(?P<layer>[^.]*)MovieRenderQueue_WorldDepth\.R", 0.01),
    ),
    "target_depth": (NamedChannel(r"target\.Z"),),
}
MOTION: dict[Style, MotionStyle] = {
    "project": MotionStyle(r"flow\.x", r"flow\.y"),
    "nuke": MotionStyle(r"forward\.u", r"forward\.v", down=-1.0),
    "blender": MotionStyle(
        r"((?P<layer>[^.]+)\.)?Vector\.Z", r"((?P<layer>[^.]+)\.)?Vector\.W", right=-1.0
    ),
    "unreal": MotionStyle(
        r"(?P<layer>[^.]*)MovieRenderQueue_MotionVectors\.R",
        r"(?P<layer>[^.]*)MovieRenderQueue_MotionVectors\.G",
        right=-1.0,
        zero=0.5,
        of_picture=True,
        to_previous=True,
    ),
}
OPTIONS = {
    "r": "red",
    "g": "green",
    "b": "blue",
    "depth": "depth",
    "target_depth": "target_depth",
    "motion_x": "flow_x",
    "motion_y": "flow_y",
}
"""Names in `metamerlab warp --channel` of the keys of a study's ``channels``."""


@dataclass(frozen=True)
class _Fit:
    """A channel that fits a question, or a pair of them, and what tells how it is meant."""

    names: tuple[str, ...]
    layer: Layer
    factor: float = 1.0
    style: MotionStyle | None = None


def channel_value(
    path: Path, planes: Planes, key: str, given: str | None = None, *, layer: Layer | None = None
) -> NDArray[np.float32] | None:
    """Return the values of `key` of `KNOWN` in a file, in our unit; None if it is not there.

    Depth is inf where there is nothing.

    Parameters
    ----------
    given : str, optional
        A channel's name that was told, in our unit.
    layer : Layer, optional
        Where several channels fit, the one of this layer is meant.

    Raises
    ------
    InputError
        If several different channels fit.
    """
    factor = 1.0
    if given is not None:
        plane = planes.named(given)
    else:
        fit = _one(path, planes, _fits(planes, key), (key,), layer)
        plane = None if fit is None else planes[fit.names[0]]
        factor = 1.0 if fit is None else fit.factor
    if plane is None:
        return None
    if not key.endswith("depth"):
        return plane
    empty = plane >= EMPTY_DEPTH
    return np.where(empty, np.float32(np.inf), plane * np.float32(factor)).astype(np.float32)


def need(
    path: Path,
    planes: Planes,
    key: str,
    given: str | None = None,
    *,
    layer: Layer | None = None,
    cure: str = "",
) -> NDArray[np.float32]:
    """Return the result of `channel_value`.

    Raises
    ------
    InputError
        If it is not there, or several channels fit; `cure` ends the first message.
    """
    found = channel_value(path, planes, key, given, layer=layer)
    if found is None:
        wanted = given or " or ".join(readable(known.pattern) for known in KNOWN[key])
        raise InputError(
            f"{path}: must have a channel {wanted} for {key} (has {', '.join(planes)}){cure}"
        )
    return found


def lone_plane(path: Path, planes: Planes) -> NDArray[np.float32] | None:
    """Return the one plane of numbers in a file: of depth, or a part's only one; None if none is.

    Raises
    ------
    InputError
        If several different ones fit.
    """
    of_part = list(planes.parts.values())
    alone = [name for name in planes if of_part.count(planes.parts.get(name, "")) == 1]
    found = [fit.names[0] for fit in _fits(planes, "depth")] or alone
    if any(not np.array_equal(planes[name], planes[found[0]], equal_nan=True) for name in found):
        raise InputError(
            f"{path}: must have one plane of numbers (these fit: {', '.join(found)}); save the one"
            " that is meant alone"
        )
    return planes[found[0]] if found else None


def depth_layer(path: Path, planes: Planes, given: str | None = None) -> Layer | None:
    """Return the layer that depth comes from, whose colour and motion go with it.

    Raises
    ------
    InputError
        If several different channels fit.
    """
    if given is None:
        fit = _one(path, planes, _fits(planes, "depth"), ("depth",), None)
        return None if fit is None else fit.layer
    told = planes.named(given)
    for fit in _fits(planes, "depth"):
        if planes[fit.names[0]] is told:
            return fit.layer
    name = next((name for name, plane in planes.items() if plane is told), given)
    layer, dot, _ = planes.own_name(name).partition(".")
    return planes.parts.get(name, ""), layer if dot else ""


def colour_layer(path: Path, planes: Planes, given: str | None = None) -> Layer | None:
    """Return `depth_layer`; None where depth is not clear, which colour does not need."""
    try:
        return depth_layer(path, planes, given)
    except InputError:
        return None


def find_motion(
    path: Path,
    planes: Planes,
    given: tuple[str | None, str | None] = (None, None),
    *,
    style: Style | None = None,
    layer: Layer | None = None,
) -> Motion | None:
    """Return the motion of a file; None if it has none.

    Parameters
    ----------
    given : (x, y)
        Names that were told; they are meant as `style` says, by default as this project's.
    style : optional
        Look for one program's channels only.
    layer : Layer, optional
        Where several pairs fit, the one of this layer is meant.

    Raises
    ------
    InputError
        If several different pairs fit.
    """
    if any(name is not None for name in given):
        x, y = (None if name is None else planes.named(name) for name in given)
        if x is None or y is None:
            return None
        return _in_pixels(x, y, MOTION[style or "project"])
    styles = MOTION.values() if style is None else (MOTION[style],)
    fits = [
        _Fit((x, y), where, style=chosen)
        for chosen in styles
        for x, where in _matching(planes, chosen.x)
        for y, same in _matching(planes, chosen.y)
        if where == same
    ]
    fit = _one(path, planes, fits, ("motion_x", "motion_y"), layer)
    if fit is None or fit.style is None:
        return None
    return _in_pixels(planes[fit.names[0]], planes[fit.names[1]], fit.style)


def alpha_of(planes: Planes, red: NDArray[np.float32]) -> NDArray[np.float32] | None:
    """Return the alpha of the layer that a plane of red comes from; None if it has none."""
    name = next((name for name, plane in planes.items() if plane is red), "")
    layer, dot, _ = planes.own_name(name).rpartition(".")
    for other, plane in planes.items():
        same_part = planes.parts.get(other) == planes.parts.get(name)
        if same_part and planes.own_name(other) == f"{layer}{dot}A":
            return plane
    return None


def check_opaque(path: Path, alpha: NDArray[np.generic] | None, opaque: int = 1) -> None:
    """Refuse colour that is transparent somewhere.

    Raises
    ------
    InputError
        If its alpha is not `opaque` everywhere.
    """
    if alpha is not None and not (alpha == opaque).all():
        raise InputError(
            f"{path}: must be opaque (its alpha channel is not 1 everywhere); put it on a"
            " background first"
        )


def need_motion(
    path: Path,
    planes: Planes,
    given: tuple[str | None, str | None] = (None, None),
    *,
    style: Style | None = None,
    layer: Layer | None = None,
    cure: str = "",
) -> Motion:
    """Return the result of `find_motion`.

    Raises
    ------
    InputError
        If it is not there, or several pairs fit; `cure` ends the first message.
    """
    found = find_motion(path, planes, given, style=style, layer=layer)
    if found is None:
        raise InputError(
            f"{path}: must have a channel {_lacking(planes, given)} for motion"
            f" (has {', '.join(planes)}){cure}"
        )
    return found


def _fits(planes: Planes, key: str) -> list[_Fit]:
    return [
        _Fit((name,), layer, known.factor)
        for known in KNOWN[key]
        for name, layer in _matching(planes, known.pattern)
    ]


def _one(
    path: Path, planes: Planes, fits: list[_Fit], keys: tuple[str, ...], layer: Layer | None
) -> _Fit | None:
    """The one that is meant; the first, where all hold the same numbers."""
    if len(fits) > 1 and layer is not None:
        fits = [fit for fit in fits if fit.layer == layer] or fits
    others = [
        fit
        for fit in fits[1:]
        if fit.factor != fits[0].factor
        or fit.style is not fits[0].style
        or not all(
            np.array_equal(planes[a], planes[b], equal_nan=True)
            for a, b in zip(fit.names, fits[0].names, strict=True)
        )
    ]
    if not others:
        return fits[0] if fits else None
    first = fits[0].names
    options = " ".join(
        f"--channel {OPTIONS[key]}={name}" for key, name in zip(keys, first, strict=True)
    )
    entries = ", ".join(f'{key} = "{name}"' for key, name in zip(keys, first, strict=True))
    listed = "; ".join(" with ".join(fit.names) for fit in (fits[0], *others))
    raise InputError(
        f"{path}: must have one channel for {' and '.join(keys)} (these fit: {listed}); name the"
        f" one that is meant (metamerlab warp: {options}; a study: channels = {{ {entries} }}), or"
        " save it alone"
    )


def _lacking(planes: Planes, given: tuple[str | None, str | None]) -> str:
    """Channels that would be enough, in words: the other half where one is there."""
    if any(name is not None for name in given):
        return " and ".join(name or "of your naming" for name in given if name not in planes)
    pairs = [(style.x, style.y) for style in MOTION.values()]
    for pair in pairs:
        there = [bool(_matching(planes, pattern)) for pattern in pair]
        if any(there):
            return readable(pair[there.index(False)]) if not all(there) else readable(pair[0])
    return " or ".join(f"{readable(x)} with {readable(y)}" for x, y in pairs)


def readable(pattern: str) -> str:
    """A pattern of `KNOWN` as people write it."""
    for old, new in ((r"((?P<layer>[^.]+)\.)?", ""), ("(?P<layer>FinalImage)", "FinalImage"),
                     ("(?P<layer>[^.]+)", "*"), ("(?P<layer>[^.]*)", "*"), ("\\", ""),
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


def _matching(planes: Planes, pattern: str) -> list[tuple[str, Layer]]:
    """Channels whose own name fits, with their layers."""
    found = []
    for name in planes:
        match = re.fullmatch(pattern, planes.own_name(name))
        if match is not None:
            layer = match.groupdict().get("layer") or ""
            found.append((name, (planes.parts.get(name, ""), layer)))
    return found


@dataclass(frozen=True)
class Channels:
    """Names of a file's channels, in this project's units; what is empty is found by itself."""

    red: tuple[str, ...] = ()
    green: tuple[str, ...] = ()
    blue: tuple[str, ...] = ()
    depth: tuple[str, ...] = ()
    flow_x: tuple[str, ...] = ()
    flow_y: tuple[str, ...] = ()
    target_depth: tuple[str, ...] = ()


def light_of(
    path: Path, planes: Planes, told: Channels, layer: Layer | None
) -> NDArray[np.float32]:
    """Red, green and blue as stored, shape (H, W, 3), which must be opaque."""
    named = (("r", told.red), ("g", told.green), ("b", told.blue))
    light = [
        need(path, planes, key, told_name(planes, names), layer=layer, cure=naming_options(key))
        for key, names in named
    ]
    check_opaque(path, alpha_of(planes, light[0]))
    return np.stack(light, axis=-1)


def naming_options(*keys: str) -> str:
    """End of a message: the options that name channels."""
    return f"; name it by {' '.join(f'--channel {OPTIONS[key]}=NAME' for key in keys)}"


def told_name(planes: Planes, names: tuple[str, ...]) -> str | None:
    """The first of `names` that is there, or else the first; None where none is told."""
    there = (name for name in names if planes.named(name) is not None)
    return next(there, names[0] if names else None)
