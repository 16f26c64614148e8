"""`push-pull` and `weighted-pull-push`: known pixels weigh 1, holes 0, depth is not asked."""

from typing import ClassVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.frame import WarpedFrame, check_some_known
from pipeline.gl.texture import create_texture, read_back, upload
from pipeline.methods.method import composite
from pipeline.pushpull.gpu import PushPullPass, PyramidPass
from pipeline.weighted_pullpush.gpu import WeightedPullPushPass


class _ColourOnly:
    """A pass over one rgba32f texture (colour, weight), kept for the last frame size."""

    pass_type: ClassVar[type[PyramidPass]]

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._pass: PyramidPass | None = None
        self._image: moderngl.Texture | None = None

    def fill(self, warped: WarpedFrame, seed: int) -> NDArray[np.float32]:  # noqa: ARG002
        """Fill the holes; known pixels are untouched."""
        check_some_known(warped.hole)
        weight = (~warped.hole).astype(np.float32)[..., None]
        filler, image = self._prepared(warped.size)
        upload(image, np.concatenate([warped.colour * weight, weight], axis=-1))
        filler(image, image)
        return composite(warped, read_back(image)[..., :3])

    def release(self) -> None:
        """Free textures and shaders."""
        if self._pass is not None and self._image is not None:
            self._pass.release()
            self._image.release()
        self._pass = self._image = None

    def _prepared(self, size: tuple[int, int]) -> tuple[PyramidPass, moderngl.Texture]:
        wanted = size[1], size[0]
        if self._pass is None or self._image is None or self._pass.size != wanted:
            self.release()
            self._pass = self.pass_type(self._ctx, wanted)
            self._image = create_texture(self._ctx, wanted, "rgba32f")
        return self._pass, self._image


class PushPull(_ColourOnly):
    """Gortler et al. 1996, the naive rival of the paper; see `pipeline.pushpull`."""

    pass_type = PushPullPass


class WeightedPullPush(_ColourOnly):
    """Pull-push with squared weights, on the GPU; see `pipeline.weighted_pullpush`."""

    pass_type = WeightedPullPushPass
