"""`metamerlab warp` on what people have: `.flo`, RGB-D with poses, pairs from the right."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from command_line import outcome_of, refusal_of
from number_files import write_flo

from pipeline.camera import UPRIGHT, Camera, flow_between
from pipeline.errors import InputError
from pipeline.frame import SourceFrame
from pipeline.pictures.colour_file import load_colour, save_colour
from pipeline.pictures.depth_and_flow import read_flow
from pipeline.pictures.warp_input import (
    WarpInput,
    from_depth,
    from_flow,
    read_pose,
    save_warp_input,
)
from pipeline.pictures.write import write_pixels
from pipeline.warp.gpu import warp_frame
from stimuli.scenes.stereo import load_pair

HEIGHT, WIDTH = 48, 64
run = outcome_of("warp")
refusal = refusal_of("warp")


@pytest.fixture
def scene(tmp_path, rng):
    """A square at 2 m before a wall at 4 m, as a picture, its depth in millimetres, its motion."""
    colour = np.rint(rng.uniform(70, 150, (HEIGHT, WIDTH, 3))).astype(np.uint8)
    depth = np.full((HEIGHT, WIDTH), 4000, np.uint16)
    depth[12:36, 24:48] = 2000
    flow = np.zeros((HEIGHT, WIDTH, 2), np.float32)
    flow[..., 0] = np.where(depth == 2000, -8, -4)
    write_pixels(tmp_path / "picture.png", colour, "RGB")
    write_pixels(tmp_path / "depth.png", depth[..., None], "Y")
    write_flo(tmp_path / "motion.flo", flow)
    truth = np.roll(colour, -4, axis=1)
    truth[12:36, 16:40] = colour[12:36, 24:48]
    save_colour(tmp_path / "truth.png", np.float32(truth / 255))
    return tmp_path


def warped_rightly(filled, source) -> None:
    """The wall went 4 px to the left, the square 8: its left edge from 24 to 16."""
    np.testing.assert_allclose(filled[13:35, 17:39], source[13:35, 25:47], atol=1e-6)
    np.testing.assert_allclose(filled[:11, :-5], source[:11, 4:-1], atol=1e-6)


# ---- .flo


def test_a_flow_file_comes_back_as_it_was_written_with_unknown_motion_told(tmp_path, rng):
    flow = rng.normal(0, 9, (5, 7, 2)).astype(np.float32)
    flow[2, 3] = 1e10
    flow[4, 6, 1] = np.nan
    write_flo(tmp_path / "a.flo", flow)

    found, known = read_flow(tmp_path / "a.flo")

    np.testing.assert_array_equal(np.argwhere(~known), [[2, 3], [4, 6]])
    np.testing.assert_array_equal(found[known], flow[known])
    np.testing.assert_array_equal(found[~known], 0)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "does not begin with PIEH"),
        (b"PIEX" + bytes(16), "does not begin with PIEH"),
        (b"PIEH" + np.array([2, 1], "<i4").tobytes() + bytes(15), "2x1 px of motion in 28 bytes"),
        (b"PIEH" + np.array([-1, 1], "<i4").tobytes(), "must hold -1x1 px"),
        (
            b"PIEH" + np.array([1, 1], "<i4").tobytes() + np.full(2, 2e9, "<f4").tobytes(),
            "at least one pixel",
        ),
    ],
)
def test_what_is_no_flow_file_is_refused(tmp_path, data, said):
    (tmp_path / "bad.flo").write_bytes(data)
    with pytest.raises(InputError, match=said):
        read_flow(tmp_path / "bad.flo")


def flow_written(path, flow):
    """Write flow as networks and data sets do; the names are those of `ONCE_REFUSED`."""
    height, width, _ = flow.shape
    three = np.dstack([flow, np.zeros((height, width))])
    match path.name:
        case "upside-down.pfm":  # FlyingThings3D's, and the same with the bytes turned round
            path.write_bytes(
                f"PF\n{width} {height}\n-1.0\n".encode() + three[::-1].astype("<f4").tobytes()
            )
        case "other-order.pfm":
            path.write_bytes(
                f"PF\n{width} {height}\n1.0\n".encode() + three[::-1].astype(">f4").tobytes()
            )
        case "last.npy":
            np.save(path, flow)
        case "first.npy":
            np.save(path, flow.transpose(2, 0, 1))
        case "batch.npy":
            np.save(path, flow.transpose(2, 0, 1)[None].astype(np.float64))
        case "mask.npz":
            np.savez(path, flow=flow, mask=np.ones((height, width), bool))
        case "packed.npz":
            np.savez_compressed(path, flow.astype(">f4").transpose(2, 0, 1))
        case "kitti.png":
            three[..., :2], three[..., 2] = flow * 64 + 32768, 1
            three[0, 0] = 0
            write_pixels(path, three.astype(np.uint16), "RGB")


ONCE_REFUSED = (
    *("upside-down.pfm", "other-order.pfm", "last.npy", "first.npy", "batch.npy", "mask.npz"),
    *("packed.npz", "kitti.png"),
)


@pytest.mark.parametrize("name", ONCE_REFUSED)
def test_flow_is_read_as_networks_and_data_sets_write_it(tmp_path, rng, name):
    flow = np.rint(rng.uniform(-900, 900, (5, 7, 2))).astype(np.float32) / 64
    flow_written(tmp_path / name, flow)
    with warnings.catch_warnings(record=True) as notes:
        warnings.simplefilter("always")
        found, known = read_flow(tmp_path / name)
    said = [str(one.message) for one in notes]
    assert said == [f"{tmp_path / name}: flow is the motion; mask is not read"] * ("mask" in name)
    if name == "kitti.png":  # where it says that nothing is known
        assert not known[0, 0]
        assert known.sum() == 34
        flow[0, 0] = 0
    else:
        assert known.all()
    np.testing.assert_array_equal(found, flow)


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("depth.npy", np.ones((5, 7), np.float32)),
        ("colour.npy", np.ones((5, 7, 3), np.float32)),
        ("both.npz", None),
        ("grey.png", np.ones((5, 7, 1), np.uint16)),
        ("picture.png", np.full((5, 7, 3), 200, np.uint8)),
        ("colour.pfm", np.ones((5, 7, 3), np.float32)),
        ("flow.flo5", None),
    ],
)
def test_the_cure_of_what_is_no_flow_works(tmp_path, name, array):
    """`numpy.save(file, flow)`, of floats of shape (H, W, 2)."""
    path, flow = tmp_path / name, np.ones((5, 7, 2), np.float32)
    if name == "both.npz":
        np.savez(path, forward=flow, backward=-flow)
    elif array is None:
        path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(99))
    elif path.suffix == ".npy":
        np.save(path, array)
    elif path.suffix == ".pfm":
        path.write_bytes(b"PF\n7 5\n-1.0\n" + array.tobytes())
    else:
        write_pixels(path, array, "RGB" if array.shape[-1] == 3 else "Y")
    with pytest.raises(
        InputError, match=r"numpy\.save\(file, flow\), of floats of shape \(H, W, 2"
    ):
        read_flow(path)
    np.save(tmp_path / "cured.npy", flow)
    assert (read_flow(tmp_path / "cured.npy")[0] == 1).all()


def test_unknown_motion_is_that_of_the_nearest_known_pixel(scene):
    flow, _ = read_flow(scene / "motion.flo")
    flow[20, 23] = flow[2, 2] = 1e10  # beside the square, and in the wall
    write_flo(scene / "motion.flo", flow)
    found = from_flow(scene / "picture.png", scene / "motion.flo").flow_px
    assert found[20, 23, 0] in (-8, -4)
    np.testing.assert_array_equal(found[2, 2], (-4, 0))


def test_what_moves_faster_is_nearer_unless_depth_is_told(scene):
    """The square moves twice as fast as the wall; and at rest everything is equally far."""
    files = scene / "picture.png", scene / "motion.flo"
    guessed = from_flow(*files).source.depth_m
    assert guessed[20, 30] * 2 == pytest.approx(guessed[0, 0])
    assert np.ptp(from_flow(*files, nearer="none").source.depth_m) == 0
    told = from_flow(*files, scene / "depth.png", depth_scale=0.001).source.depth_m
    assert (told[20, 30], told[0, 0]) == (2, 4)
    write_flo(scene / "motion.flo", np.zeros((HEIGHT, WIDTH, 2), np.float32))
    assert np.ptp(from_flow(*files).source.depth_m) == 0


@pytest.mark.usefixtures("gl_context")
@pytest.mark.parametrize("depth", [(), ("--depth", "depth.png", "--depth-scale", 0.001)])
def test_a_picture_moves_by_its_flow_file(scene, depth):
    _, said, _ = run(
        scene / "picture.png",
        scene / "out.png",
        *("-m", "telea", "--flow", scene / "motion.flo", "--truth", scene / "truth.png"),
        *(scene / part if part == "depth.png" else part for part in depth),
    )
    assert "inside all holes" in said
    warped_rightly(load_colour(scene / "out.png"), load_colour(scene / "picture.png"))


# ---- RGB-D and two poses

CAMERA = "64,64,31.5,23.5"  # the middle of 64 x 48 px, the first centre at 0, 0


@pytest.mark.usefixtures("gl_context")
@pytest.mark.parametrize(
    "pose", ["0.25 0 0 0 0 0 1", "FILE:2", "1,0,0,.25, 0,1,0,0, 0,0,1,0, 0,0,0,1"]
)
def test_a_picture_with_depth_is_seen_from_another_pose(scene, pose):
    """By hand: 25 cm to the right is 64 * 0.25 / z px: 8 px at 2 m, 4 px at 4 m."""
    (scene / "poses.txt").write_text("# a comment\n\n1.5 0 0 0 0 0 0 1\n2.5 0.25 0 0 0 0 0 1\n")
    run(
        scene / "picture.png",
        scene / "out.png",
        *("-m", "telea", "--depth", scene / "depth.png", "--depth-scale", 0.001),
        *("--camera", CAMERA, "--target-pose", pose.replace("FILE", str(scene / "poses.txt"))),
    )
    warped_rightly(load_colour(scene / "out.png"), load_colour(scene / "picture.png"))


def test_poses_are_world_from_camera_and_both_count(scene):
    """Two cameras turned alike see each other as two that are not."""
    turned = "0 0 0 0 0.7071068 0 0.7071068"  # a quarter about y: right becomes world -z
    beside = "0 0 -0.25 0 0.7071068 0 0.7071068"
    inputs = [
        from_depth(
            scene / "picture.png", scene / "depth.png", intrinsics_px=(64, 64, 31.5, 23.5),
            pose=read_pose(pose), target_pose=read_pose(target), depth_scale=0.001,
        )
        for pose, target in (("0 0 0 0 0 0 1", "0.25 0 0 0 0 0 1"), (turned, beside))
    ]  # fmt: skip
    np.testing.assert_allclose(inputs[0].flow_px, inputs[1].flow_px, atol=1e-4)
    camera = Camera(WIDTH, HEIGHT, 64, 64, 32, 24, UPRIGHT)
    expected, _ = flow_between(camera, camera.moved((0.25, 0, 0)), inputs[0].source.depth_m)
    np.testing.assert_allclose(inputs[0].flow_px, expected, atol=1e-4)


@pytest.mark.usefixtures("gl_context")
def test_a_photo_and_its_depth_are_enough_to_move_sideways(scene):
    """By hand: an eighth of 64 px is 8 px for the square at 2 m, and 4 px for the wall at 4 m."""
    _, said, _ = run(
        scene / "picture.png", scene / "out.png", "-m", "telea", "--depth", scene / "depth.png",
        "--depth-scale", "0.001", "--parallax", "0.125",
    )  # fmt: skip
    assert "moves by 12.5 % of the width" in said
    warped_rightly(load_colour(scene / "out.png"), load_colour(scene / "picture.png"))


def test_unknown_depth_takes_the_farther_neighbour(scene):
    depth = np.full((HEIGHT, WIDTH), 4000, np.uint16)
    depth[:, 30:] = 2000
    depth[:, 28:32] = 0
    write_pixels(scene / "depth.png", depth[..., None], "Y")
    found = from_flow(
        scene / "picture.png", scene / "motion.flo", scene / "depth.png", depth_scale=0.001
    )
    np.testing.assert_allclose(found.source.depth_m[5, 26:34], [4] * 6 + [2] * 2, rtol=1e-6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 2 3", "must be tx ty tz qx qy qz qw"),
        ("0 0 0 0 0 0 x", "must be tx ty tz qx qy qz qw"),
        ("0 0 0 0 0 0 2", "quaternion of length 1"),
    ],
)
def test_what_is_no_pose_is_refused(text, said):
    with pytest.raises(InputError, match=said):
        read_pose(text)


def test_a_line_that_a_file_of_poses_lacks_is_refused(tmp_path):
    (tmp_path / "poses.txt").write_text("0 0 0 0 0 0 1\n")
    with pytest.raises(InputError, match=r"must have a pose in line 2 \(has 1"):
        read_pose(f"{tmp_path / 'poses.txt'}:2")


# ---- from the right camera to the left


@pytest.mark.usefixtures("gl_context")
def test_a_right_image_moves_to_the_left_camera(scene):
    """Its disparity counts the other way: the square goes 8 px to the right, the wall 4."""
    disparity = np.full((HEIGHT, WIDTH), 4, np.uint8)
    disparity[12:36, 24:48] = 8
    write_pixels(scene / "disparity.png", disparity[..., None], "Y")
    picture = load_colour(scene / "picture.png")
    left = np.roll(picture, 4, axis=1)
    left[12:36, 32:56] = picture[12:36, 24:48]
    save_colour(scene / "truth.png", left)
    _, said, _ = run(
        scene / "picture.png",
        scene / "out.png",
        *("-m", "telea", "--disparity", scene / "disparity.png", "--to-left"),
        *("--right", scene / "truth.png"),
    )
    filled, source = (load_colour(scene / name) for name in ("out.png", "picture.png"))
    assert "PSNR" in said
    np.testing.assert_allclose(filled[13:35, 33:55], source[13:35, 25:47], atol=1e-6)
    np.testing.assert_allclose(filled[:11, 5:], source[:11, 1:-4], atol=1e-6)


# ---- the truth, and where it is asked


@pytest.mark.usefixtures("gl_context")
def test_the_next_frame_of_a_render_is_the_truth_of_this_one(tmp_path, rng):
    """Both files have Blender's channels, not R, G, B."""
    planes = {f"ViewLayer.Combined.{c}": rng.random((32, 48), np.float32) for c in "RGB"}
    planes["ViewLayer.Depth.Z"] = np.full((32, 48), 3.0, np.float32)
    planes |= {f"ViewLayer.Vector.{c}": np.zeros((32, 48), np.float32) for c in "XYZW"}
    planes["ViewLayer.Depth.Z"][8:24, 8:24] = 1.0
    planes["ViewLayer.Vector.Z"][8:24, 8:24] = -6.0  # to the right
    moved = {key: plane.copy() for key, plane in planes.items()}
    for key in ("ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B"):
        moved[key][8:24, 14:30] = planes[key][8:24, 8:24]
    for name, held in (("a", planes), ("b", moved)):
        write_pixels(
            tmp_path / f"{name}.exr", np.stack(list(held.values()), -1), tuple(held),
            types=("float",) * len(planes),
        )  # fmt: skip
    _, said, _ = run(tmp_path / "a.exr", tmp_path / "o.png", "--truth", tmp_path / "b.exr")
    assert "PSNR" in said


