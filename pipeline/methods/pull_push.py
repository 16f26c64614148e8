"""`push-pull` and `weighted-pull-push`: known pixels weigh 1, holes 0, depth is not asked."""

from collections.abc import Callable
from functools import partial
from typing import ClassVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import Floats, WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.methods.method import InNumpy
from pipeline.methods.on_gpu import OnGpu
from pipeline.plate.gpu import PlatePass
from pipeline.pushpull.gpu import PushPullPass, PyramidPass, WeightedPullPushPass
from pipeline.pushpull.reference import SAME_SURFACE, push_pull, recirculating, weighted_pull_push


class _ColourOnly(OnGpu[PyramidPass]):
    """A pass over one rgba32f texture (colour, weight)."""

    pass_type: ClassVar[type[PyramidPass]]

    def _build(self, size: tuple[int, int]) -> PyramidPass:
        return self.pass_type(self._ctx, size)

    def _run(self, filler: PyramidPass, frame: FrameTextures, seed: int) -> None:  # noqa: ARG002
        filler(frame.colour, frame.colour)


class PushPull(_ColourOnly):
    """Gortler et al. 1996, the naive rival of the paper; see `pipeline.pushpull`."""

    pass_type = PushPullPass

    def in_numpy(self) -> InNumpy:
        """Return the numpy twin of this method with its parameters."""
        return InNumpy(_by(push_pull))


class WeightedPullPush(_ColourOnly):
    """Pull-push with squared weights, on the GPU; see `pipeline.pushpull`.

    Parameters
    ----------
    recirculate : float
        For clips: how much what a place of the background showed last weighs beside a known pixel,
        from 0 (every frame by itself) to 1; see `recirculating`.
    """

    pass_type = WeightedPullPushPass

    def __init__(self, ctx: moderngl.Context, *, recirculate: float = 0.0) -> None:
        super().__init__(ctx)
        if not 0 <= recirculate <= 1:
            raise InputError(f"recirculate must lie in 0..1 (got {recirculate})")
        self._weight = recirculate
        if recirculate:
            self.new_plate = self._new_plate  # what tells a `PlateMethod`

    def in_numpy(self) -> InNumpy:
        """Return the numpy twin of this method with its parameters."""
        plate = partial(recirculating, self._weight) if self._weight else None
        return InNumpy(_by(weighted_pull_push), plate)

    def _build_plate(self, size: tuple[int, int]) -> PlatePass:
        return PlatePass(self._ctx, size, SAME_SURFACE, weight=self._weight, overwrites=True)


def _by(
    twin: Callable[[NDArray[np.floating]], Floats],
) -> Callable[[WarpedFrame, int], Floats]:
    return lambda warped, _seed: twin(np.dstack([warped.colour, ~warped.hole]))
