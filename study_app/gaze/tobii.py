"""Gaze from a screen-based Tobii, by the package TittaPy, which brings Tobii's own library along.

It calibrates at our targets, in the session's window, and connects again by itself.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from protocols.errors import StudyError
from protocols.viewing import Viewing
from study_app.gaze.source import CalibrationResult, GazeSample, RawFile, SourceInfo
from study_app.gaze.wire import first_rate

if TYPE_CHECKING:
    from study_app.gaze.source import TrackerContext

WAIT_S = 5.0
"""Longest wait for the first samples."""
SETTLE_S = 0.8
"""The eye's way to a target."""
ACTION_S = 10.0
"""Longest time that each step of a calibration may take."""
_LOST, _RESTORED = "connection_lost", "connection_restored"


def load_titta() -> Any:
    """Import TittaPy.

    Raises
    ------
    StudyError
        If it is not installed.
    """
    try:
        return importlib.import_module("TittaPy_v2")
    except ImportError as error:
        raise StudyError(
            f"a Tobii needs the package TittaPy (found: {error}); pip install 'metamerlab[tobii]',"
            " or send its gaze over LSL and use --gaze lsl:NAME"
        ) from None


class TobiiGaze:
    """A gaze source on a Tobii.

    Parameters
    ----------
    rest : str
        Its address, such as ``tet-tcp://169.254.5.184``; empty: the one that is found.
    desk : TrackerContext
        Display, clock and targets of the session.
    titta : module, optional
        Left out, TittaPy.
    """

    def __init__(self, rest: str, desk: TrackerContext, titta: Any = None) -> None:
        self._address, self._desk, self._titta = rest, desk, titta or load_titta()
        self._tracker: Any = None
        self._keeps, self._raw = False, list[str]()
        self._offset_s, self._away = 0.0, False
        self._news: list[str] = []
        self._info = SourceInfo("tobii", "", 0.0)

    def open(self) -> None:
        """Connect, and wait for the first samples.

        Raises
        ------
        StudyError
            If there is none, or it sends nothing.
        """
        try:
            found = [each["address"] for each in self._titta.find_all_eye_trackers()]
            address = self._address or (found[0] if len(found) == 1 else "")
            if not address:
                raise StudyError(
                    f"gaze: one Tobii must be found (found {', '.join(found) or 'none'}); switch it"
                    " on and see it in Tobii's own manager, or name it with --gaze tobii:ADDRESS"
                )
            self._tracker = tracker = self._titta.EyeTracker(address)
            tracker.start("gaze")
            tracker.start("notification")
        except RuntimeError as error:
            raise StudyError(
                f"gaze: the Tobii must answer (found: {error}); see it in Tobii's own manager"
            ) from None
        self._measure_offset()
        rate_hz = first_rate(
            self, WAIT_S, "the Tobii must send samples; see whether its own manager shows the eyes"
        )
        told = f"{tracker.model} at {address}, Tobii's library {self._titta.get_SDK_version()}"
        self._info = SourceInfo("tobii", told, rate_hz, self._offset_s)

    def info(self) -> SourceInfo:
        """Name the tracker; its rate, and its clock's offset, are as measured on opening."""
        return self._info

    def poll(self) -> Sequence[GazeSample]:
        """Return the samples that have arrived. Never waits."""
        if self._tracker is None:
            return ()
        told = self._tracker.consume_N("notification", 1000)
        for kind in told.get("notification_type", ()):
            self._news.append(f"the Tobii says {kind}")
            if kind in (_LOST, _RESTORED):
                self._away = kind == _LOST
        columns = self._tracker.consume_N("gaze", 10_000)
        names = list(columns)
        rows = list(zip(*columns.values(), strict=True))
        if rows and self._keeps:
            head = [",".join(names)] if not self._raw else []
            self._raw += [*head, *(",".join(map(str, row)) for row in rows)]
        return [self._sample(dict(zip(names, row, strict=True))) for row in rows]

    def mark(self, text: str) -> None:
        """Measure the clock's offset again: an attempt is about to begin. Markers go nowhere."""
        del text
        self._keeps = self._desk.store
        self._measure_offset()

    def calibrate(self, points_px: Sequence[tuple[float, float]]) -> CalibrationResult | None:
        """Have the tracker calibrate itself at these targets; None where someone quit.

        Raises
        ------
        StudyError
            If a step of it does not end, or fails.
        """
        self._keeps = self._desk.store
        tracker = self._tracker
        steps: list[tuple[Callable[[], Any], tuple[float, float]]] = [
            *((self._collect(point), point) for point in points_px),
            (tracker.calibration_compute_and_apply, points_px[-1]),
        ]
        try:
            tracker.enter_calibration_mode(False)
            result = self._ended(points_px[0])
            for run, place in steps:
                if result is None or not self._desk.look_at(place, SETTLE_S, _nothing, _nothing):
                    return None
                run()
                result = self._ended(place)
        except RuntimeError as error:  # as the library where nothing answers
            raise self._failed(error) from None
        finally:
            with suppress(RuntimeError):
                tracker.leave_calibration_mode(False)
        if result is None:
            return None
        return _quality(result["calibration_result"], Viewing.of(self._desk.display))

    def check_drift(self, point_px: tuple[float, float]) -> float | None:
        """The tracker has no drift check; the validation before each block is one."""

    def raw(self, *, over: bool) -> RawFile | None:
        """Return every column of the samples since the last call, as a table."""
        del over
        lines, self._raw = self._raw, []
        return RawFile(".csv", "\n".join([*lines, ""]).encode()) if lines else None

    def news(self) -> Sequence[str]:
        """Return the tracker's own messages since the last call."""
        told, self._news = self._news, []
        return told

    def close(self) -> None:
        """Disconnect; safe to call twice."""
        if self._tracker is not None:
            with suppress(RuntimeError):  # the tracker may be gone
                self._tracker.stop("gaze")
                self._tracker.stop("notification")
            self._tracker = None

    def _collect(self, point_px: tuple[float, float]) -> Callable[[], Any]:
        display = self._desk.display
        share = [point_px[0] / display.width_px, point_px[1] / display.height_px]
        return lambda: self._tracker.calibration_collect_data(share)

    def _ended(self, place: tuple[float, float]) -> Any:
        """Show a target until a step of the calibration ends; return its result, None: quit."""
        until_s = self._desk.clock() + ACTION_S
        while self._desk.clock() < until_s:
            result = self._tracker.calibration_retrieve_result()
            if result is not None and result["status"] == 0:
                return result
            if result is not None:
                break
            if not self._desk.look_at(place, 0.0, _nothing, _nothing):
                return None
        raise self._failed("it did not end" if result is None else result["status_string"])

    def _failed(self, said: object) -> StudyError:
        self.poll()  # it may have told of its connection
        if self._away or "CONNECTION_FAILED" in str(said):
            found = f"{said}; it says {_LOST}" if self._away else said
            return StudyError(
                f"gaze: the Tobii must be connected while it is calibrated (found: {found}); see"
                " its cable, its power and Tobii's own manager, then run 'metamerlab session"
                " resume'"
            )
        return StudyError(
            f"gaze: the Tobii's calibration must succeed (found: {said}); see the tracker in"
            " Tobii's own manager, seat the participant in its view, then run 'metamerlab session"
            " resume'"
        )

    def _measure_offset(self) -> None:
        self._offset_s = self._desk.clock() - self._titta.get_system_timestamp() / 1e6

    def _sample(self, row: Mapping[str, Any]) -> GazeSample:
        display = self._desk.display
        raw_s = float(row["system_time_stamp"]) / 1e6
        seen = [eye for eye in ("left", "right") if row[f"{eye}_gaze_point_valid"]]
        place = [
            sum(float(row[f"{eye}_gaze_point_on_display_area_{axis}"]) for eye in seen)
            / (len(seen) or math.nan)
            for axis in "xy"
        ]
        x_px, y_px = place[0] * display.width_px, place[1] * display.height_px
        return GazeSample(raw_s + self._offset_s, raw_s, x_px, y_px)


def _nothing(*_: object) -> None:
    """Nothing to do at a flip or a key."""


def _quality(found: Mapping[str, Any], viewing: Viewing) -> CalibrationResult:
    """Return the mean error of the calibration's own samples, over its points and both eyes."""
    errors_deg, points = list[float](), 0
    for point in found["points"]:
        target = _px(
            point["position_on_display_area_x"], point["position_on_display_area_y"], viewing
        )
        own = [
            viewing.angle_deg(_px(x, y, viewing), target)
            for eye in ("left", "right")
            for x, y in zip(
                point[f"samples_{eye}_position_on_display_area_x"],
                point[f"samples_{eye}_position_on_display_area_y"],
                strict=True,
            )
            if math.isfinite(x) and math.isfinite(y)
        ]
        points += bool(own)
        errors_deg += own
    mean_deg = sum(errors_deg) / len(errors_deg) if errors_deg else math.nan
    return CalibrationResult(mean_deg, math.nan, points)


def _px(x: float, y: float, viewing: Viewing) -> tuple[float, float]:
    return float(x) * viewing.width_px, float(y) * viewing.height_px
