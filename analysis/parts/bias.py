"""Order and side bias: is the first interval, or one key, chosen too often?"""

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import pandas as pd

from analysis.models.order_and_side import Bias, came_both_ways, has_sides, order_bias, side_bias
from analysis.parts import PartFigure, Presentation, SimplePart
from analysis.parts.shared import SIGN_FLIP
from analysis.plans.preference_plan import PreferencePlan
from analysis.plots import bias_bars
from analysis.report.result_table import ResultTable, attribute, deciding, limits, p_value
from analysis.report.wording import level_text, p_text, share, share_range
from protocols.blocks import Cautions, FigurePlace


@dataclass(frozen=True)
class Biases:
    """Every number; one is None where nothing tells it from what was preferred."""

    order: Bias | None
    side: Bias | None
    notes: tuple[str, ...] = ()


class BiasPart(SimplePart[PreferencePlan, Biases]):
    """Shares of the first interval and of the left key, whatever they showed."""

    name: ClassVar[str] = "bias"
    section: ClassVar[tuple[str, str]] = ("checks", "Order, learning, speed")

    def wanted(self, table: pd.DataFrame, plan: PreferencePlan) -> bool:
        """Return True if orders or sides can be told."""
        return super().wanted(table, plan) and (came_both_ways(table) or has_sides(table))

    def of(self, table: pd.DataFrame, plan: PreferencePlan) -> Biases:
        """Return both."""
        order = order_bias(table, alpha=plan.alpha) if came_both_ways(table) else None
        return Biases(order, side_bias(table, alpha=plan.alpha))

    def show(self, found: Biases, plan: PreferencePlan) -> Presentation:
        """Return the figure, a table, and each as a sentence."""
        biases = [one for one in (found.order, found.side) if one is not None]
        caption = (
            f"Share of choices of the first interval and of the left key, with {plan.limits};"
            " dots: participants."
        )
        table = ResultTable.of(
            "Order and side bias, against .5",
            biases,
            attribute("Alternative", "alternative", str, "l"),
            attribute("Trials", "trials", str),
            attribute("Share", "share", share),
            limits(text=share_range),
            deciding(),
            p_value("Sign-flip p", "sign_flip_p"),
        )
        return Presentation(
            blocks=(
                FigurePlace("bias"),
                table.block(),
                Cautions.each("About these shares", biases, lambda b: b.alternative),
            ),
            others=(table.folded("Sign-flip test of order and side", SIGN_FLIP),),
            sentences=tuple(
                f"The {b.alternative} was picked in {share(b.share)} of {b.trials} trials,"
                f" {level_text(plan.confidence)} {share_range(b.lower, b.upper)}, {p_text(b.p)}."
                for b in biases
            ),
            methods=(
                f"Choices of {' and '.join(f'the {b.alternative}' for b in biases)} were compared"
                " with .5 by a score t test clustered by participant and by scene."
            ),
            tables={"bias.csv": table.every_field("by_participant", "extreme")},
            figures=(
                PartFigure("bias", caption, partial(bias_bars, biases, level=plan.confidence)),
            ),
        )
