"""Quality measures against values worked by hand, and what each of them must tell apart."""

import numpy as np
import pytest
from scipy import ndimage

from pipeline import quality as measures
from pipeline.errors import InputError
from pipeline.quality import KnownTruth, evaluate, high_frequency_ratio, psnr_db, ssim


def band_error(filled, truth, mask):
    return measures.band_error(filled, KnownTruth(truth), mask)


MEASURES = (psnr_db, ssim, high_frequency_ratio, band_error)


@pytest.fixture
def mask():
    mask = np.zeros((64, 80), bool)
    mask[12:52, 16:60] = True
    return mask


@pytest.fixture
def truth(rng):
    return (0.5 + 0.1 * rng.standard_normal((64, 80, 3))).clip(0, 1).astype(np.float32)


def test_psnr_of_a_known_error(mask, truth):
    """By hand: an error of 0.1 everywhere is -10 log10(0.01) = 20 dB."""
    assert psnr_db(truth.clip(0.2, 0.8), truth.clip(0.2, 0.8), mask) == np.inf
    base = np.full_like(truth, 0.4)
    assert psnr_db(base + np.float32(0.1), base, mask) == pytest.approx(20.0, abs=1e-4)


def test_psnr_counts_the_three_channels(mask):
    """By hand: 0.1 in one channel of three is -10 log10(0.01 / 3) = 24.771 dB."""
    base = np.full((64, 80, 3), 0.4, np.float32)
    shifted = base.copy()
    shifted[..., 0] += 0.1

    assert psnr_db(shifted, base, mask) == pytest.approx(24.771, abs=1e-3)


@pytest.mark.parametrize("measure", MEASURES)
def test_nothing_outside_the_mask_counts(measure, mask, truth, rng):
    filled = ndimage.gaussian_filter(truth, (1, 1, 0))
    elsewhere = np.where(mask[..., None], filled, rng.random(truth.shape, dtype=np.float32))

    assert measure(elsewhere, truth, mask) == measure(filled, truth, mask)


def test_a_perfect_fill_scores_perfectly(mask, truth):
    quality = evaluate(truth, truth, mask)

    assert quality.psnr_db == np.inf
    assert quality.ssim == pytest.approx(1.0, abs=1e-12)
    assert quality.high_frequency_ratio == 1.0
    assert quality.band_error == 0.0


def test_ssim_of_a_shift_of_constant_images(mask):
    """By hand: without structure SSIM is (2ab + C1) / (a^2 + b^2 + C1), C1 = 0.01^2.

    a = 0.4, b = 0.5: 0.4001 / 0.4101 = 0.97562, where the window lies inside the mask.
    """
    base = np.full((64, 80, 3), 0.4, np.float32)
    inner = np.zeros_like(mask)
    inner[24:40, 28:48] = True  # 12 px inside: the mask of the fill is the wide one
    shifted = np.where(mask[..., None], np.float32(0.5), base)

    composite = measures._composite(shifted, base, mask)
    np.testing.assert_array_equal(composite, shifted)
    assert ssim(shifted, base, mask) < 0.976
    assert ssim(np.full_like(base, 0.5), base, np.ones_like(mask)) == pytest.approx(
        0.97562, abs=1e-5
    )


def test_high_frequency_ratio_of_scaled_noise_is_the_scale(truth):
    """Half the contrast has half the detail; the whole image is the mask."""
    everywhere = np.ones((64, 80), bool)
    half = (0.5 + 0.5 * (truth - 0.5)).astype(np.float32)

    assert high_frequency_ratio(half, truth, everywhere) == pytest.approx(0.5, abs=1e-6)


def test_high_frequency_ratio_tells_blur_from_noise(mask, truth, rng):
    blurred = ndimage.gaussian_filter(truth, (2, 2, 0))
    noisy = (truth + 0.2 * rng.standard_normal(truth.shape)).clip(0, 1).astype(np.float32)

    assert high_frequency_ratio(blurred, truth, mask) < 0.5
    assert high_frequency_ratio(noisy, truth, mask) > 1.5


def test_band_error_of_a_texture_without_content_is_one(truth):
    everywhere = np.ones((64, 80), bool)
    flat = np.full_like(truth, 0.5)

    assert band_error(flat, truth, everywhere) == pytest.approx(1.0, abs=1e-6)


def test_band_error_forgives_other_noise_of_the_same_statistics(mask, truth, rng):
    """PSNR cannot do this: a metamer beats a blur, though its pixels are as wrong."""
    other = (0.5 + 0.1 * rng.standard_normal(truth.shape)).clip(0, 1).astype(np.float32)
    blurred = ndimage.gaussian_filter(truth, (2, 2, 0))
    louder = (0.5 + 2 * (other - 0.5)).clip(0, 1).astype(np.float32)

    error = band_error(other, truth, mask)
    assert error < 0.5 * band_error(blurred, truth, mask)
    assert error < 0.5 * band_error(louder, truth, mask)
    assert psnr_db(other, truth, mask) < psnr_db(blurred, truth, mask)


@pytest.mark.parametrize("measure", MEASURES)
def test_bad_input_is_refused(measure, mask, truth):
    broken = truth.copy()
    broken[20, 20] = np.nan

    with pytest.raises(InputError, match="filled must be finite"):
        measure(broken, truth, mask)
    with pytest.raises(InputError, match="one height and width"):
        measure(truth[1:], truth, mask)
    with pytest.raises(InputError, match="mask must hold at least one pixel"):
        measure(truth, truth, np.zeros_like(mask))


@pytest.mark.parametrize("measure", [high_frequency_ratio, band_error])
def test_a_flat_truth_has_no_detail_to_compare_with(measure, mask, truth):
    with pytest.raises(InputError, match="some detail inside the mask"):
        measure(truth, np.full_like(truth, 0.5), np.ones_like(mask))


def test_ssim_refuses_an_image_smaller_than_its_window():
    tiny = np.full((8, 8, 3), 0.5, np.float32)

    with pytest.raises(InputError, match="at least 11x11"):
        ssim(tiny, tiny, np.ones((8, 8), bool))


def test_what_is_known_of_the_truth_is_the_same_for_every_fill_and_mask(mask, truth, rng):
    view, wide = KnownTruth(truth), np.ones_like(mask)
    fills = [rng.random(truth.shape, dtype=np.float32) for _ in range(2)]

    for hole in (mask, wide, mask):
        for fill in fills:
            assert evaluate(fill, view, hole) == evaluate(fill, truth, hole)


def test_the_truth_is_split_into_bands_once(mask, truth, rng, monkeypatch):
    split = []
    analyse = measures.analyse
    monkeypatch.setattr(
        measures, "analyse", lambda image, *more: split.append(0) or analyse(image, *more)
    )
    view = KnownTruth(truth)
    for hole in (mask, np.ones_like(mask)):
        for _ in range(2):
            evaluate(rng.random(truth.shape, dtype=np.float32), view, hole)

    assert len(split) == 4 + 1
