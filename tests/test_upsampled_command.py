"""`metamerlab warp --true-within`: the true view around the gaze, and the sheet of it."""

import numpy as np
import pytest
from command_line import result_of

from pipeline.errors import InputError
from pipeline.foveation.conditions import foveate
from pipeline.foveation.geometry import Flat, eccentricity_deg, pixel_centres
from pipeline.foveation.two_rates import TwoRates, coarsened
from pipeline.frame import SourceFrame
from pipeline.pictures.colour_file import load_colour, save_colour
from pipeline.pictures.decode import read_pixels
from pipeline.pictures.warp_input import WarpInput, save_warp_input
from stimuli.warp.upsampled import DOT, FRAMES, crops_of

HEIGHT, WIDTH = 72, 96
GAZE = (30.0, 40.0)
run = result_of("warp", catch_exceptions=False)


@pytest.fixture
def given(tmp_path, rng):
    """A square before a wall that moves to the left, and a true view that the warp cannot know."""
    colour = rng.uniform(0.3, 0.6, (HEIGHT, WIDTH, 3)).astype(np.float32)
    depth_m = np.full((HEIGHT, WIDTH), 4.0, np.float32)
    depth_m[12:60, 24:72] = 2.0
    flow_px = np.zeros((HEIGHT, WIDTH, 2), np.float32)
    flow_px[12:60, 24:72, 0] = -10.0
    save_warp_input(tmp_path / "frame.exr", WarpInput(SourceFrame(colour, depth_m), flow_px))
    truth = colour.copy()
    truth[12:60, 14:62] = colour[12:60, 24:72]
    truth[12:60, 62:72] = rng.uniform(0, 1, (48, 10, 3))
    save_colour(tmp_path / "truth.png", truth)
    return tmp_path


@pytest.mark.usefixtures("gl_context")
def test_the_true_view_is_shown_at_the_gaze_and_the_fill_beyond(given):
    common = [given / "frame.exr", given / "out.png", "--truth", given / "truth.png", "-m"]
    run(*common, "telea")
    plain, truth = (load_colour(given / name) for name in ("out.png", "truth.png"))
    sheet = given / "sheet.png"
    options = ["--true-within", 6, "--gaze", "30,40", "--fov", 30, "--compare", sheet]
    done = run(*common, "telea", "-m", "navier-stokes", *options)

    assert "inside holes where nothing of the true view is shown" in done.output
    geometry = Flat(30.0).of(WIDTH, HEIGHT)
    away = eccentricity_deg(geometry, GAZE, *pixel_centres(geometry))
    shown = load_colour(given / "out.png")
    assert np.array_equal(shown[away < 5.99], truth[away < 5.99])
    assert np.array_equal(shown[away > 7.01], plain[away > 7.01])
    drawn = np.asarray(read_pixels(sheet).data)
    # A dot and a frame of the fovea in each of four tiles.
    for colour in {DOT, *FRAMES}:
        assert (drawn == colour).all(axis=-1).sum() >= 4 * 20


@pytest.mark.usefixtures("gl_context")
def test_the_periphery_is_shown_coarser_and_by_a_condition(given):
    common = [given / "frame.exr", given / "out.png", "--truth", given / "truth.png", "-m", "telea"]
    run(*common)
    plain, truth = (load_colour(given / name) for name in ("out.png", "truth.png"))
    options = ["--true-within", 4, "--gaze", "30,40", "--fov", 30, "--coarser", 2, "--seed", 3]
    geometry = Flat(30.0).of(WIDTH, HEIGHT)
    away = eccentricity_deg(geometry, GAZE, *pixel_centres(geometry))[..., None]
    for condition in (None, "blur"):
        run(*common, *options, *(["--condition", condition] if condition else []))
        shown = load_colour(given / "out.png")
        wanted = coarsened(plain, 2)
        if condition:
            wanted = foveate(wanted, GAZE, viewing=Flat(30.0), method=condition, seed=3)
        assert np.array_equal(shown[away[..., 0] < 3.99], truth[away[..., 0] < 3.99])
        assert np.abs(shown - wanted).max(where=away > 5.01, initial=0) < 1.01 / 255


