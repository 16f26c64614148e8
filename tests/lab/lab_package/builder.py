"""Draws the ramps, and fills them with any method that is registered."""

import numpy as np

from pipeline.frame import WarpedFrame
from pipeline.methods.registry import create_method
from protocols.manifest import Clip, cache_key
from stimuli.media.png import encode_frame
from stimuli.recipes.single_stimuli import SingleStimulusBuilder
from stimuli.worker import RendererInfo


def ramp(scene, edge_px):
    grey = np.linspace(0.2, 0.8, edge_px, dtype=np.float32)
    across = np.broadcast_to(grey, (edge_px, edge_px))
    return np.repeat((across if scene == "a" else across.T)[..., None], 3, axis=2)


class RampBuilder(SingleStimulusBuilder):
    renderer = RendererInfo("", "lab ramps", "")

    @property
    def recipe(self):
        return self.protocol.stimuli

    @property
    def wanted(self):
        return self.recipe.pool()

    def _fill(self, stimulus):
        return self.recipe.fills.get(stimulus.condition["method"])

    def key(self, stimulus):
        scene, fill = stimulus.condition["scene"], self._fill(stimulus)
        return cache_key({"scene": scene, "fill": fill, "edge_px": self.recipe.edge_px})

    def encoded(self, stimulus):
        edge_px, fill = self.recipe.edge_px, self._fill(stimulus)
        colour = ramp(stimulus.condition["scene"], edge_px)
        if fill is not None:
            hole = np.zeros((edge_px, edge_px), bool)
            hole[: edge_px // 2, : edge_px // 2] = True
            method = create_method(fill)
            still = np.zeros((edge_px, edge_px, 2), np.float32)
            warped = WarpedFrame(colour, np.ones(hole.shape, np.float32), hole, still)
            colour = method.fill(warped, seed=0)
            method.release()
        yield encode_frame(colour, 8)

    def record(self, stimulus, key, hashes):
        return Clip(
            name=stimulus.name, condition=dict(stimulus.condition), width_px=self.recipe.edge_px,
            height_px=self.recipe.edge_px, fps=1.0, bit_depth=8, seed=0, parameters={},
            cache_key=key, frames_sha256=hashes,
        )  # fmt: skip
