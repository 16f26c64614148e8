"""Pictures and videos that were made elsewhere, taken into hashed clips: the recipe `files`."""

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import result_of
from PIL import Image
from video_patch import SEGMENT, TRACK, TRACKS, VIDEO, element, patched, without

from pipeline.errors import InputError
from protocols.disk.hashing import sha256_file
from protocols.errors import StudyError
from protocols.load import load_study
from protocols.manifest import read_manifest
from protocols.study_file.new_study import study_files
from stimuli.batch.check import check_batch
from stimuli.media.png import decode_png
from stimuli.recipes import builder_of
from stimuli.recipes.base import BuildMachine

DISPLAY = """
name = "desk"
width_px = 640
height_px = 480
width_mm = 192.0
height_mm = 144.0
distance_mm = 600.0
refresh_hz = 60.0
"""
metamerlab = result_of(terminal_width=100)
QUIET = lambda *_: None  # noqa: E731


def picture(seed: int, size=(24, 32)) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (*size, 3), dtype=np.uint8)


def stored(folder: Path, name: str) -> np.ndarray:
    return decode_png(folder / name / "000000.png")


class Study:
    """A study of files in a folder of its own, and what builds it."""

    def __init__(self, folder: Path, template: str, rows: dict[str, str], **keys: str) -> None:
        self.folder = folder
        self.text = template
        for key, value in {"width_px": "32", "height_px": "24", **keys}.items():
            line = next(row for row in self.text.splitlines() if row.startswith(f"{key} = "))
            self.text = self.text.replace(line, f"{key} = {value}", 1)
        self.table(rows)

    @property
    def path(self) -> Path:
        return self.folder / "study.toml"

    @property
    def clips(self) -> Path:
        return self.folder / "clips"

    def table(self, rows: dict[str, str]) -> None:
        """Write the table: every stimulus in one of the two scenes, half of them gratings."""
        lines = ["stimulus,file,scene,noise,pattern,contrast"]
        for index, (name, file) in enumerate(rows.items()):
            pattern = "grating" if index % 2 else "none"
            lines.append(f"{name},{file},one,fine,{pattern},0.2")
        (self.folder / "stimuli.csv").write_text("\n".join(lines) + "\n")
        self.path.write_text(self.text)

    def build(self, **where):
        study, display = load_study(self.path)
        builder = builder_of(study, display, self.folder)
        return builder.build(self.clips, BuildMachine(**where), QUIET)


@pytest.fixture(scope="session")
def template() -> str:
    from protocols.display import Display

    display = Display(
        name="desk", width_px=640, height_px=480, width_mm=192.0, height_mm=144.0,
        distance_mm=600.0, refresh_hz=60.0,
    )  # fmt: skip
    text = study_files("files-study", "Files", display, "yes-no")["study.toml"]
    text = text.replace('baseline = "fine"', "").replace('# scenes = ["one"]', "")
    return text.replace('display = "display.toml"', 'display = "desk.toml"')


@pytest.fixture
def study(tmp_path, template):
    """Return a function that makes a study of these files."""
    (tmp_path / "desk.toml").write_text(DISPLAY)

    def make(rows: dict[str, str], **keys: str) -> Study:
        return Study(tmp_path, template, rows, **keys)

    return make


@pytest.fixture
def stills(study, tmp_path):
    """Return a study of four PNG files."""
    for index in range(4):
        Image.fromarray(picture(index)).save(tmp_path / f"{index}.png")
    return study({f"s{index}": f"{index}.png" for index in range(4)})


@pytest.mark.parametrize("ending", ["png", "tif", "bmp", "ppm"])
def test_a_still_of_any_lossless_format_is_shown_with_exactly_its_pixels(study, tmp_path, ending):
    for index in range(2):
        Image.fromarray(picture(index)).save(tmp_path / f"{index}.{ending}")
    made = study({"a": f"0.{ending}", "b": f"1.{ending}"})

    outcome = made.build()

    assert outcome.built == ["a", "b"]
    assert np.array_equal(stored(made.clips, "a"), picture(0))
    assert np.array_equal(stored(made.clips, "b"), picture(1))
    clip = read_manifest(made.clips).clip("a")
    assert clip.condition == {"scene": "one", "noise": "fine", "pattern": "none", "contrast": 0.2}
    assert clip.frames_sha256 == (sha256_file(made.clips / "a" / "000000.png"),)
    assert check_batch(made.clips).in_order


