"""Depth-guided pull and push, worked by hand and held to what they promise."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pipeline.inpaint.reference import (
    ONLY_NEARER,
    RELAXED_RESOLUTIONS,
    GuidedLevel,
    guide_from_depth,
    guided_base,
    interpolate,
    near_a_hole,
    nearest_depth_m,
    pull,
    pull_push,
    push,
    relax,
)
from pipeline.inpaint.regions import CELL, SOURCE_RINGS, source_resolution
from pipeline.statistics.moments import chroma_slopes, chroma_variances, luma_moments, moments
from pipeline.statistics.reference import band_statistics, outlined_levels, straddles

THRESHOLD = 0.04
GAMMAS = [0.0, 0.25, 0.5, 1.0]


def level(values, validity, guide=0.5):
    """Make a level of one channel from nested lists."""
    values = np.array(values, float)[..., None]
    validity = np.array(validity, float)
    return GuidedLevel(
        values, validity, np.broadcast_to(np.array(guide, float), validity.shape).copy()
    )


def alone(result):
    """Give the one value, validity and guide of a 1x1 level."""
    return result.values[0, 0, 0], result.validity[0, 0], result.guide[0, 0]


def test_guide_is_zero_at_the_nearest_depth_and_one_at_infinity():
    depth_m = np.array([0.5, 2.0, 4.0, np.inf], np.float32)

    np.testing.assert_array_equal(guide_from_depth(depth_m, 2.0), [0, 0, 0.5, 1])


def test_pull_averages_what_is_known_by_its_validity():
    """By hand: (1 * 0.2 + 0.5 * 0.8) / 1.5 = 0.4; validity (1 + 0.5) / 4."""
    pulled = pull(level([[0.2, 9.0], [9.0, 0.8]], [[1, 0], [0, 0.5]]), THRESHOLD)

    np.testing.assert_allclose(alone(pulled), (0.4, 0.375, 0.5), rtol=1e-15)


def test_pull_takes_only_the_farthest_children_and_their_depth():
    """By hand: guides 0.5 and 0.47 lie within 0.04 of the farthest, 0.2 does not."""
    pulled = pull(
        level([[0.2, 0.4], [0.9, 0.9]], [[1, 1], [1, 1]], [[0.5, 0.47], [0.2, 0.2]]), THRESHOLD
    )

    np.testing.assert_allclose(alone(pulled), (0.3, 0.5, 0.5), rtol=1e-15)


def test_the_farthest_depth_counts_even_where_nothing_is_known():
    """A hole's own background depth keeps the foreground out; all else is a last resort."""
    pulled = pull(level([[0.9, 0.0]], [[1, 0]], [[0.2, 0.5]]), THRESHOLD)

    assert alone(pulled) == (0.9, ONLY_NEARER, 0.5)


def test_a_last_resort_gives_way_to_anything_that_is_known():
    """By hand: of 0.9 (only nearer) and 0.1 (a quarter known), 0.1 alone remains."""
    pulled = pull(level([[0.9, 0.1]], [[ONLY_NEARER, 0.25]]), THRESHOLD)

    value, validity, _ = alone(pulled)

    assert value == 0.1
    assert validity == 2 * 0.25 / 4  # an odd border repeats its one row


def test_a_last_resort_is_averaged_alike():
    pulled = pull(level([[0.9, 0.1], [5.0, 5.0]], [[ONLY_NEARER] * 2, [0, 0]]), THRESHOLD)

    np.testing.assert_allclose(alone(pulled)[:2], (0.5, ONLY_NEARER))


def test_nothing_known_pulls_to_nothing():
    assert alone(pull(level([[5.0, 5.0], [5.0, 5.0]], [[0, 0], [0, 0]]), THRESHOLD)) == (0, 0, 0.5)


def test_an_image_of_foreground_alone_is_filled_with_it():
    """ONLY_NEARER serves where the whole image has nothing else."""
    fine = level([[0.9, 0.0], [0.7, 0.0]], [[1, 0], [1, 0]], [[0.1, 0.5], [0.1, 0.5]])

    filled = pull_push(fine, 0.5, THRESHOLD)[0]

    np.testing.assert_allclose(filled.values[..., 0], [[0.9, 0.8], [0.7, 0.8]])


