"""Image files and what they mean: channel names, units and transfer functions.

Files of integers (PNG, JPEG, ...) hold display-referred R'G'B' as shown. OpenEXR and other
float files hold scene-linear light with sRGB primaries: it is encoded by the sRGB curve on
import and decoded on export, unless told that the file holds encoded values.

RGBZ + flow in one OpenEXR file, of one part or several: this project writes ``R`` ``G`` ``B``,
``Z``, ``flow.x``, ``flow.y`` and, where the camera moves along its axis, ``target.Z``;
`stimuli.media.channels` says what each means and which other programs' names are known, and
`Channels` tells further ones.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.colour import decode_srgb, encode_srgb
from pipeline.errors import InputError, note
from pipeline.frame import NO_DEPTH, SourceFrame, check_colour, check_depth, check_flow
from pipeline.image_file import (
    StoredPixels,
    check_fits,
    count_pictures,
    from_integers,
    read_pixels,
    three_channels,
    write_pixels,
)
from stimuli.media.channels import (
    OPTIONS,
    Layer,
    Planes,
    check_opaque,
    colour_layer,
    depth_layer,
    find,
    need,
    need_motion,
)
from stimuli.media.exr_parts import read_parts

_DEPTH_UNIT = "metamerlab:depth_unit"
_TRANSFER = "metamerlab:transfer"
NEARLY = 1 / 256
"""Light outside [0, 1] that lossy compression and filters leave, and no display shows."""


class Transfer(enum.StrEnum):
    """Meaning of the numbers of a float file."""

    LINEAR = "linear"  # scene-linear light, sRGB primaries
    ENCODED = "encoded"  # display-referred R'G'B', as this project works on


def stored_transfer(path: Path, attributes: Mapping[str, Any]) -> Transfer:
    """Return the transfer that the header states; left out, scene-linear light.

    Raises
    ------
    InputError
        If it says something else.
    """
    said = str(attributes.get(_TRANSFER, Transfer.LINEAR))
    try:
        return Transfer(said)
    except ValueError:
        raise InputError(
            f"{path}: {_TRANSFER} must be {' or '.join(Transfer)} (the header says {said[:40]!r})"
        ) from None


def check_depth_unit(path: Path, attributes: Mapping[str, Any], cure: str = "") -> None:
    """Refuse depth whose header says another unit than metres; `cure` ends the message.

    Raises
    ------
    InputError
        With the unit.
    """
    unit = str(attributes.get(_DEPTH_UNIT, "m"))
    if unit != "m":
        raise InputError(f"{path}: depth must be in metres (the header says {unit[:40]!r}){cure}")


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


@dataclass(frozen=True)
class WarpInput:
    """Input of a warp: a source frame, and where each of its pixels goes.

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
    path: str | Path,
    *,
    transfer: Transfer | None = None,
    clip: bool = False,
    channels: Channels | None = None,
) -> NDArray[np.float32]:
    """Read encoded colour.

    Parameters
    ----------
    path : str or Path
    transfer : Transfer, optional
        Of float files; by default what the file says, or `Transfer.LINEAR`.
    clip : bool
        Clip linear light to [0, 1] instead of refusing what a display cannot show.
    channels : Channels, optional
        Names of colour in an OpenEXR file of several layers.

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
        grey), is transparent, is stored turned, or has values that are NaN or outside [0, 1].
        Of an OpenEXR file, further channels are left out.
    """
    path = Path(path)
    check_fits(path, "read")
    pixels = read_pixels(path)
    if is_layered(path, pixels):
        told, file = channels or Channels(), read_parts(path, encoded=transfer is Transfer.ENCODED)
        layer = colour_layer(path, file.planes, _told(file.planes, told.depth))
        light = _light(path, file.planes, told, layer)
        return _encoded(path, light, transfer or stored_transfer(path, file.attributes), clip)
    data = three_channels(path, pixels, encoded=transfer is Transfer.ENCODED)
    if pixels.data.dtype.kind == "u":
        return from_integers(data)
    stored = stored_transfer(path, pixels.attributes)
    return _encoded(path, data, transfer or stored, clip)


def is_layered(path: Path, pixels: StoredPixels) -> bool:
    """True if a file is of OpenEXR and holds more than one picture's colour, grey and alpha."""
    if pixels.kind != "openexr":
        return False
    return not {*pixels.channels} <= {*"RGBAYL"} or count_pictures(path) > 1


def save_colour(path: str | Path, colour: NDArray[np.float32], *, bits: int | None = None) -> None:
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
    path = Path(path)
    if path.suffix.lower() == ".exr":
        kind = "half" if _chosen_bits(path, bits, (16, 32)) == 16 else "float"
        attributes = {_TRANSFER: Transfer.LINEAR.value, "compression": "zip"}
        write_pixels(
            path, _linear(colour), ("R", "G", "B"), types=(kind,) * 3, attributes=attributes
        )
        return
    dtype = np.uint8 if _chosen_bits(path, bits, (8, 16)) == 8 else np.uint16
    steps = np.empty(colour.shape, dtype)
    for row, values in zip(steps, colour, strict=True):  # one at a time: memory
        row[:] = np.rint(values * np.iinfo(dtype).max)
    write_pixels(path, steps, ("R", "G", "B"))


