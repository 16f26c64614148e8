"""A panorama with distance, warped into views from a moved eye: beside the flat warp of a room."""

import numpy as np
import pytest
from cameras import (
    MOVE_M,
    VIEWS,
    flat_warp,
    look_along,
    psnr_db,
    room_around,
    true_view,
)
from scipy import ndimage

from pipeline.errors import InputError
from pipeline.foveation.geometry import Equirectangular, Flat, pixel_centres
from pipeline.foveation.panorama import with_caps
from pipeline.foveation.view import flat_view, square_view
from pipeline.frame import PanoramaFrame, SourceFrame
from pipeline.methods.moved_panorama import move_panorama, warp_panorama
from pipeline.methods.registry import fill
from pipeline.warp.around import (
    KEPT_PX,
    GridPart,
    Outlook,
    panorama_motion,
    seen_from,
)
from pipeline.warp.gpu import warp_frame

HEIGHT = 256


@pytest.fixture(scope="module")
def room():
    return room_around(HEIGHT)


@pytest.fixture(scope="module")
def view():
    return square_view(2 * HEIGHT, 90)


def beyond_a_pixel(one, other):
    """Return the share of `one` that is farther than a pixel from `other`."""
    return (one & ~ndimage.binary_dilation(other, np.ones((3, 3)))).sum() / one.sum()


def test_a_pixel_goes_where_its_point_is_seen_from_the_moved_eye():
    """By hand: 2 m straight ahead and, seen a meter from the left and two down, at 45 degrees."""
    view = Flat(distance_px=10).of(40, 30)
    small = Equirectangular().of(16, 8)
    middle = GridPart(
        8, 4, 1, 1, small
    )  # its centre is right of and below the middle by half a pixel
    right, down = np.radians((360 / 32, 180 / 16))
    point = 2 * np.array([np.sin(right) * np.cos(down), np.sin(down), np.cos(right) * np.cos(down)])
    outlook = Outlook.towards(view, point - (1, 2, 1))

    flow_px, depth_m = panorama_motion(np.float32([[2]]), middle, outlook)

    np.testing.assert_allclose(flow_px[0, 0] + (8.5, 4.5), (20 + 10, 15 + 20), atol=1e-4)
    np.testing.assert_allclose(depth_m, 1, rtol=1e-6)
    still, far_m = panorama_motion(np.float32([[np.inf]]), middle, outlook)
    np.testing.assert_allclose(
        still[0, 0] + (8.5, 4.5), (20 + 10 * np.tan(right), 15 + 10 * np.tan(down) / np.cos(right)),
        atol=1e-4,
    )  # fmt: skip
    assert np.isinf(far_m)


def test_the_grid_goes_on_over_the_seam_and_over_the_poles():
    """By hand: beyond a pole the other meridian comes back, and its directions say so."""
    plane = np.arange(8 * 16).reshape(8, 16)
    geometry = Equirectangular().of(16, 8)
    part = GridPart(-2, -1, 20, 10, geometry)

    read = part.read(plane)

    assert np.array_equal(read[1:9, 2:18], plane)
    assert np.array_equal(read[1:9, :2], plane[:, -2:])
    assert np.array_equal(read[1:9, 18:], plane[:, :2])
    assert np.array_equal(read[0, 2:18], np.roll(plane[0], 8))
    assert np.array_equal(read[9, 2:18], np.roll(plane[7], 8))
    rays = geometry.directions(*pixel_centres(geometry))
    np.testing.assert_allclose(geometry.directions(*part.centres()), part.read(rays), atol=1e-12)


def test_what_a_view_can_show_lies_in_the_part_that_is_kept(room, rng):
    """For any direction, width and move the warp of all of the grid shows the same."""
    shares = []
    for _ in range(6):
        view = Flat(width_deg=rng.uniform(20, 140)).of(*rng.integers(40, 80, 2))
        look = rng.uniform(-400, 400), rng.uniform(-90, 90)
        outlook = Outlook.towards(view, rng.uniform(-0.5, 0.5, 3), *look)
        made, whole = seen_from(room, outlook), GridPart.around((HEIGHT, 2 * HEIGHT), outlook)
        flow_px, depth_m = panorama_motion(whole.read(room.distance_m), whole, outlook)
        source = SourceFrame(whole.read(room.colour), whole.read(room.distance_m))
        warped = [
            warp_frame(one, flow, target_depth_m=depth, window=window)
            for one, flow, depth, window in (
                (made.source, made.flow_px, made.target_depth_m, made.window),
                (source, flow_px, depth_m, whole.window(outlook)),
            )
        ]
        assert np.array_equal(warped[0].hole, warped[1].hole)
        assert np.array_equal(warped[0].colour, warped[1].colour)
        shares.append(made.source.depth_m.size / source.depth_m.size)
    assert min(shares) < 0.5


