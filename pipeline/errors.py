"""Errors that the pipeline raises when its caller, or the machine, is at fault, and its notes."""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from protocols.errors import UserError

_NAMED = 5  # files that say the same


class FileNote(UserWarning):
    """Decision about a user's file that does not stop the work: ``PATH: text``."""

    def __init__(self, path: Path, text: str) -> None:
        super().__init__(path, text)
        self.text = text

    def __str__(self) -> str:
        """Name the file, then say what was decided."""
        return "{}: {}".format(*self.args)


class InputError(UserError, ValueError):
    """An array, parameter or name that breaks a stated rule.

    The message names the argument, what must hold and what was found.
    """


class MissingExtraError(InputError):
    """A package is missing that the work needs; the message names the extra."""


class GLUnavailableError(UserError, RuntimeError):
    """No OpenGL that can run the pipeline; the message says what was found and the cure."""


def note(path: Path, text: str) -> None:
    """Warn with a `FileNote` about a file."""
    warnings.warn(FileNote(path, text), stacklevel=3)


def print_notes(say: Callable[[str], None]) -> None:
    """Print each `FileNote` of this process from now on by `say`, once, as ``note: ...``.

    Of many files with one text, such as the frames of a folder, the first few are named.
    """
    told: dict[str, set[str]] = {}
    others = warnings.showwarning

    def show(message: Warning | str, category: type[Warning], *rest: Any, **more: Any) -> None:
        if not isinstance(message, FileNote):
            others(message, category, *rest, **more)
            return
        files = told.setdefault(message.text, set())
        if str(message) not in files and len(files) <= _NAMED:
            files.add(str(message))
            text = str(message) if len(files) <= _NAMED else f"of further files: {message.text}"
            say(f"note: {text}")

    warnings.simplefilter("always", FileNote)
    warnings.showwarning = show


@contextmanager
def notes_printed(say: Callable[[str], None]) -> Iterator[None]:
    """Do what `print_notes` does for as long as the block lasts."""
    with warnings.catch_warnings():
        print_notes(say)
        yield
