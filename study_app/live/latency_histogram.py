"""Age of gaze when its frame is flipped: median, 95 % and maximum over any number of frames."""

from __future__ import annotations

import math
from array import array

from protocols.latency import EyeState, LatencySummary

SILENT_S = 0.1
"""A tracker that sends nothing for so long has lost the eye, as in sessions."""
AHEAD_S = 0.001
"""Longest time by which a sample may be stamped after its arrival: two clocks agree no better."""
_BIN_S, _BINS = 1e-4, 20_000


class Latency:
    """Counts ages in bins of 0.1 ms, so that nothing grows with the number of frames."""

    def __init__(self) -> None:
        self._bins = array("Q", bytes(8 * _BINS))
        self._most_s = -math.inf
        self._counts: dict[EyeState, int] = dict.fromkeys(
            ("found", "lost", "silent", "ahead", "none"), 0
        )

    def add(self, eye: EyeState, age_s: float) -> None:
        """Count a frame, whose gaze was so old at its flip."""
        self._counts[eye] += 1
        if eye == "found":
            self._bins[min(max(0, round(age_s / _BIN_S)), _BINS - 1)] += 1
            self._most_s = max(self._most_s, age_s)

    def summary(self) -> LatencySummary:
        """Return the counts."""
        counts, found = self._counts, self._counts["found"]
        return LatencySummary(
            frames=found,
            median_ms=self._quantile_ms(0.5) if found else None,
            p95_ms=self._quantile_ms(0.95) if found else None,
            max_ms=round(1e3 * self._most_s, 3) if found else None,
            lost=counts["lost"] + counts["none"],
            silent=counts["silent"],
            ahead=counts["ahead"],
        )

    def _quantile_ms(self, share: float) -> float:
        due, seen = max(1, math.ceil(share * self._counts["found"])), 0
        for place, count in enumerate(self._bins):
            seen += count
            if seen >= due:
                return min(round(1e3 * _BIN_S * place, 3), round(1e3 * self._most_s, 3))
        raise AssertionError("fewer ages were counted than frames")
