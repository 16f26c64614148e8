"""Photographs with depth and OpenEXR sequences."""

import numpy as np
import pytest
from PIL import Image

from pipeline.errors import InputError
from pipeline.pictures.stored_frames import sequence_files
from pipeline.warp.settings import MOST_RIM_PX
from protocols.formats.format_reference import json_schema
from protocols.recipes.warped_clips import (
    CirclePath,
    ExrScene,
    RgbdScene,
    StereoPath,
    StereoScene,
    UpsamplingPath,
)
from stimuli.batch.footage import CameraShot, Footage
from stimuli.rendering.paths import STILL, make_path
from stimuli.rendering.scenery import CameraStep
from stimuli.scenes.photo import open_rgbd, open_stereo
from stimuli.scenes.sequence import load_picture, open_sequence

CIRCLE = CirclePath(kind="circle")
UP = UpsamplingPath(kind="upsampling", real_every=2, along=CIRCLE)


def planes(height=12, width=16, value=0.25, depth=3.0, half=True):
    kind = np.float16 if half else np.float32
    light = np.full((height, width), value, kind)
    return light, np.full((height, width), depth, np.float32)


def scene(file="a.exr", camera=CIRCLE, **more):
    return ExrScene(kind="exr", name="s", file=file, camera=camera, **more)


def test_parts_of_a_file_count_as_one(tmp_path, write_exr):
    light, depth = planes()
    write_exr(tmp_path / "a.exr", [{"R": light, "G": light, "B": light}, {"Z": depth}])
    assert load_picture(tmp_path / "a.exr", scene()).frame.depth_m[3, 3] == 3.0


def test_a_protocol_may_name_channels_and_transfer(tmp_path, write_exr):
    light, depth = planes(half=False)
    write_exr(tmp_path / "a.exr", [{"R": light, "G": light, "B": light, "far": depth}])
    named = scene(channels={"depth": "far"}, transfer="linear")
    picture = load_picture(tmp_path / "a.exr", named)
    assert picture.frame.depth_m[0, 0] == 3.0
    assert picture.frame.colour[0, 0, 0] == 0.25


def test_a_file_without_depth_says_so_and_how_to_name_it(tmp_path, write_exr):
    light, _ = planes()
    write_exr(tmp_path / "a.exr", [{"R": light, "G": light, "B": light}])
    with pytest.raises(
        InputError, match=r"channel Z or depth.Z .*for depth .* channels = \{ depth"
    ):
        load_picture(tmp_path / "a.exr", scene())


@pytest.mark.parametrize(("bad", "found"), [(np.nan, "nan"), (0.0, r"0\.0"), (-1.0, r"-1\.0")])
def test_depth_that_is_no_distance_is_refused_with_its_place(tmp_path, bad, found, write_exr):
    light, depth = planes()
    depth[4, 7] = bad
    write_exr(tmp_path / "a.exr", [{"R": light, "G": light, "B": light, "Z": depth}])
    with pytest.raises(InputError, match=f"depth must be greater than 0.*{found} at row 4, column"):
        load_picture(tmp_path / "a.exr", scene())


def test_a_cut_file_is_refused(tmp_path, write_exr):
    light, depth = planes(64, 64)
    write_exr(tmp_path / "a.exr", [{"R": light, "G": light, "B": light, "Z": depth}])
    data = (tmp_path / "a.exr").read_bytes()
    (tmp_path / "a.exr").write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=r"a\.exr: must be"):
        load_picture(tmp_path / "a.exr", scene())


def test_a_gap_in_a_sequence_is_named(tmp_path):
    for number in (1, 2, 4):
        (tmp_path / f"s.{number:04d}.exr").touch()
    with pytest.raises(InputError, match="1 missing, the first is 3"):
        sequence_files("s.####.exr", tmp_path)
    with pytest.raises(FileNotFoundError):
        sequence_files("t.####.exr", tmp_path)


def test_a_sequence_is_up_sampled_by_its_own_motion(tmp_path, gl_context, write_exr):
    """A dotted wall that goes 2 px to the right from file to file."""
    rng = np.random.default_rng(2)
    wall = rng.uniform(0.1, 0.9, (48, 80)).astype(np.float32)
    for number in range(4):
        light = np.roll(wall, 2 * number, axis=1)
        depth = np.full(wall.shape, 3.0, np.float32)
        write_exr(tmp_path / f"s.{number:04d}.exr", [{
            "R": light, "G": light, "B": light, "Z": depth,
            "flow.x": np.full(wall.shape, 2.0, np.float32), "flow.y": 0 * depth,
        }])  # fmt: skip
    sequence = open_sequence(scene("s.####.exr", UP, transfer="linear"), tmp_path)
    shot = CameraShot(make_path(UP, 4, 8.0), (64, 32), 0.01, 0.125)  # 8 px of margin: one to one
    footage = Footage(gl_context, sequence, shot)
    warped, truth = footage.warped(3), footage.truth(3)
    footage.release()
    assert footage.margin_px == 8
    assert not warped.hole.any()
    np.testing.assert_allclose(warped.colour, truth, atol=1e-5)


