"""Learning: did answers or their speed change over the session?"""

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, TypeVar

import numpy as np
import pandas as pd
from numpy.random import Generator

from analysis.models.compared_methods import Comparisons
from analysis.models.trends import Course, Trend, course, trend
from analysis.parts import AnalysisPlan, Part, PartFigure, PartNumbers, Presentation
from analysis.parts.ratings import RatingResults
from analysis.parts.shared import SIGN_FLIP
from analysis.plans.preference_plan import PreferencePlan
from analysis.plans.rate_plan import RatePlan
from analysis.plans.rating_plan import RatingPlan
from analysis.plots import learning_plot
from analysis.report.result_table import (
    T_DF,
    ResultTable,
    attribute,
    deciding,
    estimated,
    limits,
    p_value,
    set_aside,
)
from analysis.report.wording import (
    NOT_IDENTIFIED,
    number_range,
    p_text,
    placed,
    t_text,
)
from protocols.blocks import Cautions, FigurePlace
from protocols.tasks.rates import name_of


@dataclass(frozen=True)
class LearnedOutcome:
    """Outcome that may change over a session.

    Attributes
    ----------
    name : str
        In a sentence: "right answers".
    rows : DataFrame
        ``participant``, ``order``, ``outcome`` (a number), and the columns in which it is centred.
    """

    name: str
    rows: pd.DataFrame


@dataclass(frozen=True)
class Learning:
    """Every number; `course` is that of the first outcome, None where there are times alone."""

    trends: tuple[Trend, ...]
    course: Course | None
    notes: tuple[str, ...] = ()


P = TypeVar("P", bound=AnalysisPlan, contravariant=True)


class LearningPart(Part[P, Learning]):
    """Trends over the session of the answers of a task, and of the logarithm of their times."""

    name: ClassVar[str] = "learning"
    section: ClassVar[tuple[str, str]] = ("checks", "Learning, speed")
    axis: ClassVar[str]
    """Title of the figure's axis of outcomes."""
    bounds: ClassVar[tuple[float, float] | None] = (0.0, 1.0)
    """Smallest and largest value of an answer; None: no limits."""

    def wanted(self, table: pd.DataFrame, _plan: P) -> bool:
        """Return True if the table says in which order trials came."""
        return "order" in table and bool(table["order"].notna().any())

    @abstractmethod
    def outcomes(
        self, table: pd.DataFrame, plan: P, found: PartNumbers
    ) -> Iterator[LearnedOutcome]:
        """Yield the answers that may change; the first is drawn."""

    def cells(self, plan: P) -> tuple[str, ...]:
        """Return the columns that define cells, in which outcomes are centred."""
        return plan.compared

    def compute(
        self, table: pd.DataFrame, plan: P, found: PartNumbers, _chance: Generator
    ) -> Learning:
        """Return the trend of each outcome."""
        outcomes = list(self.outcomes(table, plan, found))
        drawn = course(outcomes[0].rows, "outcome") if outcomes else None
        if "rt_s" in table and (table["rt_s"] > 0).any():
            rows = table[table["rt_s"] > 0]
            rows = rows.assign(outcome=np.log(rows["rt_s"].astype(float)))
            outcomes.append(LearnedOutcome("logarithm of the reaction time", rows))
        how: dict[str, Any] = {"within": self.cells(plan), "level": plan.confidence}
        trends = (replace(trend(o.rows, "outcome", **how), outcome=o.name) for o in outcomes)
        return Learning(tuple(trends), drawn)

    def show(self, found: Learning, plan: P) -> Presentation:
        """Return the figure, the table of changes, and each as a sentence."""
        trends = found.trends
        table = ResultTable[Trend].of(
            "Change from the first to the last trial, between participants",
            trends,
            attribute("Outcome", "outcome", str, "l"),
            estimated("Change", "change", ""),
            limits(),
            T_DF,
            deciding(),
            p_value("Sign-flip p", "sign_flip_p"),
            set_aside(attribute("Spearman \N{GREEK SMALL LETTER RHO}", "spearman_rho")),
            p_value("pooled p", "spearman_p"),
        )
        return Presentation(
            blocks=(
                FigurePlace("learning"),
                table.block(),
                Cautions.each("About these trends", trends, lambda one: one.outcome),
            ),
            others=(
                table.folded(
                    "Learning: sign-flip test, pooled rank correlation",
                    "Papers print the rank correlation of all trials, which finds learning too"
                    f" often where people's trends differ. {SIGN_FLIP}",
                ),
            ),
            sentences=tuple(apa_trend(one) for one in trends),
            methods=(
                "Change over the session is the mean of a least-squares slope of each participant,"
                " within conditions, with a t test and a sign-flip test over participants."
            ),
            tables={"learning.csv": table.every_field("changes")},
            figures=() if found.course is None else (self._figure(trends[0], found.course, plan),),
        )

    def _figure(self, first: Trend, drawn: Course, plan: P) -> PartFigure:
        name = first.outcome[:1].upper() + first.outcome[1:]
        caption = (
            f"{name} along the session: the participants' mean with {100 * plan.confidence:g} % t"
            " limits (band), over each participant's own trend (grey lines, least squares)."
        )
        draw = partial(
            learning_plot, drawn, y_label=self.axis, bounds=self.bounds, level=plan.confidence
        )
        return PartFigure("learning", caption, draw)


