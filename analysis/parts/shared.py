"""Helpers that parts share: columns of tables, and ends of sentences."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeAlias, TypeVar

import numpy as np
import pandas as pd

from analysis.answers import SimulatedAnswers
from analysis.arrays import Floats
from analysis.models.clustered import holm
from analysis.models.contrasts import (
    MEAN,
    MOST_IN_PAIRS,
    Difference,
    crossed_means_p,
    pairs_of,
)
from analysis.models.detection import Measure
from analysis.models.mixed.reaction_model import TimeRatio
from analysis.models.ordinal import RatingDifference
from analysis.models.right_answers import Rate
from analysis.parts import AnalysisPlan, Estimate
from analysis.plans.preference_plan import PreferencePlan
from analysis.plans.rate_plan import RatePlan
from analysis.report.result_table import (
    T_DF,
    ResultColumn,
    ResultTable,
    attribute,
    deciding,
    estimated,
    limits,
    undecided,
)
from analysis.report.wording import (
    NONE,
    level_text,
    number,
    number_range,
    p_text,
    placed,
    t_text,
)
from analysis.showable import FamilyOfTests
from protocols.blocks import Block, Cautions, Paragraph, grouped

G = TypeVar("G")
T = TypeVar("T")

Comparison: TypeAlias = Difference | RatingDifference | TimeRatio
"""Comparison of two conditions, with a t test, Holm-adjusted among others."""


def compared(plan: AnalysisPlan, sign: str = "-") -> ResultColumn[Comparison]:
    """Return the column that names what is compared."""
    return ResultColumn("Conditions", "l c", lambda one: between(one, plan, sign))


def condition(plan: AnalysisPlan) -> ResultColumn[object]:
    """Return the column that names conditions."""
    return attribute("Condition", "condition", plan.label, "l c")


def between(one: Comparison, plan: AnalysisPlan, sign: str = "-") -> str:
    """Return the name of a comparison: ``ours - blur``."""
    return f"{plan.label(one.first)} {sign} {plan.label(one.second)}"


SIGN_FLIP = (
    "The sign-flip test of the participants' own values assumes no normal law; with few people its"
    " p cannot be small."
)


def corrects(plan: AnalysisPlan) -> bool:
    """Return True if p is corrected for the number of comparisons."""
    return getattr(plan.section, "correction", "holm") == "holm"


def decides(one: Comparison, plan: AnalysisPlan) -> float:
    """Return the p that decides: adjusted where the plan asks for it."""
    return one.p_adjusted if corrects(plan) else one.p


def deciding_column(plan: AnalysisPlan) -> ResultColumn[object]:
    """Return the column of that p."""
    return deciding(f"p{'_adjusted' * corrects(plan)}")


def over(found: Sequence[object], plan: AnalysisPlan) -> str:
    """Return the words on the correction of so many comparisons; none of one."""
    return f", Holm-adjusted over {len(found)}" * (corrects(plan) and len(found) > 1)


def many(found: Sequence[Comparison]) -> bool:
    """Return True if conditions are so many that Wald's statistics judge them."""
    return any(one.second == MEAN for one in found)


def draws_of(found: Sequence[Comparison], plan: AnalysisPlan) -> int:
    """Return the draws of the bootstrap by which a mixed model's comparisons have p; 0: none."""
    return 0 if many(found) else plan.bootstrap_draws


def tests_of(found: Sequence[Comparison]) -> str:
    """Return the tests of a mixed model's comparisons, for a paragraph on methods."""
    return "Wald's statistics, which" if many(found) else "likelihood ratios, whose roots"


def against(found: Sequence[Comparison], plan: AnalysisPlan) -> str:
    """Return the names of what others are compared with, the mean of all last."""
    others = sorted({one.second for one in found}, key=lambda name: (name == MEAN, name))
    return " and ".join(map(plan.label, others))


