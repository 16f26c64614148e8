"""Ordered ratings, or graded comparisons of pairs: a cumulative-link mixed model."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, TypeVar

import numpy as np
import pandas as pd
from scipy.special import ndtri

from analysis.answers import SimulatedAnswers
from analysis.models.ordinal import (
    RatedCondition,
    RatingDifference,
    RatingModel,
    paired_ratings,
    rating_model,
)
from analysis.parts import AnalysisPlan, Estimate, PartFigure, Presentation, SimplePart, Tests
from analysis.parts.margins import (
    contrast_sentences,
    contrasts_table,
    margin_tables,
    means_table,
)
from analysis.parts.shared import (
    apa_test,
    between,
    compared,
    decides,
    deciding_column,
    mean_differences_p,
    over,
    pairs_in,
    ratio_told,
    sd_text,
    tests_of,
)
from analysis.plans.rating_plan import RatingPlan
from analysis.plots.tasks import ratings_plot
from analysis.repeat import lme4_effects, scripts
from analysis.report.result_table import (
    T_DF,
    ResultColumn,
    ResultTable,
    attribute,
    estimated,
    limits,
)
from analysis.report.wording import (
    NOT_IDENTIFIED,
    by_how_much,
    df_text,
    leading,
    level_text,
    number,
    number_range,
    placed,
    share,
)
from analysis.showable import FamilyOfTests
from protocols.blocks import Block, Box, Cautions, FigurePlace, Paragraph, Section
from protocols.tasks.rates import name_of

T = TypeVar("T")

EACH_SHOWN = 11
"""More ratings than so many, as of a slider, are told by quartiles."""
QUARTILES = {
    "Lowest": 1e-9, "First quartile": 0.25, "Median": 0.5, "Third quartile": 0.75,
    "Highest": 1.0 - 1e-9,
}  # fmt: skip
"""Columns in place of each rating, and the share of ratings up to there."""


@dataclass(frozen=True)
class RatingResults:
    """Every number.

    Attributes
    ----------
    model : RatingModel
        Places of conditions on the latent axis, and their comparisons.
    levels : mapping
        How often each participant gave each rating, in the order of the model's categories.
    """

    model: RatingModel
    levels: Mapping[str, tuple[int, ...]]
    notes: tuple[str, ...] = ()


class RatingsPart(SimplePart[RatingPlan, RatingResults]):
    """Places of conditions on the latent axis that ratings cut, and their differences."""

    name: ClassVar[str] = "ratings"
    section: ClassVar[tuple[str, str]] = ("ratings", "Ratings")
    essential: ClassVar[bool] = True

    def of(self, table: pd.DataFrame, plan: RatingPlan) -> RatingResults:
        """Fit the model; count each participant's ratings."""
        how: dict[str, Any] = {"reference": plan.reference_in(()), "link": plan.link}
        how |= {"asked": plan.contrasts, "inference": plan.inference}
        if not plan.by:
            model = paired_ratings(table, **how)
        else:
            blank = "scene" in table and (table["scene"] == "").all()
            rows = table.drop(columns="scene") if blank else table
            categories = plan.scale or None
            model = rating_model(rows, (plan.by,), categories=categories, **how)
        levels = pd.crosstab(table["participant"], table["rating"].map(name_of))
        levels = levels.reindex(columns=list(model.categories), fill_value=0)
        return RatingResults(
            model,
            {str(who): tuple(map(int, row)) for who, row in levels.iterrows()},
            tuple(_family(len(model.contrasts), plan).hopeless(len(levels), plan.alpha)),
        )

    def planned_p(self, found: RatingResults, plan: RatingPlan) -> float | None:
        """Return the least p of the comparisons."""
        every = (decides(one, plan) for one in found.model.contrasts)
        return min((p for p in every if p >= 0), default=None)

    def families(self, cells: pd.DataFrame, plan: RatingPlan) -> Sequence[FamilyOfTests]:
        """Return the comparisons."""
        return (_family(len(pairs_in(cells, plan)), plan),)

    def planned_over(
        self, answers: SimulatedAnswers, people: Sequence[int], plan: RatingPlan
    ) -> Tests:
        """Test differences of mean normal scores of ratings, near those of the model."""
        steps, counts = np.unique(answers.given, return_counts=True)
        scores = ndtri((np.cumsum(counts) - 0.5 * counts) / counts.sum())
        scores -= np.average(scores, weights=counts)
        scores /= np.sqrt(np.average(scores**2, weights=counts))
        scored = replace(answers, given=scores[np.searchsorted(steps, answers.given)])
        return {
            "": partial(mean_differences_p, scored, people, plan, holms=plan.correction == "holm")
        }

    def estimates(self, found: RatingResults, plan: RatingPlan) -> Sequence[Estimate]:
        """Return distances of conditions on the latent axis, where they are known."""
        count = sum(map(sum, found.levels.values()))
        return [
            Estimate(
                f"{between(one, plan)}, latent axis",
                one.difference,
                one.lower,
                one.upper,
                decides(one, plan),
                count,
            )
            for one in found.model.contrasts
            if not math.isnan(one.difference)
        ]

    def show(self, found: RatingResults, plan: RatingPlan) -> Presentation:
        """Return places, comparisons, people, and the clearest comparison before all."""
        model, pairs = found.model, not plan.by
        places, comparisons = _places(model, plan), _comparisons(model, plan)
        own = [one.p for one in model.contrasts]
        first = model.contrasts[min(range(len(own)), key=lambda k: (math.isnan(own[k]), own[k]))]
        headline = apa_rating(first, model, plan)
        count = sum(decides(one, plan) < plan.alpha for one in model.contrasts)
        differ = f"{count} of {len(own)} comparisons differ"
        if len(own) < 2:
            differ = "They differ" if count else "No difference is shown"
        caption = (
            f"{'' if pairs else 'Left: share of each rating. '}Places on the latent axis with"
            f" {plan.limits}, from the first condition on."
        )
        return Presentation(
            lead=(
                Box(
                    "Clearest comparison",
                    headline,
                    f"{differ}, two-sided{over(own, plan)}, by"
                    f" {tests_of(model.contrasts).partition(',')[0]}.",
                ),
            ),
            headline=headline,
            blocks=_blocks(model, places, comparisons, plan),
            further=(Section("people", "Participants", "Participants", _people(found)),),
            sentences=(
                *(apa_rating(one, model, plan) for one in model.contrasts),
                *contrast_sentences(model.margins, plan, _unit(model)),
            ),
            methods=_methods(found, plan),
            tables=_tables(model, places, comparisons),
            scripts={} if pairs else _scripts(model, plan),
            figures=(
                PartFigure("ratings", caption, partial(ratings_plot, model, shares=not pairs)),
            ),
        )


