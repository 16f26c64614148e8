"""Critical scaling: how much may change before an ABX observer can tell."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar

import pandas as pd

from analysis.models.contrasts import Difference
from analysis.models.critical_scaling import CriticalModel, CriticalScaling, critical_scalings
from analysis.parts import Estimate, PartFigure, Presentation, SimplePart
from analysis.parts.levels import SECTION, TRUST, Counts, counts_in, levels_axis
from analysis.parts.shared import (
    apa_difference,
    condition,
    difference_estimates,
    difference_table,
    difference_tables,
    in_order,
    law_of_mixed,
    like_these,
)
from analysis.plans.rate_plan import RatePlan, baseline_in
from analysis.plots import scaling_plot
from analysis.report.result_table import ResultColumn, ResultTable, attribute
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
from protocols.blocks import Block, Box, Cautions, FigurePlace, Heading, Paragraph, TableBlock
from protocols.errors import count_of


@dataclass(frozen=True)
class CriticalScalings(CriticalModel):
    """Every number; `counts` as d' of all answers is drawn beside the fits."""

    counts: Mapping[str, Counts] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


class CriticalPart(SimplePart[RatePlan, CriticalScalings]):
    """The largest scaling that cannot be told apart, of ABX and which-half."""

    name: ClassVar[str] = "critical"
    section: ClassVar[tuple[str, str]] = SECTION

    def wanted(self, _table: pd.DataFrame, plan: RatePlan) -> bool:
        """Return True if there is a level along which answers get better."""
        return plan.by_scaling

    def of(self, table: pd.DataFrame, plan: RatePlan) -> CriticalScalings:
        """Fit every condition."""
        column = str(plan.level)
        if (pd.to_numeric(table[column]) <= 0).any():
            raise ValueError(f"{column} is not positive everywhere")
        found = critical_scalings(
            table,
            plan.compared,
            column=column,
            rule=plan.rule,
            reference=baseline_in(table, plan),
            level=plan.confidence,
        )
        ordered = replace(
            found,
            fits=in_order(found.fits, plan, lambda one: one.condition),
            contrasts=in_order(found.contrasts, plan, lambda one: one.first),
        )
        names = [one.condition for one in ordered.fits if not one.critical_identified]
        notes = (f"critical {column} of {', '.join(names)}: {NOT_IDENTIFIED}; not compared",)
        return CriticalScalings(
            **vars(ordered), counts=counts_in(table, plan), notes=notes * bool(names)
        )

    def estimates(self, found: CriticalScalings, plan: RatePlan) -> Sequence[Estimate]:
        """Return differences of ln s_c."""
        trials = {one.condition: one.trials for one in found.fits}
        return difference_estimates(found.contrasts, trials, plan)

    def show(self, found: CriticalScalings, plan: RatePlan) -> Presentation:
        """Return critical scalings and gains, differences, each scene's and each participant's."""
        fits, whom = found.fits, like_these(scenes=_over_scenes(found))
        who, alone = "the typical participant", _alone(found)
        if alone:
            who, whom = "the participant", "this person, with these pictures"
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
            f" (curves); below, critical scalings of {who} with"
            f" {plan.limits} of {whom}, where these data identify them."
        )
        compared = tuple(apa_difference(one, plan) for one in found.contrasts)
        return Presentation(
            lead=_lead(found, plan, f"{who} has d' = 0; {level_text(plan.confidence)} of {whom}"),
            headline=" ".join((f"Critical {plan.level}:", *_said(found, plan), *compared)),
            blocks=(
                Heading("Critical scaling"),
                FigurePlace("scaling"),
                table.block(),
                Paragraph(
                    f"Of {who}. d' is 0 up to the critical scaling s and rises"
                    f" towards the gain above it. Limits speak of {whom}.",
                    muted=True,
                ),
                *difference_tables(
                    "Differences of the logarithm of critical scalings, in one model of all;"
                    f" of {whom}",
                    found.contrasts,
                    plan,
                ),
                *_scenes(fits, plan),
                *(() if alone else _people(fits, plan)),
                Cautions.each(TRUST, fits, lambda one: plan.label(one.condition)),
            ),
            sentences=(*map(apa_critical, fits), *compared),
            methods=_METHOD_ALONE
            if alone
            else (
                "Critical scalings of all conditions were fitted to the answers in one model, with"
                " critical scaling random over participants"
                f"{' and scenes' * _over_scenes(found)}, also within conditions, and gain random"
                " over participants. Differences are those of its means of ln s_c; limits and"
                f" tests are {law_of_mixed(scenes=_over_scenes(found))}."
            ),
            tables={
                "critical.csv": table.every_field(),
                "critical_scenes.csv": _scene_lines(fits),
                "critical_differences.csv": difference_table(found.contrasts, plan).every_field(
                    kind=Difference
                ),
            },
            figures=(PartFigure("scaling", caption, draw),),
        )


