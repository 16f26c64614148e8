"""The sections of a protocol that choose levels or pairs from the answers so far.

Every choice is a pure function of (protocol, plan, journal so far): a session that was killed
goes on as it would have.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from protocols.chance import Chance
from protocols.errors import Problem, StudyError
from protocols.places import place_of
from protocols.units import Condition, Few, Model, Name, Number, Positive, Share

if TYPE_CHECKING:
    from protocols.journal import Attempt
    from protocols.plan import Plan, PlannedTrial
    from protocols.schema import StudyProtocol
    from protocols.tasks.base import Arrangement, Cell
    from protocols.tasks.pairs import PairTask


@dataclass(frozen=True)
class Slot:
    """One trial whose stimuli are chosen when it comes."""

    track: str
    """The trials of a track are chosen from each other's answers."""
    condition: Condition
    """What is fixed beforehand."""


class Adaptive(Model):
    """What every rule has."""

    rule: str
    """How the next level or pair follows from the answers."""
    trials: Positive
    """Trials per track."""

    def slots(self, study: StudyProtocol, chance: Chance) -> list[Slot]:
        """Return the trials of a participant in order."""
        raise NotImplementedError

    def choose(
        self,
        study: StudyProtocol,
        trial: PlannedTrial,
        plan: Plan,
        past: Sequence[Attempt],
        chance: Chance,
    ) -> Arrangement:
        """Return what a trial shows.

        Parameters
        ----------
        plan : Plan
            The participant's.
        past : sequence of Attempt
            Completed attempts of the trial's track, oldest first.
        chance : Chance
            Fixed by participant, trial and attempt.
        """
        raise NotImplementedError

    def problems(self, study: StudyProtocol) -> Iterator[Problem]:
        """Yield what does not fit the rest of the study."""
        if study.design.repeats != 1:
            yield Problem(
                "design.repeats",
                f"must be 1 where a rule chooses what is shown and has trials = {self.trials} of"
                f" its own (got {study.design.repeats})",
            )

    def sentence(self, study: StudyProtocol) -> str:
        """Return what a participant meets, for a preregistration."""
        raise NotImplementedError

    def trials_of(self, study: StudyProtocol) -> int:
        """Return how many trials all tracks have."""
        return len(self.slots(study, Chance("count")))


