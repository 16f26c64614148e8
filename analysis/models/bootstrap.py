"""Bootstrap limits of scales that respect participants and scenes."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri, stdtr, stdtrit

from analysis.arrays import Floats, Ints
from analysis.models.clustered import holm, least_p
from analysis.models.numeric import zeroed
from analysis.models.paired.paired_counts import fit_scores, pair_index
from protocols.errors import count_of

FEW_CLUSTERS = 5


@dataclass(frozen=True)
class ScaleIntervals:
    """Bootstrap intervals of mean-zero scores and of their differences.

    Attributes
    ----------
    level : float
    lower, upper : ndarray (k,)
    difference_lower, difference_upper : ndarray (k, k)
        Of score i minus score j; they leave out 0 exactly where p < 1 - level.
    difference_p : ndarray (k, k)
        Two-sided, of equal scores; 1 on the diagonal.
    difference_p_adjusted : ndarray (k, k)
        Holm's over the k (k - 1) / 2 differences.
    standard_error : ndarray (k,)
    samples : int
        Bootstrap samples used; `left_out` had a condition nobody compared.
    resampled : tuple of str
        What was drawn with replacement.
    """

    level: float
    lower: Floats
    upper: Floats
    difference_lower: Floats
    difference_upper: Floats
    difference_p: Floats
    difference_p_adjusted: Floats
    standard_error: Floats
    samples: int
    left_out: int
    resampled: tuple[str, ...]
    warnings: tuple[str, ...]


def bootstrap_scores(
    wins: Floats,
    *,
    rng: np.random.Generator,
    samples: int = 1000,
    scenes: bool = True,
) -> Floats:
    """Draw participants (and scenes) with replacement and fit each draw.

    Parameters
    ----------
    wins : ndarray (participants, scenes, k, k)
        Votes for i over j of each participant in each scene.
    scenes : bool
        Draw scenes as well, independently of participants (the two-way bootstrap).

    Returns
    -------
    ndarray (samples, k)
        Mean-zero scores; rows of draws that left conditions uncompared are NaN.

    Notes
    -----
    The two-way ("pigeonhole") bootstrap of Owen 2007, Annals of Applied Statistics 1(2).
    """
    people = draws(wins.shape[0], samples, rng)
    places = draws(wins.shape[1] if scenes else 1, samples, rng)
    return drawn_scores(wins, people, np.broadcast_to(places, (samples, wins.shape[1])))


def draws(count: int, samples: int, rng: np.random.Generator) -> Ints:
    """Return counts of how often each of so many is drawn with replacement (samples, count)."""
    return rng.multinomial(count, np.full(count, 1 / count), samples)


def drawn_scores(wins: Floats, people: Ints, scenes: Ints) -> Floats:
    """Fit each draw: how often (samples, participants) and (samples, scenes) were drawn."""
    participants, scene_count, count, _ = wins.shape
    first, second = pair_index(count)
    votes = np.concatenate([wins[..., first, second], wins[..., second, first]], axis=-1)
    by_person = people @ votes.reshape(participants, -1)
    drawn = np.einsum(
        "bs,bsv->bv", scenes.astype(np.float64), by_person.reshape(len(people), scene_count, -1)
    )
    won, lost = drawn[:, : first.size], drawn[:, first.size :]
    return fit_scores(won, lost, count)


def bootstrap_scale(
    wins: Floats,
    *,
    rng: np.random.Generator,
    samples: int = 1000,
    level: float = 0.95,
    scenes: bool = True,
) -> ScaleIntervals:
    """Bootstrap intervals of scores that respect participants and scenes.

    Parameters
    ----------
    wins : ndarray (participants, scenes, k, k)

    Raises
    ------
    ValueError
        If there is one participant only, or fewer than 20 samples link all conditions.

    Notes
    -----
    Percentile limits widened as Hesterberg 2015 ("expanded percentile") does for few clusters:
    the quantiles are those of t with G - 1 degrees of freedom times sqrt(G / (G - 1)), G the
    number of participants. Plain percentiles of observers cover .90, of both ways .92
    (docs/decisions/0053).
    """
    participants, scene_count = wins.shape[:2]
    if participants < 2:
        raise ValueError(f"wins must hold at least two participants (got {participants})")
    scores = bootstrap_scores(wins, rng=rng, samples=samples, scenes=scenes)
    whole = np.isfinite(scores).all(axis=1)
    scores = scores[whole]
    if scores.shape[0] < 20:
        raise ValueError(
            "too few bootstrap samples link all conditions"
            f" ({scores.shape[0]} of {samples}); collect more comparisons"
        )
    two_way = scenes and scene_count > 1
    tail = expanded_tail(level, participants)
    lower, upper = np.quantile(scores, [tail, 1.0 - tail], axis=0)
    first, second = np.triu_indices(scores.shape[1], 1)
    ends = difference_limits(scores[:, first] - scores[:, second], participants, level)
    diff_lower, diff_upper = np.zeros((2, scores.shape[1], scores.shape[1]))
    diff_lower[first, second], diff_upper[first, second], p = ends
    diff_lower[second, first], diff_upper[second, first] = -ends[1], -ends[0]
    warnings = []
    if participants < FEW_CLUSTERS:
        warnings.append(
            f"only {count_of(participants, 'participant')}: intervals are a rough guide"
        )
    if not two_way:
        warnings.append("scenes were not resampled: limits speak about these scenes only")
    left_out = int(samples - whole.sum())
    if left_out:
        warnings.append(f"{left_out} of {samples} samples left conditions uncompared")
    return ScaleIntervals(
        level=level,
        lower=lower,
        upper=upper,
        difference_lower=diff_lower,
        difference_upper=diff_upper,
        difference_p=_square(p, first, second),
        difference_p_adjusted=_square(holm(p), first, second),
        standard_error=scores.std(axis=0, ddof=1),
        samples=int(whole.sum()),
        left_out=left_out,
        resampled=("participants", "scenes") if two_way else ("participants",),
        warnings=tuple(warnings),
    )


def difference_limits(drawn: Floats, clusters: int, level: float) -> tuple[Floats, Floats, Floats]:
    """Return expanded percentile limits and p of drawn differences (samples, differences).

    Limits hold 0 exactly where p does not reach 1 - level. Differences are of order 1, in standard
    deviations or logits.
    """
    drawn = zeroed(drawn)
    tail = expanded_tail(level, clusters)
    lower, upper = np.quantile(drawn, [tail, 1.0 - tail], axis=0)
    p = _difference_p(drawn, clusters)
    holds = p >= 1.0 - level
    return (
        np.where(holds, np.minimum(lower, 0.0), lower),
        np.where(holds, np.maximum(upper, 0.0), upper),
        p,
    )


def _difference_p(drawn: Floats, participants: int) -> Floats:
    """Return the two-sided p at which the expanded percentile limits of draws just hold 0.

    Parameters
    ----------
    drawn : ndarray (samples, differences)

    Notes
    -----
    The area of draws beyond 0, found on the same line between order statistics that gives the
    limits, becomes the p of a t that `expanded_tail` would turn into it. Draws that are 0 lie half
    below it, half above: 0 is in the middle of them. Where 0 lies outside all
    draws the normal law goes on from the outermost one, at the draws' own deviation. No p is
    below that of unanimous participants.
    """
    samples = drawn.shape[0]
    place = np.arange(samples) / (samples - 1.0)
    floor = float(least_p(participants))
    widened = np.sqrt(participants / (participants - 1.0))
    edge = float(ndtri(1.0 / samples))
    found = np.ones(drawn.shape[1])
    for index, column in enumerate(np.sort(drawn, axis=0).T):
        centre, deviation = float(column.mean()), float(column.std(ddof=1))
        if deviation < 1e-12:
            found[index] = 1.0 if abs(centre) < 1e-12 else floor
            continue
        if column[0] > 0.0 or column[-1] < 0.0:
            z = edge - min(abs(column[0]), abs(column[-1])) / deviation
        else:
            low, high = (int(np.searchsorted(column, 0.0, side)) for side in ("left", "right"))
            below = float(place[low:high].mean() if low < high else np.interp(0.0, column, place))
            z = max(edge, float(ndtri(min(max(below, 1e-12), 1.0 - 1e-12))))
            above = max(edge, float(ndtri(max(1.0 - below, 1e-12))))
            z = min(z, above)
        found[index] = max(floor, float(min(1.0, 2.0 * stdtr(participants - 1, z / widened))))
    return found


def _square(values: NDArray[Any], first: NDArray[np.intp], second: NDArray[np.intp]) -> Floats:
    """Lay values of pairs out as a symmetric table with 1 on the diagonal."""
    size = int(second.max()) + 1
    table = np.ones((size, size))
    table[first, second] = table[second, first] = values
    return table


def expanded_tail(level: float, clusters: int) -> float:
    """Return the bootstrap tail area that gives `level` with few clusters (Hesterberg 2015)."""
    tail = 0.5 * (1.0 - level)
    widened = stdtrit(clusters - 1, tail) * np.sqrt(clusters / (clusters - 1))
    return float(ndtr(widened))
