"""The metamer of moment maps on the GPU, in two passes. Twin: metamer_of() in maps.py.

Noise is weighed for blocks of 4x4 pixels; the last pass of foveated metamers adds it.
"""

from __future__ import annotations

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.denoising.maps import MomentMaps
from pipeline.foveation.geometry import Geometry
from pipeline.foveation.picture_pass import PoolUniforms, WeighedNoisePass, halved, weight_layers
from pipeline.foveation.pooling import Pooling
from pipeline.foveation.reference import AIM
from pipeline.gl.texture import check_texture, upload
from pipeline.noise.gains import gain_constants


class DenoisePass(WeighedNoisePass):
    """Makes metamers of flat pictures' maps, of one size and number of levels.

    Compiles and allocates on construction. `load` uploads maps; a call binds and dispatches twice.
    """

    def __init__(
        self, ctx: moderngl.Context, geometry: Geometry, pooling: Pooling, levels: int
    ) -> None:
        if geometry.on_sphere:
            raise ValueError("these passes know flat pictures only; numpy knows panoramas")
        self._eye = PoolUniforms(geometry, pooling)
        super().__init__(ctx, (geometry.width_px, geometry.height_px), self._eye)
        self.levels = levels
        self._prepare(levels)
        self._maps = self._array(self._blocks, weight_layers(levels, bent=False))
        gains = gain_constants(levels, aim=AIM)
        self._weigh = self._shader("denoising/weights.comp.glsl", **gains)

    def load(self, maps: MomentMaps) -> None:
        """Upload maps of this size and these levels."""
        if maps.base.shape[1::-1] != self.size or maps.levels != self.levels:
            raise ValueError("a pass makes metamers of one size and number of levels only")
        upload(
            self._base,
            np.pad(maps.base.astype(np.float32), ((0, 0), (0, 0), (0, 1)), constant_values=1),
        )
        self._maps.write(map_layers(maps).tobytes())

    def __call__(
        self, target: moderngl.Texture, gaze_px: tuple[float, float], *, seed: int = 0
    ) -> None:
        """Make the metamer of what was loaded, into `target`: rgba32f of the picture's size."""
        check_texture(target, "target", self.size, "rgba32f")
        self._eye.set_gaze(gaze_px)
        self._weigh.run_over(halved(self._blocks), maps=self._maps, weights=self._weights)
        self._add_noise(target, seed)

    def apply(
        self, maps: MomentMaps, gaze_px: tuple[float, float], *, seed: int = 0
    ) -> NDArray[np.float32]:
        """Load, work, read back: for callers without textures."""
        self.load(maps)
        return self._read(lambda target: self(target, gaze_px, seed=seed))


def map_layers(maps: MomentMaps) -> NDArray[np.float32]:
    """Maps as the shader reads them: (layers, h, w, 4), a layer a level, then Cr of four each."""
    height, width, levels = maps.slopes.shape[:3]
    layers = np.zeros((weight_layers(levels, bent=False), height, width, 4), np.float32)
    bands = maps.deviations.reshape(height, width, levels, 3)
    for level in range(levels):
        layers[level, ..., :3] = bands[:, :, level]
        layers[level, ..., 3] = maps.slopes[:, :, level, 0]
        layers[levels + level // 4, ..., level % 4] = maps.slopes[:, :, level, 1]
    return layers
