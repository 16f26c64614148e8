"""Panoramas with distance: drawn, as files, as scenes of a study, and in `metamerlab warp`."""

import numpy as np
import pytest
import trimesh
from cameras import psnr_db, room_around
from command_line import outcome_of, refusal_of
from pydantic import ValidationError

from pipeline.colour import encode_srgb
from pipeline.errors import InputError
from pipeline.foveation.geometry import Equirectangular, pixel_centres
from pipeline.pictures.colour_file import load_colour, save_colour
from pipeline.pictures.panorama_file import load_panorama, save_panorama
from pipeline.pictures.write import write_pixels
from protocols.recipes.warped_clips import AroundScene
from stimuli.batch.footage import CameraShot, Footage
from stimuli.rendering.open_scene import open_scenery
from stimuli.rendering.paths import make_path
from stimuli.rendering.render import WorldRenderer
from stimuli.rendering.render_panorama import surroundings_of
from stimuli.rendering.world import Material, Mesh, MeshPart, Viewpoint, World

run = outcome_of("warp")
refusal = refusal_of("warp")
LINE = {"kind": "line", "direction": (1.0, 0.0, 0.0)}


def around(**keys):
    """Return a scene of kind around."""
    return AroundScene.model_validate({"kind": "around", "name": "room", "camera": LINE} | keys)


@pytest.fixture
def folder(tmp_path):
    """The room as OpenEXR, and as a picture with millimetres in a PNG."""
    room = room_around(64)
    save_panorama(tmp_path / "room.exr", room)
    save_colour(tmp_path / "room.png", room.colour)
    millimetres = np.rint(1000 * room.distance_m).astype(np.uint16)
    write_pixels(tmp_path / "room-mm.png", millimetres[..., None], "Y")
    return tmp_path


def test_each_pixel_has_colour_and_distance_along_its_own_ray(gl_context):
    """By hand: walls of a cube around the eye, 4 m away; what a wall shows is its place there."""
    box = trimesh.creation.box((8, 8, 8))
    corners = np.asarray(box.triangles).reshape(-1, 3).astype(np.float32)
    mesh = Mesh(
        corners, corners, np.zeros((len(corners), 2), np.float32), 0.5 + corners / 16,
        np.arange(len(corners), dtype=np.uint32).reshape(-1, 3),
    )  # fmt: skip
    white = Material(np.full((2, 2, 4), 255, np.uint8), lit=False)
    world = World((MeshPart(mesh, white),), Viewpoint((0, 0, 0), (0, -0.3, -2)))
    renderer = WorldRenderer(gl_context, world)
    move_m = np.array([1.0, 0.5, -0.5])
    made = surroundings_of(renderer, 64, move_m=move_m)
    renderer.release()

    geometry = Equirectangular().of(128, 64)
    rays = geometry.directions(*pixel_centres(geometry))
    with np.errstate(divide="ignore"):
        away = ((4 * np.sign(rays) - move_m) / rays).min(axis=-1)
    off = np.abs(made.distance_m / away - 1)
    assert np.percentile(off, 95) < 2e-4
    assert off.max() < 0.01  # where walls meet, the slope is neither's
    place = (move_m + rays * away[..., None]) * (1, -1, -1)  # y is up in the world, ahead is -z
    np.testing.assert_allclose(made.colour, encode_srgb(0.5 + place / 16), atol=0.006)


def test_files_come_back_as_they_were_written(folder):
    room = room_around(64)
    for made in (
        load_panorama(folder / "room.exr"),
        load_panorama(folder / "room.png", folder / "room-mm.png", depth_scale=0.001),
    ):
        np.testing.assert_allclose(made.colour, room.colour, atol=0.003)
        np.testing.assert_allclose(made.distance_m, room.distance_m, atol=0.0006)