def _family(count: int, plan: RatingPlan) -> FamilyOfTests:
    """Return so many comparisons, whose p a parametric bootstrap alone holds."""
    holms = plan.correction == "holm"
    return FamilyOfTests(
        "comparison", " of ratings", count, holms, False, draws=plan.bootstrap_draws
    )


def apa_rating(one: RatingDifference, model: RatingModel, plan: AnalysisPlan) -> str:
    """Return a sentence on how much higher one condition is rated."""
    law = f"cumulative {model.link} mixed model"
    if math.isnan(one.difference):
        return f"How {one.first} was rated against {one.second} is {NOT_IDENTIFIED}."
    apart = by_how_much(one, one.difference, _unit(model), ("above", "below"))
    return (
        f"{one.first} was rated {apart} {one.second} (difference"
        f" {placed(one, one.difference)}, {level_text(one.level)}"
        f" {number_range(one.lower, one.upper)}),"
        f" {apa_test(one, model.contrasts, plan, law)}; one showing of it is rated higher"
        f" with a chance of {leading(f'{one.superiority:.2f}')}."
    )


def _unit(model: RatingModel) -> str:
    return "SD" if model.link == "probit" else "logits"


def _methods(found: RatingResults, plan: RatingPlan) -> str:
    model = found.model
    kind = "ordered ratings" if plan.by else "graded comparisons of pairs"
    count = len(model.contrasts)
    df = sorted({df_text(one.df) for one in model.contrasts if not math.isnan(one.df)}, key=float)
    law = f"t of {' to '.join(dict.fromkeys((*df[:1], *df[-1:])))}" if df else "t of as many"
    corrected = "Holm-adjusted" if plan.correction == "holm" else "not adjusted"
    over = f", {corrected} over {count} comparisons" * (count > 1)
    formula = f" (rating ~ condition + {' + '.join(lme4_effects(model.sd))})" * bool(plan.by)
    return (
        f"Answers are {kind} on {len(model.categories)} categories, analysed by a cumulative-link"
        f" mixed model ({model.link}; McCullagh, 1980; Laplace approximation), random over"
        f" {', '.join(model.sd)}{formula}. Differences have p and limits by"
        f" {tests_of(model.contrasts)} are {law} degrees of freedom, two-sided, alpha ="
        f" {leading(f'{plan.alpha:g}')}{over}."
    )


def _places(model: RatingModel, plan: RatingPlan) -> ResultTable[RatedCondition]:
    columns: list[ResultColumn[RatedCondition]] = [
        attribute("Condition", "condition", str, "l c"),
        attribute("Ratings", "ratings", str),
        estimated("Place", "place"),
        limits(plan.limits),
    ]
    if plan.by:
        columns += [
            attribute("Mean", "mean_rating"),
            *_steps(model, _shares_of, share),
            ResultColumn("", "", None, partial(_shares, model)),
        ]
    caption = f"Places on the latent axis, {_unit(model)} from the first"
    return ResultTable(caption, model.conditions, columns)


