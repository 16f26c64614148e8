"""Learning: did answers or their speed change over the session?"""

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, TypeVar

import numpy as np
import pandas as pd

from analysis.learning import Course, Trend, course, trend
from analysis.pairings import Comparisons
from analysis.parts import Part, PartFigure, Plan, Shown
from analysis.parts.ratings import Ratings, category
from analysis.plans.preference import Settings
from analysis.plans.rates import RateSettings
from analysis.plans.ratings import RatingSettings
from analysis.plots import learning_plot
from analysis.report.blocks import Cautions, Picture, Table
from analysis.report.wording import NOT_IDENTIFIED, grouped, number, number_range, p_number, p_text

SHARES = (0.0, 1.0)


@dataclass(frozen=True)
class Outcome:
    """What may change.

    Attributes
    ----------
    name : str
        In a sentence: "right answers".
    rows : DataFrame
        ``participant``, ``order``, ``outcome`` (a number), and the columns `within`.
    within : tuple of str
        Columns that define cells, in which the outcome is centred.
    """

    name: str
    rows: pd.DataFrame
    within: tuple[str, ...]


@dataclass(frozen=True)
class Drawn:
    """What the figure shows: an outcome in parts of the session."""

    caption: str
    axis: str
    bounds: tuple[float, float] | None
    course: Course


@dataclass(frozen=True)
class Learning:
    """Every number."""

    trends: tuple[Trend, ...]
    drawn: Drawn | None
    notes: tuple[str, ...] = ()


P = TypeVar("P", bound=Plan, contravariant=True)


class LearningPart(Part[P, Learning]):
    """Trends over the session of the answers of a task, and of the logarithm of their times."""

    name: ClassVar[str] = "learning"
    section: ClassVar[tuple[str, str]] = ("checks", "Learning, speed")

    def wanted(self, table: pd.DataFrame, _plan: P) -> bool:
        """Return whether the table says in which order trials came."""
        return "order" in table and bool(table["order"].notna().any())

    @abstractmethod
    def outcomes(self, table: pd.DataFrame, plan: P, found: Mapping[str, Any]) -> Iterator[Outcome]:
        """Yield the answers that may change."""

    @abstractmethod
    def drawn(self, table: pd.DataFrame, plan: P, outcomes: list[Outcome]) -> Drawn | None:
        """Return what the figure shows."""

    def cells(self, plan: P) -> tuple[str, ...]:
        """Return the columns within which times are compared."""
        return plan.compared

    def compute(
        self,
        table: pd.DataFrame,
        plan: P,
        found: Mapping[str, Any],
        _chance: np.random.Generator,
    ) -> Learning:
        """Return the trend of each outcome."""
        outcomes = list(self.outcomes(table, plan, found))
        drawn = self.drawn(table, plan, outcomes)
        if "rt_s" in table and (table["rt_s"] > 0).any():
            rows = table[table["rt_s"] > 0]
            rows = rows.assign(outcome=np.log(rows["rt_s"].astype(float)))
            outcomes.append(Outcome("logarithm of the reaction time", rows, self.cells(plan)))
        trends = [
            replace(
                trend(one.rows, "outcome", within=one.within, level=plan.confidence),
                outcome=one.name,
            )
            for one in outcomes
        ]
        return Learning(tuple(trends), drawn)

    def show(self, found: Learning, _plan: P) -> Shown:
        """Return the figure, the table of changes, and each as a sentence."""
        trends, drawn = found.trends, found.drawn
        lines = [
            {name: value for name, value in vars(one).items() if name != "changes"}
            | {"warnings": "; ".join(one.warnings)}
            for one in trends
        ]
        return Shown(
            blocks=(
                Picture("learning"),
                Table.each(
                    "Change from the first to the last trial, between participants; beside it the"
                    " papers' pooled rank correlation",
                    trends,
                    ("Outcome", "l", lambda one: one.outcome),
                    ("Change", "", lambda one: number(one.change)),
                    ("Limits", "n", lambda one: number_range(one.lower, one.upper)),
                    ("df", "", lambda one: number(one.df, 0)),
                    ("p", "n", lambda one: p_number(one.p)),
                    ("Sign-flip p", "n", lambda one: p_number(one.sign_flip_p)),
                    (
                        "Spearman \N{GREEK SMALL LETTER RHO}",
                        "",
                        lambda one: number(one.spearman_rho),
                    ),
                    ("pooled p", "n", lambda one: p_number(one.spearman_p)),
                ),
                Cautions(
                    "About these trends", grouped([(one.outcome, one.warnings) for one in trends])
                ),
            ),
            sentences=tuple(apa_trend(one) for one in trends),
            methods=(
                "Change over the session is the mean of a least-squares slope of each participant,"
                " within conditions, with a t test and a sign-flip test over participants."
            ),
            tables={"learning.csv": pd.DataFrame(lines)},
            figures=() if drawn is None else (_figure(drawn),),
        )


