"""The printed method against values worked by hand and against what the paper asks for."""

import numpy as np
import pytest

from pipeline.colour import ycbcr_from_rgb
from pipeline.errors import InputError
from pipeline.features.reference import analyse, fitted_kernels, halve
from pipeline.frame import WarpedFrame
from pipeline.inpaint.reference import GuidedLevel, pull
from pipeline.printed.reference import (
    TILE,
    PrintedSettings,
    at_pixels,
    features,
    half,
    inpainted,
    noise_texels,
    printed_fill,
    printed_noise,
    push,
)
from pipeline.synthesis.settings import ANCHOR_REACH_PX


def warped(colour, hole, depth_m=4.0, flow_px=(0, 0)) -> WarpedFrame:
    """Make a frame whose depth and motion are the same everywhere, unless given per pixel."""
    depth = np.broadcast_to(np.float32(depth_m), hole.shape).copy()
    flow = np.broadcast_to(np.float32(flow_px), (*hole.shape, 2)).copy()
    return WarpedFrame(np.float32(np.where(hole[..., None], 0, colour)), depth, hole, flow)


def fill(frame: WarpedFrame, seed: int = 1, **settings):
    return printed_fill(frame, PrintedSettings(**settings), seed=seed, z_near_m=1.0)


def test_push_mixes_by_validity_to_the_power_gamma():
    """By hand: a coarse pixel of 8 below four of 2, at validities 1, 1/4, 0 and "only nearer"."""
    validity = np.array([[1.0, 0.25], [0.0, -1.0]])
    fine = GuidedLevel(np.full((2, 2, 1), 2.0), validity, np.ones((2, 2)))
    below = np.full((1, 1, 1), 8.0)
    for gamma, quarter in ((0.0, 2.0), (0.5, 5.0), (1.0, 6.5)):
        np.testing.assert_allclose(
            push(fine, below, gamma)[..., 0], [[2.0, quarter], [8.0, 8.0]], rtol=1e-15
        )


def test_pull_leaves_out_what_is_nearer_than_the_farthest_by_more_than_the_threshold():
    """By hand: depth's sense is the reverse of Alg. 1's, and the mean is divided by weights."""
    guide = np.array([[0.50, 0.53], [0.20, 0.51]])
    fine = GuidedLevel(
        np.array([[1.0, 2.0], [100.0, 9.0]])[..., None], np.array([[1, 0.5], [1, 0]]), guide
    )
    coarse = pull(fine, 0.04)
    assert coarse.values.item() == pytest.approx((1 * 1 + 0.5 * 2) / 1.5)
    assert coarse.validity.item() == pytest.approx(1.5 / 4)
    assert coarse.guide.item() == 0.53


def test_the_low_pass_averages_only_what_is_known(rng):
    low, known = rng.random((12, 15, 3)), rng.random((12, 15)) < 0.6
    state, guide = known.astype(np.float64), np.zeros((12, 15))
    values, ahead, _ = half(low, state, guide)
    other, _, _ = half(np.where(known[..., None], low, 7.0), state, guide)

    np.testing.assert_array_equal(values, other)
    inside, shown = low[known], values[ahead != 0]
    assert (shown >= inside.min()).all()
    assert (shown <= inside.max()).all()
    everything, _, _ = half(low, np.ones_like(state), guide)
    np.testing.assert_allclose(everything, halve(low), rtol=1e-12)


def test_a_pixel_of_the_next_level_is_known_if_all_that_it_covers_is():
    """By hand: all of four known, some, none; and a pixel at an odd border covers itself alone."""
    state = np.array([[1, 1, 1, 0, 0, 0, 1], [1, 1, 1, 1, 0, 0, 1]], float)
    _, ahead, guide = half(np.zeros((2, 7, 3)), state, np.arange(14.0).reshape(2, 7) / 14)
    np.testing.assert_array_equal(ahead, [[1, -1, 0, 1]])
    np.testing.assert_allclose(guide, [[8 / 14, 10 / 14, 12 / 14, 13 / 14]])


