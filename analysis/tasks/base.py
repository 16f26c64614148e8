"""What the analysis of a task offers: settings, results, its part of the report, its power.

The report, the tables and the commands ask it, and know no task themselves.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeAlias, TypeVar

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydantic import Field

from analysis.parts import AnyPart, Plan
from analysis.seed import SEED
from analysis.tables.table import Source
from protocols.columns import Column
from protocols.errors import StudyError
from protocols.schema import StudyProtocol
from protocols.suggest import did_you_mean
from protocols.units import Model

Counted = Callable[[int, int], None]


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


@dataclass(frozen=True)
class Assumption:
    """A number that a simulation of power takes for true, within limits."""

    name: str
    value: float
    """Not a number: left out, unless it is asked for."""
    meaning: str
    lowest: float = 0.0
    highest: float = float("inf")


@dataclass(frozen=True)
class PowerReport:
    """What a simulation of power says, ready to print and to draw.

    Attributes
    ----------
    result : dataclass
        Every number, for `power.json`.
    lead : str
        What was simulated.
    columns, rows
        A table of texts.
    legend : str
        What the columns mean.
    needed : tuple of str
        How many participants for which power, in sentences.
    draw : callable
        From a width in inches to the curve.
    draw_designs : callable, optional
        The same to power over numbers of scenes and repeats.
    """

    result: object
    lead: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    legend: str
    needed: tuple[str, ...]
    warnings: tuple[str, ...]
    draw: Callable[[float], Figure]
    draw_designs: Callable[[float], Figure] | None = None


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

    def simulated_p(
        self,
        study: StudyProtocol,
        _assumed: Mapping[str, float],
        _participants: Sequence[int],
        *,
        null: bool,  # noqa: ARG002
        rng: np.random.Generator,  # noqa: ARG002
        studies: int,  # noqa: ARG002
        progress: Counted | None = None,  # noqa: ARG002
    ) -> NDArray[np.float64]:
        """Return p of the planned test (studies, numbers of participants) of simulated studies.

        With `null` there is nothing to find. The first n people of a study are a study of n.

        Raises
        ------
        StudyError
            If this analysis, or this study, cannot be simulated so.
        """
        raise StudyError(
            f"analysis.kind: looks at {study.analysis.kind!r} cannot be simulated; bounds hold for"
            " any p"
        )

    def least_p(self, _study: StudyProtocol, _people: int) -> float:
        """Return the least p that the planned test of so many participants can show; 0: any."""
        return 0.0

    def family(self, _study: StudyProtocol) -> int:
        """Return how many planned comparisons are corrected together and have such a least p."""
        return 0

    def tidy_tables(self, _decisions: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
        """Return the decisions in forms that other programs read, by file name."""
        return {}

    @abstractmethod
    def counted(self, settings: S) -> str:
        """Return what is compared, in two or three words for the top of the page."""

    # Power.

    def assumptions(self, study: StudyProtocol) -> tuple[Assumption, ...]:
        """Return what a simulation of power takes for true, with values that fit the study."""
        self.settings(study)
        return ()

    def from_pilot(
        self,
        _study: StudyProtocol,
        _decisions: pd.DataFrame,
        _settings: S,
    ) -> tuple[Mapping[str, float], Sequence[str]]:
        """Return assumptions by name, as a pilot's decisions have them, and notes on them.

        Parameters
        ----------
        settings
            Of the pilot, which may be a table of another study.

        Raises
        ------
        StudyError
            If they cannot be had from such decisions.
        """
        raise StudyError(
            "--from: deviations cannot be taken from a pilot of this task; give them by --set"
        )

    def power(
        self,
        study: StudyProtocol,
        _assumed: Mapping[str, float],
        *,
        rng: np.random.Generator,  # noqa: ARG002
        studies: int | None = None,  # noqa: ARG002
        progress: Counted | None = None,  # noqa: ARG002
    ) -> PowerReport:
        """Simulate the study's own design and test for growing numbers of participants.

        Parameters
        ----------
        assumed : mapping
            A value for every one of `assumptions`.
        studies : int, optional
            How many to simulate; left out, as many as take seconds.

        Raises
        ------
        StudyError
            If the study compares nothing, or this analysis simulates nothing.
        """
        raise StudyError(f"analysis.kind: power of {study.analysis.kind!r} cannot be simulated")


AnyAnalysis: TypeAlias = TaskAnalysis[Any]
