"""Figures of ordered ratings: how often each was given, and where conditions lie."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from analysis.ordinal import RatingModel
from analysis.plots.style import (
    BLUE,
    explain,
    limits_text,
    new_figure,
    row_in,
    share_axis,
    style,
    wrapped,
)


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
    with style(width_in):
        each_in = row_in([one.condition for one in cells], width_in, 0.32)
        figure = new_figure(width_in, 1.0 + each_in * len(cells), simulated=simulated)
        panels = figure.subplots(1, 2 if shares else 1, sharey=True, squeeze=False)[0]
        if shares:
            _bars(panels[0], model)
        axes = panels[-1]
        for y, one in enumerate(cells):
            axes.plot([one.lower, one.upper], [y, y], color=BLUE, lw=1.4)
            axes.plot(one.place, y, "o", color=BLUE, ms=4)
        axes.axvline(0.0, color="black", lw=0.8, ls=(0, (4, 3)))
        unit = "SD" if model.link == "probit" else "logits"
        axes.set_xlabel(f"Place ({unit})" if width_in < 5 else f"Place on the latent axis ({unit})")
        axes.tick_params(axis="y", length=0)
        names = [wrapped(one.condition, width_in) for one in cells]
        panels[0].set_yticks(range(len(names)), names)
        panels[0].set_ylim(len(names) - 0.4, -0.6)
        said = f"lines: {limits_text(model.level)}"
        if shares:
            handles, labels = panels[0].get_legend_handles_labels()
            figure.legend(
                handles, labels, loc="outside lower center", ncols=min(len(labels), 7),
                title=f"Rating (left); {said} (right)",
            )  # fmt: skip
        else:
            explain(figure, said.capitalize(), width_in)
    return figure


def _bars(axes: mpl.axes.Axes, model: RatingModel) -> None:
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
    axes.tick_params(axis="y", length=0)


def _ramp(count: int) -> Sequence[tuple[float, float, float, float]]:
    """Return colours that differ in lightness, for grey prints and the colour-blind."""
    return [mpl.colormaps["cividis"](x) for x in np.linspace(0.05, 0.95, count)]
