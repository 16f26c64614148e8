"""Metamers in numpy: selection, moments, synthesis, against closed forms and invariants."""

import numpy as np
import pytest
from skimage import data

from pipeline.colour import ycbcr_from_rgb
from pipeline.features.reference import analyse
from pipeline.foveation import reference
from pipeline.foveation.chain import chain_length, chain_of, enlarge, halve_around, select
from pipeline.foveation.displacement import (
    DisplacementSettings,
    displacement_px,
    eidolon,
    pooled_white_variance,
    unit_field,
    warped_metamer,
)
from pipeline.foveation.geometry import Equirectangular, Flat, pixel_centres
from pipeline.foveation.noise_plane import GRAIN, noise_plane, noise_tile, panorama_noise
from pipeline.foveation.pooled_moments import (
    LEAST_TIGHTNESS,
    PARTNER_SHARE,
    WantedMoments,
    colour_shape,
    wanted_by_blocks,
)
from pipeline.foveation.pooling import (
    HALVED_VARIANCE,
    MetamerSettings,
    Pooling,
    Pools,
    halving_variance,
    lod_of,
    make_pooling,
)
from pipeline.foveation.reference import (
    FIRST_SMOOTH,
    ROOMY,
    blur,
    blurred,
    lost_noise,
    metamer,
    metamer_parts,
    reach_of,
)
from pipeline.noise.tile import mixed_bands
from stimuli.score.statistics import statistics_distance

SETTINGS = MetamerSettings()


def constant(value):
    return lambda _: np.array([[float(value)]])


def photograph(edge):
    picture = data.astronaut()[:512, :512].astype(np.float32) / 255
    return np.ascontiguousarray(picture[:edge, 100 : 100 + edge])


def noise_picture(rng, size):
    return (0.5 + 0.12 * rng.standard_normal((*size, 1)).repeat(3, axis=2)).clip(0, 1)


def pools_of(height, width, gaze, law=None, **constants):
    return Pools(Flat(40).of(width, height), gaze, make_pooling(law, **constants))


@pytest.mark.parametrize("lod", [0, 0.4, 1, 1.5, 2.3, 3])
def test_selection_has_the_variance_that_its_lod_stands_for(lod):
    """Averaged over where the impulse lies: an interpolated chain is not the same everywhere."""
    edge, count, variances = 128, 4, []
    x = np.arange(edge) - edge / 2
    for offset in range(8):
        impulse = np.zeros((edge, edge, 1))
        impulse[edge // 2 + offset, edge // 2 + offset] = 1
        chosen = select(chain_of(impulse, count, wraps=False), constant(lod), wraps=False)[..., 0]
        assert chosen.sum() == pytest.approx(1, abs=1e-12)
        along = chosen.sum(axis=0)
        mean = (along * x).sum()
        variances.append((along * (x - offset) ** 2).sum())
        assert abs(mean - offset) <= 0.5 * 2**lod
    level = int(lod)
    expected = HALVED_VARIANCE * (4.0**level - 1 + 3 * 4.0**level * (lod - level))
    assert np.mean(variances) == pytest.approx(expected, rel=0.03, abs=1e-12)


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (7, 5), (64, 33)])
def test_constants_survive_selection_exactly(size):
    picture = np.full((*size, 3), 0.3)
    chain = chain_of(picture, chain_length(size[1], size[0]), wraps=False)
    chosen = select(chain, constant(0.7), wraps=False)
    np.testing.assert_allclose(chosen, 0.3, atol=1e-15)


