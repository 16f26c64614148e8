"""Goodness of fit of the population's curves: deviance, and residuals by level and over time."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from analysis.models.goodness import Misfit, misfits
from analysis.models.learning import Course, Trend, course, trend
from analysis.parts import Part, PartFigure, Shown
from analysis.parts.levels import SECTION, figure_axes, section_title
from analysis.parts.shared import condition, in_order
from analysis.plans.rates import RatePlan
from analysis.plots.levels import misfit_plot
from analysis.report.wording import (
    df_text,
    level_text,
    number,
    number_range,
    p_number,
    p_text,
    placed,
    size,
    t_text,
)
from protocols.blocks import Cautions, Paragraph, Picture, Table


@dataclass(frozen=True)
class Goodness:
    """Every number.

    Attributes
    ----------
    misfits : tuple of Misfit
        By condition.
    trend : Trend or None
        Of what answers are better than their curves, over the session; None without an order.
    course : Course or None
    """

    misfits: tuple[Misfit, ...]
    trend: Trend | None
    course: Course | None
    notes: tuple[str, ...] = ()


class GoodnessPart(Part[RatePlan, Goodness]):
    """How well the curves of the model of participants fit."""

    name: ClassVar[str] = "goodness"
    section: ClassVar[tuple[str, str]] = SECTION
    needs: ClassVar[tuple[str, ...]] = ("thresholds",)

    def wanted(self, _table: pd.DataFrame, plan: RatePlan) -> bool:
        """Return whether there is a level."""
        return plan.level is not None

    def compute(
        self,
        table: pd.DataFrame,
        plan: RatePlan,
        found: Mapping[str, Any],
        chance: np.random.Generator,
    ) -> Goodness:
        """Simulate studies of the model, and compare."""
        model = found.get("thresholds")
        if model is None or not model.population.proper:
            raise ValueError("")
        each, predicted = misfits(
            table, str(plan.level), table["condition"], model.population, chance
        )
        over, drawn, notes = None, None, []
        if plan.adaptive:
            notes.append("levels were chosen from the answers: the simulation takes them as given")
        if "order" in table and bool(table["order"].notna().any()):
            rows = table[["participant", "order"]].assign(outcome=table["correct"] - predicted)
            over, drawn = trend(rows, "outcome", level=plan.confidence), course(rows, "outcome")
            notes += over.warnings
        else:
            notes.append("no column order: residuals over the session are not tested")
        return Goodness(in_order(each, plan, lambda one: one.condition), over, drawn, tuple(notes))

    def show(self, found: Goodness, plan: RatePlan) -> Shown:
        """Return what the model's own studies are like, and where the answers lie among them."""
        over = found.trend
        deviances = Table.each(
            "Goodness of fit, by studies that the model simulates",
            found.misfits,
            condition(plan),
            ("Deviance", "strong", lambda one: size(one.deviance)),
            ("Simulated", "", lambda one: size(one.expected)),
            ("Counts", "", lambda one: str(one.cells)),
            ("p", "n", lambda one: p_number(one.p)),
            ("p adj.", "n", lambda one: p_number(one.p_adjusted)),
            ("Largest residual", "", lambda one: _largest(one)),
            ("p", "n", lambda one: p_number(one.level_p)),
            ("p adj.", "n", lambda one: p_number(one.level_p_adjusted)),
        )
        told = Paragraph(
            "Deviance: of each participant's counts from that participant's curve in the model."
            " Simulated: its mean over studies of this model. Residual: share of right answers"
            " observed - expected, at the level where it is least like the simulated ones. A small"
            " p says that the curves do not fit.",
            muted=True,
        )
        sessions: tuple[Table, ...] = ()
        if over is not None and np.isfinite(over.p):
            sessions = (
                Table.each(
                    "Residuals over the session: change from the first to the last trial",
                    [over],
                    ("Change", "strong", lambda one: placed(one, one.change)),
                    (plan.limits, "n", lambda one: number_range(one.lower, one.upper)),
                    ("df", "", lambda one: df_text(one.df)),
                    ("p", "n", lambda one: p_number(one.p)),
                ),
            )
        axes = figure_axes([one.levels for one in found.misfits], plan)
        draw = partial(misfit_plot, found.misfits, found.course, **axes)
        caption = (
            f"Residuals by {plan.level}: right answers observed - expected by participants' curves;"
            " bands: 95 % of studies that the model simulates"
            f"{'; right: over the session' * (found.course is not None)}."
        )
        lines = [
            {"condition": one.condition, "level": x, "residual": r, "lower": low, "upper": high}
            for one in found.misfits
            for x, r, low, high in zip(one.levels, one.residuals, one.lower, one.upper, strict=True)
        ]
        columns = ("condition", "deviance", "expected", "cells", "p", "p_adjusted", "level_p",
                   "level_p_adjusted")  # fmt: skip
        return Shown(
            title=section_title(plan),
            blocks=(
                Picture(self.name),
                deviances,
                told,
                *sessions,
                Cautions("About this goodness of fit", found.notes),
            ),
            sentences=(
                *(
                    f"Goodness of fit of {plan.label(one.condition)}: deviance"
                    f" {size(one.deviance)} of {one.cells} counts, {size(one.expected)} in"
                    f" simulated studies, {p_text(one.p)} ({p_number(one.p_adjusted)}"
                    f" Holm-adjusted); residuals by level {p_text(one.level_p)}"
                    f" ({p_number(one.level_p_adjusted)} Holm-adjusted)."
                    for one in found.misfits
                ),
                *(
                    [
                        "Residuals changed over the session by"
                        f" {placed(over, over.change)} (share of right answers),"
                        f" {level_text(plan.confidence)} {number_range(over.lower, over.upper)},"
                        f" {t_text(over.t, over.df)}, {p_text(over.p)}."
                    ]
                    if over is not None and np.isfinite(over.t)
                    else []
                ),
            ),
            methods=(
                "Goodness of fit was judged by a parametric bootstrap of the mixed model: deviance,"
                " and residuals at each level, of the answers against those of simulated studies"
                f"{_TIME * (over is not None)}."
            ),
            tables={
                "goodness.csv": pd.DataFrame(
                    [{name: getattr(one, name) for name in columns} for one in found.misfits]
                ),
                "residuals.csv": pd.DataFrame(lines),
            },
            figures=(PartFigure(self.name, caption, draw),),
        )


_TIME = "; residuals over the session by each participant's slope, in a t test"


def _largest(one: Misfit) -> str:
    """Return the residual that is least like the simulated ones, and at which level."""
    half = 0.5 * (np.array(one.upper) - np.array(one.lower))
    away = np.abs(np.array(one.residuals)) / np.maximum(half, 1e-9)
    k = int(np.argmax(away))
    return f"{number(one.residuals[k])} at {size(one.levels[k])}"
