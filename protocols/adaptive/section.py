"""The sections of a protocol that choose levels from the answers so far.

Every choice is a pure function of (protocol, plan, journal so far): a session that was killed
goes on as it would have.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from protocols.adaptive.answer_history import Shape
from protocols.disk.hashing import Chance
from protocols.errors import Problem, StudyError
from protocols.recipes.base import SCENE, Pool
from protocols.tasks.base import Adaptive, Cell, Slot, Task, Turn
from protocols.units import Condition, Few, Name, Number, Share

if TYPE_CHECKING:  # numpy and scipy load where a level is chosen
    from protocols.adaptive.quest_plus import Grid


class AdaptiveLevels(Adaptive):
    """Levels of one column, chosen from the answers at other levels."""

    column: Name
    """The column of numbers that adapts."""
    by: tuple[Name, ...] = ()
    """Every combination of values of these columns has its own track."""

    def levels(self, task: Task, pool: Pool) -> tuple[float, ...]:
        """Return the levels that the task's conditions have, rising."""
        return self._levels(task.cells(pool))

    def next_level(self, levels: tuple[float, ...], history: Sequence[tuple[float, bool]]) -> float:
        """Return the level after these answers."""
        raise NotImplementedError

    def slots(self, task: Task, pool: Pool, chance: Chance) -> list[Slot]:
        """Return rounds in which every track has one trial, in random order."""
        tracks = [Slot(track, condition) for track, condition in self.tracks(task, pool).items()]
        return [slot for _ in range(self.trials) for slot in chance.shuffled(tracks)]

    def choose(self, task: Task, pool: Pool, turn: Turn) -> Cell:
        """Return a stimulus of the next level: each right answer is equally likely."""
        history = [
            (float(attempt.condition[self.column]), bool(attempt.correct)) for attempt in turn.past
        ]
        cells = task.cells(pool)
        level = self.next_level(self._levels(cells), history)
        options = [
            arrangement
            for cell in cells
            for arrangement in cell.arrangements
            if arrangement.condition.get(self.column) == level
            and all(arrangement.condition.get(name) == turn.condition[name] for name in self.by)
        ]
        chance = turn.chance("choose", turn.trial, turn.tries)
        # The answer first: to avoid the last picture must not make its successor predictable.
        answers = sorted({str(option.correct) for option in options})
        answer = answers[chance.below(len(answers))]
        fit = [option for option in options if str(option.correct) == answer]
        last = set(turn.past[-1].stimulus_names) if turn.past else set()
        fresh = [option for option in fit if set(option.stimuli) != last] or fit
        chosen = fresh[chance.below(len(fresh))]
        return Cell(str(chosen.condition.get(SCENE, "")), (chosen,))

    def problems(self, task: Task, pool: Pool) -> Iterator[Problem]:
        """Yield columns that are not there, and levels that are no numbers or lack stimuli."""
        yield from super().problems(task, pool)
        found = [
            *pool.check_columns("task.adaptive.column", (self.column,)),
            *task.check_shown(pool, "task.adaptive.by", self.by),
        ]
        yield from found
        if found:
            return
        levels = self.levels(task, pool)
        if len(levels) < 2:
            yield Problem(
                "task.adaptive.column",
                f"must be a column of two numbers or more (got"
                f" {', '.join(map(str, pool.stimuli.values(self.column)[:6]))})",
            )
            return
        conditions = [cell.arrangements[0].condition for cell in task.cells(pool)]
        lacking = [name for name in self.by if any(name not in entry for entry in conditions)]
        if lacking:
            yield Problem(
                "task.adaptive.by",
                f"must name columns that differ between trials (got {lacking[0]!r}, which differs"
                " within a trial)",
            )
            return
        there = {
            (tuple(entry[name] for name in self.by), entry.get(self.column)) for entry in conditions
        }
        for values in dict.fromkeys(track for track, _ in there):
            for level in levels:
                if (values, level) not in there:
                    pairs = zip(self.by, values, strict=True)
                    said = ", ".join(f"{name} = {value}" for name, value in pairs)
                    yield Problem(
                        "task.adaptive.by",
                        f"every track must have stimuli at every level (there is none at"
                        f" {self.column} = {level:g}{' where ' + said if said else ''})",
                    )
        try:
            self.next_level(levels, [])
        except StudyError as error:
            for line in str(error).splitlines():
                place, colon, message = line.partition(": ")
                yield (
                    Problem(f"task.adaptive.{place}", message)
                    if colon and " " not in place
                    else Problem("task.adaptive", line)
                )

    def sentence(self, task: Task, pool: Pool) -> str:
        """Return the tracks and their rule."""
        levels = self.levels(task, pool)
        return (
            f"{len(self.tracks(task, pool))} interleaved tracks of {self.trials} trials, one for"
            f" each {' x '.join(self.by) or 'participant'}; {self.column} is chosen from"
            f" {len(levels)} levels between {levels[0]:g} and {levels[-1]:g} by {self.rule}"
        )

    def _levels(self, cells: Iterable[Cell]) -> tuple[float, ...]:
        values = (cell.arrangements[0].condition.get(self.column) for cell in cells)
        return tuple(
            sorted({float(v) for v in values if v is not None and not isinstance(v, (str, bool))})
        )

    def tracks(self, task: Task, pool: Pool) -> dict[str, Condition]:
        """Return the values that each track holds fixed, by its name."""
        found: dict[str, Condition] = {}
        for cell in task.cells(pool):
            condition = cell.arrangements[0].condition
            found.setdefault(self.track_of(condition), {name: condition[name] for name in self.by})
        return found

    def track_of(self, condition: Condition) -> str:
        """Return the name of the track that a condition belongs to."""
        return ",".join(f"{name}={condition[name]}" for name in self.by) or "all"


