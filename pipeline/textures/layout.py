"""Layout of a baked texture: resolutions, planes, and what bounds them.

Resolution r is the texture halved r times, edges rounded up. At each there is the colour, and from
resolution 1 on moments of all pyramid levels finer than it: those of level k lie at resolutions
k + 1 and coarser. Eight numbers a level and texel: squares and means of luma in three bands, and
products of luma with Cb and Cr summed over bands (see foveation/moments.py).
"""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.errors import InputError
from pipeline.foveation.chain import chain_length
from protocols.limits import FIXED

MOMENTS = 8
"""Numbers of a level and texel."""
COLOUR_BYTES = 3
MOMENT_BYTES = 2 * MOMENTS
MOST_EDGE_PX = FIXED["frame_edge"].most
"""As large as textures are on the GPU."""


@dataclass(frozen=True)
class Layout:
    """Layout of a texture of `width` x `height` texels.

    Parameters
    ----------
    wraps : bool
        The right border goes on at the left one, as on a globe.

    Raises
    ------
    InputError
        If it is too large, or goes round and cannot be halved evenly.
    """

    width: int
    height: int
    wraps: bool = False

    def __post_init__(self) -> None:
        if not all(1 <= edge <= MOST_EDGE_PX for edge in (self.width, self.height)):
            raise InputError(
                f"a texture must have edges of 1 to {MOST_EDGE_PX} px"
                f" (has {self.width} x {self.height})"
            )
        step = 1 << self.halvings
        if self.wraps and self.width % step:
            near = max(1, round(self.width / step)) * step
            raise InputError(
                f"a texture that goes round must be a multiple of {step} px wide, so that it can be"
                f" halved {self.halvings} times (is {self.width} px); resize it to {near} px, or"
                " bake it without --wrap"
            )

    @property
    def halvings(self) -> int:
        """Halvings of the texture; as many pyramid levels have moments."""
        return chain_length(self.width, self.height)

    def size(self, halvings: int) -> tuple[int, int]:
        """Height and width of a resolution."""
        step = 1 << halvings
        return -(-self.height // step), -(-self.width // step)

    def planes(self) -> list[Plane]:
        """All planes, in the order of the file."""
        found, at = [], 0
        for halvings in range(self.halvings + 1):
            for level in (None, *range(halvings)):
                plane = Plane(level, halvings, self.size(halvings), at)
                found.append(plane)
                at += plane.nbytes
        return found

    @property
    def nbytes(self) -> int:
        """Bytes of all planes."""
        last = self.planes()[-1]
        return last.at + last.nbytes


@dataclass(frozen=True)
class Plane:
    """Colour (`level` None) or one level's moments at a resolution; `at`: bytes before it."""

    level: int | None
    halvings: int
    size: tuple[int, int]
    at: int

    @property
    def dtype(self) -> str:
        return "u1" if self.level is None else "<f2"

    @property
    def channels(self) -> int:
        return COLOUR_BYTES if self.level is None else MOMENTS

    @property
    def row_bytes(self) -> int:
        return self.size[1] * (COLOUR_BYTES if self.level is None else MOMENT_BYTES)

    @property
    def nbytes(self) -> int:
        return self.size[0] * self.row_bytes
