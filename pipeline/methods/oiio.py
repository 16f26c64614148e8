"""OpenImageIO's push-pull, `ImageBufAlgo.fillholes_pushpull`."""

import numpy as np
import OpenImageIO as oiio  # noqa: N813  its own documentation calls it so
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame, check_some_known
from pipeline.methods.method import composite


class OiioPushPull:
    """Push-pull as OpenImageIO ships it, on float colour with the holes transparent."""

    def fill(self, warped: WarpedFrame, seed: int) -> NDArray[np.float32]:  # noqa: ARG002
        """Fill the holes; known pixels are untouched."""
        check_some_known(warped.hole)
        alpha = (~warped.hole).astype(np.float32)[..., None]
        source = oiio.ImageBuf(np.concatenate([warped.colour * alpha, alpha], axis=-1))
        filled = oiio.ImageBufAlgo.fillholes_pushpull(source)
        pixels = None if filled.has_error else filled.get_pixels(oiio.FLOAT)
        if pixels is None:
            raise InputError(f"OpenImageIO's push-pull failed: {filled.geterror()}")
        return composite(warped, pixels[..., :3])

    def release(self) -> None:
        """Hold nothing."""
