"""Gaze from an EyeLink, by SR Research's own package `pylink` (of sr-research-pylink).

The Host PC records an EDF file, which is fetched at the end. Calibration and drift correction are
the tracker's own; their targets are drawn in the session's window.
"""

from __future__ import annotations

import math
import re
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from protocols.errors import StudyError
from study_app.gaze.source import CalibrationResult, GazeSample, RawFile, SourceInfo, first_rate

if TYPE_CHECKING:
    from study_app.gaze.source import TrackerContext

HOST = "100.1.1.1"
WAIT_S = 3.0
"""Longest wait for the first samples, and for a clock's answer at most a tenth of it."""
_SAMPLES_MOST = 4096
"""Per poll."""
_SETUP = (
    "screen_pixel_coords = 0 0 {right} {bottom}",
    "calibration_type = HV9",
    "calibration_area_proportion = {share} {share}",
    "validation_area_proportion = {share} {share}",
    "link_sample_data = LEFT,RIGHT,GAZE,AREA,STATUS",
    "link_event_filter = LEFT,RIGHT,BLINK",
    "file_sample_data = LEFT,RIGHT,GAZE,HREF,RAW,AREA,GAZERES,STATUS",
    "file_event_filter = LEFT,RIGHT,FIXATION,SACCADE,BLINK,MESSAGE,BUTTON,INPUT",
)
SCREEN_SHARE = 0.8
"""Share of the screen between the outermost targets."""
_ERROR = re.compile(r"(\d+(?:\.\d+)?)\s*(?:deg|avg)")


def load_pylink() -> Any:
    """Import SR Research's pylink.

    Raises
    ------
    StudyError
        If it is not installed.
    """
    try:
        import pylink

        pylink.EyeLink  # noqa: B018  (another package has the same name)
    except (ImportError, AttributeError) as error:
        raise StudyError(
            f"an EyeLink needs SR Research's package pylink (found: {error}); pip install"
            " 'metamerlab[eyelink]', if its licence suits you: it is free for education and"
            " research that is not commercial"
        ) from None
    return pylink


