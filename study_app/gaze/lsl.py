"""Gaze from a stream of the lab streaming layer (LSL); most trackers have a program that sends one.

The stream's channels are found by their labels, or named in the specification. Samples keep the
tracker's stamps; the offset between its clock and ours is measured on opening and between
attempts, never while a trial runs, and added to a copy. A head's pose comes the same way, to look
around a panorama; and markers go out, for recordings elsewhere.
"""

from __future__ import annotations

import math
import platform
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from protocols.display import Display
from protocols.errors import StudyError
from protocols.limits import FIXED
from protocols.outside import visible_line
from study_app.gaze.source import GazeSample, GazeSource, SourceInfo, rate_of
from study_app.gaze.trusted import TrustedGaze

_BUFFER_S = 10
_CHANNELS_MOST = FIXED["channels"].most
"""Limit for a stream: each sample comes with all of its channels, several times per refresh."""
_RATE_MOST_HZ = FIXED["stream_hz"].most
_RATE_FACTOR = 1.5
"""Largest factor between the rate of the first samples and the one that the stream says."""
_X_LABELS = ("x_px", "gaze_x", "x", "gazex", "por_x", "screen_x", "norm_pos_x")
_Y_LABELS = ("y_px", "gaze_y", "y", "gazey", "por_y", "screen_y", "norm_pos_y")


@dataclass(frozen=True)
class LslSpec:
    """Stream to read, and the meaning of its channels."""

    name: str = ""
    """Empty: the first stream of type `Gaze`."""
    x: str = ""
    """Label or number of the channel with the horizontal place; empty: found by its label."""
    y: str = ""
    unit: Literal["", "px", "norm"] = ""
    """`px`: pixels from the upper left corner; `norm`: shares of the screen; empty: as the
    stream's channels say, else pixels."""

    @classmethod
    def parse(cls, text: str) -> LslSpec:
        """Read ``NAME,x=...,y=...,unit=norm``; every part may be left out.

        Raises
        ------
        StudyError
            If a part is none of these.
        """
        fields: dict[str, Any] = {}
        for index, part in enumerate(filter(None, text.split(","))):
            key, equals, value = part.partition("=")
            if not equals and index == 0:
                fields["name"] = part
            elif (key in ("x", "y") and value) or (key == "unit" and value in ("px", "norm")):
                fields[key] = value
            else:
                raise StudyError(
                    "--gaze: must read lsl:NAME,x=CHANNEL,y=CHANNEL,unit=px|norm, every part"
                    f" optional (got {part!r})"
                )
        return cls(**fields)


def load_pylsl() -> Any:
    """Import pylsl.

    Raises
    ------
    StudyError
        If it is not installed.
    """
    try:
        import pylsl
    except (ImportError, RuntimeError) as error:
        raise StudyError(
            f"LSL needs the package pylsl (found: {error}); pip install 'metamerlab[lsl]'"
        ) from None
    return pylsl


