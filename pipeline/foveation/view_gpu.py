"""Flat views out of a panorama on the GPU, with noise that lies on directions. Twin: view.py."""

from __future__ import annotations

import math

import moderngl
import numpy as np

from pipeline.foveation.displacement import CUBIC
from pipeline.foveation.geometry import FlatGeometry
from pipeline.foveation.picture_pass import TILE
from pipeline.foveation.view import NOISE_BELT_DEG, belt_px, samples_of, turn
from pipeline.gl.compute import Dispatches
from pipeline.gl.passes import Pass
from pipeline.gl.texture import check_texture


class ViewPass(Pass):
    """Looks at a panorama in any direction.

    Parameters
    ----------
    panorama_px : (width, height)
        Of the panorama.
    geometry : FlatGeometry
        Of the view.
    """

    def __init__(
        self, ctx: moderngl.Context, panorama_px: tuple[int, int], geometry: FlatGeometry
    ) -> None:
        super().__init__(ctx)
        self._panorama_px = panorama_px
        self.size = geometry.width_px, geometry.height_px
        shader = self._shader(
            "foveation/shaders/view.comp.glsl",
            TILE=TILE,
            SAMPLES=samples_of(geometry, panorama_px[0]),
            BELT_SINE=math.sin(math.radians(NOISE_BELT_DEG)),
            CUBIC=CUBIC,
        )
        shader["centre_px"] = geometry.centre_px
        shader["distance_px"] = geometry.distance_px
        shader["belt_px"] = belt_px(geometry)
        self._turned = shader.uniform("turned")
        self._steps = Dispatches(
            lambda panorama, view, shift_px: shader.step_over(
                self.size, panorama=panorama, view=view, shift_px=shift_px
            )
        )

    def __call__(
        self,
        panorama: moderngl.Texture,
        view: moderngl.Texture,
        shift_px: moderngl.Texture,
        *,
        right_deg: float = 0.0,
        down_deg: float = 0.0,
    ) -> None:
        """Look into a direction: `view` (rgba32f), and its `noise_shift_px` (rg32f)."""
        check_texture(panorama, "panorama", self._panorama_px, "rgba32f", "rgba8")
        check_texture(view, "view", self.size, "rgba32f")
        check_texture(shift_px, "shift_px", self.size, "rg32f")
        # OpenGL has a matrix column by column.
        self._turned.write(turn(right_deg, down_deg).T.astype(np.float32).tobytes())
        self._steps.run(panorama, view, shift_px)
