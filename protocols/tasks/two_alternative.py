"""Two stimuli side by side; which is preferred? The task `two-alternative`."""

from __future__ import annotations

from typing import ClassVar, Literal

from protocols.display import Display
from protocols.phases import Phase
from protocols.pool import Pool
from protocols.tasks.base import shown_phase
from protocols.tasks.pairs import PairTask
from protocols.units import Degrees


class TwoAlternative(PairTask):
    """Fixation, both stimuli side by side, answer."""

    kind: Literal["two-alternative"]
    separation_deg: Degrees
    """Between the centres of the two."""

    sided: ClassVar[bool] = True

    def answers(self) -> tuple[str, ...]:
        """Return the two sides."""
        return "left", "right"

    def phases(self, pool: Pool, display: Display) -> tuple[Phase, ...]:
        """Return the one phase that shows both."""
        half_deg = self.separation_deg / 2
        return (shown_phase(pool, display, self, "both", [(0, -half_deg), (1, half_deg)]),)

    def shown_s(self, pool: Pool) -> float:
        """Return the time for which both are shown."""
        return self.single_s(pool)

    def description(self, pool: Pool) -> str:
        """Return a trial in a sentence."""
        what = "stills" if pool.stimuli.clip_s is None else "clips"
        return (
            f"two {what} side by side, {self.separation_deg:g} deg apart, for"
            f" {self.single_s(pool):g} s, answer"
        )