class EyelinkGaze:
    """A gaze source on an EyeLink's Host PC.

    Parameters
    ----------
    rest : str
        ``HOST,eye=left|right``; both may be left out. Of two eyes the left is taken.
    desk : TrackerContext
        Display, clock and targets of the session.
    pylink : module, optional
        Left out, SR Research's.
    """

    def __init__(self, rest: str, desk: TrackerContext, pylink: Any = None) -> None:
        host, _, eye = rest.partition(",eye=")
        if eye not in ("", "left", "right") or "," in host:
            raise StudyError(f"--gaze: must read eyelink:HOST,eye=left|right (got {rest!r})")
        self._host, self._eye, self._desk = host or HOST, eye, desk
        self._pylink = pylink or load_pylink()
        self._tracker: Any = None
        self._files: list[str] = []
        self._broke = False
        self._offset_s = 0.0
        self._news: list[str] = []
        self._info = SourceInfo("eyelink", "", 0.0)

    def open(self) -> None:
        """Connect, and wait for the first samples.

        Raises
        ------
        StudyError
            If there is no Host PC, or it sends no samples.
        """
        try:
            self._connect()
        except RuntimeError as error:
            raise StudyError(
                f"gaze: the EyeLink's Host PC must be reachable at {self._host} (found: {error});"
                " start it, join both computers by cable, give this one an address of the same"
                " net (100.1.1.2 of mask 255.255.255.0), and name another with --gaze eyelink:HOST"
            ) from None
        try:
            self._record()
            rate_hz = first_rate(
                self,
                WAIT_S,
                "the EyeLink must send samples; see whether its Host PC shows the eye",
            )
        except StudyError:
            self.close()
            raise
        eye = "" if not self._eye else f", {self._eye} eye"
        version = self._tracker.getTrackerVersionString().strip()
        told = f"{version} at {self._host}{eye}, pylink {self._pylink.__version__}"
        self._info = SourceInfo("eyelink", told, rate_hz, self._offset_s)

    def info(self) -> SourceInfo:
        """Name the tracker; its rate, and its clock's offset, are as measured on opening."""
        return self._info

    def poll(self) -> Sequence[GazeSample]:
        """Return the samples that have arrived. Never waits; a link that broke gives nothing."""
        tracker, samples, number = self._tracker, list[GazeSample](), 0
        if tracker is None:
            return ()
        if not tracker.isConnected():
            self._news.append("the link to the EyeLink broke; its Host PC keeps its recording")
            self._tracker, self._broke = None, True
            return ()
        while number < _SAMPLES_MOST and (kind := tracker.getNextData()):
            number += 1
            if kind == self._pylink.SAMPLE_TYPE:
                samples.append(self._sample(tracker.getFloatData()))
            elif kind == self._pylink.LOSTDATAEVENT:
                self._news.append("the EyeLink's link lost samples; its own recording has them")
        return samples

    def mark(self, text: str) -> None:
        """Write a message into the tracker's recording, and measure its clock's offset again."""
        if self._tracker is not None:
            try:
                self._begin_file()
                self._tracker.sendMessage(text)
                self._measure_offset()
            except RuntimeError as error:  # `poll` finds out whether the link is there
                self._news.append(f"the EyeLink did not take the marker {text!r} ({error})")

    def calibrate(self, points_px: Sequence[tuple[float, float]]) -> CalibrationResult | None:
        """Open the tracker's setup; it ends with the operator, and places its own nine targets.

        Raises
        ------
        StudyError
            If nothing answers.
        """
        del points_px
        with self._linked():
            self._routine("doTrackerSetup")
            error_deg, said = self._said()
        self._news.append(f"the EyeLink says of its calibration: {said}")
        return None if math.isnan(error_deg) else CalibrationResult(error_deg, math.nan, 9)

    def check_drift(self, point_px: tuple[float, float]) -> float | None:
        """Run the tracker's drift correction; infinite where it asks to calibrate again.

        Raises
        ------
        StudyError
            If nothing answers.
        """
        x_px, y_px = (round(place) for place in point_px)
        with self._linked():
            ended = self._routine("doDriftCorrect", x_px, y_px, 1, 0)
            if ended != 0:
                return math.inf
            error_deg, said = self._said()
            self._tracker.applyDriftCorrect()
        self._news.append(f"the EyeLink says of its drift correction: {said}")
        return None if math.isnan(error_deg) else error_deg

    def raw(self, *, over: bool) -> RawFile | None:
        """Return the next EDF file, once the session is over; a link that broke left several.

        Raises
        ------
        StudyError
            If it cannot be fetched.
        """
        if not over or not self._files:
            return None
        name, tracker = self._files.pop(0), self._tracker
        lost = f"it lies on the EyeLink's Host PC as {name}: copy it beside the journal"
        if tracker is None:
            raise StudyError(f"gaze: the EDF file cannot be fetched over a broken link; {lost}")
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / name
            try:
                tracker.stopRecording()
                tracker.setOfflineMode()
                tracker.closeDataFile()
                tracker.receiveDataFile(name, str(path))
                data = path.read_bytes()
            except (OSError, RuntimeError) as error:
                raise StudyError(f"gaze: the EDF file must be fetched ({error}); {lost}") from None
        if not data:
            raise StudyError(f"gaze: the EDF file must be fetched (it came empty); {lost}")
        return RawFile(".edf", data)

    def news(self) -> Sequence[str]:
        """Return news of the link since the last call; one that broke is made again.

        It is asked for between two attempts: connecting takes seconds where nothing answers.
        """
        if self._broke:
            self._connect_again()
        told, self._news = self._news, []
        return told

    def close(self) -> None:
        """Disconnect; safe to call twice."""
        if self._tracker is not None:
            with suppress(RuntimeError):  # the link may be gone
                self._tracker.stopRecording()
                if self._files:
                    self._tracker.closeDataFile()
                self._tracker.close()
            self._tracker = None

    def _connect(self) -> None:
        """Connect and say what is sent and kept; `RuntimeError` where nothing answers."""
        # None is pylink's dummy mode, which connects to nothing.
        self._tracker = self._pylink.EyeLink(None if self._host == "dummy" else self._host)
        self._tracker.setOfflineMode()
        display = self._desk.display
        right, bottom = display.width_px - 1, display.height_px - 1
        for command in _SETUP:
            self._tracker.sendCommand(
                command.format(right=right, bottom=bottom, share=SCREEN_SHARE)
            )

    def _connect_again(self) -> None:
        """Connect between two trials, and begin a further file; say whether it went well."""
        try:
            self._connect()
            if self._files:
                self._begin_file(again=True)
            else:
                self._record()
        except (RuntimeError, StudyError) as error:
            self._tracker = None
            self._news.append(f"the EyeLink could not be connected again ({error})")
        else:
            self._broke = False
            file = f", and records {self._files[-1]}" if self._files else ""
            self._news.append(f"the EyeLink is connected again{file}")

    def _record(self) -> None:
        """Record, into the file if there is one, and over the link."""
        into = int(bool(self._files))
        failed = self._tracker.startRecording(into, into, 1, 0)
        if failed or not self._tracker.waitForBlockStart(1000, 1, 0):
            raise StudyError(
                f"gaze: the EyeLink must record (it answered {failed}); see its Host PC for the"
                " reason"
            )
        self._measure_offset()

    def _begin_file(self, *, again: bool = False) -> None:
        """Open the EDF file, once; before, nothing is kept. Its name is of this second alone.

        With `again` a further one is opened, which closes the one before.
        """
        if (self._files and not again) or not self._desk.store:
            return
        number, name = int(time.time()), ""
        while number:
            number, digit = divmod(number, 36)
            name = "0123456789abcdefghijklmnopqrstuvwxyz"[digit] + name
        if f"m{name}.edf" in self._files:  # within one second
            name += "b"
        self._tracker.stopRecording()
        self._tracker.setOfflineMode()
        if failed := self._tracker.openDataFile(f"m{name}.edf"):
            raise StudyError(
                f"gaze: the EyeLink's Host PC must open an EDF file (it answered {failed}); make"
                " room on its disk"
            )
        self._files.append(f"m{name}.edf")
        display = self._desk.display
        self._tracker.sendMessage(
            f"DISPLAY_COORDS 0 0 {display.width_px - 1} {display.height_px - 1}"
        )
        self._record()

    @contextmanager
    def _linked(self) -> Iterator[None]:
        """Have a link; one that broke before is made again.

        Raises
        ------
        StudyError
            If there is none, or it breaks.
        """
        if self._broke:
            self._connect_again()
        cure = "see its cable and its Host PC, then run 'metamerlab session resume'"
        gone = StudyError(f"gaze: the EyeLink must be connected (its link broke); {cure}")
        if self._tracker is None:
            raise gone
        try:
            yield
        except RuntimeError as error:
            raise StudyError(f"gaze: the link to the EyeLink broke ({error}); {cure}") from None
        except StudyError:
            if self._tracker.isConnected():
                raise
            raise gone from None

    def _routine(self, name: str, *arguments: int) -> Any:
        """Run one of the tracker's own routines with its targets in our window, then record."""
        self._begin_file()
        self._tracker.stopRecording()
        self._tracker.setOfflineMode()
        self._pylink.openGraphicsEx(graphics(self._pylink, self._desk))
        try:
            ended = getattr(self._tracker, name)(*arguments)
        except RuntimeError as error:  # escape in a drift correction comes as one, too
            self._news.append(f"the EyeLink's routine ended with: {error}")
            ended = None
        self._record()
        return ended

    def _said(self) -> tuple[float, str]:
        """Return the error in degrees that the last routine's message names, and the message."""
        said = str(self._tracker.getCalibrationMessage()).strip()
        found = _ERROR.search(said)
        return float(found[1]) if found else math.nan, said or "nothing"

    def _measure_offset(self) -> None:
        """Ask for the tracker's time; the answer is taken as of the middle of the way."""
        tracker, clock = self._tracker, self._desk.clock
        asked_s, until_s = clock(), time.monotonic() + WAIT_S / 10
        tracker.requestTime()
        while time.monotonic() < until_s:
            if tracker_ms := tracker.readTime():
                self._offset_s = (asked_s + clock()) / 2 - tracker_ms / 1000
                return

    def _sample(self, sample: Any) -> GazeSample:
        left, right = sample.getLeftEye(), sample.getRightEye()
        eye = right if left is None or (self._eye == "right" and right is not None) else left
        raw_s = float(sample.getTime()) / 1000
        x_px, y_px = eye.getGaze() if eye is not None else (math.nan, math.nan)
        if self._pylink.MISSING_DATA in (x_px, y_px):
            x_px = y_px = math.nan
        return GazeSample(raw_s + self._offset_s, raw_s, float(x_px), float(y_px))


