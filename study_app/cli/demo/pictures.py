"""The method at work on one real pair of photographs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

METHODS = ("push-pull", "push-pull-depth", "metameric")
SHEET = "before-and-after.png"
WARPED, TRUTH = "warped", "truth"
DETAIL_PX = (112, 150)


@dataclass(frozen=True)
class Photographs:
    """What was made of the pair."""

    renderer: str
    size_px: tuple[int, int]
    """Height and width."""
    hole_share: float
    detail: tuple[int, int]
    """Top and left of the part with the most hole pixels, `DETAIL_PX` large."""
    quality: dict[str, str]
    """By method, in the holes, against the photograph taken there."""

    @classmethod
    def from_notes(cls, notes: Mapping[str, Any]) -> Photographs:
        """Return what `dataclasses.asdict` made notes of, also after a way through JSON."""
        height, width = notes["size_px"]
        top, left = notes["detail"]
        fields = {**notes, "size_px": (height, width), "detail": (top, left)}
        return cls(**fields)


def fill_photographs(out: Path, seed: int) -> Photographs:
    """Warp the motorcycle pair to the other eye, fill the holes, and write every picture.

    Raises
    ------
    GLUnavailableError, OSError
        If there is no OpenGL, or the folder cannot be written.
    """
    from pipeline.gl.context import describe, lent_context
    from stimuli import pictures
    from stimuli.choice import Choice
    from stimuli.exr import save_colour
    from stimuli.one_frame import comparison, warp_and_fill
    from stimuli.scenes.stereo import PAIR_WARP, built_in_pair

    out.mkdir(parents=True, exist_ok=True)
    with lent_context() as ctx:
        renderer = describe(ctx)
        pair = built_in_pair("motorcycle")
        assert pair.right is not None
        warped, fills = warp_and_fill(
            ctx,
            pair.warp_input(),
            [Choice(name) for name in METHODS],
            truth=pair.right,
            seed=seed,
            settings=PAIR_WARP,
        )
    for fill in fills:
        save_colour(out / f"{fill.choice.name}.png", fill.colour)
    pictures.save_picture(out / f"{WARPED}.png", pictures.of_holes(warped.colour, warped.hole))
    save_colour(out / f"{TRUTH}.png", pair.right)
    pictures.save_picture(out / SHEET, comparison(warped, fills, pair.right))
    quality = {
        fill.choice.name: f"PSNR {fill.quality.psnr_db:.2f} dB, SSIM {fill.quality.ssim:.3f}"
        for fill in fills
        if fill.quality is not None
    }
    height, width = warped.size
    return Photographs(
        renderer=str(renderer),
        size_px=(height, width),
        hole_share=float(warped.hole.mean()),
        detail=most_holes(warped.hole, DETAIL_PX),
        quality=quality,
    )


def most_holes(hole: NDArray[np.bool_], size: tuple[int, int]) -> tuple[int, int]:
    """Return top and left of the window of `size` (height, width) with the most hole pixels.

    The picture's own border is left out where it can be: what enters there is no disocclusion.
    """
    height, width = (min(a, b) for a, b in zip(size, hole.shape, strict=True))
    sums = np.pad(hole.astype(np.int64), ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    counts = (
        sums[height:, width:] - sums[:-height, width:] - sums[height:, :-width]
        + sums[:-height, :-width]
    )  # fmt: skip
    border = hole.shape[1] // 10
    if counts.shape[1] > 2 * border:
        counts[:, :border] = counts[:, counts.shape[1] - border :] = -1
    top, left = np.unravel_index(int(counts.argmax()), counts.shape)
    return int(top), int(left)
