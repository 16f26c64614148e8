"""For every task: what another process sees on the screen is what the log says, flip by flip."""

import base64
import csv
import io
import json
import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from attack.captured_flips import compare
from PIL import Image
from study_texts import short_study
from typer.testing import CliRunner

from protocols.display import Viewing
from protocols.plan import make_plan
from protocols.script import Picture, TrialScript
from study_app.cli import app
from study_app.paint import lay, paint
from study_app.preview import preview_page

PX = 64
FRAMES = 6
STIMULI = """
kind = "files"
table = "stimuli.csv"
width_px = 64
height_px = 64
"""
TRIAL = """
fixation_s = 0.1
fixation_timeout_s = 5.0
iti_s = 0.1
feedback_s = 0.2
fixation_y_deg = 5.0
dropped_frames_max = 10000
"""
ROWS = [
    ("a-one-1", "a", "one", 1),
    ("a-one-2", "a", "one", 2),
    ("a-two-1", "a", "two", 1),
    ("a-two-2", "a", "two", 2),
]
PREFERENCE = 'kind = "preference"\nprimary = { method = "one", against = "two" }'
PRACTICE = "practice = { trials = 2, feedback = true }"


@dataclass(frozen=True)
class Case:
    task: str
    answers: tuple[str, ...]
    analysis: str
    video: bool = False
    practice: str = ""


CASES = {
    "two-interval clips": Case(
        'kind = "two-interval"\ngap_s = 0.1',
        ("first", "second"), PREFERENCE, video=True,
    ),
    "two-alternative clips": Case(
        'kind = "two-alternative"\nseparation_deg = 6.0',
        ("left", "right"), PREFERENCE, video=True,
    ),
    "two-alternative stills": Case(
        'kind = "two-alternative"\nseparation_deg = 6.0\nstimulus_s = 0.2',
        ("left", "right"), PREFERENCE,
    ),
    "yes-no": Case(
        'kind = "yes-no"\nsignal = { method = ["two"] }\nstimulus_s = 0.2',
        ("yes", "no"), 'kind = "detection"', practice=PRACTICE,
    ),
    "identification": Case(
        'kind = "identification"\nalternatives = ["one", "two", "three", "four"]\n'
        'named_by = "method"\nstimulus_s = 0.2',
        ("one", "two", "three", "four"), 'kind = "identification"',
        practice=PRACTICE,
    ),
    "abx": Case(
        'kind = "abx"\nstandard = { method = "one", level = 1 }\nmatched = ["scene"]\n'
        "gap_s = 0.1\nstimulus_s = 0.2",
        ("a", "b"), 'kind = "abx"', practice=PRACTICE,
    ),
    "which-half": Case(
        'kind = "which-half"\nstandard = { method = "one", level = 1 }\nmatched = ["scene"]\n'
        "gap_s = 0.1\nstimulus_s = 0.2\nbar_deg = 0.4",
        ("left", "right"), 'kind = "which-half"', practice=PRACTICE,
    ),
    "rating": Case(
        'kind = "rating"\nscale = ["bad", "fair", "good"]\nstimulus_s = 0.2',
        ("bad", "fair", "good"), 'kind = "ratings"',
    ),
    "rating after a standard": Case(
        'kind = "rating"\nscale = ["bad", "fair", "good"]\ngap_s = 0.1\nstimulus_s = 0.2\n'
        'standard = { method = "one", level = 1 }',
        ("bad", "fair", "good"), 'kind = "ratings"\nby = "level"',
    ),
    "adaptive": Case(
        'kind = "yes-no"\nsignal = { method = ["two"] }\nstimulus_s = 0.2\n'
        'adaptive = { rule = "up-down", trials = 6, column = "level", start = 2.0,'
        " harder = [1.0], easier = [1.0] }",
        ("yes", "no"), 'kind = "detection"\nlevel = "level"',
    ),
}  # fmt: skip
SURE = '\nconfidence = { steps = 3, question = { en = "Sure?" }, keys = [["7"], ["8"], ["9"]] }'
CASES |= {
    f"{name}, confidence": replace(case, task=case.task + SURE)
    for name, case in CASES.items()
    if name != "adaptive" and "rating" not in name
}
SURE_OF = ("two-alternative clips, confidence", "abx, confidence")
"""The question is the same of every task: these show it and all of their task, and with --full
all."""
NAMES = [
    pytest.param(name, marks=pytest.mark.full)
    if ("confidence" in name and name not in SURE_OF) or f"{name}, confidence" in SURE_OF
    else pytest.param(name, marks=() if name == "which-half" else pytest.mark.slow)
    for name in CASES
]
OTHERS_SHOW = (
    "two-alternative stills", "rating after a standard", "two-alternative clips", "identification",
)  # fmt: skip
"""Watched with --full alone: each thing on their screens is on that of another case."""
WATCHED = [
    pytest.param(name.values[0], marks=pytest.mark.full) if name.values[0] in OTHERS_SHOW else name
    for name in NAMES
]


