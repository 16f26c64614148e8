"""Flat views of a panorama, and noise that lies on directions, on both twins."""

import math

import numpy as np
import pytest
from skimage import data

from pipeline.errors import InputError
from pipeline.foveation.conditions import Foveator, foveate
from pipeline.foveation.geometry import Flat
from pipeline.foveation.noise_plane import tile_edge
from pipeline.foveation.panorama_gpu import ViewPass
from pipeline.foveation.view import anchored_shift_px, belt_px, flat_view
from pipeline.gl.texture import create_texture, read_back, texture_from

VIEW = Flat(width_deg=70).of(81, 65)
TOWARDS = [(0.0, 0.0), (170.0, -30.0), (40.0, 80.0)]


@pytest.fixture(scope="module")
def panorama():
    return np.ascontiguousarray(data.astronaut()[100:228, :256] / np.float32(255), np.float32)


@pytest.fixture
def seen(gl_context, panorama):
    """Give a function that looks on the GPU: view and shift textures of the last look."""
    made = ViewPass(gl_context, (256, 128), VIEW)
    source = texture_from(gl_context, np.dstack([panorama, panorama[..., :1]]), "rgba32f")
    view = create_texture(gl_context, made.size, "rgba32f")
    shift = create_texture(gl_context, made.size, "rg32f")

    def look(right_deg, down_deg):
        made(source, view, shift, right_deg=right_deg, down_deg=down_deg)
        return view, shift

    yield look
    for thing in (made, source, view, shift):
        thing.release()


def places(right_deg, down_deg, geometry=VIEW):
    """Place of the noise of every pixel."""
    y, x = np.mgrid[: geometry.height_px, : geometry.width_px] + 0.5
    shift = anchored_shift_px(geometry, right_deg=right_deg, down_deg=down_deg)
    return np.stack([x, y], axis=-1) - shift


@pytest.mark.parametrize("towards", TOWARDS)
def test_views_on_gpu_match_reference(seen, panorama, towards):
    right_deg, down_deg = towards
    view, shift = seen(right_deg, down_deg)
    wanted = flat_view(panorama, VIEW, right_deg=right_deg, down_deg=down_deg)
    np.testing.assert_allclose(read_back(view)[..., :3], wanted, atol=0.5 / 255)
    found = read_back(shift) - anchored_shift_px(VIEW, right_deg=right_deg, down_deg=down_deg)
    # Where the belt ends either answer is right, and at its back the other end of the belt.
    assert (np.abs(found).max(axis=-1) < 2e-3).mean() > 0.98


@pytest.mark.parametrize("towards", TOWARDS)
def test_a_metamer_of_a_view_matches_reference_with_noise_on_directions(
    seen, gl_context, panorama, towards
):
    right_deg, down_deg = towards
    turned = {"right_deg": right_deg, "down_deg": down_deg}
    viewing = Flat(width_deg=70)
    foveator = Foveator((65, 81), viewing=viewing, ctx=gl_context)
    target = create_texture(gl_context, (81, 65), "rgba32f")
    view, shift = seen(right_deg, down_deg)
    foveator.passes(view, target, (5.0, 5.0), seed=1, noise_shift_px=shift)
    wanted = foveate(
        flat_view(panorama, VIEW, **turned),
        (5.0, 5.0),
        viewing=viewing,
        seed=1,
        noise_shift_px=anchored_shift_px(VIEW, **turned),
    )
    apart = np.abs(read_back(target)[..., :3] - wanted).max(axis=-1)
    assert (apart < 1 / 255).mean() > 0.98
    assert apart.mean() < 0.2 / 255
    foveator.release()
    target.release()


@pytest.mark.parametrize("pixel", [(10, 20), (60, 70), (32, 0)])
@pytest.mark.parametrize("towards", TOWARDS)
def test_a_direction_keeps_its_noise_when_the_view_turns(pixel, towards):
    """A second view looks straight at a pixel of the first: its middle finds the same noise."""
    row, column = pixel
    right_deg, down_deg = towards
    first = places(right_deg, down_deg)[row, column]
    right, down = math.radians(right_deg), math.radians(down_deg)
    nod = [[1, 0, 0], [0, math.cos(down), math.sin(down)], [0, -math.sin(down), math.cos(down)]]
    swing = [
        [math.cos(right), 0, math.sin(right)],
        [0, 1, 0],
        [-math.sin(right), 0, math.cos(right)],
    ]
    ray = np.array(swing) @ np.array(nod) @ VIEW.directions(column + 0.5, row + 0.5)
    again = places(math.degrees(math.atan2(ray[0], ray[2])), math.degrees(math.asin(ray[1])))
    np.testing.assert_allclose(again[32, 40], first, atol=1e-9)


@pytest.mark.parametrize("width_px", [60, 300, 2000])
def test_noise_goes_once_round_without_a_seam_and_is_as_wide_as_pixels(width_px):
    geometry = Flat(width_deg=90).of(width_px, width_px)
    around = 2 * math.pi * belt_px(geometry)
    assert around % tile_edge(width_px, width_px) == pytest.approx(0, abs=1e-6)
    if width_px > 200:
        assert 0.6 < belt_px(geometry) / geometry.distance_px < 1.2


@pytest.mark.parametrize("down_deg", [0.0, -40.0, 80.0])
def test_noise_is_as_dense_as_the_views_pixels(down_deg):
    """Two pixels beside each other lie .7 to 1.45 pixels of noise apart, in the middle."""
    around = places(20.0, down_deg, Flat(width_deg=40).of(601, 601))[295:306, 295:306]
    for axis in (0, 1):
        step = np.linalg.norm(np.diff(around, axis=axis), axis=-1)
        assert 0.7 < np.median(step) < 1.45


def test_a_panorama_of_another_size_is_refused(gl_context):
    made = ViewPass(gl_context, (256, 128), VIEW)
    wrong = create_texture(gl_context, (128, 64), "rgba32f")
    with pytest.raises(InputError, match="panorama must be 256x128 rgba32f or rgba8"):
        made(wrong, wrong, wrong)
    for thing in (made, wrong):
        thing.release()


def test_views_make_no_gl_objects(seen, refuse_gl_objects):
    """After the first, in whatever direction."""
    first = read_back(seen(0.0, 0.0)[0])
    refuse_gl_objects()
    other = read_back(seen(100.0, 20.0)[0])
    assert np.abs(read_back(seen(0.0, 0.0)[0]) - first).max() == 0 < np.abs(other - first).max()
