"""The task that docs/architecture.md writes from end to end, installed and run as a package."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

MAIN = "from study_app.cli import main; main()"
STUDY = """
format = 2
[study]
name = "stills"
title = "Two stills side by side"
participants = 3
[display]
display = "fhd27-60hz"
[stimuli]
kind = "files"
width_px = 64
height_px = 64
entries = [
  { name = "a-one", file = "a1.png", condition = { scene = "a", method = "one" } },
  { name = "a-two", file = "a2.png", condition = { scene = "a", method = "two" } },
  { name = "b-one", file = "b1.png", condition = { scene = "b", method = "one" } },
  { name = "b-two", file = "b2.png", condition = { scene = "b", method = "two" } },
]
[task]
kind = "side-by-side"
separation_deg = 6.0
stimulus_s = 0.5
[design]
repeats = 4
side = "fixed"
seed = 5
[trial]
[gaze]
mode = "none"
[response]
[text]
default_language = "en"
[text.languages.en]
consent = "Do you agree?"
instructions = ["Look."]
practice = "Practice."
start = "Start."
question = "Which do you prefer?"
answers = { left = "left", right = "right" }
break_page = "Break."
paused = "Paused."
gaze_lost = "Look at the dot."
too_late = "Too late."
preparing = "Preparing."
quit_question = "Stop?"
thanks = "Thank you."
[analysis]
kind = "preference"
primary = { method = "two", against = "one" }
[privacy]
"""


@pytest.fixture
def package(tmp_path: Path, repository: Path) -> Path:
    """Return a folder in which the page's package is installed."""
    page = (repository / "docs" / "architecture.md").read_text(encoding="utf-8")
    (module,) = re.findall(r'```python\n(""".*?)```', page, flags=re.S)
    (entries,) = re.findall(r"```ini\n(.*?)```", page, flags=re.S)
    site = tmp_path / "site"
    info = site / "side_by_side-1.dist-info"
    info.mkdir(parents=True)
    (site / "side_by_side.py").write_text(module, encoding="utf-8")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: side-by-side\nVersion: 1\n")
    (info / "entry_points.txt").write_text(entries, encoding="utf-8")
    return site


@pytest.fixture
def metamerlab(package: Path, repository: Path):
    """Return a function that runs the command line with the package installed."""

    def run(*words: object) -> subprocess.CompletedProcess[str]:
        paths = os.pathsep.join([str(package), str(repository)])
        return subprocess.run(
            [sys.executable, "-c", MAIN, *map(str, words)],
            env=os.environ | {"PYTHONPATH": paths},
            capture_output=True,
            text=True,
            check=False,
        )

    return run


def test_the_task_of_the_architecture_page_runs_from_check_to_report(metamerlab, tmp_path):
    study, sessions = tmp_path / "study.toml", tmp_path / "sessions"
    study.write_text(STUDY, encoding="utf-8")

    simulated = ("--participants", 3, "--utility", "two=2")
    reported = ("--protocol", study, "--out", tmp_path / "report", "--no-figures")
    for words in (
        ("protocol", "check", study),
        ("session", "simulate", study, "--out", sessions, *simulated),
        ("analysis", "report", sessions, *reported),
    ):
        done = metamerlab(*words)
        assert done.returncode == 0, done.stderr

    attempt = next(
        json.loads(line)
        for line in (sessions / "stills" / "S001" / "journal.jsonl").read_text().splitlines()
        if '"kind":"attempt"' in line
    )
    assert [phase["phase"] for phase in attempt["phases"]] == ["fixate", "both", "respond"]
    assert attempt["phases"][1]["stimuli"] == [0, 1]
    assert attempt["answers"] == ["left", "right"]
    results = json.loads((tmp_path / "report" / "results.json").read_text())
    assert results["results"]["primary"]["share"] > 0.5


def test_without_the_package_its_task_is_unknown_and_the_nearest_are_named(repository, tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(STUDY, encoding="utf-8")

    done = subprocess.run(
        [sys.executable, "-c", MAIN, "protocol", "check", str(study)],
        cwd=repository, capture_output=True, text=True, check=False,
    )  # fmt: skip

    assert done.returncode == 2
    assert "task.kind: must be one of two-interval, two-alternative" in done.stderr
