"""Blocks of which every page is made, headings, tables, figures, and the page of them.

A text is escaped on the page unless it is `Markup`. ``blocks.html`` draws each kind.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Protocol, TypeAlias, TypeVar

from markupsafe import Markup

T = TypeVar("T")


class NotedResult(Protocol):
    """A result that says when not to trust it."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons."""


W = TypeVar("W", bound=NotedResult)


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
    """Head of a column, and the classes of its cells in ``page.css``.

    ``l``: text, on the left; ``c``: wide; ``n``: never broken; ``strong``: what to read first;
    ``hash``: long codes; ``free``: as people typed it.
    """

    title: str
    style: str = ""

    @property
    def head_style(self) -> str:
        """Class of the head."""
        return "l" if "l" in self.style.split() else ""


@dataclass(frozen=True)
class TableBlock:
    """A table: each row has a cell for every column; a last row of totals stands apart."""

    caption: str
    columns: tuple[TableColumn, ...]
    rows: tuple[tuple[str, ...], ...]
    totals: bool = False

    @classmethod
    def of(
        cls,
        caption: str,
        columns: Sequence[tuple[str, str]],
        rows: Iterable[Sequence[str]],
        *,
        totals: bool = False,
    ) -> TableBlock:
        """Return a table of columns (title, style) and rows of texts."""
        return cls(
            caption,
            tuple(TableColumn(title, style) for title, style in columns),
            tuple(tuple(row) for row in rows),
            totals,
        )

    @classmethod
    def each(
        cls, caption: str, things: Iterable[T], *columns: tuple[str, str, Callable[[T], str]]
    ) -> TableBlock:
        """Return a table with a row for each of some things, of columns (title, style, cell)."""
        rows = [[cell(thing) for _, _, cell in columns] for thing in things]
        return cls.of(caption, [(title, style) for title, style, _ in columns], rows)


@dataclass(frozen=True)
class FigurePlace:
    """Place of the figure of this name; nothing where there is none."""

    name: str


@dataclass(frozen=True)
class Cautions:
    """Reasons not to trust what stands above; nothing where there are no notes."""

    title: str
    notes: tuple[str, ...]

    @classmethod
    def each(cls, title: str, things: Iterable[W], name: Callable[[W], str]) -> Cautions:
        """Return the warnings of some results, equal ones once, with the names of the results."""
        return cls(title, grouped([(name(one), one.warnings) for one in things]))


@dataclass(frozen=True)
class Box:
    """Box to read first."""

    title: str
    lead: str
    text: str = ""


@dataclass(frozen=True)
class MediaFile:
    """A picture or video (.webm) by its address, with its caption."""

    address: str
    caption: str = ""
    alt: str = ""
    link: str = ""
    """Address that a click on a picture opens."""


@dataclass(frozen=True)
class MediaRow:
    """Pictures side by side, none narrower than this."""

    shots: tuple[MediaFile, ...]
    least_rem: float = 20.0


@dataclass(frozen=True)
class CopyText:
    """Paragraphs that readers copy."""

    texts: tuple[str, ...]


@dataclass(frozen=True)
class Code:
    """Lines of a terminal."""

    text: str


@dataclass(frozen=True)
class Folded:
    """Blocks that a reader opens, and why they are there."""

    title: str
    why: str
    blocks: tuple[Block, ...]


Block: TypeAlias = (
    str
    | list[str]
    | Heading
    | Paragraph
    | TableBlock
    | FigurePlace
    | Cautions
    | Box
    | MediaRow
    | CopyText
    | Code
    | Folded
)
"""A text alone is a paragraph, and a list one with bullets."""


@dataclass(frozen=True)
class Section:
    """A section of the page; `link` is its name in the list of links at the top."""

    name: str
    title: str
    link: str
    blocks: tuple[Block, ...]

    @classmethod
    def of(cls, title: str, *blocks: Block, name: str = "") -> Section:
        """Return a section that its title names, and links to it."""
        return cls(name or title.lower().replace(" ", "-"), title, title, blocks)


def strong(text: str) -> Markup:
    """Return a text, escaped, that stands out."""
    return Markup("<strong>{}</strong>").format(text)


def grouped(notes: Sequence[tuple[str, Sequence[str]]]) -> tuple[str, ...]:
    """Merge equal warnings: each once, with the names of what it is about."""
    names: dict[str, list[str]] = {}
    for name, texts in notes:
        for text in texts:
            names.setdefault(text, []).append(name)
    everywhere = len(notes)
    return tuple(
        text
        if (len(found) == everywhere and everywhere > 1) or not any(found)
        else f"{'; '.join(found)}: {text}"
        for text, found in names.items()
    )


@dataclass(frozen=True)
class Figure:
    """A figure of a page: its caption, and SVG as `Markup`; another for small screens."""

    caption: str
    wide: str = ""
    narrow: str = ""
    width_rem: float | None = None
    """At most; None: that of all figures."""


def html_page(title: str, template: str = "protocols/page.html", **values: object) -> str:
    """Return a page.

    Parameters
    ----------
    title : str
        Of the browser's window; the page's own where there is no `heading`.
    template : str
        Package and file, which extends ``page.html``: ``stimuli/batch/contact.html``.
    values : object
        `heading`; `under` it a line; `stamp` on top of the page and over every printed one; `lead`
        blocks; `sections`; `figures` by the names in `FigurePlace`; and what the template names.

    Raises
    ------
    jinja2.UndefinedError
        If it names what is not given.
    """
    # Imported here: commands that only print their help need no templates.
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    package, _, name = template.rpartition("/")
    environment = Environment(
        loader=ChoiceLoader(
            [PackageLoader(package.replace("/", "."), "."), PackageLoader("protocols", "page")]
        ),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    style = files("protocols").joinpath("page/page.css").read_text(encoding="utf-8")
    usual: Mapping[str, object] = {
        "heading": "",
        "under": "",
        "stamp": "",
        "lead": (),
        "sections": (),
        "figures": {},
    }
    return environment.get_template(name).render(
        {**usual, **values, "title": title, "style": Markup(style)}
    )
