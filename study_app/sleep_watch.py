"""Notices that the machine slept: the monotonic clock stood still, the one since boot did not."""

from __future__ import annotations

import time
from collections.abc import Callable

_LEAST_S = 0.5


def _since_boot() -> float:
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class SleepWatch:
    """Compares two clocks that part only while the machine sleeps.

    Neither is the wall clock: setting that one is no sleep.
    """

    def __init__(
        self,
        awake: Callable[[], float] = time.monotonic,
        since_boot: Callable[[], float] = _since_boot,
    ) -> None:
        self._awake, self._since_boot = awake, since_boot
        self._apart_s = since_boot() - awake()

    def slept_s(self) -> float:
        """Return for how long the machine slept since the last call; 0: it did not."""
        apart_s = self._since_boot() - self._awake()
        slept_s = apart_s - self._apart_s
        if slept_s < _LEAST_S:
            return 0.0
        self._apart_s = apart_s
        return slept_s
