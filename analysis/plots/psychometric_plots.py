"""Psychometric functions: of conditions, of people, and how well they fit."""

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.arrays import Floats
from analysis.models.curves.goodness_of_fit import Misfit
from analysis.models.numeric import two_sided_quantile
from analysis.models.trends import Course
from analysis.plots.style import (
    GREY,
    Axes,
    Figure,
    font_size,
    interval,
    key,
    legend_columns,
    level_axis,
    limits_text,
    new_figure,
    series_look,
)
from analysis.report.wording import share, size

FEW_LEVELS = 8
"""Up to so many levels, each has its tick."""
LONGEST_TICK = 5
"""Letters of a tick that has all digits of its level."""
Curve = Callable[[Floats], Floats]
Series = tuple[Floats, Floats, Floats, Curve | None]
"""Levels, right answers, trials; and the fit, which gives the share of right answers."""
PANELS = 48
"""Panels of people, at most."""


@dataclass(frozen=True)
class DrawnCurve:
    """A fit as it is drawn: `share` of right answers, its `limits`, and `threshold` with its two.

    What is None is not drawn.
    """

    share: Curve
    limits: Callable[[Floats], tuple[Floats, Floats]] | None = None
    threshold: tuple[float, float | None, float | None] | None = None

    def __call__(self, x: Floats) -> Floats:
        """Return the share of right answers at `x`."""
        return self.share(x)


def psychometric_plot(
    series: Mapping[str, Series],
    *,
    x_label: str,
    chance: float | None = None,
    logarithmic: bool = False,
    label: Callable[[str], str] = str,
    level: float = 0.95,
    width_in: float = 3.33,
    simulated: bool = False,
) -> Figure:
    """Draw data as points and fits as curves, as [BB] Fig. 17; thresholds with limits below.

    Parameters
    ----------
    series : mapping of condition to (x, successes, trials, fit or None)
        Whiskers are binomial standard errors. A fit may be a `DrawnCurve`; points without one are
        joined by a thin line.
    chance : float, optional
        Where a dashed line stands.
    """
    fits = [fit for *_, fit in series.values()]
    placed = sum(isinstance(fit, DrawnCurve) and fit.threshold is not None for fit in fits)
    banded = any(isinstance(fit, DrawnCurve) and fit.limits is not None for fit in fits)
    everything = np.concatenate([x for x, *_ in series.values()])
    strip_in = 0.1 + 0.12 * placed if placed else 0.0
    height = (2.5 if width_in < 5 else 3.2) + strip_in
    with new_figure(width_in, height, simulated=simulated) as figure:
        ratios = [1.0, strip_in / 1.9] if placed else [1.0]
        several = figure.subplots(len(ratios), 1, sharex=True, squeeze=False, height_ratios=ratios)[
            :, 0
        ]
        axes, strip = several[0], several[-1]
        _draw_series(axes, series, everything, logarithmic=logarithmic, error_bars=True)
        if chance is not None:
            axes.axhline(chance, color=GREY, lw=0.6, ls=(0, (4, 3)))
        said = ["Whiskers: ± 1 binomial standard error"]
        if banded:
            said.append(f"bands: {limits_text(level)} of the mean curve")
        if placed:
            _draw_thresholds(strip, axes, series)
            said.append(f"below: thresholds, {limits_text(level)}")
        for number, name in enumerate(series):
            colour, marker, dash = series_look(number)
            dash, wide = ("-", 0.6) if series[name][-1] is None else (dash, 1.8)
            axes.plot([], [], ls=dash, lw=wide, color=colour, marker=marker, ms=3,
                      label=label(name))  # fmt: skip
        _level_ticks(strip, everything, width_in, logarithmic=logarithmic)
        axes.set_ylim(-0.03, 1.03)
        axes.set_yticks([0, 0.25, 0.5, 0.75, 1.0], ["0", ".25", ".5", ".75", "1"])
        strip.set_xlabel(x_label)
        axes.set_ylabel("Proportion correct")
        columns = legend_columns([label(name) for name in series], width_in)
        title = "\n".join(textwrap.wrap("; ".join(said), 56 if width_in < 5 else 100))
        figure.legend(loc="outside lower center", ncols=columns, title=title)
    return figure


