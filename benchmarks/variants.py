"""Every switch of `metameric` by itself: `script/bench variants --help`.

On stereo pairs, against the other photograph inside interior holes; and on clips of a
textured plane behind a disc, ten frames of lateral motion, where flicker is measured too.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import moderngl
import numpy as np
from numpy.typing import NDArray
from rich.progress import track
from scipy import ndimage

from benchmarks.quality import pairs, warped_pair
from benchmarks.shared.output import file_to_write, write_record
from pipeline.frame import SourceFrame, WarpedFrame
from pipeline.gl.context import create_context, describe, release_context
from pipeline.methods.metameric import Metameric
from pipeline.quality import Quality, evaluate, interior
from pipeline.synthesis.settings import MetamericSettings
from pipeline.warp.gpu import warp_frame
from protocols.revision import code_revision, package_version
from stimuli import pictures

CLIP_EDGE_PX = 192
CLIP_FRAMES = 10
CLIP_STEP_PX = 0.7  # motion of the background per frame; the disc moves 3.3 more
CLIP_SCORED = (4, 9)  # frames that are compared with the truth
TEXTURES = ("brick", "grass", "gravel")

DEFAULTS = MetamericSettings()


@dataclass(frozen=True)
class Variant:
    """One row: the default settings but for `settings`."""

    label: str
    settings: MetamericSettings = DEFAULTS


VARIANTS = (
    Variant("default"),
    Variant("levels 3", MetamericSettings(levels=3)),
    Variant("noise 0", MetamericSettings(noise=0.0)),
    Variant("noise 0.5", MetamericSettings(noise=0.5)),
    Variant("skip_depth_edges false", MetamericSettings(skip_depth_edges=False)),
    Variant("channels independent", MetamericSettings(channels="independent")),
    Variant("gamma 0", MetamericSettings(gamma=0.0)),
    Variant("gamma 0.5", MetamericSettings(gamma=0.5)),
    Variant("gamma 1", MetamericSettings(gamma=1.0)),
)


@dataclass(frozen=True)
class Scored:
    """Of one variant on one scene; flicker of clips only."""

    quality: Quality
    flicker: float | None = None


@dataclass(frozen=True)
class Clip:
    """Warped frames of a plane behind a disc, with what they should show."""

    frames: list[WarpedFrame]
    truth: list[NDArray[np.float32]]
    z_near_m: float = 2.0


def moving_texture(ctx: moderngl.Context, name: str) -> Clip:
    """Warp a plane of one of scikit-image's textures, and a disc in front, to ten frames."""
    from skimage import data, transform

    edge = CLIP_EDGE_PX
    photograph = getattr(data, name)() / 255
    grey = transform.resize(photograph, (320, 320), anti_aliasing=True)
    plane = np.clip(grey[:edge, : edge + 32, None] * (1.0, 0.9, 0.75), 0, 1).astype(np.float32)
    y, x = np.mgrid[:edge, :edge] + 0.5
    disc = (x - 0.36 * edge) ** 2 + (y - 0.5 * edge) ** 2 < (0.23 * edge) ** 2
    source = SourceFrame(
        np.where(disc[..., None], (0.8, 0.1, 0.1), plane[:, :edge]).astype(np.float32),
        np.where(disc, 2, 5).astype(np.float32),
    )
    frames, truth = [], []
    for index in range(CLIP_FRAMES):
        flow_px = np.zeros((edge, edge, 2), np.float32)
        flow_px[..., 0] = CLIP_STEP_PX * index + np.where(disc, 6 + 3.3 * index, 0)
        frames.append(warp_frame(ctx, source, flow_px))
        shown = _glided(plane, -CLIP_STEP_PX * index, order=1)[:, :edge]
        truth.append(np.clip(shown, 0, 1).astype(np.float32))
    return Clip(frames, truth)


def flicker(fills: Sequence[NDArray[np.float32]], clip: Clip) -> float:
    """Root-mean-square change from frame to frame at one place of the background.

    Over places that are holes in both frames. 0 is still; resampling by part of a pixel
    costs some, which the truth shows.
    """
    still = [_glided(fill, CLIP_STEP_PX * index) for index, fill in enumerate(fills)]
    inside = []
    for index, frame in enumerate(clip.frames):
        core = ndimage.binary_erosion(frame.hole, np.ones((3, 3)))
        moved = _glided(core.astype(np.float32)[..., None], CLIP_STEP_PX * index, order=1)
        inside.append(moved[..., 0] > 0.99)
    changes = [
        (still[k + 1] - still[k])[inside[k] & inside[k + 1]] ** 2 for k in range(len(still) - 1)
    ]
    return float(np.sqrt(np.concatenate(changes).mean()))


