"""Base of tasks: conditions, phases, and the row that an attempt becomes.

A task is the section `[task]` of a study. Plan, trial machine, presenter and tables ask it, and
know no task themselves.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Annotated, ClassVar, Literal, get_args

from pydantic import Field

from protocols.columns import Column
from protocols.disk.hashing import Chance, Json
from protocols.display import Display
from protocols.errors import Problem, StudyError
from protocols.journal import Attempt
from protocols.phases import Fixation, Image, LiveImage, MovingImage, Phase
from protocols.recipes.base import Pool
from protocols.study_file.session_schema import Exclusions
from protocols.tasks.confidence_question import COLUMNS, Confidence
from protocols.units import Condition, ExtendedModel, Model, Name, Positive, Scalar, Seconds


@dataclass(frozen=True)
class Arrangement:
    """One way to show a condition: which stimulus comes where, and which answer is right."""

    condition: Condition
    stimuli: tuple[str, ...]
    """Names, in the order in which the task's phases count them."""
    correct: str | None = None
    """The right answer; None where there is none."""


@dataclass(frozen=True)
class Cell:
    """One condition of the design; its arrangements take turns over repeats and places."""

    scene: str
    arrangements: tuple[Arrangement, ...]
    parity: int = 0
    """Index, modulo their number, of the arrangement that comes first at place 0."""

    def arranged(self, turn: int) -> Arrangement:
        """Return the arrangement of a repeat at a place: `turn` is the sum of both."""
        return self.arrangements[(self.parity + turn) % len(self.arrangements)]


@dataclass(frozen=True)
class Slot:
    """One trial whose stimuli are chosen when it comes."""

    track: str
    """The trials of a track are chosen from each other's answers."""
    condition: Condition
    """Part of the condition that is fixed beforehand."""


@dataclass(frozen=True)
class Turn:
    """One trial whose stimuli are chosen now, and all that decides the choice."""

    condition: Condition
    """Part of the condition that was fixed beforehand."""
    past: Sequence[Attempt]
    """Completed attempts of its track, oldest first."""
    person: tuple[int, str, int]
    """Seed, participant and slot."""
    trial: str
    tries: int
    """Attempts at this trial so far."""

    def chance(self, *purpose: Json) -> Chance:
        """Return the participant's source of chance for a purpose."""
        return Chance(*self.person, *purpose)


class Adaptive(Model):
    """Base of adaptive rules."""

    rule: str
    """Rule by which the next level or pair follows from the answers."""
    trials: Positive
    """Trials per track."""

    def slots(self, task: Task, pool: Pool, chance: Chance) -> list[Slot]:
        """Return the trials of a participant in order."""
        raise NotImplementedError

    def choose(self, task: Task, pool: Pool, turn: Turn) -> Cell:
        """Return the condition that a trial shows; several arrangements take turns."""
        raise NotImplementedError

    def problems(self, _task: Task, pool: Pool) -> Iterator[Problem]:
        """Yield all that does not fit the rest of the study."""
        if pool.repeats != 1:
            yield Problem(
                "design.repeats",
                f"must be 1 where a rule chooses what is shown and has trials = {self.trials} of"
                f" its own (got {pool.repeats})",
            )

    def sentence(self, task: Task, pool: Pool) -> str:
        """Return a sentence on what a participant meets, for a preregistration."""
        raise NotImplementedError

    def trials_of(self, task: Task, pool: Pool) -> int:
        """Return the number of trials of all tracks."""
        return len(self.slots(task, pool, Chance("count")))


class Analysis(ExtendedModel):
    """Test that is fixed before the data: keys of every kind of analysis."""

    added_later: ClassVar[tuple[str, ...]] = ("reaction",)

    kind: str
    """The analysis that belongs to the task."""
    alpha: Annotated[float, Field(ge=1e-9, le=0.5)] = 0.05
    """Significance level."""
    exclusions: Exclusions = Exclusions()
    """Default: the defaults of Exclusions."""
    reaction: Literal["summary", "models"] = "summary"
    """`summary`: medians and means of reaction times. `models`: also a log-normal mixed model."""

    @classmethod
    def own_kind(cls) -> str:
        """Return the kind that a section of this class names."""
        return str(get_args(cls.model_fields["kind"].annotation)[0])

    def problems(self, _task: Task, _pool: Pool, /) -> Iterator[Problem]:
        """Yield all that does not fit the rest of the study."""
        yield from ()

    def plain_sentences(self, task: Task, pool: Pool) -> list[str]:
        """Return the analysis in sentences, for a preregistration."""
        raise NotImplementedError


