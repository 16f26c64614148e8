"""World that the renderer draws: textured triangles, their light, the sky, and the viewpoint.

World axes: right-handed, y up, metres. Colours of textures are encoded R'G'B'; colours of
light and of vertices are linear factors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.camera import Camera
from pipeline.errors import InputError

Vector = tuple[float, float, float]


def vector(values: NDArray[np.floating]) -> Vector:
    """Return three numbers of an array."""
    x, y, z = map(float, values)
    return x, y, z


@dataclass(frozen=True, eq=False)
class Material:
    """A texture and how light meets it.

    Parameters
    ----------
    texture : ndarray of uint8, shape (H, W, 4)
        Encoded R'G'B' and coverage; row 0 is v = 0. It repeats, unless `clamp`.
    cutout : bool
        Whether coverage below one half is left out (leaves, fences).
    lit : bool
        Unlit surfaces show their texture as it is.
    translucency : float
        Share of light that falls through, in [0, 1]: leaves are bright on both sides.
    clamp : (bool, bool)
        Whether the texture's edge goes on beyond it, along u and v.
    nearest : bool
        Whether a texel that is drawn larger than a pixel keeps its edges.
    double_sided : bool
        Whether triangles are seen from behind, where their corners turn clockwise.
    emission : (r, g, b)
        Linear light that the surface adds by itself.
    glow : ndarray of uint8, shape (H, W, 4), optional
        A texture that multiplies `emission`, at the same places as `texture`.
    """

    texture: NDArray[np.uint8]
    cutout: bool = False
    lit: bool = True
    translucency: float = 0.0
    clamp: tuple[bool, bool] = (False, False)
    nearest: bool = False
    double_sided: bool = True
    emission: Vector = (0.0, 0.0, 0.0)
    glow: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        for texture in (self.texture, self.glow):
            if texture is None:
                continue
            shape = texture.shape
            if texture.dtype != np.uint8 or len(shape) != 3 or shape[2] != 4 or 0 in shape:
                raise InputError(
                    "a texture must be uint8 of shape (H, W, 4)"
                    f" (got {texture.dtype} of shape {shape})"
                )


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles.

    Parameters
    ----------
    position_m, normal : ndarray of float32, shape (N, 3)
    uv : ndarray of float32, shape (N, 2)
        Place in the texture, in textures.
    colour : ndarray of float32, shape (N, 3)
        Linear factor on the texture's light.
    triangles : ndarray of uint32, shape (M, 3)

    Raises
    ------
    InputError
        If shapes do not fit, a number is not finite, or a triangle names a missing vertex.
    """

    position_m: NDArray[np.float32]
    normal: NDArray[np.float32]
    uv: NDArray[np.float32]
    colour: NDArray[np.float32]
    triangles: NDArray[np.uint32]

    def __post_init__(self) -> None:
        count = len(self.position_m)
        for name, width in (("position_m", 3), ("normal", 3), ("uv", 2), ("colour", 3)):
            array = np.ascontiguousarray(getattr(self, name), np.float32)
            if array.shape != (count, width):
                raise InputError(f"{name} must have shape ({count}, {width}) (got {array.shape})")
            if not np.isfinite(array).all():
                raise InputError(f"{name} must be finite (some of {count} vertices are not)")
            object.__setattr__(self, name, array)
        triangles = np.ascontiguousarray(self.triangles, np.uint32).reshape(-1, 3)
        object.__setattr__(self, "triangles", triangles)
        if triangles.size and int(triangles.max()) >= count:
            raise InputError(
                f"triangles must name vertices below {count} (got {int(triangles.max())})"
            )

    @classmethod
    def joined(cls, meshes: Sequence[Mesh]) -> Mesh:
        """Return one mesh of all triangles of `meshes`, in order."""
        starts = np.cumsum([0, *(len(mesh.position_m) for mesh in meshes)])
        return cls(
            np.concatenate([mesh.position_m for mesh in meshes]),
            np.concatenate([mesh.normal for mesh in meshes]),
            np.concatenate([mesh.uv for mesh in meshes]),
            np.concatenate([mesh.colour for mesh in meshes]),
            np.concatenate(
                [m.triangles + np.uint32(s) for m, s in zip(meshes, starts, strict=False)]
            ),
        )

    def faceted(self) -> Mesh:
        """Return the mesh with flat triangles: no vertex is shared."""
        corners = self.triangles.ravel()
        position = self.position_m[corners]
        first, second, third = position.reshape(-1, 3, 3).astype(np.float64).transpose(1, 0, 2)
        normal = np.cross(second - first, third - first)
        normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-30)
        return Mesh(
            position,
            np.repeat(normal.astype(np.float32), 3, axis=0),
            self.uv[corners],
            self.colour[corners],
            np.arange(len(corners), dtype=np.uint32),
        )

    def transformed(self, matrix: NDArray[np.float64]) -> Mesh:
        """Return the mesh moved by a 4x4 matrix; normals stay unit and upright to surfaces."""
        linear = matrix[:3, :3]
        normal = self.normal @ np.linalg.inv(linear)
        length = np.linalg.norm(normal, axis=-1, keepdims=True)
        return replace(
            self,
            position_m=(self.position_m @ linear.T + matrix[:3, 3]).astype(np.float32),
            normal=(normal / np.maximum(length, 1e-12)).astype(np.float32),
        )

    def moved(self, x_m: float, y_m: float, z_m: float, *, turn_deg: float = 0.0) -> Mesh:
        """Return the mesh turned about the vertical, then shifted."""
        cosine, sine = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
        matrix = np.array(
            [[cosine, 0, sine, x_m], [0, 1, 0, y_m], [-sine, 0, cosine, z_m], [0, 0, 0, 1]]
        )
        return self.transformed(matrix)

    def tinted(self, colour: ArrayLike) -> Mesh:
        """Return the mesh with its colours multiplied."""
        return replace(self, colour=(self.colour * np.asarray(colour)).astype(np.float32))


