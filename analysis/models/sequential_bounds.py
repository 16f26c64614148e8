"""Looking at data while they come: bounds that keep the error, and where a study stands."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.special import ndtr, ndtri, stdtrit

from analysis.arrays import Floats
from analysis.models.bayes_factor import t_bayes_factor
from analysis.models.tails import two_sided_p
from protocols.study_file.sequential import Sequential, SequentialRule

NODES = 400
"""Points of the integration between two bounds."""

NEVER = 1e-14
"""Nominal p below which a bound cannot be reached."""


@dataclass(frozen=True)
class SequentialPlan:
    """Bounds on p at which planned looks stop the study.

    Attributes
    ----------
    looks : tuple of int
        Participants at each.
    reject_p : tuple of float
        The result is significant, and the study may stop, where p is at most this.
    accept_p : tuple of float or None
        The study may stop for "no difference" where p is at least this; None where the rule, or
        so few people, cannot show it.
    spent : tuple of float or None
        Error spent up to each look; None of Bayes factors, which promise none.
    """

    rule: SequentialRule
    looks: tuple[int, ...]
    alpha: float
    reject_p: tuple[float, ...]
    accept_p: tuple[float | None, ...]
    spent: tuple[float | None, ...]
    bayes_factor: float


@dataclass(frozen=True)
class InterimResult:
    """State of a study at its last look, and the verdict.

    Attributes
    ----------
    look : int
        Looks that have come, 0: none yet.
    planned : bool
        The number of participants is that of a planned look.
    verdict : str
        "stop: significant", "stop: no difference", "go on", "end: not significant", or "wait".
    """

    look: int
    looks: int
    participants: int
    planned: bool
    p: float | None
    reject_p: float | None
    verdict: str
    sentence: str


@dataclass(frozen=True)
class SequentialError:
    """Error rates of a sequential plan over simulated studies.

    Attributes
    ----------
    stops : tuple of float
        Share of studies that stop as significant at each look.
    accepts : tuple of float
        Share that stop for "no difference" at each look.
    significant, accepted : float
        Over all looks.
    participants : float
        Mean number at the end.
    naive : float
        Share that would be significant at some look if each were tested at alpha.
    """

    stops: tuple[float, ...]
    accepts: tuple[float, ...]
    significant: float
    accepted: float
    participants: float
    naive: float
    studies: int


def spent(fraction: float, alpha: float, rule: SequentialRule) -> float:
    """Return the two-sided error that may be spent up to a share of the information.

    Lan and DeMets 1983 (Biometrika 70, 659-663): ``obrien-fleming``, 4 (1 - Phi(z / sqrt t)) with
    z the upper alpha / 4 point; ``pocock``, alpha ln(1 + (e - 1) t).
    """
    if rule == "obrien-fleming":
        z = -float(ndtri(alpha / 4.0))
        return float(min(alpha, 4.0 * ndtr(-z / np.sqrt(fraction))))
    return float(min(alpha, alpha * np.log1p((np.e - 1.0) * fraction)))


def critical_values(fractions: Sequence[float], alpha: float, rule: SequentialRule) -> Floats:
    """Return the z at each look beyond which a two-sided test stops.

    Parameters
    ----------
    fractions : sequence of float
        Information at each look as a share of the last, rising, in (0, 1].

    Raises
    ------
    ValueError
        If fractions do not rise, or leave (0, 1].

    Notes
    -----
    Armitage, McPherson and Rowe 1969: the density of the running sum within the bounds is carried
    from look to look by numerical integration, and each bound spends what its look may.
    """
    t = np.asarray(fractions, dtype=np.float64)
    if t.size == 0 or t[0] <= 0.0 or t[-1] > 1.0 + 1e-12 or np.any(np.diff(t) <= 0.0):
        raise ValueError(f"fractions must rise within (0, 1] (got {list(fractions)})")
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    bounds = np.zeros(t.size)
    before, place, mass = 0.0, np.zeros(1), np.ones(1)
    for k in range(t.size):
        step = float(np.sqrt(t[k] - (t[k - 1] if k else 0.0)))
        now = spent(float(t[k]), alpha, rule)
        due = max(now - before, 0.0)
        root = float(np.sqrt(t[k]))

        top = -float(ndtri(NEVER / 2.0))
        if _beyond(top, root, step, place, mass) >= due:
            bounds[k] = top
        else:
            bounds[k] = scipy.optimize.brentq(
                _excess, 0.0, top, (due, root, step, place, mass), 1e-12
            )
        edge = bounds[k] * root
        inner = edge * nodes
        density = scipy.stats.norm.pdf((inner[:, None] - place) / step) / step @ mass
        place, mass, before = inner, density * weights * edge, now
    return bounds


def _beyond(z: float, root: float, step: float, place: Floats, mass: Floats) -> float:
    """Return the chance to be beyond z at a look, and within all bounds before."""
    tails = ndtr((place - z * root) / step) + ndtr((-z * root - place) / step)
    return float(mass @ tails)


def _excess(z: float, due: float, root: float, step: float, place: Floats, mass: Floats) -> float:
    return _beyond(z, root, step, place, mass) - due


def plan_of(section: Sequential, alpha: float) -> SequentialPlan:
    """Return the bounds of a study's section ``[analysis.sequential]``."""
    looks = section.looks
    if section.rule == "bayes-factor":
        bound = section.bayes_factor
        return SequentialPlan(
            section.rule,
            looks,
            alpha,
            tuple(_p_at_factor(people, bound) or 0.0 for people in looks),
            tuple(_p_at_factor(people, 1.0 / bound) for people in looks),
            (None,) * len(looks),
            bound,
        )
    fractions = [people / looks[-1] for people in looks]
    z = critical_values(fractions, alpha, section.rule)
    return SequentialPlan(
        section.rule,
        looks,
        alpha,
        tuple(float(two_sided_p(value)) for value in z),
        (None,) * len(looks),
        tuple(spent(fraction, alpha, section.rule) for fraction in fractions),
        section.bayes_factor,
    )


