"""Stills of `foveated-images`: rings and cuts in place, hashed, resumed."""

import json
import re

import numpy as np
import pytest
from command_line import metamerlab
from PIL import Image
from undrawn_reports import undrawn_scores

from pipeline.errors import GLUnavailableError, InputError
from pipeline.foveation.conditions import foveate
from pipeline.foveation.drawn import bisected, cut_shares, direction_at, draw_ring
from pipeline.foveation.geometry import Equirectangular, Flat, eccentricity_deg, pixel_centres
from protocols.display import Display
from protocols.errors import StudyError
from protocols.load import load_study
from protocols.manifest import read_manifest
from protocols.recipes.foveated_images import (
    Cuts,
    FoveatedImages,
    GazePoint,
    PanoramaView,
    Rings,
    ScenePicture,
    ShownMethod,
)
from stimuli.batch.check import check_batch
from stimuli.media.png import decode_png
from stimuli.recipes import builder_of
from stimuli.recipes.base import BuildMachine
from stimuli.recipes.build_foveated_images import FoveatedBuilder
from stimuli.recipes.foveated_work import STILLS, StillMaker

WIDTH, HEIGHT = 96, 72
QUIET = lambda *_: None  # noqa: E731
DISPLAY = Display(
    name="desk", width_px=640, height_px=480, width_mm=640.0, height_mm=480.0,
    distance_mm=100.0, refresh_hz=60.0,
)  # fmt: skip
DISTANCE_PX = 100.0


def recipe(**more) -> FoveatedImages:
    given = {
        "kind": "foveated-images",
        "width_px": WIDTH,
        "height_px": HEIGHT,
        "pictures": (
            ScenePicture(name="one", file="one.png"),
            ScenePicture(name="two", file="two.png"),
        ),
        "methods": (
            ShownMethod(name="reference"),
            ShownMethod(name="soft", method="blur", parameters={"scaling": 0.9}),
            ShownMethod(name="metamer"),
        ),
    }
    return FoveatedImages.model_validate(given | more)


class StandIn:
    """As much of a study as a builder asks for: all stimuli are shown."""

    def __init__(self, stimuli: FoveatedImages) -> None:
        self.stimuli = stimuli

    def shown(self) -> tuple[str, ...]:
        return tuple(one.name for one in self.stimuli.pool())


def builder(folder, stimuli, display=DISPLAY) -> FoveatedBuilder:
    return FoveatedBuilder(StandIn(stimuli), display, folder)


def with_pictures(folder):
    rng = np.random.default_rng(20_260_101)
    for name in ("one", "two"):
        data = rng.integers(70, 190, (HEIGHT, WIDTH, 3), dtype=np.uint8)
        Image.fromarray(data).save(folder / f"{name}.png")
    return folder


@pytest.fixture
def folder(tmp_path):
    return with_pictures(tmp_path)


def stored(path) -> np.ndarray:
    return decode_png(path).astype(np.float32) / 255


# --- rings and cuts ----------------------------------------------------------------------


@pytest.mark.parametrize("polar_deg", [0.0, 90.0, 200.0])
def test_a_ring_lies_where_it_should_and_has_its_size(polar_deg):
    """By hand on a flat picture: right of the middle at 20 degrees lies x = d tan 20."""
    geometry = Flat(width_deg=80).of(600, 600)
    white = np.ones((600, 600, 3), np.float32)
    drawn = draw_ring(
        white, geometry, (300, 300), eccentricity_deg=20, polar_deg=polar_deg, height_deg=5,
        gap_deg=None,
    )  # fmt: skip

    ink = 1 - drawn[..., 0].astype(float)
    away = eccentricity_deg(geometry, (300, 300), *pixel_centres(geometry))
    y, x = np.mgrid[:600, :600] + 0.5
    turn, far = np.radians(polar_deg), geometry.distance_px * np.tan(np.radians(20))
    assert (x * ink).sum() / ink.sum() == pytest.approx(300 + far * np.cos(turn), abs=1.5)
    assert (y * ink).sum() / ink.sum() == pytest.approx(300 - far * np.sin(turn), abs=1.5)
    half_px = 1 / float(geometry.px_per_deg(np.array(300.0), np.array(300.0))) / 2
    assert away[ink > 0.5].min() == pytest.approx(17.5, abs=2 * half_px)
    assert away[ink > 0.5].max() == pytest.approx(22.5, abs=2 * half_px)


