"""Confidence in answers that are right or wrong: what it tells of them, and people's metacognition.

All means and limits are over participants, each with a value of their own: claims about people
like these, with the scenes that were shown.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
import pandas as pd

from analysis.data_dictionary import frame_of
from analysis.models.cells import grid
from analysis.models.detection import Measure
from analysis.models.metacognition import (
    MOST_STEPS,
    Reliability,
    halves_agree,
    mean_over_people,
    rank_area,
    roc_points,
)
from analysis.models.right_answers import Rate, rate
from analysis.parts import AnalysisPlan, PartFigure, Presentation, SimplePart, tried
from analysis.parts.shared import condition, limits
from analysis.plans.rate_plan import RatePlan, shown_in
from analysis.plots.confidence_plots import calibration_plot, pairs_plot, roc_plot
from analysis.report.values import flat_table
from analysis.report.wording import (
    level_text,
    number,
    number_range,
    p_number,
    p_text,
    placed,
    share,
    share_range,
)
from protocols.blocks import Block, Cautions, FigurePlace, Paragraph, TableBlock, grouped
from protocols.prose import count_of
from protocols.tasks.confidence_question import CONFIDENCE

SECTION = ("confidence", "Confidence")


def with_steps(table: pd.DataFrame) -> tuple[pd.DataFrame, tuple[float, ...], list[str]]:
    """Return the rows with confidence, the steps that were used, and notes of what is odd.

    Returns
    -------
    rows : DataFrame
        Also with ``step``, the place of the confidence among the steps, from 0.

    Raises
    ------
    ValueError
        If confidence is no number, has too many values, or never varies.
    """
    given = table[CONFIDENCE].replace("", np.nan)
    values = pd.to_numeric(given, errors="coerce").astype(float)
    words = given[given.notna() & ~np.isfinite(values)]
    if len(words):
        raise ValueError(
            f"the column {CONFIDENCE} must hold numbers, such as 1 to 4 (found {words.iloc[0]!r})"
        )
    steps = tuple(sorted(map(float, values.dropna().unique())))
    if len(steps) > MOST_STEPS:
        raise ValueError(
            f"the column {CONFIDENCE} must hold steps, at most {MOST_STEPS} (found {len(steps)}"
            " values); group them into steps"
        )
    if not steps:
        raise ValueError("no answer has a confidence")
    if len(steps) < 2:
        raise ValueError(f"every answer was given with the same confidence ({steps[0]:g})")
    notes = []
    missing = int(values.isna().sum())
    if missing:
        notes.append(
            f"confidence is missing in {missing} of {len(table)} answers, which are left out of all"
            " that is said of it"
        )
    rows = table.assign(**{CONFIDENCE: values})[values.notna()].reset_index(drop=True)
    rows["step"] = np.searchsorted(steps, rows[CONFIDENCE])
    flat = rows.groupby("participant", observed=True)["step"].nunique()
    if (flat < 2).any():
        who = [str(name) for name in flat.index[flat < 2]]
        notes.append(
            f"{', '.join(who[:8])}{' ...' * (len(who) > 8)} gave one step of confidence only, which"
            " tells nothing"
        )
    return rows, steps, notes


def halved(rows: pd.DataFrame, within: Sequence[str]) -> pd.DataFrame:
    """Return rows in order of the session with ``half``: odd and even ones of what is alike."""
    if "order" in rows:
        rows = rows.sort_values("order", kind="stable")
    alike = rows.groupby(["participant", *within], observed=True, sort=False)
    return rows.assign(half=alike.cumcount() % 2)


def reliability_table(found: Sequence[Reliability]) -> Iterator[Block]:
    """Yield the table of split halves; nothing where there are none."""
    if found:
        yield TableBlock.each(
            "Reliability of differences between people: odd against even trials",
            found,
            ("Of", "l", lambda one: one.measure),
            ("People", "", lambda one: str(one.people)),
            ("r of halves", "", lambda one: share(one.half)),
            ("Reliability", "strong", lambda one: share(one.value)),
            limits(text=share_range),
        )


def apa_reliability(one: Reliability, plan: AnalysisPlan) -> str:
    """Return a split-half reliability as a sentence."""
    return (
        f"The split-half reliability (Spearman-Brown) of {one.measure} over {one.people}"
        f" participants was {share(one.value)}, {level_text(plan.confidence)}"
        f" {share_range(one.lower, one.upper)}."
    )


HALVES = (
    "Reliability of people's differences is the correlation of odd and even trials, within what was"
    " shown, stepped up by the Spearman-Brown formula; its limits are Fisher's."
)


def measured(one: Measure | None) -> str:
    """Return a mean with its limits for a table, or why there is none."""
    if one is None:
        return "none"
    return f"{placed(one, one.value)} {number_range(one.lower, one.upper)}".removesuffix(" none")


def apa_measure(one: Measure, *, against: float = 0.0) -> str:
    """Return a mean over people in a sentence, with its limits and test where there are any."""
    if math.isnan(one.lower):
        return f"{number(one.value)} (one participant: no limits)"
    text = f"{placed(one, one.value)}, {level_text(one.level)} {number_range(one.lower, one.upper)}"
    if math.isnan(one.p):
        return text
    ratio = (one.value - against) / one.standard_error
    said = f" against {share(against)}" if against else ""
    return f"{text}, t({one.df:.0f}) = {number(ratio)}, {p_text(one.p)}{said}"


# Confidence by correctness.


@dataclass(frozen=True)
class PersonConfidence:
    """Confidence of one person in one condition, in its steps; NaN where there is no answer."""

    condition: str
    participant: str
    trials: int
    mean: float
    right: float
    wrong: float
    area: float


@dataclass(frozen=True)
class ConditionConfidence:
    """Means over people in one condition; None where nobody has the value.

    `difference` is right minus wrong of those who gave both; `area` that below the type-2 ROC,
    tested against one half.
    """

    condition: str
    trials: int
    participants: int
    mean: Measure | None
    right: Measure | None
    wrong: Measure | None
    difference: Measure | None
    area: Measure | None
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class CalibrationPoint:
    """The share of right answers at one step of confidence; the rate names the condition."""

    step: float
    rate: Rate


@dataclass(frozen=True)
class ConfidenceResults:
    """Every number; `roc` are points (wrong, right answers at least so sure) by condition."""

    steps: tuple[float, ...]
    conditions: tuple[ConditionConfidence, ...]
    people: tuple[PersonConfidence, ...]
    calibration: tuple[CalibrationPoint, ...]
    roc: Mapping[str, tuple[tuple[float, float], ...]]
    reliability: tuple[Reliability, ...]
    notes: tuple[str, ...]


class ConfidencePart(SimplePart[RatePlan, ConfidenceResults]):
    """Confidence of right and wrong answers, type-2 ROC area, calibration, reliability."""

    name: ClassVar[str] = "confidence"
    section: ClassVar[tuple[str, str]] = SECTION

    def wanted(self, table: pd.DataFrame, plan: RatePlan) -> bool:
        """Return True if there is a column of confidence, which is no condition."""
        return CONFIDENCE in table and CONFIDENCE not in plan.by_columns

    def of(self, table: pd.DataFrame, plan: RatePlan) -> ConfidenceResults:
        """Take each person's values in each condition, and their means."""
        rows, steps, notes = with_steps(table)
        places, names = grid(rows), shown_in(rows, plan)
        people = [one for name in names for one in _people(name, _of(rows, name))]
        calibration = [
            CalibrationPoint(
                step,
                rate(
                    part["correct"],
                    places,
                    condition=name,
                    chance=plan.chance,
                    level=plan.confidence,
                ),
            )
            for name in names
            for step in steps
            for part in [rows[(rows["condition"] == name) & (rows[CONFIDENCE] == step)]]
            if len(part)
        ]
        halves = halved(rows, [*plan.compared, "correct"])
        measures = {
            "mean confidence": lambda own: float(own[CONFIDENCE].mean()),
            "type-2 ROC area": _mean_area,
        }
        found = (
            tried(partial(reliability_of, halves, name, of, plan), f"reliability of {name}", notes)
            for name, of in measures.items()
        )
        return ConfidenceResults(
            steps,
            tuple(_condition(name, people, steps, plan) for name in names),
            tuple(people),
            tuple(calibration),
            {name: _type_2(_of(rows, name), len(steps)) for name in names},
            tuple(one for one in found if one is not None),
            tuple(notes),
        )

    def show(self, found: ConfidenceResults, plan: RatePlan) -> Presentation:
        """Return tables and figures of both kinds of answers, and what the steps are worth."""
        label, cells = plan.label, found.conditions
        steps = f"steps {', '.join(map('{:g}'.format, found.steps))}"
        rows = {one.condition: (("right", one.right), ("wrong", one.wrong)) for one in cells}
        dots = {
            one.condition: tuple(
                (own.right, own.wrong) for own in found.people if own.condition == one.condition
            )
            for one in cells
        }
        series = {
            one.condition: [
                (own.step, own.rate)
                for own in found.calibration
                if own.rate.condition == one.condition
            ]
            for one in cells
        }
        return Presentation(
            blocks=(
                FigurePlace("confidence"),
                TableBlock.each(
                    f"Confidence of right and wrong answers ({steps}), means over participants",
                    cells,
                    condition(plan),
                    ("Answers", "", lambda one: str(one.trials)),
                    ("Right", "n", lambda one: measured(one.right)),
                    ("Wrong", "n", lambda one: measured(one.wrong)),
                    ("Right - wrong", "strong n", lambda one: measured(one.difference)),
                    ("p", "n", lambda one: p_number(one.difference.p if one.difference else None)),
                    ("Type-2 area", "strong n", lambda one: measured(one.area)),
                    ("p", "n", lambda one: p_number(one.area.p if one.area else None)),
                ),
                Paragraph(
                    "Type-2 area: how probably a right answer came with more confidence than a"
                    " wrong one (.5: confidence tells nothing). It grows with d', too. Limits are"
                    " over participants: of people like these, with these scenes.",
                    muted=True,
                ),
                FigurePlace("calibration"),
                TableBlock.each(
                    "Share of right answers at each confidence",
                    found.calibration,
                    ("Condition", "l c", lambda one: label(one.rate.condition)),
                    ("Confidence", "", lambda one: f"{one.step:g}"),
                    ("Answers", "", lambda one: str(one.rate.trials)),
                    ("Share right", "strong", lambda one: share(one.rate.share)),
                    ("Limits", "n", lambda one: share_range(one.rate.lower, one.rate.upper)),
                ),
                FigurePlace("type_2_roc"),
                *reliability_table(found.reliability),
                Cautions(
                    "About this confidence",
                    grouped([(label(one.condition), one.warnings) for one in cells]),
                ),
            ),
            sentences=(
                *_sentences(found, plan),
                *(apa_reliability(one, plan) for one in found.reliability),
            ),
            methods=(
                "Confidence was averaged over each participant's right and wrong answers; type-2"
                " ROC areas are each participant's chance that a right answer came with more"
                " confidence than a wrong one. Means over participants have t limits, which end at"
                " the least and the largest value that there can be."
                + f" {HALVES}"
                * bool(found.reliability)
            ),
            tables={
                "confidence.csv": flat_table(cells),
                "confidence_people.csv": pd.DataFrame(map(vars, found.people)),
                "calibration.csv": pd.DataFrame(
                    [
                        {"step": one.step}
                        | vars(one.rate)
                        | {"warnings": "; ".join(one.rate.warnings)}
                        for one in found.calibration
                    ]
                ),
                "confidence_reliability.csv": frame_of(Reliability, found.reliability),
            },
            figures=(
                PartFigure(
                    "confidence",
                    f"Mean confidence of right and wrong answers with {plan.limits} over"
                    " participants; small: participants.",
                    partial(
                        pairs_plot,
                        rows,
                        dots,
                        x_label="Confidence",
                        level=plan.confidence,
                        label=label,
                    ),
                ),
                PartFigure(
                    "calibration",
                    f"Share of right answers at each step of confidence, with {plan.limits};"
                    " dashed: chance.",
                    partial(
                        calibration_plot,
                        series,
                        chance=plan.chance,
                        level=plan.confidence,
                        label=label,
                    ),
                ),
                *(
                    [
                        PartFigure(
                            "type_2_roc",
                            "Type-2 ROC of all answers together: how often right and wrong answers"
                            " came with at least so much confidence; dashed: confidence tells"
                            " nothing.",
                            partial(
                                roc_plot,
                                {name: points for name, points in found.roc.items() if points},
                                {},
                                labels=("Wrong answers at least so sure", "Right answers so sure"),
                                label=label,
                            ),
                        )
                    ]
                    if any(found.roc.values())
                    else []
                ),
            ),
        )


