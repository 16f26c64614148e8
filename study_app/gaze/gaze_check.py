"""Has trackers calibrated, and validates gaze before a block, a few times if it must."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from protocols.errors import StudyError
from protocols.journal import Calibration
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import Gaze
from protocols.viewing import Viewing
from study_app.gaze.source import CalibrationResult, GazeSource, LookAt, Tracker
from study_app.gaze.validation import EyeUnseenError, nine_points_px, unfit_gaze
from study_app.recorder import Recorder
from study_app.stage import Page, Stage

VALIDATIONS_MAX = 3
"""Poor validations in a row before the run ends; calibrate the tracker, and resume."""
Validate = Callable[[], CalibrationResult | None]
"""Shows the targets of a validation; None where the participant or operator quit."""


@dataclass
class Targets:
    """The targets that a tracker asks for, in a window that is opened after it."""

    show: LookAt | None = None
    """Function that shows them, once it is there."""
    quit: bool = False
    """True if someone pressed a quit key meanwhile."""

    def __call__(
        self,
        place_px: tuple[float, float] | None,
        duration_s: float,
        poll: Callable[[], None],
        on_key: Callable[[str], None],
    ) -> bool:
        """Show a target; False where someone quit."""
        assert self.show is not None, "no block has begun"
        self.quit = not self.show(place_px, duration_s, poll, on_key) or self.quit
        return not self.quit


@dataclass
class TrackerCalibration:
    """Has a tracker calibrated before its first validation, and again where that was poor."""

    gaze: GazeSource
    targets: Targets
    rules: Gaze
    viewing: Viewing
    recorder: Recorder
    fit: bool = False
    """True if the last validation was good enough."""

    def __call__(self) -> bool:
        """Calibrate, or check drift, if the tracker can; False where someone quit."""
        if not isinstance(self.gaze, Tracker):
            return True
        middle_px = self.viewing.width_px / 2, self.viewing.height_px / 2
        drift_deg = self.gaze.check_drift(middle_px) if self.fit else None
        if drift_deg is not None:
            found = f"{drift_deg:.2f} deg" if math.isfinite(drift_deg) else "no fixation"
            self.recorder.note(f"gaze: the tracker's drift check found {found}")
        if not self.fit or (drift_deg or 0.0) > self.rules.accuracy_max_deg:
            own = None if self.targets.quit else self.gaze.calibrate(nine_points_px(self.viewing))
            if own is not None:
                error = f"{own.accuracy_deg:.2f} deg at " if own.points else ""
                self.recorder.note(
                    f"gaze: the tracker's own calibration: {error}{own.points} valid points"
                )
        stopped, self.targets.quit = self.targets.quit, False
        return not stopped


class GazeCheck:
    """Has gaze validated once per block and run of the program."""

    def __init__(
        self, validate: Validate, protocol: StudyProtocol, recorder: Recorder, stage: Stage
    ) -> None:
        self._validate, self._protocol = validate, protocol
        self._recorder, self._stage = recorder, stage
        self._passed: int | None = None

    def passed(self, block: int) -> bool:
        """Validate, where it was not yet done for `block`; False where the session stops.

        Where gaze is poor, or the eye was not seen, calibration is offered again.

        Raises
        ------
        StudyError
            If the gaze stays too poor for the protocol's window.
        """
        if self._passed == block:
            return True
        for tries_left in reversed(range(VALIDATIONS_MAX)):
            try:
                result = self._validate()
            except EyeUnseenError as error:
                complaint = str(error)
            else:
                if result is None:
                    return False
                self._record(result)
                complaint = unfit_gaze(self._protocol.gaze, result)
            if not complaint:
                self._passed = block
                return True
            self._recorder.note(complaint)
            if not tries_left or not self._again(complaint):
                raise StudyError(complaint)
        raise AssertionError("the last validation passes or raises")

    def _record(self, result: CalibrationResult) -> None:
        self._recorder.append(
            Calibration(
                **self._recorder.stamps(),
                accuracy_deg=round(result.accuracy_deg, 4),
                precision_deg=round(result.precision_deg, 4),
                points=result.points,
                sd_deg=_known(result.sd_deg),
                lost_share=_known(result.lost_share),
            )
        )

    def _again(self, complaint: str) -> bool:
        keys = self._protocol.response
        page = Page(
            "calibration",
            f"{complaint}\n\n{keys.continue_keys[0]}: again    {keys.quit_keys[0]}: stop",
            (*keys.continue_keys, *keys.quit_keys),
        )
        return self._stage.page(page).key in keys.continue_keys


def _known(value: float) -> float | None:
    return None if math.isnan(value) else round(value, 4)
