"""Background's pixels along a hole, where they are mixed with the foreground, are hole too.

A photograph's pixel at a silhouette shows some of both sides, and its depth is that of one of
them. Where that is the background's, the warp leaves the pixel behind at the far border of the
hole: a ghost of the foreground's outline. Known pixels keep their colour in every fill, so such
pixels must be hole themselves.

Twin: rim.comp.glsl. Change both or neither.
"""

from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.frame import WarpedFrame

Scalar = TypeVar("Scalar", bound=np.generic)

# A hole less deep than this in a direction has no rim there. The twin asks three by name.
HOLE_PX = 3
DIRECTIONS = tuple((y, x) for y in (-1, 0, 1) for x in (-1, 0, 1) if y or x)


def without_rim(warped: WarpedFrame, rim_px: int, alike_px: float) -> WarpedFrame:
    """Make hole of the background's pixels along holes, `rim_px` deep.

    A known pixel becomes hole if, in one of the eight directions, at most `rim_px` steps lead
    over known pixels into `HOLE_PX` hole pixels in line, and it moves as the first of them does,
    to `alike_px` along either axis. What uncovered the hole tore itself away from it and so moves
    otherwise: it keeps its pixels. So do the sides of gaps that rounding leaves in slanted
    surfaces. Beyond the frame's edge counts as known. Holes are those of `warped`: none grows
    from another's rim.

    Parameters
    ----------
    warped : WarpedFrame
        With the background's motion in its holes.
    rim_px : int
        0 gives back `warped`.
    alike_px : float
        `WarpSettings.alike_px`.

    Returns
    -------
    WarpedFrame
        The new hole pixels have no colour (0), and keep their own depth and motion.

    Notes
    -----
    Not in [MI], whose frames are rendered.
    """
    if rim_px == 0:
        return warped
    hole, flow = warped.hole, warped.flow_px
    rim = np.zeros_like(hole)
    for direction in DIRECTIONS:
        known = ~hole
        for steps in range(1, rim_px + 1):
            deep = known.copy()
            for further in range(HOLE_PX):
                deep &= ahead(hole, direction, steps + further)
            # In float32, as the twin: both must round alike.
            for axis in (0, 1):
                off_px = abs(flow[..., axis] - ahead(flow[..., axis], direction, steps))
                deep &= off_px <= np.float32(alike_px)
            rim |= deep
            known &= ~ahead(hole, direction, steps)
    colour = np.where(rim[..., None], np.float32(0), warped.colour)
    return replace(warped, colour=colour, hole=hole | rim)


def ahead(plane: NDArray[Scalar], direction: tuple[int, int], steps: int) -> NDArray[Scalar]:
    """Return the values `steps` in `direction` (y, x) from each pixel; 0 beyond the edge."""
    padded = np.pad(plane, steps)
    top, left = (steps + steps * along for along in direction)
    return padded[top : top + plane.shape[0], left : left + plane.shape[1]]
