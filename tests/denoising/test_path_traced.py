"""Path-traced pictures: views of a scene, light by hand, noise by samples."""

import numpy as np
import pytest

from pipeline.errors import InputError
from stimuli.denoise.path_traced import PathTracer, Rendering, SceneView, encoded, render_pair
from stimuli.rendering.world import Light, Material, Mesh, MeshPart, Viewpoint, World

CURE = "needs the extra `denoise`: script/setup --denoise installs it"


def test_views_differ_and_the_first_is_the_scenes_own():
    world = World((_floor(),), Viewpoint((0, 2, 0), (0, 1, -6)), Light())
    poses = [SceneView("shed", n).camera(world, 64).world_from_camera for n in (0, 1, 2, 3)]

    assert np.allclose(poses[0][:3, 3], (0, 2, 0))
    assert len({pose.tobytes() for pose in poses}) == 4
    assert all(np.linalg.norm(pose[:3, 3] - (0, 2, 0)) < 2 for pose in poses)
    with pytest.raises(InputError, match="must be one of"):
        SceneView("moon", 0)


def _floor():
    corners = np.array([(-50, 0, -50), (50, 0, -50), (50, 0, 50), (-50, 0, 50)], np.float32)
    up = np.tile(np.array([0, 1, 0], np.float32), (4, 1))
    tint = np.tile(np.array([1.0, 0.5, 0.25], np.float32), (4, 1))
    mesh = Mesh(corners, up, corners[:, [0, 2]], tint, np.array([[0, 1, 2], [0, 2, 3]]))
    return MeshPart(mesh, Material(np.full((2, 2, 4), 188, np.uint8)))


@pytest.fixture(scope="module")
def floor():
    """A lit floor under an even sky, seen from above, and its tracer."""
    pytest.importorskip("mitsuba", reason=CURE)
    light = Light(sun_direction=(0, 3, 4), sun=(1, 1, 1), sky=(0.5, 0.5, 0.5), exposure=1)
    world = World((_floor(),), Viewpoint((0, 3, 0), (0.1, 0, -3)), light)
    return world, PathTracer(world)


def test_light_on_a_floor_is_that_of_sun_and_sky(floor):
    """Albedo .503 (188 of 255, decoded) times the tint, by sun at .6 of upright and the sky."""
    world, tracer = floor
    camera = world.viewpoint.camera(16, 16)
    found = tracer.render(camera, 256, 1).mean(axis=(0, 1))

    albedo = ((188 / 255 + 0.055) / 1.055) ** 2.4
    assert np.allclose(found, albedo * np.array([1, 0.5, 0.25]) * (0.6 + 0.5), rtol=0.03)
    assert (tracer.shown(found) == encoded(found.astype(np.float64))).all()


def test_more_samples_are_less_noisy_and_seeds_decide(floor):
    world, tracer = floor
    rendering = Rendering(64, 4)
    (renders, _), (again, _) = (
        render_pair(tracer, world, SceneView("shed", 1), rendering) for _ in range(2)
    )

    assert (renders == again).all()
    deviation = renders[:, 40:, :, 0].std(axis=(1, 2))
    assert (np.diff(deviation) < 0).all()
    # 32 samples have the fifth root of a half five times of one's deviation, nearly.
    assert 4 < deviation[0] / deviation[5] < 8
