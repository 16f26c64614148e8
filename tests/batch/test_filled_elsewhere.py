"""Holes go out to another program, and its frames come back into the right clips."""

import csv
import shutil
import tomllib

import numpy as np
import pytest
from command_line import outcome_of
from PIL import Image

from pipeline.pictures.decode import read_pixels
from stimuli.batch.build import build
from stimuli.media.png import decode_png
from stimuli.media.video import write_video

MOTORCYCLE = 'name = "motorcycle"\n'
run = outcome_of()


def table(folder) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "frames.csv").read_text().splitlines()))


@pytest.fixture(scope="module")
def holes(small_study, tmp_path_factory):
    """Files that `export-holes` writes of the small study."""
    out = tmp_path_factory.mktemp("export") / "holes"
    _, said, _ = run("stimuli", "export-holes", small_study, "--out", out)
    assert "README.md says what to send back" in said
    return out


@pytest.fixture
def study(small_study, holes, tmp_path):
    """The small study with its third method made elsewhere: holes are painted (77, 10, 200)."""

    def write(path: str = "frames:filled/{scene}/{size}"):
        folder = tmp_path / "study"
        shutil.copytree(small_study.parent, folder)
        for line in table(holes):
            picture = read_pixels(holes / line["warped"]).data
            picture[read_pixels(holes / line["mask"]).data[..., 0] > 0] = (77, 10, 200)
            place = folder / line["send_back"]
            place.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(picture).save(place)
        file = folder / small_study.name
        text = file.read_text()
        file.write_text(text.replace('name = "telea"', f'name = "telea"\nmethod = "{path}"'))
        return file

    return write


def test_every_frame_is_there_with_mask_and_depth_and_a_readme(holes):
    lines = table(holes)
    assert len(lines) == 2 * 4
    assert {line["scene"] for line in lines} == {"box", "motorcycle"}
    for line in lines:
        warped, mask = (read_pixels(holes / line[name]).data for name in ("warped", "mask"))
        depth = read_pixels(holes / line["depth"])
        assert warped.shape[:2] == mask.shape[:2] == depth.data.shape[:2]
        assert depth.channels == ("Z",)
        assert (warped[mask[..., 0] > 0] == 0).all()
        assert (mask > 0).any() or line["frame"] == "0"
    block = (holes / "README.md").read_text().split("```toml")[1].split("```")[0]
    (method,) = tomllib.loads(block)["stimuli"]["methods"]
    named = {"name": "ours", "label": "Ours", "method": "frames:filled/{scene}/{size}"}
    assert method == named


def test_a_folder_with_something_in_it_is_left_alone(small_study, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    _, _, error = run("stimuli", "export-holes", small_study, "--out", tmp_path, status=2)
    assert "must be a new or empty folder" in error
    assert [file.name for file in tmp_path.iterdir()] == ["mine.txt"]


def test_frames_filled_elsewhere_enter_the_holes_of_their_own_clips(
    study, read_plan, inline, tmp_path
):
    path = study()
    assert run("protocol", "check", path, status=None)[0] == 0
    build(read_plan(path), tmp_path / "clips", inline)
    for scene in ("box", "motorcycle"):
        hole = decode_png(tmp_path / f"clips/holes/{scene}__small/000002.png") > 0
        shown = decode_png(tmp_path / f"clips/{scene}__small__telea/000002.png")
        other = decode_png(tmp_path / f"clips/{scene}__small__push-pull/000002.png")
        assert hole.any()
        assert (shown[hole] == (77, 10, 200)).all()
        np.testing.assert_array_equal(shown[~hole], other[~hole])


def test_a_video_for_each_clip_enters_the_holes_too(study, read_plan, inline, tmp_path):
    path = study("frames:filled/{scene}-{size}.avi")
    filled = path.parent / "filled"
    for scene in ("box", "motorcycle"):
        write_video(filled / f"{scene}-small.avi", sorted((filled / scene / "small").iterdir()), 30)
        shutil.rmtree(filled / scene)
    assert run("protocol", "check", path, status=None)[0] == 0
    build(read_plan(path), tmp_path / "clips", inline)
    hole = decode_png(tmp_path / "clips/holes/box__small/000002.png") > 0
    shown = decode_png(tmp_path / "clips/box__small__telea/000002.png")
    assert (shown[hole] == (77, 10, 200)).all()
    files = sorted(tmp_path.glob("clips/box__small__push-pull/*.png"))
    write_video(filled / "box-small.avi", files[:3], 30)
    _, _, error = run("protocol", "check", path, status=2)
    assert "must hold as many frames as the clip has, 4 (has 3)" in error


def test_frames_of_another_scene_are_refused_by_the_build(study, read_plan, inline, tmp_path):
    path = study()
    filled = path.parent / "filled"
    (filled / "box").rename(filled / "away")
    (filled / "motorcycle").rename(filled / "box")
    (filled / "away").rename(filled / "motorcycle")
    with pytest.raises(Exception, match=r"must show, outside the holes, .* of another scene"):
        build(read_plan(path), tmp_path / "clips", inline)


@pytest.mark.parametrize(
    ("method", "said"),
    [
        ("frames:filled/box/small", "must hold {scene}, for box and motorcycle"),
        ("frames:filled/{shot}/{size}", "may hold {scene}, {size} and, in"),
        ("frames:filled/{frame}/{scene}", "may hold {scene}, {size} and, in"),
    ],
)
def test_a_path_that_cannot_name_the_frames_of_every_clip_is_refused(study, method, said):
    _, _, error = run("protocol", "check", study(method), status=2)
    assert "stimuli.methods[2]: " in error
    assert said in error


def test_wrong_counts_and_sizes_are_found_by_check(study):
    path = study()
    (path.parent / "filled/box/small/000003.png").unlink()
    Image.fromarray(np.zeros((10, 12, 3), np.uint8)).save(
        path.parent / "filled/motorcycle/small/000000.png"
    )
    _, _, error = run("protocol", "check", path, status=2)
    assert "must hold as many frames as the clip has, 4 (has 3)" in error
    assert "000000.png: must be 78 x 58 px as the warped frame (is 12 x 10)" in error


def test_what_is_missing_is_a_note_of_check_and_stops_a_build_before_it_begins(study, tmp_path):
    path = study("onnx:net.onnx")
    _, said, _ = run("protocol", "check", path)
    assert "net.onnx: is not there; 'metamerlab stimuli build' needs it" in said
    path.write_text(path.read_text().replace("onnx:net.onnx", "frames:none/{scene}-{frame}.png"))
    code, said, _ = run("protocol", "check", path, status=None)
    assert (code, said.count("is not there")) == (0, 1)
    code, _, error = run("stimuli", "build", path, "--out", tmp_path / "clips", status=2)
    assert "is not there" in error
    assert not (tmp_path / "clips").exists()


def test_a_network_of_another_size_is_found_by_check(study):
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    path = study("onnx:net.onnx")
    values = [
        onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [1, channels, 64, 64])
        for name, channels in (("image", 3), ("mask", 1), ("out", 3))
    ]
    node = onnx.helper.make_node("Identity", ["image"], ["out"])
    graph = onnx.helper.make_graph([node], "net", values[:2], values[2:])
    opset = [onnx.helper.make_opsetid("", 17)]
    onnx.save(onnx.helper.make_model(graph, opset_imports=opset, ir_version=9),
              path.parent / "net.onnx")  # fmt: skip
    _, _, error = run("protocol", "check", path, status=2)
    assert "takes images of 64 x 64 px only (the padded frame has 80 x 64)" in error
