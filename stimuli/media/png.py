"""PNG frames: encoded in memory, checked without decoding."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import AnyArray
from pipeline.pictures.size_limits import check_values
from protocols.outside import reading

# Run lengths find what repeats in a photograph-like frame (flat sky), and nothing more does: zlib's
# own search takes twice the time for files that are 2 % larger.
_OPTIONS = [
    cv2.IMWRITE_PNG_COMPRESSION, 3,
    cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE,
]  # fmt: skip
_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def encode_frame(colour: NDArray[np.float32], bit_depth: int) -> bytes:
    """Return a PNG of encoded colour in [0, 1], shape (H, W, 3), with 8 or 16 bits."""
    dtype = np.uint8 if bit_depth == 8 else np.uint16
    largest = np.float32(np.iinfo(dtype).max)
    whole = np.multiply(colour, largest)
    whole += np.float32(0.5)
    return _encode(cv2.cvtColor(whole.astype(dtype), cv2.COLOR_RGB2BGR), _OPTIONS)


def encode_bytes(colour: NDArray[np.uint8]) -> bytes:
    """Return a PNG of stored red, green, blue, shape (H, W, 3), unchanged."""
    return _encode(cv2.cvtColor(colour, cv2.COLOR_RGB2BGR), _OPTIONS)


def encode_mask(mask: NDArray[np.bool_]) -> bytes:
    """Return a PNG of one bit per pixel, white where true."""
    return _encode(mask.astype(np.uint8) * 255, [cv2.IMWRITE_PNG_BILEVEL, 1])


def decode_png(path: Path) -> AnyArray:
    """Read a PNG as stored: (H, W, 3) in red, green, blue, or (H, W).

    Raises
    ------
    InputError
        If it is not a whole PNG.
    """
    data = path.read_bytes()
    image = None
    if is_whole_png(data):
        check_values(path, *struct.unpack_from(">II", data, 16), 4)  # as its first chunk says
        with reading(path, "a whole PNG file", InputError):
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise InputError(f"{path}: must be a whole PNG file (it is damaged or cut short)")
    return image[..., ::-1] if image.ndim == 3 else image


def decode_in_8_bits(path: Path) -> NDArray[np.uint8]:
    """Read a PNG as `decode_png`; of 16 bits a channel the upper 8."""
    stored = decode_png(path)
    return np.ascontiguousarray(stored >> 8 if stored.dtype == np.uint16 else stored, np.uint8)


def decode_in_unit(path: Path) -> NDArray[np.float32]:
    """Read a PNG as `decode_png`, its numbers from 0 to 1."""
    stored = decode_png(path)
    return (stored / np.float32(np.iinfo(stored.dtype).max)).astype(np.float32)


def is_whole_png(data: bytes) -> bool:
    """True if `data` is a PNG in which every chunk is there and unharmed."""
    if data[:8] != _SIGNATURE:
        return False
    at = 8
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        end = at + 12 + length
        if end > len(data):
            return False
        kind = data[at + 4 : at + 8]
        if zlib.crc32(data[at + 4 : end - 4]) != struct.unpack_from(">I", data, end - 4)[0]:
            return False
        if kind == b"IEND":
            return bool(end == len(data))
        at = end
    return False


def _encode(image: AnyArray, options: list[int]) -> bytes:
    done, data = cv2.imencode(".png", np.ascontiguousarray(image), options)
    if not done:
        raise InputError(f"a frame of {image.shape} could not be encoded as PNG")
    return bytes(data)
