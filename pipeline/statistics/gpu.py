"""Noise that each hole pixel lacks, on the GPU: band moments, inpainted, less the base's.

`LowBandPass` makes the low bands of a filled frame near its holes; other bands are made where they
are used. Twins: reference.py, moments.py, features/reference.py.
"""

from collections.abc import Sequence
from itertools import pairwise

import moderngl
import numpy as np

from pipeline.features.reference import band_constants, low_constants
from pipeline.gl.passes import Pass
from pipeline.inpaint.gpu import MOMENT_PLANES, GuidedBasePass, GuidedChainPass
from pipeline.inpaint.regions import CELL, FIRST_STORED, HALVED_TILE, LIST_GROUP
from pipeline.statistics import moments

BANDS = 3  # high, along x, along y: so many texels side by side


class VariancePass(Pass):
    """Measure the bands around the holes, carry their moments into them, say what is lacking.

    The result is `texels`, an image in which the levels lie as `places` says: texels of
    resolution k + 1 for level k, `BANDS` side by side, written where hole pixels look them up.

    Parameters
    ----------
    base : GuidedBasePass
        Whose holes, guide and lists these are; it must have run on the frame.
    levels, cross, skip_depth_edges
        As for `reference.inpainted_statistics`.
    gate : moderngl.Texture, optional
        Part that coefficients of 4x4 pixels take (r32f); written where `("first", 1)` visits.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        base: GuidedBasePass,
        *,
        levels: int,
        cross: bool,
        skip_depth_edges: bool,
        gate: moderngl.Texture | None = None,
    ) -> None:
        constants = {
            **vars(moments),
            **band_constants(),
            "PLANES": MOMENT_PLANES,
            "CROSS": cross,
            "GATED": gate is not None,
            "SKIP_DEPTH_EDGES": skip_depth_edges,
            "TILE": CELL // 2,
            "GAMMA": base.gamma,
        }
        super().__init__(ctx, constants)
        self._base = base
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
        self.texels = self._texture((BANDS * widest, height), "rgba32f")
        self.chain = self._part(GuidedChainPass(ctx, base, planes=MOMENT_PLANES, is_base=False))
        # For coarser levels, and for the finest.
        self._first, self._lacking = (
            [
                self._shader(f"statistics/{name}.comp.glsl", IS_FINEST=finest)
                for finest in (False, True)
            ]
            for name in ("moments_first", "lacking")
        )
        self._set(depth_threshold=base.depth_threshold)
        self._hold(**base.lists.shared)
        if gate is not None:
            self._hold(gate=gate)

    def __call__(self, levels: Sequence[moderngl.Texture], depth_m: moderngl.Texture) -> None:
        """Write `texels`, given the filled frame's levels (`LowBandPass`)."""
        lists = self._base.lists
        for k, level in enumerate(levels):
            shader = self._first[k == 0]
            shader["gate_shift"] = FIRST_STORED - k
            shader["halves_list"] = lists.appendable(("halves", k))
            shader["incomplete_list"] = lists.appendable(("moments", k + FIRST_STORED))
            own = self.chain.at(k + FIRST_STORED)
            seen = self._seen(k, level, depth_m)
            lists.run(shader, ("first", k), k + FIRST_STORED, moments=own, **seen)
        self.chain()
        for k, level in enumerate(levels):
            shader = self._lacking[k == 0]
            shader["gate_shift"] = FIRST_STORED - k
            shader["coarse_size"] = self._base.resolutions.sizes[k + FIRST_STORED]
            shader["corner"] = tuple(self.places[k, 2:].tolist())
            lists.run(
                shader,
                ("halves", k),
                coarse=self.chain.at(k + FIRST_STORED),
                variances=self.texels,
                base=self._base.chain.at(k + 1),
                **self._seen(k, level, depth_m),
            )

    def _seen(
        self, k: int, level: moderngl.Texture, depth_m: moderngl.Texture
    ) -> dict[str, moderngl.Texture]:
        """A level's colour and guide, and the guides of both halvings."""
        guide = self._base.guide
        own = {"level_guide": guide.at(k)} if k else {"depth_m": depth_m}
        halved = {"half_guide": guide.at(k + 1), "quarter_guide": guide.at(k + FIRST_STORED)}
        return {"level": level, **own, **halved}


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
    ) -> None:
        super().__init__(ctx, {**low_constants(), "MIXED": MIXED})
        self._lists = base.lists
        sizes = base.resolutions.sizes
        self._coarser = [self._texture(sizes[k], "rgba32f") for k in range(1, levels)]
        self._halve = self._shader(LOWPASS, TILE=CELL, DEPTH_EDGES=False)
        self._hold(**base.lists.shared)
        self._first = None
        if skip_depth_edges and levels > 1:
            self._first = self._part(_FirstHalving(ctx, base))

    def __call__(
        self, image: moderngl.Texture, depth_m: moderngl.Texture
    ) -> list[moderngl.Texture]:
        """Return the levels, `image` (rgba32f) first."""
        levels = [image, *self._coarser]
        for k, (fine, coarse) in enumerate(pairwise(levels), start=1):
            if k == 1 and self._first:
                self._first(fine, coarse, depth_m)
                continue
            # 2x2 results each
            self._lists.run(self._halve, ("source", k + 1), fine=fine, coarse=coarse)
        return levels


class _FirstHalving(Pass):
    """Halve the frame itself, and look at depth only where it jumps.

    Elsewhere no low band can mix two depths, so there is no need to ask: depth costs as much time
    as colour.
    """

    def __init__(self, ctx: moderngl.Context, base: GuidedBasePass) -> None:
        constants = {"HALVED_TILE": HALVED_TILE, "TILE": HALVED_TILE, "MIXED": MIXED}
        super().__init__(ctx, {**low_constants(), **constants})
        self._base = base
        self._find = self._shader("statistics/depth_edges.comp.glsl")
        self._find["jumps_list"] = base.lists.appendable(("jumps", 2))
        self._find["plain_list"] = base.lists.appendable(("plain", 2))
        self._find["source_region"] = base.lists.region(("source", 3))
        self._plain, self._jumps = (
            self._shader(LOWPASS, DEPTH_EDGES=edges) for edges in (False, True)
        )
        self._set(depth_threshold=base.depth_threshold)
        self._hold(**base.lists.shared)

    def __call__(
        self, fine: moderngl.Texture, coarse: moderngl.Texture, depth_m: moderngl.Texture
    ) -> None:
        lists = self._base.lists
        width, height = self._base.resolutions.sizes[3]
        extents = self._base.guide.extents
        self._find.run(-(-width // LIST_GROUP), height, extents=extents)
        lists.run(self._plain, ("plain", 2), fine=fine, coarse=coarse)
        lists.run(self._jumps, ("jumps", 2), fine=fine, coarse=coarse, depth_m=depth_m)
