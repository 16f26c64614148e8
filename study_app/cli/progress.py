"""Progress of commands with long work: one line, or a bar with the time that is left."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from study_app.cli.terminal import Description, PlainConsole, say

if TYPE_CHECKING:
    from stimuli.media.frames_folder import Reporter


@contextmanager
def one_line() -> Iterator[Callable[[str, int, int], None]]:
    """Show one line that says what is done; a total of 0 means that no end is known."""
    columns = (Description(), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, console=PlainConsole(stderr=True), transient=True) as bars:
        task = bars.add_task("starting", total=None)

        def say(name: str, done: int, total: int) -> None:
            bars.update(task, description=name, completed=done, total=total or None)

        yield say


class ProgressLines:
    """Lines that stay, on `console`, and between them one line on stderr that says what is done.

    The line goes before the next one is printed, so that neither runs into the other.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._open = ExitStack()
        self._now: Callable[[str, int, int], None] | None = None

    def __enter__(self) -> ProgressLines:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    @property
    def reporter(self) -> Reporter:
        """The same, as work on files takes it."""
        from stimuli.media.frames_folder import Reporter

        return Reporter(self.say, self.progress)

    def say(self, line: str) -> None:
        """Print a line."""
        self._close()
        self._console.print(line)

    def progress(self, name: str, done: int, total: int) -> None:
        """Print the state of the work; see `one_line`."""
        if self._now is None:
            self._now = self._open.enter_context(one_line())
        self._now(name, done, total)

    def _close(self) -> None:
        self._open.close()
        self._now = None


@contextmanager
def going_on() -> Iterator[None]:
    """Say at Ctrl-C that the same command continues, and end with status 130.

    For commands that keep what is done.
    """
    try:
        yield
    except KeyboardInterrupt:
        say("stopped; the same command continues from here", file=sys.stderr)
        raise typer.Exit(130) from None


@contextmanager
def progress_line(what: str) -> Iterator[Callable[[int, int, str], None]]:
    """Show a bar that stays; yield what is told of things done, things in all, and what goes on.

    Things in all may be 0: then no end is known. An error takes the bar away: over what went wrong
    it says nothing. Without a terminal there is none.
    """
    terminal = PlainConsole(stderr=True)
    progress = Progress(
        Description(), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), Description("left"),
        TimeRemainingColumn(), console=terminal, disable=not terminal.is_terminal,
    )  # fmt: skip
    with progress:
        task = progress.add_task(what, total=None)
        try:
            yield lambda done, total, now: progress.update(
                task, completed=done, total=total or None, description=now
            )
        except BaseException:
            progress.remove_task(task)
            raise
