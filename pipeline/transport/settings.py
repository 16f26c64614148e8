"""What can be set about coherence transport, and what is fixed: one place for both twins."""

from dataclasses import dataclass

from pipeline.errors import InputError

RADIUS_PX = 4  # seen pixels this near to a hole pixel are averaged
TENSOR_PX = 3.0  # deviation of the Gaussian that averages gradients
TENSOR_REACH_PX = 6  # how far it reaches along rows and columns
TENSOR_STEP_PX = 2  # and of how many pixels it takes one
CARRY_PX = 2  # tensors are carried from seen pixels this near
COHERENCE = 10.0  # how much longer than wide the average is along a clear structure
FAINT = 0.02  # a gradient of so much encoded colour per pixel is no clear structure yet
LEAST_DIFFERENCE = 1e-6  # of eigenvalues: where they are equal there is no direction
NEAR_SHARE = 0.25  # of what is near, in thin holes that see no background of theirs
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

    Raises
    ------
    InputError
        If a value is out of range.
    """

    share: float = 0.7
    depth_threshold: float = 0.04

    def __post_init__(self) -> None:
        if not 0 <= self.share <= 1:
            raise InputError(f"share must lie in [0, 1] (got {self.share})")
        if not 0 < self.depth_threshold < 1:
            raise InputError(f"depth_threshold must lie in (0, 1) (got {self.depth_threshold})")
