"""Pairs of conditions that are compared, and Wald's comparisons of their estimates."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from analysis.arrays import Floats, Ints
from analysis.models.clustered import held_p, holm, least_p, two_way_df, weighted_df
from analysis.models.numeric import ROUNDING, two_sided_p, two_sided_quantile, zeroed
from protocols.errors import StudyError
from protocols.limits import FIXED

Pair = tuple[str, str]
MOST_CONDITIONS = FIXED["conditions"].most

MOST_IN_PAIRS = 8
"""Conditions of which all pairs are compared, and by likelihood ratios where a model is mixed."""
MEAN = "the mean of all"
"""In place of a pair's second condition: with this each of more conditions is compared."""

IN_CONDITION = " x condition"
"""After the name of a random effect: what a level adds to itself in one condition."""


@dataclass(frozen=True)
class Difference:
    """Difference between two conditions, first minus second, with limits that respect the clusters.

    `p_adjusted` is Holm's over the contrasts made together.
    """

    measure: str
    first: str
    second: str
    difference: float
    standard_error: float
    lower: float
    upper: float
    level: float
    df: float
    p: float
    p_adjusted: float

    @property
    def t(self) -> float:
        """Difference in standard errors."""
        return self.difference / max(self.standard_error, 1e-12)

    @property
    def held(self) -> str:
        """Reason that holds p above that of t; empty if there is none."""
        return held_p(self.t, self.df, self.p)


def unidentified(one: Difference) -> Difference:
    """Return a comparison that the data do not identify: without numbers."""
    nan = math.nan
    one = replace(one, difference=nan, standard_error=nan, lower=nan, upper=nan)
    return replace(one, df=nan, p=nan, p_adjusted=nan)


def check_conditions(count: int) -> None:
    """Refuse to compare what can hardly be conditions: a column of file names, say.

    Raises
    ------
    StudyError
        If there are more than `MOST_CONDITIONS`.
    """
    if count > MOST_CONDITIONS:
        raise StudyError(
            f"at most {MOST_CONDITIONS} conditions must be compared (found {count:,}); name the"
            " column that holds them, or leave rows out with --where"
        )


def pairs_of(names: Iterable[str], reference: str | None) -> list[Pair]:
    """Return all pairs of conditions, or each with the one that others are compared with.

    Of more than `MOST_IN_PAIRS` each is compared with that one, or the first, and with their mean.

    Raises
    ------
    ValueError
        If `reference` is no condition.
    StudyError
        If there are more conditions than a study compares.
    """
    known = list(names)
    check_conditions(len(known))
    many = len(known) > MOST_IN_PAIRS
    if reference is None and not many:
        return list(combinations(known, 2))
    reference = known[0] if reference is None else reference
    if reference not in known:
        raise ValueError(f"reference must be one of {known} (got {reference!r})")
    own = [(name, reference) for name in known if name != reference]
    return own + [(name, MEAN) for name in known] * many


ONE_SIDED = 0.1
"""Ratio of what a level gives to both sides, less by more, up to which it is of one side alone."""


@dataclass(frozen=True)
class CrossedDesign:
    """Participants and scenes that saw a mixed model's conditions, for degrees of freedom.

    Attributes
    ----------
    shares : mapping of "participant" and, where there are several, "scene" to ndarray
        (levels, conditions): which part of a condition's trials each level has.
    sd : mapping
        Deviations by name of the random effect: of both, and of both in one condition
        (`IN_CONDITION` after the name).
    """

    shares: Mapping[str, Floats]
    sd: Mapping[str, float]

    @classmethod
    def of(
        cls, condition: Ints, groups: Mapping[str, Ints], sd: Mapping[str, float]
    ) -> "CrossedDesign":
        """Count trials; codes (trials,) from 0."""
        shares = {}
        for name, code in groups.items():
            table = np.zeros((int(code.max()) + 1, int(condition.max()) + 1))
            np.add.at(table, (code, condition), 1.0)
            shares[name] = table / table.sum(axis=0)
        return cls(shares, {name: float(np.nan_to_num(value)) for name, value in sd.items()})

    def covariance(self, name: str) -> Floats:
        """Return participants', or scenes', part of the covariance of the conditions' means."""
        share, own = self.shares[name], self.sd.get(name + IN_CONDITION, 0.0) ** 2
        together: Floats = self.sd.get(name, 0.0) ** 2 * share.T @ share
        return together + own * np.diag(np.sum(share**2, axis=0))

    def df(self, contrast: Floats, variance: float) -> float:
        """Return the degrees of freedom of a contrast (conditions,) with this variance.

        As of a share that is clustered by participants and scenes (`clustered.two_way_df`): what
        is left of the variance counts for participants, and half of it for scenes.
        """
        parts, degrees = [], []
        for name, share in self.shares.items():
            parts.append(float(contrast @ self.covariance(name) @ contrast))
            sides = share @ contrast.clip(min=0.0), share @ (-contrast).clip(min=0.0)
            degrees.append(_levels_df(*sides))
        rest = max(variance - sum(parts), 0.0)
        weights = np.array(parts) + rest * np.array([1.0, 0.5])[: len(parts)]
        if not weights.any():
            return degrees[0]
        return float(two_way_df(list(weights), [np.asarray(df) for df in degrees]))


def _levels_df(first: Floats, second: Floats) -> float:
    """Return the degrees of freedom of participants, or of scenes, on the sides of a contrast.

    Where all are on one side alone, as in groups of people who saw one condition each, these are
    two samples, and the mean of the second takes another degree; 1 is left.

    Parameters
    ----------
    first, second : ndarray (levels,)
        What each gives to either side, 0 or more.
    """
    every = float(weighted_df(first + second)[1])
    less, more = np.minimum(first, second), np.maximum(first, second)
    sides = sorted((first.sum(), second.sum()))
    two = bool(np.all(less <= ONE_SIDED * more)) and sides[0] > ONE_SIDED * sides[1]
    return max(every - two, min(every, 1.0))


