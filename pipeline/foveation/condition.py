"""Interface of every condition."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Protocol

from pipeline.foveation.geometry import Geometry
from pipeline.foveation.picture_fixation import Picture, PictureFixation
from pipeline.foveation.pooling import Pooling

if TYPE_CHECKING:
    import moderngl

    from pipeline.foveation.gpu import FoveationPass


class Condition(Protocol):
    """A configured way to change a picture for a gaze.

    A pure function of picture, fixation and parameters: any state is only a cache.

    Attributes
    ----------
    on_charts : bool
        Whether a panorama is shown in three pictures, see panorama.py; it needs `pooling`.
    """

    on_charts: ClassVar[bool]

    @property
    def pooling(self) -> Pooling | None:
        """Width of the eye's pools; None where it plays no part."""
        ...

    def apply(self, picture: Picture, fixation: PictureFixation) -> Picture:
        """Return the picture that is shown: (H, W, 3), float32 in [0, 1]."""
        ...

    def on_gpu(
        self, ctx: moderngl.Context, geometry: Geometry, seed: int | None = None
    ) -> FoveationPass | None:
        """Build the passes that do the same, or None where only numpy does it.

        Noise of `seed` is made before they take their memory, which it needs for a while.
        """
        ...
