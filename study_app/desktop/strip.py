"""Additions of a lab to the picture: a patch for a photodiode, and the number of the flip.

The number is for a camera or a frame grabber to read.

A row of blocks at the upper and at the lower edge of the screen: white, black, 24 bits of the
flip's number and 8 bits of its CRC, most significant bit first (white is 1). A capture that was
torn between two flips shows two different numbers.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

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


class CapturedPicture(NamedTuple):
    """One captured picture."""

    number: int
    """Number that its strip says."""
    content: str
    """A hash of the clip's place, by any function of the pixels."""


@dataclass(frozen=True)
class FlipMismatch:
    """One flip that was not what the log says."""

    number: int
    expected: str
    found: str

    def __str__(self) -> str:
        return f"flip {self.number}: must show {self.expected} (found {self.found})"


def compare(
    logged: Mapping[int, str | None],
    captured: Sequence[CapturedPicture],
    names: Mapping[str, str],
    *,
    attempts: Sequence[range] = (),
    blank: Collection[str] = (),
) -> list[FlipMismatch]:
    """Return every difference between what was logged and what was captured.

    Also compared is what the log does not name: pages, waits and the warm-up. There, as in
    every phase without a clip, no clip frame may be seen, and numbers only rise.

    Parameters
    ----------
    logged : mapping
        Number of each flip -> the name of the clip frame it showed; None: no clip.
    captured : sequence of CapturedPicture
        In the order in which the pictures appeared, each once.
    names : mapping
        Hash of the pixels -> name of the clip frame.
    attempts : sequence of range
        Numbers of the flips of each attempt, from its first to its last: all of them are logged.
    blank : collection of str
        Hashes of pixels that are also seen where no clip is, such as a frame as grey as the screen.

    Returns
    -------
    list of FlipMismatch
        In the order of the log: flips that are missing, out of order, or show something else. Then,
        in the order of the capture, flips that were shown again and flips that are not in the
        log. Empty where all flips appeared once, in order, with the right content.
    """
    first_at: dict[int, int] = {}
    for place, seen in enumerate(captured):
        first_at.setdefault(seen.number, place)
    found: list[FlipMismatch] = []
    latest = -1
    for number, frame in logged.items():
        expected = frame or "no clip"
        place = first_at.get(number, -1)
        if place < 0:
            found.append(FlipMismatch(number, expected, "no such flip"))
            continue
        if place < latest:
            found.append(FlipMismatch(number, expected, "the flip after a later one"))
        latest = max(latest, place)
        content = captured[place].content
        shown = names.get(content)
        if shown != frame and not (frame is None and content in blank):
            found.append(FlipMismatch(number, expected, shown or "pixels of no clip frame"))
    return found + _besides(logged, captured, names, attempts, blank)


def _besides(
    logged: Mapping[int, str | None],
    captured: Sequence[CapturedPicture],
    names: Mapping[str, str],
    attempts: Sequence[range],
    blank: Collection[str],
) -> list[FlipMismatch]:
    """Return the captures that should not have been."""
    found: list[FlipMismatch] = []
    latest, before = -1, None
    seen_before: set[int] = set()
    for seen in captured:
        if seen == before:
            continue
        before, frame = seen, names.get(seen.content)
        said = "nothing, it is not in the log"
        if seen.number in seen_before:
            found.append(
                FlipMismatch(seen.number, "nothing any more", f"the flip again, after {latest}")
            )
        elif seen.number < latest and seen.number not in logged:
            found.append(FlipMismatch(seen.number, said, f"an earlier flip after {latest}"))
        elif seen.number not in logged:
            if frame is not None and seen.content not in blank:
                found.append(FlipMismatch(seen.number, said, frame))
            elif any(seen.number in attempt for attempt in attempts):
                found.append(FlipMismatch(seen.number, said, "a flip within an attempt"))
        seen_before.add(seen.number)
        latest = max(latest, seen.number)
    return found
