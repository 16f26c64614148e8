"""Every fill method keeps the one contract; the registry tells mistakes apart."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.inpaint.reference import guide_from_depth, nearest_depth_m
from pipeline.methods.method import composite
from pipeline.methods.registry import (
    METHODS,
    check_method,
    create_method,
    method_names,
    method_parameters,
)
from pipeline.pictures.write import write_pixels
from stimuli.batch.clip import Fills

NAMED = [entry.name for entry in METHODS if not entry.takes_path]


def warped_frame(rng, height=40, width=56, hole=None, colour=None) -> WarpedFrame:
    """A noisy background at 4 m, seen beside a foreground at 2 m that moved 8 px more."""
    if colour is None:
        colour = rng.random((height, width, 3), dtype=np.float32)
    depth_m = np.full((height, width), 4.0, np.float32)
    depth_m[:, : width // 4] = 2.0
    flow_px = np.zeros((height, width, 2), np.float32)
    flow_px[..., 0] = np.where(depth_m == 2.0, -10.0, -2.0)
    if hole is None:
        hole = np.zeros((height, width), bool)
        hole[:, width // 4 : width // 4 + min(8, width // 2)] = True
    return WarpedFrame(colour, depth_m, hole, flow_px)


@pytest.fixture
def method(gl_context, name):
    """The method of that name, freed after the test."""
    made = create_method(name, gl_context)
    yield made
    made.release()


@pytest.mark.parametrize("name", NAMED)
@pytest.mark.parametrize("size", [(40, 56), (33, 47)])
def test_every_method_keeps_known_pixels_bit_for_bit_and_fills_within_range(method, rng, size):
    frame = warped_frame(rng, *size)
    filled = method.fill(frame, seed=1)

    known = ~frame.hole
    np.testing.assert_array_equal(
        filled[known].view(np.uint32), frame.colour[known].view(np.uint32)
    )
    assert filled.dtype == np.float32
    assert filled.min() >= 0
    assert filled.max() <= 1


@pytest.mark.parametrize("name", NAMED)
def test_every_method_ignores_what_the_colour_array_holds_inside_holes(method, rng):
    frame = warped_frame(rng)
    other = frame.colour.copy()
    other[frame.hole] = rng.random((int(frame.hole.sum()), 3), dtype=np.float32)
    first = method.fill(frame, seed=1)
    second = method.fill(warped_frame(rng, hole=frame.hole, colour=other), seed=1)

    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("name", NAMED)
def test_every_method_keeps_a_constant_image_constant(method, rng, name):
    """OpenCV works on bytes, and its Telea drifts by up to three steps on a constant."""
    atol = 3.5 / 255 if name in ("telea", "navier-stokes") else 1e-6
    colour = np.full((40, 56, 3), (0.2, 0.4, 0.8), np.float32)
    filled = method.fill(warped_frame(rng, colour=colour), seed=1)

    np.testing.assert_allclose(filled, colour, atol=atol)


@pytest.mark.parametrize("name", ["metameric", "metameric-paper", "push-pull-depth"])
def test_a_frame_all_at_infinity_is_filled_as_one_at_any_depth(method, rng):
    """Nothing is nearest there, and the guide must be a number all the same."""
    far = warped_frame(rng)
    far, near = (replace(far, depth_m=np.full_like(far.depth_m, z_m)) for z_m in (np.inf, 5.0))
    fills = [method.fill(frame, seed=1) for frame in (far, near)]

    np.testing.assert_array_equal(*fills)
    for frame in (far, near):
        guide = guide_from_depth(frame.depth_m, nearest_depth_m(frame.depth_m))
        assert np.isfinite(guide).all()
        assert np.ptp(guide) == 0


@pytest.mark.parametrize("name", NAMED)
def test_every_method_is_a_pure_function_of_frame_and_seed(gl_context, rng, name):
    """A frame gives the same fill alone, again, and after a frame of another size."""
    frame, other = warped_frame(rng), warped_frame(rng, 21, 30)
    method = create_method(name, gl_context)
    fresh = create_method(name, gl_context)
    try:
        alone = fresh.fill(frame, seed=3)
        method.fill(other, seed=5)
        later = [method.fill(frame, seed=3) for _ in range(2)]
    finally:
        method.release()
        fresh.release()

    np.testing.assert_array_equal(later[0], alone)
    np.testing.assert_array_equal(later[1], alone)


@pytest.mark.parametrize("name", NAMED)
def test_every_method_returns_a_frame_without_holes_as_it_is(method, rng):
    frame = warped_frame(rng, hole=np.zeros((40, 56), bool))
    np.testing.assert_array_equal(method.fill(frame, seed=1), frame.colour)


@pytest.mark.parametrize("name", NAMED)
def test_every_method_refuses_a_frame_that_is_all_hole(method, rng):
    with pytest.raises(InputError, match="at least one known pixel"):
        method.fill(warped_frame(rng, hole=np.ones((40, 56), bool)), seed=1)


@pytest.mark.parametrize("name", NAMED)
def test_every_method_takes_a_frame_of_one_pixel(method, rng):
    frame = warped_frame(rng, 1, 1, hole=np.zeros((1, 1), bool))
    np.testing.assert_array_equal(method.fill(frame, seed=1), frame.colour)


def test_composite_refuses_a_fill_that_is_not_finite_or_of_another_size(rng):
    frame = warped_frame(rng)
    broken = frame.colour.copy()
    broken[frame.hole] = np.nan

    with pytest.raises(InputError, match="must be finite in every hole"):
        composite(frame, broken)
    with pytest.raises(InputError, match="must have shape"):
        composite(frame, broken[1:])


def test_composite_does_not_mind_what_lies_outside_the_holes(rng):
    frame = warped_frame(rng)
    fill = np.where(frame.hole[..., None], np.float32(2.0), np.float32(np.nan))

    result = composite(frame, np.broadcast_to(fill, frame.colour.shape))

    assert (result[frame.hole] == 1).all()
    np.testing.assert_array_equal(result[~frame.hole], frame.colour[~frame.hole])


# --- the registry ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("tela", "did you mean 'telea'"),
        ("Navier_Stokes", "did you mean 'navier-stokes'"),
        ("background-extention", "did you mean 'background-extension'"),
        ("xyz", "must be one of .*telea"),
        ("onnx:", "must name a path"),
    ],
)
def test_an_unknown_method_suggests_the_nearest(name, hint):
    with pytest.raises(InputError, match=hint):
        create_method(name)


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"radius": 3.0}, "'radius'.; did you mean 'radius_px'"),
        ({"xyz": 3.0}, r"parameters of telea are: radius_px \(got 'xyz'\)"),
        ({"radius_px": "wide"}, "radius_px must be int or float"),
        ({"radius_px": True}, "radius_px must be int or float"),
        ({"radius_px": 0.0}, "radius_px must lie in"),
        ({"radius_px": float("nan")}, "radius_px must lie in"),
    ],
)
def test_wrong_parameters_are_refused(parameters, said):
    with pytest.raises(InputError, match=said):
        create_method("telea", None, parameters)


def test_every_method_has_its_own_name_and_summary():
    assert len(set(method_names())) == len(METHODS)
    assert all(entry.summary for entry in METHODS)
    assert method_parameters("telea") == {"radius_px": 3.0}


def test_the_radius_reaches_opencv(rng):
    frame = warped_frame(rng)
    narrow, wide = (create_method("telea", None, {"radius_px": r}).fill(frame, 0) for r in (1, 9))

    assert (narrow[frame.hole] != wide[frame.hole]).any()


@pytest.mark.parametrize("name", ["telea", "navier-stokes"])
@pytest.mark.parametrize("size", [(1, 40), (40, 1)])
def test_opencv_fills_frames_one_pixel_high_or_wide_alike_each_time(rng, name, size):
    """OpenCV itself reads memory beside such a picture, and differs from run to run."""
    method = create_method(name)
    for _ in range(60):
        frame = warped_frame(rng, *size, hole=rng.random(size) < 0.4)
        found = set()
        for value in (0, 77, 255):  # what memory held before
            before = [np.full(int(length), value, np.uint8) for length in range(64, 9000, 90)]
            del before
            found.add(method.fill(frame, 0).tobytes())
        assert len(found) == 1


# --- frames made elsewhere ---------------------------------------------------------------


@pytest.fixture
def folder(tmp_path, rng):
    for number in range(3):
        data = rng.integers(0, 255, (40, 56, 3), dtype=np.uint8)
        write_pixels(tmp_path / f"{number:06d}.png", data, "RGB")
    return tmp_path


def at_index(frame: WarpedFrame, index: int) -> WarpedFrame:
    return WarpedFrame(frame.colour, frame.depth_m, frame.hole, frame.flow_px, index)


def test_frames_made_elsewhere_fill_the_holes_by_frame_index(folder, rng):
    from pipeline.pictures.decode import read_pixels

    frame = at_index(warped_frame(rng), 2)
    stored = read_pixels(folder / "000002.png").data
    stored[~frame.hole] = np.rint(255 * frame.colour[~frame.hole])
    write_pixels(folder / "000002.png", stored, "RGB")
    filled = create_method(f"frames:{folder}").fill(frame, 0)

    stored = stored[frame.hole]
    np.testing.assert_array_equal(np.rint(filled[frame.hole] * 255), stored)
    np.testing.assert_array_equal(filled[~frame.hole], frame.colour[~frame.hole])


@pytest.mark.parametrize("place", ["", "/shot-{frame}.png"])
def test_frames_that_show_something_else_outside_the_holes_are_refused(folder, rng, place):
    for file in sorted(folder.iterdir()):
        write_pixels(folder / f"shot-{file.name}", np.zeros((40, 56, 3), np.uint8), "RGB")
    method, frame = create_method(f"frames:{folder}{place}"), warped_frame(rng)

    if place:  # black elsewhere: only what lies in the holes was sent back
        assert (method.fill(frame, 0)[frame.hole] == 0).all()
    else:
        with pytest.raises(InputError, match=r"000000\.png: must show, .* frame 0 .*another scene"):
            method.fill(frame, 0)


def test_frames_of_wrong_number_or_size_are_refused(folder, rng):
    method = create_method(f"frames:{folder}")

    with pytest.raises(InputError, match=r"must hold frame 000003 \(has 3 frames\)"):
        method.fill(at_index(warped_frame(rng), 3), 0)
    with pytest.raises(InputError, match=r"000000\.png: must be 50 x 40 px .*is 56 x 40"):
        method.fill(warped_frame(rng, 40, 50), 0)


def test_a_folder_with_a_gap_a_double_or_nothing_is_refused(folder):
    (folder / "000001.png").rename(folder / "000007.png")
    with pytest.raises(InputError, match=r"5 missing, the first is 000001"):
        create_method(f"frames:{folder}")

    (folder / "000007.png").rename(folder / "02.png")
    with pytest.raises(InputError, match=r"frame 2 is in 000002\.png and in 02\.png"):
        create_method(f"frames:{folder}")

    for file in folder.iterdir():
        file.unlink()
    with pytest.raises(InputError, match="has none"):
        create_method(f"frames:{folder}")
    with pytest.raises(FileNotFoundError):
        create_method(f"frames:{folder}/nowhere")


@pytest.fixture
def video(folder):
    """The folder's frames as a video that keeps every pixel."""
    from stimuli.media.video import write_video

    write_video(folder / "filled.avi", sorted(folder.glob("*.png")), 30.0)
    return folder / "filled.avi"


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 0)])
def test_a_video_fills_the_holes_as_its_frames_do(video, rng, order, monkeypatch):
    monkeypatch.setattr("pipeline.methods.frames.MOST_APART", 1.0)  # random frames, all apart
    from_video, from_folder = (
        create_method(f"frames:{video}"),
        create_method(f"frames:{video.parent}"),
    )
    frame = warped_frame(rng)
    for index in order:
        filled, wanted = (
            each.fill(at_index(frame, index), 0) for each in (from_video, from_folder)
        )
        np.testing.assert_array_equal(filled, wanted)
    assert len(from_video) == 3
    from_video.release()


