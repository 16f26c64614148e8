"""Worth of each correction of `metameric`: `script/bench ablation --help`.

One correction at a time is switched off, in the numpy twin; beside them settings, the number of
levels, what was tried and left out, `metameric-paper` and `push-pull-depth`. Measured on the stereo
pairs, against the other photograph inside interior holes, and on the built-in scenes, against the
true view; of frames larger than `--crop` the part with the most holes. FovVideoVDP where it can be
imported.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from benchmarks.paper import Row, View, fovvideovdp, photographs, rendered
from benchmarks.pictures import most_holes
from benchmarks.shared import colour_edges
from benchmarks.shared.output import PagePart, file_to_write, write_record
from pipeline.frame import WarpedFrame
from pipeline.gl.context import create_context, release_context
from pipeline.inpaint import reference as inpaint
from pipeline.inpaint.reference import nearest_depth_m
from pipeline.noise import tile
from pipeline.noise.mixing import Mixing, fitted_mixing
from pipeline.printed.reference import printed_fill
from pipeline.printed.settings import PrintedSettings
from pipeline.quality import Quality, evaluate
from pipeline.statistics import lacking
from pipeline.statistics import reference as statistics
from pipeline.statistics.lacking import noise_variances
from pipeline.statistics.moments import PER_BAND
from pipeline.synthesis import reference as synthesis
from pipeline.synthesis.reference import metameric_fill
from pipeline.synthesis.settings import MetamericSettings
from protocols.revision import code_revision, package_version
from stimuli.scenes.builtin_scenes import scene_names

PART = PagePart("ablation table")
SEED = 1

Colour = NDArray[np.float32]
Patch = tuple[Any, str, Any]  # where, what, and what stands in its place


def unmixed(levels: int) -> Mixing:
    """Bands as they come: what they overlap by is known all the same."""
    fitted = fitted_mixing(levels)
    back = np.linalg.inv(fitted.matrix)
    return replace(
        fitted,
        matrix=np.eye(len(back)),
        overlap=np.asarray(back.T @ fitted.overlap @ back),
    )


def _outlines_measured(
    values: NDArray[np.float64],
    base_bands: NDArray[np.float64],
    outlined: NDArray[np.bool_],
    known: NDArray[np.float64],
    *,
    cross: bool,
) -> NDArray[np.float64]:
    return noise_variances(values, base_bands, np.zeros_like(outlined), known, cross=cross)


def _everywhere(hole: NDArray[np.bool_], *_: int) -> NDArray[np.bool_]:
    return np.ones_like(hole)


def _from_squares(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """As `luma_moments`, of E[X^2] in place of E|X|."""
    mean, _, square = np.moveaxis(values.reshape(*values.shape[:2], -1, PER_BAND)[..., :3], -1, 0)
    return mean, np.maximum(0.0, square - mean**2)


def _of_one_pixel() -> NDArray[np.float64]:
    return np.pad(np.ones((1, 1)), 3)


CORRECTIONS: dict[str, tuple[Patch, ...]] = {
    "0034 the base is not measured across outlines": (
        (statistics, "noise_variances", _outlines_measured),
    ),
    "0047 noise is mixed": ((tile, "fitted_mixing", unmixed),),
    "0058 the base is relaxed": ((inpaint, "RELAXED_RESOLUTIONS", 0),),
    "0059 noise is softened": ((tile, "softening", _of_one_pixel),),
}
DEFAULT = "metameric"
DEFAULTS = MetamericSettings()


@dataclass(frozen=True)
class Variant:
    """One row: settings, and what is replaced in the twin."""

    label: str
    settings: MetamericSettings = DEFAULTS
    patches: tuple[Patch, ...] = ()


VARIANTS = (
    Variant(DEFAULT),
    *(Variant(f"without {name}", patches=patches) for name, patches in CORRECTIONS.items()),
    Variant("skip_depth_edges false", MetamericSettings(skip_depth_edges=False)),
    Variant("channels independent", MetamericSettings(channels="independent")),
    Variant("gamma 0", MetamericSettings(gamma=0.0)),
    Variant("gamma 0.5", MetamericSettings(gamma=0.5)),
    *(Variant(f"levels {levels}", MetamericSettings(levels=levels)) for levels in (1, 3, 4)),
    Variant(
        "statistics that keep to a colour",
        patches=((synthesis, "inpainted_statistics", colour_edges.inpainted_statistics),),
    ),
    Variant(
        "statistics that keep to a colour four times as coarse",
        patches=(
            (
                synthesis,
                "inpainted_statistics",
                partial(colour_edges.inpainted_statistics, resolutions=2),
            ),
        ),
    ),
    Variant(
        "variances from mean squares",
        patches=((lacking, "luma_moments", _from_squares),),
    ),
    Variant("statistics of the whole frame", patches=((statistics, "near_a_hole", _everywhere),)),
    Variant("noise 0.8", MetamericSettings(noise=0.8)),
    Variant("noise 0 (push-pull-depth)", MetamericSettings(noise=0.0)),
)
PRINTED = "metameric-paper"


@contextmanager
def replaced(patches: Sequence[Patch]) -> Iterator[None]:
    """Put `patches` in place; noise that they change is made anew before and after."""
    of_noise = any(where is tile for where, _, _ in patches)
    with ExitStack() as stack:
        for where, name, value in patches:
            stack.enter_context(mock.patch.object(where, name, value))
        if of_noise:
            stack.callback(tile.noise_bands.cache_clear)
            tile.noise_bands.cache_clear()
        yield


def fills(view: View) -> Iterator[tuple[str, Colour]]:
    """Every variant's fill of one view."""
    warped = view.warped
    z_near_m = nearest_depth_m(warped.depth_m)
    for variant in VARIANTS:
        with replaced(variant.patches):
            found = metameric_fill(warped, variant.settings, seed=SEED, z_near_m=z_near_m)
        yield variant.label, found.colour.astype(np.float32)
    printed = printed_fill(warped, PrintedSettings(), seed=SEED, z_near_m=z_near_m)
    yield PRINTED, printed.colour.astype(np.float32)


