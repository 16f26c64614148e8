"""Preferences as bars in the papers' style, and on a scale."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from analysis.arrays import Floats
from analysis.models.bootstrap import ScaleIntervals
from analysis.models.preference import Preference
from analysis.models.scaling import Scale
from analysis.plots.style import (
    BLUE,
    GREY,
    ORANGE,
    PALE_BLUE,
    PALE_ORANGE,
    Axes,
    Figure,
    explain,
    font_size,
    interval,
    limits_text,
    name_rows,
    new_figure,
    null_line,
    row_in,
    share_axis,
    wrapped,
)
from analysis.report.wording import share, share_range

Label = Callable[[str], str]


def preference_bars(
    cells: Sequence[Preference],
    shares: Mapping[tuple[str, str, str], Sequence[float]],
    *,
    label: Label = str,
    width_in: float = 7.0,
    simulated: bool = False,
) -> Figure:
    """Draw shares as split bars ([MI] Fig. 10, [BB] Fig. 18), with what the papers leave out.

    Parameters
    ----------
    cells : sequence of Preference
        In drawing order; equal sizes are grouped under a heading.
    shares : mapping of (method, against, size) to the participants' own shares
        Drawn as dots.
    label : callable
        Name to label.

    Notes
    -----
    A bar is split at the share of the method on the left; the dark part is the method chosen
    more often. Whiskers are the clustered limits; the column repeats share and limits.
    """
    rows, headings, place, last = [], [], 0.0, None
    for cell in cells:
        if cell.size != last and cell.size not in ("", "all"):
            headings.append((place, cell.size))
            place += 0.75
            last = cell.size
        rows.append((place, cell))
        place += 1.0
    size = font_size(width_in)
    row_in = 0.36 if width_in < 5 else 0.34
    with new_figure(width_in, 0.7 + row_in * place, simulated=simulated) as figure:
        axes, numbers = figure.subplots(
            1, 2, sharey=True, width_ratios=(1.0, 0.40 if width_in < 5 else 0.22)
        )
        for y, cell in rows:
            own = np.asarray(shares.get((cell.method, cell.against, cell.size), ()))
            _split_bar(axes, y, cell, own, 4 if width_in < 5 else 8)
            found = cell.estimate
            numbers.text(0.0, y, share(found.share), va="center", fontweight="bold")
            numbers.text(0.34, y, share_range(found.lower, found.upper), va="center")
        null_line(axes, 0.5)
        share_axis(axes, f"Share preferring {'' if width_in < 5 else 'the method on the '}left")
        said = f"Whiskers and [ ]: {limits_text(cells[0].estimate.level)}; dots: participants"
        explain(figure, said, width_in)
        axes.set_yticks([y for y, _ in rows], [wrapped(label(c.method), width_in) for _, c in rows])
        axes.set_ylim(place - 0.4, -0.55)
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        other = axes.twinx()
        other.set_ylim(axes.get_ylim())
        other.set_yticks(
            [y for y, _ in rows], [wrapped(label(c.against), width_in) for _, c in rows]
        )
        other.tick_params(axis="y", length=0)
        other.spines[:].set_visible(False)
        for y, name in headings:
            text = "all sizes" if name == "all" else label(name)
            axes.text(
                0.0,
                y,
                text,
                va="center",
                color=GREY,
                fontweight="bold",
                fontsize=size,
                zorder=6,
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
            )
        numbers.set_xlim(0.0, 1.0)
        numbers.axis("off")
    return figure


def _split_bar(axes: Axes, y: float, cell: Preference, own: Floats, dot: float) -> None:
    """Draw a bar of both methods, its limits, and participants' own shares."""
    found = cell.estimate
    more = 2 * cell.chosen - cell.trials  # in a tie nobody is dark
    first, second = BLUE if more > 0 else PALE_BLUE, ORANGE if more < 0 else PALE_ORANGE
    axes.barh(y, found.share, height=0.62, color=first)
    axes.barh(y, 1.0 - found.share, left=found.share, height=0.62, color=second)
    axes.plot([found.lower, found.upper], [y, y], color="black", lw=1.1, zorder=4)
    for end in (found.lower, found.upper):
        axes.plot([end, end], [y - 0.13, y + 0.13], color="black", lw=1.1, zorder=4)
    axes.scatter(own, y + _spread(own), s=dot, facecolor="white", edgecolor="black", linewidth=0.5,
                 zorder=5, clip_on=False)  # fmt: skip


def _spread(values: Floats) -> Floats:
    """Vertical places that keep dots of equal shares apart, the same in every run."""
    shift = np.zeros(len(values))
    for value in np.unique(np.round(values, 3)):
        same = np.nonzero(np.isclose(values, value, atol=5e-4))[0]
        if same.size > 1:
            shift[same] = np.linspace(-0.24, 0.24, same.size)
    return shift


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
