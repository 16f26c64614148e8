"""What a page is made of: headings, paragraphs, tables and figures, whichever task they are of.

A text is escaped on the page unless it is `Markup`.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias, TypeVar

from markupsafe import Markup
from matplotlib.figure import Figure

from analysis.report.wording import grouped

T = TypeVar("T")


class Warned(Protocol):
    """A result that says when not to trust it."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons."""


W = TypeVar("W", bound=Warned)


@dataclass(frozen=True)
class Heading:
    """A heading within a section."""

    text: str


@dataclass(frozen=True)
class Paragraph:
    """A paragraph; `muted` ones explain a table."""

    text: str
    muted: bool = False


@dataclass(frozen=True)
class TableColumn:
    """Head of a column, and the classes of its cells in `report.css`.

    ``l``: text, on the left; ``c``: wide; ``n``: never broken; ``strong``: what to read first.
    """

    title: str
    style: str = ""

    @property
    def head_style(self) -> str:
        """Class of the head."""
        return "l" if "l" in self.style.split() else ""


@dataclass(frozen=True)
class Table:
    """A table: each row has a cell for every column."""

    caption: str
    columns: tuple[TableColumn, ...]
    rows: tuple[tuple[str, ...], ...]

    @classmethod
    def of(
        cls, caption: str, columns: Sequence[tuple[str, str]], rows: Sequence[Sequence[str]]
    ) -> "Table":
        """Return a table of columns (title, style) and rows of texts."""
        return cls(
            caption,
            tuple(TableColumn(title, style) for title, style in columns),
            tuple(tuple(row) for row in rows),
        )

    @classmethod
    def each(
        cls, caption: str, things: Iterable[T], *columns: tuple[str, str, Callable[[T], str]]
    ) -> "Table":
        """Return a table with a row for each of some things, of columns (title, style, cell)."""
        rows = [[cell(thing) for _, _, cell in columns] for thing in things]
        return cls.of(caption, [(title, style) for title, style, _ in columns], rows)


@dataclass(frozen=True)
class Picture:
    """Where the figure of this name stands; nothing where there is none."""

    name: str


@dataclass(frozen=True)
class Cautions:
    """When not to trust what stands above; nothing where there are no notes."""

    title: str
    notes: tuple[str, ...]

    @classmethod
    def each(cls, title: str, things: Iterable[W], name: Callable[[W], str]) -> "Cautions":
        """Return the warnings of some results, equal ones once, with the names of the results."""
        return cls(title, grouped([(name(one), one.warnings) for one in things]))


@dataclass(frozen=True)
class Box:
    """What to read first."""

    title: str
    lead: str
    text: str = ""


Block: TypeAlias = Heading | Paragraph | Table | Picture | Cautions | Box


@dataclass(frozen=True)
class Section:
    """A section of the page; `link` is its name in the list of links at the top."""

    name: str
    title: str
    link: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class ReportFigure:
    """A figure by name, its caption, and how to draw it at a width in inches."""

    name: str
    caption: str
    draw: Callable[[float], Figure]


def strong(text: str) -> Markup:
    """Return a text, escaped, that stands out."""
    return Markup("<strong>{}</strong>").format(text)
