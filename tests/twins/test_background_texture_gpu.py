"""Texture from the background itself: the GPU against the definition."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from benchmarks.dispatches import dispatches_of
from pipeline.background_texture.reference import texture_origins
from pipeline.frame import WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.gl.texture import read_back
from pipeline.inpaint.reference import guide_from_depth
from pipeline.synthesis.gpu import MetamericPass
from pipeline.synthesis.reference import metameric_fill
from pipeline.synthesis.settings import MetamericSettings

Z_NEAR_M = 1.0
BACKGROUND = MetamericSettings(texture="background", levels=3)
# From end to end: a sixteenth of an 8-bit step. What is added is a gain, the root of a
# difference that may be small, times a detail that few roundings reach.
WHOLE_ATOL = 2.0**-12


def disc_scene(rng, size, motion_px):
    """A disc that moved in front of a texture; motion in 256ths of a pixel, as warped."""
    height, width = size
    y, x = np.mgrid[:height, :width] + 0.5
    radius = 0.2 * min(size)
    disc = np.hypot(x - 0.6 * width, y - 0.5 * height) < radius
    was = np.hypot(x - 0.6 * width + 0.7 * radius, y - 0.5 * height) < radius
    colour = np.where(disc[..., None], [0.9, 0.1, 0.1], rng.uniform(0.2, 0.8, (*size, 3)))
    moved = (np.round(0.7 * radius), 0)
    flow = np.where(disc[..., None], moved, 0.0) + np.round(256 * np.array(motion_px)) / 256
    return WarpedFrame(
        colour.astype(np.float32),
        np.where(disc, 2.0, 5.0).astype(np.float32),
        was & ~disc,
        flow.astype(np.float32),
    )


def gpu_fill(ctx, warped, settings=BACKGROUND, seed=1):
    filler = MetamericPass(ctx, (warped.size[1], warped.size[0]), settings)
    inputs = FrameTextures.of(ctx, warped)
    filler(inputs, z_near_m=Z_NEAR_M, seed=seed)
    filled = read_back(inputs.colour)[..., :3]
    filler.release()
    inputs.release()
    return filled


@pytest.mark.parametrize("motion_px", [(0.0, 0.0), (4.3, -2.6)])
@pytest.mark.parametrize("size", [(96, 128), (61, 83)])
def test_fill_on_gpu_matches_reference(gl_context, rng, size, motion_px):
    warped = disc_scene(rng, size, motion_px)
    expected = metameric_fill(warped, BACKGROUND, seed=1, z_near_m=Z_NEAR_M).colour
    assert texture_origins(warped, guide_from_depth(warped.depth_m, Z_NEAR_M), 0.04)[1].any()

    filled = gpu_fill(gl_context, warped)

    np.testing.assert_allclose(filled, expected, rtol=0, atol=WHOLE_ATOL)
    np.testing.assert_array_equal(filled[~warped.hole], warped.colour[~warped.hole])


def test_independent_channels_match_too(gl_context, rng):
    warped = disc_scene(rng, (64, 96), (1.0, 0.0))
    settings = replace(BACKGROUND, channels="independent", levels=2)
    expected = metameric_fill(warped, settings, seed=1, z_near_m=Z_NEAR_M).colour

    filled = gpu_fill(gl_context, warped, settings)

    np.testing.assert_allclose(filled, expected, rtol=0, atol=WHOLE_ATOL)


@pytest.mark.parametrize("motion_px", [(0.0, 0.0), (-3.4, 7.1)])
def test_origins_on_gpu_are_the_references(gl_context, rng, motion_px):
    """Exactly: places are whole pixels, motion whole 256ths, and all fit float32."""
    warped = disc_scene(rng, (96, 128), motion_px)
    warped = replace(warped, hole=warped.hole | (np.arange(128) >= 120))  # and at the border
    origin_px, found = texture_origins(warped, guide_from_depth(warped.depth_m, Z_NEAR_M), 0.04)
    filler = MetamericPass(gl_context, (128, 96), BACKGROUND)
    inputs = FrameTextures.of(gl_context, warped)
    filler(inputs, z_near_m=Z_NEAR_M, seed=1)
    ours = read_back(filler.origin_px)
    filler.release()
    inputs.release()

    np.testing.assert_array_equal(ours[warped.hole][:, 0] >= 0, found[warped.hole])
    np.testing.assert_array_equal(ours[found], origin_px[found].astype(np.float32))


def test_two_runs_are_bit_identical_and_the_seed_only_matters_for_noise(gl_context, rng):
    warped = disc_scene(rng, (96, 128), (0.5, 0.25))
    found = texture_origins(warped, guide_from_depth(warped.depth_m, Z_NEAR_M), 0.04)[1]
    first, again = gpu_fill(gl_context, warped), gpu_fill(gl_context, warped)
    other = gpu_fill(gl_context, warped, seed=2)

    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first[found], other[found])


def test_without_background_in_reach_the_gpu_keeps_to_noise(gl_context, rng):
    warped = disc_scene(rng, (64, 96), (0.0, 0.0))
    closed_in = replace(warped, depth_m=np.where(warped.hole, 5.0, 2.0).astype(np.float32))
    noise = gpu_fill(gl_context, closed_in, replace(BACKGROUND, texture="noise"))

    np.testing.assert_array_equal(gpu_fill(gl_context, closed_in), noise)


@pytest.mark.parametrize("by", [1, 3, 8])
def test_texture_moves_with_the_background(gl_context, rng, by):
    """White noise would alias in the pyramid; photographs and this texture do not."""
    warped = disc_scene(rng, (96, 128), (0.0, 0.0))
    smooth = 0.5 + 2 * (ndimage.gaussian_filter(warped.colour, (1.5, 1.5, 0)) - 0.5)
    in_front = (warped.depth_m < 3)[..., None]
    colour = np.where(in_front, warped.colour, smooth.clip(0, 1)).astype(np.float32)
    warped = replace(warped, colour=colour)
    moved = WarpedFrame(
        *(np.roll(array, by, axis=1) for array in (warped.colour, warped.depth_m, warped.hole)),
        np.roll(warped.flow_px, by, axis=1) + np.array([by, 0], np.float32),
    )

    def detail(frame):
        return gpu_fill(gl_context, frame) - gpu_fill(gl_context, frame, without)

    without = replace(BACKGROUND, noise=0.0)
    here = detail(warped)[warped.hole].ravel()
    along = np.roll(detail(moved), -by, axis=1)[warped.hole].ravel()

    assert np.corrcoef(here, along)[0, 1] > 0.9


def test_only_this_texture_costs_two_dispatches(gl_context):
    """To look for it, and to halve the frame once more: of three levels to 8x6 texels."""
    passes = [
        MetamericPass(gl_context, (64, 48), replace(BACKGROUND, texture=texture))
        for texture in ("noise", "background")
    ]
    noise, background = passes
    frame = FrameTextures.create(gl_context, (64, 48))
    cheap, dear = (
        dispatches_of(lambda one=one: one(frame, z_near_m=1.0, seed=0)) for one in passes
    )
    frame.release()

    assert len(dear) == len(cheap) + 2
    assert background.held_bytes == noise.held_bytes + 8 * 64 * 48 + 16 * 8 * 6
    for item in passes:
        item.release()
