"""Cuts through the gaze on the GPU, for a gaze that moves. Twin: `bisected` in drawn.py."""

from __future__ import annotations

import moderngl

from pipeline.foveation.drawn import cut_normal
from pipeline.foveation.geometry import FlatGeometry
from pipeline.foveation.picture_pass import TILE
from pipeline.gl.compute import Dispatches
from pipeline.gl.passes import Pass
from pipeline.gl.texture import check_texture


class CutPass(Pass):
    """Shows one picture on one side of a line through the gaze, another on the other side.

    Parameters
    ----------
    geometry : FlatGeometry
        Of all three.
    """

    def __init__(self, ctx: moderngl.Context, geometry: FlatGeometry) -> None:
        super().__init__(ctx)
        self._geometry = geometry
        self.size = geometry.width_px, geometry.height_px
        shader = self._shader("foveation/shaders/cut.comp.glsl", TILE=TILE)
        shader["centre_px"] = geometry.centre_px
        shader["distance_px"] = geometry.distance_px
        self._normal, self._ramp = shader.uniform("normal"), shader.uniform("ramp_deg")
        self._steps = Dispatches(
            lambda first, second, target: shader.step_over(
                self.size, first=first, second=second, target=target
            )
        )

    def __call__(
        self,
        first: moderngl.Texture,
        second: moderngl.Texture,
        target: moderngl.Texture,
        gaze_px: tuple[float, float],
        *,
        angle_deg: float,
        ramp_deg: float,
    ) -> None:
        """Show `first` on the left of the line's direction, `second` (rgba8 too) on its right."""
        check_texture(first, "first", self.size, "rgba32f")
        check_texture(second, "second", self.size, "rgba32f", "rgba8")
        check_texture(target, "target", self.size, "rgba32f")
        self._normal.value = tuple(map(float, cut_normal(self._geometry, gaze_px, angle_deg)))
        self._ramp.value = ramp_deg
        self._steps.run(first, second, target)