def test_jpeg_and_grey_pictures_are_decoded_as_opencv_decodes_them(study, tmp_path):
    Image.fromarray(picture(0)).save(tmp_path / "0.jpg", quality=95)
    Image.fromarray(picture(1)[..., 0]).save(tmp_path / "1.png")
    made = study({"a": "0.jpg", "b": "1.png"})
    made.build()

    jpeg = cv2.imread(str(tmp_path / "0.jpg"))[..., ::-1].astype(int)
    assert abs(stored(made.clips, "a").astype(int) - jpeg).max() <= 2  # two decoders' rounding
    assert np.array_equal(stored(made.clips, "b"), np.repeat(picture(1)[..., :1], 3, axis=-1))


def _rgba(path: Path) -> None:
    alpha = np.full((24, 32, 1), 128, np.uint8)
    Image.fromarray(np.concatenate([picture(0), alpha], axis=-1)).save(path)


def _deep(path: Path) -> None:
    cv2.imwrite(str(path), picture(0).astype(np.uint16) * 257)


def _turned(path: Path) -> None:
    image = Image.fromarray(picture(0))
    exif = image.getexif()
    exif[0x0112] = 6
    image.save(path, exif=exif)


def _several(path: Path) -> None:
    first, second = (Image.fromarray(picture(seed)) for seed in (0, 1))
    first.save(path, save_all=True, append_images=[second])


def _cut(path: Path) -> None:
    Image.fromarray(picture(0)).save(path)
    path.write_bytes(path.read_bytes()[:-900])


@pytest.mark.parametrize(
    ("file", "write", "message"),
    [
        ("x.png", _rgba, "must be opaque"),
        ("x.png", _deep, "must have 8 bits per channel (has 16 bits)"),
        ("x.jpg", _turned, "must be stored upright (its Exif orientation is 6)"),
        ("x.tif", _several, "must hold one picture"),
        ("x.gif", _several, "must hold one picture"),
        ("x.png", _cut, "must be a whole image"),
        ("x.png", lambda path: path.write_text("no picture"), "must be an image"),
        ("x.png", lambda path: Image.fromarray(picture(0, (24, 33))).save(path),
         "must be 32 x 24 px, as the study says (got 33 x 24 px); no picture is rescaled"),
        ("x", lambda path: path.mkdir(), "a folder of frames is a video: give stimuli.fps"),
    ],
)  # fmt: skip
def test_a_still_that_cannot_be_shown_as_it_is_is_refused(study, tmp_path, file, write, message):
    write(tmp_path / file)
    Image.fromarray(picture(1)).save(tmp_path / "good.png")
    made = study({"a": file, "b": "good.png"})

    with pytest.raises(InputError) as caught:
        made.build()

    assert message in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / file))
    assert not (made.clips / "manifest.json").exists()


