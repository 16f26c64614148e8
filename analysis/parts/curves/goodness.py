"""Goodness of fit of the population's curves: deviance, and residuals by level and over time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
import pandas as pd
from numpy.random import Generator

from analysis.arrays import Floats
from analysis.models.cells import grid
from analysis.models.critical_scaling import CriticalModel, critical_misfits
from analysis.models.curves.goodness_of_fit import Misfit, misfits
from analysis.models.numeric import ROUNDING
from analysis.models.trends import Course, Trend, course, trend
from analysis.parts import Part, PartFigure, PartNumbers, Presentation
from analysis.parts.levels import SECTION, figure_axes, section_title
from analysis.parts.shared import apa_p, condition, in_order
from analysis.plans.rate_plan import RatePlan
from analysis.plots.psychometric_plots import misfit_plot
from analysis.report.result_table import (
    T_DF,
    ResultColumn,
    ResultTable,
    attribute,
    deciding,
    estimated,
    limits,
    p_value,
    set_aside,
)
from analysis.report.wording import (
    level_text,
    number,
    number_range,
    p_text,
    placed,
    size,
    t_text,
)
from protocols.blocks import Cautions, FigurePlace, Paragraph, TableBlock

SIMULATED = "studies that the model simulates"


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
    """Goodness of fit of the curves of participants in one model."""

    name: ClassVar[str] = "goodness"
    section: ClassVar[tuple[str, str]] = SECTION
    needs: ClassVar[tuple[str, ...]] = ("thresholds", "critical")

    def wanted(self, table: pd.DataFrame, plan: RatePlan) -> bool:
        """Return True if there is a level, and a model of several people along it."""
        return plan.level is not None and table["participant"].nunique() > 1

    def compute(
        self, table: pd.DataFrame, plan: RatePlan, found: PartNumbers, chance: Generator
    ) -> Goodness:
        """Simulate studies of the model, and compare."""
        model, over, drawn, notes = found.get("thresholds"), None, None, []
        level = str(plan.level)
        critical = found.get("critical")
        if critical is not None:
            each, predicted = _of_scalings(critical, table, plan, chance)
        elif model is not None and model.population.proper:
            each, predicted = misfits(table, level, table["condition"], model.population, chance)
        else:
            raise ValueError("goodness of fit is of curves in the population: there are none")
        if plan.adaptive:
            notes.append("levels were chosen from the answers: the simulation takes them as given")
        if "order" in table and bool(table["order"].notna().any()):
            rows = table[["participant", "order"]].assign(outcome=table["correct"] - predicted)
            rows = rows.dropna()
            over, drawn = trend(rows, "outcome", level=plan.confidence), course(rows, "outcome")
            notes += over.warnings
        else:
            notes.append("no column order: residuals over the session are not tested")
        return Goodness(
            misfits=in_order(each, plan, lambda one: one.condition),
            trend=over,
            course=drawn,
            notes=tuple(notes),
        )

    def show(self, found: Goodness, plan: RatePlan) -> Presentation:
        """Return a picture of the model's own studies, and of the answers' place among them."""
        over = found.trend
        deviances = _deviances(found, plan)
        told = Paragraph(
            "Deviance: of each participant's counts from that participant's curve in the model."
            f" Simulated: its mean over {SIMULATED}. A small p says that the curves do not fit.",
            muted=True,
        )
        axes = figure_axes([one.levels for one in found.misfits], plan)
        draw = partial(misfit_plot, found.misfits, found.course, **axes)
        caption = (
            f"Residuals by {plan.level}: right answers observed - expected by the curves;"
            f" bands: 95 % of {SIMULATED}"
            f"{'; right: over the session' * (found.course is not None)}."
        )
        return Presentation(
            title=section_title(plan),
            blocks=(
                FigurePlace(self.name),
                deviances.block(),
                told,
                *([_over_session(over, plan)] if over and np.isfinite(over.p) else []),
                Cautions("About this goodness of fit", found.notes),
            ),
            others=(
                deviances.folded(
                    "Largest residual by level",
                    "It shows where the curves miss; the deviance judges all levels together."
                    " p adj. is Holm's over all.",
                ),
            ),
            sentences=tuple(_sentences(found, plan)),
            methods=(
                "Goodness of fit was judged by a parametric bootstrap of the mixed model: deviance,"
                " and residuals at each level, of the answers against simulated ones"
                f"{_TIME * (over is not None)}."
            ),
            tables={"goodness.csv": deviances.frame(), "residuals.csv": _residuals(found.misfits)},
            figures=(PartFigure(self.name, caption, draw),),
        )


def _deviances(found: Goodness, plan: RatePlan) -> ResultTable[Misfit]:
    return ResultTable.of(
        f"Goodness of fit, by {SIMULATED}",
        found.misfits,
        condition(plan),
        attribute("Deviance", "deviance", size, "strong"),
        attribute("Simulated", "expected", size),
        attribute("Counts", "cells", str),
        deciding("p_adjusted"),
        set_aside(ResultColumn("Largest residual", "", _largest)),
        p_value("p", "level_p"),
        p_value("p adj.", "level_p_adjusted"),
    )


def _over_session(over: Trend, plan: RatePlan) -> TableBlock:
    return (
        ResultTable[Trend]
        .of(
            "Residuals over the session: change from the first to the last trial",
            [over],
            estimated("Change", "change"),
            limits(plan.limits),
            T_DF,
            deciding(),
        )
        .block()
    )


def _residuals(each: Sequence[Misfit]) -> pd.DataFrame:
    return pd.DataFrame(
        {"condition": one.condition, "level": x, "residual": r, "lower": low, "upper": high}
        for one in each
        for x, r, low, high in zip(one.levels, one.residuals, one.lower, one.upper, strict=True)
    )


def _sentences(found: Goodness, plan: RatePlan) -> Iterator[str]:
    for one in found.misfits:
        yield (
            f"Goodness of fit of {plan.label(one.condition)}: deviance {size(one.deviance)} of"
            f" {one.cells} counts, {size(one.expected)} where simulated,"
            f" {apa_p(one.p, one.p_adjusted)}."
        )
    over = found.trend
    if over is not None and np.isfinite(over.t):
        yield (
            f"Residuals changed over the session by {placed(over, over.change)} (share of right"
            f" answers), {level_text(plan.confidence)} {number_range(over.lower, over.upper)},"
            f" {t_text(over.t, over.df)}, {p_text(over.p)}."
        )
    if over is not None and over.participants < 2 and np.isfinite(over.spearman_p):
        yield (
            "The rank correlation of residuals with the order of trials was"
            f" \N{GREEK SMALL LETTER RHO} = {number(over.spearman_rho)}, {p_text(over.spearman_p)}."
        )


def _of_scalings(
    model: CriticalModel, table: pd.DataFrame, plan: RatePlan, chance: np.random.Generator
) -> tuple[tuple[Misfit, ...], Floats]:
    """Return the distance of answers from the model of critical scalings, and the chance of each.

    These, and not the general curves, are what a study of scalings is about.
    """
    each, shares = critical_misfits(model, chance)
    names = sorted(fit.condition for fit in model.fits)
    levels = pd.to_numeric(table[str(plan.level)]).to_numpy(dtype=np.float64)
    predicted = shares[
        np.searchsorted(names, table["condition"].astype(str)),
        grid(table).person,
        np.searchsorted(model.likelihood.scalings, levels),
    ]
    return each, predicted


_TIME = "; residuals over the session by each participant's slope, in a t test"


def _largest(one: Misfit) -> str:
    """Return the residual that is least like the simulated ones, and at which level."""
    half = 0.5 * (np.array(one.upper) - np.array(one.lower))
    away = np.abs(np.array(one.residuals)) / np.maximum(half, 1e-9)
    k = int(np.argmax(away >= away.max() - ROUNDING))
    return f"{number(one.residuals[k])} at {size(one.levels[k])}"
