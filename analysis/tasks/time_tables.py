"""The analysis of a table of reaction times of any task, kind `reaction`."""

from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd

from analysis.models.cells import conditions
from analysis.parts.correct import below_guessing
from analysis.parts.times import TimesPart
from analysis.plans.rating_plan import OneColumnPlan
from analysis.plans.table_sections import TimeTableSection
from analysis.tables.table import Source
from analysis.tables.trials import as_decisions, read_times
from analysis.tasks.base import TaskAnalysis


@dataclass(frozen=True, kw_only=True)
class TimesPlan(OneColumnPlan):
    """Names and rules of the analysis of reaction times.

    `alternatives`: how many answers the table holds; None where none is right or wrong.
    """


class TableOfTimes(TaskAnalysis[TimeTableSection, TimesPlan]):
    """Reaction times by condition, whatever was answered."""

    kind = "reaction"
    task = "reaction times"
    options = TimeTableSection
    parts = (TimesPart(),)

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
        plan.check_known(known, f"a value of {plan.by!r}")
        return plan

    def read(self, table: Source, section: TimeTableSection) -> pd.DataFrame:
        """Read who took how long, and whether the answer was right if the table says so."""
        return as_decisions(read_times(table, by=section.by or None))

    def table_notes(self, decisions: pd.DataFrame, plan: TimesPlan) -> Sequence[str]:
        """Return a note on answers of two alternatives that are below guessing."""
        if plan.alternatives != 2:
            return ()
        return below_guessing(decisions, 0.5)
