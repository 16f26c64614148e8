"""Critical scaling: the largest pooling that ABX observers cannot tell from what it pools."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
import pandas as pd
import scipy
from scipy.special import expit, log_expit, logsumexp, ndtri

from analysis.arrays import Floats, Ints
from analysis.models.cells import checked, conditions, grid
from analysis.models.contrasts import Difference, paired, pairs_of
from analysis.models.curves.response import RATE_PRIOR
from analysis.models.numeric import numeric_hessian, two_sided_quantile
from protocols.answer_rules import answer_rule
from protocols.errors import count_of

STEP_SCALING, STEP_GAIN = 0.06, 0.2
"""Distances of the grid over participants' ln s_c and ln gain."""

GAINS = (0.3, 40.0)
BEYOND = 1.5
"""Reach of the grid of ln s_c past the scalings shown."""

PERSON_PRIOR_SD = 1.5
"""Deviation of ln s_c and ln gain from mid-scaling and gain 5, in a fit of one person.

Wide (a factor of 4.5 either way), and enough to keep someone finite who is always at chance."""

FEW_PARTICIPANTS = 5

HARDLY_SEEN = 1.0
"""d' at the largest scaling below which the law cannot be placed."""

HARDLY_SEEN_NOTE = (
    "hardly a difference was seen at the largest scaling: critical scaling and gain are little"
    " more than their priors"
)

UNBOUNDED = 1000.0
"""Limits whose ends differ by more than this factor leave a critical scaling or gain open.

The gains that a fit looks at (`GAINS`) span a factor of 133."""

SD_PRIOR = 0.5
"""Scale of the Rayleigh law that the deviations of ln s_c and ln gain are drawn to.

It keeps them off 0, where ten people's maximum-likelihood deviation often lies and limits would
be too narrow (Chung et al. 2013), and off the absurd."""


@dataclass(frozen=True)
class CriticalScaling:
    """d' as a function of scaling: 0 up to `critical`, then rising towards `gain`.

    Attributes
    ----------
    critical, gain : float
        Of the typical participant (their geometric mean).
    critical_limits, gain_limits : pair of float or None
        None where the likelihood does not bound them.
    critical_sd, gain_sd : float
        Between participants, of natural logarithms.
    lapse : float
    individual : mapping of participant to (critical, gain)
        Drawn towards the typical one as far as their answers leave open.
    alone : mapping of participant to critical
        Fitted to their answers alone (`fit_alone`); empty where it was not asked for.
    """

    condition: str
    critical: float
    critical_limits: tuple[float, float] | None
    gain: float
    gain_limits: tuple[float, float] | None
    critical_sd: float
    gain_sd: float
    lapse: float
    rule: str
    law: str
    level: float
    log_likelihood: float
    trials: int
    participants: int
    individual: Mapping[str, tuple[float, float]]
    warnings: tuple[str, ...]
    alone: Mapping[str, float] = field(default_factory=dict)

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
        critical = ("critical", "critical_limits", "critical_sd", "individual", "alone")
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
        critical = self.critical * np.exp(self.critical_sd * z_s)[:, None, None]
        gain = self.gain * np.exp(self.gain_sd * z_g)[None, :, None]
        right = answer_rule(self.rule).share(scaling_d_prime(scaling, critical, gain))
        return np.asarray((1.0 - self.lapse) * right.mean(axis=(0, 1)) + 0.5 * self.lapse)


def scaling_d_prime(scaling: Floats, critical: Floats | float, gain: Floats | float) -> Floats:
    """Return d' of two stimuli that pool with `scaling`.

    d'^2 = gain^2 (1 - critical^2 / scaling^2) above the critical scaling, else 0: the squared
    distance of the pooled responses grows as Freeman and Simoncelli 2011, equation 17, derive it.
    Their equation 18, and Wallis et al. 2019 and Broderick et al. 2023 after it, puts that squared
    distance in the place of d'; their critical scalings are smaller.
    """
    scaling = np.asarray(scaling, dtype=np.float64)
    return np.asarray(gain * np.sqrt(np.maximum(1.0 - (critical / scaling) ** 2, 0.0)))


def fit_alone(trials: pd.DataFrame, *, column: str, rule: str) -> tuple[float, float]:
    """Return critical scaling and gain of one person, or of all answers as if they were one's.

    Notes
    -----
    Trials count as independent. The fit is penalised by wide normal laws of ln s_c and ln gain
    (`PERSON_PRIOR_SD`) and the law of lapses (`response.RATE_PRIOR`).
    """
    rows, scalings = _prepare(trials, column)
    right, shown = (one[0] for one in _counts(rows, scalings, column, np.zeros(len(rows), int)))
    middle = np.log(np.sqrt(scalings.min() * scalings.max()))

    def loss(theta: Floats) -> float:
        rate = float(expit(theta[2]))
        value = _log_likelihood(
            scalings, right, shown, np.array(theta[0]), np.array(theta[1]), rate, rule
        )
        prior = -0.5 * ((theta[0] - middle) ** 2 + (theta[1] - np.log(5.0)) ** 2)
        return float(-value - prior / PERSON_PRIOR_SD**2 - _lapse_prior(theta[2:]))

    starts = [
        np.array([np.log(s), np.log(g), -3.0])
        for s in np.geomspace(0.5 * scalings.min(), 0.9 * scalings.max(), 6)
        for g in (1.0, 3.0, 8.0)
    ]
    best = _polish(loss, sorted(starts, key=loss)[:3])
    return float(np.exp(best[0])), float(np.exp(best[1]))


