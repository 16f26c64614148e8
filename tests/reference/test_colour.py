"""Colour: published values of sRGB and BT.709, and inverses that are exact."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from pipeline.colour import (
    RGB_FROM_YCBCR,
    YCBCR_FROM_RGB,
    decode_srgb,
    encode_srgb,
    rgb_from_ycbcr,
    ycbcr_from_rgb,
)
from pipeline.errors import InputError

# ITU-R BT.709: E'Y = 0.2126 R' + 0.7152 G' + 0.0722 B';
# E'CB = (B' - E'Y) / 1.8556, E'CR = (R' - E'Y) / 1.5748.
PRIMARIES = {
    "white": ((1, 1, 1), (1, 0, 0)),
    "black": ((0, 0, 0), (0, 0, 0)),
    "grey": ((0.25, 0.25, 0.25), (0.25, 0, 0)),
    "red": ((1, 0, 0), (0.2126, -0.2126 / 1.8556, 0.5)),
    "green": ((0, 1, 0), (0.7152, -0.7152 / 1.8556, -0.7152 / 1.5748)),
    "blue": ((0, 0, 1), (0.0722, 0.5, -0.0722 / 1.5748)),
}


@pytest.mark.parametrize("name", PRIMARIES)
def test_ycbcr_follows_bt709(name):
    rgb, expected = PRIMARIES[name]

    np.testing.assert_allclose(ycbcr_from_rgb(np.array(rgb, float)), expected, rtol=0, atol=2e-16)


def test_the_two_matrices_are_inverses_to_the_last_bits():
    np.testing.assert_allclose(RGB_FROM_YCBCR @ YCBCR_FROM_RGB, np.eye(3), rtol=0, atol=4e-16)


# float64: 2 x 3 products and sums, factors of at most 1.86 in the way back.
@given(arrays.arrays(np.float64, (2, 5, 3), elements=st.floats(0, 1)))
def test_ycbcr_comes_back_to_the_colour_it_was_made_from(colour):
    np.testing.assert_allclose(rgb_from_ycbcr(ycbcr_from_rgb(colour)), colour, rtol=0, atol=2e-15)


def test_grey_has_no_chroma_in_float32_either():
    """Within the roundings of three float32 products and their sum."""
    grey = np.repeat(np.linspace(0, 1, 256, dtype=np.float32)[:, None], 3, axis=1)

    assert np.abs(ycbcr_from_rgb(grey)[:, 1:]).max() <= 4 * 2.0**-24
    assert ycbcr_from_rgb(grey).dtype == np.float32


# IEC 61966-2-1, worked to 12 digits with decimal arithmetic.
@pytest.mark.parametrize(
    ("linear", "encoded"),
    [
        (0.0, 0.0),
        (0.001, 0.01292),
        (0.0031308, 0.040449936),
        (0.18, 0.461356129500),
        (0.5, 0.735356983052),
        (1.0, 1.0),
    ],
)
def test_srgb_curve_has_its_published_values(linear, encoded):
    np.testing.assert_allclose(encode_srgb(np.array([linear])), [encoded], rtol=0, atol=1e-12)
    np.testing.assert_allclose(decode_srgb(np.array([encoded])), [linear], rtol=0, atol=1e-12)


# The standard rounds both thresholds: between them the two pieces miss each other by 2e-8.
@given(st.floats(0, 4))
def test_srgb_decodes_what_it_encoded(linear):
    value = np.array([linear])

    np.testing.assert_allclose(decode_srgb(encode_srgb(value)), value, rtol=1e-13, atol=3e-8)


def test_srgb_never_falls_as_light_rises():
    light = np.concatenate([np.linspace(0, 0.01, 5001), np.linspace(0.01, 1, 1001)])

    assert (np.diff(encode_srgb(light)) >= 0).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("curve", [encode_srgb, decode_srgb])
def test_srgb_keeps_shape_and_type(curve, dtype):
    colour = np.full((2, 3, 3), 0.5, dtype)

    assert curve(colour).shape == colour.shape
    assert curve(colour).dtype == dtype


@pytest.mark.parametrize("bad", [-1e-6, np.nan, np.inf])
@pytest.mark.parametrize(("curve", "name"), [(encode_srgb, "linear"), (decode_srgb, "encoded")])
def test_srgb_refuses_what_it_does_not_define(curve, name, bad):
    with pytest.raises(InputError, match=rf"^{name} must be finite and at least 0 \(got {bad}"):
        curve(np.array([0.5, bad]))


@pytest.mark.parametrize("convert", [ycbcr_from_rgb, rgb_from_ycbcr, encode_srgb, decode_srgb])
def test_eight_bit_colour_is_refused_rather_than_truncated(convert):
    with pytest.raises(InputError, match=r"must be of a floating type \(got uint8\)"):
        convert(np.full((2, 2, 3), 128, np.uint8))


@pytest.mark.parametrize("convert", [ycbcr_from_rgb, rgb_from_ycbcr])
def test_a_fourth_channel_is_refused(convert):
    with pytest.raises(InputError, match=r"must be of shape \(\.\.\., 3\) \(got \(2, 2, 4\)\)"):
        convert(np.ones((2, 2, 4)))
