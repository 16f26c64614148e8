"""A user's mistake outside the image pipeline: the exception, and one entry of a list."""

from __future__ import annotations

from dataclasses import dataclass


class StudyError(Exception):
    """A mistake the user can mend: bad file, protocol, folder, device or key.

    The message says what must hold, what was found, where, and the cure. The
    command line prints it without a traceback and exits with status 2.
    """


@dataclass(frozen=True)
class Problem:
    """One mistake: where it is, and what must hold, was found and cures it."""

    place: str
    message: str

    def __str__(self) -> str:
        return f"{self.place}: {self.message}" if self.place else self.message