@pytest.fixture
def make_study(start_study):
    """Give a function: a case -> its study with pictures of noise, built, of as many frames as the
    case has."""

    def make(case, name="study"):
        study = start_study(name)
        write_pictures(study.folder, case)
        text = short_study(
            name="proof",
            display="little.toml",
            stimuli=STIMULI + (f"fps = 30.0\nduration_s = {FRAMES / 30}" if case.video else ""),
            task=case.task,
            answers=case.answers,
            analysis=case.analysis,
            design=f"repeats = 1\n{case.practice}",
            trial=TRIAL,
        )
        study.path.write_text(text, encoding="utf-8")
        metamerlab("stimuli", "build", study.path, "--out", study.stimuli)
        return study

    return make


def metamerlab(*words):
    """Run a command as a user types it; it must succeed."""
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output


def write_pictures(folder, case):
    """Write the files and the table that says what they show."""
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
    (folder / "stimuli.csv").write_text("\n".join(lines) + "\n")


@pytest.fixture(autouse=True)
def opengl_3_3(monkeypatch):
    """Windows have what every desk has: OpenGL 3.3 and no compute shaders."""
    monkeypatch.setenv("MESA_GL_VERSION_OVERRIDE", "3.3FC")
    monkeypatch.setenv("MESA_GLSL_VERSION_OVERRIDE", "330")


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", WATCHED)
def test_another_process_sees_every_logged_flip_with_the_hashed_frames(
    screen, make_study, name, full
):
    case = CASES[name]
    study = make_study(case)

    seen = screen.watch(study)

    logged, names = study.logged()
    assert compare(logged, seen, names) == []
    completed = [a for a in study.journal().attempts if a.outcome == "completed"]
    assert {a.role for a in completed} >= {"main"} | ({"practice"} if case.practice else set())
    shown = {entry for entry in logged.values() if entry}
    assert sum(entry is not None for entry in logged.values()) >= 6 * len(completed)
    frames = FRAMES if case.video else 1
    each = 1 if "two-alternative" not in name else len(completed)  # pairs of their own
    late = 0
    for attempt in completed:  # a busy machine misses refreshes, and frames with them: never others
        skipped = sum(frames - stimulus.frames_shown for stimulus in attempt.stimuli)
        assert skipped <= attempt.missed
        late += skipped
    assert len(shown) >= (frames * each - late if case.video else 1)
    for attempt in completed:
        assert [one.key in "789" for one in attempt.further] == [True] * ("confidence" in name)
        assert ("confidence" in name) == any(p.phase == "confidence" for p in attempt.phases)
    feedback = [a for a in completed if any(p.phase == "feedback" for p in a.phases)]
    assert [a.role for a in feedback] == ["practice"] * (2 if case.practice else 0)
    if "adaptive" in case.task:
        levels = [a.condition["level"] for a in completed]
        assert levels[0] == 2
        assert set(levels) == {1, 2}
    assert study.journal().start.versions["opengl"].startswith("3.3 ")
    if name in (REPORTED if full else REPORTED[:3]):
        check_report(study, len(completed))


