"""The low bands of a filled frame, near its holes. Other bands are made where they are used.

Twin: features/reference.py.
"""

from itertools import pairwise

import moderngl

from pipeline.features.reference import low_constants
from pipeline.gl.passes import Pass
from pipeline.gl.shader import Constant
from pipeline.inpaint.gpu import GuidedBasePass
from pipeline.inpaint.regions import CELL, HALVED_TILE, LIST_GROUP

LOWPASS = "statistics/lowpass.comp.glsl"
MIXED = -1024.0  # alpha of what mixes two depths: -16 after the smallest tap, of 1/64


class LowBandPass(Pass):
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
        super().__init__(ctx)
        self._lists = base.lists
        sizes = base.resolutions.sizes
        self._coarser = [self._texture(sizes[k], "rgba32f") for k in range(1, levels)]
        self._halve = self._shader(LOWPASS, **_constants(CELL, depth_edges=False))
        self._hold(**base.lists.shared)
        self._first = None
        if skip_depth_edges and levels > 1:
            self._first = self._part(_FirstHalving(ctx, base, depth_threshold))

    def __call__(
        self, image: moderngl.Texture, depth_m: moderngl.Texture, z_near_m: float
    ) -> list[moderngl.Texture]:
        """Return the levels, `image` (rgba32f) first."""
        levels = [image, *self._coarser]
        for k, (fine, coarse) in enumerate(pairwise(levels), start=1):
            if k == 1 and self._first:
                self._first(fine, coarse, depth_m, z_near_m)
                continue
            # 2x2 results each
            self._lists.run(self._halve, ("source", k + 1), fine=fine, coarse=coarse)
        return levels


class _FirstHalving(Pass):
    """Halve the frame itself, and look at depth only where it jumps.

    Elsewhere no low band can mix two depths, so there is no need to ask: depth costs as much time
    as colour.
    """

    def __init__(self, ctx: moderngl.Context, base: GuidedBasePass, depth_threshold: float) -> None:
        super().__init__(ctx)
        self._base = base
        self._find = self._shader("statistics/depth_edges.comp.glsl", HALVED_TILE=HALVED_TILE)
        self._find["jumps_list"] = base.lists.appendable(("jumps", 2))
        self._find["plain_list"] = base.lists.appendable(("plain", 2))
        self._find["source_region"] = base.lists.region(("source", 3))
        self._plain = self._shader(LOWPASS, **_constants(HALVED_TILE, depth_edges=False))
        self._jumps = self._shader(LOWPASS, **_constants(HALVED_TILE, depth_edges=True))
        self._set(depth_threshold=depth_threshold)
        self._hold(**base.lists.shared)

    def __call__(
        self,
        fine: moderngl.Texture,
        coarse: moderngl.Texture,
        depth_m: moderngl.Texture,
        z_near_m: float,
    ) -> None:
        lists = self._base.lists
        width, height = self._base.resolutions.sizes[3]
        extents = self._base.guide.extents
        self._find.run(-(-width // LIST_GROUP), height, extents=extents)
        lists.run(self._plain, ("plain", 2), fine=fine, coarse=coarse)
        self._jumps["z_near_m"] = z_near_m
        lists.run(self._jumps, ("jumps", 2), fine=fine, coarse=coarse, depth_m=depth_m)


def _constants(tile: int, *, depth_edges: bool) -> dict[str, Constant]:
    return {"TILE": tile, "MIXED": MIXED, "DEPTH_EDGES": depth_edges, **low_constants()}
