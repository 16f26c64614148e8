"""Pixels that would mislead: outliers and silhouettes of measured depth, and mixed pixels.

A hole takes the farthest depth of the quads that tore there, so one wrong pixel beside it decides
the whole of it. Measured depth has such pixels, alone and in small clumps, most of all along
silhouettes, which are ragged, and which nothing measured in places: the warp would comb them.
Before anything is warped, what is beside a step in depth follows the colours around it (`mends`).
Rendered depth is right, and is left alone.

Both twins of the warp are given what is mended here: there is no twin of this.

A photograph's pixel at a silhouette shows some of both sides, and its depth is that of one of
them. Where that is the background's, the warp leaves the pixel behind at the far border of the
hole: a ghost of the foreground's outline. Known pixels keep their colour in every fill, so such
pixels must be hole themselves (`without_rim`).

Twin of `without_rim`: rim.comp.glsl. Change both or neither.
"""

from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pipeline.frame import SourceFrame, WarpedFrame

SAME_SURFACE = 0.04  # steps of 1 - z_near / z up to this are of one surface
NEAR_PERCENTILE = 1.0  # of depth, for z_near: outliers do not set it
CHUNK = 1 << 14  # pixels whose windows are looked at in one go
NEAR_PX = 2.0  # standard deviation of the weight by distance: a silhouette is so wide
COLOUR_NOISE = 0.06  # and of that by colour
UNALIKE = 0.1  # weight of a pixel of any other colour: nothing bears out a pixel that is alone
SILHOUETTE_PX = 6  # three of `NEAR_PX`: so far from a step in depth pixels are judged, and judge
UNMEASURED = 0.1  # weight of depth that was set where none was measured

Scalar = TypeVar("Scalar", bound=np.generic)


def taken(
    plane: NDArray[Scalar], pixel: NDArray[np.intp], source: NDArray[np.intp]
) -> NDArray[Scalar]:
    """Copy a plane, with what it has at `source` put at `pixel`, flat indices of (H, W)."""
    result = plane.reshape(-1, *plane.shape[2:]).copy()
    result[pixel] = result[source]
    return result.reshape(plane.shape)


def mends(frame: SourceFrame) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the pixels whose depth is mended and the pixel that each is to be like, flat.

    Every pixel within `SILHOUETTE_PX` of one beside a step in depth is for its own depth, with a
    weight that falls with its distance and with the difference of its colour. One whose own surface
    has less than half of the weight is to be like the weighted median, in depth, if as much speaks
    against its own as one measured pixel of the same colour. The frame is mirrored at its edges.

    Notes
    -----
    Weighted median: Ma et al. 2013, "Constant time weighted median filtering for stereo matching
    and beyond". There every pixel takes it.
    """
    edge = 2 * SILHOUETTE_PX + 1
    steps = np.stack(np.divmod(np.arange(edge**2), edge), axis=-1) - SILHOUETTE_PX
    steps = steps[(steps**2).sum(axis=-1) <= SILHOUETTE_PX**2]
    fall = ((steps**2).sum(axis=-1) / (2 * NEAR_PX**2)).astype(np.float32)[:, None]
    finite = frame.depth_m[np.isfinite(frame.depth_m)]
    near_m = np.percentile(finite, NEAR_PERCENTILE) if finite.size else 1.0
    guide = 1 - near_m / frame.depth_m.astype(np.float64)
    torn = np.zeros(frame.size, np.bool_)
    torn[1:] |= abs(np.diff(guide, axis=0)) > SAME_SURFACE
    torn[:, 1:] |= abs(np.diff(guide, axis=1)) > SAME_SURFACE
    trust = np.ones(guide.size, np.float32)
    if frame.measured is not None:
        trust[~frame.measured.ravel()] = UNMEASURED
    colour = frame.colour.reshape(-1, 3)
    depth = guide.ravel().astype(np.float32)
    index = np.pad(np.arange(depth.size).reshape(frame.size), SILHOUETTE_PX, mode="reflect")
    pixels, sources = [np.zeros(0, np.intp)], [np.zeros(0, np.intp)]
    judged = np.argwhere(ndimage.maximum_filter(torn, edge)) + SILHOUETTE_PX
    for first in range(0, len(judged), CHUNK):
        at = judged[first : first + CHUNK]
        here, place = index[tuple(at.T)], index[tuple(np.moveaxis(at + steps[:, None], -1, 0))]
        apart = ((colour[place] - colour[here]) ** 2).sum(axis=-1) / (2 * COLOUR_NOISE**2)
        weight = trust[place] * np.exp(-fall) * (UNALIKE + (1 - UNALIKE) * np.exp(-apart))
        own = (weight * (abs(depth[place] - depth[here]) <= SAME_SURFACE)).sum(axis=0)
        other = weight.sum(axis=0) - own
        moved = (other > own) & (other > 1)
        here, place, weight = here[moved], place[:, moved], weight[:, moved]
        order = depth[place].argsort(axis=0, kind="stable")
        total = np.take_along_axis(weight, order, axis=0).cumsum(axis=0)
        middle = order[(2 * total < total[-1:]).sum(axis=0), np.arange(len(here))]
        pixels.append(here)
        sources.append(place[middle, np.arange(len(here))])
    return np.concatenate(pixels), np.concatenate(sources)


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
