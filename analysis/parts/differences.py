"""Differences between conditions in tables and sentences; which of them were planned."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import numpy as np
import pandas as pd

from analysis.columns import frame_of
from analysis.detection import Measure
from analysis.parts import Estimate, Part, Plan, Shown
from analysis.plans.rates import RateSettings
from analysis.rates import Difference, Rate
from analysis.report.blocks import Box, Table
from analysis.report.wording import (
    leading,
    level_text,
    number,
    number_range,
    p_number,
    p_text,
    placed,
    share,
    share_range,
)
from analysis.showable import hopeless

T = TypeVar("T")


def in_order(found: Sequence[T], plan: Plan, name: Callable[[T], str]) -> tuple[T, ...]:
    """Sort results by the order of conditions that the study declares."""
    names = plan.in_order(list(dict.fromkeys(map(name, found))))
    return tuple(sorted(found, key=lambda one: names.index(name(one))))


def alone(table: pd.DataFrame, plan: Plan) -> tuple[str, ...]:
    """Return a note where one person saw several conditions."""
    if table["participant"].nunique() > 1 or len(set(table[plan.compared[0]])) < 2:
        return ()
    return ("one participant only: conditions are not compared",)


def told_apart(found: Sequence[Difference], plan: Plan) -> tuple[Difference, ...]:
    """Return differences in order, without those that nothing can be said of: of one person."""
    known = [one for one in found if np.isfinite(one.p)]
    return in_order(known, plan, lambda one: one.first)


def difference_tables(caption: str, found: Sequence[Difference], plan: Plan) -> tuple[Table, ...]:
    """Return the table of differences; none where there are none."""
    label = plan.label
    if not found:
        return ()
    return (
        Table.each(
            caption,
            found,
            ("Conditions", "l c", lambda one: f"{label(one.first)} - {label(one.second)}"),
            ("Difference", "strong", lambda one: placed(one, one.difference)),
            (limits_title(plan), "n", lambda one: number_range(one.lower, one.upper)),
            ("SE", "", lambda one: number(one.standard_error)),
            ("df", "", lambda one: number(one.df, 1)),
            ("p", "n", lambda one: p_number(one.p)),
            ("p adj.", "n", lambda one: p_number(one.p_adjusted)),
        ),
    )


def limits_title(plan: Plan) -> str:
    """Return what heads limits."""
    return f"{100 * plan.confidence:g} % limits"


def estimate(what: str, value: float, one: Rate | Measure, trials: int) -> Estimate:
    """Return one of the main numbers of a report."""
    return Estimate(what, value, one.lower, one.upper, one.p, trials)


def difference_estimates(
    several: Sequence[Difference], trials: Mapping[str, int], plan: Plan
) -> list[Estimate]:
    """Return differences as the main numbers of a report; `trials` are those of conditions."""
    return [
        Estimate(
            f"{plan.label(one.first)} - {plan.label(one.second)}, {one.measure}",
            one.difference,
            one.lower,
            one.upper,
            one.p_adjusted,
            trials[one.first] + trials[one.second],
        )
        for one in several
    ]


def apa_difference(one: Difference) -> str:
    """Return the difference of two conditions as a sentence."""
    ratio = one.difference / max(one.standard_error, 1e-12)
    text = (
        f"{one.first} minus {one.second}: {placed(one, one.difference)} in {one.measure},"
        f" {level_text(one.level)} {number_range(one.lower, one.upper)},"
        f" t({one.df:.1f}) = {number(ratio)}, {p_text(one.p)}"
    )
    if abs(one.p_adjusted - one.p) > 1e-12:
        text += f" ({p_text(one.p_adjusted)} Holm-adjusted)"
    return text + "."


@dataclass(frozen=True)
class Planned:
    """The planned tests against the baseline.

    Attributes
    ----------
    differences : tuple of Difference
        Of d' (yes-no), of shares of right answers, or of thresholds where levels were chosen from
        the answers.
    instead : tuple of Rate
        Right answers, where nothing is compared.
    """

    differences: tuple[Difference, ...]
    instead: tuple[Rate, ...]
    notes: tuple[str, ...]


class ComparisonsPart(Part[RateSettings, Planned]):
    """The planned comparisons, which other parts computed; of one condition its right answers."""

    name: ClassVar[str] = "comparisons"
    section: ClassVar[tuple[str, str]] = ("sensitivity", "Sensitivity")
    needs: ClassVar[tuple[str, ...]] = ("rates", "sensitivity", "thresholds")

    def compute(
        self,
        table: pd.DataFrame,
        plan: RateSettings,
        found: Mapping[str, Any],
        _chance: np.random.Generator,
    ) -> Planned:
        """Choose what the study compares."""
        notes = []
        differences: tuple[Difference, ...] = ()
        if plan.adaptive:
            differences = found["thresholds"].contrasts if "thresholds" in found else ()
            notes.append(
                "levels were chosen from the answers: shares of right answers and d' are the rule's"
                " doing and compare nothing; thresholds do"
            )
        elif "sensitivity" in found:
            differences = found["sensitivity"].planned
            family = len(differences) if plan.correction == "holm" else min(len(differences), 1)
            notes += hopeless(table["participant"].nunique(), family, plan.alpha)
        return Planned(differences, () if differences else found["rates"].conditions, tuple(notes))

    def planned_p(self, found: Planned) -> float | None:
        """Return the least adjusted p of the planned comparisons; of a single condition its own."""
        if found.differences:
            return min(one.p_adjusted for one in found.differences)
        return found.instead[0].p if len(found.instead) == 1 else None

    def show(self, found: Planned, plan: RateSettings) -> Shown:
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
            against, count = label(planned[0].second), len(planned)
            adjusted = f", Holm-adjusted over {count} comparisons" if holm and count > 1 else ""
            decides = f"Each against {against}, two-sided{adjusted}."
            if count > 1:
                corrected = ", Holm-adjusted" if holm else ", not adjusted"
                methods = f"{count} comparisons with {against} were planned{corrected}. "
        return Shown(
            lead=(Box(title, " ".join(lines[:6]) + more, decides),),
            headline=apa_difference(planned[0]) if planned else lines[0],
            methods=f"{methods}Tests are two-sided, alpha = {leading(f'{plan.alpha:g}')}.",
            tables={"comparisons.csv": frame_of(Difference, planned)},
        )


def _said(one: Difference, plan: RateSettings) -> str:
    """Return a comparison with the baseline in short; adjusted p decides if it is asked for."""
    p = one.p_adjusted if plan.correction == "holm" else one.p
    between = f"{plan.label(one.first)} against {plan.label(one.second)}"
    level = f"{level_text(one.level)} {number_range(one.lower, one.upper)}"
    word = "they differ" if p < plan.alpha else "no difference is shown"
    return (
        f"{between}: {placed(one, one.difference)} in {one.measure}, {level}, {p_text(p)}: {word}"
    )
