"""Psychometric functions along a level: of all answers, of the population, of each person."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from analysis.cells import conditions
from analysis.columns import frame_of
from analysis.parts import Estimate, Part, PartFigure, Shown, tried
from analysis.parts.differences import (
    apa_difference,
    difference_estimates,
    difference_tables,
    in_order,
)
from analysis.plans.rates import RateSettings, shown_in
from analysis.plots import psychometric_plot
from analysis.plots.curves import Curve
from analysis.psychometric import Psychometric, fit_psychometric
from analysis.psychometric_posterior import (
    PsychometricPosterior,
    ThresholdDifference,
    compare_thresholds,
    psychometric_posterior,
)
from analysis.rates import Difference
from analysis.report.blocks import Block, Cautions, Paragraph, Picture, Table
from analysis.report.wording import (
    NONE,
    NOT_IDENTIFIED,
    column_in_words,
    grouped,
    leading,
    level_text,
    p_number,
    sd_digits,
    share,
    size,
    size_range,
)
from analysis.thresholds import Threshold, ThresholdModel, fit_thresholds
from protocols.adaptive.psychometric import Shape

Floats = NDArray[np.float64]

WIDELY_SPACED = 8.0
"""Levels whose largest is so many times the smallest are drawn on a logarithmic axis."""
MOST_PEOPLE = 12
"""Thresholds of people are compared, all pairs of them, in so small a group at most."""
SECTION = ("levels", "Levels")
TRUST = "When not to trust these levels"
SHAPES: Mapping[Shape, str] = {
    "gauss": "cumulative normal",
    "logistic": "logistic",
    "gumbel": "Gumbel (Weibull on logarithms)",
    "weibull": "Weibull",
}


@dataclass(frozen=True)
class Counts:
    """Right answers and trials of a condition by level, all participants together."""

    levels: tuple[float, ...]
    right: tuple[int, ...]
    trials: tuple[int, ...]

    @property
    def arrays(self) -> tuple[Floats, Floats, Floats]:
        """Levels, right answers and trials."""
        x, right, trials = (
            np.array(values, dtype=np.float64) for values in (self.levels, self.right, self.trials)
        )
        return x, right, trials


def counts_in(table: pd.DataFrame, plan: RateSettings) -> dict[str, Counts]:
    """Return counts by condition."""
    found = {}
    for name in shown_in(table, plan):
        rows = table[table[plan.compared[0]] == name]
        each = rows.groupby(pd.to_numeric(rows[plan.level]))["correct"].agg(["sum", "size"])
        found[name] = Counts(
            tuple(map(float, each.index)),
            tuple(map(int, each["sum"])),
            tuple(map(int, each["size"])),
        )
    return found


def levels_axis(plan: RateSettings) -> str:
    """Return what stands along the axis of levels."""
    name = column_in_words(str(plan.level))
    return name[:1].upper() + name[1:]


def curves_figure(
    name: str,
    fits: str,
    counts: Mapping[str, Counts],
    curves: Mapping[str, Curve | None],
    plan: RateSettings,
) -> PartFigure:
    """Return the figure of shares along the level, and of curves that `fits` names."""
    levels = np.array([x for one in counts.values() for x in one.levels])
    wide = bool(levels.min() > 0 and levels.max() / levels.min() > WIDELY_SPACED)
    draw = partial(
        psychometric_plot,
        {condition: (*one.arrays, curves.get(condition)) for condition, one in counts.items()},
        x_label=levels_axis(plan),
        chance=plan.guess,
        logarithmic=wide or plan.logarithmic,
        label=plan.label,
    )
    caption = (
        f"Right answers by {plan.level}: data of all participants together with binomial standard"
        f" errors (thin), {fits} (thick); dashed: chance."
    )
    return PartFigure(name, caption, draw)


class LevelsPart:
    """What parts along a level have in common."""

    section: ClassVar[tuple[str, str]] = SECTION

    def wanted(self, _table: pd.DataFrame, plan: RateSettings) -> bool:
        """Return whether there is a level."""
        return plan.level is not None

    def title(self, plan: RateSettings) -> str:
        """Return what heads the section."""
        return f"By {column_in_words(str(plan.level))}"


@dataclass(frozen=True)
class Curves:
    """Counts by condition, and a curve fitted to all participants' answers together."""

    counts: Mapping[str, Counts]
    curves: Mapping[str, Psychometric]
    notes: tuple[str, ...]


