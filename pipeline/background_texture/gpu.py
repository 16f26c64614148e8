"""From where in the frame each hole pixel takes its texture, on the GPU.

Twin: reference.py.
"""

import moderngl

from pipeline.background_texture import reference
from pipeline.frame_textures import FrameTextures
from pipeline.gl.passes import Pass
from pipeline.inpaint.regions import WorkLists


class SeekPass(Pass):
    """Find from where each hole pixel takes its texture. Twin: reference.texture_origins.

    Writes hole pixels of a texture of its own: rg32f, (x, y), negative where there is none.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        size: tuple[int, int],
        lists: WorkLists,
        depth_threshold: float,
    ) -> None:
        steps = {f"STEP_{k}": step for k, step in enumerate(reference.STEPS_PX)}
        super().__init__(ctx)
        self._seek = self._shader(
            "background_texture/seek.comp.glsl",
            REACH=reference.REACH_PX,
            INSET=reference.INSET_PX,
            MARGIN=float(reference.MARGIN_PX),
            OCTANT_TANGENT=reference.OCTANT_TANGENT,
            **steps,
        )
        self._lists = lists
        self._hold(**lists.shared)
        self._seek["depth_threshold"] = depth_threshold
        self.origin_px = self._texture(size, "rg32f")

    def __call__(self, frame: FrameTextures, z_near_m: float) -> moderngl.Texture:
        """Return the texture of origins; one dispatch over the pixels with a hole."""
        self._seek["z_near_m"] = z_near_m
        self._lists.run(
            self._seek,
            ("holes", 1),
            image=frame.colour,
            depth_m=frame.depth_m,
            flow_px=frame.flow_px,
            origin=self.origin_px,
        )
        return self.origin_px
