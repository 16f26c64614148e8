"""A reporter of what work on files decides, and of how far it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Reporter:
    """Callables that are told; left out, nobody is.

    Parameters
    ----------
    say : callable
        Called with what was decided and written, a line each.
    progress : callable
        Called with what is going on, how much of it is done, and of how much (0: not known).
    """

    say: Callable[[str], None] = lambda _: None
    progress: Callable[[str, int, int], None] = lambda *_: None


SILENT = Reporter()