@dataclass(frozen=True, eq=False)
class MeshPart:
    """A mesh and its material."""

    mesh: Mesh
    material: Material


@dataclass(frozen=True)
class Light:
    """One sun with shadows, light from the sky, and light that the ground sends back.

    Parameters
    ----------
    sun_direction : (x, y, z)
        From the scene towards the sun; any length.
    sun, sky, ground : (r, g, b)
        Linear light from each.
    haze : (r, g, b)
        Encoded colour that distance fades to.
    haze_m : float
        Distance at which 63 % is haze; inf for none. It is measured from the scene's own
        viewpoint, not from the moving camera: a surface must keep its colour while one moves.
    exposure : float
        Factor before tone mapping.
    """

    sun_direction: Vector = (0.4, 0.8, 0.3)
    sun: Vector = (2.2, 2.0, 1.7)
    sky: Vector = (0.75, 0.85, 1.0)
    ground: Vector = (0.25, 0.22, 0.18)
    haze: Vector = (0.75, 0.8, 0.85)
    haze_m: float = float("inf")
    exposure: float = 1.0


@dataclass(frozen=True)
class Viewpoint:
    """Place of the camera before it moves."""

    position_m: Vector
    look_at_m: Vector
    vertical_fov_deg: float = 45.0

    def camera(self, width_px: int, height_px: int, margin_px: int = 0) -> Camera:
        """A camera of `width_px` x `height_px` with the field of view on its height.

        `margin_px` adds that many pixels on every side and moves none of the others.
        """
        focal_px = height_px / 2 / np.tan(np.radians(self.vertical_fov_deg) / 2)
        return Camera(
            width_px + 2 * margin_px,
            height_px + 2 * margin_px,
            focal_px,
            focal_px,
            width_px / 2 + margin_px,
            height_px / 2 + margin_px,
            look_at_pose(self.position_m, self.look_at_m),
        )


@dataclass(frozen=True, eq=False)
class World:
    """Everything that can be seen.

    Parameters
    ----------
    parts : sequence of MeshPart
    viewpoint : Viewpoint
    light : Light, optional
        Left out: every surface is unlit.
    sky : ndarray of uint8, shape (H, W, 3), optional
        Encoded panorama, longitude x latitude, row 0 the zenith; left out: `backdrop`.
    backdrop : (r, g, b)
        Encoded colour where there is nothing.
    """

    parts: tuple[MeshPart, ...]
    viewpoint: Viewpoint
    light: Light | None = None
    sky: NDArray[np.uint8] | None = None
    backdrop: Vector = (0.62, 0.72, 0.82)
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        if not any(len(part.mesh.triangles) for part in self.parts):
            raise InputError("a world must hold at least one triangle (got none)")

    @property
    def bounds_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The least and the greatest corner of all vertices."""
        lows = [part.mesh.position_m.min(axis=0) for part in self.parts]
        highs = [part.mesh.position_m.max(axis=0) for part in self.parts]
        return np.min(lows, axis=0).astype(np.float64), np.max(highs, axis=0).astype(np.float64)

    def seen_from(self, viewpoint: Viewpoint) -> Self:
        """Return the world with another viewpoint."""
        return replace(self, viewpoint=viewpoint)


def look_at_pose(position_m: ArrayLike, look_at_m: ArrayLike) -> NDArray[np.float64]:
    """World-from-camera pose at `position_m`, looking at `look_at_m`, upright.

    Raises
    ------
    InputError
        If both are one point.
    """
    position, target = np.asarray(position_m, np.float64), np.asarray(look_at_m, np.float64)
    forward = target - position
    length = float(np.linalg.norm(forward))
    if not length > 0:
        raise InputError(f"look_at_m must differ from position_m (both are {position.tolist()})")
    forward /= length
    right = np.cross(forward, (0.0, 1.0, 0.0))
    if np.linalg.norm(right) < 1e-9:  # straight up or down: the image's top is -z
        right = np.array([1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = (
        right,
        np.cross(forward, right),
        forward,
        position,
    )
    return pose
