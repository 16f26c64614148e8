"""Likelihood of ABX answers along scalings; participants' deviations are summed over a grid.

A grid, because a participant's likelihood has a corner wherever a critical scaling passes one that
was shown, and Laplace's method knows no corners. Sums over many participants are smooth.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from scipy.special import expit, log_expit, logsumexp

from analysis.arrays import Floats
from analysis.models.curves.response import RATE_PRIOR
from protocols.answer_rules import answer_rule

STEP_SCALING, STEP_GAIN = 0.08, 0.25
"""Distances of the grid over participants' ln s_c and ln gain."""

GAINS = (0.3, 40.0)
BEYOND = 1.5
"""Reach of the grid of ln s_c past the scalings shown."""

STEP_LAW, FIRST_LAW, END_LAW = 0.005, -0.1, 4.0
"""Distances and ends of the table of the law by ln (scaling / s_c)."""

NODES = 15
"""Nodes of a participant's deviation in all conditions, within `REACH` deviations."""
REACH = 3.5

WIDE = np.log(5.0), 3.0
"""Typical ln gain, and the deviation of the prior of ln s_c and ln gain of the population.

It keeps someone finite who is always at chance, and says nothing (a factor of 20 either way)."""

ROUNDS, ALIKE = 3, 0.1
"""Rounds of deviations of scenes, at most, and the change of their logarithms that ends them."""

STEP, STEP_SCENE = 1e-2, 0.12
"""Steps of second derivatives; of scenes such that corners of the law average out."""

LEAST_CURVATURE = 0.05
ENOUGH = {"gtol": 0.1, "maxiter": 100}

SD_PRIOR = 0.5
"""Scale of the Rayleigh law that deviations of ln s_c and ln gain are drawn to.

It keeps them off 0, where ten people's maximum-likelihood deviation often lies and limits would
be too narrow (Chung et al. 2013), and off the absurd."""


def scaling_d_prime(scaling: Floats, critical: Floats | float, gain: Floats | float) -> Floats:
    """Return d' of two stimuli that pool with `scaling`.

    d'^2 = gain^2 (1 - critical^2 / scaling^2) above the critical scaling, else 0: the squared
    distance of the pooled responses grows as Freeman and Simoncelli 2011, equation 17, derive it.
    Their equation 18, and Wallis et al. 2019 and Broderick et al. 2023 after it, puts that squared
    distance in the place of d'; their critical scalings are smaller.
    """
    scaling = np.asarray(scaling, dtype=np.float64)
    return np.asarray(gain * np.sqrt(np.maximum(1.0 - (critical / scaling) ** 2, 0.0)))


def sd_penalty(log_sd: Floats) -> tuple[float, Floats]:
    """Return the log prior of deviations, whose logarithms these are, and its slope in these."""
    square = np.exp(2.0 * log_sd) / SD_PRIOR**2
    return float(np.sum(log_sd - 0.5 * square)), np.asarray(1.0 - square)


@dataclass(frozen=True)
class Parameters:
    """Parameters of the population, and of its scenes.

    Attributes
    ----------
    place, gain : ndarray (conditions,)
        Means of ln s_c and ln gain.
    log_sd : ndarray (3,)
        Logarithms of deviations: of ln s_c of a participant in all conditions, and in one more; of
        ln gain in one.
    lapse : float
        Logit of the rate.
    scenes : ndarray (conditions, scenes)
        Deviations of ln s_c.
    """

    place: Floats
    gain: Floats
    log_sd: Floats
    lapse: float
    scenes: Floats

    @property
    def sd(self) -> tuple[float, float, float]:
        """The deviations; none is narrower than the grid can show."""
        common, own, gain = np.exp(self.log_sd).tolist()
        return common, math.hypot(own, 0.5 * STEP_SCALING), math.hypot(gain, 0.5 * STEP_GAIN)

    @classmethod
    def of(cls, theta: Floats, conditions: int) -> "Parameters":
        """Take a vector apart, whose last numbers are those of scenes; none: there is one."""
        place, gain, log_sd, lapse, scenes = np.split(
            theta, np.cumsum([conditions, conditions, 3, 1])
        )
        if not scenes.size:
            scenes = np.zeros(conditions)
        return cls(place, gain, log_sd, float(lapse[0]), scenes.reshape(conditions, -1))