class CatchTrials(Model):
    """Catch trials, spread evenly over the blocks."""

    trials: Positive
    """Number of catch trials."""
    where: dict[Name, Scalar]
    """Condition in which the answer is obvious, such as `{ eccentricity_deg = 5.0 }`."""


class Task(ExtendedModel):
    """Task of a participant in a trial, and its conditions."""

    added_later: ClassVar[tuple[str, ...]] = ("confidence",)

    kind: str
    """Kind of task; 'metamerlab new-study --help' names them."""
    stimulus_s: Seconds | None = None
    """Time for which a still is shown. Clips are shown once, whole."""
    confidence: Confidence | None = None
    """Question after each answer: how sure are participants? Default: not asked."""

    analysis: ClassVar[type[Analysis]]
    """The kind of analysis that goes with it."""
    sided: ClassVar[bool] = False
    """True if the answers name sides of the screen, so that keys never swap."""
    stimuli_per_trial: ClassVar[int] = 1
    decides: ClassVar[bool] = False
    """True if an answer is a decision, right or wrong or a preference: one can be sure of it."""
    decisions: ClassVar[str] = "decisions"
    """Word for several trials in a sentence of a report."""
    every_answer: ClassVar[tuple[str, ...]] = ()
    """Names of the answers, where each study of the task has the same."""

    # The design.

    def answers(self) -> tuple[str, ...]:
        """Return the names of the answers, from left to right where keys are not swapped."""
        if not self.every_answer:
            raise NotImplementedError
        return self.every_answer

    def cells(self, pool: Pool) -> list[Cell]:
        """Return every condition that the design repeats, in the scenes of the pool."""
        raise NotImplementedError

    def catch_cells(self, _pool: Pool) -> list[Cell]:
        """Return the conditions of catch trials."""
        return []

    @property
    def catch_trials(self) -> int:
        """Number of catch trials."""
        return 0

    def judged_cells(self, pool: Pool) -> list[Cell]:
        """Return the conditions of practice in which answers must be right or wrong."""
        return self.cells(pool)

    @property
    def adaptation(self) -> Adaptive | None:
        """The rule that chooses levels or pairs from the answers; None: all are planned."""
        return None

    # The trial.

    def phases(self, pool: Pool, display: Display) -> tuple[Phase, ...]:
        """Return the phases between fixation and answer."""
        raise NotImplementedError

    def phases_after(self, _pool: Pool, _display: Display) -> tuple[Phase, ...]:
        """Return the phases after answer and confidence, before feedback."""
        return ()

    def durations(self) -> Mapping[str, float]:
        """Return the task's times by key, in seconds: each must be whole refreshes."""
        return {} if self.stimulus_s is None else {"stimulus_s": self.stimulus_s}

    def shown_s(self, pool: Pool) -> float:
        """Return the time for which a trial shows stimuli, gaps included."""
        raise NotImplementedError

    def single_s(self, pool: Pool) -> float:
        """Return the time for which one stimulus is shown."""
        return pool.stimuli.clip_s or self.stimulus_s or 0.0

    def description(self, pool: Pool) -> str:
        """Return a trial in a sentence, from fixation to answer, for a preregistration."""
        raise NotImplementedError

    def design_sentence(self, pool: Pool) -> str:
        """Return a sentence on what a participant meets how often, for a preregistration."""
        rule = self.adaptation
        if rule is not None:
            return rule.sentence(self, pool)
        cells = len(self.cells(pool))
        return f"{cells} conditions, each {times(pool.repeats)}"

    def right_answer(self) -> str:
        """Return the right answer in a sentence; empty where none is."""
        return ""

    def catch_sentence(self) -> str:
        """Return a sentence on the catch trials."""
        raise NotImplementedError

    # The tables.

    def condition_columns(self, pool: Pool) -> tuple[Column, ...]:
        """Return the columns of a table that say what was shown: those of the stimuli."""
        return tuple(
            Column(name, "value", "", "Column of the stimuli's conditions")
            for name in pool.stimuli.columns()
        )

    def answer_columns(self) -> tuple[Column, ...]:
        """Return the columns of a table that say what was answered."""
        raise NotImplementedError

    def row(self, attempt: Attempt) -> dict[str, object]:
        """Return an attempt's values in the columns of condition and answer."""
        raise NotImplementedError

    def all_answer_columns(self) -> tuple[Column, ...]:
        """Return the columns of the answer, and of how sure it was where that is asked."""
        return (*self.answer_columns(), *(COLUMNS if self.confidence else ()))

    def whole_row(self, attempt: Attempt) -> dict[str, object]:
        """Return an attempt's values in the columns of condition, answer and confidence."""
        return {**self.row(attempt), **(self.confidence.row(attempt) if self.confidence else {})}

    def arranged_columns(self, pool: Pool) -> frozenset[str]:
        """Return the columns of a table that tell how a condition was arranged.

        A task whose `row` gives columns of the condition other names says them itself.
        """
        found: set[str] = set()
        for cell in self.cells(pool):
            first, *others = cell.arrangements
            for other in others:
                found |= {k for k, v in other.condition.items() if first.condition.get(k) != v}
                if other.correct != first.correct:
                    found |= {column.name for column in self.answer_columns()}
        return frozenset(found - {"correct", "track"})

    # Mistakes.

    def problems(self, pool: Pool) -> Iterator[Problem]:
        """Yield all that does not fit the rest of the study."""
        if pool.stimuli.clip_s is None and self.stimulus_s is None:
            yield Problem("task.stimulus_s", "missing: the stimuli are stills, say how long")
        if pool.stimuli.clip_s is not None and self.stimulus_s is not None:
            yield Problem(
                "task.stimulus_s",
                f"must be left out: the stimuli are clips of {pool.stimuli.clip_s:g} s",
            )

    def own_columns(self) -> Mapping[str, tuple[Scalar, ...]]:
        """Return the columns of a condition that are the task's and not the stimuli's, and their
        values: what analyses and adaptive rules may name beside the stimuli's."""
        return {}

    def labels(self) -> Mapping[str, str]:
        """Return the words that reports print for values of its own columns."""
        return {}

    def check_shown(self, pool: Pool, place: str, names: Iterable[str]) -> Iterator[Problem]:
        """Yield a problem for every name that is no column of a trial's condition."""
        own = self.own_columns()
        yield from pool.check_columns(place, [name for name in names if name not in own])


