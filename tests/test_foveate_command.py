"""`metamerlab foveate` from the command line to the picture, and every mistake on the way."""

from types import SimpleNamespace

import numpy as np
import pytest
from command_line import metamerlab, outcome_of, refusal_of
from PIL import Image

from pipeline.errors import InputError
from pipeline.foveation.conditions import CONDITIONS, foveate
from pipeline.foveation.geometry import Equirectangular, Flat
from pipeline.named_classes import Choice
from pipeline.pictures import colour_file
from pipeline.pictures.colour_file import PictureReading, load_colour, read_any, save_colour
from pipeline.pictures.decode import read_pixels
from pipeline.pictures.write import write_pixels
from protocols.display import Display
from stimuli.foveate.condition_sheet import _named, draw_pools, ring_eccentricities, usual_choices
from stimuli.foveate.foveate_files import Outputs, foveate_file
from stimuli.foveate.foveation_steps import condition_steps
from stimuli.media.frames_folder import Reporter
from stimuli.media.gaze_and_display import StatedViewing, read_gaze, width_deg
from stimuli.media.moving import shrunk, wandering

HEIGHT, WIDTH = 48, 64
FAST = ("--numpy",)  # OpenGL has tests of its own
run = outcome_of("foveate")
refusal = refusal_of("foveate")


