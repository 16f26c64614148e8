"""For every task: what another process sees on the screen is what the log says, flip by flip."""

from __future__ import annotations

import csv
import hashlib
import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from protocols.journal_file import Journal, read_journal
from protocols.load import load_study
from protocols.manifest import Manifest, read_manifest
from protocols.schema import StudyProtocol
from protocols.viewing import Viewing
from study_app.layout import Extras, Layout
from study_app.strip import Seen, compare

PX = 64
FRAMES = 6
GREY = 128
DISPLAY = """
name = "little"
width_px = 640
height_px = 480
width_mm = 192.0
height_mm = 144.0
distance_mm = 600.0
refresh_hz = 60.0
clip_memory_mib = 64
"""
STUDY = """
format = 2
[study]
name = "proof"
title = "Proof"
participants = 1
[display]
display = "little.toml"
[stimuli]
kind = "files"
table = "stimuli.csv"
width_px = 64
height_px = 64
{video}
[task]
{task}
[design]
repeats = 1
side = "fixed"
seed = 3
{practice}
[trial]
fixation_s = 0.1
fixation_timeout_s = 5.0
iti_s = 0.1
feedback_s = 0.2
fixation_y_deg = 5.0
dropped_frames_max = 10000
[gaze]
mode = "none"
[response]
keys = {keys}
[text]
default_language = "en"
[text.languages.en]
consent = "Do you agree?"
instructions = ["Look."]
practice = "Practice."
start = "Start."
question = "Which?"
answers = {answers}
break_page = "Break."
paused = "Paused."
gaze_lost = "Look at the dot."
too_late = "Too late."
preparing = "Preparing."
quit_question = "Stop?"
thanks = "Thank you."
right = "Right."
wrong = "Wrong."
[analysis]
{analysis}
[privacy]
"""
ROWS = [
    ("a-one-1", "a", "one", 1),
    ("a-one-2", "a", "one", 2),
    ("a-two-1", "a", "two", 1),
    ("a-two-2", "a", "two", 2),
]
PREFERENCE = 'kind = "preference"\nprimary = { method = "one", against = "two" }'
PRACTICE = "practice = { trials = 2, feedback = true }"
TWO = '[["left"], ["right"]]'


@dataclass(frozen=True)
class Case:
    task: str
    answers: dict[str, str]
    analysis: str
    keys: str = TWO
    video: bool = False
    practice: str = ""


