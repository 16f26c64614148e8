"""Figures of ordered ratings: how often each was given, and where conditions lie."""

from collections.abc import Sequence

import numpy as np

from analysis.models.ordinal import RatingModel
from analysis.plots.style import (
    Axes,
    Figure,
    explain,
    interval,
    limits_text,
    name_rows,
    new_figure,
    null_line,
    row_in,
    share_axis,
)

TOLD = 14
"""Ratings that the legend names at most; of a slider, whose colours run on, these suffice."""


def ratings_plot(
    model: RatingModel,
    *,
    shares: bool = True,
    width_in: float = 3.33,
    simulated: bool = False,
) -> Figure:
    """Draw the shares of each rating (left), and conditions on the latent axis with limits.

    `shares` False leaves the first panel out, as for pairs, whose ratings belong to two methods.
    """
    cells = model.conditions
    each_in = row_in([one.condition for one in cells], width_in, 0.32)
    with new_figure(width_in, 1.0 + each_in * len(cells), simulated=simulated) as figure:
        panels = figure.subplots(1, 2 if shares else 1, sharey=True, squeeze=False)[0]
        if shares:
            _bars(panels[0], model)
        axes = panels[-1]
        for y, one in enumerate(cells):
            interval(axes, y, one.place, one.lower, one.upper)
        null_line(axes, 0.0)
        unit = "SD" if model.link == "probit" else "logits"
        axes.set_xlabel(f"Place ({unit})" if width_in < 5 else f"Place on the latent axis ({unit})")
        for panel in panels:
            name_rows(panel, [one.condition for one in cells], width_in)
        said = f"lines: {limits_text(model.level)}"
        if shares:
            bars, names = panels[0].get_legend_handles_labels()
            told = np.unique(
                np.linspace(0, len(names) - 1, min(len(names), TOLD)).round().astype(int)
            )
            figure.legend(
                [bars[k] for k in told], [names[k] for k in told], loc="outside lower center",
                ncols=min(len(told), 7 if width_in > 5 else 5),
                title=f"Rating (left); {said} (right)",
            )  # fmt: skip
        else:
            explain(figure, said.capitalize(), width_in)
    return figure


def _bars(axes: Axes, model: RatingModel) -> None:
    colours = _ramp(len(model.categories))
    for y, one in enumerate(model.conditions):
        left = 0.0
        for k, value in enumerate(one.shares):
            axes.barh(
                y,
                value,
                left=left,
                height=0.65,
                color=colours[k],
                label=model.categories[k] if y == 0 else None,
            )
            left += value
    share_axis(axes, "Share of ratings")


def _ramp(count: int) -> Sequence[tuple[float, float, float, float]]:
    """Return colours that differ in lightness, for grey prints and the colour-blind."""
    from matplotlib import colormaps

    return [colormaps["cividis"](x) for x in np.linspace(0.05, 0.95, count)]
