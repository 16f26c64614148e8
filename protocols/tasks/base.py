"""What every task offers: its conditions, its phases, and the row that an attempt becomes.

A task is the section `[task]` of a study. Plan, trial machine, presenter and tables ask it, and
know no task themselves.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, ClassVar

from protocols.columns import Column
from protocols.errors import Problem, StudyError
from protocols.phases import Clip, Fixation, Image, Phase, Text
from protocols.session_schema import Analysis
from protocols.suggest import did_you_mean
from protocols.units import Condition, Model, Name, Positive, Scalar, Seconds

if TYPE_CHECKING:
    from protocols.adaptive.section import Adaptive
    from protocols.display import Display
    from protocols.journal import Attempt
    from protocols.schema import StudyProtocol


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
    """Which arrangement comes first at place 0."""

    def arranged(self, turn: int) -> Arrangement:
        """Return the arrangement of a repeat at a place: `turn` is the sum of both."""
        return self.arrangements[(self.parity + turn) % len(self.arrangements)]


class CatchTrials(Model):
    """Catch trials, spread evenly over the blocks."""

    trials: Positive
    """Number of catch trials."""
    where: dict[Name, Scalar]
    """Condition in which the answer is obvious, such as `{ eccentricity_deg = 5.0 }`."""


class Task(Model):
    """What a participant does in a trial, and which conditions there are."""

    kind: str
    """What a participant does; 'metamerlab new-study --help' names the tasks."""
    stimulus_s: Seconds | None = None
    """How long a still is shown. Clips are shown once, whole."""

    analysis: ClassVar[type[Analysis]]
    """The kind of analysis that goes with it."""
    sided: ClassVar[bool] = False
    """Whether the answers name sides of the screen, so that keys never swap."""
    stimuli_per_trial: ClassVar[int] = 1

    # The design.

    def answers(self) -> tuple[str, ...]:
        """Return the names of the answers, from left to right where keys are not swapped."""
        raise NotImplementedError

    def cells(self, study: StudyProtocol, scenes: Sequence[str]) -> list[Cell]:
        """Return every condition that the design repeats, in these scenes."""
        raise NotImplementedError

    def catch_cells(self, _study: StudyProtocol) -> list[Cell]:
        """Return the conditions of catch trials."""
        return []

    @property
    def catch_trials(self) -> int:
        """How many catch trials there are."""
        return 0

    def practice_cells(self, study: StudyProtocol, scenes: Sequence[str]) -> list[Cell]:
        """Return the conditions of practice trials."""
        return self.cells(study, scenes)

    @property
    def adaptation(self) -> Adaptive | None:
        """The rule that chooses levels or pairs from the answers; None: all are planned."""
        return None

    # The trial.

    def phases(self, study: StudyProtocol, display: Display) -> tuple[Phase, ...]:
        """Return what is shown between fixation and answer."""
        raise NotImplementedError

    def durations(self) -> Mapping[str, float]:
        """Return the task's times by key, in seconds: each must be whole frames."""
        return {} if self.stimulus_s is None else {"stimulus_s": self.stimulus_s}

    def shown_s(self, study: StudyProtocol) -> float:
        """Return how long a trial shows stimuli, gaps included."""
        raise NotImplementedError

    def single_s(self, study: StudyProtocol) -> float:
        """Return how long one stimulus is shown."""
        return study.stimuli.clip_s or self.stimulus_s or 0.0

    def description(self, study: StudyProtocol) -> str:
        """Return a trial in a sentence, from fixation to answer, for a preregistration."""
        raise NotImplementedError

    def design_sentence(self, study: StudyProtocol) -> str:
        """Return what a participant meets how often, for a preregistration."""
        rule = self.adaptation
        if rule is not None:
            return rule.sentence(study)
        cells = len(self.cells(study, study.main_scenes()))
        return f"{cells} conditions, each {times(study.design.repeats)}"

    def right_answer(self) -> str:
        """Return which answer is right, in a sentence; empty where none is."""
        return ""

    def catch_sentence(self) -> str:
        """Return what the catch trials show."""
        raise NotImplementedError

    # The tables.

    def condition_columns(self, study: StudyProtocol) -> tuple[Column, ...]:
        """Return the columns of a table that say what was shown."""
        raise NotImplementedError

    def answer_columns(self) -> tuple[Column, ...]:
        """Return the columns of a table that say what was answered."""
        raise NotImplementedError

    def row(self, attempt: Attempt) -> dict[str, object]:
        """Return what an attempt says in the columns of condition and answer."""
        raise NotImplementedError

    def arranged_columns(self, study: StudyProtocol) -> frozenset[str]:
        """Return the columns of a table that tell how a condition was arranged.

        A task whose `row` gives columns of the condition other names says them itself.
        """
        found: set[str] = set()
        for cell in self.cells(study, study.main_scenes()):
            first, *others = cell.arrangements
            for other in others:
                found |= {k for k, v in other.condition.items() if first.condition.get(k) != v}
                if other.correct != first.correct:
                    found |= {column.name for column in self.answer_columns()}
        return frozenset(found - {"correct", "track"})

    # Mistakes.

    def problems(self, study: StudyProtocol) -> Iterator[Problem]:
        """Yield what does not fit the rest of the study."""
        if study.stimuli.clip_s is None and self.stimulus_s is None:
            yield Problem("task.stimulus_s", "missing: the stimuli are stills, say how long")
        if study.stimuli.clip_s is not None and self.stimulus_s is not None:
            yield Problem(
                "task.stimulus_s",
                f"must be left out: the stimuli are clips of {study.stimuli.clip_s:g} s",
            )

    def own_columns(self) -> Mapping[str, tuple[Scalar, ...]]:
        """Return the columns of a condition that are the task's and not the stimuli's, and their
        values: what analyses and adaptive rules may name beside the stimuli's."""
        return {}

    def labels(self) -> Mapping[str, str]:
        """Return what reports print for values of its own columns."""
        return {}

    def check_shown(
        self, study: StudyProtocol, place: str, names: Iterable[str]
    ) -> Iterator[Problem]:
        """Yield a problem for every name that is no column of a trial's condition."""
        own = self.own_columns()
        yield from self.check_columns(study, place, [name for name in names if name not in own])

    def check_columns(
        self, study: StudyProtocol, place: str, names: Iterable[str]
    ) -> Iterator[Problem]:
        """Yield a problem for every name that is no column of the stimuli's conditions."""
        known = study.stimuli.columns()
        for name in names:
            if name not in known:
                yield Problem(
                    place,
                    f"must name a column of the stimuli ({', '.join(known)}) (got {name!r})"
                    f"{did_you_mean(name, known)}",
                )

    def check_where(
        self, study: StudyProtocol, place: str, where: Mapping[str, Scalar]
    ) -> Iterator[Problem]:
        """Yield a problem for every column or value that no stimulus has."""
        yield from self.check_columns(study, place, where)
        for column, value in where.items():
            known = study.stimuli.values(column)
            if isinstance(value, int | float) and str(value) in map(str, known):
                continue  # a column of texts that should be one of numbers: told where it is used
            if known and value not in known:
                listed = ", ".join(map(str, known[:12])) + (", ..." if len(known) > 12 else "")
                yield Problem(
                    f"{place}.{column}",
                    f"must be a value that the stimuli have ({listed}) (got {value!r})"
                    + (did_you_mean(value, map(str, known)) if isinstance(value, str) else ""),
                )


