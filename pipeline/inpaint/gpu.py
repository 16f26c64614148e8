"""Guided pull and push on the GPU. Twin: reference.py.

Resolution r has ceil(size / 2^r) pixels. Chains of texels share one image per resolution;
see planes.glsl for how they lie in it. Resolutions up to `ResolutionSizes.top` are dispatched
over lists of tiles and pixels, the rest inside one work group per chain.
"""

from dataclasses import dataclass, field

import moderngl

from pipeline.errors import InputError
from pipeline.features.reference import MAX_LEVELS
from pipeline.gl.passes import Pass
from pipeline.gl.texture import check_size, check_texture
from pipeline.inpaint.reference import RELAXED_RESOLUTIONS
from pipeline.inpaint.regions import CELL, FIRST_STORED, LIST_GROUP, MOST_EDGE_PX, WorkLists

TAIL_EDGE = 32  # from this size on, one work group does the rest
TAIL_GROUP = 128
BASE_PLANES = 1
MOMENT_PLANES = 4


@dataclass(frozen=True)
class ResolutionSizes:
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


class GuidePyramid(Pass):
    """The guide of resolutions 1 to the top, one float per pixel: the farthest of each 2x2.

    Written by the base chain, read by all. `extents`, least and largest of each 4x4 pixels, are
    for the pyramid's low bands, where there are any.
    """

    def __init__(self, ctx: moderngl.Context, resolutions: ResolutionSizes) -> None:
        super().__init__(ctx)
        self.resolutions = resolutions
        self._guides = [
            self._texture(resolutions.sizes[r], "r32f") for r in range(1, resolutions.top + 1)
        ]
        self.extents = self._texture(resolutions.sizes[2], "rg32f")

    def at(self, resolution: int) -> moderngl.Texture:
        """The guide of one resolution, from 1 to the top."""
        return self._guides[resolution - 1]


class GuidedChainPass(Pass):
    """Pull and push of one kind of chain between its finest resolution and 1x1.

    Parameters
    ----------
    base : GuidedBasePass
        Whose lists, guide, gamma and depth threshold these are.
    planes : int
        vec4 per texel.
    is_base : bool
        The one chain of colour, which also pulls the guide for all others. Its finest resolution
        is 1; that of the moments of level k is `FIRST_STORED` + k.
    """

    def __init__(
        self, ctx: moderngl.Context, base: "GuidedBasePass", *, planes: int, is_base: bool
    ) -> None:
        resolutions, lists, guide = base.resolutions, base.lists, base.guide
        relaxed = RELAXED_RESOLUTIONS if is_base else 0
        constants = {
            "CHAIN_TEXELS": resolutions.tail_texels,
            "GAMMA": base.gamma,
            "GROUP": TAIL_GROUP,
            "IS_BASE": is_base,
            "IS_FINEST": False,
            "MOST_CHAINS": MAX_LEVELS,
            "PLANES": planes,
            "RELAXED": max(0, relaxed - resolutions.top),
            "TILE": CELL,
        }
        super().__init__(ctx, constants)
        self._resolutions = resolutions
        self._lists = lists
        self._guide = guide
        self._is_base = is_base
        self._relaxed = relaxed
        self._pull, self._push, self._tail = (
            self._shader(f"inpaint/{name}.comp.glsl") for name in ("pull", "push", "tail")
        )
        if is_base:
            self._relax = self._shader("inpaint/relax.comp.glsl")
        self._set(depth_threshold=base.depth_threshold)
        self._hold(**lists.shared)
        self._finest = 1 if is_base else FIRST_STORED
        top = resolutions.top
        self._texels = {}
        for r in range(self._finest, top + 1):
            width, height = resolutions.sizes[r]
            size = (planes * width, self._chains(r) * height)
            self._texels[r] = self._texture(size, "rgba32f")
        self._tail.hold(top=self.at(top), top_guide=guide.at(top))
        if planes > 1:
            texels = resolutions.tail_texels * self._chains(top)
            self._tail.hold(
                scratch=self._buffer(16 * planes * texels), scratch_guide=self._buffer(4 * texels)
            )

    def at(self, resolution: int) -> moderngl.Texture:
        """The texels of one resolution, from the finest to the top; see planes.glsl."""
        return self._texels[resolution]

    def __call__(self) -> None:
        """Complete all resolutions, given the finest of each chain."""
        for r in self._pulls:
            self._pull_step(r)
        self._tail_step()
        for r in reversed(self._pushes):
            self._push["coarse_size"] = self._resolutions.sizes[r + 1]
            self._lists.run(self._push, self._incomplete(r), **self._fine_and_coarse(r))
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
        """Number of chains stored at a resolution."""
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
        shader["fine_size"] = self._resolutions.sizes[r]
        shader["fine_region"] = self._regions(r)
        shader["incomplete_list"] = self._lists.appendable(self._incomplete(r + 1))
        key = ("source" if self._is_base else "pulled", r + 1)
        self._lists.run(shader, key, **self._fine_and_coarse(r))

    def _relax_steps(self, r: int) -> None:
        for parity in (0, 1):
            self._relax["parity"] = parity
            self._lists.run(
                self._relax, self._incomplete(r), level=self.at(r), guide=self._guide.at(r)
            )

    def _fine_and_coarse(self, r: int) -> dict[str, moderngl.Texture]:
        return {
            "fine": self.at(r),
            "coarse": self.at(r + 1),
            "fine_guide": self._guide.at(r),
            "coarse_guide": self._guide.at(r + 1),
        }

    def _tail_step(self) -> None:
        top = self._resolutions.top
        shader = self._tail
        shader["top_size"] = self._resolutions.sizes[top]
        shader["top_region"] = self._regions(top)
        shader["guide_region"] = self._lists.region(("source", top))
        shader.run(self._chains(top))


