"""Inference on a share when trials cluster in participants and scenes.

Trials of one participant, or of one scene, are more alike than others. Every function takes
`chosen` and `shown`, counts of shape (..., participants, scenes); leading axes are batches, so
the simulation of ten thousand studies is one call.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from analysis.arrays import Bools, Floats
from analysis.models.numeric import two_sided_p, two_sided_quantile
from protocols.errors import count_of

EXACT_FLIPS = 16
"""Up to this many participants every sign pattern is enumerated."""

MONTE_CARLO_FLIPS = 100_000
FLIPS_AT_ONCE = 5_000

SAME = 1e-12
"""Shares nearer than this are the same: rounding is no effect."""

FEW_SCENES = 5
"""Below this the test leans to the safe side, and still cannot be trusted; results say so."""

LEAST_OF_SCENES = 0.1
"""Variance between scenes, as a share of that between people, that so few scenes do not rule out.

Divided by their degrees of freedom: with two scenes, many people alone never make p small."""


TWO_ALONE = 1.5
"""Degrees of freedom below which a sample is of two: what they differ by says too little of what
their mean is worth for degrees that are weighted by it."""


@dataclass(frozen=True)
class ClusteredShare:
    """A share with a standard error that respects participants and scenes.

    Attributes
    ----------
    share, standard_error, df : ndarray (...)
        `standard_error` is 0 where all answers agree; no t exists there.
    effective_n : ndarray (...)
        Independent trials that would give the same standard error, at most the trials shown.
    trials, persons : ndarray (...)

    Notes
    -----
    `p_value` and `limits` are one procedure, so that p < 1 - level exactly where the limits leave
    out the null (docs/decisions/0160). p is the largest of three: of the clustered score test,
    (share - null) / sqrt(null (1 - null) / n) against t with n = share (1 - share) / error^2; of
    the score test of independent trials, because people who agree by luck tell no more than
    their trials do; and of unanimous participants, 2 null^persons. The first two are inverted by
    Wilson's limits, whose quantile^2 / n is the larger of both (Korn and Graubard 1998 cap their
    effective n by the same rule). Unanimous participants are votes: their p is the third, and
    their limits reach at least as far in as the exact ones of participants.
    """

    share: Floats
    standard_error: Floats
    df: Floats
    effective_n: Floats
    trials: Floats
    persons: Floats

    def score_t(self, null: float = 0.5) -> Floats:
        """Return the clustered score test's t; infinite where participants agree off the null."""
        gap = self.share - null
        gap = np.where(np.abs(gap) < SAME, 0.0, gap)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = gap * np.sqrt(self._size() / (null * (1.0 - null)))
        return np.asarray(np.where(gap == 0.0, 0.0, ratio))

    def p_parts(self, null: float = 0.5) -> tuple[Floats, Floats, Floats]:
        """Return p of the clustered test, of independent trials, and of unanimous participants."""
        gap = np.abs(self.share - null)
        z = np.where(gap < SAME, 0.0, gap) * np.sqrt(self.trials / (null * (1.0 - null)))
        toward = np.where(self.share > null, null, 1.0 - null)
        return (
            two_sided_p(self.score_t(null), self.df),
            two_sided_p(z),
            least_p(self.persons, toward),
        )

    def p_value(self, null: float = 0.5) -> Floats:
        """Return the two-sided p of share = null."""
        clustered, independent, floor = self.p_parts(null)
        p = np.where(
            self._unanimous(), floor, np.maximum(np.maximum(clustered, independent), floor)
        )
        return np.asarray(np.where(np.abs(self.share - null) < SAME, 1.0, p))

    def held(self, null: float = 0.5) -> str:
        """Say that one share's p is the least that so many participants can show; "" if not."""
        clustered, independent, floor = (float(part) for part in self.p_parts(null))
        if float(self.p_value(null)) != floor or max(clustered, independent) >= floor:
            return ""
        return _held(floor, int(self.persons))

    def limits(self, level: float = 0.95, null: float = 0.5) -> tuple[Floats, Floats]:
        """Return the limits that leave out `null` exactly where its p is below 1 - level."""
        share, tail = self.share, 0.5 + 0.5 * level
        inverse = np.maximum(
            two_sided_quantile(level) ** 2 / self.trials,
            two_sided_quantile(level, self.df) ** 2 / self._size(),
        )
        centre = (share + 0.5 * inverse) / (1.0 + inverse)
        half = np.sqrt(share * (1.0 - share) * inverse + 0.25 * inverse**2) / (1.0 + inverse)
        # Rounding must not push a limit past the share itself.
        low = np.minimum(np.clip(centre - half, 0.0, 1.0), share)
        high = np.maximum(np.clip(centre + half, 0.0, 1.0), share)
        edge = (1.0 - tail) ** (1.0 / self.persons)
        low = np.where(share == 1.0, np.maximum(low, edge), low)
        high = np.where(share == 0.0, np.minimum(high, 1.0 - edge), high)
        few = self.p_parts(null)[2] >= 1.0 - level
        low = np.where(few & (share > null), np.minimum(low, null), low)
        high = np.where(few & (share < null), np.maximum(high, null), high)
        return np.asarray(low), np.asarray(high)

    def equivalence_p(self, margin: float, null: float = 0.5) -> Floats:
        """Return the TOST p of |share - null| < margin: the larger of two one-sided ones.

        Schuirmann 1987, with the one-sided halves of `p_value`: p < alpha exactly where the
        limits at 1 - 2 alpha lie inside the margin. Unanimous answers show no equivalence.
        """
        low, high = null - margin, null + margin
        half_low, half_high = 0.5 * self.p_value(low), 0.5 * self.p_value(high)
        below = np.where(self.share > low, half_low, 1.0 - half_low)
        above = np.where(self.share < high, half_high, 1.0 - half_high)
        return np.asarray(np.where(self._unanimous(), 1.0, np.maximum(below, above)))

    def _unanimous(self) -> Bools:
        return np.asarray((self.share == 0.0) | (self.share == 1.0))

    def _size(self) -> Floats:
        """Trials that the clustered error stands for, infinite where participants agree."""
        with np.errstate(divide="ignore", invalid="ignore"):
            size = self.share * (1.0 - self.share) / self.standard_error**2
        return np.asarray(
            np.where(
                self._unanimous(), self.trials, np.where(self.standard_error > 0, size, np.inf)
            )
        )


