"""The pictures of README and docs, from our own scenes: `script/bench pictures`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from pipeline.gl.context import create_context, release_context
from pipeline.methods.registry import create_method
from protocols.stimuli_schema import CirclePath
from stimuli import pictures
from stimuli.footage import Footage, Shot
from stimuli.paths import make_path
from stimuli.render import Renderer
from stimuli.scenery import RenderedScenery
from stimuli.scenes.registry import build_scene

FILLS = (
    ("push-pull", "push-pull", {}),
    ("metameric", "metameric", {}),
    ("metameric, texture from the background", "metameric", {"texture": "background"}),
)


def main(argv: list[str]) -> int:
    """Render, warp, fill and write one labelled picture."""
    parser = argparse.ArgumentParser(prog="script/bench pictures", description=__doc__)
    parser.add_argument("--scene", default="garden")
    parser.add_argument("--size", type=int, nargs=2, default=(448, 336), metavar=("W", "H"))
    parser.add_argument("--extent", type=float, default=0.25, help="radius of the path, m")
    parser.add_argument("--frame", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("docs/images/fills.png"))
    arguments = parser.parse_args(argv)
    ctx = create_context()
    world = build_scene(arguments.scene, 1, {})
    scenery = RenderedScenery(ctx, Renderer(ctx, world), arguments.scene)
    shot = Shot(
        make_path(CirclePath(kind="circle"), 60, 30.0), tuple(arguments.size), arguments.extent, 0.1
    )
    footage = Footage(ctx, scenery, shot, probe=[arguments.frame])
    warped = footage.warped(arguments.frame)
    tiles = [
        ("warped: what the source did not see", pictures.of_holes(warped.colour, warped.hole)),
    ]
    for label, name, parameters in FILLS:
        method = create_method(name, ctx, parameters)
        tiles.append((label, pictures.of_colour(method.fill(warped, 1))))
        method.release()
    tiles.append(("the true view", pictures.of_colour(footage.truth(arguments.frame))))
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    pictures.save_picture(arguments.out, pictures.sheet(tiles, columns=3))
    print(f"holes {100 * np.mean(warped.hole):.1f} %; wrote {arguments.out}")
    footage.release()
    scenery.release()
    release_context(ctx)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
