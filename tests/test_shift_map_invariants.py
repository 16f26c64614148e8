"""What a shift-map fill must keep, whatever the scene."""

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame
from pipeline.methods.registry import create_method
from pipeline.shiftmap.reference import shift_map_fill
from pipeline.shiftmap.settings import ShiftMapSettings
from pipeline.warp.reference import warp

Z_NEAR_M = 2.0


def fill(frame, **settings):
    return shift_map_fill(frame, ShiftMapSettings(**settings), z_near_m=Z_NEAR_M)


@pytest.fixture(scope="module")
def red_scene(disc_over_plane) -> WarpedFrame:
    """A red disc that moved 24 px over grey noise, warped for real."""
    flow = np.where(disc_over_plane.depth_m[..., None] < 3, (24.0, 3.0), (0.0, 0.0))
    return warp(disc_over_plane, flow.astype(np.float32))


@pytest.fixture(scope="module")
def red_fill(red_scene):
    return fill(red_scene)


def test_a_red_foreground_never_bleeds_into_a_grey_background(red_scene, red_fill):
    """Red less green is 0.7 on the disc and 0 in every hole; only rounding remains."""
    inside = red_fill.colour[red_scene.hole]

    assert len(inside) > 500
    assert np.abs(inside - inside[:, :1]).max() < 1e-6
    assert inside[:, 1].std() > 0.1  # and it is no flat grey


def test_the_fill_has_as_much_detail_as_the_background(red_scene, red_fill):
    """White noise of deviation .6 / sqrt(12), in the same places of the plane and of the hole."""
    deep = red_scene.hole & (red_fill.gain > 0.9)

    assert deep.sum() > 200
    assert red_fill.colour[deep].std() == pytest.approx(0.6 / np.sqrt(12), rel=0.15)


def test_known_pixels_keep_their_bits(red_scene, red_fill):
    known = ~red_scene.hole

    filled = red_fill.colour.astype(np.float32)[known]

    assert filled.tobytes() == red_scene.colour[known].tobytes()


def test_without_gain_the_base_is_left_alone(red_scene):
    found = fill(red_scene, gain=0.0)

    np.testing.assert_array_equal(found.colour[red_scene.hole], found.base.colour[red_scene.hole])


def test_detail_moves_with_the_background(rng):
    """The screen-door test: the view turns by whole pixels, and copied detail turns with it.

    Push-pull's grid does not turn, and what it changes in the base may change a choice of the
    search; so detail is compared, where most shifts are the same.
    """
    height, width, by = 64, 128, (4, 8)
    plane = rng.uniform(0.2, 0.8, (height + 16, width + 16, 3)).astype(np.float32)

    def view(down, right):
        colour = plane[8 - down :, 8 - right :][:height, :width].copy()
        x = np.arange(width) - right
        nearer = np.broadcast_to(x < 40, (height, width))
        hole = np.broadcast_to((x >= 40) & (x < 56), (height, width)).copy()
        colour[nearer] = (0.9, 0.1, 0.1)
        depth_m = np.where(nearer, 2.0, 5.0).astype(np.float32)
        flow = np.where(nearer[..., None], (right - 16.0, down), (right, down))
        return WarpedFrame(colour, depth_m, hole, flow.astype(np.float32))

    still, moved = fill(view(0, 0)), fill(view(*by))

    there = moved.detail[by[0] + 8 : -8, 40 + by[1] : 56 + by[1]]
    here = still.detail[8 : -8 - by[0], 40:56]
    same_place = still.detail[by[0] + 8 : -8, 40:56]
    assert np.corrcoef(there.ravel(), here.ravel())[0, 1] > 0.5
    assert abs(np.corrcoef(there.ravel(), same_place.ravel())[0, 1]) < 0.2


def test_a_nearest_depth_that_is_none_is_refused(gl_context):
    with pytest.raises(InputError, match="z_near_m must be a depth in metres"):
        create_method("shift-map", gl_context, {"z_near_m": -1.0})
