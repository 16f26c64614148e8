"""The noise: unit variance per band, tileable, the same everywhere, as strong as asked for."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from benchmarks.fits.fit_mixing import SPECTRA, deviations_of
from pipeline.features.reference import analyse, band, double, fitted_kernels
from pipeline.noise import tile
from pipeline.noise.gains import (
    AIM,
    LAGS,
    LEAST_GAIN,
    MOST_GAIN,
    fitted_mixing,
    in_pairs,
    measured_variances,
    overlap_by_levels,
    packed,
    spectral_gains,
    unpacked,
)
from pipeline.noise.tile import (
    GRAIN,
    TAP_BITS,
    TILE,
    TILE_TEXELS,
    WHITE_BITS,
    WHITE_DEVIATION,
    NoiseBands,
    Stream,
    look_up,
    midway,
    noise_bands,
    noise_taps,
    split,
    white_noise,
    white_steps,
)
from pipeline.noise.tile import unit as unit_band

LEVELS = 6
# Of seed 7: a place of white noise, and texels of two tiles.
GOLDEN_WHITE = [-3759, 7345, -5387]
GOLDEN_FINE = [0.1248593, -0.6745697, 0.7887821]
GOLDEN_COARSE = [0.3136276, 1.0196657, 0.1955212]
GOLDEN_MIXED = [0.4211520, -0.3594691, 0.4533142]
GOLDEN_BETWEEN = [0.8543282, -0.4798307, 0.1698408]  # half a pixel below


@pytest.fixture(scope="module")
def noise():
    return noise_bands(7, LEVELS, 3)


@pytest.fixture(scope="module")
def unit():
    """The same seed's bands before they are mixed."""
    return unit_bands(7, LEVELS, 3)


def at_pixels(noise):
    """Tiles without the texels between: (levels, channels, TILE, TILE, 3)."""
    return noise.tiles[:, :, ::2, ::2].astype(np.float64)


def unit_bands(seed, levels, channels, edge=TILE):
    """Unmixed bands, (levels, channels, edge, edge, 3), each of unit variance."""
    bands = split(white_steps(seed, (edge, edge), channels), levels)
    units = [[[unit_band(one) for one in band] for band in level] for level in bands]
    return np.moveaxis(np.array(units), 1, -1)


def deviations(white, levels):
    """Deviation of every band's coefficients, (levels, 3, channels), with the tile repeated.

    A border of a quarter of the tile is enough: a whole tile about it gives the same to the bit.
    """
    margin = TILE // 4
    pyramid = analyse(np.pad(white, ((margin,) * 2,) * 2 + ((0, 0),), mode="wrap"), levels)
    return [
        bands[edge:-edge, edge:-edge].std(axis=(0, 1))
        for bands, edge in ((b, margin >> level) for level, b in enumerate(pyramid.bands))
    ]


def test_noise_has_the_stated_shape_and_no_offset(noise):
    assert noise.tiles.shape == (LEVELS, 3, TILE_TEXELS, TILE_TEXELS, 3)
    assert noise.lag_correlation.shape == (LEVELS, 3, len(LAGS))
    means = noise.tiles.astype(np.float64).mean(axis=(2, 3))
    assert np.abs(means).max() < 0.01