def test_stroke_and_gap_are_a_fifth_of_the_ring():
    """By hand: of area pi/4 (1 - .36) h^2 closed; the gap takes a bar of .2 h by about .2 h."""
    geometry = Flat(width_deg=10).of(800, 800)
    white = np.ones((800, 800, 3), np.float32)
    areas = {}
    for gap in (None, 0.0, 90.0):
        drawn = draw_ring(
            white, geometry, (400, 400), eccentricity_deg=1, polar_deg=0, height_deg=2, gap_deg=gap
        )
        areas[gap] = (1 - drawn[..., 0]).sum() / 80.0**2
        if gap is not None:
            turn, far = np.radians(gap), 0.8 * 80  # the middle of the gap
            column = round(480 + far * np.cos(turn))
            assert drawn[round(400 - far * np.sin(turn)), column, 0] == 1

    assert areas[None] == pytest.approx(np.pi / 4 * (1 - 0.36) * 4, rel=0.01)
    assert areas[None] - areas[0.0] == pytest.approx(0.2 * 0.2 * 4, rel=0.05)
    assert areas[90.0] == pytest.approx(areas[0.0], rel=0.01)


def test_the_picture_outside_the_ring_is_untouched(rng):
    picture = rng.random((60, 80, 3)).astype(np.float32)
    geometry = Flat(width_deg=40).of(80, 60)
    drawn = draw_ring(
        picture, geometry, (40, 30), eccentricity_deg=8, polar_deg=180, height_deg=4, gap_deg=0
    )

    changed = (drawn != picture).any(axis=2)
    assert 20 < changed.sum() < 100
    assert changed[:, 40:].sum() == 0


def test_on_a_panorama_a_ring_goes_over_the_seam():
    geometry = Equirectangular().of(360, 180)
    grey = np.full((180, 360, 3), 0.5, np.float32)
    ring = {"eccentricity_deg": 10.0, "polar_deg": 0.0, "height_deg": 12.0, "gap_deg": 0.0}
    across = draw_ring(grey, geometry, (350, 90), **ring)
    inside = draw_ring(grey, geometry, (100, 90), **ring)

    np.testing.assert_allclose(np.roll(across, 110, axis=1), inside, atol=1e-6)
    assert (across[:, 0] != 0.5).any()
    assert (across[:, -1] != 0.5).any()


@pytest.mark.parametrize(("eccentricity", "polar"), [(19.5, 0.0), (60.0, 90.0), (120.0, 0.0)])
def test_a_ring_off_the_picture_is_refused(eccentricity, polar):
    grey = np.full((60, 80, 3), 0.5, np.float32)
    with pytest.raises(InputError, match="must lie on the picture"):
        draw_ring(
            grey, Flat(width_deg=40).of(80, 60), (40, 30), eccentricity_deg=eccentricity,
            polar_deg=polar, height_deg=2, gap_deg=None,
        )  # fmt: skip


def test_directions_turn_counter_clockwise():
    geometry = Flat(width_deg=60).of(100, 100)
    right, up = (direction_at(geometry, (50, 50), 10, turn) for turn in (0, 90))

    np.testing.assert_allclose(right, [np.sin(np.radians(10)), 0, np.cos(np.radians(10))])
    np.testing.assert_allclose(up, [0, -np.sin(np.radians(10)), np.cos(np.radians(10))], atol=1e-12)


def test_a_cut_goes_through_the_gaze_and_keeps_both_sides(rng):
    geometry = Flat(width_deg=40).of(120, 90)
    first, second = (rng.random((90, 120, 3)).astype(np.float32) for _ in range(2))
    gaze = (30.0, 50.0)
    mixed = bisected(first, second, geometry, gaze, angle_deg=90, ramp_deg=2)
    share = cut_shares(geometry, gaze, 90, 2)

    # Up, so the left is first.
    np.testing.assert_array_equal(mixed[share >= 1], first[share >= 1])
    np.testing.assert_array_equal(mixed[share <= 0], second[share <= 0])
    assert (share[:, :25] == 1).all()
    assert (share[:, 36:] == 0).all()
    column = int(gaze[0])
    assert share[50, column - 1 : column + 1].mean() == pytest.approx(0.5, abs=0.01)
    x, y = np.array(gaze[0]), np.array(gaze[1])
    ramp_px = 2 * float(geometry.px_per_deg(x, y))
    blended = ((share > 0) & (share < 1))[50].sum()
    assert blended == pytest.approx(ramp_px, abs=1.5)


