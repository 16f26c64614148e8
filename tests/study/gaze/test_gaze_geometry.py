"""Pixels and degrees, exact off the centre."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.display import Viewing
from protocols.load import load_display, shipped

FHD = Viewing.of(load_display("fhd27-60hz"))


def test_the_screen_at_70_cm_measures_as_the_paper_s_monitor():
    """By hand: half of 597.7 mm at 700 mm is atan(298.85 / 700) = 23.12 deg."""
    right, _ = FHD.to_deg(1920, 540)

    assert right == pytest.approx(math.degrees(math.atan(298.85 / 700)), abs=1e-12)
    assert FHD.angle_deg((0, 540), (1920, 540)) == pytest.approx(46.24, abs=0.01)
    one_px = FHD.angle_deg((959.5, 540), (960.5, 540))
    assert 1 / one_px == pytest.approx(39.2, abs=0.1)  # pixels per degree at the centre


def test_a_degree_has_more_pixels_off_the_centre():
    """tan' = 1 / cos^2: at 20 deg a pixel is cos^2(20 deg) = 0.883 of a central one."""
    x, _ = FHD.to_px(20.0, 0.0)

    ratio = FHD.angle_deg((x - 0.5, 540), (x + 0.5, 540)) / FHD.angle_deg(
        (959.5, 540), (960.5, 540)
    )

    assert ratio == pytest.approx(math.cos(math.radians(20.0)) ** 2, rel=1e-6)


def test_angles_off_both_axes_are_between_lines_of_sight():
    """By hand: (300, 0, 700) and (0, 168.1, 700) mm; cos = 700^2 / (|a| |b|)."""
    a, b = math.hypot(298.85, 700), math.hypot(168.1, 700)

    angle = FHD.angle_deg((1920, 540), (960, 1080))

    assert angle == pytest.approx(math.degrees(math.acos(700**2 / (a * b))), abs=1e-9)
    assert angle < math.hypot(23.12, 13.5)  # the plane's distance would be too large


@given(
    name=st.sampled_from(sorted(shipped("displays"))),
    x=st.floats(-500, 4000),
    y=st.floats(-500, 3000),
)
def test_degrees_invert_pixels_everywhere(name, x, y):
    viewing = Viewing.of(load_display(name))

    # atan and tan lose a few roundoffs of the largest coordinate, 4000 px: 1e-12 of it each.
    assert viewing.to_px(*viewing.to_deg(x, y)) == pytest.approx((x, y), abs=1e-8)


def test_a_centred_clip_has_the_declared_angle_within_a_pixel():
    display = load_display("fhd27-60hz")
    width, height = display.centred_size_px(24.0, 12.0)

    assert width % 2 == 0
    assert height % 2 == 0
    left = FHD.angle_deg((960 - width / 2, 540), (960 + width / 2, 540))
    assert left == pytest.approx(24.0, abs=1 / 39)
    assert display.angles_deg(width, 1)[0] == pytest.approx(left, abs=1e-9)