@pytest.mark.slow
def test_every_band_is_white_noise_through_its_filters_softened_and_without_a_seam():
    """Undo by hand what is said to be done: analysis, synthesis, low-pass there and back.

    Made here from 7 tiles side by side, so that no border reaches the middle one, by a library's
    convolution with the low-pass's own correlation, it must be the same.
    """
    edge, beside = 128, 3  # three tiles are 12 coefficients of the last level; filters reach 10
    unit = unit_bands(7, LEVELS, 1, edge)
    margin = beside * edge
    white = white_noise(7, (edge, edge), 1)
    periodic = np.pad(white, ((margin,) * 2,) * 2 + ((0, 0),), mode="wrap")
    kernels = fitted_kernels()
    low = signal.correlate2d(kernels.low, kernels.low)

    def softened(image):
        return signal.convolve2d(image[..., 0], low, mode="same", boundary="wrap")[..., None]

    for level, bands in enumerate(analyse(periodic, LEVELS).bands):
        for index, kernel in enumerate(kernels.bands()):
            image = band(bands[:, :, index], kernel[::-1, ::-1])
            image = softened(image) if index > 0 else image
            for finer in reversed(range(level)):
                image = softened(double(image, ((2 * margin + edge) >> finer,) * 2))
            expected = image[margin:-margin, margin:-margin, 0]

            # Nothing of the border reaches the tile: it repeats without a seam. Steps are rounded.
            expected = expected / expected.std()
            np.testing.assert_allclose(unit[level, 0, ..., index], expected, rtol=0, atol=0.02)


def test_taps_are_those_of_the_pyramid_in_whole_numbers_and_bands_have_no_offset():
    kernels, taps = fitted_kernels(), noise_taps()
    low = signal.correlate2d(kernels.low, kernels.low)
    for found, expected in ((taps.halving, 2 * kernels.low), (taps.soft, 4 * low)):
        np.testing.assert_allclose(found / 2.0**TAP_BITS, expected, rtol=0, atol=2**-TAP_BITS / 2)
    for found in (taps.high, taps.oriented):
        assert found.sum() == 0
        np.testing.assert_array_equal(found, found[::-1, ::-1])


def test_a_pixel_comes_up_doubled_and_softened():
    """Through a library's convolution; where it lies in the coarse image says the phase."""
    coarse = np.zeros((1, 12, 12), np.int32)
    coarse[0, 5, 6] = 1 << 12
    fine = np.empty((1, 24, 24), np.int32)
    tile._raise(coarse, fine, noise_taps().raising)

    kernels = fitted_kernels()
    low = signal.correlate2d(kernels.low, kernels.low)
    plain = double(coarse[0, ..., None].astype(np.float64), (24, 24), kernels)[..., 0]
    expected = signal.convolve2d(plain, low, mode="same", boundary="wrap")
    np.testing.assert_allclose(fine[0], expected, rtol=0, atol=1)


def test_white_noise_is_white_again():
    """Mixed bands of white noise's own deviations, with their gains: a flat spectrum.

    In octaves: within a fifth in amplitude of its mean, but for what lies below the last level.
    """
    white = 0.1 * deviations_of(4, 0.0)
    given = (white * spectral_gains(white**2, fitted_mixing(4).overlap) / AIM).reshape(4, 3)
    power = np.zeros((TILE, TILE))
    for seed in range(4):
        total = np.einsum("lyxb,lb->yx", at_pixels(noise_bands(seed, 4, 1))[:, 0], given)
        power += np.abs(np.fft.fft2(total)) ** 2
    axis = np.abs(np.fft.fftfreq(TILE))
    radius = np.maximum.outer(axis, axis)

    edges = 0.5 * 2.0 ** -np.arange(4)
    octaves = [power[(radius <= high) & (radius > high / 2)].mean() for high in edges]

    np.testing.assert_allclose(np.sqrt(octaves / np.mean(octaves)), 1, rtol=0, atol=0.2)


def test_the_same_seed_gives_the_same_noise_and_another_one_other():
    one, again, other = (unit_bands(seed, 1, 1) for seed in (7, 7, 8))

    assert again.tobytes() == one.tobytes()
    correlation = np.corrcoef(one[..., 0].ravel(), other[..., 0].ravel())
    assert abs(correlation[0, 1]) < 0.02


