"""Shares by the values of a second factor, a row for each and a group for what is compared."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from analysis.plots.style import (
    MARKERS,
    SERIES,
    legend_columns,
    new_figure,
    share_axis,
    style,
    wrapped,
)


def interaction_plot(
    rows: Sequence[tuple[str, str, float, float, float]],
    *,
    title: str,
    chance: float,
    width_in: float = 7.0,
    simulated: bool = False,
) -> Figure:
    """Draw shares with limits.

    Parameters
    ----------
    rows : sequence of (what is compared, value of the factor, share, lower, upper)
    title : str
        What the factor is called.
    """
    groups = list(dict.fromkeys(of for of, *_ in rows))
    values = list(dict.fromkeys(at for _, at, *_ in rows))
    step = 0.4 / max(1, len(values) - 1)
    with style(width_in):
        height = 0.8 + (0.2 + 0.16 * len(values)) * len(groups)
        figure = new_figure(width_in, height, simulated=simulated)
        axes = figure.subplots()
        for number, value in enumerate(values):
            own = [(groups.index(of), *numbers) for of, at, *numbers in rows if at == value]
            colour, marker = SERIES[number % len(SERIES)], MARKERS[number % len(MARKERS)]
            places = [place - 0.2 + step * number for place, *_ in own]
            for y, (_, _, lower, upper) in zip(places, own, strict=True):
                axes.plot([lower, upper], [y, y], color=colour, lw=1.4)
            axes.plot([one[1] for one in own], places, marker, color=colour, ls="none", ms=4.5,
                      label=value)  # fmt: skip
        axes.axvline(chance, color="black", lw=0.8, ls=(0, (4, 3)))
        share_axis(axes, "Share")
        axes.set_yticks(range(len(groups)), [wrapped(one, width_in) for one in groups])
        axes.set_ylim(len(groups) - 0.5, -0.5)
        axes.tick_params(axis="y", length=0)
        figure.legend(loc="outside lower center", title=title,
                      ncols=legend_columns(values, width_in))  # fmt: skip
    return figure
