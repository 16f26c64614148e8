"""Two stimuli one after the other; which is preferred? The task `two-interval`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from protocols.display import Display
from protocols.phases import Phase
from protocols.pool import Pool
from protocols.tasks.base import blank_phase, shown_phase
from protocols.tasks.pairs import PairTask
from protocols.units import Seconds


class TwoInterval(PairTask):
    """Fixation, interval 1, gap, interval 2, answer."""

    kind: Literal["two-interval"]
    gap_s: Seconds = 0.5
    """Blank between the intervals."""

    def answers(self) -> tuple[str, ...]:
        """Return the two intervals."""
        return "first", "second"

    def phases(self, pool: Pool, display: Display) -> tuple[Phase, ...]:
        """Return interval 1, gap, interval 2."""
        return (
            shown_phase(pool, display, self, "first", [(0, 0.0)]),
            blank_phase(display, "gap", self.gap_s),
            shown_phase(pool, display, self, "second", [(1, 0.0)]),
        )

    def durations(self) -> Mapping[str, float]:
        """Return the task's times by key."""
        return {**super().durations(), "gap_s": self.gap_s}

    def shown_s(self, pool: Pool) -> float:
        """Return the length of both intervals and the gap."""
        return 2 * self.single_s(pool) + self.gap_s

    def description(self, pool: Pool) -> str:
        """Return a trial in a sentence."""
        what = "still" if pool.stimuli.clip_s is None else "clip"
        return (
            f"first {what} ({self.single_s(pool):g} s), blank {self.gap_s:g} s, second {what},"
            " answer"
        )