class CurvesPart(LevelsPart, Part[RateSettings, Curves]):
    """Psychometric functions of all participants together."""

    name: ClassVar[str] = "curves"

    def compute(
        self,
        table: pd.DataFrame,
        plan: RateSettings,
        _found: Mapping[str, Any],
        _chance: np.random.Generator,
    ) -> Curves:
        """Count, and fit each condition."""
        counts, notes = counts_in(table, plan), list[str]()
        fits = {
            name: tried(
                partial(
                    fit_psychometric,
                    *one.arrays,
                    guess=plan.guess,
                    shape=plan.shape,
                    falling=plan.falling,
                    level=plan.confidence,
                ),
                f"psychometric function of {plan.label(name)}",
                notes,
            )
            for name, one in counts.items()
        }
        return Curves(counts, {k: fit for k, fit in fits.items() if fit is not None}, tuple(notes))

    def show(self, found: Curves, plan: RateSettings) -> Shown:
        """Return data and curves."""
        label = plan.label
        fits = found.curves.items()
        table = Table.of(
            "Psychometric functions, all participants together",
            (
                ("Condition", "l c"),
                ("Threshold", "strong"),
                ("Limits", "n"),
                ("Width", ""),
                ("Lapse rate", ""),
                ("Misfit p", "n"),
            ),
            [
                (
                    label(name),
                    *_placed(fit, found.counts[name].levels),
                    share(fit.lapse),
                    p_number(fit.p) if fit.df > 0 else NONE,
                )
                for name, fit in fits
            ],
        )
        told = Paragraph(
            "Threshold: where half of the way from guessing to lapsing is done. Width: from 5 to"
            f" 95 % of that way. Shape: {SHAPES[plan.shape]}. These limits speak of answers,"
            " not of people; the next table's do.",
            muted=True,
        )
        return Shown(
            title=self.title(plan),
            blocks=(
                Picture("levels"),
                *((table, told) if fits else ()),
                Cautions(TRUST, grouped([(label(name), fit.warnings) for name, fit in fits])),
            ),
            sentences=tuple(
                f"All answers to {label(name)} together have their threshold at"
                f" {size(fit.threshold)}, {level_text(fit.level)}"
                f" {size_range(fit.threshold_limits)} of answers, not of people."
                for name, fit in fits
                if fit.identified(found.counts[name].levels)
            ),
            methods=(
                f"Psychometric functions over {plan.level} were fitted by maximum likelihood with"
                f" {'a guess rate of chance' if plan.guess is not None else 'a free guess rate'}."
            ),
            tables={
                "levels.csv": pd.DataFrame(
                    [
                        {"condition": name, "level": x, "right": right, "trials": trials}
                        for name, one in found.counts.items()
                        for x, right, trials in zip(one.levels, one.right, one.trials, strict=True)
                    ]
                )
            },
            figures=(
                curves_figure(
                    "levels", "fitted psychometric functions", found.counts, found.curves, plan
                ),
            ),
        )


def _placed(fit: Psychometric, levels: Sequence[float]) -> tuple[str, str, str]:
    """Return threshold, limits and width as text; none where the answers do not place them."""
    if not fit.identified(levels):
        return NOT_IDENTIFIED, NONE, NONE
    return size(fit.threshold), size_range(fit.threshold_limits), size(fit.width)


