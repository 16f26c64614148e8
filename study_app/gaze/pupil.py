"""Gaze from Pupil Labs' glasses, Neon or Invisible, by their real-time API: REST and RTSP.

Glasses say where gaze is in the picture of their own camera. A calibration at our targets puts it
on the screen, by the plane-to-plane map (homography) that fits best. It holds while head and
screen stay: use a chin rest.
"""

from __future__ import annotations

import json
import math
import re
import select
import socket
import struct
import threading
import urllib.request
from collections import deque
from collections.abc import Sequence
from http.client import HTTPException
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from protocols.errors import StudyError
from protocols.limits import FIXED
from protocols.viewing import Viewing
from study_app.gaze.source import CalibrationResult, GazeSample, RawFile, SourceInfo
from study_app.gaze.wire import CONNECT_S, RETRY_S, ClockOffset, TcpConnection, address, first_rate

if TYPE_CHECKING:
    from study_app.gaze.source import TrackerContext

HOST, PORT = "neon.local", 8080
WAIT_S = 8.0
"""Longest wait for the first samples: the clocks' report comes every few seconds."""
SETTLE_S, HOLD_S = 0.6, 0.6
"""At each target: the eye's way, and what counts."""
_ANSWER_MOST = FIXED["tracker_answer"].most
_EPOCH_1900_S = 2_208_988_800
_RTP, _RTCP = 0, 1
_WORN = 255
_NOTE = (
    "gaze of glasses is put on the screen by a calibration, which holds while head and screen stay"
)


