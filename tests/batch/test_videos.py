"""Videos go in where folders of frames do, and come out."""

import os
import resource
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import result_of

from pipeline.errors import InputError
from pipeline.pictures.colour_file import save_colour
from pipeline.pictures.drawing import save_picture
from pipeline.pictures.stored_frames import read_picture
from protocols.errors import StudyError
from stimuli.media.frames_folder import SILENT
from stimuli.media.picture_files import save_pictures
from stimuli.media.video import unpacked_video, write_video

run = result_of(catch_exceptions=False)


@pytest.fixture(scope="module")
def frames(tmp_path_factory) -> Path:
    """Four frames of a disc that moves, 64 x 48."""
    folder = tmp_path_factory.mktemp("clip") / "frames"
    folder.mkdir()
    y, x = np.mgrid[:48, :64]
    for number in range(4):
        disc = (x - 16 - 8 * number) ** 2 + (y - 24) ** 2 < 100
        grey = np.where(disc[..., None], (200, 60, 40), 60 + 2 * x[..., None])
        save_picture(folder / f"{number:06d}.png", grey.astype(np.uint8))
    return folder


@pytest.fixture(scope="module")
def lossless(frames) -> Path:
    path = frames.parent / "clip.avi"
    write_video(path, sorted(frames.iterdir()), 24.0)
    return path


def test_a_lossless_video_gives_back_every_pixel_and_its_rate(frames, lossless):
    with unpacked_video(lossless) as found:
        assert (found.frames, found.fps) == (4, 24.0)
        assert not found.notes
        for file in sorted(frames.iterdir()):
            np.testing.assert_array_equal(
                read_picture(found.folder / file.name), read_picture(file)
            )
        folder = found.folder
    assert not folder.exists()


def test_a_video_that_was_cut_short_says_so(tmp_path, rng):
    files = [tmp_path / f"{number:06d}.png" for number in range(4)]
    for file in files:
        save_picture(file, rng.integers(0, 256, (48, 64, 3)).astype(np.uint8))
    whole, cut = tmp_path / "whole.avi", tmp_path / "cut.avi"
    write_video(whole, files, 24.0)
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    with unpacked_video(cut) as found:
        assert found.frames < 3
        assert "of 4 frames" in found.notes[0]


@pytest.mark.parametrize("ending", [".mp4", ".webm"])
def test_a_lossy_video_is_near_and_complete(frames, tmp_path, ending):
    write_video(tmp_path / f"v{ending}", sorted(frames.iterdir()), 30.0)
    with unpacked_video(tmp_path / f"v{ending}") as found:
        assert found.frames == 4
        assert not found.notes
        assert found.fps == pytest.approx(30.0)
        last = read_picture(found.folder / "000003.png").astype(float)
        apart = [np.abs(last - read_picture(file)).mean() for file in sorted(frames.iterdir())]
        assert np.argmin(apart) == 3
        assert apart[3] < 12


def test_foveating_a_video_is_foveating_its_frames_and_writes_a_video(frames, lossless, tmp_path):
    words = ("--method", "blur", "--numpy", "--gaze", "10,10")
    run("foveate", frames, tmp_path / "a", *words)
    run("foveate", lossless, tmp_path / "b", *words, "--video", tmp_path / "b.avi")
    with unpacked_video(tmp_path / "b.avi") as shown:
        assert (shown.frames, shown.fps) == (4, 24.0)
        for number in range(4):
            name = f"{number:06d}.png"
            one, other = (read_picture(tmp_path / folder / name) for folder in "ab")
            np.testing.assert_array_equal(one, other)
            np.testing.assert_array_equal(one, read_picture(shown.folder / name))
    assert not np.array_equal(one, read_picture(frames / name))


def test_frames_of_16_bits_become_a_video_of_8(tmp_path, rng):
    (tmp_path / "deep").mkdir()
    colours = rng.integers(0, 65536, (2, 48, 64, 3)).astype(np.uint16)
    for number, colour in enumerate(colours):
        cv2.imwrite(str(tmp_path / "deep" / f"{number:06d}.png"), colour[..., ::-1])
    run("foveate", tmp_path / "deep", tmp_path / "out", "--method", "reference", "--numpy",
               "--gaze", "10,10", "--video", tmp_path / "v.avi")  # fmt: skip
    with unpacked_video(tmp_path / "v.avi") as shown:
        for number, colour in enumerate(colours):
            found = read_picture(shown.folder / f"{number:06d}.png")
            np.testing.assert_allclose(found, colour / 257, atol=0.51)
    save_colour(tmp_path / "float.exr", np.float32(colours[0] / 65535))
    with pytest.raises(InputError, match="must have 8 or 16 bits per channel"):
        write_video(tmp_path / "w.avi", [tmp_path / "float.exr"], 24.0)


def gone() -> int:
    """Return the number of a process that is no more."""
    with subprocess.Popen(["true"]) as process:
        process.wait()
    return process.pid


