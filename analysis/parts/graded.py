"""Answers that confidence grades: meta-d' and M-ratio of people, ROC and unequal variances."""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, TypeVar

import numpy as np
import pandas as pd

from analysis.arrays import Floats
from analysis.data_dictionary import frame_of
from analysis.models.detection import Measure
from analysis.models.metacognition import (
    FEWEST_TRIALS,
    FEWEST_WRONG,
    UNBIASED_PADDING,
    MetaFit,
    Ratio,
    Reliability,
    UnequalFit,
    fewest_answers,
    fit_meta,
    fit_unequal,
    graded_area,
    graded_counts,
    halves_agree,
    mean_over_people,
    ratio_of_means,
    roc_points,
)
from analysis.parts import AnalysisPlan, PartFigure, Presentation, SimplePart, tried
from analysis.parts.confidence import (
    HALVES,
    SECTION,
    ConfidencePart,
    apa_measure,
    apa_reliability,
    halved,
    measured,
    reliability_table,
    with_steps,
)
from analysis.parts.correct import answers_in
from analysis.parts.sensitivity import with_shared_noise
from analysis.parts.shared import condition
from analysis.plans.rate_plan import RatePlan, shown_in
from analysis.plots.confidence_plots import metacognition_plot, roc_plot
from analysis.report.values import flat_table
from analysis.report.wording import level_text, number, number_range, p_number, p_text, placed
from protocols.blocks import Cautions, FigurePlace, Paragraph, TableBlock, grouped
from protocols.prose import count_of

TOGETHER = "all conditions together"
MIXED = "answers of unequal d' taken together raise M-ratio, and lower the slope of the ROC"
ENOUGH = f"{FEWEST_TRIALS} answers (of few steps 400 / steps)"
NO_PERSON = "no participant has what it takes"


@dataclass(frozen=True)
class PersonMeta:
    """d' and meta-d' of one person in one condition."""

    condition: str
    participant: str
    trials: int
    fit: MetaFit
    m_ratio: float


