"""Geometry and pooling against closed forms."""

import math

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.foveation.geometry import (
    CapGeometry,
    Equirectangular,
    Flat,
    check_gaze,
    eccentricity_deg,
    pixel_centres,
)
from pipeline.foveation.pooling import HALVED_VARIANCE, Pooling, Pools, lod_of, make_pooling


def at(value):
    return np.array(float(value))


def test_flat_picture_spans_its_width_in_degrees():
    geometry = Flat(width_deg=40).of(512, 300)
    assert eccentricity_deg(geometry, (0, 150), at(512), at(150)) == pytest.approx(40, abs=1e-9)


@pytest.mark.parametrize(("degrees", "excess"), [(40, 0.10), (90, 0.68)])
def test_flat_density_at_the_edge_exceeds_the_middle(degrees, excess):
    geometry = Flat(width_deg=degrees).of(1000, 1000)
    middle, edge = (geometry.px_per_deg(at(x), at(500)) for x in (500, 1000))
    assert edge / middle - 1 == pytest.approx(excess, abs=0.005)


def test_flat_density_is_the_root_of_the_area_of_a_square_degree():
    """The solid angle of a pixel at t off the normal is cos(t)^3 / d^2."""
    geometry = Flat(distance_px=700, centre_px=(100, 50)).of(640, 480)
    x, y, step = 500.0, 400.0, 1e-3
    corner = geometry.directions(at(x), at(y))
    across = geometry.directions(at(x + step), at(y)) - corner
    down = geometry.directions(at(x), at(y + step)) - corner
    square_px = np.linalg.norm(np.cross(across, down)) / step**2
    density = math.radians(1) / math.sqrt(square_px)
    assert geometry.px_per_deg(at(x), at(y)) == pytest.approx(density, rel=1e-5)


def test_eccentricity_off_the_screen_goes_on():
    geometry = Flat(distance_px=100).of(200, 200)
    found = eccentricity_deg(geometry, (-300, 100), at(100), at(100))
    assert found == pytest.approx(math.degrees(math.atan(4)), abs=1e-9)


def test_eccentricity_is_exact_beside_the_gaze():
    """An arccosine of a dot product would answer 0 there."""
    geometry = Flat(distance_px=1e6).of(20, 20)
    found = eccentricity_deg(geometry, (10, 10), at(10.01), at(10))
    assert found == pytest.approx(math.degrees(1e-8), rel=1e-6)


def test_panorama_density_grows_to_the_poles():
    geometry = Equirectangular().of(720, 360)
    assert geometry.px_per_deg(at(0), at(180)) == pytest.approx(2)
    assert geometry.px_per_deg(at(0), at(300)) == pytest.approx(2 / math.sqrt(0.5), rel=1e-9)
    assert np.isfinite(geometry.px_per_deg(at(0), at(0)))


def test_panorama_eccentricity_crosses_the_seam_and_the_poles():
    geometry = Equirectangular().of(360, 180)
    assert eccentricity_deg(geometry, (1, 90), at(359), at(90)) == pytest.approx(2, abs=1e-9)
    assert eccentricity_deg(geometry, (0, 10), at(180), at(10)) == pytest.approx(20, abs=1e-9)


def test_flat_and_panorama_agree_on_eccentricity_of_the_same_directions():
    flat, panorama = Flat(width_deg=80).of(400, 300), Equirectangular().of(800, 400)
    rays = flat.directions(*pixel_centres(flat))
    longitude = np.arctan2(rays[..., 0], rays[..., 2])
    latitude = np.arcsin(-rays[..., 1])
    x, y = (longitude / (2 * np.pi) + 0.5) * 800, (0.5 - latitude / np.pi) * 400
    middle = eccentricity_deg(flat, (200, 150), *pixel_centres(flat))
    np.testing.assert_allclose(eccentricity_deg(panorama, (400, 200), x, y), middle, atol=1e-9)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: Flat(width_deg=180), "between 0 and 180"),
        (lambda: Flat(width_deg=30, distance_px=3), "got both"),
        (lambda: Flat(distance_px=0), "positive"),
        (lambda: Equirectangular().of(300, 200), "twice as wide"),
        (lambda: Flat().of(0, 5), "at least 1 x 1"),
        (lambda: check_gaze(Flat().of(9, 9), (math.nan, 0)), "finite"),
        (lambda: check_gaze(Flat().of(9, 9), 5), "two numbers"),
    ],
)
def test_impossible_viewing_is_refused(make, match):
    with pytest.raises(InputError, match=match):
        make()


