"""Recirculation of the last shown frame, on the GPU. Twin: recirculation.py."""

from collections.abc import Mapping

import moderngl

from pipeline.frame_textures import FrameTextures
from pipeline.gl.compute import Resource
from pipeline.shiftmap.plate_gpu import KeepingPass
from pipeline.weighted_pullpush.gpu import WeightedPullPushPass
from pipeline.weighted_pullpush.recirculation import SAME_SURFACE


class RecirculationPass(KeepingPass):
    """Fill views of one size again, from what they know and what was shown before.

    Parameters
    ----------
    size : (width, height)
    weight : float
        As of `Recirculation`.
    """

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], weight: float) -> None:
        super().__init__(ctx, SAME_SURFACE)
        self._recall = self._plate_shader("weighted_pullpush/recall.comp.glsl")
        self._recall["recirculated"] = weight
        self._show = self._plate_shader("weighted_pullpush/show.comp.glsl")
        self._fill = self._part(WeightedPullPushPass(ctx, size))
        self._weighted = self._texture(size, "rgba32f")

    def _settle(self, frame: FrameTextures, given: Mapping[str, Resource]) -> None:
        self._recall.run_over(frame.size, weighted=self._weighted, **given)
        self._fill(self._weighted, self._weighted)
        self._show.run_over(frame.size, filled=self._weighted, **given)
