"""Metameric inpainting on the GPU against its definition, stage by stage."""

import numpy as np
import pytest

from pipeline.colour import RGB_FROM_YCBCR, ycbcr_from_rgb
from pipeline.features.reference import analyse, spoiled_levels
from pipeline.gl.texture import read_back
from pipeline.inpaint.reference import (
    GuidedLevel,
    children,
    guide_from_depth,
    guided_base,
    near_a_hole,
    pull,
    pull_push,
    push,
)
from pipeline.inpaint.regions import STATISTICS_RINGS
from pipeline.noise.gains import fitted_mixing
from pipeline.noise.tile import TEXELS_PER_PX, noise_bands
from pipeline.statistics.moments import known_background, moments, noise_variances
from pipeline.statistics.reference import outlined_levels
from pipeline.synthesis.reference import deviations, sample, shaped_noise
from pipeline.synthesis.settings import MetamericSettings

Z_NEAR_M = 1.0
THRESHOLD = MetamericSettings().depth_threshold
ROUNDOFF = 2.0**-24  # of one float32 operation
# Roundings; GUIDED and LOW_BAND are derived in test_inpaint_gpu.py and test_features_gpu.py.
GUIDED = 9 + 13 + 14  # of one pull and push, gamma from 0, 0.25, 0.5, 1
LOW_BAND = 9  # of one level
BAND = 11  # of a coefficient from its 3x3 colours
SHARES = 9  # of a guided interpolation
LOOK_UP = 40  # of noise between texels, with its gain
LARGEST_GAIN, GAIN_SLOPE = 1.4, 0.6  # over all of mixing.json; the latter per texel of an axis


def moment_tolerances(run, fill, k):
    """Bound the five moments of level k, absolute, by the coefficients of this frame."""
    resolutions = max(1, int(np.ceil(np.log2(max(run.frame.size)))))
    largest = np.abs(analyse(ycbcr_from_rgb(fill.base), k + 1).bands[k]).max()
    base = GUIDED * resolutions * ROUNDOFF
    # Taps' magnitudes sum to 0.733 at most, and each difference has two colours.
    band = 2 * 0.733 * (base + LOW_BAND * k * ROUNDOFF) + BAND * 0.733 * ROUNDOFF
    return first_and_second(band, largest, GUIDED * resolutions, run.settings.channels)


def first_and_second(band, largest, pooled, channels):
    """Bound first and second moments, in their order, of coefficients that are `band` off."""
    first = band + pooled * largest * ROUNDOFF
    second = 2 * largest * band + (1 + pooled) * largest**2 * ROUNDOFF
    of_chroma = second if channels == "correlated" else first
    return np.array([first, first, second, of_chroma, of_chroma])


def variance_tolerance(bands, variance):
    """Bound a variance made from given moments and colours, absolute.

    Its terms and those of the base's energy, measured or a share of it, are at most
    (2 x largest)^2 and cost 11 roundings: of a share a division and a mix, of a variance two,
    their product and difference. A coefficient's own error, BAND, counts twice its
    size twice.
    """
    largest = np.abs(bands).max()
    off = (11 * (2 * largest) ** 2 + 2 * (2 * largest) * BAND * 0.733) * ROUNDOFF
    return off + 20 * variance * ROUNDOFF


def noise_tolerance(run, lacking, guide, anchor_px):
    """Bound the colour that given variances and base lead to, absolute: (H, W, 3).

    Interpolation of variances costs SHARES and 4 roundings, their root half of it and 4 of its
    own. Luma's are positive. Chroma's may cancel, so their magnitudes count. Where a place is off,
    so are noise, by what neighbouring texels differ along both axes, and its gain.
    """
    settings = run.settings
    cross = settings.channels == "correlated"
    noise = noise_bands(3, settings.levels, 1 if cross else 3)
    farthest_px = np.abs(anchor_px).max() + max(run.frame.size)
    moved_px = ROUNDOFF * farthest_px
    total = np.zeros((*run.frame.size, 3))
    for k, level in enumerate(lacking):
        tile = noise.tiles[k].astype(np.float64)
        tallest = np.abs(tile).max()
        step = max(np.abs(tile - np.roll(tile, 1, axis)).max() for axis in (1, 2))
        slope = 2 * TEXELS_PER_PX * (LARGEST_GAIN * step + GAIN_SLOPE * tallest)
        size = GuidedLevel(np.abs(level.values), level.validity, level.guide)
        here = sample(size, guide, k + 1, settings.depth_threshold)
        here = deviations(here.reshape(*run.frame.size, 3, 3), cross=cross)
        roundings = LOOK_UP + SHARES + 10
        off = roundings * ROUNDOFF * LARGEST_GAIN * tallest + slope * moved_px
        total += off * here.sum(axis=2)
    return (settings.noise * total + 8 * ROUNDOFF) @ np.abs(RGB_FROM_YCBCR).T


