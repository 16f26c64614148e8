"""Psychometric functions along a level, in the population."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar, TypeVar

import numpy as np
import pandas as pd
import scipy

from analysis.answers import SimulatedAnswers
from analysis.arrays import Floats
from analysis.models.clustered import holm
from analysis.models.contrasts import Difference
from analysis.models.curves.population import Threshold
from analysis.models.thresholds import ThresholdModel, fit_thresholds
from analysis.parts import Estimate, PartFigure, PartResults, Presentation, SimplePart, Tests
from analysis.parts.shared import (
    apa_difference,
    condition,
    difference_estimates,
    difference_table,
    difference_tables,
    in_order,
    law_of_mixed,
    like_these,
    pairs_in,
)
from analysis.plans.rate_plan import RatePlan, shown_in
from analysis.plots.psychometric_plots import PANELS, DrawnCurve, people_plot, psychometric_plot
from analysis.report.result_table import ResultColumn, ResultTable, within
from analysis.report.wording import (
    NONE,
    NOT_IDENTIFIED,
    Ends,
    column_in_words,
    leading,
    level_text,
    number,
    share,
    size,
    size_range,
)
from analysis.showable import FamilyOfTests
from protocols.adaptive.answer_history import Shape
from protocols.blocks import Block, Cautions, CopyText, FigurePlace, Folded, Paragraph

R = TypeVar("R")

BANDS = 4
"""Curves, at most, whose limits are drawn as bands; more would hide each other."""
WIDELY_SPACED = 8.0
"""Levels whose largest is so many times the smallest are drawn on a logarithmic axis."""
SECTION = ("levels", "Levels")
TRUST = "When not to trust these levels"
SHAPES: Mapping[Shape, str] = {
    "gauss": "cumulative normal",
    "logistic": "logistic",
    "gumbel": "Gumbel (Weibull on logarithms)",
    "weibull": "Weibull",
}


@dataclass(frozen=True)
class Counts:
    """Right answers and trials of a condition by level, all participants together."""

    levels: tuple[float, ...]
    right: tuple[int, ...]
    trials: tuple[int, ...]

    @property
    def arrays(self) -> tuple[Floats, Floats, Floats]:
        """Levels, right answers and trials."""
        x, right, trials = np.array((self.levels, self.right, self.trials), dtype=np.float64)
        return x, right, trials


def counts_in(table: pd.DataFrame, plan: RatePlan) -> dict[str, Counts]:
    """Return counts by condition."""
    found = {}
    for name in shown_in(table, plan):
        rows = table[table["condition"] == name]
        each = rows.groupby(pd.to_numeric(rows[plan.level]))["correct"].agg(["sum", "size"])
        right, trials = (tuple(map(int, each[column])) for column in ("sum", "size"))
        found[name] = Counts(tuple(map(float, each.index)), right, trials)
    return found


def levels_axis(plan: RatePlan) -> str:
    """Return the title of the axis of levels."""
    name = column_in_words(str(plan.level))
    return name[:1].upper() + name[1:]


def counts_of_people(table: pd.DataFrame, plan: RatePlan) -> dict[str, dict[str, Counts]]:
    """Return counts by participant and condition."""
    return {
        str(who): counts_in(rows, plan) for who, rows in table.groupby("participant", sort=True)
    }


def figure_axes(shown: Iterable[Sequence[float]], plan: RatePlan) -> dict[str, Any]:
    """Return the settings with which axes along such levels are drawn."""
    levels = np.array([x for several in shown for x in several])
    wide = bool(levels.min() > 0 and levels.max() / levels.min() > WIDELY_SPACED)
    return {
        "x_label": levels_axis(plan),
        "logarithmic": wide or plan.logarithmic,
        "label": plan.label,
        "level": plan.confidence,
    }


def curves_figure(
    name: str,
    fits: str,
    counts: Mapping[str, Counts],
    curves: Mapping[str, DrawnCurve],
    plan: RatePlan,
) -> PartFigure:
    """Return the figure of shares along the level, and of curves that `fits` names."""
    draw = partial(
        psychometric_plot,
        {key: (*one.arrays, curves.get(key)) for key, one in counts.items()},
        chance=plan.guess,
        **figure_axes([one.levels for one in counts.values()], plan),
    )
    caption = (
        f"Right answers by {plan.level}: data of all participants together with binomial standard"
        f" errors (points){f', {fits} (curves)' * bool(curves)}; dashed: chance."
    )
    return PartFigure(name, caption, draw)


def people_figure(
    name: str,
    fits: str,
    people: Mapping[str, Mapping[str, Counts]],
    curves: Mapping[tuple[str, str], DrawnCurve],
    plan: RatePlan,
) -> PartFigure:
    """Return the figure of each participant; `curves` are by participant and condition."""
    series = {
        who: {key: (*one.arrays, curves.get((who, key))) for key, one in counts.items()}
        for who, counts in people.items()
    }
    every = [one.levels for counts in people.values() for one in counts.values()]
    first = f"the first {PANELS} of {len(people)} participants" if len(people) > PANELS else ""
    caption = (
        f"Right answers of {first or 'each participant'} by {plan.level} (points), {fits} (curves),"
        " and thresholds (below); dashed: chance."
    )
    draw = partial(people_plot, series, chance=plan.guess, **figure_axes(every, plan))
    return PartFigure(name, caption, draw)


@dataclass(frozen=True)
class PlacedThreshold:
    """A threshold and the width of its curve; `known` where the answers place them.

    The width is a length: that of a falling curve, whose `width` is negative, as well.
    """

    known: bool
    value: float
    ends: Ends | None
    width: float


def threshold_columns(
    of: Callable[[R], PlacedThreshold], limits: str, *, logarithmic: bool
) -> Iterator[ResultColumn[R]]:
    """Yield threshold, limits and width; none where the answers do not place them."""

    def column(
        title: str, style: str, none: str, text: Callable[[PlacedThreshold], str]
    ) -> ResultColumn[PlacedThreshold]:
        return ResultColumn(title, style, lambda one: text(one) if one.known else none)

    yield from within(
        of,
        (
            column(
                "Threshold",
                "strong",
                NOT_IDENTIFIED,
                lambda one: size(one.value, within=one.ends),
            ),
            column(limits, "n", NONE, lambda one: size_range(one.ends)),
            column(
                "Width, as a ratio" if logarithmic else "Width",
                "",
                NONE,
                lambda one: size(abs(one.width)),
            ),
        ),
    )


def section_title(plan: RatePlan) -> str:
    """Return the heading of the section of levels."""
    return f"By {column_in_words(str(plan.level))}"


P = TypeVar("P", bound=PartResults)


class LevelsPart(SimplePart[RatePlan, P]):
    """Base of parts along a level."""

    section: ClassVar[tuple[str, str]] = SECTION

    def wanted(self, _table: pd.DataFrame, plan: RatePlan) -> bool:
        """Return True if there is a level."""
        return plan.level is not None

    def title(self, plan: RatePlan) -> str:
        """Return the heading of the section."""
        return section_title(plan)


def _counted(counts: Mapping[str, Counts]) -> pd.DataFrame:
    return pd.DataFrame(
        {"condition": name, "level": x, "right": right, "trials": trials}
        for name, one in counts.items()
        for x, right, trials in zip(one.levels, one.right, one.trials, strict=True)
    )


@dataclass(frozen=True)
class Thresholds(ThresholdModel):
    """Every number; `counts` as curves are drawn beside them, `people` of each participant."""

    counts: Mapping[str, Counts]
    people: Mapping[str, Mapping[str, Counts]] = field(repr=False)
    notes: tuple[str, ...] = ()

    @property
    def levels(self) -> list[float]:
        """All levels shown."""
        return [x for one in self.counts.values() for x in one.levels]


class ThresholdsPart(LevelsPart[Thresholds]):
    """Thresholds in the population: one model, random over participants and scenes."""

    name: ClassVar[str] = "thresholds"

    def of(self, table: pd.DataFrame, plan: RatePlan) -> Thresholds:
        """Fit the model.

        Raises
        ------
        ValueError
            If there is one participant only, or none can be fitted.
        """
        if table["participant"].nunique() < 2:
            raise ValueError("one participant only: nothing is said about other people")
        model = fit_thresholds(
            table,
            str(plan.level),
            plan.compared,
            plan.curve,
            scenes="scene" in table,
            reference=plan.reference_in(shown_in(table, plan)),
            level=plan.confidence,
        )
        ordered = replace(
            model,
            thresholds=in_order(model.thresholds, plan, lambda one: one.condition),
            contrasts=in_order(model.contrasts, plan, lambda one: one.first),
        )
        return Thresholds(
            **vars(ordered), counts=counts_in(table, plan), people=counts_of_people(table, plan)
        )

    def planned_over(
        self, answers: SimulatedAnswers, people: Sequence[int], plan: RatePlan
    ) -> Tests:
        """Test thresholds that levels chosen from the answers gave, by paired t tests."""

        def tested() -> Floats:
            gaps = answers.counts[..., 1:] - answers.counts[..., :1]
            tests = (scipy.stats.ttest_1samp(gaps[:, :count], 0.0, axis=1) for count in people)
            p = np.stack([test.pvalue for test in tests], axis=1)
            return holm(p) if plan.correction == "holm" else p

        return {"": tested} if plan.adaptive else {}

    def families(self, cells: pd.DataFrame, plan: RatePlan) -> Sequence[FamilyOfTests]:
        """Return the comparisons, where levels adapt; nothing holds their p."""
        count = len(pairs_in(cells, plan))
        return (FamilyOfTests("comparison", " of thresholds", count, people=False),) * plan.adaptive

    def estimates(self, found: Thresholds, plan: RatePlan) -> Sequence[Estimate]:
        """Return differences of thresholds, where levels adapt and so these are the result."""
        trials = {name: sum(one.trials) for name, one in found.counts.items()}
        return difference_estimates(found.contrasts, trials, plan) if plan.adaptive else ()

    def show(self, found: Thresholds, plan: RatePlan) -> Presentation:
        """Return thresholds, what differs, and each participant's own."""
        each, shown = found.thresholds, found.levels
        effects = _deviations(found)

        def placed(one: Threshold) -> PlacedThreshold:
            ends = (one.lower, one.upper)
            return PlacedThreshold(one.identified(shown), one.value, ends, one.width)

        over_scenes = " and scenes" if found.scene_sd else ""
        table = ResultTable.of(
            f"Thresholds in the population: one model, random over participants{over_scenes}",
            each,
            condition(plan),
            *threshold_columns(placed, plan.limits, logarithmic=found.logarithmic),
        )
        differing = "natural logarithms of thresholds" if found.logarithmic else "thresholds"
        lapses = (
            "Threshold: where half of the way from guessing to lapsing is done. Width: from 5 to"
            f" 95 % of that way. Shape: {SHAPES[plan.shape]}."
            f" Limits speak of {like_these(scenes=bool(found.scene_sd))}. Mean lapse rate of"
            f" participants {share(found.lapse)}{_spread(found, '; {}')}."
        )
        people = _people(found, plan)
        told = plan.by_threshold
        title = f"Differences of {differing}"
        differences = difference_tables(title, found.contrasts, plan, told=told)
        files = difference_table(found.contrasts, plan, told=told).every_field(kind=Difference)
        said = tuple(apa_difference(one, plan) for one in found.contrasts)
        of_all = "right answers of all levels together"
        if plan.by_scaling:
            of_all = "critical scalings, whose law is that of pools"
        beside = Folded(
            title,
            f"The study compares {of_all}. Thresholds compare the same answers by the level that is"
            " needed; they are the result where levels are the question.",
            (*differences, CopyText(said)),
        )
        known = apa_thresholds(found, levels=shown)
        return Presentation(
            title=self.title(plan),
            blocks=(
                FigurePlace("psychometric"),
                table.block(),
                Paragraph(lapses, muted=True),
                *(differences if told else ()),
                *((*people, FigurePlace("people")) if people else ()),
                Cautions("When not to trust these thresholds", found.warnings),
            ),
            others=(beside,) * (not told and bool(differences)),
            headline=" ".join((*said[:1], known)) * told,
            sentences=(known, *said * told),
            methods=(
                "Thresholds in the population come from one mixed model of all trials, random over"
                f" {', '.join(effects)}, with a lapse rate of each participant, drawn towards small"
                " ones (adaptive quadrature over participants"
                f"{', then Laplace approximation' * ('scenes' in effects)}). Limits and tests are"
                f" {law_of_mixed(scenes='scenes' in effects)}."
            ),
            tables={
                "levels.csv": _counted(found.counts),
                "thresholds.csv": threshold_lines(each),
                "threshold_differences.csv": files,
            },
            figures=tuple(_figures(found, plan)),
        )


