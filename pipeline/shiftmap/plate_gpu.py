"""What was filled once stays, on the GPU. Twin: plate.py."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping

import moderngl
import numpy as np

from pipeline.frame_textures import FrameTextures
from pipeline.gl.compute import Resource, Shader
from pipeline.gl.passes import Pass
from pipeline.gl.texture import create_texture, texture_from
from pipeline.shiftmap.plate import COLOUR_STEPS, READ_SHARE, WRITE_SHARE, margin_px
from pipeline.shiftmap.settings import SUBPIXELS

ROW = 64  # work-group size, pixels in a row
NOBODY = 0xFFFFFFFF  # claims a texel


class KeepingPass(Pass, ABC):
    """Settle frames on plates, in place. How is up to a subclass; keeping is the last dispatch.

    Parameters
    ----------
    depth_threshold : float
        As of `ShiftMapPlate`.
    """

    def __init__(self, ctx: moderngl.Context, depth_threshold: float) -> None:
        super().__init__(ctx)
        self._depth_threshold = depth_threshold
        self._keep = self._plate_shader("shiftmap/keep.comp.glsl")

    def new_plate(self) -> "PlateTextures":
        """Return an empty plate."""
        return PlateTextures(self._ctx, self)

    def __call__(self, frame: FrameTextures, plate: "PlateTextures") -> None:
        """Settle `frame.colour` and keep in the plate what is new."""
        self._set(margin=(plate.margin_px, plate.margin_px))
        given = {
            "image": frame.colour,
            "depth_m": frame.depth_m,
            "flow_px": frame.flow_px,
            **plate.held,
        }
        self._settle(frame, given)
        self._keep.run_over(frame.size, **given)

    @abstractmethod
    def _settle(self, frame: FrameTextures, given: Mapping[str, Resource]) -> None:
        """Bring kept colours into the holes, and claim the texels to keep."""

    def _plate_shader(self, path: str) -> Shader:
        """Compile a shader that includes plate.glsl."""
        shader = self._shader(
            path,
            ROW=ROW,
            SUBPIXELS=SUBPIXELS,
            STEPS=COLOUR_STEPS,
            READ_SHARE=READ_SHARE,
            WRITE_SHARE=WRITE_SHARE,
        )
        if "same_surface" in shader:
            shader["same_surface"] = float(np.float32(1 - self._depth_threshold))
        return shader


class PlatePass(KeepingPass):
    """Take into the holes of frames what is kept there, and keep what is new."""

    def __init__(self, ctx: moderngl.Context, depth_threshold: float) -> None:
        super().__init__(ctx, depth_threshold)
        self._look_up = self._plate_shader("shiftmap/look_up.comp.glsl")

    def _settle(self, frame: FrameTextures, given: Mapping[str, Resource]) -> None:
        self._look_up.run_over(frame.size, **given)


class PlateTextures:
    """The plate of one source frame; its size is that of the first view."""

    def __init__(
        self, ctx: moderngl.Context, settle: Callable[[FrameTextures, "PlateTextures"], None]
    ) -> None:
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