def rgbd(**more):
    values = {"kind": "rgbd", "name": "r", "rgb": "c.png", "depth": "d.png", "depth_scale": 0.001,
              "focal_px": 60.0, "camera": CIRCLE}  # fmt: skip
    return RgbdScene(**values | more)


def test_a_depth_image_is_scaled_and_its_gaps_take_the_farther_side(tmp_path):
    Image.fromarray(np.full((30, 40, 3), 90, np.uint8)).save(tmp_path / "c.png")
    depth = np.full((30, 40), 1000, np.uint16)
    depth[:, 20:] = 3000
    depth[:, 18:22] = 0
    Image.fromarray(depth).save(tmp_path / "d.png")
    photo = open_rgbd(rgbd(depth_speckle=False), tmp_path)
    frame, camera = photo.source((40, 30), 0, STILL, 0.0, -1)
    np.testing.assert_allclose(frame.depth_m[5], [1.0] * 18 + [3.0] * 22, rtol=1e-6)
    assert camera.fx_px == 60.0


def test_a_depth_image_of_another_size_is_refused(tmp_path):
    Image.fromarray(np.full((30, 40, 3), 90, np.uint8)).save(tmp_path / "c.png")
    Image.fromarray(np.full((30, 41), 9, np.uint16)).save(tmp_path / "d.png")
    with pytest.raises(
        InputError, match=r"d\.png: must be as large as c\.png, 40 x 30 px \(is 41 x 30"
    ):
        open_rgbd(rgbd(), tmp_path)


def test_a_photograph_has_no_further_real_frames(tmp_path, gl_context):
    Image.fromarray(np.full((30, 40, 3), 90, np.uint8)).save(tmp_path / "c.png")
    Image.fromarray(np.full((30, 40), 1000, np.uint16)).save(tmp_path / "d.png")
    photo = open_rgbd(rgbd(camera=UP), tmp_path)
    with pytest.raises(InputError, match="no further real frames"):
        Footage(gl_context, photo, CameraShot(make_path(UP, 4, 8.0), (40, 30), 0.1, 0.0))


def pair(folder, **more):
    return open_stereo(
        StereoScene(
            kind="stereo", name="m", left="motorcycle", right="motorcycle",
            disparity="motorcycle", focal_px=994.978, baseline_m=0.193001, offset_px=31.086,
            camera=StereoPath(kind="stereo"), **more,
        ),
        folder,
    )  # fmt: skip


@pytest.fixture
def motorcycle(tmp_path):
    return pair(tmp_path)


def test_photographs_have_a_rim_and_files_of_programs_none(tmp_path, write_exr, motorcycle):
    light, depth = planes()
    write_exr(tmp_path / "a.exr", [{"R": light, "G": light, "B": light, "Z": depth}])
    Image.fromarray(np.full((30, 40, 3), 90, np.uint8)).save(tmp_path / "c.png")
    Image.fromarray(np.full((30, 40), 1000, np.uint16)).save(tmp_path / "d.png")

    assert motorcycle.rim_px == open_rgbd(rgbd(), tmp_path).rim_px == 1
    assert pair(tmp_path, rim_px=3).rim_px == open_rgbd(rgbd(rim_px=3), tmp_path).rim_px == 3
    for camera in (CIRCLE, UP):
        assert open_sequence(scene(camera=camera), tmp_path).rim_px == 0
        assert open_sequence(scene(camera=camera, rim_px=2), tmp_path).rim_px == 2


def test_outliers_of_depth_are_mended_in_photographs_and_stay_in_files_of_programs(
    tmp_path, write_exr
):
    light, depth = planes(48, 64)
    depth[5, 5] = 9.0
    flow = np.full(depth.shape, 2.0, np.float32)
    flow[5, 5] = 7.0
    for number in range(2):
        write_exr(tmp_path / f"s.{number:04d}.exr", [{
            "R": light, "G": light, "B": light, "Z": depth, "flow.x": flow, "flow.y": 0 * flow,
        }])  # fmt: skip
    Image.fromarray(np.full((48, 64, 3), 90, np.uint8)).save(tmp_path / "c.png")
    Image.fromarray((1000 * depth).astype(np.uint16)).save(tmp_path / "d.png")

    def shows(photo, frame=-1):
        taken, _ = photo.source((64, 48), 0, STILL, 0.0, frame)
        return taken.depth_m[5, 5] / taken.depth_m[9, 9]

    def sequence(camera, **more):
        return open_sequence(scene("s.####.exr", camera, **more), tmp_path)

    assert shows(open_rgbd(rgbd(), tmp_path)) == 1
    assert shows(open_rgbd(rgbd(depth_speckle=False), tmp_path)) == 3
    for more, ratio in (({}, 3), ({"depth_speckle": True}, 1)):
        assert shows(sequence(CIRCLE, **more)) == shows(sequence(UP, **more), 0) == ratio
        flow_px, seen_m = sequence(UP, **more).motion(
            (64, 48), 0, CameraStep(0, 1, STILL, STILL, 0.0)
        )
        assert (flow_px[5, 5, 0], seen_m[5, 5]) == ((7, 9) if ratio == 3 else (2, 3))


