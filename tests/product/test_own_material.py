"""From files of one's own to a first report: what `new-study` writes of scenes, pairs, methods."""

import re
import shutil
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from protocols.errors import StudyError
from protocols.study_file.own_stimuli import OwnMethod, OwnStimuli, methods_of, unused_name
from stimuli.scenes.stereo import built_in_pair

SMALL_DISPLAY = """
name = "small"
width_px = 320
height_px = 240
width_mm = 320.0
height_mm = 240.0
distance_mm = 600.0
refresh_hz = 10.0
"""


@pytest.fixture(scope="module")
def own(tmp_path_factory) -> Path:
    """A .glb, a .gltf with its buffers beside it, a photographed pair, and a small display."""
    folder = tmp_path_factory.mktemp("own")
    made = np.random.default_rng(0)
    for name in ("hall", "yard"):
        scene = trimesh.Scene()
        for size, place in (
            ((8, 0.2, 8), (0, 0, 0)),
            *((made.uniform(0.5, 1.5, 3), (*made.uniform(-2, 2, 2), 1.0)) for _ in range(4)),
        ):
            box = trimesh.creation.box(size)
            box.visual.vertex_colors = (*made.integers(40, 230, 3), 255)
            box.apply_translation((place[0], place[2] / 2, place[1]))
            scene.add_geometry(box)
        if name == "hall":
            scene.export(folder / "hall.glb")
            continue
        (folder / name).mkdir()
        for file, data in trimesh.exchange.gltf.export_gltf(scene).items():
            place = "Der Hof.gltf" if file == "model.gltf" else file
            (folder / name / place).write_bytes(data)
    pair = built_in_pair("motorcycle")
    for name, view in (("left", pair.left), ("right", pair.right)):
        half = cv2.resize(view, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(folder / f"{name}.png"), (half[..., ::-1] * 255).round().astype(np.uint8))
    rows, columns = half.shape[:2]
    disparity = np.where(pair.known, pair.disparity_px, np.nan) / 2
    np.save(folder / "disparity.npy", disparity[: 2 * rows : 2, : 2 * columns : 2])
    (folder / "small.toml").write_text(SMALL_DISPLAY)
    return folder


def pair_of(own: Path) -> tuple[object, ...]:
    return ("--pair", own / "left.png", own / "right.png", own / "disparity.npy")


@pytest.fixture(scope="module")
def study(own, tmp_path_factory, shared_gl_context) -> Path:  # noqa: ARG001
    """Study that `new-study` made of it all."""
    from typer.testing import CliRunner

    from study_app.cli import app

    folder = tmp_path_factory.mktemp("made") / "mine"
    words = (
        "new-study", folder, "--display", own / "small.toml", "--scene", own / "hall.glb",
        "--scene", own / "yard" / "Der Hof.gltf", *pair_of(own), "--methods",
        "telea,reference",
    )  # fmt: skip
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    assert "focal_px and baseline_m are assumed" in done.stdout
    return folder


@pytest.mark.slow
def test_from_files_to_a_first_report_and_its_figure_in_seven_commands(
    study, metamerlab, tmp_path, monkeypatch
):
    monkeypatch.chdir(shutil.copytree(study, tmp_path / "mine"))
    commands = (
        "protocol check study.toml",
        "stimuli build study.toml --out clips --workers 1",
        "stimuli check clips",
        "session simulate study.toml --stimuli clips --out pilot --participants 2",
        "analysis report pilot --protocol study.toml --out report2 --no-figures",
        "figure study.toml --report report2 --size large --scene hall --out teaser.svg",
    )
    for command in commands:
        done = metamerlab(*command.split())
        assert "Traceback" not in done.output
    page = Path("report2/report.html").read_text(encoding="utf-8")
    assert "Telea" in page
    assert "imulated" in page
    clips = {path.name for path in Path("clips").iterdir() if "__" in path.name}
    assert len(clips) == 3 * 2 * 2
    assert "pair__large__reference" in clips
    drawn = Path("teaser.svg").read_text(encoding="utf-8")
    for text in ("Telea", "Reference", "JOD", "SIMULATED DATA"):
        assert text in drawn, text
    assert "Hall, large" not in drawn
    done = metamerlab("figure", "study.toml", "--report", "report2", "--frame", "99", status=2)
    assert "--frame: must be 0 to 9" in " ".join(done.stderr.split())


