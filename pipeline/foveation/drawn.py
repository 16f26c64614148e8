"""Drawings of studies in pictures before an eye: Landolt rings, and cuts through the gaze.

Angles are counter-clockwise from the right, as the eye sees them. A ring is round for the eye: on
a flat picture far from its middle, or on a panorama, its pixels are not.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.geometry import Geometry, pixel_centres
from pipeline.frame import Floats

GAP_SHARE = 0.2
"""Stroke and gap, as a share of the ring's height (ISO 8596)."""
FINER = 8
"""Samples per pixel edge."""


def direction_at(
    geometry: Geometry, gaze_px: tuple[float, float], eccentricity_deg: float, polar_deg: float
) -> Floats:
    """The unit vector so far from the gaze, towards that polar angle."""
    gaze = geometry.directions(np.array(gaze_px[0]), np.array(gaze_px[1]))
    right, down = _axes(gaze)
    turn, away = math.radians(polar_deg), math.radians(eccentricity_deg)
    aside = math.cos(turn) * right - math.sin(turn) * down
    return np.asarray(math.cos(away) * gaze + math.sin(away) * aside)


def draw_ring(
    picture: NDArray[np.floating],
    geometry: Geometry,
    gaze_px: tuple[float, float],
    *,
    eccentricity_deg: float,
    polar_deg: float,
    height_deg: float,
    gap_deg: float | None,
    grey: float = 0.0,
) -> NDArray[np.float32]:
    """Draw a Landolt ring into a picture.

    Parameters
    ----------
    picture : ndarray of shape (H, W, 3)
        Encoded R'G'B' in [0, 1].
    height_deg : float
        Outer diameter at the eye; stroke and gap are a fifth of it, the gap has parallel sides.
    gap_deg : float or None
        Direction of the gap; None: closed.
    grey : float
        Encoded, from 0 to 1.

    Returns
    -------
    ndarray of float32, shape (H, W, 3)
        Where the ring covers nothing, bit for bit the picture.

    Raises
    ------
    InputError
        If a part of the ring lies off the picture, or a value is out of range.
    """
    if not 0 < height_deg < 90 or not 0 <= grey <= 1:
        raise InputError(
            f"a ring's height_deg must lie in 0..90 and its grey in 0..1 (got {height_deg}, {grey})"
        )
    centre = direction_at(geometry, gaze_px, eccentricity_deg, polar_deg)
    rows, columns = ring_pixels(geometry, gaze_px, eccentricity_deg, polar_deg, height_deg)
    fine: Floats = (np.arange(FINER, dtype=np.float64) + 0.5) / FINER
    x = (columns.astype(np.float64)[:, None] + fine).reshape(1, -1)
    y = (rows.astype(np.float64)[:, None] + fine).reshape(-1, 1)
    if geometry.wraps:
        x = np.mod(x, float(geometry.width_px))
    across, up = _place_deg(geometry.directions(x, y), centre)
    radius = np.hypot(across, up)
    inked = (radius <= height_deg / 2) & (radius >= (0.5 - GAP_SHARE) * height_deg)
    if gap_deg is not None:
        turn = math.radians(gap_deg)
        along = across * math.cos(turn) + up * math.sin(turn)
        aside = -across * math.sin(turn) + up * math.cos(turn)
        inked &= ~((along > 0) & (np.abs(aside) <= GAP_SHARE / 2 * height_deg))
    cover = inked.reshape(len(rows), FINER, len(columns), FINER).mean(axis=(1, 3))[..., None]
    drawn = np.array(picture, np.float32)
    place = np.ix_(rows, columns % geometry.width_px)
    drawn[place] = np.where(cover > 0, (1 - cover) * drawn[place] + cover * grey, drawn[place])
    return drawn