REPORTED = (
    "two-interval clips", "rating", "adaptive", "two-alternative stills", "yes-no",
    "identification", "abx", "which-half",
)  # fmt: skip
"""The first three always: of each task, simulated sessions have a report elsewhere."""


def check_report(study, decisions):
    """Make a report of a session and a second one without a window, which some models need."""
    metamerlab(
        "session", "simulate", study.path, "--stimuli", study.stimuli, "--out", study.sessions,
        "--participants", 1,
    )  # fmt: skip
    out = study.folder / "report"
    metamerlab(
        "analysis", "report", study.sessions, "--protocol", study.path, "--no-figures",
        "--out", out,
    )  # fmt: skip
    results = json.loads((out / "results.json").read_text())
    with (out / "tables" / "decisions.csv").open() as file:
        people = [row["participant"] for row in csv.DictReader(file)]
    assert results["simulated"] is True
    # Both are there; rules may leave out what a busy machine makes of an answer's time.
    assert results["participants"]["began"] == 2, results["participants"]
    assert people.count("P01") == decisions > 0
    assert (out / "report.html").exists()


SHOTS = """
import sys
from pathlib import Path
import numpy as np
from protocols.load import load_study
from protocols.manifest import read_manifest
from protocols.plan import chosen, make_plan
from protocols.make_script import Scripts
from study_app.presenter import Presenter
from study_app.session_setup import SessionSetup
from study_app.stage import FlipPicture
from study_app.desktop.window import Window

folder, buffer, out, number = map(Path, sys.argv[1:5])
study, display = load_study(folder / "study.toml")
manifest = read_manifest(folder / "clips")
plan = make_plan(study, manifest, "P0", 0)
trial = chosen(study, plan, plan.trials[int(str(number))], [])
script = Scripts(study, display, "en", manifest).of(trial)

def picture():
    data = buffer.read_bytes()
    start = int.from_bytes(data[:4], "big") + 12 * int.from_bytes(data[76:80], "big")
    return np.frombuffer(data, np.uint8, 640 * 480 * 4, start).reshape(480, 640, 4)[..., 2::-1]

shots = []
with Window(display, pacing="software") as window:
    setup = SessionSetup(study, display, manifest, folder, "P0", "en", folder / "clips")
    with Presenter(window, setup, 60.0) as presenter:
        presenter.prepare(trial, script, 1)
        for phase in script.phases:
            for told in (None, *phase.follows.values()):
                for refreshes in sorted({0, 2, (phase.frames or 1) - 1}):
                    for _ in range(2):
                        presenter.show(FlipPicture(phase, refreshes, notice=told))
                    shots.append(picture())
np.savez(out, shots=np.stack(shots), script=script.model_dump_json())
"""


def played(data, entries, frames, size):
    """The screen that a preview page draws for these entries: its pictures at its places."""
    screen = np.full((size[1], size[0], 3), data["grey"], np.uint8)
    for entry in entries:
        at = round(entry["x"]) - size[0] // 2, round(entry["y"]) - size[1] // 2
        wide, high = round(entry["w"]), round(entry["h"])
        if entry["kind"] == "stimulus":
            left, top = (round(entry[k] - entry["whole"][k]) for k in "xy")
            lay(screen, frames[entry["name"]][0][top : top + high, left : left + wide], at)
        elif entry["kind"] == "fill":
            lay(screen, np.full((high, wide, 3), entry["grey"], np.uint8), at)
        else:
            stored = base64.b64decode(data["images"][entry["image"]].partition(",")[2])
            image = np.asarray(Image.open(io.BytesIO(stored)).convert("RGBA"))
            assert image.shape[:2] == (high, wide)
            lay(screen, image, at)
    return screen


