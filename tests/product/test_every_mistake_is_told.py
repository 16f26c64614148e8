"""The mistakes that people make with material of their own: each has its message, and none builds.

One table, read by one test: a mistake, the command that meets it first, and what must be said.
Stereo pairs have `test_wrong_pairs.py` besides, and options of `new-study` `test_own_material.py`.
"""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import result_of

from pipeline.frame import SourceFrame
from pipeline.pictures.warp_input import WarpInput, save_warp_input
from protocols.load import shipped

MESH = (
    '[[stimuli.scenes]]\nname = "place"\nkind = "mesh"\nfile = "{}"\n'
    'camera = {{ kind = "circle" }}\n'
)
STEREO = (
    '[[stimuli.scenes]]\nname = "pair"\nkind = "stereo"\nleft = "{}"\nright = "{}"\n'
    'disparity = "{}"\nfocal_px = 370.0\nbaseline_m = 0.1\ncamera = {{ kind = "stereo" }}\n'
)
SEQUENCE = (
    '[[stimuli.scenes]]\nname = "shot"\nkind = "exr"\nfile = "{}"\n'
    'camera = {{ kind = "upsampling", real_every = 2 }}\n'
)
CIRCLE = 'camera = { kind = "circle", turns = 1.0 }'
METHOD = '[[stimuli.methods]]\nname = "mine"\nmethod = "{}"\n'


def scene(text: str, *names: str) -> tuple[str, str]:
    return ("[[stimuli.sizes]]", text.format(*names) + "\n[[stimuli.sizes]]")


def method(name: str) -> tuple[str, str]:
    return ("[stimuli.clips]", METHOD.format(name) + "\n[stimuli.clips]")


