"""Draw globes with a baked texture, for an eye that rests somewhere."""

from __future__ import annotations

from typing import Literal

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.foveation.geometry import FlatGeometry
from pipeline.foveation.picture_pass import PoolUniforms
from pipeline.foveation.pooling import MetamerSettings
from pipeline.gl.texture import check_size
from pipeline.textures.bake import BakedTexture
from pipeline.textures.gpu import TexturePass
from pipeline.textures.reference import Fragments
from stimuli.rendering.triangle_batches import columns, projection, set_uniform, shader_text
from stimuli.texture.scenes import Globe, TexturedScene, globe_vertices

GlobeCondition = Literal["reference", "blur", "metamer"]
GLOBE_CONDITIONS: tuple[GlobeCondition, ...] = ("reference", "blur", "metamer")
"""Sources of a pixel: the texture at its own size; at its pool's; and noise of what that lost."""
BACKDROP = 0.02
_NEAR_M = 0.01


class TexturedRenderer:
    """A scene on the GPU: uploads on construction, a call draws one picture.

    Parameters
    ----------
    settings : MetamerSettings
        Pooling, levels and strength of the noise; chroma follows luma, and what lies below the last
        level is kept.

    Raises
    ------
    InputError, GLUnavailableError
        If the driver cannot hold the texture or the picture.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        baked: BakedTexture,
        geometry: FlatGeometry,
        settings: MetamerSettings,
        *,
        seed: int = 0,
    ) -> None:
        self._ctx, self._geometry, self._settings = ctx, geometry, settings
        size = geometry.width_px, geometry.height_px
        check_size(ctx, size)
        self._layout = baked.layout
        self._pooled = PoolUniforms(geometry, settings.pooling)
        self._texture = TexturePass(
            ctx, baked, self._pooled, shader_text("globe.vert.glsl"),
            levels=settings.levels, seed=seed,
        )  # fmt: skip
        self._target = ctx.texture(size, 4, dtype="f4")
        self._depth = ctx.depth_renderbuffer(size)
        self._framebuffer = ctx.framebuffer([self._target], self._depth)

    def picture(
        self,
        scene: TexturedScene,
        condition: GlobeCondition,
        gaze_px: tuple[float, float],
        *,
        turn_deg: float = 0.0,
    ) -> NDArray[np.float32]:
        """Picture of the scene, its globes turned: (H, W, 3), encoded R'G'B'."""
        self.draw(scene, condition, gaze_px, turn_deg=turn_deg)
        return self._read()[..., :3]

    def draw(
        self,
        scene: TexturedScene,
        condition: GlobeCondition,
        gaze_px: tuple[float, float],
        *,
        turn_deg: float = 0.0,
    ) -> None:
        """Draw the scene as `picture` does, and leave it on the GPU."""
        program = self._texture.use(
            "colour", foveated=condition != "reference",
            strength=self._settings.noise if condition == "metamer" else 0.0,
        )  # fmt: skip
        backdrop = (BACKDROP, BACKDROP, BACKDROP, 0.0)
        self._draw(scene, program, gaze_px, turn_deg, backdrop)

    def fragments(
        self,
        scene: TexturedScene,
        gaze_px: tuple[float, float],
        *,
        foveated: bool,
        turn_deg: float = 0.0,
    ) -> tuple[Fragments, NDArray[np.bool_]]:
        """Fragments of the pixels, and where a globe is shown (H, W); elsewhere numbers are 0."""
        program = self._texture.use("fragments", foveated=foveated)
        nowhere = (0.0, 0.0, 0.0, -1.0)
        self._draw(scene, program, gaze_px, turn_deg, nowhere)
        found = self._read()
        shown = found[..., 3] >= 0
        found = np.where(shown[..., None], found, 0)
        return Fragments(found[..., :2], found[..., 2], found[..., 3]), shown  # type: ignore[arg-type]

    @property
    def held_bytes(self) -> int:
        """Memory beyond the picture's own, bytes."""
        return self._texture.held_bytes

    def release(self) -> None:
        """Free everything on the GPU."""
        self._ctx.detect_framebuffer(0).use()
        for held in (self._framebuffer, self._depth, self._target, self._texture):
            held.release()

    def _draw(
        self,
        scene: TexturedScene,
        program: moderngl.Program,
        gaze_px: tuple[float, float],
        turn_deg: float,
        backdrop: tuple[float, float, float, float],
    ) -> None:
        ctx, geometry = self._ctx, self._geometry
        self._pooled.set_gaze(gaze_px)
        size = geometry.width_px, geometry.height_px
        lens = (geometry.distance_px, geometry.distance_px, *geometry.centre_px)
        projected = projection(size, lens, _NEAR_M)
        set_uniform(program, "clip_from_camera", columns(projected))
        light = np.asarray(scene.light) / max(float(np.linalg.norm(scene.light)), 1e-9)
        set_uniform(program, "light_direction", tuple(light.tolist()))
        set_uniform(program, "ambient", scene.ambient)
        self._framebuffer.use()
        ctx.viewport = (0, 0, geometry.width_px, geometry.height_px)
        ctx.disable(moderngl.CULL_FACE | moderngl.BLEND)
        ctx.enable(moderngl.DEPTH_TEST)
        ctx.depth_func = "<"
        self._framebuffer.clear(*backdrop, depth=1.0)
        for globe in scene.globes:
            self._draw_globe(program, globe, turn_deg)

    def _read(self) -> NDArray[np.float32]:
        """Pixels that were drawn last, (H, W, 4)."""
        width, height = self._target.size
        pixels = np.empty((height, width, 4), np.float32)
        self._target.read_into(pixels, alignment=1)
        return pixels

    def _draw_globe(self, program: moderngl.Program, globe: Globe, turn_deg: float) -> None:
        vertices, triangles = globe_vertices(globe, turn_deg)
        buffer, index = self._ctx.buffer(vertices), self._ctx.buffer(triangles)
        used = (("in_position", "3f"), ("in_normal", "3f"), ("in_uv", "2f"))
        form = " ".join(f if name in program else f"{f[0]}x4" for name, f in used)
        names = [name for name, _ in used if name in program]
        array = self._ctx.vertex_array(program, [(buffer, form, *names)], index_buffer=index)
        array.render(moderngl.TRIANGLES)
        for held in (array, buffer, index):
            held.release()
