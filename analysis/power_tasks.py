"""Power of tasks with right answers: simulate the study, analyse it as it will be, count."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from analysis.power import first_reaching
from analysis.simulated_tasks import TaskDesign

Simulate = Callable[[TaskDesign, np.random.Generator], pd.DataFrame]
Analyse = Callable[[pd.DataFrame], float]

MANY_UNDECIDED = 0.05


@dataclass(frozen=True)
class TaskPower:
    """How often studies of growing size are significant.

    Attributes
    ----------
    designs : tuple of TaskDesign
    power : tuple of float
        Share of simulated studies with p < alpha.
    undecided : tuple of float
        Share of studies whose analysis gave no p; they count as not significant.
    needed : tuple of (goal, participants or None)
        Where only participants differ: the smallest number that keeps the goal.
    """

    designs: tuple[TaskDesign, ...]
    power: tuple[float, ...]
    undecided: tuple[float, ...]
    needed: tuple[tuple[float, int | None], ...]
    studies: int
    alpha: float
    warnings: tuple[str, ...]

    def standard_error(self, power: float) -> float:
        """Return the Monte Carlo standard error of a power."""
        return float(np.sqrt(max(power * (1.0 - power), 1e-9) / self.studies))


def power_of_task(
    simulate: Simulate,
    analyse: Analyse,
    designs: Sequence[TaskDesign],
    *,
    rng: np.random.Generator,
    studies: int = 500,
    alpha: float = 0.05,
    progress: Callable[[int, int], None] | None = None,
) -> TaskPower:
    """Return the share of significant studies for each design.

    Parameters
    ----------
    simulate : (design, rng) -> trials
        One study with the effect to find, such as a simulator of `simulated_tasks` with its
        effect filled in. An effect of nothing gives the false-positive rate.
    analyse : trials -> p
        The planned test. NaN, or a ValueError, is a study without answer.
    designs : sequence of TaskDesign
        Numbers of participants, scenes and repeats to try.

    Raises
    ------
    ValueError
        If there is nothing to simulate.
    """
    if not designs or studies < 1:
        raise ValueError("there must be a design and a study at least")
    power, undecided = [], []
    for number, design in enumerate(designs):
        p_values = np.full(studies, np.nan)
        for study in range(studies):
            try:
                p_values[study] = analyse(simulate(design, rng))
            except ValueError:
                continue
            if progress:
                progress(number * studies + study + 1, len(designs) * studies)
        power.append(float(np.mean(p_values < alpha)))
        undecided.append(float(np.mean(np.isnan(p_values))))
    notes = [
        f"{share:.0%} of the studies with {design.participants} participants gave no p"
        for design, share in zip(designs, undecided, strict=True)
        if share > MANY_UNDECIDED
    ]
    people = [design.participants for design in designs]
    only_people = len(
        {replace(design, participants=2) for design in designs}
    ) == 1 and people == sorted(set(people))
    return TaskPower(
        designs=tuple(designs),
        power=tuple(power),
        undecided=tuple(undecided),
        needed=tuple((goal, first_reaching(people, np.array(power), goal)) for goal in (0.8, 0.9))
        if only_people
        else (),
        studies=studies,
        alpha=alpha,
        warnings=tuple(notes),
    )
