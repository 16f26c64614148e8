"""Arrays as pictures that a person can judge: depth, motion, bands, and labelled sheets.

A picture is uint8 of shape (H, W, 3).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import NamedTuple, TypeAlias, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from pipeline.frame import Bools, Floats
from pipeline.inpaint.reference import nearest_depth_m
from pipeline.pictures.write import write_pixels

S = TypeVar("S", bound=np.generic)
Picture: TypeAlias = NDArray[np.uint8]
HOLE_COLOUR = (255, 0, 255)  # photographs hold no magenta
CROP_SHARE = 1 / 6
"""Width of a crop that is looked for, in widths of the picture; 4 to 3."""
_FAR = 2.0  # crops' widths, below which another crop shows much the same place
_BACKGROUND = (24, 24, 24)
_TEXT = (240, 240, 240)
_MARGIN_PX = 12
_TEXT_PX = 18
_LEAST_TILE_PX = 320  # narrower pictures are enlarged on a sheet, so that labels fit


def of_colour(colour: NDArray[np.floating]) -> Picture:
    """Encoded R'G'B' in [0, 1]."""
    picture: Picture = np.rint(255 * np.clip(colour, 0, 1)).astype(np.uint8)
    return picture


def of_mask(mask: Bools) -> Picture:
    """White where true."""
    return _grey(mask.astype(np.float64))


def of_holes(colour: NDArray[np.floating], hole: Bools) -> Picture:
    """Colour with the holes in `HOLE_COLOUR`."""
    picture = of_colour(colour)
    picture[hole] = HOLE_COLOUR
    return picture


def of_depth(depth_m: NDArray[np.floating], near_m: float | None = None) -> Picture:
    """Near is bright, and equal steps of grey are equal steps of parallax; inf is black.

    `near_m` is white; by default the nearest depth. Two depths are comparable with the same.
    """
    near_m = nearest_depth_m(depth_m) if near_m is None else near_m
    return _grey(np.clip(near_m / depth_m, 0, 1))


def of_flow(flow_px: NDArray[np.floating], longest_px: float | None = None) -> Picture:
    """Hue is the direction (red right, then green-yellow down, cyan left), brightness the length.

    `longest_px` is full brightness; by default the longest motion.
    """
    length = np.linalg.norm(flow_px, axis=-1)
    longest_px = float(length.max()) if longest_px is None else longest_px
    hue = np.mod(np.arctan2(flow_px[..., 1], flow_px[..., 0]) / (2 * np.pi), 1.0)
    value = np.clip(length / longest_px, 0, 1) if longest_px > 0 else np.zeros_like(length)
    hsv = np.stack([hue, np.ones_like(hue), value], axis=-1)
    bytes_hsv = np.rint(255 * hsv).astype(np.uint8)
    return np.asarray(Image.fromarray(bytes_hsv, mode="HSV").convert("RGB"))


def of_signed(values: NDArray[np.floating], largest: float | None = None) -> Picture:
    """Zero is mid grey, `largest` white and its negative black.

    By default the 99.5th percentile of the absolute values: single spikes do not hide the rest.
    """
    if largest is None:
        largest = float(np.percentile(np.abs(values), 99.5))
    return _grey(0.5 + 0.5 * np.clip(values / largest, -1, 1) if largest > 0 else 0 * values + 0.5)


def of_magnitude(values: NDArray[np.floating], largest: float | None = None) -> Picture:
    """Zero is black, `largest` white; by default the 99.5th percentile."""
    if largest is None:
        largest = float(np.percentile(values, 99.5))
    return _grey(np.clip(values / largest, 0, 1) if largest > 0 else 0 * values)


def fitted(picture: Picture, size: tuple[int, int]) -> Picture:
    """Scale into `size` (height, width) with the same aspect, on the sheet's background.

    Enlarged by repeating pixels, shrunk by averaging.
    """
    scale = min(size[0] / picture.shape[0], size[1] / picture.shape[1])
    height, width = (max(1, round(scale * edge)) for edge in picture.shape[:2])
    method = Image.Resampling.NEAREST if scale > 1 else Image.Resampling.BOX
    canvas = Image.new("RGB", (size[1], size[0]), _BACKGROUND)
    canvas.paste(Image.fromarray(picture).resize((width, height), method), (0, 0))
    return np.asarray(canvas)


