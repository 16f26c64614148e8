"""Continue each hole from its background side, along the parallax direction.

The simple classical rival: what a hole uncovers is most likely more of what lies beside
it. Where the camera moved sideways, the parallax runs along the rows, and each row of a
hole takes its colour from its end on the background. What a hole uncovers lies behind the
foreground that moved away, so its background side is where the foreground moves relative to
the background, reversed.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from pipeline.errors import InputError
from pipeline.frame import Bools, Floats, WarpedFrame, check_some_known
from pipeline.methods.method import composite
from protocols.errors import must_be_one_of

_MARGIN_PX = 2.0  # by how much rounding may widen a hole beyond the motion that opened it


def parallax_direction(warped: WarpedFrame, depth_threshold: float = 0.04) -> Floats:
    """Direction to each hole's background side, shape (H, W, 2), (row, column), unit length.

    Zero outside holes. The direction is ``background motion - foreground motion``, the background's
    being the frame's own motion inside the hole and the foreground's that of the nearest pixel at
    a hole's border which is clearly nearer than the hole. A hole that no such pixel can have opened
    (content that enters at the image border) takes the direction to the nearest known pixel.
    """
    hole = warped.hole
    result = np.zeros((*hole.shape, 2))
    if not hole.any() or hole.all():
        return result
    start = np.argwhere(hole)
    border = _border(~hole)
    toward_known = border[_nearest(border, start)] - start
    direction = toward_known / np.linalg.norm(toward_known, axis=1, keepdims=True)

    # How far the hole beside each known border pixel is.
    beside_m = ndimage.maximum_filter(np.where(hole, warped.depth_m, 0), size=3)
    nearer = _clearly_nearer(warped.depth_m, beside_m, depth_threshold)
    foreground = border[nearer[border[:, 0], border[:, 1]]]
    if len(foreground):
        by = foreground[_nearest(foreground, start)]
        relative = _motion(warped, start) - _motion(warped, by)
        length = np.linalg.norm(relative, axis=1)
        distance = np.linalg.norm(by - start, axis=1)
        opened = (length > 0) & (distance <= length + _MARGIN_PX)
        direction[opened] = relative[opened] / length[opened, None]
    result[hole] = direction
    return result


def _border(known: Bools) -> NDArray[np.intp]:
    """Known pixels that touch an unknown one; the nearest known pixel is always one of them."""
    return np.argwhere(known & ndimage.binary_dilation(~known, np.ones((3, 3), np.bool_)))


def _nearest(points: NDArray[np.intp], to: NDArray[np.intp]) -> NDArray[np.intp]:
    """Index of the point nearest to each of `to`."""
    _, index = cKDTree(points).query(to)
    return np.asarray(index, np.intp)


def _motion(warped: WarpedFrame, pixel: NDArray[np.intp]) -> Floats:
    """Motion (row, column) of each pixel."""
    return warped.flow_px[pixel[:, 0], pixel[:, 1], ::-1].astype(np.float64)


@dataclass(frozen=True)
class Scene:
    """Scene of walks: known pixels, depth, and which share of a depth counts as clearly nearer."""

    known: Bools
    depth_m: NDArray[np.float32]
    depth_threshold: float


@dataclass(frozen=True)
class WalkEnds:
    """Ends of walks: pixel (N, 2), the step taken (N, 2), how many steps (N), whether found (N)."""

    end: NDArray[np.intp]
    step: Floats
    steps: NDArray[np.intp]
    found: Bools


def background_ends(scene: Scene, start: NDArray[np.intp], direction: Floats) -> WalkEnds:
    """Walk to the background side, and the other way where that side is foreground or outside."""
    ahead = walk_to_known(scene.known, start, direction)
    guide_m = scene.depth_m[start[:, 0], start[:, 1]]
    ahead_m = scene.depth_m[ahead.end[:, 0], ahead.end[:, 1]]
    doubtful = ~ahead.found | _clearly_nearer(ahead_m, guide_m, scene.depth_threshold)
    back = walk_to_known(scene.known, start[doubtful], -direction[doubtful])
    back_m = scene.depth_m[back.end[:, 0], back.end[:, 1]]
    better = back.found & (~ahead.found[doubtful] | (back_m > ahead_m[doubtful]))
    ends = _replace(ahead, np.flatnonzero(doubtful)[better], back, better)

    lost = np.flatnonzero(~ends.found)
    return _replace(ends, lost, _nearest_known(scene.known, start[lost]), np.ones(len(lost), bool))


def _nearest_known(known: Bools, start: NDArray[np.intp]) -> WalkEnds:
    """The nearest known pixel in any direction, which always exists."""
    border = _border(known)
    end = border[_nearest(border, start)] if len(start) else start
    steps = np.abs(end - start).max(axis=1, initial=0)
    step = (end - start) / np.maximum(steps, 1)[:, None]
    return WalkEnds(end, step, steps, np.ones(len(start), bool))


def walk_to_known(known: Bools, start: NDArray[np.intp], direction: Floats) -> WalkEnds:
    """Step from pixel to pixel until one is known; not found where the image ends before."""
    longest = np.abs(direction).max(axis=1, keepdims=True)
    step = np.divide(direction, longest, out=np.zeros_like(direction), where=longest > 0)
    end, steps = start.copy(), np.zeros(len(start), np.intp)
    found = np.zeros(len(start), bool)
    walking = np.flatnonzero(longest[:, 0] > 0)
    count = 0
    while len(walking):
        count += 1
        pixel = np.rint(start[walking] + count * step[walking]).astype(np.intp)
        inside = ((pixel >= 0) & (pixel < known.shape)).all(axis=1)
        walking, pixel = walking[inside], pixel[inside]
        arrived = known[pixel[:, 0], pixel[:, 1]]
        done = walking[arrived]
        end[done], steps[done], found[done] = pixel[arrived], count, True
        walking = walking[~arrived]
    return WalkEnds(end, step, steps, found)


def walk_within(
    scene: Scene, start: NDArray[np.intp], step: Floats, steps: NDArray[np.intp]
) -> NDArray[np.intp]:
    """Go on by up to `steps`, while the pixels are known and not clearly nearer than `start`."""
    guide_m = scene.depth_m[start[:, 0], start[:, 1]]
    end = start.copy()
    walking = np.flatnonzero(steps > 0)
    count = 0
    while len(walking):
        count += 1
        pixel = np.rint(start[walking] + count * step[walking]).astype(np.intp)
        inside = ((pixel >= 0) & (pixel < scene.known.shape)).all(axis=1)
        walking, pixel = walking[inside], pixel[inside]
        row, column = pixel[:, 0], pixel[:, 1]
        same = scene.known[row, column] & ~_clearly_nearer(
            scene.depth_m[row, column], guide_m[walking], scene.depth_threshold
        )
        walking, pixel = walking[same], pixel[same]
        end[walking] = pixel
        walking = walking[steps[walking] > count]
    return end


def _replace(ends: WalkEnds, where: NDArray[np.intp], by: WalkEnds, chosen: Bools) -> WalkEnds:
    fields = {}
    for name in ("end", "step", "steps", "found"):
        values = getattr(ends, name).copy()
        values[where] = getattr(by, name)[chosen]
        fields[name] = values
    return WalkEnds(**fields)


def _clearly_nearer(
    depth_m: NDArray[np.float32], than_m: NDArray[np.float32], threshold: float
) -> Bools:
    return np.asarray(depth_m < np.float32(1 - threshold) * than_m)


_CONTINUATIONS = ("repeat", "mirror")


class BackgroundExtension:
    """Each hole pixel takes the colour found on walking to the hole's background side.

    1. The direction. A hole opens behind the foreground that moved away, so its background
       side lies where the foreground moves relative to the background, reversed:
       ``background motion - foreground motion``, the background's being the frame's own
       motion inside the hole and the foreground's that of the nearest pixel at a hole's
       border which is clearly nearer than the hole. A hole that no such pixel can have
       opened (content that enters at the image border) takes the direction to the nearest
       known pixel.
    2. The end. The pixel walks until it meets a known pixel. If that is foreground (clearly
       nearer than the hole), or the image ends before, it walks the other way too and the
       farther of the two ends counts. Where both walks leave the image, the nearest known
       pixel is the end.
    3. The colour: that of the end (``repeat``), or of the pixel as far beyond the end as the
       hole pixel is before it (``mirror``; repeated from where the background ends).

    Parameters
    ----------
    continuation : {"repeat", "mirror"}
        How the background goes on inside the hole.
    inset_px : int
        How many more pixels to walk into the background, past the mixed colours of a
        silhouette; fewer where it is narrower.
    depth_threshold : float
        How much nearer counts as clearly nearer: by this share of the depth. It knows no
        range of the frame, which would flicker from frame to frame.
    """

    def __init__(
        self,
        *,
        continuation: str = "repeat",
        inset_px: int = 1,
        depth_threshold: float = 0.04,
    ) -> None:
        if continuation not in _CONTINUATIONS:
            raise InputError(must_be_one_of("continuation", continuation, _CONTINUATIONS))
        if not 0 <= inset_px <= 16:
            raise InputError(f"inset_px must lie in 0..16 (got {inset_px})")
        if not 0 < depth_threshold < 1:
            raise InputError(f"depth_threshold must lie in (0, 1) (got {depth_threshold})")
        self.continuation = continuation
        self.inset_px = inset_px
        self.depth_threshold = depth_threshold

    def fill(self, warped: WarpedFrame, seed: int) -> NDArray[np.float32]:  # noqa: ARG002
        """Fill the holes; every filled pixel has a colour of the frame's."""
        check_some_known(warped.hole)
        if not warped.hole.any():
            return warped.colour.copy()
        scene = Scene(~warped.hole, warped.depth_m, self.depth_threshold)
        start = np.argwhere(warped.hole)
        direction = parallax_direction(warped, self.depth_threshold)[warped.hole]
        ends = background_ends(scene, start, direction)
        # Mirrored, the last hole pixel takes the first known one: no gap, no doubling.
        beyond = ends.steps - 1 if self.continuation == "mirror" else np.zeros_like(ends.steps)
        source = walk_within(scene, ends.end, ends.step, beyond + self.inset_px)
        filled = warped.colour.copy()
        filled[warped.hole] = warped.colour[source[:, 0], source[:, 1]]
        return composite(warped, filled)

    def release(self) -> None:
        """Hold nothing."""