def test_files_are_copied_with_all_that_they_name_and_each_has_views(study, own):
    scenes = study / "scenes"
    assert sorted(path.name for path in scenes.iterdir()) == ["der-hof", "hall", "pair"]
    given = {path.name for path in (own / "yard").iterdir()}
    assert {path.name for path in (scenes / "der-hof").iterdir()} == given | {"views.png"}
    assert (scenes / "hall" / "views.png").stat().st_size > 10_000
    assert {path.name for path in (scenes / "pair").iterdir()} == {
        "left.png", "right.png", "disparity.npy",
    }  # fmt: skip


def test_the_view_line_is_that_of_the_sheets_first_view_and_the_others_stand_beside(study):
    text = (study / "study.toml").read_text(encoding="utf-8")
    views = re.findall(r"^view = (\{.*\})$", text, flags=re.M)
    others = re.findall(r"^#   view = (\{.*\})$", text, flags=re.M)
    assert len(views) == 2
    assert len(others) == 2 * 7
    assert len({*views, *others}) == 16
    for line in (*views, *others):
        assert set(tomllib.loads(f"view = {line}")["view"]) == {
            "position_m", "look_at_m", "vertical_fov_deg",
        }  # fmt: skip


def test_methods_stand_in_the_order_given_and_the_first_two_are_compared(study):
    read = tomllib.loads((study / "study.toml").read_text(encoding="utf-8"))
    assert [each["name"] for each in read["stimuli"]["methods"]] == ["telea", "reference"]
    assert read["analysis"]["primary"] == {"method": "telea", "against": "reference"}
    assert read["task"]["catch"]["worse"] == "telea"
    of_four = OwnStimuli((), tuple(map(OwnMethod, ("reference", "ours", "push-pull", "telea"))))
    assert {key: of_four.words()[key] for key in ("PRIMARY", "AGAINST", "CATCH_WORSE")} == {
        "PRIMARY": "ours", "AGAINST": "push-pull", "CATCH_WORSE": "push-pull",
    }  # fmt: skip
    assert read["design"]["practice"]["scenes"] == ["hall"]
    assert [each["name"] for each in read["stimuli"]["scenes"]] == ["hall", "der-hof", "pair"]


def test_every_pair_given_is_held_each_with_its_own_rig(metamerlab, own, tmp_path):
    half = np.load(own / "disparity.npy")
    np.save(tmp_path / "four.npy", 4 * half)
    second = ("--pair", own / "left.png", own / "right.png", tmp_path / "four.npy")
    study = tmp_path / "s"

    metamerlab(
        "new-study", study, *pair_of(own), *second, "--pair", *["motorcycle"] * 3, "--baseline-m",
        "0.2", "--units-per-px", "1", "--units-per-px", "4", "--units-per-px", "1",
    )  # fmt: skip

    read = tomllib.loads((study / "study.toml").read_text(encoding="utf-8"))
    scenes = {scene["name"]: scene for scene in read["stimuli"]["scenes"]}
    assert list(scenes) == ["pair", "pair-2", "motorcycle"]
    assert [scenes[name].get("units_per_px", 1) for name in scenes] == [1, 4, 1]
    assert scenes["pair"]["baseline_m"] == scenes["pair-2"]["baseline_m"] == 0.2
    assert (study / scenes["pair-2"]["disparity"]).read_bytes() == (
        tmp_path / "four.npy"
    ).read_bytes()


def test_without_the_true_view_there_are_no_catch_trials_and_it_is_said(metamerlab, tmp_path):
    metamerlab("new-study", tmp_path / "s", "--methods", "telea,navier-stokes")
    text = (tmp_path / "s" / "study.toml").read_text(encoding="utf-8")
    assert "# No catch trials" in text
    assert "catch" not in tomllib.loads(text)["task"]
    metamerlab("protocol", "check", tmp_path / "s" / "study.toml")


