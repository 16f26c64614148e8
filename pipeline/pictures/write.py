"""Image files, written whole or not at all."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import OpenImageIO as oiio  # noqa: N813  its own documentation calls it so

from pipeline.errors import InputError
from pipeline.frame import AnyArray
from pipeline.pictures.decode import pixels_of
from protocols.disk.whole_file import whole_path
from protocols.outside import visible_line

# OpenEXR files carry the time of writing, unless told one: same pixels, same bytes.
_NO_TIME = "1970:01:01 00:00:00"
_NEEDS_ROOM = ("jpeg", "webp")
"""Formats whose libraries end the process, or never return, when the disk is full."""
_HEAD = 2**16  # bytes that hold all of such a file but its pixels
_ENDS = {".png": b"IEND\xaeB`\x82", ".tga": b"TRUEVISION-XFILE.\0"}
FREE_SPACE: Final = "free some space on this disk, or choose another one"


def write_pixels(
    path: Path,
    data: AnyArray,
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
    with whole_path(path, path.suffix) as temporary:
        target = oiio.ImageOutput.create(str(temporary))
        if target is None:
            oiio.geterror()  # it names the temporary file
            raise InputError(f"{path}: must end as an image format does, such as .png or .exr")
        if target.format_name() in _NEEDS_ROOM:  # OpenImageIO would not say what stands against it
            temporary.write_bytes(bytes(2 * data.nbytes + _HEAD))
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


def _check_whole(path: Path, temporary: Path, shape: tuple[int, ...]) -> None:
    """Read the file back: on a full disk OpenImageIO writes half of it and reports success."""
    try:
        whole = pixels_of(temporary, ours=True).data.shape == shape
    except InputError:
        whole = False
    if whole:
        whole = temporary.read_bytes().endswith(_ENDS.get(path.suffix.lower(), b""))
    if not whole:
        raise write_error(path, f"the file came out incomplete; {FREE_SPACE}")


def write_error(path: Path, reason: str) -> Exception:
    """Return the exception for a file that a library did not write whole; its reason is named."""
    if shutil.disk_usage(path.parent).free == 0:
        return OSError(28, "No space left on device", str(path))
    return InputError(f"{path}: cannot be written ({reason})")


def _oiio_type(dtype: np.dtype[Any]) -> str:
    names = {"uint8": "uint8", "uint16": "uint16", "float16": "half", "float32": "float"}
    if dtype.name not in names:
        raise InputError(f"pixels must be one of {', '.join(names)} (got {dtype.name})")
    return names[dtype.name]
