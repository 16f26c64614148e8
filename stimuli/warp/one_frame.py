"""One frame from end to end: warp it, fill its holes by any methods, measure the fills."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.frame import WarpedFrame, check_seed
from pipeline.methods.registry import fill
from pipeline.named_classes import Choice
from pipeline.pictures import drawing
from pipeline.pictures.warp_input import WarpInput
from pipeline.quality import SSIM_LEAST_PX, KnownTruth, Quality, evaluate, interior
from pipeline.warp.gpu import warp_frame
from pipeline.warp.settings import WarpSettings


@dataclass(frozen=True)
class FillResult:
    """One fill, and its quality where the truth is known.

    `quality` is that of the holes that do not touch the frame's border, or of what a mask
    selects; `quality_all` that of all holes, or of the same mask.
    """

    choice: Choice
    colour: NDArray[np.float32]
    quality: Quality | None
    quality_all: Quality | None


def warp_and_fill(
    ctx: moderngl.Context | None,
    frame: WarpInput,
    choices: Sequence[Choice],
    *,
    seed: int = 0,
    settings: WarpSettings | None = None,
    truth: NDArray[np.float32] | None = None,
    truth_mask: NDArray[np.bool_] | None = None,
    hole: NDArray[np.bool_] | None = None,
) -> tuple[WarpedFrame, list[FillResult]]:
    """Warp `frame` once and fill it by every method of `choices`.

    Parameters
    ----------
    ctx : moderngl.Context or None
        Where it is drawn; None: numpy works.
    hole : ndarray of bool, shape (H, W), optional
        Further holes, in the new view.
    truth : ndarray of float32, shape (H, W, 3), optional
        What the target view shows: fills are measured against it.
    truth_mask : ndarray of bool, shape (H, W), optional
        Where to measure; by default in interior holes, and in all.

    Raises
    ------
    InputError
        If the input breaks a rule, everything is a hole, or a method cannot be made.
    """
    seed = check_seed(seed)
    warped = warp_frame(
        frame.source,
        frame.flow_px,
        target_depth_m=frame.target_depth_m,
        window=frame.window,
        settings=settings or WarpSettings(),
        ctx=ctx,
    )
    if hole is not None:
        warped = replace(warped, hole=warped.hole | hole)
    everywhere = warped.hole if truth_mask is None else warped.hole & truth_mask
    inside = interior(warped.hole) if truth_mask is None else everywhere
    same = np.array_equal(inside, everywhere)
    view = None if truth is None else KnownTruth(truth)
    results = []
    for choice in choices:
        colour = fill(warped, choice.name, seed=seed, ctx=ctx, **choice.parameters)
        quality_all = _measure(colour, view, everywhere)
        quality = quality_all if same else _measure(colour, view, inside)
        results.append(FillResult(choice, colour, quality, quality_all))
    return warped, results


def _measure(
    colour: NDArray[np.float32], truth: KnownTruth | None, mask: NDArray[np.bool_]
) -> Quality | None:
    if truth is None or not mask.any() or min(mask.shape) < SSIM_LEAST_PX:
        return None
    return evaluate(colour, truth, mask)


def comparison(
    warped: WarpedFrame, fills: Sequence[FillResult], truth: NDArray[np.float32] | None = None
) -> drawing.Picture:
    """Labelled sheet of 8-bit pictures: the holes, the truth if known, each fill, its quality."""
    tiles = [("warped, holes marked", drawing.of_holes(warped.colour, warped.hole))]
    if truth is not None:
        tiles.append(("truth", drawing.of_colour(truth)))
    tiles += [
        (one.choice.label + quality_words(one), drawing.of_colour(one.colour)) for one in fills
    ]
    return drawing.sheet(tiles)


def quality_words(fill: FillResult) -> str:
    """A line for a label; empty where nothing was measured."""
    quality = fill.quality or fill.quality_all
    if quality is None:
        return ""
    return (
        f"\nPSNR {quality.psnr_db:.2f} dB, SSIM {quality.ssim:.3f},"
        f" band error {quality.band_error:.3f}"
    )
