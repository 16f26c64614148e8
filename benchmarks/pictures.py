"""The pictures of README and docs, from our own scenes: `script/bench pictures`.

One sheet of close-ups for the README, one of the fills, and one of the steps of the method for
docs/method.md.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from pipeline.frame import WarpedFrame
from pipeline.gl.context import create_context, release_context
from pipeline.methods.registry import create_method
from pipeline.pictures import drawing
from protocols.recipes.warped_clips import CirclePath
from stimuli.batch.footage import CameraShot, Footage
from stimuli.rendering.paths import make_path
from stimuli.rendering.render import WorldRenderer
from stimuli.rendering.scenery import RenderedScenery
from stimuli.scenes.builtin_scenes import build_scene
from stimuli.warp.warp_steps import metameric_steps

FILLS = "push-pull", "metameric", "background-extension", "coherence-transport"
SIZE_PX = (448, 336)
CROP_PX = (84, 112)
CROPS_AT = ((184, 30), (170, 210))
"""Top and left of each close-up: a fence with flowers behind, a gate before a path."""

SEED = 1
STEPS = (  # of `stimuli.warp.warp_steps`, and what stands under them
    ("base", "2 base: colour of what lies at the hole's depth"),
    ("level0-bands", "3 finest bands: high, along x, along y"),
    ("level0-deviation", "4 their deviations, carried into the hole"),
    ("noise", "5 noise, shaped by them"),
)


def main(argv: list[str]) -> int:
    """Render, warp, fill and write the labelled pictures."""
    parser = argparse.ArgumentParser(prog="script/bench pictures", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/images"))
    out = parser.parse_args(argv).out
    ctx = create_context()
    scenery = RenderedScenery(WorldRenderer(ctx, build_scene("garden", 1, {})), "garden")
    path = make_path(CirclePath(kind="circle"), 60, 30.0)
    footage = Footage(ctx, scenery, CameraShot(path, SIZE_PX, 0.25, 0.1), probe=[0])
    warped = footage.warped(0)
    tiles = [
        ("warped: what the source did not see", drawing.of_holes(warped.colour, warped.hole)),
    ]
    for name in FILLS:
        method = create_method(name, ctx)
        tiles.append((name, drawing.of_colour(method.fill(warped, SEED))))
        method.release()
    tiles.append(("the true view", drawing.of_colour(footage.truth(0))))
    out.mkdir(parents=True, exist_ok=True)
    sheets = {
        "close-ups.png": close_ups(tiles),
        "fills.png": drawing.sheet(tiles, columns=3),
        "method-steps.png": steps_sheet(warped, tiles),
    }
    for name, sheet in sheets.items():
        drawing.save_picture(out / name, sheet)
    print(f"holes {100 * np.mean(warped.hole):.1f} %; wrote {', '.join(sheets)} into {out}")
    footage.release()
    scenery.release()
    release_context(ctx)
    return 0


def close_ups(tiles: list[tuple[str, drawing.Picture]]) -> drawing.Picture:
    """The holes, a plain blur, our fills and the truth, in two crops at three times their size."""
    shown = [
        ("what the camera did not see", 0),
        ("push-pull", 1),
        ("metameric", 2),
        ("coherence-transport", 4),
        ("truth", -1),
    ]
    return drawing.sheet(
        [
            (
                label,
                tiles[place][1][top : top + CROP_PX[0], left : left + CROP_PX[1]]
                .repeat(3, 0)
                .repeat(3, 1),
            )
            for top, left in CROPS_AT
            for label, place in shown
        ],
        columns=len(shown),
    )


def steps_sheet(warped: WarpedFrame, fills: list[tuple[str, drawing.Picture]]) -> drawing.Picture:
    """The steps of the method where most is hidden, between the warped frame and the truth."""
    rows, columns = slice(189, 309), slice(71, 231)
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
        ("their depth: the background's", drawing.of_depth(detail.depth_m)),
        *((label, drawing.fitted(steps[name], (120, 160))) for name, label in STEPS),
        ("metameric", metameric),
        ("the true view", truth),
    ]
    return drawing.sheet(tiles, columns=4)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
