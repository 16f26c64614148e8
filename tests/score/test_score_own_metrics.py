"""Our own metrics: perfect on equals, worked by hand, and blind to what metamers share."""

import re

import numpy as np
import pytest
from scipy import ndimage

from pipeline.colour import rgb_from_ycbcr, ycbcr_from_rgb
from pipeline.features.reference import Pyramid, analyse, synthesise
from pipeline.foveation.geometry import Flat, eccentricity_deg, pixel_centres
from pipeline.quality import high_frequency_ratio, psnr_db, ssim
from stimuli.score.foveated import seen_wide
from stimuli.score.measure_clips import measure_job
from stimuli.score.metrics import METRICS, PluginMetrics
from stimuli.score.pair import read_colour
from stimuli.score.statistics import statistics_distance
from stimuli.score.viewing_conditions import ViewerGaze, standard_fhd

OWN = ("pixels", "statistics")


def measured(family, pair, gaze=None):
    return measure_job(family, pair, standard_fhd(), gaze or ViewerGaze()).values


@pytest.mark.parametrize("family", OWN)
def test_identical_clips_are_perfect(pair, clips, family):
    values = measured(family, pair(clips.truth))

    assert values
    for (name, _), value in values.items():
        assert value == pytest.approx(METRICS[name].perfect, abs=1e-12), name


def test_flicker_lies_in_the_ring_where_a_clip_changes_and_its_reference_does_not(pair, clips):
    """By hand: a band that alternates by 10/255 covers a known share of one ring; all else is 0."""
    viewing = seen_wide(64, 48, 30)  # corners 18 degrees from the middle
    still = np.rint(255 * 0.5 * np.repeat(clips.truth[:1], 4, axis=0)).astype(np.float32) / 255
    geometry = Flat(width_deg=30).of(64, 48)
    away = eccentricity_deg(geometry, (20.0, 24.0), *pixel_centres(geometry))
    restless = still.copy()
    band = (away >= 11) & (away < 13)
    restless[1::2, band] += np.float32(10 / 255)

    gaze = ViewerGaze(((20.0, 24.0),))
    values = measure_job("flicker-rings", pair(restless, truth=still), viewing, gaze).values
    rings = {place: value for (_, place), value in values.items() if place != "frame"}
    assert list(rings) == [f"{first} to {first + 5} deg" for first in (0, 5, 10, 15, 20)]
    ring = (away >= 10) & (away < 15)
    expected = 10 * band.sum() / ring.sum()
    assert rings.pop("10 to 15 deg") == pytest.approx(expected, abs=1e-3)
    assert set(rings.values()) == {0.0}
    assert values["flicker-rings", "frame"] == pytest.approx(expected / 5, abs=1e-3)
    moving = measure_job("flicker-rings", pair(clips.truth), viewing, gaze).values
    assert set(moving.values()) == {0.0}  # the reference moves alike


def test_a_picture_scores_what_pipeline_quality_says(pair, clips):
    """One frame: the clip's numbers are those of the functions called directly."""
    fill = clips.fills["metameric"][:1]
    made = pair(fill, truth=clips.truth[:1], fps=0.0)
    test, truth = read_colour(made.test[0]), read_colour(made.truth[0])
    values = measured("pixels", made)

    for region, mask in (("holes", clips.holes[0]), ("frame", np.ones_like(clips.holes[0]))):
        assert values["psnr", region] == pytest.approx(psnr_db(test, truth, mask))
        assert values["ssim", region] == ssim(test, truth, mask)
        assert values["hf-ratio", region] == high_frequency_ratio(test, truth, mask)


@pytest.mark.parametrize("family", OWN)
def test_in_holes_nothing_outside_counts(pair, clips, family):
    fill = clips.fills["push-pull"]
    elsewhere = np.where(clips.holes[..., None], fill, 1 - fill)
    plain, changed = (measured(family, pair(frames)) for frames in (fill, elsewhere))

    for (name, region), value in plain.items():
        same = changed[name, region] == pytest.approx(value, rel=1e-9)
        assert same == (region == "holes"), (name, region)


def test_psnr_of_a_clip_is_that_of_its_mean_squared_error(pair, clips):
    """By hand: squared errors of 0, 0.01, 0.01 and 0 have the mean 0.005, 23.01 dB."""
    flat = np.full_like(clips.truth, 100 / 255)
    fill = flat.copy()
    fill[1:3] += np.float32(26 / 255)
    values = measured("pixels", pair(fill, truth=flat))

    assert values["psnr", "frame"] == pytest.approx(-10 * np.log10(0.5 * (26 / 255) ** 2), abs=1e-4)
    assert values["hf-ratio", "frame"] == 1.0  # the frames without error; flat ones have no ratio


def test_flicker_is_the_change_that_the_reference_does_not_have(pair, clips):
    """By hand: a fill that alternates by 10/255 over a still reference changes by 10 each time."""
    still = np.repeat(clips.truth[:1], 4, axis=0) * np.float32(0.5)
    still = np.rint(255 * still).astype(np.float32) / 255
    restless = still.copy()
    restless[1::2] += np.float32(10 / 255)

    assert measured("pixels", pair(restless, truth=still))["flicker", "holes"] == pytest.approx(
        10.0, abs=1e-3
    )
    stuck = np.repeat(clips.truth[:1], 4, axis=0)
    moving = measured("pixels", pair(stuck))["flicker", "holes"]
    assert moving > 5, "a fill that sticks to the screen under a moving reference"


