"""The root of every user's mistake, that outside the image pipeline, and words of messages."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches

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


_SAME_WORDS = {
    "centre": "middle", "center": "middle", "central": "middle", "off": "none", "no": "none",
}  # fmt: skip


def did_you_mean(found: object, known: Iterable[str]) -> str:
    """Return ``; did you mean 'x'?`` for the nearest known name, or nothing.

    Case, dashes, British or American spelling and a word of the same meaning make no difference.
    """
    names = {_plain(name): name for name in reversed(list(known))}
    given = _plain(found) if isinstance(found, str) and len(found) < 1000 else ""
    near = get_close_matches(given, names, 1) or [
        name
        for name in names
        if min(len(name), len(given)) > 2 and (name.startswith(given) or given.startswith(name))
    ]
    return f"; did you mean {names[near[0]]!r}?" if near else ""


def _plain(name: str) -> str:
    low = re.sub(r"[\s_.'-]+", "", name.lower()).replace("our", "or").replace("grey", "gray")
    return _SAME_WORDS.get(low, low)


def must_be_one_of(what: str, found: object, known: Iterable[str]) -> str:
    """Return the message on a value that is none of those known, with the nearest of them."""
    names = list(known)
    return f"{what} must be one of {', '.join(names)} (got {found!r}){did_you_mean(found, names)}"


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


def labelled(name: str, label: str | None) -> str:
    """Return a name with its label, where they differ."""
    return f"{label} ({name})" if label and label != name else name


def shortest(value: float, works: Callable[[float], bool]) -> str:
    """Return a number in as few digits, four at least, as still do what it is named for."""
    texts = (f"{value:.{digits}g}" for digits in range(4, 18))
    return next((text for text in texts if works(float(text))), repr(value))


def count_of(number: int, noun: str) -> str:
    """Return a number with its noun: ``1 participant``, ``2 participants``."""
    return f"{number} {noun}" + "s" * (number != 1)