@dataclass(frozen=True)
class Thresholds(ThresholdModel):
    """Every number; `counts` as curves are drawn beside them."""

    counts: Mapping[str, Counts]
    notes: tuple[str, ...] = ()

    def places(self, one: Threshold) -> bool:
        """Return whether the answers place a threshold among the levels shown."""
        return one.identified([x for counts in self.counts.values() for x in counts.levels])


class ThresholdsPart(LevelsPart, Part[RateSettings, Thresholds]):
    """Thresholds in the population: one model, random over participants and scenes."""

    name: ClassVar[str] = "thresholds"

    def compute(
        self,
        table: pd.DataFrame,
        plan: RateSettings,
        _found: Mapping[str, Any],
        _chance: np.random.Generator,
    ) -> Thresholds:
        """Fit the model."""
        if table["participant"].nunique() < 2:
            raise ValueError("one participant only: nothing is said about other people")
        model = fit_thresholds(
            table,
            str(plan.level),
            plan.compared,
            guess=plan.guess,
            shape=plan.shape,
            falling=plan.falling,
            logarithmic=plan.logarithmic,
            scenes="scene" in table,
            reference=plan.reference_in(shown_in(table, plan)),
            level=plan.confidence,
        )
        ordered = replace(
            model,
            thresholds=in_order(model.thresholds, plan, lambda one: one.condition),
            contrasts=in_order(model.contrasts, plan, lambda one: one.first),
        )
        return Thresholds(**vars(ordered), counts=counts_in(table, plan))

    def estimates(self, found: Thresholds, plan: RateSettings) -> Sequence[Estimate]:
        """Return differences of thresholds, where levels adapt and so these are the result."""
        trials = {name: sum(one.trials) for name, one in found.counts.items()}
        return difference_estimates(found.contrasts, trials, plan) if plan.adaptive else ()

    def show(self, found: Thresholds, plan: RateSettings) -> Shown:
        """Return thresholds, what differs, and each participant's own."""
        placed = {one.condition for one in found.thresholds if found.places(one)}
        curves: dict[str, Curve | None] = {
            one.condition: partial(found.average, one.condition)
            for one in found.thresholds
            if one.individual
        }
        effects = ["participants"]
        if found.scene_sd:
            effects.append("scenes")
        if len(found.thresholds) > 1:
            effects.append("participants x conditions")
        differing = "natural logarithms of thresholds" if found.logarithmic else "thresholds"
        return Shown(
            title=self.title(plan),
            blocks=(
                Picture("psychometric"),
                *_population(found, placed, plan),
                *difference_tables(f"Differences of {differing}", found.contrasts, plan),
                *_individuals(found, placed, plan),
                Cautions("When not to trust these thresholds", found.warnings),
            ),
            sentences=(
                apa_thresholds(found, levels=[x for c in found.counts.values() for x in c.levels]),
                *map(apa_difference, found.contrasts),
            ),
            methods=(
                "Thresholds in the population come from one mixed model of all trials, random over"
                f" {', '.join(effects)} (Laplace approximation), with one lapse rate, drawn towards"
                " small ones, for all."
            ),
            tables={
                "thresholds.csv": pd.DataFrame(
                    [
                        {"condition": one.condition, "participant": who, "threshold": value}
                        | {"lower": lower, "upper": upper, "width": width}
                        for one in found.thresholds
                        for who, value, lower, upper, width in (
                            ("", one.value, one.lower, one.upper, one.width),
                            *(
                                (name, own, None, None, None)
                                for name, own in one.individual.items()
                            ),
                        )
                    ]
                ),
                "threshold_differences.csv": frame_of(Difference, found.contrasts),
            },
            figures=(
                curves_figure(
                    "psychometric",
                    "the mean of the participants' curves in one model",
                    found.counts,
                    curves,
                    plan,
                ),
            ),
        )


