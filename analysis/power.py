"""What simulations of power share: the numbers to try, what was found, and how it is told."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy import optimize
from scipy.special import expit

from analysis.plots import power_plot, sized
from analysis.showable import two_scenes
from analysis.tasks.base import PowerReport
from protocols.prose import count_of

Floats = NDArray[np.float64]

FEW_SCENES = 5
FEW_IN_PILOT = 12
"""Participants, or scenes, below which a deviation is a rough guess."""
NO_SPREAD = (
    "--from: deviations cannot be taken from this pilot (nearly everyone always answers alike, so"
    " that they have no finite estimate); give them by --set"
)


@dataclass(frozen=True)
class Power:
    """Power by number of participants.

    Attributes
    ----------
    participants : tuple of int
    each : ndarray
        Mean chance of a comparison after correction.
    every : ndarray
        Chance that all of them are significant after correction.
    false_positives : ndarray
        Chance that what decides is significant where there is nothing to find.
    comparisons : int
        0: a single condition is tested against chance.
    needed : tuple of (which power, goal, participants or None)
        Empty where the test errs too often to plan by it.
    studies : int
    assumptions : mapping
        What was taken for true, by name.
    """

    participants: tuple[int, ...]
    each: Floats
    every: Floats
    false_positives: Floats
    comparisons: int
    needed: tuple[tuple[str, float, int | None], ...]
    studies: int
    assumptions: Mapping[str, float]
    alpha: float
    planned: int | None
    warnings: tuple[str, ...]

    def report(
        self,
        columns: Mapping[str, Floats],
        drawn: Mapping[str, Floats],
        *,
        taken: str,
        tested: str,
        legend: str,
        draw_designs: Callable[[float], Figure] | None = None,
    ) -> PowerReport:
        """Return it ready to print and to draw.

        Parameters
        ----------
        columns, drawn : mapping of a title to (numbers of participants,)
            Of the table, and of the figure.
        taken, tested : str
            What was taken for true, and which tests were made.
        """
        people = self.participants
        thinned = {*range(0, len(people), max(1, len(people) // 12))}
        shown = sorted(thinned | {i for i, n in enumerate(people) if n == self.planned})
        return PowerReport(
            result=self,
            lead=f"{self.studies} simulated studies; {taken}; alpha {self.alpha:g}, {tested}",
            columns=("participants", *columns),
            rows=tuple(
                (
                    f"{people[i]}{' (planned)' * (people[i] == self.planned)}",
                    *(
                        f"{values[i]:.{3 if 'false positives' in name else 2}f}"
                        for name, values in columns.items()
                    ),
                )
                for i in shown
            ),
            legend=legend,
            needed=tuple(
                f"{name}, power {goal:.0%}:"
                f" {f'more than {people[-1]}' if number is None else number} participants"
                for name, goal, number in self.needed
            ),
            warnings=self.warnings,
            draw=sized(power_plot, people, drawn, planned=self.planned),
            draw_designs=draw_designs,
        )


def numbers_needed(
    participants: Sequence[int], curves: Mapping[str, Floats], *, errs: Sequence[str]
) -> tuple[tuple[str, float, int | None], ...]:
    """Return which number reaches power .8 and .9 of each test; none where the test errs."""
    return tuple(
        (name, goal, first_reaching(participants, curve, goal))
        for name, curve in curves.items()
        for goal in (() if errs else (0.8, 0.9))
    )


def few_scenes(scenes: int, scene_sd: float, *, claimed: bool) -> list[str]:
    """Say if scenes are so few, or differ so, that they limit what people can show.

    `claimed`: the test speaks of further scenes.
    """
    if claimed and scenes == 2:
        return two_scenes(scenes)
    if scenes >= FEW_SCENES or scene_sd <= 0:
        return []
    return [
        f"{count_of(scenes, 'scene')} only: more participants cannot make up for scenes that differ"
    ]


def rough_guesses(people: int, scenes: int) -> tuple[str, ...]:
    """Say of which deviation a pilot has too few participants, or scenes."""
    return tuple(
        f"only {count} {kind} in the pilot: their deviation is a rough guess, and too small rather"
        " than too large; try larger ones by --set"
        for kind, count in (("participants", people), ("scenes", scenes))
        if 1 < count < FEW_IN_PILOT
    )


def default_participants(planned: int | None) -> tuple[int, ...]:
    """Return the numbers of participants a curve shows: 4 to 40, wider for larger plans."""
    top = max(40, 2 * (planned or 0))
    step = max(1, top // 40)
    wanted = {*range(4, top, step), top, planned or top}
    return tuple(sorted(people for people in wanted if people > 1))


def first_reaching(participants: Sequence[int], curve: Floats, goal: float) -> int | None:
    """Return the smallest number from which the smoothed, rising curve stays above `goal`."""
    rising = optimize.isotonic_regression(curve).x
    above = np.nonzero(rising >= goal)[0]
    return int(participants[above[0]]) if above.size else None


def errs_too_often(
    participants: Sequence[int], false_positives: Floats, alpha: float, studies: int
) -> list[str]:
    """Say if the test errs more than twice as often as alpha allows, beyond chance of `studies`."""
    worst, doubled = int(np.argmax(false_positives)), 2 * alpha
    if false_positives[worst] <= doubled + 3 * np.sqrt(doubled * (1 - doubled) / studies):
        return []
    return [
        "do not plan by these numbers: in this design the test errs too often. With nothing to"
        f" find, {false_positives[worst]:.2f} of studies of {participants[worst]} participants are"
        f" significant all the same, at alpha {alpha:g}. Add scenes"
    ]


def mean_logit(rate: float, spread: float) -> float:
    """Return the logit whose mean response over normal effects of sd `spread` is `rate`."""
    if spread == 0:
        return float(np.log(rate / (1.0 - rate)))
    nodes, weights = np.polynomial.hermite_e.hermegauss(41)
    weights = weights / weights.sum()
    return float(
        optimize.brentq(lambda mu: weights @ expit(mu + spread * nodes) - rate, -60.0, 60.0)
    )
