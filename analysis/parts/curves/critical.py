"""Critical scaling: how much may change before an ABX observer can tell."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import pandas as pd

from analysis.models.contrasts import Difference
from analysis.models.critical_scaling import CriticalScaling, critical_scalings
from analysis.parts import PartFigure, Presentation, SimplePart
from analysis.parts.levels import SECTION, TRUST, Counts, counts_in, levels_axis
from analysis.parts.shared import condition, difference_tables, in_order
from analysis.plans.rate_plan import RatePlan
from analysis.plots import scaling_plot
from analysis.report.result_table import ResultColumn, ResultTable, attribute
from analysis.report.values import frame_of
from analysis.report.wording import (
    NONE,
    NOT_IDENTIFIED,
    leading,
    level_text,
    number,
    share,
    size,
    size_range,
)
from protocols.blocks import Block, Box, Cautions, FigurePlace, Heading, Paragraph
from protocols.errors import count_of


@dataclass(frozen=True)
class CriticalScalings:
    """Every number; `counts` as d' of all answers is drawn beside the fits."""

    fits: tuple[CriticalScaling, ...]
    contrasts: tuple[Difference, ...]
    counts: Mapping[str, Counts]
    notes: tuple[str, ...] = ()


class CriticalPart(SimplePart[RatePlan, CriticalScalings]):
    """The largest scaling that cannot be told apart, of ABX and which-half."""

    name: ClassVar[str] = "critical"
    section: ClassVar[tuple[str, str]] = SECTION

    def wanted(self, _table: pd.DataFrame, plan: RatePlan) -> bool:
        """Return True if there is a level along which answers get better."""
        return plan.level is not None and not plan.falling

    def of(self, table: pd.DataFrame, plan: RatePlan) -> CriticalScalings:
        """Fit every condition."""
        column = str(plan.level)
        if (pd.to_numeric(table[column]) <= 0).any():
            raise ValueError(f"{column} is not positive everywhere")
        fits, compared = critical_scalings(
            table, plan.compared, column=column, rule=plan.rule, level=plan.confidence
        )
        ordered = in_order(fits, plan, lambda one: one.condition)
        return CriticalScalings(ordered, compared, counts_in(table, plan))

    def show(self, found: CriticalScalings, plan: RatePlan) -> Presentation:
        """Return critical scalings and gains, differences, and each participant's own."""
        fits = found.fits
        table = _table(fits, plan)
        draw = partial(
            scaling_plot,
            fits,
            {fit.condition: found.counts[fit.condition].arrays for fit in fits},
            label=plan.label,
            x_label=f"{levels_axis(plan)} (log axis)",
        )
        caption = (
            f"d' by {plan.level}: data with standard errors (points), the population's fit"
            " (curves); below, critical scalings of the typical participant with"
            f" {plan.limits}, where these data identify them."
        )
        return Presentation(
            lead=_lead(fits, plan),
            blocks=(
                Heading("Critical scaling"),
                FigurePlace("scaling"),
                table.block(),
                Paragraph(
                    "Of the typical participant. d' is 0 up to the critical scaling s and rises"
                    f" towards the gain above it ({fits[0].law} law).",
                    muted=True,
                ),
                *_people(fits, plan),
                *difference_tables(
                    "Differences of the logarithm of critical scalings, paired over participants",
                    found.contrasts,
                    plan,
                ),
                *((_NOISY,) if found.contrasts else ()),
                Cautions.each(TRUST, fits, lambda one: plan.label(one.condition)),
            ),
            sentences=tuple(map(apa_critical, fits)),
            methods=(
                "Critical scalings were fitted to the answers with critical scaling and gain random"
                " over participants."
            ),
            tables={
                "critical.csv": table.every_field(),
                "critical_differences.csv": frame_of(found.contrasts, Difference),
            },
            figures=(PartFigure("scaling", caption, draw),),
        )