def test_white_noise_is_even_and_no_place_tells_of_another():
    """Of every stream of two seeds: moments of an even spread, and no correlation nearby."""
    found = np.stack(
        [white_steps(seed, (256, 256), 3, stream) for seed in (0, 1) for stream in Stream]
    ).reshape(-1, 256, 256)
    assert (found % 2 == 1).all()
    assert np.abs(found).max() == 2**WHITE_BITS - 1
    ours = found / WHITE_DEVIATION
    for power, expected in ((1, 0), (2, 1), (3, 0), (4, 1.8)):
        np.testing.assert_allclose((ours**power).mean(axis=(1, 2)), expected, rtol=0, atol=0.05)
    for shift in ((0, 1), (1, 0), (1, 1), (0, 2), (16, 0), (0, 128)):
        beside = (ours * np.roll(ours, shift, (1, 2))).mean(axis=(1, 2))
        np.testing.assert_allclose(beside, 0, rtol=0, atol=5 / 256)
    between_streams = np.corrcoef(ours.reshape(len(ours), -1)) - np.eye(len(ours))
    assert np.abs(between_streams).max() < 5 / 256


def test_channels_are_independent(noise):
    bands = at_pixels(noise)[0, ..., 0].reshape(3, -1)

    off_diagonal = np.corrcoef(bands) - np.eye(3)

    assert np.abs(off_diagonal).max() < 0.02


def test_noise_of_a_seed_never_changes(noise, unit):
    """Stimuli shown to people are made again from their seeds: these numbers are for ever."""
    np.testing.assert_array_equal(white_steps(7, (3, 3), 3)[:, 1, 2], GOLDEN_WHITE)
    np.testing.assert_allclose(unit[0, 0, 5, 9], GOLDEN_FINE, atol=1e-6)
    np.testing.assert_allclose(unit[3, 2, 200, 100], GOLDEN_COARSE, atol=1e-6)
    np.testing.assert_allclose(noise.tiles[0, 0, 10, 18], GOLDEN_MIXED, atol=1e-6)
    np.testing.assert_allclose(noise.tiles[0, 0, 11, 18], GOLDEN_BETWEEN, atol=1e-6)


def test_what_lies_between_pixels_is_rounded(noise):
    """So that a transform's order of sums cannot be seen."""
    for between_rows_or_columns in (noise.tiles[:, :, 1::2], noise.tiles[:, :, :, 1::2]):
        assert not (between_rows_or_columns / np.float32(GRAIN) % 1).any()
    assert (noise.tiles[:, :, ::2, ::2] / np.float32(GRAIN) % 1).any()


def test_fewer_levels_are_the_first_of_more():
    np.testing.assert_array_equal(unit_bands(7, 2, 1), unit_bands(7, 4, 1)[:2])


def test_mixed_bands_are_unit_bands_weighed_by_the_matrix(noise, unit):
    """Weighing mixed bands by s is weighing unit bands by T s."""
    matrix = fitted_mixing(LEVELS).matrix
    weights = np.random.default_rng(0).random((LEVELS, 3))

    found = np.einsum("lcyxb,lb->cyx", at_pixels(noise), weights)

    mixed = (matrix @ weights.ravel()).reshape(LEVELS, 3)
    expected = np.einsum("lcyxb,lb->cyx", unit, mixed)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-3)
    assert found.std() > 1


@pytest.mark.parametrize("levels", range(1, 7))
def test_the_mixing_treats_x_and_y_alike_and_couples_neighbouring_levels(levels):
    matrix = fitted_mixing(levels).matrix
    blocks = matrix.reshape(levels, 3, levels, 3)

    turned = blocks[:, [0, 2, 1]][:, :, :, [0, 2, 1]]

    np.testing.assert_array_equal(turned, blocks)
    far = np.abs(np.subtract.outer(np.arange(levels), np.arange(levels))) > 1
    assert not np.moveaxis(blocks, 2, 1)[far].any()


@cache
def grey_bands(seed: int, levels: int) -> NoiseBands:
    return noise_bands(seed, levels, 1)


@cache
def tiles_of(seed: int, levels: int) -> NDArray[np.float64]:
    return at_pixels(grey_bands(seed, levels))


