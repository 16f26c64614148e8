"""Gaze and display as people write them: where somebody looks, and from how far."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.errors import InputError
from pipeline.foveation.geometry import (
    WIDEST_FLAT_DEG,
    Equirectangular,
    Flat,
    FlatGeometry,
    Geometry,
    Viewing,
    check_gaze,
)
from protocols.display import COMMON_PITCH_MM, Display
from protocols.load import load_display
from protocols.plausible_numbers import RANGES, hardly_meant

NARROWEST_DEG = 0.01
"""Least visual angle of a flat picture: a pixel of the finest displays is about as wide."""
ASSUMED_DEG = 40.0
"""Width of a flat picture of which nothing is said."""


@dataclass(frozen=True)
class GazeAndDisplay:
    """A picture before an eye, and in words where that comes from."""

    viewing: Viewing
    geometry: Geometry
    words: str
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class StatedViewing:
    """Gaze, display and angle of a picture, as people state them.

    Parameters
    ----------
    gaze : str, optional
        As `read_gaze` takes it; left out: the middle.
    display : str, optional
        A display of ours or a file of one: the picture stands in its middle, pixel for pixel.
    fov_deg : float, optional
        Visual angle of the picture's width instead, from `NARROWEST_DEG` to below 180. Without
        either a flat picture is 40 degrees wide.
    panorama : bool
        The picture is equirectangular, all around.
    monitor : Display, optional
        What shows it where neither is stated, pixel for pixel.
    """

    gaze: str | None = None
    display: str | None = None
    fov_deg: float | None = None
    panorama: bool = False
    monitor: Display | None = None

    def of(self, size: tuple[int, int]) -> GazeAndDisplay:
        """Return the gaze and the display with which a picture of (height, width) is looked at.

        Raises
        ------
        InputError, StudyError
            If these contradict each other, the angle is impossible, there is no such display, or a
            panorama is not 2:1.
        """
        height, width = size
        if self.panorama:
            if self.display is not None or self.fov_deg is not None:
                given = "--display" if self.display is not None else "--fov"
                raise InputError(f"a panorama is 360 degrees wide: leave {given} out")
            around = Equirectangular()
            geometry: Geometry = around.of(width, height)
            return GazeAndDisplay(
                around, geometry, f"panorama: 360 x 180 degrees, {_density(geometry)}"
            )
        if self.display is not None and self.fov_deg is not None:
            raise InputError("give --display or --fov, not both: each says how wide the picture is")
        notes: list[str] = []
        screen = self.monitor if self.fov_deg is None else None
        if self.display is not None:
            screen = load_display(self.display)
        if screen is not None:
            flat = Flat(distance_px=screen.distance_mm / screen.pitch_x_mm)
            where = f"display {screen.name}, pixel for pixel"
            if self.display is None:
                where = (
                    f"{screen.name}, {screen.pitch_x_mm:.3f} mm a pixel, from"
                    f" {screen.distance_mm / 10:.0f} cm; --display or --fov says otherwise"
                )
            if width > screen.width_px or height > screen.height_px:
                notes.append(
                    f"the picture ({width} x {height} px) is larger than the display"
                    f" ({screen.width_px} x {screen.height_px} px): its border cannot be seen"
                )
        elif self.fov_deg is not None:
            if not NARROWEST_DEG <= self.fov_deg < WIDEST_FLAT_DEG:
                raise InputError(
                    f"--fov must lie between {NARROWEST_DEG:g} and 180 degrees"
                    f" (got {self.fov_deg:g}); a picture that goes all around takes --panorama"
                )
            flat, where = Flat(width_deg=self.fov_deg), "as asked"
        else:
            flat = Flat(width_deg=ASSUMED_DEG)
            where = "assumed, since neither --display nor --fov was given"
        shown = flat.of(width, height)
        if self.fov_deg and math.radians(shown.distance_px) > RANGES["px_per_deg"][1]:
            asked = hardly_meant("view_deg", self.fov_deg)
            notes.append(f"--fov {self.fov_deg:g}: that is finer than displays are{asked}")
        if screen is None:
            where += f"; right on a common screen from {common_distance_cm(shown):.0f} cm"
        words = (
            f"field of view: {width_deg(shown):.1f} x {height_deg(shown):.1f} degrees"
            f" ({where}), {_density(shown)}"
        )
        return GazeAndDisplay(flat, shown, words, tuple(notes))


AS_ASSUMED = StatedViewing()
"""Nothing is said: the middle of a flat picture, 40 degrees wide."""


def common_distance_cm(geometry: FlatGeometry) -> float:
    """Distance at which a screen of `COMMON_PITCH_MM` shows the geometry, pixel for pixel."""
    return geometry.distance_px * COMMON_PITCH_MM / 10


def width_deg(geometry: FlatGeometry) -> float:
    """Visual angle of the whole width, seen from before the middle."""
    return 2 * math.degrees(math.atan(geometry.width_px / 2 / geometry.distance_px))


def height_deg(geometry: FlatGeometry) -> float:
    """Visual angle of the whole height, seen from before the middle."""
    return 2 * math.degrees(math.atan(geometry.height_px / 2 / geometry.distance_px))


def read_gaze(text: str | None, geometry: Geometry) -> tuple[float, float]:
    """Read ``X,Y`` in pixels, or ``Xdeg,Ydeg`` from the middle, right and down.

    Degrees are azimuth and elevation (`protocols.display`); on a panorama longitude and latitude.

    Parameters
    ----------
    text : str or None
        None: the middle of the picture.

    Returns
    -------
    (x, y)
        Pixels of the picture; also off a flat one.

    Raises
    ------
    InputError
        Saying what is wrong with it.
    """
    if text is None:
        return geometry.width_px / 2, geometry.height_px / 2
    parts = [part.strip().lower() for part in text.split(",")]
    degrees = [part.endswith(("deg", "°")) for part in parts]
    numbers = [_number(part.removesuffix("deg").removesuffix("°")) for part in parts]
    if len(parts) != 2 or any(number is None for number in numbers) or len(set(degrees)) != 1:
        raise InputError(
            "--gaze must be X,Y in pixels from the upper left corner, such as 512,384, or in"
            f" degrees right of and below the middle, such as 5deg,-3deg (got {text!r})"
        )
    x, y = (number for number in numbers if number is not None)
    if not degrees[0]:
        if geometry.wraps and not 0 <= y <= geometry.height_px:
            raise InputError(
                f"--gaze on a panorama must have Y from 0 to {geometry.height_px} (got {text!r})"
            )
        return check_gaze(geometry, (x, y))
    if isinstance(geometry, FlatGeometry):
        if max(abs(x), abs(y)) >= 90:
            raise InputError(
                f"--gaze before a flat picture must lie within 90 degrees (got {text!r})"
            )
        return geometry.place_px(x, y)
    if abs(y) > 90:
        raise InputError(
            f"--gaze on a panorama must have a latitude of at most 90 degrees (got {text!r})"
        )
    place = geometry.width_px * (0.5 + x / 360), geometry.height_px * (0.5 + y / 180)
    return check_gaze(geometry, place)


def gaze_words(gaze_px: tuple[float, float], geometry: Geometry) -> str:
    """The gaze in pixels, and whether it lies on the picture."""
    x, y = gaze_px
    off = not (0 <= x <= geometry.width_px and 0 <= y <= geometry.height_px)
    return f"gaze: {x:.1f}, {y:.1f} px{', off the picture' if off else ''}"


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _density(geometry: Geometry) -> str:
    middle = np.array(geometry.width_px / 2), np.array(geometry.height_px / 2)
    return f"{float(geometry.px_per_deg(*middle)):.3g} px per degree in the middle"
