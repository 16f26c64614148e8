"""Which decisions compare two methods, and how often each participant chose one in each scene."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ALL_SIZES = "all"
"""Sizes taken together."""

METHOD_COLUMNS = ("first", "second", "chosen", "rejected")


def pairing_rows(
    decisions: pd.DataFrame, method: str, against: str, size: str = ALL_SIZES
) -> pd.DataFrame:
    """Return the decisions between two methods, at one size or at all."""
    first, second = decisions["first"], decisions["second"]
    pair = ((first == method) & (second == against)) | ((first == against) & (second == method))
    return decisions[pair if size == ALL_SIZES else pair & (decisions["size"] == size)]


def counts(
    decisions: pd.DataFrame, method: str
) -> tuple[Floats, Floats, tuple[str, ...], tuple[str, ...]]:
    """Count choices of `method` and trials per participant and scene.

    Returns
    -------
    chosen, shown : ndarray (participants, scenes)
    participants, scenes : tuple of str
    """
    return cell_counts(decisions, np.asarray(decisions["chosen"] == method, dtype=np.float64))


def cell_counts(
    decisions: pd.DataFrame, picked: Floats
) -> tuple[Floats, Floats, tuple[str, ...], tuple[str, ...]]:
    """Sum `picked` (decisions,) per participant and scene, and count decisions; as `counts`."""
    person, people = numbered(decisions["participant"])
    scene, scenes = numbered(decisions["scene"])
    place, shape = person * len(scenes) + scene, (len(people), len(scenes))
    shown = np.bincount(place, minlength=shape[0] * shape[1]).astype(np.float64)
    chosen = np.bincount(place, weights=picked, minlength=shown.size).astype(np.float64)
    return chosen.reshape(shape), shown.reshape(shape), people, scenes


def numbered(column: pd.Series) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Return the number of each row's name, and the names that occur, in sorted order."""
    if isinstance(column.dtype, pd.CategoricalDtype):
        codes, names = column.cat.codes.to_numpy(dtype=np.int64), column.cat.categories
        there = np.flatnonzero(np.bincount(codes, minlength=len(names)))
        place = np.zeros(len(names), dtype=np.int64)
        place[there] = np.arange(there.size)
        return place[codes], tuple(map(str, names[there]))
    codes, names = pd.factorize(column.astype(str), sort=True)
    return codes.astype(np.int64), tuple(map(str, names))


def as_numbers(decisions: pd.DataFrame) -> pd.DataFrame:
    """Return the table with its names as categories in sorted order: grouped once, and for all.

    The columns of methods share their categories.
    """
    methods = pd.unique(pd.concat([decisions["first"], decisions["second"]]).astype(str))
    kinds = {name: pd.CategoricalDtype(sorted(methods)) for name in METHOD_COLUMNS}
    for name in ("participant", "scene", "size"):
        kinds[name] = pd.CategoricalDtype(sorted(pd.unique(decisions[name].astype(str))))
    text = {name: decisions[name].astype(str) for name in kinds if name in decisions.columns}
    return decisions.assign(**{name: text[name].astype(kinds[name]) for name in text})


def found_pairings(decisions: pd.DataFrame) -> tuple[tuple[str, str], ...]:
    """Return the pairs of methods that decisions compare, sorted."""
    different = decisions[["first", "second"]].astype(str).drop_duplicates()
    pairs = {(min(a, b), max(a, b)) for a, b in different.to_numpy() if a != b}
    return tuple(sorted(pairs))
