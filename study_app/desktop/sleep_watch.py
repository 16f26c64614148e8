"""Notices that the machine slept: one clock stood still, the other did not."""

from __future__ import annotations

import ctypes
import sys
import time
from collections.abc import Callable

_LEAST_S = 0.5

if sys.platform == "win32":
    _through_sleep = time.monotonic

    def _awake() -> float:
        hundred_ns = ctypes.c_ulonglong()
        ctypes.windll.kernel32.QueryUnbiasedInterruptTime(ctypes.byref(hundred_ns))
        return hundred_ns.value / 1e7

elif sys.platform == "darwin":
    _awake = time.monotonic

    def _through_sleep() -> float:
        return time.clock_gettime(time.CLOCK_MONOTONIC)

else:
    _awake = time.monotonic

    def _through_sleep() -> float:
        return time.clock_gettime(time.CLOCK_BOOTTIME)


class SleepWatch:
    """Compares two clocks that part only while the machine sleeps.

    Neither is the wall clock: setting that one is no sleep.
    """

    def __init__(
        self,
        awake: Callable[[], float] = _awake,
        through_sleep: Callable[[], float] = _through_sleep,
    ) -> None:
        self._awake, self._through_sleep = awake, through_sleep
        self._apart_s = through_sleep() - awake()

    def slept_s(self) -> float:
        """Return for how long the machine slept since the last call; 0: it did not."""
        apart_s = self._through_sleep() - self._awake()
        slept_s = apart_s - self._apart_s
        if slept_s < _LEAST_S:
            return 0.0
        self._apart_s = apart_s
        return slept_s