def test_protocols_and_the_warp_allow_the_same_rims():
    scenes = json_schema("study")["$defs"]
    for name in ("StereoScene", "RgbdScene", "ExrScene"):
        assert scenes[name]["properties"]["rim_px"]["maximum"] == MOST_RIM_PX


@pytest.mark.parametrize("rim_px", [0, 1, 3])
def test_holes_alone_are_the_holes_of_the_whole_warp(tmp_path, gl_context, rim_px):
    """A survey counts holes, and a clip fills them: both must mean the same ones."""
    shot = CameraShot(make_path(StereoPath(kind="stereo"), 2, 2.0), (150, 100), 0.193001, 0.2)
    sizes = []
    for wide in (0, rim_px):
        photo = pair(tmp_path, rim_px=wide)
        whole = Footage(gl_context, photo, shot, probe=[1])
        alone = Footage(gl_context, photo, shot, probe=[1], holes_only=True)
        hole = whole.warped(1).hole
        np.testing.assert_array_equal(alone.holes(1), hole)
        sizes.append(hole.sum())
        whole.release()
        alone.release()
    assert (sizes[1] > sizes[0]) == (rim_px > 0)


def test_the_true_view_is_the_other_photograph_in_the_rim_as_well(tmp_path, gl_context):
    shot = CameraShot(make_path(StereoPath(kind="stereo"), 2, 2.0), (150, 100), 0.193001, 0.2)
    found = []
    for rim_px in (0, 2):
        footage = Footage(gl_context, pair(tmp_path, rim_px=rim_px), shot, probe=[1])
        found.append((footage.warped(1), footage.truth(1)))
        footage.release()
    (bare, bare_truth), (grown, truth) = found
    rim = grown.hole & ~bare.hole
    assert rim.sum() > 100
    np.testing.assert_array_equal(truth[~rim], bare_truth[~rim])
    np.testing.assert_array_equal(bare_truth[rim], bare.colour[rim])
    assert np.abs(truth[rim] - bare.colour[rim]).mean() > 0.02
    assert truth[rim].mean() > 0.1  # not the warp's black


def test_at_the_other_camera_the_truth_is_the_other_photograph(motorcycle, gl_context):
    """At full baseline a hole's true content lies offset_px further right, whatever its depth.

    By hand: x_right = x_shown - baseline parallax + parallax + offset.
    """
    from skimage.data import stereo_motorcycle

    right = stereo_motorcycle()[1].astype(np.float64) / 255
    shot = CameraShot(make_path(StereoPath(kind="stereo"), 2, 2.0), (500, 350), 0.193001, 0.2)
    footage = Footage(gl_context, motorcycle, shot, probe=[1])
    warped, truth = footage.warped(1), footage.truth(1)
    margin = footage.margin_px
    footage.release()
    scale = max((500 + 2 * margin) / 741, (350 + 2 * margin) / 500)
    left = (741 - (500 + 2 * margin) / scale) / 2
    top = (500 - (350 + 2 * margin) / scale) / 2
    rows, columns = np.nonzero(warped.hole)
    for row, column in list(zip(rows, columns, strict=True))[:: max(1, len(rows) // 20)]:
        x = (column + 0.5 + margin) / scale + left + 31.086 - 0.5
        y = (row + 0.5 + margin) / scale + top - 0.5
        x0, y0 = int(np.floor(x)), int(np.floor(y))
        if not (0 <= x0 < 740 and 0 <= y0 < 499):
            continue
        a, b = x - x0, y - y0
        wanted = (
            (1 - a) * (1 - b) * right[y0, x0] + a * (1 - b) * right[y0, x0 + 1]
            + (1 - a) * b * right[y0 + 1, x0] + a * b * right[y0 + 1, x0 + 1]
        )  # fmt: skip
        np.testing.assert_allclose(truth[row, column], wanted, atol=2e-3)
    assert np.array_equal(truth[~warped.hole], warped.colour[~warped.hole])