class LslStream(GazeSource, ABC):
    """A source on an LSL stream: a kind of it says what the channels mean.

    Parameters
    ----------
    name : str
        The stream's; empty: the first one of the kind's type.
    clock : callable
        The session's clock.
    wait_s : float
        How long to look for the stream, and for its first samples.
    """

    what: ClassVar[str]
    """The option that names it, without dashes; messages begin with it."""
    kind: ClassVar[str]
    """The type of streams to look for."""

    def __init__(self, name: str, clock: Callable[[], float], wait_s: float) -> None:
        self._name, self._clock, self._wait_s = name, clock, wait_s
        self._inlet: Any = None
        self._info = SourceInfo("lsl", "", 0.0)
        self._offset_s = 0.0

    @abstractmethod
    def _choose_channels(self, labels: Sequence[str], units: Sequence[str], count: int) -> None:
        """Find out what the channels mean; `StudyError` if they are not understood."""

    @abstractmethod
    def _place(self, row: Sequence[float]) -> tuple[float, float]:
        """Return the place that a sample's channels give."""

    def open(self) -> None:
        """Find the stream and wait for its first sample.

        Raises
        ------
        StudyError
            If there is no such stream, its channels are not understood, or it sends nothing.
        """
        self._pylsl = pylsl = load_pylsl()
        key, value = ("name", self._name) if self._name else ("type", self.kind)
        found = pylsl.resolve_byprop(key, value, 1, self._wait_s)
        if not found:
            others = [f"{s.name()} ({s.type()})" for s in pylsl.resolve_streams(0.5)]
            raise StudyError(
                f"{self.what}: a stream with {key} {value!r} must be on the network (found"
                f" {', '.join(others) or 'no stream at all'}); start the tracker's LSL program,"
                f" or name another stream with --{self.what} lsl:NAME"
            )
        self._check_stream(found[0])
        inlet = pylsl.StreamInlet(found[0], max_buflen=_BUFFER_S, recover=True)
        try:
            stream = inlet.info(timeout=self._wait_s)
            inlet.open_stream(timeout=self._wait_s)
            stamps = self._first_stamps(inlet, value)
            self._offset_s = self._measure_offset(inlet)
        except (TimeoutError, pylsl.util.TimeoutError, pylsl.util.LostError) as error:
            raise StudyError(
                f"{self.what}: stream {value!r} must answer (found: {error}); start the"
                " tracker's LSL program again"
            ) from None
        self._inlet = inlet
        labels, units = _labels(stream)
        self._choose_channels(labels, units, int(stream.channel_count()))
        rate_hz = self._checked_rate(float(stream.nominal_srate()), stamps)
        self._info = SourceInfo(
            "lsl", f"{stream.name()} on {stream.hostname()}", rate_hz, self._offset_s
        )

    def info(self) -> SourceInfo:
        """Name the stream; its clock's offset is as measured on opening."""
        return self._info

    def poll(self) -> Sequence[GazeSample]:
        """Return the samples that arrived. Never waits; a stream that was lost gives nothing."""
        if self._inlet is None:
            return ()
        try:
            rows, stamps = self._inlet.pull_chunk(timeout=0.0, max_samples=4096)
        except self._pylsl.util.LostError:
            return ()
        return [
            GazeSample(stamp + self._offset_s, stamp, *self._place(row))
            for row, stamp in zip(rows, stamps, strict=True)
        ]

    def mark(self, text: str) -> None:
        """Measure the clock's offset again: an attempt is about to begin.

        Markers go out on the session's own marker stream (`LslMarkers`).
        """
        del text
        if self._inlet is not None:
            try:
                self._offset_s = self._measure_offset(self._inlet, timeout_s=0.05)
            except (TimeoutError, self._pylsl.util.TimeoutError, self._pylsl.util.LostError):
                return  # the last one stands

    def close(self) -> None:
        """Disconnect; safe to call twice."""
        if self._inlet is not None:
            self._inlet.close_stream()
            self._inlet = None

    def _measure_offset(self, inlet: Any, timeout_s: float = 5.0) -> float:
        to_local_s = float(inlet.time_correction(timeout=timeout_s))
        return to_local_s + self._clock() - float(self._pylsl.local_clock())

    def _first_stamps(self, inlet: Any, name: str) -> list[float]:
        """Return the stamps of the first samples, half a second of them at most."""
        until_s = self._clock() + self._wait_s
        stamps: list[float] = []
        enough_s = math.inf
        while self._clock() < min(until_s, enough_s):
            _, new = inlet.pull_chunk(timeout=0.05, max_samples=4096)
            new = [stamp for stamp in new if math.isfinite(stamp)]
            if new and not stamps:
                enough_s = self._clock() + 0.5
            stamps += new
        if not stamps:
            raise StudyError(
                f"{self.what}: stream {name!r} must send samples (found none in"
                f" {self._wait_s:g} s); start the tracker's recording"
            )
        return stamps

    def _check_stream(self, stream: Any) -> None:
        """Refuse a stream that cannot be it before any of it is asked for."""
        name, channels, rate_hz = stream.name(), stream.channel_count(), stream.nominal_srate()
        if channels > _CHANNELS_MOST:
            raise StudyError(
                f"{self.what}: stream {name!r} must have at most {_CHANNELS_MOST} channels (got"
                f" {channels}); have the tracker's LSL program send {self.what} in a stream of its"
                " own"
            )
        if stream.channel_format() in (self._pylsl.cf_string, self._pylsl.cf_undefined):
            raise StudyError(f"{self.what}: stream {name!r} must send numbers (it sends text)")
        if not 0 <= rate_hz <= _RATE_MOST_HZ:
            raise StudyError(
                f"{self.what}: stream {name!r} must send at most {_RATE_MOST_HZ:g} Hz (it"
                f" says {rate_hz:g})"
            )

    def _checked_rate(self, nominal_hz: float, stamps: Sequence[float]) -> float:
        """Return the stream's rate; where it says one, its samples must come at about that rate."""
        measured_hz = rate_of(stamps, self.what)
        if nominal_hz == 0:
            return measured_hz
        if not nominal_hz / _RATE_FACTOR <= measured_hz <= nominal_hz * _RATE_FACTOR:
            raise StudyError(
                f"{self.what}: the stream must send at the rate that it says ({nominal_hz:g} Hz,"
                f" its first samples came at {measured_hz:.3g} Hz); correct the rate in the"
                " tracker's LSL program"
            )
        return nominal_hz