@pytest.mark.parametrize(("gamma", "kept"), [(0.0, 1.0), (0.25, 0.5), (0.5, 0.25), (1.0, 0.0625)])
def test_push_keeps_validity_to_the_power_of_gamma(gamma, kept):
    """By hand, validity 1/16: its fourth root is 1/2, its root 1/4."""
    coarse = level([[10.0]], [[1]])

    pushed = push(level([[2.0]], [[1 / 16]]), coarse, gamma, THRESHOLD)

    np.testing.assert_allclose(pushed.values, [[[kept * 2 + (1 - kept) * 10]]], rtol=1e-15)
    assert pushed.validity[0, 0] == 1 / 16


@pytest.mark.parametrize("gamma", GAMMAS)
@pytest.mark.parametrize("validity", [0.0, ONLY_NEARER])
def test_what_is_unknown_takes_the_coarser_value_at_every_gamma(gamma, validity):
    """Also at gamma 0, where a careless pow(0, 0) is 1."""
    pushed = push(level([[2.0]], [[validity]]), level([[10.0]], [[1]]), gamma, THRESHOLD)

    assert pushed.values[0, 0, 0] == 10


@pytest.mark.parametrize("gamma", GAMMAS)
def test_what_is_certain_is_kept_at_every_gamma(gamma):
    pushed = push(level([[2.0]], [[1]]), level([[10.0]], [[1]]), gamma, THRESHOLD)

    assert pushed.values[0, 0, 0] == 2


COARSE = [[16.0, 160.0], [1600.0, 16000.0]]
COARSE_MEAN = 9 + 30 + 300 + 1000  # of 9, 3, 3 and 1 sixteenths


def test_interpolation_weighs_by_nine_three_three_one():
    """By hand, pixel (1, 1) of 4x4: its parent (0, 0) has 9/16, (0, 1), (1, 0) 3, (1, 1) 1."""
    below, similar = interpolate(level(COARSE, np.ones((2, 2))), np.full((4, 4), 0.5), THRESHOLD)

    assert below[1, 1, 0] == COARSE_MEAN
    assert below[0, 0, 0] == 16  # at a corner the parent stands in for all
    assert below[2, 3, 0] == 0.75 * 16000 + 0.25 * 160
    assert similar.all()


@pytest.mark.parametrize("other", [0.25, 0.75])
def test_a_step_of_exactly_the_threshold_is_the_same_depth(other):
    """Of numbers that floats hold exactly: 0.25 away at a threshold of 0.25."""
    coarse = level(COARSE, np.ones((2, 2)), [[0.5, other], [0.5, other]])

    below, similar = interpolate(coarse, np.full((4, 4), 0.5), 0.25)
    pulled = pull(level([[0.2, 0.4]], [[1, 1]], [[0.5, other]]), 0.25)

    assert below[1, 1, 0] == COARSE_MEAN
    assert similar.all()
    np.testing.assert_allclose(alone(pulled), (0.3, 1.0, max(0.5, other)), rtol=1e-15)
    assert not straddles(np.array([[0.5, other]]), 0.25).any()


def test_the_least_neighbour_counts_alone_where_only_it_is_of_the_pixel_s_depth():
    coarse = level(COARSE, np.ones((2, 2)), [[0.9, 0.9], [0.9, 0.5]])

    below, similar = interpolate(coarse, np.full((4, 4), 0.5), THRESHOLD)

    assert below[1, 1, 0] == COARSE[1][1]
    assert similar[1, 1]


@pytest.mark.parametrize("other", [0.3, 0.45, 0.55, 0.9])
def test_interpolation_leaves_out_neighbours_of_another_depth(other):
    """By hand: the right ones are nearer or farther, 9 and 3 of 12 remain."""
    coarse = level(COARSE, np.ones((2, 2)), [[0.5, other], [0.5, other]])

    below, similar = interpolate(coarse, np.full((4, 4), 0.5), THRESHOLD)

    np.testing.assert_allclose(below[1, 1, 0], (9 * 16 + 3 * 1600) / 12)
    assert similar[1, 1]


