"""The planned comparisons of a study of right answers."""

from dataclasses import dataclass
from typing import ClassVar

import pandas as pd
from numpy.random import Generator

from analysis.models.contrasts import Difference
from analysis.models.right_answers import Rate
from analysis.parts import Part, PartNumbers, Presentation
from analysis.parts.shared import against, apa_difference, decides, planned_family
from analysis.plans.rate_plan import RatePlan
from analysis.report.wording import (
    leading,
    level_text,
    number_range,
    p_text,
    placed,
    share,
    share_range,
)
from protocols.blocks import Box


@dataclass(frozen=True)
class PlannedTests:
    """The planned tests against the baseline.

    Attributes
    ----------
    differences : tuple of Difference
        Of d' (yes-no), of shares of right answers, of ln critical scaling in a study of scalings,
        or of thresholds where other levels were chosen from the answers.
    instead : tuple of Rate
        Right answers, where nothing is compared.
    """

    differences: tuple[Difference, ...]
    instead: tuple[Rate, ...]
    notes: tuple[str, ...]


class ComparisonsPart(Part[RatePlan, PlannedTests]):
    """The planned comparisons, which other parts computed; of one condition its right answers."""

    name: ClassVar[str] = "comparisons"
    section: ClassVar[tuple[str, str]] = ("sensitivity", "Sensitivity")
    needs: ClassVar[tuple[str, ...]] = ("rates", "sensitivity", "thresholds", "critical")

    def compute(
        self, table: pd.DataFrame, plan: RatePlan, found: PartNumbers, _chance: Generator
    ) -> PlannedTests:
        """Choose what the study compares."""
        notes = []
        differences: tuple[Difference, ...] = ()
        if plan.by_scaling:
            differences = found["critical"].contrasts if "critical" in found else ()
        elif plan.adaptive:
            differences = found["thresholds"].contrasts if "thresholds" in found else ()
            notes.append(
                "levels were chosen from the answers: shares of right answers and d' are the rule's"
                " doing and compare nothing; thresholds do"
            )
        elif "sensitivity" in found:
            differences = found["sensitivity"].planned
        # Of a yes-no task d' decides, which its own part gives.
        instead = () if differences or plan.kind == "detection" else found["rates"].conditions
        held = not plan.adaptive and not (plan.by_scaling and differences)
        if held and (differences or len(instead) == 1):
            people = table["participant"].nunique()
            notes += planned_family(len(differences), plan).hopeless(people, plan.alpha)
        return PlannedTests(differences, instead, tuple(notes))

    def planned_p(self, found: PlannedTests, plan: RatePlan) -> float | None:
        """Return the least p of the planned comparisons; of a single condition its own."""
        if found.differences:
            return min(decides(one, plan) for one in found.differences)
        return found.instead[0].p if len(found.instead) == 1 and not plan.adaptive else None

    def show(self, found: PlannedTests, plan: RatePlan) -> Presentation:
        """Return the comparisons in short."""
        planned, label = found.differences, plan.label
        lines = [f"{_said(one, plan)}." for one in planned] or [
            f"{label(one.condition)}: {share(one.share)} of answers were right,"
            f" {share_range(one.lower, one.upper)}, {p_text(one.p)} against chance"
            f" ({share(one.chance)})."
            for one in found.instead
        ]
        more = f" {len(lines) - 6} more are below." if len(lines) > 6 else ""
        title = "Planned comparisons" if planned else "Right answers"
        holm = plan.correction == "holm"
        decides, methods = "", ""
        if planned:
            others, count = against(planned, plan), len(planned)
            adjusted = f", Holm-adjusted over {count} comparisons" if holm and count > 1 else ""
            decides = f"Each against {others}, two-sided{adjusted}; these p decide."
            if count > 1:
                corrected = ", Holm-adjusted" if holm else ", not adjusted"
                methods = f"{count} comparisons with {others} were planned{corrected}. "
        return Presentation(
            lead=(Box(title, " ".join(lines[:6]) + more, decides),) if lines else (),
            headline=apa_difference(planned[0], plan) if planned else "".join(lines[:1]),
            methods=f"{methods}Tests are two-sided, alpha = {leading(f'{plan.alpha:g}')}.",
        )


def _said(one: Difference, plan: RatePlan) -> str:
    """Return a comparison with the baseline in short; adjusted p decides if it is asked for."""
    p = decides(one, plan)
    between = f"{plan.label(one.first)} against {plan.label(one.second)}"
    level = f"{level_text(one.level)} {number_range(one.lower, one.upper)}"
    word = "they differ" if p < plan.alpha else "no difference is shown"
    return (
        f"{between}: {placed(one, one.difference)} in {one.measure}, {level}, {p_text(p)}: {word}"
    )
