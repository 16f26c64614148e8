"""Work lists: which tiles of which resolution a fill has to visit. Twin: near_a_hole().

Three kinds, by key:

``("source", r)``
    Tiles of resolution r whose pixels are read at all.
``("chain", k, r)``
    Tiles of resolution r that hold moments of pyramid level k (r > k).
``("push", r)``
    Tiles of resolution r with pixels that some hole pixel needs completed.
``("holes", 1)``
    Tiles of resolution 1 with a hole pixel in them.
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

MOST_GROUPS = 32768  # every driver takes 65535; the rest of a list is looped over
_GROUP = 64
_COUNTS_STRIDE = 16  # bytes of one uvec4


@dataclass(frozen=True)
class _List:
    """One work list. Field order is the shader's `struct List`, then the host's own."""

    resolution: int
    columns: int
    tiles: int
    first: int
    cell_resolution: int
    rings: int


class WorkLists:
    """All work lists of one frame size, rebuilt for each frame in two dispatches.

    Parameters
    ----------
    sizes : list of (width, height)
        Of every resolution that is dispatched tile by tile, finest first.
    levels : int
        Pyramid levels.
    """

    dispatches = 2

    def __init__(self, ctx: moderngl.Context, sizes: list[tuple[int, int]], levels: int) -> None:
        self._ctx = ctx
        self.sizes = sizes
        self._grids = [
            self._grid(resolution) for resolution in range(source_resolution(levels) + 1)
        ]
        self._plan(levels)
        cell_count = sum(columns * rows for _, columns, rows in self._grids)
        tile_count = _padded(self._lists[-1].first + self._lists[-1].tiles)
        self._reset_groups = -(-max(cell_count, len(self._lists)) // _GROUP)
        self._list_groups = -(-tile_count // _GROUP)
        self._cells = ctx.buffer(reserve=4 * cell_count)
        self._counts = ctx.buffer(reserve=_COUNTS_STRIDE * len(self._lists))
        self._entries = ctx.buffer(reserve=4 * tile_count)
        self._active = ctx.buffer(reserve=4 * tile_count)
        self._infos = ctx.buffer(self._packed().tobytes())
        self._reset = compile_compute(ctx, "inpaint/reset.comp.glsl")
        self._reset["cell_count"] = cell_count
        self._reset["list_count"] = len(self._lists)
        self._build = compile_compute(
            ctx, "inpaint/lists.comp.glsl", GROUP=_GROUP, MOST_GROUPS=MOST_GROUPS
        )
        self._build["list_count"] = len(self._lists)

    def reset(self) -> None:
        """Forget the last frame. What comes next marks cells: storage buffer 0 is bound."""
        self._cells.bind_to_storage_buffer(0)
        self._counts.bind_to_storage_buffer(1)
        self._reset.run(self._reset_groups)
        self._ctx.memory_barrier()

    def build(self) -> None:
        """List the tiles near marked cells; storage buffers 0 to 3 stay bound."""
        self._ctx.memory_barrier()
        self._cells.bind_to_storage_buffer(0)
        self._counts.bind_to_storage_buffer(1)
        self._entries.bind_to_storage_buffer(2)
        self._active.bind_to_storage_buffer(3)
        self._infos.bind_to_storage_buffer(7)
        self._build.run(self._list_groups)
        self._ctx.memory_barrier()

    def run(self, shader: moderngl.ComputeShader, key: Key) -> None:
        """Dispatch `shader` (it includes tiles.glsl) over the tiles of one list."""
        index = self._index[key]
        item = self._lists[index]
        shader["list_index"] = index
        shader["list_first"] = item.first
        shader["work_size"] = self.sizes[item.resolution]
        shader.run_indirect(self._counts, _COUNTS_STRIDE * index)
        self._ctx.memory_barrier()

    @property
    def cell_grids(self) -> NDArray[np.uint32]:
        """First cell and cells per row of every resolution of cells, for marking."""
        return np.array([(first, columns) for first, columns, _ in self._grids], np.uint32)

    def first(self, key: Key) -> int:
        """Where the active flags of a list's tiles start."""
        return self._lists[self._index[key]].first

    def columns(self, resolution: int) -> int:
        """Tiles per row of a resolution."""
        return -(-self.sizes[resolution][0] // CELL)

    def tile_counts(self) -> dict[Key, tuple[int, int]]:
        """For every list of the last frame: (tiles listed, tiles there are). Reads back."""
        counts = np.frombuffer(self._counts.read(), np.uint32).reshape(-1, 4)[:, 3]
        return {key: (int(counts[i]), self._lists[i].tiles) for key, i in self._index.items()}

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

    def _plan(self, levels: int) -> None:
        last = len(self.sizes) - 1
        source = source_resolution(levels)
        self._index: dict[Key, int] = {}
        self._lists: list[_List] = []
        self._add(("holes", 1), 1, 0, 0)
        for r in range(1, last + 1):
            self._add(("source", r), r, source, SOURCE_RINGS)
            # Finer cells, one ring: at least four pixels around every hole.
            self._add(("push", r), r, min(r - 1, source), 1)
            for k in range(min(r, levels)):
                self._add(("chain", k, r), r, k, STATISTICS_RINGS)

    def _add(self, key: Key, resolution: int, cell_resolution: int, rings: int) -> None:
        width, height = self.sizes[resolution]
        columns, rows = -(-width // CELL), -(-height // CELL)
        last = self._lists[-1] if self._lists else None
        first = _padded(last.first + last.tiles) if last else 0
        self._index[key] = len(self._lists)
        self._lists.append(
            _List(resolution, columns, columns * rows, first, cell_resolution, rings)
        )

    def _packed(self) -> NDArray[np.uint32]:
        rows = []
        for item in self._lists:
            cell_first, cell_columns, cell_rows = self._grids[item.cell_resolution]
            tiles = (item.resolution, item.columns, item.tiles, item.first)
            cells = (item.cell_resolution, cell_first, cell_columns, cell_rows)
            rows.append((*tiles, *cells, item.rings))
        return np.array(rows, np.uint32)


def _padded(count: int) -> int:
    """Round up to whole work groups, so that none sees two lists."""
    return -(-count // _GROUP) * _GROUP
