"""Texture from the background itself, in place of filtered white noise.

Noise has the background's variances and nothing of its structure. The background beside a
hole has both: each hole pixel takes the fine detail of a known background pixel that lies
whole steps away along the parallax, where Kuffner dos Anjos et al. 2022, 3.4, take noise.
What detail is added, and how much, the inpainted statistics decide as before
(docs/decisions/0016).

1. Eight rays go from the hole pixel to the nearest known pixels. The nearest end in front of
   the background is the foreground that opened the hole; background motion minus foreground
   motion points to the background side. The ray of that octant ends at the hole's border.
2. The pixel's distance from that border, in the source frame, is rounded up to whole steps;
   so many steps ahead lies the texture. Sub-pixel motion changes neither (3.4.1), and
   neighbours keep their places, so structure stays intact.
3. The detail of a pyramid level is that level less the next coarser one, at that place.

Twin: seek.comp.glsl and shaderlib/detail.glsl. Change both or neither.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.colour import ycbcr_from_rgb
from pipeline.features.reference import halve
from pipeline.frame import WarpedFrame

REACH_PX = 64  # how far a ray looks for a known pixel
STEPS_PX = (32, 16, 8)  # tried in turn, until the texture is background and known
INSET_PX = 2 / 3  # past mixed border pixels; off halves, where rounding would decide
MARGIN_PX = 2  # by how much rounding may widen a hole beyond the motion that opened it
OCTANTS = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))  # row, column
OCTANT_TANGENT = 0.41421356  # of 22.5 degrees


@dataclass(frozen=True, eq=False)
class Scene:
    """What rays see."""

    known: NDArray[np.bool_]
    guide: NDArray[np.float64]
    flow: NDArray[np.float64]  # (H, W, 2): row, column
    threshold: float

    def is_background(self, place: NDArray[np.intp], pixel: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Tell whether `place` (N, 2) is known and not in front of hole pixel `pixel`."""
        inside = ((place >= 0) & (place < self.known.shape)).all(axis=1)
        step = at(self.guide, pixel) - at(self.guide, place)
        return np.asarray(inside & at(self.known, place) & (step <= self.threshold))


def at(array: NDArray[Any], place: NDArray[np.intp]) -> NDArray[Any]:
    """Read pixels (..., 2), (row, column); beyond the border, the border."""
    row, column = np.moveaxis(np.clip(place, 0, np.array(array.shape[:2]) - 1), -1, 0)
    return np.asarray(array[row, column])


