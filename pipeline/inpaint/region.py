"""Which part of a frame takes part in a fill: shared by both twins.

Work follows the holes. The frame is cut into square cells; a cell of resolution r covers
``CELL << r`` pixels. What is far from every hole counts as unknown and is never read.
"""

CELL = 8  # edge of a work tile, in pixels of the resolution it works on
STATISTICS_RINGS = 1  # cells of pyramid level k around a hole whose coefficients count
# Cells around a hole whose pixels are read at all, and the resolution of those cells, at least: 3
# of 128 px. Pushes and relaxations lead 381 px away from a hole pixel at resolution 8, the coarsest
# that is not the tail's in the largest frame (texels start there that it depends on).
SOURCE_RINGS = 3
SOURCE_RESOLUTION = 4
MOST_EDGE_PX = 16384


def source_resolution(levels: int) -> int:
    """Resolution of the cells that decide which pixels are read."""
    return max(SOURCE_RESOLUTION, levels)
