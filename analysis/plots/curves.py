"""Curves: psychometric functions, change over the session, power."""

from collections.abc import Callable, Mapping, Sequence
from itertools import cycle

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy import stats

from analysis.models.learning import Course
from analysis.plots.style import (
    BLUE,
    DASHES,
    GREY,
    LIGHT,
    MARKERS,
    ORANGE,
    SERIES,
    explain,
    legend_columns,
    level_axis,
    limits_text,
    new_figure,
    style,
)

Floats = NDArray[np.float64]

FEW_LEVELS = 8
"""Up to so many levels, each has its tick."""
PERSON = "#B4B4B4"
"""Of one person's line, which lies below all else."""
Curve = Callable[[Floats], Floats]


def psychometric_plot(
    series: Mapping[str, tuple[Floats, Floats, Floats, Curve | None]],
    *,
    x_label: str,
    chance: float | None = None,
    logarithmic: bool = False,
    label: Callable[[str], str] = str,
    width_in: float = 3.33,
    simulated: bool = False,
) -> Figure:
    """Draw data as points and fits as curves, as [BB] Fig. 17.

    Parameters
    ----------
    series : mapping of condition to (x, successes, trials, fit or None)
        Whiskers are binomial standard errors. A fit gives the share of right answers at x; points
        without one are joined by a thin line.
    chance : float, optional
        Where the dashed line stands; left out, at the guess rates of the fits.
    """
    with style(width_in):
        figure = new_figure(width_in, 2.5 if width_in < 5 else 3.2, simulated=simulated)
        axes = figure.subplots()
        guesses: set[float] = set()
        everything = np.concatenate([x for x, *_ in series.values()])
        for number, (name, (x, successes, trials, fit)) in enumerate(series.items()):
            colour, marker = SERIES[number % len(SERIES)], MARKERS[number % len(MARKERS)]
            dash = DASHES[number % len(DASHES)]
            share = successes / trials
            error = np.sqrt(np.maximum(share * (1.0 - share), 0.25 / trials) / trials)
            axes.errorbar(
                x,
                share,
                error,
                color=colour,
                ls="none" if fit is not None else "-",
                lw=0.6,
                marker=marker,
                ms=3,
                elinewidth=0.6,
            )
            curve = dash if fit is not None else "-"
            width = 1.8 if fit is not None else 0.6
            axes.plot(
                [], [], ls=curve, lw=width, color=colour, marker=marker, ms=3, label=label(name)
            )
            if fit is not None:
                space = np.geomspace if logarithmic else np.linspace
                fine = space(everything.min(), everything.max(), 200)
                axes.plot(fine, fit(fine), ls=dash, color=colour, lw=1.8, alpha=0.85)
                guesses.add(float(getattr(fit, "guess", np.nan)))
        shown = np.unique(everything)
        if logarithmic:
            level_axis(axes, everything)
        elif shown.size <= FEW_LEVELS:
            axes.set_xticks(shown, [f"{value:g}" for value in shown])
        for guess in sorted(guesses if chance is None else {chance}):
            if np.isfinite(guess):
                axes.axhline(guess, color=GREY, lw=0.6, ls=(0, (4, 3)))
        axes.set_ylim(-0.03, 1.03)
        axes.set_yticks([0, 0.25, 0.5, 0.75, 1.0], ["0", ".25", ".5", ".75", "1"])
        axes.set_xlabel(x_label)
        axes.set_ylabel("Proportion correct")
        columns = legend_columns([label(name) for name in series], width_in)
        figure.legend(
            loc="outside lower center", ncols=columns, title="Whiskers: ± 1 binomial standard error"
        )
    return figure


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
    with style(width_in):
        figure = new_figure(width_in, 2.3 if width_in < 5 else 3.0, simulated=simulated)
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
            reach = error * stats.t.ppf(0.5 + 0.5 * level, count - 1)
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
    with style(width_in):
        figure = new_figure(width_in, 2.7 if width_in < 5 else 3.4, simulated=simulated)
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
