"""Thresholds at a stated performance, such as 75 % right answers or d' = 1."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from analysis.data_dictionary import frame_of
from analysis.models.contrasts import Difference
from analysis.models.curves.population import Population, Threshold
from analysis.parts import Part, Presentation
from analysis.parts.levels import (
    SECTION,
    Counts,
    counts_in,
    curves_figure,
    section_title,
    threshold_cells,
    threshold_lines,
)
from analysis.parts.shared import apa_difference, difference_tables, in_order, law_of_mixed
from analysis.plans.rate_plan import RatePlan
from analysis.plots.psychometric_plots import DrawnCurve
from analysis.report.wording import NOT_IDENTIFIED, level_text, share, size, size_range
from protocols.blocks import Cautions, FigurePlace, Paragraph, TableBlock
from protocols.tasks.rates import performance_in_words


@dataclass(frozen=True)
class StatedThresholds:
    """Every number.

    Attributes
    ----------
    share : float
        Of right answers, at which thresholds are.
    own_widths : bool
        Whether each condition has a width of its own.
    thresholds : tuple of Threshold
    contrasts : tuple of Difference
        Of thresholds; of their natural logarithms where levels are logarithmic.
    """

    share: float
    own_widths: bool
    thresholds: tuple[Threshold, ...]
    contrasts: tuple[Difference, ...]
    counts: Mapping[str, Counts] = field(repr=False)
    population: Population = field(repr=False)
    notes: tuple[str, ...] = ()


class StatedPart(Part[RatePlan, StatedThresholds]):
    """The level at which the typical participant has the share of right answers that is stated."""

    name: ClassVar[str] = "stated_thresholds"
    section: ClassVar[tuple[str, str]] = SECTION
    needs: ClassVar[tuple[str, ...]] = ("thresholds", "slopes")

    def wanted(self, _table: pd.DataFrame, plan: RatePlan) -> bool:
        """Return True if a performance is stated."""
        return plan.level is not None and plan.threshold_at is not None

    def compute(
        self,
        table: pd.DataFrame,
        plan: RatePlan,
        found: Mapping[str, Any],
        _chance: np.random.Generator,
    ) -> StatedThresholds:
        """Return the levels at which the curves of the population reach the share."""
        stated = plan.stated_share
        if "thresholds" not in found or stated is None:
            raise ValueError("")
        own_widths = "slopes" in found
        population = found["slopes" if own_widths else "thresholds"].population
        guess, lapse = population.rates()
        if not guess < stated < 1.0 - lapse:
            raise ValueError(
                f"{share(stated)} right answers must lie between guessing ({share(guess)}) and what"
                f" lapses leave ({share(1.0 - lapse)})"
            )
        thresholds, contrasts = population.thresholds(stated)
        return StatedThresholds(
            share=stated,
            own_widths=own_widths,
            thresholds=in_order(thresholds, plan, lambda one: one.condition),
            contrasts=in_order(contrasts, plan, lambda one: one.first),
            counts=counts_in(table, plan),
            population=population,
        )

    def show(self, found: StatedThresholds, plan: RatePlan) -> Presentation:
        """Return thresholds, what differs, and the curves with the share that is stated."""
        assert plan.threshold_at is not None
        at = performance_in_words(plan.threshold_at)
        if isinstance(plan.threshold_at, str):
            at += f" ({100 * found.share:.3g} % right answers of an unbiased observer)"
        placed = [one.identified(found.population.levels) for one in found.thresholds]
        widths = "a width of each condition" if found.own_widths else "one width"
        differing = "natural logarithms of thresholds" if plan.logarithmic else "thresholds"
        scenes = "scene" in found.population.sd
        curves = {
            one.condition: DrawnCurve(
                partial(found.population.average, one.condition),
                partial(found.population.average_limits, one.condition),
                (one.value, one.lower, one.upper),
            )
            for one, known in zip(found.thresholds, placed, strict=True)
            if known
        }
        table = TableBlock.of(
            f"Thresholds in the population at {at}",
            (("Condition", "l c"), ("Threshold", "strong"), (plan.limits, "n")),
            [
                (plan.label(one.condition),
                 *threshold_cells(known, one.value, (one.lower, one.upper), one.width)[:2])
                for one, known in zip(found.thresholds, placed, strict=True)
            ],
        )  # fmt: skip
        told = Paragraph(
            f"The level at which the typical participant reaches {at}, by the model of"
            f" participants with {widths}. The thresholds above are half of the way from guessing"
            " to lapsing instead.",
            muted=True,
        )
        figure = curves_figure(
            self.name,
            f"the mean curve of people like these, and thresholds at {at} of the typical one",
            found.counts,
            curves,
            plan,
        )
        parts = [
            f"{plan.label(one.condition)} {size(one.value, within=(one.lower, one.upper))},"
            f" {level_text(plan.confidence)} {size_range((one.lower, one.upper))}"
            if known
            else f"{plan.label(one.condition)} {NOT_IDENTIFIED}"
            for one, known in zip(found.thresholds, placed, strict=True)
        ]
        return Presentation(
            title=section_title(plan),
            blocks=(
                FigurePlace(self.name),
                table,
                told,
                *difference_tables(f"Differences of {differing} at {at}", found.contrasts, plan),
                Cautions("When not to trust these thresholds", found.notes),
            ),
            sentences=(
                f"Thresholds at {at}: {'; '.join(parts)}.",
                *(f"At {at}, {apa_difference(one, plan.label)}" for one in found.contrasts),
            ),
            methods=(
                f"Thresholds at {at} are the levels at which the typical participant of the mixed"
                f" model, with {widths}, reaches this share; limits by the delta method,"
                f" {law_of_mixed(scenes=scenes)}"
                f"{'; differences are Holm-adjusted' * (len(found.contrasts) > 1)}."
            ),
            tables={
                "stated_thresholds.csv": threshold_lines(found.thresholds),
                "stated_threshold_differences.csv": frame_of(Difference, found.contrasts),
            },
            figures=(figure,),
        )
