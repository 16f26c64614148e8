"""The task that docs/architecture.md writes from end to end, installed and run as a package."""

import json
import re

import pytest
from study_texts import short_study

pytestmark = pytest.mark.slow

STIMULI = """
kind = "files"
width_px = 64
height_px = 64
entries = [
  { name = "a-one", file = "a1.png", condition = { scene = "a", method = "one" } },
  { name = "a-two", file = "a2.png", condition = { scene = "a", method = "two" } },
  { name = "b-one", file = "b1.png", condition = { scene = "b", method = "one" } },
  { name = "b-two", file = "b2.png", condition = { scene = "b", method = "two" } },
]
"""
TASK = """
kind = "side-by-side"
separation_deg = 6.0
stimulus_s = 0.5
"""
ANALYSIS = """
kind = "preference"
primary = { method = "two", against = "one" }
"""


@pytest.fixture
def study(tmp_path):
    """The file of a study of two stills side by side."""
    path = tmp_path / "study.toml"
    text = short_study(
        name="stills", stimuli=STIMULI, task=TASK, answers=("left", "right"), analysis=ANALYSIS,
        design="repeats = 4",
    )  # fmt: skip
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def site(install_package, repository):
    """The folder in which the page's package is installed."""
    page = (repository / "docs" / "architecture.md").read_text(encoding="utf-8")
    (module,) = re.findall(r'```python\n(""".*?)```', page, flags=re.S)
    (entry_points,) = re.findall(r"```ini\n(.*?)```", page, flags=re.S)
    return install_package("side-by-side", {"side_by_side.py": module}, entry_points)


def test_the_task_of_the_architecture_page_runs_from_check_to_report(
    site, study, with_packages, tmp_path
):
    done = with_packages(
        site,
        ("protocol", "check", study),
        ("session", "simulate", study, "--out", "sessions", "--participants", 3,
         "--utility", "two=2"),
        ("analysis", "report", "sessions", "--protocol", study, "--out", "report", "--no-figures"),
    )  # fmt: skip

    assert done.returncode == 0, done.stderr
    lines = (tmp_path / "sessions" / "stills" / "S001" / "journal.jsonl").read_text().splitlines()
    attempt = next(json.loads(line) for line in lines if '"kind":"attempt"' in line)
    assert [phase["phase"] for phase in attempt["phases"]] == ["fixate", "both", "respond"]
    assert attempt["phases"][1]["stimuli"] == [0, 1]
    assert attempt["answers"] == ["left", "right"]
    results = json.loads((tmp_path / "report" / "results.json").read_text())
    assert results["results"]["preferences"]["primary"]["share"] > 0.5


def test_without_the_package_its_task_is_unknown_and_the_nearest_are_named(
    study, with_packages, tmp_path
):
    done = with_packages(tmp_path / "nothing", ("protocol", "check", study))

    assert done.returncode == 2
    assert "task.kind: must be one of two-interval, two-alternative" in done.stderr