def texture_origins(
    warped: WarpedFrame, guide: NDArray[np.float64], threshold: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Tell from where in the frame each hole pixel takes its texture.

    Parameters
    ----------
    guide : ndarray, shape (H, W)
        ``1 - z_near / z``.
    threshold : float
        Steps of the guide beyond this are depth edges.

    Returns
    -------
    origin_px : ndarray, shape (H, W, 2)
        (x, y) of a point between known background pixels; 0 where not `found`.
    found : ndarray of bool, shape (H, W)
        False outside holes, and where there is no such point within reach.
    """
    flow = warped.flow_px.astype(np.float64)[..., ::-1]
    scene = Scene(~warped.hole, guide, flow, threshold)
    pixel = np.argwhere(warped.hole)
    border, direction, waiting = background_border(scene, pixel)
    source, source_border = pixel - at(flow, pixel), np.rint(border - at(flow, border))
    distance = np.abs(source_border - source).max(axis=1, initial=0) + INSET_PX
    origin = np.zeros((len(pixel), 2))
    found = np.zeros(len(pixel), bool)
    for step in STEPS_PX:
        jump = (step * np.ceil(distance / step)).astype(np.intp)
        place = pixel + jump[:, None] * direction
        # Motion that varies over the background must not make the texture glide.
        point = place + at(flow, place) - at(flow, pixel)
        usable = waiting & scene.is_background(place, pixel)
        for rows in (np.floor, np.ceil):
            for columns in (np.floor, np.ceil):
                corner = np.stack([rows(point[:, 0]), columns(point[:, 1])], axis=1)
                usable &= scene.is_background(corner.astype(np.intp), pixel)
        origin[usable] = point[usable]
        found |= usable
        waiting = waiting & ~usable
    origin_px = np.zeros((*warped.hole.shape, 2))
    origin_px[warped.hole] = np.where(found[:, None], origin[:, ::-1] + 0.5, 0.0)
    taken = np.zeros(warped.hole.shape, bool)
    taken[warped.hole] = found
    return origin_px, taken


def background_border(
    scene: Scene, pixel: NDArray[np.intp], reach_px: int = REACH_PX
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]:
    """Find the known pixel on each hole pixel's background side, and the octant it lies in.

    Returns end, direction (both (N, 2)) and whether there is one. Where there is none, the
    direction is that of the parallax, 0 without any.
    """
    octants = np.array(OCTANTS)
    steps, end = rays(scene.known, pixel, reach_px)
    met = steps > 0
    behind = np.stack([scene.is_background(place, pixel) for place in end])
    length = np.where(met, steps**2 * (octants**2).sum(axis=1)[:, None], np.inf)
    everyone = np.arange(len(pixel))

    to_opener = np.where(behind, np.inf, length)
    nearest = to_opener.argmin(axis=0)
    relative = at(scene.flow, pixel) - at(scene.flow, end[nearest, everyone])
    reach = np.sqrt((relative**2).sum(axis=1))
    opened = (reach > 0) & (np.sqrt(to_opener.min(axis=0)) <= reach + MARGIN_PX)
    to_background = np.where(behind & met, length, np.inf)
    chosen = np.where(opened, _octant(relative), to_background.argmin(axis=0))
    # The other way, where the background side is another foreground or out of sight; or else the
    # nearest background that there is.
    chosen = np.where((behind & met)[chosen, everyone], chosen, (chosen + 4) % 8)
    chosen = np.where((behind & met)[chosen, everyone], chosen, to_background.argmin(axis=0))
    found = (behind & met)[chosen, everyone]
    parallax = octants[_octant(relative)] * (reach > 0)[:, None]
    return end[chosen, everyone], np.where(found[:, None], octants[chosen], parallax), found


def rays(
    known: NDArray[np.bool_], pixel: NDArray[np.intp], reach_px: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Walk all octants to the first known pixel: steps taken (8, N; 0: none), ends (8, N, 2)."""
    steps = np.zeros((len(OCTANTS), len(pixel)), np.intp)
    for ray, direction in zip(steps, np.array(OCTANTS), strict=True):
        for count in range(1, reach_px + 1):
            place = pixel + count * direction
            inside = ((place >= 0) & (place < known.shape)).all(axis=1)
            ray[(ray == 0) & inside & at(known, place)] = count
    ends = pixel + steps[:, :, None] * np.array(OCTANTS)[:, None]
    return steps, ends


def _octant(vector: NDArray[np.float64]) -> NDArray[np.intp]:
    """Index into `OCTANTS` of the direction nearest to each (row, column)."""
    y, x = np.abs(vector).T
    sign = np.sign(vector) * np.stack([y > OCTANT_TANGENT * x, x > OCTANT_TANGENT * y], axis=1)
    index = np.zeros((3, 3), np.intp)
    for number, (row, column) in enumerate(OCTANTS):
        index[row + 1, column + 1] = number
    place = sign.astype(np.intp) + 1
    return np.asarray(index[place[:, 0], place[:, 1]])


def details(
    base: NDArray[np.float64], origin_px: NDArray[np.float64], levels: int
) -> list[NDArray[np.float64]]:
    """Detail of every level at `origin_px`: each (H, W, 3), Y', Cb, Cr.

    Parameters
    ----------
    base : ndarray, shape (H, W, 3)
        The frame, holes filled.
    origin_px : ndarray, shape (H, W, 2)
        (x, y) of where to look.
    """
    result: list[NDArray[np.float64]] = []
    image: NDArray[np.float64] = base
    here = sample_image(base, 0, origin_px)
    for level in range(1, levels + 1):
        image = halve(image)
        coarser = sample_image(image, level, origin_px)
        result.append(ycbcr_from_rgb(here - coarser).astype(np.float64))
        here = coarser
    return result


def sample_image(
    image: NDArray[np.float64], level: int, place_px: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Interpolate a pyramid level at points (x, y) of full size, borders repeated."""
    place = place_px[..., ::-1] / (1 << level) - 0.5
    corner = np.floor(place)
    fraction = (place - corner)[..., None]
    first = corner.astype(np.intp)
    last = np.array(image.shape[:2]) - 1
    (y0, x0), (y1, x1) = (np.moveaxis(np.clip(first + offset, 0, last), -1, 0) for offset in (0, 1))
    y, x = fraction[..., 0, :], fraction[..., 1, :]
    return np.asarray(
        (1 - y) * ((1 - x) * image[y0, x0] + x * image[y0, x1])
        + y * ((1 - x) * image[y1, x0] + x * image[y1, x1])
    )
