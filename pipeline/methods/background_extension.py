"""Continue each hole from its background side, along the parallax direction.

The simple classical rival: what a hole uncovers is most likely more of what lies beside
it. Where the camera moved sideways, the parallax runs along the rows, and each row of a
hole takes its colour from its end on the background.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame, check_some_known
from pipeline.methods.method import composite
from pipeline.walks import Scene, background_ends, parallax_direction, walk_within
from protocols.errors import must_be_one_of

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
