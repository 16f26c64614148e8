"""Plausible numbers: the one table of ranges, and single numbers a thousand times off.

A range is far from what people, displays and trackers do, so that a number outside it is mostly one
in another unit. Each number is looked at, not only a median.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from protocols.units import CONVERSIONS, UNIT_OF_SUFFIX

RANGES: Final = {
    "rt_s": (0.001, 600.0),
    "median_rt_s": (0.05, 60.0),
    "deg": (-360.0, 360.0),
    "share": (0.0, 1.0),
    "tracker_hz": (3.0, 20_000.0),
    "distance_mm": (250.0, 5000.0),
    "pitch_mm": (0.04, 1.5),
    "refresh_hz": (20.0, 1000.0),
    "baseline_m": (0.0, 2.0),
    "view_deg": (np.pi, 170.0),
    "window_deg": (0.2, 45.0),
    "px_per_deg": (0.0, 300.0),
}
"""Least and most of a quantity, by its name and unit. A tracker's 2000 Hz are 2 Hz, and 30 Hz are
30 kHz, where stamps in seconds and in milliseconds are taken for each other. A view in radians is
below pi, which in degrees takes a lens of 650 mm before a full frame; a focal length in shares of
the picture or in mm gives nearly 180 degrees. A tracker errs by more than 0.2 degrees. An eye
resolves 120 px a degree; an 8K monitor at 1 m has 190."""
FACTORS: Final = (1e3, 1e6)
"""Factors between units of one quantity, such as s, ms and us."""
SINGLE: Final = 0.1
MIXED: Final = 0.5
"""Largest shares of a column: of single numbers in a design, and of times in another unit."""
_FEWEST: Final = 12
_TAIL: Final = 10
_CHANCE: Final = 3e-4
_BELOW: Final = float(np.log(1.5))
_ABOVE: Final = float(np.log(10.0))
_GROUPED: Final = re.compile(r"[-+]?[1-9]\d{0,2}(\.\d{3})+")
_BARE: Final = re.compile(r"[-+]?\d{1,3}")


def hardly_meant(quantity: str, value: float, *, per: float = 1.0) -> str:
    """Return the question on a number whose `per`-th part is outside its range; empty: it is not.

    It names the number that is meant, if the one given fits in another unit.
    """
    least, most = RANGES[quantity]
    if least <= value / per <= most:
        return ""
    unit = quantity.rpartition("_")[2]
    factors = [factor for (_, known), factor in CONVERSIONS.items() if known == unit]
    for factor in (*factors, *(1 / factor for factor in factors)):
        if least <= factor * value / per <= most:
            return f"; {UNIT_OF_SUFFIX[unit]} are meant: should it be {factor * value:.4g}?"
    return f"; {UNIT_OF_SUFFIX[unit]} are meant"


def shifted(values: NDArray[np.float64], most: float = SINGLE) -> tuple[NDArray[np.bool_], float]:
    """Find the numbers that are a thousand or a million times too large or too small.

    Some numbers are, if (1) brought back by the factor they lie among the others, large ones at
    most 1.5 times below, small ones ten times above; (2) they lie farther from each of the others
    than half of the factor's logarithm, so nearer to where they belong than to where they are; and
    (3) the others' own tail does not reach there. Its logarithms are taken for exponential (a power
    law: a log-normal falls faster). The chance that one of the k in the outer tenth, of mean
    excess h, is d above the tenth's edge is then k (1 + d / kh)^-k, for h is only estimated; it
    must be below 3 in 10,000.

    Parameters
    ----------
    values : ndarray of float64, shape (n,)
        Numbers; nan: none.
    most : float
        Largest share of the numbers that may be off.

    Returns
    -------
    off : ndarray of bool, shape (n,)
    factor : float
        They should be multiplied by; 1 where none is off.
    """
    off = np.zeros(values.shape, np.bool_)
    places = np.flatnonzero(np.isfinite(values) & (values != 0))
    if places.size < _FEWEST:
        return off, 1.0
    for sign in (1.0, -1.0):
        logs = sign * np.log(np.abs(values[places]))
        order = np.argsort(logs, kind="stable")
        ranked = logs[order]
        apart = np.flatnonzero(np.diff(ranked) > np.log(FACTORS[0]) / 2) + 1
        for first in apart[apart >= ranked.size * (1 - most)]:
            others, far = ranked[:first], ranked[first:]
            tail = others[-max(_TAIL, others.size // 10) :]
            excess, k = float(np.mean(tail - tail[0])), tail.size
            beyond = far[0] - tail[0]
            if excess > 0 and k * (1 + beyond / (k * excess)) ** -k > _CHANCE:
                continue
            least = others[0] - (_BELOW if sign > 0 else _ABOVE)
            for factor in map(float, np.log(FACTORS)):
                within = least <= far[0] - factor and far[-1] - factor <= others[-1] + 1e-9
                if within and far[0] - others[-1] > factor / 2:
                    off[places[order[first:]]] = True
                    return off, round(float(np.exp(-sign * factor)), 9)
    return off, 1.0


def point_between_thousands(texts: Sequence[str]) -> int | None:
    """Return the place of the first point between thousands, as in ``1.043`` beside ``350``.

    There is one, if every number with a point has three digits behind it and no 0 alone before it,
    every other has at most three digits, and read as thousands they span less, as logarithms, than
    as they are; or if one ends in 0, which programs that write ``350`` leave away.
    """
    split = [place for place, text in enumerate(texts) if _GROUPED.fullmatch(text)]
    bare = [text for text in texts if _BARE.fullmatch(text)]
    if not split or not bare or len(split) + len(bare) < len(texts):
        return None
    size = np.abs([float(text) for text in bare])
    beside = size[size > 0]
    if not beside.size:
        return None
    as_is = np.abs([float(texts[place]) for place in split])
    spans = [
        float(np.ptp(np.log(np.concatenate([beside, factor * as_is])))) for factor in (1.0, 1e3)
    ]
    rounded = any(texts[place].endswith("0") for place in split)
    return split[0] if rounded or spans[1] < spans[0] else None
