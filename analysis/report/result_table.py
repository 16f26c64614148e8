"""Tables of results: each is declared once, for the page, the terminal and its CSV file."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from typing import Generic, Protocol, TypeAlias, TypeVar

import pandas as pd

from analysis.report.values import frame_of
from analysis.report.wording import (
    IntervalEstimate,
    df_text,
    number,
    number_range,
    p_number,
    placed,
    t_number,
)
from protocols.blocks import TableBlock

H = TypeVar("H")
R = TypeVar("R")
V = TypeVar("V")
T = TypeVar("T", contravariant=True)


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
    """

    title: str
    style: str
    text: Callable[[T], str] | None
    csv: str | FileValues[T] = ""

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
        """Return the table of the page and of the terminal."""
        shown = [(one.title, one.style, one.text) for one in self.columns if one.text is not None]
        return TableBlock.each(self.caption, self.rows, *shown)

    def frame(self) -> pd.DataFrame:
        """Return the table of the file, as the columns say."""
        return pd.DataFrame(
            {name: value for one in self.columns for name, value in one.values(row).items()}
            for row in self.rows
        )

    def every_field(self, *without: str) -> pd.DataFrame:
        """Return the table of a file that holds all fields of the rows, `without` some."""
        return frame_of(self.rows, without=without)


def attribute(
    title: str, name: str, text: Callable[..., str] = number, style: str = ""
) -> ResultColumn[object]:
    """Return the column of an attribute, such as ``answers.trials``, which is so in the file."""
    return ResultColumn(title, style, lambda row: text(attrgetter(name)(row)), name)


def p_value(title: str, name: str) -> ResultColumn[object]:
    """Return the column of a p."""
    return attribute(title, name, p_number, "n")


P_VALUE, P_ADJUSTED = p_value("p", "p"), p_value("p adj.", "p_adjusted")
DF = ResultColumn[JudgedByT]("df", "", lambda row: df_text(row.df, row.t), "df")
T_DF = ResultColumn[JudgedByT]("t(df)", "n", lambda row: t_number(row.t, row.df), "t df")
TESTED = DF, P_VALUE, P_ADJUSTED
"""Degrees of freedom and p of a comparison."""


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
        yield ResultColumn(one.title, one.style, text, partial(_after, get, one.values))


def _after(get: Callable[[R], H], made: Callable[[H], V], row: R) -> V:
    return made(get(row))