def _of(rows: pd.DataFrame, name: str) -> pd.DataFrame:
    return rows[rows["condition"] == name]


def _area(own: pd.DataFrame) -> float:
    steps, right = own["step"].to_numpy(float), own["correct"].to_numpy() == 1
    return rank_area(steps[right], steps[~right])


def _mean_area(own: pd.DataFrame) -> float:
    areas = [_area(part) for _, part in own.groupby("condition")]
    known = [area for area in areas if not math.isnan(area)]
    return float(np.mean(known)) if known else math.nan


def _people(name: str, rows: pd.DataFrame) -> Iterator[PersonConfidence]:
    for who, own in rows.groupby("participant", sort=True):
        right, wrong = (own.loc[own["correct"] == k, CONFIDENCE].mean() for k in (1, 0))
        mean = float(own[CONFIDENCE].mean())
        yield PersonConfidence(
            name, str(who), len(own), mean, float(right), float(wrong), _area(own)
        )


def _condition(
    name: str, people: Sequence[PersonConfidence], steps: Sequence[float], plan: AnalysisPlan
) -> ConditionConfidence:
    own = [one for one in people if one.condition == name]
    right, wrong = (np.array([getattr(one, kind) for one in own]) for kind in ("right", "wrong"))
    both = np.isfinite(right - wrong)
    notes = []
    if not both.any():
        lacking = "wrong" if np.isnan(wrong).all() else "right and wrong"
        notes.append(f"nobody has {lacking} answers: no difference, no type-2 area")
    elif not both.all():
        notes.append(
            f"{count_of(int((~both).sum()), 'participant')} without right or without wrong answers:"
            " not in the difference and the type-2 area"
        )
    if len(own) < 2:
        notes.append("one participant only: no limits")
    take, scale = partial(mean_over_people, level=plan.confidence), (steps[0], steps[-1])
    return ConditionConfidence(
        condition=name,
        trials=sum(one.trials for one in own),
        participants=len(own),
        mean=_known(take(np.array([one.mean for one in own]), within=scale)),
        right=_known(take(right, within=scale)),
        wrong=_known(take(wrong, within=scale)),
        difference=_known(take(right - wrong, against=0.0, within=apart(steps))),
        area=_known(take(np.array([one.area for one in own]), against=0.5, within=(0.0, 1.0))),
        warnings=tuple(notes),
    )