def apa_trend(found: Trend) -> str:
    """Return a sentence on the change of an outcome over the session."""
    if math.isnan(found.p):
        return f"Whether {found.outcome} changed over the session is {NOT_IDENTIFIED}."
    test = "sign-flip test" if math.isnan(found.t) else t_text(found.t, found.df)
    return (
        f"From the first to the last trial {found.outcome} changed by"
        f" {placed(found, found.change)}, {number_range(found.lower, found.upper)}, over"
        f" {found.participants} participants, {test}, {p_text(found.p)}."
    )


class RightLearning(LearningPart[RatePlan]):
    """Right answers; where levels adapt, these decide about them, and times alone can change."""

    axis: ClassVar[str] = "Share of right answers"

    def outcomes(
        self, table: pd.DataFrame, plan: RatePlan, _found: PartNumbers
    ) -> Iterator[LearnedOutcome]:
        """Yield right answers, unless levels adapt."""
        if not plan.adaptive:
            yield LearnedOutcome(
                "right answers", table.assign(outcome=table["correct"].astype(float))
            )

    def cells(self, plan: RatePlan) -> tuple[str, ...]:
        """Return condition and level."""
        return plan.compared if plan.level is None else (*plan.compared, plan.level)


class ChoiceLearning(LearningPart[PreferencePlan]):
    """Choices of each pairing, the primary comparison's first."""

    section: ClassVar[tuple[str, str]] = ("checks", "Order, learning, speed")
    axis: ClassVar[str] = "Share of choices"

    def outcomes(
        self, table: pd.DataFrame, plan: PreferencePlan, _found: PartNumbers
    ) -> Iterator[LearnedOutcome]:
        """Yield choices of the first of each pairing."""
        grouped = Comparisons(table)
        for method, against in plan.pairings:
            rows = grouped.rows(method, against)
            if not rows["order"].isna().all():
                chosen = (rows["chosen"] == method).astype(float)
                name = f"choosing {plan.label(method)} over {plan.label(against)}"
                yield LearnedOutcome(name, rows.assign(outcome=chosen))

    def cells(self, _plan: PreferencePlan) -> tuple[str, ...]:
        """Return the size."""
        return ("size",)


class StepLearning(LearningPart[RatingPlan]):
    """Ratings, in steps of their scale."""

    needs: ClassVar[tuple[str, ...]] = ("ratings",)
    axis: ClassVar[str] = "Rating, steps (lowest: 1)"
    bounds: ClassVar[None] = None

    def outcomes(
        self, table: pd.DataFrame, _plan: RatingPlan, found: PartNumbers
    ) -> Iterator[LearnedOutcome]:
        """Yield the step that was rated."""
        ratings: RatingResults = found["ratings"]
        steps = table["rating"].map(name_of).map(ratings.model.steps).astype(float) + 1.0
        yield LearnedOutcome("rating, in steps of the scale", table.assign(outcome=steps))

    def cells(self, plan: RatingPlan) -> tuple[str, ...]:
        """Return the condition, or both of a pair."""
        return plan.columns
