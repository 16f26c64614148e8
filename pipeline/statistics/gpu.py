"""How much noise each hole pixel lacks, on the GPU: band moments, inpainted, less the base's.

Twins: reference.py, lacking.py.
"""

from collections.abc import Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.features.gpu import band_constants
from pipeline.gl.shader import compile_compute
from pipeline.gl.texture import create_texture, texture_bytes
from pipeline.inpaint.gpu import MOMENT_PLANES, ChainPass, GuidedBasePass
from pipeline.inpaint.region import CELL
from pipeline.inpaint.regions import FIRST_STORED
from pipeline.statistics.lacking import (
    KNOWN_ENOUGH,
    SMALLEST_VARIANCE,
)

BANDS = 3  # high, along x, along y: so many texels side by side


class VariancePass:
    """Measure the bands around the holes, carry their moments into them, say what is lacking.

    The result is `texels`, an image in which the levels lie as `places` says: texels of
    resolution k + 1 for level k, `BANDS` side by side, written where hole pixels look them up.

    Parameters
    ----------
    base : GuidedBasePass
        Whose holes, guide and lists these are; it must have run on the frame.
    levels, cross, gamma, depth_threshold, skip_depth_edges
        As for `reference.inpainted_statistics`.
    with_gain : bool
        Also say how much of the background's detail to add.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        base: GuidedBasePass,
        *,
        levels: int,
        cross: bool,
        gamma: float,
        depth_threshold: float,
        skip_depth_edges: bool,
        with_gain: bool,
    ) -> None:
        self._base = base
        self._levels = levels
        sizes = base.resolutions.sizes[1 : levels + 1]
        # Level 0 above, the others side by side below it.
        corners = [(0, 0)]
        corners += [
            (BANDS * sum(width for width, _ in sizes[1:k]), sizes[0][1]) for k in range(1, levels)
        ]
        widest = max(sizes[0][0], sum(width for width, _ in sizes[1:]))
        height = sum(rows for _, rows in sizes[:2])
        self.places = np.array(
            [(*size, *corner) for size, corner in zip(sizes, corners, strict=True)], np.int32
        )
        self.texels = create_texture(ctx, (BANDS * widest, height), "rgba32f")
        self.chain = ChainPass(
            ctx,
            base.resolutions,
            base.lists,
            base.guide,
            planes=MOMENT_PLANES,
            is_base=False,
            gamma=gamma,
            depth_threshold=depth_threshold,
        )
        bands = {
            **band_constants(),
            "PLANES": MOMENT_PLANES,
            "CROSS": cross,
            "SKIP_DEPTH_EDGES": skip_depth_edges,
        }
        # For coarser levels, and for the finest.
        self._first = [
            compile_compute(
                ctx,
                "statistics/moments_first.comp.glsl",
                IS_FINEST=finest,
                TILE=CELL // 2,
                **bands,
            )
            for finest in (False, True)
        ]
        self._lacking = [
            compile_compute(
                ctx,
                "statistics/lacking.comp.glsl",
                IS_FINEST=finest,
                KNOWN_ENOUGH=KNOWN_ENOUGH,
                SMALLEST_VARIANCE=SMALLEST_VARIANCE,
                GAMMA=float(gamma),
                GAIN=with_gain,
                **bands,
            )
            for finest in (False, True)
        ]
        for shader in (*self._first, *self._lacking):
            shader["depth_threshold"] = depth_threshold

    @property
    def dispatches(self) -> int:
        """How many dispatches one call makes."""
        return self._levels + self.chain.dispatches + self._levels

    @property
    def held_bytes(self) -> int:
        """Memory, bytes."""
        return self.chain.held_bytes + texture_bytes(self.texels)

    def __call__(
        self, levels: Sequence[moderngl.Texture], depth_m: moderngl.Texture, z_near_m: float
    ) -> None:
        """Write `texels`, given the filled frame's levels (`LowBandPass`)."""
        for k, level in enumerate(levels):
            shader = self._first[k == 0]
            self._bind(shader, k, level, depth_m, z_near_m)
            lists = self._base.lists
            shader["halves_list"] = lists.appendable(("halves", k))
            shader["incomplete_list"] = lists.appendable(("moments", k + FIRST_STORED))
            lists.run(shader, ("first", k), k + FIRST_STORED)
        self.chain()
        self.texels.bind_to_image(3, read=False, write=True)
        for k, level in enumerate(levels):
            shader = self._lacking[k == 0]
            self._bind(shader, k, level, depth_m, z_near_m)
            self._base.chain.at(k + 1).bind_to_image(6)
            shader["coarse_size"] = self._base.resolutions.sizes[k + FIRST_STORED]
            shader["corner"] = tuple(self.places[k, 2:].tolist())
            self._base.lists.run(shader, ("halves", k))

    def level_of(self, texels: NDArray[np.float32], k: int) -> NDArray[np.float32]:
        """What `texels`, read back, holds of a level: (rows, columns, BANDS, 4)."""
        columns, rows, left, top = self.places[k]
        here = texels[top : top + rows, left : left + BANDS * columns]
        return here.reshape(rows, columns, BANDS, 4)

    def _bind(
        self,
        shader: moderngl.ComputeShader,
        k: int,
        level: moderngl.Texture,
        depth_m: moderngl.Texture,
        z_near_m: float,
    ) -> None:
        """A level's colour and guide, the guides of both halvings, and its stored moments."""
        guide = self._base.guide
        level.bind_to_image(0, read=True, write=False)
        if k == 0:
            depth_m.bind_to_image(1, read=True, write=False)
            shader["z_near_m"] = z_near_m
        else:
            guide.at(k).bind_to_image(1)
        self.chain.at(k + FIRST_STORED).bind_to_image(2)
        guide.at(k + 1).bind_to_image(4)
        guide.at(k + FIRST_STORED).bind_to_image(5)

    def release(self) -> None:
        """Free everything this pass made."""
        self.chain.release()
        self.texels.release()
        for shader in (*self._first, *self._lacking):
            shader.release()
