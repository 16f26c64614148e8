"""The mouse in place of an eye: for rehearsals, and for trying a protocol without a tracker."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from study_app.gaze.source import CalibrationResult, GazeSample, SourceInfo


class MouseGaze:
    """One sample per poll, that is per refresh.

    Parameters
    ----------
    cursor_px : callable
        Returns the cursor, from the upper left corner of the screen.
    clock : callable
        The session's clock.
    rate_hz : float
        How often it is polled.
    """

    def __init__(
        self,
        cursor_px: Callable[[], tuple[float, float]],
        clock: Callable[[], float],
        rate_hz: float,
    ) -> None:
        self._cursor_px, self._clock, self._rate_hz = cursor_px, clock, rate_hz

    def open(self) -> None:
        """Nothing to connect to."""

    def info(self) -> SourceInfo:
        """Say that it is no eye."""
        return SourceInfo("mouse", "cursor in place of an eye", self._rate_hz, polled=True)

    def poll(self) -> Sequence[GazeSample]:
        """Return the place of the cursor now."""
        now_s = self._clock()
        return [GazeSample(now_s, now_s, *self._cursor_px())]

    def mark(self, text: str) -> None:
        """Markers have nowhere to go."""

    def calibrate(self, points_px: Sequence[tuple[float, float]]) -> CalibrationResult | None:
        """A mouse needs none."""

    def close(self) -> None:
        """Nothing to close."""
