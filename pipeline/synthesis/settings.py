"""What can be set about a metameric fill: one place, shared by both twins."""

from dataclasses import dataclass, fields
from typing import Literal, get_args

from pipeline.errors import InputError
from pipeline.features.reference import check_levels

Channels = Literal["correlated", "independent"]
Anchor = Literal["flow", "camera", "screen"]
Texture = Literal["noise", "background"]


@dataclass(frozen=True)
class MetamericSettings:
    """Parameters of `metameric`; the defaults were chosen by measurement (docs/method.md).

    Parameters
    ----------
    levels : int
        Pyramid levels, 1 to 6.
    gamma : float
        Exponent on validity when moments are pushed: 0 most local, 1 smoothest.
    base_gamma : float
        The same for the colour that the noise is added to.
    depth_threshold : float
        Steps of ``1 - z_near / z`` beyond this are depth edges.
    noise : float
        Amplitude of the noise relative to the statistics; 0 leaves the base alone.
    channels : {"correlated", "independent"}
        Chroma noise that follows the luma noise as the background's does, or of its own.
    anchor : {"flow", "camera", "screen"}
        What the noise sticks to: the background by its inpainted motion, the background
        by its depth and two cameras, or the screen (the paper's screen-door effect).
    skip_depth_edges : bool
        Leave coefficients that straddle a depth edge out of the statistics.
    texture : {"noise", "background"}
        What is shaped by the statistics: filtered white noise, or the detail of the known
        background along the parallax, and noise where that is out of reach. The latter needs
        at least 2 levels.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    levels: int = 4
    gamma: float = 0.5
    base_gamma: float = 0.25
    depth_threshold: float = 0.04
    noise: float = 1.0
    channels: Channels = "correlated"
    anchor: Anchor = "flow"
    skip_depth_edges: bool = True
    texture: Texture = "noise"

    def __post_init__(self) -> None:
        check_levels(self.levels)
        for name, highest in (("gamma", 8.0), ("base_gamma", 8.0), ("noise", 8.0)):
            value = getattr(self, name)
            if not 0 <= value <= highest:
                raise InputError(f"{name} must lie in 0..{highest:g} (got {value})")
        if not 0 < self.depth_threshold <= 1:
            raise InputError(f"depth_threshold must lie in (0, 1] (got {self.depth_threshold})")
        if self.texture == "background" and self.levels < 2:
            raise InputError(
                f'levels must be at least 2 for texture "background" (got {self.levels})'
            )
        for name, choices in (
            ("channels", get_args(Channels)),
            ("anchor", get_args(Anchor)),
            ("texture", get_args(Texture)),
        ):
            if getattr(self, name) not in choices:
                raise InputError(
                    f"{name} must be one of {', '.join(choices)} (got {getattr(self, name)!r})"
                )

    @classmethod
    def names(cls) -> list[str]:
        """Names of all parameters."""
        return [field.name for field in fields(cls)]
