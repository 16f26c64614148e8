"""Curves: change over the session, power."""

from collections.abc import Mapping, Sequence
from itertools import cycle

import numpy as np

from analysis.arrays import Floats
from analysis.models.numeric import two_sided_quantile
from analysis.models.trends import Course
from analysis.plots.style import (
    BLUE,
    LIGHT,
    ORANGE,
    SERIES,
    Figure,
    explain,
    limits_text,
    new_figure,
)

PERSON = "#B4B4B4"
"""Colour of one person's line, which lies below all else."""


def learning_plot(
    course: Course,
    *,
    y_label: str,
    bounds: tuple[float, float] | None = None,
    level: float = 0.95,
    width_in: float = 3.33,
    simulated: bool = False,
) -> Figure:
    """Draw an outcome over the session: the mean of people with t limits over their own trends.

    A trend is a person's least-squares line: their values themselves, of few trials each, cross
    so often that nobody is seen. `bounds` are the values the outcome can take, such as (0, 1) for a
    share.
    """
    with new_figure(width_in, 2.3 if width_in < 5 else 3.0, simulated=simulated) as figure:
        axes = figure.subplots()
        places, each = course.places, course.people
        low, high = bounds if bounds is not None else (-np.inf, np.inf)
        for values in each:
            there = np.isfinite(values)
            if there.sum() > 1:
                line = np.polynomial.Polynomial.fit(places[there], values[there], 1)
                ends = places[there][[0, -1]]
                axes.plot(ends, np.clip(line(ends), low, high), color=PERSON, lw=0.7, zorder=1)
        mean, count = np.nanmean(each, axis=0), np.isfinite(each).sum(axis=0)
        axes.plot(places, mean, "o-", color=BLUE, lw=1.6, ms=4, zorder=3)
        if count.min() > 1:
            error = np.nanstd(each, axis=0, ddof=1) / np.sqrt(count)
            reach = error * two_sided_quantile(level, count - 1)
            lower, upper = np.maximum(mean - reach, low), np.minimum(mean + reach, high)
            axes.fill_between(places, lower, upper, color=BLUE, alpha=0.2, lw=0, zorder=2)
        if bounds is not None:
            margin = 0.03 * (bounds[1] - bounds[0])
            axes.set_ylim(bounds[0] - margin, bounds[1] + margin)
        axes.set_xlim(0, 1)
        axes.set_xticks([0, 0.5, 1.0], ["start", "middle", "end"])
        axes.set_xlabel("Place in the session")
        axes.set_ylabel(y_label)
        said = f"Points: mean; band: its {limits_text(level)}; grey lines: participants' own trends"
        explain(figure, said, width_in)
    return figure


def power_plot(
    participants: Sequence[int],
    lines: Mapping[str, Floats],
    *,
    planned: int | None = None,
    x_label: str = "Participants",
    width_in: float = 3.33,
    simulated: bool = False,
) -> Figure:
    """Draw power against numbers of participants (or scenes), with the 80 and 90 % lines.

    Parameters
    ----------
    lines : mapping of what is powered to powers (participants,)
    """
    with new_figure(width_in, 2.7 if width_in < 5 else 3.4, simulated=simulated) as figure:
        axes = figure.subplots()
        for goal in (0.8, 0.9):
            axes.axhline(goal, color=LIGHT, lw=1.0, zorder=0)
        for (name, values), dash in zip(lines.items(), cycle(("-", "--", ":", "-.")), strict=False):
            axes.plot(participants, values, dash, color=SERIES[0], lw=1.4, label=name)
        if planned:
            axes.axvline(planned, color=ORANGE, lw=1.0)
            axes.plot([], [], color=ORANGE, lw=1.0, label=f"planned: {planned}")
        axes.set_ylim(0, 1.02)
        axes.set_yticks([0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0])
        if min(participants) < max(participants):
            axes.set_xlim(min(participants), max(participants))
        axes.set_xlabel(x_label)
        axes.set_ylabel("Power")
        figure.legend(loc="outside lower center", ncols=1 if width_in < 5 else 2)
    return figure
