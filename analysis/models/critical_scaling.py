"""Critical scaling: the largest pooling that ABX observers cannot tell from what it pools."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pandas as pd
from scipy.special import betaincinv, expit, logit, ndtri

from analysis.arrays import Floats, Ints
from analysis.models.cells import TrialGrid, checked, grid, numbered, one_condition
from analysis.models.contrasts import (
    IN_CONDITION,
    CrossedDesign,
    Difference,
    pairs_of,
    wald,
)
from analysis.models.curves.critical_likelihood import (
    CriticalLikelihood,
    Parameters,
    fit_scenes,
    scaling_d_prime,
)
from analysis.models.curves.goodness_of_fit import Misfit, adjusted_misfits, misfit_of, studies_of
from analysis.models.curves.response import RATE_PRIOR
from analysis.models.numeric import two_sided_quantile
from protocols.answer_rules import answer_rule
from protocols.errors import count_of

FEW_PARTICIPANTS = 5

HARDLY_SEEN = 1.0
"""d' at the largest scaling below which the law cannot be placed."""

HARDLY_SEEN_NOTE = (
    "hardly a difference was seen at the largest scaling: critical scaling and gain are little"
    " more than their priors"
)

UNBOUNDED = 1000.0
"""Limits whose ends differ by more than this factor leave a critical scaling or gain open.

The gains that a fit looks at span a factor of 133."""

MOST_SCENES = 80
"""Scenes times conditions, up to which scenes have deviations: each is a parameter."""

LAPSES = 10
"""Rates of lapse that a single participant's posterior is summed over, equally likely."""
ALONE = -7.0
"""Logarithm of deviations between people where there is one: none."""

EXTRAPOLATED = "the critical scaling lies below all scalings shown: it is extrapolated"

SCALING = "critical scaling's level"
"""Column of the scaling as a number, whatever the table calls it."""


@dataclass(frozen=True)
class CriticalScaling:
    """d' as a function of scaling: 0 up to `critical`, then rising towards `gain`.

    Attributes
    ----------
    critical, gain : float
        Of the typical participant and scene (their geometric mean).
    critical_limits, gain_limits : pair of float or None
        None where the likelihood does not bound them. Of one participant, an end that the answers
        leave open is 0 or infinite.
    critical_sd, gain_sd, scene_sd : float
        Between participants, and of ln s_c between scenes (0: none has one), of natural logarithms.
    lapse : float
    individual : mapping of participant to (critical, gain)
        Drawn towards the typical one as far as their answers leave open.
    scenes : mapping of scene to (critical, lower, upper)
        Of these scenes, drawn towards the typical one too; empty where scenes have no deviation.
    """

    condition: str
    critical: float
    critical_limits: tuple[float, float] | None
    gain: float
    gain_limits: tuple[float, float] | None
    critical_sd: float
    gain_sd: float
    scene_sd: float
    lapse: float
    rule: str
    level: float
    trials: int
    participants: int
    individual: Mapping[str, tuple[float, float]]
    scenes: Mapping[str, tuple[float, float, float]]
    warnings: tuple[str, ...]

    @property
    def critical_identified(self) -> bool:
        """True if the answers bound the critical scaling."""
        return HARDLY_SEEN_NOTE not in self.warnings and _bounded(self.critical_limits)

    @property
    def gain_identified(self) -> bool:
        """True if the answers bound the gain."""
        return HARDLY_SEEN_NOTE not in self.warnings and _bounded(self.gain_limits)

    @property
    def unidentified(self) -> tuple[str, ...]:
        """Fields whose numbers mean nothing."""
        critical = (
            "critical",
            "critical_limits",
            "critical_sd",
            "scene_sd",
            "individual",
            "scenes",
        )
        gain = ("gain", "gain_limits", "gain_sd")
        return (critical if not self.critical_identified else ()) + (
            gain if not self.gain_identified else ()
        )

    def d_prime(self, scaling: Floats) -> Floats:
        """Return d' at scalings (any shape), of the typical participant."""
        return scaling_d_prime(scaling, self.critical, self.gain)

    def share(self, scaling: Floats) -> Floats:
        """Return the share of right answers at scalings (any shape), of the typical participant."""
        right = answer_rule(self.rule).share(self.d_prime(scaling))
        return np.asarray((1.0 - self.lapse) * right + 0.5 * self.lapse)

    def average_share(self, scaling: Floats) -> Floats:
        """Return the population's mean share of right answers at scalings (n,).

        This is what the answers of all participants together follow: it rises earlier and less
        steeply than the typical participant's.
        """
        z_s, z_g = (ndtri((np.arange(n) + 0.5) / n) for n in (200, 20))
        apart = np.hypot(self.critical_sd, self.scene_sd)
        critical = self.critical * np.exp(apart * z_s)[:, None, None]
        gain = self.gain * np.exp(self.gain_sd * z_g)[None, :, None]
        right = answer_rule(self.rule).share(scaling_d_prime(scaling, critical, gain))
        return np.asarray((1.0 - self.lapse) * right.mean(axis=(0, 1)) + 0.5 * self.lapse)