class PupilGaze:
    """A gaze source on the phone of Pupil Labs' glasses.

    Parameters
    ----------
    rest : str
        ``HOST`` or ``HOST:PORT`` of the phone; empty: `HOST`.
    desk : TrackerContext
        Display, clock and targets of the session.
    wait_s : float
        How long to wait for the first samples.
    """

    def __init__(self, rest: str, desk: TrackerContext, *, wait_s: float = WAIT_S) -> None:
        host, port = self._where = address(rest, "pupil", HOST, PORT)
        self._desk, self._wait_s = desk, wait_s
        self._datagrams = _Datagrams(desk)
        request = f"OPTIONS rtsp://{host}/ RTSP/1.0\r\nCSeq: 99\r\n\r\n".encode()
        self._wire = TcpConnection(
            f"the glasses' phone at {host}:{port}", self._connect, desk.clock, request
        )
        self._clock, self._clock_hz = ClockOffset(), 90_000
        self._report: tuple[int, float] | None = None
        self._number: int | None = None
        self._map: NDArray[np.float64] | None = None
        self._places: list[tuple[float, float]] = []
        self._lost, self._news = 0, list[str]()
        self._keeps = self._records = False
        self._raw: list[bytes] = []
        self._info = SourceInfo("pupil", "", 0.0)

    def open(self) -> None:
        """Connect, and wait for the first samples.

        Raises
        ------
        StudyError
            If the phone cannot be reached, has no glasses, or sends nothing.
        """
        try:
            self._wire.open(
                "start the Companion app, join both to one network, and name the address that the"
                " app shows with --gaze pupil:HOST"
            )
        except StudyError:
            self.close()
            raise
        rate_hz = first_rate(
            self,
            self._wait_s,
            "the glasses must send gaze; see whether the Companion app shows it, and let UDP"
            " through this computer's firewall",
        )
        self._clock.renew()
        self._info = SourceInfo(
            "pupil",
            "Pupil Labs at {}:{}".format(*self._where),
            rate_hz,
            self._clock.offset_s,
            notes=(_NOTE,),
        )

    def info(self) -> SourceInfo:
        """Name the phone; its rate, and its clock's offset, are as measured on opening."""
        return self._info

    def poll(self) -> Sequence[GazeSample]:
        """Return the samples that came; without a calibration none on the screen. Never waits."""
        samples = []
        self._places = []
        for stamp_s, (t_s, x, y) in self._arrived():
            if x == x:
                self._places.append((x, y))
            if self._map is not None and x == x:
                x, y = on_screen(self._map, x, y)
            else:
                x = y = math.nan
            samples.append(GazeSample(t_s, stamp_s, x, y))
        return samples

    def mark(self, text: str) -> None:
        """Write an event into the phone's recording: an attempt is about to begin."""
        self._begin()
        self._clock.renew()
        self._ask("event", {"name": text})

    def calibrate(self, points_px: Sequence[tuple[float, float]]) -> CalibrationResult | None:
        """Show targets and fit the map; None where someone quit.

        Raises
        ------
        StudyError
            If gaze was seen at fewer than four targets.
        """
        self._begin()
        seen, silent, begun = [], 0, self._wire.connection
        for point in points_px:
            number = self._number
            place = self._gaze_at(point)
            if place is None:
                return None
            if place[0] == place[0]:
                seen.append((place, point))
            silent += self._number == number
        if len(seen) < 4:
            app = "see whether the Companion app shows gaze, and that the network goes"
            cure = f"{app}, then run 'metamerlab session resume'"
            if begun is None or self._wire.connection is not begun:
                raise self._wire.lost(cure)
            if silent:
                raise StudyError(
                    f"gaze: the glasses' phone must send gaze (none came at {silent} of"
                    f" {len(points_px)} targets); {cure}"
                )
            raise StudyError(
                f"gaze: the glasses must see the eyes at four targets or more (they did at"
                f" {len(seen)}); seat them well, then run 'metamerlab session resume'"
            )
        self._clock.renew()  # a connection may be new
        self._map = homography([place for place, _ in seen], [point for _, point in seen])
        viewing = Viewing.of(self._desk.display)
        errors_deg = [
            viewing.angle_deg(on_screen(self._map, *place), point) for place, point in seen
        ]
        return CalibrationResult(sum(errors_deg) / len(seen), math.nan, len(seen))

    def check_drift(self, point_px: tuple[float, float]) -> float | None:
        """Return the distance of gaze from a target; infinite where no eye was seen."""
        place = self._gaze_at(point_px)
        if place is None or self._map is None:
            return None
        if place[0] != place[0]:
            return math.inf
        found = on_screen(self._map, *place)
        return Viewing.of(self._desk.display).angle_deg(found, point_px)

    def raw(self, *, over: bool) -> RawFile | None:
        """Return the packets since the last call, each after its length in 4 bytes."""
        if over and self._records:
            self._records = False
            self._ask("recording:stop_and_save", {})
        data, self._raw = b"".join(self._raw), []
        return RawFile(".rtp", data) if data else None

    def news(self) -> Sequence[str]:
        """Return news of the connection since the last call."""
        told, self._news = [*self._wire.news(), *self._news], []
        if self._lost:
            told.append(f"{self._lost} packets of gaze were lost on the way")
        self._lost = 0
        return told

    def close(self) -> None:
        """Disconnect; safe to call twice."""
        self._wire.close()
        self._datagrams.close()

    def _begin(self) -> None:
        """Keep what comes from here on, and have the phone record, once."""
        self._keeps = self._desk.store
        if self._keeps and not self._records:
            self._records = True
            said = self._ask("recording:start", {})
            if said is not None:
                name = said.get("id", "?") if isinstance(said, dict) else "?"
                self._news.append(f"the phone makes the recording {name}; fetch it from there")

    def _ask(self, path: str, body: dict[str, str] | None) -> Any:
        """Return the result of a call of the phone's REST API; None where it failed, said."""
        try:
            return self._rest(path, body)
        except (OSError, ValueError) as error:
            self._news.append(f"the phone did not answer {path} ({error})")
            return None

    def _rest(self, path: str, body: dict[str, str] | None = None) -> Any:
        host, port = self._where
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(f"http://{host}:{port}/api/{path}", data)
        try:
            with urllib.request.urlopen(request, timeout=CONNECT_S) as answer:
                said = json.loads(answer.read(_ANSWER_MOST))
        except HTTPException as error:
            raise OSError(f"it does not speak HTTP: {error}") from None
        return said.get("result") if isinstance(said, dict) else None

    def _connect(self) -> socket.socket:
        """Ask for the gaze stream, and have it sent to our ports."""
        try:
            parts = self._rest("status") or ()
            sensor = next(
                part["data"]
                for part in parts
                if part["model"] == "Sensor"
                and (part["data"]["sensor"], part["data"]["conn_type"]) == ("gaze", "DIRECT")
                and part["data"]["connected"]
            )
            url = "rtsp://{ip}:{port}/?{params}".format(**sensor)
            where = str(sensor["ip"]), int(sensor["port"])
        except StopIteration:
            raise StudyError(
                "gaze: the phone must see its glasses (they are not connected)"
            ) from None
        except (KeyError, TypeError, ValueError) as error:
            raise StudyError(f"gaze: the phone's status was not understood ({error!r})") from None
        made = socket.create_connection(where, timeout=CONNECT_S)
        try:
            self._describe(made, url)
        except (OSError, StudyError):
            made.close()
            raise
        return made

    def _describe(self, made: socket.socket, url: str) -> None:
        said = _rtsp(made, "DESCRIBE", url, 1, "Accept: application/sdp\r\n")
        rate = re.search(r"a=rtpmap:\d+ \S+?/(\d+)", said)
        control = re.findall(r"a=control:(\S+)", said)
        track = control[-1] if control else url
        track = track if track.startswith("rtsp:") else f"{url.rstrip('/')}/{track}"
        self._clock_hz = max(1, int(rate[1])) if rate else 90_000
        ports = "{}-{}".format(*self._datagrams.ports)
        said = _rtsp(made, "SETUP", track, 2, f"Transport: RTP/AVP;unicast;client_port={ports}\r\n")
        name = re.search(r"(?im)^Session:\s*([^;\s]+)", said)
        _rtsp(made, "PLAY", url, 3, f"Session: {name[1] if name else ''}\r\n")

    def _arrived(self) -> list[tuple[float, tuple[float, float, float]]]:
        """Return stamps of the phone, each with session time and place in the camera's picture."""
        for _, data in self._wire.take():
            if not data:  # a new connection: its clock is reported anew
                self._report = self._number = None
                self._clock.reset()
        found = []
        for arrived_s, channel, data in self._datagrams.take():
            if self._keeps:
                self._raw.append(struct.pack("!I", len(data)) + data)
            if channel == _RTCP and len(data) >= 20 and data[1] == 200:  # a sender's report
                whole, part, stamp = struct.unpack("!III", data[8:20])
                self._report = stamp, whole - _EPOCH_1900_S + part / 2**32
            elif channel == _RTP and len(data) >= 12 and self._report:
                number, stamp = struct.unpack("!HI", data[2:8])
                payload = data[12 + 4 * (data[0] & 15) :]
                if len(payload) < 9:
                    continue
                if self._number is not None:
                    self._lost += (number - self._number - 1) % 65536
                self._number = number
                # The 32 bits of a stamp begin anew every half day.
                ticks = (stamp - self._report[0] + 2**31) % 2**32 - 2**31
                stamp_s = self._report[1] + ticks / self._clock_hz
                x, y, worn = struct.unpack("!ffB", payload[:9])
                place = (x, y) if worn == _WORN else (math.nan, math.nan)
                found.append((stamp_s, (self._clock.to_session(stamp_s, arrived_s), *place)))
        return found

    def _gaze_at(self, point_px: tuple[float, float]) -> tuple[float, float] | None:
        """Return the mean place in the camera's picture; nan without an eye, None where quit."""
        kept: list[tuple[float, float]] = []

        def collect() -> None:
            self.poll()
            kept.extend(self._places)

        for duration_s in (SETTLE_S, HOLD_S):
            kept.clear()
            if not self._desk.look_at(point_px, duration_s, collect, lambda _: None):
                return None
        if not kept:
            return math.nan, math.nan
        return sum(x for x, _ in kept) / len(kept), sum(y for _, y in kept) / len(kept)


