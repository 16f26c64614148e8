"""Three stimuli of which two are the same; which is the odd one? The task `odd-one-out`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from protocols.columns import Column
from protocols.display import Display
from protocols.phases import Phase
from protocols.recipes.base import Pool
from protocols.tasks.base import Analysis, Arrangement, in_turn
from protocols.tasks.compared import ComparisonTask, StimulusPair
from protocols.tasks.rates import RatesAnalysis
from protocols.units import Condition


class OddityAnalysis(RatesAnalysis):
    """Shares of right answers against one third, d' of the triangle, by condition and level."""

    kind: Literal["odd-one-out"]


class OddOneOut(ComparisonTask):
    """Fixation, three stimuli with gaps between, answer."""

    kind: Literal["odd-one-out"]

    analysis: ClassVar[type[Analysis]] = OddityAnalysis
    stimuli_per_trial: ClassVar[int] = 3
    rule: ClassVar[str] = "protocols.triangle:Triangle"
    every_answer: ClassVar[tuple[str, ...]] = ("first", "second", "third")
    decisions: ClassVar[str] = "odd ones"

    def arrangements(self, condition: Condition, pair: StimulusPair) -> Sequence[Arrangement]:
        """Return the odd one at each place, either stimulus as the odd one."""
        return [
            Arrangement(
                {**condition, "odd": odd[0], "twice": twice[0]},
                tuple(odd[1] if place == answer else twice[1] for place in self.every_answer),
                answer,
            )
            for odd, twice in (pair, pair[::-1])
            for answer in self.every_answer
        ]

    def phases(self, pool: Pool, display: Display) -> tuple[Phase, ...]:
        """Return the three stimuli with gaps between."""
        return in_turn(pool, display, self, self.every_answer, self.gap_s)

    def shown_s(self, pool: Pool) -> float:
        """Return the length of the three stimuli and their gaps."""
        return 3 * self.single_s(pool) + 2 * self.gap_s

    def description(self, pool: Pool) -> str:
        """Return a trial in a sentence."""
        return (
            f"three stimuli ({self.single_s(pool):g} s each), blanks of {self.gap_s:g} s between,"
            " answer"
        )

    def right_answer(self) -> str:
        """Return a sentence on the three stimuli and the right answer."""
        told = self.pair_sentence("the odd one", "what is shown twice")
        return f"{told}; right is the place of the odd one."

    def condition_columns(self, pool: Pool) -> tuple[Column, ...]:
        """Return the columns of the stimuli, and which was the odd one and which came twice."""
        return (
            *super().condition_columns(pool),
            Column("odd", "text", "", "Stimulus shown once"),
            Column("twice", "text", "", "Stimulus shown twice"),
        )
