"""Pixels that would mislead: outliers and silhouettes of measured depth, and mixed pixels.

A hole takes the farthest depth of the quads that tore there, so one wrong pixel beside it decides
the whole of it. Measured depth has such pixels, alone and in small clumps, most of all along
silhouettes. They take depth and motion from around them before anything is warped. Then the
silhouettes themselves, which are ragged, and which nothing measured in places, follow the colours:
else the warp would comb them. Rendered depth is right, and is left alone.

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

from pipeline.frame import Bools, Floats, SourceFrame, WarpedFrame

LEAST_ALIKE = 12  # pixels of the 7x7 around one, itself included, that bear it out
WINDOW_PX = 3  # pixels this far along rows and columns are in the window
WIDER_PX = (3, 6, 12)  # windows in which a mend is looked for, in turn
SAME_SURFACE = 0.04  # steps of 1 - z_near / z up to this are of one surface
NEAR_PERCENTILE = 1.0  # of depth, for z_near: outliers do not set it
CHUNK = 1 << 14  # pixels whose windows are looked at in one go
NEAR_PX = 2.0  # standard deviation of the weight by distance: a silhouette is so wide
COLOUR_NOISE = 0.06  # and of that by colour
SILHOUETTE_PX = 6  # three of the former: so far from a step in depth pixels are judged, and judge
UNMEASURED = 0.1  # weight of depth that was set where none was measured

Scalar = TypeVar("Scalar", bound=np.generic)


def taken(
    plane: NDArray[Scalar], pixel: NDArray[np.intp], source: NDArray[np.intp]
) -> NDArray[Scalar]:
    """Copy a plane, with what it has at `source` put at `pixel`, each (N, 2)."""
    result = plane.copy()
    result[tuple(pixel.T)] = plane[tuple(source.T)]
    return result


def mends(frame: SourceFrame) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the pixels whose depth is mended and the pixel that each is to be like, (N, 2) each.

    Outliers are mended first, then silhouettes.
    """
    own = np.arange(frame.depth_m.size).reshape(frame.size)
    first = outlier_mends(frame.depth_m)
    second = silhouette_mends(replace(frame, depth_m=taken(frame.depth_m, *first)))
    like = taken(taken(own, *first), *second)
    pixel = np.argwhere(like != own)
    return pixel, np.stack(np.divmod(like[tuple(pixel.T)], frame.size[1]), axis=-1)


