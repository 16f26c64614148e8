"""Pairs of stimuli in tasks that have two told apart."""

from __future__ import annotations

from abc import abstractmethod
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, combinations
from typing import Annotated, ClassVar, NamedTuple

from pydantic import Field

from protocols.columns import Column
from protocols.errors import Problem
from protocols.recipes.base import Pool, Stimulus
from protocols.tasks.base import Arrangement, Cell, Task, matches
from protocols.tasks.rates import RatesAnalysis
from protocols.tasks.single import RightOrWrong
from protocols.units import Condition, Name, Scalar, Seconds

AGAINST, STANDARD, ANOTHER = "against", "standard", "another"


class ComparisonAnalysis(RatesAnalysis):
    """d' by condition, and the level at which it leaves zero."""

    claimed_level: Annotated[float, Field(gt=0)] | None = None
    """Level up to which two stimuli are claimed to look alike: the report says on which side of the
    limits of each critical level it lies. Default: none."""

    added_later: ClassVar[tuple[str, ...]] = (*RatesAnalysis.added_later, "claimed_level")

    def problems(self, task: Task, pool: Pool, /) -> Iterator[Problem]:
        """Yield also a claim without a level."""
        yield from super().problems(task, pool)
        if self.claimed_level is not None and self.level is None:
            yield Problem("analysis.claimed_level", "must have analysis.level, which it is one of")


class StimulusPair(NamedTuple):
    """Two stimuli that are compared: what a table calls each, and their names."""

    one: tuple[str, str]
    other: tuple[str, str]


class Standards(Task):
    """Stimuli may have a standard, with which they are compared."""

    standard: dict[Name, Scalar] | None = None
    """Condition that every other stimulus of its scene is compared with, such as `{ method =
    "reference" }`."""
    matched: tuple[Name, ...] = ("scene",)
    """Columns in which a stimulus and its standard agree."""

    def is_standard(self, stimulus: Stimulus) -> bool:
        """Return True if others are compared with this stimulus."""
        return self.standard is not None and matches(stimulus.condition, self.standard)

    def key(self, stimulus: Stimulus) -> tuple[Scalar | None, ...]:
        """Return the values that a stimulus and its standard have in common."""
        return tuple(stimulus.condition.get(name) for name in self.matched)

    def standards(self, pool: Pool) -> dict[tuple[Scalar | None, ...], list[str]]:
        """Return the names of the standards by what they have in common with their stimuli."""
        found: dict[tuple[Scalar | None, ...], list[str]] = {}
        for stimulus in pool.stimuli.pool():
            if self.is_standard(stimulus):
                found.setdefault(self.key(stimulus), []).append(stimulus.name)
        return found

    def standard_problems(self, pool: Pool) -> Iterator[Problem]:
        """Yield a problem where a stimulus has no standard, or more than one."""
        if self.standard is None:
            return
        yield from pool.check_where("task.standard", self.standard)
        yield from pool.check_columns("task.matched", self.matched)
        standards = self.standards(pool)
        for key, names in standards.items():
            if len(names) > 1:
                said = ", ".join(f"{c} = {v}" for c, v in zip(self.matched, key, strict=True))
                yield Problem(
                    "task.matched",
                    f"there must be one standard where {said} (got {' and '.join(names[:3])});"
                    " name the column in which they differ too",
                )
        for stimulus in pool.stimuli.pool():
            if not self.is_standard(stimulus) and self.key(stimulus) not in standards:
                yield Problem(
                    "task.matched",
                    "every stimulus must have a standard that agrees with it in"
                    f" {', '.join(self.matched)} (there is none for {stimulus.name!r})",
                )
                return