class AdaptiveLevels(Adaptive):
    """Levels of one column, chosen from the answers at other levels."""

    column: Name
    """The column of numbers that adapts."""
    by: tuple[Name, ...] = ()
    """Every combination of values of these columns has its own track."""

    def levels(self, study: StudyProtocol) -> tuple[float, ...]:
        """Return the levels that the task's conditions have, rising."""
        values = (cell.arrangements[0].condition.get(self.column) for cell in self._cells(study))
        return tuple(
            sorted({float(v) for v in values if v is not None and not isinstance(v, (str, bool))})
        )

    def next_level(self, study: StudyProtocol, history: Sequence[tuple[float, bool]]) -> float:
        """Return the level after these answers."""
        raise NotImplementedError

    def slots(self, study: StudyProtocol, chance: Chance) -> list[Slot]:
        """Return rounds in which every track has one trial, in random order."""
        tracks = [Slot(track, condition) for track, condition in self._tracks(study).items()]
        return [slot for _ in range(self.trials) for slot in chance.shuffled(tracks)]

    def choose(
        self,
        study: StudyProtocol,
        trial: PlannedTrial,
        _plan: Plan,
        past: Sequence[Attempt],
        chance: Chance,
    ) -> Arrangement:
        """Return a stimulus of the next level: each right answer is equally likely."""
        history = [
            (float(attempt.condition[self.column]), bool(attempt.correct)) for attempt in past
        ]
        level = self.next_level(study, history)
        options = [
            arrangement
            for cell in self._cells(study)
            for arrangement in cell.arrangements
            if arrangement.condition.get(self.column) == level
            and all(arrangement.condition.get(name) == trial.condition[name] for name in self.by)
        ]
        # The answer first: to avoid the last picture must not make its successor predictable.
        answers = sorted({str(option.correct) for option in options})
        answer = answers[chance.below(len(answers))]
        fit = [option for option in options if str(option.correct) == answer]
        last = set(past[-1].stimulus_names) if past else set()
        fresh = [option for option in fit if set(option.stimuli) != last] or fit
        return fresh[chance.below(len(fresh))]

    def problems(self, study: StudyProtocol) -> Iterator[Problem]:
        """Yield columns that are not there, and levels that are no numbers or lack stimuli."""
        yield from super().problems(study)
        task = study.task
        found = [
            *task.check_columns(study, "task.adaptive.column", (self.column,)),
            *task.check_shown(study, "task.adaptive.by", self.by),
        ]
        yield from found
        if found:
            return
        if len(self.levels(study)) < 2:
            yield Problem(
                "task.adaptive.column",
                f"must be a column of two numbers or more (got"
                f" {', '.join(map(str, study.stimuli.values(self.column)[:6]))})",
            )
            return
        conditions = [cell.arrangements[0].condition for cell in self._cells(study)]
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
            for level in self.levels(study):
                if (values, level) not in there:
                    pairs = zip(self.by, values, strict=True)
                    said = ", ".join(f"{name} = {value}" for name, value in pairs)
                    yield Problem(
                        "task.adaptive.by",
                        f"every track must have stimuli at every level (there is none at"
                        f" {self.column} = {level:g}{' where ' + said if said else ''})",
                    )
        try:
            self.next_level(study, [])
        except StudyError as error:
            for line in str(error).splitlines():
                place, colon, message = line.partition(": ")
                yield (
                    Problem(f"task.adaptive.{place}", message)
                    if colon and " " not in place
                    else Problem("task.adaptive", line)
                )

    def sentence(self, study: StudyProtocol) -> str:
        """Return the tracks and their rule."""
        levels = self.levels(study)
        return (
            f"{len(self._tracks(study))} interleaved tracks of {self.trials} trials, one for each"
            f" {' x '.join(self.by) or 'participant'}; {self.column} is chosen from"
            f" {len(levels)} levels between {levels[0]:g} and {levels[-1]:g} by {self.rule}"
        )

    def _cells(self, study: StudyProtocol) -> list[Cell]:
        return study.task.cells(study, study.main_scenes())

    def _tracks(self, study: StudyProtocol) -> dict[str, Condition]:
        found: dict[str, Condition] = {}
        for cell in self._cells(study):
            condition = {name: cell.arrangements[0].condition[name] for name in self.by}
            name = ",".join(f"{key}={value}" for key, value in condition.items()) or "all"
            found.setdefault(name, condition)
        return found


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
    shape: Literal["gauss", "logistic", "gumbel", "weibull"] = "gauss"
    """Shape of the psychometric function, also in the report. `weibull` needs levels above 0."""
    falling: bool = False
    """Answers get worse as the level rises."""

    def problems(self, study: StudyProtocol) -> Iterator[Problem]:
        """Yield also a level that the report could not fit the planned shape to."""
        found = list(super().problems(study))
        yield from found
        lowest = min(self.levels(study), default=1.0)
        if not found and self.shape == "weibull" and lowest <= 0:
            yield Problem(
                "task.adaptive.shape",
                "must be another one, or every level above 0: the report fits thresholds of the"
                f" Weibull function on logarithms of the level (got a level {lowest:g})",
            )

    def next_level(self, study: StudyProtocol, history: Sequence[tuple[float, bool]]) -> float:
        """Return the level of least expected entropy."""
        from protocols.adaptive.quest_plus import Axis, Grid, next_level

        grid = Grid(
            self.levels(study),
            Axis(self.threshold),
            Axis(self.width),
            Axis(self.guess),
            Axis(self.lapse),
            self.shape,
            self.falling,
        )
        return next_level(history, grid)


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

    def next_level(self, study: StudyProtocol, history: Sequence[tuple[float, bool]]) -> float:
        """Return the level of the track."""
        from protocols.adaptive.up_down import UpDown, next_level

        rule = UpDown(
            self.levels(study),
            self.start,
            self.harder,
            self.easier,
            self.in_a_row,
            self.one_at_first,
            self.falling,
        )
        return next_level(history, rule)


