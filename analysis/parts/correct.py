"""Right answers by condition, against chance; which answer was given where which was right.

Answers that are worse than guessing, or fall where they should rise, are mistakes of a table.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
import pandas as pd

from analysis.models.numeric import binomial_below
from analysis.models.right_answers import Rate, correct_rates
from analysis.parts import AnalysisPlan, PartFigure, Presentation, SimplePart
from analysis.parts.shared import condition, in_order
from analysis.plans.rate_plan import RatePlan, shown_in
from analysis.plots import heat_map, rates_plot
from analysis.report.result_table import (
    P_VALUE,
    ResultColumn,
    ResultTable,
    attribute,
    deciding,
    limits,
    p_value,
)
from analysis.report.wording import (
    level_text,
    p_text,
    share,
    share_range,
)
from protocols.blocks import Cautions, FigurePlace, Paragraph
from protocols.errors import count_of


@dataclass(frozen=True)
class Rates:
    """Every number.

    Attributes
    ----------
    conditions : tuple of Rate
        Right answers, against chance.
    answers : tuple of str
        Empty where the table does not say them.
    confusion : tuple of tuple of float
        Share of each answer (columns, as `answers`) where each was right (rows).
    """

    conditions: tuple[Rate, ...]
    answers: tuple[str, ...]
    confusion: tuple[tuple[float | None, ...], ...]
    notes: tuple[str, ...]


class RatesPart(SimplePart[RatePlan, Rates]):
    """Shares of right answers."""

    name: ClassVar[str] = "rates"
    section: ClassVar[tuple[str, str]] = ("correct", "Right answers")
    essential: ClassVar[bool] = True

    def of(self, table: pd.DataFrame, plan: RatePlan) -> Rates:
        """Count right answers, and each answer where each was right."""
        rates = correct_rates(table, plan.compared, chance=plan.chance, level=plan.confidence)
        notes = odd_answers(table, plan)
        shown = shown_in(table, plan)
        if missing := [plan.label(name) for name in plan.values if name not in shown]:
            notes.append(f"no decisions of {', '.join(missing)}")
        answers = answers_in(table, plan)
        confusion: list[tuple[float | None, ...]] = []
        for right in answers:
            said = table.loc[table["expected"].astype(str) == right, "answer"].astype(str)
            confusion.append(
                tuple(float((said == one).mean()) if len(said) else None for one in answers)
            )
        ordered = in_order(rates, plan, lambda one: one.condition)
        return Rates(ordered, answers, tuple(confusion), tuple(notes))

    def show(self, found: Rates, plan: RatePlan) -> Presentation:
        """Return shares against chance, and the table of confusions of more than two answers."""
        rates, label = found.conditions, plan.label
        names = [label(one.condition) for one in rates]
        among = f"Answers were given in {len(names)} conditions ({', '.join(names)}). "
        caption = (
            f"Shares of right answers with {plan.limits} that respect"
            f" {respected(rates)}; p against chance, which is dashed."
        )
        figures = [PartFigure("correct", caption, partial(rates_plot, rates, label=label))]
        told = plan.kind != "detection" and not plan.by_threshold
        table = rate_table(f"Right answers by {plan.by_name or 'condition'}", rates, plan, told)
        tables = {"rates.csv": table.every_field()}
        if len(found.answers) > 2:
            matrix = np.array(found.confusion, dtype=np.float64)
            answers = [label(one) for one in found.answers]
            draw = partial(heat_map, matrix, answers, answers, row_title="Right answer")
            caption = "Share of each answer (columns) where each was right (rows)."
            figures.append(PartFigure("confusion", caption, draw))
            tables["confusion.csv"] = pd.DataFrame(
                matrix, columns=list(found.answers), index=list(found.answers)
            ).reset_index(names="expected")
        return Presentation(
            blocks=(
                FigurePlace("correct"),
                table.block(),
                *[
                    Paragraph(
                        f"Deciding p: against chance, with {errors(rates)}; limits"
                        " belong to the same test.",
                        muted=True,
                    )
                ]
                * told,
                Cautions.each(
                    "When not to trust these shares", rates, lambda one: label(one.condition)
                ),
                FigurePlace("confusion"),
            ),
            others=(
                table.folded(
                    "Right answers against chance, pooled",
                    "Papers print the exact test of all trials. It takes trials as independent,"
                    " which they are not."
                    + " p of clustered errors stands beside it, because d' (or the threshold)"
                    " decides here." * (not told),
                ),
            ),
            sentences=tuple(apa_rate(one, label(one.condition), tested=told) for one in rates),
            methods=(
                f"{among if len(names) > 1 else ''}Shares of right answers were tested against"
                f" chance with {errors(rates)}."
            ),
            tables=tables,
            figures=figures,
        )


def rate_table(
    caption: str, rates: Sequence[Rate], plan: AnalysisPlan, told: bool = True
) -> ResultTable[Rate]:
    """Return the table of shares; `told` if their p decides."""
    return ResultTable.of(
        caption,
        rates,
        condition(plan),
        ResultColumn("Right", "n", lambda one: f"{one.count} / {one.trials}"),
        attribute("Share", "share", share, "strong"),
        limits(plan.limits, share_range),
        attribute("Chance", "chance", share),
        deciding() if told else P_VALUE,
        p_value("Pooled exact p", "exact_p"),
    )


def respected(rates: Iterable[Rate]) -> str:
    """Return those whose variation limits respect: scenes too where a condition has several."""
    return "participants and scenes" if any(one.scenes > 1 for one in rates) else "participants"


def clusters(rates: Iterable[Rate]) -> str:
    """Return the words for the clusters of errors."""
    return respected(rates).replace("participants", "participant").replace("scenes", "scene")


def errors(rates: Sequence[Rate]) -> str:
    """Return the words for errors; those of one participant take trials as they come."""
    if all(one.participants < 2 for one in rates):
        return "errors of independent trials"
    return f"errors clustered by {clusters(rates)}"


def apa_rate(rate: Rate, name: str = "", *, tested: bool = True) -> str:
    """Return the share of right answers of one condition as a sentence; `tested`: with its p."""
    people = count_of(rate.participants, "participant")
    against = f", {p_text(rate.p)} against chance (" if tested else " (chance "
    return (
        f"In condition {name or rate.condition}, {rate.count} of {rate.trials} answers were"
        f" correct, {share(rate.share)}, {level_text(rate.level)}"
        f" {share_range(rate.lower, rate.upper)}{against}{share(rate.chance)}; {people}"
        f"{'' if rate.scenes < 2 else f', {rate.scenes} scenes'})."
    )


def odd_answers(rows: pd.DataFrame, plan: RatePlan) -> list[str]:
    """Return notes on answers that are below guessing, or get worse where they should not."""
    notes = [] if plan.adaptive else list(below_guessing(rows, plan.chance))
    if plan.level is not None and wrong_way(rows, plan.level, falling=plan.falling):
        change = ("better", "false") if plan.falling else ("worse", "true")
        notes.append(
            f"answers get {change[0]} as {plan.level} rises: curves and thresholds mean"
            f" nothing; say falling = {change[1]} (--set falling={change[1]})"
        )
    elif plan.level is not None and not notes:
        low = below_at(rows, plan.level, plan.chance)
        if low and not plan.adaptive:
            notes.append(f"{low}: were there more than {plan.alternatives} answers?")
    return notes


def answers_in(rows: pd.DataFrame, plan: RatePlan) -> tuple[str, ...]:
    """Return the answers of a table of confusions; none where it does not say them."""
    if "expected" not in rows or "answer" not in rows or (rows["answer"] == "").any():
        return ()
    given = {*rows["expected"].astype(str), *rows["answer"].astype(str)}
    return plan.answers if given <= set(plan.answers) else tuple(sorted(given))


RARE = 1e-4
"""Chance of a false alarm in a table whose answers are as they should be."""
_STEEP = 4.0
"""So many standard errors of the trend of all people together are no chance."""


def below_guessing(rows: pd.DataFrame, chance: float) -> tuple[str, ...]:
    """Return a note where right answers are fewer than guessing gives; else none."""
    right, trials = int(rows["correct"].sum()), len(rows)
    if binomial_below(right, trials, chance) >= RARE:
        return ()
    return (
        f"answers are below guessing ({right} of {trials} right): if correct is 1 for errors, say"
        " --map correct=COLUMN:errors; if answers are named the wrong way round, --answer",
    )


def below_at(rows: pd.DataFrame, level: str, chance: float) -> str:
    """Return levels with fewer right answers than guessing gives; empty: none."""
    counts = rows.groupby(level)["correct"].agg(["sum", "size"])
    low = counts[binomial_below(counts["sum"], counts["size"], chance) < RARE / len(counts)]
    if low.empty:
        return ""
    return (
        f"right answers are fewer than guessing at {chance:g} gives (at {level} {low.index[0]:g},"
        f" {low['sum'].iloc[0]} of {low['size'].iloc[0]})"
    )


def wrong_way(rows: pd.DataFrame, level: str, *, falling: bool) -> bool:
    """Return True if answers get worse along a level where they should get better, or turned.

    Cochran's and Armitage's test of trend, within participants.
    """
    rank = rows[level].astype(float).rank(method="dense")
    people = rows["participant"]
    away = rank - rank.groupby(people).transform("mean")
    mean = rows["correct"].groupby(people).transform("mean")
    spread = float((away**2 * mean * (1.0 - mean)).sum())
    if spread <= 0.0:
        return False
    trend = float((away * (rows["correct"] - mean)).sum()) / np.sqrt(spread)
    return bool(trend > _STEEP if falling else trend < -_STEEP)


def curve_mistake(rows: pd.DataFrame, level: str, guess: float | None, *, falling: bool) -> str:
    """Return the fault of a table that no psychometric function can have made, and the cure.

    Empty where nothing is.
    """
    low = "" if guess is None else below_at(rows, level, guess)
    if wrong_way(rows, level, falling=falling):
        share = rows.groupby(level)["correct"].mean()
        if low and share.max() < 0.85 and share.min() < 0.15:
            return (
                f"answers are below guessing and {'rise' if falling else 'fall'} with {level} (to"
                f" {share.min():.2f} right): correct seems to be 1 for errors; say"
                " --map correct=COLUMN:errors"
            )
        cure = "leave --falling away" if falling else "say --falling"
        return f"answers get {'better' if falling else 'worse'} as {level} rises; {cure}"
    return f"{low}; say --guess 0.25 if there were four answers, or --guess fit" if low else ""
