"""A display of two rates: the true view around the gaze, and an older frame's fill beyond it.

Such a display draws what is looked at for every refresh, and fills up the rest from frames that it
drew before ([MI] Fig. 12). It may draw that periphery coarser, and changed as an eye hardly sees:
averaged to blocks, then shown by a condition of `conditions.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.geometry import Flat, FlatGeometry, share_around
from pipeline.named_classes import NamedClass

if TYPE_CHECKING:
    import moderngl

Colour = NDArray[np.float32]
AS_IT_IS = "reference"
FOVEATOR = NamedClass("foveator", "a condition", "pipeline.foveation.conditions:Foveator")
"""By name: clips are hashed with all that this module imports, and few have a condition."""


class TwoRates:
    """The true view within an angle of the gaze, and what is shown beyond it.

    Parameters
    ----------
    geometry : FlatGeometry
        Of the frames.
    gaze_px : (x, y)
        On them.
    within_deg : float
        Radius of the true view; over the next degree it gives way.
    coarser : int
        Edge of the periphery's blocks in pixels.
    condition : str
        One of `condition_names`, for the periphery. Its noise lies on the screen, of `seed`.
    parameters : mapping, optional
        Of the condition.
    ctx : moderngl.Context, optional
        Where the condition works; None: in numpy.

    Attributes
    ----------
    share : ndarray of float32, shape (H, W, 1)
        Share of the true view in each pixel: 1 within the angle, 0 beyond the fade.

    Raises
    ------
    InputError
        If the gaze lies off the frames, a number is out of range, or there is no such condition.
    """

    def __init__(
        self,
        geometry: FlatGeometry,
        gaze_px: tuple[float, float],
        within_deg: float,
        *,
        coarser: int = 1,
        condition: str = AS_IT_IS,
        parameters: Mapping[str, Any] | None = None,
        seed: int = 0,
        ctx: moderngl.Context | None = None,
    ) -> None:
        (x, y), width, height = gaze_px, geometry.width_px, geometry.height_px
        if not (0 <= x < width and 0 <= y < height):
            raise InputError(
                f"the gaze must lie on the picture to show the true view around it: x from 0 to"
                f" {width}, y from 0 to {height} px (got {x:g}, {y:g})"
            )
        if not 0 < within_deg < 90:
            raise InputError(
                "the radius of the true view must lie between 0 and 90 degrees"
                f" (got {within_deg:g})"
            )
        if coarser < 1:
            raise InputError(f"blocks must be at least 1 px wide (got {coarser})")
        self.gaze_px, self.within_deg, self.coarser = gaze_px, within_deg, coarser
        self.condition, self._seed, self._foveator = condition, seed, None
        self.share = share_around(geometry, gaze_px, within_deg)[..., None]
        if condition != AS_IT_IS:
            viewing = Flat(distance_px=geometry.distance_px, centre_px=geometry.centre_px)
            self._foveator = FOVEATOR.load()(
                (height, width), viewing=viewing, method=condition, seed=seed, ctx=ctx,
                **(parameters or {}),
            )  # fmt: skip

    def shown(self, made: Colour, truth: Colour, frame: int = 0) -> Colour:
        """Mix a frame with the true one; where the share is 0 or 1, bit for bit one of them."""
        around = coarsened(made, self.coarser)
        if self._foveator is not None:
            inside = around.clip(0, 1)
            around = self._foveator(inside, self.gaze_px, seed=self._seed, frame=frame)
        mixed = around + self.share * (truth - around)
        return np.where(self.share == 1, truth, np.where(self.share == 0, around, mixed))

    def release(self) -> None:
        """Free what is held on the GPU."""
        if self._foveator is not None:
            self._foveator.release()


def coarsened(picture: Colour, factor: int) -> Colour:
    """Average a picture to blocks of `factor` pixels an edge, and interpolate between these.

    Pixels of the right and the lower border go on where a block reaches beyond.
    """
    if factor == 1:
        return picture
    height, width = picture.shape[:2]
    padded = np.pad(picture, ((0, -height % factor), (0, -width % factor), (0, 0)), "edge")
    rows, columns = (edge // factor for edge in padded.shape[:2])
    blocks = padded.reshape(rows, factor, columns, factor, 3).mean(axis=(1, 3))
    enlarged = cv2.resize(blocks, padded.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(enlarged, np.float32)[:height, :width]