def test_a_video_that_is_short_damaged_or_of_another_scene_is_refused(video, rng):
    method = create_method(f"frames:{video}")
    with pytest.raises(InputError, match=r"must hold frame 000003 \(has 3 frames\)"):
        method.fill(at_index(warped_frame(rng), 3), 0)
    with pytest.raises(InputError, match=r"filled\.avi: must be 50 x 40 px .*is 56 x 40"):
        method.fill(warped_frame(rng, 40, 50), 0)
    with pytest.raises(InputError, match="another scene"):
        method.fill(warped_frame(rng), 0)
    video.write_bytes(b"no video")
    with pytest.raises(InputError, match="must be a video that OpenCV reads"):
        create_method(f"frames:{video}")


# --- A frame that stays on the GPU


class OneView:
    """One warped frame, as arrays and as textures."""

    def __init__(self, ctx, frame):
        self.frame = frame
        self.textures = FrameTextures.create(ctx, (frame.size[1], frame.size[0]))
        self.arrays = 0

    def source_key(self, frame):  # noqa: ARG002
        return 0

    def warped(self, frame):  # noqa: ARG002
        self.arrays += 1
        return self.frame

    def warped_textures(self, frame):  # noqa: ARG002
        self.textures.upload(self.frame)
        return self.textures