def many_told(found: Sequence[Comparison], plan: AnalysisPlan) -> str:
    """Return the comparisons of many conditions in words; empty where they are few."""
    if not many(found):
        return ""
    return (
        f"Of more than {MOST_IN_PAIRS} conditions each is compared with"
        f" {against(found, plan)}, and no other."
    )


def ratio_told(found: Sequence[Comparison], plan: AnalysisPlan) -> str:
    """Return the meaning of tests of a mixed model, for a paragraph below a table."""
    if told := many_told(found, plan):
        return f"{told} p and limits: Wald's."
    return (
        "Deciding p and limits: of the likelihood ratio against each value of the difference"
        f"{bootstrapped(plan.bootstrap_draws) or ', whose root is judged by t'}."
    )


def apa_test(
    one: RatingDifference | TimeRatio, among: Sequence[Comparison], plan: AnalysisPlan, model: str
) -> str:
    """Return the test of a mixed model for a sentence: ``t(5) = 2.31, p = .138 (model)``.

    By a bootstrap the likelihood ratio takes the place of its root, which t judges.
    """
    draws = draws_of(among, plan)
    more = "likelihood ratio, " * (not many(among)) + model
    judged = f"likelihood ratio {number(one.t**2)}" if draws else t_text(one.t, one.df)
    return f"{judged}, {apa_p(one.p, decides(one, plan), more + bootstrapped(draws))}"


def apa_p(p: float, decides: float, more: str = "") -> str:
    """Return the p that decides, for a sentence: ``p = .138 (Holm-adjusted; more)``.

    Holm is not named where p is the same without, as of a comparison that is the only one.
    """
    text = "; ".join(filter(None, ("Holm-adjusted" * (abs(decides - p) > 1e-12), more)))
    return f"{p_text(decides)} ({text})" if text else p_text(decides)


def bootstrapped(draws: int) -> str:
    """Return the source of a likelihood ratio's p, after other words; nothing by t."""
    return f"; parametric bootstrap, {draws} draws" if draws else ""


def law_of_mixed(*, scenes: bool) -> str:
    """Return the law of limits and tests of a mixed model, for a paragraph on methods."""
    df = "between those of participants and of scenes" if scenes else "of participants - 1"
    return f"t with degrees of freedom {df}"


def like_these(*, scenes: bool) -> str:
    """Return the people and scenes that limits speak of; `scenes`: these were drawn from many."""
    return f"people like these and {'scenes like these' if scenes else 'these scenes'}"


@dataclass(frozen=True)
class GroupedRow(Generic[G, T]):
    """A row of a table of groups; the group is named in its first row."""

    group: G
    entry: T
    first: bool


def group_rows(groups: Iterable[tuple[G, Sequence[T]]]) -> list[GroupedRow[G, T]]:
    """Return the rows of a table of groups."""
    return [
        GroupedRow(group, one, one is several[0]) for group, several in groups for one in several
    ]


def sd_text(deviations: Mapping[str, float]) -> str:
    """Return deviations by name as text: ``participant 0.31, scene 0.12``."""
    return ", ".join(f"{name} {number(sd)}" for name, sd in deviations.items()) or NONE


def in_order(found: Sequence[T], plan: AnalysisPlan, name: Callable[[T], str]) -> tuple[T, ...]:
    """Return results by condition in the order that the study declares."""
    names = plan.in_order(list(dict.fromkeys(map(name, found))))
    return tuple(sorted(found, key=lambda one: names.index(name(one))))


def told_apart(found: Sequence[Difference], plan: AnalysisPlan) -> tuple[Difference, ...]:
    """Return differences in order, without those that nothing can be said of: of one person."""
    known = [one for one in found if np.isfinite(one.p)]
    return in_order(known, plan, lambda one: one.first)


def pairs_in(cells: pd.DataFrame, plan: AnalysisPlan) -> list[tuple[str, str]]:
    """Return the conditions of a study's cells that are compared."""
    names = list(dict.fromkeys(cells["condition"]))
    return pairs_of(names, plan.reference_in(names))


