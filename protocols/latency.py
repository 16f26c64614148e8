"""Age of gaze when a frame drawn to it is flipped: what is recorded, and a summary."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import AfterValidator

from protocols.units import Count, ExtendedModel, Model, storable

EyeState: TypeAlias = Literal["found", "lost", "silent", "ahead", "none"]
"""State of the eye by the newest sample: it saw the eye; it did not; there was none for 100 ms; its
stamp lies ahead of the clock; there never was one. Only a gaze that was `found` has a latency."""


class SaccadeTimes(Model):
    """One saccade: its first and last fast sample."""

    onset_s: Annotated[float, AfterValidator(storable)]
    """Session clock."""
    offset_s: Annotated[float, AfterValidator(storable)]
    """Session clock. The eye sees little from the onset to 50 ms behind this."""


class LiveFrames(ExtendedModel):
    """The frames of an attempt that were drawn to the gaze."""

    ages_ms: tuple[Annotated[float, AfterValidator(storable)], ...]
    """Sample to flip, of the frames whose newest sample saw the eye, in their order. Frames that
    held a gaze until a saccade count in no number."""
    lost: Count
    """Frames that held the last gaze: the eye was lost, or never found."""
    silent: Count
    """Frames that held it because the tracker sent nothing."""
    ahead: Count
    """Frames whose sample was stamped later than it came."""
    saccades: tuple[SaccadeTimes, ...] = ()
    """Saccades under way or just over in the attempt, as far as gaze had come."""

    added_later: ClassVar[tuple[str, ...]] = ("saccades",)

    @classmethod
    def of(
        cls, frames: Iterable[tuple[EyeState, float]], saccades: tuple[SaccadeTimes, ...] = ()
    ) -> LiveFrames:
        """Sum up (state of the eye, age in seconds) of frames."""
        shown = list(frames)
        eyes = [eye for eye, _ in shown]
        return cls(
            ages_ms=tuple(round(1e3 * age_s, 3) for eye, age_s in shown if eye == "found"),
            lost=eyes.count("lost") + eyes.count("none"),
            silent=eyes.count("silent"),
            ahead=eyes.count("ahead"),
            saccades=saccades,
        )


class LatencySummary(Model):
    """Sample to flip, of the frames that showed a gaze that was found."""

    frames: Count
    median_ms: float | None
    p95_ms: float | None
    max_ms: float | None
    lost: Count
    """Frames that held the last gaze: the eye was lost, or never found."""
    silent: Count
    """Frames that held it because the tracker sent nothing."""
    ahead: Count
    """Frames whose sample was stamped later than it came."""

    @classmethod
    def of(cls, attempts: Sequence[LiveFrames]) -> LatencySummary:
        """Sum up the frames of several attempts."""
        ages_ms = sorted(age for one in attempts for age in one.ages_ms)
        count = len(ages_ms)

        def quantile_ms(share: float) -> float | None:
            return ages_ms[max(1, math.ceil(share * count)) - 1] if ages_ms else None

        return cls(
            frames=count,
            median_ms=quantile_ms(0.5),
            p95_ms=quantile_ms(0.95),
            max_ms=quantile_ms(1.0),
            lost=sum(one.lost for one in attempts),
            silent=sum(one.silent for one in attempts),
            ahead=sum(one.ahead for one in attempts),
        )

    def words(self) -> str:
        """A line for people."""
        held = f"held in {self.lost + self.silent}, of them {self.silent} while the source was mute"
        held += f"; stamped ahead of the clock in {self.ahead}" if self.ahead else ""
        if self.median_ms is None:
            return f"sample to flip: no frame showed a gaze that was found ({held})"
        return (
            f"sample to flip: median {self.median_ms:.1f} ms, 95 % {self.p95_ms:.1f} ms, maximum"
            f" {self.max_ms:.1f} ms, of {self.frames} frames ({held})"
        )
