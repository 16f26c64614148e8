"""Reaction times: summaries, a log-normal mixed model, and EZ diffusion."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
import pandas as pd

from analysis.columns import frame_of
from analysis.diffusion import MEASURES, DiffusionResults, diffusion_by_condition
from analysis.parts import PartFigure, Plan, Shown, SimplePart, tried
from analysis.plots import reaction_plot
from analysis.rates import Difference
from analysis.reaction import ReactionTimes, participant_medians, reaction_times
from analysis.reaction_model import NO_SPREAD, TimeModel, TimeRatio, time_model
from analysis.repeat import scripts
from analysis.report.blocks import Block, Cautions, Paragraph, Picture, Table
from analysis.report.wording import (
    NOT_IDENTIFIED,
    grouped,
    number,
    number_range,
    p_number,
    p_text,
)

COLUMNS = {"drift": "Drift, 1/s", "boundary": "Boundary", "nondecision_s": "Other time, s"}


@dataclass(frozen=True)
class Times:
    """Every number; a model that was not asked for, or cannot be fitted, is None.

    `medians` are the participants', by condition, s.
    """

    summary: tuple[ReactionTimes, ...]
    medians: Mapping[str, tuple[float, ...]]
    model: TimeModel | None
    diffusion: DiffusionResults | None
    notes: tuple[str, ...]


class TimesPart(SimplePart[Plan, Times]):
    """Reaction times of any task; EZ diffusion where one of two answers is right."""

    name: ClassVar[str] = "times"
    section: ClassVar[tuple[str, str]] = ("checks", "Learning, speed")

    def wanted(self, table: pd.DataFrame, _plan: Plan) -> bool:
        """Return whether there are times above 0."""
        return "rt_s" in table and bool((table["rt_s"] > 0).any())

    def of(self, table: pd.DataFrame, plan: Plan) -> Times:
        """Summarise the times above 0, and model them where the plan asks for it."""
        rows = table[table["rt_s"] > 0].reset_index(drop=True)
        level = plan.confidence
        notes: list[str] = []
        summary = reaction_times(rows, plan.compared, level=level)
        names = plan.in_order([one.condition for one in summary])
        reference = plan.reference_in(names)
        model, diffusion = None, None
        if plan.reaction == "models":
            model = tried(
                lambda: time_model(rows, plan.compared, reference=reference, level=level),
                "model of reaction times",
                notes,
            )
            if "correct" in rows and plan.alternatives == 2:
                diffusion = tried(
                    lambda: diffusion_by_condition(
                        rows, plan.compared, reference=reference, level=level
                    ),
                    "diffusion model",
                    notes,
                )
        return Times(
            summary=tuple(sorted(summary, key=lambda one: names.index(one.condition))),
            medians=participant_medians(rows, plan.compared),
            model=model,
            diffusion=diffusion,
            notes=tuple(notes),
        )

    def show(self, found: Times, plan: Plan) -> Shown:
        """Return the figure, a table of each model, what they say, and every number as CSV."""
        draw = partial(
            reaction_plot, found.summary, found.medians, label=plan.label, level=plan.confidence
        )
        caption = (
            "Participants' median reaction times, and their mean with"
            f" {100 * plan.confidence:g} % limits."
        )
        return Shown(
            blocks=(
                *_summary(found, plan),
                *_model(found.model, plan),
                *_ez(found.diffusion, plan),
            ),
            sentences=tuple(_sentences(found, plan)),
            methods=" ".join(_methods(found)),
            tables=_tables(found),
            scripts=_scripts(found.model, plan) if found.model is not None else {},
            figures=(PartFigure("reaction", caption, draw),),
        )


def _summary(found: Times, plan: Plan) -> Iterator[Block]:
    times, label = found.summary, plan.label
    yield Picture("reaction")
    yield Table.each(
        "Reaction times, s",
        times,
        (plan.compared_title, "l", lambda t: label(t.condition)),
        ("Answers", "", lambda t: str(t.answers)),
        ("Median", "", lambda t: number(t.median)),
        ("Quartiles", "n", lambda t: f"{number(t.quartile_low)} to {number(t.quartile_high)}"),
        ("Trimmed mean", "", lambda t: number(t.trimmed_mean)),
        ("Mean of medians", "", lambda t: number(t.mean_of_medians)),
        ("Limits", "n", lambda t: number_range(t.lower, t.upper)),
    )
    yield Cautions("About these times", grouped([(label(t.condition), t.warnings) for t in times]))


def _model(model: TimeModel | None, plan: Plan) -> Iterator[Block]:
    if model is None:
        return
    level, label = f"{100 * model.level:g} % limits", plan.label
    deviations = {
        "participants": model.participant_sd,
        "participants x conditions": model.interaction_sd,
        "scenes": model.scene_sd,
        "scenes x conditions": model.scene_interaction_sd,
        "the rest": model.residual_sd,
    }
    spread = ", ".join(f"{name} {number(sd)}" for name, sd in deviations.items())
    yield Table.each(
        "Typical reaction times by a log-normal mixed model",
        model.times,
        ("Condition", "l", lambda one: label(one.condition)),
        ("Answers", "", lambda one: str(one.answers)),
        ("Typical, s", "strong", lambda one: number(one.median_s)),
        (level, "n", lambda one: number_range(one.lower, one.upper)),
    )
    if model.ratios:
        yield Table.each(
            "How many times as long answers take",
            model.ratios,
            ("Conditions", "l c", lambda one: f"{label(one.first)} / {label(one.second)}"),
            ("Ratio", "strong", lambda one: number(one.ratio)),
            (level, "n", lambda one: number_range(one.lower, one.upper)),
            ("df", "", lambda one: f"{round(one.df, 1):g}"),
            ("p", "n", lambda one: p_number(one.p)),
            ("p adj.", "n", lambda one: p_number(one.p_adjusted)),
        )
    yield Paragraph(
        f"Typical: the median answer of the median person. SD of ln s: {spread}. p adj.: Holm.",
        muted=True,
    )
    yield Cautions("When not to trust this model of times", model.warnings)


def _ez(found: DiffusionResults | None, plan: Plan) -> Iterator[Block]:
    if found is None:
        return
    label = plan.label
    yield Table.of(
        "EZ diffusion: means over participants",
        (
            ("Condition", "l"),
            ("People", ""),
            *((part, "n") for name in MEASURES for part in (COLUMNS[name], "limits")),
        ),
        [
            [label(one.condition), str(one.participants)]
            + [
                cell
                for name in MEASURES
                for cell in (
                    number(one.means[name]),
                    number_range(one.lower[name], one.upper[name]),
                )
            ]
            for one in found.conditions
        ],
    )
    if found.contrasts:
        yield Table.each(
            "Differences, paired over participants",
            found.contrasts,
            ("Conditions", "l c", lambda one: f"{label(one.first)} - {label(one.second)}"),
            ("Of", "l", lambda one: one.measure),
            ("Difference", "strong", lambda one: number(one.difference)),
            ("Limits", "n", lambda one: number_range(one.lower, one.upper)),
            ("df", "", lambda one: f"{round(one.df, 1):g}"),
            ("p", "n", lambda one: p_number(one.p)),
            ("p adj.", "n", lambda one: p_number(one.p_adjusted)),
        )
    yield Paragraph(
        "Drift: how fast evidence comes; boundary: how much of it is asked for; other time: for"
        " seeing and pressing (Wagenmakers et al. 2007). It takes right and wrong answers as"
        " equally fast.",
        muted=True,
    )
    yield Cautions("When not to trust EZ diffusion", found.warnings)


def _sentences(found: Times, plan: Plan) -> Iterator[str]:
    label = plan.label
    for one in found.summary:
        about = f" to {label(one.condition)}" if len(found.summary) > 1 else ""
        text = f"Answers{about} took {number(one.median)} s (median)"
        if not math.isnan(one.lower):
            text += (
                f"; the participants' medians were {number(one.mean_of_medians)} s on average,"
                f" {100 * plan.confidence:g}% CI {number_range(one.lower, one.upper)}"
            )
        yield f"{text}."
    for ratio in found.model.ratios if found.model else ():
        first, second = label(ratio.first), label(ratio.second)
        if math.isnan(ratio.ratio):
            yield f"How long answers to {first} took against {second} is {NOT_IDENTIFIED}."
            continue
        yield (
            f"Answers to {first} took {ratio.ratio:.2f} times as long as those to {second},"
            f" {100 * ratio.level:g}% CI [{ratio.lower:.2f}, {ratio.upper:.2f}],"
            f" t({round(ratio.df, 1):g}), {p_text(ratio.p)} ({p_number(ratio.p_adjusted)}"
            " Holm-adjusted; log-normal mixed model)."
        )
    for gap in found.diffusion.contrasts if found.diffusion else ():
        yield (
            f"EZ diffusion, {label(gap.first)} minus {label(gap.second)}: {gap.difference:.3g} in"
            f" {gap.measure}, {100 * gap.level:g}% CI [{gap.lower:.3g}, {gap.upper:.3g}],"
            f" t({round(gap.df, 1):g}) = {gap.difference / gap.standard_error:.2f}, {p_text(gap.p)}"
            f" ({p_number(gap.p_adjusted)} Holm-adjusted)."
        )


def _methods(found: Times) -> Iterator[str]:
    yield (
        "Reaction times are summarised by medians and quartiles of all answers, and by the mean of"
        " the participants' medians, taken on the logarithm, with t limits."
    )
    if found.model is not None:
        effects = ["participants", *(["scenes"] if found.model.scene_sd else [])]
        if len(found.model.times) > 1:
            effects += [f"{effect} x conditions" for effect in effects]
        law = (
            "degrees of freedom between those of participants and of scenes"
            if found.model.scene_sd
            else "participants - 1 degrees of freedom"
        )
        yield (
            "Their logarithms were also fitted by a linear mixed model (REML), random over"
            f" {', '.join(effects)}; tests are t with {law}, Holm-adjusted."
        )
    if found.diffusion is not None:
        yield (
            "EZ diffusion (Wagenmakers, van der Maas & Grasman, 2007) was fitted to each"
            " participant in each condition; conditions were compared by paired t tests over"
            " participants, Holm-adjusted within each measure."
        )


def _scripts(model: TimeModel, plan: Plan) -> dict[str, str]:
    """Return what repeats the model; an effect whose variance is 0 is none."""
    deviations = {
        ("participant",): model.participant_sd,
        ("participant", "condition"): model.interaction_sd,
        ("scene",): model.scene_sd,
        ("scene", "condition"): model.scene_interaction_sd,
    }
    groups = [list(group) for group, sd in deviations.items() if sd > NO_SPREAD]
    if not groups:
        return {}
    return scripts(
        "times",
        *("R", "py"),
        by=list(plan.compared_columns),
        effects=[f"(1 | {':'.join(group)})" for group in groups],
        groups=groups,
    )


def _tables(found: Times) -> dict[str, pd.DataFrame]:
    lines = [vars(one) | {"warnings": "; ".join(one.warnings)} for one in found.summary]
    tables = {"reaction.csv": pd.DataFrame(lines)}
    if found.model is not None:
        tables["times.csv"] = pd.DataFrame([vars(one) for one in found.model.times])
        tables["ratios.csv"] = frame_of(TimeRatio, found.model.ratios)
    if found.diffusion is not None:
        tables["diffusion.csv"] = pd.DataFrame(
            [
                {"participant": one.participant, "condition": one.condition, "trials": one.trials}
                | {name: getattr(one.fit, name) for name in (*MEASURES, "share")}
                | {"corrected": int(one.fit.corrected)}
                for one in found.diffusion.people
            ]
        )
        tables["diffusion_comparisons.csv"] = frame_of(Difference, found.diffusion.contrasts)
    return {name: table.replace([np.inf, -np.inf], np.nan) for name, table in tables.items()}
