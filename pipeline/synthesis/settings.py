"""Settings of a metameric fill: one place, shared by both twins."""

from dataclasses import dataclass, fields
from typing import Literal, get_args

from pipeline.errors import InputError
from pipeline.features.reference import check_levels
from protocols.errors import must_be_one_of

Channels = Literal["correlated", "independent"]
Anchor = Literal["flow", "screen"]

# Noise is looked up at most this far outside: float32 tells 1/128 px apart there.
ANCHOR_REACH_PX = 65536.0


@dataclass(frozen=True)
class MetamericSettings:
    """Parameters of `metameric`; the defaults were chosen by measurement (docs/method.md).

    Parameters
    ----------
    levels : int
        Pyramid levels, 1 to 6.
    gamma : float
        Exponent on validity when colour and moments are pushed: 0 most local, 1 smoothest.
    depth_threshold : float
        Steps of ``1 - z_near / z`` beyond this are depth edges.
    noise : float
        Amplitude of the noise relative to the statistics; 0 leaves the base alone.
    channels : {"correlated", "independent"}
        Chroma noise that follows the luma noise as the background's does, or of its own.
    anchor : {"flow", "screen"}
        What the noise sticks to: the background by its inpainted motion, where that is less than
        `ANCHOR_REACH_PX`, or the screen (the paper's screen-door effect).
    skip_depth_edges : bool
        Leave coefficients that straddle a depth edge out of the statistics, and out of the
        measure of what the base already holds.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    levels: int = 2
    gamma: float = 0.25
    depth_threshold: float = 0.04
    noise: float = 1.0
    channels: Channels = "correlated"
    anchor: Anchor = "flow"
    skip_depth_edges: bool = True

    def __post_init__(self) -> None:
        check_levels(self.levels)
        for name, highest in (("gamma", 8.0), ("noise", 8.0)):
            value = getattr(self, name)
            if not 0 <= value <= highest:
                raise InputError(f"{name} must lie in 0..{highest:g} (got {value})")
        if not 0 < self.depth_threshold <= 1:
            raise InputError(f"depth_threshold must lie in (0, 1] (got {self.depth_threshold})")
        for name, choices in (
            ("channels", get_args(Channels)),
            ("anchor", get_args(Anchor)),
        ):
            if getattr(self, name) not in choices:
                raise InputError(must_be_one_of(name, getattr(self, name), choices))

    @classmethod
    def names(cls) -> list[str]:
        """Names of all parameters."""
        return [field.name for field in fields(cls)]