def test_check_finds_a_picture_of_another_size_without_decoding_it(stills, tmp_path):
    Image.fromarray(picture(1, (25, 33))).save(tmp_path / "1.png")
    whole = (tmp_path / "2.png").read_bytes()
    (tmp_path / "2.png").write_bytes(whole[: len(whole) // 2])  # for the build to find
    done = metamerlab("protocol", "check", stills.path, status=2)

    said = " ".join(done.stderr.split())
    assert "stimuli.csv: line 3: file" in said
    assert "must be 32 x 24 px, as the study says (got 33 x 25 px)" in said
    assert "line 4" not in said
    for name in ("0", "2", "3"):
        Image.fromarray(picture(1, (25, 33))).save(tmp_path / f"{name}.png")
    said = " ".join(metamerlab("protocol", "check", stills.path, status=None).stderr.split())
    assert "1 more files are of another size" in said
    assert said.count("must be 32 x 24 px") == 3


def test_every_bad_file_has_its_line(stills, tmp_path):
    Image.fromarray(picture(0, (9, 9))).save(tmp_path / "1.png")
    (tmp_path / "3.png").write_text("?")

    with pytest.raises(InputError) as caught:
        stills.build()

    lines = str(caught.value).splitlines()
    assert [line.split(":")[0] for line in lines] == [str(tmp_path / f"{k}.png") for k in (1, 3)]


def test_missing_files_are_told_before_anything_is_written(stills, tmp_path):
    (tmp_path / "2.png").unlink()

    with pytest.raises(StudyError, match=r"stimuli.csv: line 4: file: the file of 's2' is not"):
        stills.build()
    assert not stills.clips.exists()


def test_the_same_files_give_the_same_bytes(stills, tmp_path):
    stills.build(workers=1)
    first = {p.name: p.read_bytes() for p in stills.clips.rglob("*") if p.is_file()}
    shutil.rmtree(stills.clips)
    for index in range(4):
        os.utime(tmp_path / f"{index}.png", (1, 1))
    stills.build(workers=3)

    assert {p.name: p.read_bytes() for p in stills.clips.rglob("*") if p.is_file()} == first


def test_a_changed_file_is_taken_in_again_and_no_other(stills, tmp_path):
    stills.build()
    before = {p: p.stat().st_mtime_ns for p in stills.clips.glob("*/*.png")}
    Image.fromarray(picture(9)).save(tmp_path / "2.png")

    outcome = stills.build()

    assert outcome.built == ["s2"]
    assert outcome.kept == ["s0", "s1", "s3"]
    assert np.array_equal(stored(stills.clips, "s2"), picture(9))
    changed = {p.parent.name for p in before if p.stat().st_mtime_ns != before[p]}
    assert changed == {"s2"}
    assert stills.build().built == []


def test_a_damaged_frame_is_made_again(stills):
    stills.build()
    (stills.clips / "s1" / "000000.png").write_bytes(b"x")
    assert not check_batch(stills.clips).in_order

    assert stills.build().built == ["s1"]
    assert check_batch(stills.clips).in_order


def test_another_condition_makes_another_manifest_of_the_same_frames(stills):
    old = stills.build().manifest
    text = (stills.folder / "stimuli.csv").read_text()
    (stills.folder / "stimuli.csv").write_text(text.replace("s0,0.png,one", "s0,0.png,two"))

    outcome = stills.build()

    assert outcome.built == []
    assert outcome.manifest.clip("s0").condition["scene"] == "two"
    assert outcome.manifest.clip("s0").frames_sha256 == old.clip("s0").frames_sha256
    assert read_manifest(stills.clips) == outcome.manifest


def test_stimuli_that_are_gone_go_and_a_users_things_stay(stills):
    stills.build()
    stills.table({f"s{index}": f"{index}.png" for index in range(2)})
    stills.build()
    assert sorted(p.name for p in stills.clips.iterdir() if p.is_dir()) == ["s0", "s1"]

    (stills.clips / "mine").mkdir()
    with pytest.raises(StudyError, match=r"it holds mine"):
        stills.build()
    assert (stills.clips / "mine").is_dir()


def test_a_folder_called_like_a_stimulus_that_no_build_made_is_refused(stills):
    stills.build()
    stills.table({f"s{index}": f"{index}.png" for index in range(4)} | {"later": "0.png"})
    stills.table({"s0": "0.png", "s1": "1.png", "later": "2.png"})
    (stills.clips / "later").mkdir()
    (stills.clips / "later" / "mine.txt").write_text("mine")

    with pytest.raises(StudyError, match=r"it holds later"):
        stills.build()
    assert (stills.clips / "later" / "mine.txt").read_text() == "mine"


@pytest.mark.parametrize("name", ["holes", "previews"])
def test_names_of_the_batchs_own_folders_are_refused(stills, name):
    stills.table({"s0": "0.png", name: "1.png"})
    done = metamerlab("stimuli", "build", stills.path, "--out", stills.clips, status=2)
    assert "stimuli.csv: line 3: stimulus: must not be holes or previews" in done.stderr


def test_a_table_of_stimuli_holds_no_control_characters(stills):
    table = stills.folder / "stimuli.csv"
    table.write_text(table.read_text().replace(",fine,", ",fi\x1bne,", 1))
    with pytest.raises(StudyError, match=r"entries\[0\].*must hold no control characters"):
        load_study(stills.path)


def write_video(path: Path, frames: list[np.ndarray], fps: float) -> None:
    """Write a lossless video: FFV1 in Matroska."""
    height, width, _ = frames[0].shape
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), fps, (width, height))
    assert writer.isOpened()
    for frame in frames:
        writer.write(np.ascontiguousarray(frame[..., ::-1]))
    writer.release()


FRAMES = [picture(seed) for seed in range(6)]


@pytest.fixture
def videos(study, tmp_path):
    """Return a study of a video file and a folder of frames, six frames each."""
    write_video(tmp_path / "a.mkv", FRAMES, 30.0)
    (tmp_path / "b").mkdir()
    for index, frame in enumerate(FRAMES):
        Image.fromarray(frame[::-1]).save(tmp_path / "b" / f"frame{index:03d}.png")

    def make(rows=None, fps="30.0", duration_s="0.2"):
        made = study(rows or {"a": "a.mkv", "b": "b"})
        made.text = made.text.replace("# fps = 30.0", f"fps = {fps}")
        made.text = made.text.replace("# duration_s = 1.0", f"duration_s = {duration_s}")
        made.text = made.text.replace("stimulus_s = 0.5\n", "")
        made.path.write_text(made.text)
        return made

    return make


