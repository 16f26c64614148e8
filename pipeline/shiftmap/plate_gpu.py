"""What was filled once stays, on the GPU. Twin: plate.py."""

import moderngl
import numpy as np

from pipeline.frame_textures import FrameTextures
from pipeline.gl.passes import Pass
from pipeline.gl.texture import create_texture, texture_from
from pipeline.shiftmap.plate import COLOUR_STEPS, READ_SHARE, WRITE_SHARE, margin_px
from pipeline.shiftmap.settings import SUBPIXELS

ROW = 64  # work-group size, pixels in a row
NOBODY = 0xFFFFFFFF  # claims a texel


class PlatePass(Pass):
    """Settle frames on plates, in place; two dispatches.

    Parameters
    ----------
    depth_threshold : float
        As of `ShiftMapPlate`.
    """

    def __init__(self, ctx: moderngl.Context, depth_threshold: float) -> None:
        super().__init__(ctx)
        shared = {"ROW": ROW, "SUBPIXELS": SUBPIXELS, "STEPS": COLOUR_STEPS}
        self._look_up = self._shader(
            "shiftmap/look_up.comp.glsl", **shared, READ_SHARE=READ_SHARE, WRITE_SHARE=WRITE_SHARE
        )
        self._keep = self._shader("shiftmap/keep.comp.glsl", **shared)
        self._set(same_surface=float(np.float32(1 - depth_threshold)))

    def new_plate(self) -> "PlateTextures":
        """Return an empty plate."""
        return PlateTextures(self._ctx, self)

    def __call__(self, frame: FrameTextures, plate: "PlateTextures") -> None:
        """Take into the holes of `frame.colour` what is kept there, and keep what is new."""
        self._set(margin=(plate.margin_px, plate.margin_px))
        given = {
            "image": frame.colour,
            "depth_m": frame.depth_m,
            "flow_px": frame.flow_px,
            **plate.held,
        }
        self._look_up.run_over(frame.size, **given)
        self._keep.run_over(frame.size, **given)


class PlateTextures:
    """The plate of one source frame; its size is that of the first view."""

    def __init__(self, ctx: moderngl.Context, settle: PlatePass) -> None:
        self._ctx, self._settle = ctx, settle
        self.held: dict[str, moderngl.Texture | moderngl.Buffer] = {}
        self.margin_px = 0

    def settle_textures(self, frame: FrameTextures) -> None:
        """As `ShiftMapPlate.settle`, in place: `frame.colour` holds the view's own fill."""
        if not self.held:
            self._begin(frame.size)
        self._settle(frame, self)

    def release(self) -> None:
        """Free the plate."""
        for one in self.held.values():
            one.release()
        self.held = {}

    def _begin(self, size: tuple[int, int]) -> None:
        self.margin_px = margin_px(size)
        width, height = (length + 2 * self.margin_px for length in size)
        nothing = np.zeros((height, width), np.float32)
        nobody = np.full(height * width, NOBODY, np.uint32)
        self.held = {
            "plate": create_texture(self._ctx, (width, height), "rg32ui"),
            "plate_m": texture_from(self._ctx, nothing, "r32f"),
            "claims": self._ctx.buffer(nobody.tobytes()),
        }
