"""Bradley-Terry strengths of the methods: log odds of being chosen, with limits."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from numpy.random import Generator

from analysis.arrays import Floats
from analysis.models.bootstrap import ScaleIntervals, bootstrap_scale
from analysis.models.compared_methods import as_numbers
from analysis.models.paired.paired_counts import Model
from analysis.models.scaling import Scale, scale
from analysis.parts import Part, PartFigure, Presentation, tried
from analysis.parts.scale import BOOTSTRAP_SAMPLES, vote_tensor
from analysis.parts.shared import adjusted
from analysis.plans.preference_plan import PreferencePlan
from analysis.plots import jod_plot
from analysis.report.wording import big, number, number_range, p_number, p_text
from protocols.blocks import Block, Cautions, FigurePlace, Paragraph, TableBlock, grouped


@dataclass(frozen=True)
class Odds:
    """Odds of choosing the first method over the second; p of even odds, Holm's over the size."""

    size: str
    first: str
    second: str
    odds: float
    lower: float
    upper: float
    p: float
    p_adjusted: float


@dataclass(frozen=True)
class Strengths:
    """Every number: by size, log odds that average zero, and their limits; odds of all pairs."""

    sizes: Mapping[str, tuple[Scale, ScaleIntervals]]
    odds: tuple[Odds, ...]
    notes: tuple[str, ...]


class StrengthsPart(Part[PreferencePlan, Strengths]):
    """Bradley and Terry's model by size, limits by bootstrap over participants and scenes."""

    name: ClassVar[str] = "strengths"
    section: ClassVar[tuple[str, str]] = ("scale", "Scale")

    def wanted(self, table: pd.DataFrame, plan: PreferencePlan) -> bool:
        """Return True if there are three methods: of two the odds ratio says it all."""
        return len(plan.methods) > 2 and table["participant"].nunique() > 1

    def compute(
        self,
        table: pd.DataFrame,
        plan: PreferencePlan,
        _found: Mapping[str, Any],
        chance: Generator,
    ) -> Strengths:
        """Fit the methods of each size that comparisons link."""
        decisions, notes, sizes = (
            as_numbers(table),
            list[str](),
            dict[str, tuple[Scale, ScaleIntervals]](),
        )
        for size in plan.sizes:
            rows, methods = plan.compared_at(decisions, size)
            if len(methods) > 2:
                votes, _ = vote_tensor(rows, methods)
                fit = tried(
                    partial(_fitted, votes, methods, plan.confidence, chance),
                    f"strengths{plan.at(size, ' at {}')}",
                    notes,
                )
                sizes |= {} if fit is None else {size: fit}
        if not sizes:
            raise ValueError("; ".join(notes) or "fewer than three methods were compared")
        odds = tuple(one for size, fit in sizes.items() for one in _odds(size, *fit))
        return Strengths(sizes, odds, tuple(notes))

    def show(self, found: Strengths, plan: PreferencePlan) -> Presentation:
        """Return strengths and odds."""
        level = f"{100 * plan.confidence:g} %"
        caption = f"Log odds of being chosen (Bradley-Terry, mean zero) with {level} limits."
        frames = [
            pd.DataFrame(
                {"size": size, "method": fit.conditions, "log_odds": fit.scores}
                | {name: getattr(limits, name) for name in ("lower", "upper", "standard_error")}
            )
            for size, (fit, limits) in found.sizes.items()
        ]
        table = pd.concat(frames, ignore_index=True)
        return Presentation(
            blocks=tuple(_blocks(found, table.to_dict("records"), plan)),
            sentences=tuple(
                f"The odds of choosing {plan.label(one.first)} over {plan.label(one.second)}"
                f"{plan.at(one.size, ' ({})')} were {big(one.odds)}, {level.replace(' ', '')} CI"
                f" [{big(one.lower)}, {big(one.upper)}], {p_text(one.p)}"
                f"{adjusted(one.p, one.p_adjusted, 'Bradley-Terry, two-way bootstrap')}."
                for one in found.odds
            ),
            methods=(
                "Strengths are log odds by maximum likelihood under Bradley and Terry's model"
                " (1952), with two-way bootstrap intervals over participants and scenes."
            ),
            tables={
                "strengths.csv": table,
                "odds.csv": pd.DataFrame([vars(one) for one in found.odds]),
            },
            figures=(
                PartFigure("strengths", caption, partial(jod_plot, found.sizes, label=plan.label)),
            ),
        )


def _fitted(
    votes: Floats, methods: tuple[str, ...], level: float, chance: Generator
) -> tuple[Scale, ScaleIntervals]:
    model: Model = "bradley-terry"
    fit = scale(votes.sum(axis=(0, 1)), methods, model)
    samples = BOOTSTRAP_SAMPLES
    return fit, bootstrap_scale(votes, rng=chance, samples=samples, level=level, model=model)


def _odds(size: str, fit: Scale, limits: ScaleIntervals) -> Iterator[Odds]:
    for first, second in zip(*np.triu_indices(len(fit.conditions), 1), strict=True):
        gap = fit.scores[first] - fit.scores[second]
        yield Odds(
            size,
            fit.conditions[first],
            fit.conditions[second],
            float(np.exp(gap)),
            float(np.exp(limits.difference_lower[first, second])),
            float(np.exp(limits.difference_upper[first, second])),
            float(limits.difference_p[first, second]),
            float(limits.difference_p_adjusted[first, second]),
        )


def _blocks(found: Strengths, lines: Sequence[Any], plan: PreferencePlan) -> Iterator[Block]:
    label, several = plan.label, [("Size", "l", lambda one: plan.at(one["size"]))] * plan.sized
    yield FigurePlace("strengths")
    yield TableBlock.each(
        "Bradley-Terry strengths, log odds",
        lines,
        ("Method", "l", lambda one: label(one["method"])),
        *several,
        (
            "Log odds",
            "strong",
            lambda one: number(one["log_odds"], within=(one["lower"], one["upper"])),
        ),
        (plan.limits, "n", lambda one: number_range(one["lower"], one["upper"])),
        ("bootstrap SE", "", lambda one: number(one["standard_error"])),
    )
    yield TableBlock.each(
        "Odds of choosing the first; limits and p by bootstrap of participants and scenes",
        found.odds,
        ("Methods", "l", lambda one: plan.named(one.first, one.second, one.size)),
        ("Odds", "strong", lambda one: big(one.odds)),
        (plan.limits, "n", lambda one: f"[{big(one.lower)}, {big(one.upper)}]"),
        ("p", "n", lambda one: p_number(one.p)),
        ("p adj.", "n", lambda one: p_number(one.p_adjusted)),
    )
    yield Paragraph(
        "The same votes as the scale above, by the logistic law in place of the normal one:"
        " strengths are differences of log odds, as in logistic regression.",
        muted=True,
    )
    notes = [
        (plan.at(size), fit.warnings + limits.warnings)
        for size, (fit, limits) in found.sizes.items()
    ]
    yield Cautions("When not to trust these strengths", grouped(notes))
