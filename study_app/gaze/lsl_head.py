"""A head's pose from a stream of the lab streaming layer, to look around a panorama."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

from protocols.errors import StudyError
from protocols.outside import visible_line
from study_app.gaze.lsl import LslStream
from study_app.gaze.trusted import TrustedGaze

_ANGLES = ("yaw", "pitch")
_QUATERNION = ("w", "x", "y", "z")


class LslHead(LslStream):
    """A head's pose on an LSL stream: where it looks, in degrees to the right and down.

    Its samples have these for places. The head's roll changes nothing, as a screen does not roll.
    Channels are found by their labels: ``yaw``, ``pitch`` and perhaps ``roll``, degrees to the
    right and up, or ``w``, ``x``, ``y``, ``z`` (also ``qw`` ...), a quaternion of any length in
    axes to the right, up, and back. Without labels three channels are the former, four the latter.
    """

    what, kind = "head", "Mocap"

    def __init__(
        self, name: str, clock: Callable[[], float] = time.monotonic, *, wait_s: float = 5.0
    ) -> None:
        super().__init__(name, clock, wait_s)
        self._channels: tuple[int, ...] = ()

    def _place(self, row: Sequence[float]) -> tuple[float, float]:
        if len(self._channels) == len(_ANGLES):
            yaw_deg, pitch_deg = (row[k] for k in self._channels)
            return yaw_deg, -pitch_deg
        w, x, y, z = (row[k] for k in self._channels)
        length = w * w + x * x + y * y + z * z
        if not 0 < length < math.inf:
            return math.nan, math.nan
        right, up, ahead = -2 * (w * y + x * z), 2 * (w * x - y * z), w * w - x * x - y * y + z * z
        down = math.asin(max(-1.0, min(1.0, -up / length)))
        return math.degrees(math.atan2(right, ahead)), math.degrees(down)

    def _choose_channels(self, labels: Sequence[str], units: Sequence[str], count: int) -> None:
        names = [label.lower() for label in labels]
        if not any(names) and count in (3, 4):
            self._channels = tuple(range(2 if count == 3 else 4))
            return
        known = (_ANGLES, _QUATERNION, tuple(f"q{part}" for part in _QUATERNION))
        found = [one for one in known if all(names.count(name) == 1 for name in one)]
        if len(found) != 1 or len(names) != count:
            there = ", ".join(map(visible_line, labels)) if any(labels) else "without labels"
            raise StudyError(
                "head: the stream must have channels yaw, pitch, roll (degrees) or w, x, y, z (a"
                f" quaternion), by their labels, or 3 or 4 without labels (got {count} channels:"
                f" {there}); have the tracker's LSL program label them"
            )
        chosen = tuple(names.index(name) for name in found[0])
        if len(chosen) == len(_ANGLES) and units[chosen[0]].lower().startswith("rad"):
            raise StudyError(
                "head: the stream must give degrees (its channels say"
                f" {units[chosen[0]]!r}); set the tracker's LSL program to degrees"
            )
        self._channels = chosen


def open_head(specification: str, clock: Callable[[], float]) -> TrustedGaze:
    """Open the stream that ``lsl`` or ``lsl:NAME`` names.

    Raises
    ------
    StudyError
        If there is none, or its channels are no pose.
    """
    source = TrustedGaze(LslHead(specification.partition(":")[2], clock), clock)
    source.open()
    return source
