"""Stands for pylsl, with one stream of gaze behind it, at the pace of a test's clock."""

import math
from types import SimpleNamespace

RATE_HZ = 250.0
EPOCH_S = 40_000.5
"""The sender's clock at our 0; LSL's own clock is ours."""


class LostError(RuntimeError):
    """The stream is gone, and does not come back."""


class _End:
    """Of a list of channels without labels."""

    def child(self, _name):
        return self

    def empty(self):
        return True


class FakePylsl:
    """The module, with one stream.

    Parameters
    ----------
    eye : Eye
        What it sees; `break` and `death` send nothing, and the second loses the stream.
    clock : callable
        The test's.
    """

    cf_string, cf_undefined = 3, 0
    util = SimpleNamespace(LostError=LostError, TimeoutError=TimeoutError)

    def __init__(self, eye, clock) -> None:
        self.eye, self.clock = eye, clock
        self.rows: list[tuple[float, list[float]]] = []
        self.rate_hz = RATE_HZ
        self.lost = False
        self._next = 0

    def local_clock(self):
        return self.clock()

    def resolve_byprop(self, _key, _value, _least, _wait_s):
        return [self]

    def StreamInlet(self, _stream, **_options):  # noqa: N802  (their name)
        return self

    # Of a stream's description.

    def info(self, timeout=0.0):  # noqa: ARG002
        return self

    def name(self):
        return "eyes"

    def hostname(self):
        return "host"

    def channel_count(self):
        return 3

    def channel_format(self):
        return 2

    def nominal_srate(self):
        return self.rate_hz

    def desc(self):
        return _End()

    # Of an inlet.

    def open_stream(self, timeout=0.0):
        pass

    def close_stream(self):
        pass

    def time_correction(self, timeout=0.0):  # noqa: ARG002
        return -EPOCH_S

    def pull_chunk(self, timeout=0.0, max_samples=0):
        if timeout:  # on opening nobody else moves the clock
            self.clock.move_to(self.clock() + timeout)
            self.advance(self.clock())
        if self.lost:
            raise LostError("the stream has been lost")
        taken, self.rows = self.rows[:max_samples], self.rows[max_samples:]
        return [row for _, row in taken], [stamp for stamp, _ in taken]

    def advance(self, now_s: float) -> int:
        """Send all samples up to a time; return how many will come."""
        wanted = int(now_s * RATE_HZ) + 1
        what = self.eye.now(now_s)
        self.lost = self.lost or what == "death"
        count = 0
        for number in range(self._next, wanted):
            if what in ("break", "death"):
                continue
            x_px, y_px = self.eye.place(number / RATE_HZ) or (math.nan, math.nan)
            self.rows.append((number / RATE_HZ + EPOCH_S, [x_px, y_px, 3.5]))
            count += 1
        self._next = wanted
        return count