# --- the pool ----------------------------------------------------------------------------


def test_the_papers_counts_come_out():
    """6.1: 6 methods x 5 eccentricities x (5 open + 5 closed); 6.3: 3 x (6 + 6) + 6 per scene."""
    methods = tuple(ShownMethod(name=name) for name in ("reference", "a", "b", "c", "d", "e"))
    rings = recipe(
        pictures=(ScenePicture(name="one", file="one.png"),),
        methods=methods,
        rings=Rings(eccentricities_deg=(5.0, 10.0, 15.0, 20.0, 25.0)),
    )
    cuts = recipe(
        pictures=tuple(ScenePicture(name=f"s{k}", file=f"{k}.png") for k in range(7)),
        methods=methods[:4],
        cuts=Cuts(),
    )

    assert len(rings.pool()) == 300
    assert len(cuts.pool()) == 294
    assert len({one.name for one in (*rings.pool(), *cuts.pool())}) == 594


def test_polar_angles_are_spread_and_equal_for_all_methods_and_scenes():
    made = recipe(rings=Rings(eccentricities_deg=(5.0, 10.0), places=4, gaps_deg=(0.0, 180.0)))
    angles = {}
    for one in made.stimuli():
        key = one.eccentricity_deg, one.condition["symbol"], one.gap_deg, one.condition["place"]
        angles.setdefault(key, set()).add(one.polar_deg)
        assert 90 * one.condition["place"] <= one.polar_deg <= 90 * (one.condition["place"] + 1)

    assert all(len(found) == 1 for found in angles.values())
    assert len({found.pop() for found in angles.values()}) == 2 * 3 * 4
    other = recipe(
        texture_seed=1, rings=Rings(eccentricities_deg=(5.0, 10.0), places=4, gaps_deg=(0.0, 180.0))
    )
    assert [a.polar_deg for a in made.stimuli()] != [b.polar_deg for b in other.stimuli()]


def test_conditions_are_columns():
    ring = recipe(rings=Rings(eccentricities_deg=(2.5,), places=1)).pool()[0]
    cut = recipe(cuts=Cuts(draws=1)).pool()[-1]
    two = recipe(gazes=(GazePoint(name="middle"), GazePoint(name="left", x_deg=-5.0)), draws=2)

    assert ring.name == "one__reference__e2-5__open__p0"
    assert list(ring.condition) == [
        "scene", "method", "eccentricity_deg", "symbol", "gap_deg", "place", "polar_deg",
    ]  # fmt: skip
    assert cut.condition["cut"] == "inconsistent"
    assert cut.condition["method"] == "metamer"
    assert two.columns() == ("scene", "method", "gaze", "draw")
    assert len(two.pool()) == 2 * 2 * (1 + 2 * 2)  # the reference has no seed, and one draw


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"cuts": Cuts(), "rings": Rings(eccentricities_deg=(5.0,))}, "two experiments"),
        ({"cuts": Cuts(), "draws": 2}, "draws is for whole pictures"),
        ({"cuts": Cuts(), "methods": (ShownMethod(name="reference"),)}, "beside 'reference'"),
        ({"methods": (ShownMethod(name="blur"), ShownMethod(name="blur"))}, "named once"),
        ({"gazes": (GazePoint(name="off", x_deg=90.0),)}, "within 90 degrees"),
    ],
)
def test_contradictions_are_refused(more, said):
    with pytest.raises(ValueError, match=said):
        recipe(**more)


# --- the builder -------------------------------------------------------------------------


def test_stills_are_what_the_python_call_returns(folder):
    made = builder(folder, recipe())
    colours = {one.name: made.colour(one) for one in made.wanted}
    seeds = {one.name: one.seed for one in made.wanted}
    made.close()

    picture = stored(folder / "two.png")
    viewing = Flat(distance_px=DISTANCE_PX)
    middle = (WIDTH / 2, HEIGHT / 2)
    soft = foveate(picture, middle, viewing=viewing, method="blur", scaling=0.9)
    noise = foveate(picture, middle, viewing=viewing, seed=seeds["two__metamer"])
    np.testing.assert_array_equal(colours["two__reference"], picture)
    np.testing.assert_allclose(colours["two__soft"], soft, atol=1.01 / 255)
    np.testing.assert_allclose(colours["two__metamer"], noise, atol=1.01 / 255)


