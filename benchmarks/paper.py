"""The method as printed beside today's and push-pull: `script/bench paper --help`.

On stereo pairs, against the other photograph inside interior holes; on the built-in scenes, seen
from four places around their camera, against the true view inside all holes; with `--photos` on any
photographs instead, each behind cut-outs of the next one that move. FovVideoVDP or
ColorVideoVDP (in JOD, as a still, everything but the holes set to the truth) where it can be
imported.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.quality import pairs, warped_pair
from benchmarks.shared.output import PagePart, file_to_write, write_record
from benchmarks.thin import DIRECTIONS, SCENE_SEED
from pipeline.camera import flow_between
from pipeline.frame import SourceFrame, WarpedFrame
from pipeline.gl.context import create_context, describe, release_context
from pipeline.methods.registry import create_method, method_names
from pipeline.quality import Quality, evaluate, interior
from pipeline.warp.gpu import warp_frame
from pipeline.warp.settings import TargetWindow
from protocols.revision import code_revision, package_version
from stimuli import pictures
from stimuli.read_stimulus import read_picture
from stimuli.rendering.paths import STILL, Pose
from stimuli.rendering.render import WorldRenderer
from stimuli.rendering.scenery import RenderedScenery
from stimuli.scenes.builtin_scenes import build_scene, scene_names
from stimuli.scenes.stereo import PAIR_WARP

PARTS = {"fvvdp": PagePart("paper table"), "cvvdp": PagePart("cvvdp table")}
PHOTOS = PagePart("photographs table")
METHODS = ("metameric-paper", "metameric", "push-pull", "push-pull-depth")
SEED = 1
MARGIN = 0.15  # of the width, around rendered views: nothing enters them

PHOTO_WIDTH_PX = 448
CUT_OUT_PX = 22  # deviation of the noise whose highest parts are cut out
DISPARITY_PX = {"photograph": 10, "cut-out": 30}

Colour = NDArray[np.float32]
Score = Callable[[Colour, Colour, NDArray[np.bool_]], float]


@dataclass(frozen=True)
class View:
    """One warped frame, what it should show, and where that is asked."""

    warped: WarpedFrame
    truth: Colour
    mask: NDArray[np.bool_]


@dataclass(frozen=True)
class Row:
    """One method on one scene: means over its views."""

    quality: Quality
    jod: float | None


def photographs(ctx: moderngl.Context, folder: Path | None) -> Iterator[tuple[str, list[View]]]:
    """Every pair with its other photograph."""
    for name, pair in pairs(folder):
        if pair.right is not None:
            warped = warped_pair(ctx, pair)
            yield name, [View(warped, pair.right, interior(warped.hole))]


def rendered(
    ctx: moderngl.Context, names: Sequence[str], size_px: tuple[int, int], extent: float
) -> Iterator[tuple[str, list[View]]]:
    """Every built-in scene; `extent` is the camera's way in near depths."""
    margin_px = round(MARGIN * size_px[0])
    for name in names:
        scenery = RenderedScenery(WorldRenderer(ctx, build_scene(name, SCENE_SEED)), name)
        extent_m = extent * scenery.typical_depth_m
        frame, camera = scenery.source(size_px, margin_px, STILL, extent_m, -1)
        window = TargetWindow.inside_margin(frame.size, margin_px)
        views = []
        for direction in DIRECTIONS:
            pose = Pose(np.asarray(direction, np.float64), np.eye(3))
            target = pose.applied_to(camera, extent_m)
            flow_px, depth_m = flow_between(camera, target, frame.depth_m)
            warped = warp_frame(ctx, frame, flow_px, target_depth_m=depth_m, window=window)
            truth = scenery.truth(size_px, pose, extent_m, warped, 0)
            views.append(View(warped, truth, warped.hole))
        scenery.release()
        yield name, views