@pytest.mark.parametrize("name", NAMES)
def test_window_painter_and_preview_show_the_same_pixels(screen, make_study, tmp_path, name):
    """Every phase of a trial, each of its notices, and clips at three moments."""
    study = make_study(CASES[name])
    html = preview_page(
        study.protocol, study.display, stimuli=study.stimuli, manifest=study.manifest
    ).html
    data = json.loads(re.search(r"^const data = (\{.*\});$", html, flags=re.M)[1])
    plan = make_plan(study.protocol, study.manifest, "P0", 0)
    page = data["trials"][-1]  # of practice, where there is any
    role = "practice" if page["phases"][-2]["name"] == "feedback" else "main"
    number = next(
        i for i, trial in enumerate(plan.trials)
        if (list(trial.stimuli), trial.role) == (page["stimuli"], role)
    )  # fmt: skip
    screen.script(SHOTS, study.folder, screen.file, tmp_path / "shots.npz", number)
    with np.load(tmp_path / "shots.npz") as stored:
        script, shots = (
            TrialScript.model_validate_json(str(stored["script"])),
            iter(stored["shots"]),
        )
    frames = [
        [study.frame(stimulus.name, k) for k in range(stimulus.frames)]
        for stimulus in script.stimuli
    ]
    compared = 0
    for phase, drawn in zip(script.phases, page["phases"], strict=True):
        for told in (None, *phase.follows.values()):
            for refreshes in sorted({0, 2, (phase.frames or 1) - 1}):
                seen = next(shots).astype(int)
                wanted = paint(
                    script, phase, dict(enumerate(frames)), {}, refreshes=refreshes, notice=told
                )
                blended = told or any(isinstance(entry, Picture) for entry in phase.show)
                off = np.abs(seen - wanted)
                assert off.max() <= (1 if blended else 0), (phase.name, refreshes, told)
                assert (off > 0).mean() < 0.02
                compared += 1
            if page["stimuli"] and told is phase.follows.get("right"):
                by_name = {s.name: f for s, f in zip(script.stimuli, frames, strict=True)}
                first = paint(script, phase, dict(enumerate(frames)), {}, notice=told)
                ours = played(data, drawn["show"], by_name, script.size_px)
                assert np.abs(ours.astype(int) - first).max() <= 1, phase.name
    assert compared >= 3 * len(script.phases) - 4
    assert any(entry.crop for row in script.frames for entry in row) == ("which-half" in name)


def test_two_side_by_side_stand_as_far_apart_as_the_protocol_says(make_study):
    study = make_study(CASES["two-alternative stills"])
    viewing = Viewing.of(study.display)

    (x0, y0), (x1, y1) = study.places
    assert y0 == y1
    middles = [viewing.to_deg(x + PX / 2, y0 + PX / 2) for x in (x0, x1)]
    pixel_deg = 1 / 34
    assert middles[1][0] - middles[0][0] == pytest.approx(6.0, abs=2 * pixel_deg)
    assert middles[0][0] + middles[1][0] == pytest.approx(0.0, abs=2 * pixel_deg)
    assert middles[0][1] == pytest.approx(0.0, abs=pixel_deg)


def test_a_journal_of_every_task_names_what_its_flips_showed(make_study):
    """On a virtual display, for every case: hashes in the log are those of the manifest."""
    for name, case in CASES.items():
        if "confidence" in name and name != "abx, confidence":
            continue  # one is enough where nothing is drawn
        study = make_study(case, name.replace(",", "").replace(" ", "-"))
        metamerlab(
            "session", "simulate", study.path, "--stimuli", study.stimuli, "--out",
            study.sessions, "--participants", 1,
        )  # fmt: skip
        folder, manifest = study.session("S001"), study.manifest
        lines = (folder / "journal.jsonl").read_text().splitlines()
        attempts = [json.loads(line) for line in lines if '"kind":"attempt"' in line]
        for attempt in attempts:
            clips = [manifest.clip(s["name"]) for s in attempt["stimuli"]]
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