def test_a_frame_without_holes_is_measured_as_its_pyramid(rng):
    colour = rng.random((33, 41, 3))
    found = fill(warped(colour, np.zeros((33, 41), bool)), levels=3)

    pyramid = analyse(ycbcr_from_rgb(np.float32(colour).astype(np.float64)), 3)
    interior = slice(8, -8)  # the reach of holes; there are none, but borders may differ
    for level in range(3):
        cut = slice(interior.start >> level, interior.stop >> level)
        np.testing.assert_allclose(
            found.means[level][cut, cut], pyramid.bands[level][cut, cut], atol=1e-12
        )
        np.testing.assert_allclose(found.deviations[level], 0, atol=1e-7)
    np.testing.assert_allclose(found.residual, pyramid.residual, atol=1e-12)


def test_statistics_do_not_depend_on_what_a_hole_holds(rng):
    low, known = rng.random((16, 16, 3)), rng.random((16, 16)) < 0.8
    state = known.astype(np.float64)
    np.testing.assert_array_equal(
        features(low, state), features(np.where(known[..., None], low, -3.0), state)
    )


def test_a_hole_takes_its_statistics_from_what_lies_at_its_depth(rng):
    """Red at 1 m beside a hole whose depth is that of the grey at 10 m on its other side."""
    colour = np.full((64, 96, 3), 0.5) + rng.uniform(-0.2, 0.2, (64, 96, 1))
    colour[:, :40] = (0.9, 0.1, 0.1)
    depth = np.full((64, 96), 10.0)
    depth[:, :40] = 1.0
    hole = np.zeros((64, 96), bool)
    hole[:, 40:52] = True

    reds = [
        fill(warped(colour, hole, depth), depth_threshold=threshold).colour[hole][:, 0].mean()
        for threshold in (0.04, 1.0)
    ]

    # What is left comes in with the residual, which is interpolated across the edge as printed.
    assert reds[0] < 0.6 < 0.65 < reds[1]


def test_a_hole_behind_everything_known_is_filled_by_what_is_nearer():
    """Printed, its pull would find no valid child at any level, and it would be black."""
    hole = np.zeros((32, 32), bool)
    hole[12:20, 12:20] = True
    found = fill(warped(np.full((32, 32, 3), 0.6), hole, np.where(hole, 100.0, 2.0)))
    np.testing.assert_allclose(found.colour[hole], 0.6, atol=1e-6)


def test_a_constant_stays_constant():
    hole = np.zeros((24, 40), bool)
    hole[5:19, 9:30] = True
    found = fill(warped(np.full((24, 40, 3), (0.2, 0.5, 0.8)), hole))
    np.testing.assert_allclose(found.colour, np.full((24, 40, 3), (0.2, 0.5, 0.8)), atol=1e-6)


def test_gamma_decides_how_far_statistics_spread():
    """A bright dot of detail beside a hole: gamma 0 keeps it near, gamma 1 spreads it."""
    level = GuidedLevel(np.zeros((16, 16, 1)), np.zeros((16, 16)), np.ones((16, 16)))
    level.validity[:, 0] = 1
    level.values[:8, 0] = 1.0
    near, far = (inpainted(level, gamma, 0.04)[..., 0] for gamma in (0.0, 1.0))
    assert near[:8, 1].mean() - near[8:, 1].mean() > far[:8, 1].mean() - far[8:, 1].mean()
    for values in (near, far):
        assert values.min() >= 0
        assert values.max() <= 1


def test_noise_has_bands_of_unit_variance_and_independent_channels():
    """As coefficients; and as full-size images they are zero on average."""
    noise = printed_noise(3, 3)
    assert noise.shape == (3, TILE, TILE, 3, 3)
    wide = np.pad(noise[0, :, :, 0].astype(np.float64), ((8, 8), (8, 8), (0, 0)), mode="wrap")
    kernel = fitted_kernels().high
    # The finest high band, filtered once: what is left of unit coefficients after their filter.
    coefficients = analyse(wide, 1).bands[0][8:-8, 8:-8, 0]
    spectrum = abs(np.fft.fft2(kernel, (TILE, TILE))) ** 2
    # White noise of variance v has band variance v mean(|K|^2) = 1; twice more filtered:
    expected = (spectrum**3).mean() / spectrum.mean()
    assert coefficients.var() == pytest.approx(expected, rel=0.02)
    flat = noise.reshape(3, -1, 3, 3).astype(np.float64)
    for level in range(3):
        for band in range(3):
            assert abs(flat[level, :, band].mean(axis=0)).max() < 1e-3
            correlation = np.corrcoef(flat[level, :, band].T)
            # A level's coefficients are 4^level fewer, and neighbours are alike.
            assert abs(correlation - np.eye(3)).max() < 5 * 2**level * 2 / TILE


