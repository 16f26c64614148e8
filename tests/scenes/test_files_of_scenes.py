"""Every file that a loader opens decides the clip's key; none that is broken is left out."""

import base64
import json
import os
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from pipeline.errors import InputError
from protocols.recipes.warped_clips import MeshScene, RgbdScene, StereoScene
from stimuli.rendering.open_scene import open_world, scene_files, scene_inputs
from stimuli.scenes.mesh_file import load_world

CAMERA = {"kind": "circle"}
_opened: list[Path] | None = None


def _note(event: str, arguments: tuple[object, ...]) -> None:
    if event == "open" and _opened is not None and isinstance(arguments[0], (str, os.PathLike)):
        _opened.append(Path(os.path.realpath(arguments[0])))


@cache
def listen() -> None:
    """Have every opened file noted from now on: a hook cannot be taken away, and slows all."""
    sys.addaudithook(_note)


def opened_below(folder: Path, work) -> set[Path]:
    """Every file below a folder that Python opens while `work` runs."""
    global _opened
    listen()
    _opened = []
    try:
        work()
        return {path for path in _opened if path.is_relative_to(folder) and path.is_file()}
    finally:
        _opened = None


def picture(path: Path, grey: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.full((4, 4, 3), grey, np.uint8)).save(path)


def mesh(file: str) -> MeshScene:
    return MeshScene.model_validate(
        {"name": "m", "kind": "mesh", "file": file, "camera": CAMERA,
         "view": {"position_m": (0, 0, 0), "look_at_m": (0, 0, -1)}}
    )  # fmt: skip


@pytest.fixture
def gltf(tmp_path) -> Path:
    """A mesh with buffer and picture in files of their own."""
    visual = trimesh.visual.TextureVisuals(
        uv=[[0, 0], [1, 0], [0, 1]],
        material=trimesh.visual.material.PBRMaterial(
            name="wall", baseColorTexture=Image.new("RGB", (4, 4), (200, 20, 20))
        ),
    )
    scene = trimesh.Scene(
        trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], visual=visual)
    )
    for name, data in scene.export(file_type="gltf").items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "model.gltf").rename(tmp_path / "s.gltf")
    document = json.loads((tmp_path / "s.gltf").read_text())
    (tmp_path / "maps").mkdir()
    picture(tmp_path / "maps/red wall.png", 90)
    document["images"] = [{"uri": "maps/red%20wall.png"}]
    (tmp_path / "s.gltf").write_text(json.dumps(document))
    return tmp_path


def test_each_file_of_a_gltf_changes_its_key(gltf):
    files = scene_files(mesh("s.gltf"), gltf)
    assert {"s.gltf", "maps/red wall.png"} < set(files)
    assert any(path.suffix == ".bin" for path in files.values())
    for path in files.values():
        before = scene_inputs(mesh("s.gltf"), gltf)
        data = path.read_bytes()
        path.write_bytes(data + b" ")
        assert scene_inputs(mesh("s.gltf"), gltf) != before
        path.write_bytes(data)


@pytest.mark.parametrize(
    ("texture", "moved"),
    [
        ({"extensions": {"KHR_texture_transform": {"offset": [0.5, 0]}}}, 0.5),
        ({"extensions": {"KHR_texture_transform": {"offset": [0.0, 0.0], "scale": [1, 1]}}}, 0),
        ({"extensions": []}, 0),
    ],
)
def test_a_picture_lies_where_its_file_moves_it(gltf, texture, moved):
    before = load_world(gltf / "s.gltf").parts[0].mesh.uv
    document = json.loads((gltf / "s.gltf").read_text())
    document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] |= texture
    (gltf / "s.gltf").write_text(json.dumps(document))
    np.testing.assert_allclose(
        load_world(gltf / "s.gltf").parts[0].mesh.uv - before, [[moved, 0]] * 3
    )


def test_a_picture_by_coordinates_that_are_not_there_is_refused(gltf):
    document = json.loads((gltf / "s.gltf").read_text())
    document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = 1
    (gltf / "s.gltf").write_text(json.dumps(document))
    with pytest.raises(InputError, match="has a picture, and a mesh of its has no TEXCOORD_1"):
        load_world(gltf / "s.gltf")