class LslGaze(LslStream):
    """A gaze source on an LSL stream.

    Parameters
    ----------
    spec : LslSpec
        Which stream.
    display : Display
        Turns shares of the screen into pixels.
    clock, wait_s
        As of every stream.
    """

    what, kind = "gaze", "Gaze"

    def __init__(
        self,
        spec: LslSpec,
        display: Display,
        clock: Callable[[], float] = time.monotonic,
        *,
        wait_s: float = 5.0,
    ) -> None:
        super().__init__(spec.name, clock, wait_s)
        self._spec = spec
        self._screen = float(display.width_px), float(display.height_px)
        self._channels = (0, 1)
        self._scale = (1.0, 1.0)

    def _place(self, row: Sequence[float]) -> tuple[float, float]:
        (x, y), (across, down) = self._channels, self._scale
        return row[x] * across, row[y] * down

    def _choose_channels(self, labels: Sequence[str], units: Sequence[str], count: int) -> None:
        if count < 2:
            raise StudyError(f"gaze: the stream must have two channels or more (got {count})")
        listed = ", ".join(map(visible_line, labels)) if any(labels) else "without labels"
        there = f"{count} channels: {listed}"
        cure = "name both channels by label or number: --gaze lsl:NAME,x=CHANNEL,y=CHANNEL"

        def find(axis: str, wanted: str, known: Sequence[str], fallback: int) -> int:
            if wanted.isdecimal() and int(wanted) < count:
                return int(wanted)
            if not any(labels) and not wanted:
                return fallback
            if any(labels) and len(labels) != count:
                raise StudyError(
                    f"gaze: the stream must have one label per channel, or none (got {len(labels)}"
                    f" for {there}); have the tracker's LSL program mend them, or"
                    " name both channels by number: --gaze lsl:NAME,x=0,y=1"
                )
            names = [label if wanted else label.lower() for label in labels]
            name = wanted or next((name for name in known if name in names), "")
            if names.count(name) != 1:
                raise StudyError(
                    f"gaze: channel {wanted or axis!r} must be one of the stream's ({there});"
                    f" {cure}"
                )
            return names.index(name)

        x = find("x", self._spec.x, _X_LABELS, 0)
        y = find("y", self._spec.y, _Y_LABELS, 1)
        if x == y:
            raise StudyError(
                f"gaze: x and y must be two channels of the stream (got channel {x} for both, of"
                f" {there}); {cure}"
            )
        whole = len(labels) == count
        said = units[x].lower() if whole else ""
        label = labels[x].lower() if whole else ""
        if said.startswith("deg") and not self._spec.unit:
            raise StudyError(
                "gaze: the stream must give pixels or shares of the screen (its channels say"
                f" {units[x]!r}); if they are one of these, add unit=px or unit=norm to --gaze"
            )
        norm = said.startswith("norm") or label.startswith("norm")
        unit = self._spec.unit or ("norm" if norm else "px")
        self._channels = x, y
        self._scale = self._screen if unit == "norm" else (1.0, 1.0)


def _labels(stream: Any) -> tuple[list[str], list[str]]:
    """Return the channels' labels and units, as far as the stream says them."""
    labels, units = list[str](), list[str]()
    channel = stream.desc().child("channels").child("channel")
    while not channel.empty() and len(labels) <= _CHANNELS_MOST:
        labels.append(channel.child_value("label"))
        units.append(channel.child_value("unit"))
        channel = channel.next_sibling("channel")
    return labels, units


class LslMarkers:
    """An LSL stream of type `Markers`: ``main-0003 attempt 1 first`` at the flip's stamp.

    Every marker is stamped with the flip that it belongs to, on LSL's clock.

    Parameters
    ----------
    participant : str
        Part of the stream's identity, which the whole network sees. Empty: the host's name alone.
    clock : callable
        The session's clock, which the stamps of flips are on.
    """

    def __init__(self, participant: str = "", clock: Callable[[], float] = time.monotonic) -> None:
        self._pylsl = pylsl = load_pylsl()
        identity = f"metamerlab {participant or platform.node()}"
        info = pylsl.StreamInfo(
            "metamerlab", "Markers", 1, pylsl.IRREGULAR_RATE, "string", identity
        )
        self._outlet = pylsl.StreamOutlet(info)
        self._to_lsl_s = float(pylsl.local_clock()) - clock()

    def __call__(self, text: str, t_s: float) -> None:
        """Send one marker; never waits."""
        self._outlet.push_sample([text], t_s + self._to_lsl_s)


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
