"""The shipped study `two-rates`, small: built, scored around its dot, simulated and reported."""

import csv
import json
import re

import numpy as np
import pytest
from built_study import write_small_study
from command_line import metamerlab

from protocols.load import load_display, load_protocol, load_study, shipped
from stimuli.batch.build import build
from stimuli.batch.build_plan import BuildPlan

BOX = """kind = "mesh"
file = "box.gltf"
view = { position_m = [0, 0, 0], look_at_m = [0, 0, -1], vertical_fov_deg = 60 }
"""


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Write the study with the box at both rates and 6 frames; the eye is near its screen."""
    folder = tmp_path_factory.mktemp("two-rates")
    write_small_study(folder)
    screen = shipped("displays")["fhd27-60hz"].read_text("utf-8")
    (folder / "near.toml").write_text(screen.replace("distance_mm = 700.0", "distance_mm = 100.0"))
    text = shipped("studies")["two-rates"].read_text("utf-8")
    text = re.sub(
        r'\[\[stimuli.scenes\]\]\nname = "(colonnade|thicket)-.*?\n\n', "", text, flags=re.S
    )
    for old, new in (
        ('display = "fhd27-60hz"', 'display = "near.toml"'),
        ("duration_s = 2.0", "duration_s = 0.1"),
        ("turns = 2.0", "turns = 0.2"),
        ("extent_m = 0.5", "extent_m = 0.1"),
        ('kind = "builtin"\nbuiltin = "garden"\nseed = 1\n', BOX),
        ("participants = 14", "participants = 2"),
    ):
        assert old in text
        text = text.replace(old, new)
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_shipped_study_asks_what_it_says():
    study = load_protocol(shipped("studies")["two-rates"])
    assert (study.task.kind, study.gaze.mode) == ("two-interval", "enforce")
    assert {scene.camera.real_every for scene in study.warped.scenes} == {2, 3}
    fills = [method for method in study.warped.methods if not method.is_reference]
    assert (len(study.warped.methods), len(fills)) == (5, 4)
    assert study.warped.clips.periphery.coarser == 2
    told = study.warped.described(load_display("fhd27-60hz"), ["garden-2"])
    assert "True view within 5 deg of (0, 0) deg." in told
    assert "Periphery in blocks of 2 px." in told


@pytest.mark.slow
@pytest.mark.usefixtures("gl_context")
def test_its_clips_are_scored_around_their_dot_and_by_ring(short, inline):
    """Without a word of the gaze: the clips say where their dot is, and how far the eye."""
    folder = short.parent
    plan = BuildPlan(*load_study(short), folder)
    build(plan, folder / "clips", inline)
    scores = folder / "scores"
    done = metamerlab(
        "stimuli", "score", folder / "clips", "--out", scores, "--workers", 1,
        "--metrics", "psnr,flicker-rings",
    )  # fmt: skip

    numbers = json.loads((scores / "scores.json").read_text())
    assert numbers["gaze_px"] == [[edge / 2 for edge in plan.shown_px]]
    degree_px = plan.distance_px * np.pi / 180
    assert numbers["display"]["px_per_deg"] == pytest.approx(degree_px, rel=0.01)
    ring = "flicker-rings 5 to 10 deg"
    for clip in numbers["clips"]:
        assert clip["scores"]["flicker-rings 0 to 5 deg"] == 0  # the true view
        assert clip["scores"][ring] > 0
    lines = csv.DictReader((scores / "tables.csv").read_text().splitlines())
    rows = [row for row in lines if row["region"] == "rings"]
    assert [row["scene"] for row in rows][:2] == ["0 to 5 deg", "5 to 10 deg"]
    fill = [clip["scores"][ring] for clip in numbers["clips"] if clip["method"] == "push-pull"]
    assert float(rows[1]["push-pull"]) == pytest.approx(np.mean(fill), abs=0.006)
    for said in (done.stdout, (scores / "scores.html").read_text("utf-8")):
        assert "5 to 10 deg" in said


@pytest.mark.slow
def test_its_sessions_are_simulated_and_reported(short, tmp_path):
    metamerlab("session", "simulate", short, "--out", tmp_path / "s", "--participants", 2)
    metamerlab("analysis", "report", tmp_path / "s", "--protocol", short, "--out", tmp_path / "r")
    page = (tmp_path / "r" / "report.html").read_text("utf-8")
    assert "Coherence transport" in page
    metamerlab("protocol", "preregister", short, "--out", tmp_path / "plan.html")
    said = "True view within 5 deg of (0, 0) deg"
    assert said in (tmp_path / "plan.html").read_text("utf-8")
