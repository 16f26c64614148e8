"""Scales from paired comparisons: Bradley-Terry logits and Thurstone Case V JODs."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats
from scipy.special import expit, ndtr

from analysis.numeric import numeric_hessian
from analysis.pairs import (
    JOD_SIGMA,
    Floats,
    Model,
    components,
    difference_design,
    has_maximum,
    log_probability,
    pair_index,
    solve_pairs,
)

PSEUDO_VOTES = 0.5
"""Added to both sides of every compared pair where no finite maximum exists."""

FEW_CLUSTERS = 5


@dataclass(frozen=True)
class Scale:
    """Scores of conditions from paired comparisons.

    Attributes
    ----------
    model, unit : str
        "bradley-terry" in logits or "thurstone" in JOD (1 JOD = 75 % of the answers).
    conditions : tuple of str
    scores : ndarray (k,)
        Mean zero.
    covariance : ndarray (k, k)
        From the observed information; takes votes as independent. Prefer the bootstrap.
    log_likelihood : float
        Without binomial coefficients.
    deviance, fit_df, fit_p : float, int, float
        Likelihood ratio against one free proportion per pair: does one axis suffice?
    equal_statistic, equal_df, equal_p : float, int, float
        Likelihood ratio against "all conditions are equal" (votes as independent).
    warnings : tuple of str
        When not to trust the scores.
    """

    model: Model
    unit: str
    conditions: tuple[str, ...]
    scores: Floats
    covariance: Floats
    log_likelihood: float
    deviance: float
    fit_df: int
    fit_p: float
    equal_statistic: float
    equal_df: int
    equal_p: float
    warnings: tuple[str, ...]

    def relative_to(self, name: str) -> tuple[Floats, Floats]:
        """Return scores and standard errors with condition `name` at zero."""
        if name not in self.conditions:
            raise ValueError(f"name must be one of {list(self.conditions)} (got {name!r})")
        index = self.conditions.index(name)
        shift = np.eye(len(self.conditions))
        shift[:, index] -= 1.0
        variance = np.einsum("ij,jk,ik->i", shift, self.covariance, shift)
        return shift @ self.scores, np.sqrt(variance.clip(min=0.0))


@dataclass(frozen=True)
class Contrast:
    """One condition against another on a scale, by likelihood ratio (votes independent)."""

    first: str
    second: str
    difference: float
    statistic: float
    p: float


@dataclass(frozen=True)
class ScaleIntervals:
    """Bootstrap intervals of mean-zero scores and of their differences.

    Attributes
    ----------
    level : float
    lower, upper : ndarray (k,)
    difference_lower, difference_upper : ndarray (k, k)
        Of score i minus score j.
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
    standard_error: Floats
    samples: int
    left_out: int
    resampled: tuple[str, ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class TiedScale:
    """Scores and tie threshold where "no difference" was an answer.

    An answer is a tie when the perceived difference stays within ± `threshold`.
    """

    model: Model
    conditions: tuple[str, ...]
    scores: Floats
    threshold: float
    covariance: Floats
    threshold_se: float
    log_likelihood: float


def scale(wins: Floats, conditions: Sequence[str], model: Model = "thurstone") -> Scale:
    """Fit scores to a table of votes by maximum likelihood.

    Parameters
    ----------
    wins : ndarray (k, k)
        ``wins[i, j]`` votes for i over j. Ties may be entered as half a vote each way
        (`scale_with_ties` models them instead). The diagonal is ignored.
    conditions : sequence of str
    model : "thurstone" (JOD, Case V) or "bradley-terry" (logits)

    Raises
    ------
    ValueError
        If the table has a wrong shape, holds negative or non-finite counts, or comparisons do
        not link all conditions (the message names the separate groups).

    Notes
    -----
    Where some condition always won or always lost, the maximum is at infinity (Ford 1957); half
    a vote is then added to both sides of each compared pair, and the result says so.
    Bradley and Terry 1952; Thurstone 1927, Case V; 1 JOD as in Perez-Ortiz and Mantiuk 2017.
    """
    votes = _checked(wins, conditions)
    names = tuple(conditions)
    votes, warnings = _finite_votes(votes)
    count = len(names)
    first, second = pair_index(count)
    won, lost = votes[first, second], votes[second, first]
    solution = solve_pairs(difference_design(count), won, lost, model)
    if not bool(solution.converged):
        warnings = (*warnings, "the fit did not converge; do not use these scores")
    scores, covariance = _centred(solution.parameters, solution.information)
    total = won + lost
    share = won / np.maximum(total, 1e-300)
    saturated = float(np.sum(_xlogy(won, share) + _xlogy(lost, 1.0 - share)))
    deviance = max(0.0, 2.0 * (saturated - float(solution.log_likelihood)))
    fit_df = int(np.count_nonzero(total)) - (count - 1)
    equal = max(0.0, 2.0 * (float(solution.log_likelihood) + float(total.sum()) * np.log(2.0)))
    return Scale(
        model=model,
        unit="logit" if model == "bradley-terry" else "JOD",
        conditions=names,
        scores=scores,
        covariance=covariance,
        log_likelihood=float(solution.log_likelihood),
        deviance=deviance,
        fit_df=fit_df,
        fit_p=float(stats.chi2.sf(deviance, fit_df)) if fit_df > 0 else 1.0,
        equal_statistic=equal,
        equal_df=count - 1,
        equal_p=float(stats.chi2.sf(equal, count - 1)),
        warnings=warnings,
    )


def contrasts(
    wins: Floats, conditions: Sequence[str], model: Model = "thurstone"
) -> tuple[Contrast, ...]:
    """Test every two conditions for equal scores by likelihood ratio, one degree of freedom."""
    votes, _ = _finite_votes(_checked(wins, conditions))
    count = len(conditions)
    first, second = pair_index(count)
    won, lost = votes[first, second], votes[second, first]
    full = np.zeros((first.size, count))
    full[np.arange(first.size), first] = 1.0
    full[np.arange(first.size), second] = -1.0
    free = solve_pairs(full[:, 1:], won, lost, model)
    scores = np.concatenate([[0.0], free.parameters])
    found = []
    for i, j in combinations(range(count), 2):
        merged = full.copy()
        merged[:, i] += merged[:, j]
        keep = [column for column in range(count) if column not in (i, j)]
        tied = solve_pairs(merged[:, keep], won, lost, model)
        statistic = max(0.0, 2.0 * float(free.log_likelihood - tied.log_likelihood))
        found.append(
            Contrast(
                first=conditions[i],
                second=conditions[j],
                difference=float(scores[i] - scores[j]),
                statistic=statistic,
                p=float(stats.chi2.sf(statistic, 1)),
            )
        )
    return tuple(found)


def bootstrap_scores(
    wins: Floats,
    *,
    rng: np.random.Generator,
    samples: int = 1000,
    model: Model = "thurstone",
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
    participants, scene_count, count, _ = wins.shape
    first, second = pair_index(count)
    votes = np.concatenate([wins[..., first, second], wins[..., second, first]], axis=-1)
    weight_p = rng.multinomial(participants, np.full(participants, 1 / participants), samples)
    if scenes and scene_count > 1:
        weight_s = rng.multinomial(scene_count, np.full(scene_count, 1 / scene_count), samples)
    else:
        weight_s = np.ones((samples, scene_count), dtype=np.int64)
    by_person = weight_p @ votes.reshape(participants, -1)
    drawn = np.einsum(
        "bs,bsv->bv", weight_s.astype(np.float64), by_person.reshape(samples, scene_count, -1)
    )
    won, lost = drawn[:, : first.size], drawn[:, first.size :]
    return _batch_scores(won, lost, count, model)


def bootstrap_scale(
    wins: Floats,
    *,
    rng: np.random.Generator,
    samples: int = 1000,
    level: float = 0.95,
    model: Model = "thurstone",
    scenes: bool = True,
) -> ScaleIntervals:
    """Bootstrap intervals of scores that respect participants and scenes.

    Parameters
    ----------
    wins : ndarray (participants, scenes, k, k)

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
    scores = bootstrap_scores(wins, rng=rng, samples=samples, model=model, scenes=scenes)
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
    between = scores[:, :, None] - scores[:, None, :]
    diff_lower, diff_upper = np.quantile(between, [tail, 1.0 - tail], axis=0)
    warnings = []
    if participants < FEW_CLUSTERS:
        warnings.append(f"only {participants} participants: intervals are a rough guide")
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
        standard_error=scores.std(axis=0, ddof=1),
        samples=int(whole.sum()),
        left_out=left_out,
        resampled=("participants", "scenes") if two_way else ("participants",),
        warnings=tuple(warnings),
    )


def expanded_tail(level: float, clusters: int) -> float:
    """Return the bootstrap tail area that gives `level` with few clusters (Hesterberg 2015)."""
    tail = 0.5 * (1.0 - level)
    widened = stats.t.ppf(tail, clusters - 1) * np.sqrt(clusters / (clusters - 1))
    return float(stats.norm.cdf(widened))


def scale_with_ties(
    wins: Floats, ties: Floats, conditions: Sequence[str], model: Model = "thurstone"
) -> TiedScale:
    """Fit scores and a tie threshold where observers could answer "no difference".

    Parameters
    ----------
    wins : ndarray (k, k)
        Votes for i over j.
    ties : ndarray (k, k), symmetric
        How often i and j were called equal (each tie appears in both halves).

    Notes
    -----
    Glenn and David 1960 (Thurstone), Rao and Kupper 1967 (Bradley-Terry). For two conditions
    this is the 2-AC model of signal detection.
    """
    votes = _checked(wins, conditions)
    if ties.shape != votes.shape or not np.allclose(ties, ties.T):
        raise ValueError(f"ties must be symmetric of shape {votes.shape} (got {ties.shape})")
    tied_pairs = np.triu(ties, k=1)
    if not np.all(np.isfinite(ties)) or np.any(ties < 0) or tied_pairs.sum() == 0:
        raise ValueError("ties must be finite, not negative, and not all zero")
    if not bool(has_maximum((votes > 0) | (ties > 0))):
        raise ValueError("no finite scores exist: some conditions always won and never tied")
    count = len(conditions)
    first, second = pair_index(count)
    won, lost, tied = votes[first, second], votes[second, first], ties[first, second]
    design = difference_design(count)
    sigma = 1.0 if model == "bradley-terry" else JOD_SIGMA

    def loss(theta: Floats) -> float:
        difference, threshold = design @ theta[:-1], np.exp(theta[-1])
        up = (difference - threshold) / sigma
        down = (-difference - threshold) / sigma
        cdf = expit if model == "bradley-terry" else ndtr
        middle = np.maximum(1.0 - cdf(up) - cdf(down), 1e-300)
        total = won * log_probability(difference - threshold, model)
        total += lost * log_probability(-difference - threshold, model)
        return -float(np.sum(total + tied * np.log(middle)))

    start = np.zeros(count)
    start[-1] = np.log(0.3 * sigma)
    best = optimize.minimize(loss, start, method="BFGS", options={"gtol": 1e-9})
    best = optimize.minimize(
        loss, best.x, method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-12}
    )
    hessian = numeric_hessian(loss, best.x)
    inverse = np.asarray(np.linalg.inv(hessian), dtype=np.float64)
    scores, covariance = _centred_covariance(best.x[:-1], inverse[:-1, :-1])
    threshold = float(np.exp(best.x[-1]))
    return TiedScale(
        model=model,
        conditions=tuple(conditions),
        scores=scores,
        threshold=threshold,
        covariance=covariance,
        threshold_se=threshold * float(np.sqrt(inverse[-1, -1])),
        log_likelihood=-float(best.fun),
    )


def _batch_scores(won: Floats, lost: Floats, count: int, model: Model) -> Floats:
    """Fit many vote tables; pseudo-votes only where a table has no finite maximum."""
    first, second = pair_index(count)
    beaten = np.zeros((won.shape[0], count, count), dtype=bool)
    beaten[:, first, second] = won > 0
    beaten[:, second, first] = lost > 0
    linked = has_maximum(beaten | beaten.swapaxes(-1, -2))
    infinite = linked & ~has_maximum(beaten)
    if infinite.any():
        extra = PSEUDO_VOTES * ((won + lost) > 0) * infinite[:, None]
        won, lost = won + extra, lost + extra
    scores = np.full((won.shape[0], count), np.nan)
    if linked.any():
        solution = solve_pairs(
            difference_design(count), won[linked], lost[linked], model, tolerance=1e-6
        )
        free = np.concatenate(
            [np.zeros((solution.parameters.shape[0], 1)), solution.parameters], axis=1
        )
        free[~solution.converged] = np.nan
        scores[linked] = free - free.mean(axis=1, keepdims=True)
    return scores


def _checked(wins: Floats, conditions: Sequence[str]) -> Floats:
    votes = np.array(wins, dtype=np.float64)
    count = len(conditions)
    if count < 2 or len(set(conditions)) != count:
        raise ValueError(f"conditions must be at least two distinct names (got {list(conditions)})")
    if votes.shape != (count, count):
        raise ValueError(f"wins must be {count}x{count}, one row per condition (got {votes.shape})")
    if not np.all(np.isfinite(votes)) or np.any(votes < 0):
        raise ValueError("wins must hold finite counts that are not negative")
    np.fill_diagonal(votes, 0.0)
    parts = components(votes > 0, tuple(conditions))
    if len(parts) > 1:
        listed = "; ".join("{" + ", ".join(part) + "}" for part in parts)
        raise ValueError(
            "comparisons must link all conditions for one scale;"
            f" found {len(parts)} separate groups: {listed}"
        )
    return votes


def _finite_votes(votes: Floats) -> tuple[Floats, tuple[str, ...]]:
    if bool(has_maximum(votes > 0)):
        return votes, ()
    return votes + PSEUDO_VOTES * ((votes + votes.T) > 0), (
        "some conditions always won or always lost, so no finite maximum exists;"
        " half a vote was added to both sides of each pair: distances are a lower bound",
    )


def _centred(parameters: Floats, information: Floats) -> tuple[Floats, Floats]:
    return _centred_covariance(parameters, np.asarray(np.linalg.inv(information), dtype=np.float64))


def _centred_covariance(parameters: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Put back the first score, shift the mean to zero."""
    count = parameters.size + 1
    free = np.concatenate([[0.0], parameters])
    whole = np.zeros((count, count))
    whole[1:, 1:] = covariance
    centre = np.eye(count) - 1.0 / count
    return centre @ free, centre @ whole @ centre.T


def _xlogy(count: Floats, share: Floats) -> NDArray[np.float64]:
    safe = np.where(count > 0, share, 1.0)
    return np.asarray(count * np.log(safe))
