"""The low bands of a filled frame, near its holes. Other bands are made where they are used.

Twin: features/reference.py.
"""

from itertools import pairwise

import moderngl

from pipeline.features.reference import fitted_kernels
from pipeline.gl.shader import compile_compute
from pipeline.gl.texture import create_texture, texture_bytes
from pipeline.inpaint.gpu import GuidedBasePass
from pipeline.inpaint.region import CELL
from pipeline.inpaint.regions import HALVED_TILE, LIST_GROUP

MIXED = -1024.0  # alpha of what mixes two depths: -16 after the smallest tap, of 1/64


class LowBandPass:
    """Halve a filled frame `levels` - 1 times, near holes only.

    Alpha of a level is 1 where no tap, at any level, was a hole, else 0; with
    `skip_depth_edges` it is `MIXED` where a low band mixed two depths.

    Parameters
    ----------
    base : GuidedBasePass
        Whose lists and guide these are, of as many levels. It must have run on the frame.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        base: GuidedBasePass,
        levels: int,
        *,
        skip_depth_edges: bool = False,
        depth_threshold: float = 0.04,
    ) -> None:
        self._lists = base.lists
        sizes = base.resolutions.sizes
        self._coarser = [create_texture(ctx, sizes[k], "rgba32f") for k in range(1, levels)]
        self._shader = _lowpass(ctx, CELL, depth_edges=False)
        self._first = None
        if skip_depth_edges and levels > 1:
            self._first = _FirstHalving(ctx, base, depth_threshold)

    @property
    def dispatches(self) -> int:
        """How many dispatches one call makes."""
        return len(self._coarser) + (_FirstHalving.dispatches - 1 if self._first else 0)

    @property
    def held_bytes(self) -> int:
        """Memory of the levels, bytes."""
        return sum(texture_bytes(level) for level in self._coarser)

    def __call__(
        self, image: moderngl.Texture, depth_m: moderngl.Texture, z_near_m: float
    ) -> list[moderngl.Texture]:
        """Return the levels, `image` (rgba32f) first."""
        levels = [image, *self._coarser]
        for k, (fine, coarse) in enumerate(pairwise(levels), start=1):
            if k == 1 and self._first:
                self._first(fine, coarse, depth_m, z_near_m)
                continue
            fine.bind_to_image(0, read=True, write=False)
            coarse.bind_to_image(1, read=False, write=True)
            self._lists.run(self._shader, ("source", k + 1))  # 2x2 results each
        return levels

    def release(self) -> None:
        """Free textures and shaders."""
        for texture in self._coarser:
            texture.release()
        self._shader.release()
        if self._first:
            self._first.release()


class _FirstHalving:
    """Halve the frame itself, and look at depth only where it jumps.

    Elsewhere no low band can mix two depths, so there is no need to ask: depth costs as much time
    as colour.
    """

    dispatches = 3

    def __init__(self, ctx: moderngl.Context, base: GuidedBasePass, depth_threshold: float) -> None:
        self._ctx = ctx
        self._base = base
        self._find = compile_compute(
            ctx, "statistics/depth_edges.comp.glsl", HALVED_TILE=HALVED_TILE
        )
        self._find["jumps_list"] = base.lists.appendable(("jumps", 2))
        self._find["plain_list"] = base.lists.appendable(("plain", 2))
        self._find["source_region"] = base.lists.region(("source", 3))
        self._plain = _lowpass(ctx, HALVED_TILE, depth_edges=False)
        self._jumps = _lowpass(ctx, HALVED_TILE, depth_edges=True)
        self._find["depth_threshold"] = self._jumps["depth_threshold"] = depth_threshold

    def __call__(
        self,
        fine: moderngl.Texture,
        coarse: moderngl.Texture,
        depth_m: moderngl.Texture,
        z_near_m: float,
    ) -> None:
        lists = self._base.lists
        self._base.guide.extents.bind_to_image(0, read=True, write=False)
        width, height = self._base.resolutions.sizes[3]
        self._find.run(-(-width // LIST_GROUP), height)
        self._ctx.memory_barrier()
        fine.bind_to_image(0, read=True, write=False)
        coarse.bind_to_image(1, read=False, write=True)
        lists.run(self._plain, ("plain", 2))
        depth_m.bind_to_image(2, read=True, write=False)
        self._jumps["z_near_m"] = z_near_m
        lists.run(self._jumps, ("jumps", 2))

    def release(self) -> None:
        for shader in (self._find, self._plain, self._jumps):
            shader.release()


def _lowpass(ctx: moderngl.Context, tile: int, *, depth_edges: bool) -> moderngl.ComputeShader:
    low = fitted_kernels().low
    return compile_compute(
        ctx,
        "statistics/lowpass.comp.glsl",
        TILE=tile,
        LOW_INNER=float(low[1, 1]),
        LOW_MIXED=float(low[0, 1]),
        LOW_OUTER=float(low[0, 0]),
        MIXED=MIXED,
        DEPTH_EDGES=depth_edges,
    )
