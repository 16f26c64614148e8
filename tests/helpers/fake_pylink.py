"""Stands for SR Research's pylink, and for the Host PC behind it, at the pace of a test's clock."""

from collections import deque
from pathlib import Path

RATE_HZ = 500.0
EPOCH_MS = 70_000_000
"""The tracker's clock at our 0."""
SETUP_TARGETS_PX = [(960, 540), (192, 108), (1728, 972)]
EDF = b"SR_RESEARCH_COMBFILE\n" + bytes(range(256))


class Side:
    """One eye of a sample."""

    def __init__(self, x_px: float, y_px: float) -> None:
        self.gaze = x_px, y_px

    def getGaze(self):  # noqa: N802  (their names)
        return self.gaze


class Sample:
    """As `getFloatData` returns it."""

    def __init__(self, t_ms, left=None, right=None) -> None:
        self.t_ms, self.left, self.right = t_ms, left, right

    def getTime(self):  # noqa: N802
        return self.t_ms

    def getLeftEye(self):  # noqa: N802
        return self.left

    def getRightEye(self):  # noqa: N802
        return self.right


class KeyInput:
    """A key of the display's computer."""

    def __init__(self, code, modifier) -> None:
        self.code, self.modifier = code, modifier


class EyeLinkCustomDisplay:
    """Base of our display."""


class FakePylink:
    """The module, with one Host PC.

    Parameters
    ----------
    eye : Eye
        What it sees; `break` and `death` end the link, the second for good.
    clock : callable
        The test's.
    """

    SAMPLE_TYPE, LOSTDATAEVENT, MISSING_DATA = 200, 63, -32768
    __version__ = "2.2.596.0"
    ENTER_KEY, TERMINATE_KEY = 13, 32767
    CURS_UP, CURS_DOWN, CURS_LEFT, CURS_RIGHT = 18432, 20480, 19200, 19712
    EyeLinkCustomDisplay, KeyInput = EyeLinkCustomDisplay, KeyInput

    def __init__(self, eye, clock) -> None:
        self.eye, self.clock = eye, clock
        self.queue: deque = deque()
        self.calls: list[tuple] = []
        self.files: dict[str, bytes] = {}
        self.refuses = self.drift_refuses = self.file_is_lost = False
        self.drawn: list = []
        self.graphics = None
        self.connected = self.recording = self.into_file = False
        self.open_file = ""
        self.drift_error = "0.31"
        self._next = 0

    def EyeLink(self, host):  # noqa: N802
        if self.refuses or self.eye.now(self.clock()) in ("break", "death"):
            raise RuntimeError("Link terminated")
        self.calls.append(("EyeLink", host))
        self.connected = True
        return Tracker(self)

    def openGraphicsEx(self, graphics):  # noqa: N802
        self.graphics = graphics

    def advance(self, now_s: float) -> int:
        """Queue all samples up to a time; return how many will come."""
        wanted = int(now_s * RATE_HZ) + 1
        if self.eye.now(now_s) in ("break", "death"):
            self.connected = False
        count = 0
        for number in range(self._next, wanted):
            if not (self.recording and self.connected):
                continue
            place = self.eye.place(number / RATE_HZ) or (self.MISSING_DATA, self.MISSING_DATA)
            self.queue.append((self.SAMPLE_TYPE, Sample(2.0 * number + EPOCH_MS, Side(*place))))
            count += 1
        self._next = max(wanted, self._next)
        return count


class Tracker:
    """As `pylink.EyeLink(host)` returns it."""

    def __init__(self, host: FakePylink) -> None:
        self._host = host
        self._last = None

    def __getattr__(self, name):
        """Note every call that has no effect here."""

        def call(*arguments):
            self._answers()
            self._host.calls.append((name, *arguments))
            return 0

        return call

    def _answers(self):
        """As pylink where nothing answers."""
        if self._host.eye.now(self._host.clock()) in ("break", "death"):
            self._host.connected = False
        if not self._host.connected:
            raise RuntimeError("Link terminated")

    def isConnected(self):  # noqa: N802
        return int(self._host.connected)

    def getTrackerVersionString(self):  # noqa: N802
        return "EYELINK CL 5.15 "

    def startRecording(self, samples, _events, _link, _link_events):  # noqa: N802
        self._answers()
        self._host.recording, self._host.into_file = True, bool(samples)
        return 0

    def stopRecording(self):  # noqa: N802
        self._host.recording = False
        self._host.queue.clear()

    def waitForBlockStart(self, _ms, _samples, _events):  # noqa: N802
        return 1

    def openDataFile(self, name):  # noqa: N802
        assert name not in self._host.files
        self._host.files[name] = EDF
        self._host.open_file = name
        return 0

    def closeDataFile(self):  # noqa: N802
        self._host.open_file = ""
        return 0

    def receiveDataFile(self, name, path):  # noqa: N802
        assert not self._host.open_file
        if self._host.file_is_lost:
            raise RuntimeError("Link terminated")
        Path(path).write_bytes(self._host.files[name])
        return len(EDF)

    def requestTime(self):  # noqa: N802
        return 0

    def readTime(self):  # noqa: N802
        return self._host.clock() * 1000 + EPOCH_MS

    def getNextData(self):  # noqa: N802
        if not self._host.queue:
            return 0
        kind, self._last = self._host.queue.popleft()
        return kind

    def getFloatData(self):  # noqa: N802
        return self._last

    def doTrackerSetup(self):  # noqa: N802
        self._show(SETUP_TARGETS_PX)
        self._host.calls.append(("doTrackerSetup",))

    def doDriftCorrect(self, x, y, _draw, _setup):  # noqa: N802
        self._show([(x, y)])
        self._host.calls.append(("doDriftCorrect", x, y))
        return 27 if self._host.drift_refuses else 0

    def getCalibrationMessage(self):  # noqa: N802
        last = self._host.calls[-1][0]
        if last == "doDriftCorrect":
            return f"drift correction: {self._host.drift_error} deg"
        return "calibration GOOD ERROR 0.42 avg. 0.80 max"

    def _show(self, targets) -> None:
        host = self._host
        assert not host.recording
        host.graphics.setup_cal_display()
        for target in targets:
            host.graphics.draw_cal_target(*target)
            for _ in range(30):
                self._answers()
                if any(key.code == host.TERMINATE_KEY for key in host.graphics.get_input_key()):
                    host.graphics.exit_cal_display()
                    return
            host.graphics.erase_cal_target()
        host.graphics.exit_cal_display()
