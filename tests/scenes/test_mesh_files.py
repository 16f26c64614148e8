"""Scenes from glTF files, whole and broken."""

import base64
import json
import re
import tomllib

import numpy as np
import pytest
import trimesh
from PIL import Image
from pydantic import TypeAdapter, ValidationError
from typer.testing import CliRunner, Result

from pipeline.errors import InputError
from protocols.errors import StudyError
from protocols.load import parse_view
from protocols.recipes.warped_clips import MeshScene
from stimuli.recipes.bring_in import bring_scene
from stimuli.rendering.open_scene import open_world
from stimuli.rendering.render import WorldRenderer
from stimuli.rendering.scene_views import ScenePreview, look_around
from stimuli.rendering.world import Viewpoint
from stimuli.scenes.mesh_file import load_world
from study_app.cli.stimuli_commands import app

AHEAD = Viewpoint((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 60.0)


def quad(texture: Image.Image | None, **material: object) -> trimesh.Trimesh:
    """A square of 2 x 2 units in the xy plane, its texture's top at +y."""
    vertices = [[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]]
    visual = trimesh.visual.TextureVisuals(
        uv=[[0, 0], [1, 0], [0, 1], [1, 1]],
        material=trimesh.visual.material.PBRMaterial(baseColorTexture=texture, **material),
    )
    return trimesh.Trimesh(vertices, [[0, 1, 3], [0, 3, 2]], visual=visual, process=False)


def halves(above, below, alpha=(255, 255)):
    pixels = np.zeros((64, 64, 4), np.uint8)
    pixels[:32], pixels[32:] = (*above, alpha[0]), (*below, alpha[1])
    return Image.fromarray(pixels)


def write_glb(path, geometry, transform=None):
    scene = trimesh.Scene()
    scene.add_geometry(geometry, transform=np.eye(4) if transform is None else transform)
    path.write_bytes(scene.export(file_type="glb"))
    return path


@pytest.fixture
def draw(gl_context):
    def run(world, viewpoint=AHEAD):
        renderer = WorldRenderer(gl_context, world.seen_from(viewpoint))
        try:
            return renderer.render(viewpoint.camera(64, 48))
        finally:
            renderer.release()

    return run


def test_a_glb_keeps_texture_transform_and_scale(tmp_path, draw):
    """Placed at z = -3 units and read at 2 m a unit: 6 m away, top half red."""
    place = trimesh.transformations.translation_matrix((0, 0, -3))
    path = write_glb(tmp_path / "quad.glb", quad(halves((200, 20, 20), (20, 20, 200))), place)
    frame = draw(load_world(path, scale=2.0))
    assert frame.depth_m[24, 32] == pytest.approx(6.0, rel=1e-5)
    np.testing.assert_allclose(frame.colour[18, 32] * 255, (200, 20, 20), atol=1)
    np.testing.assert_allclose(frame.colour[30, 32] * 255, (20, 20, 200), atol=1)


def test_masked_materials_are_cut_out(tmp_path, draw):
    texture = halves((9, 200, 9), (9, 9, 9), alpha=(255, 0))
    place = trimesh.transformations.translation_matrix((0, 0, -3))
    card = quad(texture, alphaMode="MASK", alphaCutoff=0.5)
    frame = draw(load_world(write_glb(tmp_path / "leaf.glb", card, place)))
    assert np.isfinite(frame.depth_m[18, 32])
    assert np.isinf(frame.depth_m[30, 32])


def test_a_missing_picture_is_named(tmp_path):
    document = {"asset": {"version": "2.0"}, "images": [{"uri": "gone.png"}]}
    (tmp_path / "s.gltf").write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"s\.gltf: names a texture that is missing .*gone\.png"):
        load_world(tmp_path / "s.gltf")


def test_a_missing_gltf_buffer_is_named(tmp_path):
    document = {"asset": {"version": "2.0"}, "buffers": [{"uri": "gone.bin", "byteLength": 4}]}
    (tmp_path / "s.gltf").write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"names a buffer that is missing .*gone\.bin"):
        load_world(tmp_path / "s.gltf")


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.9])
def test_a_cut_glb_is_refused(tmp_path, share):
    path = write_glb(tmp_path / "quad.glb", quad(halves((1, 2, 3), (4, 5, 6))))
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError, match="must be a whole"):
        load_world(path)


def test_a_needed_extension_that_is_unknown_is_named(tmp_path):
    document = {"asset": {"version": "2.0"}, "extensionsRequired": ["KHR_draco_mesh_compression"]}
    (tmp_path / "s.gltf").write_text(json.dumps(document))
    with pytest.raises(InputError, match="KHR_draco_mesh_compression"):
        load_world(tmp_path / "s.gltf")


