"""Settings of coherence transport, and what is fixed: one place for both twins."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.geometry import Flat, share_around

RADIUS_PX = 4  # seen pixels this near to a hole pixel are averaged
TENSOR_PX = 3.0  # deviation of the Gaussian that averages gradients
TENSOR_REACH_PX = 6  # how far it reaches along rows and columns
TENSOR_STEP_PX = 2  # and of how many pixels it takes one
CARRY_PX = 2  # tensors are carried from seen pixels this near
COHERENCE = 10.0  # how much longer than wide the average is along a clear structure
FAINT = 0.02  # a gradient of so much encoded colour per pixel is no clear structure yet
LEAST_DIFFERENCE = 1e-6  # of eigenvalues: where they are equal there is no direction
NEAR_SHARE = 0.25  # of what is near, in thin holes that see no background of theirs
WORKED_PX = 64  # transport works this far around what the gaze leaves it: edges come from there
THIN_PX, WIDE_PX = 2, 6  # across a hole: up to here it is thin, and from here on it is not


@dataclass(frozen=True)
class TransportSettings:
    """Parameters of `coherence-transport`.

    Parameters
    ----------
    share : float
        Of transport in the fill, from 0 to 1; the rest is `push-pull-depth`.
    depth_threshold : float
        Steps of ``1 - z_near / z`` beyond this are depth edges.
    fovea_deg : float
        Within this angle of the gaze transport works; over the next degree it gives way to
        `push-pull-depth`, which alone fills what lies beyond. 0: transport works everywhere.
    gaze_x_deg, gaze_y_deg : float
        Where the eye looks, right of and below the frame's middle.
    width_deg : float
        Visual angle of the frame's width.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    share: float = 0.7
    depth_threshold: float = 0.04
    fovea_deg: float = 0.0
    gaze_x_deg: float = 0.0
    gaze_y_deg: float = 0.0
    width_deg: float = 40.0

    def __post_init__(self) -> None:
        if not 0 <= self.share <= 1:
            raise InputError(f"share must lie in [0, 1] (got {self.share})")
        if not 0 < self.depth_threshold < 1:
            raise InputError(f"depth_threshold must lie in (0, 1) (got {self.depth_threshold})")
        if not 0 <= self.fovea_deg <= 180:
            raise InputError(f"fovea_deg must lie in [0, 180] (got {self.fovea_deg})")
        for name in ("gaze_x_deg", "gaze_y_deg"):
            if not -90 < getattr(self, name) < 90:
                raise InputError(f"{name} must lie in (-90, 90) (got {getattr(self, name)})")
        Flat(width_deg=self.width_deg)  # checks its range
        for name in ("gaze_x_deg", "gaze_y_deg", "width_deg"):
            if self.fovea_deg == 0 and getattr(self, name) != getattr(type(self), name):
                raise InputError(
                    f"{name} (got {getattr(self, name)}) is for a fill by eccentricity and needs"
                    " fovea_deg above 0, how far around the gaze transport works; give it, too"
                )

    def attention(self, size: tuple[int, int]) -> NDArray[np.float32]:
        """Share of transport that the gaze leaves: (H, W) of a frame of `size`, 1 at the gaze."""
        if self.fovea_deg == 0:
            return np.ones(size, np.float32)
        eye = Flat(width_deg=self.width_deg).of(size[1], size[0])
        return share_around(eye, eye.place_px(self.gaze_x_deg, self.gaze_y_deg), self.fovea_deg)

    def worked(self, size: tuple[int, int]) -> tuple[slice, slice]:
        """Rows and columns where transport works in a frame of `size`."""
        attended = self.attention(size) > 0

        def around(axis: int) -> slice:
            found = np.flatnonzero(attended.any(axis=1 - axis))
            if not len(found):
                return slice(0, 0)
            first, last = int(found[0]), int(found[-1])
            return slice(max(0, first - WORKED_PX), min(size[axis], last + WORKED_PX + 1))

        return around(0), around(1)