@dataclass(frozen=True)
class CriticalModel:
    """Critical scalings of all conditions, fitted together, and their comparison.

    Attributes
    ----------
    fits : tuple of CriticalScaling
        By condition.
    contrasts : tuple of Difference
        Of ln s_c, of conditions whose critical scaling the answers bound.
    likelihood, theta, scene_sd
        Answers, parameters, and deviations of scenes in all conditions and in one: what a study
        like this one is simulated from.
    """

    fits: tuple[CriticalScaling, ...]
    contrasts: tuple[Difference, ...]
    likelihood: CriticalLikelihood = field(repr=False)
    theta: Floats = field(repr=False)
    scene_sd: tuple[float, float] = (0.0, 0.0)


def critical_scalings(
    trials: pd.DataFrame,
    by: Sequence[str] = (),
    *,
    column: str = "scaling",
    rule: str = "differencing",
    reference: str | None = None,
    level: float = 0.95,
) -> CriticalModel:
    """Fit critical scalings and gains of all conditions that vary between participants and scenes.

    Parameters
    ----------
    trials : DataFrame, one row per decided ABX trial
        ``participant``, `column` (the scaling, positive), ``correct`` (0/1), the columns `by`, and
        ``scene``, if scenes were drawn from many.
    reference : str, optional
        Condition that the others are compared with; left out, all pairs.

    Raises
    ------
    ValueError
        If columns are missing, or there are fewer than two scalings.

    Notes
    -----
    ln s_c is the condition's, plus a participant's deviation in all conditions and one in this,
    plus both of the scene; ln gain is the condition's plus the participant's deviation there. All
    deviations are normal and have a prior (`SD_PRIOR`). Participants are summed over a grid
    (`CriticalLikelihood`); scenes are parameters with a penalty, whose deviations are those of
    restricted maximum likelihood by Laplace's method. Limits and tests: t on the second derivative
    in all parameters, with degrees of freedom between those of participants and of scenes
    (`contrasts.CrossedDesign`), because so many people and scenes tell the mean.

    Of a single participant nothing is known of deviations: medians and limits are those of the
    posterior of this person, at these scenes, for each condition by itself.
    """
    rows, scalings = _prepare(trials, column, by)
    parts, condition = numbered(rows, by)
    places, names = grid(rows), [name for name, _ in parts]
    pairs = pairs_of(names, reference)
    people = len(places.participants)
    if people == 1:
        alone = _likelihood(rows, scalings, rule, (condition, places.person, 0 * places.scene))
        return _of_one(alone, names, places.participants[0], level)
    scene, several, notes = places.scene, len(places.scenes) > 1, list[str]()
    if several and len(places.scenes) * len(names) > MOST_SCENES:
        several, scene = False, np.zeros_like(scene)
        notes.append("so many scenes and conditions: critical scalings are about these scenes")
    likelihood = _likelihood(rows, scalings, rule, (condition, places.person, scene))
    theta, covariance, scene_sd = fit_scenes(likelihood, common=not one_condition(scene, condition))
    at = Parameters.of(theta, len(names))
    sd = {
        "participant": at.sd[0] * likelihood.common,
        "participant" + IN_CONDITION: at.sd[1],
    }
    groups = {"participant": places.person}
    if several:
        groups["scene"] = scene
        sd |= {"scene": scene_sd[0], "scene" + IN_CONDITION: scene_sd[1]}
    crossed = CrossedDesign.of(condition, groups, sd)
    if people < FEW_PARTICIPANTS:
        notes.append(f"only {count_of(people, 'participant')}: limits are a rough guide")
    told = _Told(likelihood, theta, covariance, crossed, places, level, tuple(notes))
    fits = tuple(told.condition(k, name) for k, name in enumerate(names))
    known = {fit.condition for fit in fits if fit.critical_identified}
    contrasts = wald(
        "ln s_c", names, [pair for pair in pairs if known.issuperset(pair)], at.place,
        covariance[: len(names), : len(names)], crossed=crossed, level=level,
    )  # fmt: skip
    return CriticalModel(fits, tuple(contrasts), likelihood, theta, scene_sd)


