"""Figures of tasks: right answers and bias, d', d' against scaling, a second factor, ratings."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from analysis.arrays import Floats
from analysis.models.critical_scaling import CriticalScaling
from analysis.models.detection import (
    Discrimination,
    DiscriminationResults,
    YesNoCondition,
    YesNoResults,
)
from analysis.models.ordinal import RatingModel
from analysis.models.right_answers import Rate
from analysis.plots.style import (
    BLUE,
    GREY,
    ORANGE,
    Axes,
    Figure,
    explain,
    interval,
    key,
    legend_columns,
    level_axis,
    limits_text,
    name_rows,
    new_figure,
    null_line,
    row_in,
    series_look,
    share_axis,
)
from protocols.answer_rules import answer_rule

Label = Callable[[str], str]


def detection_plot(
    results: YesNoResults,
    *,
    label: Label = str,
    width_in: float = 7.0,
    simulated: bool = False,
) -> Figure:
    """Draw the shares answered correctly and with one answer, as [BB] Fig. 20."""
    cells = results.conditions
    with new_figure(
        width_in, 0.9 + _rows_in(cells, label, width_in, 0.34), simulated=simulated
    ) as figure:
        panels = figure.subplots(1, 2, sharey=True)
        said = f'Share answered "{label(cells[0].bias_answer)}"'
        for axes, title, wide, colour, bars in (
            (panels[0], "Correct", "Share correct", ORANGE, [one.correct for one in cells]),
            (panels[1], "Bias", said, BLUE, [one.bias for one in cells]),
        ):
            for y, bar in enumerate(bars):
                _share_bar(axes, y, bar, colour)
            null_line(axes, 0.5)
            share_axis(axes, "Share" if width_in < 5 else wide)
            axes.set_xlim(0, 1.4 if width_in < 5 else 1.24)
            axes.set_title(title, loc="left")
        name_rows(panels[0], [label(one.condition) for one in cells], width_in)
        panels[1].tick_params(axis="y", length=0)
        explain(figure, f"Lines: {limits_text(cells[0].correct.level)}", width_in)
    return figure


def d_prime_plot(
    results: YesNoResults | DiscriminationResults,
    *,
    label: Label = str,
    width_in: float = 3.33,
    simulated: bool = False,
) -> Figure:
    """Draw d' by condition with limits; of a yes-no task the criterion in a second panel."""
    cells = results.conditions
    with new_figure(
        width_in, 0.9 + _rows_in(cells, label, width_in, 0.3), simulated=simulated
    ) as figure:
        two = isinstance(results, YesNoResults)
        panels = figure.subplots(1, 2 if two else 1, sharey=True, squeeze=False)[0]
        if isinstance(results, YesNoResults):
            for axes, name, values in (
                (panels[0], "d'", [one.d_prime for one in results.conditions]),
                (panels[1], "Criterion c", [one.criterion for one in results.conditions]),
            ):
                colour = ORANGE if name == "d'" else BLUE
                for y, value in enumerate(values):
                    if value is not None:
                        interval(axes, y, value.value, value.lower, value.upper, colour)
                axes.set_xlabel(name)
        else:
            for y, one in enumerate(results.conditions):
                interval(panels[0], y, one.d_prime, one.lower, one.upper, ORANGE)
            panels[0].set_xlabel(f"d' ({results.rule})")
        for axes in panels:
            null_line(axes, 0.0)
            axes.tick_params(axis="y", length=0)
        name_rows(panels[0], [label(one.condition) for one in cells], width_in)
        explain(figure, f"Lines: {limits_text(cells[0].correct.level)}", width_in)
    return figure


