"""The shading core: levels of detail, continuity, noise that stays on the surface, energy."""

import dataclasses

import numpy as np
import pytest

from benchmarks.fits.fit_overlap import measured
from pipeline.colour import ycbcr_from_rgb
from pipeline.features.reference import analyse
from pipeline.textures.bake import Layout, bake
from pipeline.textures.footprints import saved, touched
from pipeline.textures.reference import Fragments, lost_energy, read_mips, shade
from pipeline.textures.surface_noise import fitted_overlap, surface_noise

EDGE = 256


def fractal(exponent, seed=0):
    rng = np.random.default_rng(seed)
    frequency = np.hypot(np.fft.fftfreq(EDGE)[:, None], np.fft.fftfreq(EDGE))
    amplitude = np.maximum(frequency, 1 / 64) ** -exponent
    plane = np.fft.ifft2(amplitude * np.fft.fft2(rng.standard_normal((EDGE, EDGE)))).real
    plane = 0.5 + 0.12 * (plane - plane.mean()) / plane.std()
    return np.repeat(np.rint(255 * plane.clip(0, 1)).astype(np.uint8)[..., None], 3, 2)


@pytest.fixture(scope="module")
def baked():
    texture = fractal(1.0)
    texture[..., 2] = texture[..., 2] // 2 + 60
    return bake(texture, wraps=True)


@pytest.fixture(scope="module")
def noise(baked):
    return surface_noise(0, baked.layout)


def facing(edge_px, texture_px, rho_off=0.0, eta=0.0):
    """A quad that fills the picture, seen straight on."""
    step = texture_px / edge_px
    y, x = np.mgrid[:edge_px, :edge_px] + 0.5
    one = np.ones((edge_px, edge_px))
    place = step * np.stack([x, y], axis=-1)
    return Fragments(place, (np.log2(step) + rho_off) * one, eta * one)


