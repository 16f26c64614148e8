"""Guided pull and push on the GPU. Twin: reference.py.

Resolution r has ceil(size / 2^r) pixels. `chains` of texels share one texture array per
resolution, `planes` layers each; see guided.glsl for what a texel holds. Resolutions up to
`Resolutions.top` are dispatched tile by tile, the rest inside one work group.
"""

from dataclasses import dataclass, field

import moderngl

from pipeline.features.reference import MAX_LEVELS
from pipeline.gl.shader import compile_compute
from pipeline.gl.texture import create_array
from pipeline.inpaint.region import CELL
from pipeline.inpaint.regions import WorkLists

TAIL_EDGE = 32  # from this size on, one work group does the rest
TAIL_GROUP = 128
BASE_PLANES = 2
MOMENT_PLANES = 5


@dataclass(frozen=True)
class Resolutions:
    """Sizes (width, height) of all resolutions down to 1x1, and the last dispatched one."""

    size: tuple[int, int]
    levels: int
    sizes: list[tuple[int, int]] = field(init=False)
    top: int = field(init=False)

    def __post_init__(self) -> None:
        sizes = [self.size]
        while sizes[-1] != (1, 1) or len(sizes) < self.levels + 2:
            sizes.append(tuple((edge + 1) // 2 for edge in sizes[-1]))  # type: ignore[arg-type]
        small = next(r for r, size in enumerate(sizes) if max(size) <= TAIL_EDGE)
        object.__setattr__(self, "sizes", sizes)
        object.__setattr__(self, "top", max(small, self.levels, 1))

    @property
    def tail_texels(self) -> int:
        """Texels of the top resolution and all coarser ones together."""
        return sum(width * height for width, height in self.sizes[self.top :])


class ChainPass:
    """Pull and push of one kind of chain between resolution 1 and 1x1.

    Parameters
    ----------
    planes : int
        vec4 per texel.
    is_base : bool
        The one chain of colour and motion, which also holds the guide for all others.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        resolutions: Resolutions,
        lists: WorkLists,
        *,
        planes: int,
        is_base: bool,
        gamma: float,
        depth_threshold: float,
    ) -> None:
        self._ctx = ctx
        self._resolutions = resolutions
        self._lists = lists
        self._is_base = is_base
        constants = {"TILE": CELL, "PLANES": planes, "MOST_CHAINS": MAX_LEVELS}
        self._pull = compile_compute(ctx, "inpaint/pull.comp.glsl", IS_BASE=is_base, **constants)
        self._push = compile_compute(ctx, "inpaint/push.comp.glsl", IS_BASE=is_base, **constants)
        self._tail = compile_compute(
            ctx,
            "inpaint/tail.comp.glsl",
            GROUP=TAIL_GROUP,
            CHAIN_TEXELS=resolutions.tail_texels,
            **constants,
        )
        for shader in (self._pull, self._push, self._tail):
            shader["depth_threshold"] = depth_threshold
        for shader in (self._push, self._tail):
            shader["gamma"] = gamma
        self.arrays = [
            create_array(ctx, (*resolutions.sizes[r], planes * self._chains(r)), "rgba32f")
            for r in range(1, resolutions.top + 1)
        ]
        self._scratch = ctx.buffer(
            reserve=16 * planes * resolutions.tail_texels * self._chains(resolutions.top)
        )

    def array(self, resolution: int) -> moderngl.TextureArray:
        """The texels of one resolution, from 1 to the top."""
        return self.arrays[resolution - 1]

    @property
    def dispatches(self) -> int:
        """How many dispatches `__call__` makes."""
        return 2 * (self._resolutions.top - 1) + 1

    @property
    def held_bytes(self) -> int:
        """Memory of textures and scratch, bytes."""
        texels = sum(a.width * a.height * a.layers for a in self.arrays)
        return 16 * texels + self._scratch.size

    def __call__(self, base: "ChainPass") -> None:
        """Complete all resolutions from 1 up, given first pulls in `arrays`.

        `base` holds the guide; the base chain passes itself.
        """
        top = self._resolutions.top
        for r in range(1, top):
            self._pull_step(r, base)
        self._tail_step(base)
        for r in reversed(range(1, top)):
            self._push_step(r, base)

    def _chains(self, resolution: int) -> int:
        return 1 if self._is_base else min(resolution, self._resolutions.levels)

    def _firsts(self, resolution: int, chains: int) -> list[int]:
        keys = [
            ("source", resolution) if self._is_base else ("chain", k, resolution)
            for k in range(chains)
        ]
        firsts = [self._lists.first(key) for key in keys]
        return firsts + [0] * (MAX_LEVELS - chains)

    def _pull_step(self, r: int, base: "ChainPass") -> None:
        chains = self._chains(r)
        shader = self._pull
        self.array(r).use(0)
        if not self._is_base:
            base.array(r + 1).use(1)
        self.array(r + 1).bind_to_image(0, read=False, write=True)
        shader["fine_size"] = self._resolutions.sizes[r]
        shader["fine_columns"] = self._lists.columns(r)
        shader["coarse_columns"] = self._lists.columns(r + 1)
        shader["fine_first"] = self._firsts(r, chains)
        shader["coarse_first"] = self._firsts(r + 1, chains)
        shader["chains"] = chains
        # The coarsest level's tiles include those of all finer ones.
        key = ("source", r + 1) if self._is_base else ("chain", chains - 1, r + 1)
        self._lists.run(shader, key)

    def _push_step(self, r: int, base: "ChainPass") -> None:
        chains = self._chains(r)
        shader = self._push
        self.array(r + 1).use(0)
        if not self._is_base:
            base.array(r).use(1)
        self.array(r).bind_to_image(0, read=True, write=True)
        shader["coarse_size"] = self._resolutions.sizes[r + 1]
        shader["fine_columns"] = self._lists.columns(r)
        shader["fine_first"] = self._firsts(r, chains)
        shader["chains"] = chains
        self._lists.run(shader, ("push", r))

    def _tail_step(self, base: "ChainPass") -> None:
        top = self._resolutions.top
        chains = self._chains(top)
        shader = self._tail
        base.array(top).use(0)
        self.array(top).bind_to_image(0, read=True, write=True)
        self._scratch.bind_to_storage_buffer(5)
        shader["top_size"] = self._resolutions.sizes[top]
        shader["top_columns"] = self._lists.columns(top)
        shader["top_first"] = self._firsts(top, chains)
        shader["base_first"] = self._lists.first(("source", top))
        shader.run(chains)
        self._ctx.memory_barrier()

    def release(self) -> None:
        """Free textures, scratch and shaders."""
        for array in self.arrays:
            array.release()
        self._scratch.release()
        for shader in (self._pull, self._push, self._tail):
            shader.release()


class GuidedBasePass:
    """Fill the holes of one frame's colour from its background, in place.

    The method `push-pull-depth`, and what `metameric` adds its noise to. Known pixels keep
    their bits. A call makes `dispatches` dispatches and allocates nothing.

    Parameters
    ----------
    size : (width, height)
        Any from 1x1.
    levels : int
        Pyramid levels of the statistics that will follow; 1 where none do.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        size: tuple[int, int],
        *,
        levels: int = 1,
        gamma: float = 0.25,
        depth_threshold: float = 0.04,
    ) -> None:
        self.resolutions = Resolutions(size, levels)
        self.lists = WorkLists(ctx, self.resolutions.sizes[: self.resolutions.top + 1], levels)
        self.chain = ChainPass(
            ctx,
            self.resolutions,
            self.lists,
            planes=BASE_PLANES,
            is_base=True,
            gamma=gamma,
            depth_threshold=depth_threshold,
        )
        self._first = compile_compute(ctx, "inpaint/base_first.comp.glsl", TILE=CELL)
        self._last = compile_compute(ctx, "inpaint/base_last.comp.glsl", TILE=CELL)
        for shader in (self._first, self._last):
            shader["depth_threshold"] = depth_threshold

    @property
    def dispatches(self) -> int:
        """How many dispatches one call makes."""
        return self.lists.dispatches + 1 + self.chain.dispatches + 1

    @property
    def held_bytes(self) -> int:
        """Memory beyond the caller's textures, bytes."""
        return self.lists.held_bytes + self.chain.held_bytes

    def __call__(
        self,
        image: moderngl.Texture,
        depth_m: moderngl.Texture,
        flow_px: moderngl.Texture,
        z_near_m: float,
    ) -> None:
        """Fill `image` (rgba32f; alpha 1 known, 0 hole; alpha stays).

        Parameters
        ----------
        depth_m : r32f
            With the background's depth inside holes.
        flow_px : rg32f
            Warped motion.
        """
        self.lists(image)
        self._first["z_near_m"] = z_near_m
        image.use(0)
        depth_m.use(1)
        flow_px.use(2)
        self.chain.array(1).bind_to_image(0, read=False, write=True)
        self.lists.run(self._first, ("source", 1))
        self.chain(self.chain)
        self._last["z_near_m"] = z_near_m
        self._last["coarse_size"] = self.resolutions.sizes[1]
        self.chain.array(1).use(0)
        depth_m.use(1)
        image.bind_to_image(0, read=True, write=True)
        self.lists.run(self._last, ("push", 0))

    def release(self) -> None:
        """Free everything this pass made."""
        self.lists.release()
        self.chain.release()
        self._first.release()
        self._last.release()