REFUSED = {
    # Pairs.
    "left and right exchanged": (scene(STEREO, "r.png", "l.png", "d.npy"), "exchanged"),
    "right is left": (scene(STEREO, "l.png", "l.png", "d.npy"), "the same picture"),
    "disparity in quarters": (scene(STEREO, "l.png", "r.png", "d4.npy"), "units_per_px = 4 fits"),
    "disparity as JPEG": (scene(STEREO, "l.png", "r.png", "d.jpg"), "jpeg changes them"),
    "depth for disparity": (scene(STEREO, "l.png", "r.png", "z.npy"), "no disparity (depth?)"),
    "pair of two sizes": (scene(STEREO, "l.png", "small.png", "d.npy"), "must be as large as"),
    "a disparity that is text": (scene(STEREO, "l.png", "r.png", "notes.txt"), "notes.txt"),
    # Sequences.
    "a sequence smaller than its clip": (scene(SEQUENCE, "shot.#.exr"), "set width_px = 120"),
    # Methods.
    "a misspelt method": (method("metamerik"), "did you mean 'metameric'"),
    "frames of other scenes in one folder": (method("frames:filled"), "must hold {scene}"),
    "an unknown word in braces": (method("frames:f/{name}/{scene}/{size}"), "may hold {scene}"),
    "a network that is none": (method("onnx:notes.txt"), "must be an ONNX model"),
    "a parameter that no method has": (
        ('name = "metameric"\nlabel', 'name = "metameric"\nparameters = { sead = 1 }\nlabel'),
        "sead",
    ),
    # Scenes.
    "a misspelt built-in scene": (('builtin = "garden"', 'builtin = "gardn"'), "'garden'"),
    "two scenes of one name": (('name = "colonnade"', 'name = "garden"'), "garden"),
    "a scene's name with a space": (('name = "garden"', 'name = "my garden"'), "lower-case"),
    "a path without a way": (
        (
            'camera = { kind = "circle", turns = 1.0 }',
            'camera = { kind = "upsampling", real_every = 2 }',
        ),
        "camera.along",
    ),
    "a pair's path for a mesh": (
        (CIRCLE, 'camera = { kind = "stereo" }'),
        "the stereo path needs a stereo pair",
    ),
    # Sizes and clips.
    "a share in percent": (("hole_share = 0.02", "hole_share = 2"), "less than 0.5"),
    "a share and an extent": (("hole_share = 0.02", "hole_share = 0.02\nextent_m = 0.1"), "either"),
    "degrees and pixels": (("width_deg = 8.0", "width_deg = 8.0\nwidth_px = 300"), "width_px"),
    "an odd number of pixels": (
        ("width_deg = 8.0\nheight_deg = 6.0", "width_px = 301\nheight_px = 200"),
        "a multiple of 2 pixels (got 301)",
    ),
    "a picture of 200 degrees": (("width_deg = 8.0", "width_deg = 200.0"), "less than 180"),
    "a clip that the display is too small for": (("width_deg = 8.0", "width_deg = 90.0"), "fit"),
    "a rate that no display shows": (("fps = 30.0", "fps = 25.0"), "30 fps or 20 fps"),
    "half a frame": (("duration_s = 1.0", "duration_s = 1.01"), "whole frames"),
    # The rest of a study.
    "a key misspelt": (("repeats = 2", "repaets = 2"), "did you mean 'repeats'"),
    "a section misspelt": (("[gaze]", "[gase]"), "did you mean 'gaze'"),
    "a number as text": (("gap_s = 0.5", 'gap_s = "0.5"'), "must be a number"),
    "a decimal comma": (("gap_s = 0.5", "gap_s = 0,5"), "line"),
    "a negative time": (("gap_s = 0.5", "gap_s = -0.5"), "gap_s"),
    "a gap between two refreshes": (("gap_s = 0.5", "gap_s = 0.505"), "whole"),
    "an unknown task": (('kind = "two-interval"', 'kind = "2afc"'), "two-interval"),
    "a pairing with nobody": (
        ('pairings = "all"', 'pairings = [["metameric", "pushpull"]]'),
        "did you mean 'push-pull'",
    ),
    "catch trials of one method": (('worse = "push-pull"', 'worse = "reference"'), "must differ"),
    "practice in no scene": (('scenes = ["garden"]', 'scenes = ["gardens"]'), "gardens"),
    "one key for two answers": (('["right", "j"]', '["left", "j"]'), "left"),
    "a key that is none": (('["right", "j"]', '["rigth", "j"]'), "a key: a letter"),
    "a language without texts": (('default_language = "en"', 'default_language = "fr"'), "fr"),
    "no such display": (('display = "fhd27-60hz"', 'display = "fhd28-60hz"'), "fhd27-60hz"),
}
NOTED = {
    "milliseconds for seconds": (("gap_s = 0.5", "gap_s = 500.0"), "seconds are meant"),
    "a session of a day": (("repeats = 2", "repeats = 300"), "people tire"),
    "clips of two pixels": (
        ("width_deg = 8.0\nheight_deg = 6.0", "width_deg = 0.05\nheight_deg = 0.05"),
        "shows little",
    ),
    "a mesh that is not there": (scene(MESH, "scenes/none.glb"), "the file is not there"),
    "a sequence that is not there": (scene(SEQUENCE, "none.####.exr"), "no file is called"),
    "folders of frames to come": (method("frames:f/{scene}/{size}"), "is not there"),
    "a network to come": (method("onnx:net.onnx"), "is not there"),
}
TABLES = {
    "no column of ours": ("Vpn;Wahl\n1;a\n", "metamerlab analysis import TABLE --map"),
    "the same method twice": ("participant,first,second,chosen\nP,a,a,a\n", "must differ"),
    "an answer that was not shown": (
        "participant,first,second,chosen\nP,a,b,c\n",
        "must be 'a' or",
    ),
    "a comma at the end": ("participant,first,second,chosen\nP,a,b,a,\n", "counts as a cell"),
    "a time in milliseconds": (
        "participant,first,second,chosen,rt_s\nP,a,b,a,99999999\n",
        "below a day",
    ),
    "a column twice": ("participant,first,second,first\nP,a,b,a\n", "names of their own"),
    "an empty table": ("participant,first,second,chosen\n", "at least one decision"),
    "not a table": ("", "must be a CSV table"),
}
run = result_of(catch_exceptions=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Pictures, disparities and files that the mistakes name."""
    made = tmp_path_factory.mktemp("mistakes")
    rng = np.random.default_rng(3)
    grey = cv2.GaussianBlur(rng.uniform(0, 1, (60, 130)), (0, 0), 1.0)
    grey = (255 * (grey - grey.min()) / np.ptp(grey)).astype(np.uint8)
    left, right = grey[:, :120], grey[:, 6:126]  # what left shows at x, right shows at x - 6
    for name, view in (("l", left), ("r", right), ("small", right[:30, :60])):
        cv2.imwrite(str(made / f"{name}.png"), cv2.merge([view] * 3))
    disparity = np.full((60, 120), 6.0, np.float32)
    np.save(made / "d.npy", disparity)
    np.save(made / "d4.npy", 4 * disparity)
    np.save(made / "z.npy", np.tile(np.linspace(1, 40, 120, dtype=np.float32), (60, 1)))
    cv2.imwrite(str(made / "d.jpg"), disparity.astype(np.uint8))
    (made / "notes.txt").write_text("notes")
    colour = np.dstack([left] * 3).astype(np.float32) / 255
    for number in range(1, 4):
        given = WarpInput(
            SourceFrame(colour, np.full((60, 120), 3.0, np.float32)),
            np.zeros((60, 120, 2), np.float32),
        )
        save_warp_input(made / f"shot.{number}.exr", given)
    filled = made / "filled"
    filled.mkdir()
    cv2.imwrite(str(filled / "000000.png"), cv2.merge([left] * 3))
    return made


def study(folder: Path, tmp_path: Path, change: tuple[str, str]) -> Path:
    text = shipped("studies")["demo"].read_text(encoding="utf-8")
    old, new = change
    assert old in text, old
    for file in folder.iterdir():
        (shutil.copytree if file.is_dir() else shutil.copyfile)(file, tmp_path / file.name)
    (tmp_path / "study.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    return tmp_path / "study.toml"


@pytest.mark.parametrize("mistake", REFUSED)
def test_a_mistake_of_a_study_is_refused_by_its_check(folder, tmp_path, mistake):
    change, said = REFUSED[mistake]
    done = run("protocol", "check", study(folder, tmp_path, change), status=2)
    told = " ".join(done.stderr.split())
    assert said in told
    assert len(done.stderr.splitlines()) <= 6, "one mistake is not told by many lines"


@pytest.mark.parametrize("mistake", NOTED)
def test_what_is_hardly_meant_or_still_to_come_is_noted(folder, tmp_path, mistake):
    change, said = NOTED[mistake]
    done = run("protocol", "check", study(folder, tmp_path, change))
    assert any(said in line for line in done.stdout.splitlines() if line.startswith("note: "))


@pytest.mark.parametrize("mistake", TABLES)
def test_a_mistake_in_a_table_is_refused_by_line_or_column(tmp_path, mistake):
    text, said = TABLES[mistake]
    (tmp_path / "old.csv").write_text(text)
    for command in ("report", "import"):
        done = run("analysis", command, tmp_path / "old.csv", "--out", tmp_path / command, status=2)
        assert said in " ".join(done.stderr.split())
        assert str(tmp_path / "old.csv") in done.stderr
        assert not (tmp_path / command).exists()
