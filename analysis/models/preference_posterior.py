"""A preference as a posterior: a hierarchical model, its ROPE, and what the prior does to it.

Needs NumPyro, the extra `bayes`; without it the module imports, and the fit refuses.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
from scipy.special import expit

from analysis.arrays import Floats
from analysis.models.compared_methods import counts, pairing_rows
from protocols.errors import StudyError
from protocols.prose import count_of

Verdict = Literal["preferred", "other preferred", "practically equal", "undecided"]

CHAINS = 4
WARM_UP = 500
DRAWS = 1000

WORST_R_HAT = 1.01
LEAST_DRAWS = 400
"""Effective draws below which a limit is not told by a digit or two."""

SHIFTED = 0.02
"""A share that moves by more with another prior is the prior's as much as the data's."""

_CURE = (
    "install it with: pip install 'metamerlab[bayes]' (in a checkout: pip install -e '.[bayes]')"
)


@dataclass(frozen=True)
class Prior:
    """Belief before the data, in logits.

    `typical_sd` is of a normal law of the typical choice, around none; `spread_sd` of the
    half-normal laws of the deviations between participants and between scenes.
    """

    typical_sd: float = 1.5
    spread_sd: float = 1.0


PRIORS: Mapping[str, Prior] = {
    "default": Prior(),
    "narrow": Prior(0.75, 0.5),
    "wide": Prior(3.0, 2.0),
}
"""The default, at which a share is nearly even over 0 to 1; half, and twice, as wide."""


@dataclass(frozen=True)
class Posterior:
    """Median, central limits and standard deviation of one number."""

    median: float
    mean: float
    sd: float
    lower: float
    upper: float


@dataclass(frozen=True)
class PriorCheck:
    """The share under one prior."""

    prior: str
    share: Posterior
    in_rope: float
    verdict: Verdict


@dataclass(frozen=True)
class BayesianPreference:
    """Posterior of how often `method` is chosen over `against`.

    Attributes
    ----------
    share : Posterior
        Of the population: the mean over people and scenes that could have been drawn.
    typical : Posterior
        Logit of the typical person's choice at the typical scene, as the mixed model's intercept.
    participant_sd, scene_sd : Posterior
        Logits; `scene_sd` of 0 where there is one scene.
    better : float
        Posterior probability that the share is above one half.
    in_rope : float
        Posterior probability that it is within `margin` of one half.
    verdict : str
        "preferred" or "other preferred" where the limits lie outside the region of practical
        equivalence, "practically equal" where they lie inside, else "undecided" (Kruschke 2018).
    r_hat, effective_draws, divergences
        Worst over all numbers; whether the sampler can be trusted.
    """

    method: str
    against: str
    margin: float
    level: float
    share: Posterior
    typical: Posterior
    participant_sd: Posterior
    scene_sd: Posterior
    better: float
    in_rope: float
    verdict: Verdict
    sensitivity: tuple[PriorCheck, ...]
    trials: int
    participants: int
    scenes: int
    r_hat: float
    effective_draws: float
    divergences: int
    warnings: tuple[str, ...]

    @property
    def unidentified(self) -> tuple[str, ...]:
        """Fields that the sampler did not find: its chains disagree."""
        return _SAMPLED if self.r_hat > WORST_R_HAT or self.effective_draws < LEAST_DRAWS else ()


_SAMPLED = (
    "share", "typical", "participant_sd", "scene_sd", "better", "in_rope", "verdict", "sensitivity"
)  # fmt: skip


def bayesian_preference(
    decisions: pd.DataFrame,
    method: str,
    against: str,
    *,
    margin: float = 0.1,
    level: float = 0.95,
    priors: Mapping[str, Prior] = PRIORS,
    seed: int = 0,
) -> BayesianPreference:
    """Sample the posterior of a preference with participants and scenes as random.

    Parameters
    ----------
    decisions : DataFrame, one row per decision
        ``participant``, ``scene``, ``first``, ``second``, ``chosen``.
    margin : float
        Half the region of practical equivalence, as a distance of the share from one half.
    priors : mapping of name to Prior
        The first decides; the others stand beside.

    Raises
    ------
    StudyError
        If NumPyro is missing.
    ValueError
        If no decision compares the two, or of one participant only.

    Notes
    -----
    logit p = typical + participant + scene, effects normal, four chains of NUTS (Hoffman and
    Gelman 2014). The model of `models.glmm_logit`; it differs in the priors, and in that
    deviations near 0 are averaged over, not put at their most likely value.
    """
    rows = pairing_rows(decisions, method, against)
    if rows.empty:
        raise ValueError(f"no decision compares {method} with {against}")
    chosen, shown, people, scenes = counts(rows, method)
    if len(people) < 2:
        raise ValueError("decisions must be of two participants at least")
    found = dict(zip(priors, _sampled(chosen, shown, list(priors.values()), seed), strict=True))
    checks = tuple(
        PriorCheck(name, _posterior(one.share, level), *_verdict(one.share, margin, level))
        for name, one in found.items()
    )
    first = next(iter(found.values()))
    return BayesianPreference(
        method=method,
        against=against,
        margin=margin,
        level=level,
        share=checks[0].share,
        typical=_posterior(first.typical, level),
        participant_sd=_posterior(first.participant_sd, level),
        scene_sd=_posterior(first.scene_sd, level),
        better=float(np.mean(first.share > 0.5)),
        in_rope=checks[0].in_rope,
        verdict=checks[0].verdict,
        sensitivity=checks,
        trials=int(shown.sum()),
        participants=len(people),
        scenes=len(scenes),
        r_hat=first.r_hat,
        effective_draws=first.effective_draws,
        divergences=first.divergences,
        warnings=tuple(_notes(first, checks, len(people))),
    )


@dataclass(frozen=True)
class _Draws:
    share: Floats
    typical: Floats
    participant_sd: Floats
    scene_sd: Floats
    r_hat: float
    effective_draws: float
    divergences: int


def _sampled(
    chosen: Floats, shown: Floats, priors: Sequence[Prior], seed: int
) -> tuple[_Draws, ...]:
    """Run the chains under each prior, and return the draws of all chains together.

    Priors are arguments of the model, so that it is compiled once.
    """
    try:
        import jax
        import numpyro
        from numpyro import distributions as laws
        from numpyro.infer import MCMC, NUTS
    except ImportError:
        raise StudyError(f"a Bayesian fit needs NumPyro, which is not here; {_CURE}") from None
    person, scene = np.nonzero(shown)
    votes, total = chosen[person, scene], shown[person, scene]
    crossed = shown.shape[1] > 1

    def model(typical_sd: Any, spread_sd: Any) -> None:
        eta = numpyro.sample("typical", laws.Normal(0.0, typical_sd))
        for name, index, count in (
            ("participant", person, shown.shape[0]),
            *((("scene", scene, shown.shape[1]),) if crossed else ()),
        ):
            sd = numpyro.sample(f"{name}_sd", laws.HalfNormal(spread_sd))
            with numpyro.plate(f"{name}s", count):
                effect = numpyro.sample(name, laws.Normal(0.0, 1.0))
            eta = eta + sd * effect[index]
        numpyro.sample("votes", laws.Binomial(total_count=total, logits=eta), obs=votes)

    chains: Any = MCMC(
        NUTS(model, target_accept_prob=0.9),
        num_warmup=WARM_UP,
        num_samples=DRAWS,
        num_chains=CHAINS,
        chain_method="vectorized",
        progress_bar=False,
        jit_model_args=True,
    )
    found = []
    for place, prior in enumerate(priors):
        widths = (np.float32(prior.typical_sd), np.float32(prior.spread_sd))
        chains.run(jax.random.PRNGKey(seed + place), *widths, extra_fields=("diverging",))
        found.append(_draws(chains))
    return tuple(found)


def _draws(chains: Any) -> _Draws:
    from numpyro.diagnostics import summary

    by_chain = {
        name: np.asarray(values, dtype=np.float64)
        for name, values in chains.get_samples(group_by_chain=True).items()
        if values.ndim == 2
    }
    told = summary(by_chain)
    draws = {name: values.reshape(-1) for name, values in by_chain.items()}
    scene_sd = draws.get("scene_sd", np.zeros_like(draws["typical"]))
    spread = np.hypot(draws["participant_sd"], scene_sd)
    nodes, weights = np.polynomial.hermite_e.hermegauss(31)
    share = expit(draws["typical"][:, None] + spread[:, None] * nodes) @ (weights / weights.sum())
    return _Draws(
        share=share,
        typical=draws["typical"],
        participant_sd=draws["participant_sd"],
        scene_sd=scene_sd,
        r_hat=max(float(one["r_hat"]) for one in told.values()),
        effective_draws=min(float(one["n_eff"]) for one in told.values()),
        divergences=int(np.asarray(chains.get_extra_fields()["diverging"]).sum()),
    )


def _posterior(draws: Floats, level: float) -> Posterior:
    lower, median, upper = np.quantile(draws, [0.5 - 0.5 * level, 0.5, 0.5 + 0.5 * level])
    return Posterior(
        float(median), float(draws.mean()), float(draws.std(ddof=1)), float(lower), float(upper)
    )


def _verdict(share: Floats, margin: float, level: float) -> tuple[float, Verdict]:
    """Return the probability of practical equivalence, and what the limits say."""
    found = _posterior(share, level)
    inside = float(np.mean(np.abs(share - 0.5) < margin))
    if found.lower > 0.5 + margin:
        return inside, "preferred"
    if found.upper < 0.5 - margin:
        return inside, "other preferred"
    if found.lower > 0.5 - margin and found.upper < 0.5 + margin:
        return inside, "practically equal"
    return inside, "undecided"


def _notes(first: _Draws, checks: Sequence[PriorCheck], people: int) -> list[str]:
    notes = []
    if first.r_hat > WORST_R_HAT or first.effective_draws < LEAST_DRAWS:
        notes.append(
            f"the chains do not agree well (r-hat {first.r_hat:.3f},"
            f" {first.effective_draws:.0f} effective draws): nothing is reported"
        )
    if first.divergences:
        notes.append(f"{count_of(first.divergences, 'draw')} diverged: limits may be wrong")
    moved = max(abs(one.share.median - checks[0].share.median) for one in checks)
    if moved > SHIFTED or len({one.verdict for one in checks}) > 1:
        notes.append(
            f"the prior matters: with another the share moves by up to {moved:.3f}; report all of"
            " them"
        )
    if people < 6:
        notes.append(
            f"only {count_of(people, 'participant')}: the prior says much about how people differ"
        )
    return notes