@pytest.mark.usefixtures("gl_context")
def test_a_gaze_says_where_coherence_transport_works(given):
    """By hand: the gaze's degrees, of a picture 30 degrees wide."""
    out = {}
    for name, options in (
        ("push-pull-depth", ()),
        ("coherence-transport", ()),
        ("gazed", ("--set", "fovea_deg=4", "--gaze", "66,36", "--fov", 30)),
    ):
        method = "coherence-transport" if name == "gazed" else name
        done = run(given / "frame.exr", given / f"{name}.png", "-m", method, *options)
        out[name] = load_colour(given / f"{name}.png")
    assert "gaze: 66.0, 36.0 px" in done.output
    geometry = Flat(30.0).of(WIDTH, HEIGHT)
    away = eccentricity_deg(geometry, (66.0, 36.0), *pixel_centres(geometry))
    plain, whole, found = (
        out[name] for name in ("push-pull-depth", "coherence-transport", "gazed")
    )
    assert np.array_equal(found[away > 5.01], plain[away > 5.01])
    # Noise is fitted to the surroundings, which lie beyond the border, too.
    assert np.abs(found - whole)[away < 3.99].max() < 1.01 / 255
    assert (plain != whole)[away < 3.99].any()
    assert (plain != whole)[away > 5.01].any()


def test_crops_lie_at_the_gaze_and_where_the_periphery_differs_most(rng):
    one = rng.integers(0, 255, (90, 120, 3), np.uint8)
    other = one.copy()
    other[60:72, 90:105] ^= 128  # far from the gaze
    other[20:35, 20:40] = 255 - other[20:35, 20:40]  # near it: not looked for
    away = TwoRates(Flat(40.0).of(120, 90), (30.0, 27.0), 6).share[..., 0] == 0
    fovea, first, _ = crops_of([one, other], away, (30.0, 27.0))

    assert (fovea.x + fovea.width / 2, fovea.y + fovea.height / 2) == pytest.approx((30, 27), abs=1)
    assert first.x <= 90 <= first.x + first.width
    assert first.y <= 60 <= first.y + first.height
    corner, *_ = crops_of([one, other], away, (0.0, 0.0))
    assert (corner.x, corner.y) == (0, 0)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--true-within", "5"], "--true-within needs the true view: give --truth"),
        (["--coarser", "2"], "--coarser and --condition say what lies around the true view"),
        (
            ["--truth", "TRUTH", "--true-within", "5", "--condition", "blurr"],
            "did you mean 'blur'?",
        ),
        (["--gaze", "3,4"], "--gaze says where the true view is shown, or where coherence"),
        (
            ["-m", "coherence-transport", "--set", "fovea_deg=5", "--set", "gaze_x_deg=1"],
            "say gaze_x_deg: use them, and leave it out of --set",
        ),
        (["--set", "fovea_deg=5"], "parameters of telea are: radius_px (got 'fovea_deg')"),
        (["--truth", "TRUTH", "--true-within", "5", "--gaze=-3,4"], "must lie on the picture"),
        (["--truth", "TRUTH", "--true-within", "0"], "between 0 and 90 degrees (got 0)"),
        (["--truth", "TRUTH", "--true-within", "nan"], "between 0 and 90 degrees (got nan)"),
    ],
)
def test_what_contradicts_itself_is_refused_before_any_work(given, options, said):
    words = [str(given / "truth.png") if word == "TRUTH" else word for word in options]
    method = () if "-m" in words else ("-m", "telea")
    done = run(given / "frame.exr", given / "out.png", *method, *words, status=2)
    assert said in " ".join(done.stderr.split())
    assert not (given / "out.png").exists()


def test_a_true_view_needs_a_gaze_on_the_picture():
    with pytest.raises(InputError, match=r"got 100, 5"):
        TwoRates(Flat(40.0).of(100, 80), (100.0, 5.0), 5)
