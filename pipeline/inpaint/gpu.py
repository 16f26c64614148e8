"""Guided pull and push on the GPU. Twin: reference.py.

Resolution r has ceil(size / 2^r) pixels. Chains of texels share one image per resolution;
see planes.glsl for how they lie in it. Resolutions up to `Resolutions.top` are dispatched
over lists of tiles and pixels, the rest inside one work group per chain.
"""

from dataclasses import dataclass, field

import moderngl

from pipeline.errors import InputError
from pipeline.features.reference import MAX_LEVELS
from pipeline.gl.shader import compile_compute, set_array
from pipeline.gl.texture import check_size, check_texture, create_texture, texture_bytes
from pipeline.inpaint.reference import RELAXED_RESOLUTIONS
from pipeline.inpaint.region import CELL, MOST_EDGE_PX
from pipeline.inpaint.regions import FIRST_STORED, LIST_GROUP, WorkLists

TAIL_EDGE = 32  # from this size on, one work group does the rest
TAIL_GROUP = 128
BASE_PLANES = 1
MOMENT_PLANES = 5


@dataclass(frozen=True)
class Resolutions:
    """Sizes (width, height) of all resolutions down to 1x1, and the last dispatched one.

    Raises
    ------
    InputError
        If an edge is above `MOST_EDGE_PX`.
    """

    size: tuple[int, int]
    levels: int
    sizes: list[tuple[int, int]] = field(init=False)
    top: int = field(init=False)

    def __post_init__(self) -> None:
        if max(self.size) > MOST_EDGE_PX:
            raise InputError(
                f"a frame to fill must be at most {MOST_EDGE_PX} px wide and high"
                f" (got {self.size[0]}x{self.size[1]})"
            )
        sizes = [self.size]
        while sizes[-1] != (1, 1) or len(sizes) < self.levels + 2:
            width, height = sizes[-1]
            sizes.append(((width + 1) // 2, (height + 1) // 2))
        small = next(r for r, size in enumerate(sizes) if max(size) <= TAIL_EDGE)
        object.__setattr__(self, "sizes", sizes)
        object.__setattr__(self, "top", max(small, self.levels + FIRST_STORED - 1))

    def texels(self, resolution: int) -> int:
        """Pixels of one resolution."""
        width, height = self.sizes[resolution]
        return width * height

    @property
    def tail_texels(self) -> int:
        """Texels of the top resolution and all coarser ones together."""
        return sum(self.texels(r) for r in range(self.top, len(self.sizes)))


class GuidePyramid:
    """The guide of resolutions 1 to the top, one float per pixel: the farthest of each 2x2.

    Written by the base chain, read by all. `extents`, least and largest of each 4x4 pixels, are
    for the pyramid's low bands, where there are any.
    """

    def __init__(self, ctx: moderngl.Context, resolutions: Resolutions) -> None:
        self._guides = [
            create_texture(ctx, resolutions.sizes[r], "r32f") for r in range(1, resolutions.top + 1)
        ]
        self.extents = create_texture(ctx, resolutions.sizes[2], "rg32f")
        self.scratch = ctx.buffer(reserve=4 * resolutions.tail_texels * MAX_LEVELS)

    def at(self, resolution: int) -> moderngl.Texture:
        """The guide of one resolution, from 1 to the top."""
        return self._guides[resolution - 1]

    @property
    def held_bytes(self) -> int:
        """Memory, bytes."""
        return sum(map(texture_bytes, (*self._guides, self.extents))) + self.scratch.size

    def release(self) -> None:
        """Free guides and scratch."""
        for texture in (*self._guides, self.extents):
            texture.release()
        self.scratch.release()


class ChainPass:
    """Pull and push of one kind of chain between its finest resolution and 1x1.

    Parameters
    ----------
    planes : int
        vec4 per texel.
    is_base : bool
        The one chain of colour, which also pulls the guide for all others. Its finest resolution
        is 1; that of the moments of level k is `FIRST_STORED` + k.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        resolutions: Resolutions,
        lists: WorkLists,
        guide: GuidePyramid,
        *,
        planes: int,
        is_base: bool,
        gamma: float,
        depth_threshold: float,
    ) -> None:
        self._ctx = ctx
        self._resolutions = resolutions
        self._lists = lists
        self._guide = guide
        self._is_base = is_base
        self._relaxed = RELAXED_RESOLUTIONS if is_base else 0
        self._pull = compile_compute(
            ctx,
            "inpaint/pull.comp.glsl",
            IS_BASE=is_base,
            TILE=CELL,
            PLANES=planes,
            MOST_CHAINS=MAX_LEVELS,
        )
        self._push = compile_compute(
            ctx, "inpaint/push.comp.glsl", PLANES=planes, GAMMA=float(gamma)
        )
        self._tail = compile_compute(
            ctx,
            "inpaint/tail.comp.glsl",
            GROUP=TAIL_GROUP,
            CHAIN_TEXELS=resolutions.tail_texels,
            PLANES=planes,
            MOST_CHAINS=MAX_LEVELS,
            RELAXED=max(0, self._relaxed - resolutions.top),
            GAMMA=float(gamma),
        )
        self._shaders = [self._pull, self._push, self._tail]
        if is_base:
            self._relax = compile_compute(
                ctx, "inpaint/relax.comp.glsl", IS_FINEST=False, GAMMA=float(gamma)
            )
            self._shaders.append(self._relax)
        for shader in self._shaders:
            shader["depth_threshold"] = depth_threshold
        self._finest = 1 if is_base else FIRST_STORED
        top = resolutions.top
        self._texels = {}
        for r in range(self._finest, top + 1):
            width, height = resolutions.sizes[r]
            size = (planes * width, self._chains(r) * height)
            self._texels[r] = create_texture(ctx, size, "rgba32f")
        self._scratch = ctx.buffer(
            reserve=16 * planes * resolutions.tail_texels * self._chains(top)
        )

    def at(self, resolution: int) -> moderngl.Texture:
        """The texels of one resolution, from the finest to the top; see planes.glsl."""
        return self._texels[resolution]

    @property
    def dispatches(self) -> int:
        """How many dispatches one call makes."""
        relaxed = sum(r < self._relaxed for r in self._pushes)
        return len(self._pulls) + 1 + len(self._pushes) + 2 * relaxed

    @property
    def held_bytes(self) -> int:
        """Memory of texels and scratch, bytes."""
        return sum(map(texture_bytes, self._texels.values())) + self._scratch.size

    def __call__(self) -> None:
        """Complete all resolutions, given the finest of each chain."""
        for r in self._pulls:
            self._pull_step(r)
        self._tail_step()
        for r in reversed(self._pushes):
            self._push_step(r)
            if r < self._relaxed:
                self._relax_steps(r)

    @property
    def _pulls(self) -> range:
        """Resolutions that are pulled from, apart from the tail's and what is made by halving."""
        return range(2, self._resolutions.top)

    @property
    def _pushes(self) -> range:
        """Resolutions that are pushed into, apart from the tail's."""
        return range(self._finest, self._resolutions.top)

    def _chains(self, resolution: int) -> int:
        """How many are stored at a resolution."""
        return 1 if self._is_base else min(resolution - FIRST_STORED + 1, self._resolutions.levels)

    def _regions(self, resolution: int) -> list[tuple[int, int, int]]:
        chains = range(self._chains(resolution))
        if self._is_base:
            regions = [self._lists.region(("source", resolution))]
        else:
            regions = [self._lists.stored_region(chain, resolution) for chain in chains]
        return regions + [(0, 0, 0)] * (MAX_LEVELS - len(chains))

    def _incomplete(self, resolution: int) -> tuple[str, int]:
        return ("base" if self._is_base else "moments", resolution)

    def _pull_step(self, r: int) -> None:
        shader = self._pull
        self._bind(r, r + 1)
        shader["fine_size"] = self._resolutions.sizes[r]
        shader["fine_region"] = self._regions(r)
        shader["incomplete_list"] = self._lists.appendable(self._incomplete(r + 1))
        self._lists.run(shader, ("source" if self._is_base else "pulled", r + 1))

    def _push_step(self, r: int) -> None:
        shader = self._push
        self._bind(r, r + 1)
        shader["coarse_size"] = self._resolutions.sizes[r + 1]
        self._lists.run(shader, self._incomplete(r))

    def _relax_steps(self, r: int) -> None:
        shader = self._relax
        self.at(r).bind_to_image(0)
        self._guide.at(r).bind_to_image(1)
        for parity in (0, 1):
            shader["parity"] = parity
            self._lists.run(shader, self._incomplete(r))

    def _bind(self, fine: int, coarse: int) -> None:
        self.at(fine).bind_to_image(0)
        self.at(coarse).bind_to_image(1)
        self._guide.at(fine).bind_to_image(2)
        self._guide.at(coarse).bind_to_image(3)

    def _tail_step(self) -> None:
        top = self._resolutions.top
        shader = self._tail
        self.at(top).bind_to_image(0)
        self._scratch.bind_to_storage_buffer(5)
        self._guide.at(top).bind_to_image(2)
        self._guide.scratch.bind_to_storage_buffer(7)
        shader["top_size"] = self._resolutions.sizes[top]
        shader["top_region"] = self._regions(top)
        shader["guide_region"] = self._lists.region(("source", top))
        shader.run(self._chains(top))
        self._ctx.memory_barrier()

    def release(self) -> None:
        """Free texels, scratch and shaders."""
        for texture in self._texels.values():
            texture.release()
        self._scratch.release()
        for shader in self._shaders:
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
    tiles : int
        How many entries the work list of a shift-map's tiles has room for.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        size: tuple[int, int],
        *,
        gamma: float,
        levels: int = 1,
        depth_threshold: float = 0.04,
        tiles: int = 0,
    ) -> None:
        check_size(ctx, size)
        self.resolutions = Resolutions(size, levels)
        sizes = self.resolutions.sizes[: self.resolutions.top + 1]
        self.lists = WorkLists(ctx, sizes, levels, tiles)
        self.guide = GuidePyramid(ctx, self.resolutions)
        self.chain = ChainPass(
            ctx,
            self.resolutions,
            self.lists,
            self.guide,
            planes=BASE_PLANES,
            is_base=True,
            gamma=gamma,
            depth_threshold=depth_threshold,
        )
        self._first = compile_compute(
            ctx,
            "inpaint/base_first.comp.glsl",
            CELL=CELL,
            RESOLUTIONS=len(self.lists.cell_grids),
        )
        set_array(self._first, "first_and_columns", self.lists.cell_grids)
        self._first["holes_list"] = self.lists.appendable(("holes", 1))
        self._first["half_list"] = self.lists.appendable(("base", 1))
        self._first["quarter_list"] = self.lists.appendable(("base", 2))
        self._last = compile_compute(ctx, "inpaint/base_last.comp.glsl")
        self._relax = compile_compute(
            ctx, "inpaint/relax.comp.glsl", IS_FINEST=True, GAMMA=float(gamma)
        )
        for shader in (self._first, self._last, self._relax):
            shader["depth_threshold"] = depth_threshold

    @property
    def dispatches(self) -> int:
        """How many dispatches one call makes."""
        return self.lists.dispatches + 1 + self.chain.dispatches + 1 + 2

    @property
    def held_bytes(self) -> int:
        """Memory beyond the caller's textures, bytes."""
        return self.lists.held_bytes + self.guide.held_bytes + self.chain.held_bytes

    def __call__(self, image: moderngl.Texture, depth_m: moderngl.Texture, z_near_m: float) -> None:
        """Fill `image` (rgba32f; alpha 1 known, 0 hole; alpha stays).

        `depth_m` (r32f) holds the background's depth inside holes.
        """
        check_texture(image, "image", self.resolutions.size, "rgba32f")
        check_texture(depth_m, "depth_m", self.resolutions.size, "r32f")
        self.lists.reset()
        self._first["z_near_m"] = z_near_m
        image.bind_to_image(0, read=True, write=False)
        depth_m.bind_to_image(1, read=True, write=False)
        self.chain.at(1).bind_to_image(2)
        self.guide.at(1).bind_to_image(3)
        self.chain.at(2).bind_to_image(4)
        self.guide.at(2).bind_to_image(5)
        self.guide.extents.bind_to_image(6)
        width, height = self.resolutions.sizes[2]
        self._first.run(-(-width // LIST_GROUP), height)
        self.lists.build()
        self.chain()
        self._last["z_near_m"] = z_near_m
        image.bind_to_image(0, read=True, write=True)
        depth_m.bind_to_image(1, read=True, write=False)
        self.chain.at(1).bind_to_image(2)
        self.guide.at(1).bind_to_image(3)
        self.lists.run(self._last, ("holes", 1))
        self._relax["z_near_m"] = z_near_m
        for parity in (0, 1):
            self._relax["parity"] = parity
            self.lists.run(self._relax, ("holes", 1))

    def release(self) -> None:
        """Free everything this pass made."""
        self.lists.release()
        self.guide.release()
        self.chain.release()
        self._first.release()
        self._last.release()
        self._relax.release()