def test_noise_is_periodic():
    """Across the seam, where two coarse pixels meet, it steps as wherever two meet."""
    noise = printed_noise(3, 4)[3, :, :, 0, 0].astype(np.float64)
    rows = np.sqrt(((noise - np.roll(noise, 1, axis=0)) ** 2).mean(axis=1))[::8]
    assert rows[0] < 1.5 * rows[1:].mean()


def test_noise_moves_with_the_background_by_whole_pixels():
    still, moved = (
        noise_texels(np.full((9, 11, 2), flow, np.float32)) for flow in ((0, 0), (5, -3))
    )
    for axis, by in ((0, -3), (1, 5)):
        np.testing.assert_array_equal((moved[axis] + by) % TILE, still[axis])
    part = noise_texels(np.full((9, 11, 2), 0.4, np.float32))
    np.testing.assert_array_equal(part[0], still[0])  # the nearest texel is still the same
    far = noise_texels(np.full((9, 11, 2), 2 * ANCHOR_REACH_PX, np.float32))
    np.testing.assert_array_equal(far[1], still[1])


def test_a_fill_moves_with_a_translating_background(rng):
    """No screen door: what was filled at a place is filled again where that place went."""
    colour = rng.random((64, 160, 3))
    hole = np.zeros((64, 160), bool)
    hole[:, 64:80] = True
    first = fill(warped(colour, hole))
    later = fill(warped(np.roll(colour, 16, axis=1), np.roll(hole, 16, axis=1), flow_px=(16, 0)))
    # Statistics change a little with the place in the frame, where levels are cut off.
    moved = later.colour[8:-8, 80:96] - first.colour[8:-8, 64:80]
    assert abs(moved).mean() < 0.01
    stuck = fill(warped(np.roll(colour, 16, axis=1), np.roll(hole, 16, axis=1)))
    assert abs(stuck.colour[8:-8, 80:96] - first.colour[8:-8, 64:80]).mean() > 0.1


@pytest.mark.parametrize("exponent", [0.0, 1.0])
def test_a_hole_gets_texture_of_the_right_strength(rng, exponent):
    """Of stationary noise 1 / f^e, without corrections for how bands overlap."""
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(256), np.fft.fftfreq(256)))
    frequency[0, 0] = 1
    spectrum = np.fft.fft2(rng.standard_normal((256, 256, 3)), axes=(0, 1))
    texture = np.fft.ifft2(spectrum / frequency[..., None] ** exponent, axes=(0, 1)).real
    colour = 0.5 + 0.08 * texture / texture.std()
    hole = np.zeros((256, 256), bool)
    hole[80:176, 90:160] = True

    found = fill(warped(colour, hole))

    for level, (mine, theirs) in enumerate(
        zip(*(analyse(one, 3).bands for one in (found.colour, colour)), strict=True)
    ):
        inside = slice(96 >> level, 160 >> level), slice(104 >> level, 146 >> level)
        ratio = mine[inside].std(axis=(0, 1)) / theirs.std(axis=(0, 1))
        assert ratio.min() > 0.5, (level, ratio)
        assert ratio.max() < 2.0, (level, ratio)


def test_interpolation_at_pixels_is_exact_on_a_ramp():
    ramp = np.arange(8.0)[:, None] * np.ones((1, 8))
    found = at_pixels(ramp[..., None], (32, 32), 2)[..., 0]
    np.testing.assert_allclose(found[2:-2, 5], (np.arange(32) + 0.5)[2:-2] / 4 - 0.5)


def test_seeds_and_settings_are_checked(rng):
    hole = np.zeros((8, 8), bool)
    hole[2:4] = True
    frame = warped(rng.random((8, 8, 3)), hole)
    assert not np.array_equal(fill(frame, 1).colour, fill(frame, 2).colour)
    with pytest.raises(InputError, match="seed must be a whole number"):
        fill(frame, -1)
    with pytest.raises(InputError, match="known"):
        fill(warped(rng.random((8, 8, 3)), np.ones((8, 8), bool)))
    for settings, said in (
        ({"levels": 0}, "levels"),
        ({"gamma": -1.0}, "gamma must lie in 0..8"),
        ({"depth_threshold": 0.0}, "depth_threshold must lie in"),
    ):
        with pytest.raises(InputError, match=said):
            PrintedSettings(**settings)