@pytest.mark.parametrize(("exponent", "blur_px"), SPECTRA)
@pytest.mark.parametrize("levels", [3, 4, 6])
def test_mixed_bands_measure_as_they_were_weighed(levels, exponent, blur_px):
    """Of a texture of amplitude 1 / f^exponent, blurred, in the mean over seeds, with gains.

    Unmixed, a band may have half, or three times as much. On an endless plane mixing.json says
    7 to 10 %, before all are raised by AIM; the second level's high band is asked for less.
    """
    wanted = 0.1 * deviations_of(levels, exponent, blur_px=blur_px)
    given = (wanted * spectral_gains(wanted**2, fitted_mixing(levels).overlap) / AIM).reshape(-1, 3)
    ratios = np.zeros((levels, 3))
    for seed in range(4):
        total = np.einsum("lcyxb,lb->yxc", tiles_of(seed, levels), given)
        measured = np.array([spread[:, 0] for spread in deviations(total, levels)])
        ratios += (measured / wanted.reshape(-1, 3)) ** 2 / 4

    # Of the coarser levels a tile has too few coefficients to say.
    np.testing.assert_allclose(np.sqrt(ratios[:4]), 1, rtol=0, atol=0.13)


def test_gains_by_hand():
    """Two bands of variances .04 and .09: the first measures 4 times what it should.

    The second, overlapping the first by .1 in both orders, measures .09 + 2 * .1 * .2 * .3 at
    first, and then, for the first is halved, .09 g^2 + 2 * .1 * .1 * .3 g.
    """
    overlap = np.array([[[4.0, 0.0], [0.0, 0.0]], [[0.0, 0.1], [0.1, 1.0]]])

    found = spectral_gains(np.array([[0.04, 0.09]]), overlap)

    first = np.sqrt(0.09 / 0.102)
    second = first * np.sqrt(0.09 / (0.09 * first**2 + 0.006 * first))
    np.testing.assert_allclose(found, AIM * np.array([[0.5, second]]), rtol=1e-4)


def test_gains_are_bounded_and_leave_what_nobody_sees():
    overlap = np.array([[[100.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 0.01]]])

    seen, unseen = spectral_gains(np.array([[0.04, 0.04], [1e-12, 0.0]]), overlap)

    np.testing.assert_array_equal(seen, [AIM * LEAST_GAIN, AIM * MOST_GAIN])
    np.testing.assert_allclose(unseen, AIM, rtol=2e-4)


def test_covariances_are_halved_and_made_whole_again():
    half = np.random.default_rng(0).random((3, 3, 3))
    whole = half + half.transpose(0, 2, 1)

    np.testing.assert_array_equal(unpacked(packed(whole)), whole)
    assert packed(whole).shape == (3, 6)


def test_looking_up_texel_centres_gives_texels(noise):
    y, x = np.mgrid[:8, :8]
    anchor = np.stack([x + 0.5 + TILE, y + 0.5 - TILE], axis=-1)  # tiles repeat both ways

    found = look_up(noise, 2, anchor)

    expected = np.moveaxis(at_pixels(noise)[2][:, :8, :8], 0, -1)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("axis", [0, 1, -1])
def test_between_two_texels_lies_the_wave_itself(axis):
    """Waves worked by hand, at places and half-way; the highest frequency has no half-way."""

    def waves(place):
        return 0.5 + np.cos(np.pi / 4 * place + 0.3) + 2 * np.sin(3 * np.pi / 4 * place)

    place = np.arange(8)
    wave = waves(place) + 3 * np.cos(np.pi * place)
    tile = np.moveaxis(np.broadcast_to(wave, (4, 6, 8)), -1, axis)

    dense = np.moveaxis(midway(tile, axis), axis, -1)

    assert dense.shape[-1] == 16
    np.testing.assert_array_equal(dense[..., ::2], np.broadcast_to(wave, dense[..., ::2].shape))
    difference = dense[..., 1::2] - waves(place + 0.5)
    np.testing.assert_allclose(difference, 0, rtol=0, atol=2**-20)


