"""Noise kept on the display: white pages stay white, nights dark, and every twin agrees."""

from functools import partial

import cv2
import numpy as np
import pytest
from PIL import Image
from scipy.special import ndtr
from scipy.stats import norm
from skimage import data

from benchmarks.foveate_quality import as_floats, night, text_page
from pipeline.colour import ycbcr_from_rgb
from pipeline.compression.codec import CompressionSettings, compress, decoded_base, decompress
from pipeline.compression.gpu import DecompressPass
from pipeline.denoising.gpu import DenoisePass
from pipeline.denoising.maps import maps_of, metamer_of
from pipeline.foveation.conditions import foveate
from pipeline.foveation.geometry import Flat
from pipeline.foveation.pooled_moments import added, along_pool, pool_slope
from pipeline.foveation.pooling import MetamerSettings, Pooling, Pools
from pipeline.foveation.reference import finished, metamer, metamer_parts
from pipeline.noise.gains import fitted_mixing
from pipeline.noise.tile import mixed_bands
from pipeline.textures.bake import bake
from pipeline.textures.reference import Fragments, shade
from pipeline.textures.surface_noise import surface_noise
from stimuli.score.statistics import statistics_distance


def coloured_lines(edge):
    """Lines and discs of saturated colours on yellow."""
    rng, page = np.random.default_rng(2), np.full((edge, edge, 3), (255, 240, 40), np.uint8)
    inks = (230, 20, 20), (20, 20, 220), (0, 130, 0), (0, 0, 0)
    for _ in range(edge // 4):
        (start, end), ink = rng.integers(0, edge, (2, 2)).tolist(), inks[rng.integers(4)]
        filled = -1 if rng.random() < 0.3 else 2
        cv2.line(page, start, end, ink, 2, cv2.LINE_AA)
        cv2.circle(page, start, int(rng.integers(5, 30)), ink, filled, cv2.LINE_AA)
    return as_floats(page)


def hues(edge):
    """All hues along x, and their values along y."""
    value, hue = np.mgrid[:edge, :edge] / edge
    hsv = np.stack([360 * hue, np.ones_like(hue), value], axis=2).astype(np.float32)
    return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB), np.float32)