def _people(found: Thresholds, plan: RatePlan) -> tuple[Block, ...]:
    """Return the table of participants' own thresholds; nothing where there are none."""
    each = found.thresholds
    own = sorted({who for one in each for who in one.individual})
    if not own:
        return ()

    def column(one: Threshold) -> ResultColumn[str]:
        known = one.individual if one.identified(found.levels) else {}
        ends = (one.lower, one.upper)
        return ResultColumn(
            plan.label(one.condition), "", lambda who: size(known.get(who), within=ends)
        )

    participant = ResultColumn[str]("Participant", "l", str)
    return (
        ResultTable("Participants' thresholds", own, (participant, *map(column, each))).block(),
        Paragraph(
            "Each is drawn towards the mean as far as the participant's answers leave open.",
            muted=True,
        ),
    )


def _figures(found: Thresholds, plan: RatePlan) -> Iterator[PartFigure]:
    population = found.population
    placed = [one for one in found.thresholds if one.identified(found.levels)]
    curves = {
        one.condition: DrawnCurve(
            partial(population.average, one.condition),
            partial(population.average_limits, one.condition) if len(placed) <= BANDS else None,
            (one.value, one.lower, one.upper),
        )
        for one in placed
    }
    fits = "the mean curve of people like these in one model"
    yield curves_figure("psychometric", fits, found.counts, curves, plan)
    of_people = {
        (who, one.condition): DrawnCurve(
            partial(population.typical, one.condition, who=who), threshold=(value, None, None)
        )
        for one in placed
        for who, value in one.individual.items()
    }
    if any(one.individual for one in found.thresholds):
        yield people_figure("people", "their curves in one model", found.people, of_people, plan)


