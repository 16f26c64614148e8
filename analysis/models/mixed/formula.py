"""Wilkinson formulas as papers print them: what a model's design is, and what is wrong with it."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import pandas as pd

from analysis.arrays import Floats, Ints

TILDE_OPERATOR = "\N{TILDE OPERATOR}"  # what papers print for ~

ILL_SCALED = 1e3
"""So many times larger or smaller than 1 a covariate is standardised before it is fitted."""

ALIASED = 1e-6
"""Part of a unit vector that leaves the design as it is: a term with less is not in it."""

_SUM = re.compile(r"\s*1((?:\s*\+\s*[A-Za-z_]\w*)*)\s*")
_LOGIT_LEFT = re.compile(r"^\s*logit\(\s*([^()]+?)\s*\)\s*~")


@dataclass(frozen=True)
class FormulaDesign:
    """Design of a formula on a table of trials.

    Attributes
    ----------
    design : ndarray (trials, terms)
    y : ndarray (trials,)
        Answers, 0 or 1.
    scaled, back
        As of `well_scaled`.
    hidden : tuple of str
        Terms that cannot be told apart (`aliased`).
    """

    formula: str
    design: Floats
    y: Floats
    terms: Sequence[str]
    scaled: Floats
    back: Floats
    hidden: tuple[str, ...]

    @classmethod
    def of(cls, formula: str, trials: pd.DataFrame, reference: Mapping[str, str] | None) -> Self:
        """Return the design of a formula.

        Parameters
        ----------
        formula : str
            As papers print it; ``logit(column)`` on the left is the column.
        reference : mapping, optional
            Column to the level that the others are compared with.

        Raises
        ------
        ValueError
            If the formula does not fit the table.
        """
        design, y, terms = _matrices(formula, trials, reference)
        scaled, back = well_scaled(design)
        return cls(formula, design, y, terms, scaled, back, aliased(scaled, back, terms))

    @property
    def notes(self) -> list[str]:
        """Reasons not to trust the terms."""
        told = f"{', '.join(self.hidden)} cannot be told apart, and have no numbers"
        return [told] if self.hidden else []


def _matrices(
    formula: str, trials: pd.DataFrame, reference: Mapping[str, str] | None
) -> tuple[Floats, Floats, list[str]]:
    plain = _LOGIT_LEFT.sub(r"\1 ~", formula.replace(TILDE_OPERATOR, "~"))
    left = plain.split("~", maxsplit=1)[0].strip()
    if "~" not in plain or left not in trials.columns:
        raise ValueError(
            f"formula must have a column on its left side, such as 'logit(correct) ~ 1 + method'"
            f" (got {formula!r}; columns: {list(trials.columns)})"
        )
    y = pd.to_numeric(trials[left], errors="coerce").to_numpy(dtype=np.float64)
    if not np.all(np.isin(y, (0.0, 1.0))):
        raise ValueError(f"column {left!r} must hold 0 and 1 only, in every row")
    columns = _columns(plain.split("~", maxsplit=1)[1], trials)
    if columns is not None:
        parts = [np.ones(len(trials)), *(trials[name].to_numpy(np.float64) for name in columns)]
        return np.column_stack(parts), y, ["Intercept", *columns]
    table = trials.assign(**{left: y})
    for column, first in (reference or {}).items():
        levels = sorted(map(str, table[column].unique()))
        if first not in levels:
            raise ValueError(f"reference of {column!r} must be one of {levels} (got {first!r})")
        levels.remove(first)
        table[column] = pd.Categorical(table[column].astype(str), [first, *levels])
    # Imported here: most formulas are sums of columns, and this takes half a second.
    from statsmodels.genmod.families import Binomial
    from statsmodels.genmod.generalized_linear_model import GLM

    model = GLM.from_formula(plain, table, family=Binomial())
    design = np.asarray(model.exog, dtype=np.float64)
    if design.shape[0] != len(table):
        raise ValueError("formula columns must have no missing values")
    return design, y, list(model.exog_names)


def _columns(right: str, trials: pd.DataFrame) -> list[str] | None:
    """Return the columns of ``1 + a + b`` where all hold numbers: no formula is quicker."""
    found = _SUM.fullmatch(right)
    if found is None:
        return None
    names = re.findall(r"\w+", found[1])
    plain = len(set(names)) == len(names) and all(
        name in trials.columns
        and trials[name].dtype.kind in "iuf"
        and bool(np.isfinite(trials[name].to_numpy(np.float64)).all())
        for name in names
    )
    return names if plain else None


def aliased(design: Floats, back: Floats, terms: Sequence[str]) -> tuple[str, ...]:
    """Return the terms that cannot be told apart: the design holds some in two ways.

    `back` as of `well_scaled`.
    """
    axes = np.linalg.eigh(design.T @ design)[1]
    flat = axes[:, : len(terms) - int(np.linalg.matrix_rank(design))]  # eigh sorts from the least
    involved = np.abs(back @ flat).max(axis=1, initial=0.0) > ALIASED
    return tuple(term for term, some in zip(terms, involved, strict=True) if some)


def well_scaled(design: Floats) -> tuple[Floats, Floats]:
    """Return a design that arithmetic can take, and how its coefficients become the given ones.

    Columns whose deviation or distance from 0 is a thousandfold too large or small are
    standardised (shifted only beside an intercept). If b belongs to what is returned, the second
    result times b belongs to `design`, and its covariance likewise.
    """
    centre, spread = design.mean(axis=0), design.std(axis=0)
    back = np.eye(design.shape[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        ill = (spread > ILL_SCALED) | (spread < 1.0 / ILL_SCALED)
        ill = (spread > 0) & (ill | (np.abs(centre) > ILL_SCALED * spread))
    if not ill.any():
        return design, back
    intercept = np.flatnonzero((spread == 0) & (centre == 1.0))
    scaled = design.copy()
    for column in np.flatnonzero(ill):
        back[column, column] = 1.0 / spread[column]
        shift = 0.0
        if intercept.size:
            shift = centre[column]
            back[intercept[0], column] = -shift / spread[column]
        scaled[:, column] = (design[:, column] - shift) / spread[column]
    return scaled, back


def group_codes(trials: pd.DataFrame, column: str) -> Ints:
    """Return the number of each trial's group (trials,): 0, 1, ... in the order of the names."""
    if column not in trials.columns:
        raise ValueError(f"{column!r} must be a column (columns: {list(trials.columns)})")
    empty = trials[column].isna().to_numpy()
    if empty.any():
        raise ValueError(
            f"column {column!r} must name a group in every row"
            f" (row {int(np.argmax(empty)) + 1} has none)"
        )
    codes, _ = pd.factorize(trials[column], sort=True)
    return np.asarray(codes, dtype=np.int64)
