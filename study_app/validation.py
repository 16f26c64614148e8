"""Nine points: how accurate and how precise a gaze source is, in degrees, on this display."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from protocols.errors import StudyError
from protocols.session_schema import Gaze
from protocols.viewing import Viewing, angle_between_deg
from study_app.gaze.source import CalibrationResult, GazeSample, GazeSource

SETTLE_S = 0.6
"""The eye's way to a target: samples before are left out."""
HOLD_S = 0.6
"""How long samples count at each target."""
SCREEN_SHARE = 0.8
"""Targets span this share of the screen."""
MIN_VALID_SHARE = 0.5
"""Share of the samples at a target that must see the eye."""


@dataclass(frozen=True)
class PointQuality:
    """How well gaze met one target."""

    x_px: float
    y_px: float
    samples: int
    """With the eye seen."""
    accuracy_deg: float
    """Mean angle between gaze and target; nan without samples."""
    precision_deg: float
    """Root mean square of the angles between successive samples; nan without two."""


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
    Accuracy is the mean angle between the lines of sight to gaze and target, precision the root
    mean square of sample-to-sample angles (Holmqvist et al. 2012, "Eye tracker data quality").
    Angles between samples on both sides of a loss are left out.
    """
    target = viewing.sight(*target_px)
    sights = [viewing.sight(s.x_px, s.y_px) if s.valid else None for s in samples]
    errors = [angle_between_deg(sight, target) for sight in sights if sight is not None]
    steps = [
        angle_between_deg(early, late)
        for early, late in itertools.pairwise(sights)
        if early is not None and late is not None
    ]
    return PointQuality(
        *target_px,
        samples=len(errors),
        accuracy_deg=float(np.mean(errors)) if errors else math.nan,
        precision_deg=float(np.sqrt(np.mean(np.square(steps)))) if steps else math.nan,
    )


def summarise(points: Sequence[PointQuality]) -> CalibrationResult:
    """Return the mean over the targets.

    Raises
    ------
    StudyError
        If the eye was not seen at a target.
    """
    unseen = [f"({p.x_px:.0f}, {p.y_px:.0f})" for p in points if math.isnan(p.precision_deg)]
    if unseen:
        raise StudyError(
            f"gaze: the eye must be seen at every target (not at {', '.join(unseen)} px); seat"
            " the participant in the tracker's view and calibrate it again"
        )
    return CalibrationResult(
        accuracy_deg=float(np.mean([point.accuracy_deg for point in points])),
        precision_deg=float(np.mean([point.precision_deg for point in points])),
        points=len(points),
    )


def smallest_window_deg(result: CalibrationResult) -> float:
    """Return the smallest fixation window that a fixating eye does not leave by the tracker alone.

    The mean error, and twice the noise on top.
    """
    return result.accuracy_deg + 2 * result.precision_deg


def unfit_gaze(rules: Gaze, result: CalibrationResult) -> str:
    """Return why a block must not start with this validation; empty: it may."""
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
    """
    points = []
    for target in nine_points_px(viewing):
        on_target(target)
        kept: list[GazeSample] = []
        for duration_s, into in ((SETTLE_S, []), (HOLD_S, kept)):
            if not look_at(target, duration_s, partial(_collect, source, into)):
                return None
        quality = point_quality(viewing, target, kept)
        if quality.samples < MIN_VALID_SHARE * len(kept):
            quality = PointQuality(*target, quality.samples, math.nan, math.nan)
        points.append(quality)
    return points


def _collect(source: GazeSource, into: list[GazeSample]) -> None:
    into.extend(source.poll())
