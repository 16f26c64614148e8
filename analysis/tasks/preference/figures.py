"""The figures of a report of preferences."""

from analysis.plans.preference import Settings
from analysis.plots import (
    bias_bars,
    forest_plot,
    jod_plot,
    preference_bars,
    sized,
)
from analysis.report.blocks import ReportFigure
from analysis.tasks.common_figures import shares_figure
from analysis.tasks.preference.study import StudyResults


def report_figures(
    results: StudyResults, settings: Settings, *, simulated: bool
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
            sized(preference_bars, cells, dots, label=label, simulated=simulated),
        ),
        ReportFigure(
            "forest",
            f"Odds of choosing the first method of each pair, with {level} limits (each comparison"
            " alone). Blue: the first is preferred after correction; orange: the second; grey:"
            " neither is. Grey band: smaller than the smallest effect of interest.",
            sized(forest_plot, cells, label=label, simulated=simulated),
        ),
    ]
    scales = {one.size: (one.scale, one.intervals) for one in results.scales}
    if scales:
        made.append(
            ReportFigure(
                "scale",
                f"Quality in JOD (mean zero; of two 1 JOD apart, 75 % choose the better) with"
                f" {level} bootstrap limits.",
                sized(jod_plot, scales, label=label, simulated=simulated),
            )
        )
    for name, shares in (
        ("participants", results.participant_shares),
        ("scenes", results.scene_shares),
    ):
        caption = (
            f"Share of choices of the first method, by {name.removesuffix('s')}. Blue: the first is"
            " preferred; orange: the second."
        )
        columns = [
            f"{label(method)} / {label(against)}"
            + (f"\n{label(size)}" * (settings.sized and size != "all"))
            for method, against, size in shares
        ]
        found = list(shares.values())
        made.append(shares_figure(name, caption, columns, found, label=label, simulated=simulated))
    biases = [bias for bias in (results.order, results.side) if bias is not None]
    made.append(
        ReportFigure(
            "bias",
            f"How often the first interval and the left key were picked, with {level} limits;"
            " dots: participants.",
            sized(bias_bars, biases, simulated=simulated),
        )
    )
    return tuple(made)
