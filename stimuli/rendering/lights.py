"""Lamps, made before a view is drawn: the sun's shadow map and the sky that a vertex sees."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.colour import decode_srgb
from stimuli.rendering.triangle_batches import DepthShaders, TriangleBatch, columns, set_uniform
from stimuli.rendering.world import Light, Mesh, World

SHADOW_PX = 2048
SKY_DIRECTIONS = 32
SKY_PX = 512
LARGEST_SHADOW_M = 30.0  # radius of what a shadow map covers

Matrix = NDArray[np.float64]


class Lamps:
    """Shadow maps of one world.

    Parameters
    ----------
    origin_m : ndarray, shape (3,)
        What the vertices on the GPU are counted from.
    """

    def __init__(
        self, ctx: moderngl.Context, depth: DepthShaders, world: World, origin_m: Matrix
    ) -> None:
        self._ctx, self._depth, self._world, self._origin = ctx, depth, world, origin_m
        low, high = world.bounds_m
        self._low, self._high = low, high
        self._reach_m = float(np.linalg.norm(high - low))
        self.radius_m = min(0.5 * self._reach_m, LARGEST_SHADOW_M)

    def draw_shadows(self, batches: Iterable[TriangleBatch]) -> moderngl.Texture:
        """Return the depth that the sun sees; all clear in a world without light."""
        shadow_map = self._ctx.depth_texture((SHADOW_PX, SHADOW_PX))
        shadow_map.filter = (moderngl.LINEAR, moderngl.LINEAR)
        shadow_map.repeat_x = shadow_map.repeat_y = False
        light = self._world.light
        if light is not None:
            self._draw_depth(shadow_map, self._matrix(light.sun_direction), batches)
        shadow_map.compare_func = "<="
        return shadow_map

    def bake_sky(self, held: Sequence[tuple[TriangleBatch, Mesh]]) -> None:
        """Tell each vertex its share of the sky, cosine-weighted: soft shade under everything."""
        positions = [(mesh.position_m - self._origin).astype(np.float64) for _, mesh in held]
        seen = [np.zeros(len(place)) for place in positions]
        weight = [np.full(len(place), 1e-6) for place in positions]
        batches = [batch for batch, _ in held]
        depth_map = self._ctx.depth_texture((SKY_PX, SKY_PX))
        bias_m = 3.0 * self.radius_m / SKY_PX
        for direction in _dome():
            matrix = self._matrix(direction)
            self._draw_depth(depth_map, matrix, batches)
            nearest = np.frombuffer(depth_map.read(), np.float32).reshape(SKY_PX, SKY_PX)
            for index, (_, mesh) in enumerate(held):
                towards = mesh.normal @ direction
                facing = np.abs(towards)
                place = positions[index] + bias_m * mesh.normal * np.sign(towards)[:, None]
                at = place @ matrix[:3, :3].T + matrix[:3, 3]
                texel = np.floor((0.5 + 0.5 * at[:, :2]) * SKY_PX).astype(np.int64)
                inside = ((texel >= 0) & (texel < SKY_PX)).all(axis=1)
                x, y = texel.clip(0, SKY_PX - 1).T
                free = 0.5 + 0.5 * at[:, 2] <= nearest[y, x] + bias_m / (2 * self._reach_m)
                seen[index] += facing * (free | ~inside)
                weight[index] += facing
        depth_map.release()
        for (batch, mesh), open_sum, total in zip(held, seen, weight, strict=True):
            batch.set_openness(mesh, open_sum / total, self._origin)

    def set_uniforms(self, surface: moderngl.Program) -> None:
        """Tell the surface shader of the world's light."""
        light = self._world.light or Light()
        direction = np.asarray(light.sun_direction, np.float64)
        direction = direction / np.linalg.norm(direction)
        for name, value in (
            ("shadow_from_world", columns(self._matrix(light.sun_direction))),
            ("sun_direction", tuple(direction)),
            ("sun", light.sun),
            ("sky", light.sky),
            ("ground", light.ground),
            ("haze", tuple(decode_srgb(np.asarray(light.haze, np.float64)))),
            ("haze_per_m", 1.0 / light.haze_m),
            ("exposure", light.exposure),
            ("shadow_texel_m", 2 * self.radius_m / SHADOW_PX),
        ):
            set_uniform(surface, name, value)

    def _matrix(self, direction: ArrayLike) -> Matrix:
        """Orthographic clip space as the light sees it, around the middle of the view."""
        viewpoint = self._world.viewpoint
        ahead = np.asarray(viewpoint.look_at_m) - viewpoint.position_m
        ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
        centre = (self._low + self._high) / 2
        if 0.5 * self._reach_m > self.radius_m:
            centre = np.asarray(viewpoint.position_m) + 0.75 * self.radius_m * ahead
        return _light_matrix(
            np.asarray(direction, np.float64), centre - self._origin, self.radius_m, self._reach_m
        )

    def _draw_depth(
        self, depth_map: moderngl.Texture, matrix: Matrix, batches: Iterable[TriangleBatch]
    ) -> None:
        framebuffer = self._ctx.framebuffer([], depth_map)
        framebuffer.use()
        self._ctx.viewport = (0, 0, *depth_map.size)
        framebuffer.clear(depth=1.0)
        self._ctx.enable(moderngl.DEPTH_TEST)
        self._ctx.depth_func = "<"
        self._depth.draw(batches, matrix)
        self._ctx.detect_framebuffer(0).use()
        framebuffer.release()


def _light_matrix(
    direction: NDArray[np.float64], centre: NDArray[np.float64], radius_m: float, reach_m: float
) -> NDArray[np.float64]:
    towards = direction / np.linalg.norm(direction)
    side = np.cross((0.0, 1.0, 0.0), towards)
    if np.linalg.norm(side) < 1e-6:
        side = np.array([1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    above = np.cross(towards, side)
    matrix = np.eye(4)
    matrix[0, :3], matrix[1, :3], matrix[2, :3] = (
        side / radius_m,
        above / radius_m,
        -towards / reach_m,
    )
    matrix[:3, 3] = -matrix[:3, :3] @ centre
    return matrix


def _dome() -> list[NDArray[np.float64]]:
    """Directions over the upper hemisphere, even in solid angle (a golden spiral)."""
    index = np.arange(SKY_DIRECTIONS) + 0.5
    up = index / SKY_DIRECTIONS
    turn = np.pi * (1 + 5**0.5) * index
    level = np.sqrt(1 - up**2)
    return list(np.stack([level * np.cos(turn), up, level * np.sin(turn)], axis=-1))
