"""The analyses of `abx` and `which-half`: d', and critical scalings."""

from collections.abc import Callable
from typing import Any, ClassVar

import pandas as pd

from analysis.arrays import Floats
from analysis.models.detection import DiscriminationResults, abx
from analysis.parts import AnyPart
from analysis.parts.curves.critical import CriticalPart
from analysis.parts.sensitivity import DiscriminationPart
from analysis.plans.rate_plan import RatePlan, baseline_in
from analysis.plans.table_settings import AbxTableSettings, WhichHalfTableSettings
from analysis.simulations import tabulated
from analysis.tasks.rates import RatesTask, rate_parts
from protocols.tasks.base import Analysis


def _sense(rows: pd.DataFrame, plan: RatePlan) -> DiscriminationResults:
    return abx(
        rows,
        plan.compared,
        rule=plan.rule,
        reference=baseline_in(rows, plan),
        level=plan.confidence,
    )


class AbxRates(RatesTask):
    """Shares of right answers, d' and d' against the level: task `abx`."""

    kind: ClassVar[str] = "abx"
    options: ClassVar[type[Analysis]] = AbxTableSettings
    task: ClassVar[str] = "ABX answers"
    parts: ClassVar[tuple[AnyPart, ...]] = rate_parts(
        DiscriminationPart(_sense, sides=True), levels=(CriticalPart(),)
    )
    named: ClassVar[tuple[str, str]] = ("a", "b")
    """The task's answers."""

    def table_answers(self, decisions: pd.DataFrame, _told: Any) -> tuple[str, ...]:
        """Return the two answers: as the table names them, if it does."""
        if "answer" in decisions:
            found = tuple(sorted(set(decisions["answer"].map(str)) - {""}))
            if len(found) == len(self.named):
                return found
        return self.named

    def share_of(self, settings: RatePlan) -> Callable[[Floats], Floats]:
        """Return the chance of a right answer by d', by the study's decision rule."""
        return tabulated(settings.right_share)


class WhichHalfRates(AbxRates):
    """The same of halves that change: task `which-half`."""

    kind: ClassVar[str] = "which-half"
    options: ClassVar[type[Analysis]] = WhichHalfTableSettings
    task: ClassVar[str] = "answers which half had changed"
    named: ClassVar[tuple[str, str]] = ("left", "right")
