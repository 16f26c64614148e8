"""Draw the stereo pair of the tutorials: the scene `colonnade`, seen by two cameras side by side.

python script/site/pair.py   writes left.jpg, right.jpg and disparity.png of docs/tutorials
"""

from __future__ import annotations

import numpy as np
from pictures import DOCS
from PIL import Image

from pipeline.gl.context import lent_context
from stimuli.rendering.render import WorldRenderer
from stimuli.scenes.builtin_scenes import build_scene

WIDTH_PX, HEIGHT_PX = 370, 250
SAMPLES = 5  # along an edge of a pixel, averaged; the middle one tells its depth
BASELINE_M = 0.3
UNITS_PER_PX = 6


def main() -> None:
    tutorials = DOCS / "tutorials"
    fine = SAMPLES
    with lent_context() as ctx:
        world = build_scene("colonnade", seed=1)
        renderer = WorldRenderer(ctx, world)
        left = world.viewpoint.camera(fine * WIDTH_PX, fine * HEIGHT_PX)
        for name, camera in (("left", left), ("right", left.moved((BASELINE_M, 0, 0)))):
            frame = renderer.render(camera)
            blocks = frame.colour.reshape(HEIGHT_PX, fine, WIDTH_PX, fine, 3)
            pixels = np.rint(255 * blocks.mean(axis=(1, 3))).astype(np.uint8)
            Image.fromarray(pixels).save(tutorials / f"{name}.jpg", quality=92)
            if camera is left:
                depth_m = frame.depth_m[fine // 2 :: fine, fine // 2 :: fine]
    disparity_px = left.fx_px / fine * BASELINE_M / depth_m
    stored = np.rint(UNITS_PER_PX * disparity_px).astype(np.uint8)
    Image.fromarray(stored).save(tutorials / "disparity.png", optimize=True)


if __name__ == "__main__":
    main()