def behind_cut_outs(ctx: moderngl.Context, folder: Path) -> Iterator[tuple[str, list[View]]]:
    """Every photograph of a folder, behind blobs of the next one that move; itself is the truth."""
    files = photographs_in(folder)
    far_px, near_px = DISPARITY_PX.values()
    for index, (file, next_file) in enumerate(zip(files, files[1:] + files[:1], strict=True)):
        photograph = _small(file)
        height, width = photograph.shape[:2]
        noise = np.random.default_rng(index).standard_normal((height, width))
        noise = ndimage.gaussian_filter(noise, CUT_OUT_PX)
        near = noise > noise.std()
        other = cv2.resize(_small(next_file), (width, height), interpolation=cv2.INTER_AREA)
        disparity_px = np.where(near, near_px, far_px)
        source = SourceFrame(
            np.where(near[..., None], other, photograph),
            np.asarray(width / disparity_px, np.float32),
        )
        flow_px = np.stack([-disparity_px, np.zeros_like(disparity_px)], axis=-1)
        warped = warp_frame(ctx, source, np.asarray(flow_px, np.float32), settings=PAIR_WARP)
        shown = np.roll(photograph, -far_px, axis=1)
        truth = np.where(warped.hole[..., None], shown, warped.colour)
        yield file.stem, [View(warped, truth, interior(warped.hole))]


def photographs_in(folder: Path) -> list[Path]:
    """List the photographs of a folder by name; none where it does not exist."""
    return sorted(path for path in folder.glob("*") if path.suffix in {".png", ".jpg"})


