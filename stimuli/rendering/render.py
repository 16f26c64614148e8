"""Draw a world from any camera: encoded colour and linear depth, one sample per pixel.

Nothing is anti-aliased along edges: colour and depth of a pixel belong to one surface, as a
warp needs it. The true view is drawn in the same way, so that source and truth differ only
in where the camera stands.
"""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.camera import Camera
from pipeline.errors import InputError
from pipeline.frame import SourceFrame
from pipeline.gl.texture import check_size
from stimuli.rendering.lights import Lamps
from stimuli.rendering.triangle_batches import DepthShaders, columns, program, set_uniform, upload
from stimuli.rendering.world import Material, World

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
        held = upload(ctx, world.parts, self._origin, self._surface, self._depth)
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
        clip_from_world = self._projection(camera) @ view
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
