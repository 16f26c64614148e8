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

from pipeline.frame import Floats, WarpedFrame
from pipeline.plate.reference import KeptFills
from pipeline.weighted_pullpush.reference import weighted_pull_push

SAME_SURFACE = 0.04  # depths that differ by a larger share of the greater one are of two surfaces


def recirculating(weight: float) -> KeptFills:
    """Return the fill of views of one source frame from what they know and what was shown.

    Parameters
    ----------
    weight : float
        Of what was shown before, ``1 / quality^2``; what is known weighs 1. Above 0.
    """
    return KeptFills(_filled, SAME_SURFACE, weight=weight, overwrites=True)


def _filled(frame: WarpedFrame, weight: Floats) -> NDArray[np.float32]:
    return weighted_pull_push(np.dstack([frame.colour, weight])).astype(np.float32)
