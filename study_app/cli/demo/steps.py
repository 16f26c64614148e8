"""Says what is being done, step by step, on a terminal or into a file."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeElapsedColumn

from study_app.cli.terminal import Description


class Step:
    """One step that is going on."""

    def __init__(self, progress: Progress, title: str) -> None:
        self._progress, self._title = progress, title
        self._task = progress.add_task(title, total=None)
        self.result = ""
        """What is said when it is done."""

    def __call__(self, done: int, total: int, what: str = "") -> None:
        """Move the bar; `what` is going on."""
        self._progress.update(
            self._task,
            completed=done,
            total=total or None,
            description=f"{self._title}: {what}" if what else self._title,
        )

    def end(self) -> None:
        """Take the bar away."""
        self._progress.remove_task(self._task)


class Steps:
    """All steps of a demonstration, numbered."""

    def __init__(self, console: Console, count: int) -> None:
        self._console, self._count, self._number = console, count, 0
        columns = (
            Description(), BarColumn(), MofNCompleteColumn(),
            TimeElapsedColumn(),
        )  # fmt: skip
        self._progress = Progress(*columns, console=console, transient=True)

    def __enter__(self) -> Steps:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    @contextmanager
    def step(self, title: str) -> Iterator[Step]:
        """Show a step while it lasts, then one line of what came of it."""
        self._number += 1
        label = f"{self._number}/{self._count} {title}"
        if not self._console.is_terminal:
            self._console.print(f"{label} ...")
        began_s = time.monotonic()
        step = Step(self._progress, label)
        try:
            yield step
        finally:
            step.end()
        took_s = time.monotonic() - began_s
        self._console.print(f"{label}: {step.result} ({took_s:.0f} s)")
