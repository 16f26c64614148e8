"""A lab's package brings task, recipe, fill method, metric, tracker, analysis, part; one study
uses all of them, without a change of ours.

`tests/lab` is the package, as it lies where it is installed.
"""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from study_texts import short_study

pytestmark = pytest.mark.slow

EDGE_PX = 64
STIMULI = f"""
kind = "lab-ramps"
fills = {{ mean = "lab-mean", telea = "telea" }}
edge_px = {EDGE_PX}
"""
TASK = """
kind = "lab-above"
separation_deg = 3.0
stimulus_s = 0.8
"""
TRIAL = """
fixation_s = 0.1
iti_s = 0.1
dropped_frames_max = 10000
"""
ANALYSIS = """
kind = "lab-choice"
primary = { method = "whole", against = "mean" }
"""


@pytest.fixture
def study(start_study):
    """The lab's study, for the little display."""
    made = start_study()
    text = short_study(
        name="lab", display="little.toml", stimuli=STIMULI, task=TASK, answers=("upper", "lower"),
        analysis=ANALYSIS, design="repeats = 1", trial=TRIAL, gaze='mode = "enforce"',
    )  # fmt: skip
    made.path.write_text(text, encoding="utf-8")
    return made


def filled_by_hand(scene: str) -> tuple[np.ndarray, np.ndarray]:
    """A ramp from .2 to .8, and the same with the mean of the rest in its upper left quarter."""
    ramp = np.broadcast_to(0.2 + 0.6 * np.arange(EDGE_PX) / (EDGE_PX - 1), (EDGE_PX, EDGE_PX))
    whole = ramp if scene == "a" else ramp.T
    known = np.ones((EDGE_PX, EDGE_PX), bool)
    known[: EDGE_PX // 2, : EDGE_PX // 2] = False
    return whole, np.where(known, whole, whole[known].mean())


def test_a_study_of_a_labs_own_parts_runs_from_check_to_report(
    screen, study, lab_site, with_packages
):
    folder, clips, sessions = study.folder, study.stimuli, study.sessions
    changed = folder / "changed.toml"
    changed.write_text(study.path.read_text().replace('telea = "telea"', 'telea = "lab-mean"'))

    done = with_packages(
        lab_site,
        ("protocol", "check", study.path),
        ("protocol", "preregister", study.path, "--out", folder / "prereg.md"),
        ("stimuli", "build", study.path, "--out", clips),
        ("stimuli", "check", clips),
        *(
            ("stimuli", "score", clips / f"{scene}-mean" / "000000.png",
             clips / f"{scene}-whole" / "000000.png", "--metrics", "lab-error", "--out",
             folder / f"scores-{scene}")
            for scene in "ab"
        ),
        screen.session("run", study, "--simulate", "--gaze", "steady:320,240", "--skip-validation"),
        ("session", "simulate", study.path, "--stimuli", clips, "--out", sessions,
         "--participants", 2),
        ("analysis", "report", sessions, "--protocol", study.path, "--out", folder / "report",
         "--no-figures"),
        ("analysis", "power", study.path, "--rate", 0.9, "--set", "scene_sd=0", "--studies", 100,
         "--out", folder / "power"),
        ("stimuli", "build", changed, "--out", clips),
        env=screen.env,
    )  # fmt: skip

    assert done.returncode == 0, done.stdout + done.stderr
    # The recipe's builder drew the ramps, and the lab's method filled them.
    for scene in "ab":
        whole, filled = filled_by_hand(scene)
        for name, wanted in (("whole", whole), ("mean", filled)):
            with Image.open(clips / f"{scene}-{name}" / "000000.png") as image:
                shown = np.asarray(image.convert("RGB")) / 255
            assert np.abs(shown - wanted[..., None]).max() <= 0.5001 / 255
        with (folder / f"scores-{scene}" / "scores.csv").open() as file:
            (row,) = csv.DictReader(file)
        assert "Where the error is." in (folder / f"scores-{scene}" / "scores.html").read_text()
        assert float(row["value"]) == pytest.approx(np.abs(whole - filled).mean(), abs=1e-3)
        assert (row["metric"], row["region"]) == ("lab-error", "frame")
    assert "2 stills built, 4 kept" in done.stdout
    assert "one above the other for 0.8 s" in (folder / "prereg.md").read_text()
    # The lab's tracker was asked: it looked away once, and the trial came again.
    start, attempts = journal_lines(sessions / "lab" / "P01" / "journal.jsonl")
    assert start["gaze"]["source"] == "steady"
    assert [attempt["void_reason"] for attempt in attempts] == ["gaze-break"] + [None] * 6
    assert attempts[1]["gaze"]["max_deg"] < 0.1 < attempts[0]["gaze"]["max_deg"]
    # The lab's task said what was shown.
    assert attempts[1]["answers"] == ["upper", "lower"]
    assert [phase["phase"] for phase in attempts[1]["phases"]] == ["fixate", "both", "respond"]
    # The lab's analysis wrote the page.
    results = json.loads((folder / "report" / "results.json").read_text())
    primary, picked = results["results"]["preferences"]["primary"], []
    for path in (sessions / "lab").glob("*/journal.jsonl"):
        for attempt in journal_lines(path)[1]:
            pair = {attempt["condition"][side] for side in ("upper", "lower")}
            if attempt["outcome"] == "completed" and pair == {"whole", "mean"}:
                picked.append(attempt["condition"][attempt["answer"]] == "whole")
    assert len(picked) == 3 * 2  # people, scenes
    assert (primary["trials"], primary["chosen"]) == (len(picked), sum(picked))
    page = (folder / "report" / "report.html").read_text(encoding="utf-8")
    assert "The lab found: " in page
    # The lab's own statistic stands in section, sentences, methods, numbers and tables.
    fast = results["results"]["lab_fast"]["share"]
    assert page.count(f"{100 * fast:.0f} % of answers came within 0.5 s.") == 2
    assert '<h2 id="lab-fast">Fast answers</h2>' in page
    assert "The lab counted answers within 0.5 s." in page
    table = (folder / "report" / "tables" / "lab-fast.csv").read_text()
    assert table.splitlines()[0] == "share,median_s,notes"
    # The lab's planned test has a power too: of a sign test of six people or more.
    found = json.loads((folder / "power" / "power.json").read_text())
    sides = dict(zip(found["participants"], found["also"]["lab sides"], strict=True))
    assert sides[min(sides)] < 0.5 < 0.9 < sides[max(sides)]
    assert max(found["also"]["lab sides: false positives"]) < 0.15


def journal_lines(path: Path):
    """The first line and those of the attempts; our reader does not know the lab's task here."""
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return lines[0], [line for line in lines if line["kind"] == "attempt"]