def test_a_huge_scene_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("METAMERLAB_LIMITS", "triangles=1")
    path = write_glb(tmp_path / "quad.glb", quad(None))
    with pytest.raises(InputError, match="at most 1 triangles"):
        load_world(path)


def test_an_empty_scene_and_a_wrong_ending_are_refused(tmp_path):
    (tmp_path / "s.gltf").write_text('{"asset": {"version": "2.0"}}')
    with pytest.raises(InputError, match=r"at least one triangle|must be a whole"):
        load_world(tmp_path / "s.gltf")
    (tmp_path / "s.fbx").write_text("")
    with pytest.raises(InputError, match=r"must end in \.glb"):
        load_world(tmp_path / "s.fbx")
    with pytest.raises(FileNotFoundError):
        load_world(tmp_path / "none.glb")


def test_an_obj_is_refused_with_the_cure_at_every_door(tmp_path):
    path = tmp_path / "s.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    said = r"s\.obj: must end in \.glb, \.gltf; \.obj was removed: export the scene as glTF"
    with pytest.raises(InputError, match=said):
        load_world(path)
    with pytest.raises(InputError, match=said):
        bring_scene(str(path), tmp_path / "study", [], None)
    for words in ("look", "panorama"):
        result = CliRunner().invoke(app, [words, str(path), "--out", str(tmp_path / "o.png")])
        assert result.exit_code == 2
        assert ".obj was removed" in " ".join(result.output.split())


@pytest.fixture
def house(tmp_path):
    """Write a pyramid of 2 m on a lawn, in plain colours, without normals."""
    lawn = [[-9, 0, 9], [9, 0, 9], [9, 0, -9], [-9, 0, -9]]
    roof = [[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1], [0, 2, 0]]
    scene = trimesh.Scene()
    for corners, faces, colour in (
        (lawn, [[0, 1, 2], [0, 2, 3]], (0.3, 0.5, 0.2, 1.0)),
        (roof, [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]], (0.7, 0.4, 0.3, 1.0)),
    ):
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=colour, doubleSided=True)
        visual = trimesh.visual.TextureVisuals(material=material)
        scene.add_geometry(trimesh.Trimesh(corners, faces, visual=visual, process=False))
    path = tmp_path / "house.glb"
    path.write_bytes(scene.export(file_type="glb", include_normals=False))
    return path


FRONT = Viewpoint((0.0, 3.0, 7.0), (0.0, 0.7, 0.0), 45.0)


def test_plain_colours_are_lit_by_a_sun_with_a_shadow(house, draw):
    """A sun from the left: the roof's left side is bright, and the shadow lies on the right.

    By hand: the top at 2 m throws its shadow 2 m to the right under a sun of 45 degrees. The
    lawn at (1.5, 0, 0) is in it and that at (-1.5, 0, 0) is not.
    """
    frame = draw(load_world(house, sun_direction=(-1, 1, 0)), FRONT)
    camera = FRONT.camera(64, 48)

    def seen(x, y, z):
        column, row = camera.project(np.array([x, y, z], float))[0]
        return frame.colour[int(row), int(column)]

    left, right = seen(-0.4, 0.8, 0.3), seen(0.4, 0.8, 0.3)
    assert abs(left.sum() - right.sum()) < 0.06  # the front face is flat: one colour
    lawn, shade = seen(-1.7, 0, 0.2), seen(1.4, 0, 0.2)
    assert lawn.sum() > 1.3 * shade.sum()
    assert shade.sum() > 0.2  # the sky still reaches it
    above = Viewpoint((0.0, 9.0, 0.01), (0.0, 0.0, 0.0), 30.0)
    roof = draw(load_world(house, sun_direction=(-1, 1, 0)), above).colour
    assert roof[24, 28].sum() > 1.5 * roof[24, 36].sum()  # towards the sun, and away from it


def test_lighting_is_chosen_by_the_file_or_the_protocol(house, tmp_path):
    painted = write_glb(tmp_path / "quad.glb", quad(halves((200, 20, 20), (20, 20, 200))))

    def is_lit(path, **more):
        world = load_world(path, **more)
        assert all(part.material.lit == (world.light is not None) for part in world.parts)
        return world.light is not None

    assert is_lit(house)
    assert not is_lit(house, lighting="unlit")
    assert not is_lit(painted)
    assert is_lit(painted, lighting="sun")
    assert is_lit(painted, sun_direction=(0, 1, 0))


def test_a_mesh_in_a_protocol_takes_its_lighting(house):
    given = {"kind": "mesh", "name": "m", "file": house.name, "camera": {"kind": "circle"}}
    lit = TypeAdapter(MeshScene).validate_python(given | {"sun_direction": (0, 1, 0)})
    flat = TypeAdapter(MeshScene).validate_python(given | {"lighting": "unlit"})

    assert open_world(lit, house.parent).light.sun_direction == (0, 1, 0)
    assert open_world(flat, house.parent).light is None
    with pytest.raises(ValidationError, match="sun_direction needs lighting = 'sun'"):
        TypeAdapter(MeshScene).validate_python(
            given | {"lighting": "unlit", "sun_direction": (0, 1, 0)}
        )