class GuidedBasePass(Pass):
    """Fill the holes of one frame's colour from its background, in place.

    The method `push-pull-depth`, and what `metameric` adds its noise to. Known pixels keep
    their bits. A call allocates nothing.

    Parameters
    ----------
    size : (width, height)
        Any from 1x1.
    levels : int
        Pyramid levels of the statistics that will follow; 1 where none do.
    shells : bool
        Whether the work lists have shells, for coherence transport.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        size: tuple[int, int],
        *,
        gamma: float,
        levels: int = 1,
        depth_threshold: float = 0.04,
        shells: bool = False,
    ) -> None:
        super().__init__(ctx)
        check_size(ctx, size)
        self.resolutions = ResolutionSizes(size, levels)
        sizes = self.resolutions.sizes[: self.resolutions.top + 1]
        self.lists = self._part(WorkLists(ctx, sizes, levels, shells=shells))
        self.guide = self._part(GuidePyramid(ctx, self.resolutions))
        self.gamma, self.depth_threshold = float(gamma), depth_threshold
        self.chain = self._part(GuidedChainPass(ctx, self, planes=BASE_PLANES, is_base=True))
        self._first = self._shader(
            "inpaint/base_first.comp.glsl", CELL=CELL, RESOLUTIONS=len(self.lists.cell_grids)
        )
        self._first["first_and_columns"] = self.lists.cell_grids
        self._first["holes_list"] = self.lists.appendable(("holes", 1))
        self._first["half_list"] = self.lists.appendable(("base", 1))
        self._first["quarter_list"] = self.lists.appendable(("base", 2))
        self._last = self._shader("inpaint/base_last.comp.glsl")
        self._relax = self._shader("inpaint/relax.comp.glsl", IS_FINEST=True, GAMMA=self.gamma)
        self._set(depth_threshold=depth_threshold)
        self._hold(**self.lists.shared)

    def __call__(self, image: moderngl.Texture, depth_m: moderngl.Texture, z_near_m: float) -> None:
        """Fill `image` (rgba32f; alpha 1 known, 0 hole; alpha stays).

        `depth_m` (r32f) holds the background's depth inside holes.
        """
        self.tell(z_near_m=z_near_m)
        self._play(self.fill, image, depth_m)

    def fill(self, image: moderngl.Texture, depth_m: moderngl.Texture) -> None:
        """Fill an image, with the nearest depth that the passes were told."""
        check_texture(image, "image", self.resolutions.size, "rgba32f")
        check_texture(depth_m, "depth_m", self.resolutions.size, "r32f")
        halves, half_guide = self.chain.at(1), self.guide.at(1)
        self.lists.reset()
        width, height = self.resolutions.sizes[2]
        self._first.run(
            -(-width // LIST_GROUP),
            height,
            image=image,
            depth_m=depth_m,
            halves=halves,
            half_guide=half_guide,
            quarters=self.chain.at(2),
            quarter_guide=self.guide.at(2),
            extents=self.guide.extents,
        )
        self.lists.build()
        self.chain()
        holes = ("holes", 1)
        self.lists.run(
            self._last, holes, image=image, depth_m=depth_m, coarse=halves, coarse_guide=half_guide
        )
        for parity in (0, 1):
            self._relax["parity"] = parity
            self.lists.run(self._relax, holes, level=image, depth_m=depth_m)