def critical_scaling(
    trials: pd.DataFrame,
    *,
    column: str = "scaling",
    rule: str = "differencing",
    level: float = 0.95,
) -> CriticalScaling:
    """Fit critical scaling and gain that vary between participants.

    Parameters
    ----------
    trials : DataFrame, one row per decided ABX trial
        ``participant``, `column` (the scaling, positive) and ``correct`` (0/1).

    Raises
    ------
    ValueError
        If columns are missing, or there are fewer than two participants or scalings.

    Notes
    -----
    ln s_c and ln gain are normal over participants, independent of each other. The likelihood is
    summed over a grid of both that stays where it is, so that it is smooth in all parameters
    (one person's has a corner wherever s_c passes a scaling); deviations have a prior
    (`SD_PRIOR`). Limits of the typical participant: t with participants - 1 on the second
    derivative in all parameters.
    """
    rows, scalings = _prepare(trials, column)
    places = grid(rows)
    people = len(places.participants)
    if people < 2:
        raise ValueError(f"trials must hold two participants at least (found {people})")
    right, shown = _counts(rows, scalings, column, places.person)
    log_s = np.arange(np.log(scalings[0]) - BEYOND, np.log(scalings[-1]) + BEYOND, STEP_SCALING)
    log_g = np.arange(np.log(GAINS[0]), np.log(GAINS[1]), STEP_GAIN)

    @lru_cache(maxsize=1)  # derivatives in the other parameters ask for it again and again
    def table(rate: float) -> Floats:
        return _log_likelihood(scalings, right, shown, log_s[:, None], log_g[None, :], rate, rule)

    def joint(theta: Floats) -> Floats:
        rate = float(expit(theta[4]))
        weight_s = _log_weights(log_s, theta[0], theta[2], STEP_SCALING)
        weight_g = _log_weights(log_g, theta[1], theta[3], STEP_GAIN)
        return table(rate) + weight_s[:, None] + weight_g[None, :]

    def loss(theta: Floats) -> float:
        likelihood = float(logsumexp(joint(theta).reshape(people, -1), axis=1).sum())
        sd = np.maximum(np.abs(theta[2:4]), 1e-9)
        prior = float(np.sum(np.log(sd) - 0.5 * (sd / SD_PRIOR) ** 2))
        return -likelihood - prior - _lapse_prior(theta[4:])

    alone, gain = fit_alone(rows, column=column, rule=rule)
    start = np.array([np.log(alone), np.log(gain), 0.25, 0.25, -3.0])
    best = np.asarray(scipy.optimize.minimize(loss, start, method="BFGS", options={"gtol": 1e-4}).x)
    limits = _limits(loss, best, float(two_sided_quantile(level, people - 1)))
    values = joint(best)
    mass = np.exp(values - values.max(axis=(1, 2), keepdims=True))
    mass /= mass.sum(axis=(1, 2), keepdims=True)
    own_s, own_g = mass.sum(axis=2) @ log_s, mass.sum(axis=1) @ log_g
    notes = _notes(float(np.exp(best[0])), float(np.exp(best[1])), scalings)
    if people < FEW_PARTICIPANTS:
        notes.append(f"only {count_of(people, 'participant')}: limits are a rough guide")
    if limits is None:
        notes.append("the answers do not bound the model: no limits")
    return CriticalScaling(
        condition="all",
        critical=float(np.exp(best[0])),
        critical_limits=limits and limits[0],
        gain=float(np.exp(best[1])),
        gain_limits=limits and limits[1],
        critical_sd=float(abs(best[2])),
        gain_sd=float(abs(best[3])),
        lapse=float(expit(best[4])),
        rule=rule,
        law="distance",
        level=level,
        log_likelihood=-loss(best),
        trials=len(rows),
        participants=people,
        individual={
            who: (float(np.exp(own_s[i])), float(np.exp(own_g[i])))
            for i, who in enumerate(places.participants)
        },
        warnings=tuple(notes),
    )


