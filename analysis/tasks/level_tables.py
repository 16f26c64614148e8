"""The analysis of a table of right answers along a level, kind `psychometric`."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import pandas as pd

from analysis.guessing import curve_mistake
from analysis.parts import AnyPart
from analysis.parts.curves.goodness import GoodnessPart
from analysis.parts.curves.own_curves import OwnCurvesPart
from analysis.parts.levels import CurvesPart, ThresholdsPart
from analysis.plans.rate_plan import CurvePlan, RatePlan, common_settings_of_table
from analysis.plans.table_settings import CurveTableSettings
from analysis.tables.table import Source, opened
from analysis.tasks.rates import RatesTask
from protocols.errors import StudyError
from protocols.tasks.base import Analysis


class TableOfLevels(RatesTask):
    """Psychometric functions of each person and of all people."""

    kind: ClassVar[str] = "psychometric"
    task: ClassVar[str] = "answers"
    options: ClassVar[type[Analysis]] = CurveTableSettings
    parts: ClassVar[tuple[AnyPart, ...]] = (
        CurvesPart(),
        ThresholdsPart(),
        GoodnessPart(),
        OwnCurvesPart(),
    )

    def table_answers(self, _decisions: pd.DataFrame, _told: Any) -> tuple[str, ...]:
        """Return names for right and wrong answers: their number is not asked for."""
        return ("right", "wrong")

    def settings_of_table(self, decisions: pd.DataFrame, name: str, told: Any) -> RatePlan:
        """Return the plan that was told; without `by` all answers are of one condition."""
        if not told.by:
            decisions = decisions.drop(columns="method", errors="ignore")
        answers = self.table_answers(decisions, told)
        return common_settings_of_table(decisions, name, told, answers, CurvePlan)

    def read(self, table: Source, mapping: Mapping[str, str], told: Any) -> pd.DataFrame:
        """Read trials; refuse levels along which no psychometric function can run."""
        table = opened(table, mapping)
        if told.level is None:
            raise StudyError(f"{table.path}: --set level must name the column of levels")
        rows = super().read(table, {}, told)
        levels = rows[told.level]
        if (told.log or told.shape == "weibull") and bool((levels <= 0).any()):
            raise StudyError(
                f"{table.path}: {told.level} must be above 0 in every row to have a logarithm"
                f" (least: {levels.min():g}); leave the others out with --where"
                f" '{told.level}>0', or leave --log away"
            )
        if levels.nunique() < 2:
            raise StudyError(f"{table.path}: {told.level} must hold two levels or more (found 1)")
        if mistake := curve_mistake(rows, told.level, told.guess, falling=told.falling):
            raise StudyError(f"{table.path}: {mistake}")
        return rows

    def table_notes(self, _decisions: pd.DataFrame, _settings: RatePlan) -> Sequence[str]:
        """Return nothing: mistakes were refused."""
        return ()