def test_a_facing_quad_shows_the_halving_of_its_own_size(baked, noise):
    """By hand: a quarter of the texels along an edge is resolution 2, texel for pixel, unpooled."""
    shown = shade(baked, facing(EDGE // 4, EDGE), noise)

    np.testing.assert_array_equal(np.rint(255 * shown.base), baked.colour[2])
    assert (shown.noise == 0).all()


@pytest.mark.parametrize(
    ("level", "rho", "lod", "wanted"),
    [
        (0, 0.0, 0.0, 0.0),  # nothing is pooled
        (2, 2.0, 5.0, 1.0),  # between rho and rho + eta: all of it
        (4, 2.0, 5.0, 1.0),
        (5, 2.0, 5.0, 0.0),  # the base has it
        (1, 2.0, 5.0, 0.0),  # finer than a pixel
        (4, 2.0, 4.25, 1 - 0.75**2),  # the base keeps three quarters of its coefficients
        (2, 2.25, 5.0, 0.75**2),  # the pixel shows three quarters of them
        (2, 2.25, 2.25, 0.0),
        (0, -3.0, 0.5, 0.75),  # magnified
    ],
)
def test_levels_between_the_pixel_and_its_pool_are_lost(level, rho, lod, wanted):
    assert lost_energy(level, np.array(rho), np.array(lod)) == pytest.approx(wanted)


@pytest.mark.parametrize("what", ["rho", "eta"])
@pytest.mark.parametrize("at", [1.0, 2.0, 3.0])
def test_there_is_no_seam_where_the_level_of_detail_changes(baked, noise, what, at):
    """Just below and just above a whole level a surface looks the same."""
    rng = np.random.default_rng(1)
    place = rng.uniform(0, EDGE, (40, 10, 2))
    tiny, shown = 1e-6, []
    for side in (-tiny, tiny):
        rho, eta = (at + side, 1.7) if what == "rho" else (0.3, at - 0.3 + side)
        one = np.ones(place.shape[:2])
        found = shade(baked, Fragments(place, rho * one, eta * one), noise)
        shown.append(found.base + found.noise)
    assert abs(shown[0] - 0.5).max() > 0.05
    np.testing.assert_allclose(*shown, atol=1e-3)


def test_there_is_no_seam_where_a_texture_goes_round(baked, noise):
    y = np.linspace(0, EDGE, 50)[None]
    one, shown = np.ones((1, 50)), []
    for x in (1e-4, EDGE - 1e-4):
        place = np.stack([np.full_like(y, x), y], axis=-1)
        found = shade(baked, Fragments(place, 0.4 * one, 3.0 * one), noise)
        shown.append(found.base + found.noise)
    np.testing.assert_allclose(*shown, atol=2e-3)


def test_noise_goes_round_with_its_texture_and_differs_by_seed_and_level(noise):
    place = np.random.default_rng(2).uniform(0, EDGE, (60, 60, 2))
    seen = [noise.at(level, place) for level in range(3)]
    for level, found in enumerate(seen):
        around = noise.at(level, place + np.array((EDGE, 0)))
        np.testing.assert_allclose(found, around, atol=1e-6)
    other = surface_noise(1, Layout(EDGE, EDGE, True)).at(1, place)
    for second in (other, seen[0], seen[2]):
        assert abs(np.corrcoef(seen[1].ravel(), second.ravel())[0, 1]) < 0.1


def test_noise_has_unit_variance_at_and_between_its_texels():
    noise = surface_noise(0, Layout(4096, 4096))
    rng = np.random.default_rng(3)
    for level in (0, 1, 3):
        place = rng.uniform(0, 256 * 2**level, (200, 200, 2))
        np.testing.assert_allclose(noise.at(level, place).std(axis=(0, 1)), 1, atol=0.04)


def test_the_shipped_overlap_is_what_is_measured(full):
    if not full:
        pytest.skip("a long proof: --full")
    np.testing.assert_allclose(fitted_overlap(), measured(), atol=1e-3)


@pytest.mark.parametrize(("exponent", "least", "most"), [(1.0, 0.8, 1.2), (1.5, 0.8, 1.2)])
def test_bands_that_pooling_takes_come_back(exponent, least, most):
    """Deviation of each oriented and high band over that of the texture, where bands are lost."""
    baked = bake(fractal(exponent))
    noise = surface_noise(0, baked.layout)
    pooled, whole = (shade(baked, facing(EDGE, EDGE, eta=eta), noise) for eta in (4.0, 0.0))
    bands, blurred, wanted = (
        analyse(ycbcr_from_rgb(image.astype(np.float32))[..., :1], 3).bands
        for image in (pooled.base + pooled.noise, pooled.base, whole.base)
    )
    for found, without, asked in zip(bands, blurred, wanted, strict=True):
        ratio = found.std(axis=(0, 1)) / asked.std(axis=(0, 1))
        assert (without.std(axis=(0, 1)) / asked.std(axis=(0, 1)) < 0.6).all()
        assert ratio.min() > least
        assert ratio.max() < most


def test_a_facing_quad_touches_as_many_texels_as_it_has_pixels():
    """By hand: 64 pixels, 512 texels: resolution 3 texel for pixel, 64^2 texels of 4 bytes."""
    layout = Layout(512, 512)

    found = touched(layout, facing(64, 512), noise=True)

    assert {key: int(mask.sum()) for key, mask in found.masks.items()} == {(None, 3): 64**2}
    assert found.bytes_of_texels(16) == 4 * 64**2


def test_pools_of_two_pixels_touch_a_quarter_and_as_many_moments():
    """By hand: eta 1: all 32^2 texels of resolution 4, of colour and of level 3's moments.

    4 + 16 bytes for four pixels, against 4 x 4: foveation costs a quarter more.
    """
    layout = Layout(512, 512)

    foveated = touched(layout, facing(64, 512, eta=1.0), noise=True)
    blurred = touched(layout, facing(64, 512, eta=1.0), noise=False)

    counts = {key: int(mask.sum()) for key, mask in foveated.masks.items()}
    assert counts == {(None, 4): 32**2, (3, 4): 32**2}
    assert saved(foveated.bytes_of_texels(16), 4 * 64**2) == pytest.approx(-0.25)
    assert saved(blurred.bytes_of_texels(16), 4 * 64**2) == pytest.approx(0.75)


def test_between_two_resolutions_both_are_touched_and_moments_of_all_that_is_lost():
    layout = Layout(512, 512)

    found = touched(layout, facing(64, 512, eta=1.5), noise=True)

    # Level 4 begins at resolution 5; level 3 is read at 4 and 5.
    assert set(found.masks) == {(None, 4), (None, 5), (3, 4), (3, 5), (4, 5)}


def test_a_lone_texel_is_read_alone():
    layout = Layout(512, 512)
    one = np.ones((1, 1))
    lone = Fragments(np.full((1, 1, 2), 4.5 * 8), 3 * one, 0 * one)

    found = touched(layout, lone, noise=True)

    assert found.bytes_of_texels(16) == 4


def test_mips_are_read_between_resolutions_by_their_shares():
    mips = (np.full((8, 8, 1), 10, np.uint8), np.full((4, 4, 1), 30, np.uint8))
    place = np.full((1, 1, 2), 3.3)
    for lod, wanted in ((2.0, 10), (2.25, 15), (3.0, 30), (0.5, 10), (9.0, 30)):
        found = read_mips(mips, 2, np.full((1, 1), lod), place, wraps=False)
        assert found.item() == pytest.approx(wanted)


@pytest.mark.parametrize("wraps", [False, True])
def test_what_is_touched_is_what_is_read(rng, wraps):
    """Fragments of all kinds: changing a texel that is not marked changes no colour, and marked
    planes are those that a shader reads.
    """
    texture = rng.integers(0, 256, (48, 64, 3), dtype=np.uint8)
    baked = bake(texture, wraps=wraps)
    shape = (3, 4)
    place = np.stack([rng.uniform(0, 64, shape), rng.uniform(0, 48, shape)], axis=-1)
    fragments = Fragments(place, rng.uniform(-1, 2, shape), rng.choice([0.0, 1.0, 1.7, 2.6], shape))
    noise = surface_noise(0, baked.layout)
    marked = touched(baked.layout, fragments, noise=True).masks

    def shown(changed):
        found = shade(changed, fragments, noise)
        return found.base + found.noise

    def poisoned(plane, key):
        mask = marked.get(key, np.zeros(plane.shape[:2], bool))
        other = 255 - plane if plane.dtype == np.uint8 else plane * 3 + np.float16(0.01)
        return np.where(mask[..., None], plane, other)

    same = dataclasses.replace(
        baked,
        colour=tuple(poisoned(plane, (None, r)) for r, plane in enumerate(baked.colour)),
        moments=tuple(
            tuple(poisoned(plane, (k, k + 1 + i)) for i, plane in enumerate(mips))
            for k, mips in enumerate(baked.moments)
        ),
    )
    np.testing.assert_array_equal(shown(same), shown(baked))
    assert 0 < sum(mask.sum() for mask in marked.values()) < 48 * 64
