"""The analysis of identification among m answers, kind `identification`."""

from collections.abc import Callable
from typing import Any, ClassVar

import pandas as pd

from analysis.arrays import Floats
from analysis.models.detection import DiscriminationResults, identification
from analysis.parts import AnyPart
from analysis.parts.sensitivity import DiscriminationPart
from analysis.plans.rate_plan import RatePlan, baseline_in
from analysis.plans.table_settings import IdentificationTableSettings
from analysis.simulations import tabulated
from analysis.tasks.rates import RatesTask, rate_parts
from protocols.errors import StudyError
from protocols.tasks.base import Analysis


def _sense(rows: pd.DataFrame, plan: RatePlan) -> DiscriminationResults:
    return identification(
        rows,
        plan.compared,
        alternatives=plan.alternatives,
        reference=baseline_in(rows, plan),
        level=plan.confidence,
    )


class IdentificationRates(RatesTask):
    """Shares of right answers and d' by condition: task `identification`."""

    kind: ClassVar[str] = "identification"
    options: ClassVar[type[Analysis]] = IdentificationTableSettings
    task: ClassVar[str] = "identifications"
    parts: ClassVar[tuple[AnyPart, ...]] = rate_parts(DiscriminationPart(_sense))

    def table_answers(self, decisions: pd.DataFrame, told: Any) -> tuple[str, ...]:
        """Return the answers, or numbers in their place where the table does not name all.

        Raises
        ------
        StudyError
            If nothing says how many there were, or the table holds more.
        """
        found: list[str] = []
        if {"expected", "answer"} <= set(decisions.columns):
            found = sorted({*decisions["expected"].map(str), *decisions["answer"].map(str)} - {""})
        count = told.alternatives or len(found)
        if count < max(2, len(found)):
            raise StudyError(
                "--set alternatives: must say how many answers there were to choose from (got"
                f" {told.alternatives or 'nothing'}; the columns expected and answer hold"
                f" {len(found)}: {', '.join(found[:8]) or 'none'})"
            )
        return (*found, *(f"answer {number + 1}" for number in range(len(found), count)))

    def share_of(self, settings: RatePlan) -> Callable[[Floats], Floats]:
        """Return the chance of picking the right one of m by d'."""
        return tabulated(settings.right_share)
