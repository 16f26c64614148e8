"""Gaze from a Gazepoint tracker, by the Open Gaze API: lines of XML over TCP.

Gazepoint Control runs on this computer or another. Gaze is the API's best point of gaze, in shares
of the screen that it tracks. It calibrates at our targets, in the session's window.
"""

from __future__ import annotations

import math
import re
import socket
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

from protocols.errors import StudyError
from protocols.limits import FIXED
from protocols.viewing import Viewing
from study_app.gaze.source import CalibrationResult, GazeSample, RawFile, SourceInfo
from study_app.gaze.wire import CONNECT_S, ClockOffset, TcpConnection, address, first_rate

if TYPE_CHECKING:
    from study_app.gaze.source import TrackerContext

PORT = 4242
WAIT_S = 5.0
"""Longest wait for the first samples."""
_SENT = ("TIME", "POG_BEST", "BLINK", "PUPILMM", "USER_DATA")
_LINE_MOST = FIXED["tracker_line"].most
_POINT_S = 6.0
"""Longest time that the calibration may take for each target."""
_ATTRIBUTE = re.compile(r'(\w+)="([^"]*)"')


class GazepointGaze:
    """A gaze source on Gazepoint Control.

    Parameters
    ----------
    rest : str
        ``HOST`` or ``HOST:PORT``; empty: this computer.
    desk : TrackerContext
        Display, clock and targets of the session.
    wait_s : float
        How long to wait for the first samples.
    """

    def __init__(self, rest: str, desk: TrackerContext, *, wait_s: float = WAIT_S) -> None:
        self._where = address(rest, "gazepoint", "127.0.0.1", PORT)
        self._desk, self._wait_s = desk, wait_s
        self._screen = desk.display.width_px, desk.display.height_px
        self._wire = TcpConnection(
            "Gazepoint Control at {}:{}".format(*self._where), self._connect, desk.clock
        )
        self._clock = ClockOffset()
        self._rest = b""
        self._said: dict[str, Mapping[str, str]] = {}
        self._steps: list[Mapping[str, str]] = []
        self._keeps = False
        self._raw: list[bytes] = []
        self._info = SourceInfo("gazepoint", "", 0.0)

    def open(self) -> None:
        """Connect, and wait for the first samples.

        Raises
        ------
        StudyError
            If Gazepoint Control cannot be reached, or sends nothing.
        """
        self._wire.open(
            "start Gazepoint Control on the computer that has the tracker, and name it with"
            " --gaze gazepoint:HOST"
        )
        rate_hz = first_rate(
            self,
            self._wait_s,
            "Gazepoint Control must send samples; see whether it shows the eyes, then try again",
        )
        self._clock.renew()
        product = self._said.get("PRODUCT_ID", {}).get("VALUE", "tracker")
        there = self._said.get("SCREEN_SIZE", {})
        size = there.get("WIDTH", ""), there.get("HEIGHT", "")
        notes = (
            f"Gazepoint Control tracks a screen of {' x '.join(size)} px, and the display has"
            f" {' x '.join(map(str, self._screen))}: gaze is taken in shares of it",
        )
        self._info = SourceInfo(
            "gazepoint",
            f"Gazepoint {product} at {self._where[0]}:{self._where[1]}",
            rate_hz,
            self._clock.offset_s,
            notes=() if not all(size) or size == tuple(map(str, self._screen)) else notes,
        )

    def info(self) -> SourceInfo:
        """Name the tracker; its rate, and its clock's offset, are as measured on opening."""
        return self._info

    def poll(self) -> Sequence[GazeSample]:
        """Return the samples that have arrived. Never waits."""
        samples = list[GazeSample]()
        for arrived_s, data in self._wire.take():
            if (
                not data
            ):  # a new connection: half a line, and the clock's offset, are of the old one
                self._rest = b""
                self._clock.reset()
            elif self._keeps:
                self._raw.append(data)
            *lines, self._rest = (self._rest + data).split(b"\n")
            if len(self._rest) > _LINE_MOST:
                self._rest = b""
                self._wire.give_up("it sends no lines")
            for line in lines:
                self._hear(line.decode("ascii", "replace").strip(), arrived_s, samples)
        return samples

    def mark(self, text: str) -> None:
        """Write a marker into the tracker's data: an attempt is about to begin."""
        self._keeps = self._desk.store
        self._clock.renew()
        self._wire.send(_set("USER_DATA", VALUE=text, DUR="1"))

    def calibrate(self, points_px: Sequence[tuple[float, float]]) -> CalibrationResult | None:
        """Have the tracker calibrate itself at these targets; None where someone quit.

        Raises
        ------
        StudyError
            If the calibration does not end, or the connection breaks.
        """
        self._keeps = self._desk.store
        width, height = self._screen
        self._steps, begun = [], self._wire.connection
        self._wire.send(_set("CALIBRATE_SHOW", STATE="0") + _set("CALIBRATE_CLEAR"))
        for x_px, y_px in points_px:
            place = {"X": f"{x_px / width:.5f}", "Y": f"{y_px / height:.5f}"}
            self._wire.send(_set("CALIBRATE_ADDPOINT", **place))
        self._wire.send(_set("CALIBRATE_START", STATE="1"))
        until_s = self._desk.clock() + _POINT_S * (len(points_px) + 1)
        target: tuple[float, float] | None = None
        while begun is not None and self._wire.connection is begun:
            if self._desk.clock() >= until_s:
                raise StudyError(
                    "gaze: the calibration by Gazepoint Control must end (it did not); see what"
                    " Gazepoint Control shows, then run 'metamerlab session resume'"
                )
            if not self._desk.look_at(target, 0.0, lambda: None, lambda _: None):
                self._wire.send(_set("CALIBRATE_START", STATE="0"))
                return None
            self.poll()
            for step in self._steps:
                if step.get("ID") == "CALIB_START_PT":
                    x, y = _number(step, "CALX"), _number(step, "CALY")
                    if 0 <= x <= 1 and 0 <= y <= 1:  # nan is neither
                        target = x * width, y * height
                elif step.get("ID") == "CALIB_RESULT":
                    self._clock.renew()  # a connection may be new
                    self._wire.send(_set("CALIBRATE_START", STATE="0"))
                    return self._quality(step, len(points_px))
            self._steps = []
        raise self._wire.lost(
            "see that Gazepoint Control runs and the network goes, then run 'metamerlab session"
            " resume'"
        )

    def check_drift(self, point_px: tuple[float, float]) -> float | None:
        """The tracker has no drift check; the validation before each block is one."""

    def raw(self, *, over: bool) -> RawFile | None:
        """Return the lines since the last call, as they came."""
        del over
        data, self._raw = b"".join(self._raw), []
        return RawFile(".xml", data) if data else None

    def news(self) -> Sequence[str]:
        """Return news of the connection since the last call."""
        return self._wire.news()

    def close(self) -> None:
        """Disconnect; safe to call twice."""
        self._wire.send(_set("ENABLE_SEND_DATA", STATE="0"))
        self._wire.close()

    def _connect(self) -> socket.socket:
        made = socket.create_connection(self._where, timeout=CONNECT_S)
        asked = [b'<GET ID="PRODUCT_ID" />\r\n', b'<GET ID="SCREEN_SIZE" />\r\n']
        wanted = [_set(f"ENABLE_SEND_{name}", STATE="1") for name in (*_SENT, "DATA")]
        made.sendall(b"".join(asked + wanted))
        return made

    def _hear(self, line: str, arrived_s: float, samples: list[GazeSample]) -> None:
        kind, _, values = line.lstrip("<").partition(" ")
        said = dict(_ATTRIBUTE.findall(values))
        if kind == "REC":
            samples.append(self._sample(said, arrived_s))
        elif kind == "ACK":
            self._said[said.get("ID", "")] = said
        elif kind == "CAL":
            self._steps.append(said)

    def _sample(self, said: Mapping[str, str], arrived_s: float) -> GazeSample:
        raw_s = _number(said, "TIME")
        t_s = self._clock.to_session(raw_s, arrived_s) if math.isfinite(raw_s) else math.nan
        if said.get("BPOGV") != "1":
            return GazeSample(t_s, raw_s, math.nan, math.nan)
        x, y = _number(said, "BPOGX"), _number(said, "BPOGY")
        return GazeSample(t_s, raw_s, x * self._screen[0], y * self._screen[1])

    def _quality(self, said: Mapping[str, str], points: int) -> CalibrationResult:
        """Return the mean error at the targets, of both eyes where both were seen."""
        viewing, (width, height) = Viewing.of(self._desk.display), self._screen
        errors_deg = []
        for number in range(1, points + 1):
            target = _number(said, f"CALX{number}") * width, _number(said, f"CALY{number}") * height
            seen = [eye for eye in "LR" if said.get(f"{eye}V{number}") == "1"]
            x = [_number(said, f"{eye}X{number}") * width for eye in seen]
            y = [_number(said, f"{eye}Y{number}") * height for eye in seen]
            if seen:
                place = sum(x) / len(seen), sum(y) / len(seen)
                errors_deg.append(viewing.angle_deg(place, target))
        mean_deg = sum(errors_deg) / len(errors_deg) if errors_deg else math.nan
        return CalibrationResult(mean_deg, math.nan, len(errors_deg))


def _set(name: str, **values: str) -> bytes:
    said = "".join(f" {key}={quoteattr(value)}" for key, value in values.items())
    return f'<SET ID="{name}"{said} />\r\n'.encode("ascii", "replace")


def _number(said: Mapping[str, str], key: str) -> float:
    try:
        return float(said.get(key, ""))
    except ValueError:
        return math.nan
