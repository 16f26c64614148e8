"""Image files as encoded colour, and encoded colour as image files.

Integers (PNG, JPEG, TIFF, ...) are display-referred R'G'B' as stored. Floats (OpenEXR, Radiance,
float TIFF) are scene-linear light with sRGB primaries, encoded by the sRGB curve on import and
decoded on export, unless told that the file holds encoded values. `load_colour` refuses what has
to be decided; `read_any` decides it, and says what was changed or left out.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.colour import decode_srgb, encode_srgb
from pipeline.errors import InputError, note
from pipeline.frame import AnyArray, check_colour
from pipeline.pictures.channels import Channels, alpha_of, colour_layer, light_of, need, told_name
from pipeline.pictures.decode import (
    StoredPixels,
    as_floats,
    check_picture,
    from_integers,
    read_parts,
    read_pixels,
    three_channels,
)
from pipeline.pictures.header import check_fits, count_pictures, stated_size_px
from pipeline.pictures.write import write_pixels

TRANSFER = "metamerlab:transfer"
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
    said = str(attributes.get(TRANSFER, Transfer.LINEAR))
    try:
        return Transfer(said)
    except ValueError:
        raise InputError(
            f"{path}: {TRANSFER} must be {' or '.join(Transfer)} (the header says {said[:40]!r})"
        ) from None


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
        layer = colour_layer(path, file.planes, told_name(file.planes, told.depth))
        light = light_of(path, file.planes, told, layer)
        return encoded_light(path, light, transfer or stored_transfer(path, file.attributes), clip)
    data = three_channels(path, pixels, encoded=transfer is Transfer.ENCODED)
    if pixels.data.dtype.kind == "u":
        return from_integers(data)
    stored = stored_transfer(path, pixels.attributes)
    return encoded_light(path, data, transfer or stored, clip)


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
        attributes = {TRANSFER: Transfer.LINEAR.value, "compression": "zip"}
        write_pixels(
            path, linear_light(colour), ("R", "G", "B"), types=(kind,) * 3, attributes=attributes
        )
        return
    dtype = np.uint8 if _chosen_bits(path, bits, (8, 16)) == 8 else np.uint16
    steps = np.empty(colour.shape, dtype)
    for row, values in zip(steps, colour, strict=True):  # one at a time: memory
        row[:] = np.rint(values * np.iinfo(dtype).max)
    write_pixels(path, steps, ("R", "G", "B"))


def check_finite_light(path: Path, colour: AnyArray) -> None:
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


def encoded_light(
    path: Path, data: NDArray[np.floating], transfer: Transfer, clip: bool
) -> NDArray[np.float32]:
    data = data.astype(np.float32)
    check_finite_light(path, data)
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


def linear_light(colour: NDArray[np.float32]) -> NDArray[np.float32]:
    return decode_srgb(colour.astype(np.float64)).astype(np.float32)


def _chosen_bits(path: Path, bits: int | None, offered: tuple[int, int]) -> int:
    if bits is not None and bits not in offered:
        raise InputError(
            f"{path}: {path.suffix} is written with {offered[0]} or {offered[1]} bits (got {bits})"
        )
    return bits or offered[0]


EXPOSED_SHARE = 0.99
LEAST_MEDIAN, MID_GREY = 0.02, 0.18
"""Light of the median pixel: darker than the first by `EXPOSED_SHARE`, it is made the second."""
_GREY = ("Y", "L", "I")


@dataclass(frozen=True)
class PictureReading:
    """Options for reading a file.

    Parameters
    ----------
    background : float
        Encoded grey, from 0 to 1, behind transparent pixels.
    clip : bool
        Clip light that a display cannot show, instead of refusing it.
    stops : float
        Light is multiplied by 2 to this power before it is encoded.
    encoded : bool
        A float file holds encoded colour, not light.
    exposed : bool
        Darken light that a display cannot show until `EXPOSED_SHARE` of its pixels can be shown,
        and clip the rest: panoramas that hold a sun. Where lamps would make all else black, the
        median decides.
    """

    background: float = 0.5
    clip: bool = False
    stops: float = 0.0
    encoded: bool = False
    exposed: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.background <= 1:
            raise InputError(f"background must lie in 0..1 (got {self.background})")
        if not -64 <= self.stops <= 64:
            raise InputError(f"stops must lie in -64..64 (got {self.stops})")


@dataclass(frozen=True, eq=False)
class AnyPicture:
    """A picture, and how it came to be.

    Attributes
    ----------
    stored : ndarray of uint8 or float32, shape (H, W, 3)
        Encoded R'G'B': of 8 bits as in the file, or in [0, 1].
    bits : int
        What a PNG of it needs: 8 or 16.
    notes : tuple of str
        What was decided on the way, a sentence each.
    """

    stored: NDArray[np.float32] | NDArray[np.uint8]
    bits: int
    notes: tuple[str, ...] = field(default=())

    @property
    def colour(self) -> NDArray[np.float32]:
        """Encoded R'G'B' in [0, 1], made anew where 8 bits are stored."""
        return as_floats(self.stored)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width, pixels."""
        return self.stored.shape[0], self.stored.shape[1]


def read_any(
    path: Path, reading: PictureReading | None = None, command: str = "read"
) -> AnyPicture:
    """Read a picture of whatever kind, for a command of `pipeline.pictures.size_limits.NEEDS`.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    InputError
        If it is not a whole picture, has no colour, holds NaN or light that no display shows, or
        is so large that the command takes too much memory.
    """
    options = reading is not None
    reading = reading or PictureReading()
    check_fits(path, command)
    pixels = read_pixels(path)
    integers = pixels.data.dtype.kind == "u"
    if integers and (reading.stops != 0 or reading.encoded):
        raise InputError(
            f"{path}: stops and encoded are for files of floats, such as .exr and .hdr"
            " (this one holds encoded integers)"
        )
    check_picture(path, pixels, ("Orientation", "several pictures"), encoded=reading.encoded)
    notes: list[str] = []
    if integers and (count := count_pictures(path)) > 1:
        notes.append(f"holds {count} pictures: the first is taken")
    colour, alpha = _colour_and_alpha(path, pixels, notes)
    premultiplied = not pixels.attributes.get("oiio:UnassociatedAlpha", 0)
    if integers:
        if colour.dtype == np.uint8 and alpha is None:
            return AnyPicture(_upright(colour, pixels, notes), 8, tuple(notes))
        shown = from_integers(colour)
    else:
        stored = stored_transfer(path, pixels.attributes)
        encoded = reading.encoded or stored is Transfer.ENCODED
        if alpha is not None and premultiplied and not encoded:
            # The background is put behind in light, where alpha was made.
            behind = ((reading.background + 0.055) / 1.055) ** 2.4 / 2.0**reading.stops
            colour = colour + (1 - alpha) * np.float32(behind)
            shown = _shown(path, colour, reading, notes, encoded=False, options=options)
            notes.append(_transparent(reading))
            return AnyPicture(_upright(shown, pixels, notes), 16, tuple(notes))
        shown = _shown(path, colour, reading, notes, encoded=encoded, options=options)
    if alpha is not None:
        over = shown if premultiplied else shown * alpha
        shown = np.clip(over + (1 - alpha) * np.float32(reading.background), 0, 1)
        notes.append(_transparent(reading))
    bits = 8 if pixels.data.dtype == np.uint8 else 16
    return AnyPicture(_upright(shown.astype(np.float32), pixels, notes), bits, tuple(notes))


def check_drawable(path: Path, ctx: moderngl.Context | None) -> None:
    """Refuse by its header a picture that is too large for the textures of a context.

    Raises
    ------
    InputError
        With the limit and the cure.
    """
    size_px = stated_size_px(path) if ctx is not None and path.is_file() else None
    if ctx is None or size_px is None:
        return
    most = int(ctx.info["GL_MAX_TEXTURE_SIZE"])
    if max(size_px) > most:
        raise InputError(
            f"{path}: must have edges of at most {most} px, as OpenGL has here (is"
            f" {size_px[0]} x {size_px[1]} px); make it smaller, or add --numpy"
        )


def _transparent(reading: PictureReading) -> str:
    return f"transparent: put on a grey of {reading.background:g}"


def _colour_and_alpha(
    path: Path, pixels: StoredPixels, notes: list[str]
) -> tuple[AnyArray, NDArray[np.float32] | None]:
    """Red, green and blue as stored, and alpha in [0, 1] unless it is 1 everywhere."""
    data, names = pixels.data, pixels.channels
    if is_layered(path, pixels):
        planes = read_parts(path, judged=True).planes
        layer = colour_layer(path, planes)
        light = [need(path, planes, key, layer=layer) for key in "rgb"]
        plane = alpha_of(planes, light[0])
        taken = [*light, plane]
        extra = [name for name, one in planes.items() if not any(one is other for other in taken)]
        alpha = _alpha(path, plane)
        if extra:
            notes.append(f"channels that are no colour are left out: {', '.join(extra)}")
        return np.stack(light, axis=-1), alpha
    alpha = _alpha(path, data[..., names.index("A")] if "A" in names else None)
    if {"R", "G", "B"} <= set(names):
        extra = [name for name in names if name not in ("R", "G", "B", "A")]
        if extra:
            notes.append(f"channels that are no colour are left out: {', '.join(extra)}")
        return data[..., [names.index(name) for name in "RGB"]], alpha
    rest = [name for name in names if name != "A"]
    if len(rest) == 1 and rest[0] in _GREY:
        notes.append("grey: shown as equal red, green and blue")
        return np.repeat(data[..., names.index(rest[0]), None], 3, axis=-1), alpha
    raise InputError(
        f"{path}: must have the channels R, G, B or one grey (has {', '.join(names)});"
        " save it as a PNG in colour"
    )


def _alpha(path: Path, plane: AnyArray | None) -> NDArray[np.float32] | None:
    """Alpha of shape (H, W, 1) in [0, 1]; None if it is 1 everywhere."""
    if plane is None:
        return None
    plane = from_integers(plane) if plane.dtype.kind == "u" else plane
    if not (np.isfinite(plane) & (plane >= 0) & (plane <= 1)).all():
        raise InputError(f"{path}: alpha must lie in 0..1")
    return None if (plane == 1).all() else plane[..., None].astype(np.float32)


def _shown(
    path: Path,
    stored: AnyArray,
    reading: PictureReading,
    notes: list[str],
    *,
    encoded: bool,
    options: bool,
) -> NDArray[np.float32]:
    """Encode light, or take floats that are encoded as they are."""
    check_finite_light(path, stored)
    if encoded and reading.stops != 0:
        raise InputError(f"{path}: stops are for light (this file holds encoded colour)")
    light = stored.astype(np.float64) * 2.0**reading.stops
    low, high = float(light.min()), float(light.max())
    if low < 0 and not encoded:
        notes.append(f"{100 * (light < 0).mean():.2g} % of its light is below 0, to {low:.3g}: 0")
        light, low = np.maximum(light, 0), 0.0
    notes.append(
        "floats: taken as encoded colour"
        if encoded
        else "floats: taken as scene-linear light with sRGB primaries, encoded by the sRGB curve"
    )
    clip = reading.clip
    if reading.exposed and not encoded and high - 1 > NEARLY:
        brightest = light.max(axis=-1)
        whole, median = max(1.0, float(np.quantile(brightest, EXPOSED_SHARE))), np.median(brightest)
        dark = whole > 1 and median < LEAST_MEDIAN * whole
        stops = math.floor(-10 * math.log2(max(1, median / MID_GREY) if dark else whole)) / 10
        share = float((brightest * 2.0**stops <= 1 + NEARLY).mean())
        notes.append(
            f"its light reaches {high:.4g}: shown as with --stops {reading.stops + stops:.1f}"
            f" --clip, by which {100 * share:.3g} % of its pixels lie in 0..1"
            + (f"; at {100 * EXPOSED_SHARE:g} % most would be black" if dark else "")
        )
        light, clip = light * 2.0**stops, True
    if clip or max(high - 1, -low) <= NEARLY:
        share = float(((light < 0) | (light > 1)).mean())
        if share > 0:
            notes.append(f"{100 * share:.2g} % of its values clipped to what a display shows")
        light = np.clip(light, 0, 1)
    else:
        mend = "lower its exposure" if high > 1 else "raise its least value to 0"
        cure = "clip it with --clip" if options else f"{mend}, or save it as PNG"
        if high > 1 and not encoded and options:
            stops = reading.stops + math.floor(-10 * math.log2(high)) / 10
            cure = f"darken it by --stops {stops:.1f}, or {cure}"
        raise InputError(
            f"{path}: must lie in 0..1 to be shown (it reaches from {low:.4g} to {high:.4g});"
            f" {cure}"
        )
    return np.asarray(light if encoded else encode_srgb(light), np.float32).clip(0, 1)


def _upright(colour: AnyArray, pixels: StoredPixels, notes: list[str]) -> AnyArray:
    """Turn a photograph as its camera was held: the eight orientations of Exif."""
    orientation = int(pixels.attributes.get("Orientation", 1))
    if orientation in range(2, 9):
        notes.append("turned upright, as its Exif orientation says")
        if orientation >= 5:
            colour = colour.transpose(1, 0, 2)
        if orientation in (2, 3, 6, 7):
            colour = colour[:, ::-1]
        if orientation in (3, 4, 7, 8):
            colour = colour[::-1]
    return np.ascontiguousarray(colour)