def _over_scenes(found: CriticalScalings) -> bool:
    return any(one.scenes for one in found.fits)


_METHOD_ALONE = (
    "Critical scaling and gain of the participant are medians of their posterior, and limits its"
    " quantiles, given the answers in each condition; lapse rates are summed over their prior."
)
_SIDES = {
    "above": "where two such pictures are told apart",
    "below": "where two such pictures look alike",
    "within": "so that it stays open whether two such pictures are told apart",
}


def _alone(found: CriticalScalings) -> bool:
    """Return True if a single participant took part."""
    return len({who for one in found.fits for who in one.individual}) == 1


def _said(found: CriticalScalings, plan: RatePlan) -> list[str]:
    """Return a sentence on each critical scaling; on one that is not known, of one person alone."""
    told, alone = [], _alone(found)
    for one in found.fits:
        ends, label, side = one.critical_limits, plan.label(one.condition), ""
        if plan.claimed_level is not None and ends is not None:
            low, high = (plan.claimed_level > end for end in ends)
            side = "above" if high else "within" if low else "below"
            side = f"; {size(plan.claimed_level)} lies {side}, {_SIDES[side]}"
        if alone:
            whose = "Your" if plan.planned_participants == 1 else "The participant's"
            label = f"{whose} s_c" + f" ({label})" * (len(found.fits) > 1)
        if one.critical_identified:
            verb = " is" if alone else ":"
            told.append(
                f"{label}{verb} {size(one.critical, within=ends)} {size_range(ends)}{side}."
            )
        elif alone and ends is not None:
            shown = found.counts[one.condition].arrays[0]
            open_above = not math.isfinite(ends[1])
            told.append(
                f"No number can be given for {label[:1].lower()}{label[1:]}: even at the"
                f" {'largest' if open_above else 'smallest'} {plan.level} shown,"
                f" {size(shown.max() if open_above else shown.min())}, the answers"
                f" {'may be guesses' if open_above else 'may be better than guesses'}"
                f"{side * ('within' not in side)}."
            )
    return told


def _lead(found: CriticalScalings, plan: RatePlan, whom: str) -> tuple[Block, ...]:
    said = _said(found, plan)
    return (Box(f"Critical {plan.level}", " ".join(said), f"Up to it {whom}."),) if said else ()


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
        known("of scenes", "", "critical", lambda one: number(one.scene_sd)),
        attribute("Lapse rate", "lapse", share),
    )


def _people(fits: Sequence[CriticalScaling], plan: RatePlan) -> tuple[Block, ...]:
    who = sorted({who for one in fits for who in one.individual})
    return (
        _each("Participant", "Participants' critical scalings", who, _own, fits, plan),
        Paragraph(
            "Each is drawn towards the typical one as far as the participant's answers leave open.",
            muted=True,
        ),
    )


def _scenes(fits: Sequence[CriticalScaling], plan: RatePlan) -> tuple[Block, ...]:
    scenes = sorted({scene for one in fits for scene in one.scenes})
    if not scenes:
        return ()
    return (
        _each("Scene", f"Critical scalings by scene, {plan.limits}", scenes, _there, fits, plan),
        Paragraph(
            "Of the typical participant at this scene, drawn towards the typical scene as far as"
            " its answers leave open; limits speak of people like these.",
            muted=True,
        ),
    )


def _each(
    title: str,
    caption: str,
    names: Sequence[str],
    text: Callable[[CriticalScaling, str], str],
    fits: Sequence[CriticalScaling],
    plan: RatePlan,
) -> TableBlock:
    """Return a table of people or of scenes, by condition."""
    columns = [ResultColumn(plan.label(one.condition), "n", partial(text, one)) for one in fits]
    return ResultTable(caption, names, (ResultColumn[str](title, "l", str), *columns)).block()


def _own(one: CriticalScaling, who: str) -> str:
    if who not in one.individual or not one.critical_identified:
        return NONE
    return size(one.individual[who][0], within=one.critical_limits)


def _there(one: CriticalScaling, scene: str) -> str:
    if scene not in one.scenes or not one.critical_identified:
        return NONE
    value, *ends = one.scenes[scene]
    return f"{size(value, within=(ends[0], ends[1]))} {size_range((ends[0], ends[1]))}"


def _scene_lines(fits: Sequence[CriticalScaling]) -> pd.DataFrame:
    """Return critical scalings of scenes, one a row; none that is not identified."""
    lines = [
        {"condition": one.condition, "scene": scene, "critical": value, "lower": low, "upper": high}
        for one in fits
        if one.critical_identified
        for scene, (value, low, high) in one.scenes.items()
    ]
    return pd.DataFrame(lines, columns=["condition", "scene", "critical", "lower", "upper"])


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
        ("ln s_c over scenes", fit.scene_sd, fit.critical_identified and fit.scene_sd > 0.0),
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
