"""Text for the terminal: as it is, never as markup, never as an escape sequence.

Names of files, journals and studies come from outside. Rich would read `[red]` in them as a style,
and a terminal would obey what follows an escape character.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from typing import Any, TextIO

from rich.console import Console
from rich.progress import Task, TextColumn
from rich.table import Table
from rich.text import Text

from protocols.outside import visible

_UNFOLDED = 10_000  # columns


def say(*parts: object, file: TextIO | None = None) -> None:
    """Print parts with spaces between, on stdout unless told otherwise."""
    stream = file or sys.stdout
    text = visible(" ".join(map(str, parts)))
    encoding = stream.encoding or "utf-8"
    stream.write(text.encode(encoding, "backslashreplace").decode(encoding) + "\n")


def say_notes(notes: Iterable[object]) -> None:
    """Print each note on a line of its own."""
    for note in notes:
        say(f"note: {note}")


def table_of(
    heads: Sequence[str], rows: Iterable[Sequence[str]], *, right: int | None = None, **options: Any
) -> Table:
    """Return a table; without heads it shows names and values.

    Parameters
    ----------
    right : int, optional
        From this column on, cells stand at the right; left out: none.
    **options
        Of `rich.table.Table`.
    """
    table = Table(show_header=bool(heads), **options)
    for place, head in enumerate(heads):
        at_right = right is not None and place >= right
        table.add_column(head, justify="right" if at_right else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


class PlainConsole(Console):
    """A console whose strings are shown as they are; styles are given as `Text`.

    In a pipe or a file no line is folded, so that names stay whole; COLUMNS asks for a width.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(**({"highlight": False, "markup": False, "emoji": False} | options))
        if not self.is_terminal and "COLUMNS" not in self._environ and "width" not in options:
            self.width = _UNFOLDED

    def render_str(self, text: str, **options: Any) -> Text:
        """Return a string as text without markup."""
        return super().render_str(visible(text), **(options | {"markup": False, "emoji": False}))


class Description(TextColumn):
    """Description of a task of a progress bar, as it is; or the same words for all tasks."""

    def __init__(self, words: str | None = None) -> None:
        super().__init__("", markup=False)
        self._words = words

    def render(self, task: Task) -> Text:
        """Return the description."""
        return Text(visible(self._words or task.description), justify="left")