def ring_pixels(
    geometry: Geometry,
    gaze_px: tuple[float, float],
    eccentricity_deg: float,
    polar_deg: float,
    height_deg: float,
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns that a ring may cover; columns of a panorama go on past its side.

    Raises
    ------
    InputError
        If a part of the ring lies off the picture.
    """
    centre = direction_at(geometry, gaze_px, eccentricity_deg, polar_deg)
    rows, columns = _box(geometry, centre, height_deg / 2)
    if rows is None or columns is None:
        raise InputError(
            f"a ring {height_deg:g} degrees high, {eccentricity_deg:g} degrees from the gaze at"
            f" {polar_deg:g} degrees, must lie on the picture ({geometry.width_px} x"
            f" {geometry.height_px} px); choose smaller eccentricities or a larger picture"
        )
    return rows, columns


def cut_shares(
    geometry: Geometry, gaze_px: tuple[float, float], angle_deg: float, ramp_deg: float
) -> Floats:
    """Share of the first side at every pixel: 1 left of the line's direction, 0 right of it.

    The line is a great circle through the gaze; over `ramp_deg` around it the share rises evenly.
    """
    if not 0 < ramp_deg < 180:
        raise InputError(f"ramp_deg must lie in 0..180 (got {ramp_deg})")
    rays = geometry.directions(*pixel_centres(geometry))
    normal = cut_normal(geometry, gaze_px, angle_deg)
    beyond = np.degrees(np.arcsin(np.clip(rays @ normal, -1, 1)))
    return np.asarray(np.clip(0.5 + beyond / ramp_deg, 0, 1))


def cut_normal(geometry: Geometry, gaze_px: tuple[float, float], angle_deg: float) -> Floats:
    """Unit vector across the line through the gaze, towards the left of its direction: (3,)."""
    right, down = _axes(geometry.directions(np.array(gaze_px[0]), np.array(gaze_px[1])))
    turn = math.radians(angle_deg + 90)
    return np.asarray(math.cos(turn) * right - math.sin(turn) * down)


def bisected(
    first: NDArray[np.floating],
    second: NDArray[np.floating],
    geometry: Geometry,
    gaze_px: tuple[float, float],
    *,
    angle_deg: float,
    ramp_deg: float = 1.0,
) -> NDArray[np.float32]:
    """Show `first` on one side of a line through the gaze, `second` on the other: (H, W, 3).

    Outside the ramp each side is its picture bit for bit.
    """
    return _blended(cut_shares(geometry, gaze_px, angle_deg, ramp_deg)[..., None], first, second)


def disc_shares(geometry: Geometry, centre: Floats, radius_deg: float, ramp_deg: float) -> Floats:
    """Share of what is shown around a direction: 1 up to `radius_deg`, 0 from `ramp_deg` beyond.

    Parameters
    ----------
    centre : ndarray of shape (3,)
        A unit vector, see `direction_at`.
    """
    if not (radius_deg >= 0 and ramp_deg >= 0 and radius_deg + ramp_deg < 180):
        raise InputError(
            "radius_deg and ramp_deg must be at least 0, and less than 180 together"
            f" (got {radius_deg}, {ramp_deg})"
        )
    rays = geometry.directions(*pixel_centres(geometry))
    sine = np.linalg.norm(np.cross(rays, centre), axis=-1)
    beyond = np.degrees(np.arctan2(sine, rays @ centre)) - radius_deg
    if ramp_deg == 0:
        return np.asarray((beyond <= 0).astype(np.float64))
    return np.asarray(np.clip(1 - beyond / ramp_deg, 0, 1))


def before_background(
    shown: NDArray[np.floating],
    background: NDArray[np.floating],
    geometry: Geometry,
    centre: Floats,
    *,
    radius_deg: float,
    ramp_deg: float,
) -> NDArray[np.float32]:
    """Show `shown` in a disc around a direction, `background` beyond it: (H, W, 3).

    Beyond the ramp the background is itself bit for bit, and so is `shown` inside.
    """
    return _blended(
        disc_shares(geometry, centre, radius_deg, ramp_deg)[..., None], shown, background
    )


def _blended(
    share: Floats, first: NDArray[np.floating], second: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Mix by the share of `first`; where one is alone, it stays as it is."""
    mixed = (share * first + (1 - share) * second).astype(np.float32)
    sides = np.where(share >= 1, first, np.where(share <= 0, second, mixed))
    return np.ascontiguousarray(sides, np.float32)


def _axes(ray: Floats) -> tuple[Floats, Floats]:
    """Right and down at a direction; straight up and down, right is where x grows."""
    right = np.cross(np.array([0.0, 1.0, 0.0]), ray)
    length = float(np.linalg.norm(right))
    right = np.array([1.0, 0.0, 0.0]) if length < 1e-9 else right / length
    return right, np.cross(ray, right)


def _place_deg(rays: Floats, centre: Floats) -> tuple[Floats, Floats]:
    """Angles from `centre`, right and up, of the length that the eye sees."""
    right, down = _axes(centre)
    across, up, ahead = rays @ right, -(rays @ down), rays @ centre
    sine = np.hypot(across, up)
    angle = np.degrees(np.arctan2(sine, ahead))
    scale = np.divide(angle, sine, out=np.zeros_like(angle), where=sine > 0)
    return across * scale, up * scale


def _box(
    geometry: Geometry, centre: Floats, reach_deg: float
) -> tuple[NDArray[np.intp] | None, NDArray[np.intp] | None]:
    """Rows and columns of the pixels near a direction; None where some lie off the picture."""
    turns = np.radians(np.arange(0, 360, 2.0))
    right, down = _axes(centre)
    away = math.radians(reach_deg)
    aside = np.cos(turns)[:, None] * right + np.sin(turns)[:, None] * down
    x, y = geometry.positions(math.cos(away) * centre + math.sin(away) * aside)
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        return None, None
    if geometry.wraps:
        middle = geometry.positions(centre[None])[0][0]
        width = geometry.width_px
        x = middle + (x - middle + width / 2) % width - width / 2
        if np.ptp(x) > width / 2 or not 1 <= y.min() <= y.max() <= geometry.height_px - 1:
            return None, None  # around a pole
    elif x.min() < 0 or x.max() > geometry.width_px or y.min() < 0 or y.max() > geometry.height_px:
        return None, None
    first_row, last_row = max(0, math.floor(y.min()) - 1), math.ceil(y.max()) + 1
    first, last = math.floor(x.min()) - 1, math.ceil(x.max()) + 1
    if not geometry.wraps:
        first, last = max(0, first), min(geometry.width_px, last)
    return np.arange(first_row, min(geometry.height_px, last_row)), np.arange(first, last)
