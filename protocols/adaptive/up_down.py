"""Up-down tracks: harder after correct answers, easier after a wrong one.

Two rules, and what lies between them:

- **Weighted** (Kaernbach 1991, "Simple adaptive testing with the weighted up-down method",
  Perception & Psychophysics 49, 227-229): each correct answer makes it harder, each wrong one
  easier, by steps of different size. The track hovers where it is as likely to climb as to
  fall: ``p harder = (1 - p) easier``, so ``p = easier / (easier + harder)``.
- **Transformed** (Levitt 1971, "Transformed up-down methods in psychoacoustics", Journal of the
  Acoustical Society of America 49, 467-477): n correct answers in a row make it harder, one wrong
  answer easier, by steps of the same size. It hovers where ``p ** n = 1/2``: at .707 for two,
  at .794 for three.

With n answers in a row and unequal steps both rules together give
``p ** n = easier / (easier + harder)`` (`performance`). This is where a track with small steps
ends up. With steps as large as the rise of the psychometric function it hovers elsewhere
(García-Pérez 1998, Vision Research 38, 1861-1881).

**Steps.** After each reversal the next step sizes of the list apply; the last ones stay. Until the
first reversal one correct answer is enough (`one_at_first`), so that easy trials at the start are
not wasted.

**Levels.** The track is a number that stays between the lowest and the highest level. What is
shown is the level nearest to it, of two as near the lower. Where every step is a multiple of the
distance between levels, as it should be, both are the same.

**Harder** means a lower level, or a higher one where performance falls with the level.
"""

from __future__ import annotations

from dataclasses import dataclass

from protocols.adaptive.answer_history import History, check_history, check_rising
from protocols.errors import StudyError


@dataclass(frozen=True)
class UpDown:
    """The rule of one track.

    Attributes
    ----------
    levels : tuple of float
        The levels that may be shown, rising, in the unit of the stimulus.
    start : float
        The first level; an easy one, so that the participant sees what to look for.
    harder, easier : tuple of float
        Step sizes, equally many, positive, in the unit of the levels: first before the first
        reversal, then after each.
    in_a_row : int
        How many correct answers in a row make it harder.
    one_at_first : bool
        Until the first reversal, one correct answer makes it harder.
    falling : bool
        Performance falls with the level: harder is higher.

    Raises
    ------
    StudyError
        If levels are out of order, or start or steps do not fit them.
    """

    levels: tuple[float, ...]
    start: float
    harder: tuple[float, ...]
    easier: tuple[float, ...]
    in_a_row: int = 1
    one_at_first: bool = True
    falling: bool = False

    def __post_init__(self) -> None:
        """Check everything that can be checked without data."""
        check_rising(self.levels)
        low, high = self.levels[0], self.levels[-1]
        if self.start not in self.levels:
            raise StudyError(
                f"start: must be one of the levels, which go from {low:g} to {high:g}"
                f" (got {self.start:g})"
            )
        if not self.harder or len(self.harder) != len(self.easier):
            raise StudyError(
                "harder, easier: must be equally many step sizes, one or more (got"
                f" {len(self.harder)} and {len(self.easier)})"
            )
        for name, steps in (("harder", self.harder), ("easier", self.easier)):
            for index, step in enumerate(steps):
                if not 0 < step <= high - low:
                    raise StudyError(
                        f"{name}[{index}]: a step must be greater than 0 and no longer than the"
                        f" range of the levels, {high - low:g} (got {step:g});"
                        " take smaller steps, or add levels"
                    )
        if self.in_a_row < 1:
            raise StudyError(f"in_a_row: must be at least 1 (got {self.in_a_row})")


@dataclass(frozen=True)
class Track:
    """State of a track after a history.

    Attributes
    ----------
    next_level : float
    shown : tuple of float
        The level that the rule asked for at each trial of the history.
    reversals : tuple of int
        Trials, from 0, whose answer turned the track around.
    """

    next_level: float
    shown: tuple[float, ...]
    reversals: tuple[int, ...]


def track(history: History, settings: UpDown) -> Track:
    """Follow the rule through the answers.

    Raises
    ------
    StudyError
        If a trial of the history was not shown at the level that the rule asks for: it was made
        with other settings, or with answers that are missing here.
    """
    check_history(history, settings.levels)
    low, high = settings.levels[0], settings.levels[-1]
    towards_harder = 1.0 if settings.falling else -1.0
    position, run, direction = settings.start, 0, 0.0
    shown: list[float] = []
    reversals: list[int] = []
    for trial, (level, correct) in enumerate(history):
        asked = _nearest(position, settings.levels)
        if level != asked:
            raise StudyError(
                f"history[{trial}]: the level must be {asked:g}, which this track asks for after"
                f" the answers before it (got {level:g}); use the settings that the answers were"
                " given with, and every answer of the track in its order"
            )
        shown.append(asked)
        run = run + 1 if correct else 0
        needed = 1 if settings.one_at_first and not reversals else settings.in_a_row
        if correct and run < needed:
            continue
        run = 0
        turn = towards_harder if correct else -towards_harder
        if direction == -turn:
            reversals.append(trial)
        direction = turn
        steps = settings.harder if correct else settings.easier
        position += turn * steps[min(len(reversals), len(steps) - 1)]
        position = min(max(position, low), high)
    return Track(_nearest(position, settings.levels), tuple(shown), tuple(reversals))


def next_level(history: History, settings: UpDown) -> float:
    """Return the level to show next.

    Raises
    ------
    StudyError
        As `track`.
    """
    return track(history, settings).next_level


def _nearest(position: float, levels: tuple[float, ...]) -> float:
    return min(levels, key=lambda level: (abs(level - position), level))