def test_every_frame_of_a_video_and_of_a_folder_is_taken_in_order(videos):
    made = videos()
    outcome = made.build()

    assert [len(clip.frames_sha256) for clip in outcome.manifest.clips] == [6, 6]
    for index, frame in enumerate(FRAMES):
        exact = decode_png(made.clips / "a" / f"{index:06d}.png").astype(int)
        assert abs(exact - frame).max() <= 3, index  # 8-bit YCbCr or RGB inside of the codec
        assert np.array_equal(decode_png(made.clips / "b" / f"{index:06d}.png"), frame[::-1])
    assert {clip.fps for clip in outcome.manifest.clips} == {30.0}
    assert len(list((made.clips / "previews").glob("*.webm"))) == 2
    assert check_batch(made.clips).in_order
    assert made.build().built == []


@pytest.mark.parametrize(
    ("rows", "keys", "message"),
    [
        ({"a": "a.mkv", "b": "b"}, {"duration_s": "0.1"},
         "must have 3 frames, duration_s x fps (got 6); cut it, or change duration_s"),
        ({"a": "a.mkv", "b": "b"}, {"duration_s": "0.3"}, "must have 9 frames"),
        ({"a": "a.mkv", "b": "a.mkv "}, {"fps": "60.0", "duration_s": "0.1"},
         "must have 60 frames per second, as the study says (it says 30)"),
        ({"a": "desk.toml", "b": "b"}, {}, "must be a video that OpenCV reads"),
        ({"a": "still.png", "b": "b"}, {}, "still.png: must"),
    ],
)  # fmt: skip
def test_videos_of_another_length_or_rate_are_refused(videos, tmp_path, rows, keys, message):
    Image.fromarray(picture(0)).save(tmp_path / "still.png")
    rows = {name: file.strip() for name, file in rows.items()}
    if len(set(rows.values())) < len(rows):
        shutil.copy(tmp_path / "a.mkv", tmp_path / "c.mkv")
        rows["b"] = "c.mkv"
    made = videos(rows, **keys)

    with pytest.raises(InputError) as caught:
        made.build()
    assert message in str(caught.value)


def test_a_changed_frame_of_a_folder_makes_its_clip_again(videos, tmp_path):
    made = videos()
    made.build()
    Image.fromarray(picture(99)).save(tmp_path / "b" / "frame003.png")
    assert made.build().built == ["b"]
    assert np.array_equal(decode_png(made.clips / "b" / "000003.png"), picture(99))


def test_the_commands_build_check_and_probe_it(stills):
    planned = metamerlab("stimuli", "build", stills.path, "--out", stills.clips, "--dry-run")
    assert "4, 32 x 24 px" in " ".join(planned.stdout.split())
    assert "measured reading " in " ".join(planned.stdout.split())
    assert not stills.clips.exists()

    built = metamerlab("stimuli", "build", stills.path, "--out", stills.clips)
    assert "4 stills built, 0 kept" in built.stdout
    metamerlab("stimuli", "check", stills.clips)
    metamerlab("stimuli", "check", stills.clips, "--flicker")
    refused = metamerlab(
        "stimuli", "score", stills.clips, "--out", stills.folder / "scores", status=2
    )
    assert "metamerlab stimuli score TEST REFERENCE" in " ".join(refused.stderr.split())


def test_the_contact_sheet_shows_every_still_and_no_player(stills):
    stills.build()
    page = (stills.clips / "contact-sheet.html").read_text()

    assert "4 stills, 32 x 24 px" in page
    assert page.count("data-clip=") == 4
    assert 'class="bar" hidden' in page
    assert "noise fine, pattern grating, contrast 0.2" in page


def test_a_cluster_is_refused_for_files(stills):
    done = metamerlab(
        "stimuli", "build", stills.path, "--out", stills.clips, "--scheduler", "tcp://x:1", status=2
    )
    assert "--scheduler is for stimuli that are computed" in " ".join(done.stderr.split())
    assert not stills.clips.exists()


