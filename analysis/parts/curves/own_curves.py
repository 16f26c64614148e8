"""Psychometric functions of each person, from that person's answers alone."""

from collections.abc import Mapping
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
    counts_in,
    counts_of_people,
    people_figure,
    threshold_cells,
    width_title,
)
from analysis.plans.rate_plan import RatePlan
from analysis.plots.psychometric_plots import DrawnCurve
from analysis.report.wording import p_number, size, size_range
from protocols.blocks import Cautions, FigurePlace, Paragraph, TableBlock

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
    """Psychometric functions of each person, by their posterior; thresholds compared."""

    name: ClassVar[str] = "psychometric"

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
        label = plan.label
        compared = [
            {"within": kind, "of": who} | vars(one)
            for kind, groups in (
                ("participant", found.within),
                ("condition", found.between),
            )
            for who, several in groups.items()
            for one in several
        ]
        curves = {
            (one.participant, one.condition): DrawnCurve(
                one.fit, threshold=(place.value, place.lower, place.upper)
            )
            for one in found.people
            if one.known
            for place in [one.fit.threshold]
        }
        return Presentation(
            title=self.title(plan),
            blocks=(
                FigurePlace("own_curves"),
                TableBlock.of(
                    "Each participant's curve, from these answers alone",
                    (
                        *(("Participant", "l"), ("Condition", "l c"), ("Threshold", "strong")),
                        ("Limits", "n"),
                        *((width_title(plan.logarithmic), ""), ("Lapse rate", ""), ("Spread", "")),
                    ),
                    [
                        (
                            one.participant,
                            label(one.condition),
                            *cells,
                            size(fit.lapse.value, 2),
                            size(fit.spread.value, 2),
                        )
                        for one in found.people
                        for fit, place in [(one.fit, one.fit.threshold)]
                        for cells in [
                            threshold_cells(
                                one.known, place.value, (place.lower, place.upper), fit.width.value
                            )
                        ]
                    ],
                ),
                Paragraph(
                    "Medians of a posterior with priors on lapses, guesses and on answers that vary"
                    " more than chance (Schütt et al., 2016). Spread: how far the true share at a"
                    " level strays.",
                    muted=True,
                ),
                Cautions.each(
                    TRUST, found.people, lambda one: f"{one.participant}, {label(one.condition)}"
                ),
            ),
            sentences=tuple(
                f"{who}: {label(one.first)} minus {label(one.second)} {_gap(one)},"
                f" {100 * one.level:g}% limits {size_range((one.lower, one.upper))}, posterior p"
                f" {p_number(one.p_adjusted)}{' Holm-adjusted' * (len(several) > 1)}."
                for who, several in found.within.items()
                for one in several
            ),
            methods=(
                "Each participant's psychometric function is the median of a posterior with priors"
                " on lapses, guesses and overdispersion (Schütt, Harmeling, Macke & Wichmann,"
                " 2016); thresholds are compared by their posteriors"
                + ", Holm-adjusted" * any(len(several) > 1 for several in found.within.values())
                + "."
            ),
            figures=(
                people_figure(
                    "own_curves", "curves from these answers alone", found.counts, curves, plan
                ),
            ),
            tables={
                "people.csv": pd.DataFrame(map(_line, found.people)),
                "comparisons_of_people.csv": pd.DataFrame(
                    compared, columns=["within", "of", *ThresholdDifference.__dataclass_fields__]
                ),
            },
        )


def _gap(one: ThresholdDifference) -> str:
    return size(one.difference, within=(one.lower, one.upper))


def _compared(
    groups: Mapping[str, Mapping[str, PsychometricPosterior]],
) -> dict[str, tuple[ThresholdDifference, ...]]:
    return {name: compare_thresholds(fits) for name, fits in groups.items() if len(fits) > 1}


def _line(one: PersonFit) -> dict[str, object]:
    line: dict[str, object] = {"participant": one.participant, "condition": one.condition}
    for name in ("threshold", "width", "guess", "lapse", "spread"):
        known = name not in one.fit.unidentified
        for part in ("value", "lower", "upper"):
            column = name if part == "value" else f"{name}_{part}"
            line[column] = getattr(getattr(one.fit, name), part) if known else None
    return line | {"trials": one.fit.trials, "warnings": "; ".join(one.fit.warnings)}
