"""A clip or picture and its reference: frames from files, one at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.pictures.colour_file import load_colour
from pipeline.pictures.header import check_fits
from stimuli.media.png import decode_in_unit
from stimuli.score.metrics import HOLES

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class ScoredPair:
    """Pair of clips that one job measures; small, since it is sent to other processes.

    Attributes
    ----------
    name : str
        The clip's name, as messages say it.
    test, truth : tuple of Path
        The frames, in order.
    masks : tuple of Path
        A hole mask per frame (white is hole), or one for all; empty where there is none.
    fps : float
        0 for a picture.
    """

    name: str
    test: tuple[Path, ...]
    truth: tuple[Path, ...]
    masks: tuple[Path, ...]
    width_px: int
    height_px: int
    fps: float

    @property
    def frames(self) -> int:
        """Number of frames; a picture has 1."""
        return len(self.test)

    @property
    def is_picture(self) -> bool:
        """True if it has no time."""
        return self.fps == 0

    @property
    def regions(self) -> tuple[str, ...]:
        """Regions where it can be measured."""
        return (HOLES, "frame") if self.masks else ("frame",)

    @property
    def holeless(self) -> bool:
        """True if there are masks, and none has a hole."""
        return bool(self.masks) and not any(self.mask(k).any() for k in range(self.frames))

    def truth_frame(self, index: int) -> Image:
        """Read the reference: encoded colour in [0, 1], shape (H, W, 3)."""
        return read_colour(self.truth[index])

    def mask(self, index: int) -> Mask:
        """Read where the holes are; everywhere, where nothing is said."""
        if not self.masks:
            return np.ones((self.height_px, self.width_px), np.bool_)
        return read_hole_mask(
            self.masks[index if len(self.masks) > 1 else 0], (self.height_px, self.width_px)
        )

    def test_frame(self, index: int, region: str) -> Image:
        """Read the clip; for `holes`, every other pixel is set to the reference ([MI] 4)."""
        colour = read_colour(self.test[index])
        if region != HOLES:
            return colour
        return np.where(self.mask(index)[..., None], colour, self.truth_frame(index))

    def walk(self) -> Iterator[tuple[int, Image, Image, Mask]]:
        """Yield index, clip, reference and mask of every frame, each read once."""
        for index in range(self.frames):
            yield (
                index,
                read_colour(self.test[index]),
                self.truth_frame(index),
                self.mask(index),
            )


def composed_region(test: Image, truth: Image, mask: Mask, region: str) -> Image:
    """Return the picture that is measured in `region`."""
    return np.where(mask[..., None], test, truth) if region == HOLES else test


def read_colour(path: Path) -> Image:
    """Read a frame or picture as encoded colour in [0, 1], shape (H, W, 3).

    Raises
    ------
    InputError
        If it is not a whole, opaque picture in colour or grey.
    """
    check_fits(path, "score")
    if path.suffix.lower() == ".png" and path.is_file():
        colour = decode_in_unit(path)
        if colour.ndim == 3 and colour.shape[2] == 3:
            return colour
    return load_colour(path)


def read_hole_mask(path: Path, size: tuple[int, int]) -> Mask:
    """Read a mask, white where there is a hole, at `size` (height, width).

    A mask of another size (clips that were rescaled) is brought to `size`: a pixel is a hole
    where any part of it is.

    Raises
    ------
    InputError
        If it has colours, grey in the place of white, or other proportions.
    """
    colour = read_colour(path)
    if (colour != colour[..., :1]).any():
        raise InputError(f"{path}: a mask must be black and white (it has colours)")
    hole = colour[..., 0] >= 0.5
    if colour.any() and not hole.any():
        raise InputError(
            f"{path}: a mask must be white in holes (its brightest pixel has"
            f" {colour.max() * 100:.2g} % of white)"
        )
    if hole.shape == size:
        return np.asarray(hole)
    across, down = size[1] / hole.shape[1], size[0] / hole.shape[0]
    if abs(across / down - 1) > 0.02:
        raise InputError(
            f"{path}: a mask must have the frame's proportions, {size[1]} x {size[0]} px"
            f" (got {hole.shape[1]} x {hole.shape[0]} px)"
        )
    share = cv2.resize(hole.astype(np.float32), (size[1], size[0]), interpolation=cv2.INTER_AREA)
    return np.asarray(share > 0)