def never_stops(plan: SequentialPlan, look: int, least: float) -> bool:
    """Return True if a look, counted from 0, cannot stop where no p is below `least`."""
    return plan.reject_p[look] < least and plan.accept_p[look] is None


def _p_at_factor(people: int, factor: float) -> float | None:
    """Return the p at which the default Bayes factor has this value; None where it never has.

    For so many people it falls as p rises, from p near 0 to p = 1 (t = 0).
    """

    def excess(log_p: float) -> float:
        t = -float(stdtrit(people - 1, 0.5 * np.exp(log_p)))
        return float(np.log(t_bayes_factor(t, people)) - np.log(factor))

    low, high = float(np.log(NEVER)), 0.0
    if excess(low) < 0.0 or excess(high) > 0.0:
        return None
    return float(np.exp(scipy.optimize.brentq(excess, low, high, xtol=1e-9)))


def standing(
    plan: SequentialPlan, people: int, p: float | None, judged: str, least: float = 0.0
) -> InterimResult:
    """Return the look at which a study with so many participants stands, and the meaning of p.

    `judged` says in words which p it is; they can show none below `least`.
    """
    look = sum(people >= planned for planned in plan.looks)
    last = look == len(plan.looks)
    planned = people in plan.looks or people > plan.looks[-1]
    upcoming = "" if last else f" The next look is at {plan.looks[look]} participants."
    count = f"{people} participant{'s' * (people != 1)}"
    if look == 0 or not planned or p is None:
        where = f"after look {look} of {len(plan.looks)}" if look else "before the first look"
        why = "no planned test can be made" if p is None else f"with {count} no look is planned"
        sentence = f"The study stands {where}: {why}. Do not decide now.{upcoming}"
        return InterimResult(look, len(plan.looks), people, planned, p, None, "wait", sentence)
    bound, accept = plan.reject_p[look - 1], plan.accept_p[look - 1]
    here = f"Look {look} of {len(plan.looks)} ({count})"
    rule = (
        f"Bayes factor of {plan.bayes_factor:g}"
        if plan.rule == "bayes-factor"
        else f"bound of the rule {plan.rule}"
    )
    is_ = f"p = {p:.4g} ({judged}) is"
    if p <= bound:
        verdict = "stop: significant"
        said = f"{is_} at most {bound:.4g}, the {rule}: significant; the study may stop."
    elif accept is not None and p >= accept:
        verdict = "stop: no difference"
        said = (
            f"{is_} at least {accept:.4g}, where the Bayes factor is"
            f" 1/{plan.bayes_factor:g}: the study may stop for no difference."
        )
    else:
        verdict = "end: not significant" if last else "go on"
        end = "not significant; the study ends here." if last else "not yet; go on."
        said = f"{is_} above {bound:.4g}, the {rule}: {end}{upcoming}"
        if never_stops(plan, look - 1, least):
            said += f" This look could never stop the study: no p below {least:.2g} can be had."
    return InterimResult(
        look, len(plan.looks), people, planned, p, bound, verdict, f"{here}: {said}"
    )


def sequential_error(plan: SequentialPlan, p_values: Floats) -> SequentialError:
    """Run a plan over simulated studies.

    Parameters
    ----------
    p_values : ndarray (studies, looks)
        Of the planned test with the first so many participants of one study each.
    """
    p = np.asarray(p_values, dtype=np.float64)
    significant = p <= np.array(plan.reject_p)
    accept = np.array([np.inf if bound is None else bound for bound in plan.accept_p])
    accepted = ~significant & (p >= accept)
    ended = significant | accepted
    first = np.where(ended.any(axis=1), ended.argmax(axis=1), len(plan.looks) - 1)
    rows = np.arange(len(p))
    stops = np.array([np.mean((first == k) & significant[rows, first])
                      for k in range(len(plan.looks))])  # fmt: skip
    accepts = np.array([np.mean((first == k) & accepted[rows, first])
                        for k in range(len(plan.looks))])  # fmt: skip
    return SequentialError(
        stops=tuple(map(float, stops)),
        accepts=tuple(map(float, accepts)),
        significant=float(stops.sum()),
        accepted=float(accepts.sum()),
        participants=float(np.array(plan.looks)[first].mean()),
        naive=float(np.mean((p < plan.alpha).any(axis=1))),
        studies=len(p),
    )
