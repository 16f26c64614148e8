"""A stereo pair whose files do not belong together is refused by name of the mistake."""

import re
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
from command_line import outcome_of
from number_files import load_plane
from PIL import Image

from pipeline.errors import InputError
from pipeline.pictures.colour_file import load_colour, save_colour
from pipeline.pictures.write import write_pixels
from protocols.load import load_protocol
from stimuli.scenes.pair_check import judge_pair
from stimuli.scenes.stereo import StereoPair, built_in_pair, load_pair

ANY_OFFSET = 1e9
run = outcome_of()


@pytest.fixture(scope="module")
def pair() -> StereoPair:
    """The motorcycle at half its size; any disparity is allowed."""
    whole = built_in_pair("motorcycle")
    left, right = (
        np.ascontiguousarray(cv2.resize(view, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
        for view in (whole.left, whole.right)
    )
    rows, columns = left.shape[:2]
    disparity = np.ascontiguousarray(whole.disparity_px[: 2 * rows : 2, : 2 * columns : 2] / 2)
    known = np.ascontiguousarray(whole.known[: 2 * rows : 2, : 2 * columns : 2])
    return StereoPair(left, disparity, known, 500.0, 0.193, ANY_OFFSET, right)


def exchanged(pair: StereoPair) -> StereoPair:
    return replace(pair, left=pair.right, right=pair.left)


def test_a_true_pair_agrees_and_so_does_a_darker_or_noisier_one(pair, rng):
    noisy = (pair.right + rng.normal(0, 0.03, pair.right.shape)).clip(0, 1).astype(np.float32)
    for right in (pair.right, pair.right * np.float32(0.7), noisy):
        verdict = judge_pair(replace(pair, right=right))
        assert not verdict.doubtful


@pytest.mark.parametrize(
    ("mistake", "said"),
    [
        (exchanged, "left and right are exchanged"),
        (lambda p: replace(p, right=p.left), "left and right are the same picture"),
        (lambda p: replace(p, disparity_px=4 * p.disparity_px), r"units_per_px = 4 fits"),
        (lambda p: replace(p, disparity_px=p.disparity_px / 4), r"units_per_px = 0\.25 fits"),
        (lambda p: replace(p, disparity_px=256 * p.disparity_px), r"units_per_px = 256 fits"),
        (lambda p: replace(exchanged(p), mirrored=True), "is that of the other photograph"),
        (lambda p: replace(p, mirrored=True), "the other way: the picture given as the right one"),
        (lambda p: replace(p, right=np.roll(p.right, 6, axis=0)), "not rectified: .* 6 px lower"),
        (lambda p: replace(p, right=p.right[::-1, ::-1].copy()), "may be of different pictures"),
        (lambda p: replace(p, disparity_px=200 / p.disparity_px), r"no disparity \(depth\?\)"),
    ],
)
def test_a_wrong_pair_is_refused_with_what_is_wrong(pair, mistake, said):
    verdict = judge_pair(mistake(pair))
    assert verdict.refused
    assert re.search(said, str(verdict)), str(verdict)


def test_a_slightly_wrong_pair_is_doubtful(pair):
    verdict = judge_pair(replace(pair, disparity_px=1.2 * pair.disparity_px))
    assert verdict.doubtful
    assert not verdict.refused


def test_pictures_without_texture_are_not_judged_but_said(pair):
    flat = np.full_like(pair.left, 0.5)
    flat[0, 0] = 0.4
    verdict = judge_pair(replace(pair, left=flat))
    assert not verdict.refused
    assert "too few pixels have texture" in str(verdict)


@pytest.mark.parametrize(
    ("folder", "left", "disparity", "right", "units_per_px"),
    [
        ("middlebury2003_teddy", "im2.png", "disp2.pgm", "im6.png", 4.0),
        ("middlebury2001_venus", "imL.png", "groundtruth.png", "imR.png", 8.0),
        ("middlebury2001_tsukuba", "imL.png", "groundtruth.png", "imR.png", 16.0),
        ("middlebury2006_aloe", "aloeL.jpg", "aloeGT.png", "aloeR.jpg", 1.0),
    ],
)
def test_real_pairs_pass_and_are_refused_exchanged_or_in_other_units(
    shared_data, folder, left, disparity, right, units_per_px
):
    place = shared_data / "stereo" / folder
    if not place.is_dir():
        pytest.skip("needs Middlebury's pairs, which are not here")

    def read(first, second, units):
        pair = load_pair(place / first, place / disparity, place / second, units_per_px=units)
        return judge_pair(pair, units_per_px=units)

    assert not read(left, right, units_per_px).doubtful
    assert "exchanged" in str(read(right, left, units_per_px))
    other = read(left, right, 4 * units_per_px)
    assert other.refused
    assert f"units_per_px = {units_per_px:g} fits" in str(other)


# ---- in a study


@pytest.fixture
def study(small_study, pair, tmp_path):
    """The small study with a pair of files, disparity in quarters of a pixel."""
    folder = tmp_path / "study"
    shutil.copytree(small_study.parent, folder)
    save_colour(folder / "left.png", pair.left)
    save_colour(folder / "right.png", pair.right)
    quarters = np.where(pair.known, 4 * pair.disparity_px, 0)
    write_pixels(folder / "quarters.png", np.rint(quarters)[..., None].astype(np.uint16), "Y")
    path = folder / small_study.name
    text = path.read_text()
    for old, new in (
        ('left = "motorcycle"', 'left = "left.png"'),
        ('right = "motorcycle"', 'right = "right.png"'),
        ('disparity = "motorcycle"', 'disparity = "quarters.png"\nunits_per_px = 4.0'),
    ):
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    return path


def test_a_study_reads_its_disparity_in_the_units_that_it_states(study):
    assert run("protocol", "check", study, status=None)[0] == 0


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("units_per_px = 4.0", "", "units_per_px = 4 fits"),
        ('right = "right.png"', 'right = "left.png"', "are the same picture"),
        ('disparity = "quarters.png"', 'disparity = "quarters.jpg"', "must hold exact numbers"),
    ],
)
def test_check_and_build_refuse_a_wrong_pair_before_anything_is_built(
    study, tmp_path, old, new, said
):
    Image.fromarray(np.full((250, 370), 90, np.uint8)).save(study.parent / "quarters.jpg")
    study.write_text(study.read_text().replace(old, new))
    for command in (
        ("protocol", "check", study),
        ("stimuli", "build", study, "--out", tmp_path / "clips"),
    ):
        _, _, error = run(*command, status=2)
        assert f"{study}: stimuli.scenes[1]: " in error
        assert said in error
    assert not (tmp_path / "clips").exists()