def test_the_look_up_s_gain_is_within_what_the_tolerance_says():
    """From texel to texel, every hundredth: the gain of `look_up`, and how it changes."""
    x = np.linspace(0, 1, 101)
    y = x[:, None]
    a, b, c, d = (1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y
    for levels in range(1, 7):
        lag = fitted_mixing(levels).lag_correlation.reshape(-1, 4, 1, 1).astype(np.float64)
        pairs = (a * b + c * d, a * c + b * d, a * d, b * c)
        twice = 2 * sum(lag[:, index] * pair for index, pair in enumerate(pairs))
        gain = 1 / np.sqrt(a * a + b * b + c * c + d * d + twice)
        assert 1.2 < gain.max() < LARGEST_GAIN
        assert (
            0.4 < 100 * max(np.abs(np.diff(gain, axis=axis)).max() for axis in (1, 2)) < GAIN_SLOPE
        )


class Stages:
    """State of the GPU after a fill, as the reference would have it."""

    def __init__(self, run):
        frame, fill_pass = run.frame, run.fill_pass
        self.filled = run()[..., :3]
        levels, sizes = run.settings.levels, fill_pass.base.resolutions.sizes
        texels = read_back(fill_pass.variances.texels)
        self.moments, self.validity, self.lacking, self.guides = [], [], [], []
        for k in range(levels):
            columns, rows = sizes[k + 2]
            chains = read_back(fill_pass.variances.chain.at(k + 2)).reshape(-1, rows, columns, 4, 4)
            planes = chains[k].astype(np.float64)
            magnitude, itself, blue, red = np.moveaxis(planes[..., :3], -2, 0)
            of_band = [itself, magnitude, planes[..., 1:, 3], blue, red]
            self.moments.append(np.stack(of_band, axis=-1).reshape(rows, columns, 15))
            self.validity.append(planes[..., 0, 3])
            width, height, left, top = fill_pass.variances.places[k]
            here = texels[top : top + height, left : left + 3 * width].astype(np.float64)
            here = here.reshape(height, width, 3, 4)
            bands = here[..., :3].reshape(*here.shape[:2], 9)
            self.lacking.append(bands)
            self.guides.append(here[:, :, 0, 3])
        lows = [read_back(low) for low in fill_pass.low_bands._coarser]
        run.load()
        fill_pass.base(run.textures.colour, run.textures.depth_m, Z_NEAR_M)
        self.base = read_back(run.textures.colour)[..., :3].astype(np.float64)
        self.bands = [
            analyse(ycbcr_from_rgb(np.nan_to_num(colour.astype(np.float64))), 1).bands[0]
            for colour in (self.base, *(low[..., :3] for low in lows))
        ]
        np.testing.assert_array_equal(self.base[~frame.hole], frame.colour[~frame.hole])


def taps(texels):
    """Tell which of the next coarser texels push reads for these."""
    rows, columns = np.nonzero(texels)
    read = np.zeros([-(-edge // 2) for edge in texels.shape], bool)
    near = rows >> 1, columns >> 1
    far = [
        np.clip(own + 2 * (axis & 1) - 1, 0, edge - 1)
        for own, axis, edge in zip(near, (rows, columns), read.shape, strict=True)
    ]
    for row in (near[0], far[0]):
        for column in (near[1], far[1]):
            read[row, column] = True
    return read


@pytest.mark.parametrize("channels", ["correlated", "independent"])
@pytest.mark.parametrize("size", [(61, 83), (130, 301)])
def test_every_stage_on_gpu_matches_reference(prepare, rng, size, channels, disc_scene):
    """Completed moments of 4x4; then each later stage from what the GPU gave it."""
    run = prepare(disc_scene(rng, size), channels=channels, levels=3)
    stages, fill = Stages(run), run.reference()
    cross, hole = channels == "correlated", run.frame.hole
    base_levels = guided_base(
        run.frame.colour,
        hole,
        guide_from_depth(run.frame.depth_m, Z_NEAR_M),
        levels=3,
        gamma=run.settings.gamma,
        threshold=THRESHOLD,
    )
    guides = [level.guide for level in base_levels]
    outlined, spoiled = outlined_levels(guides, 3, THRESHOLD), spoiled_levels(hole, 3)
    exact_bands = analyse(ycbcr_from_rgb(fill.base), 3).bands
    for k in range(3):
        near = near_a_hole(hole, k, STATISTICS_RINGS, k + 1)[:: 1 << k, :: 1 << k]
        valid = (near & ~spoiled[k] & ~outlined[k]).astype(float)
        wanted = run.needed(k)
        read = taps(wanted)

        measured = GuidedLevel(moments(exact_bands[k], cross=cross), valid, guides[k])
        exact = pull_push(measured, run.settings.gamma, THRESHOLD)[2]
        # Validity stays as first pulled, and push never touches certain texels.
        np.testing.assert_array_equal(stages.validity[k][read], exact.validity[read])
        off = np.abs(stages.moments[k] - exact.values)[read].reshape(-1, 5)
        assert (off <= moment_tolerances(run, fill, k)).all()
        np.testing.assert_allclose(
            stages.guides[k][wanted], guides[k + 1][wanted], rtol=0, atol=6 * ROUNDOFF
        )

        across = children(outlined[k][..., None].astype(float)).any(axis=2)[..., 0]
        assert across[wanted].any()
        assert not across[wanted].all()
        given = np.where(read[..., None], stages.moments[k], 0.0)
        completed = push(
            pull(GuidedLevel(moments(stages.bands[k], cross=cross), valid, guides[k]), THRESHOLD),
            GuidedLevel(given, exact.validity, guides[k + 2]),
            run.settings.gamma,
            THRESHOLD,
        )
        right = noise_variances(
            completed.values,
            stages.bands[k],
            outlined[k],
            known_background(base_levels[k + 1], THRESHOLD),
            cross=cross,
        )
        first = 1 if cross else 3  # a slope's error has no bound where luma has no variance
        found, right = (
            values[wanted].reshape(-1, 3, 3)[..., :first] for values in (stages.lacking[k], right)
        )
        largest = np.abs(stages.bands[k]).max()
        mean, *_ = first_and_second(BAND * 0.733 * ROUNDOFF, largest, GUIDED, channels)
        # Of twice two squares, and of the base's energy about the mean.
        off = (2 * 4 + 4) * largest * mean
        tolerance = variance_tolerance(stages.bands[k], right) + off
        assert (np.abs(found - right) <= tolerance).all()

    guide = guide_from_depth(run.frame.depth_m, Z_NEAR_M)
    lacking = [
        GuidedLevel(np.where(run.needed(k)[..., None], values, 0.0), exact.validity, exact.guide)
        for k, (values, exact) in enumerate(zip(stages.lacking, fill.statistics, strict=True))
    ]
    noise = noise_bands(3, 3, 1 if cross else 3)
    added = shaped_noise(lacking, guide, fill.anchor_px, noise, run.settings.depth_threshold)
    colour = (stages.base + added @ RGB_FROM_YCBCR.T).clip(0, 1)
    tolerance = noise_tolerance(run, lacking, guide, fill.anchor_px)
    assert (np.abs(stages.filled - colour) <= tolerance)[hole].all()
    assert np.median(tolerance[hole]) < 2.0**-9  # a bound that bounds something