def critical_scaling(
    trials: pd.DataFrame,
    *,
    column: str = "scaling",
    rule: str = "differencing",
    level: float = 0.95,
) -> CriticalScaling:
    """Fit one condition; see `critical_scalings`."""
    return critical_scalings(trials, column=column, rule=rule, level=level).fits[0]


def _of_one(
    likelihood: CriticalLikelihood, names: Sequence[str], who: str, level: float
) -> CriticalModel:
    """Return a single participant's critical scalings, and no comparison."""
    tails = 0.5 * (1.0 - level), 0.5, 0.5 * (1.0 + level)
    lapses = betaincinv(*RATE_PRIOR, (np.arange(LAPSES) + 0.5) / LAPSES)
    by_lapse = np.stack([likelihood.of_one(float(lapse)) for lapse in lapses])
    fits, means = list[CriticalScaling](), list[list[float]]()
    for k, name in enumerate(names):
        log = by_lapse[:, k]
        mass = np.exp(log - log.max())
        nodes = likelihood.log_s, likelihood.log_g
        low, middle, high = _quantiles(nodes[0], mass.sum(axis=(0, 2)), tails)
        gain = _quantiles(nodes[1], mass.sum(axis=(0, 1)), tails)
        # A likelihood that falls too little up to an end of the grid does not bound that end.
        fall = log.max() - log.max(axis=(0, 2))[[0, -1]]
        ends = np.where(fall < 0.5 * ndtri(tails[2]) ** 2, (0.0, np.inf), (low, high))
        means.append([math.log(middle), math.log(gain[1])])
        shown = likelihood.shown[k]
        notes = ["a single participant: limits speak of this person, with these pictures"]
        if middle < likelihood.scalings[shown.sum(axis=(0, 1)) > 0].min():
            notes.append(EXTRAPOLATED)
        fits.append(
            CriticalScaling(
                condition=name,
                critical=middle,
                critical_limits=(float(ends[0]), float(ends[1])),
                gain=gain[1],
                gain_limits=(gain[0], gain[2]),
                critical_sd=0.0,
                gain_sd=0.0,
                scene_sd=0.0,
                lapse=float(lapses @ mass.sum(axis=(1, 2)) / mass.sum()),
                rule=likelihood.rule,
                level=level,
                trials=int(shown.sum()),
                participants=1,
                individual={who: (middle, gain[1])},
                scenes={},
                warnings=tuple(notes),
            )
        )
    lapse = float(np.mean([fit.lapse for fit in fits]))
    theta = np.concatenate([*np.transpose(means), np.full(3, ALONE), [logit(lapse)]])
    return CriticalModel(tuple(fits), (), likelihood, theta)