def test_a_gaze_beyond_a_pole_stays_at_the_pole():
    around = Equirectangular().of(20, 10)
    assert check_gaze(around, (23, 11)) == (3, 10)
    assert check_gaze(around, (3, -1e9)) == (3, 0)


@pytest.mark.parametrize(
    ("law", "degrees", "deviation"), [("v1", 50, 5.3), ("v2", 50, 9.77), ("authors", 10, 0.1547)]
)
def test_presets_have_the_published_widths(law, degrees, deviation):
    found = make_pooling(law, fovea_deg=0).sigma_deg(at(degrees))
    assert found == pytest.approx(deviation, rel=5e-3)


def test_authors_pool_seven_times_narrower_than_v1_at_ten_degrees():
    v1, authors = (make_pooling(law, fovea_deg=0).sigma_deg(at(10)) for law in ("v1", "authors"))
    assert v1 / authors == pytest.approx(7, abs=0.3)


def test_v1_is_a_blur_of_six_arcmin_per_degree():
    rate = make_pooling(rate=6.37, fovea_deg=0)
    v1 = make_pooling("v1", fovea_deg=0)
    assert rate.sigma_deg(at(9)) == pytest.approx(v1.sigma_deg(at(9)), rel=1e-3)


@pytest.mark.parametrize("law", ["linear", "quadratic", "rate"])
def test_nothing_is_pooled_in_the_fovea_and_variance_rises_from_zero(law):
    pooling = Pooling(law, 0.25, 2.0)
    sigma = pooling.sigma_deg(np.array([0.0, 1.0, 2.0, 2.001, 2.002]))
    np.testing.assert_array_equal(sigma[:3], 0)
    assert sigma[4] ** 2 / sigma[3] ** 2 == pytest.approx(2, rel=2e-3)


def test_far_from_the_fovea_the_law_is_plain():
    near, plain = Pooling("linear", 0.25, 1.0), Pooling("linear", 0.25, 0.0)
    assert near.sigma_deg(at(20)) == pytest.approx(plain.sigma_deg(at(20)), rel=2e-3)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"law": "v3"}, "v1, v2, authors, linear"),
        ({"law": "v1", "scaling": 0.3}, "use law 'linear'"),
        ({"scaling": 0.3, "rate": 1}, "at most one"),
        ({"law": "rate", "alpha": 1}, "takes rate"),
        ({"scaling": 0}, "positive"),
        ({"fovea_deg": -1}, "fovea_deg"),
    ],
)
def test_impossible_pooling_is_refused(arguments, match):
    with pytest.raises(InputError, match=match):
        make_pooling(**arguments)


def test_a_constant_alone_chooses_its_law():
    assert make_pooling(alpha=0.3).law == "quadratic"
    assert make_pooling(rate=0.7) == Pooling("rate", 0.7)
    assert make_pooling() == Pooling("linear", 0.25)


def test_whole_lods_have_the_deviations_of_as_many_halvings():
    halvings = np.arange(6)
    sigma = np.sqrt(HALVED_VARIANCE * (4.0**halvings - 1))
    np.testing.assert_allclose(lod_of(sigma), halvings, atol=1e-12)


def test_lod_grows_by_one_where_pools_double():
    sigma = np.array([20.0, 40.0, 80.0])
    np.testing.assert_allclose(np.diff(lod_of(sigma)), 1, atol=2e-3)


def test_coarse_maps_are_the_fine_one_at_their_texels():
    pools = Pools(Flat().of(64, 32), (10, 5), Pooling())
    fine, coarse = pools.sigma_px(0), pools.sigma_px(2)
    assert coarse.shape == (8, 16)
    mean = fine[8:12, 40:44].mean()  # texel (2, 10)
    assert coarse[2, 10] == pytest.approx(mean, rel=5e-3)
    np.testing.assert_allclose(pools.lod(0, 3), lod_of(fine / 8))


@pytest.mark.parametrize(
    "geometry",
    [
        Flat(60, centre_px=(10, 90)).of(120, 80),
        Equirectangular().of(64, 32),
        CapGeometry(40, 9.0, True),
        CapGeometry(40, 9.0, False),
    ],
)
def test_one_ray_is_the_direction_of_its_position(geometry):
    for x, y in ((3.5, 7.25), (20.0, 20.0), (39.0, 1.0)):
        wanted = geometry.directions(np.array(x), np.array(y))
        np.testing.assert_allclose(geometry.ray(x, y), wanted, atol=1e-15)
