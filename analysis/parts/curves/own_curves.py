"""Psychometric functions of each person, from that person's answers alone."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import pandas as pd

from analysis.models.cells import conditions
from analysis.models.curves.psychometric_posterior import (
    PsychometricPosterior,
    ThresholdDifference,
    compare_thresholds,
    psychometric_posterior,
)
from analysis.parts import Presentation
from analysis.parts.levels import (
    TRUST,
    Counts,
    LevelsPart,
    PlacedThreshold,
    counts_in,
    counts_of_people,
    people_figure,
    threshold_columns,
)
from analysis.parts.shared import condition
from analysis.plans.rate_plan import RatePlan
from analysis.plots.psychometric_plots import DrawnCurve
from analysis.report.result_table import ResultColumn, ResultTable, attribute
from analysis.report.wording import p_number, size, size_range
from protocols.blocks import Cautions, CopyText, FigurePlace, Folded, Paragraph

MOST_PEOPLE = 12
"""Thresholds of people are compared, all pairs of them, in so small a group at most."""


@dataclass(frozen=True)
class PersonFit:
    """One participant's curve in one condition."""

    participant: str
    condition: str
    fit: PsychometricPosterior

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons not to trust the fit."""
        return self.fit.warnings

    @property
    def known(self) -> bool:
        """True if the answers, and not the prior, place the threshold."""
        return not self.fit.unidentified


@dataclass(frozen=True)
class OwnCurves:
    """Every number.

    Attributes
    ----------
    people : tuple of PersonFit
        Each from that person's answers alone.
    within : mapping of participant to tuple of ThresholdDifference
        Between conditions of one person.
    between : mapping of condition to tuple of ThresholdDifference
        Between people in one condition.
    """

    people: tuple[PersonFit, ...]
    within: Mapping[str, tuple[ThresholdDifference, ...]]
    between: Mapping[str, tuple[ThresholdDifference, ...]]
    notes: tuple[str, ...]
    counts: Mapping[str, Mapping[str, Counts]] = field(repr=False)


class OwnCurvesPart(LevelsPart[OwnCurves]):
    """Psychometric functions of each person, by their posterior; thresholds compared.

    `instead`: only where one person took part, and so no population can be told.
    """

    name: ClassVar[str] = "psychometric"

    def __init__(self, *, instead: bool = False) -> None:
        self._instead = instead

    def wanted(self, table: pd.DataFrame, plan: RatePlan) -> bool:
        """Return True if there is a level, and, where `instead`, nobody else for a population."""
        return super().wanted(table, plan) and not (
            self._instead and table["participant"].nunique() > 1
        )

    def of(self, table: pd.DataFrame, plan: RatePlan) -> OwnCurves:
        """Fit each person in each condition, and compare what the answers place."""
        notes, people = list[str](), list[PersonFit]()
        form = replace(plan.curve, shape="gumbel") if plan.shape == "weibull" else plan.curve
        for name, rows in conditions(table, plan.compared):
            for who, part in rows.groupby("participant", sort=True):
                ((_, counts),) = counts_in(part, plan).items()
                if len(counts.levels) < 2:
                    notes.append(f"{who}, {name}: shown at one level only; no curve")
                    continue
                fit = psychometric_posterior(*counts.arrays, form, level=plan.confidence)
                people.append(PersonFit(str(who), name, fit))
        within: dict[str, dict[str, PsychometricPosterior]] = {}
        between: dict[str, dict[str, PsychometricPosterior]] = {}
        for one in people:
            if one.known:
                within.setdefault(one.participant, {})[one.condition] = one.fit
                between.setdefault(one.condition, {})[one.participant] = one.fit
        for name, fits in between.items():
            if len(fits) > MOST_PEOPLE:
                notes.append(f"{len(fits)} people: not compared with each other, one by one")
                between[name] = {}
        return OwnCurves(
            people=tuple(people),
            within=_compared(within),
            between=_compared(between),
            notes=tuple(notes),
            counts=counts_of_people(table, plan),
        )

    def show(self, found: OwnCurves, plan: RatePlan) -> Presentation:
        """Return each person's curve in a row, and what differs within people."""
        curves = {
            (one.participant, one.condition): DrawnCurve(
                one.fit, threshold=(place.value, place.lower, place.upper)
            )
            for one in found.people
            if one.known
            for place in [one.fit.threshold]
        }
        table = _table(found, plan)
        several = ", Holm-adjusted" * any(len(one) > 1 for one in found.within.values())
        said, alone = tuple(_sentences(found, plan)), len(found.counts) == 1
        return Presentation(
            title=self.title(plan),
            blocks=(
                FigurePlace("own_curves"),
                table.block(),
                Paragraph(
                    "Medians of a posterior with priors on lapses, guesses and on answers that vary"
                    " more than chance (Schütt et al., 2016). Limits speak of that participant's"
                    " curve alone. Spread: how far the true share at a level strays.",
                    muted=True,
                ),
                Cautions.each(
                    TRUST,
                    found.people,
                    lambda one: f"{one.participant}, {plan.label(one.condition)}",
                ),
            ),
            others=(
                Folded(
                    "Each participant's conditions, compared",
                    "They speak of one person's answers each; the population's thresholds speak of"
                    " people like these.",
                    (CopyText(said),),
                ),
            )
            * (bool(said) and not alone),
            headline=" ".join(said) * alone,
            sentences=said * alone,
            methods=(
                "Each participant's psychometric function is the median of a posterior with priors"
                " on lapses, guesses and overdispersion (Schütt, Harmeling, Macke & Wichmann,"
                f" 2016); thresholds are compared by their posteriors{several}."
            ),
            figures=(
                people_figure(
                    "own_curves", "curves from these answers alone", found.counts, curves, plan
                ),
            ),
            tables={"people.csv": table.frame(), "comparisons_of_people.csv": _comparisons(found)},
        )


