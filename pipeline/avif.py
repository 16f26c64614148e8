"""AVIF pictures, through Pillow; HEIC is named, which neither it nor OpenImageIO reads."""

from __future__ import annotations

import re
from pathlib import Path

from PIL import Image, features

from pipeline.errors import InputError
from protocols.outside import reading

_HEAD = 1 << 16
_HEIC = (b"heic", b"heix", b"hevc", b"heim", b"heis", b"mif1", b"msf1")
_SHOWN = (1, 2, 6, 13, 14, 15)  # transfers that are shown as sRGB, or not said
_PRIMARIES = (1, 2)
_CURE = "save it as PNG or JPEG"


def opened_avif(path: Path) -> Image.Image | None:
    """Open an AVIF picture of 8 bits; None where a file is none.

    Raises
    ------
    InputError
        If it is HEIC, is damaged, holds several pictures, has more bits or another range of
        colour, or Pillow has no decoder.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD)
    brands = head[8 : min(int.from_bytes(head[:4]), 256)] if head[4:8] == b"ftyp" else b""
    if not {b"avif", b"avis"} & {brands[at : at + 4] for at in range(0, len(brands), 4)}:
        if brands.startswith(_HEIC):
            raise InputError(f"{path}: is HEIC, which is not read; {_CURE}")
        return None
    if not features.check("avif"):
        raise InputError(f"{path}: is AVIF, which this Pillow does not read; {_CURE}")
    depths = re.findall(rb"pixi.{5}(.)", head, re.DOTALL)
    colours = re.findall(rb"colrnclx(..)(..)", head, re.DOTALL)
    if any(depth[0] > 8 for depth in depths) or any(
        int.from_bytes(first) not in _PRIMARIES or int.from_bytes(curve) not in _SHOWN
        for first, curve in colours
    ):
        raise InputError(
            f"{path}: an AVIF picture must have 8 bits and the colours of sRGB (has more); {_CURE}"
        )
    with reading(path, "a whole AVIF picture", InputError):
        image = Image.open(path, formats=["AVIF"])
    if (pictures := getattr(image, "n_frames", 1)) > 1:
        image.close()
        raise InputError(f"{path}: must hold one picture (holds {pictures}); {_CURE}")
    return image
