"""Gaze that a displacement follows, so that pictures do not swim, and noise carried along a clip.

A displacement is as wide as pools are, and pools move with the gaze: content would creep by about
4 % of the gaze's own way. Within a fixation nothing should move. So the field's gaze rests while
the eye stays near it, and jumps when the eye jumps: changes during a saccade, and shortly after it,
go unseen (Loschky and Wolverton 2007).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.geometry import Geometry, check_gaze
from pipeline.frame import Floats


@dataclass(frozen=True)
class SteadyGaze:
    """Gaze of the field after some samples of the eye's; `after` gives the next one.

    Both gazes hold while the eye is lost, and stay at a pole while it is beyond it.

    Parameters
    ----------
    geometry : Geometry
    eye_px : (x, y)
        Where the eye was last found; given as not a number: the middle of the picture.
    field_px : (x, y), optional
        The gaze to compute displacements for; by default the eye's.
    rest_deg : float
        As long as the eye is no farther from the field's gaze than this, the field rests.
    jump_deg_per_s : float
        A faster eye makes a saccade: the field goes with it at once.
    follow_s : float
        Beyond `rest_deg` without a saccade, as when the eye pursues something, the field comes
        after, the distance in excess falling to 1/e in this time.
    lost_s : float
        How long the eye has been lost.
    """

    geometry: Geometry
    eye_px: tuple[float, float]
    field_px: tuple[float, float] | None = None
    rest_deg: float = 1.0
    jump_deg_per_s: float = 30.0
    follow_s: float = 0.5
    lost_s: float = 0.0

    def __post_init__(self) -> None:
        middle = self.geometry.width_px / 2, self.geometry.height_px / 2
        eye = check_gaze(self.geometry, self.eye_px if _is_found(self.eye_px) else middle)
        object.__setattr__(self, "eye_px", eye)
        object.__setattr__(self, "field_px", self.field_px or eye)
        if not (self.rest_deg >= 0 and self.jump_deg_per_s > 0 and self.follow_s > 0):
            raise InputError(
                "rest_deg must be at least 0, jump_deg_per_s and follow_s above 0"
                f" (got {self.rest_deg}, {self.jump_deg_per_s}, {self.follow_s})"
            )

    def after(self, eye_px: tuple[float, float], elapsed_s: float) -> SteadyGaze:
        """Return the state after one more sample, `elapsed_s` after the last.

        A sample of no later time changes nothing. An eye that is lost is not a number.
        """
        if not elapsed_s > 0:
            return self
        elapsed_s += self.lost_s
        if not _is_found(eye_px):
            return replace(self, lost_s=elapsed_s)
        eye = check_gaze(self.geometry, eye_px)
        field = self.field_px or eye
        if self._angle(self.eye_px, eye) / elapsed_s > self.jump_deg_per_s:
            field = eye
        else:
            away = self._angle(field, eye)
            if away > self.rest_deg:
                share = (1 - self.rest_deg / away) * (1 - math.exp(-elapsed_s / self.follow_s))
                field = self._between(field, eye, share)
        return replace(self, eye_px=eye, field_px=field, lost_s=0.0)

    def _angle(self, a: tuple[float, float], b: tuple[float, float]) -> float:
        """Angle of two places, degrees; without arrays, for every frame of a live picture."""
        (ax, ay, az), (bx, by, bz) = self.geometry.ray(*a), self.geometry.ray(*b)
        sine = math.hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
        return math.degrees(math.atan2(sine, ax * bx + ay * by + az * bz))

    def _between(
        self, start: tuple[float, float], end: tuple[float, float], share: float
    ) -> tuple[float, float]:
        across = end[0] - start[0]
        if self.geometry.wraps:  # the short way round
            width = self.geometry.width_px
            across = (across + width / 2) % width - width / 2
        x, y = start[0] + share * across, start[1] + share * (end[1] - start[1])
        return (x % self.geometry.width_px if self.geometry.wraps else x), y


def _is_found(eye_px: tuple[float, float]) -> bool:
    return all(map(math.isfinite, eye_px))


def carried(shift_px: NDArray[np.floating] | None, flow_px: NDArray[np.floating]) -> Floats:
    """Add one frame's motion to how far noise has been carried.

    Parameters
    ----------
    shift_px : ndarray of shape (H, W, 2), optional
        What this returned for the frame before; None for the first.
    flow_px : ndarray of shape (H, W, 2)
        For each pixel of the frame at hand, where it is less where it was a frame ago.

    Returns
    -------
    ndarray of shape (H, W, 2)
        The `noise_shift_px` of the frame at hand.
    """
    height, width = flow_px.shape[:2]
    if flow_px.shape != (height, width, 2) or not np.isfinite(flow_px).all():
        raise InputError(f"flow_px must be finite, of shape (H, W, 2) (got {flow_px.shape})")
    if shift_px is None:
        return flow_px.astype(np.float64)
    if shift_px.shape != flow_px.shape:
        raise InputError(f"shift_px must have shape {flow_px.shape} (got {shift_px.shape})")
    rows, columns = np.mgrid[:height, :width]
    before_x = np.clip(np.rint(columns - flow_px[..., 0]), 0, width - 1).astype(np.intp)
    before_y = np.clip(np.rint(rows - flow_px[..., 1]), 0, height - 1).astype(np.intp)
    return np.asarray(flow_px + shift_px[before_y, before_x])
