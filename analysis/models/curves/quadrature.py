"""Psychometric functions of many people: participants are integrated out by adaptive quadrature.

With a guess rate a participant's likelihood has more than one hill, and Laplace's method, which
knows one, makes up maxima without bound. Sums over nodes do not.
"""

from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
import scipy
from scipy.special import expit

from analysis.arrays import Floats, Ints
from analysis.models.curves.response import ResponseFunction, steep_prior
from analysis.models.numeric import newton_polish

NODES = 11, 41
"""Fewest and most, of what a participant has in all conditions, and of what in one."""
REACH = 4.5
"""Reach of the nodes, in deviations given the answers."""
FARTHEST_APART = 0.9
"""Nodes, in eta; curves bend within 1."""
LAPSE_NODES = 7

MOST_ROWS = 2_000
"""Looked at together, if no participant has more."""


STARTS = (0.5, 1.5, 0.15)
"""Deviations of eta at which searches begin; the later ones where the first finds no maximum."""

MODE_STEPS = 12
LONGEST_STEP = 2.0
SPREAD_OF_LAPSES = 1.0
"""Deviation of the normal prior of how much logits of lapse rates differ between people."""

LARGEST_SD = 50.0
LEAST_CURVATURE = 1e-6


@dataclass(frozen=True)
class PeopleFit:
    """Coefficients and deviations of eta, in the population, and each participant's own.

    Attributes
    ----------
    sd : ndarray (1 or 2,)
        Of participants; of a participant's deviation in one condition, where there are several.
    covariance : ndarray (parameters, parameters)
        Of beta, sd, and the fitted rates.
    converged : bool
        False where no search found a proper maximum.
    guess, lapse : float
        The lapse rate is the mean of `lapses`.
    own : ndarray (participants, conditions)
        Mean deviation of eta given the answers; NaN where a participant saw nothing of one.
    lapses : ndarray (participants,)
        Mean lapse rate given the answers.
    rates : ndarray (0 to 3,)
        What the fitted rates are made of: logit of the guess rate; mean and deviation over
        participants of the logit of the lapse rate (`mean_lapse`).
    """

    beta: Floats
    sd: Floats
    covariance: Floats
    log_likelihood: float
    converged: bool
    guess: float
    lapse: float
    own: Floats
    lapses: Floats
    rates: Floats


def mean_lapse(median: float, sd: float) -> float:
    """Return the mean over participants of lapse rates whose logits are normal."""
    nodes, weights = _hermite(LAPSE_NODES)
    return float(np.exp(weights) @ expit(median + sd * nodes))


def fit_people(
    design: Floats,
    y: Floats,
    person: Ints,
    condition: Ints,
    *,
    response: ResponseFunction,
    start: Floats,
    steepest: Floats,
) -> PeopleFit:
    """Maximise the likelihood of p = guess + (1 - guess - lapse) F(X beta + own deviations).

    Parameters
    ----------
    design : ndarray (trials, coefficients)
    y : ndarray (trials,)
        0 or 1.
    person, condition : ndarray (trials,)
        Counted from 0.
    response : ResponseFunction
        A fitted lapse rate is each participant's own: its logit is normal over participants, its
        median drawn towards `response.RATE_PRIOR`.
    start, steepest : ndarray (coefficients,)
        Where the search begins, and from where on answers no longer tell one coefficient from a
        larger one; infinite where they always do.

    Notes
    -----
    A participant deviates by sd_0 u in all conditions and by sd_1 v in each (u, v standard
    normal). Given u the conditions are independent: so the integral is nested, one of v in every
    condition within one of u and of the lapse rate (Gauss-Hermite nodes about the mode, Pinheiro
    and Bates 1995; of the lapse rate about its mean). Slopes are exact (Fisher's identity), errors
    invert the second derivative.
    """
    model = _Integrated.of(design, y, person, condition, response, steepest)
    parts = model.parts()

    def loss(theta: Floats) -> tuple[float, Floats]:
        values, slopes = zip(*(part(theta) for part in parts), strict=True)
        value, slope = model.prior(theta)
        return sum(values) - value, np.sum(slopes, axis=0) - slope

    found = None
    for sd in STARTS:
        begin = np.concatenate([start, np.full(model.deviations, sd), model.start_rates()])
        best = scipy.optimize.minimize(loss, begin, jac=True, method="BFGS", options={"gtol": 1e-3})
        point, hessian = newton_polish(loss, np.asarray(best.x, dtype=np.float64))
        proper = _proper(point, hessian)
        value = loss(point)[0]
        if found is None or (proper, -value) > (found[0], -found[1]):
            found = proper, value, point, hessian
        if proper:
            break
    assert found is not None
    proper, value, point, hessian = found
    beta, sds, rates = model.split(point)
    covariance = np.eye(point.size)
    if proper:
        covariance = np.asarray(np.linalg.pinv(hessian, hermitian=True), dtype=np.float64)
    # A deviation and its negative are the same: parameters are those of positive ones.
    sign = np.concatenate([np.ones(beta.size), np.where(sds < 0, -1.0, 1.0), np.ones(rates.size)])
    covariance = covariance * np.outer(sign, sign)
    own, lapse_of = (
        np.concatenate(found) for found in zip(*(part.own(point) for part in parts), strict=True)
    )
    return PeopleFit(
        beta=beta,
        sd=np.abs(sds),
        covariance=covariance,
        log_likelihood=-value,
        converged=proper,
        guess=model.rates(rates)[0],
        lapse=float(lapse_of.mean()),
        own=own,
        lapses=lapse_of,
        rates=rates,
    )