def _glided(image: NDArray[np.float32], by_px: float, order: int = 3) -> NDArray[np.float64]:
    """Image shifted: each pixel gets what lies `by_px` to its right."""
    return np.asarray(
        ndimage.shift(image.astype(np.float64), (0, -by_px, 0), order=order, mode="nearest")
    )


def score_pair(
    ctx: moderngl.Context, variant: Variant, warped: WarpedFrame, truth: NDArray[np.float32]
) -> tuple[Scored, NDArray[np.float32]]:
    """Fill one frame; quality inside its interior holes."""
    z_near_m = float(warped.depth_m.min())
    method = Metameric(ctx, **asdict(variant.settings), z_near_m=z_near_m)
    filled = method.fill(warped, 0)
    method.release()
    return Scored(evaluate(filled, truth, interior(warped.hole))), filled


def score_clip(
    ctx: moderngl.Context, variant: Variant, clip: Clip
) -> tuple[Scored, NDArray[np.float32]]:
    """Fill all frames; mean quality of the scored ones, flicker of all; and the last fill."""
    method = Metameric(ctx, **asdict(variant.settings), z_near_m=clip.z_near_m)
    fills = [method.fill(frame, 0) for frame in clip.frames]
    method.release()
    found = [asdict(evaluate(fills[k], clip.truth[k], clip.frames[k].hole)) for k in CLIP_SCORED]
    mean = Quality(**{key: float(np.mean([one[key] for one in found])) for key in found[0]})
    return Scored(mean, flicker(fills, clip)), fills[-1]


def table(results: dict[str, dict[str, Scored]]) -> str:
    """Render as Markdown: one row per scene and variant."""
    lines = [
        "| scene | variant | PSNR dB | SSIM | high-frequency ratio | band error | flicker |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for scene, rows in results.items():
        for label, scored in rows.items():
            q = scored.quality
            still = "" if scored.flicker is None else f"{scored.flicker:.4f}"
            lines.append(
                f"| {scene} | {label} | {q.psnr_db:.2f} | {q.ssim:.3f} |"
                f" {q.high_frequency_ratio:.2f} | {q.band_error:.3f} | {still} |"
            )
    return "\n".join(lines)


def measure(
    ctx: moderngl.Context, folder: Path | None, sheets: Path | None
) -> tuple[dict[str, dict[str, Scored]], dict[str, float]]:
    """Score all variants on all scenes; and the flicker of each clip's truth."""
    results: dict[str, dict[str, Scored]] = {}
    truth_flicker = {}
    images: dict[str, list[tuple[str, pictures.Picture]]] = {}
    for name, pair in pairs(folder):
        if pair.right is None:
            continue
        warped = warped_pair(ctx, pair)
        results[name], images[name] = {}, [("truth", pictures.of_colour(pair.right))]
        for variant in track(VARIANTS, name):
            scored, filled = score_pair(ctx, variant, warped, pair.right)
            results[name][variant.label] = scored
            images[name].append((variant.label, pictures.of_colour(filled)))
    for name in TEXTURES:
        clip = moving_texture(ctx, name)
        truth_flicker[name] = flicker(clip.truth, clip)
        results[name], images[name] = {}, [("truth", pictures.of_colour(clip.truth[-1]))]
        for variant in track(VARIANTS, name):
            scored, filled = score_clip(ctx, variant, clip)
            results[name][variant.label] = scored
            images[name].append((variant.label, pictures.of_colour(filled)))
    if sheets is not None:
        sheets.mkdir(parents=True, exist_ok=True)
        for name, tiles in images.items():
            pictures.save_picture(sheets / f"{name}.png", pictures.sheet(tiles))
    return results, truth_flicker


def main(argv: list[str] | None = None) -> int:
    """Measure, print, and store with what the numbers depend on."""
    parser = argparse.ArgumentParser(prog="script/bench variants", description=__doc__)
    parser.add_argument("--pairs", type=Path, help="folder of further pairs (Middlebury)")
    parser.add_argument("--sheets", type=Path, help="folder for a labelled sheet per scene")
    parser.add_argument("--json", type=file_to_write, help="file to store the numbers in")
    arguments = parser.parse_args(argv)
    ctx = create_context()
    try:
        renderer = str(describe(ctx))
        results, truth_flicker = measure(ctx, arguments.pairs, arguments.sheets)
    finally:
        release_context(ctx)
    print(table(results))
    print("flicker of the truth:", {k: round(v, 4) for k, v in truth_flicker.items()})
    if arguments.json is not None:
        record = {
            "version": package_version(),
            "revision": code_revision(),
            "renderer": renderer,
            "truth_flicker": truth_flicker,
            "scenes": {
                scene: {label: asdict(scored) for label, scored in rows.items()}
                for scene, rows in results.items()
            },
        }
        write_record(arguments.json, record)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