def _population(
    model: Thresholds, placed: Iterable[str], plan: RateSettings
) -> tuple[Block, Block]:
    spread = f"differ between participants by SD {sd_digits(model.participant_sd)}"
    if len(model.thresholds) > 1:
        spread += f", of one participant between conditions by SD {sd_digits(model.interaction_sd)}"
    if model.scene_sd:
        spread += f", between scenes by SD {sd_digits(model.scene_sd)}"
    if model.logarithmic:
        spread += " of the threshold's natural logarithm"
    return (
        Table.each(
            "Thresholds in the population: one model, random over participants"
            + (" and scenes" if model.scene_sd else ""),
            model.thresholds,
            ("Condition", "l c", lambda one: plan.label(one.condition)),
            (
                "Threshold",
                "strong",
                lambda one: size(one.value) if one.condition in placed else NOT_IDENTIFIED,
            ),
            (
                f"{100 * model.level:g} % limits",
                "n",
                lambda one: size_range((one.lower, one.upper) if one.condition in placed else None),
            ),
            (
                "Width, as a ratio" if model.logarithmic else "Width",
                "",
                lambda one: size(one.width) if one.condition in placed else NONE,
            ),
        ),
        Paragraph(
            f"Lapse rate {share(model.lapse)}, shared by all; thresholds {spread}.", muted=True
        ),
    )


def _individuals(model: Thresholds, placed: Iterable[str], plan: RateSettings) -> tuple[Block, ...]:
    own = sorted({who for one in model.thresholds for who in one.individual})
    if not own:
        return ()
    return (
        Table.of(
            "Participants' thresholds",
            (
                ("Participant", "l"),
                *((plan.label(one.condition), "") for one in model.thresholds),
            ),
            [
                (
                    who,
                    *(
                        size(one.individual.get(who)) if one.condition in placed else NONE
                        for one in model.thresholds
                    ),
                )
                for who in own
            ],
        ),
        Paragraph(
            "Each is drawn towards the mean as far as the participant's answers leave open.",
            muted=True,
        ),
    )


def apa_thresholds(model: ThresholdModel, *, unit: str = "", levels: Sequence[float] = ()) -> str:
    """Return the thresholds of all conditions as a sentence; `levels` are those shown."""
    after = f" {unit}" if unit else ""
    parts = [
        f"{one.condition} {size(one.value)}{after}, {level_text(model.level)}"
        f" {size_range((one.lower, one.upper))}"
        if one.identified(levels)
        else f"{one.condition} {NOT_IDENTIFIED}"
        for one in model.thresholds
    ]
    spread = f"participants SD = {sd_digits(model.participant_sd)}"
    if len(model.thresholds) > 1:
        spread += f", participants x conditions SD = {sd_digits(model.interaction_sd)}"
    if model.scene_sd:
        spread += f", scenes SD = {sd_digits(model.scene_sd)}"
    scale = " of ln threshold" if model.logarithmic else ""
    return (
        f"Thresholds ({model.shape} functions of {model.participants} participants fitted"
        f" together; guess rate {share(model.guess)}, lapse rate {leading(f'{model.lapse:.3f}')}):"
        f" {'; '.join(parts)} ({spread}{scale})."
    )


@dataclass(frozen=True)
class PersonFit:
    """One participant's curve in one condition."""

    participant: str
    condition: str
    fit: PsychometricPosterior


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


