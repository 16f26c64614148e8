"""`push-pull` and `weighted-pull-push`: known pixels weigh 1, holes 0, depth is not asked."""

from typing import ClassVar

from pipeline.frame_textures import FrameTextures
from pipeline.methods.on_gpu import OnGpu
from pipeline.pushpull.gpu import PushPullPass, PyramidPass
from pipeline.weighted_pullpush.gpu import WeightedPullPushPass


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


class WeightedPullPush(_ColourOnly):
    """Pull-push with squared weights, on the GPU; see `pipeline.weighted_pullpush`."""

    pass_type = WeightedPullPushPass
