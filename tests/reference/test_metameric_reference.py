"""Shaping the noise, worked by hand, and what settings refuse."""

import inspect

import numpy as np
import pytest

from pipeline.colour import ycbcr_from_rgb
from pipeline.errors import InputError
from pipeline.features.reference import analyse
from pipeline.frame import WarpedFrame, check_seed
from pipeline.inpaint.reference import GuidedLevel, guided_base
from pipeline.methods.metameric import PushPullDepth
from pipeline.statistics.moments import known_background, luma_moments, noise_variances
from pipeline.statistics.reference import inpainted_statistics
from pipeline.synthesis.reference import deviations, metameric_fill, sample
from pipeline.synthesis.settings import MetamericSettings


def statistics(mean, magnitude, square, of_chroma):
    """One texel: the same in all three bands."""
    return np.tile([mean, magnitude, square, *of_chroma], 3).reshape(1, 1, 15)


def lacking(values, base, *, outlined=False, known=0.0, cross=False):
    """Of one texel, (9,)."""
    across = np.zeros((2, 2), bool)
    across[1, 0] = outlined
    return noise_variances(values, base, across, np.full((1, 1), known), cross=cross)[0, 0]


def test_noise_is_what_the_statistics_ask_for_and_the_base_lacks():
    """By hand: luma's variance is 2 (0.5^2 - 0.4^2) = 0.18, and the base holds 0.05 of it."""
    values = statistics(0.4, 0.5, 0.3, [0.1, 0.0])
    base = np.zeros((2, 2, 3, 3))
    base[..., 0] = 0.4 + np.sqrt(0.05) * np.array([[1, -1], [1, -1]])[..., None]

    found = lacking(values, base)

    np.testing.assert_allclose(found, np.tile([0.13, 0.02, 0.0], 3), atol=1e-12)


def test_a_base_with_more_than_is_wanted_gets_no_noise():
    base = np.tile([[1.0, -1.0]], (2, 1))[..., None, None] * np.ones((3, 3))

    assert lacking(statistics(0.0, 0.5, 0.5, [0.5, 0.5]), base).max() == 0


def test_a_ramp_is_no_texture():
    """A band that is the same everywhere asks for nothing, whether the base goes on or is flat."""
    for of_base in (0.0, 0.3):
        base = np.zeros((2, 2, 3, 3))
        base[..., 0] = of_base
        assert lacking(statistics(0.3, 0.3, 0.09, [0.0, 0.0]), base, cross=True).max() == 0


@pytest.mark.parametrize(
    ("known", "held"), [(0.0, 0.0), (0.05, 0.25), (0.1, 0.5), (0.2, 1.0), (1.0, 1.0)]
)
def test_beside_an_outline_the_base_holds_what_its_known_background_continues(known, held):
    """The outline itself, 9 of energy in one coefficient, is no texture of the background."""
    base = np.zeros((2, 2, 3, 3))
    base[1, 0] = 3.0

    wanted = statistics(0.0, 0.2, 0.0, [0.2, 0.2])
    found = lacking(wanted, base, outlined=True, known=known)

    np.testing.assert_allclose(found, 0.08 * (1 - held), atol=1e-15)


def test_known_background_is_counted_in_a_3x3_window_but_not_what_is_nearer():
    """By hand, weights of 16: 4 here, 2 beside, 1 across. The right column lies in front."""
    validity = np.array([[0.0, 0.0, 1.0], [0.5, 0.0, 1.0], [-1.0, 0.25, 1.0]])
    guide = np.full((3, 3), 0.5)
    guide[:, 2] = 0.4
    base = GuidedLevel(np.zeros((3, 3, 3)), validity, guide)

    behind, everything = (known_background(base, threshold) for threshold in (0.04, 0.2))

    assert behind[1, 1] == (2 * 0.5 + 2 * 0.25) / 16
    assert everything[1, 1] == behind[1, 1] + (1 + 2 + 1) / 16
    # What is in front has its own kind and what lies behind that; borders repeat.
    assert behind[0, 2] == 12 / 16
    assert behind[1, 2] == (12 + 0.25) / 16


def beside_red(plane, first, *, skip_depth_edges):
    """Statistics and what is lacking; red in front up to column 16, a hole from `first` to 26."""
    size = (32, 48)
    hole = np.zeros(size, bool)
    hole[:, first:26] = True
    base = np.where(hole[..., None], 0.5, plane)
    base[:, :16] = (0.9, 0.1, 0.1)
    guide = np.full(size, 0.8)
    guide[:, :16] = 0.5
    levels = guided_base(base, hole, guide, levels=2, gamma=0.25, threshold=0.04)
    return inpainted_statistics(
        analyse(ycbcr_from_rgb(base), 2).bands,
        hole,
        levels,
        cross=True,
        gamma=0.25,
        threshold=0.04,
        skip_depth_edges=skip_depth_edges,
    )


@pytest.mark.parametrize("skip_depth_edges", [True, False])
@pytest.mark.parametrize(("level", "first"), [(0, 18), (1, 22)])
def test_an_outline_enters_the_statistics_only_if_told_so(level, first, skip_depth_edges):
    """The plane has no texture: what a coefficient there holds is the edge of red.

    The hole starts so far from it that one such coefficient of that level reaches no hole.
    """
    plane = np.full((32, 48, 3), 0.5)

    statistics, _ = beside_red(plane, first, skip_depth_edges=skip_depth_edges)

    largest = np.abs(statistics[level].values[:, first >> (level + 1)]).max()
    assert (largest < 1e-12) if skip_depth_edges else (largest > 1e-3)


