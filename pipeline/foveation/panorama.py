"""A panorama is worked out in three pictures: itself, and a picture of what lies around each pole.

Bands, pools and noise lie in pixels. Towards the poles of an equirectangular picture a pixel's
width shrinks to nothing: what is even in pixels runs in streaks to the pole for the eye. So there
a stereographic picture takes its place, which keeps angles. Between two latitudes both are mixed;
pixels of the equirectangular one are there at most as uneven as those of a flat picture 100
degrees wide.

Twin: panorama_gpu.py. Change both or neither.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.foveation.catalogue import Condition
from pipeline.foveation.displacement import look_up_cubic
from pipeline.foveation.geometry import (
    CapGeometry,
    EquirectangularGeometry,
    Geometry,
    pixel_centres,
)
from pipeline.foveation.picture_fixation import Colour, PictureFixation
from pipeline.foveation.sphere import BELT_DEG, cap_shares
from pipeline.frame import Floats

Scalar = TypeVar("Scalar", bound=np.generic)

SEEN_DEG = 35.0
"""Latitude to which the picture of a pole reaches, so that pools are whole where it counts."""
LEAST_EDGE_PX = 8
OVER_POLES = 2  # rows beyond a pole that a cubic reads


def cap_of(geometry: Geometry, *, upper: bool) -> CapGeometry:
    """The picture of a panorama's pole: at the pole its pixels are as large as at the equator."""
    radian_px = geometry.width_px / (2 * math.pi)
    radius_px = 2 * radian_px * math.tan(math.radians(90 - SEEN_DEG) / 2)
    return CapGeometry(max(LEAST_EDGE_PX, 2 * math.ceil(radius_px)), radian_px, upper)


def capped_rows(geometry: Geometry, *, upper: bool) -> slice:
    """Rows of the panorama of which a cap has a share."""
    count = math.ceil(geometry.height_px * (90 - BELT_DEG) / 180)
    return slice(0, count) if upper else slice(geometry.height_px - count, geometry.height_px)


def by_charts(condition: Condition, picture: Colour, fixation: PictureFixation) -> Colour:
    """Show a whole panorama to a gaze, by a condition that pools."""
    geometry = fixation.geometry

    def shown(cap: CapGeometry) -> Colour:
        return condition.apply(cap_picture(picture, cap), cap_look(fixation, cap))

    whole = with_caps(condition.apply(picture, fixation), geometry, shown)
    assert condition.pooling is not None
    fade = fixation.pools(condition.pooling).fade()[..., None]
    return np.where(fade > 0, np.clip(whole, 0, 1).astype(np.float32), picture)


def with_caps(belt: Colour, geometry: Geometry, shown: Callable[[CapGeometry], Colour]) -> Floats:
    """Mix a panorama, towards its poles, with what `shown` gives of each pole's picture."""
    x, y = pixel_centres(geometry)
    whole = belt.astype(np.float64)
    for upper in (True, False):
        cap = cap_of(geometry, upper=upper)
        rows = capped_rows(geometry, upper=upper)
        rays = geometry.directions(x, y[rows])
        share = cap_shares(rays)[..., None]
        found = look_up_cubic(shown(cap).astype(np.float64), *cap.positions(rays), wraps=False)
        whole[rows] += share * (found - whole[rows])
    return whole


def cap_picture(picture: Colour, cap: CapGeometry) -> Colour:
    """Picture around a pole of a panorama, cubic between its pixels: (edge, edge, 3)."""
    found = seen_in(picture, cap.directions(*pixel_centres(cap)))
    return np.clip(found, 0, 1).astype(np.float32)


def seen_in(panorama: NDArray[np.floating], rays: Floats) -> Floats:
    """Colours of a panorama (h, 2 h, 3) in directions (..., 3), cubic between its pixels."""
    height, width = panorama.shape[:2]
    x, y = EquirectangularGeometry(width, height).positions(rays)
    tall = over_poles(panorama, OVER_POLES).astype(np.float64)
    return look_up_cubic(tall, x, y + OVER_POLES, wraps=True)


def over_poles(panorama: NDArray[Scalar], rows: int) -> NDArray[Scalar]:
    """Go on past both poles, where the other meridian comes back: (h + 2 rows, w, ...)."""
    half = panorama.shape[1] // 2
    rows_there = np.minimum(np.arange(rows), len(panorama) - 1)
    above, below = panorama[rows_there[::-1]], panorama[len(panorama) - 1 - rows_there]
    return np.concatenate([np.roll(above, half, axis=1), panorama, np.roll(below, half, axis=1)])


def cap_look(fixation: PictureFixation, cap: CapGeometry) -> PictureFixation:
    """The same fixation of the picture of a pole."""
    return PictureFixation(
        cap,
        cap_gaze_px(fixation.geometry, cap, fixation.gaze_px),
        fixation.seed,
        fixation.frame,
        None if fixation.noise_shift_px is None else _cap_shift_px(fixation, cap),
        fixation.field_gaze_px and cap_gaze_px(fixation.geometry, cap, fixation.field_gaze_px),
    )


def cap_gaze_px(
    geometry: Geometry, cap: CapGeometry, gaze_px: tuple[float, float]
) -> tuple[float, float]:
    """Point where a gaze at the panorama meets the picture of a pole, or the plane around it."""
    x, y = cap.positions(geometry.directions(np.array(gaze_px[0]), np.array(gaze_px[1])))
    return float(x), float(y)


def _cap_shift_px(fixation: PictureFixation, cap: CapGeometry) -> Floats:
    """Motion of surfaces in the picture of a pole: (edge, edge, 2), x first, pixels."""
    geometry, shift = fixation.geometry, fixation.noise_shift_px
    assert shift is not None
    here_x, here_y = np.broadcast_arrays(*pixel_centres(cap))
    x, y = geometry.positions(cap.directions(here_x, here_y))
    column = np.floor(x).astype(np.intp) % geometry.width_px
    row = np.clip(np.floor(y).astype(np.intp), 0, geometry.height_px - 1)
    origin = geometry.directions(x - shift[row, column, 0], y - shift[row, column, 1])
    from_x, from_y = cap.positions(origin)
    return np.stack([here_x - from_x, here_y - from_y], axis=-1)
