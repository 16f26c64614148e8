"""Planned look at which a study stands, and the bounds of its looks."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import pandas as pd
from numpy.random import Generator

from analysis.models.sequential_bounds import InterimResult, SequentialPlan, plan_of, standing
from analysis.parts import (
    AnalysisPlan,
    AnyPart,
    Estimate,
    Part,
    PartFigure,
    Presentation,
    estimates_of,
)
from analysis.plots.sequential_plot import bounds_plot
from analysis.report.wording import NONE, number_range, placed
from analysis.showable import FamilyOfTests
from protocols.blocks import Block, Box, FigurePlace, Paragraph, TableBlock
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.sequential import Sequential

LEAST = 1e-9
"""Of a bound: limits that leave out less than that are all that can be."""


@dataclass(frozen=True)
class Looks:
    """The plan, and where these data stand in it.

    `limits` are those of the planned comparisons that hold at every look: they invert the test at
    the look's own bound (repeated confidence intervals, Jennison and Turnbull 1989), so that they
    leave out the null exactly where the look stops. None where no look is planned, or the rule
    promises no error.
    """

    plan: SequentialPlan
    standing: InterimResult
    limits: tuple[Estimate, ...]
    notes: tuple[str, ...] = ()


class LooksPart(Part[AnalysisPlan, Looks]):
    """Looks that a study plans at the test of other parts."""

    name: ClassVar[str] = "looks"
    section: ClassVar[tuple[str, str]] = ("looks", "Planned looks")

    def __init__(
        self,
        study: StudyProtocol,
        planned: Sequential,
        parts: Sequence[AnyPart],
        family: FamilyOfTests,
    ) -> None:
        self._planned, self._parts, self._family = planned, parts, family
        self._judged = study.analysis.judged(study.task, study.pool)
        self.needs = tuple(one.name for one in parts)  # type: ignore[misc]

    def compute(
        self, table: pd.DataFrame, plan: AnalysisPlan, found: Mapping[str, Any], _chance: Generator
    ) -> Looks:
        """Compare p of the planned test with the look's bound, and invert the test there."""
        bounds = plan_of(self._planned, plan.alpha)
        known = (one.planned_p(found[one.name], plan) for one in self._parts if one.name in found)
        p = next((p for p in known if p is not None), None)
        people = int(table["participant"].nunique())
        now = standing(bounds, people, p, self._judged, self._family.least_p(people))
        if now.reject_p is None or now.reject_p < LEAST or bounds.rule == "bayes-factor":
            return Looks(bounds, now, ())
        at_bound = plan.but(alpha=now.reject_p)
        return Looks(bounds, now, estimates_of(self._parts, table, at_bound, planned=True))

    def show(self, found: Looks, plan: AnalysisPlan) -> Presentation:
        """Return the state of the study before all else; bounds, and limits that hold there."""
        bounds, now = found.plan, found.standing
        caption = (
            f"p at which each planned look stops the study ({bounds.rule}); dashed: alpha without"
            " looks; star: this study."
        )
        tables = {"looks.csv": looks_frame(bounds)}
        limits: tuple[Block, ...] = ()
        if found.limits:
            tables["look_limits.csv"] = pd.DataFrame(
                [
                    {"of": one.what, "value": one.value, "lower": one.lower, "upper": one.upper}
                    for one in found.limits
                ]
            )
            level = 100.0 * (1.0 - (now.reject_p or 0.0))
            limits = (
                TableBlock.each(
                    "Limits that take account of the looks",
                    found.limits,
                    ("Of", "l c", lambda one: one.what),
                    ("Value", "strong", lambda one: placed(one, one.value)),
                    ("Limits", "n", lambda one: number_range(one.lower, one.upper)),
                ),
                Paragraph(
                    f"They invert the test at this look's bound ({level:.5g} % at this look), and"
                    f" hold at all looks together with {100 * plan.confidence:g} % or more,"
                    " whether or not the study stops here (Jennison & Turnbull 1989).",
                    muted=True,
                ),
            )
        return Presentation(
            lead=(
                Box(
                    f"Planned looks: {now.verdict}",
                    now.sentence,
                    "Other limits and p of this page take no account of looks: until the study has"
                    " ended, they decide nothing.",
                ),
            ),
            blocks=(FigurePlace("looks"), looks_table(bounds), *limits),
            sentences=(now.sentence,),
            methods=" ".join(self._planned.plain_sentences(plan.alpha, self._judged)),
            tables=tables,
            figures=(
                PartFigure(
                    "looks", caption, partial(bounds_plot, bounds, people=now.participants, p=now.p)
                ),
            ),
        )


def looks_frame(plan: SequentialPlan) -> pd.DataFrame:
    """Return the bounds, one look a row."""
    own = {"participants": plan.looks, "reject_p": plan.reject_p, "accept_p": plan.accept_p}
    return pd.DataFrame(own | {"spent": plan.spent})


def looks_table(plan: SequentialPlan, shares: Mapping[str, Sequence[float]] = {}) -> TableBlock:
    """Return the bounds as a table; `shares` are columns of shares of studies."""

    def cell(values: Sequence[float | None], digits: int) -> Callable[[int], str]:
        return lambda k: NONE if (value := values[k]) is None else f"{value:.{digits}f}"

    return TableBlock.each(
        f"Bounds of the planned looks, {plan.rule}",
        range(len(plan.looks)),
        ("Participants", "", lambda k: str(plan.looks[k])),
        ("Significant if p \N{LESS-THAN OR EQUAL TO}", "strong", cell(plan.reject_p, 5)),
        ("No difference if p \N{GREATER-THAN OR EQUAL TO}", "", cell(plan.accept_p, 3)),
        ("Alpha spent", "", cell(plan.spent, 5)),
        *((title, "", cell(values, 3)) for title, values in shares.items()),
    )
