"""Evidence for the stamps of flips: the driver's own counters, a fence, or nothing."""

from __future__ import annotations

import ctypes
import itertools
import statistics
from collections.abc import Sequence
from typing import Any, Literal

from protocols.display import Display
from protocols.errors import StudyError
from protocols.units import Count, Model, SecondsOrNone

Evidence = Literal["glXGetSyncValuesOML", "fence", "unverified", "software timer"]
"""Best first: the driver counted the refresh; the swap was waited for, and the intervals fit the
display; it was waited for, and they do not; no display takes part, a timer paces the flips."""

NO_WAIT_SHARE = 0.6
"""Swaps faster than this share of a refresh period did not wait for the display."""


class SyncValues:
    """The counters of ``GLX_OML_sync_control``, where they answer.

    Some drivers advertise the extension and answer False: the answer counts, not the string.
    """

    def __init__(self, library: ctypes.CDLL, display: int, drawable: int) -> None:
        get_proc = library.glXGetProcAddressARB
        get_proc.restype, get_proc.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
        three = [ctypes.POINTER(ctypes.c_int64)] * 3
        waits = ctypes.CFUNCTYPE(
            ctypes.c_int, ctypes.c_void_p, ctypes.c_ulong, ctypes.c_int64, *three
        )
        gives = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_ulong, *three)
        wait, get = map(get_proc, (b"glXWaitForSbcOML", b"glXGetSyncValuesOML"))
        self._wait, self._get = wait and waits(wait), get and gives(get)
        self._display, self._drawable = display, drawable
        self._values = [ctypes.c_int64() for _ in range(3)]  # microseconds, refreshes, swaps
        self._pointers = [ctypes.byref(value) for value in self._values]

    @classmethod
    def of_window(cls, glfw: Any, window: Any) -> SyncValues | None:
        """Return the counters of a GLFW window; None where they do not answer."""
        try:
            if glfw.get_platform() != glfw.PLATFORM_X11:
                return None
            library = ctypes.CDLL("libGL.so.1")
            drawable = int(glfw.get_glx_window(window) or 0)
            counters = cls(library, int(glfw.get_x11_display() or 0), drawable)
        except (OSError, AttributeError, TypeError, ValueError):
            return None
        return counters if counters.answers() else None

    def answers(self) -> bool:
        """Return True if the driver gives values, and not only the extension's name."""
        if not (self._get and self._wait and self._display and self._drawable):
            return False
        given = self._get(ctypes.c_void_p(self._display), self._drawable, *self._pointers)
        return bool(given) and self._values[0].value > 0

    def last_swap_s(self) -> float | None:
        """Wait for the swap just asked for; return when it happened, or None if unanswered."""
        if not self._wait:
            return None
        display = ctypes.c_void_p(self._display)
        if not self._wait(display, self._drawable, 0, *self._pointers):
            return None
        return self._values[0].value / 1e6


class MeasuredIntervals(Model):
    """Intervals between flips."""

    flips: Count
    mean_s: SecondsOrNone
    """Mean of the intervals that were one refresh long."""
    sd_s: SecondsOrNone
    min_s: SecondsOrNone
    max_s: SecondsOrNone
    missed: Count
    """Intervals of two or more refreshes."""
    doubled: Count
    """Intervals of less than half a refresh."""

    @property
    def refresh_hz(self) -> float:
        """The measured rate."""
        return 1.0 / self.mean_s


def summarise_flips(stamps_s: Sequence[float], nominal_hz: float) -> MeasuredIntervals:
    """Sum up the stamps of flips in a row.

    Raises
    ------
    ValueError
        If there are fewer than three.
    """
    if len(stamps_s) < 3:
        raise ValueError(f"at least three stamps are needed (got {len(stamps_s)})")
    gaps = [late - early for early, late in itertools.pairwise(stamps_s)]
    median_s = max(statistics.median(gaps), 1e-9)
    whole = [gap for gap in gaps if 0.5 <= gap * nominal_hz < 1.5]
    # The median of 120 gaps is no measure of 59.94 Hz against 60: the mean of those in time is.
    period_s = statistics.fmean(whole) if len(whole) > len(gaps) / 2 else median_s
    return MeasuredIntervals(
        flips=len(stamps_s),
        mean_s=period_s,
        sd_s=statistics.pstdev(whole or gaps),
        min_s=min(gaps),
        max_s=max(gaps),
        missed=sum(gap * nominal_hz >= 1.5 for gap in gaps),
        doubled=sum(gap * nominal_hz < 0.5 for gap in gaps),
    )


def judge(intervals: MeasuredIntervals, display: Display, evidence: Evidence) -> Evidence:
    """Return the evidence that the measured intervals leave.

    Raises
    ------
    StudyError
        If the swaps did not wait for the display.
    """
    if evidence == "software timer":
        return evidence
    if intervals.mean_s * display.refresh_hz < NO_WAIT_SHARE:
        raise StudyError(
            f"display {display.name!r}: every swap must wait for the refresh at"
            f" {display.refresh_hz:g} Hz (found {intervals.refresh_hz:.0f} swaps per second); turn"
            " vertical synchronisation on in the driver's settings. For a rehearsal without it,"
            " --software-pacing"
        )
    off = abs(intervals.refresh_hz / display.refresh_hz - 1)
    plausible = (
        off <= display.refresh_tolerance_share
        and intervals.missed + intervals.doubled <= 0.05 * intervals.flips
        and intervals.sd_s <= 0.1 / display.refresh_hz
    )
    return evidence if plausible or evidence == "glXGetSyncValuesOML" else "unverified"
