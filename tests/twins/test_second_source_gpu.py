"""A frame completed from a second one, on the GPU and as it is defined."""

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.warp.gpu import CompletePass
from pipeline.warp.reference import completed


def frame(rng, height=11, width=19):
    hole = rng.random((height, width)) < 0.4
    colour = rng.random((height, width, 3), np.float32)
    colour[hole] = 0
    depth_m = 1 + rng.random((height, width), np.float32)
    flow_px = rng.standard_normal((height, width, 2)).astype(np.float32)
    return WarpedFrame(colour, depth_m, hole, flow_px)


def test_each_pixel_comes_from_the_first_frame_that_knows_it(rng):
    first, second = frame(rng), frame(rng)
    result = completed(first, second)

    for name in ("colour", "depth_m", "flow_px"):
        found, one, two = (getattr(item, name) for item in (result, first, second))
        assert np.array_equal(found[~first.hole], one[~first.hole])
        taken = first.hole & ~second.hole
        assert np.array_equal(found[taken], two[taken])
        neither = first.hole & second.hole
        assert np.array_equal(found[neither], one[neither])
    assert np.array_equal(result.hole, first.hole & second.hole)


def test_frames_of_two_sizes_are_refused(rng):
    with pytest.raises(InputError, match="second"):
        completed(frame(rng), frame(rng, width=20))


def test_the_gpu_gives_the_same_bits(gl_context, rng):
    first, second = frame(rng), frame(rng)
    textures = [FrameTextures.create(gl_context, (19, 11)) for _ in range(2)]
    for one, array in zip(textures, (first, second), strict=True):
        one.upload(array)
    complete = CompletePass(gl_context)
    complete(*textures)

    found, wanted = textures[0].read_back(), completed(first, second)
    for name in ("colour", "depth_m", "flow_px", "hole"):
        assert np.array_equal(getattr(found, name), getattr(wanted, name)), name
    for item in (*textures, complete):
        item.release()