@pytest.mark.parametrize("skip_depth_edges", [True, False])
def test_beside_an_outline_a_hole_lacks_what_is_wanted_only_if_told_so(skip_depth_edges, rng):
    """Its left texels have no known background around them, and red's outline among theirs."""
    plane = 0.5 + 0.02 * rng.standard_normal((32, 48, 3))

    statistics, lacking = beside_red(plane, 16, skip_depth_edges=skip_depth_edges)

    _, variance = luma_moments(statistics[0].values)
    wanted, found = variance[:, 8], lacking[0].values[:, 8, :9:3]
    assert wanted.min() > 0
    if skip_depth_edges:
        np.testing.assert_allclose(found, wanted, rtol=1e-12)
    else:
        np.testing.assert_array_equal(found[:, :2], 0)  # high and along x see an upright edge


def test_chroma_follows_luma_by_its_slope():
    """By hand: products of -0.03 and 0.015 over squares of 0.06: slopes of -0.5 and 0.25."""
    values = statistics(0.0, np.sqrt(0.02), 0.06, [-0.03, 0.015])

    found = lacking(values, np.zeros((2, 2, 3, 3)), cross=True)

    np.testing.assert_allclose(found, np.tile([0.04, -0.02, 0.01], 3))
    amplitude = deviations(found.reshape(3, 3), cross=True)
    np.testing.assert_allclose(amplitude, np.tile([0.2, -0.1, 0.05], (3, 1)))


def test_independent_channels_have_deviations_of_their_own_and_nothing_lacks_nothing():
    found = deviations(np.array([[0.04, 0.09, 0.0]]), cross=False)

    np.testing.assert_allclose(found, [[0.2, 0.3, 0.0]])
    np.testing.assert_array_equal(deviations(np.zeros((2, 3)), cross=True), 0)


def test_variances_are_interpolated_and_not_deviations():
    """By hand: halfway between a variance of 1 and one of 0 the deviation is root 1/2."""
    lacking = GuidedLevel(
        np.repeat([[[1.0], [0.0]]], 9, axis=2), np.ones((1, 2)), np.full((1, 2), 0.5)
    )
    lacking.values[..., [1, 2, 4, 5, 7, 8]] = 0.0

    mixed = sample(lacking, np.full((1, 4), 0.5), 1, 0.04)[0].reshape(4, 3, 3)

    found = deviations(mixed, cross=True)[..., 0]
    np.testing.assert_allclose(found[1:3, 0] ** 2, [0.75, 0.25])


def test_amplitudes_are_interpolated_between_texel_centres():
    """By hand, resolution 1: pixel 1 lies a quarter of the way from texel 0 to texel 1."""
    coarse = GuidedLevel(np.array([[[0.0], [4.0]]]), np.ones((1, 2)), np.full((1, 2), 0.5))

    found = sample(coarse, np.full((1, 4), 0.5), 1, 0.04)

    np.testing.assert_allclose(found[0, :, 0], [0, 1, 3, 4])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("levels", 0),
        ("levels", 7),
        ("gamma", -0.1),
        ("noise", -1.0),
        ("depth_threshold", 0.0),
        ("depth_threshold", float("nan")),
        ("channels", "grey"),
        ("anchor", "sky"),
    ],
)
def test_settings_out_of_range_are_refused_by_name(name, value):
    with pytest.raises(InputError, match=rf"^{name} must .*\(got "):
        MetamericSettings(**{name: value})


def test_the_defaults_are_those_of_the_decisions():
    """docs/decisions/0065; push-pull-depth is metameric's base."""
    settings = MetamericSettings()
    of_depth_alone = inspect.signature(PushPullDepth).parameters

    assert (settings.levels, settings.gamma) == (2, 0.25)
    assert of_depth_alone["gamma"].default == settings.gamma
    assert of_depth_alone["depth_threshold"].default == settings.depth_threshold


@pytest.mark.parametrize("seed", [0, 2**63 - 1, np.int64(7), np.uint8(7)])
def test_a_whole_number_is_a_seed(seed):
    assert check_seed(seed) == int(seed)
    assert type(check_seed(seed)) is int


@pytest.mark.parametrize("seed", [-1, 2**63, 2**200, 1.0, 1.5, float("nan"), True, None, "1"])
def test_what_is_no_seed_is_refused(seed):
    with pytest.raises(InputError, match=r"^seed must be a whole number from 0 .*\(got "):
        metameric_fill(hole_frame(), MetamericSettings(levels=1), seed=seed, z_near_m=1.0)


def hole_frame(flow_px=(0.0, 0.0), depth_m=2.0):
    """Give 16x24 pixels of noise with a hole in the middle."""
    hole = np.zeros((16, 24), bool)
    hole[5:11, 8:16] = True
    return WarpedFrame(
        np.random.default_rng(0).random((16, 24, 3), np.float32),
        np.full((16, 24), depth_m, np.float32),
        hole,
        np.broadcast_to(np.float32(flow_px), (16, 24, 2)).copy(),
    )


def on_screen(frame=None):
    settings = MetamericSettings(levels=1, anchor="screen")
    return metameric_fill(frame or hole_frame(), settings, seed=1, z_near_m=1.0)


def test_noise_sticks_to_the_screen_where_the_motion_is_out_of_all_bounds():
    frame = hole_frame(flow_px=(1e30, 0.0))

    fill = metameric_fill(frame, MetamericSettings(levels=1), seed=1, z_near_m=1.0)

    np.testing.assert_array_equal(fill.colour, on_screen().colour)
