"""`metamerlab warp` from the command line to the picture, and every mistake on the way."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from command_line import outcome_of, refusal_of
from PIL import Image

from pipeline.frame import SourceFrame
from pipeline.methods.registry import METHODS
from pipeline.named_classes import Choice
from pipeline.pictures.colour_file import load_colour, save_colour
from pipeline.pictures.decode import read_pixels
from pipeline.pictures.warp_input import WarpInput, save_warp_input
from pipeline.pictures.write import write_pixels
from stimuli.warp.one_frame import warp_and_fill
from stimuli.warp.warp_steps import metameric_steps

HEIGHT, WIDTH = 48, 64
CPU_METHODS = ["telea", "navier-stokes", "oiio-push-pull", "background-extension"]
run = outcome_of("warp")
refusal = refusal_of("warp")


@pytest.fixture
def frame(rng) -> WarpInput:
    """A square at 2 m before a wall at 4 m; the square moves 6 px to the left."""
    colour = rng.uniform(0.3, 0.6, (HEIGHT, WIDTH, 3)).astype(np.float32)
    depth_m = np.full((HEIGHT, WIDTH), 4.0, np.float32)
    depth_m[12:36, 24:48] = 2.0
    flow_px = np.zeros((HEIGHT, WIDTH, 2), np.float32)
    flow_px[12:36, 24:48, 0] = -6.0
    return WarpInput(SourceFrame(colour, depth_m), flow_px)


@pytest.fixture
def exr(tmp_path, frame):
    save_warp_input(tmp_path / "frame.exr", frame)
    return tmp_path / "frame.exr"


@pytest.fixture
def stereo(tmp_path, frame):
    """The same scene as a pair with integer disparity; the holes of the right view are made up."""
    save_colour(tmp_path / "left.png", frame.source.colour)
    right = np.roll(frame.source.colour, -2, axis=1)
    right[12:36, 16:40] = frame.source.colour[12:36, 24:48]
    save_colour(tmp_path / "right.png", right)
    disparity = np.where(frame.source.depth_m == 2.0, 32, 8).astype(np.uint8)
    write_pixels(tmp_path / "disparity.png", disparity[..., None], "Y")
    return tmp_path


@pytest.mark.usefixtures("gl_context")
def test_only_what_is_asked_for_is_written(exr, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run(exr, "--compare", "sheet.png", "-m", "telea", "-m", "navier-stokes")
    assert {path.name for path in tmp_path.iterdir()} == {"frame.exr", "sheet.png"}
    run(exr, "-m", "telea")
    assert {path.name for path in tmp_path.iterdir()} == {"frame.exr", "sheet.png", "filled.png"}


@pytest.mark.usefixtures("gl_context")
def test_a_frame_from_a_file_is_warped_and_filled(exr, frame, tmp_path):
    out = tmp_path / "out.png"
    _, said, _ = run(exr, out, "--method", "telea")

    filled = load_colour(out)
    shown = np.rint(255 * frame.source.colour) / 255
    assert "% of the frame" in said
    np.testing.assert_allclose(filled[13:35, 19:41], shown[13:35, 25:47], atol=1e-6)
    np.testing.assert_allclose(filled[:11], shown[:11], atol=1e-6)


@pytest.mark.slow
@pytest.mark.usefixtures("gl_context")
def test_motorcycle_is_built_in_and_measured_against_the_other_photograph(tmp_path):
    _, said, _ = run("motorcycle", tmp_path / "out.png", "-m", "background-extension")

    assert "741 x 500 px" in said
    assert "PSNR" in said
    assert load_colour(tmp_path / "out.png").shape == (500, 741, 3)


@pytest.mark.usefixtures("gl_context")
def test_a_stereo_pair_is_moved_by_its_disparity(stereo):
    """The wall moves 2 px left, the square 8: its left edge from 24 to 16."""
    _, said, _ = run(
        stereo / "left.png",
        stereo / "out.png",
        *("-m", "telea", "--disparity", stereo / "disparity.png", "--units-per-px", 4),
        *("--right", stereo / "right.png"),
    )

    left, filled = load_colour(stereo / "left.png"), load_colour(stereo / "out.png")
    assert "PSNR" in said
    np.testing.assert_allclose(filled[13:35, 17:39], left[13:35, 25:47], atol=1e-6)
    np.testing.assert_allclose(filled[:11, :-3], left[:11, 2:-1], atol=1e-6)


@pytest.fixture
def photographs(tmp_path):
    """A light square before a dark wall, as a camera sees it: its outline is half of each.

    The disparity gives the mixed columns 23 and 48 to the wall.
    """
    grey = np.full((HEIGHT, WIDTH), 0.2, np.float32)
    grey[12:36, 24:48] = 0.9
    grey[12:36, [23, 48]] = 0.55
    save_colour(tmp_path / "left.png", np.repeat(grey[..., None], 3, axis=2))
    disparity = np.full((HEIGHT, WIDTH), 2, np.uint8)
    disparity[12:36, 24:48] = 8
    write_pixels(tmp_path / "disparity.png", disparity[..., None], "Y")
    return tmp_path


@pytest.mark.usefixtures("gl_context")
def test_a_pair_of_photographs_leaves_no_ghost_of_an_outline(photographs):
    """By hand: the square's right end goes from 47 to 39, its mixed column 48 to 46.

    Between them opens the hole, columns 40 to 45. Pixels inside it are the wall's.
    """
    shown = {}
    for rim_px in (None, 0, 1, 2):
        out = photographs / f"{rim_px}.png"
        _, said, _ = run(
            photographs / "left.png",
            out,
            *("-m", "push-pull-depth", "--disparity", photographs / "disparity.png"),
            *("--steps", photographs / "steps", "--compare", photographs / "sheet.png"),
            *(() if rim_px is None else ("--rim-px", rim_px)),
        )
        assert ("with a rim of" in said) == (rim_px != 0)
        mask = read_pixels(photographs / "steps" / "04-hole.png").data[20, :-2, 0] > 0
        sheet = (photographs / "sheet.png").read_bytes()
        shown[rim_px] = out.read_bytes(), load_colour(out)[20, :, 0], np.flatnonzero(mask), sheet

    holes = {rim_px: found[2].tolist() for rim_px, found in shown.items()}
    assert holes[0] == [40, 41, 42, 43, 44, 45]
    assert holes[1] == [*holes[0], 46]
    assert holes[2] == [*holes[1], 47]
    ghost, filled = shown[0][1], shown[1][1]
    assert ghost[46] == pytest.approx(0.55, abs=0.003)
    assert filled[42:48].max() < 0.25
    np.testing.assert_array_equal(filled[17:39], ghost[17:39])  # the square is as it was
    assert shown[None][0] == shown[1][0]
    assert shown[None][3] == shown[1][3] != shown[0][3]


@pytest.mark.usefixtures("gl_context")
def test_an_outlier_of_depth_is_mended_in_a_pair_and_said(photographs):
    """A pixel of the wall whose disparity is 30 px would tear a hole and be drawn elsewhere."""
    shown = {}
    for outlier, more in ((2, ()), (30, ()), (30, ("--no-depth-speckle",))):
        disparity = np.full((HEIGHT, WIDTH), 2, np.uint8)
        disparity[12:36, 24:48] = 8
        disparity[6, 50] = outlier
        write_pixels(photographs / "disparity.png", disparity[..., None], "Y")
        out = photographs / "filled.png"
        _, said, _ = run(
            photographs / "left.png",
            out,
            *("-m", "push-pull-depth", "--disparity", photographs / "disparity.png", *more),
        )
        holes = said.partition("holes ")[2].partition(" %")[0]
        shown[outlier, more] = out.read_bytes(), holes, "depth mended: 1 px" in said

    clean, mended, torn = shown.values()
    assert (clean[2], mended[2], torn[2]) == (False, True, False)
    assert clean[:2] == mended[:2]
    assert torn[1] != mended[1]


@pytest.mark.usefixtures("gl_context")
def test_a_file_has_no_rim_unless_it_is_asked_for(exr, tmp_path):
    pixels, said = {}, {}
    for rim_px in (None, 0, 1):
        out = tmp_path / f"{rim_px}.png"
        more = () if rim_px is None else ("--rim-px", rim_px)
        _, said[rim_px], _ = run(exr, out, "-m", "push-pull-depth", *more)
        pixels[rim_px] = out.read_bytes()

    assert pixels[None] == pixels[0] != pixels[1]
    assert "with a rim of 1 px" in said[1]
    assert "with a rim" not in said[None]


@pytest.fixture
def masked(tmp_path):
    """A striped picture, and a mask with a block of 10 x 6 px."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    grey = 0.5 + 0.3 * np.sin(0.7 * x + 0.4 * y)[..., None] * (1, 0.8, 0.6)
    save_colour(tmp_path / "photo.png", grey.astype(np.float32))
    mask = np.zeros((HEIGHT, WIDTH, 1), np.uint8)
    mask[20:26, 30:40] = 255
    write_pixels(tmp_path / "mask.png", mask, "Y")
    return tmp_path


