"""The seven built-in scenes: places with jumps in depth and natural textures, by their seed."""

import numpy as np
import pytest
from scipy import ndimage

from pipeline.errors import InputError
from stimuli.rendering.render import WorldRenderer
from stimuli.scenes.builtin_scenes import build_scene, scene_names
from stimuli.scenes.shapes import box, crown
from stimuli.scenes.textures.surface_noise_and_photographs import cosine_blurred, finish, ramp


@pytest.mark.parametrize("name", [
    "tunnel",
    *(pytest.param(name, marks=pytest.mark.full) for name in
      ("garden", "shed", "castle", "colonnade", "thicket", "street")),
])  # fmt: skip
def test_a_scene_has_near_and_far_and_detail_like_a_photograph(name, gl_context):
    renderer = WorldRenderer(gl_context, build_scene(name, 1))
    try:
        frame = renderer.render(renderer.world.viewpoint.camera(192, 144))
    finally:
        renderer.release()
    depth = frame.depth_m[np.isfinite(frame.depth_m)]
    near, far = np.percentile(depth, (2, 98))
    assert near < 5
    assert far > 2 * near
    inverse = 1 / frame.depth_m
    jumps = np.abs(np.diff(inverse, axis=1)) > 0.02
    assert jumps.mean() > 0.005
    luma = frame.colour @ (0.2126, 0.7152, 0.0722)
    assert 0.1 < luma.mean() < 0.75
    assert luma.std() > 0.1
    # Amplitudes of photographs fall as about 1 / frequency: power as its square.
    window = np.hanning(144)[:, None] * np.hanning(192)
    power = np.abs(np.fft.rfft2((luma - luma.mean()) * window)) ** 2
    radius = np.hypot(np.fft.fftfreq(144)[:, None], np.fft.rfftfreq(192))
    bands = [power[(radius > low) & (radius <= 2 * low)].mean() for low in (0.02, 0.04, 0.08, 0.16)]
    slope = np.polyfit(np.log2((0.02, 0.04, 0.08, 0.16)), np.log2(bands), 1)[0]
    assert -3.5 < slope < -1.0


@pytest.mark.slow
def test_a_seed_makes_the_same_place_and_another_seed_another():
    first, again, other = (build_scene("castle", seed) for seed in (4, 4, 5))

    def content(world):
        meshes = [part.mesh.position_m.tobytes() for part in world.parts]
        return meshes, [part.material.texture.tobytes() for part in world.parts]

    assert content(first) == content(again)
    assert content(first)[0] != content(other)[0]


def test_an_unknown_scene_is_refused_with_the_nearest_name():
    with pytest.raises(InputError, match="did you mean 'thicket'"):
        build_scene("thickett")
    assert len(scene_names()) == 7


def test_parameters_that_no_scene_takes_are_refused():
    with pytest.raises(InputError, match="takes no parameters"):
        build_scene("garden", parameters={"flowers": 3})


def test_colours_by_value_lie_on_straight_lines_between_their_stops(rng):
    colours = [(22, 32, 10), (62, 84, 28), (104, 128, 48), (160, 172, 92)]
    plane = rng.uniform(0, 1, (7, 5))
    plane[0, :4] = 0, 1, 1 / 3, 2 / 3

    made = ramp(plane, colours)

    for channel in range(3):
        stops = np.asarray(colours, float)[:, channel]
        expected = np.interp(plane, np.linspace(0, 1, 4), stops)
        np.testing.assert_allclose(made[..., channel], expected, rtol=1e-12)


def test_uneven_light_is_a_gaussian_blur_that_ends_in_mirrors(rng):
    plane = rng.uniform(0, 255, (64, 64))

    expected = ndimage.gaussian_filter(plane, 5.0, mode="reflect")

    np.testing.assert_allclose(cosine_blurred(plane, 5.0), expected, rtol=1e-10)


def test_what_is_not_covered_takes_the_nearest_colour(rng):
    colour = rng.uniform(-20, 280, (9, 9, 3))
    coverage = np.zeros((9, 9))
    coverage[2, 3] = coverage[7, 7] = 1.0

    made = finish(colour, coverage)

    rows, columns = np.indices((9, 9))
    first, second = np.hypot(rows - 2, columns - 3), np.hypot(rows - 7, columns - 7)
    for chosen, place in ((first < second, (2, 3)), (second < first, (7, 7))):
        assert (made[chosen][:, :3] == np.rint(colour[place].clip(0, 255))).all()
    np.testing.assert_array_equal(made[..., 3], 255 * coverage)


def test_a_crowns_cards_are_flat_turned_away_from_its_middle_and_of_its_size(rng):
    middle = np.array([1.0, 2.0, 3.0])

    mesh = crown(rng, middle, (2.0, 1.0, 2.0), cards=40, card_m=0.5, shell=0.5)

    corners = mesh.position_m.reshape(40, 4, 3).astype(float)
    low_left, low_right, high_left, high_right = corners.transpose(1, 0, 2)
    np.testing.assert_allclose(low_right - low_left, high_right - high_left, atol=1e-5)
    wide = np.linalg.norm(low_right - low_left, axis=1)
    assert ((wide > 0.37) & (wide < 0.63)).all()
    np.testing.assert_allclose(np.linalg.norm(high_left - low_left, axis=1), wide, rtol=1e-4)
    out = (corners.mean(axis=1) - middle) / (2.0, 1.0, 2.0)
    far = np.linalg.norm(out, axis=1)
    assert ((far > 0.5**0.7 - 1e-4) & (far < 1 + 1e-4)).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.normal, axis=1), 1.0, rtol=1e-5)
    assert len(mesh.triangles) == 80
    assert (np.unique(mesh.triangles) == np.arange(160)).all()


def test_a_box_has_its_size_and_its_faces_look_along_the_axes():
    mesh = box((1.0, 2.0, 3.0), (2.0, 1.0, 0.5), texture_m=1.0)

    np.testing.assert_allclose(mesh.position_m.min(axis=0), (0.0, 1.5, 2.75), atol=1e-6)
    np.testing.assert_allclose(mesh.position_m.max(axis=0), (2.0, 2.5, 3.25), atol=1e-6)
    outward = np.sign(mesh.position_m - np.array([1.0, 2.0, 3.0], np.float32))
    assert (np.abs(mesh.normal).sum(axis=1) == 1).all()
    assert (np.sum(mesh.normal * outward, axis=1) == 1).all()
    assert len(np.unique(mesh.normal + 0.0, axis=0)) == 6
