"""Shares by the values of a second factor, a row for each and a group for what is compared."""

from collections.abc import Sequence

from analysis.plots.style import (
    MARKERS,
    SERIES,
    Figure,
    key,
    limits_text,
    name_rows,
    new_figure,
    null_line,
    share_axis,
)


def interaction_plot(
    rows: Sequence[tuple[str, str, float, float, float]],
    *,
    title: str,
    chance: float,
    level: float,
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
    height = 0.95 + (0.16 * most + 0.2 * (most > 1)) * len(groups)
    with new_figure(width_in, height, simulated=simulated) as figure:
        axes = figure.subplots()
        for number, value in enumerate(values):
            own = [row for row in placed if row[1] == value]
            colour, marker = SERIES[number % len(SERIES)], MARKERS[number % len(MARKERS)]
            for y, _, _, lower, upper in own:
                axes.plot([lower, upper], [y, y], color=colour, lw=1.4)
            axes.plot([row[2] for row in own], [row[0] for row in own], marker, color=colour,
                      ls="none", ms=4.5, label=value)  # fmt: skip
        null_line(axes, chance)
        share_axis(axes, "Share")
        name_rows(axes, groups, width_in)
        named = f"{title} ({values[0]})" if len(values) == 1 else title
        key(figure, values, f"{named}; lines: {limits_text(level)}; dashed: chance", width_in)
    return figure