def test_interpolation_takes_farther_neighbours_where_there_are_no_others():
    """By hand: guides 0.3 are nearer, 0.9 farther, none is the pixel's 0.5."""
    coarse = level(COARSE, np.ones((2, 2)), [[0.9, 0.3], [0.9, 0.3]])

    below, similar = interpolate(coarse, np.full((4, 4), 0.5), THRESHOLD)

    np.testing.assert_allclose(below[1, 1, 0], (9 * 16 + 3 * 1600) / 12)
    assert not similar[1, 1]


@pytest.mark.parametrize("border", [16, 17, 18, 19])
def test_what_lies_far_behind_does_not_stand_on_the_floor_before_it(border):
    """A dark shelf above a bright floor with a wide hole that both know to be floor."""
    hole = np.zeros((64, 64), bool)
    hole[border:, 20:44] = True
    floor = np.arange(64)[:, None] >= border
    colour = np.broadcast_to(np.where(floor, 0.8, 0.1)[..., None], (64, 64, 3))
    guide = np.where(floor, 0.3, 0.7) * np.ones((64, 64))

    filled = guided_base(colour, hole, guide, levels=1, gamma=0.25, threshold=THRESHOLD)[0].values

    np.testing.assert_allclose(filled[hole], 0.8, atol=1e-12)


def test_what_finds_nothing_of_its_depth_below_keeps_what_it_knows():
    """Even a little is kept; what knows nothing takes what lies behind it."""
    coarse = level([[10.0]], [[1]], [[0.9]])

    for validity, expected in ((1 / 16, 2.0), (0.0, 10.0), (ONLY_NEARER, 10.0)):
        pushed = push(level([[2.0]], [[validity]], [[0.5]]), coarse, 0.5, THRESHOLD)

        assert pushed.values[0, 0, 0] == expected


def test_a_relaxation_by_hand():
    """Between 8 and 0, three of nothing known; even ones first: borders repeat above and below.

    The third becomes (2 + 2 * 4 + 2) / 4 = 3. Then the second takes (8 + 2 * 2 + 3) / 4, the fourth
    (3 + 2 * 2 + 0) / 4.
    """
    row = level([[8.0, 2.0, 4.0, 2.0, 0.0]], [[1, 0, 0, 0, 1]])

    relaxed = relax(row, 0.5, THRESHOLD)

    np.testing.assert_allclose(relaxed.values[0, :, 0], [8.0, 3.75, 3.0, 1.75, 0.0])
    np.testing.assert_array_equal(relaxed.validity, row.validity)


def test_a_relaxation_keeps_what_is_known_of_a_pixel_and_its_depth():
    """By hand: a quarter known keeps half of its 4 at gamma 1/2; neighbours in front do not count.

    Nor do those behind. The mean is that of the others: 10 to the right, and of itself above and
    below.
    """
    known = [[1, 0.25, 1]]

    for other, mean in ((0.5, (0 + 10 + 4 + 4) / 4), (0.1, (10 + 4 + 4) / 3), (0.9, 18 / 3)):
        found = relax(level([[0.0, 4.0, 10.0]], known, [[other, 0.5, 0.5]]), 0.5, THRESHOLD)

        np.testing.assert_allclose(found.values[0, :, 0], [0.0, 0.5 * 4 + 0.5 * mean, 10.0])


def test_relaxations_approach_a_harmonic_fill(rng):
    """Done over and over they are Gauss and Seidel's: each pixel the mean of its neighbours."""
    hole = np.zeros((9, 11), bool)
    hole[2:7, 3:9] = True
    found = GuidedLevel(rng.random((9, 11, 1)), (~hole).astype(float), np.full((9, 11), 0.5))
    for _ in range(200):
        found = relax(found, 0.5, THRESHOLD)

    values = found.values[..., 0]
    mean = (values[1:-1, :-2] + values[1:-1, 2:] + values[:-2, 1:-1] + values[2:, 1:-1]) / 4
    np.testing.assert_allclose(values[hole], mean[hole[1:-1, 1:-1]], atol=1e-12)