def _shares_of(one: RatedCondition) -> tuple[float, ...]:
    return one.shares


def _shares(model: RatingModel, one: RatedCondition) -> dict[str, object]:
    names = (f"share_{name}" for name in model.categories)
    return dict(zip(names, one.shares, strict=True))


def _comparisons(model: RatingModel, plan: RatingPlan) -> ResultTable[RatingDifference]:
    value = estimated(f"Difference, {_unit(model)}", "difference")
    higher = attribute("Rated higher", "superiority", share)
    return ResultTable.of(
        f"Comparisons{over(model.contrasts, plan)}",
        model.contrasts,
        compared(plan),
        value,
        limits(plan.limits),
        T_DF,
        deciding_column(plan),
        higher,
    )


def _blocks(
    model: RatingModel,
    places: ResultTable[RatedCondition],
    comparisons: ResultTable[RatingDifference],
    plan: RatingPlan,
) -> tuple[Block, ...]:
    pairs, unit = not plan.by, _unit(model)
    told = (
        "Ratings cut a latent axis at thresholds (cumulative-link mixed model). Place: where a"
        f" condition lies on it. Random, SD: {sd_text(model.sd)}. Rated higher: the chance that one"
        " showing of the first is rated above one of the second by the same person, on the axis,"
        f" where nothing ties. {ratio_told(model.contrasts, plan)}"
    )
    if pairs:
        told += (
            f" Thresholds: {', '.join(map(number, model.thresholds))}; symmetric around 0 unless"
            " the place in the pair sways the answer."
        )
    else:
        told += " Mean: for orientation only, the steps of a scale have no unit; " + (
            "beside it quartiles." if _many(model) else "under the ratings their shares."
        )
    middle = f"Means on the latent axis, {unit} from the middle of all thresholds"
    return (
        FigurePlace("ratings"),
        comparisons.block(),
        places.block(),
        *means_table(middle, model.margins, plan),
        *contrasts_table(model.margins, plan, unit),
        Paragraph(told, muted=True),
        Cautions("When not to trust these ratings", model.warnings),
    )


def _many(model: RatingModel) -> bool:
    return len(model.categories) > EACH_SHOWN


def _steps(
    model: RatingModel, often: Callable[[T], Sequence[float]], text: Callable[[float], str]
) -> Iterator[ResultColumn[T]]:
    """Yield columns of the ratings, or of their quartiles where there are many."""
    for place, name in enumerate(QUARTILES if _many(model) else model.categories):
        yield ResultColumn(name, "", partial(_step, model, often, text, place))


def _step(
    model: RatingModel,
    often: Callable[[T], Sequence[float]],
    text: Callable[[float], str],
    place: int,
    row: T,
) -> str:
    return _told(model, often(row), text)[place]


def _told(model: RatingModel, often: Sequence[float], text: Callable[[float], str]) -> list[str]:
    """Return counts or shares of the ratings, or the quartiles where there are many."""
    if not _many(model):
        return [text(one) for one in often]
    reached = np.cumsum(np.asarray(often, dtype=np.float64))
    at = np.searchsorted(reached, reached[-1] * np.array(list(QUARTILES.values())))
    return [model.categories[place] for place in at]


def _people(found: RatingResults) -> tuple[Block, ...]:
    model = found.model
    return (
        ResultTable.of(
            f"Ratings by participant, {'quartiles' if _many(model) else 'in numbers'}",
            [*found.levels],
            ResultColumn("Participant", "l", str),
            *_steps(model, found.levels.__getitem__, "{:.0f}".format),
        ).block(),
        Paragraph(
            "People use a scale in their own ways; the model takes a person who rates everything"
            " higher as just that. One who gave a single rating tells nothing.",
            muted=True,
        ),
    )


def _scripts(model: RatingModel, plan: RatingPlan) -> dict[str, str]:
    if all(math.isnan(one.place) for one in model.conditions[1:]):
        return {}
    languages = ("py",) if _many(model) else ("R", "py")  # clmm takes minutes, and finds no maximum
    effects, draws = lme4_effects(model.sd), plan.bootstrap_draws
    return scripts(
        "ratings", *languages, by=[plan.by], link=model.link, effects=effects, draws=draws
    )


def _tables(
    model: RatingModel,
    places: ResultTable[RatedCondition],
    comparisons: ResultTable[RatingDifference],
) -> dict[str, pd.DataFrame]:
    cuts = {"below": model.used[:-1], "above": model.used[1:], "threshold": model.thresholds}
    return {
        "ratings.csv": places.frame(),
        "comparisons.csv": comparisons.every_field(),
        **margin_tables(model.margins, "ratings"),
        "thresholds.csv": pd.DataFrame(cuts),
    }