@dataclass(frozen=True)
class GridOfPeople:
    """Posterior masses over the grid, and the log-likelihood that they sum to."""

    log_likelihood: float
    within: Floats
    """Masses of ln s_c and ln gain (conditions, participants, nodes, nodes)."""
    counts: Floats
    """Sums over people, of ln s_c by a deviation in all conditions (conditions, NODES, nodes)."""


@dataclass(frozen=True)
class CriticalLikelihood:
    """Minus the log posterior of the parameters, and its slope.

    Attributes
    ----------
    right, shown : ndarray (conditions, participants, scenes, scalings)
        Counts of right answers, and of all.
    common : bool
        True if people deviate in all conditions alike, too: they saw several.
    """

    right: Floats
    shown: Floats
    scalings: Floats
    rule: str
    common: bool

    @property
    def alike(self) -> "CriticalLikelihood":
        """The same with all scenes as one."""
        right, shown = (one.sum(axis=2, keepdims=True) for one in (self.right, self.shown))
        return replace(self, right=right, shown=shown)

    @cached_property
    def log_s(self) -> Floats:
        """Grid of ln s_c."""
        first, last = np.log(self.scalings[[0, -1]])
        return np.arange(first - BEYOND, last + BEYOND, STEP_SCALING)

    @cached_property
    def log_g(self) -> Floats:
        """Grid of ln gain."""
        return np.arange(math.log(GAINS[0]), math.log(GAINS[1]), STEP_GAIN)

    @cached_property
    def law(self) -> Floats:
        """Shares without lapses by ln (scaling / s_c), of steps `STEP_LAW`, and ln gain.

        Means over the grid's distances, by weights that fall to both sides: so corners of the law
        at single nodes add up to what is smooth.
        """
        weights = np.bartlett(2 * round(STEP_SCALING / STEP_LAW) + 1)
        above = np.exp(np.arange(FIRST_LAW - STEP_SCALING, END_LAW + 2 * STEP_SCALING, STEP_LAW))
        d_prime = scaling_d_prime(above[:, None], 1.0, np.exp(self.log_g))
        share = answer_rule(self.rule).share(d_prime)
        return np.asarray(scipy.signal.convolve(share, weights[:, None] / weights.sum(), "valid"))

    @cached_property
    def _nodes(self) -> tuple[Floats, Floats]:
        """Nodes of a standard normal deviation in all conditions, and log weights."""
        nodes = np.linspace(-REACH, REACH, NODES) if self.common else np.zeros(1)
        return nodes, -0.5 * nodes**2 - logsumexp(-0.5 * nodes**2)

    def above(self, scenes: Floats) -> "scipy.sparse.csr_array":
        """Return the matrix that reads a law (places, gains) at ln (scaling / s_c) over the grid.

        Its rows are conditions, scenes, scalings, nodes of ln s_c.
        """
        above = np.log(self.scalings)[:, None] - self.log_s - scenes[..., None, None]
        at = ((above.ravel() - FIRST_LAW) / STEP_LAW).clip(0.0, len(self.law) - 1.0 - 1e-9)
        low = at.astype(np.int64)
        high = at - low
        weights, places = (
            np.column_stack(one).ravel() for one in ((1.0 - high, high), (low, low + 1))
        )
        rows = np.arange(0, places.size + 1, 2)
        return scipy.sparse.csr_array((weights, places, rows), (low.size, len(self.law)))

    def logs(self, lapse: float) -> list[Floats]:
        """Return the law of ln share and of ln (1 - share), and their slopes in the lapse rate."""
        share = np.minimum((1.0 - lapse) * self.law + 0.5 * lapse, 1.0 - 1e-12)
        return [
            np.log(share),
            np.log1p(-share),
            (0.5 - self.law) / share,
            (self.law - 0.5) / (1.0 - share),
        ]

    def start(self) -> Floats:
        """Return parameters from which a search begins: those of all answers as one person's."""
        found = self.of_one(0.02)
        best = found.reshape(len(found), -1).argmax(axis=1)
        place, gain = np.unravel_index(best, found.shape[1:])
        return np.concatenate(
            [self.log_s[place], self.log_g[gain], np.log([0.2, 0.15, 0.25]), [-3.0]]
        )

    def of_one(self, lapse: float) -> Floats:
        """Return the log posterior of ln s_c and ln gain (conditions, nodes, nodes) of one person.

        All answers are taken as this person's.
        """
        right, shown = (one.sum(axis=(1, 2)) for one in (self.right, self.shown))
        at = self.above(np.zeros((1, 1)))
        size = self.scalings.size, self.log_s.size, self.log_g.size
        yes, no = ((at @ one).reshape(size) for one in self.logs(lapse)[:2])
        found = np.tensordot(right, yes, 1) + np.tensordot(shown - right, no, 1)
        prior = self._means_prior(self.log_s, self.log_g)
        return np.asarray(found + prior[0][:, None] + prior[1])

    def _means_prior(self, place: Floats, gain: Floats) -> tuple[Floats, Floats]:
        middle = 0.5 * np.log(self.scalings[0] * self.scalings[-1])
        return -0.5 * ((place - middle) / WIDE[1]) ** 2, -0.5 * ((gain - WIDE[0]) / WIDE[1]) ** 2

    def people(self, at: Parameters, logs: tuple[Floats, Floats]) -> GridOfPeople:
        """Sum over people; `logs` are those of shares and of their complements over the grid."""
        conditions, people = self.right.shape[:2]
        data = [one.reshape(conditions, people, -1) for one in (self.right, self.shown)]
        yes, no = (one.reshape(conditions, data[0].shape[2], -1) for one in logs)
        joint = (data[0] @ yes + (data[1] - data[0]) @ no).reshape(
            conditions, people, self.log_s.size, -1
        )
        joint += np.log(self._gains(at)[0])[:, None, None, :]
        top = joint.max(axis=(2, 3))
        mass = np.exp(joint - top[:, :, None, None])
        over_gain = mass.sum(axis=3)
        apart = self._places(at)[0]
        found = np.maximum(over_gain @ apart.transpose(0, 2, 1), 1e-300)
        by_node = np.log(found).sum(axis=0) + top.sum(axis=0)[:, None] + self._nodes[1]
        each = logsumexp(by_node, axis=1)
        pull = np.exp(by_node - each[:, None]) / found
        return GridOfPeople(
            float(each.sum()),
            mass * (pull @ apart)[..., None],
            apart * (pull.transpose(0, 2, 1) @ over_gain),
        )

    def own(self, theta: Floats) -> Floats:
        """Return means of ln s_c and ln gain given answers (conditions, participants, 2)."""
        at = Parameters.of(theta, len(self.right))
        above = self.above(at.scenes)
        yes, no = (above @ one for one in self.logs(float(expit(at.lapse)))[:2])
        within = self.people(at, (yes, no)).within
        return np.stack([within.sum(axis=3) @ self.log_s, within.sum(axis=2) @ self.log_g], axis=-1)

    def expected(self, at: Parameters, right: Floats) -> Floats:
        """Return mean shares of people with such answers (studies, conditions, people, scalings).

        Each is given own answers in a condition alone; scenes are as one.
        """
        lapse, above = float(expit(at.lapse)), self.above(np.zeros((1, 1)))
        size = self.scalings.size, -1
        yes, no = ((above @ one).reshape(size) for one in self.logs(lapse)[:2])
        share, shown = np.exp(yes), self.shown[:, :, 0]
        apart = np.hypot(at.sd[0] * self.common, at.sd[1])
        found = np.empty(right.shape)
        for k in range(len(shown)):
            places = _normal(self.log_s, at.place[k], 1.0, apart)[0]
            gains = _normal(self.log_g, at.gain[k], 1.0, at.sd[2])[0]
            prior = (np.log(places)[:, None] + np.log(gains)).ravel()
            for one, into in zip(right[:, k], found[:, k], strict=True):
                joint = one @ yes + (shown[k] - one) @ no + prior
                mass = np.exp(joint - joint.max(axis=1, keepdims=True))
                into[...] = mass @ share.T / mass.sum(axis=1, keepdims=True)
        return found

    def _places(self, at: Parameters) -> tuple[Floats, Floats, Floats]:
        """Return weights of ln s_c given the deviation in all conditions, and their log slopes."""
        mean = at.place[:, None, None] + np.exp(at.log_sd[0]) * self._nodes[0][:, None]
        return _normal(self.log_s, mean, float(np.exp(at.log_sd[1])), at.sd[1])

    def _gains(self, at: Parameters) -> tuple[Floats, Floats, Floats]:
        return _normal(self.log_g, at.gain[:, None], float(np.exp(at.log_sd[2])), at.sd[2])

    def __call__(self, theta: Floats) -> tuple[float, Floats]:
        """Return minus the log posterior and its slope."""
        at = Parameters.of(theta, len(self.right))
        lapse = float(expit(at.lapse))
        logs, above = self.logs(lapse), self.above(at.scenes)
        grid = self.people(at, (above @ logs[0], above @ logs[1]))
        conditions, people = self.right.shape[:2]
        flat = grid.within.reshape(conditions, people, -1)
        hits, misses = (
            (one.reshape(conditions, people, -1).transpose(0, 2, 1) @ flat).reshape(
                above.shape[0], -1
            )
            for one in (self.right, self.shown - self.right)
        )
        _, by_mean, by_log_sd = self._places(at)
        _, gain_mean, gain_log_sd = self._gains(at)
        pulled, gains = grid.counts * by_mean, grid.within.sum(axis=(1, 2))
        prior = self._means_prior(at.place, at.gain)
        log_prior, sd_slope = sd_penalty(at.log_sd)
        if not self.common:  # nothing tells the first, and it stays where it is
            log_prior = sd_penalty(at.log_sd[1:])[0] - 0.5 * float(at.log_sd[0]) ** 2
            sd_slope[0] = -at.log_sd[0]
        by_lapse = float(np.vdot(above.T @ hits, logs[2]) + np.vdot(above.T @ misses, logs[3]))
        a, b = RATE_PRIOR
        middle = 0.5 * np.log(self.scalings[0] * self.scalings[-1])
        sd = np.array(
            [
                np.exp(at.log_sd[0]) * float(np.sum(pulled.sum(axis=2) @ self._nodes[0])),
                float(np.sum(grid.counts * by_log_sd)),
                float(np.sum(gains * gain_log_sd)),
            ]
        )
        slope = [
            pulled.sum(axis=(1, 2)) - (at.place - middle) / WIDE[1] ** 2,
            (gains * gain_mean).sum(axis=1) - (at.gain - WIDE[0]) / WIDE[1] ** 2,
            sd + sd_slope,
            [by_lapse * lapse * (1.0 - lapse) + a - (a + b) * lapse],
        ]
        if at.scenes.shape[1] > 1:
            steep = [above @ np.gradient(one, STEP_LAW, axis=0) for one in logs[:2]]
            moved = np.vecdot(hits, steep[0]) + np.vecdot(misses, steep[1])
            slope.append(-moved.reshape(at.scenes.size, -1).sum(axis=1))
        value = grid.log_likelihood + log_prior + float(prior[0].sum() + prior[1].sum())
        value += a * float(log_expit(at.lapse)) + b * float(log_expit(-at.lapse))
        return -value, -np.concatenate(slope)


