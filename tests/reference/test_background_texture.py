"""Texture from the background itself: where it comes from, and what it does to a fill."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.background_texture.reference import STEPS_PX, details, sample_image, texture_origins
from pipeline.colour import ycbcr_from_rgb
from pipeline.errors import InputError
from pipeline.features.reference import halve
from pipeline.frame import WarpedFrame
from pipeline.inpaint.reference import guide_from_depth
from pipeline.statistics.lacking import detail_gain
from pipeline.synthesis.reference import metameric_fill
from pipeline.synthesis.settings import MetamericSettings

THRESHOLD = 0.04
Z_NEAR_M = 1.0
BACKGROUND = MetamericSettings(texture="background", levels=3)


def uncovered(plane, *, background_px=(0.0, 0.0), front=(0.9, 0.1, 0.1)):
    """Show `plane` with a hole in columns 48 to 57, opened by what stands right of it.

    The front, columns 58 to 67, has moved 12 px to the right relative to the plane.
    """
    height, width = plane.shape[:2]
    column = np.broadcast_to(np.arange(width), (height, width))
    hole = (column >= 48) & (column < 58)
    in_front = (column >= 58) & (column < 68)
    colour = np.where(in_front[..., None], front, np.where(hole[..., None], 0.0, plane))
    relative = np.where(in_front[..., None], (12.0, 0.0), 0.0)
    return WarpedFrame(
        colour.astype(np.float32),
        np.where(in_front, 2.0, 5.0).astype(np.float32),
        hole,
        (relative + background_px).astype(np.float32),
    )


def grey(rng, size=(48, 96)):
    return np.repeat(rng.uniform(0.2, 0.8, (*size, 1)), 3, axis=2)


def origins(warped):
    return texture_origins(warped, guide_from_depth(warped.depth_m, Z_NEAR_M), THRESHOLD)


def fill(warped, settings=BACKGROUND, seed=1):
    return metameric_fill(warped, settings, seed=seed, z_near_m=Z_NEAR_M)


def test_the_first_pixel_of_the_frame_is_a_place_to_take_texture_from():
    hole = np.arange(9)[None] >= 4
    flat, still = np.zeros((1, 9, 3), np.float32), np.zeros((1, 9, 2), np.float32)
    frame = WarpedFrame(flat, np.full((1, 9), 5, np.float32), hole, still)

    origin_px, found = texture_origins(frame, np.full((1, 9), 0.8), THRESHOLD)

    assert found[0, 8]
    np.testing.assert_array_equal(origin_px[0, 8], [0.5, 0.5])


def test_texture_lies_whole_steps_ahead_on_the_background_side(rng):
    """By hand: the border is column 47, and 32 px is more than the hole is wide."""
    origin_px, found = origins(uncovered(grey(rng)))

    assert found[:, 48:58].all()
    np.testing.assert_array_equal(origin_px[7, 48:58, 0], np.arange(48, 58) + 0.5 - 32)
    np.testing.assert_array_equal(origin_px[7, 48:58, 1], 7.5)


def test_steps_shorten_where_the_background_ends(rng):
    """By hand: 30 columns are cut off at the left, so 32 px back would leave the image."""
    whole = uncovered(grey(rng))
    cut = WarpedFrame(
        *(np.ascontiguousarray(array[:, 30:]) for array in (whole.colour, whole.depth_m)),
        np.ascontiguousarray(whole.hole[:, 30:]),
        np.ascontiguousarray(whole.flow_px[:, 30:]),
    )

    origin_px, found = origins(cut)

    assert found[:, 18:28].all()
    np.testing.assert_array_equal(origin_px[0, 18:28, 0], np.arange(18, 28) + 0.5 - 16)


def test_foreground_lends_no_texture(rng):
    warped = uncovered(grey(rng))
    in_front = warped.depth_m < 3
    origin_px, found = origins(warped)

    column, row = np.floor(origin_px[found]).astype(int).T
    assert not in_front[row, column].any()
    assert not warped.hole[row, column].any()


@pytest.mark.parametrize("motion_px", [(3.0, -2.0), (0.3, 0.0), (-7.7, 4.5)])
def test_texture_moves_with_the_background(rng, motion_px):
    """The place it comes from is whole steps away in the source, whatever the motion."""
    warped = uncovered(grey(rng), background_px=motion_px)
    origin_px, found = origins(warped)
    row, column = np.nonzero(found)
    away = origin_px[found] - np.stack([column, row], axis=1) - 0.5

    assert found.any()
    np.testing.assert_allclose(away / STEPS_PX[0], np.rint(away / STEPS_PX[0]), atol=1e-6)


def test_a_varying_motion_is_undone(rng):
    """The background turns a little; its texture comes from the same place of the source."""
    warped = uncovered(grey(rng))
    row = np.arange(48)[:, None]
    flow = warped.flow_px.copy()
    flow[..., 0] += (0.01 * row + 0.02 * np.arange(96)).astype(np.float32)
    origin_px, found = origins(replace(warped, flow_px=flow))
    y, x = np.nonzero(found)
    place = origin_px[found]
    lies = np.rint(np.stack([x, y], axis=1) - (32, 0)).astype(int)
    source = place - 0.5 - flow[lies[:, 1], lies[:, 0]]

    np.testing.assert_allclose(source, np.stack([x, y], axis=1) - flow[y, x] - (32, 0), atol=1e-5)


def test_without_background_in_reach_the_noise_stays(rng):
    warped = uncovered(grey(rng))
    depth = np.where(warped.hole, 5.0, 2.0).astype(np.float32)
    closed_in = replace(warped, depth_m=depth)

    assert not origins(closed_in)[1].any()
    noise = fill(closed_in, replace(BACKGROUND, texture="noise")).colour
    np.testing.assert_array_equal(fill(closed_in).colour, noise)


def test_details_and_what_lies_below_are_the_image(rng):
    image = rng.uniform(0, 1, (32, 48, 3))
    y, x = np.mgrid[:32, :48] + 0.5
    here = np.stack([x, y], axis=-1)
    below = sample_image(halve(halve(image)), 2, here)

    whole = sum(details(image, here, 2)) + ycbcr_from_rgb(below)

    np.testing.assert_allclose(whole, ycbcr_from_rgb(image), atol=1e-14)


def test_gain_is_the_share_that_the_base_lacks():
    """By hand: three bands of variance 4; the base lacks deviations of 2, 0 and 1."""
    values = np.zeros((1, 1, 3, 5))
    values[..., 1] = np.sqrt(2)  # luma's magnitude
    lacking = np.zeros((1, 1, 3, 3))
    lacking[0, 0, :, 0] = (4, 0, 1)  # variances

    gain = detail_gain(values.reshape(1, 1, -1), lacking.reshape(1, 1, -1))

    np.testing.assert_allclose(gain, np.sqrt(5 / 12), rtol=1e-15)


def test_a_constant_background_stays_constant():
    result = fill(uncovered(np.full((48, 96, 3), 0.4)))

    np.testing.assert_allclose(result.colour[:, 48:58], np.float32(0.4), atol=1e-12)


def test_red_foreground_does_not_bleed(rng):
    result = fill(uncovered(grey(rng))).colour[:, 48:58]

    assert np.ptp(result, axis=2).max() < 1e-6  # grey, as the background is


def test_structure_along_the_parallax_goes_on(rng):
    """Stripes along the rows: the background's detail continues them, noise cannot."""
    stripes = np.repeat(rng.uniform(0.3, 0.7, (48, 1, 1)), 96, axis=1).repeat(3, axis=2)
    warped = uncovered(stripes)

    def error(settings):
        return np.sqrt(np.mean((fill(warped, settings).colour - stripes)[warped.hole] ** 2))

    assert error(BACKGROUND) < 0.6 * error(replace(BACKGROUND, texture="noise"))


def test_known_pixels_keep_their_bits_and_the_result_is_in_range(rng):
    warped = uncovered(rng.uniform(0, 1, (48, 96, 3)))
    colour = fill(warped).colour

    np.testing.assert_array_equal(colour[~warped.hole], warped.colour[~warped.hole])
    assert np.isfinite(colour).all()
    assert colour.min() >= 0
    assert colour.max() <= 1


def test_unknown_texture_is_refused():
    with pytest.raises(InputError, match="texture must be one of noise, background"):
        MetamericSettings(texture="wool")
