"""Recovery of thresholds and scores by adaptive trials, of simulated observers.

They answer by the same uniform numbers whoever chooses the level. What maintained packages found
with these numbers (questplus, SweetSpot, psychopy, and `asap_cpu` of ASAP's authors) is recorded in
`benchmarks/results/adaptive.json`.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import entr, ndtri
from up_down_rules import performance, transformed, weighted

from protocols.adaptive.answer_history import History
from protocols.adaptive.psychometric_function import probability, slope_of
from protocols.adaptive.quest_plus import PARAMETERS, Grid, posterior
from protocols.adaptive.up_down import UpDown, track
from protocols.errors import StudyError

Floats = NDArray[np.float64]

LEVELS = tuple(float(level) for level in np.arange(0.0, 20.25, 0.5))
THRESHOLDS = (6.13, 8.21, 10.07, 12.33, 13.9)
"""Of the observers, in turn; on no grid."""
WIDTH = 5.0
LAPSE = 0.03
OBSERVERS = 1000

QUEST_TRIALS = 40
UP_DOWN_TRIALS = 60


@dataclass(frozen=True)
class Marginal:
    """One parameter's posterior: mean and standard deviation, in the unit of the parameter."""

    mean: float
    sd: float


@dataclass(frozen=True)
class Estimate:
    """Estimates of each parameter from the answers.

    Attributes
    ----------
    guess, threshold, width, lapse : Marginal
    entropy_nats : float
        Of the posterior over the whole grid.
    """

    guess: Marginal
    threshold: Marginal
    width: Marginal
    lapse: Marginal
    entropy_nats: float


def of_posterior(history: History, grid: Grid) -> Estimate:
    """Return posterior means and standard deviations.

    Raises
    ------
    StudyError
        If a level of the history is not in the grid.
    """
    weight = posterior(history, grid)
    found = {}
    for axis, name in enumerate(PARAMETERS):
        values = np.asarray(getattr(grid, name).values)
        share = weight.sum(axis=tuple(other for other in range(4) if other != axis))
        if values.size == 1:  # known, whatever its share is rounded to
            found[name] = Marginal(float(values[0]), 0.0)
            continue
        mean = float(share @ values)
        found[name] = Marginal(mean, math.sqrt(float(share @ (values - mean) ** 2)))
    return Estimate(**found, entropy_nats=float(entr(weight).sum()))


@dataclass(frozen=True)
class Reversals:
    """The level at which a track hovered.

    Attributes
    ----------
    level : float or None
        Mean over the reversals used; None where there are not two of them.
    sd : float or None
        Standard deviation of their levels. Neighbours depend on each other, so this is no
        standard error.
    reversals : int
        How many there were.
    used : int
        How many of them, the last ones, are in the mean.
    performance : float
        Share of correct answers that the level stands for.
    """

    level: float | None
    sd: float | None
    reversals: int
    used: int
    performance: float


def of_reversals(history: History, settings: UpDown, *, discard: int | None = None) -> Reversals:
    """Return the mean level of the reversals.

    Parameters
    ----------
    discard : int or None
        Reversals at the start that do not count. None: those before the last step size, and
        one more. After that, one more is left out where their number is odd, so that turns
        upwards and downwards count the same (Levitt 1971).

    Raises
    ------
    StudyError
        As `track`, and if `discard` is negative.
    """
    skipped = len(settings.harder) if discard is None else discard
    if skipped < 0:
        raise StudyError(f"discard: must be at least 0 (got {skipped})")
    followed = track(history, settings)
    turns = [followed.shown[trial] for trial in followed.reversals]
    used = max(0, len(turns) - skipped) // 2 * 2
    if not used:
        return Reversals(None, None, len(turns), 0, performance(settings))
    last = turns[-used:]
    mean = math.fsum(last) / used
    sd = math.sqrt(math.fsum((level - mean) ** 2 for level in last) / (used - 1))
    return Reversals(mean, sd, len(turns), used, performance(settings))


@dataclass(frozen=True)
class Observers:
    """Simulated observers: cumulative normals that differ in threshold, and their chance.

    Attributes
    ----------
    threshold : ndarray (observers,)
    uniform : ndarray (observers, trials)
        A trial is answered correctly where its number is below the probability.
    guess : float
    """

    threshold: Floats
    uniform: Floats
    guess: float

    def probability(self, observer: int, level: float) -> float:
        """Return the probability of a correct answer."""
        return float(
            probability(
                level,
                threshold=self.threshold[observer],
                width=WIDTH,
                guess=self.guess,
                lapse=LAPSE,
            )
        )

    def answers(self, observer: int, trial: int, level: float) -> bool:
        """Tell whether the answer is correct."""
        return bool(self.uniform[observer, trial] < self.probability(observer, level))

    def level_at(self, share: float) -> Floats:
        """Return the level at which each observer answers that share correctly."""
        rise = (share - self.guess) / (1.0 - self.guess - LAPSE)
        return np.asarray(self.threshold + ndtri(rise) / slope_of(WIDTH, "gauss"))


def observers(count: int, trials: int, guess: float, seed: int) -> Observers:
    """Return `count` observers; the first ones are the same whatever the count."""
    uniform = np.stack([np.random.default_rng((seed, k)).random(trials) for k in range(count)])
    return Observers(np.resize(THRESHOLDS, count), uniform, guess)


@dataclass(frozen=True)
class Recovery:
    """Recovery of thresholds, in widths (.05 to .95) of the psychometric function.

    `lost` counts observers without an estimate.
    """

    bias: float
    sd: float
    lost: int


@dataclass(frozen=True)
class Run:
    """Run of one rule: estimates (observers,), NaN where lost, and levels (observers, trials)."""

    estimate: Floats
    level: Floats


def recovery(truth: Floats, ours: Run) -> Recovery:
    """Compare estimates with the truth."""
    error = (ours.estimate - truth) / WIDTH
    return Recovery(
        float(np.nanmean(error)), float(np.nanstd(error, ddof=1)), int(np.isnan(error).sum())
    )


def up_down_rules() -> dict[str, UpDown]:
    """Return the tracks of the benchmark; 17 is easy for every observer."""
    return {
        "weighted .75": weighted(LEVELS, start=17.0, target=0.75, harder=(1.0,)),
        "weighted .75, fine": weighted(LEVELS, start=17.0, target=0.75, harder=(1.0, 0.5)),
        "2 in a row": transformed(LEVELS, start=17.0, in_a_row=2, steps=(2.0, 1.0)),
        "3 in a row": transformed(LEVELS, start=17.0, in_a_row=3, steps=(2.0, 1.0)),
    }