def cropped(view: View, size_px: tuple[int, int]) -> View:
    """The part of `size_px` (width, height) with the most holes, or all of a smaller frame."""
    height, width = view.mask.shape
    size = min(size_px[1], height), min(size_px[0], width)
    top, left = most_holes(view.mask, size)
    cut = np.s_[top : top + size[0], left : left + size[1]]
    frame = view.warped
    warped = WarpedFrame(
        np.ascontiguousarray(frame.colour[cut]),
        np.ascontiguousarray(frame.depth_m[cut]),
        np.ascontiguousarray(frame.hole[cut]),
        np.ascontiguousarray(frame.flow_px[cut]),
        frame.frame_index,
    )
    return View(warped, np.ascontiguousarray(view.truth[cut]), view.mask[cut])


def table(results: dict[str, dict[str, Row]]) -> str:
    """Render as Markdown: means, and how much worse each variant is than the default."""
    lines = [
        "| | PSNR dB | SSIM | high-frequency ratio | band error | JOD |"
        " band error less the default's, least to most |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for label in next(iter(results.values())):
        rows = [found[label] for found in results.values()]
        means = {
            key: float(np.mean([asdict(row.quality)[key] for row in rows]))
            for key in ("psnr_db", "ssim", "high_frequency_ratio", "band_error")
        }
        jods = [row.jod for row in rows if row.jod is not None]
        change = [
            found[label].quality.band_error - found[DEFAULT].quality.band_error
            for found in results.values()
        ]
        shown = f"{np.mean(jods):.2f}" if jods else ""
        lines.append(
            f"| {label} | {means['psnr_db']:.2f} | {means['ssim']:.3f} |"
            f" {means['high_frequency_ratio']:.2f} | {means['band_error']:.4f} |"
            f" {shown} | {min(change):+.4f} to {max(change):+.4f} |"
        )
    return "\n".join(lines)


def measure(
    view: View, jod: Callable[[Colour, Colour, NDArray[np.bool_]], float] | None
) -> dict[str, Row]:
    """Score all variants on one view."""
    found = {}
    for label, filled in fills(view):
        quality: Quality = evaluate(filled, view.truth, view.mask)
        found[label] = Row(quality, jod(filled, view.truth, view.mask) if jod else None)
    return found


def main(argv: list[str]) -> int:
    """Measure, print, and store with what the numbers depend on."""
    parser = argparse.ArgumentParser(prog="script/bench ablation", description=__doc__)
    parser.add_argument("--pairs", type=Path, help="folder of further pairs (Middlebury)")
    parser.add_argument("--scenes", nargs="*", choices=scene_names(), default=scene_names())
    parser.add_argument("--crop", type=int, nargs=2, default=(320, 240), metavar=("W", "H"))
    parser.add_argument("--extent", type=float, default=0.04, help="in near depths (0.04)")
    parser.add_argument("--docs", type=PART.page, help="page whose table is replaced")
    parser.add_argument("--json", type=file_to_write)
    arguments = parser.parse_args(argv)
    size_px = (arguments.crop[0], arguments.crop[1])
    ctx = create_context()
    try:
        scenes = [
            *photographs(ctx, arguments.pairs),
            *rendered(ctx, arguments.scenes, size_px, arguments.extent),
        ]
    finally:
        release_context(ctx)
    jod = fovvideovdp()
    results = {
        name: measure(cropped(views[0], size_px), jod) for name, views in track(scenes, "ablation")
    }
    print(table(results))
    if arguments.docs is not None:
        PART.replace(arguments.docs, table(results))
    record = {
        "version": package_version(), "revision": code_revision(),
        "crop_px": list(size_px), "extent": arguments.extent,
        "scenes": {
            name: {label: asdict(row) for label, row in found.items()}
            for name, found in results.items()
        },
    }  # fmt: skip
    if arguments.json is not None:
        write_record(arguments.json, record)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