def _normal(points: Floats, mean: Floats, sd: float, seen: float) -> tuple[Floats, Floats, Floats]:
    """Return weights of a normal law on a grid, and the slopes of their logs in mean and ln sd.

    `seen` is the deviation that the grid can show.
    """
    away = (points - mean) / seen
    log = -0.5 * away**2
    weight = np.exp(log - log.max(axis=-1, keepdims=True))
    weight = np.maximum(weight / weight.sum(axis=-1, keepdims=True), 1e-300)
    slopes = (away / seen, (sd / seen * away) ** 2)
    by_mean, by_log_sd = (one - (weight * one).sum(axis=-1, keepdims=True) for one in slopes)
    return weight, by_mean, by_log_sd


def fit_scenes(
    model: CriticalLikelihood, *, common: bool
) -> tuple[Floats, Floats, tuple[float, float]]:
    """Return parameters, their covariance, and deviations of scenes in all conditions and in one.

    Scenes are parameters with a penalty. Their deviations maximise the restricted likelihood: that
    of Laplace's method over all parameters, whose second derivative is taken anew after each fit.

    Parameters
    ----------
    common : bool
        True if scenes were shown in several conditions. Where there is one scene, all is 0.
    """
    conditions, _, scenes, _ = model.right.shape
    alike, theta = model.alike, model.start()
    found = scipy.optimize.minimize(alike, theta, jac=True, method="BFGS", options=ENOUGH)
    theta = np.asarray(found.x, dtype=np.float64)
    if scenes == 1:
        return (
            theta,
            np.asarray(np.linalg.inv(_curvature(alike, theta)), dtype=np.float64),
            (0.0, 0.0),
        )
    theta = np.concatenate([theta, np.zeros(conditions * scenes)])
    log_sd = np.log([0.15, 0.1])[0 if common else 1 :]
    for _ in range(ROUNDS):
        curvature = _curvature(model, theta)
        aim = curvature @ theta - model(theta)[1]

        def restricted(tried: Floats, known: Floats = curvature, aim: Floats = aim) -> float:
            own = _scene_precision(tried, conditions, scenes)
            whole = _with(known, own)
            sizes = [np.linalg.slogdet(one)[1] for one in (whole, own)]
            told = sizes[0] - sizes[1] - aim @ np.linalg.solve(whole, aim)
            return float(0.5 * told) - sd_penalty(tried)[0]

        best = scipy.optimize.minimize(restricted, log_sd, method="Nelder-Mead").x
        moved, log_sd = float(np.abs(best - log_sd).max()), np.asarray(best, dtype=np.float64)
        penalty = _scene_precision(log_sd, conditions, scenes)
        inverse = np.asarray(np.linalg.inv(_with(curvature, penalty)), dtype=np.float64)
        theta = _gone_on(model, theta, inverse, penalty)
        if moved < ALIKE:
            break
    sd = np.exp(log_sd)
    return theta, inverse, (float(sd[0]) if common else 0.0, float(sd[-1]))


