"""The root of every user's mistake, that outside the image pipeline, and one entry of a list."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

LAST_WITH_FORMAT_1 = "70b3711"
"""The last revision that read studies, manifests and journals of format 1."""


class UserError(Exception):
    """A mistake the user can mend: the root of all such exceptions of the five packages.

    The message says what must hold, what was found, where, and the cure. The
    command line prints it without a traceback and exits with status 2.
    """


class StudyError(UserError):
    """A bad file, protocol, folder, device or key."""


@dataclass(frozen=True)
class Problem:
    """One mistake: where it is, and what must hold, was found and cures it."""

    place: str
    message: str

    def __str__(self) -> str:
        return f"{self.place}: {self.message}" if self.place else self.message


def refuse_format_1(where: object, raw: Mapping[str, object], cure: str) -> None:
    """Refuse a file of format 1, which was never released.

    Parameters
    ----------
    where : object
        The file.
    raw : mapping
        What it says.
    cure : str
        What to do with that revision.

    Raises
    ------
    StudyError
        If it has format 1, naming the last revision that reads it.
    """
    if type(raw.get("format")) is int and raw["format"] == 1:
        raise StudyError(
            f"{where}: format: must be 2 (got 1); revision {LAST_WITH_FORMAT_1} of metamerlab is"
            f" the last that reads format 1: {cure}"
        )