def _proper(point: Floats, hessian: Floats) -> bool:
    if not np.all(np.isfinite(hessian)) or float(np.abs(point).max()) > LARGEST_SD:
        return False
    return bool(np.linalg.eigvalsh(hessian)[0] > LEAST_CURVATURE)


def _even(sd: Floats) -> tuple[Floats, Floats]:
    """Return nodes that are as far apart, so many that deviations `sd` of eta are seen well.

    Beside them their log weights, with the constant of a standard normal.
    """
    count = int(np.clip(np.ceil(2.0 * REACH * np.abs(sd).max() / FARTHEST_APART), *NODES))
    nodes = np.linspace(-REACH, REACH, count)
    return nodes, np.full(count, np.log((nodes[1] - nodes[0]) / np.sqrt(2.0 * np.pi)))


@cache
def _hermite(count: int) -> tuple[Floats, Floats]:
    """Return nodes and log weights of the mean of a standard normal."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(count)
    return nodes, np.log(weights / weights.sum())


@dataclass(frozen=True)
class _Spread:
    """Means and deviations of u (people,) and v (cells,) given answers; `tilt`: slope of v in u."""

    u: Floats
    u_sd: Floats
    v: Floats
    v_sd: Floats
    tilt: Floats


@dataclass(frozen=True)
class _Nodes:
    """Nodes of each participant's integral, and the values found there.

    Axes: rows, cells or people; nodes of u; nodes of v; nodes of the lapse rate.
    """

    u: Floats
    v: Floats
    within: Floats
    """Posterior weight of v given the rest (cells, u, v, lapse)."""
    across: Floats
    """Posterior weight of u and lapse (people, u, lapse)."""
    per_share: Floats
    """Slope of each row's log likelihood in its share."""
    rise: Floats
    steep: Floats


