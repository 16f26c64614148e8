"""Has trackers calibrated, and validates gaze before a block, a few times if it must."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from protocols.display import Viewing
from protocols.errors import StudyError
from protocols.journal import Calibration
from study_app.gaze.simulated import SimulatedGaze
from study_app.gaze.source import CalibrationResult, GazeSource, LookAt, Tracker
from study_app.gaze.validation import (
    EyeUnseenError,
    nine_points_px,
    summarise_targets,
    unfit_gaze,
    validate,
)
from study_app.recorder import Recorder
from study_app.session_setup import SessionListener, SessionSetup
from study_app.stage import Page, Stage

VALIDATIONS_MAX = 3
"""Poor validations in a row before the run ends; calibrate the tracker, and resume."""


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


class GazeCheck:
    """Has gaze calibrated and validated once per block and run of the program.

    A tracker is calibrated before its first validation, and again where that was poor.

    Parameters
    ----------
    gaze : GazeSource
        Open.
    setup : SessionSetup
        With the rules of gaze, and the display.
    stage, recorder : Stage, Recorder
        Of the session.
    targets : Targets
        Shows them, in the stage's window.
    listener : SessionListener, optional
        Told every validation.
    """

    def __init__(
        self,
        gaze: GazeSource,
        setup: SessionSetup,
        stage: Stage,
        recorder: Recorder,
        targets: Targets,
        listener: SessionListener | None = None,
    ) -> None:
        self._gaze, self._study = gaze, setup.study
        self._viewing, self._targets = Viewing.of(setup.display), targets
        self._stage, self._recorder = stage, recorder
        self._listener = listener or SessionListener()
        self._fit = False  # the last validation was good enough
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
                complaint = unfit_gaze(self._study.gaze, result)
            if not complaint:
                self._passed = block
                return True
            self._recorder.note(complaint)
            if not tries_left or not self._again(complaint):
                raise StudyError(complaint)
        raise AssertionError("the last validation passes or raises")

    def _validate(self) -> CalibrationResult | None:
        """Calibrate where it must be, and show the targets; None where someone quit."""
        gaze, viewing, show = self._gaze, self._viewing, self._targets.show
        assert show is not None, "no block has begun"

        def on_target(target_px: tuple[float, float]) -> None:
            if isinstance(gaze, SimulatedGaze):
                gaze.look_at(viewing.to_deg(*target_px))

        if not self._calibrate():
            return None
        points = validate(
            gaze,
            viewing,
            lambda place_px, duration_s, poll: show(place_px, duration_s, poll, lambda _: None),
            on_target,
        )
        if isinstance(gaze, SimulatedGaze):
            gaze.look_at(None)
        if points is None:
            return None
        self._fit = False  # an eye that is not seen needs a calibration too
        result = summarise_targets(points)
        self._fit = not unfit_gaze(self._study.gaze, result)
        self._listener.on_validation(points, result)
        return result

    def _calibrate(self) -> bool:
        """Calibrate, or check drift, if the tracker can; False where someone quit."""
        gaze, viewing, targets = self._gaze, self._viewing, self._targets
        if not isinstance(gaze, Tracker):
            return True
        middle_px = viewing.width_px / 2, viewing.height_px / 2
        drift_deg = gaze.check_drift(middle_px) if self._fit else None
        if drift_deg is not None:
            found = f"{drift_deg:.2f} deg" if math.isfinite(drift_deg) else "no fixation"
            self._recorder.note(f"gaze: the tracker's drift check found {found}")
        if not self._fit or (drift_deg or 0.0) > self._study.gaze.accuracy_max_deg:
            own = None if targets.quit else gaze.calibrate(nine_points_px(viewing))
            if own is not None:
                error = f"{own.accuracy_deg:.2f} deg at " if own.points else ""
                self._recorder.note(
                    f"gaze: the tracker's own calibration: {error}{own.points} valid points"
                )
        stopped, targets.quit = targets.quit, False
        return not stopped

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
        keys = self._study.response
        page = Page(
            "calibration",
            f"{complaint}\n\n{keys.continue_keys[0]}: again    {keys.quit_keys[0]}: stop",
            (*keys.continue_keys, *keys.quit_keys),
        )
        return self._stage.page(page).key in keys.continue_keys


def _known(value: float) -> float | None:
    return None if math.isnan(value) else round(value, 4)