@dataclass(frozen=True)
class ClusteredEstimate:
    """An estimate with a standard error that respects participants and scenes.

    Attributes
    ----------
    value, standard_error, df : ndarray (...)
    persons : ndarray (...)
        Participants it rests on: no p falls below `sign_flip_floor` of them.
    """

    value: Floats
    standard_error: Floats
    df: Floats
    persons: Floats

    def p_value(self, null: float = 0.0) -> Floats:
        """Return the two-sided p of t, at least the sign-flip floor of the participants."""
        gap = np.abs(self.value - null)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(gap > 1e-12, gap / self.standard_error, 0.0)
        p = two_sided_p(ratio, np.maximum(self.df, 1e-9))
        return np.asarray(np.maximum(p, np.where(gap > 1e-12, self._floor(), 0.0)))

    def limits(self, level: float = 0.95, null: float = 0.0) -> tuple[Floats, Floats]:
        """Return t limits; they hold `null` exactly where its p is above 1 - level."""
        reach = two_sided_quantile(level, self.df) * self.standard_error
        lower, upper = self.value - reach, self.value + reach
        few = self._floor() > 1.0 - level
        lower = np.where(few, np.minimum(lower, null), lower)
        return np.asarray(lower), np.asarray(np.where(few, np.maximum(upper, null), upper))

    def _floor(self) -> Floats:
        return least_p(self.persons)


def least_p(people: Floats | float, toward: Floats | float = 0.5) -> Floats:
    """Return the least two-sided p that so many participants can show, if all agree.

    `toward` is the chance that one of them answers so where there is nothing to find.
    """
    return np.asarray(np.minimum(1.0, 2.0 * np.asarray(toward) ** people))


def held_p(t: float, df: float, p: float) -> str:
    """Say that p of a `ClusteredEstimate` is the least that its participants show; "" if not."""
    held = float(two_sided_p(t, df)) < (1.0 - 1e-9) * p
    return _held(p, round(1.0 - math.log2(p))) if held else ""


def _held(p: float, people: int) -> str:
    return (
        f"p is held at {p:.2g}, the least that {count_of(people, 'participant')} can show without"
        " assuming a normal distribution"
    )


