"""A panorama with distance, warped straight into a view from another place.

The source is the panorama's own pixel grid. The target is a flat picture, the picture of a pole
(`CapGeometry`), or the panorama's belt. So the warp and every fill work as they are, and none of
them has to know that a panorama goes round: the grid is read on over the seam and over the poles,
and only where the view can see.

A source pixel that comes to lie more than `KEPT_PX` outside of the view is marked as behind the
eye. Its motion is kept, for its neighbours are judged by it. Without the mark, a third of the
grid's quads are long and out of sight, and each is looked at for tears.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.errors import InputError
from pipeline.foveation.geometry import EquirectangularGeometry, Geometry
from pipeline.foveation.panorama import over_poles
from pipeline.foveation.view import turn
from pipeline.frame import Floats, PanoramaFrame, SourceFrame, TargetWindow
from pipeline.pictures.warp_input import WarpInput
from pipeline.warp.settings import SURFACE_PX

KEPT_PX = 8.0
OVER_PX = 4  # columns beyond the seam, and rows beyond a pole, where all of it is seen
BELT_MARGIN = 3 / 32  # of the width, on either side: wider than holes are
BELT_REACH_DEG = 75.0  # latitude; from 55 degrees on caps are shown

Scalar = TypeVar("Scalar", bound=np.generic)


@dataclass(frozen=True, eq=False)
class Outlook:
    """A view of a panorama's surroundings from a moved eye.

    Parameters
    ----------
    geometry : Geometry
        Flat, the picture of a pole, or the panorama itself, which stands for its belt.
    turned : ndarray of float64, shape (3, 3)
        Axes of the panorama from those of the view; x right, y down, z ahead.
    move_m : ndarray of float64, shape (3,)
        Place of the eye, along the panorama's axes: right, down, and to its middle.
    """

    geometry: Geometry
    turned: Floats
    move_m: Floats

    @classmethod
    def towards(
        cls, geometry: Geometry, move_m: ArrayLike, right_deg: float = 0.0, down_deg: float = 0.0
    ) -> Self:
        """Look right of and below the panorama's middle.

        Raises
        ------
        InputError
            If the move is not three finite numbers.
        """
        move = np.asarray(move_m, np.float64)
        if move.shape != (3,) or not np.isfinite(move).all():
            raise InputError(f"a move must be three finite numbers, in metres (got {move_m!r})")
        return cls(geometry, turn(right_deg, down_deg), move)

    @property
    def margin_px(self) -> int:
        """Columns that a belt goes on over the seam, on either side."""
        return round(BELT_MARGIN * self.geometry.width_px) if self.geometry.wraps else 0

    def moved(self, rays: Floats, distance_m: Floats) -> Floats:
        """Points in the view's axes (..., 3), over their distance before the move."""
        return np.asarray((rays - self.move_m / distance_m[..., None]) @ self.turned)


class GridPart(NamedTuple):
    """Part of a panorama's pixel grid; it may go on over the seam and the poles."""

    left: int
    top: int
    width: int
    height: int
    panorama: EquirectangularGeometry

    @classmethod
    def around(cls, size: tuple[int, ...], outlook: Outlook) -> GridPart:
        """All of a panorama of `size` (height, width), what is looked at in its middle."""
        panorama = EquirectangularGeometry(size[1], size[0])
        if outlook.geometry.wraps:
            aside = 2 * outlook.margin_px
            return cls(-aside, 0, panorama.width_px + 2 * aside, panorama.height_px, panorama)
        middle = panorama.positions(outlook.turned[:, 2])[0]
        left = round(float(middle) - panorama.width_px / 2) - OVER_PX
        width, height = panorama.width_px + 2 * OVER_PX, panorama.height_px + 2 * OVER_PX
        return cls(left, -OVER_PX, width, height, panorama)

    def read(self, plane: NDArray[Scalar]) -> NDArray[Scalar]:
        """Values of the part's pixels, (height, width, ...)."""
        columns = (self.left + np.arange(self.width)) % plane.shape[1]
        rows = self.top + OVER_PX + np.arange(self.height)
        return np.ascontiguousarray(over_poles(plane, OVER_PX)[rows][:, columns])

    def centres(self) -> tuple[Floats, Floats]:
        """Positions of its pixels in the panorama: x of shape (1, width), y of (height, 1)."""
        x = np.arange(self.width, dtype=np.float64) + (self.left + 0.5)
        y = np.arange(self.height, dtype=np.float64) + (self.top + 0.5)
        return x[None, :], y[:, None]

    def window(self, outlook: Outlook) -> TargetWindow:
        """Window of a view, for a warp of this part by motions from the panorama's pixels."""
        margin, geometry = outlook.margin_px, outlook.geometry
        return TargetWindow(
            -self.left - margin, -self.top, geometry.width_px + 2 * margin, geometry.height_px
        )