def sheet(pictures: Sequence[tuple[str, Picture]], columns: int | None = None) -> Picture:
    """Lay out labelled pictures in rows; each label stands under its picture.

    Parameters
    ----------
    pictures : sequence of (label, picture)
        At least one; a label may have several lines.
    columns : int, optional
        By default about as many columns as rows.
    """
    columns = columns or math.ceil(math.sqrt(len(pictures)))
    columns = min(columns, len(pictures))
    factor = max(1, math.ceil(_LEAST_TILE_PX / max(p.shape[1] for _, p in pictures)))
    tiles = [(label, np.repeat(np.repeat(p, factor, 0), factor, 1)) for label, p in pictures]
    width = max(tile.shape[1] for _, tile in tiles)
    font_px = max(_TEXT_PX, width // 36)
    font = ImageFont.load_default(size=font_px)
    wrapped = [_wrap(label, font, width) for label, _ in tiles]
    line_px = math.ceil(1.3 * font_px)
    label_px = line_px * max(label.count("\n") + 1 for label in wrapped) + _MARGIN_PX
    height = max(tile.shape[0] for _, tile in tiles)
    rows = math.ceil(len(tiles) / columns)
    canvas = Image.new(
        "RGB",
        (
            columns * (width + _MARGIN_PX) + _MARGIN_PX,
            rows * (height + label_px + _MARGIN_PX) + _MARGIN_PX,
        ),
        _BACKGROUND,
    )
    draw = ImageDraw.Draw(canvas)
    for index, (label, (_, tile)) in enumerate(zip(wrapped, tiles, strict=True)):
        row, column = divmod(index, columns)
        x = _MARGIN_PX + column * (width + _MARGIN_PX)
        y = _MARGIN_PX + row * (height + label_px + _MARGIN_PX)
        canvas.paste(Image.fromarray(tile), (x, y))
        draw.multiline_text(
            (x, y + height + _MARGIN_PX // 2), label, fill=_TEXT, font=font, spacing=4
        )
    return np.asarray(canvas)


def save_picture(path: Path, picture: Picture) -> None:
    """Write a picture whole or not at all."""
    write_pixels(path, picture, ("R", "G", "B"))


def _grey(values: NDArray[np.floating]) -> Picture:
    return np.repeat(np.rint(255 * values).astype(np.uint8)[..., None], 3, axis=-1)


def _wrap(label: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont, width: int) -> str:
    lines: list[str] = []
    for given in label.split("\n"):
        line = ""
        for word in given.split(" "):
            longer = f"{line} {word}".strip()
            if line and font.getlength(longer) > width:
                lines.append(line)
                longer = word
            line = longer
        lines.append(line)
    return "\n".join(lines)


class Crop(NamedTuple):
    """A part of a picture, in pixels from its upper left corner."""

    x: int
    y: int
    width: int
    height: int

    def of(self, picture: NDArray[S]) -> NDArray[S]:
        """Return the part of a picture."""
        return picture[self.y : self.y + self.height, self.x : self.x + self.width]


def mean_difference(pictures: Sequence[Picture]) -> Floats:
    """Return the distance of pictures, shape (H, W): the mean over pairs, of encoded levels."""
    pairs = list(combinations([picture.astype(np.float64) for picture in pictures], 2))
    if not pairs:
        return np.zeros(pictures[0].shape[:2])
    total: Floats = np.mean([np.abs(a - b).mean(axis=2) for a, b in pairs], axis=0)
    return total


def auto_crops(apart: NDArray[np.floating], count: int) -> tuple[Crop, ...]:
    """Return the parts in whose middle a picture of differences is largest; none overlap.

    Each further one shows another place: what lies near those found counts less. Fewer than
    `count` where no more fit.
    """
    height, width = apart.shape
    across = max(4, round(CROP_SHARE * width))
    down = max(4, min(height, round(0.75 * across)))
    rows, columns = (np.hanning(edge + 2)[1:-1] for edge in (down, across))
    worth = cv2.sepFilter2D(
        np.ascontiguousarray(apart, np.float64), cv2.CV_64F, columns, rows, anchor=(0, 0)
    )[: height - down + 1, : width - across + 1].round(6)
    y, x = np.mgrid[: worth.shape[0], : worth.shape[1]]
    found: list[Crop] = []
    while len(found) < count and worth.size and worth.max() > -np.inf:
        top, left = (int(k) for k in np.unravel_index(int(worth.argmax()), worth.shape))
        found.append(Crop(left, top, across, down))
        squared = ((y - top) ** 2 + (x - left) ** 2) / (_FAR * across) ** 2
        overlaps = (abs(y - top) < down) & (abs(x - left) < across)
        worth = np.where(overlaps, -np.inf, worth * (1 - np.exp(-squared / 2)))
    return tuple(found)