def two_way(chosen: Floats, shown: Floats) -> ClusteredShare:
    """Estimate a share clustered by participant and by scene.

    Parameters
    ----------
    chosen, shown : ndarray (..., participants, scenes)
        How often the method was chosen, and how often it was shown, per cell; a cell never
        shown holds 0. With one scene this is the one-way test by participants.

    Notes
    -----
    V = max(V_p + V_s - V_e, V_p): the two-way cluster variance (Cameron, Gelbach and Miller
    2011; for a balanced design the quasi-F of Clark 1973), never below the variance between
    participants. The degrees of freedom lie between those of participants and of scenes,
    weighted by what each contributes. With fewer than five scenes both lean to the safe side.
    Choice and false-positive rates: docs/decisions/0051.
    """
    chosen, shown = np.asarray(chosen, dtype=np.float64), np.asarray(shown, dtype=np.float64)
    shown = np.broadcast_to(shown, chosen.shape)
    total = shown.sum(axis=(-2, -1))
    share = chosen.sum(axis=(-2, -1)) / total
    residual = chosen - shown * share[..., None, None]
    return _combined(share, total, _variances(residual, shown, total**2))


def limits_by_scene(chosen: Floats, shown: Floats, level: float) -> tuple[Floats, Floats]:
    """Return limits (scenes,) of the share in each scene, of people like those who saw it.

    They are NaN where fewer than two did.

    Parameters
    ----------
    chosen, shown : ndarray (participants, scenes)
        As of `two_way`; each scene was shown.
    """
    found = two_way(chosen.T[..., None], shown.T[..., None])
    lower, upper = (np.where(found.persons > 1.0, end, np.nan) for end in found.limits(level))
    return lower, upper


def two_way_of_first(chosen: Floats, shown: Floats, people: Sequence[int]) -> ClusteredShare:
    """Return `two_way` of the first n participants of simulated studies, for every n.

    Parameters
    ----------
    chosen : ndarray (studies, participants, scenes)
    shown : ndarray (scenes,)
        Trials of each participant, above 0 in every scene.
    people : sequence of int
        Every n.

    Returns
    -------
    ClusteredShare
        Of shape (studies, numbers of participants); where scenes are shown equally often, from
        running sums.
    """
    if np.ptp(shown) > 0.0:
        each = [two_way(chosen[:, :count], shown) for count in people]
        return ClusteredShare(
            **{name: np.stack([vars(one)[name] for one in each], axis=-1) for name in vars(each[0])}
        )
    picks, scenes = np.array(people, dtype=np.intp) - 1, chosen.shape[-1]
    rows = chosen.sum(axis=-1)
    total = np.cumsum(rows, axis=-1)[:, picks]
    row_squares = np.cumsum(rows**2, axis=-1)[:, picks]
    cell_squares = np.cumsum(np.einsum("ijk,ijk->ij", chosen, chosen), axis=-1)[:, picks]
    columns = np.cumsum(chosen, axis=1)[:, picks]
    column_squares = np.einsum("ijk,ijk->ij", columns, columns)
    persons = (picks + 1).astype(np.float64)
    trials = persons * float(shown.sum())
    mean_square = total**2 / persons
    var_person = (row_squares - mean_square) / trials**2 * persons / (persons - 1.0)
    var_scene = var_cell = np.zeros_like(var_person)
    if scenes > 1:
        var_scene = (column_squares - total**2 / scenes) / trials**2 * scenes / (scenes - 1.0)
        residual = cell_squares - row_squares / scenes - column_squares / persons
        residual += mean_square / scenes
        var_cell = residual / trials**2 * persons * scenes / ((persons - 1.0) * (scenes - 1.0))
    parts = Variances(
        person=np.maximum(var_person, 0.0),
        scene=np.maximum(var_scene, 0.0),
        cell=np.maximum(var_cell, 0.0),
        persons=persons,
        scenes=np.full_like(persons, scenes),
        person_df=persons - 1.0,
        scene_df=np.full_like(persons, scenes - 1.0),
    )
    return _combined(total / trials, trials, parts)


