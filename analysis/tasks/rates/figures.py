"""The figures of a report of right and wrong answers."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from analysis.detection import YesNoResults
from analysis.plots import (
    d_prime_plot,
    detection_plot,
    heat_map,
    learning_plot,
    psychometric_plot,
    rates_plot,
    reaction_plot,
    scaling_plot,
)
from analysis.tasks.blocks import ReportFigure
from analysis.tasks.rates.settings import RateSettings, prepared
from analysis.tasks.rates.study import RateResults
from analysis.tasks.rates.wording import column_in_words

WIDELY_SPACED = 8.0
"""Levels whose largest is so many times the smallest are drawn on a logarithmic axis."""


def rate_figures(
    decisions: pd.DataFrame, results: RateResults, settings: RateSettings, *, simulated: bool
) -> tuple[ReportFigure, ...]:
    """Return every figure these results allow, in reading order."""
    label, limits = settings.label, f"{100 * settings.confidence:g} %"
    sensitivity = results.sensitivity
    respected = "participants and scenes" if results.by_scene else "participants"
    made = []
    if isinstance(sensitivity, YesNoResults):
        made.append(
            ReportFigure(
                "correct",
                f"Shares of right answers, and of one answer, with {limits} limits that respect"
                f" {respected}; p against one half; dashed: one half.",
                lambda width: detection_plot(
                    sensitivity, label=label, width_in=width, simulated=simulated
                ),
            )
        )
    else:
        made.append(
            ReportFigure(
                "correct",
                f"Shares of right answers with {limits} limits that respect {respected};"
                " p against chance, which is dashed.",
                lambda width: rates_plot(
                    results.rates, label=label, width_in=width, simulated=simulated
                ),
            )
        )
    known = isinstance(sensitivity, YesNoResults) and all(
        one.d_prime is None for one in sensitivity.conditions
    )
    if not known:
        made.append(
            ReportFigure(
                "sensitivity",
                f"Sensitivity d' by condition with {limits} limits"
                + (
                    ", and the criterion: negative where the signal's answer is given too readily."
                    if isinstance(sensitivity, YesNoResults)
                    else "."
                ),
                lambda width: d_prime_plot(
                    sensitivity, label=label, width_in=width, simulated=simulated
                ),
            )
        )
    made += _levels(results, settings, simulated=simulated)
    made += _people(results, settings, simulated=simulated)
    rows = prepared(decisions, settings)
    if "order" in rows and rows["order"].notna().any() and not settings.adaptive:
        rows["right"] = rows["correct"].astype(float)
        made.append(
            ReportFigure(
                "learning",
                "Right answers along the session; thin lines: participants; band: 95 % t limits.",
                lambda width: learning_plot(
                    rows,
                    "right",
                    y_label="Share of right answers",
                    bounds=(0.0, 1.0),
                    width_in=width,
                    simulated=simulated,
                ),
            )
        )
    if results.reaction:
        timed = rows[rows["rt_s"] > 0]
        medians = {
            one.condition: [
                float(value)
                for value in timed[timed["condition"] == one.condition]
                .groupby("participant")["rt_s"]
                .median()
            ]
            for one in results.reaction
        }
        made.append(
            ReportFigure(
                "reaction",
                f"Participants' median reaction times, and their mean with {limits} limits.",
                lambda width: reaction_plot(
                    results.reaction, medians, label=label, width_in=width, simulated=simulated
                ),
            )
        )
    return tuple(made)


def _levels(results: RateResults, settings: RateSettings, *, simulated: bool) -> list[ReportFigure]:
    made: list[ReportFigure] = []
    counts = {
        name: (
            np.array(one.levels, dtype=np.float64),
            np.array(one.right, dtype=np.float64),
            np.array(one.trials, dtype=np.float64),
        )
        for name, one in results.counts.items()
    }
    if not counts:
        return made
    series = {name: (*counts[name], results.curves.get(name)) for name in counts}
    levels = np.concatenate([x for x, *_ in counts.values()])
    wide = bool(levels.min() > 0 and levels.max() / levels.min() > WIDELY_SPACED)
    made.append(
        ReportFigure(
            "levels",
            f"Right answers by {settings.level}: data of all participants together with binomial"
            " standard errors (thin), fitted psychometric functions (thick); dashed: chance.",
            lambda width: psychometric_plot(
                series,
                x_label=_axis(settings.level),
                chance=settings.chance,
                logarithmic=wide,
                label=settings.label,
                width_in=width,
                simulated=simulated,
            ),
        )
    )
    if results.critical:
        made.append(
            ReportFigure(
                "scaling",
                f"d' by {settings.level}: data with standard errors (thin), the population's fit"
                " (thick); below, critical scalings of the typical participant with"
                f" {100 * settings.confidence:g} % limits, where these data identify them.",
                lambda width: scaling_plot(
                    results.critical,
                    {fit.condition: counts[fit.condition] for fit in results.critical},
                    label=settings.label,
                    x_label=f"{_axis(settings.level)} (log axis)",
                    width_in=width,
                    simulated=simulated,
                ),
            )
        )
    return made


def _people(results: RateResults, settings: RateSettings, *, simulated: bool) -> list[ReportFigure]:
    made = []
    for name, title, shares in (
        ("participants", "Participant", results.participant_shares),
        ("scenes", "Scene", results.scene_shares),
    ):
        if shares:
            made.append(_heat(name, title, shares, settings, simulated=simulated))
    if len(results.answers) > 2:
        table = np.array(results.confusion, dtype=np.float64)
        names = [settings.label(answer) for answer in results.answers]
        made.append(
            ReportFigure(
                "confusion",
                "How often each answer (columns) was given where each was right (rows).",
                lambda width: heat_map(
                    table,
                    names,
                    names,
                    row_title="Right answer",
                    width_in=width,
                    simulated=simulated,
                ),
            )
        )
    return made


def _heat(
    name: str,
    title: str,
    shares: Mapping[str, tuple[tuple[str, float], ...]],
    settings: RateSettings,
    *,
    simulated: bool,
) -> ReportFigure:
    rows = sorted({row for pairs in shares.values() for row, _ in pairs})
    table = np.full((len(rows), len(shares)), np.nan)
    for column, pairs in enumerate(shares.values()):
        for row, value in pairs:
            table[rows.index(row), column] = value
    columns = [settings.label(condition) for condition in shares]
    return ReportFigure(
        name,
        f"Share of right answers, by {title.lower()}.",
        lambda width: heat_map(
            table,
            [settings.label(row) for row in rows],
            columns,
            row_title=title,
            width_in=width,
            simulated=simulated,
        ),
    )


def _axis(column: str | None) -> str:
    name = column_in_words(str(column))
    return name[:1].upper() + name[1:]
