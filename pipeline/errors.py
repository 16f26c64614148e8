"""What the pipeline raises when its caller, or the machine, is at fault, and what it notes."""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class FileNote(UserWarning):
    """What was decided about a user's file, and does not stop the work: ``PATH: what it says``."""


class InputError(ValueError):
    """An array, parameter or name that breaks a stated rule.

    The message names the argument, what must hold and what was found.
    """


class MissingExtraError(InputError):
    """What was asked for needs a package that is not installed; the message names the extra."""


class GLUnavailableError(RuntimeError):
    """No OpenGL that can run the pipeline; the message says what was found and the cure."""


def note(path: Path, text: str) -> None:
    """Warn with a `FileNote` about a file."""
    warnings.warn(FileNote(f"{path}: {text}"), stacklevel=3)


def print_notes(say: Callable[[str], None]) -> None:
    """Print each `FileNote` of this process from now on by `say`, once, as ``note: ...``."""
    told: set[str] = set()
    others = warnings.showwarning

    def show(message: Warning | str, category: type[Warning], *rest: Any, **more: Any) -> None:
        if not issubclass(category, FileNote):
            others(message, category, *rest, **more)
        elif str(message) not in told:
            told.add(str(message))
            say(f"note: {message}")

    warnings.simplefilter("always", FileNote)
    warnings.showwarning = show


@contextmanager
def notes_printed(say: Callable[[str], None]) -> Iterator[None]:
    """Do what `print_notes` does for as long as the block lasts."""
    with warnings.catch_warnings():
        print_notes(say)
        yield
