"""Weighted pull-push's definition: values worked by hand, and what must hold for any image."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from pipeline.errors import InputError
from pipeline.pushpull.reference import expand, reduce, weighted_pull_push

ROUNDING = 1e-13  # float64: some dozen roundings of values of at most 1
WEIGHTS = st.sampled_from([0.0, 0.25, 1.0, 16.0])  # unknown, quality 2, 1 and 1/4 ("super")


@st.composite
def images(draw):
    """Draw an image of any small size, with at least one known pixel."""
    height, width = draw(st.integers(1, 9)), draw(st.integers(1, 9))
    image = draw(arrays.arrays(np.float64, (height, width, 4), elements=st.floats(0, 1, width=32)))
    image[..., 3] = draw(arrays.arrays(np.float64, (height, width), elements=WEIGHTS))
    image[draw(st.integers(0, height - 1)), draw(st.integers(0, width - 1)), 3] = 1.0
    return image


def test_reduction_counts_squared_weights():
    """By hand: weights 2 and 1 count 4 : 1, so (4 x 0.5 + 1 x 1) / 5 = 0.6; weight 3 / 4."""
    fine = np.full((2, 2, 4), 0.9)
    fine[..., 3] = 0
    fine[0, 0] = (0.5, 0.5, 0.5, 2.0)
    fine[1, 1] = (1.0, 1.0, 1.0, 1.0)

    np.testing.assert_allclose(reduce(fine), [[[0.6, 0.6, 0.6, 0.75]]], rtol=1e-15)


def test_one_known_of_four_gives_its_colour_and_a_quarter_of_its_weight():
    fine = np.zeros((2, 2, 4))
    fine[1, 0] = (0.3, 0.4, 0.5, 1.0)

    np.testing.assert_array_equal(reduce(fine), [[[0.3, 0.4, 0.5, 0.25]]])


def test_reduction_gives_zero_where_nothing_is_known_and_takes_odd_sizes():
    fine = np.full((3, 3, 4), 0.7)
    fine[..., 3] = 0
    fine[2, 2] = (0.2, 0.2, 0.2, 1.0)

    reduced = reduce(fine)

    assert reduced.shape == (2, 2, 4)
    np.testing.assert_array_equal(reduced[1, 1], fine[2, 2])
    assert not reduced[0].any()


def test_expansion_blends_by_the_clamped_ratio_of_squared_weights():
    """By hand: weight 1 over 2 gives a share of 1/4: 0.25 x 0.8 + 0.75 x 0.4 = 0.5."""
    coarse = np.array([[[0.4, 0.4, 0.4, 2.0]]])
    fine = np.array([[[0.8, 0.8, 0.8, 1.0], [0.8, 0.8, 0.8, 0.0]]])

    filled = expand(fine, coarse)

    np.testing.assert_allclose(filled[0, 0], [0.5, 0.5, 0.5, 1.75], rtol=1e-15)
    np.testing.assert_array_equal(filled[0, 1], coarse[0, 0])


def test_expansion_leaves_what_weighs_as_much_as_its_surroundings():
    coarse = np.array([[[0.4, 0.4, 0.4, 1.0]]])
    fine = np.array([[[0.8, 0.1, 0.3, 1.0], [0.8, 0.1, 0.3, 7.0]]])

    np.testing.assert_array_equal(expand(fine, coarse), fine)


def test_sparse_data_of_super_quality_spreads_over_its_surroundings():
    """A pixel of weight 16 among ones of weight 1 draws its neighbours towards its colour."""
    image = np.full((8, 8, 4), 0.2)
    image[..., 3] = 1.0
    image[3, 3] = (0.9, 0.9, 0.9, 16.0)

    filled = weighted_pull_push(image)

    assert (filled[2:4, 2:4] > 0.5).all()
    assert filled[7, 7, 0] < 0.3


@settings(max_examples=50)
@given(images())
def test_filled_values_stay_in_the_range_of_the_known_ones(image):
    known = image[image[..., 3] > 0][:, :3]
    filled = weighted_pull_push(image)

    assert (filled >= known.min(axis=0) - ROUNDING).all()
    assert (filled <= known.max(axis=0) + ROUNDING).all()


@settings(max_examples=50)
@given(images())
def test_pixels_that_all_weigh_the_same_are_unchanged(image):
    image[..., 3] = image[..., 3] > 0
    known = image[..., 3] > 0

    np.testing.assert_array_equal(weighted_pull_push(image)[known], image[known][:, :3])


def test_nothing_known_and_impossible_weights_are_refused():
    image = np.zeros((2, 2, 4))
    with pytest.raises(InputError, match="at least one known pixel"):
        weighted_pull_push(image)
    for weight in (-1.0, np.nan, np.inf):
        image[0, 0, 3] = weight
        with pytest.raises(InputError, match="finite and at least 0"):
            weighted_pull_push(image)
