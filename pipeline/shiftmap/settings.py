"""What can be set about a shift-map fill, and what is fixed: one place for both twins."""

from dataclasses import dataclass

import numpy as np

from pipeline.errors import InputError

TILE_PX = 8  # one shift per square of this edge in the source frame
WINDOW_PX = 8  # pixels this far around a tile are compared too
WINDOW_STEP_PX = 3  # every so many of them, along rows and columns
LEAST_COMPARED = 16  # pixels beside a hole: what fewer differ by counts the less
LOW_RESOLUTION = 2  # detail is what lies above push-pull's means of 4x4 pixels, interpolated
# How far a way looks for the background. With all that the search adds, shifts stay under the 360
# px around a hole that take part in a fill (inpaint/region.py).
WAY_REACH_PX = 256
THIN_PX, WIDE_PX = 2, 6  # across a hole: from here up, and from here on, it is not thin
EXTENSION_SHARE = 0.5  # of the base; the rest is push-pull
NEARER_SHARE = 0.25  # of the base of a thin hole whose background is in sight nowhere
OVERLAP_POWER = 3  # bilinear shares of four tiles, sharpened: 1 blends most
SUBPIXELS = 256  # motion is taken in so many parts of a pixel, as the warp gives it
TILE = TILE_PX * SUBPIXELS

# Of the search. Costs are whole numbers, so that both twins choose alike.
LENGTHS = 32  # first shifts: along the parallax, pixel by pixel
STEPS_PX = (4, 1)  # of each sweep, along rows and columns; an even number of sweeps
ENCODED_STEPS = 255  # colours are compared in these
GUIDE_STEPS = 32767  # and guides in these
SQUARE_STEPS = 1 << 22  # squares of detail are summed in these
COST_SCALE = 16  # costs: squared colour steps, times this
NOT_KNOWN_COST = 13005  # squared steps: of a tile none of whose pixels finds a source (0.2)
FARTHER_COST = 130  # of one whose sources all lie clearly behind it (0.002)
DISAGREEMENT_COST = 520  # of shifts that have nothing in common with their neighbours' (0.008)
DISAGREEMENT_PX = 8  # shifts as far apart as this have nothing in common


@dataclass(frozen=True)
class ShiftMapSettings:
    """Parameters of `shift-map`.

    Parameters
    ----------
    gain : float
        Amplitude of the copied detail relative to what the base lacks; 0 leaves the base alone.
    depth_threshold : float
        Steps of ``1 - z_near / z`` beyond this are depth edges.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    gain: float = 1.0
    depth_threshold: float = 0.04

    def __post_init__(self) -> None:
        if not (np.isfinite(self.gain) and 0 <= self.gain <= 4):
            raise InputError(f"gain must lie in [0, 4] (got {self.gain})")
        if not 0 < self.depth_threshold < 1:
            raise InputError(f"depth_threshold must lie in (0, 1) (got {self.depth_threshold})")