CASES = {
    "two-interval clips": Case(
        'kind = "two-interval"\ngap_s = 0.1',
        {"first": "1", "second": "2"}, PREFERENCE, video=True,
    ),
    "two-alternative clips": Case(
        'kind = "two-alternative"\nseparation_deg = 6.0',
        {"left": "left", "right": "right"}, PREFERENCE, video=True,
    ),
    "two-alternative stills": Case(
        'kind = "two-alternative"\nseparation_deg = 6.0\nstimulus_s = 0.2',
        {"left": "left", "right": "right"}, PREFERENCE,
    ),
    "yes-no": Case(
        'kind = "yes-no"\nsignal = { method = ["two"] }\nstimulus_s = 0.2',
        {"yes": "yes", "no": "no"}, 'kind = "detection"', practice=PRACTICE,
    ),
    "identification": Case(
        'kind = "identification"\nalternatives = ["one", "two", "three", "four"]\n'
        'named_by = "method"\nstimulus_s = 0.2',
        {"one": "1", "two": "2", "three": "3", "four": "4"}, 'kind = "identification"',
        keys='[["left"], ["up"], ["down"], ["right"]]', practice=PRACTICE,
    ),
    "abx": Case(
        'kind = "abx"\nstandard = { method = "one", level = 1 }\nmatched = ["scene"]\n'
        "gap_s = 0.1\nstimulus_s = 0.2",
        {"a": "first", "b": "second"}, 'kind = "abx"', practice=PRACTICE,
    ),
    "adaptive": Case(
        'kind = "yes-no"\nsignal = { method = ["two"] }\nstimulus_s = 0.2\n'
        'adaptive = { rule = "up-down", trials = 6, column = "level", start = 2.0,'
        " harder = [1.0], easier = [1.0] }",
        {"yes": "yes", "no": "no"}, 'kind = "detection"\nlevel = "level"',
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Study:
    folder: Path
    sessions: Path

    @property
    def path(self) -> Path:
        return self.folder / "study.toml"

    @property
    def stimuli(self) -> Path:
        return self.folder / "clips"

    @property
    def protocol(self) -> StudyProtocol:
        return load_study(self.path)[0]

    @property
    def manifest(self) -> Manifest:
        return read_manifest(self.stimuli)

    @property
    def layout(self) -> Layout:
        protocol, display = load_study(self.path)
        return Layout.of(display, protocol, self.manifest, Extras())

    @property
    def journal(self) -> Journal:
        return read_journal(self.sessions / "proof" / "P01" / "journal.jsonl")

    def flips(self) -> list[dict[str, str]]:
        rows = []
        for attempt in self.journal.attempts:
            with (self.sessions / "proof" / "P01" / attempt.flips_file.file).open() as file:
                rows += list(csv.DictReader(file))
        return rows


def make_study(folder: Path, case: Case) -> Study:
    """Write a study with pictures of noise, each as many frames as the case has."""
    folder.mkdir()
    lines = ["stimulus,file,scene,method,level"]
    for number, (name, scene, method, level) in enumerate(ROWS):
        rng = np.random.default_rng(number)
        file = name if case.video else f"{name}.png"
        frames = [rng.integers(0, 256, (PX, PX, 3), dtype=np.uint8) for _ in range(FRAMES)]
        if case.video:
            (folder / name).mkdir()
            for index, frame in enumerate(frames):
                Image.fromarray(frame).save(folder / name / f"{index}.png")
        else:
            Image.fromarray(frames[0]).save(folder / file)
        lines.append(f"{name},{file},{scene},{method},{level}")
    text = STUDY
    for word, value in {
        "video": f"fps = 30.0\nduration_s = {FRAMES / 30}" if case.video else "",
        "task": case.task,
        "practice": case.practice,
        "keys": case.keys,
        "answers": "{ " + ", ".join(f'{k} = "{v}"' for k, v in case.answers.items()) + " }",
        "analysis": case.analysis,
    }.items():
        text = text.replace("{" + word + "}", value)
    (folder / "stimuli.csv").write_text("\n".join(lines) + "\n")
    (folder / "study.toml").write_text(text)
    (folder / "little.toml").write_text(DISPLAY)
    return Study(folder, folder / "sessions")


# After each flip the presenter waits until the watcher has read it: the capture keeps up on a busy
# machine, and a flip that never comes is noticed.
PACED = """
import mmap, struct, sys, time
from study_app import presenter
from study_app.cli import main

with open(sys.argv.pop(), "r+b") as file:
    read = mmap.mmap(file.fileno(), 8)
presenters_flip = presenter.Presenter._flip
def paced(self, draw):
    shown = presenters_flip(self, draw)
    until_s = time.monotonic() + 2.0
    while struct.unpack("<q", read[:8])[0] < shown.number and time.monotonic() < until_s:
        time.sleep(0.0005)
    return shown
presenter.Presenter._flip = paced
main()
"""


@contextmanager
def watched(
    screen: object, rectangle: tuple[int, int, int, int], read: Path
) -> Iterator[list[Seen]]:
    """Yield a list that holds, afterwards, every picture that another process saw there."""
    seen: list[Seen] = []
    read.write_bytes(b"\xff" * 8)
    script = Path(__file__).with_name("screen_watcher.py")
    watcher = subprocess.Popen(
        [sys.executable, script, screen.file, *map(str, rectangle), read],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert watcher.stdout is not None
    assert watcher.stdout.readline() == "ready\n"
    try:
        yield seen
    finally:
        out, _ = watcher.communicate(input="stop\n", timeout=60)
        for line in out.splitlines():
            number, content = line.split()
            seen.append(Seen(int(number), content))


def proof(study: Study, places: list[tuple[int, int]], rectangle: tuple[int, int, int, int]):
    """Return what the log says of each flip, and the names of pictures by their pixels' hash.

    A picture's name is that of its frames, from left to right; its pixels are composed from the
    stored files, on grey.
    """
    x, y, width, height = rectangle
    files = {
        sha: (f"{clip.name}/{index}", study.stimuli / clip.frame_path(index))
        for clip in study.manifest.clips
        for index, sha in enumerate(clip.frames_sha256)
    }
    logged: dict[int, str | None] = {}
    names: dict[str, str] = {}
    for row in study.flips():
        shown = [files[sha] for sha in row["frame_sha256"].split()]
        name = " + ".join(entry for entry, _ in shown)
        logged[int(row["flip"])] = name or None
        if shown:
            canvas = np.full((height, width, 3), GREY, np.uint8)
            for (_, path), (left, top) in zip(shown, places, strict=True):
                with Image.open(path) as image:
                    pixels = np.asarray(image.convert("RGB"))
                canvas[top - y : top - y + PX, left - x : left - x + PX] = pixels
            names[hashlib.sha256(canvas.tobytes()).hexdigest()] = name
    return logged, names


@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", CASES)
def test_another_process_sees_every_logged_flip_with_the_hashed_frames(screen, tmp_path, name):
    case = CASES[name]
    study = make_study(tmp_path / "study", case)
    built = screen.run("stimuli", "build", study.path, "--out", study.stimuli)
    assert built.returncode == 0, built.stderr
    places = sorted(study.layout.places.values())
    left, top = places[0]
    rectangle = left, top, places[-1][0] + PX - left, PX

    with watched(screen, rectangle, tmp_path / "read") as seen:
        screen.script(
            PACED, "session", "run", study.path, "--stimuli", study.stimuli, "--out",
            study.sessions, "--participant", "P01", "--software-pacing", "--simulate", "--strip",
            tmp_path / "read",
        )  # fmt: skip

    logged, names = proof(study, places, rectangle)
    assert compare(logged, seen, names) == []
    journal = study.journal
    completed = [a for a in journal.attempts if a.outcome == "completed"]
    assert {a.role for a in completed} >= {"main"} | ({"practice"} if case.practice else set())
    shown = {entry for entry in logged.values() if entry}
    assert sum(entry is not None for entry in logged.values()) >= 10 * len(completed)
    frames = FRAMES if case.video else 1
    each = 1 if "two-alternative" not in name else len(completed)  # pairs of their own
    assert len(shown) >= (frames * each if case.video else 1)
    for attempt in completed:
        assert all(s.frames_shown == frames for s in attempt.stimuli), attempt.trial
    feedback = [a for a in completed if any(p.phase == "feedback" for p in a.phases)]
    assert [a.role for a in feedback] == ["practice"] * (2 if case.practice else 0)
    if "adaptive" in case.task:
        levels = [a.condition["level"] for a in completed]
        assert levels[0] == 2
        assert set(levels) == {1, 2}


def test_two_side_by_side_stand_as_far_apart_as_the_protocol_says(tmp_path, metamerlab):
    study = make_study(tmp_path / "study", CASES["two-alternative stills"])
    assert metamerlab("stimuli", "build", study.path, "--out", study.stimuli).exit_code == 0
    _, display = load_study(study.path)
    viewing = Viewing.of(display)

    (x0, y0), (x1, y1) = sorted(study.layout.places.values())
    assert y0 == y1
    middles = [viewing.to_deg(x + PX / 2, y0 + PX / 2) for x in (x0, x1)]
    pixel_deg = 1 / 34
    assert middles[1][0] - middles[0][0] == pytest.approx(6.0, abs=2 * pixel_deg)
    assert middles[0][0] + middles[1][0] == pytest.approx(0.0, abs=2 * pixel_deg)
    assert middles[0][1] == pytest.approx(0.0, abs=pixel_deg)


@pytest.fixture
def metamerlab():
    """Give a function that runs a command as a user types it."""
    from typer.testing import CliRunner

    from study_app.cli import app

    return lambda *words: CliRunner().invoke(app, [str(word) for word in words])


def test_a_journal_of_every_task_names_what_its_flips_showed(tmp_path, metamerlab):
    """On a virtual display, for every case: hashes in the log are those of the manifest."""
    for name, case in CASES.items():
        study = make_study(tmp_path / name.replace(" ", "-"), case)
        assert metamerlab("stimuli", "build", study.path, "--out", study.stimuli).exit_code == 0
        done = metamerlab(
            "session", "simulate", study.path, "--stimuli", study.stimuli, "--out",
            study.sessions, "--participants", 1,
        )  # fmt: skip
        assert done.exit_code == 0, done.output
        folder = study.sessions / "proof" / "S001"
        lines = (folder / "journal.jsonl").read_text().splitlines()
        attempts = [json.loads(line) for line in lines if '"kind":"attempt"' in line]
        for attempt in attempts:
            clips = [study.manifest.clip(s["name"]) for s in attempt["stimuli"]]
            assert [s["sha256"] for s in attempt["stimuli"]] == [c.sha256 for c in clips]
            with (folder / attempt["flips_file"]["file"]).open() as file:
                rows = list(csv.DictReader(file))
            by_phase = {p["phase"]: p["stimuli"] for p in attempt["phases"]}
            for row in rows:
                shown = by_phase.get(row["phase"], [])
                wanted = [
                    clips[index].frames_sha256[int(frame)]
                    for index, frame in zip(shown, row["clip_frame"].split(), strict=True)
                ]
                assert row["frame_sha256"].split() == wanted, (name, row)
