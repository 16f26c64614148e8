"""The tracker: whether it can be reached, and what it sends in a second."""

from __future__ import annotations

import time

from protocols.display import Display
from protocols.errors import StudyError
from study_app.doctor.findings import FOR_SESSIONS, Finding, Status
from study_app.gaze.open_source import check_kind, open_gaze
from study_app.gaze.source import GazeSample, TrackerContext

LISTEN_S = 1.0
_FEWEST = 0.8
"""Share of the samples that should come, and of those that should see an eye."""


def check_tracker(specification: str, display: Display) -> Finding:
    """A gaze source, as ``--gaze`` names it, opened as a session opens it; it is not calibrated.

    Raises
    ------
    StudyError
        If there is no such kind.
    """
    check_kind(specification)
    middle_px = display.width_px / 2, display.height_px / 2
    desk = TrackerContext(
        display, time.monotonic, lambda: middle_px, display.refresh_hz, store=False
    )
    try:
        source = open_gaze(specification, desk)
    except StudyError as error:
        return Finding("tracker", Status.FAIL, str(error), "see docs/trackers.md", FOR_SESSIONS)
    try:
        samples, until_s = list[GazeSample](), time.monotonic() + LISTEN_S
        source.poll()  # what came while it was opened
        while time.monotonic() < until_s:
            time.sleep(1 / display.refresh_hz)
            samples += source.poll()
        info, told = source.info(), [*source.info().notes, *source.news()]
    finally:
        source.close()
    seen = sum(sample.valid for sample in samples) / max(1, len(samples))
    found = (
        f"{info.source} {info.description}: {len(samples)} samples in {LISTEN_S:g} s at"
        f" {info.rate_hz:.4g} Hz, {100 * seen:.0f} % of them with an eye"
    )
    if told:
        found += "; " + "; ".join(told)
    if len(samples) < _FEWEST * info.rate_hz * LISTEN_S or seen < _FEWEST:
        cure = "seat someone before it, and see its own program; a busy machine sends late"
        return Finding("tracker", Status.WARN, found, cure, FOR_SESSIONS)
    return Finding("tracker", Status.PASS, found, "", FOR_SESSIONS)
