"""Plate on the GPU: what was filled once stays. Twin: reference.py."""

from collections.abc import Callable

import moderngl
import numpy as np

from pipeline.frame_textures import FrameTextures
from pipeline.gl.passes import Pass
from pipeline.gl.texture import create_texture, texture_from
from pipeline.plate import reference

ROW = 64  # work-group size, pixels in a row
NOBODY = 0xFFFFFFFF  # claims a texel


class PlatePass(Pass):
    """Fill views of one source frame from what they know and what earlier views were filled with.

    Parameters
    ----------
    size : (width, height)
        Of the views.
    depth_threshold : float
        As of `SourcePlate`.
    weight : float
        Alpha of what is kept, where the filler takes alpha as a weight; what is known has 1.
    overwrites : bool
        Whether each view replaces what is kept in its holes.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        size: tuple[int, int],
        depth_threshold: float,
        *,
        weight: float = 1.0,
        overwrites: bool = False,
    ) -> None:
        super().__init__(ctx, {**vars(reference), "ROW": ROW, "STEPS": reference.COLOUR_STEPS})
        self._recall, self._show, self._keep = (
            self._shader(f"plate/{name}.comp.glsl") for name in ("recall", "show", "keep")
        )
        self._set(
            same_surface=float(np.float32(1 - depth_threshold)),
            recalled_weight=weight,
            overwrites=overwrites,
        )
        self._known = self._texture(size, "rgba32f")

    def __call__(
        self, frame: FrameTextures, plate: "PlateTextures", fill: Callable[[FrameTextures], None]
    ) -> None:
        """Fill `frame.colour` in place, and keep in the plate what is new.

        `fill` completes textures: it gets what is known or kept.
        """
        self._set(margin=(plate.margin_px, plate.margin_px))
        self._hold(image=frame.colour, depth_m=frame.depth_m, flow_px=frame.flow_px, **plate.held)
        self._recall.run_over(frame.size, known=self._known)
        fill(FrameTextures(self._known, frame.depth_m, frame.flow_px))
        self._show.run_over(frame.size, known=self._known)
        self._keep.run_over(frame.size)


class PlateTextures:
    """The plate of one source frame; its size is that of the first view.

    Parameters
    ----------
    fill : function of a frame, this plate and a seed
        Fills the frame in place, as `PlatePass` does.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        fill: Callable[[FrameTextures, "PlateTextures", int], None],
    ) -> None:
        self._ctx, self._fill = ctx, fill
        self.held: dict[str, moderngl.Texture | moderngl.Buffer] = {}
        self.margin_px = 0

    def fill_textures(self, frame: FrameTextures, seed: int) -> None:
        """Fill the next view in place, as `KeptFills.fill` does arrays."""
        if not self.held:
            self._begin(frame.size)
        self._fill(frame, self, seed)

    def release(self) -> None:
        """Free the plate."""
        for one in self.held.values():
            one.release()
        self.held = {}

    def _begin(self, size: tuple[int, int]) -> None:
        self.margin_px = reference.margin_px(size)
        width, height = (length + 2 * self.margin_px for length in size)
        nothing = np.zeros((height, width), np.float32)
        nobody = np.full(height * width, NOBODY, np.uint32)
        self.held = {
            "plate": create_texture(self._ctx, (width, height), "rg32ui"),
            "plate_m": texture_from(self._ctx, nothing, "r32f"),
            "claims": self._ctx.buffer(nobody.tobytes()),
        }