def test_a_relaxed_fill_meets_its_border_more_smoothly():
    """Smaller second differences across the border, a smaller error; what is known stays."""
    axis = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    smooth = (np.sin(axis)[:, None] + np.cos(axis))[..., None]
    known = np.ones((64, 64))
    known[20:44, 16:48] = 0.0
    guide = np.full((64, 64), 0.5)

    pushed, relaxed = (
        pull_push(GuidedLevel(smooth, known, guide), 0.5, THRESHOLD, relaxed=count)[0].values[
            ..., 0
        ]
        for count in (0, RELAXED_RESOLUTIONS)
    )

    np.testing.assert_array_equal(relaxed[known > 0], smooth[known > 0, 0])
    across = [np.abs(np.diff(fill, 2, axis=0))[18:20, 16:48].mean() for fill in (pushed, relaxed)]
    assert across[1] < 0.6 * across[0]
    errors = [np.abs(fill - smooth[..., 0]).mean() for fill in (pushed, relaxed)]
    assert errors[1] < errors[0]


def test_a_row_of_eight_by_hand():
    """[MI] Fig. 8 c: four known background pixels, two holes behind two foreground ones.

    Guides: background and holes 0.5, foreground 0.1. Pulled to 4: (0.2, 1), (0.4, 1),
    hole (0, 0), foreground (0.9, 1). To 2: (0.3, 1) and the pair of hole and foreground,
    which is only nearer. To 1: (0.3, 0.5). Back, gamma 0: the hole's pair takes 0.3 from
    the top, its pixels mix 3/4 of it with 1/4 of the known neighbour 0.4 on the left,
    and on the right all of 0.3, for the right neighbour is in front.
    """
    fine = level(
        [[0.2, 0.2, 0.4, 0.4, 7.0, 7.0, 0.9, 0.9]],
        [[1, 1, 1, 1, 0, 0, 1, 1]],
        [[0.5] * 6 + [0.1] * 2],
    )

    levels = pull_push(fine, 0.0, THRESHOLD)

    np.testing.assert_allclose(
        [levels[1].values[0, 2, 0], levels[2].values[0, 1, 0], levels[3].values[0, 0, 0]],
        [0.3, 0.3, 0.3],
    )
    np.testing.assert_allclose(
        levels[0].values[0, :, 0], [0.2, 0.2, 0.4, 0.4, 0.325, 0.3, 0.9, 0.9]
    )
    np.testing.assert_array_equal(levels[1].validity, [[1, 1, 0, 1]])
    np.testing.assert_array_equal(levels[2].validity, [[1, ONLY_NEARER]])
    np.testing.assert_array_equal(levels[3].validity, [[0.5]])


def test_pull_of_odd_sizes_repeats_the_last_pixel():
    pulled = pull(level([[1.0, 2.0, 4.0]] * 3, np.ones((3, 3))), THRESHOLD)

    np.testing.assert_array_equal(pulled.values[..., 0], [[1.5, 4.0], [1.5, 4.0]])
    np.testing.assert_array_equal(pulled.validity, np.ones((2, 2)))


sizes = st.tuples(st.integers(1, 13), st.integers(1, 13))


@given(st.data(), sizes, st.sampled_from(GAMMAS), st.integers(0, 3), st.integers(0, 2**32 - 1))
def test_filled_values_stay_within_the_range_of_what_is_known(data, size, gamma, relaxed, seed):
    """Any mask and any depths: a fill is a convex combination of known values."""
    rng = np.random.default_rng(seed)
    known = data.draw(hnp.arrays(bool, size))
    known.flat[0] = True
    guide = data.draw(hnp.arrays(float, size, elements=st.sampled_from([0.0, 0.3, 0.32, 0.9])))
    values = rng.normal(0, 10, (*size, 2))
    values[~known] = 1e6  # must not be seen

    level = GuidedLevel(values, known.astype(float), guide)
    for filled in pull_push(level, gamma, THRESHOLD, relaxed=relaxed):
        for channel in range(2):
            inside = values[known][:, channel]
            slack = 1e-12 * np.abs(inside).max()
            assert filled.values[..., channel].min() >= inside.min() - slack
            assert filled.values[..., channel].max() <= inside.max() + slack