def test_a_truth_measures_a_file_inside_interior_holes_and_inside_all(scene, rng):
    """By hand: what enters at the right border is wrong here by far, and counts in all holes."""
    source = load_colour(scene / "picture.png")
    flow, _ = read_flow(scene / "motion.flo")
    depth = np.where(flow[..., 0] == -8, 2, 4).astype(np.float32)
    save_warp_input(scene / "frame.exr", WarpInput(SourceFrame(source, depth), flow))
    run(scene / "frame.exr", scene / "out.png", "-m", "push-pull-depth", status=None)
    truth = load_colour(scene / "out.png")
    truth[:, -4:] = 1.0 - truth[:, -4:] * 0.5
    save_colour(scene / "truth.png", truth)

    _, said, _ = run(
        scene / "frame.exr", scene / "out.png", "-m", "push-pull-depth",
        "--truth", scene / "truth.png",
    )  # fmt: skip

    inside, everywhere = said.split("inside all holes")
    assert "do not touch the border" in inside

    def number(text):
        return float(text.split("push-pull-depth")[1].split()[0])

    assert number(inside) > 45  # the truth was rounded to 8 bits
    assert number(everywhere) < 15
    assert rng is not None


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--depth", "depth.png", "--camera", "64,64,3,3"], "a picture needs --flow FILE or"),
        (["--depth", "depth.png", "--parallax", "0"], "must lie between -1 and 1 widths"),
        (["--flow", "motion.flo", "--parallax", "1"], "do not go with it"),
        (["--flow", "motion.flo", "--pose", "0 0 0 0 0 0 1"], "do not go with it"),
        (["--flow", "motion.flo", "--nearer", "slow"], "--nearer: must be one of fast, none"),
        (["--flow", "motion.flo", "--to-left"], "options of stereo pairs"),
        (["--flow", "motion.flo", "--clip"], "belong to files of colour"),
        (["--flow", "none.flo"], "none.flo"),
        (["--flow", "motion.flo", "--truth", "small.png"], "small.png: must be as large as"),
        (
            ["--depth", "depth.png", "--camera", "64,64", "--target-pose", "0 0 0 0 0 0 1"],
            "--camera must be FX,FY,CX,CY",
        ),
        (
            ["--depth", "depth.png", "--camera", "64,64,3,3", "--target-pose", "0 0"],
            "must be tx ty tz",
        ),
        (
            ["--disparity", "depth.png", "--right", "truth.png", "--truth", "truth.png"],
            "--truth and --right",
        ),
        ([], "--flow FILE or --depth FILE (the camera then moves sideways"),
    ],
)
def test_options_that_do_not_go_together_are_refused(scene, arguments, said):
    save_colour(scene / "small.png", np.zeros((4, 4, 3), np.float32))
    given = [scene / part if "." in part and " " not in part else part for part in arguments]
    assert said in refusal(scene / "picture.png", scene / "out.png", "-m", "telea", *given)
    assert not (scene / "out.png").exists()


