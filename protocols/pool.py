"""Stimuli, scenes and repeats that a task gets of a study."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from protocols.errors import Problem, did_you_mean
from protocols.recipes.base import Recipe
from protocols.units import Scalar


@dataclass(frozen=True)
class Pool:
    """Stimuli of a study, and how its trials use them."""

    stimuli: Recipe
    scenes: tuple[str, ...]
    """Scenes of the trials that are asked for; one empty name where the stimuli tell none."""
    repeats: int
    """Trials per condition and participant."""

    def check_columns(self, place: str, names: Iterable[str]) -> Iterator[Problem]:
        """Yield a problem for every name that is no column of the stimuli's conditions."""
        known = self.stimuli.columns()
        for name in names:
            if name not in known:
                yield Problem(
                    place,
                    f"must name a column of the stimuli ({', '.join(known)}) (got {name!r})"
                    f"{did_you_mean(name, known)}",
                )

    def check_where(self, place: str, where: Mapping[str, Scalar]) -> Iterator[Problem]:
        """Yield a problem for every column or value that no stimulus has."""
        yield from self.check_columns(place, where)
        for column, value in where.items():
            known = self.stimuli.values(column)
            if isinstance(value, int | float) and str(value) in map(str, known):
                continue  # a column of texts that should be one of numbers: told where it is used
            if known and value not in known:
                listed = ", ".join(map(str, known[:12])) + (", ..." if len(known) > 12 else "")
                yield Problem(
                    f"{place}.{column}",
                    f"must be a value that the stimuli have ({listed}) (got {value!r})"
                    f"{did_you_mean(value, map(str, known))}",
                )
