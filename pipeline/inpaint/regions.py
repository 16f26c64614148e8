"""Work lists: which tiles and pixels of which resolution a fill has to visit.

By tile, from the cells of region.py (twin: near_a_hole()):

``("source", r)``
    Tiles of resolution r whose pixels are read at all.
``("chain", k, r)``
    Tiles of resolution r that hold moments of pyramid level k (r > k).

By pixel, appended by the passes that find them:

``("holes", 1)``
    Pixels of resolution 1 with a hole pixel among their children.
``("base", r)``, ``("finest", r)``, ``("coarser", r)``
    Pixels of resolution r that push has to complete: of the base, of the moments of level
    r - 1, of the moments of all finer levels.
"""

from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.gl.shader import compile_compute
from pipeline.inpaint.region import (
    CELL,
    SOURCE_RINGS,
    STATISTICS_RINGS,
    source_resolution,
)

Key = tuple[str, int] | tuple[str, int, int]

_GROUP = 64
_COUNTS_STRIDE = 16  # bytes of one uvec4


@dataclass(frozen=True)
class _List:
    """One list: where its counts (`index`) and its entries (from `first`) are."""

    index: int
    resolution: int
    first: int
    capacity: int
    cell_resolution: int = 0  # of lists by tile
    rings: int = 0