@pytest.fixture
def colour(rng):
    """Texture of 8-bit values, so that files keep it exactly."""
    values = rng.integers(60, 200, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    return (values / np.float32(255)).astype(np.float32)


@pytest.fixture
def png(tmp_path, colour):
    save_colour(tmp_path / "picture.png", colour)
    return tmp_path / "picture.png"


# --- what it writes ----------------------------------------------------------------------


def test_the_command_writes_what_the_python_call_returns(png, tmp_path, colour):
    out = tmp_path / "new" / "out.png"
    _, said, _ = run(png, out, "--gaze", "20,30", "--fov", 30, "--seed", 7, *FAST)

    asked = foveate(colour, (20, 30), viewing=Flat(width_deg=30), seed=7)
    assert f"wrote {out} (metamer)" in said
    np.testing.assert_array_equal(read_pixels(out).data, np.rint(255 * asked))


def test_what_is_assumed_is_said(png, tmp_path):
    _, said, _ = run(png, tmp_path / "out.png", "-m", "blur", *FAST, status=None)

    assert "field of view: 40.0 x 30.5 degrees (assumed, since neither" in said
    assert "gaze: 32.0, 24.0 px" in said


def test_the_fovea_comes_out_as_it_went_in(png, tmp_path):
    run(png, tmp_path / "out.png", "--set", "fovea_deg=8", *FAST, status=None)

    given, shown = (read_pixels(path).data for path in (png, tmp_path / "out.png"))
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    distance = 32 / np.tan(np.radians(20))
    fovea = np.hypot(x - 32, y - 24) < distance * np.tan(np.radians(8)) - 0.01
    np.testing.assert_array_equal(shown[fovea], given[fovea])
    assert (shown[~fovea] != given[~fovea]).mean() > 0.8


def test_a_seed_decides_every_byte(png, tmp_path):
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        assert run(png, tmp_path / f"{name}.png", "--seed", seed, *FAST, status=None)[0] == 0

    a, b, c = ((tmp_path / f"{name}.png").read_bytes() for name in "abc")
    assert a == b != c


def test_a_parameter_reaches_the_condition(png, tmp_path, colour):
    run(png, tmp_path / "out.png", "-m", "blur", "--parameter", "scaling=.9", *FAST, status=None)

    wide = foveate(colour, (32, 24), method="blur", scaling=0.9)
    np.testing.assert_array_equal(read_pixels(tmp_path / "out.png").data, np.rint(255 * wide))


@pytest.mark.usefixtures("gl_context")
def test_with_opengl_the_renderer_is_named(png, tmp_path):
    _, said, _ = run(png, tmp_path / "gpu.png", status=None)
    run(png, tmp_path / "numpy.png", *FAST, status=None)

    gpu, twin = (read_pixels(tmp_path / f"{n}.png").data.astype(int) for n in ("gpu", "numpy"))
    assert ("renderer: " in said) != ("worked out by numpy" in said)
    assert np.abs(gpu - twin).max() <= 1


def test_a_comparison_shows_every_condition_and_the_pools(png, tmp_path):
    sheet = tmp_path / "sheet.png"
    _, said, _ = run(png, tmp_path / "out.png", "--compare", sheet, *FAST)

    assert f"wrote {sheet} ({len(usual_choices())} conditions)" in said
    assert f"wrote {tmp_path / 'out.png'} (metamer)" in said
    tile_px = 320 + 12
    assert read_pixels(sheet).data.shape[1] == 3 * tile_px + 12


def test_a_parameter_reaches_every_condition_of_a_sheet_that_has_it(png, tmp_path):
    sheet, pair = tmp_path / "sheet.png", ("-m", "blur", "-m", "reference")
    looks = (png, tmp_path / "out.png", "--compare", sheet, *FAST)
    assert run(*looks, *pair, "--set", "fovea_deg=8", status=None)[0] == 0
    wide = read_pixels(tmp_path / "out.png").data
    assert run(*looks, *pair, status=None)[0] == 0
    assert (wide != read_pixels(tmp_path / "out.png").data).any()

    assert "did you mean 'fovea_deg'" in refusal(*looks, "--set", "fovea=8")
    assert "contrast-enhanced: strength must lie in 0..2" in refusal(*looks, "--set", "strength=4")


def test_a_sheet_leaves_out_what_takes_minutes_or_a_folder():
    names = {choice.name for choice in usual_choices()}

    assert names == {e.name for e in CONDITIONS} - {"energy-metamer", "files:"}


def test_steps_are_written_as_pictures(png, tmp_path):
    folder = tmp_path / "steps"
    _, _, _ = run(png, tmp_path / "out.png", "-m", "warped-metamer", "--steps", folder, *FAST)

    names = sorted(path.name for path in folder.glob("*.png"))
    assert names == [
        "00-picture.png",
        "01-pools.png",
        "02-eccentricity.png",
        "03-pool-width.png",
        "04-lod.png",
        "05-fade.png",
        "06-warped-metamer-displacement.png",
        "07-warped-metamer-displaced.png",
        "08-warped-metamer-match.png",
        "09-warped-metamer-change.png",
        "10-warped-metamer-shown.png",
        "sheet.png",
    ]
    np.testing.assert_array_equal(
        read_pixels(folder / "10-warped-metamer-shown.png").data,
        read_pixels(tmp_path / "out.png").data,
    )


def test_steps_of_a_metamer_show_base_deviations_and_noise(colour):
    from pipeline.foveation.conditions import create_condition
    from pipeline.foveation.pooling import Pooling, Pools

    pools = Pools(Flat().of(WIDTH, HEIGHT), (32, 24), Pooling())
    condition = create_condition("metamer", {"levels": 2})
    steps = {name: picture for name, _, picture in condition_steps(condition, colour, pools, 0)}

    assert set(steps) == {"base", "noise", "level0-deviation", "level1-deviation"}
    assert all(picture.shape == (HEIGHT, WIDTH, 3) for picture in steps.values())
    assert steps["noise"].std() > 10 > np.abs(steps["base"].mean() - 255 * colour.mean())


@pytest.mark.parametrize("ending", [".webp", ".png"])
def test_a_flip_shows_two_seeds_in_turn(png, tmp_path, ending):
    path = tmp_path / f"flip{ending}"
    code, _, _ = run(png, tmp_path / "out.png", "--flip", path, *FAST, status=None)

    with Image.open(path) as moving:
        frames = []
        for index in range(moving.n_frames):
            moving.seek(index)
            frames.append(np.asarray(moving.convert("RGB"), int))
    assert code == 0
    assert len(frames) == 2
    assert np.abs(frames[0] - frames[1]).mean() > 5
    fovea = np.abs(frames[0] - frames[1])[23:25, 31:33]
    assert fovea.max() <= (40 if ending == ".webp" else 0)  # WebP is lossy


def test_the_gaze_of_an_animation_wanders_and_comes_back(png, tmp_path):
    path = tmp_path / "gaze.webp"
    run(png, tmp_path / "out.png", "-m", "blur", "--animate", path, *FAST, status=None)

    with Image.open(path) as moving:
        assert moving.n_frames == 48
    places = np.array(wandering(Flat().of(WIDTH, HEIGHT), 48)) / (WIDTH, HEIGHT)
    steps = np.linalg.norm(np.diff(places, axis=0, append=places[:1]), axis=1)
    assert steps.max() < 0.15
    assert places.min() > 0.1
    assert places.max() < 0.9
    quarters = {(x > 0.5, y > 0.5) for x, y in places}
    assert len(quarters) == 4


def test_a_shrunk_picture_keeps_its_field_of_view(rng):
    picture = rng.random((60, 100, 3)).astype(np.float32)
    small, viewing = shrunk(picture, Flat(distance_px=200), 50)

    assert small.shape == (30, 50, 3)
    assert viewing == Flat(distance_px=100)
    around, same = shrunk(rng.random((64, 128, 3)).astype(np.float32), Equirectangular(), 51)
    assert around.shape == (26, 52, 3)
    assert same == Equirectangular()
    assert shrunk(picture, Flat(), 200)[0] is picture


def test_list_names_every_condition_and_law_without_a_picture():
    _, said, _ = run("--list")

    for name in (*(entry.shown_name for entry in CONDITIONS), "v1", "authors", "quadratic"):
        assert name in said


# --- gaze and display --------------------------------------------------------------------


def test_degrees_lie_right_of_and_below_the_middle():
    flat = StatedViewing(fov_deg=90).of((400, 600)).geometry  # 300 px away

    x, y = read_gaze("45deg,-45deg", flat)
    assert (x, y) == pytest.approx((600, -100))
    assert read_gaze("12.5,7", flat) == (12.5, 7)
    around = StatedViewing(panorama=True).of((180, 360)).geometry
    assert read_gaze("90deg,-45deg", around) == pytest.approx((270, 45))
    assert read_gaze(None, around) == (180, 90)


def test_a_display_says_how_far_the_eye_is():
    """By hand: 597.7 mm over 1920 px, seen from 700 mm: 2248.6 px away."""
    looking = StatedViewing(display="fhd27-60hz").of((1080, 1920))

    assert looking.geometry.distance_px == pytest.approx(700 * 1920 / 597.7)
    assert "46.2 x 27.0 degrees (display fhd27-60hz, pixel for pixel)" in looking.words
    assert not looking.notes
    assert "larger than the display" in StatedViewing(display="fhd27-60hz").of((1081, 100)).notes[0]


def test_a_panorama_has_no_seam(tmp_path, rng):
    save_colour(tmp_path / "around.png", rng.random((32, 64, 3)).astype(np.float32))
    for name, gaze in (("a", "0,16"), ("b", "64,16"), ("c", "-180deg,0deg")):
        out = tmp_path / f"{name}.png"
        assert (
            run(tmp_path / "around.png", out, "--panorama", "--gaze", gaze, *FAST, status=None)[0]
            == 0
        )

    a, b, c = ((tmp_path / f"{name}.png").read_bytes() for name in "abc")
    assert a == b == c


def test_a_gaze_off_the_picture_is_said(png, tmp_path):
    _, said, _ = run(png, tmp_path / "out.png", "--gaze", "-30deg,0deg", "-m", "blur", *FAST)

    assert "off the picture" in said


def test_pools_are_drawn_as_wide_as_they_are():
    """By hand: at 10 degrees, scaling .25, a pool is some 2.5 degrees wide at half maximum."""
    from pipeline.foveation.pooling import Pooling

    geometry = Flat(width_deg=40).of(400, 400)
    grey = np.full((400, 400, 3), 128, np.uint8)
    drawn, shown = draw_pools(grey, geometry, (200, 200), Pooling())
    assert shown == (2, 5, 10, 20)
    row = np.flatnonzero((drawn[200].astype(int) @ [1, 1, -2] > 200) & (np.arange(400) > 200))
    px = 200 + geometry.distance_px * np.tan(np.radians([10 - 1.24, 10 + 1.24]))
    for edge in px:
        assert np.abs(row + 0.5 - edge).min() < 1.5
    assert ring_eccentricities(Flat(width_deg=1).of(8, 8), (4, 4)) == pytest.approx(
        (0.31,), abs=0.1
    )


# --- any picture -------------------------------------------------------------------------


def test_sixteen_bits_stay_sixteen(tmp_path, rng):
    data = rng.integers(0, 65536, (16, 24, 3)).astype(np.uint16)
    write_pixels(tmp_path / "deep.png", data, ("R", "G", "B"))

    run(tmp_path / "deep.png", tmp_path / "out.png", "-m", "reference", *FAST, status=None)

    np.testing.assert_array_equal(read_pixels(tmp_path / "out.png").data, data)


@pytest.mark.parametrize("ending", [".jpg", ".tif", ".bmp", ".webp", ".png"])
def test_every_common_format_is_read(tmp_path, ending):
    flat = np.full((24, 32, 3), (200, 100, 50), np.uint8)
    Image.fromarray(flat).save(tmp_path / f"picture{ending}")

    run(tmp_path / f"picture{ending}", tmp_path / "out.png", *FAST)

    shown = read_pixels(tmp_path / "out.png").data.astype(int)
    assert np.abs(shown - flat).max() <= 4  # JPEG and WebP round


def test_grey_becomes_three_channels(tmp_path):
    Image.fromarray(np.full((9, 12), 77, np.uint8)).save(tmp_path / "grey.png")

    opened = read_any(tmp_path / "grey.png")

    assert opened.colour.shape == (9, 12, 3)
    assert (opened.colour == np.float32(77 / 255)).all()
    assert "grey" in opened.notes[0]


def test_of_an_animation_the_first_frame_is_taken_and_it_is_said(tmp_path):
    first, second = (Image.fromarray(np.full((9, 12), grey, np.uint8)) for grey in (77, 200))
    first.save(tmp_path / "moving.gif", save_all=True, append_images=[second])

    opened = read_any(tmp_path / "moving.gif")

    assert (opened.colour == np.float32(77 / 255)).all()
    assert "holds 2 pictures: the first is taken" in opened.notes


def test_transparent_pictures_stand_on_a_stated_grey(tmp_path):
    """By hand: half of red over a grey of .25."""
    data = np.zeros((4, 5, 4), np.uint8)
    data[..., 0], data[..., 3] = 255, 51  # alpha .2
    Image.fromarray(data).save(tmp_path / "clear.png")

    opened = read_any(tmp_path / "clear.png", PictureReading(background=0.25))

    np.testing.assert_allclose(opened.colour[0, 0], [0.2 + 0.2, 0.2, 0.2], atol=1e-6)
    assert "put on a grey of 0.25" in opened.notes[-1]


def test_photographs_are_turned_upright(tmp_path):
    """Orientation 6: the camera was turned, the first row is the right side."""
    data = np.zeros((16, 32, 3), np.uint8)
    data[:8] = 255
    picture = Image.fromarray(data)
    exif = picture.getexif()
    exif[0x0112] = 6
    picture.save(tmp_path / "turned.jpg", exif=exif, quality=95)

    opened = read_any(tmp_path / "turned.jpg")

    assert opened.colour.shape == (32, 16, 3)
    assert opened.colour[:, 9:].min() > 0.9
    assert opened.colour[:, :7].max() < 0.1
    assert any("upright" in note for note in opened.notes)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_every_orientation_agrees_with_pillow(tmp_path, orientation):
    from PIL import ImageOps

    data = np.zeros((16, 24, 3), np.uint8)
    data[:8, :8], data[:8, 16:], data[8:, :8] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    picture = Image.fromarray(data)
    exif = picture.getexif()
    exif[0x0112] = orientation
    picture.save(tmp_path / "turned.tif", exif=exif)

    with Image.open(tmp_path / "turned.tif") as stored:
        upright = np.asarray(ImageOps.exif_transpose(stored))
    np.testing.assert_array_equal(255 * read_any(tmp_path / "turned.tif").colour, upright)


def test_light_is_encoded_and_the_curve_is_named(tmp_path):
    """By hand: light of .2140 is half of the encoded range."""
    write_pixels(tmp_path / "light.exr", np.full((8, 8, 3), 0.21404, np.float32), ("R", "G", "B"))

    opened = read_any(tmp_path / "light.exr")

    np.testing.assert_allclose(opened.colour, 0.5, atol=1e-4)
    assert "sRGB curve" in opened.notes[0]
    assert opened.bits == 16


def test_bright_light_is_refused_with_a_cure_that_works(tmp_path):
    data = np.full((8, 8, 3), 0.5, np.float32)
    data[2, 3] = 9.0
    write_pixels(tmp_path / "sun.hdr", data, ("R", "G", "B"))
    given = (tmp_path / "sun.hdr", tmp_path / "out.png", "-m", "reference", *FAST)

    said = refusal(*given)
    stops = said.partition("--stops ")[2].split(",")[0]

    assert "must lie in 0..1" in said
    assert float(stops) == pytest.approx(-3.2)
    assert run(*given, "--stops", stops, status=None)[0] == 0
    assert run(*given, "--clip", status=None)[0] == 0
    assert load_colour(tmp_path / "out.png")[2, 3, 0] == 1


def test_a_panorama_of_light_is_exposed_by_a_percentile_and_it_is_said(tmp_path):
    light = np.full((32, 64, 3), 4.0, np.float32)
    light[:8] = 1.0
    light[0, :3] = 5000  # the sun
    write_pixels(tmp_path / "around.exr", light, ("R", "G", "B"))
    given = (tmp_path / "around.exr", tmp_path / "out.exr", "-m", "reference", *FAST)

    _, said, _ = run(*given, "--panorama")
    assert "reaches 5000: shown as with --stops -2.0 --clip" in said
    shown = read_pixels(tmp_path / "out.exr").data
    np.testing.assert_allclose(shown[[4, 20, 0], [9, 9, 0]], [[0.25] * 3, [1] * 3, [1] * 3], 1e-3)
    assert "darken it by --stops" in refusal(*given)
    assert "darken it by --stops" in refusal(*given, "--panorama", "--stops", 0)


def test_light_below_nothing_is_none_and_it_is_said(tmp_path):
    """Lossy compression leaves such light (DWA)."""
    light = np.full((32, 64, 3), 0.25, np.float32)
    light[5, 7], light[0, 0] = -0.01, 3.0
    write_pixels(tmp_path / "around.exr", light, ("R", "G", "B"))
    given = (tmp_path / "around.exr", tmp_path / "out.exr", "-m", "reference", *FAST)
    for more in (("--panorama",), ("--clip",), ("--stops", -1.6)):
        _, said, _ = run(*given, *more)
        assert "0.049 % of its light is below 0, to -0.0" in " ".join(said.split())
        assert (read_pixels(tmp_path / "out.exr").data[5, 7] == 0).all()


def test_one_lamp_does_not_make_a_panorama_black(tmp_path):
    """By hand: nearly .36 is brought to mid grey by one stop; 2.4 % of the pixels are the lamp."""
    light = np.full((64, 128, 3), 0.3599, np.float32)
    light[20:34, 40:54] = 900
    write_pixels(tmp_path / "around.exr", light, ("R", "G", "B"))
    given = (tmp_path / "around.exr", tmp_path / "out.exr", "-m", "reference", *FAST)
    _, said, _ = run(*given, "--panorama")
    said = " ".join(said.split())
    assert "shown as with --stops -1.0 --clip, by which 97.6 % of its pixels lie in 0..1" in said
    assert "most would be black" in said
    shown = read_pixels(tmp_path / "out.exr").data
    np.testing.assert_allclose(shown[0, 0], 0.18, rtol=4e-3)


def test_the_distance_is_told_from_which_a_common_screen_is_right(png, tmp_path):
    """By hand: 64 px of 25.4/96 mm are 40 degrees wide from 23.3 mm, and 8 from 121 mm."""
    for more, distance in (((), "2 cm"), (("--fov", "8"), "12 cm")):
        said = run(png, tmp_path / "out.png", *more, *FAST)[1]
        assert f"right on a common screen from {distance})" in " ".join(said.split())


def test_without_a_statement_a_monitor_is_seen_from_60_cm():
    """By hand: 512 px of .25 mm are 128 mm wide: 2 atan(64 / 600)."""
    monitor = Display(
        name="monitor", width_px=1000, height_px=800, width_mm=250, height_mm=200,
        distance_mm=600, refresh_hz=60,
    )  # fmt: skip
    looking = StatedViewing(monitor=monitor).of((512, 512))
    assert width_deg(looking.geometry) == pytest.approx(12.18, abs=0.01)
    assert "0.250 mm a pixel, from 60 cm" in looking.words
    assert width_deg(StatedViewing(fov_deg=20, monitor=monitor).of((512, 512)).geometry) == 20


def test_a_frame_of_one_pixel_is_noted(tmp_path, colour):
    plain = 0.6 + 0.1 * colour
    framed = plain.copy()
    framed[0] = framed[:, -1] = 0.02
    for name, picture in (("framed", framed), ("plain", plain), ("textured", colour)):
        save_colour(tmp_path / f"{name}.png", picture)
        _, said, _ = run(tmp_path / f"{name}.png", tmp_path / "out.png", *FAST)
        told = "its upper row, right column differs much from the next" in " ".join(said.split())
        assert told == (name == "framed")


def test_a_grey_has_a_name_or_a_number(tmp_path):
    Image.new("RGBA", (64, 48), (255, 0, 0, 0)).save(tmp_path / "clear.png")
    given = (tmp_path / "clear.png", tmp_path / "out.png", "-m", "reference", *FAST)
    for grey, value in (("white", 1.0), ("black", 0.0), ("0.2", 0.2)):
        run(*given, "--background", grey)
        np.testing.assert_allclose(load_colour(tmp_path / "out.png"), value, atol=1e-6)
    for wrong in ("whitish", "1.5", "nan"):
        assert "white, black, or a grey from 0 to 1" in refusal(*given, "--background", wrong)


# --- mistakes ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--gaze", "here"], "--gaze must be X,Y"),
        (["--gaze", "1,2,3"], "--gaze must be X,Y"),
        (["--gaze", "nan,2"], "--gaze must be X,Y"),
        (["--gaze", "5deg,2"], "--gaze must be X,Y"),
        (["--gaze", "90deg,0deg"], "within 90 degrees"),
        (["--panorama"], "must be twice as wide as high (got 64 x 48 px)"),
        (["--fov", "180"], "must lie between 0.01 and 180 degrees (got 180)"),
        (["--fov", "0"], "must lie between 0.01 and 180"),
        (["--fov", "1e-300"], "must lie between 0.01 and 180 degrees (got 1e-300)"),
        (["--fov", "nan"], "must lie between 0.01 and 180"),
        (["--display", "fhd72"], "fhd72"),
        (["--display", "fhd27-60hz", "--fov", "30"], "not both"),
        (["--panorama", "--fov", "30"], "leave --fov out"),
        (["-m", "metamere"], "did you mean 'metamer'"),
        (["-m", "metamer", "-m", "blur"], "add --compare"),
        (["-m", "blur", "--set", "scaling"], "must be name=value"),
        (["-m", "blur", "--set", "scale=1"], "did you mean 'scaling'"),
        (["-m", "blur", "--set", "scaling=-1"], "must be positive"),
        (["--stops", "1"], "for files of floats"),
        (["--encoded"], "for files of floats"),
        (["--animate", "moving.gif"], "must end in .webp"),
        (["--compare", "out.png"], "must be different files"),
        (["--seed", str(2**63)], "seed must be a whole number"),
    ],
)
def test_wrong_options_are_refused_and_nothing_is_written(
    png, tmp_path, monkeypatch, arguments, said
):
    monkeypatch.chdir(tmp_path)

    assert said in refusal(png, "out.png", *arguments, *FAST)
    assert not (tmp_path / "out.png").exists()