class OwnCurvesPart(LevelsPart, Part[RateSettings, OwnCurves]):
    """Psychometric functions of each person, by their posterior; thresholds compared."""

    name: ClassVar[str] = "psychometric"

    def compute(
        self,
        table: pd.DataFrame,
        plan: RateSettings,
        _found: Mapping[str, Any],
        _chance: np.random.Generator,
    ) -> OwnCurves:
        """Fit each person in each condition, and compare what the answers place."""
        notes, people = list[str](), list[PersonFit]()
        for name, rows in conditions(table, plan.compared):
            for who, part in rows.groupby("participant", sort=True):
                counts = part.groupby(plan.level)["correct"].agg(["sum", "size"])
                if len(counts) < 2:
                    notes.append(f"{who}, {name}: shown at one level only; no curve")
                    continue
                fit = psychometric_posterior(
                    counts.index.to_numpy(dtype=np.float64),
                    counts["sum"].to_numpy(dtype=np.float64),
                    counts["size"].to_numpy(dtype=np.float64),
                    guess=plan.guess,
                    shape="gumbel" if plan.shape == "weibull" else plan.shape,
                    falling=plan.falling,
                    logarithmic=plan.logarithmic,
                    level=plan.confidence,
                )
                people.append(PersonFit(str(who), name, fit))
        within, between = {}, {}
        for who in dict.fromkeys(one.participant for one in people):
            own = {p.condition: p.fit for p in people if p.participant == who and _known(p)}
            if len(own) > 1:
                within[who] = compare_thresholds(own)
        for name in dict.fromkeys(one.condition for one in people):
            own = {p.participant: p.fit for p in people if p.condition == name and _known(p)}
            if len(own) > MOST_PEOPLE:
                notes.append(f"{len(own)} people: not compared with each other, one by one")
            elif len(own) > 1:
                between[name] = compare_thresholds(own)
        return OwnCurves(tuple(people), within, between, tuple(notes))

    def show(self, found: OwnCurves, plan: RateSettings) -> Shown:
        """Return each person's curve in a row, and what differs within people."""
        label = plan.label
        names = ("threshold", "width", "guess", "lapse", "spread")
        compared = [
            {"within": kind, "of": who} | vars(one)
            for kind, groups in (("participant", found.within), ("condition", found.between))
            for who, several in groups.items()
            for one in several
        ]
        return Shown(
            title=self.title(plan),
            blocks=(
                Table.of(
                    "Each participant's curve, from these answers alone",
                    (
                        ("Participant", "l"),
                        ("Condition", "l c"),
                        ("Threshold", "strong"),
                        ("Limits", "n"),
                        ("Width", ""),
                        ("Lapse rate", ""),
                        ("Spread", ""),
                    ),
                    [
                        (
                            one.participant,
                            label(one.condition),
                            *_own(one.fit),
                            size(one.fit.lapse.value, 2),
                            size(one.fit.spread.value, 2),
                        )
                        for one in found.people
                    ],
                ),
                Paragraph(
                    "Medians of a posterior with priors on lapses, guesses and on answers that vary"
                    " more than chance (Schütt et al., 2016). Spread: how far the true share at a"
                    " level strays.",
                    muted=True,
                ),
                Cautions(
                    TRUST,
                    tuple(
                        f"{one.participant}, {label(one.condition)}: {note}"
                        for one in found.people
                        for note in one.fit.warnings
                    ),
                ),
            ),
            sentences=tuple(
                f"{who}: {label(one.first)} minus {label(one.second)} {one.difference:.3g},"
                f" {100 * one.level:g}% limits {size_range((one.lower, one.upper))}, posterior p"
                f" {p_number(one.p_adjusted)} Holm-adjusted."
                for who, several in found.within.items()
                for one in several
            ),
            methods=(
                "Each participant's psychometric function is the median of a posterior with priors"
                " on lapses, guesses and overdispersion (Schütt, Harmeling, Macke & Wichmann,"
                " 2016); thresholds are compared by their posteriors, Holm-adjusted."
            ),
            tables={
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
                        for one in found.people
                    ]
                ),
                "comparisons_of_people.csv": pd.DataFrame(
                    compared, columns=["within", "of", *ThresholdDifference.__dataclass_fields__]
                ),
            },
        )


def _known(one: PersonFit) -> bool:
    """Return whether the answers, and not the prior, place the threshold."""
    return not one.fit.unidentified


def _own(fit: PsychometricPosterior) -> tuple[str, str, str]:
    """Return threshold, limits and width as text; none where the prior decides them."""
    if fit.unidentified:
        return NONE, NONE, NONE
    place = fit.threshold
    return size(place.value), size_range((place.lower, place.upper)), size(fit.width.value)
