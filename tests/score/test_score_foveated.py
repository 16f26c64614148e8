"""Scores around a gaze: ratios of bands by eccentricity, and each metric beside its blindness."""

import json
from itertools import pairwise

import numpy as np
import pytest
from command_line import metamerlab
from undrawn_reports import undrawn_scores

from pipeline.errors import InputError
from pipeline.foveation.conditions import foveate
from pipeline.foveation.geometry import Equirectangular, Flat
from pipeline.pictures.colour_file import save_colour
from stimuli.score.available import split_available
from stimuli.score.band_ratios import EDGES_DEG, RingEnergies
from stimuli.score.foveated import METRICS_OF_FOVEATION, score_foveated, seen_wide
from stimuli.score.measure_clips import Cache
from stimuli.score.measured import PairScores
from stimuli.score.metrics import BLIND, METRICS

pytestmark = pytest.mark.slow

OWN = ("statistics", "band-ratio")
EDGE = 128


@pytest.fixture(scope="module")
def texture():
    rng = np.random.default_rng(20_260_101)
    made = rng.uniform(0.3, 0.7, (EDGE, EDGE, 3)).astype(np.float32)
    made.flags.writeable = False
    return made


def rings(fov_deg=40.0):
    return RingEnergies(Flat(width_deg=fov_deg).of(EDGE, EDGE))


def test_half_the_contrast_is_half_the_ratio_in_every_ring(texture):
    energies = rings()
    energies.add(0.5 + 0.5 * (texture - 0.5), texture, (64, 64))

    found = energies.ratios()
    there = ~np.isnan(found)
    np.testing.assert_allclose(found[there], 0.5, rtol=1e-5)
    assert there[0].sum() >= 6
    assert energies.mean_ratio() == pytest.approx(0.5, rel=1e-5)


def test_rings_lie_around_the_gaze(texture):
    """Contrast is lost in the right half only: a gaze far left sees that in its outer rings."""
    test = texture.copy()
    test[:, 64:] = 0.5
    energies = rings()
    energies.add(test, texture, (0, 64))

    finest = energies.ratios()[0]
    inner, outer = EDGES_DEG.index(10.0), EDGES_DEG.index(30.0)
    np.testing.assert_allclose(finest[2:inner], 1, atol=0.02)
    assert finest[outer] < 0.1


def test_frames_count_each_at_its_own_gaze(texture):
    """A hole that moves with the gaze is seen in the fovea's rings of every frame."""
    y, x = np.mgrid[:EDGE, :EDGE] + 0.5
    energies = rings()
    for gaze in ((32.0, 40.0), (90.0, 80.0)):
        test = np.where(np.hypot(x - gaze[0], y - gaze[1])[..., None] < 24, 0.5, texture)
        energies.add(test.astype(np.float32), texture, gaze)

    finest = energies.ratios()[0]
    near, far = EDGES_DEG.index(3.5), EDGES_DEG.index(15.0)
    assert finest[near] < 0.05
    np.testing.assert_allclose(finest[far : far + 2], 1, atol=0.05)


def test_a_flat_reference_has_no_ratio():
    flat = np.full((EDGE, EDGE, 3), 0.5, np.float32)
    energies = rings()
    energies.add(flat, flat, (64, 64))

    assert energies.mean_ratio() is None
    assert all(points == () for points in energies.curves().values())


def test_blur_loses_bands_outward_and_a_metamer_gives_them_back(texture):
    viewing = seen_wide(EDGE, EDGE, 40)
    scores = {
        method: score_foveated(
            foveate(texture, (64, 64), method=method)[None], texture[None], [(64.0, 64.0)],
            viewing, metrics=OWN,
        )
        for method in ("reference", "blur", "metamer")
    }  # fmt: skip

    ratio = {method: found.values["band-ratio"] for method, found in scores.items()}
    finest = dict(scores["blur"].band_ratios["level 0"])
    falling = [finest[x] for x in sorted(finest)]
    assert ratio["reference"] == pytest.approx(1, abs=1e-4)
    assert ratio["blur"] < 0.5 < 0.8 < ratio["metamer"] < 1.2
    assert all(a >= b - 0.02 for a, b in pairwise(falling))
    assert falling[-1] < 0.2
    distance = {method: found.values["statistics"] for method, found in scores.items()}
    assert distance["reference"] < 1e-3 < distance["metamer"] < 0.5 * distance["blur"]


def test_what_a_metric_is_blind_to_stands_beside_it(texture):
    found = score_foveated(texture[None], texture[None], [(64, 64)], metrics=OWN)

    assert set(found.blind) == set(OWN)
    assert "compares pixels" in BLIND["fvvdp"]
    assert set(BLIND) == set(METRICS)


@pytest.mark.parametrize(
    ("test", "truth", "gaze", "said"),
    [
        ((1, 64, 64, 3), (1, 64, 32, 3), [(1, 1)], "both be of shape"),
        ((64, 64, 3), (64, 64, 3), [(1, 1)], "both be of shape"),
        ((1, 64, 64, 3), (1, 64, 64, 3), [], "gaze_px must hold"),
    ],
)
def test_shapes_that_do_not_fit_are_refused(test, truth, gaze, said):
    with pytest.raises(InputError, match=said):
        score_foveated(np.zeros(test, np.float32), np.zeros(truth, np.float32), gaze)


