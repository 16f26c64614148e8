"""Confidence by detection theory: type-2 ROC area, meta-d', and unequal variances.

Counts of graded answers are arrays (2, 2 x steps): a row for trials of the first stimulus (noise)
and one for those of the second (signal); columns run from the first answer at its highest
confidence over both lowest to the second answer at its highest.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.special import ndtr, ndtri

from analysis.arrays import Floats, Ints
from analysis.models.detection import Measure
from analysis.models.tails import two_sided_p, two_sided_quantile

MOST_STEPS = 11
"""More different values are no steps of a scale, but a slider."""
FEWEST_TRIALS = 100
"""Of one person, for meta-d' and slopes of three steps and more; see `fewest_answers`."""
FEWEST_WRONG = 5
"""Wrong answers of one person, for meta-d'."""
FEWEST_FOR_RELIABILITY = 5
"""People, for limits of a correlation."""
UNBIASED_PADDING = 0.5
"""Answers of each stimulus, with which one person's d_a is right on average.

Without it d_a of 1.3 was too large by .03 (200 answers in two steps, 100 in four), and limits of
30 people with 200 answers in two steps held the truth in .92, with it in .95 (261 studies).
"""
WIDEST = 3.0
"""Largest logarithm of a ratio of standard deviations that data can tell from none."""


@dataclass(frozen=True)
class Ratio:
    """A ratio of two means over people with Fieller's limits; NaN where these have no end."""

    value: float
    lower: float
    upper: float
    level: float
    people: int


@dataclass(frozen=True)
class MetaFit:
    """Sensitivity of one person in answers and in confidence.

    Attributes
    ----------
    d_prime, criterion : float
        From answers alone.
    meta_d_prime : float
        The d' of an ideal observer whose confidence tells right from wrong as well.
    padded : bool
        1 / (2 x steps) was added to every cell, because one was empty.
    """

    d_prime: float
    criterion: float
    meta_d_prime: float
    log_likelihood: float
    padded: bool

    @property
    def ratio(self) -> float:
        """M-ratio: 1 for who uses all that the answers used."""
        return self.meta_d_prime / self.d_prime


@dataclass(frozen=True)
class UnequalFit:
    """Normal evidence whose standard deviation differs between noise (1) and signal.

    Attributes
    ----------
    mean, sd : float
        Of the signal's evidence.
    d_a : float
        Distance in the root mean square of both deviations.
    slope : float
        Of the ROC in normal coordinates: 1 / sd.
    area : float
        Below the fitted ROC.
    """

    mean: float
    sd: float
    d_a: float
    slope: float
    area: float
    log_likelihood: float


@dataclass(frozen=True)
class Reliability:
    """Reliability of a ranking of people: how alike two halves of each person's trials rank them.

    `half` is Pearson's correlation of the halves, `value` that of whole tests (Spearman-Brown),
    with limits by Fisher's transformation; none of them is below 0.
    """

    measure: str
    people: int
    half: float
    value: float
    lower: float
    upper: float


def rank_area(higher: Floats, lower: Floats) -> float:
    """Return the chance that a value of one sample exceeds one of another; ties count half.

    With confidence of right and of wrong answers this is the area below the type-2 ROC. NaN where
    a sample is empty.
    """
    if not higher.size or not lower.size:
        return math.nan
    ranks = scipy.stats.rankdata(np.concatenate([higher, lower]))[: higher.size]
    wins = float(ranks.sum()) - 0.5 * higher.size * (higher.size + 1)
    return wins / (higher.size * lower.size)


def roc_points(graded: Floats) -> tuple[tuple[float, float], ...]:
    """Return (false alarms, hits) at each criterion, from strict to lenient, of counts (2, n)."""
    shares = np.cumsum(graded[:, ::-1], axis=1) / graded.sum(axis=1, keepdims=True)
    points = [(0.0, 0.0), *((float(low), float(high)) for low, high in shares.T)]
    return tuple(points)


def graded_counts(signal: Floats, chose_signal: Floats, step: Ints, steps: int) -> Floats:
    """Return counts (2, 2 x steps) of trials (0/1, 0/1, and the step from 0)."""
    place = np.where(chose_signal > 0.5, steps + step, steps - 1 - step)
    counts = np.zeros((2, 2 * steps))
    np.add.at(counts, (signal.astype(np.int64), place), 1.0)
    return counts


def fewest_answers(steps: int) -> int:
    """Return the least answers of one person for metacognition: padding of few steps weighs more.

    Of 100 answers in two steps limits of 30 people held the true M-ratio in .87.
    """
    return max(FEWEST_TRIALS, math.ceil(400 / steps))


