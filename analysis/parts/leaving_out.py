"""Influence of single participants and scenes on the primary comparison, and its power."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
import pandas as pd
import scipy
from numpy.random import Generator
from scipy.special import ndtri

from analysis.models.clustered import ClusteredShare, two_way
from analysis.models.compared_methods import Comparisons, counts
from analysis.models.tails import two_sided_quantile
from analysis.parts import Part, PartFigure, Presentation
from analysis.plans.preference_plan import PreferencePlan
from analysis.plots.interaction_plot import interaction_plot
from analysis.report.wording import leading, level_text, number, number_range, p_number, share
from protocols.blocks import FigurePlace, Heading, Paragraph
from protocols.prose import count_of

JOD = float(ndtri(0.75))
"""Of two 1 JOD apart, this quantile's share prefers the better."""
MOST_DRAWN = 40


@dataclass(frozen=True)
class LeftOutResult:
    """The primary comparison without one participant, or one scene (`kind`)."""

    kind: str
    name: str
    share: float
    lower: float
    upper: float
    p: float


@dataclass(frozen=True)
class LeavingOut:
    """Every number.

    Attributes
    ----------
    p : float
        Of all decisions.
    jod, jod_lower, jod_upper : float
        The share and its limits as a distance of the two methods; infinite where all agree.
    without : tuple of LeftOutResult
    power : float
        Chance to find the smallest effect of interest with the standard error that was reached.
    planned_power : float or None
        The same with the planned participants; None where the study plans none, or as many.
    participants : int
    planned_participants : int or None
    """

    method: str
    against: str
    p: float
    jod: float
    jod_lower: float
    jod_upper: float
    without: tuple[LeftOutResult, ...]
    power: float
    planned_power: float | None
    participants: int
    planned_participants: int | None
    notes: tuple[str, ...] = ()

    def turning(self, alpha: float) -> list[LeftOutResult]:
        """Return those without whom the result is another: significant, or not."""
        return [one for one in self.without if (one.p < alpha) != (self.p < alpha)]


class LeavingOutPart(Part[PreferencePlan, LeavingOut]):
    """The primary comparison without each participant and each scene in turn."""

    name: ClassVar[str] = "leaving_out"
    section: ClassVar[tuple[str, str]] = ("preference", "Preference")

    def wanted(self, table: pd.DataFrame, plan: PreferencePlan) -> bool:
        """Return True if there is a primary comparison, and several people made it."""
        return plan.primary is not None and plan.test != "pooled" and _people(table, plan) > 2

    def compute(
        self,
        table: pd.DataFrame,
        plan: PreferencePlan,
        _found: Mapping[str, Any],
        _chance: Generator,
    ) -> LeavingOut:
        """Judge it again without each, by the study's own test."""
        assert plan.primary is not None
        method, against, _ = plan.primary
        chosen, shown, people, scenes = counts(Comparisons(table).rows(*plan.primary), method)
        if plan.test == "participant":
            chosen, shown, scenes = chosen.sum(1, keepdims=True), shown.sum(1, keepdims=True), ()
        whole = two_way(chosen, shown)
        without = []
        for axis, kind, names in ((0, "participant", people), (1, "scene", scenes)):
            for place, name in enumerate(names if len(names) > 1 else ()):
                rest = [np.delete(cells, place, axis) for cells in (chosen, shown)]
                if rest[1].sum() > 0:
                    left = two_way(*rest)
                    low, high = (float(end) for end in left.limits(plan.confidence))
                    p = float(left.p_value())
                    without.append(LeftOutResult(kind, name, float(left.share), low, high, p))
        lower, upper = (float(end) for end in whole.limits(plan.confidence))
        jod, jod_lower, jod_upper = (ndtri([whole.share, lower, upper]) / JOD).tolist()
        planned = plan.planned_participants
        more = planned if planned not in (None, len(people)) else None
        return LeavingOut(
            method,
            against,
            float(whole.p_value()),
            jod,
            jod_lower,
            jod_upper,
            tuple(without),
            _power(whole, plan, 1.0),
            None if more is None else _power(whole, plan, more / len(people)),
            len(people),
            planned,
        )

    def show(self, found: LeavingOut, plan: PreferencePlan) -> Presentation:
        """Return in short what it depends on, and a figure of shares without each."""
        said = tuple(_sentences(found, plan))
        middle = float(np.median([one.share for one in found.without] or [0.5]))
        by_change = sorted(found.without, key=lambda one: -abs(one.share - middle))
        shown = by_change[:MOST_DRAWN]
        rows = [
            (f"without {plan.label(one.name)}", one.kind, one.share, one.lower, one.upper)
            for one in found.without
            if one in shown
        ]
        some = f" (the {MOST_DRAWN} that change it most)" if len(found.without) > MOST_DRAWN else ""
        caption = (
            f"The primary comparison without each participant and each scene in turn{some}, with"
            f" {plan.limits}; dashed: chance."
        )
        lines = [vars(one) for one in found.without]
        return Presentation(
            blocks=(
                Heading("What the primary comparison depends on"),
                Paragraph(" ".join(said) + " Nobody is excluded by this."),
                FigurePlace("leaving_out"),
            ),
            sentences=said,
            methods=(
                "The primary comparison was judged again without each participant and each scene in"
                " turn. Its power for the smallest effect of interest follows from its own standard"
                " error by a noncentral t; no effect that was found enters."
            ),
            tables={
                "leaving_out.csv": pd.DataFrame(
                    lines, columns=[*LeftOutResult.__dataclass_fields__]
                )
            },
            figures=(
                PartFigure(
                    "leaving_out",
                    caption,
                    partial(
                        interaction_plot,
                        rows,
                        title="Left out",
                        chance=0.5,
                        level=plan.confidence,
                    ),
                ),
            )
            if rows
            else (),
        )