@pytest.mark.usefixtures("gl_context")
def test_a_masked_picture_is_filled_where_the_mask_is_white_and_stays_elsewhere(masked):
    """By every method, against the picture itself; OpenCV's one call is one of them."""
    every = [entry.name for entry in METHODS if not entry.takes_path]
    _, said, _ = run(
        masked / "photo.png",
        masked / "out.png",
        *("--mask", masked / "mask.png", "--truth", masked / "photo.png"),
        *("--compare", masked / "sheet.png"),
        *(word for name in every for word in ("-m", name)),
    )

    assert "holes 1.95 % of the frame" in said  # 60 of 64 x 48
    assert all(name in said for name in every)
    before, after = (read_pixels(masked / name).data for name in ("photo.png", "out.png"))
    changed = (before != after).any(axis=-1)
    assert changed[20:26, 30:40].mean() > 0.9
    changed[20:26, 30:40] = False
    assert not changed.any()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--mask", "{folder}/black.png"], "black elsewhere (all of it is black)"),
        (["--mask", "{folder}/white.png"], "black elsewhere (all of it is white); paint black"),
        (["--mask", "{folder}/grey.png"], "(all of it is at least 60 % of white); paint black"),
        (["--mask", "{folder}/small.png"], "must be as large as"),
        (["--mask", "{folder}/none.png"], "none.png"),
        (["--mask", "{folder}/mask.png", "--amount", "0.5"], "fills a picture as it is"),
        (["--mask", "{folder}/mask.png", "--parallax", "0.1"], "fills a picture as it is"),
        (["--mask", "{folder}/mask.png", "--rim-px", "1"], "leave out --rim-px"),
    ],
)
def test_a_mask_that_does_not_fit_is_refused(masked, arguments, said):
    write_pixels(masked / "black.png", np.zeros((HEIGHT, WIDTH, 1), np.uint8), "Y")
    write_pixels(masked / "white.png", np.full((HEIGHT, WIDTH, 1), 255, np.uint8), "Y")
    write_pixels(masked / "grey.png", np.full((HEIGHT, WIDTH, 1), 153, np.uint8), "Y")
    write_pixels(masked / "small.png", np.full((HEIGHT // 2, WIDTH // 2, 1), 255, np.uint8), "Y")

    message = refusal(
        masked / "photo.png", masked / "out.png", *(a.format(folder=masked) for a in arguments)
    )

    assert said in message
    assert not (masked / "out.png").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--mask", "{folder}/mask.png"], "--mask needs a picture file in its place"),
        (["--flow", "{folder}/f.flo"], "--flow, --depth, cameras and poses need a picture file"),
        (["--depth", "{folder}/d.png"], "--flow, --depth, cameras and poses need a picture file"),
    ],
)
def test_what_belongs_to_a_picture_does_not_go_with_a_built_in_pair(masked, options, said):
    options = [word.format(folder=masked) for word in options]
    message = refusal("motorcycle", masked / "out.png", *options)
    assert message.startswith(
        "error: motorcycle: is a built-in pair, whose disparity makes its holes"
    )
    assert said in message


@pytest.mark.parametrize("kind", ["depth", "disparity"])
@pytest.mark.parametrize("missing", [math.nan, 0])
def test_depth_and_disparity_of_which_nothing_is_known_are_named_as_what_they_are(
    masked, kind, missing
):
    empty = np.full((HEIGHT, WIDTH), missing, np.float32 if math.isnan(missing) else np.uint16)
    np.save(masked / "empty.npy", empty)
    message = refusal(masked / "photo.png", masked / "out.png", f"--{kind}", masked / "empty.npy")
    assert message.startswith(
        f"error: {masked / 'empty.npy'}: {kind} must be known for at least one pixel"
    )


def test_a_parameter_out_of_its_range_is_refused_before_anything_is_read(masked):
    for words, said in (
        (("metameric", "--set", "levels=-3"), "levels must lie in 1..6 (got -3)"),
        (("coherence-transport", "--set", "gaze_x_deg=3"), "needs fovea_deg above 0"),
    ):
        message = refusal(masked / "none.png", masked / "out.png", "-m", *words)
        assert said in message


@pytest.mark.usefixtures("gl_context")
def test_half_the_amount_moves_half_as_far_and_has_no_truth(stereo):
    _, said, _ = run(
        stereo / "left.png",
        stereo / "out.png",
        *("-m", "telea", "--disparity", stereo / "disparity.png", "--units-per-px", 4),
        *("--right", stereo / "right.png", "--amount", 0.5),
        status=None,
    )

    left, filled = load_colour(stereo / "left.png"), load_colour(stereo / "out.png")
    assert "PSNR" not in said
    np.testing.assert_allclose(filled[13:35, 21:43], left[13:35, 25:47], atol=1e-6)


@pytest.mark.usefixtures("gl_context")
def test_a_comparison_shows_every_method(exr, tmp_path):
    sheet = tmp_path / "sheet.png"
    methods = [part for name in CPU_METHODS for part in ("-m", name)]
    _, said, _ = run(exr, tmp_path / "out.png", "--compare", sheet, *methods)

    assert f"wrote {sheet} (4 methods)" in said
    assert read_pixels(sheet).data.shape[1] > 3 * 320  # three columns of enlarged tiles


@pytest.mark.usefixtures("gl_context")
def test_a_comparison_without_methods_takes_all_of_them(exr, tmp_path):
    _, said, _ = run(exr, tmp_path / "out.png", "--compare", tmp_path / "sheet.png", status=None)

    every = [entry.name for entry in METHODS if not entry.takes_path]
    assert f"({len(every)} methods)" in said


@pytest.mark.usefixtures("gl_context")
def test_steps_are_written_as_pictures(exr, tmp_path):
    folder = tmp_path / "steps"
    _, _, _ = run(exr, tmp_path / "out.png", "-m", "telea", "--steps", folder)

    names = sorted(path.name for path in folder.glob("*.png"))
    assert names == [
        "00-source.png",
        "01-source-depth.png",
        "02-source-flow.png",
        "03-warped.png",
        "04-hole.png",
        "05-warped-depth.png",
        "06-warped-flow.png",
        "07-filled-telea.png",
        "sheet.png",
    ]
    mask = read_pixels(folder / "04-hole.png").data[..., 0]
    assert set(np.unique(mask)) == {0, 255}
    assert (mask[13:35, 43:47] == 255).all()  # uncovered, between quads torn at either side
    assert (mask[:11] == 0).all()


def test_metameric_steps_show_bands_moments_and_noise(gl_context, frame):
    warped, _ = warp_and_fill(gl_context, frame, [])
    steps = {name: picture for name, _, picture in metameric_steps(warped, {"levels": 2}, 0)}

    assert set(steps) == {"base", "noise"} | {
        f"level{level}-{what}"
        for level in (0, 1)
        for what in ("bands", "valid", "mean", "deviation", "amplitude", "noise")
    }
    assert steps["level0-valid"].shape == (HEIGHT, WIDTH, 3)
    assert steps["level1-valid"].shape == (HEIGHT // 2, WIDTH // 2, 3)
    # Noise is added in the hole only: mid grey elsewhere.
    assert (steps["noise"][~warped.hole] == 128).all()
    assert (steps["noise"][warped.hole] != 128).any()


def test_list_names_every_method_without_a_source():
    _, said, _ = run("--list")

    for entry in METHODS:
        assert entry.shown_name in said


# --- mistakes ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["-m", "tela"], "did you mean 'telea'"),
        (
            ["-m", "shift-map"],
            "'coherence-transport' replaces it; for its own fills install revision",
        ),
        (
            ["--set", "texture=background"],
            "parameter 'texture' of metameric has left metamerlab, and metameric always fills with",
        ),
        (["-m", "telea", "-m", "navier-stokes"], "add --compare"),
        (["-m", "telea", "--set", "radius"], "must be name=value"),
        (["-m", "telea", "--amount", "0.5"], "options of stereo pairs"),
        (["-m", "telea", "--focal-px", "900"], "options of stereo pairs"),
        (["-m", "telea", "--disparity", "d.png", "--clip"], "belong to files of colour"),
        (["-m", "telea", "--rim-px", "5"], "rim_px must be a whole number from 0 to 4 (got 5)"),
        (["-m", "telea", "--rim-px", "-1"], "rim_px must be a whole number from 0 to 4 (got -1)"),
    ],
)
def test_wrong_options_are_refused_before_any_work(exr, tmp_path, arguments, said):
    assert said in refusal(exr, tmp_path / "out.png", *arguments)
    assert not (tmp_path / "out.png").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["{stereo}/left.png"], "OUT: {stereo}/left.png is read by this command"),
        (["o.png", "--compare", "{stereo}/left.png"], "--compare: {stereo}/left.png is read"),
        (["o.png", "--compare", "{stereo}/right.png"], "--compare: {stereo}/right.png is read"),
        (["o.png", "--steps", "{stereo}"], "{stereo}: holds what this command reads"),
        (["o.png", "--steps", "others"], "others: must be empty or new (it holds"),
        (["o.png", "--compare", "s.png", "--steps", "s.png"], "must be a folder or a file"),
    ],
)
def test_what_is_read_is_never_written_over(stereo, tmp_path, monkeypatch, options, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "others").mkdir()
    (tmp_path / "others" / "sheet.png").write_bytes(b"somebody's")
    before = {path: path.read_bytes() for path in stereo.rglob("*.*")}
    given = [option.format(stereo=stereo) for option in options]
    pair = ("--disparity", stereo / "disparity.png", "--right", stereo / "right.png")

    assert said.format(stereo=stereo) in refusal(
        stereo / "left.png", *given, *pair, "--units-per-px", 4
    )
    assert {path: path.read_bytes() for path in stereo.rglob("*.*")} == before


