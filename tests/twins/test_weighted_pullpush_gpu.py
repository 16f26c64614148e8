"""Weighted pull-push on the GPU does what its definition says."""

import numpy as np
import pytest

from benchmarks.shared.dispatches import dispatches_of
from pipeline.errors import InputError
from pipeline.gl.texture import create_texture, read_back, texture_from
from pipeline.pushpull.gpu import WeightedPullPushPass
from pipeline.pushpull.reference import weighted_pull_push

UNIT = 2.0**-24  # float32 rounding
# Roundings that one level adds to a colour in [0, 1]. Reduce: square 1, weigh 1, sum 3 above and
# 3 below the line, divide 5 (GLSL allows 2.5 ulp). Expand: interpolate 4, blend 3, and the share
# 1 + 1 + 5; a share's error moves the colour by at most itself. That is 27.
# Weights carry relative errors of 4 (mean) and 8 (interpolated, blended) per level, which enter
# the squares of both stages twice: another 2 x 2 x 12.
PER_LEVEL = (27 + 48) * UNIT


def run(ctx, image):
    height, width, _ = image.shape
    passes = WeightedPullPushPass(ctx, (width, height))
    source = texture_from(ctx, image, "rgba32f")
    target = create_texture(ctx, (width, height), "rgba32f")
    try:
        passes(source, target)
        apart = read_back(target)
        passes(source, source)
        in_place = read_back(source)
    finally:
        for thing in (passes, source, target):
            thing.release()
    np.testing.assert_array_equal(apart, in_place)
    return apart[..., :3]


@pytest.mark.parametrize("size", [(64, 96), (33, 47), (1, 7), (5, 1), (1, 1)])
@pytest.mark.parametrize("known_share", [0.05, 0.5, 1.0])
def test_gpu_matches_reference(gl_context, rng, size, known_share):
    image = rng.random((*size, 4), dtype=np.float32)
    image[..., 3] = rng.choice(np.float32([0.25, 1, 16]), size)
    image[rng.random(size) >= known_share, 3] = 0
    image[0, 0, 3] = 1
    levels = int(np.ceil(np.log2(max(size)))) + 1

    filled = run(gl_context, image)

    np.testing.assert_allclose(filled, weighted_pull_push(image), atol=levels * PER_LEVEL, rtol=0)


def test_known_pixels_that_weigh_the_same_stay_bit_for_bit(gl_context, rng):
    image = rng.random((40, 56, 4), dtype=np.float32)
    known = rng.random((40, 56)) < 0.5
    image[..., 3] = known

    np.testing.assert_array_equal(run(gl_context, image)[known], image[known][:, :3])


def test_dispatches_are_twice_the_levels(gl_context):
    passes = WeightedPullPushPass(gl_context, (64, 48))
    image = create_texture(gl_context, (64, 48), "rgba32f")
    try:
        assert len(dispatches_of(lambda: passes(image, image))) == 12
    finally:
        passes.release()
        image.release()


def test_textures_of_another_size_or_format_are_refused(gl_context):
    passes = WeightedPullPushPass(gl_context, (8, 8))
    small = create_texture(gl_context, (4, 8), "rgba32f")
    half = create_texture(gl_context, (8, 8), "rgba16f")
    good = create_texture(gl_context, (8, 8), "rgba32f")
    try:
        for wrong in (small, half):
            with pytest.raises(InputError, match="image must be"):
                passes(wrong, good)
            with pytest.raises(InputError, match="filled must be"):
                passes(good, wrong)
    finally:
        for thing in (passes, small, half, good):
            thing.release()