def _scene_precision(log_sd: Floats, conditions: int, scenes: int) -> Floats:
    """Return the inverse covariance of scenes' deviations; of two, the first is in all conditions.

    Deviations are in the order (conditions, scenes).
    """
    variance = np.exp(2.0 * log_sd)
    together = variance[-1] * np.eye(conditions) + (variance[0] if log_sd.size > 1 else 0.0)
    return np.asarray(np.kron(np.linalg.inv(together), np.eye(scenes)), dtype=np.float64)


def _with(curvature: Floats, penalty: Floats) -> Floats:
    """Return a second derivative with a penalty of its last parameters."""
    first = len(curvature) - len(penalty)
    whole = curvature.copy()
    whole[first:, first:] += penalty
    return whole


def _gone_on(model: CriticalLikelihood, theta: Floats, inverse: Floats, penalty: Floats) -> Floats:
    """Minimise with a penalty of scenes, by steps of one second derivative, `inverse`."""
    first = theta.size - len(penalty)

    def loss(theta: Floats) -> tuple[float, Floats]:
        value, slope = model(theta)
        pull = np.append(np.zeros(first), penalty @ theta[first:])
        return value + 0.5 * float(theta @ pull), slope + pull

    options = ENOUGH | {"hess_inv0": 0.5 * (inverse + inverse.T)}
    found = scipy.optimize.minimize(loss, theta, jac=True, method="BFGS", options=options)
    return np.asarray(found.x, dtype=np.float64)


def _curvature(model: CriticalLikelihood, theta: Floats) -> Floats:
    """Return second derivatives; where answers bend the other way, as sharp as they do."""
    first = 2 * len(model.right) + 4
    steps = np.diag(np.where(np.arange(theta.size) < first, STEP, STEP_SCENE))
    rows = [(model(theta + s)[1] - model(theta - s)[1]) / (2.0 * s.sum()) for s in steps]
    values, directions = np.linalg.eigh(0.5 * (np.array(rows) + np.array(rows).T))
    return np.asarray((directions * np.maximum(np.abs(values), LEAST_CURVATURE)) @ directions.T)
