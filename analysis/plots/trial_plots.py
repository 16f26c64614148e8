"""Heat maps per participant and scene, reaction times, bias."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from analysis.arrays import Floats
from analysis.models.order_and_side import Bias
from analysis.models.reaction import ReactionTimes
from analysis.plots.style import (
    BLUE,
    ORANGE,
    Figure,
    explain,
    font_size,
    interval,
    limits_text,
    name_rows,
    new_figure,
    null_line,
    own_dots,
    row_in,
    share_axis,
)
from analysis.report.wording import share

Label = Callable[[str], str]

NUMBERED_ROWS = 40
PAGE_IN = 9.0


def heat_map(
    shares: Floats,
    rows: Sequence[str],
    columns: Sequence[str],
    *,
    row_title: str,
    width_in: float = 7.0,
    simulated: bool = False,
) -> Figure:
    """Draw shares (rows x columns, NaN where nothing was shown) with their numbers.

    More than `NUMBERED_ROWS` share the height of a page: colours alone, which grow lighter with the
    share and have a scale, and few of their names.
    """
    from matplotlib.colors import LinearSegmentedColormap

    every = len(rows) // NUMBERED_ROWS + 1  # how many rows a name stands for
    size = font_size(width_in)
    cell_in = (0.19 if width_in < 5 else 0.23) if every == 1 else PAGE_IN / len(rows)
    longest = max(len(line) for text in columns for line in text.split("\n"))
    lines = max(text.count("\n") for text in columns) + 1
    upright = longest * size * 0.0092 > (width_in - 1.1) / max(len(columns), 1)
    head = 0.1 + (longest * size * 0.0085 if upright else lines * size * 0.018)
    with new_figure(width_in, 0.45 + head + cell_in * len(rows), simulated=simulated) as figure:
        axes = figure.subplots()
        edges = (np.arange(count + 1) - 0.5 for count in (len(columns), len(rows)))
        diverging = LinearSegmentedColormap.from_list("shares", [ORANGE, "#FFFFFF", BLUE])
        colours = diverging if every == 1 else "cividis"
        cells = axes.pcolormesh(
            *edges, np.ma.masked_invalid(shares), cmap=colours, vmin=0.0, vmax=1.0
        )
        if every > 1:
            bar = figure.colorbar(cells, location="bottom", shrink=0.6, aspect=30)
            bar.set_ticks([0.0, 0.5, 1.0], labels=["0", ".5", "1"])
            bar.set_label("Share")
        axes.invert_yaxis()
        for (row, column), value in np.ndenumerate(shares) if every == 1 else ():
            text, place = ("-", 0.5) if np.isnan(value) else (share(float(value)), float(value))
            colour = _readable_on(cells.cmap(place))
            axes.text(column, row, text, ha="center", va="center", color=colour, fontsize=size - 1)
        axes.xaxis.tick_top()
        axes.set_xticks(range(len(columns)), columns, rotation=90 if upright else 0)
        axes.set_yticks(
            range(0, len(rows), every),
            [text if len(text) < 19 else text[:18] + "…" for text in rows[::every]],
        )
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
        axes.set_ylabel(row_title)
    return figure


def bias_bars(
    biases: Sequence[Bias],
    *,
    level: float = 0.95,
    width_in: float = 3.33,
    simulated: bool = False,
) -> Figure:
    """Draw how often the first interval and the left key were picked, people as dots."""
    with new_figure(width_in, 0.7 + 0.4 * len(biases), simulated=simulated) as figure:
        axes = figure.subplots()
        for y, bias in enumerate(biases):
            own_dots(axes, y, [one for _, one in bias.by_participant])
            interval(axes, y, bias.share, bias.lower, bias.upper)
        null_line(axes, 0.5)
        share_axis(axes, "Share picked")
        name_rows(axes, [bias.alternative for bias in biases], width_in)
        explain(figure, f"Lines: {limits_text(level)}; grey dots: participants", width_in)
    return figure


def reaction_plot(
    summaries: Sequence[ReactionTimes],
    medians: Mapping[str, Sequence[float]],
    *,
    label: Label = str,
    level: float = 0.95,
    width_in: float = 3.33,
    simulated: bool = False,
) -> Figure:
    """Draw participants' median reaction times and their mean with limits, on a log axis."""
    from matplotlib.ticker import MaxNLocator

    each_in = row_in([label(one.condition) for one in summaries], width_in, 0.36)
    with new_figure(width_in, 0.75 + each_in * len(summaries), simulated=simulated) as figure:
        axes = figure.subplots()
        for y, summary in enumerate(summaries):
            own_dots(axes, y, medians.get(summary.condition, ()))
            interval(axes, y, summary.mean_of_medians, summary.lower, summary.upper)
        axes.set_xscale("log")
        values = [value for own in medians.values() for value in own]
        values += [end for one in summaries for end in (one.lower, one.upper)]
        low, high = float(np.nanmin(values)) / 1.15, float(np.nanmax(values)) * 1.15
        axes.set_xlim(low, high)
        every = np.asarray(MaxNLocator(5).tick_values(low, high))
        ticks = [tick for tick in every if low <= tick <= high]
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.minorticks_off()
        axes.set_xlabel("Reaction time, s (log axis)")
        name_rows(axes, [label(one.condition) for one in summaries], width_in)
        said = f"Lines: {limits_text(level)} of the mean; grey dots: participants' medians"
        explain(figure, said, width_in)
    return figure


def _readable_on(colour: tuple[float, float, float, float]) -> str:
    """Return black or white, whichever contrasts more (WCAG 2 relative luminance)."""
    rgb = np.asarray(colour[:3])
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    luminance = float(linear @ (0.2126, 0.7152, 0.0722))
    return "white" if 1.05 / (luminance + 0.05) > (luminance + 0.05) / 0.05 else "black"