def test_a_photograph_that_is_stored_turned_is_refused(stereo, tmp_path):
    """Its map would be laid over it the wrong way."""
    picture = Image.open(stereo / "left.png")
    exif = picture.getexif()
    exif[0x0112] = 3
    picture.save(tmp_path / "turned.jpg", exif=exif)

    assert "must be stored upright (its Exif orientation is 3)" in refusal(
        tmp_path / "turned.jpg", tmp_path / "o.png", "--disparity", stereo / "disparity.png"
    )


@pytest.mark.parametrize(
    "options", [["--focal-px", "nan"], ["--baseline-m", "-5"], ["--offset-px", "3"]]
)
def test_a_built_in_pair_takes_no_cameras_of_ones_own(tmp_path, options):
    said = refusal("motorcycle", tmp_path / "out.png", "-m", "telea", *options)

    assert "motorcycle: brings its own disparity" in said


@pytest.mark.parametrize(
    ("out", "said"),
    [
        ("out.jpg", "must end in .png or .exr"),
        ("frame.exr/out.png", "frame.exr is a file"),
        ("folder.png", "must be a file, and is a folder"),
    ],
)
def test_an_output_that_cannot_be_written_is_refused_before_any_work(exr, tmp_path, out, said):
    (tmp_path / "folder.png").mkdir()

    assert said in refusal(exr, tmp_path / out, "-m", "telea")