@given(st.data(), sizes, st.integers(0, 2**32 - 1))
def test_partly_valid_values_fill_within_their_range_as_well(data, size, seed):
    rng = np.random.default_rng(seed)
    validity = data.draw(hnp.arrays(float, size, elements=st.sampled_from([0.0, 0.25, 0.6, 1.0])))
    validity.flat[-1] = 0.25
    values = rng.uniform(-1, 1, (*size, 1))
    values[validity == 0] = 1e6

    inside = values[validity > 0]
    for relaxed in (0, 3):
        level = GuidedLevel(values, validity, np.full(size, 0.5))
        filled = pull_push(level, 0.5, THRESHOLD, relaxed=relaxed)[0].values

        assert inside.min() - 1e-12 <= filled.min()
        assert filled.max() <= inside.max() + 1e-12


@pytest.mark.parametrize("relaxed", [0, RELAXED_RESOLUTIONS])
@pytest.mark.parametrize("gamma", GAMMAS)
@pytest.mark.parametrize("size", [(1, 1), (5, 1), (1, 6), (9, 14), (40, 33)])
def test_the_foreground_never_gets_into_the_background(gamma, size, relaxed, rng):
    """Foreground value 1 at guide 0.1, background 0 at 0.6: holes with its depth get 0."""
    foreground = rng.random(size) < 0.4
    hole = rng.random(size) < 0.5
    foreground.flat[0], hole.flat[0] = False, False
    guide = np.where(foreground, 0.1, 0.6)

    level = GuidedLevel(foreground[..., None].astype(float), (~hole).astype(float), guide)
    filled = pull_push(level, gamma, THRESHOLD, relaxed=relaxed)[0]

    assert filled.values[~foreground].max() == 0


def test_base_keeps_known_pixels_and_fills_from_the_background(disc_over_plane):
    guide = guide_from_depth(disc_over_plane.depth_m, 1.0)
    hole = np.zeros(disc_over_plane.size, bool)
    hole[30:70, 78:100] = True
    guide[hole] = guide.max()

    base = guided_base(
        disc_over_plane.colour, hole, guide, levels=4, gamma=0.25, threshold=THRESHOLD
    )[0]

    np.testing.assert_array_equal(base.values[~hole], disc_over_plane.colour[~hole])
    red_less_green = base.values[hole][:, 0] - base.values[hole][:, 1]
    assert np.abs(red_less_green).max() < 1e-7  # grey stays grey, to float32 input


