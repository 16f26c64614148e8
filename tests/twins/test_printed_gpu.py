"""The printed method on the GPU against its definition."""

from dataclasses import replace

import moderngl
import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.gl.texture import create_texture, read_back, upload
from pipeline.printed.gpu import PrintedPass
from pipeline.printed.reference import PrintedSettings, printed_fill

# A deviation is the root of a difference of two moments, E[X^2] - E[X]^2, each below 1/2 and
# off by some 8 roundoffs of 2^-24 (a band's 9 taps, a square, the chain's means). Where the true
# variance is 0 the root is off by 2^-10.7; three bands of four levels carry noise of up to 4 of it.
WORST_ATOL = 2.0**-10.7 * 12 * 4
# Elsewhere the relative error is that of the moments.
USUAL_ATOL = 2.0**-16
USUAL_SHARE = 0.99


def frame(rng, height: int, width: int) -> WarpedFrame:
    """Blocks at four depths before a textured wall, with holes between them and in the wall."""
    colour = rng.random((height, width, 3)).astype(np.float32)
    depth = np.full((height, width), 9.0, np.float32)
    hole = np.zeros((height, width), bool)
    for metres in (1.0, 1.7, 3.0):
        top, left = rng.integers(0, height), rng.integers(0, width)
        tall, wide = rng.integers(1, 2 + height // 2), rng.integers(1, 2 + width // 2)
        depth[top : top + tall, left : left + wide] = metres
        hole[top : top + tall, left + wide : left + 2 * wide] = True
    depth[hole] = 9.0
    hole[0, 0] = False
    colour[hole] = 0
    flow = (6 * rng.standard_normal((height, width, 2))).astype(np.float32)
    return WarpedFrame(colour, depth, hole, flow)


def run(
    ctx: moderngl.Context, warped: WarpedFrame, settings: PrintedSettings, seed: int = 1
) -> np.ndarray:
    height, width = warped.size
    known = (~warped.hole).astype(np.float32)[..., None]
    filler = PrintedPass(ctx, (width, height), settings)
    textures = FrameTextures.of(ctx, warped)
    # What the array holds inside holes goes up too: no pass may read it.
    upload(textures.colour, np.concatenate([warped.colour, known], axis=-1))
    filler(textures, z_near_m=1.0, seed=seed)
    found = read_back(textures.colour)
    for resource in (textures, filler):
        resource.release()
    np.testing.assert_array_equal(found[..., 3], known[..., 0])
    return found[..., :3]


@pytest.mark.parametrize("size", [(1, 1), (1, 23), (19, 1), (2, 2), (33, 47), (64, 96)])
@pytest.mark.parametrize(
    "settings", [PrintedSettings(), PrintedSettings(1, 0.0), PrintedSettings(6, 1.0, 0.3)]
)
def test_gpu_matches_reference(gl_context, rng, size, settings):
    warped = frame(rng, *size)
    found = run(gl_context, warped, settings)
    expected = printed_fill(warped, settings, seed=1, z_near_m=1.0).colour

    np.testing.assert_array_equal(found[~warped.hole], warped.colour[~warped.hole])
    error = abs(found - expected)[warped.hole]
    assert error.size == 0 or error.max() <= WORST_ATOL
    assert error.size == 0 or (error <= USUAL_ATOL).mean() >= USUAL_SHARE


def test_another_seed_gives_other_noise_and_the_first_comes_back(gl_context, rng):
    warped = frame(rng, 33, 47)
    filler = PrintedPass(gl_context, (47, 33), PrintedSettings())
    results = []
    for seed in (1, 2, 1):
        textures = FrameTextures.of(gl_context, warped)
        filler(textures, z_near_m=1.0, seed=seed)
        results.append(read_back(textures.colour))
        textures.release()
    filler.release()
    np.testing.assert_array_equal(results[0], results[2])
    assert (results[0] != results[1]).any(axis=-1)[warped.hole].all()


@pytest.mark.parametrize("size", [(1, 1), (40, 24), (200, 100)])
def test_a_pass_says_what_it_holds(gl_context, size):
    filler = PrintedPass(gl_context, size, PrintedSettings())
    textures = FrameTextures.create(gl_context, size)
    filler(textures, z_near_m=1.0, seed=0)
    assert filler.held_bytes > 100 * size[0] * size[1]
    for resource in (textures, filler):
        resource.release()


def test_textures_of_another_size_or_format_are_refused(gl_context):
    filler = PrintedPass(gl_context, (8, 6), PrintedSettings())
    right = FrameTextures.create(gl_context, (8, 6))
    small = create_texture(gl_context, (7, 6), "r32f")
    with pytest.raises(InputError, match=r"depth_m must be 8x6 r32f"):
        filler(replace(right, depth_m=small), z_near_m=1.0, seed=0)
    with pytest.raises(InputError, match="seed must be a whole number"):
        filler(right, z_near_m=1.0, seed=-1)
    for resource in (right, small, filler):
        resource.release()


def test_a_frame_that_needs_wider_textures_than_there_are_is_refused(gl_context):
    limit = gl_context.info["GL_MAX_TEXTURE_SIZE"]
    with pytest.raises(InputError, match=r"texture edges must lie in"):
        PrintedPass(gl_context, (limit // 3 + 1, 1), PrintedSettings())
