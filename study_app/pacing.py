"""Refresh that each flip fell on, and missed refreshes: a pure fold over flip stamps.

The display refreshes on a grid. A flip is on time when it lies near a grid line, late when it
lies clearly behind one (its frame is still on that refresh), and every grid line without a flip
is a missed refresh. Two flips at one line are a doubled flip: the first was never seen.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

Pacing = Literal["vsync", "software"]
"""Flips wait for the display, or for a timer in its place."""
FlipKind = Literal["first", "on-time", "late", "missed", "doubled"]

LATE_SHARE = 0.15
"""Share of a refresh period behind the grid from which a flip counts as late."""
_FOLLOW_SHARE = 0.1
"""Share by which each on-time flip pulls the grid: real clocks drift by some parts in 10^4."""


class JudgedFlip(NamedTuple):
    """One flip as judged."""

    t_s: float
    """Its stamp."""
    refreshes: int
    """Refreshes since the flip before; 0 for a doubled one, 1 in time."""
    kind: FlipKind
    late_s: float
    """Behind the grid line of its refresh."""

    @property
    def missed(self) -> int:
        """Refreshes without a flip of their own just before this one."""
        return max(0, self.refreshes - 1)


def cannot_keep_up(refresh_hz: float, missed: int, refreshes: int) -> str:
    """Words on a display that missed so many of its refreshes."""
    reached_hz = refresh_hz * (1 - missed / refreshes)
    return (
        f"the display cannot keep up ({reached_hz:.3g} Hz instead of {refresh_hz:.4g}: {missed} of"
        f" {refreshes} refreshes were missed)"
    )


class Pacer:
    """Judges flips one by one against the refresh grid.

    Parameters
    ----------
    refresh_hz : float
        The display's measured rate, or its nominal one; it may be off by half a percent.
    """

    def __init__(self, refresh_hz: float) -> None:
        self._period_s = 1.0 / refresh_hz
        self._line_s: float | None = None  # grid line of the flip before

    def flip(self, t_s: float) -> JudgedFlip:
        """Judge the flip stamped `t_s`; stamps must not run backwards.

        Raises
        ------
        ValueError
            If the stamp is before the grid line of the flip before by a whole refresh.
        """
        if self._line_s is None:
            self._line_s = t_s
            return JudgedFlip(t_s, 0, "first", 0.0)
        period = self._period_s
        since = (t_s - self._line_s) / period
        refreshes = round(since)
        if refreshes < 0:
            raise ValueError(f"flip stamps must not run backwards (got {t_s} s)")
        behind = since - refreshes
        self._line_s += refreshes * period
        late = behind >= LATE_SHARE
        if not late and refreshes:
            self._line_s += behind * period * _FOLLOW_SHARE
        kind: FlipKind = "on-time"
        if refreshes == 0:
            kind = "doubled"
        elif refreshes > 1:
            kind = "missed"
        elif late:
            kind = "late"
        return JudgedFlip(t_s, refreshes, kind, behind * period)