def assert_as_the_flat_warp(ctx, room, view, name):
    """Compare a view with the flat warp of the same view, from a source of the same density."""
    look = VIEWS[name]
    made = warp_panorama(room, MOVE_M, view, right_deg=look[0], down_deg=look[1], ctx=ctx)
    flat = flat_warp(ctx, view, *look, MOVE_M)
    colour, depth_m = true_view(view, *look, MOVE_M)
    known = ~(made.hole | flat.hole)

    assert beyond_a_pixel(made.hole, flat.hole) <= 0.01
    assert beyond_a_pixel(flat.hole, made.hole) <= 0.01
    assert psnr_db(made.colour, colour, known) >= 41
    assert (np.abs(made.depth_m[known] / depth_m[known] - 1) > 0.02).mean() <= 0.003
    return made, flat, colour


def test_a_view_over_the_seam_has_the_holes_and_colours_of_the_flat_warp(gl_context, room, view):
    assert_as_the_flat_warp(gl_context, room, view, "seam")


@pytest.mark.slow
@pytest.mark.parametrize("name", VIEWS)
def test_views_all_around_are_as_those_of_the_flat_warp(gl_context, room, view, name):
    made, flat, colour = assert_as_the_flat_warp(gl_context, room, view, name)
    for method in ("push-pull-depth", "coherence-transport", "metameric"):
        both = [
            psnr_db(fill(one, method, seed=7, ctx=gl_context), colour, one.hole)
            for one in (made, flat)
        ]
        assert both[0] >= both[1] - 1.5, method


@pytest.mark.parametrize("look", [(20, 10), (180, 0), (0, 90)])
def test_an_eye_that_stays_sees_what_a_flat_view_of_the_panorama_shows(
    gl_context, room, view, look
):
    """To within resampling: here between pixels in a line, there by a cubic."""
    right, down = look
    made = warp_panorama(room, (0, 0, 0), view, right_deg=right, down_deg=down, ctx=gl_context)

    shown = flat_view(room.colour, view, right_deg=right, down_deg=down)
    true, depth_m = true_view(view, right, down, (0, 0, 0))
    assert not made.hole.any()
    assert psnr_db(made.colour, shown, made.depth_m > 0) >= 40
    assert psnr_db(made.colour, true, made.depth_m > 0) >= psnr_db(shown, true, depth_m > 0) - 1


def test_both_twins_of_the_warp_take_a_part_of_a_panorama(gl_context):
    room = room_around(64)
    for right, down in ((180, 0), (0, 90)):
        view = Flat(width_deg=90).of(40, 32)
        twins = [
            warp_panorama(room, MOVE_M, view, right_deg=right, down_deg=down, ctx=ctx)
            for ctx in (None, gl_context)
        ]
        assert np.array_equal(twins[0].hole, twins[1].hole)
        np.testing.assert_allclose(twins[0].colour, twins[1].colour, atol=1e-4)


@pytest.mark.slow
def test_belt_and_caps_join_without_seam_or_pole(gl_context, room):
    """Holes that are none beyond a pixel of the truth, and colours, above 55 degrees and there."""
    geometry = Equirectangular().of(512, 256)
    rays = geometry.directions(*pixel_centres(geometry))
    true, true_m = look_along(rays, MOVE_M)
    point = MOVE_M + rays * true_m[..., None]
    away = np.linalg.norm(point, axis=-1)
    hidden = look_along(point / away[..., None])[1] < 0.995 * away
    shown = move_panorama(room, MOVE_M, "push-pull-depth", seed=7, ctx=gl_context)

    def holes(geometry):
        hole = warp_panorama(room, MOVE_M, geometry, ctx=gl_context).hole
        return np.repeat(hole[..., None], 3, axis=-1).astype(np.float32)

    margin = Outlook.towards(geometry, MOVE_M).margin_px
    hole = with_caps(holes(geometry)[:, margin:-margin], geometry, holes)[..., 0] > 0.5
    near = ndimage.binary_dilation(np.hstack([hidden] * 3), np.ones((3, 3)))[:, 512:1024]
    latitude = np.abs(np.degrees(np.arcsin(rays[..., 1])))
    seam = np.zeros(near.shape, bool)
    seam[:, :4] = seam[:, -4:] = True
    for zone, most in ((latitude > 55, 0.003), (seam & (latitude < 60), 0.0)):
        assert (hole & ~near)[zone].mean() <= most
        assert psnr_db(shown, true, zone & ~near) >= 42


def test_a_panorama_must_be_whole_and_a_move_three_numbers(room):
    with pytest.raises(InputError, match="twice as wide as high"):
        PanoramaFrame(room.colour[:, :500].copy(), room.distance_m[:, :500].copy())
    with pytest.raises(InputError, match="three finite numbers"):
        warp_panorama(room, (0, 1))


def test_what_lies_far_outside_of_a_view_is_not_drawn_and_keeps_its_motion(room, view):
    """Its neighbours are judged by it: a surface that leaves the view is not torn at its border."""
    made = seen_from(room, Outlook.towards(view, MOVE_M))
    window = made.window
    at = made.flow_px + np.indices(made.source.size)[::-1].transpose(1, 2, 0) + 0.5
    at -= (window.x_px, window.y_px)
    out = ((at < -KEPT_PX - 0.01) | (at > view.width_px + KEPT_PX + 0.01)).any(axis=-1)
    assert out.any()
    assert (made.target_depth_m[out] == 0).all()
    assert (made.flow_px[out] != 0).any()