class WorkLists:
    """All work lists of one frame size, rebuilt for each frame.

    Parameters
    ----------
    sizes : list of (width, height)
        Of every resolution that is dispatched over lists, finest first.
    levels : int
        Pyramid levels.
    """

    dispatches = 2

    def __init__(self, ctx: moderngl.Context, sizes: list[tuple[int, int]], levels: int) -> None:
        self._ctx = ctx
        self.sizes = sizes
        self._grids = [self._grid(r) for r in range(source_resolution(levels) + 1)]
        self._lists: dict[Key, _List] = {}
        self._plan_tiles(levels)
        by_tile = list(self._lists.values())
        tile_count = _padded(by_tile[-1].first + by_tile[-1].capacity)
        self._plan_pixels(tile_count, levels)
        last = list(self._lists.values())[-1]
        cell_count = sum(columns * rows for _, columns, rows in self._grids)
        self._reset_groups = -(-max(cell_count, len(self._lists)) // _GROUP)
        self._list_groups = tile_count // _GROUP
        self._cells = ctx.buffer(reserve=4 * cell_count)
        self._counts = ctx.buffer(reserve=_COUNTS_STRIDE * len(self._lists))
        self._entries = ctx.buffer(reserve=4 * (last.first + last.capacity))
        self._active = ctx.buffer(reserve=4 * tile_count)
        self._infos = ctx.buffer(self._packed(by_tile).tobytes())
        self._reset = compile_compute(ctx, "inpaint/reset.comp.glsl")
        self._reset["cell_count"] = cell_count
        self._reset["list_count"] = len(self._lists)
        self._build = compile_compute(ctx, "inpaint/lists.comp.glsl", GROUP=_GROUP)
        self._build["list_count"] = len(by_tile)

    def reset(self) -> None:
        """Forget the last frame; storage buffers 0 to 2 stay bound for what marks cells next."""
        self._cells.bind_to_storage_buffer(0)
        self._counts.bind_to_storage_buffer(1)
        self._entries.bind_to_storage_buffer(2)
        self._reset.run(self._reset_groups)
        self._ctx.memory_barrier()

    def build(self) -> None:
        """List the tiles near marked cells; storage buffers 1 to 3 stay bound for all passes."""
        self._ctx.memory_barrier()
        self._active.bind_to_storage_buffer(3)
        self._infos.bind_to_storage_buffer(7)
        self._build.run(self._list_groups)
        self._ctx.memory_barrier()

    def run(self, shader: moderngl.ComputeShader, key: Key) -> None:
        """Dispatch `shader` over one list.

        It includes tiles.glsl for a list by tile, pixels.glsl for one by pixel.
        """
        item = self._lists[key]
        shader["list_index"] = item.index
        shader["list_first"] = item.first
        if "work_size" in shader:
            shader["work_size"] = self.sizes[item.resolution]
        shader.run_indirect(self._counts, _COUNTS_STRIDE * item.index)
        self._ctx.memory_barrier()

    def appendable(self, key: Key) -> tuple[int, int]:
        """Index and first entry of a list by pixel: what a pass needs to append to it."""
        item = self._lists[key]
        return item.index, item.first

    @property
    def cell_grids(self) -> NDArray[np.uint32]:
        """First cell and cells per row of every resolution of cells, for marking."""
        return np.array([(first, columns) for first, columns, _ in self._grids], np.uint32)

    def first(self, key: Key) -> int:
        """Where the active flags of a list by tile start."""
        return self._lists[key].first

    def columns(self, resolution: int) -> int:
        """Tiles per row of a resolution."""
        return -(-self.sizes[resolution][0] // CELL)

    def entry_counts(self) -> dict[Key, tuple[int, int]]:
        """For every list of the last frame: (entries, entries there could be). Reads back."""
        counts = np.frombuffer(self._counts.read(), np.uint32).reshape(-1, 4)[:, 3]
        return {key: (int(counts[i.index]), i.capacity) for key, i in self._lists.items()}

    @property
    def held_bytes(self) -> int:
        """Memory of the lists, bytes."""
        buffers = (self._cells, self._counts, self._entries, self._active, self._infos)
        return sum(buffer.size for buffer in buffers)

    def release(self) -> None:
        """Free buffers and shaders."""
        for item in (self._cells, self._counts, self._entries, self._active, self._infos):
            item.release()
        for shader in (self._reset, self._build):
            shader.release()

    def _grid(self, resolution: int) -> tuple[int, int, int]:
        """(first cell, columns, rows) of the cells of one resolution."""
        width, height = self.sizes[0]

        def cells(r: int) -> tuple[int, int]:
            edge = CELL << r
            return -(-width // edge), -(-height // edge)

        columns, rows = cells(resolution)
        return sum(c * r for c, r in map(cells, range(resolution))), columns, rows

    def _plan_tiles(self, levels: int) -> None:
        source = source_resolution(levels)
        first = 0
        for r in range(1, len(self.sizes)):
            width, height = self.sizes[r]
            tiles = -(-width // CELL) * -(-height // CELL)
            wanted: list[tuple[Key, int, int]] = [(("source", r), source, SOURCE_RINGS)]
            wanted += [(("chain", k, r), k, STATISTICS_RINGS) for k in range(min(r, levels))]
            for key, cells, rings in wanted:
                self._lists[key] = _List(len(self._lists), r, first, tiles, cells, rings)
                first = _padded(first + tiles)

    def _plan_pixels(self, first: int, levels: int) -> None:
        keys: list[Key] = [("holes", 1)]
        for r in range(1, len(self.sizes)):
            keys += [("base", r), ("coarser", r)]
            if r <= levels:
                keys.append(("finest", r))
        for key in keys:
            width, height = self.sizes[key[-1]]
            self._lists[key] = _List(len(self._lists), key[-1], first, width * height)
            first += width * height

    def _packed(self, lists: list[_List]) -> NDArray[np.uint32]:
        """The lists by tile as the shader's `struct List`."""
        rows = []
        for item in lists:
            cell_first, cell_columns, cell_rows = self._grids[item.cell_resolution]
            tiles = (item.resolution, self.columns(item.resolution), item.capacity, item.first)
            cells = (item.cell_resolution, cell_first, cell_columns, cell_rows)
            rows.append((*tiles, *cells, item.rings))
        return np.array(rows, np.uint32)


def _padded(count: int) -> int:
    """Round up to whole work groups, so that none sees two lists."""
    return -(-count // _GROUP) * _GROUP