def test_look_draws_views_and_says_how_to_copy_them(tmp_path, gl_context):
    place = trimesh.transformations.translation_matrix((0, 0, -3))
    path = write_glb(tmp_path / "quad.glb", quad(halves((200, 20, 20), (20, 20, 200))), place)
    lines = look_around(gl_context, ScenePreview(str(path)), tmp_path / "views.png", 3)
    assert len(lines) == 3
    assert lines[0].startswith("0: view = { position_m = [")
    with Image.open(tmp_path / "views.png") as sheet:
        assert sheet.size[0] > 900


def test_look_draws_the_views_that_it_is_told(tmp_path, gl_context):
    path = write_glb(tmp_path / "quad.glb", quad(halves((200, 20, 20), (20, 20, 200))))
    line = "3: view = { position_m = [0, 0, 3], look_at_m = [0, 0, 0], vertical_fov_deg = 30 }"
    views = [parse_view(line), parse_view("{ position_m = [0, 9, 0], look_at_m = [0, 9, 1] }")]
    sheet = tmp_path / "views.png"
    lines = look_around(gl_context, ScenePreview(str(path), chosen=views), sheet, 9)
    assert lines[0] == line.replace("3:", "0:")
    assert len(lines) == 2
    with Image.open(sheet) as picture:
        pixels = np.asarray(picture.convert("RGB"))
    # The red half above the blue one, as one sees it who stands before them; then only sky.
    assert (pixels == (200, 20, 20)).all(2).sum() == pytest.approx(180 * 360, rel=0.4)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("view = [0, 1, 2]", "--view"),
        ("position_m = [0, 0, 3]", "must be a line as in a protocol"),
        (
            "{ position_m = [0, 0] , look_at_m = [0, 0, 0] }",
            "--view: position_m: must have 3 entries or more",
        ),
        ("view = { position_m = [0, 0, 0] }", "--view: look_at_m"),
    ],
)
def test_a_view_that_is_no_protocol_line_is_refused(line, said):
    with pytest.raises(StudyError, match=re.escape(said)):
        parse_view(line)


def look(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["look", *map(str, arguments)], terminal_width=100)


@pytest.mark.slow
def test_look_shows_a_file_in_the_light_that_its_lines_give_the_protocol(house, tmp_path):
    sheets = {}
    for name, options, lines in (
        ("left out", (), []),
        ("sun", ("--lighting", "sun"), ['lighting = "sun"']),
        ("unlit", ("--lighting", "unlit"), ['lighting = "unlit"']),
        ("east", ("--sun-direction", -1, 1, 0), ["sun_direction = [-1, 1, 0]"]),
        ("both", ("--lighting", "sun", "--sun-direction", 1, 1, 0.5),
         ['lighting = "sun"', "sun_direction = [1, 1, 0.5]"]),
    ):  # fmt: skip
        out = tmp_path / f"{name}.png"
        result = look(house, "--out", out, "--views", 1, *options)
        assert result.exit_code == 0, result.output
        view, *told, wrote = result.stdout.splitlines()
        assert view.startswith("0: view = { ")
        assert told == lines
        assert wrote == f"wrote {out}"
        scene = {
            key: tuple(value) if isinstance(value, list) else value
            for key, value in tomllib.loads("\n".join(told)).items()
        }
        given = {"name": "a", "kind": "mesh", "file": house.name, "camera": {"kind": "circle"}}
        TypeAdapter(MeshScene).validate_python(given | scene)
        with Image.open(out) as picture:
            sheets[name] = np.asarray(picture.convert("RGB"))

    # The house brings plain colours alone: left out, it is lit.
    assert np.array_equal(sheets["left out"], sheets["sun"])
    assert not np.array_equal(sheets["sun"], sheets["unlit"])
    assert not np.array_equal(sheets["sun"], sheets["east"])
    assert not np.array_equal(sheets["east"], sheets["both"])


@pytest.mark.parametrize(
    ("scene", "options", "said"),
    [
        (None, ("--lighting", "sunn"), "--lighting: must be one of unlit, sun (got 'sunn')"),
        (None, ("--lighting", "unlit", "--sun-direction", 0, 1, 0), "needs --lighting sun"),
        (None, ("--sun-direction", 0, 0, 0), "must be finite and not zero (got [0, 0, 0])"),
        (None, ("--sun-direction", "nan", 1, 0), "must be finite and not zero"),
        ("garden", ("--lighting", "sun"), "garden: a built-in scene has a light of its own"),
    ],
)
def test_look_refuses_a_light_that_the_protocol_would_not_take(
    house, tmp_path, scene, options, said
):
    out = tmp_path / "views.png"
    result = look(scene or house, "--out", out, *options)

    assert result.exit_code == 2
    assert result.stderr.startswith("error: ")
    assert said in result.stderr
    assert not out.exists()


