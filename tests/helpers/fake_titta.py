"""Stands for TittaPy, and for a Tobii behind it, at the pace of a test's clock."""

from __future__ import annotations

from collections import deque

import numpy as np

RATE_HZ = 120.0
EPOCH_US = 5_000_000_000


class FakeTitta:
    """The module, with one tracker."""

    def __init__(self, eye, clock, trackers=1) -> None:
        self.eye, self.clock, self.trackers = eye, clock, trackers
        self.rows: list[tuple] = []
        self.said: list[str] = []
        self.calls: list[tuple] = []
        self.results: deque = deque()
        self.fails = ""
        self.model = "Pro Spectrum"
        self._next, self._away = 0, False

    def find_all_eye_trackers(self):
        return [{"address": f"tet-tcp://{n}"} for n in range(self.trackers)]

    def EyeTracker(self, address):  # noqa: N802  (their name)
        self.calls.append(("EyeTracker", address))
        return self

    def get_system_timestamp(self):
        return self.clock() * 1e6 + EPOCH_US

    def get_SDK_version(self):  # noqa: N802
        return "2.1.0.1"

    def start(self, stream):
        self.calls.append(("start", stream))

    def stop(self, stream):
        self._answers()
        self.calls.append(("stop", stream))

    def _answers(self) -> None:
        """As Tobii's library where nothing answers."""
        if self.eye.now(self.clock()) in ("break", "death"):
            raise RuntimeError("Error code 7: TOBII_RESEARCH_STATUS_SE_CONNECTION_FAILED")

    def advance(self, now_s: float) -> int:
        """Have all samples up to a time; return how many."""
        wanted, away = int(now_s * RATE_HZ) + 1, self.eye.now(now_s) in ("break", "death")
        if away != self._away:
            self.said.append("connection_lost" if away else "connection_restored")
            self._away = away
        count = 0
        for number in range(self._next, wanted):
            t_s = number / RATE_HZ
            if away:
                continue
            place, nan = self.eye.place(t_s), float("nan")
            x, y = (place[0] / 1920, place[1] / 1080) if place else (nan, nan)
            stamp = round(t_s * 1e6) + EPOCH_US
            # The right eye is beside the left, and is lost every third time.
            right = place is not None and number % 3 != 0
            shift = 0.002 if right else 0.0
            self.rows.append((
                stamp + 77, stamp, x - shift, y, place is not None,
                x + shift if right else nan, y if right else nan, right,
            ))  # fmt: skip
            count += 1
        self._next = wanted
        return count

    def consume_N(self, stream, _n):  # noqa: N802
        if stream == "notification":
            told, self.said = self.said, []
            return {"notification_type": told}
        rows, self.rows = self.rows, []
        names = ["device_time_stamp", "system_time_stamp"] + [
            f"{eye}_gaze_point_{what}"
            for eye in ("left", "right")
            for what in ("on_display_area_x", "on_display_area_y", "valid")
        ]
        columns = list(zip(*rows, strict=True)) or [()] * len(names)
        return {name: np.array(each) for name, each in zip(names, columns, strict=True)}

    def _later(self, action, more=None) -> None:
        self._answers()
        self.calls.append((action,))
        status = {"status": int(action == self.fails), "status_string": f"{action} failed"}
        self.results.extend([None, status | {"calibration_result": more}])

    def enter_calibration_mode(self, _monocular):
        self.points = []
        self._later("enter")

    def calibration_collect_data(self, point):
        self.points.append(point)
        self._later("collect")

    def calibration_compute_and_apply(self):
        found = [
            {
                "position_on_display_area_x": x, "position_on_display_area_y": y,
                "samples_left_position_on_display_area_x": [x + 0.01, x + 0.01],
                "samples_left_position_on_display_area_y": [y, y],
                "samples_right_position_on_display_area_x": [float("nan")],
                "samples_right_position_on_display_area_y": [float("nan")],
            }
            for x, y in self.points
        ]  # fmt: skip
        self._later("compute", {"points": found})

    def leave_calibration_mode(self, _force):
        self._answers()
        self.calls.append(("leave",))

    def calibration_retrieve_result(self):
        return self.results.popleft() if self.results else None
