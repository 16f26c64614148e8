"""docs/running-a-study.md, followed to the letter: its commands, its program, its TOML.

Only the study is smaller, and what needs a person or a tracker is done by a program: an artificial
observer sits for P01, and a robot moves the cursor and presses keys for the pilot by mouse.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import threading
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from study_texts import with_values

from protocols.journal import Attempt, SessionResume
from protocols.journal_file import read_journal

pytestmark = pytest.mark.slow

GUIDE = Path(__file__).resolve().parents[2] / "docs" / "running-a-study.md"
SMALLER = {
    "study.toml": {
        "width_deg": "2.75",
        "height_deg": "1.9",
        "duration_s": "0.1",
        "pairings": '[["coherence-transport", "push-pull"]]',
        "repeats": "1",
        "blocks": "1",
        "fixation_s": "0.1",
        "gap_s": "0.1",
        "iti_s": "0.1",
        "dropped_frames_max": "10000",  # a busy machine misses refreshes
        "loss_max_share": "1.0",
        "silence_s": "5.0",
    },
    "display.toml": {
        "width_px": "640",
        "height_px": "480",
        "width_mm": "192.0",
        "height_mm": "144.0",
        "distance_mm": "600.0",
    },
}


def blocks(language: str) -> list[str]:
    text = GUIDE.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.M | re.S)


def commands() -> list[list[str]]:
    lines = "".join(blocks("bash")).replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True) for line in lines if line.strip()]


def make_smaller(folder: Path) -> None:
    for name, values in SMALLER.items():
        text = with_values((folder / name).read_text(encoding="utf-8"), values)
        if name == "study.toml":
            # One size, one built-in scene, neither practice nor catch trials.
            text = re.sub(r'\[\[stimuli\.scenes\]\]\nname = "shed".*?\n\n', "", text, flags=re.S)
            text = re.sub(r'\[\[stimuli\.sizes\]\]\nname = "large".*?\n\n', "", text, flags=re.S)
            text = re.sub(
                r"^\[(task\.catch|design\.practice)\]\n.*?\n(?=\[)", "", text, flags=re.M | re.S
            )
        (folder / name).write_text(text, encoding="utf-8")


def bring_scenes(folder: Path) -> None:
    """Put a 3D file and a pair of photographs of one's own into the study's folder."""
    rng = np.random.default_rng(1)
    scene = trimesh.Scene()
    for extents, place, colour in [
        ((40, 0.1, 40), (0, -0.05, -10), (120, 110, 90)),
        ((40, 20, 0.1), (0, 10, -6), (150, 160, 170)),
        *(
            (rng.uniform(0.2, 0.8, 3), rng.uniform((-2, 0.2, -4), (2, 1.6, -1)), rgb)
            for rgb in rng.integers(40, 230, (12, 3))
        ),
    ]:
        box = trimesh.creation.box(extents)
        box.visual.vertex_colors = (*colour, 255)
        box.apply_translation(place)
        scene.add_geometry(box)
    scene.export(folder / "scenes" / "place.glb")

    # A wall of noise, and before it a square of noise that the right camera sees 56 px to the left.
    wall, square = rng.integers(0, 256, (240, 360, 3)), rng.integers(0, 256, (160, 90, 3))
    for side, shift in (("left", 0), ("right", 56)):
        picture = np.roll(wall, -8 if side == "right" else 0, axis=1).astype(np.uint8)
        picture[40:200, 200 - shift : 290 - shift] = square
        Image.fromarray(picture).save(folder / "scenes" / f"{side}.png")


def add_scenes(folder: Path, seen: int) -> None:
    """Paste the guide's scenes below the others, as it says; `seen` of its TOML blocks."""
    path = folder / "study.toml"
    mark = "[[stimuli.sizes]]"
    text = path.read_text(encoding="utf-8")
    assert mark in text
    path.write_text(
        text.replace(mark, "\n".join(blocks("toml")[:seen]) + "\n" + mark, 1), encoding="utf-8"
    )