def test_a_loader_opens_nothing_that_was_not_hashed(gltf):
    scene = mesh("s.gltf")
    files = {path.resolve() for path in scene_files(scene, gltf).values()}

    assert opened_below(gltf.resolve(), lambda: open_world(scene, gltf)) == files


def test_pictures_with_depth_open_nothing_that_was_not_hashed(tmp_path):
    from stimuli.scenes.photo import open_rgbd, open_stereo

    for name in ("left", "right", "rgb"):
        picture(tmp_path / "p" / f"{name}.png", 90)
    depth = np.full((4, 4), 1500, np.uint16)
    Image.fromarray(depth).save(tmp_path / "p" / "depth.png")
    np.save(tmp_path / "p" / "disparity.npy", depth.astype(np.float32) / 1000)
    shared = {"name": "x", "focal_px": 5.0, "camera": CAMERA}
    rgbd = RgbdScene.model_validate(
        shared | {"kind": "rgbd", "rgb": "p/rgb.png", "depth": "p/depth.png", "depth_scale": 1e-3}
    )
    stereo = StereoScene.model_validate(
        shared
        | {"kind": "stereo", "left": "p/left.png", "right": "p/right.png", "baseline_m": 0.1,
           "disparity": "p/disparity.npy"}
    )  # fmt: skip
    for scene, load in ((rgbd, open_rgbd), (stereo, open_stereo)):
        files = {path.resolve() for path in scene_files(scene, tmp_path).values()}
        assert opened_below(tmp_path.resolve(), lambda s=scene, r=load: r(s, tmp_path)) <= files


@pytest.mark.parametrize("kind", ["images", "buffers"])
@pytest.mark.parametrize("name", ["../t.png", "/etc/hostname", "a/../../t.png"])
def test_a_mesh_does_not_reach_outside_its_folder(gltf, kind, name):
    folder = gltf / "mesh"
    (folder / "a").mkdir(parents=True)
    picture(gltf / "t.png", 9)
    document = json.loads((gltf / "s.gltf").read_text())
    document[kind][0]["uri"] = name
    (folder / "s.gltf").write_text(json.dumps({"asset": document["asset"], kind: document[kind]}))

    with pytest.raises(InputError, match="must name files in its own folder"):
        load_world(folder / "s.gltf")


BAD = {
    "cut": lambda data: data[: len(data) // 2],
    "text": lambda _: b"no picture",
    "empty": lambda _: b"",
}


@pytest.mark.parametrize("harm", BAD)
@pytest.mark.parametrize("place", ["file", "data", "view"])
def test_a_gltf_picture_that_cannot_be_read_is_named(gltf, harm, place):
    path = gltf / "s.gltf"
    document = json.loads(path.read_text())
    data = BAD[harm]((gltf / "maps/red wall.png").read_bytes())
    if place == "file":
        (gltf / "maps/red wall.png").write_bytes(data)
    elif place == "data":
        text = base64.b64encode(data).decode()
        document["images"] = [{"uri": f"data:image/png;base64,{text}", "name": "red wall"}]
    else:
        (gltf / "extra.bin").write_bytes(b"...." + data)
        document["buffers"].append({"uri": "extra.bin", "byteLength": 4 + len(data)})
        document["bufferViews"].append(
            {"buffer": len(document["buffers"]) - 1, "byteOffset": 4, "byteLength": len(data)}
        )
        document["images"] = [
            {"bufferView": len(document["bufferViews"]) - 1, "mimeType": "image/png",
             "name": "red wall"}
        ]  # fmt: skip
    path.write_text(json.dumps(document))

    with pytest.raises(InputError, match=r"red wall.*must be a picture that can be read"):
        load_world(path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"textures": [{"extensions": {"KHR_texture_basisu": {}}}]}, "KHR_texture_basisu"),
        ({"textures": [{"source": 7}]}, "must lead to a picture"),
        ({"textures": []}, "must lead to a picture"),
        ({"images": [{"bufferView": 99}]}, "must be a whole"),
    ],
)  # fmt: skip
def test_a_gltf_texture_that_leads_to_no_picture_is_refused(gltf, change, said):
    path = gltf / "s.gltf"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))

    with pytest.raises(InputError, match=said):
        load_world(path)
