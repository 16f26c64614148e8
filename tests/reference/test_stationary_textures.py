"""The measure of stationary textures says 1 and 0 of the truth, and notices what is not."""

import numpy as np
import pytest
from scipy import ndimage
from stationary_textures import LEVELS, Scene, Texture, measure, whole_coefficients

SCENE = Scene(64, 20, 28)


class Truth:
    """Shows the plane itself, its contrast changed, and a ramp to the right."""

    def __init__(self, contrast=1.0, shift=0.0, ramp=0.0):
        self.contrast, self.shift, self.ramp = contrast, shift, ramp

    def fill(self, frame, *, seed):
        assert seed >= 0
        front, uncovered = SCENE.masks()
        np.testing.assert_array_equal(frame.hole, uncovered)
        assert (frame.colour[front] == np.float32((0.8, 0.1, 0.1))).all()
        np.testing.assert_array_equal(frame.depth_m, np.where(front, 2, 5))
        shown = 0.5 + self.contrast * (frame.colour.astype(np.float64) - 0.5) + self.shift
        return shown + self.ramp * np.arange(len(front))[:, None]


def test_the_truth_itself_measures_one_and_its_contrast_what_it_is():
    right, strong = (measure(Truth(c, 0.1), SCENE, [Texture(0.5)], range(4)) for c in (1.0, 1.5))

    np.testing.assert_allclose(right.ratio, 1, rtol=1e-5)
    np.testing.assert_allclose(right.offset, 0, atol=1e-5)  # bands know no brightness
    np.testing.assert_allclose(strong.ratio, 1.5, rtol=1e-5)
    assert right.ratio.shape == (1, LEVELS, 3)


def test_a_mean_is_no_deviation_and_is_told_in_the_planes_deviations():
    """A ramp adds a mean to the band along x, and changes nothing else."""
    plain, ramp, strong = (
        measure(Truth(c, ramp=r), SCENE, [Texture(0.5)], range(4))
        for c, r in ((1.0, 0.0), (1.0, 0.01), (3.0, 0.01))
    )

    # But where the ramp ends: its border reaches some coefficients.
    np.testing.assert_allclose(ramp.ratio, plain.ratio, rtol=0.05)
    assert (ramp.offset[0, :, 1] > 0.1).all()
    np.testing.assert_allclose(ramp.offset[0, :, 2], 0, atol=1e-6)
    # Three times the contrast: the same ramp, in the same plane's deviations.
    np.testing.assert_allclose(strong.offset[0, :, 1], ramp.offset[0, :, 1], rtol=0.3)


def test_an_edge_that_does_not_halve_is_refused():
    with pytest.raises(ValueError, match="edge_px must be a multiple of 2 \\(got 61\\)"):
        Scene(61, 20, 28)


def test_coefficients_that_see_the_disc_are_left_out():
    """By hand: a wall from column 8 on; a 3x3 kernel at level 0 sees one pixel, so 7 are left.

    Low bands of level 1 take four pixels, two of them its own: column 3 sees the wall, and the
    kernel beside it, column 2. Columns 0 and 1 are left.
    """
    front = np.zeros((16, 16), bool)
    front[:, 8:] = True

    places = whole_coefficients(front, ~front, 2)

    assert [mask.any(axis=0).sum() for mask in places] == [7, 2]
    assert all(mask[:, 0].all() for mask in places)


def test_a_texture_has_its_slope_and_its_deviation():
    texture = Texture(1.0).picture(128, 3)[..., 0]
    power = np.abs(np.fft.fft2(texture - texture.mean())) ** 2
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(128), np.fft.fftfreq(128)))
    low, high = (power[(frequency > f) & (frequency < 1.2 * f)].mean() for f in (1 / 16, 1 / 4))

    assert texture.std() == pytest.approx(0.12, rel=0.01)
    assert low / high == pytest.approx(16, rel=0.3)  # power 1 / f^2, a factor of 4 apart


def test_a_blurred_texture_is_what_a_gaussian_filter_makes():
    sharp, soft = (Texture(0.5, blur).picture(96, 2)[..., 0] - 0.5 for blur in (0.0, 1.5))

    expected = ndimage.gaussian_filter(sharp, 1.5, mode="wrap", truncate=8)

    np.testing.assert_allclose(soft, expected * 0.12 / expected.std(), atol=2e-3)
