"""The main numbers of right and wrong answers, in short."""

from collections.abc import Sequence

import pandas as pd

from analysis.plans.rates import RateSettings, baseline_in, prepared, shown_in
from analysis.rates import Difference, correct_rates, rate_contrasts
from analysis.tasks.base import Estimate
from analysis.thresholds import fit_thresholds


def rate_estimates(decisions: pd.DataFrame, settings: RateSettings) -> tuple[Estimate, ...]:
    """Return shares of right answers and what they differ by; thresholds where levels adapt.

    Raises
    ------
    ValueError
        If nothing can be said of these decisions.
    """
    rows = prepared(decisions, settings)
    count = rows["condition"].value_counts()
    shown, reference = shown_in(rows, settings), baseline_in(rows, settings)
    if settings.adaptive and settings.level is not None:
        model = fit_thresholds(
            rows,
            settings.level,
            ("condition",),
            guess=settings.chance,
            shape=settings.shape,
            falling=settings.falling,
            logarithmic=settings.shape == "weibull",
            reference=reference,
            level=settings.confidence,
        )
        return difference_estimates(model.contrasts, settings, count)
    rates = correct_rates(rows, ("condition",), chance=settings.chance, level=settings.confidence)
    found = [
        Estimate(
            f"right answers, {settings.label(one.condition)}",
            one.share,
            one.lower,
            one.upper,
            one.p,
            one.trials,
        )
        for one in sorted(rates, key=lambda one: shown.index(one.condition))
    ]
    if reference is None or rows["participant"].nunique() < 2:
        return tuple(found)
    compared = rate_contrasts(rows, ("condition",), reference=reference, level=settings.confidence)
    return (*found, *difference_estimates(compared, settings, count))


def difference_estimates(
    several: Sequence[Difference], settings: RateSettings, count: pd.Series
) -> tuple[Estimate, ...]:
    """Return differences as estimates; `count` holds the decisions of each condition."""
    return tuple(
        Estimate(
            f"{settings.label(one.first)} - {settings.label(one.second)}, {one.measure}",
            one.difference,
            one.lower,
            one.upper,
            one.p_adjusted,
            int(count[one.first] + count[one.second]),
        )
        for one in several
    )