def outlier_mends(
    depth_m: NDArray[np.float32],
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the pixels that are outliers and the pixel that each is to be like, (N, 2) each.

    That is the median, in depth, of what is no outlier in the smallest window of `WIDER_PX` that
    holds any. An outlier without one stays as it is.
    """
    bad = outliers(depth_m)
    left = np.argwhere(bad)
    pixels, sources = [np.zeros((0, 2), np.intp)], [np.zeros((0, 2), np.intp)]
    for around in WIDER_PX:
        edge = 2 * around + 1
        steps = np.stack(np.divmod(np.arange(edge**2), edge), axis=-1) - around
        good_depth_m = np.pad(np.where(bad, np.nan, depth_m), around, constant_values=np.nan)
        unmended = []
        for some in _chunks(left):
            place = some[:, None] + around + steps
            found = good_depth_m[place[..., 0], place[..., 1]]
            count = (~np.isnan(found)).sum(axis=1)
            middle = np.argsort(found, axis=1, kind="stable")[np.arange(len(some)), count // 2]
            pixels.append(some[count > 0])
            sources.append((some + steps[middle])[count > 0])
            unmended.append(some[count == 0])
        left = np.concatenate(unmended) if unmended else left
    return np.concatenate(pixels), np.concatenate(sources)


def silhouette_mends(frame: SourceFrame) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return pixels beside a step in depth and the pixel that each is to be like, (N, 2) each.

    Every pixel within `SILHOUETTE_PX` of one is for its own depth, with a weight that falls with
    its distance and with the difference of its colour. One whose own surface has less than half of
    the weight is to be like the weighted median, in depth, if as much speaks against its own as
    one measured pixel of the same colour. The frame is mirrored at its edges.

    Notes
    -----
    Weighted median: Ma et al. 2013, "Constant time weighted median filtering for stereo matching
    and beyond". There every pixel takes it.
    """
    edge = 2 * SILHOUETTE_PX + 1
    steps = np.stack(np.divmod(np.arange(edge**2), edge), axis=-1) - SILHOUETTE_PX
    steps = steps[(steps**2).sum(axis=-1) <= SILHOUETTE_PX**2]
    fall = ((steps**2).sum(axis=-1) / (2 * NEAR_PX**2)).astype(np.float32)[:, None]
    guide = _guide(frame.depth_m)
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
    for some in _chunks(np.argwhere(ndimage.maximum_filter(torn, edge))):
        at = some + SILHOUETTE_PX
        here, place = index[tuple(at.T)], index[tuple(np.moveaxis(at + steps[:, None], -1, 0))]
        apart = ((colour[place] - colour[here]) ** 2).sum(axis=-1) / (2 * COLOUR_NOISE**2)
        weight = trust[place] * np.exp(-apart - fall)
        own = (weight * (abs(depth[place] - depth[here]) <= SAME_SURFACE)).sum(axis=0)
        other = weight.sum(axis=0) - own
        moved = (other > own) & (other > 1)
        here, place, weight = here[moved], place[:, moved], weight[:, moved]
        order = depth[place].argsort(axis=0, kind="stable")
        total = np.take_along_axis(weight, order, axis=0).cumsum(axis=0)
        middle = order[(2 * total < total[-1:]).sum(axis=0), np.arange(len(here))]
        pixels.append(here)
        sources.append(place[middle, np.arange(len(here))])
    pixel, source = (
        np.stack(np.divmod(np.concatenate(found), frame.size[1]), axis=-1)
        for found in (pixels, sources)
    )
    return pixel, source


def _guide(depth_m: NDArray[np.float32]) -> Floats:
    """Return 1 - z_near / z, which an outlier does not set."""
    finite = depth_m[np.isfinite(depth_m)]
    near_m = np.percentile(finite, NEAR_PERCENTILE) if finite.size else 1.0
    guide: Floats = 1 - near_m / depth_m.astype(np.float64)
    return guide


def _chunks(pixels: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Cut (N, 2) into parts whose windows fit memory."""
    return [pixels[first : first + CHUNK] for first in range(0, len(pixels), CHUNK)]


def outliers(depth_m: NDArray[np.float32]) -> Bools:
    """Return True for pixels that nothing around them bears out, shape (H, W).

    A pixel is borne out if at least `LEAST_ALIKE` of the 7x7 around it have its depth, or if three
    steps over such pixels lead out of the 5x5 around it: thin things, such as spokes, wires and
    what is seen between them, go on beyond. And so is one beside a pixel of its depth that is. The
    frame is mirrored at its edges.
    """
    guide = np.pad(_guide(depth_m), WINDOW_PX, mode="reflect")

    def alike(pixel: NDArray[np.intp], y: int, x: int) -> Bools:
        place = pixel + WINDOW_PX
        apart = guide[tuple(place.T)] - guide[place[:, 0] + y, place[:, 1] + x]
        return np.asarray(np.abs(apart) <= SAME_SURFACE)

    pixel = np.argwhere(np.ones(depth_m.shape, np.bool_))
    for y, x in ((0, 1), (1, 0), (0, -1), (-1, 0)):  # most pixels go on straight
        ends = [alike(pixel, count * y, count * x) for count in range(1, WINDOW_PX + 1)]
        pixel = pixel[~np.logical_and.reduce(ends)]
    edge = 2 * WINDOW_PX + 1
    lonely, beside = [np.zeros((0, 2), np.intp)], [np.zeros((0, 3, 3), np.bool_)]
    for some in _chunks(pixel):
        window = np.zeros((len(some), edge, edge), np.bool_)
        for y, x in np.ndindex(edge, edge):
            window[:, y, x] = alike(some, y - WINDOW_PX, x - WINDOW_PX)
        reached = np.zeros_like(window)
        reached[:, WINDOW_PX, WINDOW_PX] = True
        for _ in range(WINDOW_PX):
            reached = window & _grown(reached)
        reached[:, 1:-1, 1:-1] = False
        alone = (window.sum(axis=(1, 2)) < LEAST_ALIKE) & ~reached.any(axis=(1, 2))
        lonely.append(some[alone])
        beside.append(window[alone, 2:5, 2:5])
    return _unborne(depth_m.shape, np.concatenate(lonely), np.concatenate(beside))


def _grown(masks: Bools) -> Bools:
    """Grow each of (N, H, W) masks by a pixel all around."""
    padded = np.pad(masks, ((0, 0), (1, 1), (1, 1)))
    height, width = masks.shape[1:]
    shifted = [padded[:, y : y + height, x : x + width] for y, x in np.ndindex(3, 3)]
    return np.asarray(np.logical_or.reduce(shifted))


def _unborne(shape: tuple[int, ...], pixel: NDArray[np.intp], beside: Bools) -> Bools:
    """Mark pixels, (N, 2), but for those beside one of their depth that is not marked.

    `beside`, (N, 3, 3), tells which around them have their depth.
    """
    bad = np.zeros(shape, np.bool_)
    bad[tuple(pixel.T)] = True
    while len(pixel):
        borne = np.zeros(len(pixel), np.bool_)
        for y, x in np.ndindex(3, 3):
            place = (pixel + np.array([y - 1, x - 1])).clip(0, np.array(shape) - 1)
            borne |= beside[:, y, x] & ~bad[tuple(place.T)]
        if not borne.any():
            break
        bad[tuple(pixel[borne].T)] = False
        pixel, beside = pixel[~borne], beside[~borne]
    return bad


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