def test_check_notes_a_doubtful_pair(study):
    study.write_text(study.read_text().replace("units_per_px = 4.0", "units_per_px = 3.8"))
    _, said, _ = run("protocol", "check", study)
    assert (
        "note: stimuli.scenes[1]: left.png, right.png, quarters.png: outside the holes the warp"
        " lies more than 1 px beside the true view" in said
    )


def test_units_at_their_default_leave_a_studys_hashes_as_they_were(small_study):
    study = load_protocol(small_study)
    assert "units_per_px" not in study.model_dump_json()
    assert "units_per_px" not in str(study.stimuli.identity())


# ---- in `warp`


def test_warp_refuses_a_wrong_pair_and_says_the_option(study):
    folder = study.parent
    files = (folder / "left.png", folder / "out.png", "--disparity", folder / "quarters.png")
    _, _, error = run("warp", *files, "--right", folder / "right.png", status=2)
    assert "--units-per-px 4 fits" in error
    assert not (folder / "out.png").exists()


@pytest.mark.parametrize("name", ["d.png", "d.pgm", "d.tif"])
def test_disparity_of_integers_is_read_from_each_documented_format(tmp_path, name):
    values = np.arange(1, 25, dtype=np.uint8).reshape(4, 6)
    Image.fromarray(values).save(tmp_path / name)
    plane, integers = load_plane(tmp_path / name)
    assert integers
    np.testing.assert_array_equal(plane, values)


@pytest.mark.parametrize("name", ["d.jpg", "d.webp"])
def test_numbers_are_not_read_from_lossy_files_and_colour_is(tmp_path, name):
    Image.fromarray(np.full((16, 16, 3), 90, np.uint8)).save(tmp_path / name)
    with pytest.raises(InputError, match=rf"{name}: must hold exact numbers .* as PNG"):
        load_plane(tmp_path / name)
    assert load_colour(tmp_path / name).shape == (16, 16, 3)