def threshold_lines(thresholds: Sequence[Threshold]) -> pd.DataFrame:
    """Return thresholds of conditions with limits, and those of participants, one a row."""
    return pd.DataFrame(
        {"condition": one.condition, "participant": who, "threshold": value}
        | ({} if who else {"lower": one.lower, "upper": one.upper, "width": one.width})
        for one in thresholds
        for who, value in (("", one.value), *one.individual.items())
    )


def apa_thresholds(model: ThresholdModel, *, unit: str = "", levels: Sequence[float] = ()) -> str:
    """Return the thresholds of all conditions as a sentence; `levels` are those shown."""
    after = f" {unit}" if unit else ""
    parts = [
        f"{one.condition} {size(one.value, within=(one.lower, one.upper))}{after},"
        f" {level_text(model.level)} {size_range((one.lower, one.upper))}"
        if one.identified(levels)
        else f"{one.condition} {NOT_IDENTIFIED}"
        for one in model.thresholds
    ]
    return (
        f"Thresholds ({model.shape} functions of {model.participants} participants fitted"
        f" together; guess rate {share(model.guess)}, mean lapse rate"
        f" {leading(f'{model.lapse:.3f}')}):"
        f" {'; '.join(parts)}{_spread(model, ' ({})')}."
    )


def _deviations(model: ThresholdModel) -> dict[str, float]:
    found = {
        "participants": model.participant_sd,
        "participants x conditions": model.interaction_sd,
    }
    if model.scene_sd:
        found |= {"scenes": model.scene_sd, "scenes x conditions": model.scene_interaction_sd}
    several = len(model.thresholds) > 1
    return {name: sd for name, sd in found.items() if several or " x " not in name}


def _spread(model: ThresholdModel, form: str) -> str:
    """Return deviations within `form`; nothing where they are not identified."""
    if math.isnan(model.participant_sd):
        return ""
    ends = [(one.lower, one.upper) for one in model.thresholds]
    known = [(low, high) for low, high in ends if low is not None and high is not None]
    if model.logarithmic:
        known = [(math.log(low), math.log(high)) for low, high in known if low > 0.0]
    within = min(known, key=lambda one: one[1] - one[0], default=None)
    text = ", ".join(
        f"{name} SD = {number(sd, within=within)}" for name, sd in _deviations(model).items()
    )
    return form.format(text + " of ln threshold" * model.logarithmic)
