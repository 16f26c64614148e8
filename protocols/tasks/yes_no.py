"""One stimulus; is the signal there? The task `yes-no`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from protocols.errors import Problem
from protocols.recipes.base import Pool, Stimulus
from protocols.tasks.base import Analysis
from protocols.tasks.rates import RatesAnalysis
from protocols.tasks.single import SingleStimulus
from protocols.units import Name, Scalar


class DetectionAnalysis(RatesAnalysis):
    """Shares of "yes", d' and criterion by condition."""

    kind: Literal["detection"]


class YesNo(SingleStimulus):
    """Fixation, one stimulus, yes or no."""

    kind: Literal["yes-no"]
    signal: Annotated[dict[Name, tuple[Scalar, ...]], Field(min_length=1)]
    """Stimuli that hold the signal, by columns and their values, such as `{ cut = ["inconsistent"]
    }`. For all others "no" is right."""

    analysis: ClassVar[type[Analysis]] = DetectionAnalysis
    every_answer: ClassVar[tuple[str, ...]] = ("yes", "no")

    def expected(self, stimulus: Stimulus) -> str:
        """Return `yes` where the stimulus holds the signal."""
        held = all(stimulus.condition.get(key) in values for key, values in self.signal.items())
        return "yes" if held else "no"

    def right_answer(self) -> str:
        """Return a sentence on where yes is right."""
        where = " and ".join(
            f"{column} is {' or '.join(map(str, values))}" for column, values in self.signal.items()
        )
        return f"Yes is right where {where}, else no."

    def problems(self, pool: Pool) -> Iterator[Problem]:
        """Yield all that does not fit the rest of the study."""
        yield from super().problems(pool)
        for column, values in self.signal.items():
            for index, value in enumerate(values):
                for problem in pool.check_where("task.signal", {column: value}):
                    place = f"{problem.place}[{index}]" if problem.place.count(".") > 1 else None
                    yield Problem(place or problem.place, problem.message)
        answers = {self.expected(stimulus) for stimulus in pool.stimuli.pool()}
        if len(answers) == 1:
            yield Problem(
                "task.signal",
                "must hold for some stimuli and not for others (every right answer is"
                f" {answers.pop()!r})",
            )
