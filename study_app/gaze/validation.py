"""Nine points: how accurate and how precise a gaze source is, in degrees, on this display."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from protocols.display import Viewing, angle_between_deg
from protocols.errors import StudyError
from protocols.study_file.session_schema import Gaze
from study_app.gaze.source import CalibrationResult, GazeSample, GazeSource

SETTLE_S = 0.6
"""The eye's way to a target: samples before are left out."""
HOLD_S = 0.6
"""Time for which samples count at each target."""
SCREEN_SHARE = 0.8
"""Targets span this share of the screen."""
MIN_VALID_SHARE = 0.5
"""Share of the samples at a target that must see the eye."""


@dataclass(frozen=True)
class PointQuality:
    """Quality of gaze at one target."""

    x_px: float
    y_px: float
    samples: int
    """With the eye seen."""
    accuracy_deg: float
    """Angle between the mean direction of gaze and the target; nan without samples."""
    precision_deg: float
    """Root mean square of the steps between successive samples; nan without two in a row."""
    sd_deg: float = math.nan
    """Standard deviation, of azimuth and elevation together; nan without samples."""
    lost_share: float = 1.0
    """Share of the samples that did not see the eye."""


def nine_points_px(viewing: Viewing) -> list[tuple[float, float]]:
    """Return the targets, the centre first, then row by row."""
    across = [viewing.width_px / 2 * (1 + SCREEN_SHARE * side) for side in (-1, 0, 1)]
    down = [viewing.height_px / 2 * (1 + SCREEN_SHARE * side) for side in (-1, 0, 1)]
    grid = [(x, y) for y in down for x in across]
    return [grid[4], *grid[:4], *grid[5:]]


def point_quality(
    viewing: Viewing, target_px: tuple[float, float], samples: Sequence[GazeSample]
) -> PointQuality:
    """Judge the samples at one target.

    Notes
    -----
    As ETDQualitizer has it, in Fick angles: accuracy, RMS-S2S, STD and loss from invalid
    samples. Steps between samples on both sides of a loss are left out.
    """
    seen = [sample.valid for sample in samples]
    if not any(seen):
        return PointQuality(*target_px, 0, math.nan, math.nan)
    sights = np.array(
        [viewing.sight(s.x_px, s.y_px) if s.valid else (math.nan,) * 3 for s in samples]
    )
    x, y, z = sights.T
    angles_deg = np.degrees([np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))])
    steps = np.square(np.diff(angles_deg)).sum(axis=0)
    direction = np.nanmean(sights / np.linalg.norm(sights, axis=1, keepdims=True), axis=0)
    return PointQuality(
        *target_px,
        samples=sum(seen),
        accuracy_deg=angle_between_deg(tuple(direction), viewing.sight(*target_px)),
        precision_deg=float(np.sqrt(np.nanmean(steps))) if np.isfinite(steps).any() else math.nan,
        sd_deg=float(np.hypot(*np.nanstd(angles_deg, axis=1))),
        lost_share=1 - sum(seen) / len(seen),
    )


class EyeUnseenError(StudyError):
    """An eye that was not seen at a target: seated better, or calibrated again, it may be."""


def summarise_targets(points: Sequence[PointQuality]) -> CalibrationResult:
    """Return the mean over the targets.

    Raises
    ------
    EyeUnseenError
        If the eye was not seen at a target.
    """
    unseen = [f"({p.x_px:.0f}, {p.y_px:.0f})" for p in points if math.isnan(p.precision_deg)]
    if unseen:
        raise EyeUnseenError(
            f"gaze: the eye must be seen at every target (not at {', '.join(unseen)} px); seat"
            " the participant in the tracker's view and calibrate it again"
        )
    return CalibrationResult(
        accuracy_deg=float(np.mean([point.accuracy_deg for point in points])),
        precision_deg=float(np.mean([point.precision_deg for point in points])),
        points=len(points),
        sd_deg=float(np.mean([point.sd_deg for point in points])),
        lost_share=float(np.mean([point.lost_share for point in points])),
    )


def smallest_window_deg(result: CalibrationResult) -> float:
    """Return the smallest fixation window that a fixating eye does not leave by the tracker alone.

    The mean error, and twice the noise on top.
    """
    return result.accuracy_deg + 2 * result.precision_deg


def unfit_gaze(rules: Gaze, result: CalibrationResult) -> str:
    """Return the reason why a block must not start with this validation; empty: it may."""
    if result.accuracy_deg > rules.accuracy_max_deg:
        return (
            f"gaze: the mean error must be at most accuracy_max_deg = {rules.accuracy_max_deg:g}"
            f" deg (got {result.accuracy_deg:.2f} deg); calibrate the tracker again"
        )
    if rules.window_deg < smallest_window_deg(result):
        return (
            f"gaze: window_deg = {rules.window_deg:g} must be at least the mean error and twice"
            f" the noise, {smallest_window_deg(result):.2f} deg (accuracy"
            f" {result.accuracy_deg:.2f}, precision {result.precision_deg:.2f} deg); calibrate"
            " again, or widen the window"
        )
    return ""


def validate(
    source: GazeSource,
    viewing: Viewing,
    look_at: Callable[[tuple[float, float], float, Callable[[], None]], bool],
    on_target: Callable[[tuple[float, float]], None] = lambda _: None,
) -> list[PointQuality] | None:
    """Show nine targets and judge the gaze at each.

    Parameters
    ----------
    source : GazeSource
        Open.
    viewing : Viewing
        Geometry of the display.
    look_at : callable
        Shows a target for a while and calls back at every flip; False where someone quit.
    on_target : callable
        Told every target before it is shown, for eyes that exist only in numbers.

    Returns
    -------
    list of PointQuality, or None where someone quit.

    Raises
    ------
    EyeUnseenError
        If nothing is sent.
    """
    points = []
    for target in nine_points_px(viewing):
        on_target(target)
        kept: list[GazeSample] = []
        for duration_s, into in ((SETTLE_S, []), (HOLD_S, kept)):
            if not look_at(target, duration_s, partial(_collect, source, into)):
                return None
        if not kept:
            raise EyeUnseenError(
                "gaze: the tracker must send samples (none came at a target); see its cable and its"
                " program, and calibrate it again"
            )
        quality = point_quality(viewing, target, kept)
        if quality.samples < MIN_VALID_SHARE * len(kept):
            quality = replace(quality, accuracy_deg=math.nan, precision_deg=math.nan)
        points.append(quality)
    return points


def _collect(source: GazeSource, into: list[GazeSample]) -> None:
    into.extend(source.poll())
