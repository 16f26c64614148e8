"""A picture, and again with another left or right half; which half? The task `which-half`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar, Literal

from protocols.columns import Column
from protocols.display import Display
from protocols.errors import Problem
from protocols.phases import Bar, Fixation, Image, Phase
from protocols.recipes.base import Pool
from protocols.tasks.base import Analysis, Arrangement, blank_phase, whole_frames
from protocols.tasks.compared import ComparisonAnalysis, ComparisonTask, StimulusPair
from protocols.units import Condition, Degrees


class WhichHalfAnalysis(ComparisonAnalysis):
    """d' by condition, and the level at which it leaves zero."""

    kind: Literal["which-half"]
    rule: Literal["dual-pair"] = "dual-pair"
    """The participant picks the half that changed more (`protocols.answer_rules`)."""


class WhichHalf(ComparisonTask):
    """Fixation, a picture, gap, the picture with one half replaced, answer."""

    kind: Literal["which-half"]
    bar_deg: Degrees = 2.0
    """Width of a grey bar between the halves that hides their border. 0: none."""

    analysis: ClassVar[type[Analysis]] = WhichHalfAnalysis
    stimuli_per_trial: ClassVar[int] = 4
    rule: ClassVar[str] = "dual-pair"
    decisions: ClassVar[str] = "answers which half had changed"
    every_answer: ClassVar[tuple[str, ...]] = ("left", "right")

    def arrangements(self, condition: Condition, pair: StimulusPair) -> Sequence[Arrangement]:
        """Return either stimulus whole at first, with the left and with the right half changed."""
        found = []
        for first, other in (pair, pair[::-1]):
            for half in self.answers():
                told = {**condition, "first": first[0], "changed_to": other[0]}
                second = [other[1] if half == side else first[1] for side in self.answers()]
                found.append(Arrangement(told, (first[1], first[1], *second), half))
        return found

    def phases(self, pool: Pool, display: Display) -> tuple[Phase, ...]:
        """Return interval 1, gap, interval 2: of each its two halves."""
        frames = whole_frames(display, self.single_s(pool))
        bar = (Bar(self.bar_deg),) if self.bar_deg else ()

        def interval(name: str, left: int) -> Phase:
            halves = Image(left, half="left"), Image(left + 1, half="right")
            return Phase(name, frames, (*halves, *bar, Fixation()), watched=True)

        return interval("first", 0), blank_phase(display, "gap", self.gap_s), interval("second", 2)

    def shown_s(self, pool: Pool) -> float:
        """Return the length of both intervals and the gap."""
        return 2 * self.single_s(pool) + self.gap_s

    def description(self, pool: Pool) -> str:
        """Return a trial in a sentence."""
        bar = f", a bar of {self.bar_deg:g} deg between its halves" if self.bar_deg else ""
        return (
            f"a picture ({self.single_s(pool):g} s){bar}, blank {self.gap_s:g} s, the picture"
            " again with its left or its right half changed, answer"
        )

    def right_answer(self) -> str:
        """Return a sentence on what changes, and on the right answer."""
        return f"{self.pair_sentence('What is shown first', 'what it changes to')}; right is where."

    def condition_columns(self, pool: Pool) -> tuple[Column, ...]:
        """Return the columns of the stimuli, and which was shown first and which came in."""
        return (
            *super().condition_columns(pool),
            Column("first", "text", "", "Stimulus shown whole in the first interval"),
            Column("changed_to", "text", "", "Stimulus of one half of the second interval"),
        )

    def problems(self, pool: Pool) -> Iterator[Problem]:
        """Yield all that does not fit the rest of the study."""
        yield from super().problems(pool)
        if pool.stimuli.clip_s is not None:
            yield Problem("task.kind", "must be another one: which-half shows stills, no clips")