@pytest.mark.usefixtures("gl_context")
def test_unknown_and_impossible_parameters_are_refused(exr, tmp_path):
    out = tmp_path / "out.png"

    assert "did you mean 'radius_px'" in refusal(exr, out, "-m", "telea", "--set", "radius=3")
    assert "must lie in" in refusal(exr, out, "-m", "telea", "--set", "radius_px=0")
    assert "must be int or float" in refusal(exr, out, "-m", "telea", "--set", "radius_px=wide")
    assert not out.exists()


@pytest.mark.slow
def test_without_opengl_it_is_said_and_numpy_works(exr, tmp_path):
    """In a process of its own, where EGL finds no driver."""
    code = "from study_app.cli import main; main()"
    command = [sys.executable, "-c", code, "warp", exr, tmp_path / "out.png", "-m", "telea"]
    env = {**os.environ, "__EGL_VENDOR_LIBRARY_DIRS": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, env=env)

    assert done.returncode == 0, done.stderr
    assert "'metamerlab doctor' says why" in done.stdout
    assert (tmp_path / "out.png").stat().st_size > 0


@pytest.mark.parametrize("name", ["nowhere.exr", "nowhere"])
def test_a_missing_source_is_refused(tmp_path, name):
    said = refusal(tmp_path / name, tmp_path / "out.png", "-m", "telea")

    assert "no such file" in said
    assert name in said