def graphics(pylink: Any, desk: TrackerContext) -> Any:
    """Return the painter of the tracker's targets in the window, which gives it our keys."""
    codes = {
        "enter": pylink.ENTER_KEY, "space": ord(" "), "up": pylink.CURS_UP,
        "down": pylink.CURS_DOWN, "left": pylink.CURS_LEFT, "right": pylink.CURS_RIGHT,
    }  # fmt: skip

    class Graphics(pylink.EyeLinkCustomDisplay):  # type: ignore[misc]
        """Targets and keys; the camera's picture stays on the Host PC."""

        def __init__(self) -> None:
            super().__init__()
            self.target_px: tuple[float, float] | None = None

        def draw_cal_target(self, x: float, y: float) -> None:
            self.target_px = float(x), float(y)

        def erase_cal_target(self) -> None:
            self.target_px = None

        setup_cal_display = exit_cal_display = clear_cal_display = erase_cal_target

        def get_input_key(self) -> list[object]:
            """Show one flip, and return the keys that went down; the quit key ends the setup."""
            down: list[str] = []
            if not desk.look_at(self.target_px, 0.0, lambda: None, down.append):
                return [pylink.KeyInput(pylink.TERMINATE_KEY, 0)]
            known = [codes.get(key, ord(key) if len(key) == 1 else 0) for key in down]
            return [pylink.KeyInput(code, 0) for code in known if code]

        def setup_image_display(self, *_: int) -> int:
            """No picture of the camera here."""
            return 0

        def _nothing(self, *_: object) -> None:
            """No sound, and no picture of the camera: that is on the Host PC."""

        play_beep = get_mouse_state = _nothing
        image_title = draw_image_line = set_image_palette = exit_image_display = _nothing
        draw_line = draw_lozenge = draw_cross_hair = alert_printf = record_abort_hide = _nothing

    return Graphics()
