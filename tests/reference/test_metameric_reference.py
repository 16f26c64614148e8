"""Shaping the noise, worked by hand, and what settings refuse."""

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.inpaint.reference import Level
from pipeline.synthesis.reference import noise_amplitudes, sample
from pipeline.synthesis.settings import MetamericSettings


def statistics(mean, second):
    """One texel: the same mean and second moments in all three bands."""
    return np.tile(np.concatenate([mean, second]), 3).reshape(1, 1, 18)


def test_noise_is_what_the_statistics_ask_for_and_the_base_lacks():
    """By hand: variance 0.25 - 0.16 = 0.09; the base holds 0.05 of it: root of 0.04."""
    values = statistics([0.4, 0.0, 0.0], [0.25, 0.01, 0.0])
    around = 0.4 + np.sqrt(0.05) * np.array([1, -1, 1, -1])
    base = np.zeros((2, 2, 3, 3))
    base[..., 0] = around.reshape(2, 2, 1)

    found = noise_amplitudes(values, base, cross=False)

    np.testing.assert_allclose(found, np.tile([0.2, 0.1, 0.0], 3).reshape(1, 1, 9), atol=1e-12)


def test_a_base_with_more_than_is_wanted_gets_no_noise():
    base = np.tile([[1.0, -1.0]], (2, 1))[..., None, None] * np.ones((3, 3))

    assert noise_amplitudes(statistics([0, 0, 0], [0.5] * 3), base, cross=False).max() == 0


def test_chroma_follows_luma_by_its_slope():
    """By hand: var Y 0.04, cov(Y, Cb) -0.02, cov(Y, Cr) 0.01: slopes -0.5 and 0.25."""
    values = statistics([0, 0, 0], [0.04, -0.02, 0.01])

    found = noise_amplitudes(values, np.zeros((2, 2, 3, 3)), cross=True)

    np.testing.assert_allclose(found, np.tile([0.2, -0.1, 0.05], 3).reshape(1, 1, 9))


def test_amplitudes_are_interpolated_between_texel_centres():
    """By hand, resolution 1: pixel 1 lies a quarter of the way from texel 0 to texel 1."""
    coarse = Level(np.array([[[0.0], [4.0]]]), np.ones((1, 2)), np.full((1, 2), 0.5))

    found = sample(coarse, np.full((1, 4), 0.5), 1, 0.04)

    np.testing.assert_allclose(found[0, :, 0], [0, 1, 3, 4])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("levels", 0),
        ("levels", 7),
        ("gamma", -0.1),
        ("base_gamma", 9.0),
        ("noise", -1.0),
        ("depth_threshold", 0.0),
        ("depth_threshold", float("nan")),
        ("channels", "grey"),
        ("anchor", "sky"),
        ("texture", "wood"),
    ],
)
def test_settings_out_of_range_are_refused_by_name(name, value):
    with pytest.raises(InputError, match=rf"^{name} must .*\(got "):
        MetamericSettings(**{name: value})
