"""What the analysis of a task offers: settings, results, its part of the report, its power.

The report, the tables and the commands ask it, and know no task themselves.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeAlias, TypeVar

import pandas as pd
from pydantic import Field

from analysis.parts import AnyPart, Plan
from analysis.power import Simulation
from analysis.seed import SEED
from analysis.tables.table import Source
from protocols.columns import Column
from protocols.errors import StudyError
from protocols.schema import StudyProtocol
from protocols.suggest import did_you_mean
from protocols.units import Model


class TableOptions(Model):
    """What a table without a protocol must be told, such as which column holds the level.

    Subclasses say it in fields; `metamerlab analysis import --set KEY=VALUE` fills them.
    """


class NamedOptions(TableOptions):
    """How a report of a table names and sorts its conditions."""

    order: str | None = None
    """Conditions in the order of the report, with commas between; others follow."""
    label: dict[str, str] = Field(default_factory=dict)
    """What the report calls a condition, as label.NAME = "TEXT"."""

    def sort(self, names: Sequence[str], parts: Sequence[str] = ()) -> list[str]:
        """Return conditions in the order that is asked for.

        Raises
        ------
        StudyError
            If `order` or `label` name what is no condition, nor (`label`) one of its parts.
        """
        first = [] if self.order is None else [name.strip() for name in self.order.split(",")]
        for key, given, known in (("order", first, names), ("label", self.label, (*names, *parts))):
            for name in given:
                if name not in known:
                    raise StudyError(
                        f"--set {key}: must name conditions of the table ({', '.join(known)})"
                        f" (got {name!r}){did_you_mean(name, known)}"
                    )
        return sorted(names, key=lambda name: (*first, name).index(name))


S = TypeVar("S", bound=Plan)


class TaskAnalysis(ABC, Generic[S]):
    """The analysis of a kind of task: how its tables are read, its parts, its power.

    `S` are its settings.
    """

    kind: ClassVar[str]
    """As in the section `[analysis]` of a study."""
    task: ClassVar[str] = "decisions"
    """What several trials are called in a sentence."""
    parts: ClassVar[tuple[AnyPart, ...]] = ()
    """Its statistics, in reading order."""
    options: ClassVar[type[TableOptions]] = TableOptions
    """What a table without a protocol must be told."""
    constants: ClassVar[Mapping[str, int]] = {"seed": SEED}
    """What results depend on beside data and settings; the report's provenance lists it."""

    # Where settings and decisions come from.

    def settings(self, _study: StudyProtocol) -> S:
        """Return the settings that a protocol fixes.

        Raises
        ------
        StudyError
            If these are of tables only.
        """
        raise StudyError(
            f"analysis.kind: {self.kind} come from tables only; no study shows them yet"
        )

    @abstractmethod
    def settings_of_table(self, decisions: pd.DataFrame, name: str, options: Any) -> S:
        """Return the settings of a table without a protocol.

        Parameters
        ----------
        options : TableOptions
            Of this analysis.

        Raises
        ------
        StudyError
            If the options do not fit the table.
        """

    @abstractmethod
    def options_of(self, settings: S) -> TableOptions:
        """Return what a table must be told to be read as these settings say."""

    @abstractmethod
    def read(self, table: Source, mapping: Mapping[str, str], options: Any) -> pd.DataFrame:
        """Read decisions from a table of any tool; what was left out is added to its notes.

        Parameters
        ----------
        table : Table or Path
        mapping : mapping of our name to the file's column
            Of a path.

        Raises
        ------
        StudyError
            With the column, line and value at fault.
        """

    @abstractmethod
    def columns_of(self, decisions: pd.DataFrame) -> tuple[Column, ...]:
        """Return the columns of a table that was read, for its data dictionary."""

    def table_notes(self, _decisions: pd.DataFrame, _settings: S) -> Sequence[str]:
        """Return what is odd about the answers of a table that was read."""
        return ()

    def check_table(self, _path: Path, _decisions: pd.DataFrame, _settings: S) -> None:
        """Refuse a table that does not fit the protocol given with it (StudyError)."""

    # Results.

    def parts_of(self, _settings: S) -> Sequence[AnyPart]:
        """Return the parts of such a report, in reading order."""
        return self.parts

    def table(self, decisions: pd.DataFrame, _settings: S) -> pd.DataFrame:
        """Return decisions as the parts take them."""
        return decisions

    def tidy_tables(self, _decisions: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
        """Return the decisions in forms that other programs read, by file name."""
        return {}

    @abstractmethod
    def counted(self, settings: S) -> str:
        """Return what is compared, in two or three words for the top of the page."""

    # Power.

    def simulation(self, study: StudyProtocol) -> Simulation[S]:
        """Return how such a study is simulated, for its power.

        Raises
        ------
        StudyError
            If this analysis simulates nothing, or the study compares nothing.
        """
        raise StudyError(f"analysis.kind: power of {study.analysis.kind!r} cannot be simulated")


AnyAnalysis: TypeAlias = TaskAnalysis[Any]