def test_a_source_that_is_no_frame_is_refused(tmp_path, stereo):
    (tmp_path / "text.exr").write_text("not an image")
    out = tmp_path / "out.png"

    assert "must be an image" in refusal(tmp_path / "text.exr", out, "-m", "telea")
    assert "come with --disparity" in refusal(stereo / "left.png", out, "-m", "telea")
    assert not out.exists()


def test_a_cut_file_is_refused(exr, tmp_path):
    exr.write_bytes(exr.read_bytes()[:2000])

    assert "must be" in refusal(exr, tmp_path / "out.png", "-m", "telea")


@pytest.mark.parametrize(
    ("channel", "value", "said"),
    [
        ("R", np.nan, "colour must be finite"),
        ("Z", 0.0, "depth must be greater than 0"),
        ("flow.x", np.nan, "flow must be finite"),
    ],
)
def test_bad_values_are_refused_and_nothing_is_written(tmp_path, rng, channel, value, said):
    names = ("R", "G", "B", "Z", "flow.x", "flow.y")
    data = rng.uniform(0.1, 0.9, (8, 8, 6)).astype(np.float32)
    data[3, 4, names.index(channel)] = value
    write_pixels(tmp_path / "bad.exr", data, names)

    message = refusal(tmp_path / "bad.exr", tmp_path / "out.png", "-m", "telea")

    assert said in message
    assert "row 3, column 4" in message
    assert not (tmp_path / "out.png").exists()


