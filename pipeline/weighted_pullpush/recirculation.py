"""The last shown frame comes back into the holes of the next, in numpy.

Source: "20090110 - Hole Filling": the last frame is reprojected along the filled motion and merged
with the new one at a lower quality, and holes are filled from both. The note recirculates what was
drawn, without its fill. Views of one source frame all draw the same, so here the fill comes back
too (docs/decisions/0044). Depth and motion need no fill: the warp gives holes their background's.

The frame is kept by places of the source, as plate/reference.py keeps fills, but each view writes
what it shows over what was there.

Twin: `PlatePass` of plate/gpu.py. Change both or neither.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.frame import WarpedFrame
from pipeline.plate.reference import SourcePlate
from pipeline.weighted_pullpush.reference import weighted_pull_push

SAME_SURFACE = 0.04  # depths that differ by a larger share of the greater one are of two surfaces


class Recirculation:
    """What views of one source frame have shown.

    Parameters
    ----------
    weight : float
        Of what was shown before, ``1 / quality^2``; what is known weighs 1. Above 0.
    """

    def __init__(self, weight: float) -> None:
        self._weight = weight
        self._plate = SourcePlate(SAME_SURFACE)

    def fill(self, warped: WarpedFrame, seed: int = 0) -> NDArray[np.float32]:  # noqa: ARG002
        """Fill the next view of the source; all of them have one size."""
        hole = warped.hole
        if not hole.any():
            return warped.colour
        known, colour = self._plate.recall(warped)
        image = np.dstack([warped.colour, (~hole).astype(np.float64)])
        image[hole] = np.where(known[:, None], np.insert(colour, 3, self._weight, axis=1), 0.0)
        fill = weighted_pull_push(image).astype(np.float32)
        shown = np.where(hole[..., None], fill, warped.colour)
        self._plate.keep(warped, shown, again=True)
        return shown
