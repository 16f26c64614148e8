"""The plate of `shift-map` on the GPU against its definition: the same bits."""

import numpy as np
import pytest

from pipeline.frame import WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.gl.texture import read_back
from pipeline.shiftmap.plate import ShiftMapPlate
from pipeline.shiftmap.plate_gpu import PlatePass

THRESHOLD = 0.04


@pytest.fixture(scope="module")
def plates(module_gl_context):
    made = PlatePass(module_gl_context, THRESHOLD)
    yield made
    made.release()


def views(rng, size=(40, 70), count=5) -> list[WarpedFrame]:
    """Blocks of holes of a few depths, infinity too, that move by parts of a pixel."""
    height, width = size
    blocks = rng.integers(0, 4, (height // 8 + 1, width // 8 + 1))
    which = np.kron(blocks, np.ones((8, 8), int))[:height, :width]
    motion = rng.uniform(-2, 2, (4, 2))
    made = []
    for k in range(count):
        hole = which == rng.integers(0, 4)
        hole |= rng.random(size) < 0.2
        depth = np.float32([2, 2.05, 5, np.inf])[which] * np.float32(1 + 0.01 * k)
        flow = (k * motion)[which] + rng.integers(-60, 60, (*size, 2)) / 256
        flow[:3] += 50  # beyond the margin
        colour = rng.random((*size, 3), np.float32)
        made.append(WarpedFrame(colour, depth, hole, flow.astype(np.float32)))
    return made


def test_gpu_and_reference_have_the_same_bits(module_gl_context, plates, rng):
    reference, plate = ShiftMapPlate(THRESHOLD), plates.new_plate()
    taken = 0
    for view in views(rng):
        filled = np.where(view.hole[..., None], rng.random(view.colour.shape), view.colour)
        filled = filled.astype(np.float32)
        expected = reference.settle(view, filled)
        textures = FrameTextures.of(module_gl_context, view)
        textures.colour.write(np.dstack([filled, ~view.hole]).astype(np.float32).tobytes())
        plate.settle_textures(textures)
        texels = read_back(textures.colour)
        assert texels[..., :3].tobytes() == expected.tobytes()
        np.testing.assert_array_equal(texels[..., 3] == 0, view.hole)
        taken += (expected != filled).any(axis=-1).sum()
        textures.release()
    plate.release()
    assert taken > 500


def test_each_source_has_a_plate_of_its_own(module_gl_context, plates, rng):
    first, second = plates.new_plate(), plates.new_plate()
    a, b = views(rng, count=2)
    for plate, view in ((first, a), (second, b)):
        textures = FrameTextures.of(module_gl_context, view)
        before = read_back(textures.colour)
        plate.settle_textures(textures)
        assert read_back(textures.colour).tobytes() == before.tobytes()  # nothing was kept
        textures.release()
        plate.release()
    assert not first.held
