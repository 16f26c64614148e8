"""Pixels to and from files, through OpenImageIO; what they mean is for `stimuli.exr` to say."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import OpenImageIO as oiio  # noqa: N813  its own documentation calls it so
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.limits import check_need, check_values
from protocols.outside import reading, visible_line

_INTEGERS = {"uint8": np.uint8, "uint16": np.uint16}
# OpenEXR files carry the time of writing, unless told one: same pixels, same bytes.
_NO_TIME = "1970:01:01 00:00:00"
_LOSSY = ("jpeg", "jpeg2000", "jpegxl", "webp", "heif")
_NEEDS_ROOM = ("jpeg", "webp")
"""Formats whose libraries end the process, or never return, when the disk is full."""
_HEAD = 2**16  # bytes that hold all of such a file but its pixels
_UPRIGHT = 1  # of Exif's orientations
_FIRST_ON_ITS_SIDE = 5  # of the eight orientations of Exif
_ENDS = {".png": b"IEND\xaeB`\x82", ".tga": b"TRUEVISION-XFILE.\0"}


@dataclass(frozen=True)
class Pixels:
    """The content of an image file, as stored.

    Parameters
    ----------
    data : ndarray of uint8, uint16 or float32, shape (H, W, C)
        Integers as stored; half and float, and whatever else, as float32.
    channels : tuple of str
        C names, such as ``R``, ``Z`` or ``flow.x``.
    attributes : mapping
        The file's header.
    """

    data: NDArray[Any]
    channels: tuple[str, ...]
    attributes: Mapping[str, Any] = field(default_factory=dict)


def read_pixels(path: Path) -> Pixels:
    """Read an image file of any format that OpenImageIO knows.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    InputError
        If it is not an image, or its end is missing.
    """
    if not path.exists():
        raise FileNotFoundError(2, "No such file", str(path))
    with reading(
        path, "a whole image", InputError
    ):  # names and texts in its header may be no UTF-8
        return _read_pixels(path)


def _read_pixels(path: Path, *, ours: bool = False) -> Pixels:
    config = oiio.ImageSpec()  # without one, PFM files come out upside down
    config.attribute("oiio:UnassociatedAlpha", 1)  # colour as stored, not multiplied by alpha
    source = oiio.ImageInput.open(str(path), config) if path.is_file() else None
    if source is None:
        no_file = "it is a folder" if path.is_dir() else "it is no regular file"
        reason = visible_line(oiio.geterror()) if path.is_file() else no_file
        raise InputError(f"{path}: must be an image ({reason}); is it damaged or of another kind?")
    try:
        spec = source.spec()
        if not ours:
            check_values(path, spec.width, spec.height, spec.nchannels)
    except Exception:
        source.close()
        raise
    stored = str(spec.format) if not spec.channelformats else "float"
    kind = stored if stored in _INTEGERS else "float"
    data = source.read_image(0, 0, 0, spec.nchannels, kind)
    error = source.geterror()
    source.close()
    if data is None or error:
        raise InputError(
            f"{path}: must be a whole image ({visible_line(error)});"
            " the file is damaged or was cut short: copy or make it again"
        )
    data = np.asarray(data).reshape(spec.height, spec.width, spec.nchannels)
    attributes = {item.name: item.value for item in spec.extra_attribs}
    return Pixels(data, tuple(spec.channelnames), attributes)


def stated_size_px(path: Path, *, upright: bool = False) -> tuple[int, int] | None:
    """Return width and height as an image file's header has them; None where it is no image.

    With `upright`, as it is seen once turned by its Exif orientation.
    """
    source = oiio.ImageInput.open(str(path)) if path.is_file() else None
    if source is None:
        oiio.geterror()
        return None
    spec = source.spec()
    source.close()
    size_px = int(spec.width), int(spec.height)
    turned = upright and spec.get_int_attribute("Orientation", _UPRIGHT) >= _FIRST_ON_ITS_SIDE
    return size_px[::-1] if turned else size_px


def check_fits(path: Path, command: str) -> None:
    """Refuse by its header a picture for which a command of `NEEDS` takes too much memory.

    Raises
    ------
    InputError
        As `pipeline.limits.check_need`. What is no picture, its reader refuses.
    """
    size_px = stated_size_px(path)
    if size_px is not None:
        check_need(path, command, *size_px)


def may_be_lossy(path: Path) -> str | None:
    """Return the format of an image file whose numbers may be changed by compression, else None."""
    source = oiio.ImageInput.open(str(path)) if path.is_file() else None
    if source is None:
        oiio.geterror()
        return None
    name = str(source.format_name())
    source.close()
    return name if name in _LOSSY else None


def check_upright(path: Path, pixels: Pixels) -> None:
    """Refuse a photograph that is stored as its camera was held, which nobody asks to be turned.

    Raises
    ------
    InputError
        If its Exif orientation is another than upright.
    """
    orientation = int(pixels.attributes.get("Orientation", _UPRIGHT))
    if orientation != _UPRIGHT:
        raise InputError(
            f"{path}: must be stored upright (its Exif orientation is {orientation}); turn it and"
            " save it again"
        )


def count_pictures(path: Path) -> int:
    """Return how many pictures an image file holds: pages of a TIFF, frames of a GIF, ..."""
    source, count = oiio.ImageInput.open(str(path)), 0
    while source is not None and source.seek_subimage(count, 0):
        count += 1
    oiio.geterror()
    if source is not None:
        source.geterror()
        source.close()
    return count


def three_channels(path: Path, pixels: Pixels) -> NDArray[Any]:
    """Return `pixels` as red, green, blue of shape (H, W, 3), as stored; grey becomes three.

    Raises
    ------
    InputError
        If there are other channels, or an alpha channel that is not 1 everywhere.
    """
    data, names = pixels.data, pixels.channels
    if names[-1:] == ("A",):
        opaque = np.iinfo(data.dtype).max if data.dtype.kind == "u" else 1
        if not (data[..., -1] == opaque).all():
            raise InputError(
                f"{path}: must be opaque (its alpha channel is not 1 everywhere);"
                " put it on a background first"
            )
        data, names = data[..., :-1], names[:-1]
    if len(names) == 1 and names[0] in ("Y", "L"):
        return np.repeat(data, 3, axis=-1)
    if set(names) != {"R", "G", "B"}:
        raise InputError(
            f"{path}: must have the channels R, G, B (has {', '.join(pixels.channels)})"
        )
    return data[..., [names.index(name) for name in "RGB"]]


def from_integers(data: NDArray[np.unsignedinteger[Any]]) -> NDArray[np.float32]:
    """Return stored integers as [0, 1], the largest one that fits as 1."""
    # Rounded as by way of float64: twice 24 bits and two more are fewer than its 53.
    largest = np.float32(np.iinfo(data.dtype).max)
    shown: NDArray[np.float32] = np.divide(data, largest, dtype=np.float32)
    return shown


FREE_SPACE: Final = "free some space on this disk, or choose another one"


def write_pixels(
    path: Path,
    data: NDArray[Any],
    channels: Sequence[str],
    *,
    types: Sequence[str] = (),
    attributes: Mapping[str, str | int | float] | None = None,
) -> None:
    """Write an image file whole or not at all: under a temporary name, synced, then renamed.

    Parameters
    ----------
    path : Path
        The extension chooses the format.
    data : ndarray of shape (H, W, C)
    channels : sequence of str
        C names.
    types : sequence of str, optional
        What to store each channel as, ``"half"`` or ``"float"``; by default as `data`.
    attributes : mapping, optional
        For the header.

    Raises
    ------
    OSError
        If the folder is missing or cannot be written to, or the disk is full.
    InputError
        If the format is unknown or cannot hold the data.
    """
    height, width, count = data.shape
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.tmp{path.suffix}")
    target = oiio.ImageOutput.create(str(temporary))
    if target is None:
        oiio.geterror()  # it names the temporary file
        raise InputError(f"{path}: must end as an image format does, such as .png or .exr")
    try:
        try:  # what the system has against it, it says better than OpenImageIO
            with temporary.open("wb") as room:
                if target.format_name() in _NEEDS_ROOM:
                    room.write(bytes(2 * data.nbytes + _HEAD))
        except OSError as error:
            raise type(error)(error.errno, error.strerror, str(path)) from None
        spec = oiio.ImageSpec(width, height, count, _oiio_type(data.dtype))
        spec.channelnames = tuple(channels)
        spec.attribute("oiio:UnassociatedAlpha", 1)
        if types:
            spec.channelformats = tuple(types)
        if path.suffix.lower() == ".exr":
            spec.attribute("DateTime", _NO_TIME)
        for name, value in (attributes or {}).items():
            spec.attribute(name, value)
        done = target.open(str(temporary), spec) and target.write_image(np.ascontiguousarray(data))
        if not (target.close() and done):
            raise write_error(path, visible_line(target.geterror()))
        _check_whole(path, temporary, data.shape)
        with temporary.open("rb") as written:
            os.fsync(written.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _check_whole(path: Path, temporary: Path, shape: tuple[int, ...]) -> None:
    """Read the file back: on a full disk OpenImageIO writes half of it and reports success."""
    try:
        whole = _read_pixels(temporary, ours=True).data.shape == shape
    except InputError:
        whole = False
    if whole:
        whole = temporary.read_bytes().endswith(_ENDS.get(path.suffix.lower(), b""))
    if not whole:
        raise write_error(path, f"the file came out incomplete; {FREE_SPACE}")


def write_error(path: Path, reason: str) -> Exception:
    """Return what to raise of a file that a library did not write whole; its reason is named."""
    free = os.statvfs(path.parent)
    if free.f_bavail == 0:
        return OSError(28, "No space left on device", str(path))
    return InputError(f"{path}: cannot be written ({reason})")


def _oiio_type(dtype: np.dtype[Any]) -> str:
    names = {"uint8": "uint8", "uint16": "uint16", "float16": "half", "float32": "float"}
    if dtype.name not in names:
        raise InputError(f"pixels must be one of {', '.join(names)} (got {dtype.name})")
    return names[dtype.name]