def test_networks_are_copied_and_folders_of_frames_are_found_from_the_study(
    metamerlab, own, tmp_path, monkeypatch
):
    onnx = pytest.importorskip("onnx")
    monkeypatch.chdir(tmp_path)
    image = onnx.helper.make_tensor_value_info("image", onnx.TensorProto.FLOAT, [1, 3, "h", "w"])
    out = onnx.helper.make_tensor_value_info("out", onnx.TensorProto.FLOAT, [1, 3, "h", "w"])
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Identity", ["image"], ["out"])], "net", [image], [out]
    )
    onnx.save(onnx.helper.make_model(graph), "My Net.onnx")
    (tmp_path / "filled").mkdir()
    named = "onnx:My Net.onnx,frames:filled/{scene}/{size},frames:later/{scene}/{size}"

    metamerlab("new-study", "s", "--scene", "garden", "--methods", named)

    read = tomllib.loads(Path("s/study.toml").read_text(encoding="utf-8"))
    assert [(each["name"], each["method"]) for each in read["stimuli"]["methods"]] == [
        ("my-net", "onnx:networks/my-net/My Net.onnx"),
        ("filled", "frames:../filled/{scene}/{size}"),
        ("later", "frames:later/{scene}/{size}"),
    ]
    copied = Path("s/networks/my-net/My Net.onnx")
    assert copied.read_bytes() == Path("My Net.onnx").read_bytes()
    assert own.exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--scene", "none.glb"], "none.glb"),
        (["--scene", "{own}/left.png"], "must be a .glb or .gltf file, or a built-in scene"),
        (["--scene", "{own}/small.toml"], "OpenEXR frames with --exr"),
        (["--scene", "{own}/broken.glb"], "broken.glb"),
        (["--scene", "gardn"], "garden"),
        (["--pair", "{own}/right.png", "{own}/left.png", "{own}/disparity.npy"], "exchanged"),
        (["--pair", "{own}/left.png", "{own}/left.png", "{own}/disparity.npy"], "same picture"),
        (["--pair", "{own}/left.png", "{own}/right.png", "{own}/none.npy"], "none.npy"),
        (["--pair", "{own}/left.png", "{own}/right.png", "{own}/small.npy"], "must be as large as"),
        (["--pair", "{own}/left.png", "{own}/right.png", "{own}/four.npy"], "units_per_px = 4"),
        (["--units-per-px", "4"], "are of a pair (got none)"),
        (["--pair", "motorcycle", "motorcycle"], "must be followed by three files"),
        (
            [*["--pair", *["motorcycle"] * 3] * 2, *["--focal-px", "9"] * 3],
            "once for all pairs, or once for each (got 3 times, and 2 pairs)",
        ),
        (["--methods", "push-pull"], "must name two or more"),
        (["--methods", "push-pull,push-pull"], "names 'push-pull' twice"),
        (["--methods", "push-pull,"], "names joined by commas"),
        (["--methods", "push-pul,telea"], "push-pull"),
        (["--methods", "telea,onnx:none.onnx"], "none.onnx"),
        (["--methods", "telea,onnx:"], "onnx:"),
        (["--scene", "garden", "--task", "yes-no"], "two-interval or two-alternative"),
    ],
)  # fmt: skip
def test_mistakes_are_told_before_anything_is_written(metamerlab, own, tmp_path, words, said):
    (own / "broken.glb").write_bytes((own / "hall.glb").read_bytes()[:300])
    disparity = np.load(own / "disparity.npy")
    np.save(own / "small.npy", disparity[::2, ::2])
    np.save(own / "four.npy", 4 * disparity)

    done = metamerlab(
        "new-study", tmp_path / "s", *(word.format(own=own) for word in words), status=2
    )

    assert said in " ".join(done.stderr.split())
    assert not list(tmp_path.iterdir())


def test_names_are_unused_and_as_a_study_may_have_them():
    assert unused_name("Der Höf__2", ()) == "der-h-f-2"
    assert unused_name("place", {"place", "place-2"}) == "place-3"
    assert unused_name("日本", ()) == "own"
    assert len(unused_name("x" * 90, {"x" * 45})) <= 48
    assert methods_of("a, frames:out/{scene}/{size}", ["a"]) == (
        OwnMethod("a"),
        OwnMethod("out", "frames:out/{scene}/{size}"),
    )
    with pytest.raises(StudyError, match="two or more"):
        OwnStimuli((), (OwnMethod("a"),))