def brute_force_near(hole, cell_resolution, rings, tile_resolution):
    """Say the definition again, pixel by pixel and cell by cell."""
    height, width = hole.shape
    edge, tile = CELL << cell_resolution, CELL << tile_resolution
    marked = {(row // edge, column // edge) for row, column in np.argwhere(hole)}
    near = np.zeros_like(hole)
    for top in range(0, height, tile):
        for left in range(0, width, tile):
            cells = {
                (row // edge, column // edge)
                for row in range(top, min(top + tile, height))
                for column in range(left, min(left + tile, width))
            }
            near[top : top + tile, left : left + tile] = any(
                max(abs(a - c), abs(b - d)) <= rings for a, b in cells for c, d in marked
            )
    return near


@pytest.mark.parametrize("cells", [0, 1, 2])
@pytest.mark.parametrize("tiles", [0, 1, 2, 3])
@pytest.mark.parametrize("rings", [1, 2])
def test_what_is_near_a_hole_is_what_brute_force_says(cells, rings, tiles, rng):
    for size in ((1, 1), (7, 100), (61, 90)):
        for holes in (0, 1, 4):
            hole = np.zeros(size, bool)
            for _ in range(holes):
                hole[rng.integers(size[0]), rng.integers(size[1])] = True

            np.testing.assert_array_equal(
                near_a_hole(hole, cells, rings, tiles), brute_force_near(hole, cells, rings, tiles)
            )


def test_base_reads_only_what_is_near_a_hole(rng):
    """Pixels beyond three cells of 128 px: any colour gives the same fill."""
    hole = np.zeros((16, 1200), bool)
    hole[3:9, 20:50] = True
    colour = rng.random((16, 1200, 3))
    other = colour.copy()
    other[:, 512:] = rng.random((16, 688, 3))
    guide = np.full(hole.shape, 0.5)
    settings = {"levels": 4, "gamma": 0.25, "threshold": THRESHOLD}

    one, two = (guided_base(c, hole, guide, **settings)[0].values for c in (colour, other))

    source = source_resolution(4)
    near = near_a_hole(hole, source, SOURCE_RINGS, source)
    assert near.sum() == 16 * 512
    np.testing.assert_array_equal(one[hole], two[hole])
    known = guided_base(colour, hole, guide, **settings)[0].validity
    np.testing.assert_array_equal(known, near & ~hole)


def test_no_pixel_depends_on_more_than_is_read():
    """Followed pixel by pixel along a row, up to the coarsest resolution that is dispatched.

    A relaxation leads two texels on, a push to the parent and the next one on its side. What a
    texel covers begins within the rings, so that its tile is one that is worked on.
    """
    farthest = 0
    for pixel in range(512):
        texels = {pixel}
        for resolution in range(9):
            if resolution < RELAXED_RESOLUTIONS:
                texels = {texel + step for texel in texels for step in range(-2, 3)}
            begins = max(
                (max(texels) << resolution) - pixel, pixel - ((min(texels) + 1 << resolution) - 1)
            )
            farthest = max(farthest, begins)
            texels = {
                t for texel in texels for t in (texel >> 1, (texel >> 1) + 2 * (texel & 1) - 1)
            }

    assert farthest == 381
    assert farthest < SOURCE_RINGS * (CELL << source_resolution(1))


def mean_moments(bands, *, cross):
    return moments(bands, cross=cross).mean(axis=(0, 1), keepdims=True)


def test_the_variance_of_laplace_coefficients_comes_back_from_their_magnitudes(rng):
    """And chroma's, or its slope beside luma; to 4 standard errors."""
    luma = rng.laplace(scale=0.1, size=(400, 400, 1, 1))
    slope = np.array([1.0, -0.5, 0.25])
    bands = luma * slope
    few = 4 * np.sqrt(5 + 4) / 400

    mean, variance = luma_moments(mean_moments(bands, cross=True))
    np.testing.assert_allclose(mean, 0.0, atol=4 * luma.std() / 400)
    np.testing.assert_allclose(variance, luma.var(), rtol=few)
    of_chroma = chroma_slopes(mean_moments(bands, cross=True))[0, 0, 0]
    np.testing.assert_allclose(of_chroma, slope[1:], rtol=1e-12)
    of_chroma = chroma_variances(mean_moments(bands, cross=False))[0, 0, 0]
    np.testing.assert_allclose(of_chroma, luma.var() * slope[1:] ** 2, rtol=few)


def test_a_few_edges_count_for_less_than_texture_of_their_variance():
    """By hand: of 100 coefficients two of 10 / root 2 have the variance of 100 ones; 1 / 50."""
    edge, texture = np.zeros((10, 10, 1, 3)), np.ones((10, 10, 1, 3))
    edge[3, 4], edge[3, 5] = np.sqrt(50), -np.sqrt(50)
    texture[::2] = -1

    of_edge, of_texture = (
        luma_moments(mean_moments(bands, cross=False))[1] for bands in (edge, texture)
    )

    assert edge.var() == pytest.approx(texture.var())
    np.testing.assert_allclose(of_edge, of_texture / 50)


def test_without_luma_chroma_has_no_slope():
    bands = np.zeros((4, 4, 1, 3))
    bands[..., 1:] = 0.3

    assert not chroma_slopes(mean_moments(bands, cross=True)).any()


def test_the_nearest_depth_is_the_smallest_and_a_metre_where_all_is_sky():
    assert nearest_depth_m(np.array([[3.0, np.inf], [2.5, 7.0]], np.float32)) == 2.5
    assert nearest_depth_m(np.full((2, 3), np.inf, np.float32)) == 1.0


def test_a_jump_of_depth_is_straddled_from_both_sides():
    guide = np.zeros((3, 6))
    guide[:, 3:] = 0.041

    np.testing.assert_array_equal(straddles(guide, 0.04), [[0, 0, 1, 1, 0, 0]] * 3)
    assert not straddles(guide, 0.042).any()


def statistics(bands, valid, guide, *, cross=False):
    return band_statistics(bands, valid, guide, cross=cross, gamma=0.5, threshold=THRESHOLD)


def test_outlines_spread_through_the_levels():
    """By hand: a step between columns 7 and 8 of 16, its farther side on the right.

    Level 0: one column on either side. Low bands of level 1 whose four taps reach across are
    those of columns 3 and 4, and a 3x3 kernel reaches those from 2 and 5; at level 2 the
    step has spread to columns 0 to 3, all there are.
    """
    guide = np.full((16, 16), 0.5)
    guide[:, :8] = 0.1
    guides = [guide, guide[::2, ::2], guide[::4, ::4]]

    found = outlined_levels(guides, 3, THRESHOLD)

    for level, columns in enumerate(((7, 8), (2, 3, 4, 5), (0, 1, 2, 3))):
        expected = np.zeros(guides[level].shape, bool)
        expected[:, columns] = True
        np.testing.assert_array_equal(found[level], expected)


def test_a_slant_is_an_outline_once_a_step_of_its_level_is_one():
    """By hand: 0.012 a pixel, so 0.024 a pixel of level 1 and 0.048 one of level 2.

    Four taps of the first low band span 0.036: none of them mixes two depths.
    """
    guide = np.broadcast_to(0.012 * np.arange(32), (16, 32))
    guides = [guide, guide[::2, 1::2], guide[::4, 3::4]]

    found = outlined_levels(guides, 3, THRESHOLD)

    assert [mask.mean() for mask in found] == [0, 0, 1]


def test_a_step_as_high_as_the_threshold_is_no_outline():
    guide = np.full((16, 16), 0.5)
    guide[:, :8] = 0.25

    for threshold, outlined in ((0.25, False), (0.25 - 2.0**-20, True)):
        found = outlined_levels([guide, guide[::2, ::2], guide[::4, ::4]], 3, threshold)
        assert [bool(mask.any()) for mask in found] == [outlined] * 3


def test_nothing_is_outlined_on_a_plane_and_past_1x1_nothing_changes():
    guides = [np.full(size, 0.3) for size in ((3, 4), (2, 2), (1, 1))]

    assert not any(mask.any() for mask in outlined_levels(guides, 5, THRESHOLD))


def test_statistics_ignore_what_is_not_valid(rng):
    """Coefficients are 1 where they count; 1000 elsewhere must not be seen."""
    size = (24, 32)
    valid = rng.random(size) < 0.6
    bands = np.where(valid[..., None, None], 1.0, 1000.0) + np.zeros((*size, 3, 3))

    found = statistics(bands, valid, np.full(size, 0.5))

    np.testing.assert_allclose(found.values, 1, rtol=1e-12)


def test_statistics_are_half_the_level_s_size():
    found = statistics(np.ones((7, 10, 3, 3)), np.ones((7, 10), bool), np.zeros((7, 10)))

    assert found.values.shape == (4, 5, 15)


def test_statistics_are_crossed_with_luma_if_told_so():
    """By hand: luma -2 and two chromas -3 and 5 everywhere."""
    size = (4, 4)
    bands = np.broadcast_to([-2.0, -3.0, 5.0], (*size, 1, 3)).copy()

    for cross, of_chroma in ((True, [6, -10]), (False, [3, 5])):
        found = statistics(bands, np.ones(size, bool), np.full(size, 0.5), cross=cross)
        np.testing.assert_allclose(found.values[0, 0], [-2, 2, 4, *of_chroma], rtol=1e-15)