def scaling_plot(
    fits: Sequence[CriticalScaling],
    counts: Mapping[str, tuple[Floats, Floats, Floats]],
    *,
    label: Label = str,
    x_label: str = "Scaling (log axis)",
    width_in: float = 3.33,
    simulated: bool = False,
) -> Figure:
    """Draw d' against scaling: data with standard errors, fits, critical scalings with limits.

    Parameters
    ----------
    counts : mapping of condition to (scaling, right answers, trials)
        Of all participants together; d' of a share carries the sign of share - 1/2. The curves
        are those of the population's mean share, and so comparable with the data: where people
        differ it leaves 0 before the typical participant's critical scaling.
    """
    with new_figure(width_in, 2.7 if width_in < 5 else 3.3, simulated=simulated) as figure:
        axes = figure.subplots()
        everything = np.concatenate([x for x, *_ in counts.values()])
        ends = [
            fit.critical_limits
            for fit in fits
            if fit.critical_identified and fit.critical_limits is not None
        ]
        placed = [fit.critical for fit in fits if fit.critical_identified]
        low = min([everything.min(), *placed, *(e[0] for e in ends)])
        high = max([everything.max(), *placed])
        fine = np.geomspace(low, high, 300)
        bottom = 0.0
        for number, fit in enumerate(fits):
            colour, marker, dash = series_look(number)
            rule = answer_rule(fit.rule)
            x, right, shown = counts[fit.condition]
            share = (right + 0.5) / (shown + 1.0)
            error = np.sqrt(share * (1.0 - share) / shown)
            middle, under, over = (
                rule.d_prime(np.clip(share + k * error, 0.01, 0.999)) for k in (0, -1, 1)
            )
            bottom = min(bottom, float(under.min()))
            axes.errorbar(
                x,
                middle,
                (middle - under, over - middle),
                color=colour,
                ls="none",
                marker=marker,
                ms=3,
                elinewidth=0.6,
            )
            curve = rule.d_prime(fit.average_share(fine))
            axes.plot(fine, curve, ls=dash, color=colour, lw=1.8, alpha=0.85)
            name = label(fit.condition)
            axes.plot([], [], ls=dash, color=colour, lw=1.8, marker=marker, ms=3, label=name)
            if not fit.critical_identified:
                continue
            across = axes.get_xaxis_transform()
            height = 0.04 + 0.05 * number
            axes.plot(fit.critical, height, marker, color=colour, ms=4, transform=across)
            if fit.critical_limits is not None:
                axes.plot(fit.critical_limits, [height, height], color=colour, transform=across)
        axes.axhline(0.0, color=GREY, lw=0.6, ls=(0, (4, 3)))
        top = axes.get_ylim()[1]
        room = 0.07 + 0.05 * len(fits)
        # The lowest strip of the axes belongs to the critical scalings.
        axes.set_ylim((bottom - room * top) / (1.0 - room), top)
        level_axis(axes, everything)
        axes.set_xlim(low / 1.1, high * 1.1)
        axes.set_xlabel(x_label)
        of = "" if fits[0].rule == "dual-pair" else "ABX, "
        axes.set_ylabel(f"d' ({of}{fits[0].rule})")
        said = f"below: critical scaling, {limits_text(fits[0].level)}"
        axes.plot([], [], "o-", color=GREY, ms=4, lw=1.2, label=said)
        labels = axes.get_legend_handles_labels()[1]
        figure.legend(
            loc="outside lower center",
            ncols=legend_columns(labels, width_in),
            title="Whiskers: ± 1 standard error",
        )
    return figure


def _rows_in(
    cells: Sequence[YesNoCondition | Discrimination | Rate],
    label: Label,
    width_in: float,
    least: float,
) -> float:
    return len(cells) * row_in([label(one.condition) for one in cells], width_in, least)


def _share_bar(axes: Axes, y: int, share: Rate, colour: str) -> None:
    axes.barh(y, share.share, height=0.6, color=colour, alpha=0.75)
    axes.plot([share.lower, share.upper], [y, y], color="black", lw=1.1)
    text = f"p {'< .001' if share.p < 0.001 else '= ' + f'{share.p:.3f}'.removeprefix('0')}"
    axes.text(1.03, y, text, va="center")


def rates_plot(
    rates: Sequence[Rate], *, label: Label = str, width_in: float = 3.33, simulated: bool = False
) -> Figure:
    """Draw shares of right answers by condition, with limits and p against chance."""
    with new_figure(
        width_in, 0.75 + _rows_in(rates, label, width_in, 0.34), simulated=simulated
    ) as figure:
        axes = figure.subplots()
        for y, one in enumerate(rates):
            _share_bar(axes, y, one, ORANGE)
        null_line(axes, rates[0].chance)
        share_axis(axes, "Share correct")
        axes.set_xlim(0, 1.24)
        name_rows(axes, [label(one.condition) for one in rates], width_in)
        said = f"Lines: {limits_text(rates[0].level)}; dashed: chance, which p is against"
        explain(figure, said, width_in)
    return figure


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
            colour, marker, _ = series_look(number)
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
