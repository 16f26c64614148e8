"""The bounds of planned looks, and where a study stands among them."""

import numpy as np

from analysis.models.sequential_bounds import SequentialPlan
from analysis.plots.style import BLUE, GREY, ORANGE, Figure, explain, new_figure
from analysis.report.wording import leading

LEAST_SHOWN = 1e-6
"""A bound of p below is drawn at the edge: no look of so few people stops there."""


def bounds_plot(
    plan: SequentialPlan,
    *,
    people: int | None = None,
    p: float | None = None,
    width_in: float = 3.33,
    simulated: bool = False,
) -> Figure:
    """Draw at which p each look stops the study, and the study's own p, if there is one.

    The axis of p is logarithmic, smaller above. `people` is how many took part so far.
    """
    with new_figure(width_in, 2.4, simulated=simulated) as figure:
        axes = figure.subplots()
        reject = [max(bound, LEAST_SHOWN) for bound in plan.reject_p]
        axes.plot(plan.looks, reject, "o-", color=BLUE, ms=4, label="significant")
        shown = [
            (look, bound)
            for look, bound in zip(plan.looks, plan.accept_p, strict=True)
            if bound is not None
        ]
        if shown:
            axes.plot(*zip(*shown, strict=True), "s-", color=ORANGE, ms=4, label="no difference")
        axes.axhline(plan.alpha, color=GREY, lw=0.8, ls=(0, (4, 3)))
        if p is not None and people is not None:
            axes.plot(
                people, max(p, LEAST_SHOWN), "*", color="black", ms=9, label="this study", zorder=5
            )
        axes.set_yscale("log")
        axes.set_ylim(1.3, LEAST_SHOWN / 1.3 if min(reject) == LEAST_SHOWN else min(reject) / 3.0)
        # The formatter of logarithmic axes writes formulas, which the house style does not set.
        axes.yaxis.set_major_formatter(
            lambda value, _: leading(np.format_float_positional(value, 9, trim="-"))
        )
        axes.set_xticks(plan.looks)
        axes.set_xlim(0, max(plan.looks[-1], people or 0) * 1.05)
        axes.set_xlabel("Participants")
        axes.set_ylabel("p")
        axes.legend(loc="best")
        explain(figure, f"Dashed: alpha = {leading(f'{plan.alpha:g}')}", width_in)
    return figure