def test_a_frame_that_a_user_put_there_meanwhile_is_not_written_over(tmp_path):
    def shown():
        yield np.zeros((4, 4, 3), np.float32), 8
        (tmp_path / "new").mkdir()
        (tmp_path / "new" / "000000.png").write_text("precious")

    with pytest.raises(StudyError, match=r"it holds 000000\.png"):
        save_pictures(tmp_path / "new", ["000000.png"], shown(), SILENT)
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["000000.png"]
    assert (tmp_path / "new" / "000000.png").read_text() == "precious"


def test_what_killed_commands_left_of_one_picture_goes_with_the_next(frames, tmp_path):
    out, dead = tmp_path / "out.png", gone()
    for name in (f".out.{dead}.tmp.png", f".out.png.{dead}.part"):
        (tmp_path / name).write_bytes(b"half")
    kept = [f".out.png.{os.getppid()}.part", f".thesis.{dead}.part", f".out.txt.{dead}.part"]
    for name in kept:
        (tmp_path / name).write_bytes(b"precious")
    run("foveate", frames / "000000.png", out, "--method", "reference", "--numpy")
    assert {path.name for path in tmp_path.iterdir() if path.is_file()} == {*kept, "out.png"}


def test_scoring_a_video_gives_its_frames_scores_at_its_rate(frames, lossless, tmp_path):
    second = tmp_path / "frames"
    second.mkdir()
    for file in frames.iterdir():
        save_picture(second / file.name, read_picture(file) // 2)
    by_folder, by_video = (
        run(
            "stimuli",
            "score",
            given,
            second,
            "--metrics",
            "psnr,ssim",
            "--workers",
            "1",
            status=None,
        )
        for given in (frames, lossless)
    )
    assert by_folder.exit_code == 0, by_folder.output
    assert by_video.exit_code == 0, by_video.output
    numbers = [
        [word for word in done.stdout.split() if word.replace(".", "").isdigit()]
        for done in (by_folder, by_video)
    ]
    assert numbers[0] == numbers[1] != []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["{v}", "{o}", "--video", "x.gif"], "x.gif: must end in .mp4 or .webm or .avi"),
        (["{p}", "{o}.png", "--video", "x.mp4"], "--video is for a folder of frames or a video"),
        (["{b}", "{o}"], "must be a video that OpenCV reads"),
        (["{v}", "{o}", "--compare", "x.png"], "takes one picture"),
    ],
)
def test_mistakes_with_videos_are_told(frames, lossless, tmp_path, words, said):
    (tmp_path / "bad.mp4").write_bytes(b"no video")
    places = {"v": lossless, "p": frames / "000000.png", "b": tmp_path / "bad.mp4",
              "o": tmp_path / "o"}  # fmt: skip
    done = run("foveate", *(word.format(**places) for word in words), "--numpy", status=2)
    assert said in " ".join(done.stderr.split())


@pytest.mark.parametrize("ending", [".avi", ".mp4", ".webm"])
def test_a_video_on_a_full_disk_is_not_kept(tmp_path, rng, ending):
    """The system takes no more bytes, and OpenCV reports success: frames or the index are short."""
    files = [tmp_path / f"{number:06d}.png" for number in range(8)]
    for file in files:
        save_picture(file, rng.integers(0, 256, (48, 64, 3)).astype(np.uint8))
    path = tmp_path / f"v{ending}"
    write_video(path, files, 24.0)
    whole = path.read_bytes()
    path.unlink()
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    for size in (0, len(whole) // 3, len(whole) * 9 // 10, len(whole) - 20, len(whole) - 1):
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, limit[1]))
        try:
            with pytest.raises(InputError, match=f"v{ending}: cannot be written.*free some space"):
                write_video(path, files, 24.0)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        assert sorted(tmp_path.iterdir()) == files
    write_video(path, files, 24.0)
    assert path.read_bytes() == whole


def test_a_frame_that_the_video_lost_is_told(frames, tmp_path, monkeypatch):
    class Lossy:
        fourcc, real, count = cv2.VideoWriter.fourcc, cv2.VideoWriter, 0

        def __init__(self, *words):
            self.writer = self.real(*words)
            self.isOpened, self.release = self.writer.isOpened, self.writer.release

        def write(self, image):
            self.count += 1
            if self.count != 2:
                self.writer.write(image)

    monkeypatch.setattr(cv2, "VideoWriter", Lossy)
    with pytest.raises(InputError, match="of 4 frames only 3 arrived"):
        write_video(tmp_path / "v.avi", sorted(frames.iterdir()), 24.0)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_takes_no_video_is_told_by_its_reason(frames, tmp_path):
    (tmp_path / "v.avi").mkdir()
    with pytest.raises(IsADirectoryError) as told:
        write_video(tmp_path / "v.avi", sorted(frames.iterdir()), 24.0)
    assert told.value.filename == str(tmp_path / "v.avi")
    assert [path.name for path in tmp_path.iterdir()] == ["v.avi"]


def test_a_video_that_cannot_be_written_leaves_nothing(frames, tmp_path):
    odd = tmp_path / "odd.png"
    save_picture(odd, np.zeros((47, 63, 3), np.uint8))
    with pytest.raises(InputError, match="needs even edges"):
        write_video(tmp_path / "v.mp4", [odd], 30.0)
    with pytest.raises(InputError, match="as the frame before"):
        write_video(tmp_path / "v.avi", [frames / "000000.png", odd], 30.0)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["odd.png"]
