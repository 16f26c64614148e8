"""An OpenEXR sequence is shown as it is: its own motion, its own holes, pixel for pixel."""

import numpy as np
import pytest
from command_line import outcome_of
from pydantic import ValidationError

from pipeline.pictures.write import write_pixels
from protocols.load import shipped
from protocols.manifest import read_manifest
from protocols.recipes.warped_clips import BuiltinScene, Clips
from stimuli.batch.build import build
from stimuli.media.png import decode_png

CLIP_PX = (96, 64)  # width, height
MARGIN_PX = (12, 8)
FILE_PX = (CLIP_PX[0] + 2 * MARGIN_PX[0], CLIP_PX[1] + 2 * MARGIN_PX[1])
JUMP_PX = 6  # of the near square, from file to file
run = outcome_of()


def write_sequence(folder, frames: int, size_px: tuple[int, int]) -> list[np.ndarray]:
    """A square that jumps to the right before a wall at rest; return every frame's colour."""
    width, height = size_px
    rng = np.random.default_rng(4)
    wall = rng.uniform(0.1, 0.9, (height, width, 3)).astype(np.float32)
    square = rng.uniform(0.1, 0.9, (height // 2, width // 4, 3)).astype(np.float32)
    shown = []
    for number in range(frames):
        inside = np.zeros((height, width), bool)
        left = width // 4 + JUMP_PX * number
        inside[height // 4 : height // 4 + len(square), left : left + square.shape[1]] = True
        colour = wall.copy()
        colour[inside] = square.reshape(-1, 3)
        flow = np.zeros((height, width, 2), np.float32)
        flow[inside, 0] = JUMP_PX
        depth = np.where(inside, 2, 4).astype(np.float32)
        write_pixels(
            folder / f"s.{number:04d}.exr",
            np.concatenate([colour, depth[..., None], flow], axis=-1),
            ("R", "G", "B", "Z", "flow.x", "flow.y"),
            types=("float",) * 6,
        )
        shown.append(colour)
    return shown


SCENE = """[[stimuli.scenes]]
name = "shot"
kind = "exr"
file = "s.####.exr"
transfer = "linear"
camera = { kind = "upsampling", real_every = 2 }

"""


@pytest.fixture
def study(tmp_path):
    """The demo study of one sequence; sizes and clips may be changed."""

    def write(*changes: tuple[str, str], size_px=FILE_PX):
        text = shipped("studies")["demo"].read_text()
        head, rest = text.split("[[stimuli.scenes]]", 1)
        sizes = '[[stimuli.sizes]]\nname = "small"\n\n[[stimuli.methods]]\nname = "reference"\n\n'
        methods = '[[stimuli.methods]]\nname = "push-pull"\n\n[[stimuli.methods]]\nname = "telea"\n'
        text = head + SCENE + sizes + methods + "\n" + rest[rest.index("[stimuli.clips]") :]
        for old, new in (
            ("width_deg = 8.0", f"width_px = {CLIP_PX[0]}"),
            ("height_deg = 6.0", f"height_px = {CLIP_PX[1]}"),
            ("fps = 30.0", "fps = 10.0"),
            ("duration_s = 1.0", "duration_s = 0.4"),
            ('scenes = ["garden"]', 'scenes = ["shot"]'),
            ('size = "large"', 'size = "small"'),
            ('"metameric"', '"telea"'),
            *changes,
        ):
            assert old in text, old
            text = text.replace(old, new)
        path = tmp_path / "study.toml"
        path.write_text(text)
        return path, write_sequence(tmp_path, 4, size_px)

    return write


@pytest.fixture
def built(study, read_plan, inline, tmp_path):
    path, colours = study()
    build(read_plan(path), tmp_path / "clips", inline)
    return tmp_path / "clips", colours


def test_a_sequences_clips_are_the_middle_of_its_files_pixel_for_pixel(built):
    clips, colours = built
    x, y = MARGIN_PX
    for frame in range(4):
        shown = decode_png(clips / f"shot__small__reference/{frame:06d}.png")
        expected = np.rint(255 * colours[frame][y : y + CLIP_PX[1], x : x + CLIP_PX[0]])
        np.testing.assert_array_equal(shown, expected)


def test_outside_the_holes_a_fill_shows_the_moved_pixels_and_holes_are_the_motions(built):
    clips, _ = built
    for frame in (0, 1, 2, 3):
        hole = decode_png(clips / f"holes/shot__small/{frame:06d}.png") > 0
        real = decode_png(clips / f"shot__small__reference/{frame:06d}.png")
        filled = decode_png(clips / f"shot__small__push-pull/{frame:06d}.png")
        # A quad at a torn corner may reach half a pixel into it.
        assert (filled != real).any(axis=-1)[~hole].sum() <= 1
        # By hand: every second file is real; after one jump a strip of that width is uncovered.
        height = (CLIP_PX[1] + 2 * MARGIN_PX[1]) // 2
        assert abs(int(hole.sum()) - (0 if frame % 2 == 0 else JUMP_PX * height)) <= 1


def test_its_margin_is_the_files_own_and_its_extent_none(built):
    clip = read_manifest(built[0]).clips[0]
    assert clip.parameters["margin_px"] == min(MARGIN_PX)
    assert clip.parameters["extent_m"] == 0.0
    assert (clip.width_px, clip.height_px) == CLIP_PX


def test_a_hole_share_does_not_apply_and_check_says_so(study):
    path, _ = study(('name = "small"', 'name = "small"\nhole_share = 0.2'))
    _, said, _ = run("protocol", "check", path)
    assert "note: stimuli.scenes[0]: shot is a sequence with its own motion: hole_share" in said


@pytest.mark.parametrize(
    ("changes", "size_px", "said"),
    [
        ([], (80, 64), "at least as large as the clip, 96x64 px (they are 80x64); render it"),
        ([], (80, 65), "set width_px = 80 and height_px = 64 in stimuli.clips"),
        ([("duration_s = 0.4", "duration_s = 0.5")], (96, 64), "needs 5 frames (the sequence has"),
        ([("width_px = 96", "width_px = 95")], (96, 64), "must be a multiple of 2"),
        ([("height_px = 64", "height_deg = 6.0")], (96, 64), "or width_px and height_px (got"),
    ],
)
def test_what_a_sequence_cannot_show_is_refused_before_anything_is_built(
    study, changes, size_px, said
):
    path, _ = study(*changes, size_px=size_px)
    _, _, error = run("protocol", "check", path, status=2)
    assert said in error


def test_a_size_that_says_nothing_is_for_sequences_alone(study):
    path, _ = study(
        ('kind = "exr"\nfile = "s.####.exr"\ntransfer = "linear"', 'kind = "builtin"'),
        ("camera = { kind", 'builtin = "garden"\ncamera = { kind'),
        ("real_every = 2 }", 'real_every = 2, along = { kind = "circle" } }'),
    )
    _, _, error = run("protocol", "check", path, status=2)
    assert "stimuli.sizes[0]: a size says either hole_share or extent_m (got neither)" in error


def test_an_up_sampled_scene_without_files_of_motion_says_how_its_camera_moves():
    with pytest.raises(ValidationError, match=r"camera\.along must say how the camera moves"):
        BuiltinScene(
            kind="builtin", name="g", builtin="garden",
            camera={"kind": "upsampling", "real_every": 2},
        )  # fmt: skip


def test_pixels_and_degrees_are_told_in_a_preregistration_and_keep_old_hashes(study):
    path, _ = study()
    assert "(96 x 64 px, never rescaled)" in run("protocol", "preregister", path, status=None)[1]
    plain = Clips(width_deg=8.0, height_deg=6.0, fps=10.0, duration_s=1.0).model_dump()
    assert "width_px" not in plain
    assert "height_px" not in plain


@pytest.mark.parametrize(
    ("scale", "said"),
    [
        ("-1", "the flow leads the other way: motion_scale = 1"),
        ("0.125", "motion_scale = 0.125 * 8"),
    ],
)
def test_frames_that_do_not_follow_the_motion_are_refused_before_anything_is_built(
    study, tmp_path, scale, said
):
    path, _ = study(('transfer = "linear"', f'transfer = "linear"\nmotion_scale = {scale}'))
    for words in (("protocol", "check", path), ("stimuli", "build", path, "--out", tmp_path / "c")):
        _, _, error = run(*words, status=2)
        assert "stimuli.scenes[0]: s.0000.exr, s.0001.exr: outside the holes the warp must" in error
        assert said in error
    assert not (tmp_path / "c").exists()
