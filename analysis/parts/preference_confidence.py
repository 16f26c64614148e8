"""Confidence in preferences, which are neither right nor wrong: what it goes with.

Others' choices, and one's own at another time, say which preferences are clear.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
import pandas as pd

from analysis.data_dictionary import frame_of
from analysis.models.compared_methods import pairing_rows
from analysis.models.detection import Measure
from analysis.models.metacognition import Reliability, mean_over_people
from analysis.parts import PartFigure, Presentation, SimplePart, tried
from analysis.parts.confidence import (
    HALVES,
    SECTION,
    apa_measure,
    apa_reliability,
    apart,
    halved,
    measured,
    reliability_of,
    reliability_table,
    with_steps,
)
from analysis.plans.preference_plan import PreferencePlan
from analysis.plots.confidence_plots import pairs_plot
from analysis.report.values import flat_table
from analysis.report.wording import by_how_much, p_number, share
from protocols.blocks import FigurePlace, Paragraph, TableBlock
from protocols.tasks.confidence_question import CONFIDENCE

CELL = ["pair", "scene", "size"]
"""Columns that make two questions the same."""


@dataclass(frozen=True)
class PairConfidence:
    """Share of choices of one of a pair, and the confidence in them, over people."""

    method: str
    against: str
    trials: int
    share: float
    confidence: Measure


@dataclass(frozen=True)
class ConfidenceCorrelate:
    """Difference of confidence within each person that goes with `what`.

    `people` are those who have both; with none of them `difference` is None, and `lacking` says
    why.
    """

    what: str
    people: int
    difference: Measure | None
    lacking: str


@dataclass(frozen=True)
class PreferenceConfidence:
    """Every number; `people` are their mean confidence by pair."""

    steps: tuple[float, ...]
    pairs: tuple[PairConfidence, ...]
    people: Mapping[str, tuple[tuple[str, float], ...]]
    companions: tuple[ConfidenceCorrelate, ...]
    reliability: tuple[Reliability, ...]
    notes: tuple[str, ...]


class PreferenceConfidencePart(SimplePart[PreferencePlan, PreferenceConfidence]):
    """Confidence beside strength of preference, agreement with others, and consistency."""

    name: ClassVar[str] = "confidence"
    section: ClassVar[tuple[str, str]] = SECTION

    def wanted(self, table: pd.DataFrame, _plan: PreferencePlan) -> bool:
        """Return True if there is a column of confidence."""
        return CONFIDENCE in table

    def of(self, table: pd.DataFrame, plan: PreferencePlan) -> PreferenceConfidence:
        """Take each person's values, and their means."""
        rows, steps, notes = with_steps(table)
        rows = _with_others(rows)
        pairs, people = [], {}
        for method, against in plan.pairings:
            own = pairing_rows(rows, method, against)
            if own.empty:
                continue
            means = own.groupby("participant", observed=True)[CONFIDENCE].mean()
            chosen = float((own["chosen"] == method).mean())
            ends = steps[0], steps[-1]
            mean = mean_over_people(means.to_numpy(float), plan.confidence, within=ends)
            pairs.append(PairConfidence(method, against, len(own), chosen, mean))
            name = plan.label(method) + " / " + plan.label(against)
            people[name] = tuple((str(who), float(value)) for who, value in means.items())
        reliability = tried(
            partial(
                reliability_of,
                halved(rows, ["pair"]),
                "mean confidence",
                lambda own: float(own[CONFIDENCE].mean()),
                plan,
            ),
            "reliability of mean confidence",
            notes,
        )
        return PreferenceConfidence(
            steps,
            tuple(pairs),
            people,
            tuple(_companion(rows, steps, *one, plan) for one in _COMPANIONS),
            () if reliability is None else (reliability,),
            tuple(notes),
        )

    def show(self, found: PreferenceConfidence, plan: PreferencePlan) -> Presentation:
        """Return confidence of each pair, and what it goes with."""
        label, steps = plan.label, ", ".join(map("{:g}".format, found.steps))
        named = [(one, f"{label(one.method)} / {label(one.against)}") for one in found.pairs]
        return Presentation(
            blocks=(
                FigurePlace("confidence"),
                TableBlock.each(
                    f"Confidence by comparison (steps {steps}), means over participants",
                    named,
                    ("Comparison", "l c", lambda one: one[1]),
                    ("Choices", "", lambda one: str(one[0].trials)),
                    ("Share", "", lambda one: share(one[0].share)),
                    ("Confidence", "strong n", lambda one: measured(one[0].confidence)),
                ),
                TableBlock.each(
                    "Correlates of confidence, within participants",
                    found.companions,
                    ("More confidence where", "l c", lambda one: one.what),
                    ("People", "", lambda one: str(one.people)),
                    ("By, steps", "strong n", lambda one: _said(one)),
                    ("p", "n", lambda one: p_number(one.difference.p if one.difference else None)),
                ),
                Paragraph(
                    "Others: all but the person. No preference is right, so confidence here says"
                    " nothing of metacognition. Limits are over participants: of people like these,"
                    " with these scenes.",
                    muted=True,
                ),
                *reliability_table(found.reliability),
            ),
            sentences=(
                *(
                    f"Choices between {label(one.method)} and {label(one.against)} (share"
                    f" {share(one.share)}) came with a mean confidence of"
                    f" {apa_measure(one.confidence)}."
                    for one in found.pairs
                ),
                *(
                    f"Where {one.what}, confidence was"
                    f" {by_how_much(gap, gap.value, 'steps', ('higher', 'lower'))}: difference"
                    f" {apa_measure(gap)}."
                    for one in found.companions
                    if (gap := one.difference) is not None
                ),
                *(apa_reliability(one, plan) for one in found.reliability),
            ),
            methods=(
                "Confidence was averaged over each participant's choices, and compared within"
                " participants by how the others chose in the same comparison and scene, and by"
                " whether a repeat got the same answer; tests are t over participants."
                + f" {HALVES}"
                * bool(found.reliability)
            ),
            tables={
                "confidence.csv": flat_table(found.pairs),
                "confidence_goes_with.csv": flat_table(found.companions),
                "confidence_people.csv": pd.DataFrame(
                    [
                        {"comparison": name, "participant": who, "confidence": value}
                        for name, values in found.people.items()
                        for who, value in values
                    ]
                ),
                "confidence_reliability.csv": frame_of(Reliability, found.reliability),
            },
            figures=(
                PartFigure(
                    "confidence",
                    f"Mean confidence by comparison with {plan.limits} over"
                    " participants; in brackets the share of the first; small: participants.",
                    partial(
                        pairs_plot,
                        {
                            f"{name} ({share(one.share)})": (("Confidence", one.confidence),)
                            for one, name in named
                        },
                        {
                            f"{name} ({share(one.share)})": [
                                (value,) for _, value in found.people[name]
                            ]
                            for one, name in named
                        },
                        x_label="Confidence",
                        level=plan.confidence,
                    ),
                ),
            ),
        )


