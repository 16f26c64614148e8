"""What reaches the terminal: text as it is, never as markup, never as an escape sequence.

Names of files, journals and studies come from outside. Rich would read `[red]` in them as a style,
and a terminal would obey what follows an escape character.
"""

from __future__ import annotations

import sys
from typing import Any, TextIO

from rich.console import Console
from rich.progress import Task, TextColumn
from rich.text import Text

from protocols.outside import visible

_UNFOLDED = 10_000  # columns


def say(*parts: object, file: TextIO | None = None) -> None:
    """Print parts with spaces between, on stdout unless told otherwise."""
    stream = file or sys.stdout
    text = visible(" ".join(map(str, parts)))
    encoding = stream.encoding or "utf-8"
    stream.write(text.encode(encoding, "backslashreplace").decode(encoding) + "\n")


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
    """What a task of a progress bar says, as it is; or the same words for all tasks."""

    def __init__(self, words: str | None = None) -> None:
        super().__init__("", markup=False)
        self._words = words

    def render(self, task: Task) -> Text:
        """Return the description."""
        return Text(visible(self._words or task.description), justify="left")