def _quantiles(nodes: Floats, mass: Floats, shares: Sequence[float]) -> list[float]:
    """Return quantiles of the exponential of what has such masses at evenly spaced nodes."""
    edges = np.append(nodes, 2.0 * nodes[-1] - nodes[-2]) - 0.5 * (nodes[1] - nodes[0])
    below = np.append(0.0, np.cumsum(mass))
    return [float(one) for one in np.exp(np.interp(shares, below / below[-1], edges))]


@dataclass(frozen=True)
class _Told:
    """Parameters, and how well they are known, as results by condition."""

    likelihood: CriticalLikelihood
    theta: Floats
    covariance: Floats
    crossed: CrossedDesign
    places: TrialGrid
    level: float
    notes: tuple[str, ...]

    def condition(self, k: int, name: str) -> CriticalScaling:
        """Return one condition's."""
        model = self.likelihood
        at = Parameters.of(self.theta, len(model.right))
        shown = model.shown[k]
        seen, people = shown.sum(axis=(1, 2)) > 0, int((shown.sum(axis=(1, 2)) > 0).sum())
        unit = np.eye(len(at.place))[k]
        df = self.crossed.df(unit, float(self.covariance[k, k]))
        critical = self._limits({k: 1.0}, df)
        gain = self._limits({len(unit) + k: 1.0}, max(people - 1.0, 1.0))
        middle = float(np.exp(at.place[k])), float(np.exp(at.gain[k]))
        notes = list(self.notes)
        if critical is None:
            notes.append("the answers do not bound the model: no limits")
        scalings = model.scalings[shown.sum(axis=(0, 1)) > 0]
        own = np.exp(self._own[k])
        sd = self.crossed.sd
        scenes = {}
        if "scene" in self.crossed.shares:
            first = 2 * len(unit) + 4 + k * at.scenes.shape[1]
            for j, scene in enumerate(self.places.scenes):
                ends = self._limits({k: 1.0, first + j: 1.0}, df)
                if ends is not None and shown[:, j].any():
                    scenes[scene] = (float(np.exp(at.place[k] + at.scenes[k, j])), *ends)
        return CriticalScaling(
            condition=name,
            critical=middle[0],
            critical_limits=critical,
            gain=middle[1],
            gain_limits=gain,
            critical_sd=math.hypot(sd["participant"], sd["participant" + IN_CONDITION]),
            gain_sd=at.sd[2],
            scene_sd=math.hypot(sd.get("scene", 0.0), sd.get("scene" + IN_CONDITION, 0.0)),
            lapse=float(expit(at.lapse)),
            rule=model.rule,
            level=self.level,
            trials=int(shown.sum()),
            participants=people,
            individual={
                who: (float(own[i, 0]), float(own[i, 1]))
                for i, who in enumerate(self.places.participants)
                if seen[i]
            },
            scenes=scenes,
            warnings=(*notes, *_notes(*middle, scalings)),
        )

    @cached_property
    def _own(self) -> Floats:
        return self.likelihood.own(self.theta)

    def _limits(self, weights: Mapping[int, float], df: float) -> tuple[float, float] | None:
        """Return limits of the exponential of a sum; None where the answers do not bound it."""
        sum_of = np.zeros(len(self.theta))
        sum_of[list(weights)] = list(weights.values())
        variance = float(sum_of @ self.covariance @ sum_of)
        if not variance > 0.0:
            return None
        reach = float(two_sided_quantile(self.level, df)) * math.sqrt(variance)
        # Where the answers hardly bound a logarithm, its limit exceeds every float: infinite.
        with np.errstate(over="ignore", under="ignore"):
            ends = np.exp(float(sum_of @ self.theta) + np.array([-reach, reach]))
        return float(ends[0]), float(ends[1])


def _bounded(limits: tuple[float, float] | None) -> bool:
    """Return True if limits of a positive quantity say anything."""
    return limits is not None and limits[0] > 0 and limits[1] < UNBOUNDED * limits[0]


