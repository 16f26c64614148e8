"""Compressed pictures made again on the GPU, in three passes. Twin: decompress() in codec.py.

Colour is unfolded from its cells; noise is weighed for blocks of 4x4 pixels; both are added by the
last pass of foveated metamers.
"""

from __future__ import annotations

import math

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.compression import image_codecs
from pipeline.compression.codec import decoded_cells
from pipeline.compression.compressed_file import CompressedPicture, atlas_shape
from pipeline.errors import InputError
from pipeline.foveation.displacement import CUBIC
from pipeline.foveation.geometry import Flat
from pipeline.foveation.picture_pass import PoolUniforms, WeighedNoisePass, halved
from pipeline.foveation.pooling import Pooling
from pipeline.foveation.reference import AIM
from pipeline.gl.compute import Shader
from pipeline.gl.shader import Constant
from pipeline.gl.texture import check_texture, upload
from pipeline.noise.gains import gain_constants


class DecompressPass(WeighedNoisePass):
    """Makes pictures of one file, or of files with the same grid and levels.

    Compiles and allocates on construction. `load` uploads a frame; a call binds and dispatches.
    """

    def __init__(self, ctx: moderngl.Context, like: CompressedPicture) -> None:
        self._eye = PoolUniforms(Flat().of(*like.grid.size), Pooling(fovea_deg=0))
        self._grid, self._maps = like.grid, like.map_grids()
        density = self._grid.density
        first, span = self._grid.arc
        constants: dict[str, Constant] = {
            "CUBIC": CUBIC,
            "FIRST_RAD": first,
            "KNEE_PX": density.knee_px,
            "LEFT_OUT_RAD": (2 * math.pi - span) / 2,
            "START_PX": density.start_px,
            "TURN_PX": density.turn_px,
            "WHOLE_TURN": self._grid.whole_turn,
        }
        super().__init__(ctx, like.grid.size, self._eye, constants)
        self.levels = len(self._maps)
        self._cells = self._texture(self._grid.shape, "rgba8")
        self._unfold = self._polar_shader("unfold")
        if self.levels:
            self._prepare(self.levels)
            self._prepare_maps()

    def load(self, compressed: CompressedPicture, frame: int = 0) -> None:
        """Decode a frame's pictures and upload them.

        Raises
        ------
        InputError
            If they are damaged, or the file has another grid or other levels.
        """
        if compressed.grid != self._grid or compressed.levels != self.levels:
            raise InputError("a pass makes pictures of one grid and number of levels only")
        cells = decoded_cells(compressed.bases[frame], self._grid, compressed.codec)
        turned = np.pad(cells.transpose(1, 0, 2), ((0, 0), (0, 0), (0, 1)))
        upload(self._cells, np.ascontiguousarray(turned))
        if self.levels:
            held = compressed.statistics[frame // compressed.hold]
            shape = atlas_shape(self._maps)
            upload(
                self._atlas, image_codecs.decode(held.atlas, compressed.codec, shape, "the maps")
            )
            self._weigh["scales"] = held.scales

    def __call__(self, target: moderngl.Texture, *, seed: int = 0) -> None:
        """Make the frame that was loaded, into `target`: rgba32f of the picture's size."""
        self._play(self._colour, target)
        if self.levels:
            self._add_noise(target, seed)

    def _colour(self, target: moderngl.Texture) -> None:
        check_texture(target, "target", self.size, "rgba32f")
        picture = self._base if self.levels else target
        self._unfold.run_over(self.size, cells=self._cells, picture=picture)
        if self.levels:
            self._weigh.run_over(halved(self._blocks), atlas=self._atlas, weights=self._weights)

    def apply(
        self, compressed: CompressedPicture, *, seed: int = 0, frame: int = 0
    ) -> NDArray[np.float32]:
        """Load, work, read back: for callers without textures."""
        self.load(compressed, frame)
        return self._read(lambda target: self(target, seed=seed))

    def _polar_shader(self, name: str, **constants: Constant) -> Shader:
        shader = self._shader(f"compression/{name}.comp.glsl", **constants)
        shader["gaze_px"] = self._grid.gaze_px
        return shader

    def _prepare_maps(self) -> None:
        rows, columns = atlas_shape(self._maps)
        self._atlas = self._texture((columns, rows), "r8")
        self._weigh = self._polar_shader(
            "weights",
            MAP_ROWS=self._maps[0].shape[0],
            MAP_KNEE=self._maps[0].density.knee_px,
            **gain_constants(self.levels, aim=AIM),
        )
        ends = np.cumsum([0, *(grid.shape[1] for grid in self._maps)])
        places = [
            (first, grid.shape[1], grid.density.start_px)
            for first, grid in zip(ends[:-1], self._maps, strict=True)
        ]
        self._weigh["places"] = np.array(places, np.float32)
        self._eye.set_gaze(self._grid.gaze_px)
