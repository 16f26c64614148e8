"""Validates the gaze source before a block, a few times if it must."""

from __future__ import annotations

import math
from collections.abc import Callable

from protocols.errors import StudyError
from protocols.journal import Calibration, Note
from protocols.schema import StudyProtocol
from study_app.gaze.source import CalibrationResult
from study_app.recorder import Recorder
from study_app.stage import Page, Stage
from study_app.validation import unfit_gaze

VALIDATIONS_MAX = 3
"""Poor validations in a row before the run ends; calibrate the tracker, and resume."""
Validate = Callable[[], CalibrationResult | None]
"""Shows the targets of a validation; None where the participant or operator quit."""


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

        Raises
        ------
        StudyError
            If the gaze stays too poor for the protocol's window.
        """
        if self._passed == block:
            return True
        for tries_left in reversed(range(VALIDATIONS_MAX)):
            result = self._validate()
            if result is None:
                return False
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
            complaint = unfit_gaze(self._protocol.gaze, result)
            if not complaint:
                self._passed = block
                return True
            self._recorder.append(Note(**self._recorder.stamps(), text=complaint))
            if not tries_left or not self._again(complaint):
                raise StudyError(complaint)
        raise AssertionError("the last validation passes or raises")

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