ON_GPU = ["metameric", "metameric-paper", "push-pull-depth", "push-pull", "weighted-pull-push"]


@pytest.mark.parametrize("name", ON_GPU)
def test_a_clip_filled_on_the_gpu_has_the_bits_of_its_frames_filled_as_arrays(
    gl_context, rng, name
):
    method = create_method(name, gl_context)
    view = OneView(gl_context, warped_frame(rng))

    found = Fills(method, view, 3).frame(0)

    assert view.arrays == 0
    assert found.tobytes() == method.fill(view.frame, 3).tobytes()
    method.release()
    view.textures.release()


def test_a_frame_on_the_gpu_that_is_all_hole_is_refused(gl_context, rng):
    method = create_method("push-pull", gl_context)
    view = OneView(gl_context, warped_frame(rng, hole=np.ones((40, 56), bool)))

    with pytest.raises(InputError, match="at least one known pixel"):
        Fills(method, view, 0).frame(0)
    method.release()
    view.textures.release()


@pytest.mark.parametrize("name", NAMED)
def test_every_parameter_of_every_method_has_a_range_that_is_checked_without_a_context(name):
    check_method(name, {})
    for key, default in method_parameters(name).items():
        check_method(name, {key: default})
        if isinstance(default, bool):
            continue
        if isinstance(default, str):
            wrong = ["nonsense"]
        elif isinstance(default, int):
            wrong = [-5, 10**6]
        else:
            wrong = [-5.0, math.nan, math.inf]
        for value in wrong:
            with pytest.raises(InputError, match=key):
                check_method(name, {key: value})


def test_a_gaze_without_a_fill_by_eccentricity_is_refused():
    check_method("coherence-transport", {"fovea_deg": 5.0, "gaze_x_deg": 3.0, "width_deg": 20.0})
    for key in ("gaze_x_deg", "gaze_y_deg", "width_deg"):
        with pytest.raises(InputError, match=rf"^{key} \(got 3.0\) .*needs fovea_deg above 0"):
            check_method("coherence-transport", {key: 3.0})


def test_a_networks_parameters_are_checked_before_its_file():
    check_method("onnx:none.onnx", {"multiple_px": 8})
    with pytest.raises(InputError, match=r"multiple_px must lie in 1\.\.1024 \(got 0\)"):
        check_method("onnx:none.onnx", {"multiple_px": 0})
