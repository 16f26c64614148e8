"""Colour: the sRGB transfer function, and one Y'CbCr matrix with its exact inverse.

Everywhere in this project "colour" means display-referred R'G'B' in [0, 1]: sRGB
primaries, gamma-encoded. Perceived contrast, not energy, is what the features measure
(Walton et al. 2021, section 6).
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import Floats

# BT.709 luma weights; full range, so Y' spans [0, 1] and Cb, Cr span [-0.5, 0.5].
_RED, _GREEN, _BLUE = 0.2126, 0.7152, 0.0722

YCBCR_FROM_RGB: Final[Floats] = np.array(
    [
        [_RED, _GREEN, _BLUE],
        [-_RED / (2 - 2 * _BLUE), -_GREEN / (2 - 2 * _BLUE), 0.5],
        [0.5, -_GREEN / (2 - 2 * _RED), -_BLUE / (2 - 2 * _RED)],
    ]
)
RGB_FROM_YCBCR: Final[Floats] = np.array(
    [
        [1.0, 0.0, 2 - 2 * _RED],
        [1.0, -_BLUE * (2 - 2 * _BLUE) / _GREEN, -_RED * (2 - 2 * _RED) / _GREEN],
        [1.0, 2 - 2 * _BLUE, 0.0],
    ]
)


def ycbcr_from_rgb(colour: NDArray[np.floating]) -> NDArray[np.floating]:
    """Decorrelate R'G'B' of shape (..., 3) into Y', Cb, Cr (BT.709, full range).

    Raises
    ------
    InputError
        If `colour` is not of a floating type or its last axis is not 3 long.
    """
    _check_floating(colour, "colour", channels=3)
    return colour @ YCBCR_FROM_RGB.T.astype(colour.dtype)


def rgb_from_ycbcr(ycbcr: NDArray[np.floating]) -> NDArray[np.floating]:
    """Invert `ycbcr_from_rgb`.

    Raises
    ------
    InputError
        If `ycbcr` is not of a floating type or its last axis is not 3 long.
    """
    _check_floating(ycbcr, "ycbcr", channels=3)
    return ycbcr @ RGB_FROM_YCBCR.T.astype(ycbcr.dtype)


def encode_srgb(linear: NDArray[np.floating]) -> NDArray[np.floating]:
    """Encode scene-linear light of any shape for a display (IEC 61966-2-1).

    1 is the display's white; what is brighter goes on along the curve, and clipping it is
    the caller's decision.

    Raises
    ------
    InputError
        If `linear` is not of a floating type, or a value is negative or not finite.
    """
    _check_light(linear, "linear")
    return np.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055
    ).astype(linear.dtype)


def decode_srgb(encoded: NDArray[np.floating]) -> NDArray[np.floating]:
    """Invert `encode_srgb`: encoded values of any shape to scene-linear light, 1 is white.

    Raises
    ------
    InputError
        If `encoded` is not of a floating type, or a value is negative or not finite.
    """
    _check_light(encoded, "encoded")
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4).astype(
        encoded.dtype
    )


def _check_light(array: NDArray[np.floating], name: str) -> None:
    _check_floating(array, name)
    bad = ~(np.isfinite(array) & (array >= 0))
    if bad.any():
        raise InputError(
            f"{name} must be finite and at least 0"
            f" (got {array[bad].flat[0]}, and {int(bad.sum())} such values in all)"
        )


def _check_floating(array: NDArray[np.floating], name: str, *, channels: int | None = None) -> None:
    # Integers would be truncated without a word: 8-bit values must be divided by 255 first.
    if not np.issubdtype(array.dtype, np.floating):
        raise InputError(f"{name} must be of a floating type (got {array.dtype})")
    if channels is not None and array.shape[-1:] != (channels,):
        raise InputError(f"{name} must be of shape (..., {channels}) (got {array.shape})")
