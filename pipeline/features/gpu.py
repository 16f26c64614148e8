"""The pyramid's low bands on the GPU; its other bands are made where they are used.

Twin: reference.py.
"""

import moderngl

from pipeline.features.reference import fitted_kernels
from pipeline.gl.shader import compile_compute
from pipeline.gl.texture import create_texture, texture_bytes
from pipeline.inpaint.region import CELL
from pipeline.inpaint.regions import WorkLists

MIXED = -1024.0  # alpha of what mixes two depths: -16 after the smallest tap, of 1/64


def band_constants() -> dict[str, float]:
    """The 3x3 kernels as the constants that bands.glsl declares."""
    kernels = fitted_kernels()
    return {
        "HIGH_EDGE": float(kernels.high[0, 1]),
        "HIGH_CORNER": float(kernels.high[0, 0]),
        "ORIENTED_EDGE": float(kernels.oriented[1, 2]),
        "ORIENTED_CORNER": float(kernels.oriented[0, 2]),
    }


class LowBandPass:
    """Halve a filled frame `levels` - 1 times, near holes only.

    Alpha of a level is 1 where no tap, at any level, was a hole, else 0; with
    `skip_depth_edges` it is `MIXED` where a low band mixed two depths.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        sizes: list[tuple[int, int]],
        lists: WorkLists,
        levels: int,
        *,
        skip_depth_edges: bool = False,
        depth_threshold: float = 0.04,
    ) -> None:
        low = fitted_kernels().low
        self._lists = lists
        self._skip_depth_edges = skip_depth_edges
        self._first, self._shader = (
            compile_compute(
                ctx,
                "features/lowpass.comp.glsl",
                TILE=CELL,
                LOW_INNER=float(low[1, 1]),
                LOW_MIXED=float(low[0, 1]),
                LOW_OUTER=float(low[0, 0]),
                MIXED=MIXED,
                DEPTH_EDGES=depth_edges,
            )
            for depth_edges in (skip_depth_edges, False)
        )
        if skip_depth_edges:
            self._first["depth_threshold"] = depth_threshold
        self._coarser = [create_texture(ctx, sizes[k], "rgba32f") for k in range(1, levels)]

    @property
    def dispatches(self) -> int:
        """How many dispatches one call makes."""
        return len(self._coarser)

    @property
    def held_bytes(self) -> int:
        """Memory of the levels, bytes."""
        return sum(texture_bytes(level) for level in self._coarser)

    def __call__(
        self, image: moderngl.Texture, depth_m: moderngl.Texture, z_near_m: float
    ) -> list[moderngl.Texture]:
        """Return the levels, `image` (rgba32f) first."""
        levels = [image, *self._coarser]
        if self._skip_depth_edges:
            depth_m.bind_to_image(2, read=True, write=False)
            self._first["z_near_m"] = z_near_m
        for k, (fine, coarse) in enumerate(zip(levels, self._coarser, strict=False), start=1):
            fine.bind_to_image(0, read=True, write=False)
            coarse.bind_to_image(1, read=False, write=True)
            shader = self._first if k == 1 else self._shader
            self._lists.run(shader, ("source", k + 1))  # 2x2 results each
        return levels

    def release(self) -> None:
        """Free textures and shader."""
        for texture in self._coarser:
            texture.release()
        self._first.release()
        self._shader.release()
