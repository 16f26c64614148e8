"""Slopes of psychometric functions, compared between conditions."""

import math
from dataclasses import dataclass, field
from typing import ClassVar

import pandas as pd

from analysis.data_dictionary import frame_of
from analysis.models.contrasts import Difference
from analysis.models.curves.population import Population, Threshold
from analysis.parts import Presentation
from analysis.parts.levels import LevelsPart, population_model, threshold_cells, width_title
from analysis.parts.shared import TESTED, apa_test, compared, in_order
from analysis.plans.rate_plan import RatePlan, shown_in
from analysis.report.wording import level_text, number, number_range
from protocols.blocks import Cautions, TableBlock


@dataclass(frozen=True)
class Slopes:
    """Every number, of a model in which each condition has a slope of its own.

    Attributes
    ----------
    thresholds : tuple of Threshold
        With widths.
    ratios : tuple of Difference
        Of natural logarithms of slopes at the threshold.
    log_likelihood : float
    """

    thresholds: tuple[Threshold, ...]
    ratios: tuple[Difference, ...]
    log_likelihood: float
    population: Population = field(repr=False)
    notes: tuple[str, ...] = ()


class SlopesPart(LevelsPart[Slopes]):
    """Slopes at the threshold in the population."""

    name: ClassVar[str] = "slopes"

    def wanted(self, table: pd.DataFrame, plan: RatePlan) -> bool:
        """Return True if several conditions have levels, and several people answered."""
        several = len(shown_in(table, plan)) > 1 and table["participant"].nunique() > 1
        return super().wanted(table, plan) and several

    def of(self, table: pd.DataFrame, plan: RatePlan) -> Slopes:
        """Fit the model, and compare."""
        model = population_model(table, plan, own_widths=True)
        if any(math.isnan(one.value) for one in model.thresholds):
            raise ValueError("the answers do not place the threshold of each condition")
        return Slopes(
            thresholds=in_order(model.thresholds, plan, lambda one: one.condition),
            ratios=in_order(model.population.slope_ratios(), plan, lambda one: one.first),
            log_likelihood=model.log_likelihood,
            population=model.population,
            notes=_notes(model.population, plan),
        )

    def show(self, found: Slopes, plan: RatePlan) -> Presentation:
        """Return slopes' ratios, and the model that they come from."""
        ratios = found.ratios
        lines = frame_of(Difference, ratios)
        for name in ("difference", "lower", "upper"):
            lines[name.replace("difference", "ratio")] = lines[name].map(math.exp)
        return Presentation(
            title=self.title(plan),
            blocks=(
                TableBlock.of(
                    "Slopes in the population: the same model, with a width of each condition",
                    (
                        ("Condition", "l c"),
                        ("Threshold", ""),
                        (plan.limits, "n"),
                        (width_title(plan.logarithmic), "strong"),
                    ),
                    [
                        (
                            plan.label(one.condition),
                            *threshold_cells(True, one.value, (one.lower, one.upper), one.width),
                        )
                        for one in found.thresholds
                    ],
                ),
                TableBlock.each(
                    "Ratios of slopes at the threshold (the inverse of widths)",
                    ratios,
                    compared(plan, "/"),
                    ("Ratio", "strong", lambda one: _ratio(one)[0]),
                    (plan.limits, "n", lambda one: _ratio(one)[1]),
                    *TESTED,
                ),
                Cautions("About these slopes", found.notes),
            ),
            sentences=tuple(
                f"The slope at the threshold of {plan.label(one.first)} was {_ratio(one)[0]} times"
                f" that of {plan.label(one.second)}, {level_text(one.level)} {_ratio(one)[1]},"
                f" {apa_test(one)}."
                for one in ratios
            ),
            methods=(
                "Slopes at the threshold were compared in a model in which each condition has a"
                " width of its own, on logarithms, by t with degrees of freedom of participants -"
                " 1; limits are the wider of the model's and of those from how participants'"
                " scores differ (sandwich)."
            ),
            tables={"slopes.csv": lines},
        )


def _notes(population: Population, plan: RatePlan) -> tuple[str, ...]:
    """Return notes on levels that do not tell the slope of a condition, and on their choice."""
    notes = [
        f"{plan.label(name)}: the width is near the gap between two levels, which do not tell how"
        " steep the curve is: its slope is not compared"
        for name in population.narrow
    ]
    if plan.adaptive:
        notes.append("levels were chosen from the answers: curves come out steeper than they are")
    return tuple(notes)


def _ratio(one: Difference) -> tuple[str, str]:
    """Return a ratio and its limits as text."""
    ends = math.exp(one.lower), math.exp(one.upper)
    return number(math.exp(one.difference), within=ends), number_range(*ends)