class ComparisonTask(Standards, RightOrWrong):
    """Two stimuli differ; the answer says where, or which of them came again."""

    compare: Name | None = None
    """Compare stimuli that differ in this column only, such as `seed`. With a standard too, both
    comparisons are made, and the column `against` tells them apart (`standard`, `another`)."""
    gap_s: Seconds = 0.5
    """Blank between two stimuli."""

    sided: ClassVar[bool] = True

    @abstractmethod
    def arrangements(self, condition: Condition, pair: StimulusPair) -> Sequence[Arrangement]:
        """Return the ways to show a pair; right answers alternate."""

    def cells(self, pool: Pool) -> list[Cell]:
        """Return every pair that is compared."""
        rank = {scene: place for place, scene in enumerate(pool.scenes)}
        seen: Counter[str] = Counter()
        found = []
        both = self.own_columns()
        compared = chain(
            self._against_standard(pool) if self.standard is not None else (),
            self._between(pool) if self.compare is not None else (),
        )
        for scene, told, against, pairs in compared:
            condition: Condition = {**told, AGAINST: against} if both else told
            ways = [self.arrangements(condition, pair) for pair in pairs]
            # In turn, so that any two that follow each other balance right answers and pairs.
            turns = [
                ways[(turn + shift) % len(ways)][turn]
                for shift in range(len(ways))
                for turn in range(len(ways[0]))
            ]
            # Each condition has another arrangement in every scene.
            found.append(Cell(scene, tuple(turns), rank[scene] + seen[scene]))
            seen[scene] += 1
        return sorted(found, key=lambda cell: rank[cell.scene])

    def own_columns(self) -> Mapping[str, tuple[Scalar, ...]]:
        """Return `against` where both comparisons are made."""
        both = self.standard is not None and self.compare is not None
        return {AGAINST: (STANDARD, ANOTHER)} if both else {}

    def labels(self) -> Mapping[str, str]:
        """Return the words that reports print for the two comparisons."""
        if not self.own_columns():
            return {}
        return {STANDARD: "against the standard", ANOTHER: "against another"}

    def _between(self, pool: Pool) -> Iterator[tuple[str, Condition, str, list[StimulusPair]]]:
        for scene, _, stimuli, condition in pool.stimuli.groups(pool.scenes, self.compare or ""):
            names = {value: stimulus.name for value, stimulus in stimuli.items()}
            for pair in combinations(names.items(), 2):
                yield scene, condition, ANOTHER, [StimulusPair(*pair)]

    def _against_standard(
        self, pool: Pool
    ) -> Iterator[tuple[str, Condition, str, list[StimulusPair]]]:
        standards = self.standards(pool)
        found: dict[object, tuple[str, Condition, list[StimulusPair]]] = {}
        for stimulus in pool.stimuli.pool():
            standard = standards.get(self.key(stimulus))
            if stimulus.scene not in pool.scenes or not standard or self.is_standard(stimulus):
                continue
            told = {k: v for k, v in stimulus.condition.items() if k != self.compare}
            pair = StimulusPair((STANDARD, standard[-1]), ("comparison", stimulus.name))
            same = stimulus.name if self.compare is None else tuple(told.items())
            found.setdefault(same, (stimulus.scene, told, []))[2].append(pair)
        for scene, condition, pairs in found.values():
            yield scene, condition, STANDARD, pairs

    def durations(self) -> Mapping[str, float]:
        """Return the task's times by key."""
        return {**super().durations(), "gap_s": self.gap_s}

    def pair_sentence(self, one: str, other: str) -> str:
        """Return the differences of the two stimuli, under the names that a trial gives them."""
        found = []
        if self.standard is not None:
            where = ", ".join(f"{column} {value}" for column, value in self.standard.items())
            found.append(
                f"One of {one} and {other} is the standard ({where}), the other has the same"
                f" {' and '.join(self.matched)}"
            )
        if self.compare is not None:
            found.append(f"{one} and {other} differ in {self.compare} alone")
        return "; or ".join(found)

    def condition_columns(self, pool: Pool) -> tuple[Column, ...]:
        """Return the columns of the stimuli, and what they were compared with."""
        return (
            *(column for column in super().condition_columns(pool) if column.name != self.compare),
            *(
                Column(name, "text", "", "Value it was compared with: the standard, or another")
                for name in self.own_columns()
            ),
        )

    def problems(self, pool: Pool) -> Iterator[Problem]:
        """Yield all that does not fit the rest of the study."""
        yield from super().problems(pool)
        if self.standard is None and self.compare is None:
            yield Problem("task", "must have standard, compare or both")
        yield from self.standard_problems(pool)
        if self.compare is not None:
            yield from pool.check_columns("task.compare", (self.compare,))
