"""Work lists: which tiles and pixels of which resolution a fill has to visit.

Work follows the holes. What is far from every hole counts as unknown and is never read. How far is
said in cells of the pyramid, which both twins share: one of resolution r is 8x8 of its texels, and
so one texel of resolution r + 3. On the GPU they are also the tiles by which texels are visited,
which no result depends on.

Regions, from these cells (twin: near_a_hole() in reference.py); a flag per tile says what is in:

``("source", r)``
    Tiles of resolution r whose pixels are read at all.
``("chain", k, r)``
    Tiles of resolution r that hold moments of pyramid level k (r > k). None for r = k + 2: what is
    stored there lies in the tiles of r = k + 1, each of which covers 4x4 of its pixels.

Lists by tile, of one region each or of what every chain takes from its own:

``("source", r)``
    As the region.
``("first", k)``
    Tiles of resolution k + 1 whose moments of level k are made, four in a work group.
``("pulled", r)``
    Tiles and chains of resolution r to pull.
``("jumps", 2)``, ``("plain", 2)``
    Those of ("source", 2), cut to tiles of `HALVED_TILE` pixels: whether a jump of depth may lie
    under what the first halving makes there or not. Appended by the pass that finds them.

Lists by pixel, appended by the passes that find them:

``("holes", 1)``
    Pixels of resolution 1 with a hole pixel among their children.
``("base", r)``, ``("moments", r)``
    Pixels of resolution r that push has to complete: of the base, of the chains of moments.
``("halves", k)``
    Pixels of resolution k + 1 whose moments of level k are incomplete.

And, of the pixels themselves, for coherence transport:

``("shell", k)``
    Hole pixels of one shell. Each appends to the next, `SHELLS` before the host looks.
``("band", 0)``
    Known pixels that hole pixels see.

No pixel is on two of them at a time. So they share room for the frame's pixels: even shells grow
upwards from its first entry, odd ones downwards from its last, and so does the band before these.
"""

from dataclasses import dataclass
from typing import TypeAlias

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.gl.compute import Resource, Shader
from pipeline.gl.passes import Pass
from protocols.limits import FIXED

CELL = 8  # edge of a cell, in texels of its resolution; a power of two
STATISTICS_RINGS = 1  # cells of level k around one with a hole pixel whose coefficients count
# Cells around a hole whose pixels are read at all, and the resolution of those cells, at least: 3
# of 128 px. Pushes and relaxations lead 381 px away from a hole pixel at resolution 8, the coarsest
# that is not the tail's in the largest frame (texels start there that it depends on).
SOURCE_RINGS = 3
SOURCE_RESOLUTION = 4
MOST_EDGE_PX = FIXED["frame_edge"].most


def source_resolution(levels: int) -> int:
    """Resolution of the cells that decide which pixels are read."""
    return max(SOURCE_RESOLUTION, levels)


Key: TypeAlias = tuple[str, int]
RegionKey: TypeAlias = tuple[str, int] | tuple[str, int, int]

# A ring is STATISTICS_RINGS * CELL = 8 coefficients of level k wide. The tap that push takes at
# resolution r begins less than 2^r px from the hole: inside the ring up to r = k + 3.
RING_REACH = 3
FIRST_STORED = 2  # moments of level k are stored from resolution k + 2 on
HALVED_TILE = 2  # edge of a tile of ("jumps", 2): a pixel of resolution 3
TILES_AT_ONCE = 4  # of ("first", k) in one work group: 4x4 pixels each, see tiles.glsl

SHELLS = 32  # dispatched in a row; an even number, as the last one becomes the first
_EMPTY = np.tile(np.array([0, 1, 1, 0], np.uint32), SHELLS).tobytes()  # counts of their lists
DOWNWARDS = 1 << 31  # as lists.glsl has it

LIST_GROUP = 64  # invocations of a work group, as lists.glsl has it
_COUNTS_STRIDE = 16  # bytes of one uvec4


@dataclass(frozen=True)
class _List:
    """Place of its counts (`index`) and of its entries (from `first`)."""

    index: int
    resolution: int
    first: int  # with `DOWNWARDS`, the last of its room


@dataclass(frozen=True)
class _Region:
    """Place of its flags, and the lists that its tiles go into."""

    resolution: int
    first: int
    tiles: int
    cell_resolution: int
    rings: int
    own: Key | None
    chains: range  # into ("pulled", resolution)

    @property
    def own_packed(self) -> tuple[int, int]:
        """Chain of the entries in `own`, and how many a work group visits."""
        match self.own:
            case None:
                return 0, 0
            case "first", level:
                return level, TILES_AT_ONCE
            case _:
                return 0, 1

    @property
    def chains_packed(self) -> tuple[int, int]:
        """First chain and end."""
        return self.chains.start, self.chains.stop


