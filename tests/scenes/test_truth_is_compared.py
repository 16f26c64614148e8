"""A warp is compared with a given true view before anything is scored, whatever it comes from."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from command_line import outcome_of, refusal_of
from number_files import write_flo
from scipy.spatial.transform import Rotation

from pipeline.frame import SourceFrame
from pipeline.pictures.colour_file import load_colour, save_colour
from pipeline.pictures.warp_input import (
    WarpInput,
    from_depth,
    from_flow,
    motion_between,
    read_pose,
    save_warp_input,
)
from stimuli.rendering.render import WorldRenderer
from stimuli.scenes.builtin_scenes import build_scene, scene_names
from stimuli.scenes.truth_check import flow_readings, judge_truth, no_readings, pose_readings

HEIGHT, WIDTH = 192, 256
LENS = (200.0, 200.0, 127.5, 95.5)
CAMERA = ",".join(f"{value:g}" for value in LENS)
BESIDE = "0.1 0 0 0 0 0 1"  # 20 px at 1 m, 4 px at 5 m
run, refusal = outcome_of("warp"), refusal_of("warp")
flow_or = flow_readings("turn it")


def rough(seed, wide=64):
    noise = np.random.default_rng(seed).random((HEIGHT, WIDTH + wide, 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.2)
    return (smooth - smooth.min()) / np.ptp(smooth)


def square_before_a_wall(wall_px=4, far_m=5.0):
    """Two views, the left one's depth in metres and its flow; the square moves by 20 px."""
    wall, square = rough(1), 0.2 + 0.6 * rough(2)
    box, moved = (slice(60, 130), slice(100, 170)), (slice(60, 130), slice(80, 150))
    left, right = wall[:, :WIDTH].copy(), wall[:, wall_px : WIDTH + wall_px].copy()
    left[box] = right[moved] = square[box]
    depth = np.full((HEIGHT, WIDTH), far_m, np.float32)
    depth[box] = 1
    flow = np.zeros((HEIGHT, WIDTH, 2), np.float32)
    flow[..., 0] = np.where(depth == 1, -20, -wall_px)
    return left, right, depth, flow


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The scene in files of every kind, right and wrong."""
    folder = tmp_path_factory.mktemp("truth")
    left, right, depth, flow = square_before_a_wall()
    for name, colour in (("left", left), ("right", right), ("other", rough(7)[:, :WIDTH])):
        save_colour(folder / f"{name}.png", colour)
    np.save(folder / "depth.npy", depth)
    np.save(folder / "inverse.npy", 1 / depth)
    for name, motion in (
        ("flow", flow),
        ("back", -flow),
        ("shares", flow / (WIDTH, HEIGHT)),
        ("up", flow[..., ::-1]),
    ):
        write_flo(folder / f"{name}.flo", motion.astype(np.float32))
    for name, motion in (("frame", flow), ("frame-back", -flow)):
        picture = SourceFrame(left, depth)
        save_warp_input(folder / f"{name}.exr", WarpInput(picture, motion))
    mask = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    mask[60:130, 100:170] = 1
    save_colour(folder / "mask.png", mask)
    return folder


def words(folder, text):
    """Split an invocation; names of files are in the folder, POSE is where the right view is."""
    parts = [BESIDE if part == "POSE" else part for part in text.split()]
    parts = ["-0.1 0 0 0 0 0 1" if part == "INVERSE" else part for part in parts]
    known = (".npy", ".flo", ".png", ".exr")
    return [folder / part if part.endswith(known) else part for part in parts]


POSED = f"left.png --camera {CAMERA} --target-pose POSE --truth right.png"


@pytest.mark.usefixtures("gl_context")
@pytest.mark.parametrize(
    "given",
    [
        f"{POSED} --depth depth.npy",
        "left.png --flow flow.flo --truth right.png",
        "frame.exr --truth right.png",
        "left.png --mask mask.png --truth left.png",
    ],
)
def test_what_belongs_together_is_measured_without_a_word(files, tmp_path, given):
    source, *rest = words(files, given)
    _, said, error = run(source, tmp_path / "o.png", "-m", "push-pull", *rest)
    assert "note" not in said + error
    assert "mask" in given or "PSNR" in said


@pytest.mark.parametrize(
    ("given", "said", "cured"),
    [
        (f"{POSED} --depth depth.npy".replace("POSE", "INVERSE"), "camera from world, as COLMAP",
         f"{POSED} --depth depth.npy"),
        (f"{POSED} --depth depth.npy --depth-scale 1000", "--depth-scale 1 fits",
         f"{POSED} --depth depth.npy --depth-scale 1"),
        (f"{POSED} --depth depth.npy --depth-scale 0.01", "--depth-scale 1 fits",
         f"{POSED} --depth depth.npy --depth-scale 1"),
        (f"{POSED} --depth inverse.npy", "--depth-is inverse fits",
         f"{POSED} --depth inverse.npy --depth-is inverse"),
        (f"{POSED} --depth depth.npy".replace(CAMERA, "400,400,255,191"), f"--camera {CAMERA} fits",
         f"{POSED} --depth depth.npy"),
        ("left.png --flow back.flo --truth right.png", "the flow leads the other way",
         "left.png --flow flow.flo --truth right.png"),
        ("right.png --flow flow.flo --truth left.png", "the flow leads the other way", ""),
        ("left.png --flow shares.flo --truth right.png", "multiply it by width and height", ""),
        ("left.png --flow up.flo --truth right.png", "y before x: exchange them", ""),
        ("left.png --flow flow.flo --truth left.png", "shows the picture unmoved", ""),
        ("left.png --flow flow.flo --truth other.png", "may be of different pictures", ""),
        ("frame-back.exr --truth right.png", "the flow leads the other way",
         "frame.exr --truth right.png"),
        ("frame.exr --truth other.png", "may be of different pictures", ""),
        ("left.png --depth depth.npy --truth right.png", "--parallax 0.0",
         "left.png --depth depth.npy --parallax 0.0746 --truth right.png"),
        ("left.png --mask mask.png --truth right.png", "different pictures", ""),
    ],
)  # fmt: skip
def test_what_does_not_is_refused_with_the_cause_and_the_cure_works(
    files, tmp_path, given, said, cured
):
    source, *rest = words(files, given)
    error = refusal(source, tmp_path / "o.png", "-m", "telea", *rest)
    assert "outside the holes the warp must show what the true view shows" in error
    assert said in error
    assert not (tmp_path / "o.png").exists()
    if cured:
        source, *rest = words(files, cured)
        run(source, tmp_path / "o.png", "-m", "telea", *rest)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("", "moves by 20 px against what is far; small numbers in"),
        (" --depth-scale 1000", "0.02 px against what is far; small"),
        (
            " --depth-scale 1000",
            "less than a pixel: are depth (--depth-scale) and poses in metres?",
        ),
        (" --depth-is inverse", "large numbers in"),
    ],
)
def test_without_a_true_view_the_motion_is_said_and_what_would_make_it_wrong(
    files, tmp_path, change, said
):
    source, *rest = words(
        files, f"{POSED} --depth depth.npy{change}".replace("--truth right.png", "")
    )
    assert said in run(source, tmp_path / "o.png", "-m", "telea", *rest)[1]


@pytest.mark.parametrize("wall_px", [0, 4])
def test_a_far_wall_does_not_hide_a_square_that_goes_the_wrong_way(wall_px):
    left, right, depth, flow = square_before_a_wall(wall_px, 1e4 if wall_px == 0 else 5.0)
    verdict = judge_truth(WarpInput(SourceFrame(left, depth), -flow), right, flow_or)
    assert verdict.refused
    assert "leads the other way" in str(verdict)


def changed(right, how):
    rng = np.random.default_rng(3)
    if how == "jpeg":
        bytes_ = cv2.imencode(".jpg", np.uint8(255 * right), [cv2.IMWRITE_JPEG_QUALITY, 40])[1]
        return np.float32(cv2.imdecode(bytes_, 1) / 255)
    if how == "reflection":
        seen = right.copy()
        seen[20:110, 20:110] = rough(9)[20:110, 20:110]
        return seen
    return {
        "gain": np.float32(0.9) * right,
        "offset": (right + np.float32(0.1)).clip(0, 1),
        "gamma": right ** np.float32(0.8),
        "noise": (right + rng.normal(0, 0.06, right.shape)).clip(0, 1).astype(np.float32),
    }[how]


@pytest.mark.parametrize("how", ["gain", "offset", "gamma", "noise", "jpeg", "reflection"])
def test_other_light_noise_and_reflections_alarm_nobody(how):
    left, right, depth, flow = square_before_a_wall()
    frame = WarpInput(SourceFrame(left, depth), flow)
    assert not judge_truth(frame, changed(right, how), flow_or).doubtful


def test_contrast_does_not_count_and_without_texture_nothing_is_judged():
    left, right, depth, flow = (np.float32(part) for part in square_before_a_wall())
    pale, shown = 0.45 + 0.1 * left, 0.45 + 0.1 * right
    frame = WarpInput(SourceFrame(pale, depth), flow)
    assert not judge_truth(frame, shown, flow_or).doubtful
    assert judge_truth(replace(frame, flow_px=-flow), shown, flow_or).cause
    flat = replace(frame, source=SourceFrame(np.full_like(left, 0.5), depth))
    assert "too few pixels have texture" in str(judge_truth(flat, shown, flow_or))


def test_a_texture_that_repeats_is_right_where_it_is_right():
    x = np.arange(WIDTH + 64)
    stripes = np.float32(0.5 + 0.4 * np.sin(2 * np.pi * x / 8))
    wall = np.repeat(np.tile(stripes, (HEIGHT, 1))[..., None], 3, axis=2)
    wall += 0.1 * np.float32(np.sin(np.arange(HEIGHT) / 3))[:, None, None]
    flow = np.zeros((HEIGHT, WIDTH, 2), np.float32)
    flow[..., 0] = -3
    frame = WarpInput(
        SourceFrame(wall[:, :WIDTH].clip(0, 1), np.ones((HEIGHT, WIDTH), np.float32)), flow
    )
    right = wall[:, 3 : WIDTH + 3].clip(0, 1)
    assert not judge_truth(frame, right, flow_or).doubtful
    assert judge_truth(replace(frame, flow_px=-flow), right, flow_or).cause


def test_how_far_it_is_off_is_said_where_nothing_else_fits():
    left, right, depth, flow = square_before_a_wall()
    left, right = (
        (0.5 + 4 * (cv2.GaussianBlur(view, (0, 0), 4) - 0.5)).clip(0, 1) for view in (left, right)
    )
    beside = np.roll(right, 3, axis=0)
    verdict = judge_truth(WarpInput(SourceFrame(left, depth), flow), beside, no_readings)
    assert not verdict.refused
    assert "lies more than 2 px beside the true view" in str(verdict)


# ---- rendered views, whose true view is rendered, too


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name == "garden" else pytest.mark.slow)
        for name in scene_names()
    ],
)
def test_rendered_views_agree_and_are_refused_where_poses_are_read_wrongly(gl_context, name):
    renderer = WorldRenderer(gl_context, build_scene(name, 1))
    try:
        here = renderer.world.viewpoint.camera(WIDTH, HEIGHT)
        near_m = float(np.percentile(renderer.render(here).depth_m, 20))
        there = here.moved((0.12 * near_m, 0.02 * near_m, 0.1 * near_m))
        source, truth = renderer.render(here), renderer.render(there).colour
    finally:
        renderer.release()
    lens = (here.fx_px, here.fy_px, here.cx_px - 0.5, here.cy_px - 0.5)
    poses = here.world_from_camera, there.world_from_camera
    back = np.diag([1.0, -1.0, -1.0, 1.0])

    def verdict(poses, scale=1.0):
        depth = source.depth_m * np.float32(scale)
        frame = WarpInput(SourceFrame(source.colour, depth), *motion_between(depth, lens, *poses))
        return judge_truth(frame, truth, pose_readings(depth, lens, poses))

    assert not verdict(poses).doubtful
    assert "as COLMAP writes them" in str(verdict(tuple(map(np.linalg.inv, poses))))
    assert "exchanged" in str(verdict(poses[::-1]))
    assert "y up and z back" in str(verdict([pose @ back for pose in poses]))
    assert "--depth-scale 0.001 fits" in str(verdict(poses, 1000))
    turned = [pose.copy() for pose in poses]
    for pose in turned:
        order = np.roll(Rotation.from_matrix(pose[:3, :3]).as_quat(), 1)
        pose[:3, :3] = Rotation.from_quat(order).as_matrix()
    assert verdict(turned).refused


# ---- what is out there


@pytest.mark.slow
@pytest.mark.parametrize(
    ("folder", "picture", "flow", "truth"),
    [
        *(
            (f"middlebury_flow_{name}", "frame10.png", "flow10.flo", "frame11.png")
            for name in ("Grove3", "Hydrangea", "RubberWhale", "Urban3")
        ),
        *(
            (f"sintel_{name}_clean", "frame_0002.png", "gt/frame_0002.flo", "frame_0003.png")
            for name in ("alley_1", "cave_2")
        ),
    ],
)
def test_real_flow_alarms_nobody_and_backward_flow_is_refused(
    shared_data, folder, picture, flow, truth
):
    place = shared_data / "stereo" / folder
    if not place.is_dir():
        pytest.skip("needs Middlebury's and Sintel's flow, which is not here")
    frame, shown = from_flow(place / picture, place / flow), load_colour(place / truth)
    assert not judge_truth(frame, shown, flow_or).doubtful
    wrong = judge_truth(replace(frame, flow_px=-frame.flow_px), shown, flow_or)
    assert "leads the other way" in str(wrong)
    # The same flow, and the pictures exchanged.
    exchanged = replace(frame, source=SourceFrame(shown, frame.source.depth_m))
    assert "leads the other way" in str(judge_truth(exchanged, frame.source.colour, flow_or))
    turned = np.ascontiguousarray(shown[::-1, ::-1])
    assert "different pictures" in str(judge_truth(frame, turned, flow_or))


@pytest.mark.slow
@pytest.mark.parametrize(("first", "second"), [(1, 2), (2, 3), (3, 2), (3, 4), (4, 5)])
def test_a_real_depth_camera_is_not_refused_and_its_inverse_poses_are(shared_data, first, second):
    place = shared_data / "stereo" / "slambook_rgbd5"
    if not place.is_dir():
        pytest.skip("needs an RGB-D sequence, which is not here")
    lens = (518.0, 519.0, 325.5, 253.5)
    poses = tuple(read_pose(f"{place / 'pose.txt'}:{number}") for number in (first, second))
    truth = load_colour(place / "color" / f"{second}.png")
    for refused in (False, True):
        read = tuple(np.linalg.inv(pose) if refused else pose for pose in poses)
        frame = from_depth(
            place / "color" / f"{first}.png", place / "depth" / f"{first}.pgm",
            intrinsics_px=lens, pose=read[0], target_pose=read[1], depth_scale=0.001,
        )  # fmt: skip
        verdict = judge_truth(
            frame, truth, pose_readings(frame.source.depth_m, lens, read, depth_scale=0.001)
        )
        assert verdict.refused is refused, str(verdict)
        assert ("COLMAP" in str(verdict)) is refused
