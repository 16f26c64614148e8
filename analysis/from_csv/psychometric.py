"""Psychometric functions of a CSV file: thresholds of people and of the population, compared."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.cells import conditions
from analysis.columns import frame_of
from analysis.from_csv.found import Found, Progress, limits, number, unique
from analysis.guessing import curve_mistake
from analysis.plots import psychometric_plot
from analysis.plots.curves import Curve
from analysis.psychometric_posterior import (
    PsychometricPosterior,
    ThresholdDifference,
    compare_thresholds,
    psychometric_posterior,
)
from analysis.rates import Difference
from analysis.report.wording import NONE, p_number
from analysis.tables.table import Source, opened
from analysis.tables.trials import read_trials
from analysis.tasks.rates.wording import apa_difference, apa_thresholds
from analysis.thresholds import ThresholdModel, fit_thresholds
from protocols.adaptive.psychometric import Shape
from protocols.errors import StudyError
from protocols.prose import count_of

Floats = NDArray[np.float64]

MOST_PEOPLE = 12
"""Thresholds of people are compared, all pairs of them, in so small a group at most."""


@dataclass(frozen=True)
class PsychometricOptions:
    """How a table is read and fitted.

    Attributes
    ----------
    x : str
        Column of levels.
    by : str or None
        Column of conditions.
    guess : float or None
        Rate of guessing; None fits it.
    """

    x: str
    by: str | None = None
    guess: float | None = 0.5
    shape: Shape = "gauss"
    falling: bool = False
    logarithmic: bool = False
    level: float = 0.95


@dataclass(frozen=True)
class PersonFit:
    """One participant's curve in one condition."""

    participant: str
    condition: str
    fit: PsychometricPosterior


@dataclass(frozen=True)
class PsychometricFound:
    """Every number of the analysis.

    Attributes
    ----------
    people : tuple of PersonFit
        Each from that person's answers alone.
    population : ThresholdModel or None
        All people together; None of one person, or where the model cannot be fitted.
    within : mapping of participant to tuple of ThresholdDifference
        Between conditions of one person.
    between : mapping of condition to tuple of ThresholdDifference
        Between people in one condition.
    """

    people: tuple[PersonFit, ...]
    population: ThresholdModel | None
    within: Mapping[str, tuple[ThresholdDifference, ...]]
    between: Mapping[str, tuple[ThresholdDifference, ...]]


def psychometric_of_csv(
    source: Source,
    options: PsychometricOptions,
    mapping: Mapping[str, str] | None = None,
    *,
    progress: Progress | None = None,
) -> Found:
    """Fit psychometric functions to the trials of a table.

    Raises
    ------
    StudyError
        If the table lacks a column, or holds what cannot be.
    """
    by = () if options.by is None else (options.by,)
    table = opened(source, mapping)
    rows = read_trials(table, conditions=by, levels=(options.x,), own=False)
    if options.logarithmic and bool((rows[options.x] <= 0).any()):
        raise StudyError(
            f"{table.path}: {options.x} must be above 0 in every row to have a logarithm"
            f" (least: {rows[options.x].min():g}); leave the others out with --where"
            f" '{options.x}>0', or leave --log away"
        )
    if rows[options.x].nunique() < 2:
        raise StudyError(f"{table.path}: {options.x} must hold two levels or more (found 1)")
    if mistake := curve_mistake(rows, options.x, options.guess, falling=options.falling):
        raise StudyError(f"{table.path}: {mistake}")
    notes = list(table.notes)
    people = _people(rows, by, options, notes, progress)
    population = _population(rows, by, options, notes)
    result = PsychometricFound(
        people=people,
        population=population,
        within=_within(people),
        between=_between(people, notes),
    )
    simulated = "simulated" in rows and bool((rows["simulated"].astype(str) == "1").any())
    count = rows["participant"].nunique()
    return Found(
        title=f"{count_of(len(rows), 'answer')} of {count_of(count, 'participant')} by {options.x}"
        + (" (SIMULATED)" if simulated else ""),
        shown=_shown(result),
        sentences=_sentences(result, rows[options.x]),
        notes=unique([*notes, *(population.warnings if population else ())]),
        tables=_tables(result),
        figures={
            "psychometric": lambda width: _figure(
                rows, by, options, result, width, simulated=simulated
            )
        },
        result=result,
    )


def _people(
    rows: pd.DataFrame,
    by: tuple[str, ...],
    options: PsychometricOptions,
    notes: list[str],
    progress: Progress | None,
) -> tuple[PersonFit, ...]:
    cells = [
        (str(who), name, part)
        for name, of_condition in conditions(rows, by)
        for who, part in of_condition.groupby("participant", sort=True)
    ]
    found = []
    for done, (who, name, part) in enumerate(cells):
        if progress is not None:
            progress("fitting people", done, len(cells))
        counts = part.groupby(options.x)["correct"].agg(["sum", "size"])
        if len(counts) < 2:
            notes.append(f"{who}, {name}: shown at one level only; no curve")
            continue
        fit = psychometric_posterior(
            counts.index.to_numpy(dtype=np.float64),
            counts["sum"].to_numpy(dtype=np.float64),
            counts["size"].to_numpy(dtype=np.float64),
            guess=options.guess,
            shape="gumbel" if options.shape == "weibull" else options.shape,
            falling=options.falling,
            logarithmic=options.logarithmic,
            level=options.level,
        )
        notes += [f"{who}, {name}: {note}" for note in fit.warnings]
        found.append(PersonFit(who, name, fit))
    return tuple(found)


