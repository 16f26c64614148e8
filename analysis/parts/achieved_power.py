"""Size of the primary comparison in JOD, and its power with the people who came or are planned."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pandas as pd
from numpy.random import Generator
from scipy.special import nctdtr, ndtri

from analysis.models.clustered import ClusteredShare, two_way
from analysis.models.compared_methods import Comparisons, counts
from analysis.models.numeric import two_sided_quantile
from analysis.parts import Part, PartNumbers, Presentation
from analysis.plans.preference_plan import PreferencePlan
from analysis.report.wording import leading, level_text, number, number_range, share
from protocols.blocks import Heading, Paragraph
from protocols.errors import count_of

JOD = float(ndtri(0.75))
"""Quantile of the share that prefers the better of two 1 JOD apart."""


@dataclass(frozen=True)
class AchievedPower:
    """Every number.

    Attributes
    ----------
    jod, jod_lower, jod_upper : float
        The share and its limits as a distance of the two methods; infinite where all agree.
    power : float
        Chance to find the smallest effect of interest with the standard error that was reached.
    planned_power : float or None
        The same with the planned participants; None where the study plans none, or as many.
    participants : int
    planned_participants : int or None
    """

    method: str
    against: str
    jod: float
    jod_lower: float
    jod_upper: float
    power: float
    planned_power: float | None
    participants: int
    planned_participants: int | None
    notes: tuple[str, ...] = ()


class AchievedPowerPart(Part[PreferencePlan, AchievedPower]):
    """Power of the primary comparison, from the standard error that it reached."""

    name: ClassVar[str] = "achieved_power"
    section: ClassVar[tuple[str, str]] = ("preference", "Preference")

    def wanted(self, table: pd.DataFrame, plan: PreferencePlan) -> bool:
        """Return True if there is a primary comparison, and several people made it."""
        return plan.primary is not None and plan.test != "pooled" and _people(table, plan) > 2

    def compute(
        self, table: pd.DataFrame, plan: PreferencePlan, _found: PartNumbers, _chance: Generator
    ) -> AchievedPower:
        """Judge it by the study's own test."""
        assert plan.primary is not None
        method, against, _ = plan.primary
        chosen, shown, people, _ = counts(Comparisons(table).rows(*plan.primary), method)
        if plan.test == "participant":
            chosen, shown = chosen.sum(1, keepdims=True), shown.sum(1, keepdims=True)
        whole = two_way(chosen, shown)
        lower, upper = (float(end) for end in whole.limits(plan.confidence))
        jod, jod_lower, jod_upper = (ndtri([whole.share, lower, upper]) / JOD).tolist()
        planned = plan.planned_participants
        more = planned if planned not in (None, len(people)) else None
        return AchievedPower(
            method,
            against,
            jod,
            jod_lower,
            jod_upper,
            _power(whole, plan, 1.0),
            None if more is None else _power(whole, plan, more / len(people)),
            len(people),
            planned,
        )

    def show(self, found: AchievedPower, plan: PreferencePlan) -> Presentation:
        """Return both in a sentence each."""
        said = tuple(_sentences(found, plan))
        return Presentation(
            blocks=(Heading("Size and power of the primary comparison"), Paragraph(" ".join(said))),
            sentences=said,
            methods=(
                "The power of the primary comparison for the smallest effect of interest follows"
                " from its own standard error by a noncentral t; no effect that was found enters."
            ),
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
    return float(1.0 - nctdtr(df, away, reach) + nctdtr(df, away, -reach))


def _sentences(found: AchievedPower, plan: PreferencePlan) -> Iterator[str]:
    ends = found.jod_lower, found.jod_upper
    yield (
        f"In JOD the primary comparison is {number(found.jod, within=ends)},"
        f" {level_text(plan.confidence)} {number_range(*ends)}."
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
