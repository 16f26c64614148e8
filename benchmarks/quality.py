"""Quality of fills and silhouettes on stereo pairs: `python -m benchmarks.quality --help`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import astuple, replace
from pathlib import Path

import moderngl
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.shared.output import PagePart
from pipeline.frame import WarpedFrame
from pipeline.gl.context import create_context, release_context
from pipeline.methods.registry import METHODS
from pipeline.named_classes import Choice
from pipeline.quality import Quality, interior
from pipeline.warp.gpu import warp_frame
from stimuli.scenes.stereo import PAIR_WARP, StereoPair, built_in_pair, load_pair
from stimuli.score.fovvideovdp import open_fvvdp
from stimuli.score.viewing_conditions import standard_fhd
from stimuli.warp.one_frame import warp_and_fill

# Pairs of the Middlebury benchmark, where a folder of them is given: no licence lets us ship them.
PAIRS = {
    "teddy": ("middlebury2003_teddy", "im2.png", "disp2.pgm", "im6.png", 4.0),
    "aloe": ("middlebury2006_aloe", "aloeL.jpg", "aloeGT.png", "aloeR.jpg", 1.0),
    "tsukuba": ("middlebury2001_tsukuba", "imL.png", "groundtruth.png", "imR.png", 16.0),
}
PART = PagePart("quality table")
HEAD = "| method | PSNR dB | SSIM | high-frequency ratio | band error |\n"
RULE = "| --- | ---: | ---: | ---: | ---: |"
CELLS = "{0.psnr_db:.2f} | {0.ssim:.3f} | {0.high_frequency_ratio:.2f} | {0.band_error:.3f} |"
SEEN = 40 / 255  # a difference of a channel that counts as wrong
BESIDE_PX, APART_PX = 4, 12


def warped_pair(ctx: moderngl.Context, pair: StereoPair, *, mended: bool = True) -> WarpedFrame:
    """The left photograph as the right one's camera sees it, without its rim."""
    frame = pair.warp_input()
    settings = replace(PAIR_WARP, depth_speckle=mended)
    return warp_frame(frame.source, frame.flow_px, settings=settings, ctx=ctx)


def wrong_known(warped: WarpedFrame, truth: NDArray[np.float32]) -> tuple[float, float, float]:
    """Return the share of known pixels that are wrong: within 4 px of holes, beyond 12 px, in all.

    Holes of less than 2 x 2 px do not count as holes.
    """
    wrong = abs(warped.colour - truth).max(axis=-1) > SEEN
    holes = ndimage.binary_opening(warped.hole, np.ones((2, 2)))
    far = ndimage.distance_transform_cdt(~holes, "chessboard")
    known = ~warped.hole
    places = (known & (far <= BESIDE_PX), known & (far > APART_PX), known)
    beside, apart, everywhere = (float(wrong[place].mean()) for place in places)
    return beside, apart, everywhere


def silhouettes(ctx: moderngl.Context, folder: Path | None) -> str:
    """Render as Markdown: one row per pair, in %, with depth as measured and as mended."""
    lines = [
        "| wrong known pixels, % | near holes | mended | elsewhere | mended | all | mended |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for name, pair in pairs(folder):
        if pair.right is not None:
            bare, mended = (
                wrong_known(warped_pair(ctx, pair, mended=is_mended), pair.right)
                for is_mended in (False, True)
            )
            shares = (f"{100 * a:.2f} | {100 * b:.2f}" for a, b in zip(bare, mended, strict=True))
            lines.append(f"| {name} | {' | '.join(shares)} |")
    return "\n".join(lines)


def jods(ctx: moderngl.Context, folder: Path | None, choices: list[Choice]) -> str:
    """Render as Markdown: FovVideoVDP's JOD in interior holes, a row per pair, as a still."""
    metric = open_fvvdp(standard_fhd(), None, foveated=False)
    labels = " | ".join(choice.label for choice in choices)
    lines = [f"| JOD | {labels} |", "| --- |" + " ---: |" * len(choices)]
    for name, pair in pairs(folder):
        truth = np.asarray(pair.right)  # every pair here has one
        warped, fills = warp_and_fill(ctx, pair.warp_input(), choices, settings=PAIR_WARP)
        shown = (np.where(interior(warped.hole)[..., None], fill.colour, truth) for fill in fills)
        found = (float(metric.predict(one, truth, dim_order="HWC")[0]) for one in shown)
        lines.append(f"| {name} | {' | '.join(f'{jod:.2f}' for jod in found)} |")
    return "\n".join(lines)


def measure(
    ctx: moderngl.Context, pair: StereoPair, choices: list[Choice]
) -> tuple[float, dict[str, Quality]]:
    """Return the share of interior holes, and each method's quality inside them."""
    mask = interior(warped_pair(ctx, pair).hole)
    _, fills = warp_and_fill(
        ctx, pair.warp_input(), choices, truth=pair.right, truth_mask=mask, settings=PAIR_WARP
    )
    found = {fill.choice.label: fill.quality for fill in fills if fill.quality is not None}
    return float(mask.mean()), found


def pairs(folder: Path | None) -> Iterator[tuple[str, StereoPair]]:
    """The built-in pair, and those of `PAIRS` that `folder` holds."""
    yield "motorcycle", built_in_pair("motorcycle")
    for name, (place, left, disparity, right, units_per_px) in PAIRS.items():
        if folder is not None and (folder / place).is_dir():
            files = (folder / place / left, folder / place / disparity, folder / place / right)
            yield name, load_pair(*files, units_per_px=units_per_px)


def table(results: dict[str, tuple[float, dict[str, Quality]]]) -> str:
    """Render as Markdown: one row per pair and method."""
    lines = [f"| pair (interior holes) {HEAD}| --- {RULE}"]
    for pair, (share, fills) in results.items():
        for method, quality in fills.items():
            lines.append(f"| {pair} ({100 * share:.1f} %) | {method} | {CELLS.format(quality)}")
    return "\n".join(lines)


def means(results: dict[str, tuple[float, dict[str, Quality]]]) -> str:
    """Render as Markdown: one row per method, its measures averaged over the pairs."""
    lines = [HEAD + RULE]
    fills = [fill for _, fill in results.values()]
    for method in fills[0]:
        columns = zip(*(astuple(fill[method]) for fill in fills), strict=True)
        mean = Quality(*(sum(column) / len(column) for column in columns))
        lines.append(f"| `{method}` | {CELLS.format(mean)}")
    return "\n".join(lines)


def main(argv: list[str]) -> int:
    """Measure and print, and replace a document's table if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=Path, help="folder of further pairs (Middlebury)")
    names = [entry.name for entry in METHODS if not entry.takes_path]
    parser.add_argument("--methods", nargs="+", choices=names, default=names)
    parser.add_argument("--jod", action="store_true", help="FovVideoVDP too; needs pyfvvdp")
    parser.add_argument("--docs", type=PART.page, help="document whose table of means is replaced")
    arguments = parser.parse_args(argv)
    choices = [Choice(name) for name in arguments.methods]
    ctx = create_context()
    try:
        print(silhouettes(ctx, arguments.pairs))
        if arguments.jod:
            print(jods(ctx, arguments.pairs, choices))
        results = {name: measure(ctx, pair, choices) for name, pair in pairs(arguments.pairs)}
    finally:
        release_context(ctx)
    print(table(results))
    if arguments.docs is not None:
        PART.replace(arguments.docs, means(results))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
