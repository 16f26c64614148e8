"""Draw a world from any camera: encoded colour and linear depth, one sample per pixel.

Nothing is anti-aliased along edges: colour and depth of a pixel belong to one surface, as a
warp needs it. The true view is drawn in the same way, so that source and truth differ only
in where the camera stands.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib import resources
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.camera import Camera
from pipeline.colour import decode_srgb
from pipeline.errors import InputError
from pipeline.frame import SourceFrame
from pipeline.gl.texture import check_size
from stimuli.world import Light, Material, Mesh, World

ANISOTROPY = 4.0
SHADOW_PX = 2048
SKY_DIRECTIONS = 32
SKY_PX = 512
NEAR_SHARE = 1e-4  # of the scene's size: how near a surface may come to the camera,
NEAR_M = 0.05  # and at most this
_SRGB8_ALPHA8 = 0x8C43
_VERTEX = "3f 3f 2f 4f"
_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$', re.MULTILINE)


@dataclass(eq=False)
class _Batch:
    """All triangles of one material on the GPU."""

    material: Material
    vertices: moderngl.Buffer
    indices: moderngl.Buffer
    texture: moderngl.Texture
    surface: moderngl.VertexArray
    depth: moderngl.VertexArray

    def release(self) -> None:
        for resource in (self.surface, self.depth, self.vertices, self.indices, self.texture):
            resource.release()


class Renderer:
    """A world on the GPU.

    Uploads, draws the shadow map and bakes the sky's light on construction (some seconds in
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
        self._depth = program(ctx, "surface.vert.glsl", "depth.frag.glsl")
        self._sky = program(ctx, "sky.vert.glsl", "sky.frag.glsl")
        self._sky_array = ctx.vertex_array(self._sky, [])
        self._batches: list[_Batch] = []
        self._targets: dict[tuple[int, int], tuple[Any, ...]] = {}
        groups: dict[int, tuple[Material, list[Mesh]]] = {}
        for part in world.parts:
            if len(part.mesh.triangles):
                groups.setdefault(id(part.material), (part.material, []))[1].append(part.mesh)
        joined = [(material, Mesh.joined(meshes)) for material, meshes in groups.values()]
        self._upload(joined)
        panorama = np.zeros((1, 1, 3), np.uint8) if world.sky is None else world.sky
        self._panorama = ctx.texture(
            panorama.shape[1::-1], 3, np.ascontiguousarray(panorama).tobytes(), alignment=1
        )
        self._panorama.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self._panorama.repeat_y = False
        self._shadow_map = ctx.depth_texture((SHADOW_PX, SHADOW_PX))
        self._shadow_map.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self._shadow_map.repeat_x = self._shadow_map.repeat_y = False
        light = world.light or Light()
        self._set_light(light)
        if world.light is not None:
            self._bake_sky([mesh for _, mesh in joined])
            self._draw_depth(self._shadow_map, self._sun_matrix(light.sun_direction))
        self._shadow_map.compare_func = "<="

    def render(self, camera: Camera) -> SourceFrame:
        """Draw what `camera` sees.

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
        framebuffer.depth_mask = True
        ctx.depth_func = "<"
        rotation = np.linalg.inv(camera.world_from_camera[:3, :3])
        place = camera.world_from_camera[:3, 3] - self._origin
        view = np.eye(4)
        view[:3, :3], view[:3, 3] = rotation, -rotation @ place
        _set(self._surface, "clip_from_world", _columns(self._projection(camera) @ view))
        _set(self._surface, "eye", tuple(place))
        # Depth first: the costly light is worked out once per pixel.
        framebuffer.color_mask = (False,) * 4
        _set(self._depth, "clip_from_world", _columns(self._projection(camera) @ view))
        for batch in self._batches:
            batch.texture.use(0)
            _set(self._depth, "cutout", batch.material.cutout)
            batch.depth.render(moderngl.TRIANGLES)
        framebuffer.color_mask = (True,) * 4
        ctx.depth_func = "<="
        self._shadow_map.use(1)
        for batch in self._batches:
            batch.texture.use(0)
            _set(self._surface, "cutout", batch.material.cutout)
            _set(self._surface, "lit", batch.material.lit and self.world.light is not None)
            _set(self._surface, "translucency", batch.material.translucency)
            batch.surface.render(moderngl.TRIANGLES)
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

    def _upload(self, joined: list[tuple[Material, Mesh]]) -> None:
        ctx = self._ctx
        for material, mesh in joined:
            texture = _texture(ctx, material)
            vertices = ctx.buffer(self._vertex_bytes(mesh, np.ones(len(mesh.position_m))))
            indices = ctx.buffer(mesh.triangles.tobytes())
            names = ("in_position", "in_normal", "in_uv", "in_colour")
            self._batches.append(
                _Batch(
                    material,
                    vertices,
                    indices,
                    texture,
                    ctx.vertex_array(
                        self._surface, [(vertices, _VERTEX, *names)], indices, skip_errors=True
                    ),
                    ctx.vertex_array(
                        self._depth, [(vertices, _VERTEX, *names)], indices, skip_errors=True
                    ),
                )
            )

    def _vertex_bytes(self, mesh: Mesh, openness: NDArray[np.floating]) -> bytes:
        packed = np.concatenate(
            [
                (mesh.position_m - self._origin).astype(np.float32),
                mesh.normal,
                mesh.uv,
                mesh.colour,
                openness.astype(np.float32)[:, None],
            ],
            axis=1,
        )
        return packed.astype(np.float32).tobytes()

    def _projection(self, camera: Camera) -> NDArray[np.float64]:
        """Clip space from camera axes: x right, y down as rows of an array, far plane at inf."""
        near_m = min(NEAR_SHARE * self._reach_m, NEAR_M)
        width, height = camera.width_px, camera.height_px
        return np.array(
            [
                [2 * camera.fx_px / width, 0, 2 * camera.cx_px / width - 1, 0],
                [0, 2 * camera.fy_px / height, 2 * camera.cy_px / height - 1, 0],
                [0, 0, 1, -2 * near_m],
                [0, 0, 1, 0],
            ]
        )

    def _draw_sky(self, camera: Camera) -> None:
        for name, value in (
            ("size_px", (camera.width_px, camera.height_px)),
            ("focal_px", (camera.fx_px, camera.fy_px)),
            ("centre_px", (camera.cx_px, camera.cy_px)),
            ("world_from_camera", _columns(camera.world_from_camera[:3, :3])),
            ("has_panorama", self.world.sky is not None),
            ("backdrop", self.world.backdrop),
        ):
            _set(self._sky, name, value)
        self._panorama.use(0)
        self._sky_array.render(moderngl.TRIANGLES, vertices=3)

    def _set_light(self, light: Light) -> None:
        direction = np.asarray(light.sun_direction, np.float64)
        direction = direction / np.linalg.norm(direction)
        haze = decode_srgb(np.asarray(light.haze, np.float64))
        for name, value in (
            ("albedo", 0),
            ("shadow", 1),
            ("shadow_from_world", _columns(self._sun_matrix(light.sun_direction))),
            ("sun_direction", tuple(direction)),
            ("sun", light.sun),
            ("sky", light.sky),
            ("ground", light.ground),
            ("haze", tuple(haze)),
            ("haze_per_m", 1.0 / light.haze_m),
            ("exposure", light.exposure),
            ("shadow_texel_m", 2 * self._shadow_radius_m() / SHADOW_PX),
        ):
            _set(self._surface, name, value)
        _set(self._depth, "albedo", 0)
        _set(self._sky, "panorama", 0)

    def _shadow_radius_m(self) -> float:
        low, high = self.world.bounds_m
        return min(0.5 * float(np.linalg.norm(high - low)), 30.0)

    def _sun_matrix(self, direction: Any) -> NDArray[np.float64]:
        """Orthographic clip space as the light sees it, around the middle of the view."""
        low, high = self.world.bounds_m
        viewpoint = self.world.viewpoint
        ahead = np.asarray(viewpoint.look_at_m) - viewpoint.position_m
        ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
        radius = self._shadow_radius_m()
        centre = (low + high) / 2
        if 0.5 * float(np.linalg.norm(high - low)) > radius:
            centre = np.asarray(viewpoint.position_m) + 0.75 * radius * ahead
        reach = float(np.linalg.norm(high - low))
        return _light_matrix(
            np.asarray(direction, np.float64), centre - self._origin, radius, reach
        )

    def _draw_depth(self, depth_map: moderngl.Texture, matrix: NDArray[np.float64]) -> None:
        framebuffer = self._ctx.framebuffer([], depth_map)
        framebuffer.use()
        self._ctx.viewport = (0, 0, *depth_map.size)
        framebuffer.clear(depth=1.0)
        self._ctx.enable(moderngl.DEPTH_TEST)
        self._ctx.depth_func = "<"
        _set(self._depth, "clip_from_world", _columns(matrix))
        for batch in self._batches:
            batch.texture.use(0)
            _set(self._depth, "cutout", batch.material.cutout)
            batch.depth.render(moderngl.TRIANGLES)
        self._ctx.detect_framebuffer(0).use()
        framebuffer.release()

    def _bake_sky(self, meshes: list[Mesh]) -> None:
        """How much of the sky each vertex sees, cosine-weighted: soft shade under everything."""
        positions = [(mesh.position_m - self._origin).astype(np.float64) for mesh in meshes]
        seen = [np.zeros(len(place)) for place in positions]
        weight = [np.full(len(place), 1e-6) for place in positions]
        low, high = self.world.bounds_m
        reach = float(np.linalg.norm(high - low))
        radius = self._shadow_radius_m()
        depth_map = self._ctx.depth_texture((SKY_PX, SKY_PX))
        bias_m = 3.0 * radius / SKY_PX
        for direction in _dome(SKY_DIRECTIONS):
            matrix = self._sun_matrix(direction)
            self._draw_depth(depth_map, matrix)
            nearest = np.frombuffer(depth_map.read(), np.float32).reshape(SKY_PX, SKY_PX)
            for index, mesh in enumerate(meshes):
                facing = np.abs(mesh.normal @ direction)
                place = (
                    positions[index]
                    + bias_m * mesh.normal * np.sign(mesh.normal @ direction)[:, None]
                )
                at = place @ matrix[:3, :3].T + matrix[:3, 3]
                texel = np.floor((0.5 + 0.5 * at[:, :2]) * SKY_PX).astype(np.int64)
                inside = ((texel >= 0) & (texel < SKY_PX)).all(axis=1)
                x, y = texel.clip(0, SKY_PX - 1).T
                free = 0.5 + 0.5 * at[:, 2] <= nearest[y, x] + bias_m / (2 * reach)
                seen[index] += facing * (free | ~inside)
                weight[index] += facing
        depth_map.release()
        for batch, mesh, open_sum, total in zip(self._batches, meshes, seen, weight, strict=True):
            batch.vertices.write(self._vertex_bytes(mesh, open_sum / total))


def program(ctx: moderngl.Context, vertex: str, fragment: str) -> moderngl.Program:
    """Compile two shaders of this package."""
    return ctx.program(vertex_shader=shader_text(vertex), fragment_shader=shader_text(fragment))


def shader_text(name: str) -> str:
    """Return a shader of this package with its includes."""
    folder = resources.files("stimuli") / "shaders"
    text = (folder / name).read_text(encoding="utf-8")
    return _INCLUDE.sub(lambda match: shader_text(match[1]), text)


def _texture(ctx: moderngl.Context, material: Material) -> moderngl.Texture:
    height, width, _ = material.texture.shape
    check_size(ctx, (width, height))
    data = np.ascontiguousarray(material.texture)
    texture = ctx.texture((width, height), 4, data, internal_format=_SRGB8_ALPHA8)
    texture.build_mipmaps()
    texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    texture.anisotropy = min(ANISOTROPY, float(ctx.max_anisotropy))
    return texture


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


def _dome(count: int) -> list[NDArray[np.float64]]:
    """Directions over the upper hemisphere, even in solid angle (a golden spiral)."""
    index = np.arange(count) + 0.5
    up = index / count
    turn = np.pi * (1 + 5**0.5) * index
    level = np.sqrt(1 - up**2)
    return list(np.stack([level * np.cos(turn), up, level * np.sin(turn)], axis=-1))


def _columns(matrix: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple(matrix.T.ravel().astype(float))


def _set(shader: Any, name: str, value: object) -> None:
    """Set a uniform, unless the compiler found it unused in this shader."""
    uniform = shader.get(name, None)
    if isinstance(uniform, moderngl.Uniform):
        uniform.value = value


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
