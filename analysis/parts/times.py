"""Reaction times: summaries, and a log-normal mixed model."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np
import pandas as pd

from analysis.answers import SimulatedAnswers
from analysis.models.mixed.reaction_model import NO_SPREAD, TimeModel, TimeRatio, time_model
from analysis.models.reaction import ReactionTimes, participant_medians, reaction_times
from analysis.parts import AnalysisPlan, PartFigure, Presentation, SimplePart, Tests, tried
from analysis.parts.margins import (
    contrast_sentences,
    contrasts_table,
    exponent,
    margin_tables,
)
from analysis.parts.shared import (
    apa_test,
    compared,
    deciding_column,
    in_order,
    law_of_mixed,
    mean_differences_p,
    over,
    pairs_in,
    ratio_told,
    sd_text,
    tests_of,
)
from analysis.plots import reaction_plot
from analysis.repeat import lme4_effects, scripts
from analysis.report.result_table import (
    T_DF,
    ResultColumn,
    ResultTable,
    attribute,
    estimated,
    limits,
)
from analysis.report.values import frame_of
from analysis.report.wording import (
    NOT_IDENTIFIED,
    level_text,
    number,
    number_range,
    placed,
)
from analysis.showable import FamilyOfTests
from protocols.blocks import Block, Cautions, FigurePlace, Paragraph


@dataclass(frozen=True)
class Times:
    """Every number; a model that was not asked for, or cannot be fitted, is None.

    `medians` are the participants', by condition, s.
    """

    summary: tuple[ReactionTimes, ...]
    medians: Mapping[str, tuple[float, ...]]
    model: TimeModel | None
    notes: tuple[str, ...]


class TimesPart(SimplePart[AnalysisPlan, Times]):
    """Reaction times of any task."""

    name: ClassVar[str] = "times"
    section: ClassVar[tuple[str, str]] = ("checks", "Learning, speed")
    secondary: ClassVar[bool] = True

    def wanted(self, table: pd.DataFrame, _plan: AnalysisPlan) -> bool:
        """Return True if there are times above 0."""
        return "rt_s" in table and bool((table["rt_s"] > 0).any())

    def of(self, table: pd.DataFrame, plan: AnalysisPlan) -> Times:
        """Summarise the times above 0, and model them where the plan asks for it."""
        rows = table[table["rt_s"] > 0].reset_index(drop=True)
        level = plan.confidence
        notes: list[str] = []
        summary = reaction_times(rows, plan.compared, level=level)
        names = plan.in_order([one.condition for one in summary])
        reference = plan.reference_in(names)
        model = None
        if plan.reaction == "models":
            model = tried(
                lambda: time_model(
                    rows,
                    plan.compared,
                    reference=reference,
                    asked=plan.contrasts,
                    inference=plan.inference,
                ),
                "model of reaction times",
                notes,
            )
            count = len(model.ratios) if model else 0
            notes += _family(count, plan).hopeless(rows["participant"].nunique(), plan.alpha)
        return Times(
            summary=tuple(sorted(summary, key=lambda one: names.index(one.condition))),
            medians=participant_medians(rows, plan.compared),
            model=model
            and replace(model, times=in_order(model.times, plan, lambda one: one.condition)),
            notes=tuple(notes),
        )

    def planned_over(
        self, answers: SimulatedAnswers, people: Sequence[int], plan: AnalysisPlan
    ) -> Tests:
        """Test differences of mean logarithms, near those of the model, where times are drawn."""
        if answers.times is None:
            return {}
        times = replace(answers, given=answers.times)
        return {self.name: partial(mean_differences_p, times, people, plan)}

    def families(self, cells: pd.DataFrame, plan: AnalysisPlan) -> Sequence[FamilyOfTests]:
        """Return the comparisons, where the study tests times."""
        if plan.reaction != "models" or "condition" not in cells:
            return ()
        return (_family(len(pairs_in(cells, plan)), plan),)

    def show(self, found: Times, plan: AnalysisPlan) -> Presentation:
        """Return the figure, a table of each model, what they say, and every number as CSV."""
        draw = partial(
            reaction_plot, found.summary, found.medians, label=plan.label, level=plan.confidence
        )
        caption = f"Participants' median reaction times, and their mean with {plan.limits}."
        return Presentation(
            blocks=(*_summary(found, plan), *_model(found.model, plan)),
            sentences=tuple(_sentences(found, plan)),
            methods=" ".join(_methods(found)),
            tables=_tables(found, plan),
            scripts=_scripts(found.model, plan) if found.model is not None else {},
            figures=(PartFigure("reaction", caption, draw),),
        )


def _family(count: int, plan: AnalysisPlan) -> FamilyOfTests:
    """Return so many comparisons, whose p a parametric bootstrap alone holds."""
    return FamilyOfTests("ratio", " of times", count, people=False, draws=plan.bootstrap_draws)


def _summary(found: Times, plan: AnalysisPlan) -> Iterator[Block]:
    times, label = found.summary, plan.label
    yield FigurePlace("reaction")
    yield ResultTable.of(
        "Reaction times, s",
        times,
        attribute(plan.compared_title, "condition", label, "l"),
        attribute("Answers", "answers", str),
        attribute("Median", "median"),
        ResultColumn(
            "Quartiles", "n", lambda t: f"{number(t.quartile_low)} to {number(t.quartile_high)}"
        ),
        attribute("Trimmed mean", "trimmed_mean"),
        attribute("Mean of medians", "mean_of_medians"),
        limits(),
    ).block()
    yield Cautions.each("About these times", times, lambda t: label(t.condition))


def _model(model: TimeModel | None, plan: AnalysisPlan) -> Iterator[Block]:
    if model is None:
        return
    sd = _deviations(model) | {"the rest": model.residual_sd}
    yield ResultTable.of(
        "Typical reaction times by a log-normal mixed model",
        model.times,
        attribute("Condition", "condition", plan.label, "l"),
        attribute("Answers", "answers", str),
        estimated("Typical, s", "median_s"),
        limits(plan.limits),
    ).block()
    if model.ratios:
        yield _ratios(model, plan).block()
    yield from contrasts_table(model.margins, plan, "ratio of times", exponent)
    yield Paragraph(
        f"Typical: the median answer of the median person. SD of ln s: {sd_text(sd)}."
        f" {ratio_told(model.ratios, plan)}",
        muted=True,
    )
    yield Cautions("When not to trust this model of times", model.warnings)


def _ratios(model: TimeModel, plan: AnalysisPlan) -> ResultTable[TimeRatio]:
    return ResultTable.of(
        f"Ratios of answer times{over(model.ratios, plan)}",
        model.ratios,
        compared(plan, "/"),
        estimated("Ratio", "ratio"),
        limits(plan.limits),
        T_DF,
        deciding_column(plan),
    )


def _deviations(model: TimeModel) -> dict[str, float]:
    """Return standard deviations of all effects of the model but the residual, by name."""
    return {
        " x ".join(f"{word}s" for word in name.split(" x ")): sd for name, sd in model.sd.items()
    }


def _sentences(found: Times, plan: AnalysisPlan) -> Iterator[str]:
    label = plan.label
    for one in found.summary:
        about = f" to {label(one.condition)}" if len(found.summary) > 1 else ""
        text = f"Answers{about} took {number(one.median)} s (median)"
        if not math.isnan(one.lower):
            text += (
                f"; the participants' medians were {placed(one, one.mean_of_medians)} s on average,"
                f" {level_text(plan.confidence)} {number_range(one.lower, one.upper)}"
            )
        yield f"{text}."
    ratios = found.model.ratios if found.model else ()
    for ratio in ratios:
        first, second = label(ratio.first), label(ratio.second)
        if math.isnan(ratio.ratio):
            yield f"How long answers to {first} took against {second} is {NOT_IDENTIFIED}."
            continue
        yield (
            f"Answers to {first} took {placed(ratio, ratio.ratio)} times as long as those to"
            f" {second}, {level_text(ratio.level)} {number_range(ratio.lower, ratio.upper)},"
            f" {apa_test(ratio, ratios, plan, 'log-normal mixed model')}."
        )
    if found.model:
        unit = "times as long"
        yield from contrast_sentences(found.model.margins, plan, unit, exponent)


def _methods(found: Times) -> Iterator[str]:
    yield (
        "Reaction times are summarised by medians and quartiles of all answers, and by the mean of"
        " the participants' medians, taken on the logarithm, with t limits."
    )
    if found.model is not None:
        yield (
            "Their logarithms were also fitted by a linear mixed model (REML), random over"
            f" {', '.join(_deviations(found.model))} (log(rt_s) ~ condition +"
            f" {' + '.join(lme4_effects(found.model.sd))}); ratios are judged, and have limits, by"
            f" {tests_of(found.model.ratios)} are {law_of_mixed(scenes=found.model.scenes > 1)}"
            f"{', Holm-adjusted' * (len(found.model.ratios) > 1)}."
        )


def _scripts(model: TimeModel, plan: AnalysisPlan) -> dict[str, str]:
    """Return scripts that repeat the model; in Python an effect whose variance is 0 is none."""
    groups = {name: name.split(" x ") for name in model.sd}
    some = [groups[name] for name, sd in model.sd.items() if sd > NO_SPREAD]
    return scripts(
        "times",
        *("R", "py"),
        by=list(plan.compared_columns),
        effects=[f"(1 | {':'.join(group)})" for group in groups.values()],
        groups=some or [["participant"]],
        draws=plan.bootstrap_draws,
    )


def _tables(found: Times, plan: AnalysisPlan) -> dict[str, pd.DataFrame]:
    tables = {"reaction.csv": frame_of(found.summary)}
    if found.model is not None:
        tables["times.csv"] = frame_of(found.model.times)
        tables["ratios.csv"] = _ratios(found.model, plan).every_field(kind=TimeRatio)
        tables |= margin_tables(found.model.margins, "times")
    return {name: table.replace([np.inf, -np.inf], np.nan) for name, table in tables.items()}
