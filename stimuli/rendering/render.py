"""Draw a world from any camera: encoded colour and linear depth, one sample per pixel.

Nothing is anti-aliased along edges: colour and depth of a pixel belong to one surface, as a
warp needs it. The true view is drawn in the same way, so that source and truth differ only
in where the camera stands.

Lamps are made before a view is drawn: the sun's shadow map and the sky that a vertex sees.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.camera import Camera
from pipeline.colour import decode_srgb
from pipeline.errors import InputError
from pipeline.frame import SourceFrame
from pipeline.gl.texture import check_size
from stimuli.rendering.triangle_batches import (
    DepthShaders,
    TriangleBatch,
    columns,
    program,
    projection,
    set_uniform,
    upload_triangles,
)
from stimuli.rendering.world import Light, Material, Mesh, World

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


NEAR_SHARE = 1e-4  # of the scene's size: how near a surface may come to the camera,
NEAR_M = 0.05  # and at most this


class WorldRenderer:
    """A world on the GPU.

    Uploads, draws the shadow map and bakes the sky's light on construction (about a second in
    software for a world of 10^5 triangles); a call draws one view.

    Parameters
    ----------
    world : World

    Raises
    ------
    GLUnavailableError
        If the driver cannot hold the world.
    """

    def __init__(self, ctx: moderngl.Context, world: World) -> None:
        self._ctx = ctx
        self.world = world
        self._origin = np.asarray(world.viewpoint.position_m, np.float64)
        low, high = world.bounds_m
        self._reach_m = float(np.linalg.norm(np.maximum(high, self._origin) - low))
        self._surface = program(ctx, "surface.vert.glsl", "surface.frag.glsl")
        self._depth = DepthShaders(ctx)
        self._sky = program(ctx, "sky.vert.glsl", "sky.frag.glsl")
        self._sky_array = ctx.vertex_array(self._sky, [])
        self._targets: dict[tuple[int, int], tuple[Any, ...]] = {}
        held = upload_triangles(ctx, world.parts, self._origin, self._surface, self._depth)
        self._batches = [batch for batch, _ in held]
        panorama = np.zeros((1, 1, 3), np.uint8) if world.sky is None else world.sky
        self._panorama = ctx.texture(
            panorama.shape[1::-1], 3, np.ascontiguousarray(panorama).tobytes(), alignment=1
        )
        self._panorama.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self._panorama.repeat_y = False
        lamps = Lamps(ctx, self._depth, world, self._origin)
        lamps.set_uniforms(self._surface)
        for shader, name, unit in (
            (self._surface, "albedo", 0),
            (self._surface, "shadow", 1),
            (self._surface, "glow", 2),
            (self._sky, "panorama", 0),
        ):
            set_uniform(shader, name, unit)
        if world.light is not None:
            lamps.bake_sky(held)
        self._shadow_map = lamps.draw_shadows(self._batches)

    def render(self, camera: Camera, *, fronts_only: bool | None = None) -> SourceFrame:
        """Draw what `camera` sees.

        Parameters
        ----------
        fronts_only : bool, optional
            Leave out triangles that are seen from behind, as their order of corners tells, or draw
            them all; left out, as their materials say.

        Returns
        -------
        SourceFrame of the camera's size
            Depth is inf where there is nothing.

        Raises
        ------
        InputError
            If the image is larger than the driver can draw.
        """
        size = (camera.width_px, camera.height_px)
        target, framebuffer = self._target(size)
        ctx = self._ctx
        framebuffer.use()
        ctx.viewport = (0, 0, *size)
        ctx.disable(moderngl.CULL_FACE | moderngl.BLEND | moderngl.DEPTH_TEST)
        self._draw_sky(camera)
        ctx.enable(moderngl.DEPTH_TEST)
        ctx.front_face, ctx.cull_face = "cw", "back"  # rows go down: corners turn the other way

        def cull(material: Material) -> None:
            hidden = not material.double_sided if fronts_only is None else fronts_only
            (ctx.enable if hidden else ctx.disable)(moderngl.CULL_FACE)

        ctx.depth_func = "<"
        rotation = np.linalg.inv(camera.world_from_camera[:3, :3])
        place = camera.world_from_camera[:3, 3] - self._origin
        view = np.eye(4)
        view[:3, :3], view[:3, 3] = rotation, -rotation @ place
        lens = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
        near_m = min(NEAR_SHARE * self._reach_m, NEAR_M)
        clip_from_world = projection(size, lens, near_m) @ view
        set_uniform(self._surface, "clip_from_world", columns(clip_from_world))
        set_uniform(self._surface, "eye", tuple(place))
        # Depth first: the costly light is worked out once per pixel.
        framebuffer.color_mask = (False,) * 4
        self._depth.draw(self._batches, clip_from_world, cull)
        framebuffer.color_mask, framebuffer.depth_mask = (True,) * 4, False
        ctx.depth_func = "<="
        self._shadow_map.use(1)
        for batch in self._batches:
            material = batch.material
            cull(material)
            batch.texture.use(0)
            batch.glow.use(2)
            for name, value in (
                ("cutout", material.cutout),
                ("lit", material.lit and self.world.light is not None),
                ("translucency", material.translucency),
                ("clamped", material.clamp),
                ("emission", material.emission),
                ("glowing", material.glow is not None),
            ):
                set_uniform(self._surface, name, value)
            batch.surface.render(moderngl.TRIANGLES)
        framebuffer.depth_mask = True  # or the next picture would not be cleared
        ctx.disable(moderngl.CULL_FACE)
        pixels = np.empty((size[1], size[0], 4), np.float32)
        target.read_into(pixels, alignment=1)
        return SourceFrame(
            np.ascontiguousarray(pixels[..., :3].clip(0, 1)), np.ascontiguousarray(pixels[..., 3])
        )

    def release(self) -> None:
        """Free everything on the GPU."""
        for batch in self._batches:
            batch.release()
        self._release_targets()
        for resource in (self._panorama, self._shadow_map, self._sky_array):
            resource.release()
        for shader in (self._surface, self._depth, self._sky):
            shader.release()

    def _release_targets(self) -> None:
        # moderngl binds again what was bound before: that must not be gone by then.
        self._ctx.detect_framebuffer(0).use()
        for held in self._targets.values():
            for resource in held:
                resource.release()
        self._targets.clear()

    def _target(self, size: tuple[int, int]) -> tuple[moderngl.Texture, moderngl.Framebuffer]:
        if size not in self._targets:
            check_size(self._ctx, size)
            self._release_targets()  # one size at a time is all a clip needs
            colour = self._ctx.texture(size, 4, dtype="f4")
            depth = self._ctx.depth_renderbuffer(size)
            framebuffer = self._ctx.framebuffer([colour], depth)
            self._targets[size] = (framebuffer, colour, depth)
        framebuffer, colour, _ = self._targets[size]
        framebuffer.use()
        framebuffer.clear(depth=1.0)
        return colour, framebuffer

    def _draw_sky(self, camera: Camera) -> None:
        for name, value in (
            ("size_px", (camera.width_px, camera.height_px)),
            ("focal_px", (camera.fx_px, camera.fy_px)),
            ("centre_px", (camera.cx_px, camera.cy_px)),
            ("world_from_camera", columns(camera.world_from_camera[:3, :3])),
            ("has_panorama", self.world.sky is not None),
            ("backdrop", self.world.backdrop),
        ):
            set_uniform(self._sky, name, value)
        self._panorama.use(0)
        self._sky_array.render(moderngl.TRIANGLES, vertices=3)


def check_view(camera: Camera, frame: SourceFrame, where: str) -> None:
    """Require a view with something in it, at different depths.

    Raises
    ------
    InputError
        If nothing is seen, with the cure.
    """
    if not np.isfinite(frame.depth_m).any():
        place = ", ".join(f"{value:.3g}" for value in camera.world_from_camera[:3, 3])
        raise InputError(
            f"{where}: the camera must see something (from ({place}) m it sees only background);"
            " choose another view with 'metamerlab stimuli look'"
        )