def test_pairs_whose_sizes_differ_are_refused(stereo):
    save_colour(stereo / "small.png", np.zeros((4, 4, 3), np.float32))
    rest = (stereo / "out.png", "-m", "telea", "--disparity", stereo / "disparity.png")

    assert "must be as large as" in refusal(stereo / "small.png", *rest)
    for option in ("--right", "--truth"):
        assert "small.png: must be as large as" in refusal(
            stereo / "left.png", *rest, option, stereo / "small.png"
        )


def test_bright_light_is_refused_or_clipped_when_asked(gl_context, tmp_path, rng):
    data = rng.uniform(0.1, 0.9, (16, 16, 6)).astype(np.float32)
    data[3, 4, 0] = 5.0
    data[..., 4:] = 0
    write_pixels(tmp_path / "hdr.exr", data, ("R", "G", "B", "Z", "flow.x", "flow.y"))
    arguments = (tmp_path / "hdr.exr", tmp_path / "out.png", "-m", "telea")

    assert "lower the exposure, or allow clipping" in refusal(*arguments)
    assert run(*arguments, "--clip", status=None)[0] == 0
    assert gl_context is not None


@pytest.mark.usefixtures("gl_context")
def test_channels_and_encoded_colour_can_be_told(tmp_path):
    """Encoded 0.5 is 128 of 255; the same number taken as linear light is 188."""
    data = np.zeros((16, 16, 6), np.float32)
    data[..., :3], data[..., 3] = 0.5, 2.0
    write_pixels(tmp_path / "own.exr", data, ("R", "G", "B", "far", "move.x", "move.y"))
    told = ["depth=far", "flow_x=move.x", "flow_y=move.y"]
    arguments = [tmp_path / "own.exr", tmp_path / "out.png", "-m", "telea"]
    named = [part for name in told for part in ("--channel", name)]

    assert "must have a channel Z" in refusal(*arguments)
    assert "did you mean 'depth'" in refusal(*arguments, "--channel", "deep=far")
    for more, value in (([], 188), (["--encoded"], 128)):
        assert run(*arguments, *named, *more, status=None)[0] == 0
        assert (read_pixels(tmp_path / "out.png").data == value).all()


