"""Pictures, depth and disparity in forms that people brought to other programs.

One scene: background with 4 px of disparity, before it a square with 20. True holes are 4.45 % of
the picture, with a rim of one pixel.
"""

import cv2
import numpy as np
import odd_pictures as odd
import pytest
from command_line import outcome_of
from PIL import Image

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame
from pipeline.pictures.warp_input import load_warp_input
from stimuli.scenes.stereo import PAIR_WARP, load_pair
from stimuli.warp.one_frame import warp_and_fill

HEIGHT, WIDTH = 192, 256
HOLES = "holes 4.4"
run = outcome_of("warp")


def noise(seed):
    rough = np.random.default_rng(seed).random((HEIGHT, WIDTH + 64, 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(rough, (0, 0), 1.2)
    return (smooth - smooth.min()) / np.ptp(smooth)


def eight(colour):
    return np.rint(255 * np.clip(colour, 0, 1)).astype(np.uint8)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    place = tmp_path_factory.mktemp("cases")
    back, front = noise(1), 0.2 + 0.6 * noise(2) * np.array([1, 0.5, 0.3], np.float32)
    disparity = np.full((HEIGHT, WIDTH), 4, np.float32)
    disparity[60:130, 100:170] = 20
    left, right = back[:, :WIDTH].copy(), back[:, 4 : WIDTH + 4].copy()
    left[60:130, 100:170] = right[60:130, 80:150] = front[60:130, 100:170]
    Image.fromarray(eight(left)).save(place / "left.png")
    Image.fromarray(eight(right)).save(place / "right.png")
    np.save(place / "disparity.npy", disparity)
    cv2.imwrite(str(place / "int16.tiff"), (disparity * 16).astype(np.int16))
    found = (disparity * 16).astype(np.int16)
    found[:, :8] = -16
    np.save(place / "sgbm.npy", found)
    linear = np.where(left <= 0.04045, left / 12.92, ((left + 0.055) / 1.055) ** 2.4)
    linear = linear.astype(np.float32)
    depth = np.where(disparity == 20, 1.0, 5.0).astype(np.float32)
    zero = np.zeros_like(depth)
    planes = {name: linear[..., k] for k, name in enumerate("RGB")}
    planes |= {"Z": depth, "flow.x": -disparity, "flow.y": zero}
    odd.write_exr(place / "whole.exr", planes)
    cropped = {name: plane[32:160, 48:208] for name, plane in planes.items()}
    odd.write_exr(place / "cropped.exr", cropped, data_at=(48, 32), window=(0, 0, WIDTH, HEIGHT))
    return place


def holes(ctx, pair) -> WarpedFrame:
    return warp_and_fill(ctx, pair.warp_input(), [], settings=PAIR_WARP)[0].hole


def test_cases_8_9_and_20_have_the_holes_of_the_scene(gl_context, files):
    wanted = load_pair(files / "left.png", files / "disparity.npy")
    with pytest.warns(UserWarning, match="-16, at 1536 pixels, is taken for unknown"):
        sgbm = load_pair(files / "left.png", files / "sgbm.npy", units_per_px=16)

    assert 100 * holes(gl_context, wanted).mean() == pytest.approx(4.45, abs=0.02)
    np.testing.assert_array_equal(holes(gl_context, sgbm), holes(gl_context, wanted))


def test_case_20_the_command_says_once_what_it_took_for_unknown(files, tmp_path):
    _, out, error = run(
        files / "left.png", tmp_path / "o.png", "--disparity", files / "sgbm.npy",
        "--units-per-px", 16, "-m", "push-pull",
    )  # fmt: skip

    assert HOLES in out
    assert error == f"note: {files / 'sgbm.npy'}: -16, at 1536 pixels, is taken for unknown\n"


@pytest.mark.parametrize("right", [("--right", "right.png"), ()])
def test_forgotten_units_are_told_and_the_cure_is_the_one_that_works(files, tmp_path, right):
    given = [files / "left.png", tmp_path / "o.png", "--disparity", files / "int16.tiff",
             "-m", "push-pull", *right[:1], *(files / name for name in right[1:])]  # fmt: skip
    _, _, said = run(*given, status=2)
    assert "int16.tiff: a disparity must be less than the picture's width" in said
    assert "without --right" not in said  # without it, this file is refused as well
    if right:
        assert "--units-per-px 16 fits" in said
    assert HOLES in run(*given, "--units-per-px", 16, status=None)[1]


def test_case_20_each_option_that_the_message_names_is_taken(files, tmp_path):
    given = (files / "left.png", tmp_path / "o.png", "--disparity", files / "sgbm.npy",
             "-m", "push-pull")  # fmt: skip
    _, _, said = run(*given, status=2)
    assert "--unknown -16" in said
    _, _, said = run(*given, "--unknown", "-16", status=2)
    assert "less than the picture's width, 256 px" in said
    assert "--units-per-px" in said
    _, out, _ = run(*given, "--unknown", "-16", "--units-per-px", 16)
    assert HOLES in out
    assert not run(*given, "--unknown", "many", status=None)[1]


def test_case_6_a_cropped_file_is_refused_and_the_whole_one_read(files):
    with pytest.raises(InputError, match=r"whole display window .of 256 x 192 px.*160 x 128 px"):
        load_warp_input(files / "cropped.exr")
    assert load_warp_input(files / "whole.exr").source.size == (HEIGHT, WIDTH)


def test_depth_along_the_ray_is_an_option(files, tmp_path):
    given = (files / "left.png", tmp_path / "o.png", "--depth", files / "disparity.npy",
             "-m", "push-pull")  # fmt: skip

    assert run(*given, status=None)[0] == 0
    plain = (tmp_path / "o.png").read_bytes()
    assert run(*given, "--depth-is", "ray", status=None)[0] == 0
    assert (tmp_path / "o.png").read_bytes() != plain
    assert "--depth-is: must be" in run(*given, "--depth-is", "far", status=None)[2]
