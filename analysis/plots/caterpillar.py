"""Levels of random effects, each with limits: a caterpillar."""

from collections.abc import Callable, Mapping, Sequence

from analysis.models.mixed.deviations import EffectLevel
from analysis.models.tails import two_sided_quantile
from analysis.plots.style import BLUE, GREY, Figure, explain, font_size, limits_text, new_figure

LEAST_SPAN = 0.02
"""Of an axis: where no level lies off the typical one, what is left of the search is not shown."""
NAMED = 40
"""Levels of one effect that have room for their names."""


def caterpillar_plot(
    effects: Mapping[str, Sequence[EffectLevel]],
    *,
    x_label: str,
    level: float,
    label: Callable[[str], str] = str,
    width_in: float = 3.33,
    simulated: bool = False,
) -> Figure:
    """Draw how far each level lies from the typical one, in order, a panel per effect."""
    reach = float(two_sided_quantile(level))
    longest = max(map(len, effects.values()))
    size = font_size(width_in)
    row_in = 0.15 if longest <= NAMED else 6.0 / longest
    with new_figure(width_in, 0.75 + row_in * longest, simulated=simulated) as figure:
        panels = figure.subplots(1, len(effects), squeeze=False, sharex=True)[0]
        for axes, (name, levels) in zip(panels, effects.items(), strict=True):
            ordered = sorted(levels, key=lambda one: one.value)
            places = range(len(ordered))
            for y, one in zip(places, ordered, strict=True):
                ends = [one.value - reach * one.error, one.value + reach * one.error]
                axes.plot(ends, [y, y], color=BLUE, lw=0.9)
            axes.plot([one.value for one in ordered], list(places), "o", color=BLUE, ms=2.5)
            axes.axvline(0.0, color=GREY, lw=0.8, ls=(0, (4, 3)))
            named = places if len(ordered) <= NAMED else ()
            texts = [label(ordered[y].name) for y in named]
            axes.set_yticks(
                list(named),
                [text if len(text) < 13 else text[:12] + "…" for text in texts],
                fontsize=size - 1,
            )
            axes.set_ylim(-0.6, len(ordered) - 0.4)
            axes.tick_params(axis="y", length=0)
            axes.set_title(f"{name}s", loc="left")
        low, high = panels[0].get_xlim()
        panels[0].set_xlim(min(low, -LEAST_SPAN / 2), max(high, LEAST_SPAN / 2))
        explain(figure, f"{x_label}; lines: {limits_text(level)}", width_in)
    return figure
