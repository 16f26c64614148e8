"""Scores on a JOD (or logit) scale, a panel per size."""

from collections.abc import Callable, Mapping

import numpy as np

from analysis.models.bootstrap import ScaleIntervals
from analysis.models.scaling import Scale
from analysis.plots.style import (
    GREY,
    Figure,
    explain,
    interval,
    limits_text,
    name_rows,
    new_figure,
    row_in,
)


def jod_plot(
    scales: Mapping[str, tuple[Scale, ScaleIntervals | None]],
    *,
    label: Callable[[str], str] = str,
    width_in: float = 7.0,
    simulated: bool = False,
) -> Figure:
    """Draw mean-zero scores with bootstrap limits, best on top, a panel per entry of `scales`."""
    count = max(len(scale.conditions) for scale, _ in scales.values())
    stacked = width_in < 5
    names = [label(one) for scale, _ in scales.values() for one in scale.conditions]
    each_in = row_in(names, width_in, 0.28)
    height = (0.55 + each_in * count) * (len(scales) if stacked else 1) + 0.4
    with new_figure(width_in, height, simulated=simulated) as figure:
        shape = (len(scales), 1) if stacked else (1, len(scales))
        panels = figure.subplots(*shape, sharex=True, squeeze=False)
        for axes, (name, (scale, limits)) in zip(panels.ravel(), scales.items(), strict=True):
            ranked = [-round(float(score), 9) for score in scale.scores]
            order = sorted(range(len(ranked)), key=ranked.__getitem__)
            for y, index in enumerate(order):
                none = (np.nan, np.nan)
                ends = none if limits is None else (limits.lower[index], limits.upper[index])
                interval(axes, y, scale.scores[index], *ends)
            axes.axvline(0.0, color=GREY, lw=0.6)
            axes.grid(axis="x", color="#EEEEEE", lw=0.6)
            name_rows(axes, [label(scale.conditions[i]) for i in order], width_in)
            axes.set_title("" if name == "all" else label(name), loc="left")
            unit = scale.unit
            axes.locator_params(axis="x", nbins=5)
            if not stacked or axes is panels.ravel()[-1]:
                axes.set_xlabel(
                    f"Quality, {unit} (1 JOD: 75 % prefer)"
                    if unit == "JOD" and width_in >= 5 and len(scales) < 3
                    else f"Quality, {unit}"
                )
        known = [limits for _, limits in scales.values() if limits is not None]
        if known:
            explain(figure, f"Lines: {limits_text(known[0].level)}, by bootstrap", width_in)
    return figure