def lose_power(folder: Path) -> None:
    """Leave a journal as a power cut does: one decision, and half a line."""
    path = folder / "journal.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    at = [i for i, line in enumerate(lines) if b'"kind":"attempt"' in line][1]
    path.write_bytes(b"".join(lines[:at]) + lines[at][:40])


class Robot:
    """Keeps the cursor on the dot, turns pages and answers, until it is stopped."""

    def __init__(self, screen) -> None:
        self._screen, self._over = screen, threading.Event()
        self._thread = threading.Thread(target=self._work)

    def __enter__(self) -> Robot:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _work(self) -> None:
        while not self._over.wait(0.25):
            subprocess.run(
                ["xdotool", "mousemove", "320", "240", "key", "space", "key", "Left", "key",
                 "Return"],
                env=self._screen.env,
                check=False,
                capture_output=True,
            )  # fmt: skip


def adapted(words: list[str]) -> tuple[list[str], bool]:
    """Return the command for a screen without a monitor, and whether the robot is needed."""
    if words[1:3] == ["stimuli", "build"]:
        return [*words, "--workers", "1"], False  # each worker opens every scene: seconds
    if words[:2] != ["metamerlab", "session"] or words[2] not in {"run", "resume", "check-display"}:
        return words, False
    words = [*words, "--software-pacing"]
    if "check-display" in words:
        words += ["--flips", "120"]
    elif "--skip-validation" not in words and not ("run" in words and "P01" in words):
        words.append("--skip-validation")  # 11 s of looking at dots; once is enough
    if "lsl" in words:
        at = words.index("lsl")
        words[at - 1 : at + 1] = ["--simulate"]
    return words, "mouse" in words


@pytest.mark.timeout(900)
def test_every_command_of_the_guide_runs_in_its_order(screen, tmp_path):
    here, program = tmp_path, Path(sys.executable).parent
    env = {**screen.env, "PATH": f"{program}{os.pathsep}{os.environ['PATH']}"}
    (tmp_path / "disparity.py").write_text(blocks("python")[0], encoding="utf-8")
    ran = []
    for words in commands():
        if words[0] == "cd":
            here = here / words[1]
            make_smaller(here)
            bring_scenes(here)
            (tmp_path / "disparity.py").rename(here / "disparity.py")
            continue
        if words[:2] == ["python", "disparity.py"]:
            add_scenes(here, 2)
        if words[1:3] == ["session", "resume"]:
            lose_power(here / "sessions/my-study/P01")
        words, robot = adapted(words)
        print(shlex.join(words), flush=True)
        if words[0] != "metamerlab":
            subprocess.run(words, cwd=here, env=env, check=True, timeout=400)
            continue
        process = screen.start(*words[1:], folder=here)
        with Robot(screen) if robot else nullcontext():
            out, err = process.communicate(timeout=400)
        assert process.returncode == 0, f"{shlex.join(words)}\n{out}\n{err}"
        assert "Traceback" not in err
        ran.append(words)

    assert len(ran) > 25
    study = here
    assert (study / "preregistration.html").is_file()
    assert (study / "report" / "report.html").is_file()
    disparity = np.load(study / "scenes" / "disparity.npy")
    assert np.nanmedian(disparity[60:180, 210:280]) == pytest.approx(56, abs=0.5)
    assert np.nanmedian(disparity[5:30, 140:300]) == pytest.approx(8, abs=0.5)
    journal = read_journal(study / "sessions/my-study/P01/journal.jsonl")
    assert any(isinstance(event, SessionResume) for event in journal.events)
    decided = {
        event.condition["scene"]
        for event in journal.events
        if isinstance(event, Attempt) and event.outcome == "completed" and event.role != "practice"
    }
    assert decided == {"garden", "place", "pair"}
    stone = (study / "pilot/own/my-study/me/journal.jsonl").read_text()
    assert '"kind":"withdrawal"' in stone
    assert {path.name for path in (study / "export").iterdir()} == {"bids", "public", "pwcmp"}


def test_the_guides_decision_pages_and_pages_beside_it_exist():
    text = GUIDE.read_text(encoding="utf-8")

    assert "reproducibility.md" in text
    assert (GUIDE.parent / "reproducibility.md").is_file()