def test_look_finds_the_things_on_a_wide_ground(tmp_path, gl_context):
    """Seen from around the whole, a few boxes on a plane of 100 m are specks."""
    scene = trimesh.Scene()
    ground = trimesh.creation.box((100, 0.1, 100))
    scene.add_geometry(ground)
    for x in (-1.5, 0, 1.5):
        box = trimesh.creation.box((0.5, 1, 0.5))
        box.apply_translation((x, 0.5, 0.4 * x))
        scene.add_geometry(box)
    path = tmp_path / "place.glb"
    path.write_bytes(scene.export(file_type="glb"))
    lines = look_around(gl_context, ScenePreview(str(path)), tmp_path / "v.png", 4)
    for line in lines:
        at = parse_view(line).position_m
        assert np.hypot(at[0], at[2]) < 12


@pytest.mark.parametrize("name", ["stk_temple", "torcs_ruudskogen"])
def test_real_scenes_look_as_their_converter_saw_them(shared_data, draw, name):
    """Against the converter's ray cast: a mirrored or flipped import is far off."""
    folder = shared_data / "scenes" / name
    camera = json.loads((folder / "camera.json").read_text())
    eye = np.array(camera["eye"])
    view = Viewpoint(
        tuple(eye.tolist()), tuple((eye + camera["forward"]).tolist()), camera["vfov_deg"]
    )
    frame = draw(load_world(folder / f"{name}.glb"), view)
    seen = np.isfinite(frame.depth_m)
    # The converter's picture is 3:2, this one 4:3 of the same height.
    assert seen.mean() == pytest.approx(camera["hit_fraction"], abs=0.08)
    near = np.percentile(frame.depth_m[seen], 25)
    assert near == pytest.approx(camera["depth_quantiles"]["25"], rel=0.25)
    with Image.open(folder / "preview.jpg") as stored:
        preview = stored.convert("RGB")
    width, height = preview.size
    left = (width - height * 4 / 3) / 2
    cut = preview.resize((64, 48), box=(left, 0, width - left, height))
    truth = np.asarray(cut, np.float64) / 255
    drawn = frame.colour.astype(np.float64)
    error = np.abs(drawn - truth)[seen].mean()
    mirrored = np.abs(drawn[:, ::-1] - truth)[seen].mean()
    assert error < 0.75 * mirrored


def test_unknown_scenes_are_no_files(tmp_path, gl_context):
    with pytest.raises((InputError, FileNotFoundError, StudyError)):
        look_around(gl_context, ScenePreview("gardn"), tmp_path / "v.png", 1)


def of_indices(path, vertices, indices):
    """Write a mesh of so many vertices in a row, whose triangles name them by turns."""
    position = np.zeros((vertices, 3), "<f4")
    position[:, 0], position[::2, 1] = np.arange(vertices), 1
    corners = (np.arange(indices) % vertices).astype("<u2")
    data = position.tobytes() + corners.tobytes()
    views = [(0, position.nbytes), (position.nbytes, corners.nbytes)]
    kinds = [(5126, vertices, "VEC3"), (5123, indices, "SCALAR")]
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": view, "componentType": kind, "count": count, "type": shape}
            for view, (kind, count, shape) in enumerate(kinds)
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": first, "byteLength": length} for first, length in views
        ],
        "buffers": [
            {
                "byteLength": len(data),
                "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode(),
            }
        ],
    }
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize(("vertices", "indices"), [(3, 30_000), (10, 9_000), (100, 6_000)])
def test_millions_of_indices_of_few_vertices_get_no_memory_for_their_bytes(
    tmp_path, monkeypatch, vertices, indices
):
    """30 MB of indices that name three vertices took 1.4 GB."""
    path = of_indices(tmp_path / "m.gltf", vertices, indices)
    load_world(path)
    monkeypatch.setenv("METAMERLAB_LIMITS", "memory=300000")
    with pytest.raises(InputError, match=r"must take at most .* METAMERLAB_LIMITS=memory="):
        load_world(path)


@pytest.mark.parametrize("each", [1, 3, 6, 12, 36])
def test_a_mesh_that_is_a_surface_gets_memory_for_its_bytes(tmp_path, monkeypatch, each):
    monkeypatch.setenv("METAMERLAB_LIMITS", "memory=300000")
    load_world(of_indices(tmp_path / "m.gltf", 3_000, 3_000 * each))
