"""The pictures of README and docs, from our own scenes: `script/bench pictures`.

One sheet of the fills for the README, and one of the steps of the method for docs/method.md.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.frame import WarpedFrame
from pipeline.gl.context import create_context, release_context
from pipeline.methods.registry import create_method
from protocols.recipes.warped_clips import CirclePath
from stimuli import pictures
from stimuli.media.footage import CameraShot, Footage
from stimuli.rendering.paths import make_path
from stimuli.rendering.render import WorldRenderer
from stimuli.rendering.scenery import RenderedScenery
from stimuli.scenes.builtin_scenes import build_scene
from stimuli.single.warp_steps import metameric_steps

FILLS = "push-pull", "metameric", "background-extension", "coherence-transport"

SEED = 1
DETAIL_PX = (120, 160)
STEPS = (  # of `stimuli.single.warp_steps`, and what stands under them
    ("base", "2 base: colour of what lies at the hole's depth"),
    ("level0-bands", "3 finest bands: high, along x, along y"),
    ("level0-deviation", "4 their deviations, carried into the hole"),
    ("noise", "5 noise, shaped by them"),
)


def main(argv: list[str]) -> int:
    """Render, warp, fill and write one labelled picture."""
    parser = argparse.ArgumentParser(prog="script/bench pictures", description=__doc__)
    parser.add_argument("--scene", default="garden")
    parser.add_argument("--size", type=int, nargs=2, default=(448, 336), metavar=("W", "H"))
    parser.add_argument("--extent", type=float, default=0.25, help="radius of the path, m")
    parser.add_argument("--frame", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("docs/images/fills.png"))
    parser.add_argument("--steps", type=Path, default=Path("docs/images/method-steps.png"))
    arguments = parser.parse_args(argv)
    ctx = create_context()
    world = build_scene(arguments.scene, 1, {})
    scenery = RenderedScenery(WorldRenderer(ctx, world), arguments.scene)
    shot = CameraShot(
        make_path(CirclePath(kind="circle"), 60, 30.0), tuple(arguments.size), arguments.extent, 0.1
    )
    footage = Footage(ctx, scenery, shot, probe=[arguments.frame])
    warped = footage.warped(arguments.frame)
    tiles = [
        ("warped: what the source did not see", pictures.of_holes(warped.colour, warped.hole)),
    ]
    for name in FILLS:
        method = create_method(name, ctx)
        tiles.append((name, pictures.of_colour(method.fill(warped, SEED))))
        method.release()
    tiles.append(("the true view", pictures.of_colour(footage.truth(arguments.frame))))
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    pictures.save_picture(arguments.out, pictures.sheet(tiles, columns=3))
    pictures.save_picture(arguments.steps, steps_sheet(warped, tiles))
    print(f"holes {100 * np.mean(warped.hole):.1f} %; wrote {arguments.out}, {arguments.steps}")
    footage.release()
    scenery.release()
    release_context(ctx)
    return 0


def steps_sheet(warped: WarpedFrame, fills: list[tuple[str, pictures.Picture]]) -> pictures.Picture:
    """The steps of the method where most is hidden, between the warped frame and the truth."""
    top, left = most_holes(warped.hole, DETAIL_PX)
    rows, columns = slice(top, top + DETAIL_PX[0]), slice(left, left + DETAIL_PX[1])
    detail = WarpedFrame(
        warped.colour[rows, columns],
        warped.depth_m[rows, columns],
        warped.hole[rows, columns],
        warped.flow_px[rows, columns],
        warped.frame_index,
    )
    steps = {name: picture for name, _, picture in metameric_steps(detail, {}, SEED)}
    holes, metameric, truth = (fills[place][1][rows, columns] for place in (0, 2, -1))
    tiles = [
        ("1 warped: holes", holes),
        ("their depth: the background's", pictures.of_depth(detail.depth_m)),
        *((label, pictures.fitted(steps[name], DETAIL_PX)) for name, label in STEPS),
        ("metameric", metameric),
        ("the true view", truth),
    ]
    return pictures.sheet(tiles, columns=4)


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


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
