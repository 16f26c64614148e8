"""The pyramid's low bands on the GPU against their definition."""

import numpy as np
import pytest

from pipeline.features.reference import band_constants, fitted_kernels, halve, range_below
from pipeline.gl.texture import read_back, texture_from
from pipeline.inpaint.gpu import GuidedBasePass
from pipeline.inpaint.reference import guide_from_depth, near_a_hole
from pipeline.inpaint.regions import STATISTICS_RINGS
from pipeline.statistics.gpu import MIXED, LowBandPass
from tests.twins.work_lists import entries_of

ROUNDOFF = 2.0**-24  # of one float32 operation
# A tap's difference and weight, the sum of a pair, a product, a sum, three sums of rows: 8
# roundings of terms that sum to at most 1; adding the origin 1 more. A level takes over the
# error of the one it was made from, as every value is a weighted mean.
LOW_BAND = 9
SIZES = [(1, 1), (1, 2), (1, 90), (45, 1), (2, 3), (7, 5), (64, 48), (61, 83), (300, 270)]


@pytest.fixture
def low_bands(gl_context):
    """Give a function that fills a frame and returns it with its low bands, finest first."""

    def run(image, levels, depth=None):
        size = (image.shape[1], image.shape[0])
        base = GuidedBasePass(gl_context, size, gamma=0.25, levels=levels)
        skip = depth is not None
        depth = np.ones(image.shape[:2], np.float32) if depth is None else depth
        lows = LowBandPass(gl_context, base, levels, skip_depth_edges=skip)
        texture = texture_from(gl_context, image, "rgba32f")
        depth_m = texture_from(gl_context, depth, "r32f")
        base(texture, depth_m, 1.0)
        lows.tell(z_near_m=1.0)
        found = [read_back(level) for level in lows(texture, depth_m)]
        for thing in (base, lows, texture, depth_m):
            thing.release()
        return found

    return run


@pytest.mark.parametrize("levels", [1, 4, 6])
@pytest.mark.parametrize("size", SIZES)
def test_low_bands_on_gpu_match_reference(low_bands, rng, size, levels):
    """Colour within the bound, and alpha exact, wherever a statistic may look."""
    hole = np.zeros(size, bool)
    hole[size[0] // 3 : size[0] // 3 + 6, size[1] // 2 : size[1] // 2 + 9] = True
    hole[0, 0] = False
    image = np.concatenate(
        [rng.random((*size, 3), np.float32), ~hole[..., None]], axis=-1, dtype=np.float32
    )

    found = low_bands(image, levels)

    assert len(found) == levels
    colour = found[0][..., :3].astype(np.float64)
    touched = hole.astype(np.float64)
    for level in range(1, levels):
        colour, touched = halve(colour), halve(touched)
        near = near_a_hole(hole, level, STATISTICS_RINGS, level + 1)[:: 1 << level, :: 1 << level]
        np.testing.assert_allclose(
            found[level][near][:, :3],
            colour[near],
            rtol=0,
            atol=LOW_BAND * level * ROUNDOFF,
            err_msg=f"level {level}",
        )
        np.testing.assert_array_equal(found[level][near][:, 3], touched[near] == 0)


@pytest.mark.parametrize("size", [(1, 40), (33, 1), (7, 5), (61, 83), (120, 90)])
def test_low_bands_across_a_depth_edge_say_so_at_every_level(low_bands, rng, size):
    image = np.ones((*size, 4), np.float32)
    image[size[0] // 2, size[1] // 2, 3] = 0
    depth = np.where(rng.random(size) < 0.02, 2.0, 4.0).astype(np.float32)
    guide = guide_from_depth(depth, 1.0)

    found = low_bands(image, 4, depth)

    hole = image[..., 3] == 0
    touched, mixed = hole, None
    for level in range(1, 4):
        touched = halve(touched.astype(float)) > 0
        mixed = range_below(guide) > 0.04 if mixed is None else halve(mixed.astype(float)) > 0
        expected = np.where(mixed, MIXED, np.where(touched, 0.0, 1.0))
        near = near_a_hole(hole, level, STATISTICS_RINGS, level + 1)[:: 1 << level, :: 1 << level]
        np.testing.assert_array_equal(found[level][..., 3][near], expected[near])


@pytest.mark.parametrize("size", [(9, 300), (203, 177)])
def test_depth_is_looked_at_where_a_low_band_may_mix_it_and_hardly_elsewhere(gl_context, rng, size):
    """Tiles of 8x8 pixels. Kernels reach one pixel farther; what decides is known of 4x4 pixels."""
    image = np.ones((*size, 4), np.float32)
    image[size[0] // 2, size[1] // 2, 3] = 0
    depth = np.where(rng.random(size) < 0.002, 2.0, 4.0).astype(np.float32)
    base = GuidedBasePass(gl_context, size[::-1], gamma=0.25, levels=4)
    lows = LowBandPass(gl_context, base, 4, skip_depth_edges=True)
    texture = texture_from(gl_context, image, "rgba32f")
    depth_m = texture_from(gl_context, depth, "r32f")
    base(texture, depth_m, 1.0)
    lows.tell(z_near_m=1.0)
    lows(texture, depth_m)

    rows, columns = -(-size[0] // 8), -(-size[1] // 8)
    found = np.zeros((2, rows, columns), int)
    for which, name in enumerate(("plain", "jumps")):
        np.add.at(found[which], tuple(entries_of(base.lists, (name, 2))[:, :2].T), 1)
    for thing in (lows, base, texture, depth_m):
        thing.release()

    def jump_within(margin):
        padded = np.pad(depth, ((margin, margin + 8), (margin, margin + 8)), mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, (8 + 2 * margin,) * 2)
        return np.ptp(windows[::8, ::8], axis=(2, 3))[:rows, :columns] > 0

    np.testing.assert_array_equal(found.sum(axis=0), 1)  # the whole frame is near the hole
    plain = found[0] == 1
    assert not jump_within(1)[plain].any()
    assert plain[~jump_within(4)].all()
    assert 10 < plain.sum() < plain.size - 10


def test_a_constant_stays_the_same_bits_in_every_low_band(low_bands):
    """0.1 is no binary fraction: only differences keep it."""
    image = np.full((40, 50, 4), 0.1, np.float32)
    image[..., 3] = 1
    image[10, 20, 3] = 0
    image[10, 20, :3] = 0

    found = low_bands(image, 4)

    filled = found[0][10, 20, :3]
    np.testing.assert_allclose(filled, 0.1, atol=2.0**-21)
    for level in found[1:]:
        known = level[..., 3] == 1
        assert np.isin(level[known][:, :3], np.float32([0.1, 0.0])).all()  # 0: never visited


def test_the_shader_s_taps_are_the_kernels():
    """Four numbers stand for 18: what symmetry makes equal must be equal in the kernels."""
    kernels = fitted_kernels()
    constants = band_constants()

    edge, corner = constants["HIGH_EDGE"], constants["HIGH_CORNER"]
    centre = -4 * (edge + corner)
    np.testing.assert_allclose(
        kernels.high, [[corner, edge, corner], [edge, centre, edge], [corner, edge, corner]]
    )
    edge, corner = constants["ORIENTED_EDGE"], constants["ORIENTED_CORNER"]
    column = np.array([corner, edge, corner])
    np.testing.assert_array_equal(kernels.oriented, np.stack([-column, 0 * column, column], axis=1))
