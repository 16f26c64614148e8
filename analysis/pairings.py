"""Which decisions compare two methods, and how often each participant chose one in each scene."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ALL_SIZES = "all"
"""Sizes taken together."""


def pairing_rows(
    decisions: pd.DataFrame, method: str, against: str, size: str = ALL_SIZES
) -> pd.DataFrame:
    """Return the decisions between two methods, at one size or at all."""
    pair = decisions["first"].isin((method, against)) & decisions["second"].isin((method, against))
    rows = decisions[pair & (decisions["first"] != decisions["second"])]
    return rows if size == ALL_SIZES else rows[rows["size"] == size]


def counts(
    decisions: pd.DataFrame, method: str
) -> tuple[Floats, Floats, tuple[str, ...], tuple[str, ...]]:
    """Count choices of `method` and trials per participant and scene.

    Returns
    -------
    chosen, shown : ndarray (participants, scenes)
    participants, scenes : tuple of str
    """
    people, person = np.unique(decisions["participant"].astype(str), return_inverse=True)
    scenes, scene = np.unique(decisions["scene"].astype(str), return_inverse=True)
    shown = np.zeros((people.size, scenes.size))
    chosen = np.zeros_like(shown)
    np.add.at(shown, (person, scene), 1.0)
    np.add.at(chosen, (person, scene), (decisions["chosen"] == method).to_numpy(dtype=np.float64))
    return chosen, shown, tuple(map(str, people)), tuple(map(str, scenes))


def found_pairings(decisions: pd.DataFrame) -> tuple[tuple[str, str], ...]:
    """Return the pairs of methods that decisions compare, sorted."""
    pairs = {
        (min(a, b), max(a, b))
        for a, b in zip(
            decisions["first"].astype(str), decisions["second"].astype(str), strict=True
        )
        if a != b
    }
    return tuple(sorted(pairs))
