"""The figures of a report of right and wrong answers."""

import numpy as np

from analysis.detection import YesNoResults
from analysis.plans.rates import RateSettings
from analysis.plots import (
    d_prime_plot,
    detection_plot,
    heat_map,
    psychometric_plot,
    rates_plot,
    scaling_plot,
    sized,
)
from analysis.report.blocks import ReportFigure
from analysis.tasks.common_figures import shares_figure
from analysis.tasks.rates.study import RateResults
from analysis.tasks.rates.wording import column_in_words

WIDELY_SPACED = 8.0
"""Levels whose largest is so many times the smallest are drawn on a logarithmic axis."""


def rate_figures(
    results: RateResults, settings: RateSettings, *, simulated: bool
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
                sized(detection_plot, sensitivity, label=label, simulated=simulated),
            )
        )
    else:
        made.append(
            ReportFigure(
                "correct",
                f"Shares of right answers with {limits} limits that respect {respected};"
                " p against chance, which is dashed.",
                sized(rates_plot, results.rates, label=label, simulated=simulated),
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
                sized(d_prime_plot, sensitivity, label=label, simulated=simulated),
            )
        )
    made += _levels(results, settings, simulated=simulated)
    made += _people(results, settings, simulated=simulated)
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
            sized(
                psychometric_plot,
                series,
                x_label=_axis(settings.level),
                chance=settings.chance,
                logarithmic=wide,
                label=settings.label,
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
                sized(
                    scaling_plot,
                    results.critical,
                    {fit.condition: counts[fit.condition] for fit in results.critical},
                    label=settings.label,
                    x_label=f"{_axis(settings.level)} (log axis)",
                    simulated=simulated,
                ),
            )
        )
    return made


def _people(results: RateResults, settings: RateSettings, *, simulated: bool) -> list[ReportFigure]:
    made = []
    label = settings.label
    for name, shares in (
        ("participants", results.participant_shares),
        ("scenes", results.scene_shares),
    ):
        if shares:
            caption = f"Share of right answers, by {name.removesuffix('s')}."
            columns, found = [label(condition) for condition in shares], list(shares.values())
            made.append(
                shares_figure(name, caption, columns, found, label=label, simulated=simulated)
            )
    if len(results.answers) > 2:
        table = np.array(results.confusion, dtype=np.float64)
        names = [label(answer) for answer in results.answers]
        made.append(
            ReportFigure(
                "confusion",
                "How often each answer (columns) was given where each was right (rows).",
                sized(heat_map, table, names, names, row_title="Right answer", simulated=simulated),
            )
        )
    return made


def _axis(column: str | None) -> str:
    name = column_in_words(str(column))
    return name[:1].upper() + name[1:]
