"""A display as data: its pixels, its place before the eye, its time base; degrees seen on it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field, PrivateAttr, model_validator

from protocols.errors import shortest
from protocols.plausible_numbers import hardly_meant
from protocols.units import Hertz, Luminance, Millimetres, Model, Name, Pixels, Positive

FRAME_TOLERANCE = 1e-6
"""Largest distance, in frames, of a duration from a whole number of them."""
COMMON_PITCH_MM = 25.4 / 96
"""Size of a pixel of a common screen, of 96 an inch: 24 inches of 1920 x 1080 have .277 mm."""
COMMON_RATES_HZ = (60.0, 72.0, 75.0, 90.0, 100.0, 120.0, 144.0, 165.0, 240.0)


class Display(Model):
    """One display at one viewing distance, in one mode."""

    name: Name
    """Its name in manifests and journals."""
    description: str = ""
    """Text for readers."""
    width_px: Pixels
    """Width in the mode it runs in."""
    height_px: Pixels
    """Height in the mode it runs in."""
    width_mm: Millimetres
    """Visible area, measured with a ruler."""
    height_mm: Millimetres
    """Visible area, measured with a ruler."""
    distance_mm: Millimetres
    """Distance from the eye to the screen's centre, perpendicular to the screen."""
    refresh_hz: Hertz
    """Nominal refresh rate. Times are counted in its refreshes."""
    refresh_tolerance_share: Annotated[float, Field(ge=1e-6, le=0.02)] = 0.005
    """Largest difference between measured and nominal rate."""
    clip_memory_mib: Positive = 2048
    """Graphics memory for stimuli: the trial shown and the next one."""
    monitor: str = ""
    """The system's name of the monitor. Default: the primary one."""
    peak_cd_m2: Luminance | None = None
    """Luminance of white. Default: not measured."""
    black_cd_m2: Luminance | None = None
    """Luminance of black. Default: not measured."""
    gamma: Annotated[float, Field(ge=0.1, le=10)] | None = None
    """Measured with a photometer. Default: not measured."""
    _tolerance_s: float = PrivateAttr(default=0.0)

    @model_validator(mode="after")
    def _square_pixels(self) -> Display:
        across, down = self.width_mm / self.width_px, self.height_mm / self.height_px
        if abs(across / down - 1) > 0.02:
            asked = hardly_meant("pitch_mm", self.width_mm, per=self.width_px)
            key = "width_mm" if asked else "height_mm"
            asked = asked or hardly_meant("pitch_mm", self.height_mm, per=self.height_px)
            raise ValueError(
                f"pixels must be square within 2 % (got {across:.4f} x {down:.4f} mm);"
                " check width_mm and height_mm of the visible area" + (asked and f" ({key}{asked})")
            )
        return self

    @property
    def pitch_x_mm(self) -> float:
        """Width of a pixel."""
        return self.width_mm / self.width_px

    @property
    def pitch_y_mm(self) -> float:
        """Height of a pixel."""
        return self.height_mm / self.height_px

    def frames(self, duration_s: float) -> int | None:
        """Return `duration_s` in whole refreshes, or None where it is not whole."""
        exact = duration_s * self.refresh_hz
        whole = round(exact)
        allowed = max(FRAME_TOLERANCE, self._tolerance_s * self.refresh_hz)
        return whole if whole >= 0 and abs(exact - whole) <= allowed else None

    def at_rate(self, refresh_hz: float, tolerance_s: float) -> Display:
        """Return the display at another rate, where times may be off by a tolerance to be whole."""
        copy = self.model_copy(update={"refresh_hz": refresh_hz})
        copy._tolerance_s = tolerance_s
        return copy

    def nearest_durations(self, duration_s: float) -> tuple[str, ...]:
        """Return the durations of whole refreshes just below and above, in seconds, as texts."""
        low = math.floor(duration_s * self.refresh_hz)
        return tuple(
            shortest(frames / self.refresh_hz, lambda s: self.frames(s) is not None)
            for frames in (low, low + 1)
            if frames > 0
        )

    def at_nominal_rate(self) -> Display | None:
        """Return the display with a whole rate that its tolerance covers; None if it has one."""
        rates = [*COMMON_RATES_HZ, round(self.refresh_hz)]
        near = min(rates, key=lambda rate: abs(self.refresh_hz / rate - 1) if rate else math.inf)
        off = abs(self.refresh_hz / near - 1)
        if off == 0 or off > self.refresh_tolerance_share:
            return None
        return self.model_copy(update={"refresh_hz": float(near)})

    def centred_size_px(self, width_deg: float, height_deg: float) -> tuple[int, int]:
        """Return (width, height) in even pixels of a centred rectangle of that visual angle."""

        def pixels(angle_deg: float, pitch_mm: float) -> int:
            half_mm = self.distance_mm * math.tan(math.radians(angle_deg / 2))
            return max(2, 2 * round(half_mm / pitch_mm))

        return pixels(width_deg, self.pitch_x_mm), pixels(height_deg, self.pitch_y_mm)

    def angles_deg(self, width_px: int, height_px: int) -> tuple[float, float]:
        """Return the visual angles (width, height) of a centred rectangle of that many pixels."""
        half_mm = width_px * self.pitch_x_mm / 2, height_px * self.pitch_y_mm / 2
        width, height = (2 * math.degrees(math.atan(mm / self.distance_mm)) for mm in half_mm)
        return width, height


@dataclass(frozen=True)
class Viewing:
    """The geometry of one display before the eye; pixel (0, 0) is its upper left corner.

    A direction is given by azimuth (right) and elevation (down): the angles of its projections on
    the horizontal and the vertical plane, so that each is a function of one pixel coordinate. The
    angle between two directions is measured between the lines of sight themselves.
    """

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