def test_a_ring_is_foveated_with_its_scene(folder):
    """The reference holds the ring as drawn; the blur's gap has lost contrast."""
    made = builder(
        folder,
        recipe(
            rings=Rings(eccentricities_deg=(12.0,), places=1, height_deg=6.0, grey=0.0),
            methods=(ShownMethod(name="reference"), ShownMethod(name="blur")),
        ),
    )
    found = {one.name: made.colour(one) for one in made.wanted if one.picture.name == "one"}
    plain = stored(folder / "one.png")
    made.close()

    sharp, soft = (found[f"one__{name}__e12__open__p0"] for name in ("reference", "blur"))
    ring = (sharp == 0).all(axis=2)
    assert ring.sum() > 15
    np.testing.assert_array_equal(sharp[~(sharp != plain).any(axis=2)],
                                  plain[~(sharp != plain).any(axis=2)])  # fmt: skip
    assert 0.1 < soft[ring].mean() < 0.45


def test_a_cut_shows_the_method_on_one_side_alone(folder):
    made = builder(folder, recipe(cuts=Cuts(draws=1)))
    cut = next(
        one for one in made.wanted
        if one.condition["cut"] == "inconsistent" and one.shown.name == "metamer"
    )  # fmt: skip
    colour = made.colour(cut)
    share = cut_shares(made.geometry, (WIDTH / 2, HEIGHT / 2), cut.cut_deg, 1.0)
    made.close()

    plain = stored(folder / "one.png")
    np.testing.assert_array_equal(colour[share <= 0], plain[share <= 0])
    assert np.abs(colour - plain)[share >= 1].mean() > 0.03


def test_unknown_methods_and_rings_off_the_picture_are_problems(folder):
    wrong = recipe(
        methods=(ShownMethod(name="metamere"), ShownMethod(name="blur", parameters={"scale": 1.0})),
        rings=Rings(eccentricities_deg=(40.0,)),
    )
    said = [str(problem) for problem in builder(folder, wrong).problems()]

    assert "did you mean 'metamer'" in said[0]
    assert "did you mean 'scaling'" in said[1]
    assert "must lie on the picture" in said[2]
    (folder / "two.png").unlink()
    with pytest.raises(StudyError, match="the file of 'two' is not there"):
        builder(folder, recipe()).check_inputs()


def test_pictures_of_another_size_are_refused_or_made_to_cover(folder, rng):
    data = rng.integers(0, 256, (200, 100, 3), dtype=np.uint8)
    Image.fromarray(data).save(folder / "one.png")
    exact = builder(folder, recipe())
    cover = builder(folder, recipe(fit="cover"))

    with pytest.raises(InputError, match='write fit = "cover"'):
        exact.colour(exact.wanted[0])
    assert cover.colour(cover.wanted[0]).shape == (HEIGHT, WIDTH, 3)
    assert cover.notes() == []
    upright, on_its_side = Image.Exif(), Image.Exif()
    on_its_side[0x0112] = 6
    for exif, said in (
        (upright, "is 50 x 40 px and stills are 96 x 72, so it is enlarged 1.92 times"),
        (on_its_side, "is 40 x 50 px and stills are 96 x 72, so it is enlarged 2.40 times"),
    ):
        Image.fromarray(data[::5, ::2]).save(folder / "one.png", exif=exif)
        (note,) = cover.notes()
        assert said in str(note)
        assert exact.notes() == []


@pytest.mark.parametrize(
    ("crop", "first"),
    [
        ("top", 0), ("bottom", 120), ("middle", 60), ((0.5, 0.0), 0), ((0.1, 0.4), 40),
        ((1.0, 0.99), 120), ("left", 60), ("right", 60),
    ],
)  # fmt: skip
def test_a_crop_keeps_an_edge_or_the_surroundings_of_a_point(folder, rng, crop, first):
    """A picture of the stills' width and 120 rows more: rows from `first` on are shown."""
    data = rng.integers(0, 256, (HEIGHT + 120, WIDTH, 3), dtype=np.uint8)
    for name in ("one", "two"):
        Image.fromarray(data).save(folder / f"{name}.png")
    pictures = ({"name": "one", "file": "one.png"}, {"name": "two", "file": "two.png"})
    for given in (
        {"crop": crop, "pictures": pictures},
        {"crop": "bottom", "pictures": ({**pictures[0], "crop": crop}, pictures[1])},
    ):
        cropped = builder(folder, recipe(fit="cover", **given))
        rows = np.rint(255 * cropped.colour(cropped.wanted[0])).astype(int)
        np.testing.assert_array_equal(rows, data[first : first + HEIGHT])


