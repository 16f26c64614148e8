"""The analysis of a table of reaction times of any task, kind `reaction`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import pandas as pd

from analysis.models.cells import conditions
from analysis.parts import AnalysisPlan, SectionKey
from analysis.parts.correct import below_guessing
from analysis.parts.random_effects import TimeEffects
from analysis.parts.times import TimesPart
from analysis.plans.table_sections import TimeTableSection, check_contrasts
from analysis.tables.table import Source
from analysis.tables.trials import as_decisions, read_times
from analysis.tasks.base import TaskAnalysis
from protocols.errors import StudyError, did_you_mean
from protocols.tasks.rates import name_of
from protocols.units import Scalar


@dataclass(frozen=True, kw_only=True)
class TimesPlan(AnalysisPlan):
    """Names and rules of the analysis of reaction times.

    `alternatives`: how many answers the table holds; None where none is right or wrong.
    """

    section: TimeTableSection

    by = SectionKey[str]()
    baseline = SectionKey[Scalar | None]()

    @property
    def compared(self) -> tuple[str, ...]:
        """The column of conditions, if any."""
        return (self.by,) if self.by else ()

    def reference_in(self, _names: Sequence[str]) -> str | None:
        """Return the baseline."""
        return None if self.baseline is None else name_of(self.baseline)


class TableOfTimes(TaskAnalysis[TimeTableSection, TimesPlan]):
    """Reaction times by condition, whatever was answered."""

    kind = "reaction"
    task = "reaction times"
    options = TimeTableSection
    parts = (TimesPart(), TimeEffects(TimesPart()))

    def plan_of_table(
        self, decisions: pd.DataFrame, name: str, section: TimeTableSection
    ) -> TimesPlan:
        """Return the plan of a table's own conditions, and the number of answers in it."""
        alternatives = None
        if "correct" in decisions:
            named = [decisions[name] for name in ("expected", "answer") if name in decisions]
            alternatives = len({value for column in named for value in column}) if named else 2
        section = section.model_copy(update={"reaction": "models"})
        plan = TimesPlan(section=section, study=name, title=name, alternatives=alternatives)
        known = [one for one, _ in conditions(decisions, plan.compared)]
        check_contrasts(section, known)
        baseline = plan.reference_in(())
        if baseline is not None and baseline not in known:
            raise StudyError(
                f"--set baseline={baseline}: must be a value of {plan.by!r}"
                f" ({', '.join(known)}){did_you_mean(baseline, known)}"
            )
        return plan

    def read(
        self, table: Source, mapping: Mapping[str, str], section: TimeTableSection
    ) -> pd.DataFrame:
        """Read who took how long, and whether the answer was right if the table says so."""
        return as_decisions(read_times(table, mapping, by=section.by or None))

    def table_notes(self, decisions: pd.DataFrame, plan: TimesPlan) -> Sequence[str]:
        """Return a note on answers of two alternatives that are below guessing."""
        if plan.alternatives != 2:
            return ()
        return below_guessing(decisions, 0.5)
