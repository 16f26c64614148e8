"""Words of texts about a study: names with labels, numbers, counts."""

from __future__ import annotations

from collections.abc import Callable


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
