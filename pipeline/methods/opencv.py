"""Fills of other libraries: OpenCV's two, which most users reach for, and OpenImageIO's."""

import cv2
import numpy as np
import OpenImageIO as oiio  # noqa: N813  its own documentation calls it so
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame, check_some_known
from pipeline.methods.method import composite

_MAX_RADIUS_PX = 100.0


class _Inpaint:
    """cv2.inpaint on 8-bit colour: it takes no floats of three channels."""

    _flag: int

    def __init__(self, *, radius_px: float = 3.0) -> None:
        if not 1.0 <= radius_px <= _MAX_RADIUS_PX:
            raise InputError(f"radius_px must lie in 1..{_MAX_RADIUS_PX:g} (got {radius_px})")
        self.radius_px = radius_px

    def fill(self, warped: WarpedFrame, seed: int) -> NDArray[np.float32]:  # noqa: ARG002
        """Fill the holes; the fill is quantised to 8 bits, all else is untouched."""
        check_some_known(warped.hole)
        # Hole colours are meaningless, and cv2 reads them at the border: make them constant.
        known = np.where(warped.hole[..., None], np.float32(0), warped.colour)
        bytes_in = np.rint(known * 255).astype(np.uint8)
        mask = warped.hole.astype(np.uint8)
        for axis, edge_px in enumerate(warped.size):
            if edge_px == 1:  # cv2 would read memory beside the picture
                bytes_in, mask = (np.repeat(plane, 2, axis) for plane in (bytes_in, mask))
        filled = cv2.inpaint(bytes_in, mask, self.radius_px, self._flag)
        filled = filled[: warped.size[0], : warped.size[1]]
        return composite(warped, filled.astype(np.float32) / np.float32(255))

    def release(self) -> None:
        """Hold nothing."""


class Telea(_Inpaint):
    """Telea 2004, "An image inpainting technique based on the fast marching method".

    Parameters
    ----------
    radius_px : float
        Neighbourhood of each filled pixel.
    """

    _flag = cv2.INPAINT_TELEA


class NavierStokes(_Inpaint):
    """Bertalmio, Bertozzi and Sapiro 2001, "Navier-Stokes, fluid dynamics, and inpainting".

    Parameters
    ----------
    radius_px : float
        Neighbourhood of each filled pixel.
    """

    _flag = cv2.INPAINT_NS


class OiioPushPull:
    """OpenImageIO's `ImageBufAlgo.fillholes_pushpull`, on float colour with transparent holes."""

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