def _said(one: ConfidenceCorrelate) -> str:
    return one.lacking if one.difference is None else measured(one.difference)


def _with_others(rows: pd.DataFrame) -> pd.DataFrame:
    """Return rows with ``pair``, ``low`` (its first in sorted order was chosen), ``others``.

    ``others`` is how often the other people chose it in the same cell; NaN where nobody else did.
    """
    first, second = rows["first"].astype(str), rows["second"].astype(str)
    low = first.where(first < second, second)
    rows = rows.assign(
        pair=low + " / " + second.where(first < second, first),
        low=(rows["chosen"].astype(str) == low).astype(float),
    )
    every = rows.groupby(CELL, observed=True)["low"]
    own = rows.groupby(["participant", *CELL], observed=True)["low"]
    count = every.transform("size") - own.transform("size")
    chosen = every.transform("sum") - own.transform("sum")
    return rows.assign(others=chosen / count.where(count > 0))


def _by_strength(own: pd.DataFrame) -> float:
    """Return the surplus of confidence where others are unanimous over where they are divided."""
    known = own[own["others"].notna()]
    strength = 2.0 * (known["others"] - 0.5).abs().to_numpy(float)
    if strength.size < 3 or float(np.ptp(strength)) == 0.0:
        return math.nan
    centred = strength - strength.mean()
    return float(centred @ known[CONFIDENCE].to_numpy(float) / (centred @ centred))


def _with_most(own: pd.DataFrame) -> float:
    side = (own["others"] - 0.5) * (own["low"] - 0.5)
    return float(own.loc[side > 0, CONFIDENCE].mean() - own.loc[side < 0, CONFIDENCE].mean())


def _consistent(own: pd.DataFrame) -> float:
    cells = own.groupby(CELL, observed=True)["low"]
    again, mixed = cells.transform("size") > 1, cells.transform("nunique") > 1
    same, other = (own.loc[again & which, CONFIDENCE].mean() for which in (~mixed, mixed))
    return float(same - other)


_COMPANIONS: tuple[tuple[str, Callable[[pd.DataFrame], float], str], ...] = (
    ("all others chose alike, against as many each way", _by_strength, "others never vary"),
    ("most others chose the same", _with_most, "nobody chose both with and against the others"),
    ("a repeat got the same answer", _consistent, "no repeats with same and with other answers"),
)


def _companion(
    rows: pd.DataFrame,
    steps: Sequence[float],
    what: str,
    of: Callable[[pd.DataFrame], float],
    lacking: str,
    plan: PreferencePlan,
) -> ConfidenceCorrelate:
    values = np.array([of(own) for _, own in rows.groupby("participant", observed=True)])
    people = int(np.isfinite(values).sum())
    if not people:
        return ConfidenceCorrelate(what, 0, None, lacking)
    within = (-math.inf, math.inf) if of is _by_strength else apart(steps)  # a slope has no end
    mean = mean_over_people(values, plan.confidence, 0.0, within=within)
    return ConfidenceCorrelate(what, people, mean, "")
