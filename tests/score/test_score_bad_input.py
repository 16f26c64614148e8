"""Every mistake ends with one message that says where, what and how to mend it."""

import shutil

import numpy as np
import pytest

from stimuli.media.png import encode_frame, encode_mask


@pytest.fixture
def two(tmp_path, clips, frames_writer):
    """Return two folders of frames: a fill and its reference."""
    frames_writer(tmp_path / "fill", clips.fills["metameric"])
    frames_writer(tmp_path / "truth", clips.truth)
    return tmp_path / "fill", tmp_path / "truth"


def refused(done, *words):
    assert done.exit_code == 2, done.output
    assert done.stderr.count("error: ") == 1
    for word in words:
        assert word in done.stderr, done.stderr


def test_clips_of_unequal_length(two, run_score):
    (two[0] / "000003.png").unlink()

    refused(run_score(*two, status=None), "as many frames as its reference (got 3 and 4)")


def test_clips_of_unequal_size(two, run_score, clips):
    (two[0] / "000002.png").write_bytes(encode_frame(clips.truth[0][:40], 8))

    refused(run_score(*two, status=None), "000002.png", "one size, 64 x 48 px", "(got 64 x 40 px)")


def test_a_reference_that_is_not_there(two, run_score, tmp_path):
    refused(run_score(two[0], tmp_path / "none", status=None), "none: the reference must exist")


def test_a_batch_without_references(run_score, tmp_path, clips, batch_writer):
    folder = batch_writer(tmp_path / "clips", clips, reference=False)

    refused(
        run_score(folder, status=None),
        "must have a reference",
        "push-pull",
        "add a method 'reference'",
    )


def test_a_clip_of_one_frame(two, run_score):
    for folder in two:
        for index in (1, 2, 3):
            (folder / f"{index:06d}.png").unlink()

    refused(run_score(*two, status=None), "at least two frames (it has one)", "truth/000000.png")


def test_frames_below_the_least_size_of_a_metric(run_score, tmp_path, rng):
    for name in "ab":
        picture = rng.random((10, 40, 3), np.float32)
        (tmp_path / f"{name}.png").write_bytes(encode_frame(picture, 8))
    ours = "psnr,ssim,statistics"

    done = run_score(tmp_path / "a.png", tmp_path / "b.png", "--metrics", ours, status=None)

    refused(done, "40 x 10 px", "ssim 11 px", "statistics 32 px", "--metrics psnr")
    run_score(tmp_path / "a.png", tmp_path / "b.png", "--metrics", "psnr")


def test_a_clip_beside_a_picture(two, run_score):
    refused(run_score(two[0], two[1] / "000000.png", status=None), "must both be folders")


def test_a_folder_without_frames(two, run_score, tmp_path):
    (tmp_path / "empty").mkdir()

    refused(run_score(two[0], tmp_path / "empty", status=None), "must hold frames")


def test_a_damaged_frame(two, run_score):
    path = two[0] / "000001.png"
    path.write_bytes(path.read_bytes()[:200])

    refused(run_score(*two, "--metrics", "psnr", status=None), "000001.png", "whole PNG")


@pytest.mark.parametrize(
    ("mask", "word"),
    [
        (np.zeros((48, 40), bool), "proportions, 64 x 48 px (got 40 x 48 px)"),
        (np.random.default_rng(0).random((48, 64, 3)).astype(np.float32), "it has colours"),
        (np.full((48, 64, 3), 1 / 255, np.float32), "must be white in holes"),
    ],
)
def test_a_mask_that_does_not_fit(two, run_score, tmp_path, mask, word):
    encoded = encode_mask(mask) if mask.dtype == bool else encode_frame(mask, 8)
    (tmp_path / "mask.png").write_bytes(encoded)

    refused(
        run_score(*two, "--mask", tmp_path / "mask.png", "--metrics", "psnr", status=None),
        "mask.png",
        word,
    )


def test_too_few_masks(two, run_score, tmp_path, clips, frames_writer):
    frames_writer(tmp_path / "holes", clips.holes[:2])

    refused(run_score(*two, "--mask", tmp_path / "holes", status=None), "2 masks and 4 frames")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--metrics", "psnr,fvdp"], ["'fvdp'", "did you mean 'fvvdp'"]),
        (["--metrics", ""], ["--metrics"]),
        (["--metrics", "flicker"], ["no metric", "flicker"]),
        (["--display", "nowhere"], ["--display", "nowhere", "standard_fhd"]),
        (["--gaze", "70,10"], ["64 x 48 px (got 70, 10)"]),
        (["--gaze", "a,b"], ["two numbers", "a, b"]),
        (["--gaze", "gaze.csv"], ["there is no file 'gaze.csv'"]),
        (["--mask", "none.png"], ["none.png: the mask must exist"]),
    ],
)
def test_options_that_make_no_sense(two, run_score, arguments, words):
    refused(run_score(*two, *arguments, status=None), *words)


def test_a_gaze_file_with_too_few_lines(two, run_score, tmp_path):
    (tmp_path / "gaze.csv").write_text("x_px,y_px\n1,2\n3,4\n")

    refused(run_score(*two, "--gaze", tmp_path / "gaze.csv", status=None), "4 frames, got 2 lines")
    (tmp_path / "gaze.csv").write_text("x,y\n1,2\n")
    refused(
        run_score(*two, "--gaze", tmp_path / "gaze.csv", status=None),
        "columns x_px and y_px",
        "(got x, y)",
    )


def test_nothing_to_score(run_score, tmp_path, batch):
    refused(run_score(status=None), "give a folder of built clips")
    refused(run_score(tmp_path, status=None), "must hold a finished batch")
    refused(run_score(batch / "manifest.json", status=None), "this is a file", "REFERENCE")
    refused(run_score(batch, "--mask", "holes", status=None), "has masks of its own")


def test_a_batch_with_a_frame_missing(run_score, batch):
    (batch / "lawn__small__metameric" / "000002.png").unlink()

    refused(run_score(batch, status=None), "lawn__small__metameric/000002.png", "it is missing")


def test_a_folder_of_other_things_is_not_written_into(run_score, batch, tmp_path):
    out = tmp_path / "thesis"
    out.mkdir()
    (out / "chapter-1.tex").write_text("...")

    refused(run_score(batch, "--out", out, status=None), "it holds chapter-1.tex")
    shutil.rmtree(out)
    out.write_text("a file")
    refused(run_score(batch, "--out", out, status=None), "must be a folder")
    refused(
        run_score(batch, "--out", batch / "scores", status=None),
        "must not lie in the folder of clips",
    )
