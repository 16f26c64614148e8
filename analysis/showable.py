"""Limits of what so few participants, scenes or draws can show at all."""

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

from analysis.models.clustered import FEW_SCENES, least_p
from analysis.models.mixed.inference import least_p_of_draws
from protocols.errors import count_of
from protocols.tasks.mixed import MOST_DRAWS

Words = Callable[[int], str]
Least = Callable[[int], float]

MOST_UNITS = 1000
"""Up to which a number of participants, or of scenes, that can show something is looked for."""


@dataclass(frozen=True)
class FamilyOfTests:
    """Tests whose p is corrected together, and what none of these p can fall below.

    Attributes
    ----------
    noun, of : str
        One of them, ``comparison``, and what it is of, `` of ratings``.
    count : int
    holm : bool
        Each p is Holm-adjusted over all of them.
    people : bool
        No p is below that of participants who all agree.
    toward : float
        Chance that one of these answers so where there is nothing to find.
    draws : int
        Draws of the parametric bootstrap that gives p; 0: none.
    """

    noun: str
    of: str = ""
    count: int = 1
    holm: bool = True
    people: bool = True
    toward: float = 0.5
    draws: int = 0

    @property
    def uncorrected(self) -> str:
        """Reason that some of them is significant more often than alpha; empty if there is none."""
        several = self.count > 1 and not self.holm
        return f'each {self.noun} is judged by itself (correction = "none")' * several

    def hopeless(self, people: int, alpha: float) -> list[str]:
        """Say that none can be significant with so many participants, and what that takes."""
        if self.count < 1:
            return []
        none = f"the {self.noun}{self.of} cannot be significant"
        if self.count > 1:
            adjusted = " after Holm's adjustment" * self.holm
            none = f"none of {self.count} {self.noun}s{self.of} can be significant{adjusted}"
        fewer = [f"fewer {self.noun}s"] * (self._times > 1)
        notes = []
        for words, number, least, most in self._held(people):
            if self._times * least(number) < alpha:
                continue
            known = range(number, most + 1)
            place = bisect_left(known, True, key=lambda n: self._times * least(n) < alpha)
            takes = [words(n) for n in known[place : place + 1]] + [words(0)] * (most == MOST_DRAWS)
            notes.append(
                f"{none}: {words(number)} can show no p below {least(number):.2g}; that takes"
                f" {', or '.join([*takes, *fewer])}"
            )
        return notes

    @property
    def _times(self) -> int:
        return self.count if self.holm else 1

    def _held(self, people: int) -> Iterator[tuple[Words, int, Least, int]]:
        """Yield all that holds p: its words, its number, the least p of a number, the largest."""
        if self.people:
            least = partial(_least_of_votes, toward=self.toward)
            yield partial(count_of, noun="participant"), people, least, MOST_UNITS
        if self.draws:
            yield "bootstrap_draws = {}".format, self.draws, least_p_of_draws, MOST_DRAWS


def _least_of_votes(number: int, toward: float = 0.5) -> float:
    return float(least_p(number, toward))


def limits_of_design(
    families: Iterable[FamilyOfTests], people: int | None, alpha: float, scenes: int, plan: object
) -> list[str]:
    """Return notes on all that a planned design can hardly or never show.

    Parameters
    ----------
    plan
        Section or plan of the analysis; without a key `test` it is always about further scenes.
    """
    test = getattr(plan, "test", None)
    few = two_scenes(scenes)
    if 0 < scenes < FEW_SCENES and not few:
        number = count_of(scenes, "scene")
        few = [f"{number} only: more participants cannot make up for scenes that differ"]
    alone = ', or say test = "participant", which speaks of these alone' * (test is not None)
    return [
        *(note for one in families if people for note in one.hopeless(people, alpha)),
        *(f"{note}. Show five or more{alone}" for note in few if test != "participant"),
    ]


def two_scenes(scenes: int) -> list[str]:
    """Return notes on a test that claims further scenes and has two."""
    if scenes != 2:
        return []
    return [
        "two scenes show hardly anything about further ones: p is seldom small, however many"
        " participants see them"
    ]
