"""Goodness of fit of psychometric functions: what studies of the model itself look like."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.special import xlogy

from analysis.arrays import Floats, Ints
from analysis.models.clustered import holm
from analysis.models.contrasts import IN_CONDITION
from analysis.models.curves.population import Population

STUDIES = 199, 999
"""Fewest and most that are simulated."""
MOST_COUNTS = 3_000_000
"""Simulated in all: of a large table fewer studies are."""
MOST_LEVELS = 10
"""Levels looked at by themselves: of more, neighbours are looked at together."""
STEPS = 15
LONGEST_STEP = 1.5


@dataclass(frozen=True)
class Misfit:
    """Misfit of one condition's answers: their distance from the fitted curves.

    Attributes
    ----------
    deviance, expected : float
        Of the counts of each participant at each level, from that participant's curve; its mean
        in studies that the model itself simulates.
    p, p_adjusted : float
        Share of these studies whose deviance is as large; Holm's over conditions.
    cells : int
        How many counts there are.
    levels : tuple of float
        Shown, or means of groups of neighbours.
    residuals, lower, upper : tuple of float
        Share of right answers at each level minus the one that the curves expect; between which
        95 % of the simulated ones lie.
    level_p, level_p_adjusted : float
        Share of simulated studies whose largest residual, in its deviations, is as large; Holm's.
    """

    condition: str
    deviance: float
    expected: float
    p: float
    cells: int
    levels: tuple[float, ...]
    residuals: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    level_p: float
    p_adjusted: float = np.nan
    level_p_adjusted: float = np.nan


def misfits(
    trials: pd.DataFrame,
    level_column: str,
    conditions: pd.Series,
    population: Population,
    rng: np.random.Generator,
) -> tuple[tuple[Misfit, ...], Floats]:
    """Compare answers with studies that the fitted model simulates.

    Parameters
    ----------
    trials : DataFrame, one row per decided trial
        ``participant``, `level_column`, ``correct``, and ``scene`` where the model has scenes.
    conditions : Series (trials,)
        Names of the model's conditions.

    Returns
    -------
    misfits : tuple of Misfit
        Of each condition.
    predicted : ndarray (trials,)
        Chance of a right answer of each trial by its participant's curve.

    Notes
    -----
    A parametric bootstrap: deviations and lapse rates of people (and scenes), and their answers to
    the same levels, are drawn from the model. Each participant's shift is fitted anew, as it is to
    the data. What all people share is not, so that p is a little too large. Levels that were
    chosen from the answers are taken as given.
    """
    counts = _Counts.of(trials, level_column, conditions, population)
    right = counts.in_cells(counts.in_rows(trials["correct"].to_numpy(np.float64))[None])
    predicted = counts.predicted(right)
    drawn = counts.simulated(studies_of(counts.eta.size), rng)
    expected = counts.predicted(drawn)
    found = []
    for k, name in enumerate(population.names):
        own = counts.condition[counts.row_of_cell] == k
        levels, shown = counts.level[counts.row_of_cell][own], counts.shown_in_cells[own]
        told = [one[:, own] for one in (right, predicted, drawn, expected)]
        found.append(misfit_of(name, levels, shown, *told))
    return adjusted_misfits(found), predicted[0][counts.cell][counts.row]


def studies_of(counts: int) -> int:
    """Return the number of studies, of so many counts each, that are simulated."""
    return int(np.clip(MOST_COUNTS // counts, *STUDIES))


def misfit_of(
    name: str,
    levels: Floats,
    shown: Floats,
    right: Floats,
    predicted: Floats,
    drawn: Floats,
    expected: Floats,
) -> Misfit:
    """Judge counts (1, cells) by simulated ones (studies, cells), each with its curves' shares."""
    place, middles = _neighbours(levels)
    deviance, deviances = _deviances(right, predicted, shown), _deviances(drawn, expected, shown)
    residual, residuals = (
        _residuals(*one, shown, place) for one in ((right, predicted), (drawn, expected))
    )
    centre, sd = residuals.mean(axis=0), residuals.std(axis=0).clip(min=1e-12)
    largest, largests = (np.abs((one - centre) / sd).max(axis=1) for one in (residual, residuals))
    lower, upper = np.quantile(residuals, (0.025, 0.975), axis=0)
    return Misfit(
        condition=name,
        deviance=float(deviance[0]),
        expected=float(deviances.mean()),
        p=_as_large(deviances, deviance),
        cells=shown.size,
        levels=tuple(middles.tolist()),
        residuals=tuple(residual[0].tolist()),
        lower=tuple(lower.tolist()),
        upper=tuple(upper.tolist()),
        level_p=_as_large(largests, largest),
    )


def adjusted_misfits(found: Sequence[Misfit]) -> tuple[Misfit, ...]:
    """Return misfits of all conditions with Holm's p."""
    p = holm(np.array([[one.p for one in found], [one.level_p for one in found]]))
    return tuple(
        replace(one, p_adjusted=float(whole), level_p_adjusted=float(by_level))
        for one, whole, by_level in zip(found, *p, strict=True)
    )