class _Datagrams:
    """Two UDP ports, read and stamped by a thread: the stream's, and its clock's reports."""

    def __init__(self, desk: TrackerContext) -> None:
        self._sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
        for each in self._sockets:
            each.bind(("", 0))
        self.ports = tuple(each.getsockname()[1] for each in self._sockets)
        self._came: deque[tuple[float, int, bytes]] = deque(maxlen=1 << 18)
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(desk,), daemon=True)
        self._thread.start()

    def take(self) -> list[tuple[float, int, bytes]]:
        """Return arrival, channel and bytes of what came since the last call."""
        return [self._came.popleft() for _ in range(len(self._came))]

    def close(self) -> None:
        """Stop; safe to call twice."""
        self._closed.set()
        self._thread.join()
        for each in self._sockets:
            each.close()

    def _run(self, desk: TrackerContext) -> None:
        while not self._closed.is_set():
            for ready in select.select(self._sockets, (), (), RETRY_S)[0]:
                self._came.append((desk.clock(), self._sockets.index(ready), ready.recv(1 << 16)))


def homography(
    places: Sequence[tuple[float, float]], points: Sequence[tuple[float, float]]
) -> NDArray[np.float64]:
    """Return the (3, 3) map from places of one plane to points of another, by least squares.

    Notes
    -----
    Hartley and Zisserman, "Multiple View Geometry", algorithm 4.2: both are centred and scaled.
    """
    (a, scale_a), (b, scale_b) = _normalised(places), _normalised(points)
    rows = []
    for (x, y), (u, v) in zip(a, b, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y, -u], [0, 0, 0, x, y, 1, -v * x, -v * y, -v]]
    fit = np.linalg.svd(np.array(rows))[2][-1].reshape(3, 3)
    return np.asarray(np.linalg.inv(scale_b) @ fit @ scale_a)


def on_screen(fit: NDArray[np.float64], x: float, y: float) -> tuple[float, float]:
    """Return the place on the screen to which a map leads."""
    u, v, w = fit @ (x, y, 1.0)
    return (float(u / w), float(v / w)) if w else (math.nan, math.nan)


def _normalised(
    places: Sequence[tuple[float, float]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    plain = np.array(places)
    middle = plain.mean(axis=0)
    scale = 1 / max(float(np.abs(plain - middle).mean()), 1e-9)
    matrix = np.array([[scale, 0, -scale * middle[0]], [0, scale, -scale * middle[1]], [0, 0, 1]])
    return (plain - middle) * scale, matrix


def _rtsp(made: socket.socket, verb: str, url: str, number: int, more: str) -> str:
    """Ask one thing of an RTSP server; `StudyError` if it refuses."""
    made.sendall(f"{verb} {url} RTSP/1.0\r\nCSeq: {number}\r\n{more}\r\n".encode())
    said = b""
    while len(said) < _ANSWER_MOST:
        head, ended, body = said.partition(b"\r\n\r\n")
        length = re.search(rb"(?i)content-length:\s*(\d+)", head)
        if ended and len(body) >= (int(length[1]) if length else 0):
            break
        part = made.recv(4096)
        if not part:
            raise OSError("it was closed")
        said += part
    text = said.decode("utf-8", "replace")
    if " 200 " not in text.partition("\r\n")[0]:
        raise StudyError(f"gaze: the glasses' stream was refused ({text.partition(chr(13))[0]})")
    return text
