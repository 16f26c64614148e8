"""Quality in JOD: Thurstone's scale of the methods, and whether answers fit on one axis."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import ClassVar

import numpy as np
import pandas as pd

from analysis import SEED
from analysis.arrays import Floats
from analysis.models.bootstrap import ScaleIntervals, bootstrap_scale
from analysis.models.compared_methods import as_numbers, numbered_names
from analysis.models.observers import ObserverCheck, check_observers
from analysis.models.scaling import Scale, scale
from analysis.parts import PartFigure, Presentation, SimplePart, tried
from analysis.plans.preference_plan import PreferencePlan
from analysis.plots import jod_plot
from analysis.report.result_table import (
    ResultColumn,
    ResultTable,
    attribute,
    estimated,
    limits,
)
from analysis.report.values import frame_of
from analysis.report.wording import (
    leading,
    number,
    p_number,
    p_text,
)
from analysis.showable import FamilyOfTests
from protocols.blocks import (
    Block,
    Cautions,
    FigurePlace,
    Folded,
    Heading,
    Paragraph,
    grouped,
)

BOOTSTRAP_SAMPLES = 2000


@dataclass(frozen=True)
class MethodScore:
    """The score of a method at a size, with limits."""

    method: str
    jod: float
    lower: float
    upper: float
    standard_error: float
    size: str


@dataclass(frozen=True)
class JodDifference:
    """Distance of two methods, with limits and p of the two-way bootstrap.

    `clustered_p_adjusted` is Holm's over the scale's; None where one participant's votes are all
    there is.
    """

    first: str
    second: str
    difference: float
    lower: float = math.nan
    upper: float = math.nan
    clustered_p: float | None = None
    clustered_p_adjusted: float | None = None
    size: str = ""


@dataclass(frozen=True)
class SizeScale:
    """Scale of the methods at one size, and whether the answers fit on one axis."""

    size: str
    scale: Scale
    intervals: ScaleIntervals | None
    contrasts: tuple[JodDifference, ...]
    observers: ObserverCheck
    warnings: tuple[str, ...]

    def scores(self) -> list[MethodScore]:
        """Return the methods; limits of none are NaN."""
        limits, names = self.intervals, self.scale.conditions
        nothing = np.full((3, len(names)), np.nan)
        ends = nothing if limits is None else (limits.lower, limits.upper, limits.standard_error)
        rows = np.column_stack([self.scale.scores, *ends]).tolist()
        return [
            MethodScore(name, jod, lower, upper, error, self.size)
            for name, (jod, lower, upper, error) in zip(names, rows, strict=True)
        ]


@dataclass(frozen=True)
class Scales:
    """Every number, by size."""

    sizes: tuple[SizeScale, ...]
    notes: tuple[str, ...]


class ScalePart(SimplePart[PreferencePlan, Scales]):
    """Thurstone Case V by size, with limits of a bootstrap over participants and scenes."""

    name: ClassVar[str] = "scale"
    section: ClassVar[tuple[str, str]] = ("scale", "Scale")

    def of(self, table: pd.DataFrame, plan: PreferencePlan) -> Scales:
        """Fit the methods of each size that can be placed on an axis."""
        decisions, notes = as_numbers(table), list[str]()
        sizes = (
            tried(
                partial(_size_scale, decisions, plan, size),
                f"scale{plan.at(size, ' at {}')}",
                notes,
            )
            for size in plan.sizes
        )
        return Scales(tuple(one for one in sizes if one is not None), tuple(notes))

    def families(self, cells: pd.DataFrame, _plan: PreferencePlan) -> Sequence[FamilyOfTests]:
        """Return the differences of three methods or more, by how many each size compares."""
        shown = [{*rows["method"], *rows["against"]} for _, rows in cells.groupby("size")]
        return [_family(count) for count in sorted({len(one) for one in shown}) if count > 2]

    def show(self, found: Scales, plan: PreferencePlan) -> Presentation:
        """Return a figure of all sizes; scores, differences and checks of each."""
        if not found.sizes:
            return Presentation()
        caption = (
            "Quality in JOD (mean zero; of two 1 JOD apart, 75 % choose the better) with"
            f" {100 * plan.confidence:g} % bootstrap limits."
        )
        scales = {one.size: (one.scale, one.intervals) for one in found.sizes}
        scores = [row for one in found.sizes for row in one.scores()]
        gaps = [row for one in found.sizes for row in one.contrasts]
        return Presentation(
            blocks=tuple(_blocks(found, plan)),
            others=(
                Folded(
                    "Differences in JOD",
                    "They say how far methods lie apart in the unit of the papers' scales; all"
                    " comparisons together place each method, so that one may differ here from its"
                    " own share of choices.",
                    tuple(_differences(found, plan)),
                ),
            ),
            methods=(
                "Quality in just objectionable differences (JOD; 1 JOD = 75% of choices) was"
                " estimated by maximum likelihood under Thurstone's Case V, with two-way bootstrap"
                " intervals over participants and scenes."
            ),
            tables={"scale.csv": frame_of(scores), "scale_differences.csv": frame_of(gaps)},
            figures=(PartFigure("scale", caption, partial(jod_plot, scales, label=plan.label)),),
        )


def _family(methods: int) -> FamilyOfTests:
    return FamilyOfTests("difference", " in JOD", math.comb(methods, 2))


def votes_of(decisions: pd.DataFrame, methods: tuple[str, ...]) -> tuple[Floats, list[str]]:
    """Count votes (participants, scenes, k, k) for i over j."""
    person, people = numbered_names(decisions["participant"])
    scene, scenes = numbered_names(decisions["scene"])
    place = {name: index for index, name in enumerate(methods)}
    won = decisions["chosen"].map(place).to_numpy(dtype=np.int64)
    lost = decisions["rejected"].map(place).to_numpy(dtype=np.int64)
    votes = np.zeros((len(people), len(scenes), len(methods), len(methods)))
    np.add.at(votes, (person, scene, won, lost), 1.0)
    return votes, list(people)


def _size_scale(decisions: pd.DataFrame, plan: PreferencePlan, size: str) -> SizeScale:
    rows, methods = plan.compared_at(decisions, size)
    if len(methods) < 2:
        raise ValueError("fewer than two methods were compared")
    votes, people = votes_of(rows, methods)
    total = votes.sum(axis=(0, 1))
    fitted, found = scale(total, methods), list[str]()
    intervals = None
    if len(people) > 1:
        try:
            intervals = bootstrap_scale(
                votes,
                rng=np.random.default_rng(SEED),
                samples=BOOTSTRAP_SAMPLES,
                level=plan.confidence,
            )
        except ValueError as problem:
            found.append(str(problem))
    if intervals is not None and len(methods) > 2:
        found += _family(len(methods)).hopeless(len(people), plan.alpha)
    return SizeScale(
        size=size,
        scale=fitted,
        intervals=intervals,
        contrasts=tuple(
            _difference(fitted, place, intervals, size)
            for place in combinations(range(len(methods)), 2)
        ),
        observers=check_observers(
            votes.sum(axis=1), people, rng=np.random.default_rng(SEED), alpha=plan.alpha
        ),
        warnings=tuple(found),
    )


def _difference(
    fitted: Scale, place: tuple[int, int], intervals: ScaleIntervals | None, size: str
) -> JodDifference:
    first, second = (fitted.conditions[one] for one in place)
    gap = float(fitted.scores[place[0]] - fitted.scores[place[1]])
    if intervals is None:
        return JodDifference(first, second, gap, size=size)
    return JodDifference(
        first,
        second,
        gap,
        float(intervals.difference_lower[place]),
        float(intervals.difference_upper[place]),
        float(intervals.difference_p[place]),
        float(intervals.difference_p_adjusted[place]),
        size,
    )


def _blocks(found: Scales, plan: PreferencePlan) -> Iterator[Block]:
    label = plan.label
    yield FigurePlace("scale")
    for size in found.sizes:
        if plan.sized:
            yield Heading(plan.at(size.size, whole="All sizes"))
        yield ResultTable.of(
            "Thurstone Case V, mean zero",
            size.scores(),
            attribute("Method", "method", label, "l"),
            estimated("JOD", "jod"),
            limits(plan.limits),
            attribute("bootstrap SE", "standard_error"),
        ).block()
        yield Paragraph(" ".join(_checks(size, plan)), muted=True)
    notes = [
        (
            plan.at(one.size),
            one.scale.warnings
            + (one.intervals.warnings if one.intervals else ())
            + one.observers.warnings
            + one.warnings,
        )
        for one in found.sizes
    ]
    yield Cautions("When not to trust these scales", grouped(notes))


def _differences(found: Scales, plan: PreferencePlan) -> Iterator[Block]:
    for size in found.sizes:
        yield ResultTable.of(
            f"By bootstrap of participants and scenes, p adj. by Holm{plan.at(size.size, ' ({})')}",
            size.contrasts,
            ResultColumn(
                "Methods", "l", lambda one: f"{plan.label(one.first)} - {plan.label(one.second)}"
            ),
            estimated("JOD", "difference"),
            limits(plan.limits),
            attribute("p", "clustered_p", p_number),
            attribute("p adj.", "clustered_p_adjusted", p_number),
        ).block()


def _checks(one: SizeScale, plan: PreferencePlan) -> Iterator[str]:
    """Yield sentences for and against one axis."""
    fitted = one.scale
    if fitted.fit_df > 0:
        yield (
            f"One axis suffices: χ²({fitted.fit_df}) = {number(fitted.deviance)},"
            f" {p_text(fitted.fit_p)} (likelihood ratio, trials as independent)."
        )
    rate = f"unlike the others (family-wise rate {leading(f'{plan.alpha:g}')})"
    flagged = ", ".join(one.observers.flagged)
    if flagged or not one.observers.turned:
        yield (
            f"Participants who answer {rate}: {flagged}."
            if flagged
            else f"No participant answers {rate}."
        )
    if one.observers.turned:
        turned = ", ".join(one.observers.turned)
        yield (
            "Participants who answer the other way round (a test of its own, family-wise rate"
            f" {leading(f'{plan.alpha:g}')}): {turned}. Did they take one answer for the other?"
        )
