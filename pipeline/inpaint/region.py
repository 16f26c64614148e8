"""Which part of a frame takes part in a fill: shared by both twins.

Work follows the holes. The frame is cut into square cells; a cell of resolution r covers
``CELL << r`` pixels. What is far from every hole counts as unknown and is never read.
"""

CELL = 8  # edge of a work tile, in pixels of the resolution it works on
STATISTICS_RINGS = 1  # cells of pyramid level k around a hole whose coefficients count
SOURCE_RINGS = 3  # cells around a hole whose pixels are read at all
SOURCE_RESOLUTION = 4  # at least: those cells are 128 px, wider than any dependency


def source_resolution(levels: int) -> int:
    """Resolution of the cells that decide which pixels are read."""
    return max(SOURCE_RESOLUTION, levels)