def test_a_crop_that_cuts_nothing_is_refused(folder):
    for more, said in (
        ({"crop": "top"}, 'crop needs fit = "cover"'),
        ({"fit": "cover", "crop": "upper"}, "crop"),
        ({"fit": "cover", "crop": (0.5, 1.5)}, "less than or equal to 1"),
        (
            {
                "fit": "cover",
                "pictures": ({"name": "one", "file": "one.png", "view": {}, "crop": "top"},),
            },
            "crop is for flat pictures, and 'one' has a view",
        ),
    ):
        with pytest.raises(ValueError, match=re.escape(said)):
            recipe(**more)
    plain = recipe(fit="cover")
    assert "crop" not in plain.model_dump()["pictures"][0]
    assert "crop" not in plain.model_dump()
    keys = [
        (made := builder(folder, recipe(fit="cover", crop=crop))).key(made.wanted[0])
        for crop in ("middle", "top", (0.5, 0.0))
    ]
    assert keys[0] != keys[1] == keys[2]


def test_keys_change_with_what_decides_the_pixels_and_nothing_else(folder):
    base = builder(folder, recipe())
    first = base.wanted[1]
    key = base.key(first)

    labelled = recipe(
        methods=(
            ShownMethod(name="reference"),
            ShownMethod(name="soft", method="blur", parameters={"scaling": 0.9}, label="Soft"),
            ShownMethod(name="metamer"),
        )
    )
    assert builder(folder, labelled).key(first) == key
    near = DISPLAY.model_copy(update={"distance_mm": 101.0})
    assert builder(folder, recipe(), near).key(first) != key
    data = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    Image.fromarray(data).save(folder / "one.png")
    assert builder(folder, recipe()).key(first) != key


@pytest.fixture
def study(folder):
    return ring_study(folder)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The stills of the same study, built undisturbed; nobody may change them."""
    folder = with_pictures(tmp_path_factory.mktemp("whole"))
    built(ring_study(folder), folder / "clips")
    return folder / "clips"


def ring_study(folder):
    """A whole study: is the ring open? Made from the template of a new study."""
    from protocols.study_file.new_study import study_files

    (folder / "desk.toml").write_text(
        "\n".join(f"{key} = {json.dumps(value)}" for key, value in
                  DISPLAY.model_dump(exclude_defaults=True).items())
    )  # fmt: skip
    text = study_files("rings", "Rings", DISPLAY, "yes-no")["study.toml"]
    head, _, rest = text.partition("[stimuli]")
    section = f"""[stimuli]
kind = "foveated-images"
width_px = {WIDTH}
height_px = {HEIGHT}
pictures = [{{ name = "one", file = "one.png" }}]
methods = [{{ name = "reference" }}, {{ name = "soft", method = "blur" }}]
rings = {{ eccentricities_deg = [6.0, 12.0], height_deg = 5.0, places = 2 }}

