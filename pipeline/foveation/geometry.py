"""Geometry of pictures before an eye: directions, eccentricity, pixels per degree.

A `Viewing` says how pictures are looked at, whatever their size; `Viewing.of` binds it to a size.
Positions are (x, y) in pixels, x right, y down, the first pixel's centre at (0.5, 0.5).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import Floats

Ray: TypeAlias = tuple[float, float, float]

WIDEST_FLAT_DEG = 180.0
LEAST_FROM_FAR_POLE = 1e-6  # 1 less the cosine: a twelfth of a degree
FADE_DEG = 1.0  # over so many degrees gives way what is shown around the gaze


class Geometry(Protocol):
    """A picture of a known size before an eye."""

    @property
    def width_px(self) -> int: ...

    @property
    def height_px(self) -> int: ...

    @property
    def wraps(self) -> bool:
        """True if the right border goes on at the left one."""
        ...

    @property
    def on_sphere(self) -> bool:
        """True for a panorama, or a part of one."""
        ...

    def directions(self, x: Floats, y: Floats) -> Floats:
        """Unit vectors from the eye to positions of one shape (...): (..., 3)."""
        ...

    def ray(self, x: float, y: float) -> Ray:
        """`directions` of one position, without arrays: for every frame."""
        ...

    def positions(self, rays: Floats) -> tuple[Floats, Floats]:
        """Invert `directions`: x and y of shape (...); NaN for what a flat picture cannot show."""
        ...

    def px_per_deg(self, x: Floats, y: Floats) -> Floats:
        """Geometric mean of the densities of pixels along the two axes there."""
        ...


@dataclass(frozen=True)
class Flat:
    """A flat picture, the eye before its centre, on the normal through it.

    Exactly one of the two is given; without either the picture is 40 degrees wide.

    Parameters
    ----------
    width_deg : float, optional
        Visual angle of the picture's whole width, in (0, 180).
    distance_px : float, optional
        Distance of the eye in pixels: millimetres over the width of a pixel.
    centre_px : (x, y), optional
        Where the normal through the eye meets the picture; by default the middle.

    Raises
    ------
    InputError
        If both are given, or a value is out of range.
    """

    width_deg: float | None = None
    distance_px: float | None = None
    centre_px: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.width_deg is not None and self.distance_px is not None:
            raise InputError("a flat viewing takes width_deg or distance_px (got both)")
        if self.width_deg is not None and not 0 < self.width_deg < WIDEST_FLAT_DEG:
            raise InputError(
                f"width_deg of a flat picture must lie between 0 and 180 (got {self.width_deg});"
                " use an equirectangular viewing for a panorama"
            )
        if self.distance_px is not None and not 0 < self.distance_px < math.inf:
            raise InputError(f"distance_px must be positive and finite (got {self.distance_px})")
        if self.centre_px is not None:
            check_point(self.centre_px, "centre_px")

    def of(self, width_px: int, height_px: int) -> FlatGeometry:
        """Bind this viewing to pictures of one size."""
        check_edges(width_px, height_px)
        distance_px = self.distance_px
        if distance_px is None:
            half_rad = math.radians((40.0 if self.width_deg is None else self.width_deg) / 2)
            distance_px = width_px / 2 / math.tan(half_rad)
        centre_px = self.centre_px or (width_px / 2, height_px / 2)
        return FlatGeometry(width_px, height_px, distance_px, centre_px)


@dataclass(frozen=True)
class Equirectangular:
    """A whole panorama: 360 degrees of longitude along x, 180 of latitude along y."""

    def of(self, width_px: int, height_px: int) -> EquirectangularGeometry:
        """Bind this viewing to pictures of one size.

        Raises
        ------
        InputError
            If the size is not 2:1.
        """
        check_edges(width_px, height_px)
        if width_px != 2 * height_px:
            raise InputError(
                "an equirectangular panorama must be twice as wide as high"
                f" (got {width_px} x {height_px} px)"
            )
        return EquirectangularGeometry(width_px, height_px)


Viewing: TypeAlias = Flat | Equirectangular


@dataclass(frozen=True)
class FlatGeometry:
    """A flat picture of a known size; see `Flat`."""

    width_px: int
    height_px: int
    distance_px: float
    centre_px: tuple[float, float]

    @property
    def wraps(self) -> bool:
        return False

    @property
    def on_sphere(self) -> bool:
        return False

    def directions(self, x: Floats, y: Floats) -> Floats:
        across, down = x - self.centre_px[0], y - self.centre_px[1]
        rays = np.stack(np.broadcast_arrays(across, down, self.distance_px), axis=-1)
        return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))

    def ray(self, x: float, y: float) -> Ray:
        across, down = x - self.centre_px[0], y - self.centre_px[1]
        length = math.sqrt(across * across + down * down + self.distance_px**2)
        return across / length, down / length, self.distance_px / length

    def place_px(self, across_deg: float, down_deg: float) -> tuple[float, float]:
        """Position so many degrees right of and below where the normal meets the picture."""
        x, y = (
            centre + self.distance_px * math.tan(math.radians(angle))
            for centre, angle in zip(self.centre_px, (across_deg, down_deg), strict=True)
        )
        return x, y

    def angles_deg(self, place_px: tuple[float, float]) -> tuple[float, float]:
        """Invert `place_px`."""
        across_deg, down_deg = (
            math.degrees(math.atan((place - centre) / self.distance_px))
            for centre, place in zip(self.centre_px, place_px, strict=True)
        )
        return across_deg, down_deg

    def positions(self, rays: Floats) -> tuple[Floats, Floats]:
        scale = self.distance_px / np.where(rays[..., 2] > 1e-6, rays[..., 2], np.nan)
        x, y = (self.centre_px[axis] + scale * rays[..., axis] for axis in (0, 1))
        return x, y

    def px_per_deg(self, x: Floats, y: Floats) -> Floats:
        """Geometric mean of d / cos(t)^2 along the radius and d / cos(t) across, at angle t."""
        cosine = self.directions(x, y)[..., 2]
        return np.asarray(math.radians(1) * self.distance_px * cosine**-1.5)


@dataclass(frozen=True)
class EquirectangularGeometry:
    """A panorama of a known size; see `Equirectangular`."""

    width_px: int
    height_px: int

    @property
    def wraps(self) -> bool:
        return True

    @property
    def on_sphere(self) -> bool:
        return True

    def directions(self, x: Floats, y: Floats) -> Floats:
        longitude = (x / self.width_px - 0.5) * (2 * np.pi)
        latitude = self._latitude(y)
        level = np.cos(latitude)
        rays = (np.sin(longitude) * level, -np.sin(latitude), np.cos(longitude) * level)
        return np.stack(np.broadcast_arrays(*rays), axis=-1)

    def ray(self, x: float, y: float) -> Ray:
        longitude = (x / self.width_px - 0.5) * (2 * math.pi)
        latitude = (0.5 - y / self.height_px) * math.pi
        level = math.cos(latitude)
        return math.sin(longitude) * level, -math.sin(latitude), math.cos(longitude) * level

    def positions(self, rays: Floats) -> tuple[Floats, Floats]:
        longitude = np.arctan2(rays[..., 0], rays[..., 2])
        down = np.arcsin(np.clip(rays[..., 1], -1, 1))
        x, y = longitude / (2 * np.pi) + 0.5, down / np.pi + 0.5
        return x * self.width_px, y * self.height_px

    def px_per_deg(self, x: Floats, y: Floats) -> Floats:
        """W / 360 along a meridian, W / 360 / cos(latitude) along a parallel."""
        level = np.maximum(np.cos(self._latitude(y)), self.least_cosine)
        return np.asarray(np.broadcast_arrays(self.width_px / 360 / np.sqrt(level), x)[0])

    @property
    def least_cosine(self) -> float:
        """Cosine of the latitude a quarter of a pixel from a pole: there a parallel is a point."""
        return math.sin(np.pi / 4 / self.height_px)

    def _latitude(self, y: Floats) -> Floats:
        return np.asarray((0.5 - y / self.height_px) * np.pi)


@dataclass(frozen=True)
class CapGeometry:
    """A pole of a panorama and what lies around it, seen in a stereographic picture.

    Stereographic pictures keep angles: a small circle around any direction is a circle of pixels.

    Parameters
    ----------
    edge_px : int
        Of the square picture, the pole in its middle.
    radian_px : float
        Pixels of a radian at the pole; farther out there are more.
    upper : bool
        Whether it is the pole above the eye.
    """

    edge_px: int
    radian_px: float
    upper: bool

    @property
    def width_px(self) -> int:
        return self.edge_px

    @property
    def height_px(self) -> int:
        return self.edge_px

    @property
    def wraps(self) -> bool:
        return False

    @property
    def on_sphere(self) -> bool:
        return True

    @property
    def pole(self) -> float:
        """y of the direction to the pole."""
        return -1.0 if self.upper else 1.0

    def directions(self, x: Floats, y: Floats) -> Floats:
        across, down = self._from_pole(x), self._from_pole(y)
        square = across**2 + down**2
        rays = (2 * across, self.pole * (1 - square), -self.pole * 2 * down)
        return np.stack(np.broadcast_arrays(*rays), axis=-1) / (1 + square)[..., None]

    def ray(self, x: float, y: float) -> Ray:
        middle, tangent_px = self.edge_px / 2, 2 * self.radian_px
        across, down = (x - middle) / tangent_px, (y - middle) / tangent_px
        square = across * across + down * down
        near = 1 + square
        return 2 * across / near, self.pole * (1 - square) / near, -self.pole * 2 * down / near

    def positions(self, rays: Floats) -> tuple[Floats, Floats]:
        # The other pole would lie at infinity.
        scale = 2 * self.radian_px / np.maximum(1 + self.pole * rays[..., 1], LEAST_FROM_FAR_POLE)
        middle = self.edge_px / 2
        return middle + scale * rays[..., 0], middle - self.pole * scale * rays[..., 2]

    def px_per_deg(self, x: Floats, y: Floats) -> Floats:
        square = self._from_pole(x) ** 2 + self._from_pole(y) ** 2
        return np.asarray(math.radians(1) * self.radian_px * (1 + square))

    def _from_pole(self, place: Floats) -> Floats:
        """Tangent of half the angle that a coordinate stands for."""
        return np.asarray((place - self.edge_px / 2) / (2 * self.radian_px))


def pixel_centres(geometry: Geometry, halvings: int = 0) -> tuple[Floats, Floats]:
    """Positions of the texels of a picture halved so often: x of shape (1, w), y of (h, 1)."""
    step = 1 << halvings
    columns, rows = -(-geometry.width_px // step), -(-geometry.height_px // step)
    x, y = ((np.arange(count, dtype=np.float64) + 0.5) * step for count in (columns, rows))
    return x[None, :], y[:, None]


def eccentricity_deg(
    geometry: Geometry, gaze_px: tuple[float, float], x: Floats, y: Floats
) -> Floats:
    """Angle between the gaze and the directions of positions, degrees, 0 to 180.

    Parameters
    ----------
    gaze_px : (x, y)
        Anywhere on the picture's plane, also off the picture; see `check_gaze`.
    x, y : ndarray
        Positions in pixels, of shapes that broadcast to that of the result.
    """
    rays = geometry.directions(x, y)
    gaze = geometry.directions(np.array(gaze_px[0]), np.array(gaze_px[1]))
    sine = np.linalg.norm(np.cross(rays, gaze), axis=-1)
    return np.asarray(np.degrees(np.arctan2(sine, rays @ gaze)))


def share_around(
    geometry: Geometry, gaze_px: tuple[float, float], within_deg: float
) -> NDArray[np.float32]:
    """Fade out around a gaze: (H, W), 1 within an angle, 0 `FADE_DEG` beyond it."""
    away = eccentricity_deg(geometry, gaze_px, *pixel_centres(geometry))
    way = ((away - within_deg) / FADE_DEG).clip(0, 1)
    return np.asarray(1 - way * way * (3 - 2 * way), np.float32)


def check_gaze(geometry: Geometry, gaze_px: tuple[float, float]) -> tuple[float, float]:
    """Return the gaze as two floats; beyond a pole of a panorama it stays at the pole.

    Raises
    ------
    InputError
        If it is not two finite numbers.
    """
    x, y = check_point(gaze_px, "gaze_px")
    if geometry.wraps:
        return x % geometry.width_px, min(max(y, 0.0), float(geometry.height_px))
    return x, y


def check_point(point: tuple[float, float], name: str) -> tuple[float, float]:
    """Require two finite numbers."""
    try:
        x, y = (float(value) for value in point)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be two numbers, x and y in pixels (got {point!r})") from None
    if not (math.isfinite(x) and math.isfinite(y)):
        raise InputError(f"{name} must be finite (got {point!r})")
    return x, y


def check_edges(width_px: int, height_px: int) -> None:
    """Require a picture of at least one pixel."""
    if min(width_px, height_px) < 1:
        raise InputError(f"a picture must have at least 1 x 1 px (got {width_px} x {height_px})")
