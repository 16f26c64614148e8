"""The interface of every gaze source. An adapter for a tracker is one small file."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeAlias, runtime_checkable

from protocols.display import Display
from protocols.errors import StudyError

ENOUGH_S = 0.5
"""Length of the first samples, for their rate."""

LookAt: TypeAlias = Callable[
    [tuple[float, float] | None, float, Callable[[], None], Callable[[str], None]], bool
]
"""Called with the target's place in pixels (None: an empty screen), how long to show it (one flip
at least), what to call at every flip, and what to tell the keys that go down. False: someone
pressed a quit key."""


@dataclass(frozen=True)
class TrackerContext:
    """Parts of the session that an adapter may use."""

    display: Display
    clock: Callable[[], float]
    cursor_px: Callable[[], tuple[float, float]]
    refresh_hz: float
    look_at: LookAt = lambda *_: False
    """Shows a target in the session's window; for `calibrate` and `check_drift`."""
    store: bool = True
    """True if gaze may be kept: a tracker's own recording too."""


class GazeSample(NamedTuple):
    """One sample."""

    t_s: float
    """Time on the session's monotonic clock."""
    raw_t: float
    """The tracker's own stamp, as it gave it."""
    x_px: float
    """Distance from the left edge of the display; nan where the eye was lost."""
    y_px: float
    """Distance from the upper edge."""

    @property
    def valid(self) -> bool:
        """True if the eye was seen."""
        return self.x_px == self.x_px and self.y_px == self.y_px


@dataclass(frozen=True)
class SourceInfo:
    """Description that a source gives of itself."""

    source: str
    description: str
    rate_hz: float
    """Nominal sampling rate."""
    clock_offset_s: float | None = None
    """Added to raw stamps to give the session's clock; None where they are one clock."""
    polled: bool = False
    """Each poll takes one sample, so that gaps between samples are the display's, not the eye's."""
    notes: tuple[str, ...] = ()
    """Assumptions about the coordinates or the eye: said, and kept in the journal."""


@dataclass(frozen=True)
class CalibrationResult:
    """Quality of a validation, or of a tracker's own calibration as it says."""

    accuracy_deg: float
    precision_deg: float
    """Root mean square of steps between samples; nan where a tracker does not say it."""
    points: int
    sd_deg: float = math.nan
    """Standard deviation; nan where it is not known."""
    lost_share: float = math.nan
    """Share of the samples without an eye; nan where it is not known."""


class RawFile(NamedTuple):
    """Data that a tracker recorded or sent, byte for byte."""

    suffix: str
    """End of the file's name, with its dot."""
    data: bytes


class GazeSource(Protocol):
    """A tracker, or what stands for one. Who derives from it inherits what does nothing."""

    def open(self) -> None:
        """Connect; `StudyError` if there is nothing to connect to."""
        return

    def info(self) -> SourceInfo:
        """Describe the open source."""

    def poll(self) -> Sequence[GazeSample]:
        """Return the samples since the last call, oldest first. Never waits."""

    def mark(self, text: str) -> None:  # noqa: ARG002
        """Write a marker into the tracker's own recording, where it has one."""
        return

    def calibrate(
        self,
        points_px: Sequence[tuple[float, float]],  # noqa: ARG002
    ) -> CalibrationResult | None:
        """Run the tracker's own calibration; None where it has none."""
        return None

    def close(self) -> None:
        """Disconnect; safe to call twice."""
        return


@runtime_checkable
class Tracker(GazeSource, Protocol):
    """A source with a drift check, a recording and a connection of its own. None of it is a must.

    Both routines show their targets in the session's window, by `TrackerContext.look_at`.
    """

    def check_drift(self, point_px: tuple[float, float]) -> float | None:
        """Run the tracker's own drift check; return the error in degrees, None without one."""

    def raw(self, *, over: bool) -> RawFile | None:
        """Return the file of what was recorded or sent since the last call; None: nothing.

        With `over` the session's run is over: a file that the tracker has is fetched now, and it is
        asked again until nothing is left.
        """

    def news(self) -> Sequence[str]:
        """Return news of the connection since the last call, for the journal."""


def first_rate(source: GazeSource, wait_s: float, silent: str) -> float:
    """Return the rate of an open source's first samples, some tenths of a second of them.

    Raises
    ------
    StudyError
        If there are none within `wait_s`: then the source is closed, and `silent` says the cure.
    """
    stamps, until_s = list[float](), time.monotonic() + wait_s
    while time.monotonic() < until_s and not (stamps and stamps[-1] - stamps[0] > ENOUGH_S):
        stamps += [sample.raw_t for sample in source.poll() if math.isfinite(sample.raw_t)]
        time.sleep(0.002)
    if not stamps:
        source.close()
        raise StudyError(f"gaze: {silent} (found no sample in {wait_s:g} s)")
    return rate_of(stamps)


def rate_of(stamps: Sequence[float], what: str = "gaze") -> float:
    """Return the rate of samples with these stamps; `StudyError` if they do not move on."""
    span_s = stamps[-1] - stamps[0] if len(stamps) > 1 else 0.0
    if span_s <= 0:
        raise StudyError(f"{what}: the stream must say its rate, or send samples steadily")
    return (len(stamps) - 1) / span_s