def _limits(
    loss: Callable[[Floats], float], best: Floats, quantile: float
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Return the limits of critical scaling and gain; None where the answers do not bound them."""
    hessian = numeric_hessian(loss, best, step=1e-3)
    if not np.all(np.isfinite(hessian)) or np.linalg.eigvalsh(hessian)[0] <= 1e-6:
        return None
    reach = quantile * np.sqrt(np.diag(np.linalg.inv(hessian)))
    # Where the answers hardly bound a logarithm, its limit exceeds every float: infinite.
    with np.errstate(over="ignore", under="ignore"):
        critical, gain = (
            (float(np.exp(best[k] - reach[k])), float(np.exp(best[k] + reach[k]))) for k in (0, 1)
        )
    return critical, gain


def critical_scalings(
    trials: pd.DataFrame,
    by: Sequence[str],
    *,
    column: str = "scaling",
    rule: str = "differencing",
    level: float = 0.95,
) -> tuple[tuple[CriticalScaling, ...], tuple[Difference, ...]]:
    """Fit every condition, and compare ln s_c between conditions by participants.

    Notes
    -----
    The comparison is a paired t over participants of their own ln s_c (`fit_alone`), which
    takes nothing for granted about how they vary. Conditions whose critical scaling the answers
    do not bound are not compared.
    """
    rows = checked(trials, (column, "correct"), by)
    fits, own = [], {}
    for name, part in conditions(rows, by):
        fit = critical_scaling(part, column=column, rule=rule, level=level)
        own[name] = {
            str(who): float(np.log(fit_alone(group, column=column, rule=rule)[0]))
            for who, group in part.groupby("participant", sort=True)
        }
        alone = {who: float(np.exp(value)) for who, value in own[name].items()}
        fits.append(replace(fit, condition=name, alone=alone))
    placed = {fit.condition: own[fit.condition] for fit in fits if fit.critical_identified}
    return tuple(fits), _paired(placed, level)


def _paired(own: Mapping[str, Mapping[str, float]], level: float) -> tuple[Difference, ...]:
    gaps = []
    for first, second in pairs_of(own, None):
        both = sorted(set(own[first]) & set(own[second]))
        if len(both) > 1:
            apart = np.array([own[first][who] - own[second][who] for who in both])
            gaps.append(((first, second), apart))
    return tuple(paired("ln s_c", gaps, level))


def _bounded(limits: tuple[float, float] | None) -> bool:
    """Return True if limits of a positive quantity say anything."""
    return limits is not None and limits[0] > 0 and limits[1] < UNBOUNDED * limits[0]


def _prepare(trials: pd.DataFrame, column: str) -> tuple[pd.DataFrame, Floats]:
    rows = checked(trials, (column, "correct"))
    values = pd.to_numeric(rows[column], errors="coerce").to_numpy(dtype=np.float64)
    if not np.all(np.isfinite(values)) or np.any(values <= 0):
        raise ValueError(f"column {column!r} must hold positive numbers, in every row")
    scalings = np.unique(values)
    if scalings.size < 2:
        raise ValueError(f"column {column!r} must hold two scalings at least (found {scalings})")
    return rows.assign(**{column: values}), scalings


def _counts(rows: pd.DataFrame, scalings: Floats, column: str, person: Ints) -> Floats:
    """Return right answers and trials (2, participants, scalings)."""
    counts = np.zeros((2, int(person.max()) + 1, scalings.size))
    at = (person, np.searchsorted(scalings, rows[column].to_numpy(dtype=np.float64)))
    np.add.at(counts[0], at, rows["correct"].to_numpy(dtype=np.float64))
    np.add.at(counts[1], at, 1.0)
    return counts


def _log_likelihood(
    scalings: Floats,
    right: Floats,
    shown: Floats,
    log_s: Floats,
    log_g: Floats,
    lapse: float,
    rule: str,
) -> Floats:
    """Return log-likelihoods (..., nodes of log_s and log_g) of counts (..., scalings)."""
    d = scaling_d_prime(
        scalings, np.exp(log_s)[..., None], np.exp(np.minimum(log_g, 4.0))[..., None]
    )
    share = (1.0 - lapse) * answer_rule(rule).share(d) + 0.5 * lapse
    share = np.minimum(np.maximum(share, 1e-12), 1.0 - 1e-12)  # `np.clip` takes twice as long
    yes, no = np.log(share), np.log1p(-share)
    return np.asarray(
        np.tensordot(right, yes, (-1, -1)) + np.tensordot(shown - right, no, (-1, -1)),
        dtype=np.float64,
    )


def _log_weights(points: Floats, mean: float, sd: float, step: float) -> Floats:
    """Return the log of a normal law on a grid; never narrower than the grid can show."""
    log = -0.5 * (points - mean) ** 2 / (sd**2 + step**2)
    return np.asarray(log - logsumexp(log))


def _lapse_prior(free: Floats) -> float:
    return float(np.sum(RATE_PRIOR[0] * log_expit(free) + RATE_PRIOR[1] * log_expit(-free)))


def _polish(loss: Callable[[Floats], float], starts: Sequence[Floats]) -> Floats:
    rough = [
        scipy.optimize.minimize(
            loss, start, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-5}
        )
        for start in starts
    ]
    best = min(rough, key=lambda one: float(one.fun))
    sharp = scipy.optimize.minimize(
        loss, best.x, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-9}
    )
    return np.asarray(sharp.x, dtype=np.float64)


def _notes(critical: float, gain: float, scalings: Floats) -> list[str]:
    notes = []
    if critical < scalings.min():
        notes.append("the critical scaling lies below all scalings shown: it is extrapolated")
    if float(scaling_d_prime(scalings.max(), critical, gain)) < HARDLY_SEEN:
        notes.append(HARDLY_SEEN_NOTE)
    return notes
