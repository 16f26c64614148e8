"""Keeps what no rule can judge away from all rules: samples of other times, places off the world.

Whatever a tracker sends, the samples that go on have finite stamps that do not fall within an
attempt and do not lie ahead of the session's clock. What is left out is missing, and missing
samples are silence: an attempt that they belong to is void, and a source that sends no others ends
the run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from study_app.gaze.source import (
    CalibrationResult,
    GazeSample,
    GazeSource,
    RawFile,
    SourceInfo,
    Tracker,
)

AHEAD_S = 0.05
"""Longest time by which stamps may lie ahead: two clocks agree within some milliseconds."""
FARTHEST_PX = 1e6
"""Gaze beyond that, or nowhere, is a lost eye."""


class TrustedGaze:
    """Another source, with samples that can be judged.

    Parameters
    ----------
    source : GazeSource
        Any.
    clock : callable
        The session's clock.
    """

    def __init__(self, source: GazeSource, clock: Callable[[], float]) -> None:
        self.source, self._clock = source, clock
        self._last_s = -math.inf
        self.left_out = 0
        """Samples since the last `news` whose stamps were none, fell, or lay ahead."""

    def open(self) -> None:
        """Connect."""
        self.source.open()

    def info(self) -> SourceInfo:
        """Describe the source."""
        return self.source.info()

    def poll(self) -> Sequence[GazeSample]:
        """Return the samples since the last call that can be judged. Never waits."""
        kept = []
        latest_s = self._clock() + AHEAD_S
        for sample in self.source.poll():
            t_s, raw_t, x_px, y_px = sample
            # Written so that what is no number fails.
            in_time = -math.inf < t_s and self._last_s <= t_s <= latest_s
            if not (in_time and math.isfinite(raw_t)):
                self.left_out += 1
                continue
            self._last_s = t_s
            if not (abs(x_px) <= FARTHEST_PX and abs(y_px) <= FARTHEST_PX):
                sample = GazeSample(t_s, raw_t, math.nan, math.nan)
            kept.append(sample)
        return kept

    def mark(self, text: str) -> None:
        """Pass a marker on: an attempt begins.

        A source may measure its clock anew now, so stamps may be a little earlier once.
        """
        self._last_s = -math.inf
        self.source.mark(text)

    def calibrate(self, points_px: Sequence[tuple[float, float]]) -> CalibrationResult | None:
        """Run the tracker's own calibration; None where it has none."""
        return self.source.calibrate(points_px)

    def check_drift(self, point_px: tuple[float, float]) -> float | None:
        """Run the tracker's own drift check; None where it has none."""
        return self.source.check_drift(point_px) if isinstance(self.source, Tracker) else None

    def raw(self, *, over: bool) -> RawFile | None:
        """Return the file of what was recorded or sent since the last call; None: nothing."""
        return self.source.raw(over=over) if isinstance(self.source, Tracker) else None

    def news(self) -> Sequence[str]:
        """Return news since the last call: of the connection, and of samples."""
        told = list(self.source.news()) if isinstance(self.source, Tracker) else []
        if self.left_out:
            told.append(f"{self.left_out} samples were left out, their stamps fell or lay ahead")
        self.left_out = 0
        return [f"gaze: {text}" for text in told]

    def close(self) -> None:
        """Disconnect; safe to call twice."""
        self.source.close()