def two_way_influence(
    estimate: Floats, influence: Floats, shown: Floats, least: Floats | float = 0.0
) -> ClusteredEstimate:
    """Give any smooth statistic of the trials an error that respects participants and scenes.

    Parameters
    ----------
    estimate : ndarray (...)
    influence : ndarray (..., participants, scenes)
        Sum of the trials' influence on the estimate in each cell (first-order: its derivative
        in a share times the trial's deviation from that share, over the number of trials).
    shown : ndarray (..., participants, scenes)
        Trials in each cell.
    least : ndarray (...) or float
        Variance to assume at least, such as the one of independent trials: where all answers
        agree the influence is 0 and says nothing.

    Notes
    -----
    The rule of `two_way`, which it equals for a share.
    """
    influence = np.array(influence, dtype=np.float64)
    shown = np.broadcast_to(np.asarray(shown, dtype=np.float64), influence.shape)
    return _estimated(estimate, _variances(influence, shown, np.asarray(1.0)), least)


def two_way_difference(
    estimate: Floats,
    influences: tuple[Floats, Floats],
    shown: tuple[Floats, Floats],
    least: Floats | float = 0.0,
) -> ClusteredEstimate:
    """Give a difference of two statistics an error, whoever and whatever was seen for which.

    Parameters
    ----------
    influences, shown : two of ndarray (..., participants, scenes)
        As of `two_way_influence`, of each statistic on one grid.

    Notes
    -----
    Participants, or scenes, that no two share are two samples: their variances add up, each about
    its own mean, with the degrees of freedom of Welch and Satterthwaite; where one is of two
    people, or scenes, with the one degree that these have.
    """
    first, second = (np.array(one, dtype=np.float64) for one in influences)
    parts = _variances(first - second, shown[0] + shown[1], np.asarray(1.0))
    apart = [
        way
        for axis, way in ((-1, "person"), (-2, "scene"))
        if not np.any((shown[0].sum(axis=axis) > 0) & (shown[1].sum(axis=axis) > 0))
    ]
    if apart:
        ones = zip((first, second), shown, strict=True)
        own = [vars(_variances(*one, np.asarray(1.0))) for one in ones]
        changed = {"cell": own[0]["cell"] + own[1]["cell"]}
        for way in apart:
            each = [(one[way], one[f"{way}_df"]) for one in own]
            variance, df = (np.asarray(sum(values)) for values in zip(*each, strict=True))
            spread = sum(known**2 / np.maximum(free, 1e-9) for known, free in each)
            with np.errstate(divide="ignore", invalid="ignore"):
                welch = np.where(spread > 0, variance**2 / spread, df)
            fewest = np.minimum(each[0][1], each[1][1])
            welch = np.where(fewest < TWO_ALONE, np.minimum(fewest, welch), welch)
            changed |= {way: variance, f"{way}_df": welch}
        if "scene" in apart:
            changed["scenes"] = np.asarray(own[0]["scenes"] + own[1]["scenes"] - 1.0)
        parts = replace(parts, **changed)
    return _estimated(estimate, parts, least)


def _estimated(estimate: Floats, parts: "Variances", least: Floats | float) -> ClusteredEstimate:
    variance, df = _two_way_variance(parts)
    return ClusteredEstimate(
        value=np.asarray(estimate, dtype=np.float64),
        standard_error=np.sqrt(np.maximum(variance, least)),
        df=np.asarray(df),
        persons=parts.persons,
    )


@dataclass(frozen=True)
class Variances:
    """Variances of a mean, which `two_way` puts together (...), and their degrees of freedom.

    Attributes
    ----------
    person, scene, cell : ndarray
        Between participants, between scenes (0 where there is one), within cells.
    persons, scenes : ndarray
        How many there are; of two samples of scenes, how many one sample of as many degrees has.
    person_df, scene_df : ndarray
        One less than how many there are, where all were seen equally often (`weighted_df`).
    """

    person: Floats
    scene: Floats
    cell: Floats
    persons: Floats
    scenes: Floats
    person_df: Floats
    scene_df: Floats


