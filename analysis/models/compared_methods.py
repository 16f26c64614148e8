"""Decisions that compare two methods, and choices of one by participant and scene."""

import numpy as np
import pandas as pd

from analysis.arrays import Floats, Ints

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


class Comparisons:
    """Decisions grouped by pairing and size, once: each comparison's rows are at hand.

    Attributes
    ----------
    decisions : DataFrame
        With names as categories (`as_numbers`).
    sizes : tuple of str
    """

    def __init__(self, decisions: pd.DataFrame) -> None:
        self.decisions = rows = as_numbers(decisions)
        first, second = (rows[side].cat.codes.to_numpy(np.int64) for side in ("first", "second"))
        self._place = {name: code for code, name in enumerate(rows["first"].cat.categories)}
        size, self.sizes = numbered_names(rows["size"])
        self._sizes = {name: code for code, name in enumerate(self.sizes)}
        pair = np.minimum(first, second) * len(self._place) + np.maximum(first, second)
        self._by_pair = _positions(pair)
        self._by_cell = _positions(pair * len(self.sizes) + size)

    def rows(self, method: str, against: str, size: str = ALL_SIZES) -> pd.DataFrame:
        """Return the decisions between two methods, at one size or at all, as `pairing_rows`."""
        pair = [self._place.get(name, -1) for name in (method, against)]
        code = min(pair) * len(self._place) + max(pair)
        nothing = np.zeros(0, dtype=np.int64)
        if min(pair) < 0:
            found = nothing
        elif size == ALL_SIZES:
            found = self._by_pair.get(code, nothing)
        else:
            cell = code * len(self.sizes) + self._sizes.get(size, -1)
            found = self._by_cell.get(cell, nothing) if size in self._sizes else nothing
        return self.decisions.take(found)


def _positions(codes: Ints) -> dict[int, Ints]:
    """Return the indices at which each code occurs, in order."""
    order = np.argsort(codes, kind="stable")
    found, start = np.unique(codes[order], return_index=True)
    return dict(zip(found.tolist(), np.split(order, start[1:]), strict=True))


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
    person, people = numbered_names(decisions["participant"])
    scene, scenes = numbered_names(decisions["scene"])
    place, shape = person * len(scenes) + scene, (len(people), len(scenes))
    shown = np.bincount(place, minlength=shape[0] * shape[1]).astype(np.float64)
    chosen = np.bincount(place, weights=picked, minlength=shown.size).astype(np.float64)
    return chosen.reshape(shape), shown.reshape(shape), people, scenes


def numbered_names(column: pd.Series) -> tuple[Ints, tuple[str, ...]]:
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

    The columns of methods share their categories. A table that has them already is returned.
    """
    named = [decisions[name].dtype for name in ("participant", "scene", "size")]
    shared = {decisions[name].dtype for name in METHOD_COLUMNS if name in decisions.columns}
    if len(shared) == 1 and all(
        isinstance(kind, pd.CategoricalDtype) for kind in (*named, *shared)
    ):
        return decisions
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
