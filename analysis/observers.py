"""Does an observer answer unlike the others? With a family-wise rate that simulation sets."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.pairs import (
    JOD_SIGMA,
    Floats,
    Model,
    fit_scores,
    log_probability,
    pair_index,
    probability,
)


@dataclass(frozen=True)
class ObserverCheck:
    """How far each observer is from the scale of the others.

    Attributes
    ----------
    observers : tuple of str
    distance : ndarray (observers,)
        Standardised shortfall of the observer's log likelihood under the others' scale, as a
        distance from the median observer in robust deviations; larger is less alike.
    p : ndarray (observers,)
        Chance that the largest distance in a clean study of this shape is as large: family-wise.
    spread : float
        Estimated standard deviation of scores between observers, which the simulation repeats.
    flagged : tuple of str
        Observers with p < alpha. Look at them; do not drop them unless the protocol says so.
    """

    observers: tuple[str, ...]
    distance: Floats
    p: Floats
    spread: float
    flagged: tuple[str, ...]
    alpha: float
    warnings: tuple[str, ...]


def check_observers(
    wins: Floats,
    observers: Sequence[str],
    *,
    rng: np.random.Generator,
    alpha: float = 0.05,
    model: Model = "thurstone",
    studies: int = 400,
) -> ObserverCheck:
    """Compare each observer with the scale of all others.

    Parameters
    ----------
    wins : ndarray (observers, k, k)
    studies : int
        Clean studies simulated to set the family-wise rate.

    Notes
    -----
    A fixed cut-off flags someone in a third of clean studies. Here clean studies with the same
    trials, scale and spread between observers are simulated, and the largest distance in each
    gives the reference distribution (parametric bootstrap of the maximum).
    """
    count, conditions = wins.shape[0], wins.shape[1]
    names = tuple(observers)
    if count < 4:
        none = np.zeros(count)
        return ObserverCheck(
            names, none, np.ones(count), 0.0, (), alpha, ("fewer than four observers: no check",)
        )
    first, second = pair_index(conditions)
    won, shown = wins[:, first, second], wins[:, first, second] + wins[:, second, first]
    scores = fit_scores(won.sum(axis=0), (shown - won).sum(axis=0), conditions, model)
    spread = _spread(won, shown, scores, conditions, model)
    # Answers averaged over observers who differ understate the distances each of them sees.
    scores = scores * np.sqrt(1.0 + 2.0 * (spread / _noise(model)) ** 2)
    distance = _apart(_distances(won, shown, conditions, model))
    shift = (
        rng.normal(0.0, spread, (studies, count, conditions))
        if spread > 0
        else np.zeros((studies, count, conditions))
    )
    personal = scores + shift
    share = probability(personal[..., first] - personal[..., second], model)
    clean = rng.binomial(shown.astype(np.int64), share).astype(np.float64)
    largest = _apart(_distances(clean, shown, conditions, model)).max(axis=-1)
    p = (1 + (largest[:, None] >= distance).sum(axis=0)) / (studies + 1)
    return ObserverCheck(
        observers=names,
        distance=distance,
        p=p,
        spread=spread,
        flagged=tuple(name for name, value in zip(names, p, strict=True) if value < alpha),
        alpha=alpha,
        warnings=(),
    )


def _distances(won: Floats, shown: Floats, conditions: int, model: Model) -> Floats:
    """Return the standardised shortfall (..., observers) under leave-one-out scales."""
    rest_won = won.sum(axis=-2, keepdims=True) - won
    rest_shown = np.broadcast_to(shown.sum(axis=-2, keepdims=True) - shown, won.shape)
    scores = fit_scores(rest_won, rest_shown - rest_won, conditions, model, tolerance=1e-5)
    first, second = pair_index(conditions)
    difference = scores[..., first] - scores[..., second]
    yes, no = log_probability(difference, model), log_probability(-difference, model)
    share = np.exp(yes)
    found = (won * yes + (shown - won) * no).sum(axis=-1)
    expected = (shown * (share * yes + (1.0 - share) * no)).sum(axis=-1)
    variance = (shown * share * (1.0 - share) * (yes - no) ** 2).sum(axis=-1)
    return np.asarray((expected - found) / np.sqrt(np.maximum(variance, 1e-9)))


def _apart(distance: Floats) -> Floats:
    """Return distances from the median observer, in (1 + robust) deviations.

    Relative distances depend little on how different observers are altogether, which is only
    roughly known; the 1 is the deviation of an observer whose answers do follow the scale.
    """
    centre = np.median(distance, axis=-1, keepdims=True)
    deviation = 1.4826 * np.median(np.abs(distance - centre), axis=-1, keepdims=True)
    return np.asarray((distance - centre) / (1.0 + deviation))


def _noise(model: Model) -> float:
    """Standard deviation of the answer noise on the scale's unit."""
    return JOD_SIGMA if model == "thurstone" else float(np.pi / np.sqrt(3.0))


def _spread(won: Floats, shown: Floats, scores: Floats, conditions: int, model: Model) -> float:
    """Estimate the standard deviation of scores between observers by moments.

    An observer's count of a pair varies as n p q + n (n - 1) f² 2 spread², f the slope of the
    answer probability.
    """
    first, second = pair_index(conditions)
    difference = scores[..., first] - scores[..., second]
    step = 1e-4
    slope = (probability(difference + step, model) - probability(difference - step, model)) / (
        2.0 * step
    )
    count = won.shape[0]
    share = won.sum(axis=0) / np.maximum(shown.sum(axis=0), 1.0)
    squares = (won - shown * share) ** 2 * count / (count - 1)
    excess = float((squares - shown * share * (1.0 - share)).sum())
    weight = float((2.0 * shown * (shown - 1.0) * slope**2).sum())
    return float(np.sqrt(max(0.0, excess / weight))) if weight > 0 else 0.0
