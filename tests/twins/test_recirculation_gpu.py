"""Recirculation on the GPU against its definition."""

import numpy as np

from pipeline.frame import WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.gl.texture import read_back
from pipeline.methods.registry import create_method
from pipeline.pushpull.reference import recirculating

WEIGHT = 0.5
# Both keep what they show in 32768ths: a fill at the border between two may go either way, and so
# on in each frame. Else float32 against float64.
TOLERANCE = 4 / 32768


def views(rng, size=(40, 70), count=5) -> list[WarpedFrame]:
    """Holes of two depths that move by parts of a pixel, other ones each time."""
    height, width = size
    blocks = rng.integers(0, 2, (height // 8 + 1, width // 8 + 1))
    which = np.kron(blocks, np.ones((8, 8), int))[:height, :width]
    motion = rng.uniform(-2, 2, (2, 2))
    made = []
    for k in range(count):
        hole = np.kron(rng.random((5, 9)) < 0.4, np.ones((8, 8), bool))[:height, :width]
        colour = np.where(hole[..., None], 0, rng.random((*size, 3))).astype(np.float32)
        depth = np.float32([2, 5])[which]
        flow = np.rint(256 * k * motion)[which] / 256
        made.append(WarpedFrame(colour, depth, hole, flow.astype(np.float32)))
    return made


def test_gpu_and_reference_show_the_same(module_gl_context, rng):
    method = create_method("weighted-pull-push", module_gl_context, {"recirculate": WEIGHT})
    reference, plate = recirculating(WEIGHT), method.new_plate()
    changed = 0
    for frame in views(rng):
        own = method.fill(frame, 0)
        expected = reference.fill(frame)
        textures = FrameTextures.of(module_gl_context, frame)
        plate.fill_textures(textures, 0)
        texels = read_back(textures.colour)
        np.testing.assert_allclose(texels[..., :3], expected, atol=TOLERANCE)
        assert texels[~frame.hole, :3].tobytes() == frame.colour[~frame.hole].tobytes()
        np.testing.assert_array_equal(texels[..., 3] == 0, frame.hole)
        changed += (np.abs(expected - own) > 10 * TOLERANCE).any(axis=-1).sum()
        textures.release()
    plate.release()
    method.release()
    assert changed > 500


def test_a_size_after_another_is_filled_too(module_gl_context, rng):
    method = create_method("weighted-pull-push", module_gl_context, {"recirculate": WEIGHT})
    for size in ((40, 70), (24, 30)):
        plate, reference = method.new_plate(), recirculating(WEIGHT)
        for frame in views(rng, size, 2):
            textures = FrameTextures.of(module_gl_context, frame)
            plate.fill_textures(textures, 0)
            expected = reference.fill(frame)
            shown = read_back(textures.colour)[..., :3]
            np.testing.assert_allclose(shown, expected, atol=TOLERANCE)
            textures.release()
        plate.release()
    method.release()