"""
    tail = rest[rest.index("[task]") :]
    for old, new in (
        ('signal = { pattern = ["grating"] }', 'signal = { symbol = ["open"] }'),
        ("where = { contrast = 0.2 }", "where = { eccentricity_deg = 6.0 }"),
        ('by = "noise"', 'by = "method"'),
        ('baseline = "fine"', 'baseline = "reference"'),
        ('level = "contrast"', 'level = "eccentricity_deg"'),
        ("falling = false", "falling = true"),
    ):
        assert old in tail
        tail = tail.replace(old, new)
    text = (head + section + tail).replace('display = "display.toml"', 'display = "desk.toml"')
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


def built(path, out):
    study, display = load_study(path)
    return builder_of(study, display, path.parent).build(out, BuildMachine(), QUIET)


def test_a_study_is_built_hashed_and_goes_on_where_it_was(folder, study):
    out = folder / "clips"
    first = built(study, out)
    bytes_before = {path: path.read_bytes() for path in sorted(out.glob("*/000000.png"))}

    assert len(first.built) == len(bytes_before) == 2 * 2 * 2 * 2
    manifest = read_manifest(out)
    clip = manifest.clip("one__soft__e12__open__p1")
    assert clip.condition["symbol"] == "open"
    assert clip.condition["eccentricity_deg"] == 12.0
    assert clip.parameters["method"] == "blur"
    assert (clip.parameters["gaze_x_px"], clip.parameters["gaze_y_px"]) == (WIDTH / 2, HEIGHT / 2)
    assert check_batch(out).in_order
    assert built(study, out).built == []
    (out / clip.name / "000000.png").unlink()
    assert built(study, out).built == [clip.name]
    assert {path: path.read_bytes() for path in bytes_before} == bytes_before


def test_stills_made_without_opengl_are_those_of_the_gpu(folder, study, whole, monkeypatch):
    def none():
        raise GLUnavailableError("no OpenGL 4.3")

    STILLS.close()
    with monkeypatch.context() as hidden:
        hidden.setattr("stimuli.worker.create_context", none)
        built(study, folder / "clips")
        STILLS.close()

    assert read_manifest(folder / "clips").renderer.renderer == "none: numpy"
    assert read_manifest(whole).renderer.renderer != "none: numpy"
    paths = sorted(whole.glob("*/000000.png"))
    assert len(paths) == 16
    for path in paths:
        other = decode_png(folder / "clips" / path.parent.name / path.name).astype(int)
        assert np.abs(decode_png(path) - other).max() <= 1


def test_an_interrupted_build_keeps_what_is_whole(folder, study, monkeypatch):
    out = folder / "clips"
    real, made = StillMaker.colour, []

    def stop(self, entry, state):
        if len(made) == 3:
            raise KeyboardInterrupt
        made.append(entry.name)
        return real(self, entry, state)

    with monkeypatch.context() as patch:
        patch.setattr(StillMaker, "colour", stop)
        with pytest.raises(KeyboardInterrupt):
            built(study, out)
    assert not (out / "manifest.json").exists()

    outcome = built(study, out)

    assert outcome.kept == made
    assert len(outcome.built) == 13
    assert check_batch(out).in_order


def test_the_commands_build_show_and_simulate_the_study(folder, study):
    out = folder / "clips"
    for words in (
        ["stimuli", "build", study, "--out", out, "--dry-run"],
        ["stimuli", "build", study, "--out", out],
        ["protocol", "show", study],
        ["protocol", "preregister", study],
        ["session", "simulate", study, "--out", folder / "sessions", "--participants", "2"],
    ):
        metamerlab(*words, catch_exceptions=False)


@pytest.mark.slow
def test_the_stills_of_a_study_are_scored_around_their_gaze(tmp_path, whole):
    out = tmp_path / "scores"
    words = ("stimuli", "score", whole, "--out", out, "--metrics", "statistics,band-ratio")
    with undrawn_scores():
        metamerlab(*words, catch_exceptions=False)

    scores = json.loads((out / "scores.json").read_text("utf-8"))
    assert scores["gaze_px"] == [[WIDTH / 2, HEIGHT / 2]]
    assert scores["display"]["px_per_deg"] == pytest.approx(DISTANCE_PX * np.pi / 180, rel=1e-3)
    assert len(scores["clips"]) == 8
    assert {clip["method"] for clip in scores["clips"]} == {"soft"}
    assert all(clip["scores"]["statistics frame"] > 0.05 for clip in scores["clips"])
    assert all(clip["scores"]["band-ratio frame"] < 0.9 for clip in scores["clips"])
    other = metamerlab(*map(str, words), "--gaze", "1,2", status=2)
    assert "must be one of this batch's: 48,36" in other.stderr


def contents(out) -> dict[str, bytes]:
    return {
        str(path.relative_to(out)): path.read_bytes()
        for path in sorted(out.rglob("*"))
        if path.is_file() and path.name != "contact-sheet.html"
    }


@pytest.mark.slow
def test_a_cluster_makes_the_same_bytes(folder, study, whole):
    distributed = pytest.importorskip("distributed")
    import warnings

    loaded, display = load_study(study)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        cluster = distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=True, dashboard_address=None,
            silence_logs=50,
        )  # fmt: skip
        try:
            where = BuildMachine(scheduler=cluster.scheduler_address)
            done = builder_of(loaded, display, folder).build(folder / "far", where, QUIET)
        finally:
            cluster.close()

    assert len(done.built) == 16
    assert contents(folder / "far") == contents(whole)


# --- panoramas, undistorted backgrounds, pictures made elsewhere -------------------------


def test_before_an_undistorted_background_only_the_ring_is_changed(folder):
    """By hand: the disc is 3 degrees and the rim of 2 wide, and another 2 blend."""
    rings = {"eccentricities_deg": (12.0,), "places": 1, "height_deg": 6.0, "rim_deg": 2.0}
    rings |= {"closed": False}
    colours = {}
    for background in ("foveated", "undistorted"):
        made = builder(folder, recipe(rings=Rings(background=background, **rings)))
        wanted = [one for one in made.wanted if one.picture.name == "one"]
        colours |= {(background, one.shown.name): made.colour(one) for one in wanted}
        entry = wanted[0]
        made.close()
    geometry, middle = made.geometry, (WIDTH / 2, HEIGHT / 2)
    centre = direction_at(geometry, middle, 12.0, entry.polar_deg)
    away = np.degrees(
        np.arccos(np.clip(geometry.directions(*pixel_centres(geometry)) @ centre, -1, 1))
    )
    scene = stored(folder / "one.png")

    shown, whole = colours["undistorted", "metamer"], colours["foveated", "metamer"]
    np.testing.assert_array_equal(shown[away > 7.01], scene[away > 7.01])
    np.testing.assert_array_equal(shown[away < 4.99], whole[away < 4.99])
    assert np.abs(whole - scene)[away > 7.01].mean() > 0.03
    assert np.abs(shown - scene)[away < 4.99].mean() > 0.03
    np.testing.assert_array_equal(
        colours["undistorted", "reference"], colours["foveated", "reference"]
    )


def test_a_panorama_is_shown_through_a_flat_view(folder):
    """A panorama of the directions themselves: the view's pixels are its own directions."""
    around = Equirectangular().of(720, 360)
    rays = around.directions(*pixel_centres(around))
    Image.fromarray(np.rint(255 * (0.5 + 0.5 * rays)).astype(np.uint8)).save(folder / "one.png")
    looked = ScenePicture(
        name="one", file="one.png", view=PanoramaView(right_deg=170.0, down_deg=-40.0)
    )
    made = builder(folder, recipe(pictures=(looked,)))
    colour = made.colour(made.wanted[0])
    geometry = made.geometry
    made.close()

    right, down = np.radians(170), np.radians(-40)
    ahead = np.array([np.sin(right) * np.cos(down), np.sin(down), np.cos(right) * np.cos(down)])
    level = np.array([np.cos(right), 0, -np.sin(right)])
    below = np.cross(ahead, level)
    ours = geometry.directions(*pixel_centres(geometry))
    wanted = ours[..., :1] * level + ours[..., 1:2] * below + ours[..., 2:] * ahead
    np.testing.assert_allclose(2 * colour - 1, wanted, atol=0.02)


