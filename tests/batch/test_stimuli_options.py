"""Options of a protocol for its clips, and a real 3D scene through the whole path."""

import json
import shutil

import forked
import numpy as np
import pytest

from pipeline.pictures.colour_file import load_colour
from protocols.manifest import read_manifest
from stimuli.batch.build import build
from stimuli.batch.check import check_batch
from stimuli.media.png import decode_png


@pytest.fixture
def study(small_study, tmp_path):
    """Write a variant of the small study and return its path."""

    def write(*changes: tuple[str, str]):
        folder = tmp_path / "study"
        shutil.copytree(small_study.parent, folder)
        path = folder / small_study.name
        text = path.read_text()
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new)
        path.write_text(text)
        return path

    return write


def test_sixteen_bits_float_frames_and_no_preview(study, read_plan, inline, tmp_path):
    path = study(
        ("[stimuli.clips]", "[stimuli.clips]\nbit_depth = 16\nexr = true\npreview = false")
    )
    out, box = tmp_path / "clips", path.parent / "box.gltf"
    box.write_text(box.read_text().replace('"nodes"', '"cameras": [{}], "nodes"'))
    noted = "box.gltf: left out document.cameras: the camera is the study's"
    clips = build(read_plan(path), out, inline).manifest.clips
    said = {clip.name: clip.parameters.get("noted") for clip in clips}
    assert said == {name: noted if name.startswith("box") else None for name in said}
    assert said["box__small__telea"]
    frame = decode_png(out / "box__small__telea/000001.png")
    assert frame.dtype == np.uint16
    floats = load_colour(out / "box__small__telea/000001.exr")
    np.testing.assert_allclose(floats, frame / 65535, atol=2 / 65535)
    assert not (out / "previews").exists()
    assert check_batch(out).in_order
    (out / "box__small__telea/000001.exr").unlink()
    assert check_batch(out).missing == ["box__small__telea/000001.exr"]
    outcome = build(read_plan(path), out, inline)
    assert [str(name) for name in outcome.built] == ["box__small__telea"]
    assert check_batch(out).in_order


@pytest.mark.slow
def test_a_declared_filter_brings_frames_to_the_displays_pixels(study, read_plan, inline, tmp_path):
    plain = tmp_path / "plain"
    scaled = tmp_path / "scaled"
    path = study(("[stimuli.clips]", '[stimuli.clips]\nrender_width_px = 156\nrescale = "box"'))
    plan = read_plan(path)
    assert (plan.render_px, plan.shown_px) == ((156, 116), (78, 58))
    build(plan, scaled, inline)
    path.write_text(path.read_text().replace('render_width_px = 156\nrescale = "box"', ""))
    build(read_plan(path), plain, inline)
    frames = [decode_png(out / "box__small__reference/000000.png") for out in (scaled, plain)]
    assert frames[0].shape == frames[1].shape == (58, 78, 3)
    assert (frames[0] != frames[1]).any()


@pytest.mark.slow
def test_a_real_gltf_scene_and_a_real_pair_build_from_one_protocol(study, tmp_path, shared_data):
    """By the command: a scene as an artist made it, and photographs, solved for 4 % of holes."""
    name = "torcs_ruudskogen"
    folder = shared_data / "scenes" / name
    pair = shared_data / "stereo" / "middlebury2014_motorcycle"
    camera = json.loads((folder / "camera.json").read_text())
    ahead = (np.array(camera["eye"]) + np.array(camera["forward"])).tolist()
    view = (
        f"view = {{ position_m = {camera['eye']}, look_at_m = {ahead},"
        f" vertical_fov_deg = {camera['vfov_deg']} }}"
    )
    path = study(
        ('file = "box.gltf"', f'file = "{name}.glb"'),
        ("view = { position_m = [0, 0, 0], look_at_m = [0, 0, -1], vertical_fov_deg = 60 }", view),
        ("extent_m = 0.16", "hole_share = 0.04"),
        ('left = "motorcycle"', 'left = "motorcycle_left.png"'),
        ('right = "motorcycle"', 'right = "motorcycle_right.png"'),
        ('disparity = "motorcycle"', 'disparity = "disparity.npy"'),
        ('camera = { kind = "stereo" }', 'camera = { kind = "stereo", baselines = 4.0 }'),
    )
    shutil.copy(folder / f"{name}.glb", path.parent)
    for side in ("left", "right"):
        shutil.copy(pair / f"motorcycle_{side}.png", path.parent)
    np.save(path.parent / "disparity.npy", np.load(pair / "motorcycle_disp.npz")["arr_0"])
    out = tmp_path / "clips"
    result = forked.run("stimuli", "build", path, "--out", out, "--workers", 1, timeout=300)
    assert result.returncode == 0, result.stderr
    clips = read_manifest(out).clips
    assert {(clip.column("scene"), clip.column("method")) for clip in clips} == {
        (scene, method)
        for scene in ("box", "motorcycle")
        for method in ("reference", "push-pull", "telea")
    }
    for clip in clips:
        assert clip.hole_share == pytest.approx(0.04, rel=0.15)
        frame = decode_png(out / clip.frame_path(3))
        assert frame.std() > 20  # a picture, not a plain
    assert check_batch(out).in_order
    # The other photograph is the truth in the holes alone.
    hole = decode_png(out / "holes/motorcycle__small/000003.png") > 0
    truth, fill = (
        decode_png(out / f"motorcycle__small__{m}/000003.png") for m in ("reference", "telea")
    )
    assert np.array_equal(truth[~hole], fill[~hole])
    assert (truth[hole] != fill[hole]).any()
