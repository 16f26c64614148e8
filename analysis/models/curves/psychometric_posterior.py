"""Psychometric functions by their posterior: priors on rates, answers that vary more than chance.

The model of Schütt et al. 2016 ("Painfree and accurate Bayesian estimation of psychometric
functions for (potentially) overdispersed data", Vision Research 122, 105-123), with its priors.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import betaln, expit, log_expit, logit

from analysis.arrays import Floats
from analysis.models.clustered import holm
from analysis.models.contrasts import check_conditions
from analysis.models.curves.response import TWO_ALTERNATIVES, CurveForm, axis_of
from analysis.models.numeric import ROUNDING, zeroed
from protocols.adaptive.answer_history import Shape
from protocols.adaptive.psychometric_function import sigmoid

PRIOR = (1.0, 10.0)
"""Beta law of the lapse rate, of a guess rate that is fitted, and of the overdispersion."""

RATE_MAX = 0.5
SPREAD_MAX = 0.999
LEAST_SPREAD = 1e-3
"""Below, the beta-binomial law is the binomial one to all digits that matter."""

EVEN_FROM = 2.0
"""Least gaps of two levels, from which on the prior of widths is even."""

FAR = 12.0
"""Log density below the highest at which the grid may end."""

COARSE = {"threshold": 25, "width": 25, "guess": 7, "lapse": 9, "spread": 9}
FINE = {"threshold": 41, "width": 37, "guess": 9, "lapse": 13, "spread": 13}

NODES = np.linspace(-21.0, 21.0, 1201)
"""Logits of shares at which likelihoods are tabulated."""

PARTS = 400
"""Each marginal stands for so many equally likely values where two are compared."""

PLACED_BY_PRIOR = (
    "the threshold lies outside the levels shown: its prior decides with it, and it has no number"
)
LIMITS_OF_PRIOR = (
    "the answers hardly place the threshold: its limits are those of the prior, and left out"
)
WIDTH_OF_LEVELS = (
    "the width is near the gap between two levels: these bound it from above alone, and the lower"
    " limit is that of a step"
)


@dataclass(frozen=True)
class Marginal:
    """The posterior of one number: values and their density, which integrates to one."""

    values: Floats
    density: Floats

    @property
    def mean(self) -> float:
        """Return the mean."""
        return float(np.trapezoid(self.values * self.density, self.values))

    @property
    def mode(self) -> float:
        """Return the value of the highest density, the first where it is level."""
        return float(self.values[np.argmax(self.density >= (1.0 - ROUNDING) * self.density.max())])

    def quantile(self, share: Floats | float) -> Floats:
        """Return the place where the distribution function reaches `share`."""
        if self.values.size == 1:
            return np.full(np.shape(share), self.values[0])
        steps = np.diff(self.values) * 0.5 * (self.density[1:] + self.density[:-1])
        risen = np.concatenate([[0.0], np.cumsum(steps)])
        return np.asarray(np.interp(share, risen / risen[-1], self.values))


@dataclass(frozen=True)
class PosteriorEstimate:
    """The median of a posterior, and its central limits."""

    value: float
    lower: float
    upper: float


@dataclass(frozen=True)
class PsychometricPosterior:
    """The posterior of ``guess + (1 - guess - lapse) S(x)``.

    Attributes
    ----------
    threshold, width, guess, lapse, spread : PosteriorEstimate
        The threshold is where S is one half, the width the distance from S = .05 to .95: negative
        where performance falls, and a ratio on logarithmic levels. `spread` in [0, 1) is how far
        the true share at a level strays: n trials there have 1 + (n - 1) spread^2 times the
        binomial variance.
    marginals : mapping of name to Marginal
        Of thresholds and widths on the axis that was fitted: ln x where it is logarithmic.
    level : float
        What the limits enclose.
    warnings : tuple of str
    """

    shape: Shape
    falling: bool
    logarithmic: bool
    threshold: PosteriorEstimate
    width: PosteriorEstimate
    guess: PosteriorEstimate
    lapse: PosteriorEstimate
    spread: PosteriorEstimate
    marginals: Mapping[str, Marginal]
    level: float
    trials: int
    warnings: tuple[str, ...]

    @property
    def unidentified(self) -> tuple[str, ...]:
        """Fields that hold the prior more than the answers."""
        prior = {PLACED_BY_PRIOR, LIMITS_OF_PRIOR} & set(self.warnings)
        return ("threshold", "width", "marginals") if prior else ()

    def __call__(self, x: Floats) -> Floats:
        """Return the curve of the median parameters at `x`."""
        place, width = self._placed()
        rise = _rise(axis_of(x, self.logarithmic), place, width, self.shape, self.falling)
        return np.asarray(
            self.guess.value + (1.0 - self.guess.value - self.lapse.value) * rise,
            dtype=np.float64,
        )

    def _placed(self) -> tuple[float, float]:
        width = abs(self.width.value)
        if self.logarithmic:
            return float(np.log(self.threshold.value)), float(np.log(width))
        return self.threshold.value, width


@dataclass(frozen=True)
class ThresholdDifference:
    """Difference of two thresholds, first minus second; on logarithmic levels, of their logarithms.

    Attributes
    ----------
    larger : float
        Posterior probability that the first is larger.
    p : float
        Twice the smaller tail, which reads as a two-sided p; `p_adjusted` is Holm's.
    """

    first: str
    second: str
    difference: float
    lower: float
    upper: float
    level: float
    larger: float
    p: float
    p_adjusted: float


def psychometric_posterior(
    x: Floats,
    successes: Floats,
    trials: Floats,
    curve: CurveForm = TWO_ALTERNATIVES,
    *,
    level: float = 0.95,
) -> PsychometricPosterior:
    """Integrate the posterior of a psychometric function on a grid.

    Parameters
    ----------
    x, successes, trials : ndarray (levels,)
        Counts of one person, or of one condition whose people are alike.
    curve : CurveForm
        Of which ``weibull`` is ``gumbel`` on logarithmic levels. The priors of threshold and width
        are on the same axis.

    Raises
    ------
    ValueError
        If arrays differ in length, fewer than two levels were shown, counts are impossible, or
        levels have no logarithm.

    Notes
    -----
    Priors of Schütt et al. 2016, on the axis of the fit: the threshold is even over the levels
    and falls as a cosine over half their range outside; the width is even from twice the least
    gap of two levels to their range, and falls to 0 at that gap and at three times the range. Where
    the width's lower limit lies below twice the gap it is the prior's, and becomes that of a step;
    where the most likely width lies there, a note says that the levels do not tell it from one.
    Coarse grids over all of this find where the posterior lies, a finer one integrates it.

    In 300 simulated runs each, 95 % limits of the threshold held it in .957 (7 levels x 20 trials),
    .970 (5 x 10), .973 (7 x 40), and where true shares strayed by .15 and .2 in .970 (7 x 20) and
    .933 (7 x 40).
    """
    counts = [np.asarray(a, dtype=np.float64) for a in (x, successes, trials)]
    shown, right, total = counts
    if not (shown.shape == right.shape == total.shape) or shown.ndim != 1:
        raise ValueError("x, successes and trials must be equally long")
    if np.unique(shown).size < 2:
        raise ValueError("x must hold two levels or more")
    if np.any(total <= 0) or np.any(right < 0) or np.any(right > total):
        raise ValueError("successes must lie between 0 and trials, and trials be positive")
    axis, shape, falling = curve.axis(shown), curve.shape, curve.falling
    gap, span = float(np.diff(np.unique(axis)).min()), float(np.ptp(axis))
    low, high = float(axis.min()), float(axis.max())
    bounds = {
        "threshold": (low - 0.5 * span, high + 0.5 * span),
        "width": (gap, 3.0 * span),
        "guess": (0.0, RATE_MAX) if curve.guess is None else (curve.guess, curve.guess),
        "lapse": (0.0, RATE_MAX) if curve.lapse is None else (curve.lapse, curve.lapse),
        "spread": (0.0, SPREAD_MAX),
    }

    def log_density(grid: Mapping[str, Floats]) -> Floats:
        place, width, guessed, lapsed = np.meshgrid(
            grid["threshold"], grid["width"], grid["guess"], grid["lapse"], indexing="ij",
            sparse=True,
        )  # fmt: skip
        prior = _log(_threshold_prior(place, low, high)) + _log(_width_prior(width, gap, span))
        if curve.lapse is None:
            prior = prior + _log_beta(lapsed, *PRIOR)
        if curve.guess is None:
            prior = prior + _log_beta(guessed, *PRIOR)
        height = np.asarray(prior[..., None] + _log_beta(grid["spread"], *PRIOR))
        for level_x, hits, shown_n in zip(axis, right, total, strict=True):
            rise = _rise(level_x, place, width, shape, falling)
            height += _log_answers(
                guessed + (1.0 - guessed - lapsed) * rise, hits, shown_n, grid["spread"]
            )
        return height

    for counted in (COARSE, COARSE, FINE):
        grid = {name: _spaced(*ends, counted[name]) for name, ends in bounds.items()}
        height = log_density(grid)
        bounds = _narrowed(grid, height)
    marginals = _marginals(grid, height)
    tails = np.array([0.5, 0.5 - 0.5 * level, 0.5 + 0.5 * level])
    found = {name: [float(v) for v in one.quantile(tails)] for name, one in marginals.items()}
    place, width = found["threshold"], found["width"]
    lapsing = found["lapse"][0] if curve.lapse is None else 0.0
    notes = _notes(marginals["threshold"], low, high, lapsing, found["spread"][0])
    if width[1] < EVEN_FROM * gap:
        width[1] = 0.0
    if marginals["width"].mode < EVEN_FROM * gap:
        notes = (*notes, WIDTH_OF_LEVELS)
    if curve.logarithmic:
        place, width = [float(np.exp(v)) for v in place], [float(np.exp(v)) for v in width]
    if falling:
        width = [-width[0], -width[2], -width[1]]
    return PsychometricPosterior(
        shape=shape,
        falling=falling,
        logarithmic=curve.logarithmic,
        threshold=PosteriorEstimate(*place),
        width=PosteriorEstimate(*width),
        guess=PosteriorEstimate(*found["guess"]),
        lapse=PosteriorEstimate(*found["lapse"]),
        spread=PosteriorEstimate(*found["spread"]),
        marginals=marginals,
        level=level,
        trials=int(total.sum()),
        warnings=notes,
    )


def compare_thresholds(
    fits: Mapping[str, PsychometricPosterior],
) -> tuple[ThresholdDifference, ...]:
    """Compare thresholds that come from different answers: of conditions, or of people.

    Posteriors are taken as independent, which they are where no answer is in two of them. It
    speaks about these people: for all people there could be, see `thresholds.fit_thresholds`.

    Raises
    ------
    ValueError
        If there is one fit only, or they differ in axis or limits.
    """
    if len(fits) < 2:
        raise ValueError("two fits or more are needed to compare thresholds")
    check_conditions(len(fits))
    pairs = list(combinations(fits, 2))
    first_fit = next(iter(fits.values()))
    if any(
        (fit.logarithmic, fit.level) != (first_fit.logarithmic, first_fit.level)
        for fit in fits.values()
    ):
        raise ValueError("fits must have the same axis and the same level of their limits")
    level = first_fit.level
    places = (np.arange(PARTS) + 0.5) / PARTS
    values = {name: fit.marginals["threshold"].quantile(places) for name, fit in fits.items()}
    tails = np.array([0.5, 0.5 - 0.5 * level, 0.5 + 0.5 * level])
    rows = []
    for first, second in pairs:
        largest = float(max(np.abs(values[name]).max() for name in (first, second)))
        gap = zeroed((values[first][:, None] - values[second][None, :]).ravel(), largest)
        larger = float(np.mean(gap > 0) + 0.5 * np.mean(gap == 0))
        middle, lower, upper = (float(v) for v in np.quantile(gap, tails))
        # The values stand for PARTS^2 pairs: no tail is known better than that.
        p = max(2.0 * min(larger, 1.0 - larger), 1.0 / PARTS**2)
        rows.append((first, second, middle, lower, upper, larger, min(1.0, p)))
    adjusted = holm(np.array([row[-1] for row in rows]))
    return tuple(
        ThresholdDifference(
            first=first,
            second=second,
            difference=middle,
            lower=lower,
            upper=upper,
            level=level,
            larger=larger,
            p=p,
            p_adjusted=float(all_of_them),
        )
        for (first, second, middle, lower, upper, larger, p), all_of_them in zip(
            rows, adjusted, strict=True
        )
    )


def _rise(
    x: Floats | float, place: Floats | float, width: Floats | float, shape: Shape, falling: bool
) -> Floats:
    """Return S(x), or 1 - S(x) where performance falls; ``weibull`` is on logarithms here."""
    rise = sigmoid(x, place, width, "gumbel" if shape == "weibull" else shape)
    return 1.0 - rise if falling else rise


def _log_answers(share: Floats, hits: float, shown: float, spreads: Floats) -> Floats:
    """Return the log-likelihood of one level without its binomial coefficient (share, spread).

    Read off tables over the logit of the share: the grid asks for the same few values so often.
    """
    place = (logit(np.clip(share, 1e-9, 1.0 - 1e-9)) - NODES[0]) / (NODES[1] - NODES[0])
    below = np.minimum(place.astype(np.int64), NODES.size - 2)
    part = place - below
    table = _answer_table(hits, shown, spreads)
    step = np.diff(table, axis=0)
    return np.asarray(table[below] + part[..., None] * step[below])


def _answer_table(hits: float, shown: float, spreads: Floats) -> Floats:
    """Return the log-likelihood at every node (nodes, spreads)."""
    share = expit(NODES)[:, None]
    plain = hits * log_expit(NODES) + (shown - hits) * log_expit(-NODES)
    size = 1.0 / np.maximum(spreads, LEAST_SPREAD) ** 2 - 1.0
    a, b = share * size, (1.0 - share) * size
    strayed = betaln(hits + a, shown - hits + b) - betaln(a, b)
    return np.asarray(np.where(spreads < LEAST_SPREAD, plain[:, None], strayed))


def _threshold_prior(place: Floats, low: float, high: float) -> Floats:
    outside = np.maximum(np.maximum(low - place, place - high), 0.0) / (high - low)
    return np.where(outside < 0.5, 0.5 * (1.0 + np.cos(2.0 * np.pi * outside)), 0.0)


def _width_prior(width: Floats, gap: float, span: float) -> Floats:
    rise = (width - gap) / ((EVEN_FROM - 1.0) * gap)
    inner = 0.5 * (1.0 - np.cos(np.pi * np.clip(rise, 0.0, 1.0)))
    outer = 0.5 * (1.0 + np.cos(0.5 * np.pi * np.clip((width - span) / span, 0.0, 2.0)))
    return np.where(width > span, outer, inner)


def _log_beta(rate: Floats | float, a: float, b: float) -> Floats:
    rate = np.asarray(rate, dtype=np.float64)
    return np.asarray((a - 1.0) * _log(rate) if a != 1.0 else 0.0) + (b - 1.0) * np.log1p(-rate)


def _log(value: Floats) -> Floats:
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(value))


def _spaced(low: float, high: float, count: int) -> Floats:
    return np.array([low]) if high <= low else np.linspace(low, high, count)


def _narrowed(grid: Mapping[str, Floats], height: Floats) -> dict[str, tuple[float, float]]:
    """Return the bounds of what lies within `FAR` of the top, with a step to spare."""
    close = height > height.max() - FAR
    bounds = {}
    for place, (name, values) in enumerate(grid.items()):
        others = tuple(k for k in range(height.ndim) if k != place)
        inside = np.flatnonzero(close.any(axis=others))
        first, last = max(inside[0] - 1, 0), min(inside[-1] + 1, values.size - 1)
        bounds[name] = (float(values[first]), float(values[last]))
    return bounds


def _marginals(grid: Mapping[str, Floats], height: Floats) -> dict[str, Marginal]:
    mass = np.exp(height - height.max())
    weights = [_trapezoid(values) for values in grid.values()]
    found = {}
    for place, (name, values) in enumerate(grid.items()):
        left = mass
        for other in reversed(range(mass.ndim)):
            if other != place:
                left = np.moveaxis(left, other, -1) @ weights[other]
        total = float(left @ weights[place])
        found[name] = Marginal(values, np.asarray(left / total, dtype=np.float64))
    return found


def _trapezoid(values: Floats) -> Floats:
    if values.size == 1:
        return np.ones(1)
    weights = np.full(values.size, values[1] - values[0])
    weights[[0, -1]] *= 0.5
    return weights


def _notes(
    threshold: Marginal, low: float, high: float, lapse: float, spread: float
) -> tuple[str, ...]:
    notes = []
    placed = float(threshold.quantile(0.5))
    if not low <= placed <= high:
        notes.append(PLACED_BY_PRIOR)
    ends = threshold.quantile(np.array([0.025, 0.975]))
    if float(ends[1] - ends[0]) > 0.9 * (high - low):
        notes.append(LIMITS_OF_PRIOR)
    if lapse > 0.1:
        notes.append(f"about {100 * lapse:.0f} % lapses: was the task understood?")
    if spread > 0.4:
        notes.append("answers vary far more than a steady observer's: look at the trials in order")
    return tuple(notes)