@dataclass(frozen=True)
class ConditionMeta:
    """Sensitivity of people's confidence in one condition.

    `gap` is meta-d' minus d', `m_ratio` the mean meta-d' by the mean d'.
    """

    condition: str
    d_prime: Measure
    meta_d_prime: Measure
    gap: Measure
    m_ratio: Ratio
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class Metacognition:
    """Every number."""

    conditions: tuple[ConditionMeta, ...]
    people: tuple[PersonMeta, ...]
    reliability: tuple[Reliability, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class PersonGraded:
    """Unequal variances of one person in one condition."""

    condition: str
    participant: str
    trials: int
    fit: UnequalFit


@dataclass(frozen=True)
class ConditionGraded:
    """Graded answers of one condition.

    Attributes
    ----------
    area : Measure
        Below each person's ROC, without a model.
    d_a, log_slope : Measure
        Over people; a slope of 1 (logarithm 0) means equal variances.
    together : UnequalFit or None
        Of all answers, as it is drawn; `points` are its (false alarms, hits).
    """

    condition: str
    area: Measure
    d_a: Measure
    log_slope: Measure
    together: UnequalFit | None
    points: tuple[tuple[float, float], ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class GradedPairs:
    """Every number."""

    conditions: tuple[ConditionGraded, ...]
    people: tuple[PersonGraded, ...]
    notes: tuple[str, ...]


Counts = Mapping[tuple[str, str], Floats]
"""Graded answers (2, 2 x steps) by condition and person."""
F = TypeVar("F", MetaFit, UnequalFit)
R = TypeVar("R", Metacognition, GradedPairs)
Fits = Mapping[tuple[str, str], F]


def _counts(rows: pd.DataFrame, plan: RatePlan, steps: int) -> Counts:
    """Return the graded answers of each condition and person."""
    answers = answers_in(rows, plan)
    if len(answers) != 2:
        raise ValueError("the table must say which of two answers was right, and which was given")
    found = {}
    for (name, who), own in rows.groupby(["condition", "participant"], sort=True):
        there, said = (
            np.asarray(own[column].astype(str) == answers[0], dtype=np.float64)
            for column in ("expected", "answer")
        )
        step = own["step"].to_numpy(np.int64)
        found[str(name), str(who)] = graded_counts(there, said, step, steps)
    return found


def _fits(
    counts: Counts, fit: Callable[[Floats], F], fewest: int
) -> tuple[Fits[F], dict[str, list[str]]]:
    """Return fits by condition and person, and by condition why others have none."""
    found: dict[tuple[str, str], F] = {}
    lacking: dict[str, list[str]] = {name: [] for name, _ in counts}
    for (name, who), cells in counts.items():
        try:
            if cells.sum() < fewest:
                raise ValueError(f"fewer than {fewest} answers")
            found[name, who] = fit(cells)
        except ValueError as problem:
            lacking[name].append(str(problem))
    return found, lacking


def _fitted(
    rows: pd.DataFrame, plan: RatePlan, steps: int, fit: Callable[[Floats], F]
) -> tuple[Counts, Fits[F], dict[str, tuple[str, ...]]]:
    """Return counts, fits, and what to say of each condition that has fits.

    Where no condition has two people who can be fitted, all conditions are taken together.
    """
    counts, fewest = _counts(rows, plan, steps), fewest_answers(steps)
    found: Fits[F]
    lacking: dict[str, list[str]]
    found, lacking = _fits(counts, fit, fewest)
    conditions = shown_in(rows, plan)
    said: dict[str, list[str]] = {name: list(_left_out(lacking[name])) for name in conditions}
    most = Counter(name for name, _ in found).most_common(1)
    if sum(count for _, count in most) < 2 and len(said) > 1:
        together: dict[tuple[str, str], Floats] = {}
        for (_, who), cells in counts.items():
            together[TOGETHER, who] = together.get((TOGETHER, who), 0.0) + cells
        again: Fits[F]
        again, lacking = _fits(together, fit, fewest)
        if len(again) > len(found):
            counts, found = together, again
            first = f"no condition alone has enough answers of two people: {MIXED}"
            said = {TOGETHER: [first, *_left_out(lacking[TOGETHER])]}
    if not found:
        reasons = dict.fromkeys(why for several in lacking.values() for why in several)
        raise ValueError(f"{NO_PERSON} ({'; '.join(reasons)})")
    fitted = {name for name, _ in found}
    if plan.level is not None:
        for notes in said.values():
            notes.append(f"the condition has several levels: {MIXED}")
    return counts, found, {name: tuple(said[name]) for name in said if name in fitted}


def _left_out(reasons: Sequence[str]) -> Iterator[str]:
    for why in dict.fromkeys(reasons):
        yield f"{count_of(reasons.count(why), 'participant')} left out: {why}"


class _GradedAnswers(SimplePart[RatePlan, R]):
    section: ClassVar[tuple[str, str]] = SECTION

    def wanted(self, table: pd.DataFrame, plan: RatePlan) -> bool:
        """Return True if people said how sure they were; `ConfidencePart` says why not."""
        return (
            ConfidencePart().wanted(table, plan)
            and tried(lambda: with_steps(table), "", []) is not None
        )


class MetacognitionPart(_GradedAnswers[Metacognition]):
    """meta-d' and M-ratio of each person in tasks with two answers."""

    name: ClassVar[str] = "metacognition"

    def of(self, table: pd.DataFrame, plan: RatePlan) -> Metacognition:
        """Fit each person in each condition, and both halves of their trials."""
        if plan.kind not in ("detection", "identification") or plan.alternatives != 2:
            raise ValueError(
                "meta-d' is of yes-no tasks and of two alternatives, whose evidence is normal with"
                f" one criterion (this is {plan.kind} with {plan.alternatives} answers)"
            )
        rows, steps, _ = with_steps(table)
        if plan.kind == "detection":
            rows = with_shared_noise(rows, plan.answers[0])
        counts, fits, said = _fitted(rows, plan, len(steps), fit_meta)
        people = tuple(
            PersonMeta(name, who, int(counts[name, who].sum()), fit, fit.ratio)
            for (name, who), fit in fits.items()
        )
        notes: list[str] = []
        whole = rows.assign(condition=TOGETHER) if TOGETHER in said else rows
        halves, fewest = halved(whole, ["condition", "expected"]), fewest_answers(len(steps)) // 2
        both = [
            _fits(_counts(halves[halves["half"] == half], plan, len(steps)), fit_meta, fewest)[0]
            for half in (0, 1)
        ]
        measures: Mapping[str, Callable[[Sequence[MetaFit]], float]] = {
            "meta-d'": lambda own: sum(one.meta_d_prime for one in own) / len(own),
            "M-ratio": lambda own: (
                sum(one.meta_d_prime for one in own) / sum(one.d_prime for one in own)
            ),
        }
        reliability = (
            tried(
                partial(halves_agree, name, _halves(both, of), plan.confidence),
                f"reliability of {name}",
                notes,
            )
            for name, of in measures.items()
        )
        return Metacognition(
            tuple(_meta(name, people, said[name], plan) for name in said),
            people,
            tuple(one for one in reliability if one is not None),
            tuple(notes),
        )

    def show(self, found: Metacognition, plan: RatePlan) -> Presentation:
        """Return means, each person, and the figure of both d'."""
        cells, label = found.conditions, plan.label
        return Presentation(
            blocks=(
                FigurePlace("metacognition"),
                TableBlock.each(
                    "Metacognition: meta-d' and M-ratio over participants",
                    cells,
                    condition(plan),
                    ("People", "", lambda one: str(one.m_ratio.people)),
                    ("d'", "", lambda one: number(one.d_prime.value)),
                    ("meta-d'", "n", lambda one: measured(one.meta_d_prime)),
                    ("meta-d' - d'", "n", lambda one: measured(one.gap)),
                    ("p", "n", lambda one: p_number(one.gap.p)),
                    ("M-ratio", "strong", lambda one: placed(one.m_ratio, one.m_ratio.value)),
                    ("Limits", "n", lambda one: number_range(one.m_ratio.lower, one.m_ratio.upper)),
                ),
                TableBlock.each(
                    "Each participant's meta-d'",
                    found.people,
                    condition(plan),
                    ("Participant", "l", lambda one: label(one.participant)),
                    ("Answers", "", lambda one: str(one.trials)),
                    ("d'", "", lambda one: number(one.fit.d_prime)),
                    ("c", "", lambda one: number(one.fit.criterion)),
                    ("meta-d'", "", lambda one: number(one.fit.meta_d_prime)),
                    ("M-ratio", "strong", lambda one: number(one.m_ratio)),
                    ("Padded", "", lambda one: "yes" if one.fit.padded else "no"),
                ),
                Paragraph(
                    "meta-d': the d' with which an ideal observer's confidence would tell right"
                    " from wrong as well. M-ratio 1: confidence used all that the answer used. That"
                    " of a condition is the mean meta-d' by the mean d'.",
                    muted=True,
                ),
                *reliability_table(found.reliability),
                Cautions(
                    "When not to trust meta-d'",
                    grouped([(label(one.condition), one.warnings) for one in cells]),
                ),
            ),
            sentences=(
                *(_apa_meta(one, plan) for one in cells),
                *(apa_reliability(one, plan) for one in found.reliability),
            ),
            methods=(
                "meta-d' (Maniscalco & Lau, 2012) was fitted to each participant by maximum"
                " likelihood, with equal variances and the criterion's place relative to d' kept;"
                " counts of participants with an empty cell were padded by 1 / (2 x steps) in every"
                f" cell; people with fewer than {ENOUGH}, {FEWEST_WRONG} wrong ones, or a d' not"
                " above its error were left out."
                " M-ratio is the mean meta-d' by the mean d', with Fieller's limits over"
                " participants." + f" {HALVES}" * bool(found.reliability)
            ),
            tables={
                "metacognition.csv": flat_table(cells),
                "metacognition_people.csv": _people_frame(found.people),
                "metacognition_reliability.csv": frame_of(Reliability, found.reliability),
            },
            figures=(
                PartFigure(
                    "metacognition",
                    "meta-d' of each participant against d'; on the dashed line confidence uses all"
                    " that the answers used.",
                    partial(
                        metacognition_plot,
                        {
                            cell.condition: [
                                (one.fit.d_prime, one.fit.meta_d_prime)
                                for one in found.people
                                if one.condition == cell.condition
                            ]
                            for cell in cells
                        },
                        label=label,
                    ),
                ),
            ),
        )


def _people_frame(people: Sequence[PersonMeta | PersonGraded]) -> pd.DataFrame:
    """Return people's fits as a table; a number of one fit has the fit's own name."""
    return flat_table(people).rename(columns=lambda name: name.removeprefix("fit_"))


def _halves(
    both: Sequence[Fits[MetaFit]], of: Callable[[Sequence[MetaFit]], float]
) -> list[tuple[float, float]]:
    """Return a measure of both halves of each person, over conditions that both halves have."""
    first, second = both
    shared: dict[str, list[tuple[str, str]]] = {}
    for key in first.keys() & second.keys():
        shared.setdefault(key[1], []).append(key)
    return [
        (of([first[key] for key in keys]), of([second[key] for key in keys]))
        for _, keys in sorted(shared.items())
    ]


def _meta(
    name: str, people: Sequence[PersonMeta], said: tuple[str, ...], plan: AnalysisPlan
) -> ConditionMeta:
    own = [one.fit for one in people if one.condition == name]
    d_prime, meta = (
        np.array([getattr(one, of) for one in own]) for of in ("d_prime", "meta_d_prime")
    )
    ratio, notes = ratio_of_means(meta, d_prime, plan.confidence), list(said)
    padded = sum(one.padded for one in own)
    if padded:
        notes.append(f"{count_of(padded, 'participant')} with empty cells: padded")
    if len(own) < 2:
        notes.append("one participant only: no limits")
    elif math.isnan(ratio.lower):
        notes.append("the mean d' is too uncertain for limits of M-ratio")
    d, m, gap = (
        mean_over_people(values, plan.confidence, 0.0) for values in (d_prime, meta, meta - d_prime)
    )
    return ConditionMeta(name, d, m, gap, ratio, tuple(notes))


def _apa_meta(one: ConditionMeta, plan: RatePlan) -> str:
    ratio, of = f"M-ratio {placed(one.m_ratio, one.m_ratio.value)}", one.m_ratio
    if not math.isnan(of.lower):
        ratio += f", {level_text(of.level)} {number_range(of.lower, of.upper)}"
    return (
        f"{_where(one.condition, plan)}, meta-d' was {number(one.meta_d_prime.value)} at"
        f" d' = {number(one.d_prime.value)} ({count_of(of.people, 'participant')}), {ratio};"
        f" meta-d' minus d' was {apa_measure(one.gap)}."
    )


class GradedPart(_GradedAnswers[GradedPairs]):
    """ROC, d_a and its slope from answers of a yes-no task that confidence grades."""

    name: ClassVar[str] = "graded"

    def of(self, table: pd.DataFrame, plan: RatePlan) -> GradedPairs:
        """Fit each person in each condition, and all together for the figure."""
        rows, steps, _ = with_steps(table)
        rows = with_shared_noise(rows, plan.answers[0])
        counts, fits, said = _fitted(rows, plan, len(steps), _of_person)
        people = tuple(
            PersonGraded(name, who, int(counts[name, who].sum()), fit)
            for (name, who), fit in fits.items()
        )
        return GradedPairs(
            tuple(_graded(name, counts, people, said[name], plan) for name in said), people, ()
        )

    def show(self, found: GradedPairs, plan: RatePlan) -> Presentation:
        """Return d_a, slopes and the ROC."""
        cells, label = found.conditions, plan.label
        drawn = {one.condition: one.points for one in cells if one.points}
        return Presentation(
            blocks=(
                FigurePlace("roc"),
                TableBlock.each(
                    "Answers graded by confidence: d_a and the slope of the ROC, over participants",
                    cells,
                    condition(plan),
                    ("People", "", lambda one: str(int(one.d_a.df) + 1)),
                    ("Area of ROC", "n", lambda one: measured(one.area)),
                    ("d_a", "strong n", lambda one: measured(one.d_a)),
                    ("p", "n", lambda one: p_number(one.d_a.p)),
                    ("Slope", "strong", lambda one: _slope(one.log_slope)),
                    ("Limits", "n", lambda one: _slope_range(one.log_slope)),
                    ("p", "n", lambda one: p_number(one.log_slope.p)),
                ),
                Paragraph(
                    "d_a: how far signal and noise lie apart, by the root mean square of both"
                    " deviations. Slope: deviation of noise by that of signal; p against 1 (equal"
                    " variances, which d' takes for granted).",
                    muted=True,
                ),
                Cautions(
                    "When not to trust these slopes",
                    grouped([(label(one.condition), one.warnings) for one in cells]),
                ),
            ),
            sentences=tuple(
                f"{_where(one.condition, plan)}, answers graded by confidence gave d_a ="
                f" {apa_measure(one.d_a)}, and a slope of the ROC of"
                f" {_slope(one.log_slope)}{_slope_said(one.log_slope)}."
                for one in cells
            ),
            methods=(
                "Normal evidence with unequal variances was fitted to each participant's graded"
                " answers by maximum likelihood, with half an answer added to each stimulus; d_a"
                " and the logarithm of the slope were averaged"
                f" over participants, with t limits; people with fewer than {ENOUGH} were left out."
            ),
            tables={
                "graded.csv": flat_table(cells).drop(columns="points"),
                "graded_people.csv": _people_frame(found.people),
                "roc.csv": pd.DataFrame(
                    [
                        {"condition": name, "false_alarms": low, "hits": high}
                        for name, points in drawn.items()
                        for low, high in points
                    ],
                    columns=["condition", "false_alarms", "hits"],
                ),
            },
            figures=(
                PartFigure(
                    "roc",
                    "ROC of answers graded by confidence, all participants together; curves: normal"
                    " evidence with unequal variances; dashed: chance.",
                    partial(
                        roc_plot,
                        drawn,
                        {one.condition: one.together for one in cells},
                        labels=("False alarms", "Hits"),
                        label=label,
                    ),
                ),
            ),
        )


_of_person = partial(fit_unequal, padding=UNBIASED_PADDING)


def _graded(
    name: str,
    counts: Counts,
    people: Sequence[PersonGraded],
    said: tuple[str, ...],
    plan: AnalysisPlan,
) -> ConditionGraded:
    cells = [one for (condition, _), one in counts.items() if condition == name]
    own = [one.fit for one in people if one.condition == name]
    areas = np.array([graded_area(one) for one in cells])
    d_a = mean_over_people(np.array([one.d_a for one in own]), plan.confidence, 0.0)
    slope = mean_over_people(np.log([one.slope for one in own]), plan.confidence, 0.0)
    notes = [*said]
    if len(own) < 2:
        notes.append("one participant only: no limits")
    every = np.sum(cells, axis=0)
    together = tried(partial(fit_unequal, every), "curve of all answers together", notes)
    area = mean_over_people(areas, plan.confidence, 0.5, within=(0.0, 1.0))
    return ConditionGraded(name, area, d_a, slope, together, roc_points(every), tuple(notes))


def _slope(log_slope: Measure) -> str:
    ends = math.exp(log_slope.lower), math.exp(log_slope.upper)
    return number(math.exp(log_slope.value), within=ends)


def _slope_range(log_slope: Measure) -> str:
    return number_range(math.exp(log_slope.lower), math.exp(log_slope.upper))


def _slope_said(log_slope: Measure) -> str:
    if math.isnan(log_slope.lower):
        return " (one participant: no limits)"
    said = f", {level_text(log_slope.level)} {_slope_range(log_slope)}"
    return said if math.isnan(log_slope.p) else f"{said}, {p_text(log_slope.p)} against 1"


def _where(name: str, plan: AnalysisPlan) -> str:
    return "All conditions together" if name == TOGETHER else f"In condition {plan.label(name)}"