@pytest.mark.usefixtures("gl_context")
def test_a_frame_that_leaves_the_view_whole_is_refused(tmp_path):
    """Every pixel becomes a hole: from nothing, nothing can be filled."""
    gone = WarpInput(
        SourceFrame(np.full((8, 8, 3), 0.5, np.float32), np.ones((8, 8), np.float32)),
        np.full((8, 8, 2), 100.0, np.float32),
    )
    save_warp_input(tmp_path / "gone.exr", gone)

    said = refusal(tmp_path / "gone.exr", tmp_path / "out.png", "-m", "telea")

    assert "at least one known pixel" in said
    assert not (tmp_path / "out.png").exists()


@pytest.mark.usefixtures("gl_context")
@pytest.mark.parametrize("seed", [-1, 1.5, "one"])
def test_a_seed_is_a_whole_number_from_0(exr, tmp_path, seed):
    _, _, said = run(exr, tmp_path / "out.png", "-m", "telea", "--seed", seed, status=2)

    assert "--seed" in said


@pytest.mark.usefixtures("gl_context")
@pytest.mark.parametrize("name", ["telea", "metameric"])
def test_a_seed_too_long_is_refused(exr, tmp_path, name):
    said = refusal(exr, tmp_path / "out.png", "-m", name, "--seed", 2**63)

    assert "seed must be a whole number from 0 to 2**63 - 1" in said
    assert not (tmp_path / "out.png").exists()


@pytest.mark.usefixtures("gl_context")
@pytest.mark.parametrize(
    "cut", [np.s_[:1, :1], np.s_[12:13, :], np.s_[:, 24:25]], ids=["pixel", "row", "column"]
)
@pytest.mark.parametrize("name", ["metameric", "push-pull-depth", "push-pull", *CPU_METHODS])
def test_frames_of_one_pixel_and_one_line_are_filled(tmp_path, frame, name, cut):
    """The row and the column have holes; the one pixel rests, for it cannot be all holes."""
    small = WarpInput(
        SourceFrame(frame.source.colour[cut].copy(), frame.source.depth_m[cut].copy()),
        frame.flow_px[cut].copy(),
    )
    save_warp_input(tmp_path / "small.exr", small)

    run(tmp_path / "small.exr", tmp_path / "out.png", "-m", name)

    assert load_colour(tmp_path / "out.png").shape == small.source.colour.shape


@pytest.mark.usefixtures("gl_context")
def test_a_frame_all_at_infinity_is_filled_and_shown_in_steps(tmp_path, frame):
    sky = WarpInput(
        SourceFrame(frame.source.colour, np.full_like(frame.source.depth_m, np.inf)), frame.flow_px
    )
    save_warp_input(tmp_path / "sky.exr", sky)

    run(
        tmp_path / "sky.exr", tmp_path / "out.png", "-m", "metameric", "--steps", tmp_path / "steps"
    )

    assert (load_colour(next((tmp_path / "steps").glob("*source-depth*.png"))) == 0).all()


@pytest.mark.parametrize("choice", [Choice("telea"), Choice("telea", {"radius_px": 5})])
def test_a_choice_names_its_parameters(choice):
    assert choice.label.startswith("telea")
    assert ("radius_px 5" in choice.label) == bool(choice.parameters)