def difference_table(
    found: Sequence[Difference], plan: AnalysisPlan, caption: str = "", *, told: bool = True
) -> ResultTable[Difference]:
    """Return the table of differences; `told` if their p decide."""
    p = deciding_column(plan)
    return ResultTable.of(
        caption,
        found,
        compared(plan),
        estimated("Difference", "difference"),
        limits(plan.limits),
        attribute("SE", "standard_error"),
        T_DF,
        p if told else undecided(p),
    )


def difference_tables(
    caption: str, found: Sequence[Difference], plan: AnalysisPlan, *, told: bool = True
) -> tuple[Block, ...]:
    """Return the table of differences, and whose p is held; nothing where there are none."""
    if not found:
        return ()
    table = difference_table(found, plan, f"{caption}{over(found, plan)}", told=told)
    held = grouped([(between(one, plan), (one.held,) if one.held else ()) for one in found])
    text = many_told(found, plan)
    more = (Paragraph(text, muted=True),) if text else ()
    return table.block(), *more, Cautions("About these differences", held)


def apa_difference(one: Difference, plan: AnalysisPlan) -> str:
    """Return the difference of two conditions as a sentence."""
    return (
        f"{plan.label(one.first)} minus {plan.label(one.second)}: {placed(one, one.difference)} in"
        f" {one.measure}, {level_text(one.level)} {number_range(one.lower, one.upper)},"
        f" {t_text(one.t, one.df)}, {apa_p(one.p, decides(one, plan))}."
    )


def alone(table: pd.DataFrame, plan: AnalysisPlan) -> tuple[str, ...]:
    """Return a note where one person saw several conditions."""
    if table["participant"].nunique() > 1 or len(set(table[plan.compared[0]])) < 2:
        return ()
    return ("one participant only: conditions are not compared",)


def estimate(what: str, value: float, one: Rate | Measure, trials: int) -> Estimate:
    """Return one of the main numbers of a report."""
    return Estimate(what, value, one.lower, one.upper, one.p, trials)


def planned_family(count: int, plan: RatePlan | PreferencePlan) -> FamilyOfTests:
    """Return the planned comparisons; of right answers without any, the test against chance."""
    if isinstance(plan, RatePlan) and not count:
        return FamilyOfTests("test", " against chance", toward=min(plan.chance, 1.0 - plan.chance))
    people, holm = plan.test != "pooled", plan.correction == "holm"
    return FamilyOfTests("comparison", count=count, holm=holm, people=people)


def difference_estimates(
    several: Sequence[Difference], trials: Mapping[str, int], plan: RatePlan
) -> list[Estimate]:
    """Return differences as the main numbers of a report; `trials` are those of conditions."""
    return [
        Estimate(
            f"{between(one, plan)}, {one.measure}",
            one.difference,
            one.lower,
            one.upper,
            decides(one, plan),
            trials[one.first] + trials[one.second],
        )
        for one in several
    ]


def mean_differences_p(
    scored: SimulatedAnswers, people: Sequence[int], plan: AnalysisPlan, *, holms: bool = True
) -> Floats:
    """Return p of differences between conditions (studies, numbers of participants, pairs).

    Of simulated numbers; near the tests of a mixed model.
    """
    names = scored.cells["condition"]
    means = {}
    for name in dict.fromkeys(names):
        total, shown = scored.grid((names == name).to_numpy(), by_scene=True)
        means[name] = np.where(shown > 0, total / np.maximum(shown, 1.0), np.nan)
    pairs = pairs_in(scored.cells, plan)
    means[MEAN] = np.mean([*means.values()], axis=0)
    each = [
        [crossed_means_p((means[one] - means[other])[:, :count]) for one, other in pairs]
        for count in people
    ]
    p = np.moveaxis(np.array(each), -1, 0)
    return holm(p) if holms else p
