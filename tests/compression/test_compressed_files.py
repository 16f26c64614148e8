"""`.metamer` files and their commands: damage, hostile headers, round trips, the sheet."""

import struct
import zlib

import numpy as np
import pytest
from command_line import outcome_of
from PIL import Image
from skimage import data

from pipeline.compression import compressed_file
from pipeline.compression.codec import CompressionSettings, compress, decompress
from pipeline.errors import InputError
from stimuli.compress.compress_files import compress_file
from stimuli.media.frames_folder import Reporter
from stimuli.media.video import unpacked_video, write_video

run = outcome_of()


@pytest.fixture(scope="module")
def picture():
    return (data.astronaut()[60:156, 120:216] / np.float32(255)).astype(np.float32)


@pytest.fixture(scope="module")
def whole(picture):
    return compressed_file.to_bytes(
        compress([picture], (48.0, 48.0), CompressionSettings(angles=64))
    )


@pytest.fixture
def png(tmp_path, picture):
    path = tmp_path / "picture.png"
    Image.fromarray(np.rint(255 * picture).astype(np.uint8)).save(path)
    return path


def sealed(body):
    """Give a body the checksum that it needs to be read."""
    return body + struct.pack("<I", zlib.crc32(body))


def test_every_changed_byte_is_found(whole, rng):
    for at in rng.integers(0, len(whole), 200):
        damaged = bytearray(whole)
        damaged[at] ^= int(rng.integers(1, 256))
        with pytest.raises(InputError):
            compressed_file.from_bytes(bytes(damaged))
    for cut in (0, 3, 20, len(whole) // 2, len(whole) - 1):
        with pytest.raises(InputError):
            compressed_file.from_bytes(whole[:cut])


@pytest.mark.slow
def test_hostile_files_get_a_message_or_a_picture(whole, rng, proof_count):
    """Changes under a checksum that holds: whoever made the file meant them."""
    read = longest = 0
    for _ in range(proof_count(3000)):
        body = bytearray(whole[:-4])
        for _ in range(int(rng.integers(1, 4))):
            # Mostly the header and the lengths.
            at = int(rng.integers(4, 130 if rng.random() < 0.8 else len(body)))
            body[at] = int(rng.integers(0, 256))
        try:
            held = compressed_file.from_bytes(sealed(bytes(body)))
            if max(held.grid.size) <= 512:
                decompress(held)
                read += 1
        except InputError as error:
            longest = max(longest, len(str(error)))
    assert read > 0
    assert 0 < longest < 400


@pytest.mark.parametrize(
    ("at", "form", "value", "message"),
    [
        (4, "B", 9, "version 1"),
        (8, "I", 0, "edges of 1 to"),
        (8, "I", 2**32 - 1, "edges of 1 to"),
        (16, "d", float("nan"), "gaze must lie"),
        (32, "H", 3, "angles must lie"),
        (34, "B", 7, "codec must be one of"),
        (36, "B", 5, "cannot have 5 levels"),
        (38, "I", 0, "must hold 1..100000 frames"),
        (38, "I", 12, "ends before"),
        (42, "H", 0, "at least 1 frame"),
    ],
)
def test_numbers_out_of_bounds_are_named(whole, at, form, value, message):
    body = bytearray(whole[:-4])
    struct.pack_into(f"<{form}", body, at, value)
    with pytest.raises(InputError, match=message):
        compressed_file.from_bytes(sealed(bytes(body)))


def test_bytes_behind_the_end_are_refused(whole):
    with pytest.raises(InputError, match="3 bytes more"):
        compressed_file.from_bytes(sealed(whole[:-4] + b"abc"))


def test_a_picture_of_another_size_inside_is_refused(whole, picture):
    other = compress([picture[:50, :50]], (25.0, 25.0), CompressionSettings(angles=64))
    mine = compressed_file.from_bytes(whole)
    mixed = compressed_file.CompressedPicture(
        mine.grid, mine.codec, mine.quality, mine.levels, other.bases, mine.statistics
    )
    with pytest.raises(InputError, match=r"must have .* px"):
        decompress(compressed_file.from_bytes(compressed_file.to_bytes(mixed)))


def test_a_rival_that_cannot_be_so_small_is_said_in_its_row(tmp_path, rng):
    """Plain, noise needs 2256 bytes."""
    png = tmp_path / "noise.png"
    Image.fromarray(rng.integers(0, 256, (192, 192, 3), np.uint8)).save(png)
    file, sheet = tmp_path / "p.metamer", tmp_path / "sheet.png"
    _, said, _ = run(
        "compress", png, "--out", file, "--gaze", "30,40", "--angles", "32", "--size-kb", "2",
        "--compare", sheet,
    )  # fmt: skip
    assert file.stat().st_size <= 2000
    assert "--compare has no plain" in said
    assert "bytes are too few" in said
    assert sheet.is_file()


def test_commands_make_a_file_and_a_picture(tmp_path, png, picture):
    file, back = tmp_path / "p.metamer", tmp_path / "back.png"
    _, said, _ = run(
        "compress", png, "--out", file, "--gaze", "30,40", "--angles", "64", "--size-kb", "2.5",
        "--compare", tmp_path / "sheet.png",
    )  # fmt: skip
    assert file.stat().st_size <= 2500
    assert "1:" in said
    assert "field of view: 40.0" in said
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.width > 600
    for options in ((), ("--numpy",)):
        _, said, _ = run("decompress", file, "--out", back, "--seed", "4", *options)
        with Image.open(back) as image:
            shown = np.asarray(image).astype(float) / 255
        wanted = decompress(compressed_file.read_compressed(file), seed=4)
        assert shown.shape == picture.shape
        assert np.abs(shown - wanted).max() <= 1.01 / 255


def test_work_that_takes_long_is_named_while_it_goes_on(tmp_path, png):
    told = []
    reporter = Reporter(told.append, lambda name, done, total: told.append((name, done, total)))

    compress_file(png, tmp_path / "a.metamer", compare=tmp_path / "s.png", reporter=reporter)

    named = [index for index, line in enumerate(told) if isinstance(line, tuple)]
    assert [told[index][0] for index in named] == ["compressing", "comparing"]
    assert "sharp up to" in told[named[0] + 1]


def test_what_a_size_leaves_unused_is_said(tmp_path, png):
    words = ("compress", png, "--out", tmp_path / "p.metamer", "--angles", "32", "--size-kb", "50")
    _, said, _ = run(*words)
    assert "more --angles" in said


def test_a_folder_is_a_clip(tmp_path, png):
    frames = tmp_path / "frames"
    frames.mkdir()
    for index in range(3):
        (frames / f"{index:06}.png").write_bytes(png.read_bytes())
    file = tmp_path / "clip.metamer"
    _, said, _ = run("compress", frames, "--out", file, "--angles", "64", "--hold", "2")
    assert "3 x 96 x 96 px" in said
    run("decompress", file, "--out", tmp_path / "back", "--numpy")
    names = sorted(path.name for path in (tmp_path / "back").iterdir())
    assert names == ["000000.png", "000001.png", "000002.png"]


def test_frames_share_statistics_and_one_picture_does_not(tmp_path, png):
    _, _, error = run("compress", png, "--out", tmp_path / "a.metamer", "--hold", "2", status=2)
    assert "--hold is for frames and videos" in error
    assert not (tmp_path / "a.metamer").exists()


def test_neither_the_picture_nor_frames_of_others_are_written_over(tmp_path, png):
    before = png.read_bytes()
    file = tmp_path / "clip.metamer"
    code, _, error = run("compress", png, "--out", file, "--compare", png, status=None)
    assert (code, png.read_bytes()) == (2, before)
    assert f"--compare: {png} is read by this command" in error
    frames, shown = tmp_path / "frames", tmp_path / "shown"
    for folder in (frames, shown):
        folder.mkdir()
        for index in range(2):
            (folder / f"{index:06}.png").write_bytes(before)
    assert run("compress", frames, "--out", file, "--angles", "64", status=None)[0] == 0
    code, _, error = run("decompress", file, "--out", shown, status=2)
    assert "must be empty or new" in error
    assert {path.read_bytes() for path in shown.iterdir()} == {before}


def test_a_video_is_compressed_as_its_frames_are_and_comes_back_as_one(tmp_path, png):
    frames = tmp_path / "frames"
    frames.mkdir()
    for index in range(2):
        turned = np.roll(np.asarray(Image.open(png)), 9 * index, axis=1)
        Image.fromarray(turned).save(frames / f"{index:06}.png")
    write_video(tmp_path / "walk.avi", sorted(frames.iterdir()), 24.0)
    for source in ("frames", "walk.avi"):
        words = ("--out", tmp_path / f"{source}.metamer", "--angles", "64")
        run("compress", tmp_path / source, *words)
    file = tmp_path / "walk.avi.metamer"
    assert file.read_bytes() == (tmp_path / "frames.metamer").read_bytes()
    back, video = tmp_path / "back", tmp_path / "made/back.avi"
    words = ("--out", back, "--video", video, "--fps", "12", "--numpy")
    run("decompress", file, *words)
    with unpacked_video(video) as found:
        assert (found.frames, found.fps) == (2, 12.0)
        for name in ("000000.png", "000001.png"):
            shown = (Image.open(folder / name) for folder in (found.folder, back))
            np.testing.assert_array_equal(*map(np.asarray, shown))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["compress", "PNG", "--size-kb", "2", "--quality", "3"], "not both"),
        (["compress", "PNG", "--size-kb", "0.2"], "too few"),
        (["compress", "PNG", "--codec", "gif"], "codec must be one of"),
        (["compress", "PNG", "--out", "x.jpg"], "must end in .metamer"),
        (["compress", "PNG", "--gaze", "9999999,0"], "gaze must lie within"),
        (["compress", "missing.png"], "no such file"),
        (["compress", ".", "--compare", "s.png"], "takes one picture, not frames"),
        (["decompress", "PNG"], "begins with MMLC"),
        (["decompress", "missing.metamer"], "no such file"),
        (["decompress", "CLIP", "--out", "one.png"], "OUT must be a folder"),
        (["decompress", "ONE", "--video", "v.mp4"], "--video is for clips"),
        (["decompress", "CLIP", "--out", "folder", "--video", "v.gif"], "must end in .mp4"),
        (["decompress", "ONE", "--out", "folder"], "must end in .png or .exr"),
    ],
)
def test_mistakes_get_one_message(tmp_path, monkeypatch, png, picture, words, message):
    monkeypatch.chdir(tmp_path)
    for name, count in (("one.metamer", 1), ("clip.metamer", 2)):
        made = compress([picture] * count, (48.0, 48.0), CompressionSettings(angles=32))
        (tmp_path / name).write_bytes(compressed_file.to_bytes(made))
    before = sorted(tmp_path.iterdir())
    named = {"PNG": png, "CLIP": "clip.metamer", "ONE": "one.metamer"}
    _, _, said = run(*(named.get(word, word) for word in words), status=2)
    assert message in said
    assert sorted(tmp_path.iterdir()) == before


def test_the_parts_of_a_file_are_written_as_pictures(tmp_path, png):
    steps = tmp_path / "parts"
    file = tmp_path / "picture.metamer"
    run("compress", png, "--out", file, "--angles", 64, "--steps", steps)
    names = ["picture", "cells", "maps", "density", "base", "shown"]
    numbered = [f"{number:02d}-{name}.png" for number, name in enumerate(names)]
    assert sorted(path.name for path in steps.glob("*.png")) == [*numbered, "sheet.png"]
    held = compressed_file.read_compressed(file)
    with Image.open(steps / "01-cells.png") as cells, Image.open(steps / "05-shown.png") as shown:
        assert cells.size == held.grid.shape[::-1]
        np.testing.assert_array_equal(np.asarray(shown), np.rint(255 * decompress(held)))

    _, _, _ = run(
        "compress", png, "--out", file, "--angles", 64, "--no-statistics", "--steps", steps
    )
    assert run("compress", png, "--out", file, "--steps", png, status=None)[0] == 2
