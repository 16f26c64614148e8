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

_UNFOLDED = 10_000  # columns
_KEPT = {0x09, 0x0A}
_TURNS = {*range(0x202A, 0x202F), *range(0x2066, 0x206A), 0x200E, 0x200F, 0x061C}
_CONTROLS = {*range(0x20), *range(0x7F, 0xA0), *_TURNS, 0x2028, 0x2029, 0xFEFF} - _KEPT
_VISIBLE = {code: ascii(chr(code))[1:-1] for code in (*_CONTROLS, *range(0xD800, 0xE000))}


def visible(text: str) -> str:
    """Return a text with control characters, turns of direction and lone surrogates spelt out."""
    return text.translate(_VISIBLE)


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