Values = Annotated[tuple[Number, ...], Field(min_length=1, max_length=1000)]


class QuestPlusLevels(AdaptiveLevels):
    """The level whose answer is expected to tell most (QUEST+, Watson 2017)."""

    rule: Literal["quest-plus"]
    threshold: Values
    """Possible thresholds, rising."""
    width: Values
    """Possible widths of the psychometric function, rising."""
    guess: Annotated[tuple[Share, ...], Field(max_length=1000)] = (0.5,)
    """Possible guess rates."""
    lapse: Annotated[tuple[Share, ...], Field(max_length=1000)] = (0.02,)
    """Possible lapse rates."""
    shape: Shape = "gauss"
    """Shape of the psychometric function, also in the report. `weibull` needs levels above 0."""
    falling: bool = False
    """Answers get worse as the level rises."""

    def problems(self, task: Task, pool: Pool) -> Iterator[Problem]:
        """Yield also a level that the report could not fit the planned shape to."""
        found = list(super().problems(task, pool))
        yield from found
        lowest = min(self.levels(task, pool), default=1.0)
        if not found and self.shape == "weibull" and lowest <= 0:
            yield Problem(
                "task.adaptive.shape",
                "must be another one, or every level above 0: the report fits thresholds of the"
                f" Weibull function on logarithms of the level (got a level {lowest:g})",
            )

    def next_level(self, levels: tuple[float, ...], history: Sequence[tuple[float, bool]]) -> float:
        """Return the level of least expected entropy."""
        from protocols.adaptive.quest_plus import next_level

        return next_level(history, self.grid(levels))

    def grid(self, levels: tuple[float, ...]) -> Grid:
        """Return every observer that is thought possible."""
        from protocols.adaptive.quest_plus import Axis, Grid

        return Grid(
            levels,
            Axis(self.threshold),
            Axis(self.width),
            Axis(self.guess),
            Axis(self.lapse),
            self.shape,
            self.falling,
        )


class UpDownLevels(AdaptiveLevels):
    """Harder after right answers, easier after a wrong one (Levitt 1971, Kaernbach 1991)."""

    rule: Literal["up-down"]
    start: Number
    """The first level. Choose an easy one."""
    harder: Values
    """Steps after right answers, one for each reversal."""
    easier: Values
    """Steps after a wrong answer, as many entries."""
    in_a_row: Few = 1
    """Right answers in a row that make the next trial harder."""
    one_at_first: bool = True
    """Until the first reversal, one right answer is enough."""
    falling: bool = False
    """Answers get worse as the level rises: harder is higher."""

    def next_level(self, levels: tuple[float, ...], history: Sequence[tuple[float, bool]]) -> float:
        """Return the level of the track."""
        from protocols.adaptive.up_down import UpDown, next_level

        rule = UpDown(
            levels,
            self.start,
            self.harder,
            self.easier,
            self.in_a_row,
            self.one_at_first,
            self.falling,
        )
        return next_level(history, rule)
