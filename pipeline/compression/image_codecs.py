"""Kept codecs for 8-bit pictures, through Pillow: JPEG as in the paper, AVIF and WebP beside it."""

from __future__ import annotations

import io
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from PIL import Image, features

from pipeline.errors import InputError
from protocols.errors import must_be_one_of

Bytes = NDArray[np.uint8]

CODECS = ("jpeg", "avif", "webp")
"""By their number in files, which never changes."""
BEST_QUALITY = 95  # beyond it files grow and little else does
WHOLE_CHROMA, THINNED_CHROMA = "4:4:4", "4:2:0"
"""As many samples of chroma as of luma, or a quarter; WebP always thins. Cells are few, so that
thinned chroma costs the fovea 3 to 10 dB."""


def check_codec(codec: str) -> str:
    """Require a codec that we know and that Pillow has here.

    Raises
    ------
    InputError
        Saying which are there.
    """
    there = [name for name in CODECS if name == "jpeg" or features.check(name)]
    if codec not in there:
        missing = "; this Pillow is built without it" if codec in CODECS else ""
        raise InputError(must_be_one_of("codec", codec, there) + missing)
    return codec


def encode(picture: Bytes, codec: str, quality: int, chroma: str = WHOLE_CHROMA) -> bytes:
    """Code a picture (H, W) or (H, W, 3), by a quality from 1 to `BEST_QUALITY`."""
    held = io.BytesIO()
    kind = check_codec(codec).upper()
    Image.fromarray(picture).save(held, kind, quality=quality, subsampling=chroma)
    return held.getvalue()


def best_quality(fits: Callable[[int], bool]) -> int:
    """The best quality that fits, found by halving; 0 if none does."""
    low, high = 0, BEST_QUALITY
    while low < high:
        middle = (low + high + 1) // 2
        if fits(middle):
            low = middle
        else:
            high = middle - 1
    return low


def decode(data: bytes, codec: str, shape: tuple[int, ...], what: str) -> Bytes:
    """Decode a picture of a known shape.

    Nothing is unpacked before its size was compared.

    Raises
    ------
    InputError
        If the data are damaged or of another size; `what` names them.
    """
    try:
        with Image.open(io.BytesIO(data), formats=[check_codec(codec).upper()]) as image:
            if image.size != (shape[1], shape[0]):
                raise InputError(
                    f"{what} must have {shape[1]} x {shape[0]} px"
                    f" (has {image.size[0]} x {image.size[1]})"
                )
            return np.asarray(image.convert("RGB" if len(shape) == 3 else "L"))
    except InputError:
        raise
    except Exception as error:  # whatever a codec says of bytes that are none of its own
        reason = (str(error).strip() or type(error).__name__).splitlines()[0][:200]
        raise InputError(f"{what} must be a whole {codec} picture ({reason})") from error
