"""Image files and what they mean: channel names, units and transfer functions.

Files of integers (PNG, JPEG, ...) hold display-referred R'G'B' as shown. OpenEXR and other
float files hold scene-linear light with sRGB primaries: it is encoded by the sRGB curve on
import and decoded on export, unless told that the file holds encoded values.

RGBZ + flow in one OpenEXR file, by channel name:

==================  ======================================================================
``R``, ``G``, ``B``  scene-linear colour, half or float
``Z``               distance along the optical axis in metres, float; inf is "nothing there"
``flow.x``          where the pixel goes, target minus source, to the right, in pixels
``flow.y``          the same, downwards
``target.Z``        optional: distance of the same point as the target camera sees it
==================  ======================================================================

`Channels` names others; some renderers' own names are known already.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.colour import decode_srgb, encode_srgb
from pipeline.errors import InputError
from pipeline.frame import SourceFrame, check_colour, check_depth, check_flow
from pipeline.image_file import Pixels, from_integers, read_pixels, three_channels, write_pixels

EMPTY_DEPTH_M = 1e10
"""Depth from which on a pixel shows nothing: Blender writes 1e10 where other programs write inf."""

_DEPTH_UNIT = "metamerlab:depth_unit"
_TRANSFER = "metamerlab:transfer"


class Transfer(enum.StrEnum):
    """What the numbers of a float file stand for."""

    LINEAR = "linear"  # scene-linear light, sRGB primaries
    ENCODED = "encoded"  # display-referred R'G'B', as this project works on


@dataclass(frozen=True)
class Channels:
    """Which channel of a file holds what: the first of these names that is there."""

    red: tuple[str, ...] = ("R", "ViewLayer.Combined.R")
    green: tuple[str, ...] = ("G", "ViewLayer.Combined.G")
    blue: tuple[str, ...] = ("B", "ViewLayer.Combined.B")
    depth: tuple[str, ...] = ("Z", "depth.Z", "ViewLayer.Depth.Z")
    flow_x: tuple[str, ...] = ("flow.x", "forward.u")  # Nuke's
    flow_y: tuple[str, ...] = ("flow.y", "forward.v")
    target_depth: tuple[str, ...] = ("target.Z",)


@dataclass(frozen=True)
class WarpInput:
    """What a warp needs: a source frame, and where each of its pixels goes.

    Parameters
    ----------
    source : SourceFrame
    flow_px : ndarray of float32, shape (H, W, 2)
        Target minus source position, x then y.
    target_depth_m : ndarray of float32, shape (H, W), optional
        Depth of the source's pixels as the target camera sees them.
    """

    source: SourceFrame
    flow_px: NDArray[np.float32]
    target_depth_m: NDArray[np.float32] | None = None


def load_colour(
    path: Path, *, transfer: Transfer | None = None, clip: bool = False
) -> NDArray[np.float32]:
    """Read encoded colour.

    Parameters
    ----------
    path : Path
    transfer : Transfer, optional
        Of float files; by default what the file says, or `Transfer.LINEAR`.
    clip : bool
        Clip linear light to [0, 1] instead of refusing what a display cannot show.

    Returns
    -------
    ndarray of float32, shape (H, W, 3)
        R'G'B' in [0, 1].

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    InputError
        If it is not a whole image, has other channels than red, green and blue (or one
        grey), is transparent, or has values that are NaN or outside [0, 1].
    """
    pixels = read_pixels(path)
    return _colour(path, pixels, Channels(), transfer, clip)


def save_colour(path: Path, colour: NDArray[np.float32], *, bits: int | None = None) -> None:
    """Write encoded colour: PNG of 8 (default) or 16 bits, or linear OpenEXR of 16 (half) or 32.

    Raises
    ------
    InputError
        If `colour` breaks the rules of `pipeline.frame.check_colour`, or `bits` is not one
        of the format's.
    OSError
        If the file cannot be written; nothing is left behind then.
    """
    check_colour(colour, "colour")
    if path.suffix.lower() == ".exr":
        kind = "half" if _chosen_bits(path, bits, (16, 32)) == 16 else "float"
        attributes = {_TRANSFER: Transfer.LINEAR.value, "compression": "zip"}
        write_pixels(
            path, _linear(colour), ("R", "G", "B"), types=(kind,) * 3, attributes=attributes
        )
        return
    dtype = np.uint8 if _chosen_bits(path, bits, (8, 16)) == 8 else np.uint16
    write_pixels(path, np.rint(colour * np.iinfo(dtype).max).astype(dtype), ("R", "G", "B"))


def load_warp_input(
    path: Path,
    *,
    channels: Channels | None = None,
    transfer: Transfer | None = None,
    clip: bool = False,
) -> WarpInput:
    """Read RGBZ and flow from one OpenEXR file; see the module's table for the channels.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    InputError
        If it is not a whole image, a channel is missing, the depth's unit is not metres,
        or a value breaks the rules of `pipeline.frame`: NaN colour, depth at or below 0,
        flow that is not finite.
    """
    names = channels or Channels()
    pixels = read_pixels(path)
    colour = _colour(path, pixels, names, transfer, clip, others_allowed=True)
    unit = str(pixels.attributes.get(_DEPTH_UNIT, "m"))
    if unit != "m":
        raise InputError(f"{path}: depth must be in metres (the header says {unit!r})")
    depth_m = _depth(path, pixels, names.depth)
    flow_px = np.stack(
        [_channel(path, pixels, names.flow_x), _channel(path, pixels, names.flow_y)], axis=-1
    )
    check_flow(flow_px, f"{path}: flow")
    has_target = any(name in pixels.channels for name in names.target_depth)
    target_m = _depth(path, pixels, names.target_depth) if has_target else None
    return WarpInput(SourceFrame(colour, depth_m), flow_px, target_m)


def save_warp_input(path: Path, frame: WarpInput, *, half_colour: bool = False) -> None:
    """Write RGBZ and flow into one OpenEXR file, as `load_warp_input` reads it.

    Depth and flow are always stored as 32-bit float; `half_colour` halves the colour's
    size at 11 bits of precision.

    Raises
    ------
    OSError
        If the file cannot be written; nothing is left behind then.
    """
    planes = [_linear(frame.source.colour), frame.source.depth_m[..., None], frame.flow_px]
    names = ["R", "G", "B", "Z", "flow.x", "flow.y"]
    if frame.target_depth_m is not None:
        planes.append(frame.target_depth_m[..., None])
        names.append("target.Z")
    colour_type = "half" if half_colour else "float"
    write_pixels(
        path,
        np.concatenate(planes, axis=-1).astype(np.float32),
        names,
        types=[colour_type] * 3 + ["float"] * (len(names) - 3),
        attributes={
            _TRANSFER: Transfer.LINEAR.value,
            _DEPTH_UNIT: "m",
            "metamerlab:flow": "target minus source position, x right, y down, pixels",
            "compression": "zip",
        },
    )


def load_plane(path: Path) -> tuple[NDArray[np.float32], bool]:
    """Read one channel as stored, such as a disparity map or a mask.

    Returns
    -------
    plane : ndarray of float32, shape (H, W)
        The stored numbers, unscaled.
    integer : bool
        Whether the file stores integers.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    InputError
        If it is not a whole image of one channel.
    """
    pixels = read_pixels(path)
    data = pixels.data
    if data.shape[-1] == 3 and (data == data[..., :1]).all():
        data = data[..., :1]  # grey, stored as colour
    if data.shape[-1] != 1:
        raise InputError(
            f"{path}: must have one channel (has {', '.join(pixels.channels)});"
            " save it as a grey image"
        )
    return data[..., 0].astype(np.float32), data.dtype.kind == "u"


def _colour(
    path: Path,
    pixels: Pixels,
    names: Channels,
    transfer: Transfer | None,
    clip: bool,
    *,
    others_allowed: bool = False,
) -> NDArray[np.float32]:
    if others_allowed:
        data = np.stack(
            [_channel(path, pixels, name) for name in (names.red, names.green, names.blue)], axis=-1
        )
    else:
        data = three_channels(path, pixels)
    if pixels.data.dtype.kind == "u":
        return from_integers(data)
    if transfer is None:
        transfer = Transfer(str(pixels.attributes.get(_TRANSFER, Transfer.LINEAR)))
    data = data.astype(np.float32)
    if not np.isfinite(data).all():
        row, column = np.argwhere(~np.isfinite(data).all(axis=-1))[0]
        raise InputError(
            f"{path}: colour must be finite (found {data[row, column]} at row {row},"
            f" column {column}); render it again, or mend these pixels"
        )
    outside = (data < 0) | (data > 1)
    if outside.any() and not clip:
        row, column = np.argwhere(outside.any(axis=-1))[0]
        raise InputError(
            f"{path}: colour must lie in [0, 1] (found {data[row, column]} at row {row}, column"
            f" {column}, and {int(outside.any(axis=-1).sum()) - 1} more such pixels); lower the"
            " exposure, or allow clipping"
        )
    data = data.clip(0, 1)
    if transfer is Transfer.LINEAR:
        # In float64, so that white is exactly 1.
        data = encode_srgb(data.astype(np.float64)).astype(np.float32)
    return data


def _depth(path: Path, pixels: Pixels, names: Iterable[str]) -> NDArray[np.float32]:
    depth_m = _channel(path, pixels, names).astype(np.float32)
    depth_m = np.where(depth_m >= EMPTY_DEPTH_M, np.float32(np.inf), depth_m)
    check_depth(depth_m, f"{path}: depth")
    return depth_m


def _channel(path: Path, pixels: Pixels, names: Iterable[str]) -> NDArray[Any]:
    for name in names:
        if name in pixels.channels:
            return np.ascontiguousarray(pixels.data[..., pixels.channels.index(name)])
    raise InputError(
        f"{path}: must have a channel {' or '.join(names)} (has {', '.join(pixels.channels)})"
    )


def _linear(colour: NDArray[np.float32]) -> NDArray[np.float32]:
    return decode_srgb(colour.astype(np.float64)).astype(np.float32)


def _chosen_bits(path: Path, bits: int | None, offered: tuple[int, int]) -> int:
    if bits is not None and bits not in offered:
        raise InputError(
            f"{path}: {path.suffix} is written with {offered[0]} or {offered[1]} bits (got {bits})"
        )
    return bits or offered[0]