_NOISY = Paragraph(
    "Differences are means of each participant's own fit. With few trials of each these fits are"
    " noisy, and their mean can differ from the typical participant's critical scalings above, even"
    " in sign.",
    muted=True,
)


def _lead(fits: Sequence[CriticalScaling], plan: RatePlan) -> tuple[Block, ...]:
    said = [
        f"{plan.label(one.condition)}: {size(one.critical, within=one.critical_limits)}"
        f" {size_range(one.critical_limits)}."
        for one in fits
        if one.critical_identified
    ]
    told = f"Up to it the typical participant has d' = 0; {level_text(plan.confidence)}."
    return (Box(f"Critical {plan.level}", " ".join(said), told),) if said else ()


def _table(fits: Sequence[CriticalScaling], plan: RatePlan) -> ResultTable[CriticalScaling]:
    def known(
        title: str, style: str, name: str, text: Callable[[CriticalScaling], str], none: str = NONE
    ) -> ResultColumn[CriticalScaling]:
        return ResultColumn(
            title, style, lambda one: none if name in one.unidentified else text(one)
        )

    return ResultTable.of(
        "The largest scaling that cannot be told apart",
        fits,
        condition(plan),
        known(
            "Critical scaling",
            "strong",
            "critical",
            lambda one: size(one.critical, within=one.critical_limits),
            NOT_IDENTIFIED,
        ),
        known("Limits", "n", "critical", lambda one: size_range(one.critical_limits)),
        known(
            "Gain", "", "gain", lambda one: size(one.gain, within=one.gain_limits), NOT_IDENTIFIED
        ),
        known("Limits", "n", "gain", lambda one: size_range(one.gain_limits)),
        known("SD of ln s", "", "critical", lambda one: number(one.critical_sd)),
        attribute("Lapse rate", "lapse", share),
    )


def _people(fits: Sequence[CriticalScaling], plan: RatePlan) -> tuple[Block, ...]:
    def column(one: CriticalScaling) -> ResultColumn[str]:
        return ResultColumn(plan.label(one.condition), "n", partial(_own, one))

    who = sorted({who for one in fits for who in one.individual})
    participant = ResultColumn[str]("Participant", "l", str)
    columns = (participant, *map(column, fits))
    return (
        ResultTable("Participants' critical scalings", who, columns).block(),
        Paragraph(
            "Each is drawn towards the typical one as far as the participant's answers leave open;"
            " in brackets: fitted to these answers alone.",
            muted=True,
        ),
    )


def _own(one: CriticalScaling, who: str) -> str:
    if who not in one.individual or not one.critical_identified:
        return NONE
    ends = one.critical_limits
    alone = f" ({size(one.alone[who], within=ends)})" if who in one.alone else ""
    return f"{size(one.individual[who][0], within=ends)}{alone}"


def apa_critical(fit: CriticalScaling) -> str:
    """Return a critical scaling as a sentence."""

    def quantity(
        name: str, value: float, ends: tuple[float, float] | None, identified: bool
    ) -> str:
        if not identified or ends is None:
            return f"{name} {NOT_IDENTIFIED}"
        return f"{name} = {size(value, within=ends)}, {level_text(fit.level)} {size_range(ends)}"

    spreads = (
        ("ln s_c", fit.critical_sd, fit.critical_identified),
        ("ln gain", fit.gain_sd, fit.gain_identified),
    )
    said = [f"of {name} = {number(sd)}" for name, sd, known in spreads if known]
    deviations = f"; SD {', '.join(said)}" if said else ""
    return (
        f"Critical scaling of condition {fit.condition}"
        f" ({count_of(fit.participants, 'participant')}, ABX by the {fit.rule} rule,"
        " d'² = gain² (1 - s_c²/s²)):"
        f" {quantity('s_c', fit.critical, fit.critical_limits, fit.critical_identified)};"
        f" {quantity('gain', fit.gain, fit.gain_limits, fit.gain_identified)}"
        f"{deviations}; lapse rate {leading(f'{fit.lapse:.3f}')}."
    )
