"""Clips that a build made are scored as they are: masks, references."""

import json

import pytest
from typer.testing import CliRunner

from stimuli.batch.build import build
from study_app.cli.stimuli_commands import app


@pytest.mark.slow
def test_a_build_is_scored_by_the_command(gl_context, plan, inline, tmp_path):  # noqa: ARG001
    build(plan, tmp_path / "clips", inline)
    out = tmp_path / "scores"
    wanted = ["--metrics", "psnr,ssim,flicker,statistics", "--workers", "1"]

    done = CliRunner().invoke(app, ["score", str(tmp_path / "clips"), "--out", str(out), *wanted])

    assert done.exit_code == 0, done.output
    numbers = json.loads((out / "scores.json").read_text())
    assert {clip["scene"] for clip in numbers["clips"]} == {"box", "motorcycle"}
    assert "fill_ms" not in numbers  # the same on every machine
    for clip in numbers["clips"]:
        # The fill alone is worse than the frame that it is a part of.
        assert clip["scores"]["psnr holes"] < clip["scores"]["psnr frame"]
        assert 0 < clip["scores"]["statistics holes"] < 1
    page = (out / "scores.html").read_text()
    assert "Scene by scene" in page
