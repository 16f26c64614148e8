"""What commands with long work show meanwhile: one line, or a bar with the time that is left."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from study_app.cli.terminal import Description, PlainConsole


@contextmanager
def one_line() -> Iterator[Callable[[str, int, int], None]]:
    """Show one line that says what is done; a total of 0 means that no end is known."""
    columns = (Description(), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, console=PlainConsole(stderr=True), transient=True) as bars:
        task = bars.add_task("starting", total=None)

        def say(name: str, done: int, total: int) -> None:
            bars.update(task, description=name, completed=done, total=total or None)

        yield say


def progress_bar() -> Progress:
    """Return a bar that stays, with counts and times; its tasks say what is going on."""
    return Progress(
        Description(),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        Description("left"),
        TimeRemainingColumn(),
        console=PlainConsole(stderr=True),
    )
