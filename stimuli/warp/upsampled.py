"""Warped fills with the true view around the gaze, side by side ([MI] Fig. 12).

A foveated display shows new frames where one looks, and may fill up what lies around by warping
older ones. The sheet shows what such a display would show, by each method.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from pipeline.foveation.two_rates import AS_IT_IS, TwoRates
from pipeline.frame import WarpedFrame
from pipeline.pictures import drawing
from pipeline.pictures.drawing import Crop, auto_crops, mean_difference
from stimuli.warp.one_frame import FillResult, quality_words

CROPS = 3
"""One of the fovea, and so many less one of the periphery."""
GAP_PX = 4
DOT_SHARE = 1 / 60
"""Width of the dot, in widths of the picture."""
DOT = (255, 220, 0)
FRAMES = ((255, 220, 0), (0, 200, 255), (255, 90, 200))
"""Colours of the crop of the fovea, then of the periphery's."""


def periphery(rates: TwoRates) -> NDArray[np.bool_]:
    """True where nothing of the true view is mixed in, (H, W)."""
    return np.asarray(rates.share[..., 0] == 0)


def upsampled(
    fills: Sequence[FillResult], truth: NDArray[np.float32], rates: TwoRates
) -> list[FillResult]:
    """Put the true view around the gaze into every fill, and show the rest as `rates` says."""
    return [replace(one, colour=rates.shown(one.colour, truth)) for one in fills]


def upsampled_sheet(
    warped: WarpedFrame, fills: Sequence[FillResult], truth: NDArray[np.float32], rates: TwoRates
) -> drawing.Picture:
    """Lay out what a foveated display shows by each method, beside the true view.

    Beside each picture stand, enlarged, its fovea and the parts of its periphery where fills differ
    most from each other and from the truth. A yellow dot marks the gaze.

    Parameters
    ----------
    fills : sequence of FillResult
        As `upsampled` returns them.
    """
    shown = [drawing.of_colour(truth), *(drawing.of_colour(one.colour) for one in fills)]
    crops = crops_of(shown, periphery(rates), rates.gaze_px)
    share = rates.share
    holes = drawing.of_holes(warped.colour, warped.hole & (share[..., 0] < 1))
    setup = np.where(share == 1, shown[0], holes).astype(np.uint8)
    looks = [f"{rates.coarser} x coarser"] * (rates.coarser > 1)
    looks += [rates.condition] * (rates.condition != AS_IT_IS)
    labels = [
        f"true view within {rates.within_deg:g} degrees; around it warped, holes marked"
        + f"\nfills are measured, then shown: {', '.join(looks)}" * bool(looks),
        "true view",
        *(one.choice.label + quality_words(one) for one in fills),
    ]
    tiles = [_tile(one, crops, rates.gaze_px) for one in [setup, *shown]]
    return drawing.sheet(list(zip(labels, tiles, strict=True)), columns=2)


def crops_of(
    shown: Sequence[drawing.Picture], away: NDArray[np.bool_], gaze_px: tuple[float, float]
) -> list[Crop]:
    """Crops to show: the gaze, then where pictures differ most among what is `away` from it."""
    found = auto_crops(mean_difference(shown) * away, CROPS - 1)
    height, width = away.shape
    across, down = found[0].width, found[0].height
    x, y = (
        int(np.clip(round(at - edge / 2), 0, whole - edge))
        for at, edge, whole in zip(gaze_px, (across, down), (width, height), strict=True)
    )
    return [Crop(x, y, across, down), *found]


def _tile(
    picture: drawing.Picture, crops: Sequence[Crop], gaze_px: tuple[float, float]
) -> drawing.Picture:
    """The picture with dot and frames; on its right the crops, enlarged, below one another."""
    height, width = picture.shape[:2]
    high = (height - GAP_PX * (CROPS - 1)) // CROPS
    wide = round(high * crops[0].width / crops[0].height)
    canvas = Image.new("RGB", (width + GAP_PX + wide, height))
    canvas.paste(Image.fromarray(picture), (0, 0))
    draw = ImageDraw.Draw(canvas)
    line = max(1, width // 400)
    for number, crop in enumerate(crops):
        top = number * (high + GAP_PX)
        enlarged = Image.fromarray(crop.of(picture)).resize((wide, high), Image.Resampling.NEAREST)
        canvas.paste(enlarged, (width + GAP_PX, top))
        boxes = (
            (crop.x, crop.y, crop.width, crop.height),
            (width + GAP_PX, top, wide, high),
        )
        for x, y, across, down in boxes:
            draw.rectangle((x, y, x + across - 1, y + down - 1), None, FRAMES[number], line)
    radius = max(2.0, DOT_SHARE * width / 2)
    x, y = gaze_px
    draw.ellipse((x - radius, y - radius, x + radius, y + radius), DOT, (0, 0, 0), line)
    return np.asarray(canvas)