def test_what_is_no_panorama_with_distance_is_refused_with_the_reason(folder):
    write_pixels(folder / "flat.exr", np.full((64, 152, 4), 0.5, np.float32), "RGBZ")
    common = [folder / "out.png", "--panorama"]

    assert "twice as wide as high (got 152 x 64 px)" in refusal(folder / "flat.exr", *common)
    said = refusal(folder / "room.png", *common, "--depth", folder / "room-mm.png",
                   "--depth-is", "distance")  # fmt: skip
    assert "no axis" in said
    assert "give a file of it with --depth" in " ".join(
        refusal(folder / "room.png", *common).split()
    )
    assert "need --panorama" in refusal(folder / "room.exr", folder / "out.png", "--move", "0,0,1")
    assert "X,Y,Z in metres" in refusal(folder / "room.exr", *common, "--move", "0,1")
    assert "leave out" in refusal(folder / "room.exr", *common, "--parallax", 0.1)
    assert "built-in scene" in refusal("builtin:stret", *common)
    assert not (folder / "out.png").exists()
    with pytest.raises(ValidationError, match="no axis"):
        around(file="room.exr", depth_is="distance")
    with pytest.raises(ValidationError, match="must say builtin, or file, or rgb and depth"):
        around(file="room.exr", builtin="street")
    with pytest.raises(ValidationError, match="seen from one place"):
        around(file="room.exr", camera={"kind": "upsampling", "real_every": 2, "along": LINE})


@pytest.mark.usefixtures("gl_context")
def test_the_command_warps_and_fills_a_view_and_the_whole_panorama(folder):
    moved = ["--panorama", "--move", "0.25,0.1,-0.1"]
    common = ["-m", "push-pull-depth", "--around", folder / "moved.png"]
    _, said, _ = run(folder / "room.exr", folder / "out.png", *moved, "--look", "180,-20", *common)

    assert "41 x 41 px, holes" in said
    whole = load_colour(folder / "moved.png")
    assert whole.shape == (64, 128, 3)
    still = room_around(64).colour
    assert 15 < psnr_db(whole, still, np.ones((64, 128), bool)) < 35
    look = outcome_of("stimuli", "look")
    _, said, _ = look(folder / "room.exr", "--out", folder / "views.png", "--views", 2)
    assert "1: right_deg = -88, down_deg = -59" in said


@pytest.mark.slow
def test_a_scene_all_around_moves_along_every_path_and_knows_its_true_views(gl_context):
    """The camera starts turned by 90 degrees: its own right is the panorama's back."""
    keys = {"builtin": "colonnade", "height_px": 128, "right_deg": 90.0, "seed": 1}
    frames = [
        {"t_s": 0.0, "position_m": (0.0, 0.0, 0.0)},
        {"t_s": 1.0, "position_m": (0.2, 0.0, 0.0), "yaw_deg": 25.0},
    ]
    paths = [
        LINE, {"kind": "circle"}, {"kind": "keyframes", "keyframes": tuple(frames)},
        {"kind": "upsampling", "real_every": 2, "along": LINE},
    ]  # fmt: skip
    scenery = open_scenery(gl_context, around(**keys), None)
    for path in paths:
        scene = around(**keys, camera=path)
        shot = CameraShot(make_path(scene.camera, 3, 2.0), (48, 36), 0.2, 0.15)
        footage = Footage(gl_context, scenery, shot)
        try:
            for frame in range(3):
                warped = footage.warped(frame)
                known = ~warped.hole
                assert known.mean() > 0.5
                assert psnr_db(warped.colour, footage.truth(frame), known) > 20, path
            assert np.array_equal(footage.holes(2), footage.warped(2).hole)
        finally:
            footage.release()
    scenery.release()


def test_a_scene_of_files_has_no_true_view(folder):
    scene = around(rgb="room.png", depth="room-mm.png", depth_scale=0.001, reference=False)
    shot = CameraShot(make_path(scene.camera, 2, 2.0), (32, 24), 0.2, 0.15)
    scenery = open_scenery(None, scene, folder)
    footage = Footage(None, scenery, shot)
    assert footage.margin_px == 0
    assert footage.warped(0).size == (24, 32)
    assert not scene.has_reference
    assert not around(file="room.exr").has_reference
    assert around(builtin="street").has_reference
    with pytest.raises(InputError, match="no true view"):
        footage.truth(0)
