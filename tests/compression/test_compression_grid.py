"""Polar cells: densities, their integrals and inverses, and what cells average."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from pipeline.compression.grid import (
    TURN,
    Density,
    PolarGrid,
    fitted_cells,
    from_cells,
    linear,
    to_cells,
)

GAZES = [(40.0, 30.0), (0.0, 0.0), (96.0, 20.0), (-30.0, 100.0), (50.0, -1.0), (95.9, 0.1)]


@pytest.mark.parametrize(("start", "knee"), [(0, 10), (4, 10), (25, 10)])
@pytest.mark.parametrize("radius", [5.0, 10.0, 26.0, 300.0])
def test_columns_are_the_integral_of_the_density(start, knee, radius):
    def density(r):
        return 0.0 if r < start else min(1.0, knee / r)

    if radius < start:
        assert Density(start, knee).columns(np.array(radius)) < 0
        return
    whole, _ = quad(density, 0, radius, points=sorted({start, knee, radius} - {0}), limit=200)
    assert Density(start, knee).columns(np.array(radius)) == pytest.approx(whole, abs=1e-6)


@pytest.mark.parametrize(("start", "knee"), [(0, 10), (4, 10), (25, 10)])
def test_the_density_is_the_derivative_of_the_columns(start, knee):
    density, step = Density(start, knee), 1e-4
    radii = np.array([30.0, 60.0, 300.0])
    slope = (density.columns(radii + step) - density.columns(radii - step)) / (2 * step)
    np.testing.assert_allclose(density.per_px(radii), slope, rtol=1e-5)
    np.testing.assert_array_equal(density.per_px(np.array([start - 0.5])), 0.0)


def test_columns_by_hand():
    # 10 columns to the knee at 10 px, then 10 ln 2 per doubling.
    density = Density(0, 10)
    found = density.columns(np.array([4.0, 10.0, 20.0, 40.0]))
    np.testing.assert_allclose(found, [4, 10, 10 + 10 * math.log(2), 10 + 20 * math.log(2)])


@pytest.mark.parametrize(("start", "knee"), [(0, 10), (4, 10), (25, 10), (7.5, 61.1)])
def test_the_inverse_undoes_the_integral(start, knee):
    density = Density(start, knee)
    radii = np.linspace(start, 900, 500)
    np.testing.assert_allclose(density.radius_px(density.columns(radii)), radii, atol=1e-9)


@pytest.mark.parametrize("gaze_px", GAZES)
def test_places_undo_positions_and_hold_the_whole_picture(gaze_px):
    grid = PolarGrid((96, 64), gaze_px, 90)
    rows, columns = grid.shape
    x, y = np.meshgrid(np.arange(96) + 0.5, np.arange(64) + 0.5)
    row, column = grid.places(x, y)
    assert (row >= -1e-6).all()
    assert (row <= rows + 1e-6).all()
    assert (column >= -1e-6).all()
    assert (column <= columns + 1e-6).all()
    back = grid.positions(row, column)
    np.testing.assert_allclose(back[0], x, atol=1e-6)
    np.testing.assert_allclose(back[1], y, atol=1e-6)


def test_an_arc_is_as_wide_as_the_picture_is_seen():
    assert PolarGrid((96, 64), (40, 30), 90).whole_turn
    assert PolarGrid((96, 64), (0, 0), 90).arc == pytest.approx((0, TURN / 4))
    assert PolarGrid((96, 64), (0, 30), 90).arc == pytest.approx((-TURN / 4, TURN / 2))
    far = PolarGrid((100, 100), (-50, 50), 90)  # corners at 45 degrees up and down
    assert far.arc == pytest.approx((-TURN / 8, TURN / 4))
    assert far.density.start_px == 50


def test_cells_are_pixels_up_to_the_knee_and_squares_beyond():
    grid = PolarGrid((400, 400), (200, 200), 60)
    along, around = grid.cell_px()
    knee = 60 / TURN
    near = np.arange(grid.shape[1]) + 1 <= knee
    np.testing.assert_allclose(along[near], 1)
    far = np.arange(grid.shape[1]) > knee + 1
    np.testing.assert_allclose(along[far], around[far], rtol=0.01)


def test_a_map_of_wide_cells_keeps_the_mean_of_noise(rng):
    image = rng.random((200, 200, 2))
    grid = PolarGrid((200, 200), (100, 100), 8)
    cells = to_cells(image, grid)
    # The outermost cells that lie on the picture whole: 60 px wide.
    assert abs(cells[:, -3].mean() - 0.5) < 0.02
    assert cells[:, -3].std() < 0.02


@pytest.mark.parametrize("gaze_px", GAZES)
def test_a_constant_stays_one_also_where_cells_lie_outside(gaze_px):
    image = np.full((64, 96, 3), 0.25)
    grid = PolarGrid((96, 64), gaze_px, 64)
    cells = to_cells(image, grid)
    np.testing.assert_allclose(cells, 0.25)
    np.testing.assert_allclose(from_cells(cells, grid), 0.25)


def test_near_the_gaze_the_picture_comes_back():
    y, x = np.mgrid[:64, :96]
    image = (0.5 + 0.4 * np.sin(x / 3) * np.cos(y / 4))[..., None]
    grid = PolarGrid((96, 64), (40.2, 30.7), 120)
    back = from_cells(to_cells(image, grid), grid)
    near = np.hypot(x + 0.5 - 40.2, y + 0.5 - 30.7) < 15
    assert np.abs(back - image)[near].max() < 0.02


def test_linear_reads_pixels_at_their_centres():
    image = np.arange(12.0).reshape(3, 4, 1)
    found = linear(image, np.array([0.5, 1.0, 3.5]), np.array([0.5, 0.5, 2.5]))
    np.testing.assert_allclose(found[:, 0], [0, 0.5, 11])


def test_fitted_cells_give_back_nearly_all_of_even_white_noise(rng):
    picture = rng.random((96, 128, 1))
    grid = PolarGrid((128, 96), (60.3, 50.1), 200)
    y, x = np.mgrid[:96, :128] + 0.5
    near = np.hypot(x - 60.3, y - 50.1) < 28

    def error(cells):
        return np.square(from_cells(cells, grid) - picture)[near].mean()

    assert error(fitted_cells(picture, grid)) < 0.06 * error(to_cells(picture, grid))


@pytest.mark.parametrize("gaze_px", GAZES)
def test_fitted_cells_keep_a_constant(gaze_px):
    grid = PolarGrid((96, 64), gaze_px, 64)
    np.testing.assert_allclose(fitted_cells(np.full((64, 96, 3), 0.25), grid), 0.25)