def test_a_view_of_what_is_no_panorama_is_refused(folder):
    made = builder(
        folder, recipe(pictures=(ScenePicture(name="one", file="one.png", view=PanoramaView()),))
    )

    with pytest.raises(InputError, match=r"one\.png: an equirectangular panorama must be twice"):
        made.colour(made.wanted[0])
    made.close()
    with pytest.raises(ValueError, match="down_deg from -90 to 90"):
        recipe(
            pictures=(ScenePicture(name="one", file="one.png", view=PanoramaView(down_deg=91.0)),)
        )


def test_pictures_made_elsewhere_are_found_by_picture_and_gaze(folder):
    (folder / "made").mkdir()
    for number in range(4):
        data = np.full((HEIGHT, WIDTH, 3), 50 * number, np.uint8)
        Image.fromarray(data).save(folder / f"made/{number:06d}.png")
    elsewhere = ShownMethod(name="lab", method="files:made")
    gazes = (GazePoint(name="middle"), GazePoint(name="left", x_deg=-5.0))
    made = builder(folder, recipe(methods=(elsewhere,), gazes=gazes))
    greys = [round(255 * float(made.colour(one).mean())) for one in made.wanted]
    key = made.key(made.wanted[0])
    made.close()

    assert greys == [0, 50, 100, 150]
    Image.fromarray(np.full((HEIGHT, WIDTH, 3), 9, np.uint8)).save(folder / "made/000003.png")
    assert made.key(made.wanted[0]) != key
    ringed = builder(folder, recipe(methods=(elsewhere,), rings=Rings(eccentricities_deg=(5.0,))))
    assert "must not be made elsewhere" in str(ringed.problems()[0])