@dataclass(frozen=True)
class _Integrated:
    """Minus the log likelihood and its slope, as a function of all parameters."""

    design: Floats
    successes: Floats
    trials: Floats
    person: Ints
    """Participant of each row."""
    cell: Ints
    person_of_cell: Ints
    condition_of_cell: Ints
    response: ResponseFunction
    steepest: Floats
    conditions: int

    @classmethod
    def of(
        cls,
        design: Floats,
        y: Floats,
        person: Ints,
        condition: Ints,
        response: ResponseFunction,
        steepest: Floats,
    ) -> "_Integrated":
        key = np.column_stack([person, condition, design])
        rows, place = np.unique(key, axis=0, return_inverse=True)
        who, what = rows[:, 0].astype(np.int64), rows[:, 1].astype(np.int64)
        cells, cell = np.unique(rows[:, :2].astype(np.int64), axis=0, return_inverse=True)
        place = place.ravel()
        return cls(
            design=rows[:, 2:],
            successes=np.bincount(place, weights=y).astype(np.float64),
            trials=np.bincount(place).astype(np.float64),
            person=who,
            cell=cell.ravel().astype(np.int64),
            person_of_cell=cells[:, 0],
            condition_of_cell=cells[:, 1],
            response=response,
            steepest=steepest,
            conditions=int(what.max()) + 1,
        )

    @property
    def deviations(self) -> int:
        return 2 if self.conditions > 1 else 1

    def parts(self) -> "list[_Integrated]":
        """Return the same of some participants each: so many rows as memory should hold at once."""
        last = np.flatnonzero(np.diff(self.person, append=-1)) + 1
        cuts = last[np.diff((last - 1) // MOST_ROWS, append=-1) != 0].tolist()
        found = []
        for low, high in pairwise([0, *cuts]):
            person, cell = int(self.person[low]), int(self.cell[low])
            cells = slice(cell, int(self.cell[high - 1]) + 1)
            found.append(
                replace(
                    self,
                    design=self.design[low:high],
                    successes=self.successes[low:high],
                    trials=self.trials[low:high],
                    person=self.person[low:high] - person,
                    cell=self.cell[low:high] - cell,
                    person_of_cell=self.person_of_cell[cells] - person,
                    condition_of_cell=self.condition_of_cell[cells],
                )
            )
        return found

    @property
    def lapse_weights(self) -> Floats:
        return _hermite(LAPSE_NODES if self.response.lapse is None else 1)[1]

    def start_rates(self) -> Floats:
        start = self.response.start()
        return np.append(start, 0.3) if self.response.lapse is None else start

    def split(self, theta: Floats) -> tuple[Floats, Floats, Floats]:
        """Return coefficients, deviations, and what the fitted rates are made of."""
        count = self.design.shape[1]
        return (
            theta[:count],
            theta[count : count + self.deviations],
            theta[count + self.deviations :],
        )

    def rates(self, free: Floats) -> tuple[float, Floats]:
        """Return the guess rate, and the lapse rate at each of its nodes."""
        if self.response.lapse is not None:
            return self.response.rates(free)[0], np.array([self.response.lapse])
        guess = self.response.rates(free[:-1])[0]
        return guess, expit(free[-2] + free[-1] * _hermite(LAPSE_NODES)[0])

    def __call__(self, theta: Floats) -> tuple[float, Floats]:
        free = self.split(theta)[2]
        value, at = self._integrated(theta)
        weight = at.within * at.across[self.person_of_cell][:, :, None, :]
        weighted = weight[self.cell] * at.per_share
        guess, lapses = self.rates(free)
        span = 1.0 - guess - lapses
        pull = (weighted @ span) * at.steep  # rows, u, v
        slope = [self.design.T @ pull.sum(axis=(1, 2))]
        slope.append(np.array([float((pull.sum(axis=2) * at.u[self.person]).sum())]))
        if self.deviations > 1:
            slope.append(np.array([float((pull * at.v[self.cell]).sum())]))
        if self.response.guess is None:
            left = float((weighted.sum(axis=3) * (1.0 - at.rise)).sum())
            slope.append(np.array([left * guess * (1.0 - 2.0 * guess)]))
        if self.response.lapse is None:
            left = -(weighted * at.rise[..., None]).sum(axis=(0, 1, 2)) * lapses * (1.0 - lapses)
            nodes = _hermite(LAPSE_NODES)[0]
            slope.append(np.array([left.sum(), left @ nodes]))
        return value, -np.concatenate(slope)

    def own(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return each participant's mean deviation in each condition, and mean lapse rate."""
        _, sd, free = self.split(theta)
        _, at = self._integrated(theta)
        people = self.person_of_cell
        deviation = (sd[0] * at.u)[people][:, :, None]
        if self.deviations > 1:
            deviation = deviation + sd[1] * at.v
        weight = at.within * at.across[people][:, :, None, :]
        found = np.full((people.max() + 1, self.conditions), np.nan)
        found[people, self.condition_of_cell] = (weight.sum(axis=3) * deviation).sum(axis=(1, 2))
        return found, at.across.sum(axis=1) @ self.rates(free)[1]

    def prior(self, theta: Floats) -> tuple[float, Floats]:
        """Return the log prior of steep curves, of fitted rates and of how lapses differ; slope."""
        beta, sd, free = self.split(theta)
        plain = free[: self.response.fitted]
        apart = free[self.response.fitted :] / SPREAD_OF_LAPSES
        value, slope = steep_prior(beta, self.steepest)
        value += self.response.penalty(plain) - 0.5 * float(apart @ apart)
        rates = self.response.penalty_slope(plain)
        return value, np.concatenate([slope, 0.0 * sd, rates, -apart / SPREAD_OF_LAPSES])

    def _integrated(self, theta: Floats) -> tuple[float, _Nodes]:
        """Return minus the log likelihood, and what it was summed from.

        Nodes are spread about the mode first, and then about the mean of what these show: steep
        curves make hills that are flat on top.
        """
        free = self.split(theta)[2]
        guess, lapses = self.rates(free)
        typical = np.exp(self.lapse_weights) @ lapses
        spread = self._mode(theta, (guess, float(typical)))
        spread = self._spread(self._summed(theta, spread, guess, np.array([typical]))[1])
        return self._summed(theta, spread, guess, lapses)

    def _summed(
        self, theta: Floats, spread: "_Spread", guess: float, lapses: Floats
    ) -> tuple[float, _Nodes]:
        beta, sd, _ = self.split(theta)
        common, own = float(sd[0]), float(sd[1]) if self.deviations > 1 else 0.0
        x, x_weight = _even(common * spread.u_sd)
        z, z_weight = _even(own * spread.v_sd) if self.deviations > 1 else (np.zeros(1),) * 2
        u = spread.u[:, None] + x * spread.u_sd[:, None]
        moved = (u - spread.u[:, None])[self.person_of_cell]
        v = (spread.v[:, None] + spread.tilt[:, None] * moved)[:, :, None]
        v = v + z * spread.v_sd[:, None, None]
        eta = (self.design @ beta)[:, None, None]
        eta = eta + common * u[self.person][:, :, None] + own * v[self.cell]
        rise, steep, _ = self.response.rise(eta)
        share = guess + (1.0 - guess - lapses) * rise[..., None]
        share = np.clip(share, 1e-12, 1.0 - 1e-12)
        hits = self.successes[:, None, None, None]
        misses = self.trials[:, None, None, None] - hits
        answers = hits * np.log(share) + misses * np.log1p(-share)
        first_row = np.flatnonzero(np.diff(self.cell, prepend=-1))
        first_cell = np.flatnonzero(np.diff(self.person_of_cell, prepend=-1))
        inner = np.add.reduceat(answers, first_row, axis=0)
        inner += (z_weight - 0.5 * v**2 + np.log(spread.v_sd)[:, None, None])[..., None]
        top = inner.max(axis=2, keepdims=True)
        within = np.exp(inner - top)
        total = within.sum(axis=2, keepdims=True)
        within /= total
        outer = np.add.reduceat((top + np.log(total))[:, :, 0, :], first_cell, axis=0)
        outer += (x_weight - 0.5 * u**2 + np.log(spread.u_sd)[:, None])[..., None]
        outer += self.lapse_weights if lapses.size > 1 else 0.0
        peak = outer.max(axis=(1, 2), keepdims=True)
        across = np.exp(outer - peak)
        whole = across.sum(axis=(1, 2), keepdims=True)
        value = -float((peak + np.log(whole)).sum())
        per_share = hits / share - misses / (1.0 - share)
        return value, _Nodes(u, v, within, across / whole, per_share, rise, steep)

    def _spread(self, at: _Nodes) -> "_Spread":
        """Return mean, deviation and slope of u and v, given the answers."""
        people = self.person_of_cell
        weight = at.across[:, :, 0]
        u = (weight * at.u).sum(axis=1)
        gap = at.u - u[:, None]
        u_variance = (weight * gap**2).sum(axis=1)
        both = at.within[..., 0] * weight[people][:, :, None]
        v = (both * at.v).sum(axis=(1, 2))
        off = at.v - v[:, None, None]
        tilt = (both * off * gap[people][:, :, None]).sum(axis=(1, 2)) / u_variance[people]
        off = off - (tilt[:, None] * gap[people])[:, :, None]
        v_variance = (both * off**2).sum(axis=(1, 2)) if self.deviations > 1 else np.ones(v.size)
        return _Spread(u, np.sqrt(u_variance), v, np.sqrt(v_variance), tilt)

    def _mode(self, theta: Floats, rates: tuple[float, float]) -> "_Spread":
        """Return the mode of u and v, by Fisher scoring, and the deviations there."""
        beta, sd, _ = self.split(theta)
        fixed = self.design @ beta
        common, own = float(sd[0]), float(sd[1]) if self.deviations > 1 else 0.0
        people = self.person_of_cell.max() + 1
        u, v = np.zeros(people), np.zeros(self.person_of_cell.size)
        for _ in range(MODE_STEPS):
            eta = fixed + common * u[self.person] + own * v[self.cell]
            gap, _, weight = self.response.slope(eta, self.successes, self.trials, rates)
            force = np.bincount(self.cell, weights=gap)
            known = np.bincount(self.cell, weights=weight)
            width = 1.0 + own**2 * known
            tilt = common * own * known / width
            narrow = 1.0 + common**2 * np.bincount(self.person_of_cell, weights=known / width)
            rise_v = own * force - v
            rise_u = np.bincount(self.person_of_cell, weights=common * force - tilt * rise_v) - u
            step_u = rise_u / narrow
            step_v = rise_v / width - tilt * step_u[self.person_of_cell]
            longest = max(float(np.abs(step_u).max()), float(np.abs(step_v).max()))
            u = u + np.clip(step_u, -LONGEST_STEP, LONGEST_STEP)
            v = v + np.clip(step_v, -LONGEST_STEP, LONGEST_STEP)
            if longest < 1e-6:
                break
        return _Spread(u, 1.0 / np.sqrt(narrow), v, 1.0 / np.sqrt(width), -tilt)
