"""Three stimuli A, B, X; was X the first or the second? The task `abx`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from protocols.columns import Column
from protocols.display import Display
from protocols.phases import Phase
from protocols.recipes.base import Pool
from protocols.tasks.base import Analysis, Arrangement, in_turn
from protocols.tasks.compared import ComparisonAnalysis, ComparisonTask, StimulusPair
from protocols.units import Condition


class AbxAnalysis(ComparisonAnalysis):
    """d' by condition, and the level at which it leaves zero."""

    kind: Literal["abx"]
    rule: Literal["differencing", "independent"] = "differencing"
    """Decision rule that turns shares of right answers into d'."""


class Abx(ComparisonTask):
    """Fixation, A, gap, B, gap, X, answer."""

    kind: Literal["abx"]

    analysis: ClassVar[type[Analysis]] = AbxAnalysis
    stimuli_per_trial: ClassVar[int] = 3
    rule: ClassVar[str] = "differencing"
    decisions: ClassVar[str] = "ABX answers"
    every_answer: ClassVar[tuple[str, ...]] = ("a", "b")

    def arrangements(self, condition: Condition, pair: StimulusPair) -> Sequence[Arrangement]:
        """Return both orders of A and B, each with X as the one and as the other."""
        one, other = pair
        return [
            Arrangement(
                {**condition, "a": a[0], "b": b[0], "x": x[0]},
                (a[1], b[1], x[1]),
                "a" if x == a else "b",
            )
            for a, b, x in (
                (one, other, one),
                (one, other, other),
                (other, one, other),
                (other, one, one),
            )
        ]

    def phases(self, pool: Pool, display: Display) -> tuple[Phase, ...]:
        """Return A, gap, B, gap, X."""
        return in_turn(pool, display, self, "abx", self.gap_s)

    def shown_s(self, pool: Pool) -> float:
        """Return the length of the three stimuli and their gaps."""
        return 3 * self.single_s(pool) + 2 * self.gap_s

    def description(self, pool: Pool) -> str:
        """Return a trial in a sentence."""
        return (
            f"A, B and X ({self.single_s(pool):g} s each), blanks of {self.gap_s:g} s between,"
            " answer"
        )

    def right_answer(self) -> str:
        """Return a sentence on the three stimuli and the right answer."""
        return f"{self.pair_sentence('A', 'B')}; X is one of the two again, and right is which."

    def condition_columns(self, pool: Pool) -> tuple[Column, ...]:
        """Return the columns of the stimuli, and which came as A, B and X."""
        return (
            *super().condition_columns(pool),
            *(Column(name, "text", "", f"Stimulus shown as {name.upper()}") for name in "abx"),
        )