def test_files_that_are_no_pictures_are_refused(tmp_path):
    (tmp_path / "text.png").write_text("not a picture")
    out = tmp_path / "out.png"

    assert "must be an image" in refusal(tmp_path / "text.png", out)
    assert "no such file" in refusal(tmp_path / "gone.png", out)
    assert not out.exists()


def test_a_picture_too_large_for_opengl_is_refused_by_its_header(png, tmp_path, monkeypatch):
    small = SimpleNamespace(info={"GL_MAX_TEXTURE_SIZE": 63})
    monkeypatch.setattr(colour_file, "read_pixels", lambda _: pytest.fail("it was read"))
    cure = r"at most 63 px, as OpenGL has here \(is 64 x 48 px\); make it smaller, or add --numpy"
    with pytest.raises(InputError, match=cure):
        foveate_file(png, tmp_path / "out.png", ctx=small)


def test_avif_is_read_upright_and_what_is_not_read_is_named(tmp_path, colour):
    image, turned = Image.fromarray(np.rint(255 * colour).astype(np.uint8)), Image.Exif()
    turned[274] = 6
    image.save(tmp_path / "photo.avif", quality=100, exif=turned)
    (tmp_path / "photo.heic").write_bytes(b"\0\0\0\x18ftypheic\0\0\0\0mif1heic" + bytes(99))
    deep = (tmp_path / "photo.avif").read_bytes().replace(b"\3\10\10\10", b"\3\12\12\12")
    (tmp_path / "deep.avif").write_bytes(deep)

    _, said, _ = run(tmp_path / "photo.avif", tmp_path / "out.png", "-m", "reference", *FAST)
    assert "turned upright" in said
    shown = read_pixels(tmp_path / "out.png").data / 255
    assert np.abs(shown - np.rot90(colour, -1)).mean() < 0.1
    assert "is HEIC, which is not read" in refusal(tmp_path / "photo.heic", tmp_path / "o.png")
    assert "must have 8 bits" in refusal(tmp_path / "deep.avif", tmp_path / "o.png")