def shown_phase(
    study: StudyProtocol,
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
    """
    clip_s = study.stimuli.clip_s
    shown: list[Clip | Image]
    if clip_s is None:
        shown = [Image(index, x_deg) for index, x_deg in places]
    else:
        each = whole_frames(display, 1 / study.stimuli.frame_hz)
        shown = [Clip(index, each, x_deg) for index, x_deg in places]
    frames = whole_frames(display, task.single_s(study))
    return Phase(name, frames, (*shown, Fixation()), watched=True)


def blank_phase(display: Display, name: str, duration_s: float) -> Phase:
    """Return a watched phase that shows the fixation target alone."""
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
            f"{duration_s:g} s must be whole frames at {display.refresh_hz:g} Hz;"
            " run 'metamerlab protocol check'"
        )
    return frames


def trial_phases(study: StudyProtocol, display: Display, *, practice: bool) -> tuple[Phase, ...]:
    """Return all phases of a trial: fixation, the task's own, answer, feedback."""
    timing, response, task = study.trial, study.response, study.task
    timeout_s = response.timeout_s
    phases = [
        Phase(
            "fixate",
            whole_frames(display, timing.fixation_s),
            (Fixation(),),
            gate_frames=whole_frames(display, timing.fixation_timeout_s),
        ),
        *task.phases(study, display),
        Phase(
            "respond",
            None,
            (Text("answer"),),
            ends_on=frozenset(task.answers()),
            timeout_frames=None if timeout_s is None else whole_frames(display, timeout_s),
        ),
    ]
    rounds = study.design.practice
    if practice and rounds is not None and rounds.feedback:
        feedback = whole_frames(display, timing.feedback_s)
        phases.append(Phase("feedback", feedback, (Text("feedback"),)))
    return tuple(phases)


def times(count: int) -> str:
    """Return how often: once, or so many times."""
    return "once" if count == 1 else f"{count} times"


def matches(condition: Condition, where: Mapping[str, Scalar]) -> bool:
    """Return whether a condition has all these values."""
    return all(condition.get(column) == value for column, value in where.items())


def all_pairs(values: Sequence[Scalar]) -> tuple[tuple[str, str], ...]:
    """Return every pair of values once, in order."""
    names = [str(value) for value in values]
    return tuple((a, b) for (i, a), (j, b) in product(enumerate(names), repeat=2) if i < j)