class ActivePairs(Adaptive):
    """The pairs whose answers are expected to tell most, chosen in batches (ASAP)."""

    rule: Literal["active-pairs"]

    def slots(self, study: StudyProtocol, chance: Chance) -> list[Slot]:
        """Return scenes and sizes in random order, each as often as the others."""
        groups = self._groups(study)
        slots: list[Slot] = []
        while len(slots) < self.trials:
            slots += chance.shuffled([Slot("pairs", condition) for condition in groups])
        return slots[: self.trials]

    def choose(
        self,
        study: StudyProtocol,
        trial: PlannedTrial,
        plan: Plan,
        past: Sequence[Attempt],
        _chance: Chance,
    ) -> Arrangement:
        """Return the next pair of the present batch, in the trial's scene and size."""
        from protocols.adaptive.active_pairs import next_batch

        task = _pair_task(study)
        methods = [str(value) for value in study.stimuli.values(task.compare)]
        first, second = task.answers()
        batch = len(past) // (len(methods) - 1)
        wins = np.zeros((len(methods), len(methods)))
        for attempt in past[: batch * (len(methods) - 1)]:
            one, other = str(attempt.condition[first]), str(attempt.condition[second])
            won, lost = (one, other) if attempt.answer == first else (other, one)
            wins[methods.index(won), methods.index(lost)] += 1
        drawn = Chance(plan.seed, plan.participant, plan.slot, "pairs", batch)
        # Shuffled: a batch may have one method in many of its pairs.
        pairs = drawn.shuffled(next_batch(wins, drawn))
        i, j = pairs[len(past) % len(pairs)]
        cell = task.cell(study, trial.condition, (methods[i], methods[j]))
        if cell is None:
            raise StudyError(
                f"task.sampling: there must be stimuli of {methods[i]!r} and {methods[j]!r} in"
                f" {dict(trial.condition)}"
            )
        return cell.arranged(len(past) + place_of(study, plan.slot))

    def problems(self, study: StudyProtocol) -> Iterator[Problem]:
        """Yield a problem where a scene lacks a stimulus that others have."""
        yield from super().problems(study)
        task = _pair_task(study)
        if task.pairings != "all":
            yield Problem("task.pairings", "must be left out where sampling chooses the pairs")
        methods = len(study.stimuli.values(task.compare))
        groups = study.stimuli.groups(study.main_scenes(), task.compare)
        if any(len(stimuli) < methods for _, _, stimuli, _ in groups):
            yield Problem(
                "task.sampling",
                "every scene and size must have stimuli of every method, so that any pair can be"
                " shown anywhere; leave scenes without a reference out",
            )

    def sentence(self, study: StudyProtocol) -> str:
        """Return how pairs are chosen."""
        methods = len(study.stimuli.values(_pair_task(study).compare))
        return (
            f"{self.trials} pairs of {methods} methods, chosen in batches by the information that"
            " their answers are expected to give"
        )

    def _groups(self, study: StudyProtocol) -> list[Condition]:
        """Return the scenes and sizes in which methods are compared."""
        task = _pair_task(study)
        groups = study.stimuli.groups(study.main_scenes(), task.compare)
        return [condition for _, _, stimuli, condition in groups if len(stimuli) > 1]


def _pair_task(study: StudyProtocol) -> PairTask:
    from protocols.tasks.pairs import PairTask

    assert isinstance(study.task, PairTask)
    return study.task
