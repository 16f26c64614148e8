"""Does an observer answer unlike the others? With a family-wise rate that simulation sets."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.arrays import Floats
from analysis.models.numeric import ROUNDING
from analysis.models.paired.paired_counts import (
    JOD_SIGMA,
    choice_share,
    fit_scores,
    log_probability,
    pair_index,
)

TAIL_DF = 4.0
"""Freedom of the t law of tastes: heavier tails than the normal law's, at some cost."""
SPREADS = (0.0, 0.15, 0.3, 0.5, 0.75, 1.0, 1.35, 1.8, 2.4, 3.2)
SPREAD_STUDIES = 60
"""Studies simulated at each of these spreads, in the scale's unit."""
FEWEST_STUDIES = 100
MOST_OBSERVERS = 60_000
"""Observers simulated in all: many people in a study leave fewer studies."""


@dataclass(frozen=True)
class ObserverCheck:
    """Distance of each observer from the scale of the others.

    Attributes
    ----------
    observers : tuple of str
    distance : ndarray (observers,)
        Standardised shortfall of the observer's log likelihood under the others' scale, as a
        distance from the median observer in robust deviations; larger is less alike.
    p : ndarray (observers,)
        Chance that the largest distance in a clean study of this shape is as large: family-wise.
    agreement : ndarray (observers,)
        How far the observer's answers lean with the scale of the others, in standard errors of
        answers by coin; negative where they lean against it.
    reversed_p : ndarray (observers,)
        Chance that the least agreement in a clean study of this shape is as low: family-wise.
    spread : float
        Estimated standard deviation of scores between observers, which the simulation repeats.
    flagged : tuple of str
        Observers with p < alpha. Look at them; do not drop them unless the protocol says so.
    turned : tuple of str
        Observers who lean against the others, with reversed_p < alpha: did they take one answer
        for the other?
    """

    observers: tuple[str, ...]
    distance: Floats
    p: Floats
    agreement: Floats
    reversed_p: Floats
    spread: float
    flagged: tuple[str, ...]
    turned: tuple[str, ...]
    alpha: float
    warnings: tuple[str, ...]