def test_avif_that_is_cut_short_or_holds_several_pictures_is_refused(tmp_path, colour):
    """Before, the first was a traceback, and of the second one picture was taken."""
    image = Image.fromarray(np.rint(255 * colour).astype(np.uint8))
    image.save(tmp_path / "photo.avif")
    whole = (tmp_path / "photo.avif").read_bytes()
    image.save(tmp_path / "two.avif", save_all=True, append_images=[image.rotate(180)])

    for bytes_left in (40, 200, len(whole) - 3):
        (tmp_path / "cut.avif").write_bytes(whole[:bytes_left])
        assert "cut.avif: must be a whole" in refusal(tmp_path / "cut.avif", tmp_path / "o.png")
    said = refusal(tmp_path / "two.avif", tmp_path / "o.png")
    assert "must hold one picture (holds 2)" in said
    assert not (tmp_path / "o.png").exists()


def test_light_that_is_no_number_is_refused(tmp_path):
    data = np.full((8, 8, 3), 0.5, np.float32)
    data[2, 3, 1] = np.nan
    write_pixels(tmp_path / "bad.exr", data, ("R", "G", "B"))

    assert "row 2, column 3" in refusal(tmp_path / "bad.exr", tmp_path / "out.png")


@pytest.mark.parametrize("choice", usual_choices(), ids=lambda choice: choice.name)
def test_a_picture_of_one_pixel_is_shown(tmp_path, choice: Choice):
    Image.fromarray(np.full((1, 1, 3), 90, np.uint8)).save(tmp_path / "dot.png")

    run(tmp_path / "dot.png", tmp_path / "out.png", "-m", choice.name, *FAST)

    assert read_pixels(tmp_path / "out.png").data.shape == (1, 1, 3)