@pytest.mark.parametrize("width", [16, 15])
def test_halving_and_doubling_wrap_as_if_the_picture_were_repeated(rng, width):
    image = rng.random((8, width, 2))
    thrice = np.concatenate([image] * 3, axis=1)
    if width % 2 == 0:
        plain = halve_around(thrice, wraps=False)[:, width // 2 : width]
        np.testing.assert_allclose(halve_around(image, wraps=True), plain, atol=1e-15)
        doubled = enlarge(thrice, (8, 6 * width), 1, wraps=False)[:, 2 * width : 4 * width]
        np.testing.assert_allclose(enlarge(image, (8, 2 * width), 1, wraps=True), doubled)
    else:
        np.testing.assert_allclose(halve_around(np.ones((8, width, 1)), wraps=True), 1, atol=1e-15)


def test_fovea_is_copied_bit_for_bit_and_the_rest_changes():
    picture = photograph(128)
    pools = pools_of(128, 128, (40, 70), fovea_deg=4)
    fovea = pools.eccentricity_deg() <= 4
    for result in (
        blur(picture, pools),
        metamer(picture, pools, SETTINGS, 1),
        warped_metamer(picture, pools, DisplacementSettings(), 1),
    ):
        assert result.dtype == np.float32
        assert (result[fovea] == picture[fovea]).all()
        assert np.abs(result - picture)[~fovea].mean() > 0.01
        assert result.min() >= 0
        assert result.max() <= 1


@pytest.mark.slow
def test_a_metamer_has_the_statistics_that_a_blur_of_equal_pooling_has_lost():
    """At most a quarter of the blur's distance; displacement at most half of the noise's."""
    picture = photograph(412)
    pools = pools_of(412, 412, (206, 206))
    blurry, noisy, warped = (
        statistics_distance(image, picture)
        for image in (
            blur(picture, pools),
            metamer(picture, pools, SETTINGS, 1),
            warped_metamer(picture, pools, DisplacementSettings(), 1),
        )
    )
    assert noisy < 0.25 * blurry
    assert warped < 0.5 * noisy


def test_flat_pictures_stay_flat():
    picture = np.full((96, 96, 3), (0.2, 0.5, 0.7), np.float32)
    pools = pools_of(96, 96, (10, 10))
    for result in (
        metamer(picture, pools, SETTINGS, 3),
        warped_metamer(picture, pools, DisplacementSettings(), 3),
    ):
        np.testing.assert_allclose(result, picture, atol=1e-6)


def test_the_same_seed_is_bit_identical_and_another_is_uncorrelated():
    picture = photograph(256)
    pools = pools_of(256, 256, (128, 128))
    first, again, other = (metamer_parts(picture, pools, SETTINGS, s).noise for s in (1, 1, 2))
    assert (first == again).all()
    far = pools.eccentricity_deg() > 5
    correlation = np.corrcoef(first[far][:, 0], other[far][:, 0])[0, 1]
    assert abs(correlation) < 0.2  # four deviations of it: coarse noise has few places


@pytest.mark.parametrize("exponent", [0.0, 1.0, 1.5])
def test_noise_has_the_variance_that_its_pools_have_lost(rng, exponent):
    """Section 11: ratio .85 to 1.15 of every band on noise of three spectra, pools from 6 px."""
    edge = 256
    frequency = np.hypot(np.fft.fftfreq(edge)[:, None], np.fft.fftfreq(edge)[None, :])
    spectrum = (
        np.fft.fft2(rng.standard_normal((edge, edge))) / np.maximum(frequency, 1 / edge) ** exponent
    )
    plane = np.real(np.fft.ifft2(spectrum))
    picture = (0.5 + 0.08 * plane / plane.std())[..., None].repeat(3, axis=2)
    pools = Pools(Flat(40).of(edge, edge), (-160, 128), Pooling())
    parts = metamer_parts(picture, pools, SETTINGS, 1)
    ours, true = (
        analyse(ycbcr_from_rgb(image), 3).bands for image in (parts.base + parts.noise, picture)
    )
    for level in range(3):
        wide = pools.sigma_px(level) > max(6, 2 * 2**level)
        for index in range(3):
            pair = [bands[level][wide][:, index, 0] for bands in (ours, true)]
            ratio = pair[0].std() / pair[1].std()
            assert 0.85 < ratio < 1.15, (level, index)


def test_variance_that_is_pooled_is_that_of_white_noise_bands(rng):
    """Far out, every pool holds hundreds of coefficients of one deviation."""
    picture = noise_picture(rng, (192, 192))
    pools = Pools(Flat(40).of(192, 192), (-400, 96), Pooling())
    lows = chain_of(picture, chain_length(192, 192), wraps=False)
    wanted = wanted_by_blocks(lows, pools, 3)
    own = analyse(ycbcr_from_rgb(picture), 1).bands[0][..., 0]
    pooled = wanted.variances[8:-8, 8:-8, :3].mean(axis=(0, 1))
    np.testing.assert_allclose(pooled, (own**2).mean(axis=(0, 1)), rtol=0.08)
    np.testing.assert_allclose(wanted.slopes, 0, atol=1e-9)  # grey


def test_the_finest_pools_are_as_wide_as_the_low_pass():
    """By hand: of two means of 2 coefficients, shares 1 - p and p, around their own centre."""
    place = np.array([-0.5, 0.5, 1.5, 2.5])
    weight = np.repeat([1 - PARTNER_SHARE, PARTNER_SHARE], 2) / 2
    spread = (weight * place**2).sum() - (weight * place).sum() ** 2
    assert 0 < PARTNER_SHARE < 0.5
    assert spread == pytest.approx(halving_variance(), rel=1e-12)


def all_of_the_display(*_):
    return np.full(3, 9.0), np.full(3, 9.0)


def test_chroma_goes_with_luma_as_it_did(rng, monkeypatch):
    grey = noise_picture(rng, (128, 128))[..., 0] - 0.5
    picture = 0.5 + grey[..., None] * (1.0, 0.5, 0.1)
    pools = pools_of(128, 128, (-200, 64))
    monkeypatch.setattr(reference, "reach_of", all_of_the_display)  # it has a shape by chance
    parts = metamer_parts(picture, pools, SETTINGS, 1)
    noise = parts.noise[parts.noise[..., 0] != 0]
    np.testing.assert_allclose(noise[:, 1], 0.5 * noise[:, 0], atol=1.2e-3)
    np.testing.assert_allclose(noise[:, 2], 0.1 * noise[:, 0], atol=1.2e-3)


GREY, YELLOW = (0.4, 0.4, 0.4), (0.9, 0.8, 0.1)


def test_the_colours_shape_is_that_of_the_pool():
    """By hand: of a share p and two values, (1 - 2 p) / sqrt(p (1 - p)); yellow has little blue."""
    yellow = np.zeros((256, 256, 1), bool)
    yellow[::8, ::8] = True
    lows = chain_of(np.where(yellow, YELLOW, GREY), chain_length(256, 256), wraps=False)
    lows[1] = lows[0][::2, ::2]  # no mixed colours, and a share of 1 in 16
    pools = pools_of(256, 256, (-4000, 128))
    by_hand = (1 - 2 / 16) / np.sqrt(15 / 256)
    variance, shape = colour_shape(lows, pools)
    skew = by_hand / 6
    np.testing.assert_allclose(shape[32, 32], (skew, skew, -skew, 1), rtol=0.04)
    between = np.subtract(*(ycbcr_from_rgb(np.array([colour]))[0, 1:] for colour in (YELLOW, GREY)))
    np.testing.assert_allclose(variance[32, 32], 15 / 256 * between**2, rtol=5e-3)


@pytest.mark.parametrize(
    ("draw", "by_hand"),
    [
        ("random", 1 / 3),  # the beta distribution of parameters 1 and 1
        ("standard_normal", 0.0),
    ],
)
def test_colours_are_bound_as_tightly_as_the_beta_distribution(rng, draw, by_hand):
    blue = getattr(rng, draw)((128, 128)).repeat(4, axis=0).repeat(4, axis=1)
    picture = 0.5 + 0.4 * blue[..., None] * (0.0, 0.0, 1.0)
    lows = chain_of(picture, chain_length(512, 512), wraps=False)
    lows[1] = lows[0][::2, ::2]  # no mixed colours
    _, shape = colour_shape(lows, pools_of(512, 512, (-8000, 256)))
    np.testing.assert_allclose(shape[40:90, 40:90, 3], by_hand, atol=0.06)


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_noise_of_two_colours_ends_a_little_beyond_these(share):
    """By hand: they lie sqrt(share / (1 - share)) below and its inverse above their mean."""
    ends = np.sqrt(share / (1 - share))
    skew = (1 / ends - ends) / 6
    below, above = reach_of(np.array([skew, skew, -skew, 1]), np.ones(3), np.ones(1))
    np.testing.assert_allclose(below[[0, 2]], (ROOMY * ends, ROOMY / ends), rtol=1e-5)
    np.testing.assert_allclose(above[[0, 2]], (ROOMY / ends, ROOMY * ends), rtol=1e-5)


def test_noise_of_greys_and_of_normal_colours_has_all_of_the_display():
    tight, loose = np.array([0, 0, 0, 1]), np.array([0, 0, 0, LEAST_TIGHTNESS])
    for shape, coloured in ((tight, 1e-3), (loose, 1.0)):
        for reach in reach_of(shape, np.full(3, 0.1), np.array([coloured])):
            assert (reach > 1).all()


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_noise_hardly_shows_the_complement_of_a_pools_colour(rng, monkeypatch, share):
    """Grey and yellow have no blue: a tenth of the pixels had of normal noise, none has now."""
    yellow = (rng.random((64, 64, 1)) < share).repeat(4, axis=0).repeat(4, axis=1)
    picture, pools = np.where(yellow, YELLOW, GREY), pools_of(256, 256, (-1500, 128))

    def blue_share():
        return (ycbcr_from_rgb(metamer(picture, pools, SETTINGS, 1))[..., 1] > 0.1).mean()

    assert blue_share() < 0.001
    monkeypatch.setattr(reference, "reach_of", all_of_the_display)
    assert blue_share() > 0.05


def test_full_chroma_gives_back_what_luma_cannot_explain(rng):
    picture = 0.5 + 0.1 * rng.standard_normal((128, 128, 3))
    pools = pools_of(128, 128, (-200, 64))
    deviation = {}
    for chroma in ("luma", "follow", "full"):
        noise = metamer_parts(picture, pools, MetamerSettings(chroma=chroma, levels=2), 1).noise
        deviation[chroma] = ycbcr_from_rgb(noise)[..., 1].std()
    assert deviation["luma"] < 1e-12
    assert deviation["follow"] < 0.7 * deviation["full"]
    true = ycbcr_from_rgb(picture)[..., 1].std()
    assert deviation["full"] == pytest.approx(true, rel=0.2)


@pytest.mark.parametrize(("level", "shared"), [(FIRST_SMOOTH - 1, True), (FIRST_SMOOTH, False)])
def test_only_finer_levels_share_weights_among_2x2_pixels(level, shared):
    """Smooth noise under weights that go on in steps would show a comb of 2 px."""
    levels, blocks = FIRST_SMOOTH + 2, 16
    variances = np.zeros((blocks, blocks, 3 * levels))
    variances[..., 3 * level] = np.square(0.01 + 0.004 * np.arange(blocks))
    wanted = WantedMoments(
        variances, np.zeros((blocks, blocks, levels, 2)), np.zeros((*variances.shape, 2))
    )
    plane = np.ones((4 * blocks, 4 * blocks, 1, 3 * levels))

    luma = lost_noise(wanted, plane, levels, "luma", wraps=False).normal[8, 16:-16, 0]

    within, between = np.diff(luma)[::2], np.diff(luma)[1::2]
    if shared:
        np.testing.assert_array_equal(within, 0)
        assert between.min() > 0
    else:
        np.testing.assert_allclose(within, between.mean(), rtol=0.2)


def test_pooled_residual_is_the_blur_of_equal_pooling():
    picture = photograph(128)
    pools = pools_of(128, 128, (20, 30))
    parts = metamer_parts(picture, pools, MetamerSettings(residual="pooled"), 1)
    np.testing.assert_array_equal(parts.base, blurred(picture, pools))


def test_a_gaze_moved_by_a_pixel_hardly_changes_the_periphery():
    """The issue: noise lies on the screen, so less than .1 of 255."""
    picture = photograph(256)
    here, there = pools_of(256, 256, (128, 128)), pools_of(256, 256, (129, 128))
    far = here.eccentricity_deg() > 8
    a, b = (metamer(picture, pools, SETTINGS, 1) for pools in (here, there))
    change = 255 * np.abs(a - b)[far].mean()
    # The picture is a quarter of 512², where pools are twice as wide and move half as fast.
    assert change < 0.2


def test_noise_carried_by_whole_pixels_is_the_shifted_noise():
    plain = noise_plane((40, 50), 5, 3, 1, wraps=False)
    shift = np.broadcast_to([3.0, 2.0], (40, 50, 2))
    carried = noise_plane((40, 50), 5, 3, 1, wraps=False, shift_px=shift)
    np.testing.assert_allclose(carried[2:, 3:], plain[:-2, :-3], atol=1e-6)


def test_noise_is_of_steps_that_a_byte_holds_and_as_even_as_unrounded_noise():
    tile = noise_tile(3, 4, 1)
    steps = tile.astype(np.float64) / GRAIN
    assert (steps == np.rint(steps)).all()
    assert np.abs(steps).max() <= 127
    exact = mixed_bands(3, 4, 1)
    np.testing.assert_allclose((tile.astype(np.float64) ** 2).mean(), (exact**2).mean(), rtol=1e-3)


def test_carried_noise_repeats_no_sooner_than_noise_on_the_screen():
    """A picture of 300 px has a tile of 512."""
    near, far = (
        noise_plane(
            (8, 300), 5, 2, 1, wraps=False, shift_px=np.broadcast_to([shift, 0.0], (8, 300, 2))
        )
        for shift in (0, 256)
    )
    assert abs(np.corrcoef(near.ravel(), far.ravel())[0, 1]) < 0.1


def test_noise_between_pixels_keeps_its_variance():
    shift = np.broadcast_to([0.37, -0.81], (256, 256, 2))
    carried = noise_plane((256, 256), 5, 4, 1, wraps=False, shift_px=shift)
    plain = noise_plane((256, 256), 5, 4, 1, wraps=False)
    np.testing.assert_allclose(carried.std(axis=(0, 1)), plain.std(axis=(0, 1)), rtol=0.04)


@pytest.fixture(scope="module")
def panorama():
    """Noise of a panorama of 512 x 256 px, by row, column and band."""
    return panorama_noise(3, 3, 1, 256)[:, :, 0].astype(np.float64)


def test_a_panoramas_noise_goes_on_over_its_seam(panorama):
    steps = np.abs(np.diff(panorama, axis=1, append=panorama[:, :1])).mean(axis=(0, 2))
    assert steps[-1] < 1.2 * steps.mean()


def test_a_panorama_has_no_seam():
    """Rolled by a whole number of coarse texels, picture and gaze give the rolled base."""
    rng = np.random.default_rng(1)
    picture = blurred(
        rng.random((128, 256, 3)),
        Pools(Equirectangular().of(256, 128), (0, 64), make_pooling(rate=30, fovea_deg=0)),
    )
    geometry = Equirectangular().of(256, 128)
    here = metamer_parts(picture, Pools(geometry, (20, 64), Pooling()), SETTINGS, 1)
    rolled = np.roll(picture, 64, axis=1)
    there = metamer_parts(rolled, Pools(geometry, (84, 64), Pooling()), SETTINGS, 1)
    np.testing.assert_allclose(np.roll(here.base, 64, axis=1), there.base, atol=1e-9)
    np.testing.assert_allclose(
        np.roll(here.wanted.variances, 16, axis=1), there.wanted.variances, atol=1e-12
    )


def test_flat_and_panorama_of_one_scene_pool_the_same_angles():
    """The same directions are averaged alike: a spot on a grey wall, near the horizon."""
    panorama, flat = Equirectangular().of(1024, 512), Flat(width_deg=60).of(256, 256)

    def scene(geometry):
        rays = geometry.directions(*pixel_centres(geometry))
        spot = np.arccos(np.clip(rays @ np.array([np.sin(0.25), 0, np.cos(0.25)]), -1, 1))
        return np.repeat(np.exp(-((spot / 0.1) ** 2))[..., None], 3, axis=2)

    pooling = Pooling("linear", 0.5, 0.0)
    around = blurred(scene(panorama), Pools(panorama, (512, 256), pooling))
    before = blurred(scene(flat), Pools(flat, (128, 128), pooling))
    peak_flat, peak_around = before[128].max(), around[256].max()
    assert peak_flat == pytest.approx(peak_around, rel=0.06)
    assert peak_flat < 0.9


@pytest.mark.parametrize("lod", [0.0, 0.5, 1.0, 1.7, 2.5])
def test_variance_of_pooled_white_noise_is_foretold(lod):
    rng = np.random.default_rng(2)
    chain = chain_of(rng.standard_normal((512, 512, 2)), 4, wraps=True)
    measured = (select(chain, constant(lod), wraps=True) ** 2).mean()
    assert pooled_white_variance(np.array([lod]))[0] == pytest.approx(measured, rel=0.04)


def test_displacement_is_as_wide_as_asked_and_crosses_no_border():
    pools = pools_of(192, 192, (96, 96))
    settings = DisplacementSettings(reach=0.35)
    fields = np.stack([displacement_px(pools, settings, seed) for seed in range(12)])
    middle = np.hypot(*np.meshgrid(np.arange(192) - 96, np.arange(192) - 96))
    ring = (middle > 40) & (middle < 70)
    wanted = 0.35 * pools.sigma_px()[ring]
    assert (fields[:, ring] / wanted[:, None]).std() == pytest.approx(1, rel=0.15)
    across, along = np.abs(fields[:, 0, :, 1]), np.abs(fields[:, 0, :, 0])
    assert across.max() < 0.2 < 1 < along[:, 40:-40].mean()
    x, y = np.meshgrid(np.arange(192) + 0.5, np.arange(192) + 0.5)
    for axis, place in enumerate((x, y)):
        assert (place + fields[..., axis]).min() > 0
        assert (place + fields[..., axis]).max() < 192
    correlation = np.corrcoef(fields[0][ring].ravel(), fields[1][ring].ravel())[0, 1]
    assert abs(correlation) < 0.25


def test_a_frame_around_a_picture_stays_a_frame():
    """A line of 4 px along the upper border is 2 to 8 px wide, whatever is displaced below it."""
    picture = np.full((192, 256, 3), 0.8, np.float32)
    picture[:4] = 0.2
    pools = pools_of(192, 256, (128, 96), scaling=0.5)
    for seed in range(4):
        dark = eidolon(picture, pools, DisplacementSettings(), seed)[..., 0] < 0.5
        wide = dark.sum(axis=0)
        assert dark[0].all()
        assert wide.min() >= 2
        assert wide.max() <= 8


def test_field_is_smooth_at_the_scale_of_the_pools():
    pools = Pools(Flat(40).of(256, 256), (-300, 128), Pooling())
    field = unit_field(pools, 0.5, 1)
    step = np.abs(np.diff(field, axis=0)).mean()
    assert step < 2 / (0.5 * pools.sigma_px().mean())


def test_level_of_detail_of_tiny_pools_is_small():
    assert lod_of(np.array([1e-3]))[0] < 1e-5