def _table(found: OwnCurves, plan: RatePlan) -> ResultTable[PersonFit]:
    def place_of(one: PersonFit) -> PlacedThreshold:
        place = one.fit.threshold
        ends = (place.lower, place.upper)
        return PlacedThreshold(one.known, place.value, ends, one.fit.width.value)

    return ResultTable.of(
        "Each participant's curve, from these answers alone",
        found.people,
        attribute("Participant", "participant", str, "l"),
        condition(plan),
        *threshold_columns(place_of, "Limits", logarithmic=plan.logarithmic),
        ResultColumn("Lapse rate", "", lambda one: size(one.fit.lapse.value, 2), _line),
        ResultColumn("Spread", "", lambda one: size(one.fit.spread.value, 2)),
    )


def _sentences(found: OwnCurves, plan: RatePlan) -> Iterator[str]:
    label = plan.label
    for who, several in found.within.items():
        for one in several:
            ends = (one.lower, one.upper)
            yield (
                f"{who}: {label(one.first)} minus {label(one.second)}"
                f" {size(one.difference, within=ends)}, {100 * one.level:g}% limits"
                f" {size_range(ends)}, posterior p {p_number(one.p_adjusted)}"
                f"{' Holm-adjusted' * (len(several) > 1)}."
            )


def _comparisons(found: OwnCurves) -> pd.DataFrame:
    compared = [
        {"within": kind, "of": who} | vars(one)
        for kind, groups in (("participant", found.within), ("condition", found.between))
        for who, several in groups.items()
        for one in several
    ]
    names = ["within", "of", *ThresholdDifference.__dataclass_fields__]
    return pd.DataFrame(compared, columns=names)


def _compared(
    groups: Mapping[str, Mapping[str, PsychometricPosterior]],
) -> dict[str, tuple[ThresholdDifference, ...]]:
    return {name: compare_thresholds(fits) for name, fits in groups.items() if len(fits) > 1}


def _line(one: PersonFit) -> dict[str, object]:
    line: dict[str, object] = {}
    for name in ("threshold", "width", "guess", "lapse", "spread"):
        known = name not in one.fit.unidentified
        for part in ("value", "lower", "upper"):
            column = name if part == "value" else f"{name}_{part}"
            line[column] = getattr(getattr(one.fit, name), part) if known else None
    return line | {"trials": one.fit.trials, "warnings": "; ".join(one.fit.warnings)}
