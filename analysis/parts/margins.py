"""Marginal means of mixed models, and contrasts that a study names, as readers see them."""

import math
from collections.abc import Callable, Iterator

import numpy as np
import pandas as pd

from analysis.models.mixed.marginal_means import Margin, Margins
from analysis.parts import AnalysisPlan
from analysis.parts.shared import apa_p
from analysis.report.result_table import (
    DECIDES,
    T_DF,
    ResultColumn,
    ResultTable,
    attribute,
    deciding,
)
from analysis.report.values import frame_of
from analysis.report.wording import (
    NOT_IDENTIFIED,
    level_text,
    number,
    number_range,
    t_text,
)
from protocols.blocks import Block


def means_table(
    title: str, found: Margins, plan: AnalysisPlan, *more: ResultColumn[Margin]
) -> Iterator[Block]:
    """Yield the table of marginal means; `more` are columns beside the model's scale."""
    if found.means:
        yield ResultTable.of(
            title,
            found.means,
            attribute("Condition", "name", plan.label, "l c"),
            *_estimate("Mean", plan, float),
            *more,
        ).block()


def contrasts_table(
    found: Margins, plan: AnalysisPlan, unit: str, turned: Callable[[float], float] = float
) -> Iterator[Block]:
    """Yield the table of named contrasts; `turned` makes the model's scale that of the unit."""
    if found.contrasts:
        yield ResultTable.of(
            f"Contrasts of the mixed model's means, {unit}",
            found.contrasts,
            attribute("Contrast", "name", str, "l c"),
            ResultColumn("Weights", "l c", lambda one: weights_of(one.name, plan)),
            *_estimate("Estimate", plan, turned),
            T_DF,
            deciding("p_adjusted"),
        ).block()


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
            f" {number_range(*ends)}, {t_text(one.t, one.df)},"
            f" {apa_p(one.p, one.p_adjusted, 'mixed model')}."
        )


def margin_tables(found: Margins, name: str) -> dict[str, pd.DataFrame]:
    """Return means and contrasts on the model's scale as tables; `name` begins their files'."""
    kinds = {"means": found.means, "contrasts": found.contrasts}
    tables = {f"{name}_{kind}.csv": frame_of(own) for kind, own in kinds.items() if own}
    if found.contrasts:
        tables[f"{name}_contrasts.csv"][DECIDES] = "p_adjusted"
    return tables


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
) -> tuple[ResultColumn[Margin], ResultColumn[Margin]]:
    def ends(one: Margin) -> tuple[float, float]:
        return turned(one.lower), turned(one.upper)

    return (
        ResultColumn(title, "strong", lambda one: number(turned(one.value), within=ends(one))),
        ResultColumn(plan.limits, "n", lambda one: number_range(*ends(one))),
    )


def exponent(value: float) -> float:
    """Return e to a value of ln seconds, or of log odds."""
    return float(np.exp(value))
