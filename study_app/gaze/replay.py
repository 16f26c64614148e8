"""A gaze source that plays a recording back on the session's clock."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from study_app.gaze.recording import Recording
from study_app.gaze.source import GazeSample, SourceInfo

SAME_TIME_S = 1e-6
"""A sample whose time comes within this has come: sums of refreshes are no exact numbers."""


class ReplaySource:
    """Emits a recording's samples as their time comes, once.

    Parameters
    ----------
    recording : Recording
        From `load_recording`.
    clock : callable
        The session's monotonic clock, in seconds.
    """

    def __init__(self, recording: Recording, clock: Callable[[], float]) -> None:
        self._recording = recording
        self._clock = clock
        self._start_s = clock()
        self._next = 0
        self.marks: list[tuple[float, str]] = []

    def open(self) -> None:
        """Start the recording now."""
        self._start_s, self._next = self._clock(), 0

    def info(self) -> SourceInfo:
        """Name the file."""
        tape = self._recording
        return SourceInfo("replay", tape.path.name, tape.rate_hz, notes=tape.notes)

    def poll(self) -> Sequence[GazeSample]:
        """Return the samples whose time has come."""
        tape = self._recording
        since_s = self._clock() - self._start_s + SAME_TIME_S
        until = int(np.searchsorted(tape.t_s, since_s, side="right"))
        start, self._next = self._next, max(until, self._next)
        return [
            GazeSample(
                self._start_s + float(tape.t_s[i]),
                float(tape.raw_t[i]),
                float(tape.x_px[i]),
                float(tape.y_px[i]),
            )
            for i in range(start, self._next)
        ]

    def mark(self, text: str) -> None:
        """Keep the marker."""
        self.marks.append((self._clock(), text))

    def calibrate(self, points_px: Sequence[tuple[float, float]]) -> None:
        """A recording cannot be calibrated."""
        del points_px

    def close(self) -> None:
        """Nothing to close."""