def weighted_df(shown: Floats) -> tuple[Floats, Floats]:
    """Return the factor of a variance between clusters, and its degrees of freedom.

    Parameters
    ----------
    shown : ndarray (..., clusters)
        Trials of each; 0 of a cluster that is not there.

    Notes
    -----
    Of G clusters that were seen equally often G / (G - 1), and G - 1. Else a sum of squares of
    w_g (b_g - mean), with w each cluster's share of the trials and the mean weighted likewise, has
    an expectation and a variance (b independent and normal, of one variance): the factor mends
    the one, and the degrees are twice its square by the other (Satterthwaite 1946; for clusters
    Bell and McCaffrey 2002). One cluster alone has no
    factor (NaN), and 0 degrees.
    """
    share = shown / shown.sum(axis=-1, keepdims=True)
    m2, m3, m4, m5 = ((share**power).sum(axis=-1) for power in (2, 3, 4, 5))
    kept = np.where(m2 < 1.0 - SAME, m2 - 2.0 * m3 + m2**2, np.nan)
    squares = m2**4 - 4.0 * m2**2 * m3 + 4.0 * m2 * m4 + 2.0 * m3**2 - 4.0 * m5 + m4
    with np.errstate(invalid="ignore"):
        return np.asarray(m2 / kept), np.where(np.isnan(kept), 0.0, kept**2 / squares)


def _variances(residual: Floats, shown: Floats, squared: Floats) -> Variances:
    """Return the variances of sums `residual` (..., participants, scenes), which is used up.

    `squared` divides their squares.
    """
    by_person, by_scene = residual.sum(axis=-1), residual.sum(axis=-2)
    shown_person, shown_scene = shown.sum(axis=-1), shown.sum(axis=-2)
    persons = (shown_person > 0).sum(axis=-1).astype(np.float64)
    scenes = (shown_scene > 0).sum(axis=-1).astype(np.float64)
    cells = (shown > 0).sum(axis=(-2, -1)).astype(np.float64)
    person_factor, person_df = weighted_df(shown_person)
    scene_factor, scene_df = weighted_df(shown_scene)
    # Few cells seen leave no residual of their own to speak of: what they hold is the most it is.
    most = np.einsum("...ps,...ps->...", residual, residual) / squared
    most = np.where(cells < persons * scenes, most, np.inf)
    person_shift = by_person / np.maximum(shown_person, 1.0)
    scene_shift = by_scene / np.maximum(shown_scene, 1.0)
    residual -= shown * (person_shift[..., :, None] + scene_shift[..., None, :])
    several = scenes > 1.0
    var_person = np.einsum("...p,...p->...", by_person, by_person) / squared * person_factor
    var_scene = np.einsum("...s,...s->...", by_scene, by_scene) / squared * scene_factor
    var_cell = np.einsum("...ps,...ps->...", residual, residual) / squared
    var_cell *= cells / np.maximum(cells - persons - scenes + 1.0, 1.0)
    var_cell = np.minimum(var_cell, most)
    return Variances(
        person=var_person,
        scene=np.where(several, var_scene, 0.0),
        cell=np.where(several, var_cell, 0.0),
        persons=persons,
        scenes=scenes,
        person_df=person_df,
        scene_df=scene_df,
    )


def _combined(share: Floats, total: Floats, parts: Variances) -> ClusteredShare:
    """Put the three variances of `two_way` together."""
    variance, df = _two_way_variance(parts)
    with np.errstate(divide="ignore", invalid="ignore"):
        effective = np.where(variance > 0, share * (1.0 - share) / variance, parts.persons)
    return ClusteredShare(
        share=np.asarray(share),
        standard_error=np.sqrt(variance),
        df=np.asarray(df),
        effective_n=np.minimum(effective, total),
        trials=np.asarray(total, dtype=np.float64),
        persons=np.asarray(parts.persons, dtype=np.float64),
    )


def _two_way_variance(parts: Variances) -> tuple[Floats, Floats]:
    """Return the two-way variance and its degrees of freedom."""
    few = (parts.scenes > 1.0) & (parts.scenes < FEW_SCENES)
    # Two or three scenes that happen to agree say little: assume some variance between them,
    # and, where many people leave no other doubt, a share of what there is between people.
    free = np.maximum(parts.scene_df, 1.0)
    like_people = LEAST_OF_SCENES * parts.person * parts.persons / (free * (free + 1.0))
    like_people = np.where(few, like_people, 0.0)
    assumed = np.maximum(np.where(few, 0.5 * parts.cell / free, 0.0), like_people)
    variance = np.maximum(parts.person + parts.scene - parts.cell, parts.person + assumed)
    # Rounding leaves about 1e-33 where all answers agree.
    variance = np.where(variance < 1e-20, 0.0, variance)
    weight_p = np.maximum(parts.person, parts.cell)
    weight_s = np.maximum(parts.scene - np.where(few, 0.0, 0.5 * parts.cell), like_people)
    df = two_way_df([weight_p, weight_s], [parts.person_df, parts.scene_df])
    return np.asarray(variance), np.where(variance > 0, df, parts.person_df)