def shown_phase(
    pool: Pool,
    display: Display,
    task: Task,
    name: str,
    places: Sequence[tuple[int, float]],
) -> Phase:
    """Return the phase that shows stimuli once.

    Parameters
    ----------
    places : sequence of (int, float)
        Which of the trial's stimuli, and where its middle is, right of the screen's centre in
        degrees.

    Raises
    ------
    StudyError
        If the time of a stimulus, or of a clip's frame, is not whole refreshes of the display.
    """
    clip_s = pool.stimuli.clip_s
    shown: list[MovingImage | Image | LiveImage]
    if pool.stimuli.follows_gaze:
        shown = [LiveImage(index, x_deg) for index, x_deg in places]
    elif clip_s is None:
        shown = [Image(index, x_deg) for index, x_deg in places]
    else:
        each = whole_frames(display, 1 / pool.stimuli.frame_hz)
        shown = [MovingImage(index, each, x_deg) for index, x_deg in places]
    frames = whole_frames(display, task.single_s(pool))
    return Phase(name, frames, (*shown, Fixation()), watched=True)


def in_turn(
    pool: Pool, display: Display, task: Task, names: Sequence[str], gap_s: float
) -> tuple[Phase, ...]:
    """Return the phases that show a trial's stimuli one after the other, with gaps between.

    Raises
    ------
    StudyError
        As `shown_phase`, and for the time of a gap.
    """
    found = [shown_phase(pool, display, task, names[0], [(0, 0.0)])]
    for index, name in enumerate(names[1:], start=1):
        gap = "gap" if len(names) == 2 else f"gap-{index}"
        found.append(blank_phase(display, gap, gap_s))
        found.append(shown_phase(pool, display, task, name, [(index, 0.0)]))
    return tuple(found)


def blank_phase(display: Display, name: str, duration_s: float) -> Phase:
    """Return a watched phase that shows the fixation target alone.

    Raises
    ------
    StudyError
        If the time is not whole refreshes of the display.
    """
    return Phase(name, whole_frames(display, duration_s), (Fixation(),), watched=True)


def whole_frames(display: Display, duration_s: float) -> int:
    """Return a time in refreshes.

    Raises
    ------
    StudyError
        If it is not whole: `protocols.feasibility` says it in full.
    """
    frames = display.frames(duration_s)
    if not frames:
        raise StudyError(
            f"{duration_s:g} s must be whole refreshes at {display.refresh_hz:g} Hz;"
            " run 'metamerlab protocol check'"
        )
    return frames


def times(count: int) -> str:
    """Return a number of times in words: once, or so many times."""
    return "once" if count == 1 else f"{count} times"


def matches(condition: Condition, where: Mapping[str, Scalar]) -> bool:
    """Return True if a condition has all these values."""
    return all(condition.get(column) == value for column, value in where.items())


def all_pairs(values: Sequence[Scalar]) -> tuple[tuple[str, str], ...]:
    """Return every pair of values once, in order."""
    names = [str(value) for value in values]
    return tuple((a, b) for (i, a), (j, b) in product(enumerate(names), repeat=2) if i < j)