def _people(table: pd.DataFrame, plan: PreferencePlan) -> int:
    assert plan.primary is not None
    return int(Comparisons(table).rows(*plan.primary)["participant"].astype(str).nunique())


def _power(estimate: ClusteredShare, plan: PreferencePlan, times: float) -> float:
    """Return the power for the smallest effect, with so many times as many participants."""
    error = float(estimate.standard_error) / np.sqrt(times)
    # Trials of people who agree by luck tell no more than independent ones.
    error = max(error, float(np.sqrt(0.25 / (estimate.trials * times))))
    df = float(estimate.df)
    reach, away = two_sided_quantile(plan.confidence, df), plan.margin / error
    return float(scipy.stats.nct.sf(reach, df, away) + scipy.stats.nct.cdf(-reach, df, away))


def _sentences(found: LeavingOut, plan: PreferencePlan) -> Iterator[str]:
    ends = found.jod_lower, found.jod_upper
    yield (
        f"In JOD the primary comparison is {number(found.jod, within=ends)},"
        f" {level_text(plan.confidence)} {number_range(*ends)}."
    )
    if found.without:
        p = sorted(one.p for one in found.without)
        least, most = (min(one.share for one in found.without), max(o.share for o in found.without))
        turning = found.turning(plan.alpha)
        names = ", ".join(f"{one.kind} {plan.label(one.name)}" for one in turning)
        yield (
            f"Without each participant and each scene in turn the share lies between {share(least)}"
            f" and {share(most)}, p between {p_number(p[0])} and {p_number(p[-1])};"
            + (
                f" the result is another without {names}."
                if turning
                else " the result stays the same without any of them."
            )
        )
    more = (
        ""
        if found.planned_power is None
        else f" (with the {found.planned_participants} planned: {share(found.planned_power)})"
    )
    yield (
        f"With {count_of(found.participants, 'participant')}, and answers that vary as these do, a"
        f" share {leading(f'{plan.margin:g}')} away from .5 is found with a chance of"
        f" {share(found.power)}{more}."
    )