def people_plot(
    people: Mapping[str, Mapping[str, Series]],
    *,
    x_label: str,
    chance: float | None,
    logarithmic: bool = False,
    label: Callable[[str], str] = str,
    level: float = 0.95,
    width_in: float = 7.0,
    simulated: bool = False,
) -> Figure:
    """Draw a panel per person: shares of right answers, curves, and thresholds with limits.

    Of more than `PANELS` people the first are drawn. Larger points stand for more answers.
    """
    shown = dict(list(people.items())[:PANELS])
    names = list(dict.fromkeys(name for one in shown.values() for name in one))
    columns = min(3 if width_in < 5 else 6, len(shown))
    rows = -(-len(shown) // columns)
    everything = np.concatenate([x for one in shown.values() for x, *_ in one.values()])
    floor = chance or 0.0
    shares = [k / n for one in shown.values() for _, k, n, _ in one.values()]
    lowest = min(floor, float(np.concatenate(shares).min()))
    room = 1.0 - lowest
    points = font_size(width_in)
    each_in = 0.82 if width_in < 5 else 0.95
    with new_figure(width_in, 0.7 + each_in * rows, simulated=simulated) as figure:
        panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        for axes, (who, series) in zip(panels.ravel(), shown.items(), strict=False):
            ranked = {name: series[name] for name in names if name in series}
            places = [names.index(name) for name in ranked]
            _draw_series(axes, ranked, everything, logarithmic=logarithmic, places=places)
            for number, (*_, fit) in zip(places, ranked.values(), strict=True):
                if isinstance(fit, DrawnCurve) and fit.threshold is not None:
                    value, lower, upper = fit.threshold
                    y = lowest - (0.04 + 0.09 * number) * room
                    colour, *_ = series_look(number)
                    if lower is not None and upper is not None:
                        axes.plot([lower, upper], [y, y], color=colour, lw=1.0)
                    axes.plot([value], [y], "|", color=colour, ms=5, mew=1.4)
            if chance is not None:
                axes.axhline(chance, color=GREY, lw=0.5, ls=(0, (4, 3)))
            text = who if len(who) < 15 else who[:14] + "…"
            axes.set_title(text, fontsize=points - 0.5, loc="left", pad=2)
            ticks = (floor, 0.5 + 0.5 * floor, 1.0)
            axes.set_yticks(ticks, map(share, ticks))
            axes.set_ylim(lowest - (0.03 + 0.09 * len(names)) * room, 1.0 + 0.09 * room)
        for axes in panels.ravel()[len(shown) :]:
            axes.set_visible(False)
        for column in range(columns):  # the lowest panel that is seen has the axis
            axes = panels[(len(shown) - 1 - column) // columns, column]
            _level_ticks(axes, everything, width_in / columns, logarithmic=logarithmic)
            axes.tick_params(labelbottom=True)
        for number, name in enumerate(names):
            colour, marker, dash = series_look(number)
            panels[0, 0].plot([], [], marker=marker, ms=3, ls=dash, label=label(name), color=colour)
        figure.supylabel("Proportion correct", fontsize=points)
        bare = all(
            not isinstance(fit, DrawnCurve) or fit.threshold is None or fit.threshold[1] is None
            for one in shown.values() for *_, fit in one.values()
        )  # fmt: skip
        said = f"{x_label}; larger points: more answers; below: thresholds"
        said += "" if bare else f", {limits_text(level)}"
        key(figure, [label(name) for name in names], said, width_in)
    return figure


def _draw_series(
    axes: Axes,
    series: Mapping[str, Series],
    everything: Floats,
    *,
    logarithmic: bool,
    error_bars: bool = False,
    places: Sequence[int] | None = None,
) -> None:
    """Draw points and curves of conditions; `places` say which colour each has."""
    space = np.geomspace if logarithmic else np.linspace
    fine = space(everything.min(), everything.max(), 200)
    most = max(float(trials.max()) for _, _, trials, _ in series.values())
    for number, (x, successes, trials, fit) in zip(
        places or range(len(series)), series.values(), strict=False
    ):
        colour, marker, dash = series_look(number)
        share = successes / trials
        if error_bars:
            error = np.sqrt(np.maximum(share * (1.0 - share), 0.25 / trials) / trials)
            axes.errorbar(x, share, error, color=colour, ls="none" if fit is not None else "-",
                          lw=0.6, marker=marker, ms=3, elinewidth=0.6)  # fmt: skip
        else:
            axes.scatter(x, share, s=2.0 + 12.0 * trials / most, color=colour, marker=marker,
                         linewidth=0, alpha=0.8)  # fmt: skip
        if fit is not None:
            axes.plot(fine, fit(fine), ls=dash, color=colour, lw=1.8 if error_bars else 1.1,
                      alpha=0.85)  # fmt: skip
        if isinstance(fit, DrawnCurve) and fit.limits is not None:
            axes.fill_between(fine, *fit.limits(fine), color=colour, alpha=0.15, lw=0, zorder=0)


def _draw_thresholds(strip: Axes, axes: Axes, series: Mapping[str, Series]) -> None:
    """Draw thresholds with limits in a strip, and lines from there to the curves."""
    row = 0
    for number, (*_, fit) in enumerate(series.values()):
        if not isinstance(fit, DrawnCurve) or fit.threshold is None:
            continue
        colour, *_ = series_look(number)
        value, lower, upper = fit.threshold
        interval(strip, row, value, value if lower is None else lower,
                 value if upper is None else upper, colour)  # fmt: skip
        top = float(fit(np.array([value]))[0])
        axes.plot([value, value], [-0.03, top], color=colour, lw=0.7, ls=":", zorder=1)
        row += 1
    strip.set_ylim(row - 0.4, -0.6)
    strip.set_yticks([])
    strip.spines["left"].set_visible(False)


def _level_ticks(axes: Axes, levels: Floats, width_in: float, *, logarithmic: bool) -> None:
    """Set ticks: at each level, where these are few and their names have room."""
    from matplotlib import rcParams

    if logarithmic:
        level_axis(axes, levels)
    shown = np.unique(levels)
    span = float(np.ptp(shown))
    axes.set_xlim(*_widened(shown, logarithmic=logarithmic))
    if logarithmic or shown.size > FEW_LEVELS or span == 0.0:
        return
    texts = [f"{value:g}" for value in shown]
    if max(map(len, texts)) > LONGEST_TICK:
        texts = [size(value, within=(0.0, span)) for value in shown]
    room_in = float(np.diff(shown).min()) / (1.1 * span) * (width_in - 0.5)
    if room_in > (0.6 * max(map(len, texts)) + 0.6) * rcParams["font.size"] / 72:
        axes.set_xticks(shown, texts)


def _widened(levels: Floats, *, logarithmic: bool) -> tuple[float, float]:
    """Return ends of the axis a little outside of all levels."""
    if logarithmic:
        low, high = _widened(np.log(levels), logarithmic=False)
        return float(np.exp(low)), float(np.exp(high))
    margin = 0.05 * float(np.ptp(levels)) or 1.0
    return float(levels.min()) - margin, float(levels.max()) + margin


def misfit_plot(
    found: Sequence[Misfit],
    course: Course | None,
    *,
    x_label: str,
    logarithmic: bool = False,
    label: Callable[[str], str] = str,
    level: float = 0.95,
    width_in: float = 7.0,
    simulated: bool = False,
) -> Figure:
    """Draw residuals along the level, with those of simulated studies, and over the session."""
    panels = 1 if course is None else 2
    wide = width_in >= 5
    height = 2.6 if wide else 0.8 + 1.9 * panels
    with new_figure(width_in, height, simulated=simulated) as figure:
        shape = (1, panels) if wide else (panels, 1)
        several = figure.subplots(*shape, squeeze=False).ravel()
        axes = several[0]
        levels = np.array([x for one in found for x in one.levels])
        for number, one in enumerate(found):
            colour, marker, _ = series_look(number)
            x = np.array(one.levels)
            axes.fill_between(x, one.lower, one.upper, color=colour, alpha=0.15, lw=0, zorder=0)
            axes.plot(x, one.residuals, ls="none", marker=marker, color=colour, ms=3.5,
                      label=label(one.condition))  # fmt: skip
        _level_ticks(axes, levels, width_in / shape[1], logarithmic=logarithmic)
        axes.set_xlabel(x_label)
        axes.set_ylabel("Residual, share right")
        said = "Bands: 95 % of simulated residuals"
        if course is not None:
            said += f"; session: mean of participants, {limits_text(level)}" * (
                len(course.people) > 1
            )
            mean, count = np.nanmean(course.people, axis=0), np.isfinite(course.people).sum(axis=0)
            reach = np.zeros(mean.size)
            if count.min() > 1:
                sd = np.nanstd(course.people, axis=0, ddof=1)
                reach = sd / np.sqrt(count) * two_sided_quantile(level, count - 1)
            several[1].errorbar(course.places, mean, reach, color="black", marker="o", ms=3.5,
                                ls="none", lw=1.0)  # fmt: skip
            several[1].set_xlim(0, 1)
            several[1].set_xticks([0, 0.5, 1.0], ["start", "middle", "end"])
            several[1].set_xlabel("Place in the session")
        for one in several:
            one.axhline(0.0, color=GREY, lw=0.7, ls=(0, (4, 3)))
        key(figure, [label(one.condition) for one in found], said, width_in)
    return figure
