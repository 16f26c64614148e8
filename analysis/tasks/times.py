"""The analysis of a table of reaction times of any task, kind `reaction`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import pandas as pd
from pydantic import Field

from analysis.cells import conditions
from analysis.guessing import below_guessing
from analysis.parts import AnyPart, Plan
from analysis.parts.random_effects import TimeEffects
from analysis.parts.times import TimesPart
from analysis.tables.table import Source
from analysis.tables.trials import answer_columns, as_decisions, read_times
from analysis.tasks.base import TableOptions, TaskAnalysis
from protocols.columns import Column
from protocols.errors import StudyError
from protocols.suggest import did_you_mean


class TimesOptions(TableOptions):
    """What a table of reaction times may be told."""

    by: str | None = None
    """The column whose values are compared."""
    baseline: str | None = None
    """The value of `by` that the others are compared with; left out: all pairs are compared."""
    alpha: Annotated[float, Field(gt=0, lt=1)] = 0.05
    """Level of every test."""


@dataclass(frozen=True)
class TimesSettings(Plan):
    """Names and rules of the analysis of reaction times.

    `alternatives`: how many answers the table holds; None where none is right or wrong.
    """

    study: str
    title: str
    by: str | None
    baseline: str | None
    alternatives: int | None
    alpha: float
    protocol_sha256: str | None = None
    reaction = "models"

    @property
    def compared(self) -> tuple[str, ...]:
        """The column of conditions, if any."""
        return () if self.by is None else (self.by,)

    def reference_in(self, _names: Sequence[str]) -> str | None:
        """Return the baseline."""
        return self.baseline


class TableOfTimes(TaskAnalysis[TimesSettings]):
    """Reaction times by condition, whatever was answered."""

    kind: ClassVar[str] = "reaction"
    task: ClassVar[str] = "reaction times"
    options: ClassVar[type[TableOptions]] = TimesOptions
    parts: ClassVar[tuple[AnyPart, ...]] = (TimesPart(), TimeEffects(TimesPart()))

    def settings_of_table(self, decisions: pd.DataFrame, name: str, options: Any) -> TimesSettings:
        """Return what the options say."""
        by = () if options.by is None else (options.by,)
        known = [value for value, _ in conditions(decisions, by)]
        if options.baseline is not None and options.baseline not in known:
            raise StudyError(
                f"--set baseline={options.baseline}: must be a value of {options.by!r}"
                f" ({', '.join(known)}){did_you_mean(options.baseline, known)}"
            )
        alternatives = None
        if "correct" in decisions:
            named = [decisions[name] for name in ("expected", "answer") if name in decisions]
            alternatives = len({value for column in named for value in column}) if named else 2
        return TimesSettings(name, name, options.by, options.baseline, alternatives, options.alpha)

    def options_of(self, settings: TimesSettings) -> TimesOptions:
        """Return the options that say the same."""
        return TimesOptions(by=settings.by, baseline=settings.baseline, alpha=settings.alpha)

    def read(self, table: Source, mapping: Mapping[str, str], options: Any) -> pd.DataFrame:
        """Read who took how long, and whether the answer was right if the table says so."""
        return as_decisions(read_times(table, mapping, by=options.by))

    def columns_of(self, decisions: pd.DataFrame) -> tuple[Column, ...]:
        """Return the columns of the table."""
        return answer_columns(decisions)

    def table_notes(self, decisions: pd.DataFrame, settings: TimesSettings) -> Sequence[str]:
        """Return why there is no EZ diffusion, or whether answers are below guessing."""
        if settings.alternatives is None:
            return (
                "no column correct, nor expected and answer: EZ diffusion needs to know which"
                " answers were right",
            )
        if settings.alternatives > 2:
            return (f"EZ diffusion is of two answers (found {settings.alternatives})",)
        return below_guessing(decisions, 0.5)

    def counted(self, settings: TimesSettings) -> str:
        """Return what is compared."""
        return "all together" if settings.by is None else f"by {settings.by}"
