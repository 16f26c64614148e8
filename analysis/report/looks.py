"""At which planned look a study stands."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from analysis.parts import Estimate
from analysis.plots import sized
from analysis.plots.sequential import bounds_plot
from analysis.report.beside import estimates_of
from analysis.report.blocks import Block, Box, Paragraph, Picture, ReportFigure, Table
from analysis.report.source import Source
from analysis.report.wording import number_range, placed
from analysis.sequential import SequentialPlan, Standing, plan_of, standing

LEAST = 1e-9
"""Of a bound: limits that leave out less than that are all that can be."""


@dataclass(frozen=True)
class Look:
    """The plan, and where these data stand in it.

    `limits` are those of the planned comparisons that hold at every look: they invert the test at
    the look's own bound (repeated confidence intervals, Jennison and Turnbull 1989), so that they
    leave out the null exactly where the look stops. None where no look is planned, or the rule
    promises no error.
    """

    plan: SequentialPlan
    standing: Standing
    limits: tuple[Estimate, ...] = ()


def look_of(source: Source, planned_p: float | None) -> Look | None:
    """Return where the study stands; None where it plans no looks, or there is no protocol."""
    protocol = source.protocol
    if protocol is None or protocol.analysis.sequential is None:
        return None
    plan = plan_of(protocol.analysis.sequential, protocol.analysis.alpha)
    people = int(source.decisions["participant"].nunique())
    now = standing(plan, people, planned_p, source.analysis.least_p(protocol, people))
    if now.reject_p is None or now.reject_p < LEAST or plan.rule == "bayes-factor":
        return Look(plan, now)
    settings: Any = source.settings
    at_bound = replace(settings, alpha=now.reject_p)
    return Look(plan, now, estimates_of(source.analysis, source.decisions, at_bound, planned=True))


def look_figures(found: Look | None, *, simulated: bool) -> Sequence[ReportFigure]:
    """Return the figure of the bounds; none where no looks are planned."""
    if found is None:
        return ()
    stands = found.standing
    return (
        ReportFigure(
            "looks",
            f"p at which each planned look stops the study ({found.plan.rule}); dashed: alpha"
            " without looks; star: this study.",
            sized(
                bounds_plot,
                found.plan,
                people=stands.participants,
                p=stands.p,
                simulated=simulated,
            ),
        ),
    )


def looks_blocks(found: Look | None) -> Sequence[Block]:
    """Return what to read before any p of the page."""
    if found is None:
        return ()
    blocks: list[Block] = [
        Box(
            f"Planned looks: {found.standing.verdict}",
            found.standing.sentence,
            "Other limits and p of this page take no account of looks: until the study has ended,"
            " they decide nothing.",
        ),
        Picture("looks"),
    ]
    if found.limits:
        level = 100.0 * (1.0 - (found.standing.reject_p or 0.0))
        blocks += [
            Table.each(
                "Limits that take account of the looks",
                found.limits,
                ("Of", "l c", lambda one: one.what),
                ("Value", "strong", lambda one: placed(one, one.value)),
                ("Limits", "n", lambda one: number_range(one.lower, one.upper)),
            ),
            Paragraph(
                f"They invert the test at this look's bound ({level:.5g} % at this look), and hold"
                f" at all looks together with {100 * (1 - found.plan.alpha):g} % or more, whether"
                " or not the study stops here (Jennison & Turnbull 1989).",
                muted=True,
            ),
        ]
    return blocks
