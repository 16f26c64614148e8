"""Tables of results: each is declared once, for the page, the terminal and its CSV file."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import takewhile
from operator import attrgetter
from typing import Generic, Protocol, TypeAlias, TypeVar

import pandas as pd

from analysis.report.values import frame_of
from analysis.report.wording import (
    IntervalEstimate,
    number,
    number_range,
    p_number,
    placed,
    t_number,
)
from protocols.blocks import Block, Folded, TableBlock

H = TypeVar("H")
R = TypeVar("R")
V = TypeVar("V")
T = TypeVar("T", contravariant=True)

DECIDING = "Deciding p"
DECIDES = "decides"
"""Column of a file that names the columns whose p decides."""


class JudgedByT(Protocol):
    """A result with a statistic that follows t."""

    @property
    def t(self) -> float:
        """Statistic."""

    @property
    def df(self) -> float:
        """Degrees of freedom."""


FileValues: TypeAlias = Callable[[T], Mapping[str, object]]
"""Values by name that a file holds of a row."""


@dataclass(frozen=True)
class ResultColumn(Generic[T]):
    """One column of a table, and what its file holds there.

    Attributes
    ----------
    title, style : str
        As of `protocols.blocks.TableColumn`.
    text : callable or None
        Cell of a row on the page and in the terminal; None: the column is in the file alone.
    csv : str or callable
        Names of the row's attributes in the file, with blanks between them, or values by name.
    decides : str or callable
        Name in the file of the p that decides, or that of each row; empty: this is none.
    other : bool
        The column is of another analysis, which stands folded.
    """

    title: str
    style: str
    text: Callable[[T], str] | None
    csv: str | FileValues[T] = ""
    decides: str | Callable[[T], str] = ""
    other: bool = False

    def values(self, row: T) -> Mapping[str, object]:
        """Return the values of a row in the file."""
        if isinstance(self.csv, str):
            return {name.split(".")[-1]: attrgetter(name)(row) for name in self.csv.split()}
        return self.csv(row)


@dataclass(frozen=True)
class ResultTable(Generic[R]):
    """Rows of results, and what readers see of them."""

    caption: str
    rows: Sequence[R]
    columns: Sequence[ResultColumn[R]]

    @classmethod
    def of(cls, caption: str, rows: Sequence[R], *columns: ResultColumn[R]) -> "ResultTable[R]":
        """Return a table of these columns."""
        return cls(caption, rows, columns)

    def block(self) -> TableBlock:
        """Return the table of the page and of the terminal, without other analyses."""
        return self._of([one for one in self.columns if not one.other], self.caption)

    def folded(self, title: str, why: str, *after: Block) -> Folded:
        """Return the other analyses of the same rows, and why they are there."""
        named = takewhile(lambda one: "l" in one.style.split(), self.columns)
        others = [one for one in self.columns if one.other]
        return Folded(title, why, (self._of([*named, *others], ""), *after))

    def _of(self, columns: Iterable[ResultColumn[R]], caption: str) -> TableBlock:
        shown = [(one.title, one.style, one.text) for one in columns if one.text is not None]
        return TableBlock.each(caption, self.rows, *shown)

    def frame(self) -> pd.DataFrame:
        """Return the table of the file, as the columns say."""
        return self._marked(
            pd.DataFrame(
                {name: value for one in self.columns for name, value in one.values(row).items()}
                for row in self.rows
            )
        )

    def every_field(self, *without: str, kind: type | None = None) -> pd.DataFrame:
        """Return the table of a file that holds all fields of the rows, `without` some.

        `kind` is the dataclass of the rows, where there may be none.
        """
        return self._marked(frame_of(self.rows, kind, without=without))

    def _marked(self, frame: pd.DataFrame) -> pd.DataFrame:
        """Add the column that names, row by row, the columns whose p decides."""
        told = [one.decides for one in self.columns if one.decides]
        if told:
            frame[DECIDES] = [
                " ".join(filter(None, (one if isinstance(one, str) else one(row) for one in told)))
                for row in self.rows
            ]
        return frame


def attribute(
    title: str, name: str, text: Callable[..., str] = number, style: str = ""
) -> ResultColumn[object]:
    """Return the column of an attribute, such as ``answers.trials``, which is so in the file."""
    return ResultColumn(title, style, lambda row: text(attrgetter(name)(row)), name)


def set_aside(column: ResultColumn[R]) -> ResultColumn[R]:
    """Return the column as one of another analysis."""
    return replace(column, other=True)


def p_value(title: str, name: str) -> ResultColumn[object]:
    """Return the column of a p of another analysis."""
    return set_aside(attribute(title, name, p_number, "n"))


def deciding(name: str = "p", file: str = "", title: str = DECIDING) -> ResultColumn[object]:
    """Return the column of the p that decides; `file` is its name in the file."""
    file = file or name.split(".")[-1]
    return replace(p_value(title, name), style="strong n", decides=file, other=False)


def undecided(p: ResultColumn[R]) -> ResultColumn[R]:
    """Return the column of such a p where another test decides."""
    return replace(p, title="p", style="n", decides="")


P_VALUE, P_ADJUSTED = p_value("p", "p"), p_value("p adj.", "p_adjusted")
T_DF = ResultColumn[JudgedByT]("t(df)", "n", lambda row: t_number(row.t, row.df), "t df")


def estimated(title: str, name: str, style: str = "strong") -> ResultColumn[IntervalEstimate]:
    """Return the column of an attribute that has limits."""
    return ResultColumn(title, style, lambda row: placed(row, getattr(row, name)), name)


def limits(
    title: str = "Limits", text: Callable[[float, float], str] = number_range
) -> ResultColumn[IntervalEstimate]:
    """Return the column of limits."""
    return ResultColumn(title, "n", lambda row: text(row.lower, row.upper), "lower upper")


def within(get: Callable[[R], H], columns: Iterable[ResultColumn[H]]) -> Iterator[ResultColumn[R]]:
    """Yield columns of what `get` takes from a row."""
    for one in columns:
        text = None if one.text is None else partial(_after, get, one.text)
        tells = one.decides if isinstance(one.decides, str) else partial(_after, get, one.decides)
        yield ResultColumn(
            one.title, one.style, text, partial(_after, get, one.values), tells, one.other
        )


def _after(get: Callable[[R], H], made: Callable[[H], V], row: R) -> V:
    return made(get(row))