def apart(steps: Sequence[float]) -> tuple[float, float]:
    """Return the least and the largest difference that means of these steps can have."""
    return steps[0] - steps[-1], steps[-1] - steps[0]


def _known(one: Measure) -> Measure | None:
    return None if math.isnan(one.value) else one


def _type_2(rows: pd.DataFrame, steps: int) -> tuple[tuple[float, float], ...]:
    counts = np.zeros((2, steps))
    np.add.at(counts, (rows["correct"].to_numpy(int), rows["step"].to_numpy(int)), 1.0)
    return roc_points(counts) if (counts.sum(axis=1) > 0).all() else ()


def reliability_of(
    rows: pd.DataFrame, name: str, of: Callable[[pd.DataFrame], float], plan: AnalysisPlan
) -> Reliability:
    """Return the correlation of a measure between both halves of people's rows."""
    pairs = [
        (of(own[own["half"] == 0]), of(own[own["half"] == 1]))
        for _, own in rows.groupby("participant", observed=True)
    ]
    return halves_agree(name, pairs, plan.confidence)


def _sentences(found: ConfidenceResults, plan: RatePlan) -> Iterator[str]:
    for one in found.conditions:
        name = plan.label(one.condition)
        if one.difference is None or one.right is None or one.wrong is None or one.area is None:
            mean = "none" if one.mean is None else apa_measure(one.mean).split(", t(")[0]
            yield f"In condition {name}, mean confidence was {mean}; {one.warnings[0]}."
            continue
        yield (
            f"In condition {name}, confidence was {number(one.right.value)} in right and"
            f" {number(one.wrong.value)} in wrong answers, a difference of"
            f" {apa_measure(one.difference)}; the type-2 ROC area was"
            f" {apa_measure(one.area, against=0.5)}."
        )
