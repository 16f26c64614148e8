"""Measurements of a family of metrics on one clip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

RatioCurve = tuple[tuple[float, float], ...]
"""Points (x, y) of a line."""


@dataclass(frozen=True)
class PairScores:
    """Numbers by (metric, region), and where the errors are.

    Attributes
    ----------
    values : mapping
        One number for the whole clip; None where there is nothing to measure (no hole, or a
        flat reference).
    per_frame : mapping
        One number per frame, for metrics that are made of these.
    error_map : ndarray of float32, shape (H, W), or None
        Error of every pixel, averaged over the frames in which it counts.
    curves : mapping
        What one number cannot say: a line per name, such as a ratio by eccentricity.
    """

    values: Mapping[tuple[str, str], float | None]
    per_frame: Mapping[tuple[str, str], list[float | None]] = field(default_factory=dict)
    error_map: NDArray[np.float32] | None = None
    curves: Mapping[str, RatioCurve] = field(default_factory=dict)


def mean_of(values: list[float | None]) -> float | None:
    """Average what is there; None where nothing is."""
    there = [value for value in values if value is not None]
    return float(np.mean(there)) if there else None
