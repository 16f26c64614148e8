"""Push-pull's definition: values worked by hand, and what must hold for any image."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from pipeline.errors import InputError
from pipeline.pushpull.reference import pull, push, push_pull, upsample

ROUNDING = 1e-14  # float64: a FEW dozen roundings of values of at most 1

FEW = settings(max_examples=50)
EDGES = st.integers(1, 9)
UNIT = st.floats(0, 1, width=32)
BINARY = st.sampled_from([0.0, 1.0])


@st.composite
def images(draw, confidences=BINARY):
    """Draw an image of any small size, with at least one known pixel."""
    height, width = draw(EDGES), draw(EDGES)
    image = draw(arrays.arrays(np.float64, (height, width, 4), elements=UNIT))
    image[..., 3] = draw(arrays.arrays(np.float64, (height, width), elements=confidences))
    image[draw(st.integers(0, height - 1)), draw(st.integers(0, width - 1)), 3] = 1.0
    return image


def test_pull_averages_only_the_known_pixels():
    """By hand: confidences 1 and 0.5; the other two pixels are unknown."""
    fine = np.full((2, 2, 4), 0.9)
    fine[..., 3] = 0
    fine[0, 0] = (0.2, 0.4, 0.6, 1.0)
    fine[1, 1] = (0.8, 0.4, 0.0, 0.5)

    np.testing.assert_allclose(pull(fine), [[[0.4, 0.4, 0.4, 1.0]]], rtol=1e-15)


def test_pull_sums_confidence_up_to_one():
    fine = np.full((2, 4, 4), 0.5)
    fine[:, :2, 3] = 0.125
    fine[:, 2:, 3] = 0.375

    np.testing.assert_array_equal(pull(fine)[..., 3], [[0.5, 1.0]])


def test_pull_gives_zero_where_nothing_is_known():
    fine = np.full((2, 2, 4), 0.7)
    fine[..., 3] = 0

    np.testing.assert_array_equal(pull(fine), np.zeros((1, 1, 4)))


def test_pull_of_an_odd_level_gives_its_last_row_and_column_fewer_children():
    fine = np.ones((3, 3, 4))
    fine[..., 0] = [[0.0, 0.2, 0.3], [0.4, 0.6, 0.5], [0.8, 0.6, 1.0]]

    np.testing.assert_allclose(pull(fine)[..., 0], [[0.3, 0.4], [0.7, 1.0]], rtol=1e-15)


def test_upsample_takes_three_quarters_of_the_nearer_pixel():
    """By hand: 0 and 1 side by side; fine pixels lie at a quarter and three quarters."""
    coarse = np.array([[0.0, 1.0]])[..., None]

    fine = upsample(coarse, (1, 4))

    np.testing.assert_array_equal(fine[..., 0], [[0.0, 0.25, 0.75, 1.0]])


def test_upsample_weighs_the_two_axes_alike():
    """By hand: one 1 among four; 9/16 for the pixel that touches it, 1/16 farthest away."""
    coarse = np.array([[1.0, 0.0], [0.0, 0.0]])[..., None]

    fine = upsample(coarse, (4, 4))[1:3, 1:3, 0]

    np.testing.assert_array_equal(fine, [[9 / 16, 3 / 16], [3 / 16, 1 / 16]])


def test_upsample_reads_the_next_coarse_pixel_and_none_beyond():
    """By hand: a spike in a row of five reaches half a coarse pixel to either side."""
    coarse = np.array([[0.0, 0.0, 1.0, 0.0, 0.0]])[..., None]

    fine = upsample(coarse, (1, 10))

    np.testing.assert_array_equal(fine[..., 0], [[0, 0, 0, 0.25, 0.75, 0.75, 0.25, 0, 0, 0]])


def test_push_fills_up_the_confidence_by_that_of_the_coarser_level():
    """By hand: 0.25 + 0.75 times 0.5."""
    fine = np.array([[[0.8, 0.8, 0.8, 0.25]]])
    coarse = np.array([[[0.4, 0.4, 0.4, 0.5]]])

    np.testing.assert_allclose(push(fine, coarse)[..., 3], [[0.625]], rtol=1e-15)


def test_push_blends_by_confidence():
    """By hand: a quarter of 0.8 and three quarters of 0.4."""
    fine = np.array([[[0.8, 0.8, 0.8, 0.25]]])
    coarse = np.array([[[0.4, 0.4, 0.4, 1.0]]])

    np.testing.assert_allclose(push(fine, coarse), [[[0.5, 0.5, 0.5, 1.0]]], rtol=1e-15)


def test_a_hole_between_two_colours_is_filled_by_hand_worked_values():
    """One row: 0.0, unknown, unknown, 1.0.

    Pulled once: 0 and 1, both known. Pushed: 1/4 and 3/4.
    """
    row = np.zeros((1, 4, 4))
    row[0, :, 3] = (1, 0, 0, 1)
    row[0, 3, :3] = 1

    np.testing.assert_array_equal(push_pull(row)[0, :, 0], [0, 0.25, 0.75, 1])


def test_a_hole_deeper_than_one_level_takes_the_colour_of_the_level_above():
    """One row: 0.5, 1.0, then six unknown.

    Pulled: (0.75, ?, ?, ?), (0.75, ?), (0.75): all that is unknown becomes 0.75.
    """
    row = np.zeros((1, 8, 4))
    row[0, :2] = [[0.5, 0.5, 0.5, 1], [1, 1, 1, 1]]

    np.testing.assert_array_equal(push_pull(row)[0, :, 0], [0.5, 1] + 6 * [0.75])


@FEW
@given(images(confidences=UNIT))
def test_filled_values_stay_within_the_range_of_the_known_ones(image):
    known = image[image[..., 3] > 0][:, :3]

    filled = push_pull(image)

    assert filled.shape == (*image.shape[:2], 3)
    assert (filled >= known.min(axis=0) - ROUNDING).all()
    assert (filled <= known.max(axis=0) + ROUNDING).all()


@FEW
@given(images())
def test_known_pixels_are_kept_bit_for_bit(image):
    known = image[..., 3] == 1

    filled = push_pull(image)

    assert filled[known].tobytes() == image[known][:, :3].tobytes()


@FEW
@given(images(confidences=st.just(1.0)))
def test_an_image_without_holes_is_kept_bit_for_bit(image):
    assert push_pull(image).tobytes() == np.ascontiguousarray(image[..., :3]).tobytes()


def test_even_the_sign_of_a_zero_is_kept():
    image = np.ones((3, 3, 4))
    image[1, 1, :3] = -0.0

    assert np.signbit(push_pull(image)[1, 1]).all()


@FEW
@given(images(), arrays.arrays(np.float64, 3, elements=UNIT))
def test_a_constant_colour_stays_constant(image, colour):
    image[image[..., 3] > 0, :3] = colour

    np.testing.assert_allclose(
        push_pull(image), np.broadcast_to(colour, (*image.shape[:2], 3)), rtol=0, atol=ROUNDING
    )


@FEW
@given(images(), st.randoms(use_true_random=False))
def test_colours_of_unknown_pixels_do_not_matter(image, random):
    other = image.copy()
    unknown = image[..., 3] == 0
    other[unknown, :3] = random.uniform(-5, 5)

    np.testing.assert_array_equal(push_pull(other), push_pull(image))


@FEW
@given(images())
def test_push_pull_commutes_with_swapping_rows_and_columns(image):
    swapped = push_pull(image.transpose(1, 0, 2)).transpose(1, 0, 2)

    np.testing.assert_allclose(swapped, push_pull(image), rtol=0, atol=ROUNDING)


def test_a_single_known_pixel_is_returned():
    np.testing.assert_array_equal(push_pull(np.array([[[0.1, 0.2, 0.3, 1]]])), [[[0.1, 0.2, 0.3]]])


@pytest.mark.parametrize("size", [(1, 1), (3, 5)])
def test_an_image_of_unknown_pixels_is_refused(size):
    with pytest.raises(InputError, match=f"all {size[0] * size[1]} are unknown"):
        push_pull(np.zeros((*size, 4)))


@pytest.mark.parametrize("shape", [(4, 4), (4, 4, 3), (0, 4, 4)])
def test_an_array_of_another_shape_is_refused(shape):
    with pytest.raises(InputError, match=r"image must be of shape \(H, W, 4\) \(got"):
        push_pull(np.ones(shape))


@pytest.mark.parametrize(
    ("channel", "value"), [(0, np.nan), (2, np.inf), (3, np.nan), (3, -0.5), (3, 1.5)]
)
def test_a_value_that_would_spread_is_refused_by_its_place(channel, value):
    image = np.ones((3, 4, 4))
    image[..., 3] = 0.5
    image[2, 1, channel] = value

    with pytest.raises(InputError, match="row 2, column 1"):
        push_pull(image)