def _population(
    rows: pd.DataFrame, by: tuple[str, ...], options: PsychometricOptions, notes: list[str]
) -> ThresholdModel | None:
    if rows["participant"].nunique() < 2:
        notes.append("one participant only: nothing is said about other people")
        return None
    try:
        return fit_thresholds(
            rows,
            options.x,
            by,
            guess=options.guess,
            shape=options.shape,
            falling=options.falling,
            logarithmic=options.logarithmic,
            scenes="scene" in rows,
            level=options.level,
        )
    except ValueError as problem:
        notes.append(f"no thresholds of the population: {problem}")
        return None


def _within(people: tuple[PersonFit, ...]) -> dict[str, tuple[ThresholdDifference, ...]]:
    found = {}
    for who in dict.fromkeys(one.participant for one in people):
        own = {
            one.condition: one.fit
            for one in people
            if one.participant == who and not one.fit.unidentified
        }
        if len(own) > 1:
            found[who] = compare_thresholds(own)
    return found


def _between(
    people: tuple[PersonFit, ...], notes: list[str]
) -> dict[str, tuple[ThresholdDifference, ...]]:
    found = {}
    for name in dict.fromkeys(one.condition for one in people):
        own = {
            one.participant: one.fit
            for one in people
            if one.condition == name and not one.fit.unidentified
        }
        if len(own) > MOST_PEOPLE:
            notes.append(f"{len(own)} people: not compared with each other, one by one")
        elif len(own) > 1:
            found[name] = compare_thresholds(own)
    return found


def _shown(result: PsychometricFound) -> pd.DataFrame:
    lines = []
    if result.population is not None:
        lines += [
            ("all people", one.condition, number(one.value), limits(one.lower, one.upper),
             number(one.width), number(result.population.lapse, 2), "")
            for one in result.population.thresholds
        ]  # fmt: skip
    lines += [
        (
            one.participant,
            one.condition,
            *_placed(one.fit),
            number(one.fit.lapse.value, 2),
            number(one.fit.spread.value, 2),
        )
        for one in result.people
    ]
    heads = ["participant", "condition", "threshold", "limits", "width", "lapse", "spread"]
    return pd.DataFrame(lines, columns=heads)


def _placed(fit: PsychometricPosterior) -> tuple[str, str, str]:
    """Return threshold, limits and width as text; none where the prior decides them."""
    if fit.unidentified:
        return NONE, NONE, NONE
    place = fit.threshold
    return number(place.value), limits(place.lower, place.upper), number(fit.width.value)


def _sentences(result: PsychometricFound, levels: pd.Series) -> tuple[str, ...]:
    found = []
    if result.population is not None:
        found.append(apa_thresholds(result.population, levels=list(levels.unique())))
        found += [apa_difference(one) for one in result.population.contrasts]
    found += [
        f"{who}: {one.first} minus {one.second} {one.difference:.3g},"
        f" {100 * one.level:g}% limits {limits(one.lower, one.upper)}, posterior p"
        f" {p_number(one.p_adjusted)} Holm-adjusted."
        for who, several in result.within.items()
        for one in several
    ]
    return tuple(found)


def _tables(result: PsychometricFound) -> dict[str, pd.DataFrame]:
    names = ("threshold", "width", "guess", "lapse", "spread")
    tables = {
        "people.csv": pd.DataFrame(
            [
                {"participant": one.participant, "condition": one.condition}
                | {
                    name if part == "value" else f"{name}_{part}": None
                    if name in one.fit.unidentified
                    else getattr(getattr(one.fit, name), part)
                    for name in names
                    for part in ("value", "lower", "upper")
                }
                | {"trials": one.fit.trials, "warnings": "; ".join(one.fit.warnings)}
                for one in result.people
            ]
        ),
        "comparisons_of_people.csv": pd.DataFrame(
            [
                {"within": kind, "of": who} | vars(one)
                for kind, groups in (("participant", result.within), ("condition", result.between))
                for who, several in groups.items()
                for one in several
            ],
            columns=["within", "of", *ThresholdDifference.__dataclass_fields__],
        ),
    }
    if result.population is not None:
        tables["thresholds.csv"] = pd.DataFrame(
            [
                {"condition": one.condition, "threshold": one.value, "lower": one.lower}
                | {"upper": one.upper, "width": one.width}
                for one in result.population.thresholds
            ]
        )
        tables["comparisons.csv"] = frame_of(Difference, result.population.contrasts)
    return tables


def _figure(
    rows: pd.DataFrame,
    by: tuple[str, ...],
    options: PsychometricOptions,
    result: PsychometricFound,
    width_in: float,
    *,
    simulated: bool,
) -> Figure:
    """Draw all answers by condition; curves of the population, or of the one person."""
    series: dict[str, tuple[Floats, Floats, Floats, Curve | None]] = {}
    for name, part in conditions(rows, by):
        counts = part.groupby(options.x)["correct"].agg(["sum", "size"])
        series[name] = (
            counts.index.to_numpy(dtype=np.float64),
            counts["sum"].to_numpy(dtype=np.float64),
            counts["size"].to_numpy(dtype=np.float64),
            _curve(result, name),
        )
    return psychometric_plot(
        series,
        x_label=options.x,
        chance=options.guess,
        logarithmic=options.logarithmic,
        width_in=width_in,
        simulated=simulated,
    )


def _curve(result: PsychometricFound, condition: str) -> Curve | None:
    model = result.population
    if model is not None:
        return (lambda x: model.average(condition, x)) if model[condition].individual else None
    own = [one.fit for one in result.people if one.condition == condition]
    return (lambda x: own[0](x)) if len(own) == 1 else None