def texture(photo, seed, turn=0.0):
    """Noise with the band deviations of a photograph; `turn` mixes in other noise."""
    wanted = analyse(ycbcr_from_rgb(photo.astype(np.float64)), 4)
    noise = np.cos(turn) * np.random.default_rng(seed).standard_normal(photo.shape)
    noise += np.sin(turn) * np.random.default_rng(seed + 1000).standard_normal(photo.shape)
    bands = list(analyse(noise, 4).bands)
    flat = np.broadcast_to(wanted.residual.mean(axis=(0, 1)), wanted.residual.shape)
    for _ in range(4):  # re-analysis spreads between levels: correct until it agrees
        made = synthesise(Pyramid(tuple(bands), flat))
        have = analyse(made, 4)
        for level, band in enumerate(bands):
            have_std = np.maximum(have.bands[level].std(axis=(0, 1)), 1e-9)  # grey has no chroma
            bands[level] = band * (wanted.bands[level].std(axis=(0, 1)) / have_std)
    made = synthesise(Pyramid(tuple(bands), flat))
    return np.clip(rgb_from_ycbcr(made), 0, 1).astype(np.float32)


def blur_of_error(image, mean_square):
    """Blur until the mean squared error is `mean_square`."""
    low, high = 0.01, 60.0
    for _ in range(16):
        sigma = (low + high) / 2
        blurred = ndimage.gaussian_filter(image, (sigma, sigma, 0), mode="nearest")
        if np.mean((blurred - image) ** 2) < mean_square:
            low = sigma
        else:
            high = sigma
    return blurred


@pytest.mark.parametrize("name", ["grass", "gravel", "brick", "coffee", "astronaut"])
def test_other_noise_of_equal_statistics_is_near_and_blur_is_far(photographs, name):
    everywhere = np.ones((128, 128), bool)
    one, other = texture(photographs[name], 1), texture(photographs[name], 2)
    blurred = blur_of_error(one, 0.45 * np.mean((one - other) ** 2))

    near, far = (statistics_distance(image, one) for image in (other, blurred))

    assert statistics_distance(one, one) == 0
    assert near < 0.2
    assert far > 4 * near
    # Pixel by pixel it is the other way round.
    assert psnr_db(other, one, everywhere) < psnr_db(blurred, one, everywhere)
    assert ssim(other, one, everywhere) < ssim(blurred, one, everywhere)


@pytest.mark.parametrize("name", ["grass", "gravel", "brick", "coffee", "astronaut"])
def test_at_equal_squared_error_blur_is_farther_than_other_noise(photographs, name):
    everywhere = np.ones((128, 128), bool)
    one, other = texture(photographs[name], 1), texture(photographs[name], 1, turn=0.5)
    blurred = blur_of_error(one, np.mean((one - other) ** 2))

    assert psnr_db(other, one, everywhere) == pytest.approx(
        psnr_db(blurred, one, everywhere), abs=0.01
    )
    assert statistics_distance(blurred, one) > 4 * statistics_distance(other, one)


@pytest.mark.parametrize("name", ["grass", "coffee"])
def test_blur_of_a_photograph_grows_with_its_width(photographs, name):
    photo = photographs[name]
    found = [
        statistics_distance(ndimage.gaussian_filter(photo, (s, s, 0)), photo)
        for s in (0.5, 1, 2, 4)
    ]

    assert found == sorted(found)
    assert found[0] < 0.15 < 0.2 < found[-1] < 1


def test_pools_grow_from_the_gaze(photographs):
    """A detail that moved by some pixels is seen by who looks at it, not from far away."""
    photo = photographs["astronaut"]
    moved = photo.copy()
    moved[16:48, 16:48] = photo[16:48, 21:53]
    patch = np.zeros((128, 128), bool)
    patch[16:48, 16:48] = True
    at, away = (
        statistics_distance(moved, photo, gaze_px=gaze, mask=patch)
        for gaze in ((32, 32), (125, 125))
    )

    assert away < 0.7 * at


def test_the_statistics_of_a_colour_that_is_off_are_far(photographs):
    photo = photographs["grass"] * np.float32(0.7)

    assert statistics_distance(photo + np.float32(0.2), photo) > 0.1


def test_the_metric_of_the_page_measures_a_clip(repository, pair, clips):
    page = (repository / "docs/quality.md").read_text(encoding="utf-8")
    (code,) = re.findall(
        r"```python\n(.*?)^```", page.split("### A metric of your own")[1], re.M | re.S
    )
    made: dict = {}
    exec(code, made)
    plugin = made["METRICS"]
    assert isinstance(plugin, PluginMetrics)
    (metric,) = plugin.metrics
    found = made["measure"](pair(clips.truth), None, None).values
    assert {name for name, _ in found} == {metric.name} == set(plugin.blind)
    assert set(found.values()) == {0.0}
    other = made["measure"](pair(np.clip(clips.truth + 0.25, 0, 1)), None, None).values
    assert min(other.values()) > 0.1


def test_the_numbers_of_our_own_families_are_those_of_their_version(pair, clips):
    """A change of code that changes these must raise `version` of the family: caches go by it."""
    made = pair(clips.fills["metameric"])
    found = measured("pixels", made) | measured("statistics", made)

    assert found == pytest.approx(GOLDEN, rel=1e-4)


GOLDEN = {
    ("psnr", "holes"): 11.43523,
    ("ssim", "holes"): 0.29481,
    ("hf-ratio", "holes"): 2.61789,
    ("psnr", "frame"): 19.79666,
    ("ssim", "frame"): 0.86886,
    ("hf-ratio", "frame"): 1.37962,
    ("flicker", "holes"): 76.52163,
    ("statistics", "holes"): 0.34591,
    ("statistics", "frame"): 0.13073,
}
