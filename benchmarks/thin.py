"""Thin things of one pixel through the warp: `script/bench thin --help`.

Every built-in scene, seen from four places around its camera. A pixel *stands alone* if all
quads around it are torn; a warp that draws quads only loses it. Measured are how many there are,
how many still are not drawn, what that does to the holes, and how far the newly shown target
pixels are from the true view, beside a fill of the same pixels.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict, dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from benchmarks.shared.output import PagePart, file_to_write, write_record
from pipeline.camera import flow_between
from pipeline.frame import SourceFrame, WarpedFrame
from pipeline.gl.context import create_context, describe, release_context
from pipeline.methods.registry import create_method
from pipeline.warp import reference
from pipeline.warp.settings import TargetWindow, WarpSettings
from protocols.revision import code_revision, package_version
from stimuli.rendering.paths import STILL, Pose
from stimuli.rendering.render import WorldRenderer
from stimuli.rendering.scenery import RenderedScenery
from stimuli.scenes.builtin_scenes import build_scene, scene_names

PART = PagePart("thin table")
DIRECTIONS = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))
SCENE_SEED = 1


@dataclass(frozen=True)
class Thin:
    """Means over the views of one scene; shares of the frame."""

    alone: float
    """Source pixels whose quads are all torn: what was lost before."""
    lost: float
    """Those of them that are still not drawn."""
    holes_before: float
    holes: float
    shown: float
    """Target pixels that show something thin, where there was a hole or something farther."""
    error: float
    """Root-mean-square error of these pixels, /255."""
    error_before: float
    """The same without what is thin, holes filled by `push-pull-depth`."""


def without_thin(
    frame: SourceFrame, flow_px: NDArray[np.float32], depth_m: NDArray[np.float32]
) -> tuple[WarpedFrame, float, float]:
    """Warp by quads and strips alone; and the shares of pixels alone, and of these not drawn."""
    window, settings = TargetWindow.of(frame.size), WarpSettings()
    depth = depth_m.astype(np.float64)
    mesh = reference.moved_mesh(depth, flow_px, window)
    stretch = settings.stretch_subpixels(window)
    torn = reference.torn_quads(flow_px, stretch, settings.surface_px)
    stretched = mesh.ring_0 | torn
    grid = tuple(length + 2 * reference.RINGS - 1 for length in frame.size)
    severed = (torn & mesh.drawable).reshape(grid)
    inner = slice(reference.RINGS - 1, 1 - reference.RINGS)
    around = [severed[inner, inner][y:, x:][: frame.size[0], : frame.size[1]]
              for y in (0, 1) for x in (0, 1)]  # fmt: skip
    alone = np.logical_and.reduce(around)
    thin, _ = reference.thin_and_mixed(flow_px, depth, stretch, settings.surface_px)
    mesh, stretched, drawn = reference.with_strips(
        mesh, stretched, mesh.drawable, frame.size, window
    )
    hits = reference.coverage(mesh, drawn, window)
    ranked = reference.partitioned_depth(mesh, stretched, hits)
    shown = reference.nearest(hits, ranked, stretched)
    warped = reference.resolve(frame, depth, flow_px, mesh, stretched, shown, window, settings)
    return warped, float(alone.mean()), float((alone & ~thin).mean())


def measure(ctx: moderngl.Context, name: str, size_px: tuple[int, int], extent: float) -> Thin:
    """Measure one scene; `extent` is the camera's way in shares of the near depth."""
    scenery = RenderedScenery(WorldRenderer(ctx, build_scene(name, SCENE_SEED)), name)
    extent_m = extent * scenery.typical_depth_m
    frame, camera = scenery.source(size_px, 0, STILL, extent_m, -1)
    fill = create_method("push-pull-depth", ctx, {})
    found = []
    for direction in DIRECTIONS:
        pose = Pose(np.asarray(direction, np.float64), np.eye(3))
        flow_px, depth_m = flow_between(camera, pose.applied_to(camera, extent_m), frame.depth_m)
        before, alone, lost = without_thin(frame, flow_px, depth_m)
        after = reference.warp(frame, flow_px, target_depth_m=depth_m)
        truth = scenery.truth(size_px, pose, extent_m, after, 0)
        inverse = [1 / np.where(one.hole, np.inf, one.depth_m) for one in (before, after)]
        shown = ~after.hole & (inverse[1] > inverse[0] * 1.001)
        errors = [(one[shown] - truth[shown]) ** 2 for one in (after.colour, fill.fill(before, 1))]
        found.append(
            Thin(
                alone,
                lost,
                float(before.hole.mean()),
                float(after.hole.mean()),
                float(shown.mean()),
                *(float(error.mean()) if error.size else 0.0 for error in errors),
            )
        )
    fill.release()
    scenery.release()
    mean = {key: float(np.mean([asdict(one)[key] for one in found])) for key in asdict(found[0])}
    for key in ("error", "error_before"):
        mean[key] = 255 * mean[key] ** 0.5
    return Thin(**mean)


def table(results: dict[str, Thin]) -> str:
    """Render as Markdown."""
    lines = [
        "| scene | lost before % | now % | holes before % | now % |"
        " target shows what is thin % | error there /255 | filled instead /255 |",
        "| --- |" + " ---: |" * 7,
    ]
    for scene, thin in results.items():
        shares = (thin.alone, thin.lost, thin.holes_before, thin.holes, thin.shown)
        lines.append(
            f"| {scene} | "
            + " | ".join(f"{100 * share:.2f}" for share in shares)
            + f" | {thin.error:.1f} | {thin.error_before:.1f} |"
        )
    return "\n".join(lines)


def main(argv: list[str]) -> int:
    """Measure, print, and store with what the numbers depend on."""
    parser = argparse.ArgumentParser(prog="script/bench thin", description=__doc__)
    parser.add_argument("--scenes", nargs="+", choices=scene_names(), default=scene_names())
    parser.add_argument("--size", type=int, nargs=2, default=(320, 240), metavar=("W", "H"))
    parser.add_argument(
        "--extent", type=float, default=0.04, help="the camera's way, in near depths (0.04)"
    )
    parser.add_argument("--docs", type=PART.page, help="page whose table is replaced")
    parser.add_argument("--json", type=file_to_write)
    arguments = parser.parse_args(argv)
    ctx = create_context()
    try:
        renderer = str(describe(ctx))
        results = {
            name: measure(ctx, name, tuple(arguments.size), arguments.extent)
            for name in arguments.scenes
        }
    finally:
        release_context(ctx)
    print(table(results))
    if arguments.docs is not None:
        PART.replace(arguments.docs, table(results))
    record = {
        "version": package_version(), "revision": code_revision(), "renderer": renderer,
        "size_px": list(arguments.size), "extent": arguments.extent,
        "scenes": {name: asdict(thin) for name, thin in results.items()},
    }  # fmt: skip
    if arguments.json is not None:
        write_record(arguments.json, record)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