def fit_meta(counts: Floats) -> MetaFit:
    """Fit meta-d' by maximum likelihood (Maniscalco & Lau 2012), equal variances.

    Parameters
    ----------
    counts : ndarray (2, 2 x steps)

    Raises
    ------
    ValueError
        If too few wrong answers or steps are there, or d' is not above its error.

    Notes
    -----
    The type-1 criterion of the ideal observer keeps its place relative to d': meta_c / meta_d' =
    c / d'. Confidence is conditional on stimulus and answer.
    """
    steps = counts.shape[1] // 2
    wrong = float(counts[0, steps:].sum() + counts[1, :steps].sum())
    by_answer = counts.sum(axis=0).reshape(2, steps)
    if (counts.sum(axis=1) == 0).any():
        raise ValueError("only one of both stimuli was shown")
    if wrong < FEWEST_WRONG:
        raise ValueError(f"fewer than {FEWEST_WRONG} wrong answers")
    if ((by_answer[0, ::-1] + by_answer[1]) > 0).sum() < 2:
        raise ValueError("one step of confidence only")
    padded = bool((counts == 0).any())
    cells = counts + padded / (2.0 * steps)
    said = cells[:, steps:].sum(axis=1) / cells.sum(axis=1)
    z = ndtri(said)
    d_prime, criterion = float(z[1] - z[0]), float(-0.5 * (z[0] + z[1]))
    density = np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    error = math.sqrt(float((said * (1.0 - said) / (cells.sum(axis=1) * density**2)).sum()))
    if d_prime <= error:
        raise ValueError("d' is not above its standard error")
    middle, spread = steps - 1, _spread(2 * steps - 1)
    spread = spread - spread[middle]
    turned = np.array([-0.5, 0.5]) - criterion / d_prime  # of means, relative to the criterion

    def cost(point: Floats) -> tuple[float, Floats]:
        gaps = np.exp(np.minimum(point[1:], 20.0))
        total, slope = 0.0, np.zeros_like(point)
        for row, shift in zip(cells, turned, strict=True):
            edges = spread @ gaps - shift * point[0]
            value, by_edge = _log_likelihood(edges, row)
            answers = np.array([row[:steps].sum(), row[steps:].sum()])
            given, by_middle = _log_likelihood(edges[[middle]], answers)
            by_edge[middle] -= by_middle[0]
            total -= value - given
            slope[0] += shift * by_edge.sum()
            slope[1:] -= (spread.T @ by_edge) * gaps
        return total, slope

    start = np.concatenate([[d_prime], np.full(2 * steps - 2, math.log(1.0 / steps))])
    found = scipy.optimize.minimize(cost, start, jac=True, method="BFGS", options={"gtol": 1e-6})
    return MetaFit(d_prime, criterion, float(found.x[0]), -float(found.fun), padded)


def fit_unequal(counts: Floats, padding: float = 0.0) -> UnequalFit:
    """Fit normal evidence of two standard deviations to graded answers by maximum likelihood.

    Parameters
    ----------
    counts : ndarray (2, grades)
        From surely noise to surely signal; grades that nobody gave are left out.
    padding : float
        Answers that are added to each stimulus, spread evenly over its grades.

    Raises
    ------
    ValueError
        If the data identify no ratio of standard deviations.
    """
    if (counts.sum(axis=1) == 0).any():
        raise ValueError("only one of both stimuli was shown")
    cells = counts[:, counts.sum(axis=0) > 0]
    if cells.shape[1] < 3:
        raise ValueError("fewer than three grades were given")
    if not 0.0 < rank_area(*_as_samples(cells)) < 1.0:
        raise ValueError("signal and noise were told apart without a mistake")
    cells = cells + padding / cells.shape[1]
    spread = _spread(cells.shape[1] - 1)
    shares = (np.cumsum(cells.sum(axis=0))[:-1] + 0.5) / (cells.sum() + 1.0)
    places = ndtri(shares)

    def cost(point: Floats) -> tuple[float, Floats]:
        mean, log_sd, lowest = point[:3]
        gaps = np.exp(np.minimum(point[3:], 20.0))
        at = lowest + spread @ gaps
        noise, by_noise = _log_likelihood(at, cells[0])
        scale = math.exp(-min(max(log_sd, -20.0), 20.0))
        edges = (at - mean) * scale
        signal, by_signal = _log_likelihood(edges, cells[1])
        by_place = by_noise + by_signal * scale
        slope = [-scale * by_signal.sum(), -(by_signal * edges).sum(), by_place.sum()]
        return -(noise + signal), -np.concatenate([slope, (spread.T @ by_place) * gaps])

    gaps = np.log(np.maximum(np.diff(places), 1e-3))
    start = np.concatenate([[0.5, 0.0, places[0]], gaps])
    found = scipy.optimize.minimize(cost, start, jac=True, method="BFGS", options={"gtol": 1e-6})
    mean, log_sd = float(found.x[0]), float(found.x[1])
    if abs(log_sd) > WIDEST or not np.isfinite(found.fun):
        raise ValueError("the ratio of standard deviations has no end")
    sd = math.exp(log_sd)
    d_a = mean * math.sqrt(2.0 / (1.0 + sd * sd))
    area = float(ndtr(d_a / math.sqrt(2.0)))
    return UnequalFit(mean, sd, d_a, 1.0 / sd, area, -float(found.fun))