def _prepare(trials: pd.DataFrame, column: str, by: Sequence[str]) -> tuple[pd.DataFrame, Floats]:
    rows = checked(trials, (column, "correct"), by)
    values = pd.to_numeric(rows[column], errors="coerce").to_numpy(dtype=np.float64)
    if not np.all(np.isfinite(values)) or np.any(values <= 0):
        raise ValueError(f"column {column!r} must hold positive numbers, in every row")
    scalings = np.unique(values)
    if scalings.size < 2:
        raise ValueError(f"column {column!r} must hold two scalings at least (found {scalings})")
    return rows.assign(**{SCALING: values}), scalings


def _likelihood(
    rows: pd.DataFrame, scalings: Floats, rule: str, codes: tuple[Ints, Ints, Ints]
) -> CriticalLikelihood:
    """Count answers; codes (trials,) of conditions, participants and scenes."""
    counts = np.zeros((2, *(int(code.max()) + 1 for code in codes), scalings.size))
    at = (*codes, np.searchsorted(scalings, rows[SCALING].to_numpy(dtype=np.float64)))
    np.add.at(counts[0], at, rows["correct"].to_numpy(dtype=np.float64))
    np.add.at(counts[1], at, 1.0)
    return CriticalLikelihood(
        counts[0], counts[1], scalings, rule, common=not one_condition(codes[1], codes[0])
    )


def critical_misfits(
    model: CriticalModel, rng: np.random.Generator
) -> tuple[tuple[Misfit, ...], Floats]:
    """Compare answers with studies that the fitted model simulates.

    Returns
    -------
    misfits : tuple of Misfit
        Of each condition.
    predicted : ndarray (conditions, participants, scalings)
        Chance of a right answer.

    Notes
    -----
    A parametric bootstrap as `goodness_of_fit.misfits`: people, scenes and answers are drawn from
    the model, and each participant's critical scaling and gain are fitted anew.
    """
    likelihood, names = model.likelihood, [fit.condition for fit in model.fits]
    at = Parameters.of(model.theta, len(names))
    shown = likelihood.shown.sum(axis=2)
    right = likelihood.right.sum(axis=2)
    studies = studies_of(int((likelihood.shown > 0).sum()))
    drawn = np.array([_drawn(model, at, rng) for _ in range(studies)])
    predicted = likelihood.alike.expected(at, right[None])
    expected = likelihood.alike.expected(at, drawn)
    found = []
    for k, name in enumerate(names):
        cells = shown[k] > 0
        levels = np.broadcast_to(likelihood.scalings, cells.shape)[cells]
        told = [one[:, k][:, cells] for one in (right[None], predicted, drawn, expected)]
        found.append(misfit_of(name, levels, shown[k][cells], *told))
    return adjusted_misfits(found), predicted[0]


def _drawn(model: CriticalModel, at: Parameters, rng: np.random.Generator) -> Floats:
    """Return right answers of a study of the model (conditions, participants, scalings)."""
    shown = model.likelihood.shown
    conditions, people, scenes, _ = shown.shape
    common = model.likelihood.common * at.sd[0] * rng.standard_normal((1, people))
    apart = common + at.sd[1] * rng.standard_normal((conditions, people))
    common = model.scene_sd[0] * rng.standard_normal((1, scenes))
    own = common + model.scene_sd[1] * rng.standard_normal((conditions, scenes))
    gain = at.gain[:, None] + at.sd[2] * rng.standard_normal((conditions, people))
    critical = np.exp(at.place[:, None, None] + apart[:, :, None] + own[:, None])[..., None]
    d_prime = scaling_d_prime(model.likelihood.scalings, critical, np.exp(gain)[..., None, None])
    lapse = float(expit(at.lapse))
    share = (1.0 - lapse) * answer_rule(model.likelihood.rule).share(d_prime) + 0.5 * lapse
    drawn = rng.binomial(shown.astype(np.int64), share).sum(axis=2)
    return np.asarray(drawn, dtype=np.float64)


def _notes(critical: float, gain: float, scalings: Floats) -> list[str]:
    notes = []
    if critical < scalings.min():
        notes.append(EXTRAPOLATED)
    if float(scaling_d_prime(scalings.max(), critical, gain)) < HARDLY_SEEN:
        notes.append(HARDLY_SEEN_NOTE)
    return notes