class WorkLists(Pass):
    """All regions and work lists of one frame size, rebuilt for each frame.

    Parameters
    ----------
    sizes : list of (width, height)
        Of every resolution that is dispatched over lists, finest first.
    levels : int
        Pyramid levels.
    shells : bool
        Whether there are lists of shells and of their band.

    Attributes
    ----------
    shared : dict of buffers
        For the shaders that mark cells, and that read lists or append to them.
    """

    def __init__(
        self,
        ctx: moderngl.Context,
        sizes: list[tuple[int, int]],
        levels: int,
        *,
        shells: bool = False,
    ) -> None:
        super().__init__(ctx)
        self.sizes = sizes
        self._levels = levels
        self._grids = [self._grid(r) for r in range(source_resolution(levels) + 1)]
        self._regions: dict[RegionKey, _Region] = {}
        self._lists: dict[Key, _List] = {}
        self._plan_regions()
        entries_bytes = _checked(ctx, 4 * self._plan_lists(shells=shells), sizes[0])
        flag_count = sum(_padded(region.tiles) for region in self._regions.values())
        cell_count = sum(columns * rows for _, columns, rows in self._grids)
        self._reset_groups = -(-max(cell_count, len(self._lists)) // LIST_GROUP)
        self._build_groups = flag_count // LIST_GROUP
        self._cells = self._buffer(4 * cell_count)
        self._counts = self._buffer(_COUNTS_STRIDE * len(self._lists))
        self._seen = self._buffer(_COUNTS_STRIDE)
        self._entries = self._buffer(entries_bytes)
        self._active = self._buffer(4 * flag_count)
        self._reset = self._shader("inpaint/reset.comp.glsl")
        self._reset["cell_count"] = cell_count
        self._reset["list_count"] = len(self._lists)
        self._build = self._shader("inpaint/lists.comp.glsl", GROUP=LIST_GROUP)
        self._packed_regions = self._buffer(self._pack_regions().tobytes())
        groups = [_padded(item.tiles) // LIST_GROUP for item in self._regions.values()]
        of_groups = np.repeat(np.arange(len(groups), dtype=np.uint32), groups)
        self._region_of_group = self._buffer(of_groups.tobytes())
        self._build.hold(regions=self._packed_regions, of_groups=self._region_of_group)
        self.shared: dict[str, Resource] = {
            "cells": self._cells,
            "counts": self._counts,
            "entries": self._entries,
            "active": self._active,
        }
        self._hold(**self.shared)

    def reset(self) -> None:
        """Forget the last frame."""
        self._reset.run(self._reset_groups)

    def build(self) -> None:
        """List the tiles near marked cells."""
        self._build.run(self._build_groups)

    def run(
        self,
        shader: Shader,
        key: Key,
        resolution: int | None = None,
        /,
        **resources: Resource,
    ) -> None:
        """Dispatch `shader` over one list; it writes `resolution`, by default the list's own.

        It includes tiles.glsl for a list by tile, pixels.glsl for one by pixel.
        """
        item = self._lists[key]
        shader["list_index"] = item.index
        shader["list_first"] = item.first
        if "work_size" in shader:
            shader["work_size"] = self.sizes[item.resolution if resolution is None else resolution]
        shader.run_indirect(self._counts, _COUNTS_STRIDE * item.index, **resources)

    def carry_shells(self) -> bool:
        """Begin anew with the last shell as the first; tell whether it holds anything."""
        first, last = self._lists["shell", 0].index, self._lists["shell", SHELLS].index
        stride = _COUNTS_STRIDE
        # Through a copy: a driver maps a buffer as it was before the last pass appended to it.
        self._ctx.copy_buffer(self._seen, self._counts, stride, read_offset=stride * last)
        found = self._seen.read()
        self._counts.write(found + _EMPTY, offset=stride * first)
        return any(found[-4:])

    def appendable(self, key: Key) -> tuple[int, int]:
        """Index and first entry of a list by pixel: what a pass needs to append to it."""
        item = self._lists[key]
        return item.index, item.first

    @property
    def cell_grids(self) -> NDArray[np.uint32]:
        """First cell and cells per row of every resolution of cells, for marking."""
        return np.array([(first, columns) for first, columns, _ in self._grids], np.uint32)

    def region(self, key: RegionKey, resolution: int | None = None) -> tuple[int, int, int]:
        """Arguments of is_active() for pixels of `resolution`, by default of the tiles' own."""
        item = self._regions[key]
        coarser = 0 if resolution is None else resolution - item.resolution
        edge_log2 = CELL.bit_length() - 1 - coarser
        return item.first, self._columns(item.resolution), edge_log2

    def stored_region(self, chain: int, resolution: int) -> tuple[int, int, int]:
        """The same for the moments of a level where they are stored."""
        if resolution == chain + FIRST_STORED:
            return self.region(("chain", chain, chain + 1), resolution)
        return self.region(("chain", chain, resolution))

    def _columns(self, resolution: int) -> int:
        """Tiles per row of a resolution."""
        return -(-self.sizes[resolution][0] // CELL)

    def _tiles(self, resolution: int) -> int:
        return self._columns(resolution) * -(-self.sizes[resolution][1] // CELL)

    def _grid(self, resolution: int) -> tuple[int, int, int]:
        """(first cell, columns, rows) of the cells of one resolution."""
        width, height = self.sizes[0]

        def cells(r: int) -> tuple[int, int]:
            edge = CELL << r
            return -(-width // edge), -(-height // edge)

        columns, rows = cells(resolution)
        return sum(c * r for c, r in map(cells, range(resolution))), columns, rows

    def _stored(self, resolution: int) -> range:
        """Chains of moments that are stored at a resolution."""
        return range(max(0, min(resolution - FIRST_STORED + 1, self._levels)))

    def _pulled(self, resolution: int) -> range:
        """Chains of a resolution that are pulled from the next finer one."""
        return self._stored(resolution - 1)

    def _plan_regions(self) -> None:
        source = source_resolution(self._levels)
        for r in range(1, len(self.sizes)):
            # Push completes what it reads, beyond a chain's own region too: in the smallest that
            # it does not leave.
            widest, pulled, none = r - RING_REACH, self._pulled(r), range(0)
            for k in range(min(r, self._levels)):
                if k == r - FIRST_STORED:
                    continue  # stored as it was made, by the tiles of the next finer resolution
                own = ("first", k) if k == r - 1 else None
                chains = pulled if k == widest else none
                self._plan_region(("chain", k, r), k, STATISTICS_RINGS, own, chains)
            chains = pulled if widest >= self._levels else none
            self._plan_region(("source", r), source, SOURCE_RINGS, ("source", r), chains)

    def _plan_region(
        self, key: RegionKey, cell_resolution: int, rings: int, own: Key | None, chains: range
    ) -> None:
        before = list(self._regions.values())[-1:]
        first = before[0].first + _padded(before[0].tiles) if before else 0
        r = key[-1]
        self._regions[key] = _Region(r, first, self._tiles(r), cell_resolution, rings, own, chains)

    def _plan_lists(self, *, shells: bool) -> int:
        """Give every list its room; return how many entries there can be."""
        first = 0

        def plan(key: Key, resolution: int, capacity: int) -> None:
            nonlocal first
            self._lists[key] = _List(len(self._lists), resolution, first)
            first += capacity

        for region in self._regions.values():
            if region.own:
                plan(region.own, region.resolution, region.tiles)
        for r, (width, height) in enumerate(self.sizes[1:], start=1):
            pixels = width * height
            plan(("base", r), r, pixels)
            if r <= self._levels:
                plan(("halves", r - 1), r, pixels)
            plan(("pulled", r), r, self._tiles(r) * len(self._pulled(r)))
            plan(("moments", r), r, pixels * len(self._stored(r)))
        if self._levels > 1:
            tiles = self.sizes[3][0] * self.sizes[3][1]
            plan(("jumps", 2), 2, tiles)
            plan(("plain", 2), 2, tiles)
        if shells:
            pixels = self.sizes[0][0] * self.sizes[0][1]
            ends = first, DOWNWARDS + first + pixels - 1
            self._lists["band", 0] = _List(len(self._lists), 0, ends[1])
            for k in range(SHELLS + 1):
                self._lists["shell", k] = _List(len(self._lists), 0, ends[k % 2])
            first += pixels
        plan(("holes", 1), 1, self.sizes[1][0] * self.sizes[1][1])
        return first

    def _pack_regions(self) -> NDArray[np.uint32]:
        """The regions as the shader's `struct Region`."""
        rows = []
        for item in self._regions.values():
            own = self.appendable(item.own) if item.own else (0, 0)
            cell_first, cell_columns, cell_rows = self._grids[item.cell_resolution]
            tiles = (item.resolution, self._columns(item.resolution), item.tiles, item.first)
            cells = (item.cell_resolution, cell_first, cell_columns, cell_rows, item.rings)
            pulled = (*self.appendable(("pulled", item.resolution)), *item.chains_packed)
            rows.append((*tiles, *cells, *own, *item.own_packed, *pulled))
        return np.array(rows, np.uint32)


def _padded(count: int) -> int:
    """Round up to whole work groups, so that none sees two regions."""
    return -(-count // LIST_GROUP) * LIST_GROUP


def _checked(ctx: moderngl.Context, size_bytes: int, frame: tuple[int, int]) -> int:
    """Return the size of a buffer that shaders of this driver can take.

    Raises
    ------
    InputError
        If they cannot.
    """
    most = int(ctx.info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"])
    if size_bytes > most:
        raise InputError(
            f"a frame to fill must have work lists of at most {most >> 20} MiB on this driver"
            f" (got {frame[0]}x{frame[1]}, which takes {-(-size_bytes >> 20)} MiB); use a smaller"
            " frame, or fill parts of it"
        )
    return size_bytes
