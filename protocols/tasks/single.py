"""Base of tasks that show one stimulus with a right answer."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar

from pydantic import Field

from protocols.adaptive.section import QuestPlusLevels, UpDownLevels
from protocols.columns import Column
from protocols.display import Display
from protocols.errors import Problem
from protocols.journal import Attempt
from protocols.phases import Phase
from protocols.recipes.base import Pool, Stimulus
from protocols.tasks.base import (
    Adaptive,
    Arrangement,
    CatchTrials,
    Cell,
    Task,
    matches,
    shown_phase,
)

Levels = Annotated[QuestPlusLevels | UpDownLevels, Field(discriminator="rule")]


ANSWER_COLUMNS = (
    Column("expected", "text", "", "The right answer", ("target", "truth", "correct_response")),
    Column("answer", "text", "", "The answer given", ("response", "resp", "key", "keys", "said")),
    Column("correct", "0/1", "", "1: the answer was right", ("corr", "acc", "accuracy", "hit")),
    Column("track", "text", "", "Adaptive track; empty: levels were constant"),
)


class RightOrWrong(Task):
    """A task with a right answer for every trial."""

    adaptive: Levels | None = None
    """Adaptive levels. Default: constant stimuli, every level equally often."""
    catch: CatchTrials | None = None
    """Catch trials. Default: none."""

    decides: ClassVar[bool] = True
    rule: ClassVar[str] = "alternatives"
    """Answer rule that ties right answers to d': a name in `protocols.answer_rules`, or another as
    ``module:NAME``. A key `rule` of the analysis goes before."""

    @property
    def adaptation(self) -> Adaptive | None:
        """The rule that chooses levels from the answers."""
        return self.adaptive

    def catch_cells(self, pool: Pool) -> list[Cell]:
        """Return the conditions in which the answer is plain."""
        if self.catch is None:
            return []
        where = self.catch.where
        cells = self.cells(pool)
        return [cell for cell in cells if matches(cell.arrangements[0].condition, where)]

    @property
    def catch_trials(self) -> int:
        """Number of catch trials."""
        return 0 if self.catch is None else self.catch.trials

    def catch_sentence(self) -> str:
        """Return a sentence on the catch trials."""
        assert self.catch is not None
        return ", ".join(f"{column} {value}" for column, value in self.catch.where.items())

    def answer_columns(self) -> tuple[Column, ...]:
        """Return the columns of the answer, and of whether it was right."""
        return ANSWER_COLUMNS

    def row(self, attempt: Attempt) -> dict[str, object]:
        """Return an attempt in these columns."""
        return {
            **attempt.condition,
            "expected": attempt.expected,
            "answer": attempt.answer,
            "correct": None if attempt.correct is None else int(attempt.correct),
            "track": attempt.track,
        }

    def problems(self, pool: Pool) -> Iterator[Problem]:
        """Yield all that does not fit the rest of the study."""
        yield from super().problems(pool)
        if self.catch is not None:
            wrong = list(pool.check_where("task.catch.where", self.catch.where))
            yield from wrong
            if not wrong and not self.catch_cells(pool):
                said = ", ".join(f"{name} = {value}" for name, value in self.catch.where.items())
                yield Problem(
                    "task.catch.where",
                    f"must fit at least one trial of the task (none has {said}); leave out what"
                    " differs within a trial",
                )
        if self.adaptive is not None:
            yield from self.adaptive.problems(self, pool)


class SingleStimulus(RightOrWrong):
    """Fixation, one stimulus, answer."""

    def expected(self, stimulus: Stimulus) -> str | None:
        """Return the right answer to a stimulus; None where it belongs to no answer."""
        raise NotImplementedError

    def cells(self, pool: Pool) -> list[Cell]:
        """Return every stimulus in these scenes that has a right answer."""
        rank = {scene: place for place, scene in enumerate(pool.scenes)}
        shown = [s for s in pool.stimuli.pool() if s.scene in rank and self.expected(s)]
        return [
            Cell(s.scene, (Arrangement(s.condition, (s.name,), self.expected(s)),))
            for s in sorted(shown, key=lambda s: rank[s.scene])
        ]

    def phases(self, pool: Pool, display: Display) -> tuple[Phase, ...]:
        """Return the one phase that shows the stimulus."""
        return (shown_phase(pool, display, self, "stimulus", [(0, 0.0)]),)

    def shown_s(self, pool: Pool) -> float:
        """Return the time for which the stimulus is shown."""
        return self.single_s(pool)

    def description(self, pool: Pool) -> str:
        """Return a trial in a sentence."""
        return f"one stimulus ({self.single_s(pool):g} s), answer"