@pytest.mark.slow
def test_killed_at_any_point_the_same_command_finishes_the_same_batch(
    study, tmp_path, repository, proof_count
):
    names = [f"k{index:02d}" for index in range(40)]
    for seed, name in enumerate(names):
        Image.fromarray(picture(seed)).save(tmp_path / f"{name}.png")
    made = study({name: f"{name}.png" for name in names})
    made.build()
    whole = {p.name: p.read_bytes() for p in made.clips.rglob("*") if p.is_file()}
    shutil.rmtree(made.clips)
    command = [
        sys.executable, "-c", "from study_app.cli import main; main()", "stimuli", "build",
        str(made.path), "--out", str(made.clips), "--workers", "1",
    ]  # fmt: skip
    killed = 0
    for turn in range(proof_count(20)):
        wanted = 3 + 37 * turn // max(1, proof_count(20))
        with subprocess.Popen(
            command, cwd=repository, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            env=os.environ | {"PYTHONPATH": str(repository)},
        ) as process:  # fmt: skip
            while process.poll() is None and len(list(made.clips.glob("k*/*.png"))) < wanted:
                time.sleep(0.001)
            killed += process.poll() is None
            process.send_signal(signal.SIGKILL)
        done = len(list(made.clips.glob("k*/000000.png")))
        outcome = made.build()
        assert len(outcome.kept) >= min(done, len(names)) - 1  # one may lack its note
        found = {p.name: p.read_bytes() for p in made.clips.rglob("*") if p.is_file()}
        assert {k: v for k, v in found.items() if k != "manifest.json"} == {
            k: v for k, v in whole.items() if k != "manifest.json"
        }
        assert json.loads(found["manifest.json"]) == json.loads(whole["manifest.json"])
        shutil.rmtree(made.clips)
    assert killed > 0


def circles(path: Path, across: int) -> None:
    """Write a circle of 80 px for who shows pixels `across` times as wide as high (case 11)."""
    y, x = np.mgrid[:240, :320]
    frames = []
    for number in range(6):
        frame = np.full((240, 320, 3), 90, np.uint8)
        frame[(across * (x - 60 - 6 * number)) ** 2 + (y - 120) ** 2 < 40**2] = (230, 200, 40)
        frames.append(frame)
    write_video(path, frames, 30.0)

    def wide(video: bytes) -> bytes:
        for name in (0x54B0, 0x54BA, 0x54B2):
            video = without(video, name)
        return video + element(0x54B0, across * 320) + element(0x54BA, 240)

    patched(path, (SEGMENT, TRACKS, TRACK, VIDEO), wide)


def shown_circle(clips: Path, name: str) -> list[int]:
    """Return how wide and high the circle is that participants see."""
    frame = decode_png(clips / name / "000003.png")
    inside = frame[..., 0] > 160
    return [int(inside.any(axis=axis).sum()) for axis in (0, 1)]


def test_a_video_of_wide_pixels_is_no_stimulus(videos, tmp_path):
    circles(tmp_path / "square.mkv", 1)
    circles(tmp_path / "wide.mkv", 2)
    made = videos({"a": "square.mkv", "b": "wide.mkv"})
    made.text = made.text.replace("width_px = 32", "width_px = 320")
    made.text = made.text.replace("height_px = 24", "height_px = 240")
    made.path.write_text(made.text)

    for command in (("protocol", "check"), ("stimuli", "build")):
        where = ("--out", made.clips) if command[1] == "build" else ()
        done = metamerlab(*command, made.path, *where, status=2)
        assert "wide.mkv: must have square pixels (to be shown as 640 x 240 px" in done.stderr
        assert "square.mkv" not in done.stderr
    assert not made.clips.exists()


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="no ffmpeg here")
def test_the_cure_for_wide_pixels_shows_a_circle(videos, tmp_path):
    circles(tmp_path / "wide.mkv", 2)
    made = videos({"a": "wide.mkv", "b": "wide-mended.mov"})
    made.text = made.text.replace("width_px = 32", "width_px = 640")
    made.text = made.text.replace("height_px = 24", "height_px = 240")
    (tmp_path / "wide-mended.mov").touch()
    made.path.write_text(made.text)
    with pytest.raises(InputError) as refused:
        made.build()
    command = shlex.split(str(refused.value).splitlines()[0].partition("such a file: ")[2])
    subprocess.run([*command, "-y", "-v", "error"], check=True)

    shutil.copy(tmp_path / "wide-mended.mov", tmp_path / "a.mov")
    made.table({"a": "a.mov", "b": "wide-mended.mov"})
    made.build()
    assert shown_circle(made.clips, "b") == pytest.approx([79, 79], abs=1)


def test_what_a_video_says_besides_is_told_and_recorded(videos, tmp_path):
    made = videos()
    sound = (
        element(0xD7, 2) + element(0x73C5, 2) + element(0x83, 2) + element(0x86, b"A_PCM/INT/LIT")
    )
    patched(tmp_path / "a.mkv", (SEGMENT, TRACKS), lambda tracks: tracks + element(TRACK, sound))

    done = metamerlab("stimuli", "build", made.path, "--out", made.clips)
    assert "note: a.mkv: its sound: not played" in done.stdout
    noted = [clip.parameters.get("noted") for clip in read_manifest(made.clips).clips]
    assert noted == ["its sound: not played", None]
