"""From where in the frame each hole pixel takes its texture, on the GPU.

Twin: reference.py.
"""

import moderngl

from pipeline.background_texture import reference
from pipeline.gl.shader import compile_compute
from pipeline.gl.texture import create_texture, texture_bytes
from pipeline.inpaint.regions import WorkLists


class SeekPass:
    """Find from where each hole pixel takes its texture. Twin: reference.texture_origins.

    Writes hole pixels of a texture of its own: rg32f, (x, y), negative where there is none.
    """

    def __init__(
        self, ctx: moderngl.Context, size: tuple[int, int], depth_threshold: float
    ) -> None:
        steps = {f"STEP_{k}": step for k, step in enumerate(reference.STEPS_PX)}
        self._shader = compile_compute(
            ctx,
            "background_texture/seek.comp.glsl",
            REACH=reference.REACH_PX,
            INSET=reference.INSET_PX,
            MARGIN=float(reference.MARGIN_PX),
            OCTANT_TANGENT=reference.OCTANT_TANGENT,
            **steps,
        )
        self._shader["depth_threshold"] = depth_threshold
        self.origin_px = create_texture(ctx, size, "rg32f")

    @property
    def held_bytes(self) -> int:
        """Memory, bytes."""
        return texture_bytes(self.origin_px)

    def __call__(
        self,
        image: moderngl.Texture,
        depth_m: moderngl.Texture,
        flow_px: moderngl.Texture,
        z_near_m: float,
        lists: WorkLists,
    ) -> moderngl.Texture:
        """Return the texture of origins; one dispatch over the pixels with a hole."""
        image.bind_to_image(0, read=True, write=False)
        depth_m.bind_to_image(1, read=True, write=False)
        flow_px.bind_to_image(2, read=True, write=False)
        self.origin_px.bind_to_image(3, read=False, write=True)
        self._shader["z_near_m"] = z_near_m
        lists.run(self._shader, ("holes", 1))
        return self.origin_px

    def release(self) -> None:
        """Free shader and texture."""
        self._shader.release()
        self.origin_px.release()