def test_pictures_of_a_user_that_are_called_as_steps_stay_as_they_are(png, tmp_path):
    """Before, a name with a number at its front was taken for an earlier step."""
    folder = tmp_path / "steps"
    words = (png, tmp_path / "out.png", "--steps", folder, *FAST)
    folder.mkdir()
    (folder / "00-picture.png").write_bytes(b"mine")

    _, _, said = run(*words, status=2)

    assert "must be empty or new (it holds 00-picture.png" in " ".join(said.split())
    assert (folder / "00-picture.png").read_bytes() == b"mine"
    assert not (tmp_path / "out.png").exists()
    (folder / "00-picture.png").unlink()
    assert [run(*words, status=None)[0] for _ in range(2)] == [0, 0]  # earlier steps are replaced


# --- energy-metamer ----------------------------------------------------------------------


def test_without_torch_the_command_names_the_cure(png, tmp_path, monkeypatch):
    from pipeline.foveation import energy

    monkeypatch.setattr(energy, "find_spec", lambda _: None)

    assert "metamerlab[metamers]" in refusal(png, tmp_path / "out.png", "-m", "energy-metamer")
    assert not (tmp_path / "out.png").exists()


def test_an_interrupted_descent_goes_on_by_the_same_command(png, tmp_path, monkeypatch):
    pytest.importorskip(
        "torch", reason="needs the extra `metamers`: script/setup --metamers installs it"
    )
    from pipeline.foveation import energy

    out = tmp_path / "out.png"
    given = (png, out, "-m", "energy-metamer", "--set", "steps=7", *FAST)
    real = energy._write_state

    def stop(path, key, done, *rest):
        real(path, key, done, *rest)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(energy, "_write_state", stop)
        metamerlab("foveate", *map(str, given), status=None)
    state = tmp_path / ".out.png.state.npz"
    assert state.exists()
    assert not out.exists()
    _, said, _ = run(*given)

    assert f"going on where {state} ends" in said
    assert not state.exists()
    assert read_pixels(out).data.shape == (HEIGHT, WIDTH, 3)