@dataclass(frozen=True)
class Effect:
    """A random effect of a model of trials, for degrees of freedom of its coefficients.

    `group` holds the participant or scene of each trial, `level` the level of the effect, and
    `times` what it is multiplied by (None: 1).
    """

    scene: bool
    group: Ints
    level: Ints
    times: Floats | None
    sd: float


def between_df(influence: Floats, effects: Sequence[Effect], variance: float) -> float:
    """Return the degrees of freedom of a coefficient, between those of participants and scenes.

    As of `CrossedDesign.df`, for any design: each group counts by the variance that its effects
    give to the coefficient.

    Parameters
    ----------
    influence : ndarray (trials,)
        What each trial adds to the coefficient.
    """
    parts: dict[bool, float] = {}
    degrees: dict[bool, Floats] = {}
    for one in effects:
        own = influence if one.times is None else influence * one.times
        given = one.sd**2 * float(np.sum(np.bincount(one.level, weights=own) ** 2))
        parts[one.scene] = parts.get(one.scene, 0.0) + given
        first, second = (
            np.asarray(np.bincount(one.group, weights=side.clip(min=0.0)), dtype=np.float64)
            for side in (influence, -influence)
        )
        degrees[one.scene] = np.asarray(_levels_df(first, second))
    rest = max(variance - math.fsum(parts.values()), 0.0)
    weights = [own + (0.5 if scene and len(parts) > 1 else 1.0) * rest
               for scene, own in parts.items()]  # fmt: skip
    return float(two_way_df([np.asarray(own) for own in weights], list(degrees.values())))


def holm_where_known(values: Sequence[float]) -> list[float]:
    """Return Holm's p of each; NaN where there is none."""
    p = np.array(values)
    known = np.isfinite(p)
    adjusted = np.full(p.size, math.nan)
    adjusted[known] = holm(p[known]) if known.any() else ()
    return [float(one) for one in adjusted]


def wald(
    measure: str, names: Sequence[str], pairs: Sequence[Pair], value: Floats, covariance: Floats,
    *, crossed: CrossedDesign, level: float,
) -> list[Difference]:  # fmt: skip
    """Compare conditions by their values (names,) and the covariance of these."""
    if not pairs:
        return []
    units = dict(zip(names, np.eye(len(names)), strict=True))
    units.setdefault(MEAN, np.full(len(names), 1.0 / len(names)))
    weights = np.array([units[first] - units[second] for first, second in pairs])
    variance = np.sum(weights @ covariance * weights, axis=1).clip(min=1e-300)
    df = [crossed.df(own, float(one)) for own, one in zip(weights, variance, strict=True)]
    return _compared(measure, pairs, weights @ value, np.sqrt(variance), np.array(df), level)


def _compared(
    measure: str, pairs: Sequence[Pair], gap: Floats, error: Floats, df: Floats, level: float
) -> list[Difference]:
    reach = two_sided_quantile(level, df) * error
    p = two_sided_p(zeroed(gap, 1e-3) / np.maximum(error, 1e-12), df)
    adjusted = holm(p) if p.size else p
    levels = np.full(p.size, level)
    table = np.column_stack([gap, error, gap - reach, gap + reach, levels, df, p, adjusted])
    return [
        Difference(measure, *pair, *row) for pair, row in zip(pairs, table.tolist(), strict=True)
    ]


def crossed_means_p(gap: Floats) -> Floats:
    """Return p of mean differences (studies, participants, scenes), both of them random.

    Near the likelihood ratio that decides in a mixed model, in closed form: variances as maximum
    likelihood has them; of the mean of n numbers the ratio is n log(1 + t^2 / n), where n is of
    those, people or scenes, that are more. Its root is judged by t, with degrees of freedom as
    `CrossedDesign`. Scenes that lack a condition are NaN, and left out. Where all numbers agree, p
    is 1 at 0, and else the least that so many people can show. Differences are of order 1.
    """
    gap = zeroed(gap)
    both = ~np.isnan(gap).any(axis=(0, 1))
    gap = gap[..., both] if both.any() else np.nanmean(gap, axis=-1, keepdims=True)
    people, scenes = gap.shape[1:]
    mean = gap.mean(axis=(1, 2), keepdims=True)
    person, scene = gap.mean(axis=2, keepdims=True) - mean, gap.mean(axis=1, keepdims=True) - mean
    free = people - 1.0, max(scenes - 1.0, 1.0)
    rest = ((gap - mean - person - scene) ** 2).mean(axis=(1, 2)) / np.prod(free)
    own = [
        np.maximum((one**2).mean(axis=(1, 2)) / count - rest, 0.0)
        for one, count in zip((person, scene), (people, scenes), strict=True)
    ]
    df = two_way_df(
        [own[0] + rest, own[1] + 0.5 * rest], [np.array(people - 1.0), np.array(scenes - 1.0)]
    )
    error = np.sqrt(own[0] + own[1] + rest)
    agree = error <= ROUNDING
    count, middle = float(max(people, scenes)), mean[:, 0, 0]
    ratio = count * np.log1p((middle / np.where(agree, 1.0, error)) ** 2 / count)
    alike = np.where(np.abs(middle) <= ROUNDING, 1.0, least_p(people))
    return np.where(agree, alike, two_sided_p(np.sqrt(ratio), np.where(agree, 1.0, df)))