def two_way_df(weights: Sequence[Floats], degrees: Sequence[Floats]) -> Floats:
    """Return degrees of freedom (...) between those of several ways, weighted by variance."""
    squares = [np.asarray(weight) ** 2 for weight in weights]
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = [
            np.where(np.asarray(df) > 0, square / df, 0.0)
            for square, df in zip(squares, degrees, strict=True)
        ]
        return np.asarray(sum(squares) / sum(spread))


def sign_flip_p(deviations: Floats, *, seed: int = 0) -> float:
    """Return the two-sided p of a mean of zero by flipping the participants' signs.

    Parameters
    ----------
    deviations : ndarray (participants,)
        Share of each participant minus the null.

    Notes
    -----
    Exact up to 16 participants: every one of the 2^n patterns, so p cannot fall below
    `sign_flip_floor`. Above, 100,000 seeded patterns with the observed one counted in.
    """
    values = np.asarray(deviations, dtype=np.float64)
    count = values.size
    if count == 0:
        return 1.0
    observed = abs(values.sum()) - 1e-9
    if count <= EXACT_FLIPS:
        codes = np.arange(2 ** (count - 1))[:, None] >> np.arange(count)[None, :] & 1
        sums = (1.0 - 2.0 * codes) @ values
        return float((np.abs(sums) >= observed).mean())
    hits = 0
    for packed in np.array_split(_flips(count, seed), MONTE_CARLO_FLIPS // FLIPS_AT_ONCE):
        up = np.unpackbits(packed, axis=1, count=count).astype(np.float64)
        hits += int((np.abs(2.0 * (up @ values) - values.sum()) >= observed).sum())
    return (hits + 1) / (MONTE_CARLO_FLIPS + 1)


@lru_cache(maxsize=1)
def _flips(count: int, seed: int) -> NDArray[np.uint8]:
    """Random sign patterns, eight to a byte; one study asks for the same ones again and again."""
    drawn = np.random.default_rng(seed).bytes(MONTE_CARLO_FLIPS * (-(-count // 8)))
    return np.frombuffer(drawn, dtype=np.uint8).reshape(MONTE_CARLO_FLIPS, -1)


def sign_flip_floor(participants: int) -> float:
    """Return the smallest p a two-sided sign-flip test of so many participants can give."""
    if participants <= EXACT_FLIPS:
        return min(1.0, 2.0 / 2.0**participants)
    return 1.0 / (MONTE_CARLO_FLIPS + 1)


def participant_t(values: Floats) -> tuple[float, float, float, float]:
    """Return mean, standard error, df and two-sided p of a one-sample t against 0.

    p is 1 where all values are 0, and NaN where they agree on another value: no variance.
    """
    values = np.asarray(values, dtype=np.float64)
    count = values.size
    mean = float(values.mean())
    if count < 2:
        return mean, float("nan"), 0.0, float("nan")
    error = float(values.std(ddof=1) / np.sqrt(count))
    if error < 1e-12:
        return mean, 0.0, float(count - 1), 1.0 if abs(mean) < 1e-12 else float("nan")
    return mean, error, float(count - 1), float(two_sided_p(mean / error, count - 1))


def holm(p_values: Floats) -> Floats:
    """Return Holm's step-down adjusted p-values along the last axis (Holm 1979)."""
    p_values = np.asarray(p_values, dtype=np.float64)
    count = p_values.shape[-1]
    order = np.argsort(p_values, axis=-1, kind="stable")
    ranked = np.take_along_axis(p_values, order, axis=-1) * np.arange(count, 0, -1)
    adjusted = np.minimum(np.maximum.accumulate(ranked, axis=-1), 1.0)
    result = np.empty_like(adjusted)
    np.put_along_axis(result, order, adjusted, axis=-1)
    return result
