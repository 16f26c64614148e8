"""Additions of a lab to the picture: a patch for a photodiode, and the number of the flip.

The number is for a camera or a frame grabber to read.

A row of blocks at the upper and at the lower edge of the screen: white, black, 24 bits of the
flip's number and 8 bits of its CRC, most significant bit first (white is 1). A capture that was
torn between two flips shows two different numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from protocols.errors import StudyError
from protocols.script import TrialScript

NUMBER_BITS = 24
CRC_BITS = 8
GUARD = (1, 0)
BLOCKS = len(GUARD) + NUMBER_BITS + CRC_BITS
BLOCK_PX = 8
"""Edge of a block; the strip is `BLOCKS` of them wide and one high."""
PATCH_PX = 48
"""Edge of the photodiode's patch, in the lower right corner."""
_CRC_POLYNOMIAL = 0x07  # x^8 + x^2 + x + 1


@dataclass(frozen=True)
class FlipMarks:
    """Additions of a lab to the picture."""

    strip: bool = False
    """Frame strip: number and CRC of every flip."""
    photodiode: bool = False
    """Patch that is white at every other clip frame."""

    def check(self, script: TrialScript) -> None:
        """Refuse what would cover a stimulus.

        Raises
        ------
        StudyError
            Saying how many pixels must be free.
        """
        (across, down), (width, height) = script.size_px, script.stimulus_px
        shown = [entry for entries in script.frames for entry in entries]
        wide = [entry.at[0] + (entry.crop[2] if entry.crop else width) for entry in shown]
        right = across // 2 + max(wide, default=-across)
        top = down // 2 + min((entry.at[1] for entry in shown), default=down)
        sizes = f"(they are {width}x{height} on {across}x{down})"
        if self.strip and (top < BLOCK_PX or across < BLOCKS * BLOCK_PX or height > down):
            raise StudyError(
                f"--strip: the frame strip needs {BLOCKS * BLOCK_PX}x{BLOCK_PX} pixels free above"
                f" and below the clips {sizes}; make the clips smaller, or leave the strip out"
            )
        x, y = patch_place(script.size_px)
        if self.photodiode and x < right and y < top + height:
            raise StudyError(
                f"--photodiode: the patch needs {PATCH_PX} pixels beside or below the clips"
                f" {sizes}; make the clips smaller, or leave it out"
            )


def patch_place(size_px: tuple[int, int]) -> tuple[int, int]:
    """Return the patch's upper left corner, from that of the screen."""
    return size_px[0] - PATCH_PX, size_px[1] - PATCH_PX - BLOCK_PX


def crc8(data: bytes) -> int:
    """Return the CRC-8 of `data` (polynomial 07, initial value 0, as in SMBus)."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = ((crc << 1) ^ _CRC_POLYNOMIAL if crc & 0x80 else crc << 1) & 0xFF
    return crc


def code_of(number: int) -> int:
    """Return the 32 bits that stand for a flip's number (modulo 2^24) and its CRC."""
    number %= 1 << NUMBER_BITS
    return number << CRC_BITS | crc8(number.to_bytes(NUMBER_BITS // 8, "big"))


def read_strip(row: NDArray[np.uint8]) -> int | None:
    """Return the number in one row of pixels, or None where there is no whole strip.

    Parameters
    ----------
    row : ndarray of shape (at least BLOCKS * BLOCK_PX,)
        Grey values from the left edge of the screen.
    """
    bits = row[BLOCK_PX // 2 : BLOCKS * BLOCK_PX : BLOCK_PX] >= 128
    if len(bits) != BLOCKS or tuple(bits[: len(GUARD)].astype(int)) != GUARD:
        return None
    code = int("".join("1" if bit else "0" for bit in bits[len(GUARD) :]), 2)
    number = code >> CRC_BITS
    return number if code == code_of(number) else None


def read_both_strips(screen: NDArray[np.uint8]) -> int | None:
    """Return the number that both strips of a picture say, or None where they do not agree.

    A screen that is read while it is drawn is drawn from one edge to the other, so that one strip
    is its first part and the other its last. A copy of it is whole if both strips said one number
    before the copy was made (no part was still to come) and say it afterwards (nothing newer had
    begun). Asked afterwards alone, a copy taken while the rest was drawn would pass.

    Parameters
    ----------
    screen : ndarray of uint8, shape (height, at least BLOCKS * BLOCK_PX)
        One channel of the screen.
    """
    number = read_strip(screen[BLOCK_PX // 2, : BLOCKS * BLOCK_PX].copy())
    if number is None or read_strip(screen[-(BLOCK_PX // 2), : BLOCKS * BLOCK_PX].copy()) != number:
        return None
    return number
