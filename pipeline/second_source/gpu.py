"""Two warped pictures of one view made one, on the GPU. Twin: reference.py."""

import moderngl

from pipeline.frame_textures import FrameTextures
from pipeline.gl.passes import Pass


class CompletePass(Pass):
    """Take from a second warped picture what is a hole in the first. One dispatch."""

    def __init__(self, ctx: moderngl.Context) -> None:
        super().__init__(ctx)
        self._complete = self._shader("second_source/complete.comp.glsl", TILE=8)

    def __call__(self, first: FrameTextures, second: FrameTextures) -> None:
        """Complete `first` in place; both have one size."""
        self._complete.run_over(
            first.size,
            colour=first.colour,
            depth_m=first.depth_m,
            flow_px=first.flow_px,
            second_colour=second.colour,
            second_depth_m=second.depth_m,
            second_flow_px=second.flow_px,
        )
