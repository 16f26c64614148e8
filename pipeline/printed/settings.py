"""Settings of the printed method: one place, shared by both twins."""

from dataclasses import dataclass

from pipeline.errors import InputError
from pipeline.features.reference import check_levels


@dataclass(frozen=True)
class PrintedSettings:
    """Parameters of `metameric-paper`; the defaults are the paper's own.

    Parameters
    ----------
    levels : int
        Pyramid levels, 1 to 6 (section 4).
    gamma : float
        Exponent on validity in the push: 0 most local, 1 smoothest (3.3.1).
    depth_threshold : float
        Children nearer than the farthest by more than this, in ``1 - z_near / z``, do not count
        in the pull (the authors' release).

    Raises
    ------
    InputError
        If a value is out of range.
    """

    levels: int = 4
    gamma: float = 0.5
    depth_threshold: float = 0.04

    def __post_init__(self) -> None:
        check_levels(self.levels)
        if not 0 <= self.gamma <= 8:
            raise InputError(f"gamma must lie in 0..8 (got {self.gamma})")
        if not 0 < self.depth_threshold <= 1:
            raise InputError(f"depth_threshold must lie in (0, 1] (got {self.depth_threshold})")