def test_what_lies_between_pixels_measures_as_the_pixels_do(noise):
    """Every band by itself: the noise moved by half a pixel is as rough as it was."""
    phases = [noise.tiles[:, :, y::2, x::2].astype(np.float64) for y in (0, 1) for x in (0, 1)]

    still, *moved = (phase.var(axis=(1, 2, 3)) for phase in phases)

    # The highest frequencies of both axes: two in 256 of white noise, more of the finest band.
    np.testing.assert_allclose(moved, np.broadcast_to(still, (3, LEVELS, 3)), rtol=0.03)


OFFSETS = [(0.5, 0.0), (0.0, 0.5), (0.5, 0.5), (0.25, 0.75), (0.1, 0.9), (0.25, 0.0)]


@pytest.mark.parametrize("offset", OFFSETS)
@pytest.mark.parametrize("slope", [0.0, 0.5, 1.0, 1.5])
def test_a_sub_pixel_look_up_keeps_the_variance(offset, slope):
    """Of a texture of amplitude 1 / f^slope, within 1 %; without a gain up to half would go."""
    noise = grey_bands(7, 4)
    weights = [
        spread[:, 0] * 2 ** (level * slope)
        for level, spread in enumerate(deviations(white_noise(7, (TILE, TILE), 1), 4))
    ]
    y, x = np.mgrid[:TILE, :TILE] + 0.5

    still, moved = (
        sum(
            look_up(noise, level, np.stack([x + dx, y + dy], axis=-1))[..., 0] @ weights[level]
            for level in range(4)
        ).var()
        for dx, dy in ((0, 0), offset)
    )

    assert moved == pytest.approx(still, rel=0.01)


@pytest.mark.parametrize("offset", OFFSETS)
@pytest.mark.parametrize("level", range(LEVELS))
def test_a_sub_pixel_look_up_keeps_a_single_band_s_deviation(noise, level, offset):
    """Bands overlap: holding their sum leaves each by itself within 7 %."""
    y, x = np.mgrid[:TILE, :TILE] + 0.5

    moved = look_up(noise, level, np.stack([x + offset[0], y + offset[1]], axis=-1))

    still = at_pixels(noise)[level].std(axis=(0, 1, 2))
    np.testing.assert_allclose(moved.std(axis=(0, 1, 3)), still, rtol=0.07)


def test_a_look_up_without_its_gain_would_lose_variance(noise):
    """The fault that the tests above guard against: halfway between texels nearly half is gone."""
    tile = noise.tiles[0, 0, ..., 0].astype(np.float64)

    halfway = 0.25 * sum(np.roll(tile, shift, (0, 1)) for shift in ((0, 0), (0, 1), (1, 0), (1, 1)))

    assert halfway.var() < 0.6 * tile.var()


@pytest.mark.parametrize("levels", range(1, 7))
def test_sums_and_differences_measure_what_the_bands_themselves_do(rng, levels):
    """The same forms, as spectral_gains.glsl sums them."""
    overlap = fitted_mixing(levels).overlap
    wanted = rng.random((levels, 3))
    high, along_x, along_y = wanted.T
    asked = np.stack([high, along_x + along_y, along_x - along_y], axis=1)

    packed = overlap_by_levels(overlap)

    measured = np.zeros((levels, 3))
    for pair, (i, j) in enumerate(in_pairs(levels)):
        a, b = asked[i], asked[j]
        products = np.array([a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1], a[2] * b[2]])
        crossed = np.array([a[0] * b[2], a[2] * b[0], a[1] * b[2], a[2] * b[1]])
        for level, form in enumerate(packed[:, pair].astype(np.float64)):
            even = products @ form[:3].reshape(6, 2)[:5]
            odd = crossed @ form[3]
            measured[level] += even[0], even[1] + odd, even[1] - odd
    expected = measured_variances(wanted.ravel(), overlap).reshape(levels, 3)
    np.testing.assert_allclose(measured, expected, rtol=0, atol=2.0**-20)