def _small(file: Path) -> Colour:
    colour = np.asarray(read_picture(file), np.float32) / 255
    height = round(PHOTO_WIDTH_PX * colour.shape[0] / colour.shape[1])
    small = cv2.resize(colour, (PHOTO_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32)


def measure(
    ctx: moderngl.Context, views: Sequence[View], jod: Score | None, methods: Sequence[str]
) -> tuple[dict[str, Row], list[tuple[str, pictures.Picture]]]:
    """Score every method on one scene; and the first view's fills."""
    rows = {}
    tiles = [("truth", pictures.of_colour(views[0].truth))]
    for name in methods:
        method = create_method(name, ctx, {})
        fills = [method.fill(view.warped, SEED) for view in views]
        method.release()
        found = [
            asdict(evaluate(fill, view.truth, view.mask))
            for fill, view in zip(fills, views, strict=True)
        ]
        mean = {key: float(np.mean([one[key] for one in found])) for key in found[0]}
        scores = [
            jod(fill, view.truth, view.mask)
            for fill, view in zip(fills, views, strict=True)
            if jod is not None
        ]
        rows[name] = Row(Quality(**mean), float(np.mean(scores)) if scores else None)
        tiles.append((name, pictures.of_colour(fills[0])))
    return rows, tiles


def fovvideovdp() -> Score | None:
    """The metric of stills in holes, where its package is installed."""
    if importlib.util.find_spec("pyfvvdp") is None:
        return None
    from stimuli.score.fovvideovdp import open_metric
    from stimuli.score.viewing_conditions import standard_fhd

    return _in_holes(open_metric(standard_fhd(), None, foveated=False))


def colorvideovdp() -> Score | None:
    """The same by the other metric; a process opens one of both."""
    if importlib.util.find_spec("pycvvdp") is None:
        return None
    from stimuli.score.colorvideovdp import open_metric
    from stimuli.score.viewing_conditions import standard_fhd

    return _in_holes(open_metric(standard_fhd()))


def _in_holes(metric: Any) -> Score:
    def score(filled: Colour, truth: Colour, mask: NDArray[np.bool_]) -> float:
        test = np.where(mask[..., None], filled, truth)
        return float(metric.predict(test, truth, dim_order="HWC")[0])

    return score


METRICS = {"fvvdp": fovvideovdp, "cvvdp": colorvideovdp}


def differences(results: dict[str, tuple[float, dict[str, Row]]]) -> str:
    """Render as Markdown: JOD of the first method less each other's, by scene and on average."""
    first, *others = next(iter(results.values()))[1]
    lines = [
        f"| JOD of {first} less that of | " + " | ".join(others) + " |",
        "| --- |" + " ---: |" * len(others),
    ]
    rows = {scene: [_jod(row) for row in rows.values()] for scene, (_, rows) in results.items()}
    rows["mean"] = np.mean(list(rows.values()), axis=0).tolist()
    for scene, (own, *theirs) in rows.items():
        cells = " | ".join(f"{own - jod:+.2f}" for jod in theirs)
        lines.append(f"| {scene} | {cells} |")
    return "\n".join(lines)


def _jod(row: Row) -> float:
    return np.nan if row.jod is None else row.jod


def table(
    results: dict[str, tuple[float, dict[str, Row]]], scenes: Sequence[str] | None = None
) -> str:
    """Render as Markdown: one row per scene and method, of all or the named scenes; the means."""
    lines = [
        "| scene (holes) | method | PSNR dB | SSIM | high-frequency ratio | band error | JOD |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for scene in results if scenes is None else scenes:
        share, rows = results[scene]
        lines += [
            f"| {scene} ({100 * share:.1f} %) | {method} | {_numbers([row])} |"
            for method, row in rows.items()
        ]
    for method in next(iter(results.values()))[1]:
        lines.append(
            f"| mean | {method} | {_numbers([rows[method] for _, rows in results.values()])} |"
        )
    return "\n".join(lines)


def _numbers(rows: Sequence[Row]) -> str:
    q = {
        key: float(np.mean([asdict(row.quality)[key] for row in rows]))
        for key in ("psnr_db", "ssim", "high_frequency_ratio", "band_error")
    }
    jods = [row.jod for row in rows if row.jod is not None]
    jod = f"{np.mean(jods):.2f}" if jods else ""
    return (
        f"{q['psnr_db']:.2f} | {q['ssim']:.3f} | {q['high_frequency_ratio']:.2f} |"
        f" {q['band_error']:.3f} | {jod}"
    )


def main(argv: list[str]) -> int:
    """Measure, print, and store with what the numbers depend on."""
    parser = argparse.ArgumentParser(prog="script/bench paper", description=__doc__)
    parser.add_argument("--pairs", type=Path, help="folder of further pairs (Middlebury)")
    parser.add_argument("--photos", type=Path, help="folder of photographs, for cut-outs alone")
    parser.add_argument("--scenes", nargs="*", choices=scene_names(), default=scene_names())
    parser.add_argument("--methods", nargs="+", choices=method_names(), default=METHODS)
    parser.add_argument("--size", type=int, nargs=2, default=(320, 240), metavar=("W", "H"))
    parser.add_argument("--extent", type=float, default=0.04, help="in near depths (0.04)")
    parser.add_argument("--sheets", type=Path, help="folder for a labelled sheet per scene")
    parser.add_argument("--metric", choices=list(METRICS), default="fvvdp", help="of the JOD")
    parser.add_argument("--docs", type=Path, help="page whose tables are replaced")
    parser.add_argument("--json", type=file_to_write)
    arguments = parser.parse_args(argv)
    if arguments.photos is not None and not photographs_in(arguments.photos):
        parser.error(f"--photos {arguments.photos}: must hold .png or .jpg files (it has none)")
    part = PARTS[arguments.metric] if arguments.photos is None else PHOTOS
    if arguments.docs is not None:
        part.page(str(arguments.docs))
    jod = METRICS[arguments.metric]()
    ctx = create_context()
    results: dict[str, tuple[float, dict[str, Row]]] = {}
    try:
        renderer = str(describe(ctx))
        size_px = (arguments.size[0], arguments.size[1])
        for scenes in (
            (
                photographs(ctx, arguments.pairs),
                rendered(ctx, arguments.scenes, size_px, arguments.extent),
            )
            if arguments.photos is None
            else (behind_cut_outs(ctx, arguments.photos),)
        ):
            for name, views in scenes:
                rows, tiles = measure(ctx, views, jod, arguments.methods)
                results[name] = float(np.mean([view.mask.mean() for view in views])), rows
                if arguments.sheets is not None:
                    arguments.sheets.mkdir(parents=True, exist_ok=True)
                    sheet = pictures.sheet(tiles)
                    pictures.save_picture(arguments.sheets / f"{name}.png", sheet)
    finally:
        release_context(ctx)
    text = table(results, None if arguments.photos is None else ()) + (
        "" if jod is None else f"\n\n{differences(results)}"
    )
    print(text)
    if arguments.docs is not None:
        part.replace(arguments.docs, text)
    record = {
        "version": package_version(), "revision": code_revision(), "renderer": renderer,
        "size_px": list(size_px), "extent": arguments.extent,
        "scenes": {
            name: {"hole_share": share, "methods": {m: asdict(row) for m, row in rows.items()}}
            for name, (share, rows) in results.items()
        },
    }  # fmt: skip
    if arguments.json is not None:
        write_record(arguments.json, record)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
