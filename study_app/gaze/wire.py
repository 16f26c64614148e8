"""Connections that come back, addresses and clocks' offsets, for adapters over a network."""

from __future__ import annotations

import math
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress

from protocols.errors import StudyError
from protocols.limits import FIXED
from study_app.gaze.lsl import rate_of
from study_app.gaze.source import GazeSource

CONNECT_S = 3.0
"""Longest wait for a connection, and for each answer on it."""
ENOUGH_S = 0.5
"""Of first samples, for their rate."""
RETRY_S = 0.25
"""Between two attempts to connect again, and how soon a thread sees that it is to end."""
KEEP_ALIVE_S = 15.0
_WAITING_MOST = FIXED["tracker_waiting"].most
"""Bytes that may wait to be taken, as over a long page; more are left to the other end."""
_FEW = 30
"""Samples that a clock's offset needs."""


class TcpConnection:
    """A TCP connection that a thread reads, and makes anew once it breaks.

    What arrives is stamped at once, also while nobody takes it: over pages and breaks.

    Parameters
    ----------
    name : str
        What is at the other end, for messages.
    connect : callable
        Connects and says all that must be said first; may wait. Raises `OSError` or `StudyError`.
    clock : callable
        The session's clock. Like `connect`, it is also called from the thread.
    keep_alive : bytes
        Sent every few seconds, where the other end wants to hear from us.
    """

    def __init__(
        self,
        name: str,
        connect: Callable[[], socket.socket],
        clock: Callable[[], float],
        keep_alive: bytes = b"",
    ) -> None:
        self._name, self._connect, self._clock = name, connect, clock
        self._keep_alive = keep_alive
        self._socket: socket.socket | None = None
        self._came: deque[tuple[float, bytes]] = deque()
        self._waiting = 0
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._news: deque[str] = deque()

    @property
    def connection(self) -> object | None:
        """The connection of now, another after each break; None while there is none."""
        return self._socket

    def open(self, cure: str) -> None:
        """Connect; `StudyError` with `cure` if there is nothing to connect to."""
        try:
            self._socket = self._connect()
        except (OSError, UnicodeError) as error:  # a host's name may be none
            reason = getattr(error, "strerror", None) or error
            raise StudyError(
                f"gaze: {self._name} must be reachable (found: {reason}); {cure}"
            ) from None
        self._thread.start()

    def take(self) -> Sequence[tuple[float, bytes]]:
        """Return the bytes that arrived since the last call, with their times. Never waits.

        Empty bytes stand for a connection that was made anew.
        """
        came = [self._came.popleft() for _ in range(len(self._came))]
        self._waiting -= sum(len(data) for _, data in came)
        return came

    def send(self, data: bytes) -> None:
        """Send, where there is a connection."""
        if self._socket is not None:
            with suppress(OSError):  # the thread sees that it broke
                self._socket.sendall(data)

    def lost(self, cure: str) -> StudyError:
        """Return that what went on needed a connection that broke."""
        now = "there is none now" if self._socket is None else "it broke, and is there again"
        return StudyError(f"gaze: the connection to {self._name} must last ({now}); {cure}")

    def give_up(self, reason: str) -> None:
        """Break the connection: what comes makes no sense."""
        if self._socket is not None:
            self._news.append(f"{self._name} was not understood ({reason})")
            with suppress(OSError):
                self._socket.shutdown(socket.SHUT_RDWR)

    def news(self) -> Sequence[str]:
        """Return news since the last call."""
        return [self._news.popleft() for _ in range(len(self._news))]

    def close(self) -> None:
        """Disconnect; safe to call twice."""
        self._closed.set()
        if self._thread.is_alive():
            self._thread.join()
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _run(self) -> None:
        while self._socket is not None and not self._closed.is_set():
            reason = self._read(self._socket)
            if self._closed.is_set():
                return
            broke_s = self._clock()
            self._news.append(f"the connection to {self._name} broke ({reason})")
            self._socket.close()
            self._socket = None
            while self._socket is None and not self._closed.is_set():
                try:
                    made = self._connect()
                except (OSError, UnicodeError, StudyError):
                    self._closed.wait(RETRY_S)
                    continue
                now_s = self._clock()
                self._news.append(
                    f"{self._name} is connected again, after {now_s - broke_s:.2f} s without gaze"
                )
                self._came.append((now_s, b""))
                self._socket = made

    def _read(self, connection: socket.socket) -> str:
        """Read until it breaks; return why."""
        connection.settimeout(RETRY_S)
        heard_us_s = time.monotonic()
        while not self._closed.is_set():
            if self._keep_alive and time.monotonic() > heard_us_s + KEEP_ALIVE_S:
                heard_us_s = time.monotonic()
                self.send(self._keep_alive)
            if self._waiting > _WAITING_MOST:
                self._closed.wait(RETRY_S)
                continue
            try:
                data = connection.recv(1 << 16)
            except TimeoutError:
                continue
            except OSError as error:
                return error.strerror or str(error)
            if not data:
                return "it was closed"
            self._waiting += len(data)
            self._came.append((self._clock(), data))
        return ""


class ClockOffset:
    """The offset of a tracker's clock, from the samples that were under way for the least time.

    It stays during an attempt; `renew` takes the least since the last call, so that clocks that
    run apart are followed.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Begin anew: the tracker's clock may have, too."""
        self.offset_s, self._least_s, self._count = math.inf, math.inf, 0

    def to_session(self, raw_s: float, arrived_s: float) -> float:
        """Return a stamp on the session's clock, both in seconds."""
        since_s = arrived_s - raw_s
        self._least_s = min(self._least_s, since_s)
        self._count += 1
        if self.offset_s == math.inf:
            self.offset_s = self._least_s
        return raw_s + self.offset_s

    def renew(self) -> None:
        """Take what was measured since the last call, where that was enough."""
        if self._count >= _FEW:
            self.offset_s, self._least_s, self._count = self._least_s, math.inf, 0


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


def address(text: str, kind: str, host: str, port: int) -> tuple[str, int]:
    """Read ``HOST``, ``HOST:PORT`` or nothing, after ``KIND:`` in --gaze.

    Raises
    ------
    StudyError
        If it is none of these.
    """
    name, colon, number = text.partition(":")
    if colon and not (number.isdecimal() and 0 < int(number) < 65536):
        raise StudyError(f"--gaze: must read {kind}:HOST or {kind}:HOST:PORT (got {text!r})")
    return name or host, int(number) if colon else port
