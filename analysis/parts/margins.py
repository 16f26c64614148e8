"""Marginal means of mixed models, and contrasts that a study names, as readers see them."""

import math
from collections.abc import Callable, Iterator

import numpy as np
import pandas as pd

from analysis.data_dictionary import frame_of
from analysis.models.mixed.marginal_means import Margin, Margins
from analysis.parts import AnalysisPlan
from analysis.parts.shared import TableColumn, adjusted
from analysis.report.wording import (
    NOT_IDENTIFIED,
    level_text,
    number,
    number_range,
    p_number,
    p_text,
    t_number,
    t_text,
)
from protocols.blocks import Block, TableBlock


def means_table(
    title: str, found: Margins, plan: AnalysisPlan, *more: TableColumn
) -> Iterator[Block]:
    """Yield the table of marginal means; `more` are columns beside the model's scale."""
    if found.means:
        yield TableBlock.each(
            title,
            found.means,
            ("Condition", "l c", lambda one: plan.label(one.name)),
            *_estimate("Mean", plan, float),
            *more,
        )


def contrasts_table(
    found: Margins, plan: AnalysisPlan, unit: str, turned: Callable[[float], float] = float
) -> Iterator[Block]:
    """Yield the table of named contrasts; `turned` makes the model's scale that of the unit."""
    if found.contrasts:
        yield TableBlock.each(
            f"Contrasts of the mixed model's means, {unit}",
            found.contrasts,
            ("Contrast", "l c", lambda one: one.name),
            ("Weights", "l c", lambda one: weights_of(one.name, plan)),
            *_estimate("Estimate", plan, turned),
            ("t(df)", "n", lambda one: t_number(one.t, one.df)),
            ("p", "n", lambda one: p_number(one.p)),
            ("p adj.", "n", lambda one: p_number(one.p_adjusted)),
        )


def contrast_sentences(
    found: Margins, plan: AnalysisPlan, unit: str, turned: Callable[[float], float] = float
) -> Iterator[str]:
    """Yield each named contrast as a sentence."""
    for one in found.contrasts:
        about = f"Contrast {one.name} ({weights_of(one.name, plan)})"
        if math.isnan(one.value):
            yield f"{about} is {NOT_IDENTIFIED}."
            continue
        ends = turned(one.lower), turned(one.upper)
        yield (
            f"{about}: {number(turned(one.value), within=ends)} {unit}, {level_text(one.level)}"
            f" {number_range(*ends)}, {t_text(one.t, one.df)}, {p_text(one.p)}"
            f"{adjusted(one.p, one.p_adjusted, 'mixed model')}."
        )


def margin_tables(found: Margins, name: str) -> dict[str, pd.DataFrame]:
    """Return means and contrasts on the model's scale as tables; `name` begins their files'."""
    kinds = {"means": found.means, "contrasts": found.contrasts}
    return {f"{name}_{kind}.csv": frame_of(Margin, own) for kind, own in kinds.items() if own}


def weights_of(name: str, plan: AnalysisPlan) -> str:
    """Return the weights of a contrast: ``1 ours - 0.5 blur - 0.5 none``."""
    parts = [
        f"{'-' if own < 0 else '+'} {abs(own):.3g} {plan.label(one)}"
        for one, own in plan.contrasts[name].items()
        if own
    ]
    return " ".join(parts).removeprefix("+ ")


def _estimate(
    title: str, plan: AnalysisPlan, turned: Callable[[float], float]
) -> tuple[TableColumn, TableColumn]:
    def ends(one: Margin) -> tuple[float, float]:
        return turned(one.lower), turned(one.upper)

    return (
        (title, "strong", lambda one: number(turned(one.value), within=ends(one))),
        (plan.limits, "n", lambda one: number_range(*ends(one))),
    )


def exponent(value: float) -> float:
    """Return e to a value of ln seconds, or of log odds."""
    return float(np.exp(value))
