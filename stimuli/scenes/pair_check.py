"""Check that the files of a stereo pair belong together: left, right, disparity in pixels.

A left pixel with disparity d must be seen again in the right photograph at x - d. Where the picture
is flat that holds for any d, so only pixels with texture along their row are asked.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from stimuli.scenes.stereo import StereoPair, too_wide

REFUSED_BELOW: Final = 0.5
"""Share of agreeing pixels. True pairs of Middlebury have 0.93 to 0.98, wrong ones at most 0.46."""
EXPLAINED_BELOW: Final = 0.7
"""The same, where another reading of the files explains what is wrong."""
DOUBTED_BELOW: Final = 0.8
"""An error of a tenth of all disparities, or of three pixels, lies below it."""

_TOLERANCE = 0.08  # of encoded grey
_TEXTURE = 0.08  # least contrast of the five pixels around one, along its row
_FEWEST = 200  # pixels that a judgement rests on
_MOST = 300_000  # pixels that are asked: rows are left out of larger pictures
_MOST_AGAIN = 30_000  # for each other reading
_FACTORS = (2, 3, 4, 5, 8, 10, 16, 32, 64, 100, 128, 256)
_ROWS = (1, 2, 3, 4, 6, 8, 12, 16)


@dataclass(frozen=True)
class PairVerdict:
    """Result of a comparison of both photographs.

    Parameters
    ----------
    agreeing : float, optional
        Share of the textured left pixels that the right photograph shows at x - d, of those that it
        sees; None where too few have texture, or none is seen.
    cause : str, optional
        What is wrong, with its cure, where another reading of the same files agrees well.
    wide : str, optional
        A disparity leads farther than the picture is wide.
    """

    agreeing: float | None
    cause: str | None = None
    wide: str | None = None

    @property
    def refused(self) -> bool:
        """True if the files cannot be a pair as they are given."""
        if self.wide is not None:
            return True
        if self.agreeing is None:
            return False
        return self.agreeing < (EXPLAINED_BELOW if self.cause else REFUSED_BELOW)

    @property
    def doubtful(self) -> bool:
        """True if a person should look at it."""
        unsure = self.agreeing is None or self.agreeing < DOUBTED_BELOW
        return unsure or self.cause is not None or self.wide is not None

    def __str__(self) -> str:
        """Return the rule, and the value that was found."""
        if self.wide is not None:
            return f"{self.wide}; {self.cause or 'is units_per_px (--units-per-px) right?'}"
        if self.agreeing is None:
            return "left and right could not be compared (too few pixels have texture)"
        cause = self.cause or (
            "the files may be of different pictures, or the disparity no disparity (depth?)"
        )
        return (
            "the right photograph must show the left one's pixels, moved left by the disparity"
            f" ({100 * self.agreeing:.0f} % of the textured ones agree); {cause}"
        )


def judge_pair(pair: StereoPair, *, units_per_px: float = 1.0) -> PairVerdict:
    """Compare the photographs of a pair by its disparity, and by what may have been meant.

    Parameters
    ----------
    pair : StereoPair
        With its right photograph.
    units_per_px : float
        As the file was read, for the cure.

    Raises
    ------
    InputError
        If the pair has no right photograph, or one of another size.
    """
    if pair.right is None:
        raise InputError("a pair must have its right photograph to be compared (it has none)")
    if np.array_equal(pair.left, pair.right):
        return PairVerdict(0.0, "left and right are the same picture: name the other photograph")
    agreeing = _agreeing(pair, _rows(pair, _MOST))
    wide = too_wide(pair.disparity_px)
    if wide is None and (agreeing is None or agreeing >= DOUBTED_BELOW + 0.1):
        return PairVerdict(agreeing)
    readings = _readings(pair, _rows(pair, _MOST_AGAIN), units_per_px)
    better, cause = max(readings, key=lambda found: found[0])
    fits = better >= max(DOUBTED_BELOW, (agreeing or 0.0) + 0.05)
    return PairVerdict(agreeing, cause if fits else None, wide)


def _rows(pair: StereoPair, most: int) -> NDArray[np.intp]:
    """The rows that are asked: evenly spaced, with at most so many pixels."""
    return np.arange(0, len(pair.disparity_px), -(-pair.disparity_px.size // most))


def _readings(
    pair: StereoPair, rows: NDArray[np.intp], units_per_px: float
) -> Iterator[tuple[float, str]]:
    """Yield the agreement, and the fault, of each other reading of the same files."""
    assert pair.right is not None
    exchanged = replace(pair, left=pair.right, right=pair.left)
    whose = (
        "the picture given as the right one is the left one"
        if pair.mirrored
        else "the picture given as left is the right one, with its own disparity"
    )
    for other, cause in (
        (exchanged, "left and right are exchanged"),
        (_turned(exchanged), "the disparity is that of the other photograph"),
        (_turned(pair), f"pixels move the other way: {whose}"),
    ):
        yield _agreeing(other, rows) or 0.0, cause
    for factor in (*_FACTORS, *(1 / factor for factor in _FACTORS)):
        disparity = (pair.disparity_px * factor).astype(np.float32)
        scaled = replace(pair, disparity_px=disparity, offset_px=_ANY_OFFSET)
        yield (
            _agreeing(scaled, rows) or 0.0,
            f"the disparity is in other units: units_per_px = {units_per_px / factor:g} fits",
        )
    for lower in (*_ROWS, *(-row for row in _ROWS)):
        yield (
            _agreeing(pair, rows, lower) or 0.0,
            f"the pair is not rectified: the right photograph lies {abs(lower)} px"
            f" {'lower' if lower > 0 else 'higher'}",
        )


_ANY_OFFSET = 1e9  # depth is not asked for here


def _turned(pair: StereoPair) -> StereoPair:
    return replace(pair, mirrored=not pair.mirrored)


def _agreeing(pair: StereoPair, rows: NDArray[np.intp], lower: int = 0) -> float | None:
    """Share of textured left pixels that the right photograph shows, of those that it can."""
    assert pair.right is not None
    height, width = pair.disparity_px.shape
    rows = rows[(rows + lower >= 0) & (rows + lower < height)]
    left = pair.left[rows].mean(axis=-1, dtype=np.float64)
    right = pair.right[rows + lower].mean(axis=-1, dtype=np.float64)
    disparity = pair.disparity_px[rows].astype(np.float64)
    place = np.arange(width) + (disparity if pair.mirrored else -disparity)
    seen = pair.known[rows] & (place >= 0) & (place <= width - 1)
    seen &= _in_front(np.rint(place).astype(np.intp).clip(0, width - 1), disparity, seen)
    textured = pair.known[rows] & (_contrast(left) > _TEXTURE)
    if textured.sum() < _FEWEST:
        return None
    asked = seen & textured
    if asked.sum() < _FEWEST / 10:  # the disparity leads out of the picture
        return 0.0
    first = np.floor(place).astype(np.intp).clip(0, width - 2)
    part = place - first
    line = np.arange(len(rows))[:, None]
    shown = (1 - part) * right[line, first] + part * right[line, first + 1]
    # Two cameras may expose differently.
    gain = shown[seen].std() / max(float(left[seen].std()), 1e-6)
    expected = shown[seen].mean() + gain * (left - left[seen].mean())
    return float((np.abs(shown - expected)[asked] <= _TOLERANCE).mean())


def _in_front(
    column: NDArray[np.intp], disparity: NDArray[np.float64], seen: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """True where no nearer pixel of the row lands in the same column, shape (rows, width)."""
    line = np.broadcast_to(np.arange(len(column))[:, None], column.shape)
    nearest = np.full(column.shape, -np.inf)
    np.maximum.at(nearest, (line[seen], column[seen]), disparity[seen])
    return np.asarray(disparity >= nearest[line, column] - 1)


def _contrast(grey: NDArray[np.float64]) -> NDArray[np.float64]:
    """Range of the five pixels around each, along its row; 0 at the ends."""
    result = np.zeros_like(grey)
    if grey.shape[1] >= 5:
        result[:, 2:-2] = np.ptp(np.lib.stride_tricks.sliding_window_view(grey, 5, axis=1), axis=-1)
    return result