@dataclass(frozen=True)
class _Counts:
    """Trials counted by participant, condition, level and scene (rows), and without scene (cells).

    A unit is a participant in a condition. Rows, cells and units are sorted in this order.
    """

    population: Population
    row: Ints
    """Row of each trial."""
    cell: Ints
    """Cell of each row; what follows is of each row, too."""
    eta: Floats
    level: Floats
    shown: Floats
    person: Ints
    scene: Ints
    condition: Ints
    row_of_cell: Ints
    unit_of_cell: Ints

    @classmethod
    def of(
        cls, trials: pd.DataFrame, column: str, conditions: pd.Series, population: Population
    ) -> "_Counts":
        names = {name: k for k, name in enumerate(population.names)}
        scene = trials["scene"] if "scene" in population.sd else trials["participant"].map("".join)
        what = conditions.map(names).to_numpy(np.int64)
        person = np.unique(trials["participant"].astype(str), return_inverse=True)[1]
        level = pd.to_numeric(trials[column]).to_numpy(np.float64)
        place = np.unique(scene.astype(str), return_inverse=True)[1]
        rows, row = np.unique(
            np.column_stack([person.ravel(), what, level, place.ravel()]),
            axis=0,
            return_inverse=True,
        )
        cell = _numbered(rows[:, :3])
        first = np.unique(cell, return_index=True)[1]
        eta = np.zeros(len(rows))
        for name, k in names.items():
            own = rows[:, 1] == k
            eta[own] = population.eta(name, rows[own, 2])
        return cls(
            population=population,
            row=row.ravel(),
            cell=cell,
            eta=eta,
            level=rows[:, 2],
            shown=np.bincount(row.ravel()).astype(np.float64),
            person=rows[:, 0].astype(np.int64),
            scene=rows[:, 3].astype(np.int64),
            condition=rows[:, 1].astype(np.int64),
            row_of_cell=first,
            unit_of_cell=_numbered(rows[first, :2]),
        )

    @property
    def shown_in_cells(self) -> Floats:
        (cells,) = self.in_cells(self.shown[None])
        return np.asarray(cells)

    def in_rows(self, values: Floats) -> Floats:
        """Sum values (trials,)."""
        return np.asarray(np.bincount(self.row, weights=values), dtype=np.float64)

    def in_cells(self, values: Floats) -> Floats:
        """Sum values (studies, rows)."""
        return np.asarray(np.add.reduceat(values, self.row_of_cell, axis=1))

    def simulated(self, studies: int, rng: np.random.Generator) -> Floats:
        """Return right answers of studies of the model (studies, cells)."""
        eta = np.tile(self.eta, (studies, 1))
        for kind, sd in self.population.sd.items():
            code = self.person if kind.startswith("participant") else self.scene
            if kind.endswith(IN_CONDITION):
                code = _numbered(np.column_stack([code, self.condition]), ordered=False)
            eta += sd * rng.standard_normal((studies, int(code.max()) + 1))[:, code]
        guess = self.population.rates()[0]
        lapses = self.population.drawn_lapses((studies, int(self.person.max()) + 1), rng)
        share = self.population.response.share(eta, (guess, lapses[:, self.person]))
        drawn = rng.binomial(self.shown.astype(np.int64), share)
        return self.in_cells(drawn.astype(np.float64))

    def predicted(self, right: Floats) -> Floats:
        """Return the shares that participants' curves expect (studies, cells).

        The shift of each curve is the most likely one, given the participant's answers in a
        condition and how far people differ.
        """
        response, rates = self.population.response, self.population.rates()
        eta, shown = self.eta[self.row_of_cell], self.shown_in_cells
        first = np.unique(self.unit_of_cell, return_index=True)[1]
        sd = [sd for kind, sd in self.population.sd.items() if kind.startswith("participant")]
        precision = 1.0 / max(float(np.sum(np.square(sd))), 1e-6)
        own = np.zeros((len(right), first.size))
        for _ in range(STEPS):
            at = eta + own[:, self.unit_of_cell]
            slope, _, weight = response.slope(at, right, shown, rates)
            pull, known = (np.add.reduceat(one, first, axis=1) for one in (slope, weight))
            step = (pull - precision * own) / (known + precision)
            own += np.clip(step, -LONGEST_STEP, LONGEST_STEP)
            if float(np.abs(step).max()) < 1e-4:
                break
        share = response.share(eta + own[:, self.unit_of_cell], rates)
        return np.asarray(np.clip(share, 1e-9, 1.0 - 1e-9))


def _numbered(keys: Floats | Ints, *, ordered: bool = True) -> Ints:
    """Return numbers from 0 of rows that are alike; `ordered`: equal ones are neighbours."""
    if ordered:
        new = np.any(np.diff(keys, axis=0) != 0, axis=1)
        return np.concatenate([[0], np.cumsum(new)]).astype(np.int64)
    return np.unique(keys, axis=0, return_inverse=True)[1].ravel().astype(np.int64)


def _neighbours(levels: Floats) -> tuple[Ints, Floats]:
    """Return the group of each cell, and the groups' mean levels."""
    place = np.unique(levels, return_inverse=True)[1].ravel()
    count = int(place.max()) + 1
    if count > MOST_LEVELS:
        rank = np.argsort(np.argsort(levels, kind="stable"), kind="stable")
        shares = np.maximum.accumulate(
            np.array([rank[place == k].mean() for k in range(count)]) / levels.size
        )
        place = _numbered((shares * MOST_LEVELS).astype(np.int64)[:, None])[place]
    size = np.bincount(place)
    return place.astype(np.int64), np.bincount(place, weights=levels) / size


def _deviances(right: Floats, share: Floats, shown: Floats) -> Floats:
    """Return deviances (studies,) of right answers (studies, cells) from shares."""
    wrong = shown - right
    cells = xlogy(right, right / (shown * share)) + xlogy(wrong, wrong / (shown * (1.0 - share)))
    return np.asarray(2.0 * cells.sum(axis=1))


def _residuals(right: Floats, share: Floats, shown: Floats, place: Ints) -> Floats:
    """Return residuals of shares at each level (studies, levels)."""
    at = (place[:, None] == np.arange(int(place.max()) + 1)).astype(np.float64)
    return np.asarray((right - shown * share) @ at / (shown @ at))


def _as_large(simulated: Floats, found: Floats) -> float:
    return float((1 + np.sum(simulated >= found[0] - 1e-9)) / (1 + simulated.size))