def _figure(drawn: Drawn) -> PartFigure:
    caption = f"{drawn.caption} along the session; thin lines: participants; band: 95 % t limits."
    draw = partial(learning_plot, drawn.course, y_label=drawn.axis, bounds=drawn.bounds)
    return PartFigure("learning", caption, draw)


def apa_trend(found: Trend) -> str:
    """Return whether an outcome changed over the session as a sentence."""
    if math.isnan(found.p):
        return f"Whether {found.outcome} changed over the session is {NOT_IDENTIFIED}."
    return (
        f"From the first to the last trial {found.outcome} changed by {number(found.change)},"
        f" [{number(found.lower)}, {number(found.upper)}], over {found.participants} participants,"
        f" t({found.df:.0f}), {p_text(found.p)}; all trials pooled: Spearman's rho ="
        f" {number(found.spearman_rho)}, {p_text(found.spearman_p)}."
    )


class RightLearning(LearningPart[RateSettings]):
    """Right answers; levels that adapt decide about these, and leave times alone."""

    def outcomes(
        self, table: pd.DataFrame, plan: RateSettings, _found: Mapping[str, Any]
    ) -> Iterator[Outcome]:
        """Yield right answers, unless levels adapt."""
        if not plan.adaptive:
            rows = table.assign(outcome=table["correct"].astype(float))
            yield Outcome("right answers", rows, self.cells(plan))

    def drawn(
        self, _table: pd.DataFrame, _plan: RateSettings, outcomes: list[Outcome]
    ) -> Drawn | None:
        """Return the share of right answers."""
        for one in outcomes:
            return Drawn(
                "Right answers", "Share of right answers", SHARES, course(one.rows, "outcome")
            )
        return None

    def cells(self, plan: RateSettings) -> tuple[str, ...]:
        """Return condition and level."""
        return plan.compared if plan.level is None else (*plan.compared, plan.level)


class ChoiceLearning(LearningPart[Settings]):
    """Choices of each pairing."""

    section: ClassVar[tuple[str, str]] = ("checks", "Order, learning, speed")

    def outcomes(
        self, table: pd.DataFrame, plan: Settings, _found: Mapping[str, Any]
    ) -> Iterator[Outcome]:
        """Yield choices of the first of each pairing."""
        grouped = Comparisons(table)
        for method, against in plan.pairings:
            rows = _chosen(grouped, method, against)
            if not rows["order"].isna().all():
                name = f"choosing {plan.label(method)} over {plan.label(against)}"
                yield Outcome(name, rows, self.cells(plan))

    def drawn(self, table: pd.DataFrame, plan: Settings, _outcomes: list[Outcome]) -> Drawn | None:
        """Return the primary comparison; without one the first."""
        method, against, size = plan.primary or (*plan.pairings[0], "all")
        rows = _chosen(Comparisons(table), method, against, size)
        if rows["order"].isna().all():
            return None
        caption = f"Choices of {plan.label(method)} over {plan.label(against)}"
        return Drawn(caption, "Share of choices", SHARES, course(rows, "outcome"))

    def cells(self, _plan: Settings) -> tuple[str, ...]:
        """Return the size."""
        return ("size",)


def _chosen(grouped: Comparisons, method: str, *other: str) -> pd.DataFrame:
    rows = grouped.rows(method, *other)
    return rows.assign(outcome=(rows["chosen"] == method).astype(float))


class StepLearning(LearningPart[RatingSettings]):
    """Ratings, in steps of their scale."""

    needs: ClassVar[tuple[str, ...]] = ("ratings",)

    def outcomes(
        self, table: pd.DataFrame, plan: RatingSettings, found: Mapping[str, Any]
    ) -> Iterator[Outcome]:
        """Yield the step that was rated."""
        ratings: Ratings = found["ratings"]
        steps = table["rating"].map(category).map(ratings.model.steps).astype(float)
        yield Outcome("rating, in steps of the scale", table.assign(outcome=steps), plan.columns)

    def drawn(
        self, _table: pd.DataFrame, _plan: RatingSettings, outcomes: list[Outcome]
    ) -> Drawn | None:
        """Return the steps."""
        caption = "Ratings, in steps of the scale,"
        return Drawn(caption, "Rating, steps", None, course(outcomes[0].rows, "outcome"))
