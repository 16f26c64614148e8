"""The probes on clips that were spoiled on purpose, by the command."""

import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from stimuli.batch.check import probe_batch
from stimuli.media.png import decode_png
from study_app.cli.stimuli_commands import app

SPOILED = "box__small__telea"
SOUND = "box__small__push-pull"


@pytest.fixture
def copy(batch, tmp_path):
    return Path(shutil.copytree(batch, tmp_path / "clips"))


def rewrite(copy, index, change):
    """Replace a frame of the spoiled clip by what `change` makes of it and its holes."""
    path = copy / SPOILED / f"{index:06d}.png"
    hole = decode_png(copy / f"holes/box__small/{index:06d}.png") > 0
    cv2.imwrite(str(path), change(decode_png(path).copy(), hole)[..., ::-1])


def probe(copy, *names):
    """Run the command; return its status and the row of each clip, by columns."""
    words = ["check", str(copy), *names, "--flicker"]
    result = CliRunner().invoke(app, words, env={"COLUMNS": "140"})
    rows = {}
    for line in result.stdout.splitlines():
        words = re.split(r"\s{2,}", line.strip())
        if "__" in words[0]:
            rows[words[0]] = words[1:]
    return result.exit_code, rows


def test_sound_clips_pass(batch):
    status, rows = probe(batch)
    assert status == 0
    assert len(rows) == 6
    assert all(row[2:] == ["none", "none"] for row in rows.values())


def test_frames_that_repeat_by_mistake_are_named(copy):
    for index in (2, 3):
        shutil.copy(copy / SPOILED / "000001.png", copy / SPOILED / f"{index:06d}.png")
    status, rows = probe(copy, SPOILED, SOUND)
    assert status == 1
    assert rows[SPOILED][2:] == ["2, 3", "none"]
    assert rows[SOUND][2:] == ["none", "none"]


def test_a_black_frame_is_named(copy):
    rewrite(copy, 2, lambda frame, _: np.zeros_like(frame))
    status, rows = probe(copy, SPOILED, SOUND)
    assert status == 1
    assert rows[SPOILED][2:] == ["none", "2"]
    assert rows[SOUND][2:] == ["none", "none"]


def test_flicker_in_the_holes_is_measured_and_pointed_out(copy):
    """Holes made white in every other frame; outside them nothing changes."""

    def white(frame, hole):
        frame[hole] = 255
        return frame

    before = {found.name: found for found in probe_batch(copy)}
    for index in (1, 3):
        rewrite(copy, index, white)
    after = {found.name: found for found in probe_batch(copy)}
    assert after[SPOILED].flicker > 3 * before[SPOILED].flicker
    assert after[SPOILED].flicker_ratio > 2 > before[SPOILED].flicker_ratio
    assert after[SPOILED].flickers
    assert after[SOUND] == before[SOUND]
    status, rows = probe(copy, SPOILED, SOUND)
    assert status == 0  # a measure of the method, not a mistake of the build
    assert rows[SPOILED][1].endswith("flickers")
    assert not rows[SOUND][1].endswith("flickers")


def test_holes_that_change_by_hand_give_their_mean_change(copy):
    """By hand: what is a hole in both frames goes from 40 to 60 of 255, so 20/255."""
    for index in range(4):
        value = (40, 60)[index % 2]

        def flat(frame, hole, value=value):
            frame[hole] = value
            return frame

        rewrite(copy, index, flat)
    (found,) = probe_batch(copy, [SPOILED])
    assert found.flicker == pytest.approx(20 / 255, rel=1e-5)


def test_an_unknown_clip_is_said(copy):
    result = CliRunner().invoke(app, ["check", str(copy), "box__small__telia", "--flicker"])
    assert result.exit_code == 2
    assert "did you mean 'box__small__telea'" in result.stderr


def test_clips_are_named_for_flicker_alone(copy):
    result = CliRunner().invoke(app, ["check", str(copy), SOUND])
    assert (result.exit_code, "are for --flicker" in result.stderr) == (2, True)
