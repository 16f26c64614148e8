"""The plate of fills on the GPU against its definition: the same bits."""

import numpy as np
import pytest

from pipeline.frame import WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.gl.texture import read_back
from pipeline.plate.gpu import PlatePass, PlateTextures
from pipeline.plate.reference import KeptFills

THRESHOLD = 0.04
SIZE = 40, 70


class Filler:
    """Fills by noise, and notes what it was asked for."""

    def __init__(self, rng) -> None:
        self._colours = [rng.random((*SIZE, 3), np.float32) for _ in range(5)]
        self.asked: list[np.ndarray] = []  # holes

    def arrays(self, frame: WarpedFrame, *_: object) -> np.ndarray:
        self.asked.append(frame.hole)
        return np.where(frame.hole[..., None], self._colours[len(self.asked) - 1], frame.colour)

    def textures(self, frame: FrameTextures) -> None:
        texels = read_back(frame.colour)
        texels[..., :3] = self.arrays(frame.read_back())
        frame.colour.write(texels.tobytes())


@pytest.fixture(scope="module")
def plates(module_gl_context):
    made = PlatePass(module_gl_context, SIZE[::-1], THRESHOLD)
    yield made
    made.release()


def views(rng, size=SIZE, count=5) -> list[WarpedFrame]:
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
    seed = int(rng.integers(1 << 30))
    mine, theirs = (Filler(np.random.default_rng(seed)) for _ in range(2))
    reference = KeptFills(mine.arrays, THRESHOLD)
    plate = PlateTextures(
        module_gl_context, lambda frame, kept, _: plates(frame, kept, theirs.textures)
    )
    kept = 0
    for view in views(rng):
        textures = FrameTextures.of(module_gl_context, view)
        plate.fill_textures(textures, 0)
        texels = read_back(textures.colour)
        assert texels[..., :3].tobytes() == reference.fill(view).tobytes()
        np.testing.assert_array_equal(texels[..., 3] == 0, view.hole)
        np.testing.assert_array_equal(theirs.asked[-1], mine.asked[-1])
        kept += int((view.hole & ~mine.asked[-1]).sum())
        textures.release()
    plate.release()
    assert kept > 500


def test_each_source_has_a_plate_of_its_own(module_gl_context, plates, rng):
    filler = Filler(rng)
    made = []
    for view in views(rng, count=2):
        made.append(
            PlateTextures(
                module_gl_context, lambda frame, kept, _: plates(frame, kept, filler.textures)
            )
        )
        textures = FrameTextures.of(module_gl_context, view)
        made[-1].fill_textures(textures, 0)
        np.testing.assert_array_equal(filler.asked[-1], view.hole)  # nothing was kept
        textures.release()
        made[-1].release()
    assert not made[0].held