# --- one call ----------------------------------------------------------------------------


def test_one_python_call_does_what_the_command_does(png, tmp_path):
    """Byte for byte, whatever is written."""
    asked = ("--gaze", "2deg,-1deg", "--fov", 50, "--seed", 3, "-m", "blur", "-m", "metamer")
    ours, theirs = tmp_path / "ours", tmp_path / "theirs"
    _, said, _ = run(
        png, theirs / "out.png", *asked, "--compare", theirs / "sheet.png", "--steps",
        theirs / "steps", "--flip", theirs / "flip.png", *FAST
    )  # fmt: skip
    lines = []
    seen = foveate_file(
        png,
        Outputs(ours / "out.png", ours / "sheet.png", ours / "steps", flip=ours / "flip.png"),
        viewing=StatedViewing("2deg,-1deg", fov_deg=50), seed=3,
        choices=[Choice("blur"), Choice("metamer")], reporter=Reporter(lines.append),
    )  # fmt: skip

    files = sorted(p.relative_to(theirs) for p in theirs.rglob("*") if p.is_file())
    assert len(files) > 10
    for file in files:
        assert (ours / file).read_bytes() == (theirs / file).read_bytes(), file
    assert said.replace(str(theirs), str(ours)).splitlines() == lines
    np.testing.assert_array_equal(read_pixels(ours / "out.png").data, np.rint(255 * seen[0].colour))


@pytest.mark.parametrize("option", ["OUT", "--compare", "--flip"])
def test_the_picture_itself_is_never_written_over(png, tmp_path, option):
    before = png.read_bytes()
    (tmp_path / "link.png").symlink_to(png)
    given = [tmp_path / "link.png"] if option == "OUT" else [tmp_path / "o.png", option, png]

    assert "is read by this command" in refusal(png, *given, *FAST)
    assert png.read_bytes() == before
    assert not (tmp_path / "o.png").exists()


def test_a_sheet_says_how_wide_each_condition_pools():
    assert _named(Choice("blur", {"rate": 0.35})) == "blur (rate 0.35)\nrate 0.35, fovea 1 deg"
    assert _named(Choice("reference")) == "reference"