def graded_area(counts: Floats) -> float:
    """Return the area below the ROC of graded answers, counts (2, grades), without a model."""
    return rank_area(*_as_samples(counts))


def mean_over_people(
    values: Floats,
    level: float,
    against: float | None = None,
    *,
    within: tuple[float, float] = (-math.inf, math.inf),
) -> Measure:
    """Return the mean of people's values with t limits, and p against a value.

    Values that are NaN are left out; one person has no limits, nobody no mean. `within` are the
    least and the largest value that there can be, where limits end: they hold the true mean as
    often, and leave out `against` exactly where p is below 1 - level.
    """
    own = values[np.isfinite(values)]
    mean = float(own.mean()) if own.size else math.nan
    if own.size < 2:
        return Measure(mean, math.nan, 0.0, math.nan, math.nan, level, math.nan)
    df, error = float(own.size - 1), float(own.std(ddof=1)) / math.sqrt(own.size)
    reach = float(two_sided_quantile(level, df)) * error
    p = math.nan
    if error > 0.0 and against is not None:
        p = float(two_sided_p((mean - against) / error, df))
    lower, upper = max(mean - reach, within[0]), min(mean + reach, within[1])
    return Measure(mean, error, df, lower, upper, level, p)


def ratio_of_means(above: Floats, below: Floats, level: float) -> Ratio:
    """Return a ratio of means over people (people,) with Fieller's limits."""
    people = above.size
    x, y = float(below.mean()), float(above.mean())
    value = y / x if x else math.nan
    if people < 2:
        return Ratio(value, math.nan, math.nan, level, people)
    moments = np.cov(above, below) / people
    squared = float(two_sided_quantile(level, people - 1)) ** 2
    a = x * x - squared * float(moments[1, 1])
    b = x * y - squared * float(moments[0, 1])
    c = y * y - squared * float(moments[0, 0])
    inner = b * b - a * c
    if a <= 0.0 or inner < 0.0:
        return Ratio(value, math.nan, math.nan, level, people)
    reach = math.sqrt(inner)
    return Ratio(value, (b - reach) / a, (b + reach) / a, level, people)


def halves_agree(measure: str, halves: Sequence[tuple[float, float]], level: float) -> Reliability:
    """Return the split-half reliability of a measure, of its two values of each person.

    Raises
    ------
    ValueError
        If too few people have both, or people do not differ.
    """
    pairs = np.array([one for one in halves if np.isfinite(one).all()]).reshape(-1, 2)
    if len(pairs) < FEWEST_FOR_RELIABILITY:
        raise ValueError(
            f"must be of {FEWEST_FOR_RELIABILITY} people at least who have it in both halves"
            f" (found {len(pairs)})"
        )
    if (np.ptp(pairs, axis=0) == 0.0).any():
        raise ValueError("people do not differ in it")
    half = float(np.corrcoef(pairs.T)[0, 1])
    reach = float(two_sided_quantile(level)) / math.sqrt(len(pairs) - 3)
    turned = math.atanh(min(max(half, -0.999999), 0.999999))
    ends = [math.tanh(turned + side * reach) for side in (-1.0, 1.0)]
    whole, lower, upper = (max(0.0, 2.0 * r / (1.0 + r)) for r in (half, *ends))
    return Reliability(measure, len(pairs), half, whole, lower, upper)


def _spread(edges: int) -> Floats:
    """Return sums at each edge of the gaps between edges (edges - 1,), from the lowest on."""
    return np.tril(np.ones((edges, edges)), -1)[:, : edges - 1]


def _log_likelihood(edges: Floats, counts: Floats) -> tuple[float, Floats]:
    """Return the log likelihood of counts between edges of a standard normal, and its slope."""
    turned = np.concatenate([[-np.inf], edges, [np.inf]])
    low, high = turned[:-1], turned[1:]
    right = low > 0.0  # small tails subtract without loss on their own side
    p = np.where(right, ndtr(-low) - ndtr(-high), ndtr(high) - ndtr(low))
    p = np.maximum(p, 1e-300)
    density = np.exp(-0.5 * edges * edges) / math.sqrt(2.0 * math.pi)
    weight = counts / p
    return float(counts @ np.log(p)), density * (weight[:-1] - weight[1:])


def _as_samples(counts: Floats) -> tuple[Floats, Floats]:
    """Return grades of signal and of noise trials, one by one."""
    grades = np.arange(counts.shape[1], dtype=np.float64)
    noise, signal = (np.repeat(grades, row.round().astype(int)) for row in counts)
    return signal, noise
