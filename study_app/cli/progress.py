"""One line that says what is done, shared by commands that report (what, done, total)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn


@contextmanager
def one_line() -> Iterator[Callable[[str, int, int], None]]:
    """Show one line that says what is done; a total of 0 means that no end is known."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task("starting", total=None)

        def say(name: str, done: int, total: int) -> None:
            bars.update(task, description=name, completed=done, total=total or None)

        yield say
