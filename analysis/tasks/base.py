"""Analysis of a task: its parts, their plan, its tables, its power.

The report, the tables and the commands ask it, and know no task themselves.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeAlias, TypeVar

import pandas as pd

from analysis import SEED
from analysis.parts import AnalysisPlan, AnyPart
from analysis.power import PowerSimulation
from analysis.showable import FamilyOfTests
from analysis.tables.table import Source
from analysis.tables.trials import answer_columns
from protocols.columns import Column
from protocols.errors import StudyError
from protocols.study_file.schema import StudyProtocol
from protocols.tasks.base import Analysis, Task

S = TypeVar("S", bound=Analysis)
P = TypeVar("P", bound=AnalysisPlan)


class TaskAnalysis(ABC, Generic[S, P]):
    """The analysis of a kind of task: its parts, and how a study or a table becomes their plan.

    `S` is the section `[analysis]` as a table is told it, `P` the plan.
    """

    def __init_subclass__(cls) -> None:
        """Refuse what was written for 0.3 and has other names now."""
        super().__init_subclass__()
        own = {*vars(cls), *getattr(vars(cls).get("read"), "__annotations__", ())}
        for old, new in _RENAMED.items():
            if old in own:
                raise TypeError(
                    f"{old} of an analysis is {new} since 0.4 (docs/from-0.3-to-0.4.md)"
                )

    kind: str
    """Kind in the section `[analysis]` of a study."""
    task: str = "decisions"
    """Word for several trials in a sentence."""
    parts: tuple[AnyPart, ...] = ()
    """Its statistics, in reading order."""
    options: type[Analysis]
    """Model of the section of a table without a protocol: `S`."""
    constants: ClassVar[Mapping[str, int]] = {"seed": SEED}
    """Constants that results depend on; the report's provenance lists them."""

    @classmethod
    def of(cls, _task: type[Task]) -> Self:
        """Return the analysis of a task."""
        return cls()

    def plan(self, _study: StudyProtocol) -> P:
        """Return the plan that a protocol fixes.

        Raises
        ------
        StudyError
            If these are of tables only.
        """
        raise StudyError(
            f"analysis.kind: {self.kind} come from tables only; no study shows them yet"
        )

    @abstractmethod
    def plan_of_table(self, decisions: pd.DataFrame, name: str, section: S) -> P:
        """Return the plan of a table without a protocol.

        Raises
        ------
        StudyError
            If its section does not fit the table.
        """

    @abstractmethod
    def read(self, table: Source, section: S) -> pd.DataFrame:
        """Read decisions from a table of any tool; what was left out is added to its notes.

        Raises
        ------
        StudyError
            With the column, line and value at fault.
        """

    def section_of_table(self, plan: P) -> Analysis:
        """Return the section with which a table is read as the plan of a study says."""
        said = {**dict(plan.section), **plan.facts}
        return self.options(**{key: said[key] for key in self.options.model_fields if key in said})

    def columns_of(self, decisions: pd.DataFrame) -> tuple[Column, ...]:
        """Return the columns of a table that was read, for its data dictionary."""
        return answer_columns(decisions)

    def table_notes(self, _decisions: pd.DataFrame, _plan: P) -> Sequence[str]:
        """Return notes on odd answers of a table that was read."""
        return ()

    def lacks(self, _decisions: pd.DataFrame, _plan: P) -> str:
        """Return the part that a table lacks for a report, and the cure; empty: nothing."""
        return ""

    def check_table(self, _path: Path, _decisions: pd.DataFrame, _plan: P) -> None:
        """Refuse a table that does not fit the protocol given with it (StudyError)."""

    def parts_of(self, _plan: P) -> Sequence[AnyPart]:
        """Return the parts of such a report, in reading order."""
        return self.parts

    def table(self, decisions: pd.DataFrame, _plan: P) -> pd.DataFrame:
        """Return decisions as the parts take them."""
        return decisions

    def tidy_tables(self, _decisions: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
        """Return the decisions in forms that other programs read, by file name."""
        return {}

    # Power.

    def simulation(self, study: StudyProtocol) -> PowerSimulation[P]:
        """Return the simulation of such a study, for its power.

        Raises
        ------
        StudyError
            If this analysis simulates nothing, or the study compares nothing.
        """
        raise StudyError(
            f"analysis.kind: the power of {study.analysis.kind!r} cannot be simulated; plan by a"
            " pilot, whose report gives the limits of every difference"
        )

    def families(self, study: StudyProtocol) -> tuple[FamilyOfTests, ...]:
        """Return the families of tests that a study plans, that of the planned test first."""
        try:
            return self.simulation(study).families()
        except StudyError:  # nothing is compared, or nobody knows what is
            return ()


_RENAMED = {
    "settings": "plan",
    "settings_of_table": "plan_of_table",
    "told_by": "section_of_table",
    "mapping": "in the table that `read` takes",
}

AnyAnalysis: TypeAlias = TaskAnalysis[Any, Any]
