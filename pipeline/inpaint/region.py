"""Region of a frame that takes part in a fill: shared by both twins.

Work follows the holes. What is far from every hole counts as unknown and is never read. How far is
said in cells of the pyramid: one of resolution r is 8x8 of its texels, and so one texel of
resolution r + 3. Nothing else of a fill's definition knows of them. On the GPU they are also the
tiles by which texels are visited, which no result depends on.
"""

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