def check_observers(
    wins: Floats,
    observers: Sequence[str],
    *,
    rng: np.random.Generator,
    alpha: float = 0.05,
    studies: int = 400,
) -> ObserverCheck:
    """Compare each observer with the scale of all others.

    Parameters
    ----------
    wins : ndarray (observers, k, k)
        Votes of each for row over column. Of fewer than four observers none is judged.
    studies : int
        Clean studies simulated to set the family-wise rate.

    Notes
    -----
    A fixed cut-off flags someone in a third of clean studies. Here clean studies with the same
    trials, scale and spread between observers are simulated, and the largest distance in each
    gives the reference distribution (parametric bootstrap of the maximum). Observers of a clean
    study differ by a t law of few degrees of freedom, because people do; the spread is the one
    whose simulated studies look as spread as this one (docs/decisions/0056). The same studies
    judge who answers the other way round, which is a test of its own.
    """
    count, conditions = wins.shape[0], wins.shape[1]
    names = tuple(observers)
    if count < 4:
        none, one = np.zeros(count), np.ones(count)
        note = "fewer than four observers: no check"
        return ObserverCheck(names, none, one, none, one, 0.0, (), (), alpha, (note,))
    first, second = pair_index(conditions)
    won, shown = wins[:, first, second], wins[:, first, second] + wins[:, second, first]
    spread, scores = _matched_spread(won, shown, conditions, rng)
    short, agreement = _judged(won, shown, conditions)
    distance = _apart(short)
    studies = max(FEWEST_STUDIES, min(studies, MOST_OBSERVERS // count))

    def simulated(spread: float, scores: Floats) -> tuple[Floats, Floats]:
        personal = scores + spread * _tastes(rng, (studies, count, conditions))
        share = choice_share(personal[..., first] - personal[..., second])
        clean = rng.binomial(shown.astype(np.int64), share).astype(np.float64)
        return _judged(clean, shown, conditions)

    largest = _apart(simulated(spread, scores)[0]).max(axis=-1)
    p = (1 + (largest[:, None] >= distance - ROUNDING).sum(axis=0)) / (studies + 1)
    reversed_p = np.ones(count)
    if float(agreement.min()) < -ROUNDING:
        # Who answers the other way round must not set how much people differ.
        others = np.arange(count) != np.argmax(agreement <= agreement.min() + ROUNDING)
        rest = _matched_spread(won[others], shown[others], conditions, rng)
        least = simulated(*rest)[1].min(axis=-1)
        reversed_p = (1 + (least[:, None] <= agreement + ROUNDING).sum(axis=0)) / (studies + 1)
    return ObserverCheck(
        observers=names,
        distance=distance,
        p=p,
        agreement=agreement,
        reversed_p=reversed_p,
        spread=spread,
        flagged=tuple(name for name, value in zip(names, p, strict=True) if value < alpha),
        turned=tuple(name for name, value in zip(names, reversed_p, strict=True) if value < alpha),
        alpha=alpha,
        warnings=(),
    )


def _judged(won: Floats, shown: Floats, conditions: int) -> tuple[Floats, Floats]:
    """Return standardised shortfall and agreement (..., observers) under leave-one-out scales."""
    rest_won = won.sum(axis=-2, keepdims=True) - won
    rest_shown = np.broadcast_to(shown.sum(axis=-2, keepdims=True) - shown, won.shape)
    scores = fit_scores(rest_won, rest_shown - rest_won, conditions, tolerance=1e-5)
    first, second = pair_index(conditions)
    difference = scores[..., first] - scores[..., second]
    yes, no = log_probability(difference), log_probability(-difference)
    share = np.exp(yes)
    found = (won * yes + (shown - won) * no).sum(axis=-1)
    expected = (shown * (share * yes + (1.0 - share) * no)).sum(axis=-1)
    variance = (shown * share * (1.0 - share) * (yes - no) ** 2).sum(axis=-1)
    leaning = ((won - 0.5 * shown) * difference).sum(axis=-1)
    by_coin = 0.25 * (shown * difference**2).sum(axis=-1)
    return (
        np.asarray((expected - found) / np.sqrt(np.maximum(variance, 1e-9))),
        np.asarray(leaning / np.sqrt(np.maximum(by_coin, 1e-9))),
    )


def _apart(distance: Floats) -> Floats:
    """Return distances from the median observer, in (1 + robust) deviations.

    Relative distances depend little on how different observers are altogether, which is only
    roughly known; the 1 is the deviation of an observer whose answers do follow the scale.
    """
    centre = np.median(distance, axis=-1, keepdims=True)
    deviation = 1.4826 * np.median(np.abs(distance - centre), axis=-1, keepdims=True)
    return np.asarray((distance - centre) / (1.0 + deviation))


def _tastes(rng: np.random.Generator, shape: tuple[int, int, int]) -> Floats:
    """Draw how observers differ, with variance 1 and the tails of people."""
    return np.asarray(rng.standard_t(TAIL_DF, shape) / np.sqrt(TAIL_DF / (TAIL_DF - 2.0)))


def _matched_spread(
    won: Floats, shown: Floats, conditions: int, rng: np.random.Generator
) -> tuple[float, Floats]:
    """Return the spread between observers whose simulated studies look as spread, and the scale.

    The moments of `_excess` see too little where observers differ much, because answers cannot
    go beyond always: so the same moments are taken of studies simulated at known spreads
    (indirect inference).
    """
    first, second = pair_index(conditions)
    total_shown = shown.sum(axis=0)
    scores = fit_scores(won.sum(axis=0), total_shown - won.sum(axis=0), conditions)

    def widened(spread: float) -> Floats:
        # Answers averaged over observers who differ understate the distances each of them sees.
        return np.asarray(scores * np.sqrt(1.0 + 2.0 * (spread / JOD_SIGMA) ** 2))

    drawn = _tastes(rng, (SPREAD_STUDIES, won.shape[0], conditions))
    seen = []
    for spread in SPREADS:
        own = widened(spread) + spread * drawn
        share = choice_share(own[..., first] - own[..., second])
        clean = rng.binomial(shown.astype(np.int64), share).astype(np.float64)
        sums = clean.sum(axis=1)
        fitted = fit_scores(sums, total_shown - sums, conditions, tolerance=1e-5)
        seen.append(float(np.nanmean(_excess(clean, shown, fitted))))
    goal = float(_excess(won, shown, scores))
    spread = float(np.interp(goal, np.maximum.accumulate(seen), SPREADS))
    return spread, widened(spread)


def _excess(won: Floats, shown: Floats, scores: Floats) -> Floats:
    """Return moments (...) of how much more observers differ than their trials make them.

    An observer's count of a pair varies as n p q + n (n - 1) f² 2 spread², f the slope of the
    answer probability; this is the square of the spread that would fit, about.
    """
    first, second = pair_index(scores.shape[-1])
    difference = scores[..., first] - scores[..., second]
    step = 1e-4
    slope = (choice_share(difference + step) - choice_share(difference - step)) / (2.0 * step)
    count = won.shape[-2]
    share = won.sum(axis=-2) / np.maximum(shown.sum(axis=0), 1.0)
    expected = shown * share[..., None, :]
    squares = (won - expected) ** 2 * count / (count - 1)
    excess = (squares - expected * (1.0 - share[..., None, :])).sum(axis=(-1, -2))
    weight = (2.0 * shown * (shown - 1.0) * slope[..., None, :] ** 2).sum(axis=(-1, -2))
    return np.asarray(np.maximum(0.0, excess) / np.maximum(weight, 1e-9))
