"""Settings of a metamer of the periphery."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

from pipeline.errors import InputError
from pipeline.features.reference import check_levels
from pipeline.foveation.pooling import Pooling
from protocols.errors import must_be_one_of

Chroma = Literal["follow", "full", "luma"]
Residual = Literal["kept", "pooled"]


@dataclass(frozen=True)
class MetamerSettings:
    """Switches of `metamer`.

    Parameters
    ----------
    pooling : Pooling
        How widely the eye pools.
    levels : int
        Of the pyramid, from 1 to 6; small pictures have fewer.
    chroma : str
        ``follow``: chroma goes with luma's noise; ``full``: and has noise of its own for what does
        not; ``luma``: none.
    residual : str
        What lies below the last level is ``kept`` (as it gives no noise), or ``pooled`` too.
    noise : float
        Times the noise's deviation, from 0 to 4.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    pooling: Pooling = field(default_factory=Pooling)
    levels: int = 5
    chroma: Chroma = "follow"
    residual: Residual = "kept"
    noise: float = 1.0

    def __post_init__(self) -> None:
        check_levels(self.levels)
        for name, value, kind in (
            ("chroma", self.chroma, Chroma),
            ("residual", self.residual, Residual),
        ):
            if value not in get_args(kind):
                raise InputError(must_be_one_of(name, value, get_args(kind)))
        if not (0 <= self.noise <= 4 and math.isfinite(self.noise)):
            raise InputError(f"noise must lie in 0..4 (got {self.noise})")
