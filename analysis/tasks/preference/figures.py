"""The figures of a report of preferences."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from analysis.pairings import pairing_rows
from analysis.plots import (
    bias_bars,
    forest_plot,
    heat_map,
    jod_plot,
    learning_plot,
    preference_bars,
    reaction_plot,
)
from analysis.tasks.blocks import ReportFigure
from analysis.tasks.preference.settings import Settings
from analysis.tasks.preference.study import StudyResults


def report_figures(
    decisions: pd.DataFrame, results: StudyResults, settings: Settings, *, simulated: bool
) -> tuple[ReportFigure, ...]:
    """Return every figure these results allow, in reading order."""
    cells, label = results.table.cells, settings.label
    level = f"{100 * cells[0].estimate.level:g} %"
    dots = {key: [value for _, value in pairs] for key, pairs in results.participant_shares.items()}
    made = [
        ReportFigure(
            "preference",
            "Share of trials in which the method on the left was chosen; dark: the one chosen more"
            f" often. Whiskers: {level} limits that respect participants and scenes; dots:"
            " participants; dashed: chance.",
            lambda width: preference_bars(
                cells, dots, label=label, width_in=width, simulated=simulated
            ),
        ),
        ReportFigure(
            "forest",
            f"Odds of choosing the first method of each pair, with {level} limits (each comparison"
            " alone). Blue: the first is preferred after correction; orange: the second; grey:"
            " neither is. Grey band: smaller than the smallest effect of interest.",
            lambda width: forest_plot(cells, label=label, width_in=width, simulated=simulated),
        ),
    ]
    scales = {one.size: (one.scale, one.intervals) for one in results.scales}
    if scales:
        made.append(
            ReportFigure(
                "scale",
                f"Quality in JOD (mean zero; of two 1 JOD apart, 75 % choose the better) with"
                f" {level} bootstrap limits.",
                lambda width: jod_plot(scales, label=label, width_in=width, simulated=simulated),
            )
        )
    for name, title, shares in (
        ("participants", "Participant", results.participant_shares),
        ("scenes", "Scene", results.scene_shares),
    ):
        made.append(_heat(name, title, shares, settings, simulated=simulated))
    biases = [bias for bias in (results.order, results.side) if bias is not None]
    made.append(
        ReportFigure(
            "bias",
            f"How often the first interval and the left key were picked, with {level} limits;"
            " dots: participants.",
            lambda width: bias_bars(biases, width_in=width, simulated=simulated),
        )
    )
    if settings.primary is not None and decisions["order"].notna().any():
        method, against, size = settings.primary
        rows = pairing_rows(decisions, method, against, size).copy()
        if not rows.empty:
            rows["preferred"] = (rows["chosen"] == method).astype(float)
            made.append(
                ReportFigure(
                    "learning",
                    f"Choices of {label(method)} over {label(against)} along the session; thin"
                    " lines: participants; band: 95 % t limits.",
                    lambda width: learning_plot(
                        rows,
                        "preferred",
                        y_label="Share of choices",
                        bounds=(0.0, 1.0),
                        width_in=width,
                        simulated=simulated,
                    ),
                )
            )
    if results.reaction:
        medians = {
            one.condition: [
                float(value)
                for value in decisions[
                    (decisions["size"] == one.condition) & (decisions["rt_s"] > 0)
                ]
                .groupby("participant")["rt_s"]
                .median()
            ]
            for one in results.reaction
        }
        made.append(
            ReportFigure(
                "reaction",
                f"Participants' median reaction times, and their mean with {level} limits.",
                lambda width: reaction_plot(
                    results.reaction, medians, label=label, width_in=width, simulated=simulated
                ),
            )
        )
    return tuple(made)


def _heat(
    name: str,
    title: str,
    shares: Mapping[tuple[str, str, str], tuple[tuple[str, float], ...]],
    settings: Settings,
    *,
    simulated: bool,
) -> ReportFigure:
    rows = sorted({row for pairs in shares.values() for row, _ in pairs})
    table = np.full((len(rows), len(shares)), np.nan)
    for column, pairs in enumerate(shares.values()):
        for row, value in pairs:
            table[rows.index(row), column] = value
    columns = [
        f"{settings.label(method)} / {settings.label(against)}"
        + ("" if size == "all" else f"\n{settings.label(size)}")
        for method, against, size in shares
    ]
    return ReportFigure(
        name,
        f"Share of choices of the first method, by {title.lower()}. Blue: the first is preferred;"
        " orange: the second.",
        lambda width: heat_map(
            table,
            [settings.label(row) for row in rows],
            columns,
            row_title=title,
            width_in=width,
            simulated=simulated,
        ),
    )
