"""Simulated answers of many studies at once, counted by cell."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from analysis.arrays import Bools, Floats, Ints


@dataclass(frozen=True)
class SimulatedAnswers:
    """Answers of simulated participants.

    Attributes
    ----------
    given : ndarray (repeats, studies, participants, cells)
        Of each trial: whether the event happened that the kind of analysis counts, the step of a
        scale, or an estimate.
    cells : DataFrame
        A row per cell: its ``scene``, and all else that a trial of it shows.
    times : ndarray, optional
        Logarithms of reaction times, s, as `given`; None: they are not drawn.
    """

    given: NDArray[np.generic]
    cells: pd.DataFrame
    times: Floats | None = None

    @cached_property
    def counts(self) -> Floats:
        """Sums over repeats (studies, participants, cells)."""
        return np.asarray(self.given.sum(axis=0, dtype=np.float64))

    def grid(self, chosen: Bools, *, by_scene: bool) -> tuple[Floats, Floats]:
        """Return sums (studies, participants, scenes) over chosen cells, and trials (scenes,).

        All scenes are one unless `by_scene`.
        """
        scene = pd.factorize(self.cells["scene"])[0] * by_scene
        where = np.zeros((scene.size, int(scene.max()) + 1))
        where[np.arange(scene.size), scene] = chosen
        return self.counts @ where, len(self.given) * where.sum(axis=0)

    def of(self, study: int, people: int) -> "SimulatedAnswers":
        """Return the first people of one study."""
        chosen = np.s_[:, study : study + 1, :people]
        times = None if self.times is None else self.times[chosen]
        return replace(self, given=self.given[chosen], times=times)

    def rows(self) -> tuple[pd.DataFrame, NDArray[np.generic]]:
        """Return a row per trial of the first study, and what was answered.

        Columns are those of the cells and of decisions: participant, session, trial, order; and
        rt_s where times were drawn.
        """
        repeats, _, people, cells = self.given.shape
        cell = np.repeat(np.arange(cells), repeats)
        rows = self.cells.iloc[np.tile(cell, people)].reset_index(drop=True)
        names = [f"P{number + 1:03d}" for number in range(people)]
        order = np.tile(np.arange(1, cell.size + 1), people)
        rows = rows.assign(
            participant=np.repeat(names, cell.size),
            session=np.repeat(names, cell.size),
            trial=[f"trial-{number}" for number in order],
            kind="main",
            order=order,
            simulated=1,
            included=1,
            exclusion="",
        )
        if self.times is not None:
            rows["rt_s"] = np.exp(_by_row(self.times))
        return rows, _by_row(self.given)


def _by_row(values: NDArray[np.generic]) -> NDArray[np.generic]:
    return np.asarray(values[:, 0].transpose(1, 2, 0).ravel())


def crossed_effects(
    rng: np.random.Generator,
    units: tuple[int, int],
    whole: Sequence[int] | Ints,
    own: Ints,
    common: float,
) -> NDArray[np.float32]:
    """Draw standard normal effects (*units, cells), such as of participants or of scenes.

    Cells of one number in `whole` share an effect, and those of one number in `own` another,
    which is its deviation from there; `common` is the share of variance of the first.
    """
    found = np.zeros((*units, own.size), dtype=np.float32)
    for codes, share in ((np.asarray(whole), common), (own, 1.0 - common)):
        if share > 0.0:
            drawn = rng.standard_normal((*units, int(codes.max()) + 1), dtype=np.float32)
            found += np.float32(np.sqrt(share)) * drawn[..., codes]
    return found


def codes_of(*columns: ArrayLike) -> Ints:
    """Return the number of each row's combination of values."""
    codes = np.zeros(np.asarray(columns[0]).size, dtype=np.int64)
    for column in columns:
        own = pd.factorize(np.asarray(column))[0]
        codes = np.unique(codes * (int(own.max()) + 1) + own, return_inverse=True)[1].ravel()
    return codes