def seen_from(frame: PanoramaFrame, outlook: Outlook) -> WarpInput:
    """Make the input of the warp into a view of a panorama from a moved eye.

    Of the grid only what comes into view is kept, and what judges it. The depth is that of a flat
    view, along its axis; in a view that is not flat it is the distance.
    """
    whole = GridPart.around(frame.distance_m.shape, outlook)
    flow_px, depth_m = panorama_motion(whole.read(frame.distance_m), whole, outlook)
    rows, columns = (
        slice(max(0, kept[0] - SURFACE_PX), kept[-1] + SURFACE_PX + 1)
        for kept in (np.flatnonzero((depth_m > 0).any(axis=axis)).tolist() for axis in (1, 0))
    )
    flow_px = np.ascontiguousarray(flow_px[rows, columns])
    depth_m = np.ascontiguousarray(depth_m[rows, columns])
    height, width = depth_m.shape
    left, top = whole.left + columns.start, whole.top + rows.start
    part = GridPart(left, top, width, height, whole.panorama)
    measured = None if frame.measured is None else part.read(frame.measured)
    source = SourceFrame(part.read(frame.colour), part.read(frame.distance_m), measured)
    return WarpInput(source, flow_px, depth_m, part.window(outlook))


def panorama_motion(
    distance_m: NDArray[np.float32], part: GridPart, outlook: Outlook
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Motion of every pixel of a part into the view, and its depth there.

    Returns
    -------
    flow_px : ndarray of float32, shape (height, width, 2)
        Position in the view less that in the panorama; (0, 0) behind the eye.
    depth_m : ndarray of float32, shape (height, width)
        0 for what nothing may draw.
    """
    geometry, (x, y) = outlook.geometry, part.centres()
    far_m = distance_m.astype(np.float64)
    point = outlook.moved(part.panorama.directions(x, y), far_m)
    length = np.linalg.norm(point, axis=-1)
    ray = point / np.maximum(length, 1e-12)[..., None]
    at_x, at_y = geometry.positions(ray)
    margin = outlook.margin_px
    if geometry.wraps:  # the nearest of the places that a point has
        at_x = at_x + geometry.width_px * np.round((x - at_x) / geometry.width_px)
    flow_px = np.stack([at_x - x, at_y - y], axis=-1).astype(np.float32)
    ahead = np.isfinite(flow_px).all(axis=-1) & (length > 0)
    shown = ahead & (at_x > -margin - KEPT_PX) & (at_x < geometry.width_px + margin + KEPT_PX)
    shown &= (at_y > -KEPT_PX) & (at_y < geometry.height_px + KEPT_PX)
    if geometry.wraps:
        shown &= np.abs(ray[..., 1]) < np.sin(np.radians(BELT_REACH_DEG))
    depth = length if geometry.on_sphere else point[..., 2]
    depth_m = np.where(shown, depth * np.where(shown, far_m, 1), 0).astype(np.float32)
    return np.where(ahead[..., None], flow_px, 0), depth_m
