"""Power of a study by number of participants, as people read it: table, curves, numbers."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from analysis.arrays import Floats
from analysis.plots import power_plot
from analysis.plots.style import Figure
from protocols.errors import count_of


@dataclass(frozen=True)
class DesignPower:
    """Power of the primary comparison with other numbers of scenes and repeats."""

    scenes: int
    repeats: int
    primary: float


@dataclass(frozen=True)
class Power:
    """Power by number of participants.

    Attributes
    ----------
    curves, wrong : mapping of a title to ndarray (numbers of participants,)
        Power, and false positives.
    needed : tuple of (which power, goal, participants or None)
        Empty where the test errs too often to plan by it.
    numbers : mapping
        All of it, for `power.json`. ``each`` and ``every``: the mean chance of a comparison, and
        that of all of them, after correction; ``comparisons``, 0: a single condition was tested
        against chance; ``also``: every column of the table.
    """

    participants: tuple[int, ...]
    planned: int | None
    curves: Mapping[str, Floats]
    wrong: Mapping[str, Floats]
    needed: tuple[tuple[str, float, int | None], ...]
    designs: tuple[DesignPower, ...]
    lead: str
    legend: str
    warnings: tuple[str, ...]
    numbers: Mapping[str, object] = field(repr=False)

    def rows(self) -> Iterator[dict[str, str]]:
        """Yield the rows of a table: a dozen numbers of participants, and the planned one."""
        people = self.participants
        shown = {*range(0, len(people), max(1, len(people) // 12))}
        for i in sorted(shown | {i for i, n in enumerate(people) if n == self.planned}):
            yield {
                "participants": f"{people[i]}{' (planned)' * (people[i] == self.planned)}",
                **{name: f"{values[i]:.2f}" for name, values in self.curves.items()},
                **{name: f"{values[i]:.3f}" for name, values in self.wrong.items()},
            }

    def needs(self) -> Iterator[str]:
        """Yield the participants that it takes for each power, in words."""
        most = f"more than {self.participants[-1]}"
        for name, goal, number in self.needed:
            yield f"{name}, power {goal:.0%}: {number or most} participants"

    def draw(self, width_in: float) -> Figure:
        """Draw the curves."""
        return power_plot(self.participants, self.curves, planned=self.planned, width_in=width_in)

    def draw_designs(self, width_in: float) -> Figure:
        """Draw power over numbers of scenes and repeats."""
        lines: dict[str, list[float]] = {}
        for one in self.designs:
            lines.setdefault(count_of(one.repeats, "repeat"), []).append(one.primary)
        return power_plot(
            sorted({one.scenes for one in self.designs}),
            {name: np.array(line) for name, line in lines.items()},
            x_label=f"Scenes, with {self.planned or self.participants[-1]} participants",
            width_in=width_in,
        )
