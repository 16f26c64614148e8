"""Measures this display's flips, and writes the report that session headers point to."""

from __future__ import annotations

import itertools
import math
import platform
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

from pipeline.gl.context import describe
from protocols.disk.hashing import canonical_json, sha256_bytes, sha256_json
from protocols.display import Display
from protocols.errors import StudyError
from protocols.journal import DisplayReport, UtcTime
from protocols.latency import LatencySummary
from protocols.revision import code_revision, package_version
from protocols.units import Count, Hertz, Model, Name, Sha256
from study_app.desktop.vsync import MeasuredIntervals, judge, summarise_flips
from study_app.desktop.window import Window
from study_app.pacing import cannot_keep_up
from study_app.recorder import write_numbered

REPORTS = "display-reports"
"""Folder of reports, beside the studies' sessions."""
WARM_UP_FLIPS = 10
SESSION_FLIPS = 120
"""Flips measured before every session: two seconds at 60 Hz."""
REHEARSAL_FLIPS = 30
"""As many where a timer paces the flips: it is no display, and there is nothing to vouch for."""


class DisplayCheck(Model):
    """One measurement of one display."""

    format: Literal[1] = 1
    at: UtcTime
    display: Name
    display_sha256: Sha256
    monitor: str
    monitor_mm: tuple[Count, Count]
    """As the monitor says of itself; 0 where it says nothing."""
    mode_px: tuple[Count, Count]
    mode_hz: float
    """As the system names the mode; 0 where it does not."""
    nominal_hz: Hertz
    measured_hz: Hertz
    evidence: str
    """Evidence for the stamps: `glXGetSyncValuesOML`, `fence`, `unverified`, `software timer`."""
    intervals: MeasuredIntervals
    every_interval_s: tuple[float, ...]
    renderer: str
    revision: str
    platform: str
    gaze_to_flip: LatencySummary | None = None
    """Latency of a synthetic gaze of 1000 Hz, drawn at no cost; None: not measured."""


def check_display(
    window: Window,
    wall_clock: Callable[[], str],
    flips: int = SESSION_FLIPS,
) -> DisplayCheck:
    """Flip, and judge the intervals.

    Raises
    ------
    StudyError
        If the swaps do not wait for the display, or its rate is another one.
    """
    display, ctx = window.display, window.ctx
    stamps: list[float] = []
    evidence = window.evidence
    for number in range(flips + WARM_UP_FLIPS):
        grey = 0.5 + 0.01 * (number % 2)  # changes, so that nothing can be left out
        ctx.clear(grey, grey, grey, 1.0)
        stamp = window.flip()
        if number >= WARM_UP_FLIPS:
            stamps.append(stamp.t_s)
            evidence = stamp.evidence
    measured = summarise_flips(stamps, display.refresh_hz)
    evidence = judge(measured, display, evidence)
    return DisplayCheck(
        at=wall_clock(),
        display=display.name,
        display_sha256=sha256_json(display),
        monitor=window.monitor_name,
        monitor_mm=window.monitor_mm,
        mode_px=window.size,
        mode_hz=window.mode_hz,
        nominal_hz=display.refresh_hz,
        measured_hz=display.refresh_hz if window.pacing == "software" else measured.refresh_hz,
        evidence=evidence,
        intervals=MeasuredIntervals(
            **{name: round(value, 9) for name, value in measured.model_dump().items()}
        ),
        every_interval_s=tuple(
            round(late - early, 6) for early, late in itertools.pairwise(stamps)
        ),
        renderer=str(describe(ctx)),
        revision=f"{package_version()} {code_revision()}",
        platform=platform.platform(),
    )


def shortfall(check: DisplayCheck) -> str:
    """Message about a display that was late at most of its flips; empty for any other."""
    gaps_s = check.every_interval_s
    if 2 * check.intervals.missed <= len(gaps_s):
        return ""
    refreshes = sum(max(1, round(gap_s * check.nominal_hz)) for gap_s in gaps_s)
    words = cannot_keep_up(check.nominal_hz, refreshes - len(gaps_s), refreshes)
    return (
        f"display {check.display!r}: {words}; close what else runs, set a lower refresh rate or"
        " resolution and name that display, or take a faster machine"
    )


def write_display_report(root: Path, check: DisplayCheck) -> DisplayReport:
    """Write a report below the folder of sessions, never over another.

    Raises
    ------
    StudyError
        If the folder cannot be written.
    """
    folder = root / REPORTS
    data = canonical_json(check) + b"\n"
    stem = f"{check.display}-{check.at.translate({ord(c): None for c in ':-.'})}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path = write_numbered(folder / stem, ".json", data)
    except OSError as error:
        raise StudyError(f"{folder}: must be a writable folder ({error.strerror})") from None
    return DisplayReport(file=f"{REPORTS}/{path.name}", sha256=sha256_bytes(data))


def display_findings(check: DisplayCheck, display: Display) -> Sequence[tuple[str, str]]:
    """Return the findings for an operator, as (name, sentence)."""
    measured = check.intervals
    lines = [
        ("display", f"{check.display}, monitor {check.monitor or 'without a name'}"),
        ("mode", f"{check.mode_px[0]}x{check.mode_px[1]}, {check.mode_hz or 0:g} Hz as named"),
        ("measured", f"{check.measured_hz:.3f} Hz over {measured.flips} flips"),
        (
            "intervals",
            f"sd {1e3 * measured.sd_s:.3f} ms, {1e3 * measured.min_s:.2f} to"
            f" {1e3 * measured.max_s:.2f} ms, {measured.missed} missed, {measured.doubled} doubled",
        ),
        ("evidence", f"{check.evidence}: {_MEANING[check.evidence]}"),
        ("renderer", check.renderer),
        *([] if check.gaze_to_flip is None else [("gaze", check.gaze_to_flip.words())]),
    ]
    across_mm, down_mm = check.monitor_mm
    if across_mm and down_mm and abs(math.log(across_mm / display.width_mm)) > 0.03:
        lines.append(
            (
                "size",
                f"the monitor says {across_mm} x {down_mm} mm, the display file"
                f" {display.width_mm:g} x {display.height_mm:g} mm: measure it with a ruler",
            )
        )
    return lines


_MEANING = {
    "glXGetSyncValuesOML": "the driver counts the refreshes",
    "fence": "swaps are waited for, and their intervals fit the display",
    "unverified": "swaps are waited for, but their intervals do not fit the display",
    "software timer": "a timer paces the flips; not for data",
}