def test_curves_are_kept_with_the_numbers(tmp_path):
    cache = Cache(tmp_path)
    cache.write("key", PairScores({("a", "frame"): 1.0}, curves={"level 0": ((1.0, 0.5),)}))

    assert cache.read("key").curves == {"level 0": ((1.0, 0.5),)}


@pytest.fixture(scope="module")
def scored(tmp_path_factory, texture):
    tmp_path = tmp_path_factory.mktemp("scored")
    save_colour(tmp_path / "texture.png", texture)
    arguments = (
        "foveate", tmp_path / "texture.png", tmp_path / "out.png", "--numpy", "--gaze", "50,60",
        "--score", tmp_path / "scores", "-m", "reference", "-m", "blur", "-m", "metamer",
    )  # fmt: skip
    metamerlab(*arguments, catch_exceptions=False)
    return tmp_path / "scores"


def test_the_command_writes_a_page_with_pictures_plots_and_blindness(scored):
    page = (scored / "scores.html").read_text("utf-8")
    raw = json.loads((scored / "scores.json").read_text("utf-8"))

    assert [clip["method"] for clip in raw["clips"]] == ["blur", "metamer"]
    assert raw["gaze_px"] == [[50.0, 60.0]]
    assert raw["display"]["px_per_deg"] == pytest.approx(
        EDGE / 2 / np.tan(np.radians(20)) * np.pi / 180, rel=1e-3
    )
    assert set(raw["clips"][0]["band_ratios"]) == {f"level {k}" for k in range(4)}
    assert 'id="pictures"' in page
    assert page.count("data:image/jpeg") >= 3
    assert 'id="bands"' in page
    assert "what it is blind to" in page
    assert BLIND["statistics"].split(":")[0] in page
    lines = (scored / "bands.csv").read_text("utf-8").splitlines()
    assert lines[0] == "scene,size,method,level,eccentricity_deg,ratio"
    assert any(line.startswith("texture,,metamer,level 2,") for line in lines)
    assert (scored / "figures" / "bands-by-eccentricity-1.png").exists()


def test_what_is_not_installed_is_named(scored):
    from importlib.util import find_spec

    page = (scored / "scores.html").read_text("utf-8")
    assert ("not computed" in page) == (
        find_spec("pyfvvdp") is None or find_spec("pycvvdp") is None
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--panorama", "--gaze", "0,64.5"], "must have Y from 0 to 64"),
        (["--gaze", "-1,5"], "needs a gaze on the picture"),
    ],
)
def test_what_no_metric_can_measure_is_refused(tmp_path, rng, arguments, said):
    save_colour(tmp_path / "a.png", rng.random((64, 128, 3)).astype(np.float32))
    given = ["foveate", str(tmp_path / "a.png"), str(tmp_path / "out.png"), "--numpy"]
    done = metamerlab(*given, "--score", str(tmp_path / "s"), *arguments, status=2)

    assert said in done.stderr
    assert not (tmp_path / "out.png").exists()


def test_a_panorama_is_scored_in_the_view_around_the_gaze(tmp_path, texture):
    """The gaze lies on the seam; a blur is told from its picture there, and from nothing else."""
    around = np.concatenate([texture, texture[:, ::-1]], axis=1)
    height, width = around.shape[:2]
    near = around.copy()
    near[height // 3 : 2 * height // 3, width // 3 : 2 * width // 3] = 0.5  # behind the eye
    shown = foveate(around, (0, height / 2), viewing=Equirectangular(), method="blur")
    for name, colour in (("around", around), ("behind", near), ("blur", shown)):
        save_colour(tmp_path / f"{name}.png", colour, bits=16)
    found = {}
    for name in ("behind", "blur"):
        given = ["stimuli", "score", tmp_path / f"{name}.png", tmp_path / "around.png"]
        given += ["--panorama", "--gaze", f"0,{height / 2}", "--out", tmp_path / name]
        given += ["--metrics", "statistics,band-ratio"]
        with undrawn_scores():
            done = metamerlab(*given)
        assert "flat view around the gaze, 90 degrees an edge" in done.output
        scores = json.loads((tmp_path / name / "scores.json").read_text("utf-8"))
        found[name] = scores["clips"][0]["scores"]

    assert found["behind"]["statistics frame"] == 0
    assert found["blur"]["statistics frame"] > 0.2
    assert found["blur"]["band-ratio frame"] < 0.7


def test_every_metric_of_foveation_takes_a_gaze_per_frame(texture):
    _, missing = split_available(METRICS[name] for name in METRICS_OF_FOVEATION)
    if missing:
        pytest.skip(f"needs the extra metrics ({missing[0].reason})")
    clip = np.stack([np.roll(texture, k, axis=1) for k in range(2)])
    blurred = np.stack([foveate(frame, (64, 64), method="blur") for frame in clip])
    found = score_foveated(blurred, clip, [(64, 64), (66, 64)])

    assert set(found.values) == set(METRICS_OF_FOVEATION)
    assert 0 < found.values["fvvdp"] < 9.9
    assert 0 < found.values["cvvdp"] < 9.9