def line_art(edge):
    """Black lines and circles on white."""
    rng, page = np.random.default_rng(2), np.full((edge, edge, 3), 255, np.uint8)
    for _ in range(edge // 8):
        start, end = rng.integers(0, edge, (2, 2)).tolist()
        cv2.line(page, start, end, (0, 0, 0), 1, cv2.LINE_AA)
        cv2.circle(page, start, int(rng.integers(5, 30)), (0, 0, 0), 1, cv2.LINE_AA)
    return as_floats(page)


def pale_sky(edge):
    """Clouds up to white before a pale blue."""
    rng, frequency = np.random.default_rng(3), np.fft.fftfreq(edge)
    falling = np.maximum(np.hypot(frequency[:, None], frequency), 1 / edge) ** -1.5
    plane = np.real(np.fft.ifft2(np.fft.fft2(rng.standard_normal((edge, edge))) * falling))
    cloud = 1 / (1 + np.exp(3 - 6 * plane / plane.std()))[..., None]
    sky = np.array([0.8, 0.9, 0.97])
    return np.asarray(sky + cloud * (1 - sky), np.float32)


def cream_sky(edge):
    """A slow gradient from cream to grey, with the dark row at the border that scanners leave."""
    down = np.mgrid[:edge, :edge][0][..., None] / edge
    sky = np.array([0.99, 0.95, 0.80]) - down * np.array([0.12, 0.12, 0.10])
    sky[0] = sky[-1] = sky[:, 0] = sky[:, -1] = 0.03
    sky += np.random.default_rng(1).normal(0, 0.006, sky.shape)
    return np.asarray(sky.clip(0, 1), np.float32)


def cream_photograph(edge):
    """A photograph in warm light, whose red is nearest to white."""
    photograph = as_floats(data.rocket()[-edge:, 60 : 60 + edge])
    return photograph * np.float32([1, 0.95, 0.8]) + np.float32([0, 0, 0.02])


EDGE = 192
BLUE, RED, YELLOW, CYAN = (0, 0, 255), (255, 0, 0), (255, 255, 0), (0, 255, 255)
PICTURES = {
    "text": text_page,
    "line art": line_art,
    "pale sky": pale_sky,
    "night": night,
    "dense text": partial(text_page, line_px=8, stroke_px=2),
}
COLOURFUL = {
    "blue on yellow": partial(text_page, ink=BLUE, paper=YELLOW),
    "red on cyan": partial(text_page, ink=RED, paper=CYAN),
    "yellow on blue": partial(text_page, ink=YELLOW, paper=BLUE),
    "red on black": partial(text_page, ink=RED, paper=(0, 0, 0)),
    "black on orange": partial(text_page, paper=(255, 160, 0)),
    "coloured lines": coloured_lines,
    "hues": hues,
    "cream sky": cream_sky,
    "saturated photograph": lambda edge: saturated(data.coffee()[:edge, 200 : 200 + edge]),
}
# Even probabilities of a normal distribution.
NORMAL = norm.ppf((np.arange(4000) + 0.5) / 4000)


def pools_of(edge):
    return Pools(Flat(40).of(edge, edge), (edge / 2, edge / 2), Pooling())


def luma_of(picture):
    return ycbcr_from_rgb(picture).astype(np.float64)[..., 0]


def bound(base, deviation, noise):
    """Of grey noise: one channel's values."""
    deviations = np.full((len(noise), 3), deviation)
    shown = added(np.full_like(deviations, base), noise[:, None].repeat(3, axis=1), deviations)
    np.testing.assert_array_equal(shown[:, :1], shown[:, 1:2])
    return shown[:, 0]


def saturated(photograph):
    hsv = cv2.cvtColor(photograph, cv2.COLOR_RGB2HSV).astype(int) * (1, 2, 1.3)
    return cv2.cvtColor(hsv.clip(0, 255).astype(np.uint8), cv2.COLOR_HSV2RGB) / np.float32(255)


@pytest.mark.parametrize("base", [0.02, 0.3, 0.5, 0.93, 0.995])
@pytest.mark.parametrize("deviation", [0.4, 0.1])
def test_bound_noise_keeps_its_mean_and_stays_on_the_display(base, deviation):
    """Wholly free and wholly bound it keeps it exactly; mixed, clipping takes a little."""
    shown = bound(base, deviation, deviation * NORMAL)
    assert shown.min() >= 0
    assert shown.max() <= 1
    assert shown.mean() == pytest.approx(base, abs=2 / 255)
    clipped = (base + deviation * NORMAL).clip(0, 1).mean()
    assert abs(shown.mean() - base) <= abs(clipped - base) + 1e-6


@pytest.mark.parametrize("luma", [0.08, 0.5, 0.85])
@pytest.mark.parametrize("filled", [0.05, 0.4, 0.8])
def test_the_slope_gives_the_variance_that_is_asked_for(luma, filled):
    mean = norm.ppf(luma)
    slope = pool_slope(np.float64(filled), np.float64(luma), mean)
    shown = ndtr(mean * np.sqrt(1 + slope**2) + slope * NORMAL)
    assert shown.mean() == pytest.approx(luma, abs=1e-4)
    assert shown.var() == pytest.approx(filled * luma * (1 - luma), rel=0.1)


def test_noise_far_from_the_ends_is_what_it_was():
    """By hand: .5 lies 2.5 deviations of .2 from either end."""
    noise = 0.2 * NORMAL[1000:3000]
    shown = bound(0.5, 0.1999, noise)
    np.testing.assert_allclose(shown, 0.5 + noise, atol=1e-12)


def test_a_colours_channels_are_bound_together_and_each_keeps_its_mean():
    """Between yellow and blue: red has the noise that blue has the other way, green has none."""
    base, along = np.array([0.7, 0.5, 0.3]), np.array([0.4, 0.0, -0.4])
    shown = added(np.tile(base, (4000, 1)), np.outer(NORMAL, along), np.tile(abs(along), (4000, 1)))
    np.testing.assert_allclose(shown.mean(axis=0), base, atol=2 / 255)
    np.testing.assert_allclose(shown[:, 0] + shown[:, 2], 1, atol=1e-9)
    assert shown[:, 0].std() > 0.3


def test_noise_leads_no_farther_than_the_pools_colours_and_keeps_its_mean():
    """Two colours, .4 and .9, a fifth of them the latter: by hand .1 below and .4 above."""
    base, deviations = np.full((4000, 3), 0.5), np.full((4000, 3), 0.2)
    noise = 0.2 * NORMAL[:, None].repeat(3, axis=1)
    below, above = np.full_like(base, 0.1), np.full_like(base, 0.4)
    shown = added(base, noise, deviations, below, above)
    assert shown.min() >= 0.4
    assert shown.max() <= 0.9
    assert shown.mean() == pytest.approx(0.5, abs=1 / 255)
    assert shown.std() > 0.15
    assert added(base, noise, deviations).min() < 0.1


def test_a_base_without_noise_stays_as_it_is(rng):
    base, nothing = rng.random((9, 9, 3)), np.zeros((9, 9, 3))
    assert (added(base, nothing, nothing) == base).all()


def test_the_deviation_of_all_bands_is_that_of_their_sum(rng):
    """Bands overlap: the sum of their squares is no variance."""
    bands = mixed_bands(1, 5, 1)[:, :, 0].reshape(15, -1)
    for _ in range(3):
        weights = rng.random(15) * 0.5 ** (np.arange(15) // 3)
        wanted = weights @ fitted_mixing(5).together @ weights
        assert (weights @ bands).var() == pytest.approx(wanted, rel=0.1)
    assert np.trace(fitted_mixing(5).together) > 16


@pytest.mark.parametrize("name", PICTURES)
def test_metamers_of_print_skies_and_nights_keep_mean_and_statistics(name):
    picture, pools = PICTURES[name](EDGE), pools_of(EDGE)
    shown = metamer(picture, pools, MetamerSettings(), 1)
    off = 255 * (luma_of(shown) - luma_of(picture))
    assert abs(off.mean()) < 3
    eccentricity = pools.eccentricity_deg()
    for start, end in ((1.5, 4), (4, 8), (8, 13), (13, 20), (20, 30)):
        assert abs(off[(eccentricity >= start) & (eccentricity < end)].mean()) < 6
    assert statistics_distance(shown, picture) < 0.17


def test_a_nearly_white_cloud_has_no_black_specks():
    """Mean and variance alone would allow a black pixel among a thousand."""
    picture, pools = PICTURES["pale sky"](EDGE), pools_of(EDGE)
    shown = metamer(picture, pools, MetamerSettings(), 1)
    assert picture.min() > 0.79
    assert shown.min() > 0.45


@pytest.mark.parametrize("name", COLOURFUL)
def test_metamers_of_saturated_colours_keep_them_in_the_mean(name):
    picture, pools = COLOURFUL[name](EDGE), pools_of(EDGE)
    parts = metamer_parts(picture, pools, MetamerSettings(), 1)
    off = 255 * (metamer(picture, pools, MetamerSettings(), 1) - picture)
    assert abs(off.mean(axis=(0, 1))).max() < 3
    noise = 255 * (finished(picture, parts.base + parts.noise, pools) - picture)
    noise -= 255 * (finished(picture, parts.base, pools) - picture)
    eccentricity = pools.eccentricity_deg()
    for start, end in ((4, 8), (8, 13), (13, 20)):
        ring = (eccentricity >= start) & (eccentricity < end)
        assert abs(noise[ring].mean(axis=0)).max() < 6
    assert noise.std() > 5


def test_blue_print_on_yellow_never_turns_white_or_black():
    """Noise swings between ink and paper."""
    picture, pools = COLOURFUL["blue on yellow"](EDGE), pools_of(EDGE)
    far = metamer(picture, pools, MetamerSettings(), 1)[pools.eccentricity_deg() > 5]
    for foreign in (far.min(axis=1) > 0.75, far.max(axis=1) < 0.25):
        assert foreign.mean() < 1e-3


@pytest.mark.parametrize("name", PICTURES | COLOURFUL)
def test_bound_noise_on_gpu_matches_reference(gl_context, name):
    picture = (PICTURES | COLOURFUL)[name](128)
    plain, drawn = (foveate(picture, (30, 50), seed=2, ctx=ctx) for ctx in (None, gl_context))
    np.testing.assert_allclose(drawn, plain, atol=1 / 255)
    assert np.abs(plain - picture).mean() > 0.01


@pytest.mark.parametrize("name", ["text", "night"])
def test_compressed_pictures_and_maps_keep_the_mean_on_both_twins(gl_context, name):
    picture, gaze_px = PICTURES[name](EDGE), (EDGE / 2, EDGE / 2)
    compressed = compress([picture], gaze_px, CompressionSettings(angles=96))
    made = DecompressPass(gl_context, compressed)
    pools = pools_of(EDGE)
    maps = maps_of(picture, pools)
    passes = DenoisePass(gl_context, pools.geometry, Pooling(), maps.levels)
    base = decoded_base(compressed.bases[0], compressed.grid, compressed.codec)
    for before, plain, drawn in (
        (base, decompress(compressed, seed=1), made.apply(compressed, seed=1)),
        (maps.base, metamer_of(maps, pools, 1), passes.apply(maps, gaze_px, seed=1)),
    ):
        np.testing.assert_allclose(drawn, plain, atol=1 / 255)
        assert abs(luma_of(plain) - luma_of(picture)).max() > 0.3
        assert 255 * abs(luma_of(plain).mean() - luma_of(before).mean()) < 2
    made.release()
    passes.release()


@pytest.mark.parametrize("name", ["text", "night"])
def test_surfaces_with_print_and_lamps_keep_their_mean(name):
    baked = bake((255 * PICTURES[name](EDGE)).astype(np.uint8), wraps=False)
    place = np.stack(np.meshgrid(*[np.arange(EDGE // 2) * 2 + 1.0] * 2), axis=-1)
    one = np.ones(place.shape[:2])
    shown = shade(baked, Fragments(place, one, 3.0 * one), surface_noise(1, baked.layout))
    colour = shown.base + shown.noise
    assert colour.min() > -1e-9
    assert colour.max() < 1 + 1e-9
    assert 255 * abs(luma_of(colour).mean() - luma_of(shown.base).mean()) < 3
    assert luma_of(shown.noise).std() > 0.05


def test_metamers_of_photographs_lose_nothing_by_the_bound():
    picture = (data.astronaut()[:256, 130:386] / 255).astype(np.float32)
    shown = metamer(picture, pools_of(256), MetamerSettings(), 1)
    assert statistics_distance(shown, picture) < 0.15


def flecks(shown, picture, eccentricity_deg):
    """Share of pixels beyond 5 degrees with more of a hue than any within 64 px, by 15 of 255."""

    def hues_of(image):
        red, green, blue = np.moveaxis(np.rint(255 * image).astype(int), 2, 0)
        for one, two, three in ((red, green, blue), (green, blue, red), (blue, red, green)):
            yield one - np.maximum(two, three)
            yield np.minimum(two, three) - one

    shares = []
    for found, known in zip(hues_of(shown), hues_of(picture), strict=True):
        most = cv2.dilate(known.clip(0).astype(np.int16), np.ones((129, 129), np.uint8))
        shares.append((found > most + 15)[eccentricity_deg > 5].mean())
    return max(shares)


@pytest.mark.slow
@pytest.mark.parametrize(
    "draw",
    [cream_sky, cream_photograph, COLOURFUL["black on orange"], COLOURFUL["blue on yellow"]],
)
def test_metamers_have_no_hue_that_the_pool_lacks(draw):
    """Channels bent each on its own would part: .6 % navy in the sky, 14 % red on orange paper."""
    picture, pools = draw(384), pools_of(384)
    shown = metamer(picture, pools, MetamerSettings(), 1)
    assert flecks(shown, picture, pools.eccentricity_deg()) < 3e-4


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kodim08", "kodim19", "kodim21"])
def test_metamers_of_photographs_have_no_hue_that_the_pool_lacks(shared_data, name):
    with Image.open(shared_data / "textures/kodak" / f"{name}.png") as opened:
        picture = as_floats(np.asarray(opened.convert("RGB"))[:384, 100:484])
    pools = pools_of(384)
    shown = metamer(picture, pools, MetamerSettings(), 1)
    assert flecks(shown, picture, pools.eccentricity_deg()) < 2e-4


def test_channels_that_go_together_share_their_room_and_keep_their_means():
    """Cream: red is .1 below white, and blue .3. Blue falls no farther than red where both fall."""
    base, deviation = (
        np.tile([0.9, 0.7], 4000).reshape(-1, 2)[:, [0, 0, 1]],
        np.full((4000, 3), 0.2),
    )
    noise, along = np.outer(0.2 * NORMAL, np.ones(3)), np.ones(3)
    apart, together = (added(base, noise, deviation, along=one) for one in (None, along))
    assert np.ptp(together[..., 0] - together[..., 2]) < 0.1
    assert np.ptp(apart[..., 0] - apart[..., 2]) > 0.15
    np.testing.assert_allclose(together.mean(axis=0), base[0], atol=2 / 255)
    against = added(1 - base, -noise, deviation, along=-along)
    np.testing.assert_allclose(against, 1 - together, atol=1e-9)


def test_print_of_many_inks_shares_no_room():
    """Red reaches far down, blue far up: what both have holds a quarter of the variance."""
    far, near, wide = np.array([2.0, 2.0, 0.5]), np.array([0.5, 0.5, 2.0]), np.ones(3)
    assert (along_pool(wide, wide, far, near) == 0).all()
    assert (along_pool(wide, wide, far, far[[2, 2, 2]]) > 0.99)[:2].all()
    assert (along_pool(np.array([1, 1, -1]), wide, far, near) == (1, 1, -1)).all()
