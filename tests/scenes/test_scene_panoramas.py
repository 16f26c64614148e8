"""Panoramas drawn of a world: every direction in its place, seams and poles included."""

import numpy as np
import pytest
import trimesh
from command_line import metamerlab
from PIL import Image

from pipeline.colour import encode_srgb
from pipeline.errors import InputError
from pipeline.foveation.geometry import Equirectangular, pixel_centres
from stimuli.rendering.render_panorama import panorama_of
from stimuli.rendering.world import Material, Mesh, MeshPart, Viewpoint, World

EYE = np.array([3.0, 1.6, -2.0])
AHEAD = np.array([1.0, -0.3, -2.0])
WHITE = Material(np.full((2, 2, 4), 255, np.uint8), lit=False)


@pytest.fixture(scope="module")
def ball():
    """Around the eye a ball whose colour is the direction; its light is linear."""
    shape = trimesh.creation.icosphere(subdivisions=5, radius=10.0)
    rays = np.asarray(shape.vertices) / 10
    mesh = Mesh(
        (shape.vertices + EYE).astype(np.float32), rays.astype(np.float32),
        np.zeros((len(rays), 2), np.float32), (0.5 + 0.4 * rays).astype(np.float32),
        shape.faces.astype(np.uint32),
    )  # fmt: skip
    return World((MeshPart(mesh, WHITE),), Viewpoint(tuple(EYE), tuple(EYE + AHEAD)))


def test_every_pixel_of_a_panorama_shows_its_own_direction(ball, gl_context):
    """By hand: the viewpoint's direction, level, lies in the middle; right of it is right."""
    told = []
    made = panorama_of(gl_context, ball, 90, report=lambda *done: told.append(done))

    around = Equirectangular().of(180, 90)
    x, y = pixel_centres(around)
    right, down = (x / 180 - 0.5) * 2 * np.pi, (y / 90 - 0.5) * np.pi
    middle = AHEAD * (1, 0, 1) / np.linalg.norm(AHEAD * (1, 0, 1))
    aside = np.cross(middle, (0, 1, 0))
    wanted = np.cos(down)[..., None] * (
        np.cos(right)[..., None] * middle + np.sin(right)[..., None] * aside
    ) - np.sin(down)[..., None] * np.array([0, 1, 0])
    assert made.shape == (90, 180, 3)
    np.testing.assert_allclose(made, encode_srgb(0.5 + 0.4 * wanted), atol=0.006)
    assert told == [(k, 6) for k in range(1, 7)]


def test_a_fine_pattern_is_averaged_and_not_left_to_chance(gl_context):
    """Dots too fine for a pixel: a panorama is their mean, to what four samples leave of them."""
    rng = np.random.default_rng(1)
    grain = np.full((256, 256, 4), 255, np.uint8)
    grain[..., :3] = np.where(rng.random((256, 256, 1)) < 0.5, 64, 192)
    room = trimesh.creation.box((8, 8, 8))
    corners = np.asarray(room.triangles).reshape(-1, 3)
    spread = corners + 0.1 * corners[:, [1, 2, 0]]
    mesh = Mesh(
        corners.astype(np.float32), corners.astype(np.float32), spread[:, :2].astype(np.float32),
        np.ones((len(corners), 3), np.float32), np.arange(len(corners), dtype=np.uint32),
    )  # fmt: skip
    world = World((MeshPart(mesh, Material(grain, lit=False)),), Viewpoint((0, 0, 0), (0, 0, -1)))

    made = panorama_of(gl_context, world, 32)[..., 0]
    assert made.std() < 0.12  # one sample alone has .25


@pytest.mark.parametrize("height_px", [15, 4097])
def test_heights_that_cannot_be_drawn_are_refused(ball, gl_context, height_px):
    with pytest.raises(InputError, match=f"16 to 4096 px high .got {height_px} px"):
        panorama_of(gl_context, ball, height_px)


def test_a_viewpoint_without_a_horizon_is_refused(ball, gl_context):
    above = ball.seen_from(Viewpoint((0, 0, 0), (0, -1, 0)))
    with pytest.raises(InputError, match="must not look straight up or down"):
        panorama_of(gl_context, above, 32)


def test_the_command_draws_a_file_of_a_scene_from_a_chosen_place(gl_context, tmp_path):
    del gl_context  # skips where there is none
    room = trimesh.creation.box((8, 3, 6))
    room.invert()
    room.visual = trimesh.visual.ColorVisuals(room, face_colors=np.full((12, 4), 120, np.uint8))
    room.export(tmp_path / "room.glb")
    where = "view = { position_m = [0, 0, 1], look_at_m = [1, 0, 1] }"
    given = [
        "stimuli",
        "panorama",
        str(tmp_path / "room.glb"),
        "--height-px",
        "32",
        "--view",
        where,
    ]

    done = metamerlab(*given, "--out", str(tmp_path / "around.png"))
    assert "64 x 32 px" in done.output
    with Image.open(tmp_path / "around.png") as drawn:
        assert drawn.size == (64, 32)
    wrong = metamerlab(*given, "--out", str(tmp_path / "around.jpg"), status=2)
    assert "must end in .png" in wrong.stderr
