"""Pixels on a flat screen and degrees of visual angle, exact off the centre too.

A direction is given by azimuth (right) and elevation (down): the angles of its projections on
the horizontal and the vertical plane, so that each is a function of one pixel coordinate. The
angle between two directions is measured between the lines of sight themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from protocols.display import Display


@dataclass(frozen=True)
class Viewing:
    """The geometry of one display before the eye; pixel (0, 0) is its upper left corner."""

    width_px: int
    height_px: int
    pitch_x_mm: float
    pitch_y_mm: float
    distance_mm: float

    @classmethod
    def of(cls, display: Display) -> Viewing:
        """Return the geometry of a display."""
        return cls(
            display.width_px,
            display.height_px,
            display.pitch_x_mm,
            display.pitch_y_mm,
            display.distance_mm,
        )

    def sight(self, x_px: float, y_px: float) -> tuple[float, float, float]:
        """Return the vector from the eye to a point of the screen, in millimetres."""
        return (
            (x_px - self.width_px / 2) * self.pitch_x_mm,
            (y_px - self.height_px / 2) * self.pitch_y_mm,
            self.distance_mm,
        )

    def to_deg(self, x_px: float, y_px: float) -> tuple[float, float]:
        """Return (azimuth, elevation) of a point: 0, 0 at the centre, right and down positive."""
        x_mm, y_mm, z_mm = self.sight(x_px, y_px)
        return math.degrees(math.atan(x_mm / z_mm)), math.degrees(math.atan(y_mm / z_mm))

    def to_px(self, x_deg: float, y_deg: float) -> tuple[float, float]:
        """Return the point of the screen at (azimuth, elevation); exact inverse of `to_deg`."""
        return (
            self.width_px / 2 + self.distance_mm * math.tan(math.radians(x_deg)) / self.pitch_x_mm,
            self.height_px / 2 + self.distance_mm * math.tan(math.radians(y_deg)) / self.pitch_y_mm,
        )

    def angle_to(self, x_px: float, y_px: float) -> Callable[[float, float], float]:
        """Return a function for the visual angle from any point of the screen to this one."""
        middle_x_px, middle_y_px = self.width_px / 2, self.height_px / 2
        pitch_x_mm, pitch_y_mm, az = self.pitch_x_mm, self.pitch_y_mm, self.distance_mm
        bx, by, bz = self.sight(x_px, y_px)
        azbx, azby, azbz = az * bx, az * by, az * bz
        sqrt, atan2, degrees = math.sqrt, math.atan2, math.degrees

        def angle_deg(x_px: float, y_px: float) -> float:  # as below, for thousands of samples
            ax, ay = (x_px - middle_x_px) * pitch_x_mm, (y_px - middle_y_px) * pitch_y_mm
            x, y, z = ay * bz - azby, azbx - ax * bz, ax * by - ay * bx
            return degrees(atan2(sqrt(x * x + y * y + z * z), ax * bx + ay * by + azbz))

        return angle_deg

    def angle_deg(self, a_px: tuple[float, float], b_px: tuple[float, float]) -> float:
        """Return the visual angle between two points of the screen."""
        return angle_between_deg(self.sight(*a_px), self.sight(*b_px))


def angle_between_deg(a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
    """Return the angle between two vectors; accurate for small angles as well."""
    (ax, ay, az), (bx, by, bz) = a, b
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    cross = math.sqrt(x * x + y * y + z * z)
    return math.degrees(math.atan2(cross, ax * bx + ay * by + az * bz))