def load_warp_input(
    path: Path,
    *,
    channels: Channels | None = None,
    transfer: Transfer | None = None,
    clip: bool = False,
) -> WarpInput:
    """Read RGBZ and flow from one OpenEXR file; `stimuli.media.channels` lists the channels.

    Where the file's motion leads to the previous frame, as Unreal's does, so does the flow.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    InputError
        If it is not a whole image, a channel is missing, the depth's unit is not metres,
        or a value breaks the rules of `pipeline.frame`: NaN colour, depth at or below 0,
        flow that is not finite.
    """
    told = channels or Channels()
    file = read_parts(path, encoded=transfer is Transfer.ENCODED)
    planes = file.planes
    layer = depth_layer(path, planes, _told(planes, told.depth))
    colour = _light(path, planes, told, layer)
    stored = stored_transfer(path, file.attributes)
    colour = _encoded(path, colour, transfer or stored, clip)
    check_depth_unit(path, file.attributes)
    depth_m = need(path, planes, "depth", _told(planes, told.depth), cure=_named_by("depth"))
    check_depth(depth_m, f"{path}: depth", cure=NO_DEPTH)
    told_motion = (_told(planes, told.flow_x), _told(planes, told.flow_y))
    cure = _named_by("motion_x", "motion_y")
    flow_px = need_motion(path, planes, told_motion, layer=layer, cure=cure).flow_px
    check_flow(flow_px, f"{path}: flow")
    target_m = find(path, planes, "target_depth", _told(planes, told.target_depth))
    if target_m is not None:
        check_depth(target_m, f"{path}: depth", cure=NO_DEPTH)
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


def _light(path: Path, planes: Planes, told: Channels, layer: Layer | None) -> NDArray[np.float32]:
    """Red, green and blue as stored, shape (H, W, 3), which must be opaque."""
    named = (("r", told.red), ("g", told.green), ("b", told.blue))
    light = [
        need(path, planes, key, _told(planes, names), layer=layer, cure=_named_by(key))
        for key, names in named
    ]
    check_opaque(path, planes, light[0])
    return np.stack(light, axis=-1)


def _named_by(*keys: str) -> str:
    """End of a message: the options that name channels."""
    return f"; name it by {' '.join(f'--channel {OPTIONS[key]}=NAME' for key in keys)}"


def check_finite(path: Path, colour: NDArray[Any]) -> None:
    """Refuse colour, shape (H, W, C), that is infinite or no number.

    Raises
    ------
    InputError
        With the first such pixel.
    """
    if not np.isfinite(colour).all():
        row, column = np.argwhere(~np.isfinite(colour).all(axis=-1))[0]
        raise InputError(
            f"{path}: colour must be finite (found {colour[row, column]} at row {row},"
            f" column {column}); render it again, or mend these pixels"
        )


def _encoded(
    path: Path, data: NDArray[np.floating], transfer: Transfer, clip: bool
) -> NDArray[np.float32]:
    data = data.astype(np.float32)
    check_finite(path, data)
    beyond = np.maximum(-data, data - 1).max(axis=-1)
    outside = int((beyond > 0).sum())
    if outside and not clip:
        row, column = np.argwhere(beyond == beyond.max())[0]
        if beyond.max() > NEARLY:
            cure = "lower the exposure, or allow clipping" if data.max() > 1 else "allow clipping"
            raise InputError(
                f"{path}: colour must lie in [0, 1] (found {data[row, column]} at row {row}, column"
                f" {column}, and {outside - 1} more such pixels); {cure}"
            )
        note(path, f"{outside} pixels lie up to {beyond.max():.2g} outside [0, 1]: clipped")
    data = data.clip(0, 1)
    if transfer is Transfer.LINEAR:
        # In float64, so that white is exactly 1.
        data = encode_srgb(data.astype(np.float64)).astype(np.float32)
    return data


def _told(planes: Planes, names: tuple[str, ...]) -> str | None:
    """The first of `names` that is there, or else the first; None where none is told."""
    there = (name for name in names if planes.named(name) is not None)
    return next(there, names[0] if names else None)


def _linear(colour: NDArray[np.float32]) -> NDArray[np.float32]:
    return decode_srgb(colour.astype(np.float64)).astype(np.float32)


def _chosen_bits(path: Path, bits: int | None, offered: tuple[int, int]) -> int:
    if bits is not None and bits not in offered:
        raise InputError(
            f"{path}: {path.suffix} is written with {offered[0]} or {offered[1]} bits (got {bits})"
        )
    return bits or offered[0]
