"""One stimulus; which of m is it? The task `identification`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from protocols.errors import Problem
from protocols.recipes.base import Pool, Stimulus
from protocols.tasks.base import Analysis
from protocols.tasks.rates import RatesAnalysis
from protocols.tasks.single import SingleStimulus
from protocols.units import Name


class IdentificationAnalysis(RatesAnalysis):
    """Shares of right answers by condition, compared with guessing."""

    kind: Literal["identification"]


class Identification(SingleStimulus):
    """Fixation, one stimulus, one of several labelled answers."""

    kind: Literal["identification"]
    alternatives: Annotated[tuple[Name, ...], Field(min_length=2)]
    """The answers, from left to right."""
    named_by: Name
    """The column whose value is the right answer."""

    analysis: ClassVar[type[Analysis]] = IdentificationAnalysis
    decisions: ClassVar[str] = "identifications"

    def answers(self) -> tuple[str, ...]:
        """Return the alternatives."""
        return self.alternatives

    def expected(self, stimulus: Stimulus) -> str | None:
        """Return the alternative that the stimulus names."""
        value = stimulus.condition.get(self.named_by)
        return None if value is None else str(value)

    def right_answer(self) -> str:
        """Return the words for the right answer."""
        return f"The right answer is the {self.named_by} of the stimulus."

    def problems(self, pool: Pool) -> Iterator[Problem]:
        """Yield all that does not fit the rest of the study."""
        yield from super().problems(pool)
        yield from pool.check_columns("task.named_by", (self.named_by,))
        if len(set(self.alternatives)) < len(self.alternatives):
            yield Problem(
                "task.alternatives",
                f"every answer must be given once (got {', '.join(self.alternatives)})",
            )
        for value in pool.stimuli.values(self.named_by):
            if str(value) not in self.alternatives:
                yield Problem(
                    "task.alternatives",
                    f"must hold every value of {self.named_by!r} (got"
                    f" {', '.join(self.alternatives)}, and a stimulus with {value!r})",
                )
