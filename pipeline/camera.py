"""Pinhole cameras: project, unproject, and the exact flow between two views.

Camera axes: x right, y down, z forward. World: right-handed, y up (as glTF). A pose is
the world-from-camera transform. The centre of pixel (row i, column j) is at
x = j + 0.5, y = i + 0.5.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.errors import InputError
from pipeline.frame import Floats, check_depth

# A camera that looks along world -z with its image upright: y down and z forward flip.
UPRIGHT = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera.

    Parameters
    ----------
    width_px, height_px : int
        Image size.
    fx_px, fy_px : float
        Focal lengths, > 0.
    cx_px, cy_px : float
        Principal point; the image's centre is (width_px / 2, height_px / 2).
    world_from_camera : array of shape (4, 4)
        A rigid transform; kept as a float64 copy that cannot be written to.

    Raises
    ------
    InputError
        If a size or focal length is not positive, the principal point not finite, or the
        pose not rigid.
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    world_from_camera: Floats

    def __post_init__(self) -> None:
        if self.width_px < 1 or self.height_px < 1:
            raise InputError(
                f"a camera's image must be at least 1x1 px (got {self.width_px}x{self.height_px})"
            )
        if not (0 < self.fx_px < np.inf and 0 < self.fy_px < np.inf):
            raise InputError(
                "focal lengths must be greater than 0 px and finite"
                f" (got {self.fx_px}, {self.fy_px})"
            )
        if not np.isfinite((self.cx_px, self.cy_px)).all():
            raise InputError(f"the principal point must be finite (got {self.cx_px}, {self.cy_px})")
        pose = np.array(self.world_from_camera, dtype=np.float64)
        pose.setflags(write=False)
        object.__setattr__(self, "world_from_camera", pose)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise InputError(
                f"world_from_camera must be a finite 4x4 matrix (got shape {pose.shape}"
                f"{'' if np.isfinite(pose).all() else ' with NaN or infinite values'})"
            )
        rotation = pose[:3, :3]
        rigid = (
            np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
            and np.linalg.det(rotation) > 0
            and np.allclose(pose[3], (0, 0, 0, 1))
        )
        if not rigid:
            raise InputError(
                "world_from_camera must be a rotation and a translation"
                f" (got determinant {np.linalg.det(rotation):.6g}, last row {pose[3]})"
            )

    def moved(self, offset_m: ArrayLike) -> Self:
        """Return this camera shifted by (right, down, forward) metres along its own axes.

        Raises
        ------
        InputError
            If `offset_m` is not of shape (3,).
        """
        offset = np.asarray(offset_m, np.float64)
        if offset.shape != (3,):
            raise InputError(
                f"offset_m must be (right, down, forward), 3 numbers (got shape {offset.shape})"
            )
        pose = self.world_from_camera.copy()
        pose[:3, 3] += pose[:3, :3] @ offset
        return replace(self, world_from_camera=pose)

    @property
    def matrix(self) -> Floats:
        """Intrinsics K, shape (3, 3): pixels from points of depth 1."""
        return np.array(
            [[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]]
        )

    def pixel_centres(self) -> Floats:
        """Positions (x, y) of all pixel centres, shape (H, W, 2), pixels."""
        x, y = np.meshgrid(np.arange(self.width_px) + 0.5, np.arange(self.height_px) + 0.5)
        return np.stack([x, y], axis=-1)

    def project(self, point_m: Floats) -> tuple[Floats, Floats]:
        """Image positions (..., 2) and depths (...) of world points (..., 3).

        Positions of points at or behind the camera (depth <= 0) are not meaningful.
        """
        relative = point_m - self.world_from_camera[:3, 3]
        return self._image(relative @ self._camera_from_world_rotation().T)

    def _camera_from_world_rotation(self) -> Floats:
        # Not the transpose: a pose from a file is a rotation only to its own precision, and
        # a point must come back to the pixel that it was unprojected from.
        return np.asarray(np.linalg.inv(self.world_from_camera[:3, :3]), np.float64)

    def _rays(self, position_px: Floats) -> Floats:
        x = (position_px[..., 0] - self.cx_px) / self.fx_px
        y = (position_px[..., 1] - self.cy_px) / self.fy_px
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def _image(self, point: Floats) -> tuple[Floats, Floats]:
        depth = point[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            x = self.fx_px * point[..., 0] / depth + self.cx_px
            y = self.fy_px * point[..., 1] / depth + self.cy_px
        return np.stack([x, y], axis=-1), depth


def flow_between(
    source: Camera, target: Camera, depth_m: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Exact motion of every source pixel into the target view (6 degrees of freedom).

    Parameters
    ----------
    depth_m : ndarray of float32, shape (H, W)
        Depth of each source pixel; inf moves by rotation alone.

    Returns
    -------
    flow_px : ndarray of float32, shape (H, W, 2)
        Target minus source position, x then y; (0, 0) for points that the target has
        behind it, or so far aside that float32 cannot say where.
    target_depth_m : ndarray of float32, shape (H, W)
        Depth of the same points along the target's axis; 0 for those points, which nothing
        may draw.

    Raises
    ------
    InputError
        If `depth_m` is not positive or not of the source's size.
    """
    check_depth(depth_m, "depth_m")
    if depth_m.shape != (source.height_px, source.width_px):
        raise InputError(
            f"depth_m must be {source.height_px}x{source.width_px} as the source camera"
            f" (got {depth_m.shape[0]}x{depth_m.shape[1]})"
        )
    start = source.pixel_centres()
    to_target = target._camera_from_world_rotation()
    turn = to_target @ source.world_from_camera[:3, :3]
    # Cameras far from the origin: subtract first, and little is lost.
    shift_m = to_target @ (source.world_from_camera[:3, 3] - target.world_from_camera[:3, 3])
    turned = source._rays(start) @ turn.T
    # Per unit of depth: a point at infinity feels no translation.
    inverse = 1.0 / depth_m.astype(np.float64)
    scaled = turned + shift_m * inverse[..., None]
    end, depth_ratio = target._image(scaled)
    with np.errstate(invalid="ignore", over="ignore"):
        flow = (end - start).astype(np.float32)
        target_depth = (depth_ratio * depth_m.astype(np.float64)).astype(np.float32)
    seen = (depth_ratio > 0) & np.isfinite(flow).all(axis=-1)
    return np.where(seen[..., None], flow, 0), np.where(seen, target_depth, 0)
