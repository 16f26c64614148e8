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
    held = [[row for row in rows if row[0] == of] for of in groups]
    most = max(map(len, held))
    step = 0.4 / max(1, most - 1)
    placed = [
        (place + step * (rank - 0.5 * (len(own) - 1)), *row[1:])
        for place, own in enumerate(held)
        for rank, row in enumerate(own)
    ]
    with style(width_in):
        height = 0.8 + (0.16 * most + 0.2 * (most > 1)) * len(groups)
        figure = new_figure(width_in, height, simulated=simulated)
        axes = figure.subplots()
        for number, value in enumerate(values):
            own = [row for row in placed if row[1] == value]
            colour, marker = SERIES[number % len(SERIES)], MARKERS[number % len(MARKERS)]
            for y, _, _, lower, upper in own:
                axes.plot([lower, upper], [y, y], color=colour, lw=1.4)
            axes.plot([row[2] for row in own], [row[0] for row in own], marker, color=colour,
                      ls="none", ms=4.5, label=value)  # fmt: skip
        axes.axvline(chance, color="black", lw=0.8, ls=(0, (4, 3)))
        share_axis(axes, "Share")
        axes.set_yticks(range(len(groups)), [wrapped(one, width_in) for one in groups])
        axes.set_ylim(len(groups) - 0.5, -0.5)
        axes.tick_params(axis="y", length=0)
        figure.legend(loc="outside lower center", title=title,
                      ncols=legend_columns(values, width_in))  # fmt: skip
    return figure
