"""Saccades as they happen, for what may change only while the eye sees little.

Engbert and Kliegl 2003, "Microsaccades uncover the orientation of covert attention": the velocity
over five samples, against a multiple of its own deviation by medians, along both axes as an
ellipse. Theirs looks at a whole trial; here only what has come counts, so the deviation is that of
the last seconds, and a saccade is known two samples after it has lasted long enough.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from protocols.errors import StudyError
from study_app.gaze.source import GazeSample

MULTIPLE = 6.0
"""Multiple of the deviation: the paper's lambda."""
LEAST_DEG_S = 30.0
"""No slower movement is a saccade, however quiet the tracker is."""
SHORTEST_S = 0.006
"""The paper's three samples at 500 Hz."""
LOOKS_BACK_S = 2.0
ENOUGH = 60
"""Velocities that a deviation needs."""
LONGEST_GAP_S = 0.05
"""Between two samples whose places still make a velocity."""
SUPPRESSED_AFTER_S = 0.05
"""So long behind a saccade little is seen still (Ross et al. 2001)."""
LEAST_HZ = 1 / LONGEST_GAP_S
"""No saccade is found in slower gaze."""
_RENEWED_S = 0.1  # between two looks at the deviation


@dataclass(frozen=True)
class Saccade:
    """One saccade, on the clock of the samples.

    Attributes
    ----------
    onset_s, offset_s : float
        Its first and last fast sample; while it is under way the last one so far.
    over : bool
        Whether it has ended.
    """

    onset_s: float
    offset_s: float
    over: bool

    def suppresses(self, t_s: float) -> bool:
        """True if a flip at this time falls where the eye sees little."""
        return self.onset_s <= t_s <= self.offset_s + SUPPRESSED_AFTER_S


class SaccadeWatch:
    """Finds saccades in samples as they come.

    A lost eye ends a saccade, and nothing is found until places come again.

    Parameters
    ----------
    px_per_deg : float
        Of the screen, in its middle.

    Attributes
    ----------
    last : Saccade or None
        The newest one.
    """

    def __init__(self, px_per_deg: float) -> None:
        self._least_px_s = LEAST_DEG_S * px_per_deg
        self._five: deque[GazeSample] = deque(maxlen=5)
        self._velocities: deque[tuple[float, float, float]] = deque()
        self._threshold: tuple[float, float] | None = None
        self._renewed_s = -math.inf
        self._began_s, self._last_s = math.nan, -math.inf
        self.last: Saccade | None = None

    @property
    def under_way(self) -> bool:
        """True if the newest saccade has not ended."""
        return self.last is not None and not self.last.over

    def take(self, samples: Iterable[GazeSample]) -> list[Saccade]:
        """Return the saccades that ended, oldest first.

        Parameters
        ----------
        samples : iterable of GazeSample
            In pixels. What is not newer than all before is passed over: several may hand on the
            same samples.
        """
        ended = []
        for sample in samples:
            if sample.t_s <= self._last_s:
                continue
            self._last_s = sample.t_s
            gone = not sample.valid or (
                bool(self._five) and sample.t_s - self._five[-1].t_s > LONGEST_GAP_S
            )
            if gone:
                self._five.clear()
                ended += self._end()
            if not sample.valid:
                continue
            self._five.append(sample)
            if len(self._five) == self._five.maxlen:
                ended += self._judge()
        return ended

    def _judge(self) -> list[Saccade]:
        """Judge the middle one of five samples."""
        a, b, middle, d, e = self._five
        span_s = e.t_s + d.t_s - b.t_s - a.t_s
        x_px_s = (e.x_px + d.x_px - b.x_px - a.x_px) / span_s
        y_px_s = (e.y_px + d.y_px - b.y_px - a.y_px) / span_s
        threshold = self._threshold_at(middle.t_s)
        self._velocities.append((middle.t_s, x_px_s, y_px_s))
        if threshold is None or (x_px_s / threshold[0]) ** 2 + (y_px_s / threshold[1]) ** 2 <= 1:
            return self._end()
        if math.isnan(self._began_s):
            self._began_s = middle.t_s
        step_s = (e.t_s - a.t_s) / 4
        if middle.t_s - self._began_s + step_s >= SHORTEST_S:
            self.last = Saccade(self._began_s, middle.t_s, over=False)
        return []

    def _end(self) -> list[Saccade]:
        self._began_s = math.nan
        if self.last is None or self.last.over:
            return []
        self.last = Saccade(self.last.onset_s, self.last.offset_s, over=True)
        return [self.last]

    def _threshold_at(self, t_s: float) -> tuple[float, float] | None:
        """Velocities along x and y that a saccade exceeds, pixels a second; None: not known yet."""
        if t_s - self._renewed_s >= _RENEWED_S:
            self._renewed_s = t_s
            while self._velocities and self._velocities[0][0] < t_s - LOOKS_BACK_S:
                self._velocities.popleft()
            if len(self._velocities) >= ENOUGH:
                found = np.array(self._velocities)[:, 1:]
                variance = np.median(found**2, axis=0) - np.median(found, axis=0) ** 2
                x_px_s, y_px_s = MULTIPLE * np.sqrt(np.maximum(variance, 0))
                self._threshold = max(x_px_s, self._least_px_s), max(y_px_s, self._least_px_s)
        return self._threshold


def check_saccade_rate(what: str, rate_hz: float) -> None:
    """Refuse gaze in which no saccade is found.

    Raises
    ------
    StudyError
        If it is slower than `LEAST_HZ`; `what` names what needs it.
    """
    if rate_hz < LEAST_HZ:
        raise StudyError(
            f"{what} needs gaze of at least {LEAST_HZ:g} Hz (got {rate_hz:g} Hz); take a faster"
            " source, or leave it out"
        )
