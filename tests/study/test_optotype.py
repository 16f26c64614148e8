"""The Landolt ring against its geometry: ISO 8596 has stroke and gap of a fifth of the height."""

import math

import numpy as np
import pytest

from protocols.display import Viewing
from protocols.load import load_display
from protocols.make_script import landolt_ring
from protocols.phases import Optotype
from study_app.paint import ring_image

DISPLAY = load_display("fhd27-60hz")
HEIGHT_DEG = 1.25


def covered(gap_deg, x_deg=0.0, y_deg=0.0):
    """Return the share of each pixel that the ring covers, and its place."""
    ring = Optotype(gap_deg, HEIGHT_DEG, x_deg, y_deg, grey=0.25)
    picture = landolt_ring(ring, DISPLAY)
    image = ring_image(picture.of)
    place = picture.at[0] + DISPLAY.width_px // 2, picture.at[1] + DISPLAY.height_px // 2
    assert (image[..., :3] == round(0.25 * 255)).all()
    return image[..., 3] / 255, place


def height_px(x_deg=0.0, y_deg=0.0):
    viewing = Viewing.of(DISPLAY)
    return (
        viewing.to_px(x_deg, y_deg + HEIGHT_DEG / 2)[1]
        - viewing.to_px(x_deg, y_deg - HEIGHT_DEG / 2)[1]
    )


def test_a_closed_ring_covers_the_area_between_two_circles():
    share, _ = covered(None)
    height = height_px()

    wanted = math.pi * height**2 * (0.25 - 0.09)

    assert share.sum() == pytest.approx(wanted, rel=0.01)


def test_the_gap_is_a_fifth_of_the_height_and_has_parallel_sides():
    closed, _ = covered(None)
    opened, _ = covered(0.0)
    height = height_px()

    missing = (closed - opened).sum(axis=0)  # of each column, right of the middle
    inside = missing[missing > 0.9 * missing.max()]

    assert np.allclose(inside, 0.2 * height, atol=0.5)
    assert (missing > 0.5).sum() == pytest.approx(0.2 * height, abs=1.5)


@pytest.mark.parametrize(
    ("gap_deg", "side"), [(0, (0, 1)), (90, (-1, 0)), (180, (0, -1)), (270, (1, 0))]
)
def test_the_gap_points_counter_clockwise_from_the_right(gap_deg, side):
    closed, _ = covered(None)
    opened, _ = covered(float(gap_deg))
    rows, columns = np.indices(closed.shape)
    missing = closed - opened
    middle = (len(closed) - 1) / 2

    down = (missing * (rows - middle)).sum() / missing.sum()
    right = (missing * (columns - middle)).sum() / missing.sum()

    assert (round(down / (0.4 * height_px())), round(right / (0.4 * height_px()))) == side


@pytest.mark.parametrize(("x_deg", "y_deg"), [(0.0, 0.0), (7.3, -4.1), (-15.0, 9.0)])
def test_a_ring_stands_where_its_angles_say_to_half_a_pixel(x_deg, y_deg):
    share, (left, top) = covered(None, x_deg, y_deg)
    rows, columns = np.indices(share.shape)

    x_px = left + (share * (columns + 0.5)).sum() / share.sum()
    y_px = top + (share * (rows + 0.5)).sum() / share.sum()

    assert (x_px, y_px) == pytest.approx(Viewing.of(DISPLAY).to_px(x_deg, y_deg), abs=0.5)