# ---- what is out there


def known_error(ctx, frame: WarpInput, truth) -> tuple[float, float]:
    """Mean absolute error against the other picture where the warp shows something, and at rest."""
    warped = warp_frame(frame.source, frame.flow_px, target_depth_m=frame.target_depth_m, ctx=ctx)
    known = ~warped.hole
    assert known.mean() > 0.5
    return (
        float(abs(warped.colour - truth)[known].mean()),
        float(abs(frame.source.colour - truth)[known].mean()),
    )


@pytest.mark.parametrize("name", ["Grove3", "Hydrangea", "RubberWhale", "Urban3"])
def test_middlebury_flow_leads_to_the_next_frame(gl_context, shared_data, name):
    folder = shared_data / "stereo" / f"middlebury_flow_{name}"
    if not folder.is_dir():
        pytest.skip("needs Middlebury's flow, which is not here")
    frame = from_flow(folder / "frame10.png", folder / "flow10.flo")
    moved, still = known_error(gl_context, frame, load_colour(folder / "frame11.png"))
    assert moved < 0.4 * still


def test_a_depth_camera_moves_from_pose_to_pose(gl_context, shared_data):
    folder = shared_data / "stereo" / "slambook_rgbd5"
    if not folder.is_dir():
        pytest.skip("needs an RGB-D sequence, which is not here")
    frame = from_depth(
        folder / "color" / "1.png", folder / "depth" / "1.pgm",
        intrinsics_px=(518, 519, 325.5, 253.5), depth_scale=0.001,
        pose=read_pose(f"{folder / 'pose.txt'}:1"),
        target_pose=read_pose(f"{folder / 'pose.txt'}:2"),
    )  # fmt: skip
    moved, still = known_error(gl_context, frame, load_colour(folder / "color" / "2.png"))
    assert moved < 0.7 * still


def test_teddy_is_seen_from_either_camera(gl_context, shared_data):
    folder = shared_data / "stereo" / "middlebury2003_teddy"
    if not folder.is_dir():
        pytest.skip("needs Middlebury's teddy, which is not here")
    for left, disparity, right, mirrored in (
        ("im2.png", "disp2.pgm", "im6.png", False),
        ("im6.png", "disp6.pgm", "im2.png", True),
    ):
        pair = load_pair(folder / left, folder / disparity, folder / right, units_per_px=4)
        pair = replace(pair, mirrored=mirrored)
        moved, still = known_error(gl_context, pair.warp_input(), pair.right)
        assert moved < 0.3 * still
