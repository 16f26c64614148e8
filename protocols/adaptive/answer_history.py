"""Checks of a list of levels and a history of answers, for every adaptive rule."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Literal, TypeAlias

from protocols.errors import StudyError

Shape: TypeAlias = Literal["gauss", "logistic", "gumbel", "weibull"]
"""Form of a psychometric function (`protocols.adaptive.psychometric_function`)."""

Answer: TypeAlias = tuple[float, bool]
"""The level that was shown, and whether the answer was correct (or "yes")."""

History: TypeAlias = Sequence[Answer]
"""Every answer of one track so far, oldest first. Void attempts are not in it."""


def check_rising(levels: Sequence[float], place: str = "levels") -> None:
    """Refuse levels that are not two or more finite numbers in rising order.

    Parameters
    ----------
    levels : sequence of float
        The levels that may be shown, in the unit of the stimulus.
    place : str
        Where they stand; the message begins with it.

    Raises
    ------
    StudyError
    """
    if len(levels) < 2:
        raise StudyError(f"{place}: must hold two levels or more (got {len(levels)})")
    for index, level in enumerate(levels):
        if not math.isfinite(level):
            raise StudyError(f"{place}[{index}]: must be a finite number (got {level:g})")
        if index and level <= levels[index - 1]:
            raise StudyError(
                f"{place}[{index}]: must be above the one before it, {levels[index - 1]:g}"
                f" (got {level:g}); list each once, from the lowest to the highest"
            )


def check_history(history: History, levels: Collection[float]) -> None:
    """Refuse a history with a level that is not allowed, or an answer that is not true or false.

    Raises
    ------
    StudyError
    """
    allowed = set(levels)
    for index, (level, correct) in enumerate(history):
        if level not in allowed:
            raise StudyError(
                f"history[{index}]: must be one of the {len(allowed)} allowed levels from"
                f" {min(allowed):g} to {max(allowed):g} (got {level:g}); these answers were given"
                " with other levels: analyse them with the protocol that they were made with"
            )
        if correct not in (True, False):
            raise StudyError(f"history[{index}]: the answer must be true or false (got {correct})")
