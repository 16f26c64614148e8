"""Quality of fills and silhouettes on stereo pairs: `python -m benchmarks.quality --help`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import asdict, astuple, replace
from pathlib import Path

import moderngl
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.shared.output import PagePart, file_to_write, write_record
from pipeline.frame import WarpedFrame
from pipeline.gl.context import create_context, describe, release_context
from pipeline.methods.registry import METHODS
from pipeline.named_classes import Choice
from pipeline.quality import Quality, interior
from pipeline.warp.gpu import warp_frame
from protocols.revision import code_revision, package_version
from stimuli.scenes.stereo import PAIR_WARP, StereoPair, built_in_pair, load_pair
from stimuli.warp.one_frame import warp_and_fill

# Pairs of the Middlebury benchmark, where a folder of them is given: no licence lets us ship them.
PAIRS = {
    "teddy": ("middlebury2003_teddy", "im2.png", "disp2.pgm", "im6.png", 4.0),
    "aloe": ("middlebury2006_aloe", "aloeL.jpg", "aloeGT.png", "aloeR.jpg", 1.0),
    "tsukuba": ("middlebury2001_tsukuba", "imL.png", "groundtruth.png", "imR.png", 16.0),
}
PART = PagePart("quality table")
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


def cells(quality: Quality) -> str:
    """The four measures, as cells of a row."""
    return (
        f"{quality.psnr_db:.2f} | {quality.ssim:.3f} | {quality.high_frequency_ratio:.2f} |"
        f" {quality.band_error:.3f}"
    )


def table(results: dict[str, tuple[float, dict[str, Quality]]]) -> str:
    """Render as Markdown: one row per pair and method."""
    lines = [
        "| pair (interior holes) | method | PSNR dB | SSIM | high-frequency ratio | band error |",
        "| --- | --- | ---: | ---: | ---: | ---: |",
    ]
    for pair, (share, fills) in results.items():
        for method, quality in fills.items():
            lines.append(f"| {pair} ({100 * share:.1f} %) | {method} | {cells(quality)} |")
    return "\n".join(lines)


def means(results: dict[str, tuple[float, dict[str, Quality]]]) -> str:
    """Render as Markdown: one row per method, its measures averaged over the pairs."""
    lines = [
        "| method | PSNR dB | SSIM | high-frequency ratio | band error |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    fills = [fill for _, fill in results.values()]
    for method in fills[0]:
        columns = zip(*(astuple(fill[method]) for fill in fills), strict=True)
        mean = Quality(*(sum(column) / len(column) for column in columns))
        lines.append(f"| `{method}` | {cells(mean)} |")
    return "\n".join(lines)


def main(argv: list[str]) -> int:
    """Measure, print, and store with what the numbers depend on."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=Path, help="folder of further pairs (Middlebury)")
    parser.add_argument("--docs", type=PART.page, help="document whose table of means is replaced")
    parser.add_argument("--json", type=file_to_write, help="file to store the numbers in")
    arguments = parser.parse_args(argv)
    choices = [Choice(entry.name) for entry in METHODS if not entry.takes_path]
    ctx = create_context()
    try:
        renderer = str(describe(ctx))
        print(silhouettes(ctx, arguments.pairs))
        results = {name: measure(ctx, pair, choices) for name, pair in pairs(arguments.pairs)}
    finally:
        release_context(ctx)
    print(table(results))
    if arguments.json is not None:
        record = {
            "version": package_version(),
            "revision": code_revision(),
            "renderer": renderer,
            "pairs": {
                name: {"hole_share": share, "methods": {m: asdict(q) for m, q in fills.items()}}
                for name, (share, fills) in results.items()
            },
        }
        write_record(arguments.json, record)
    if arguments.docs is not None:
        PART.replace(arguments.docs, means(results))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
