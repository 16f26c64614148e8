"""Confidence: against right answers, against sensitivity, and as a ROC."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from scipy.special import ndtr

from analysis.models.detection import Measure
from analysis.models.metacognition import UnequalFit
from analysis.models.right_answers import Rate
from analysis.plots.style import (
    DASHES,
    GREY,
    MARKERS,
    SERIES,
    Figure,
    key,
    limits_text,
    name_rows,
    new_figure,
)

Label = Callable[[str], str]
Points = Sequence[tuple[float, float]]
_SHARES = ([0.0, 0.25, 0.5, 0.75, 1.0], ["0", ".25", ".5", ".75", "1"])


def calibration_plot(
    series: Mapping[str, Sequence[tuple[float, Rate]]],
    *,
    chance: float,
    level: float,
    label: Label = str,
    width_in: float = 3.33,
    simulated: bool = False,
) -> Figure:
    """Draw the share of right answers at each step of confidence, by condition, with limits."""
    with new_figure(width_in, 2.6 if width_in < 5 else 3.2, simulated=simulated) as figure:
        axes = figure.subplots()
        steps = sorted({step for points in series.values() for step, _ in points})
        gap = float(np.min(np.diff(steps))) if len(steps) > 1 else 1.0
        for place, (name, points) in enumerate(series.items()):
            colour = SERIES[place % len(SERIES)]
            aside = 0.12 * gap * (place - 0.5 * (len(series) - 1)) * min(1.0, 5 / len(series))
            x = np.array([step for step, _ in points]) + aside
            for at, (_, one) in zip(x, points, strict=True):
                axes.plot([at, at], [one.lower, one.upper], color=colour, lw=1.0)
            axes.plot(
                x,
                [one.share for _, one in points],
                MARKERS[place % len(MARKERS)],
                color=colour,
                ms=4,
                label=label(name),
            )
        axes.axhline(chance, color=GREY, lw=0.8, ls=(0, (4, 3)))
        axes.set_xticks(steps, [f"{step:g}" for step in steps])
        axes.set_ylim(-0.03, 1.03)
        axes.set_yticks(*_SHARES)
        axes.set_xlabel("Confidence")
        axes.set_ylabel("Share correct")
        said = f"Lines: {limits_text(level)}; dashed: chance"
        key(figure, [label(name) for name in series], said, width_in)
    return figure


def pairs_plot(
    rows: Mapping[str, Sequence[tuple[str, Measure | None]]],
    people: Mapping[str, Sequence[tuple[float, ...]]],
    *,
    x_label: str,
    level: float,
    label: Label = str,
    width_in: float = 3.33,
    simulated: bool = False,
) -> Figure:
    """Draw one or several means with limits in each row, and people as small dots below.

    Parameters
    ----------
    rows : mapping of row to (series, mean), such as confidence of right and of wrong answers
    people : mapping of row to values of each person, in the order of the series
    """
    with new_figure(width_in, 0.85 + 0.45 * len(rows), simulated=simulated) as figure:
        axes = figure.subplots()
        named = set[str]()
        for y, (row, means) in enumerate(rows.items()):
            for place, (name, one) in enumerate(means):
                colour, marker = SERIES[place], MARKERS[place]
                lift = y - 0.24 + 0.17 * place
                values = [own[place] for own in people.get(row, ())]
                axes.scatter(
                    values,
                    np.full(len(values), y + 0.13 + 0.14 * place),
                    s=7,
                    marker=marker,
                    color=colour,
                    linewidth=0,
                    alpha=0.45,
                )
                if one is None:
                    continue
                axes.plot([one.lower, one.upper], [lift, lift], color=colour, lw=1.4)
                shown = "_" if name in named else name  # in the legend once
                axes.plot(one.value, lift, marker, color=colour, ms=4, label=shown)
                named.add(name)
        name_rows(axes, [label(name) for name in rows], width_in)
        axes.set_xlabel(x_label)
        said = f"Lines: {limits_text(level)} of the mean; small: participants"
        key(figure, [*named], said, width_in)
    return figure


def metacognition_plot(
    people: Mapping[str, Points],
    *,
    label: Label = str,
    width_in: float = 3.33,
    simulated: bool = False,
) -> Figure:
    """Draw meta-d' of each person against d'; on the dashed line M-ratio is 1."""
    with new_figure(width_in, 2.9 if width_in < 5 else 3.6, simulated=simulated) as figure:
        axes = figure.subplots()
        every = [value for points in people.values() for point in points for value in point]
        low, high = min(0.0, *every) - 0.1, max(every) + 0.2
        axes.plot([low, high], [low, high], color=GREY, lw=0.8, ls=(0, (4, 3)))
        axes.axhline(0.0, color=GREY, lw=0.5)
        for place, (name, points) in enumerate(people.items()):
            axes.plot(
                *np.array(points).T,
                MARKERS[place % len(MARKERS)],
                color=SERIES[place % len(SERIES)],
                ms=4,
                alpha=0.8,
                label=label(name),
            )
        axes.set_xlim(low, high)
        axes.set_ylim(low, high)
        axes.set_aspect("equal")
        axes.set_xlabel("d'")
        axes.set_ylabel("meta-d'")
        said = "Points: participants; dashed: meta-d' = d'"
        key(figure, [label(name) for name in people], said, width_in)
    return figure


def roc_plot(
    points: Mapping[str, Points],
    fits: Mapping[str, UnequalFit | None],
    *,
    labels: tuple[str, str],
    label: Label = str,
    width_in: float = 3.33,
    simulated: bool = False,
) -> Figure:
    """Draw ROC points of conditions, and fitted curves where there are some.

    `labels` are those of the axes, false alarms first.
    """
    with new_figure(width_in, 2.9 if width_in < 5 else 3.6, simulated=simulated) as figure:
        axes = figure.subplots()
        fine = np.linspace(-5.0, 5.0, 400)
        axes.plot([0, 1], [0, 1], color=GREY, lw=0.8, ls=(0, (4, 3)))
        for place, (name, own) in enumerate(points.items()):
            colour, fit = SERIES[place % len(SERIES)], fits.get(name)
            marker, dash = MARKERS[place % len(MARKERS)], DASHES[place % len(DASHES)]
            line, wide = ("-", 0.8) if fit is None else (dash, 1.3)
            x, y = np.array(own).T
            look = partial(axes.plot, color=colour, lw=wide, marker=marker, ms=3.5)
            look(x, y, ls=line if fit is None else "none")
            look([], [], ls=line, label=label(name))
            if fit is not None:
                curve = ndtr((fit.mean + fine) / fit.sd)
                axes.plot(ndtr(fine), curve, color=colour, ls=dash, lw=wide)
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_ticks(*_SHARES)
        axes.set_xlim(-0.02, 1.02)
        axes.set_ylim(-0.02, 1.02)
        axes.set_aspect("equal")
        axes.set_xlabel(labels[0])
        axes.set_ylabel(labels[1])
        said = f"{'Curves: fits; ' * any(fits.values())}diagonal: chance"
        key(figure, [label(name) for name in points], said, width_in)
    return figure
