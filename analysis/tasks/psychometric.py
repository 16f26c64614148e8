"""The analysis of a table of right answers along a level, kind `psychometric`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import pandas as pd
from pydantic import Field

from analysis.guessing import curve_mistake
from analysis.parts import AnyPart
from analysis.parts.levels import CurvesPart, OwnCurvesPart, ThresholdsPart
from analysis.plans.rates import RateSettings, RatesOptions
from analysis.tables.table import Source, opened
from analysis.tasks.base import TableOptions
from analysis.tasks.rates import RatesTask
from protocols.errors import StudyError


class CurveOptions(RatesOptions):
    """What a table of right answers along a level must be told."""

    guess: Annotated[float, Field(ge=0, lt=1)] | None = 0.5
    """Rate of guessing; None fits it."""
    log: bool = False
    """Fit on the logarithm of the level; `weibull` always does."""


@dataclass(frozen=True)
class CurveSettings(RateSettings):
    """Names and rules of the analysis along a level; all pairs of conditions are compared."""

    guessed: float | None = 0.5
    log: bool = False

    @property
    def guess(self) -> float | None:
        """Rate of guessing; None: unknown."""
        return self.guessed

    @property
    def logarithmic(self) -> bool:
        """Whether psychometric functions are of the logarithm of levels."""
        return self.log or super().logarithmic

    def reference_in(self, _names: Sequence[str]) -> str | None:
        """Return nothing: all pairs are compared."""
        return None


class TableOfLevels(RatesTask):
    """Psychometric functions of each person and of all people."""

    kind: ClassVar[str] = "psychometric"
    task: ClassVar[str] = "answers"
    options: ClassVar[type[TableOptions]] = CurveOptions
    parts: ClassVar[tuple[AnyPart, ...]] = (CurvesPart(), ThresholdsPart(), OwnCurvesPart())

    def table_answers(self, _decisions: pd.DataFrame, _options: Any) -> tuple[str, ...]:
        """Return names for right and wrong answers: their number is not asked for."""
        return ("right", "wrong")

    def settings_of_table(self, decisions: pd.DataFrame, name: str, options: Any) -> RateSettings:
        """Return what the options say; without `by` all answers are of one condition."""
        if options.by is None:
            decisions = decisions.drop(columns="method", errors="ignore")
        found = super().settings_of_table(decisions, name, options)
        return CurveSettings(**vars(found), guessed=options.guess, log=options.log)

    def read(self, table: Source, mapping: Mapping[str, str], options: Any) -> pd.DataFrame:
        """Read trials; refuse levels along which no psychometric function can run."""
        table = opened(table, mapping)
        if options.level is None:
            raise StudyError(f"{table.path}: --set level must name the column of levels")
        rows = super().read(table, {}, options)
        levels = rows[options.level]
        if (options.log or options.shape == "weibull") and bool((levels <= 0).any()):
            raise StudyError(
                f"{table.path}: {options.level} must be above 0 in every row to have a logarithm"
                f" (least: {levels.min():g}); leave the others out with --where"
                f" '{options.level}>0', or leave --log away"
            )
        if levels.nunique() < 2:
            raise StudyError(
                f"{table.path}: {options.level} must hold two levels or more (found 1)"
            )
        if mistake := curve_mistake(rows, options.level, options.guess, falling=options.falling):
            raise StudyError(f"{table.path}: {mistake}")
        return rows

    def table_notes(self, _decisions: pd.DataFrame, _settings: RateSettings) -> Sequence[str]:
        """Return nothing: mistakes were refused."""
        return ()

    def counted(self, settings: RateSettings) -> str:
        """Return along what answers change."""
        return f"by {settings.level}"
