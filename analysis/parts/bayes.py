"""Preferences as posteriors: how probable each is, and what the prior does to it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import pandas as pd

from analysis.models.preference_posterior import PRIORS, BayesianPreference, bayesian_preference
from analysis.parts import PartFigure, Presentation, SimplePart, tried
from analysis.plans.preference_plan import PreferencePlan
from analysis.plots.style import (
    BLUE,
    GREY,
    LIGHT,
    Figure,
    explain,
    limits_text,
    name_rows,
    new_figure,
    null_line,
    share_axis,
)
from analysis.report.wording import NONE, NOT_IDENTIFIED, leading, share, share_range
from protocols.blocks import Cautions, FigurePlace, Paragraph, TableBlock, grouped
from protocols.prose import count_of


@dataclass(frozen=True)
class Posteriors:
    """Every number, pair by pair."""

    comparisons: tuple[BayesianPreference, ...]
    notes: tuple[str, ...]


class BayesPart(SimplePart[PreferencePlan, Posteriors]):
    """Posteriors of every pairing, all sizes together."""

    name: ClassVar[str] = "bayes"
    section: ClassVar[tuple[str, str]] = ("bayes", "Posteriors")

    def wanted(self, _table: pd.DataFrame, plan: PreferencePlan) -> bool:
        """Return True if the plan asks for them: sampling takes seconds a pair."""
        return plan.bayes

    def of(self, table: pd.DataFrame, plan: PreferencePlan) -> Posteriors:
        """Sample each pairing."""
        notes: list[str] = []
        found = [
            tried(
                partial(
                    bayesian_preference, table, *pair, margin=plan.margin, level=plan.confidence
                ),
                f"posterior of {' over '.join(map(plan.label, pair))}",
                notes,
            )
            for pair in plan.pairings
        ]
        if not any(found):
            raise ValueError("; ".join(notes))
        return Posteriors(tuple(one for one in found if one is not None), tuple(notes))

    def show(self, found: Posteriors, plan: PreferencePlan) -> Presentation:
        """Return shares with credible limits under each prior, and the verdicts."""
        every, name = found.comparisons, partial(_over, label=plan.label)
        limits = f"{100 * plan.confidence:g} % credible limits"
        within = f"within {share(plan.margin)} of .5"
        prior, *others = PRIORS.items()

        def known(one: BayesianPreference, text: str) -> str:
            return NONE if one.unidentified else text

        caption = (
            f"Shares of choices with {limits}; thick: the {prior[0]} prior, thin:"
            f" {' and '.join(other for other, _ in others)} ones. Grey band: practically equal."
        )
        lines = [
            {"method": one.method, "against": one.against, "prior": check.prior}
            | {"share": check.share.median, "lower": check.share.lower, "upper": check.share.upper}
            | {"in_rope": check.in_rope, "verdict": check.verdict}
            for one in every
            for check in one.sensitivity
            if not one.unidentified
        ]
        return Presentation(
            blocks=(
                FigurePlace("posteriors"),
                TableBlock.each(
                    "Posterior shares of choices" + " over all sizes" * plan.sized,
                    every,
                    ("Comparison", "l c", name),
                    ("Share", "strong", lambda one: known(one, share(one.share.median))),
                    (
                        limits,
                        "n",
                        lambda one: known(one, share_range(one.share.lower, one.share.upper)),
                    ),
                    ("P(share > .5)", "", lambda one: known(one, leading(f"{one.better:.3f}"))),
                    (f"P({within})", "", lambda one: known(one, leading(f"{one.in_rope:.3f}"))),
                    ("Verdict", "l", lambda one: known(one, one.verdict)),
                ),
                Paragraph(
                    f"P: probability of such a share. Verdict: whether the limits lie {within}"
                    " (practically equal), beyond it, or across its edge (undecided).",
                    muted=True,
                ),
                Cautions(
                    "When not to trust these posteriors",
                    grouped([(name(one), one.warnings) for one in every]),
                ),
            ),
            sentences=[apa_bayes(one, plan.label) for one in every],
            methods=(
                "Posteriors of shares of choices are of a hierarchical logit model with"
                " participants and scenes as random (NUTS, Hoffman & Gelman, 2014), with a normal"
                f" prior of SD {prior[1].typical_sd:g} on the typical choice and half-normal ones"
                f" of SD {prior[1].spread_sd:g} on deviations; {len(others)} other priors stand"
                f" beside. Their {limits} were compared with a region of practical equivalence,"
                f" {within} (Kruschke, 2018)."
            ),
            tables={"posteriors.csv": pd.DataFrame(lines)},
            figures=(PartFigure("posteriors", caption, partial(_figure, every, name=name)),),
        )


def _over(one: BayesianPreference, label: Callable[[str], str] = str) -> str:
    return f"{label(one.method)} over {label(one.against)}"


def apa_bayes(one: BayesianPreference, label: Callable[[str], str] = str) -> str:
    """Return a posterior as a sentence."""
    method, against = label(one.method), label(one.against)
    if one.unidentified:
        return f"How often {method} is chosen over {against} is {NOT_IDENTIFIED}."
    others = "; ".join(
        f"{check.prior} prior {share(check.share.median)}"
        f" {share_range(check.share.lower, check.share.upper)}"
        for check in one.sensitivity[1:]
    )
    return (
        f"{method} was chosen over {against} with a share of {share(one.share.median)},"
        f" {100 * one.level:g}% credible {share_range(one.share.lower, one.share.upper)}"
        f" (hierarchical logit model, {count_of(one.participants, 'participant')}"
        f"{f', {one.scenes} scenes' * (one.scenes > 1)});"
        f" P(share > .50) = {leading(f'{one.better:.3f}')}, P(within {leading(f'{one.margin:g}')}"
        f" of .50) = {leading(f'{one.in_rope:.3f}')}: {one.verdict} ({others})."
    )


def _figure(
    found: tuple[BayesianPreference, ...],
    *,
    name: Callable[[BayesianPreference], str],
    width_in: float,
    simulated: bool,
) -> Figure:
    """Draw shares with limits, thick the default prior, thin the others; the ROPE is grey."""
    with new_figure(width_in, 0.8 + 0.45 * len(found), simulated=simulated) as figure:
        axes = figure.subplots()
        axes.axvspan(0.5 - found[0].margin, 0.5 + found[0].margin, color=LIGHT, lw=0)
        for y, one in enumerate(found):
            for place, check in enumerate(() if one.unidentified else one.sensitivity):
                colour, wide = (BLUE, 1.6) if place == 0 else (GREY, 0.8)
                at = y + 0.18 * place
                axes.plot([check.share.lower, check.share.upper], [at, at], color=colour, lw=wide)
                axes.plot(check.share.median, at, "o", color=colour, ms=4 if place == 0 else 2.5)
        null_line(axes, 0.5)
        name_rows(axes, [name(one) for one in found], width_in)
        share_axis(axes, "Share of choices")
        said = f"Lines: credible {limits_text(found[0].level)}; thick: default prior, thin: others"
        explain(figure, f"{said}; band: practically equal", width_in)
    return figure
