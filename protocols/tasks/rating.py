"""One stimulus, alone or after its reference; how good is it? The task `rating`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from protocols.columns import Column
from protocols.display import Display
from protocols.errors import Problem, did_you_mean
from protocols.journal import Attempt
from protocols.phases import Phase
from protocols.recipes.base import Pool
from protocols.tasks.base import Analysis, Arrangement, Cell, Task, in_turn
from protocols.tasks.compared import Standards
from protocols.tasks.mixed import MixedAnalysis
from protocols.tasks.rates import name_of
from protocols.units import Name, Scalar, Seconds

RATING_COLUMNS = (Column("rating", "value", "", "The rating given", ("score", "response")),)


class RatingsAnalysis(MixedAnalysis):
    """A cumulative-link mixed model: places of conditions on a latent axis, and differences."""

    kind: Literal["ratings"]
    by: Name = "method"
    """The column whose values are compared."""
    baseline: Scalar | None = None
    """Value that the others are compared with. Default: all pairs are compared."""
    link: Literal["probit", "logit"] = "probit"
    """Link of the model."""
    correction: Literal["holm", "none"] = "holm"
    """Over all comparisons."""

    def problems(self, task: Task, pool: Pool, /) -> Iterator[Problem]:
        """Yield columns and values that the stimuli do not have."""
        wrong = list(task.check_shown(pool, "analysis.by", (self.by,)))
        yield from wrong
        known = self.known(task, pool)
        if not wrong and len(known) < 2:
            yield Problem(
                "analysis.by",
                f"must name a column with two values or more that are rated (got {self.by!r} with"
                f" {', '.join(known) or 'none'})",
            )
        elif not wrong:
            yield from self.contrast_problems(known)
        if not wrong and self.baseline is not None and name_of(self.baseline) not in known:
            yield Problem(
                "analysis.baseline",
                f"must be a value of {self.by!r} that is rated ({', '.join(known)}) (got"
                f" {self.baseline!r}){did_you_mean(name_of(self.baseline), known)}",
            )

    def known(self, task: Task, pool: Pool) -> list[str]:
        """Return the values of `by` that are rated, in the order of the cells."""
        shown = [cell.arrangements[0].condition for cell in task.cells(pool)]
        return list(dict.fromkeys(name_of(condition.get(self.by, "")) for condition in shown))

    def plain_sentences(self, _task: Task, _pool: Pool) -> list[str]:
        """Return the analysis in sentences."""
        against = "each pair" if self.baseline is None else f"each against {self.baseline}"
        return [
            f"Ratings are compared between values of {self.by}, {against}, by a cumulative"
            f" {self.link} mixed model, random over participants and scenes, by likelihood ratio,"
            f" two-sided, alpha {self.alpha:g}; correction {self.correction}.",
            *self.mixed_sentences(),
        ]


class Rating(Standards):
    """Fixation, one stimulus, a step of a scale: absolute category rating (ITU-T P.910).

    With a standard, it comes after that and a gap: degradation category rating.
    """

    kind: Literal["rating"]
    scale: Annotated[tuple[Name, ...], Field(min_length=3, max_length=11)]
    """The steps from the lowest, as keys and labels go from left to right."""
    gap_s: Seconds = 0.5
    """Blank between a standard and its stimulus."""

    analysis: ClassVar[type[Analysis]] = RatingsAnalysis
    sided: ClassVar[bool] = True
    stimuli_per_trial: ClassVar[int] = 2

    def answers(self) -> tuple[str, ...]:
        """Return the steps."""
        return self.scale

    def cells(self, pool: Pool) -> list[Cell]:
        """Return every stimulus in these scenes; one with a standard, after it."""
        rank = {scene: place for place, scene in enumerate(pool.scenes)}
        standards = self.standards(pool)
        found = []
        for stimulus in pool.stimuli.pool():
            before = standards.get(self.key(stimulus), [])
            if stimulus.scene not in rank or self.is_standard(stimulus):
                continue
            if self.standard is None or before:
                shown = Arrangement(stimulus.condition, (*before[:1], stimulus.name))
                found.append(Cell(stimulus.scene, (shown,)))
        return sorted(found, key=lambda cell: rank[cell.scene])

    def phases(self, pool: Pool, display: Display) -> tuple[Phase, ...]:
        """Return the stimulus, after standard and gap where there is one."""
        names = ("stimulus",) if self.standard is None else ("standard", "stimulus")
        return in_turn(pool, display, self, names, self.gap_s)

    def durations(self) -> Mapping[str, float]:
        """Return the task's times by key."""
        own = {} if self.standard is None else {"gap_s": self.gap_s}
        return {**super().durations(), **own}

    def shown_s(self, pool: Pool) -> float:
        """Return the length of what is shown, the gap included."""
        one_s = self.single_s(pool)
        return one_s if self.standard is None else 2 * one_s + self.gap_s

    def description(self, pool: Pool) -> str:
        """Return a trial in a sentence."""
        shown = f"one stimulus ({self.single_s(pool):g} s), a rating in {len(self.scale)} steps"
        if self.standard is None:
            return shown
        where = ", ".join(f"{column} {value}" for column, value in self.standard.items())
        return f"its standard ({where}), blank {self.gap_s:g} s, {shown}"

    def answer_columns(self) -> tuple[Column, ...]:
        """Return the rating, and its step."""
        return (*RATING_COLUMNS, Column("step", "integer", "", "Its place on the scale, from 1"))

    def row(self, attempt: Attempt) -> dict[str, object]:
        """Return an attempt in these columns."""
        step = None if attempt.answer is None else self.scale.index(attempt.answer) + 1
        return {**attempt.condition, "rating": attempt.answer, "step": step}

    def problems(self, pool: Pool) -> Iterator[Problem]:
        """Yield all that does not fit the rest of the study."""
        yield from super().problems(pool)
        yield from self.standard_problems(pool)
        for key in ("matched", "gap_s"):
            if self.standard is None and key in self.model_fields_set:
                yield Problem(
                    f"task.{key}",
                    "must be left out where no standard is shown; leave it out, or give"
                    " task.standard",
                )
        if len(set(self.scale)) < len(self.scale):
            given = ", ".join(self.scale)
            yield Problem("task.scale", f"every step must be given once (got {given})")
