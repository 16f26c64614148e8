"""The Beyond Blur studies, whole, in the real window: every decision of a participant, seen flip by
flip by another process; and killed and resumed. By default a few trials of each."""

import re
import signal
import time

import numpy as np
import pytest
import trimesh
from attack.captured_flips import compare
from PIL import Image
from study_texts import shipped_study

from pipeline.foveation.view import flat_view
from protocols.disk.hashing import sha256_file
from protocols.feasibility import virtual_manifest
from protocols.journal import Attempt, SessionResume
from protocols.journal_file import read_journal
from protocols.load import load_study
from protocols.manifest import write_manifest
from protocols.plan import make_plan
from stimuli.recipes.foveated_work import StillsPlan

pytestmark = pytest.mark.slow

DECISIONS = {"beyond-blur-task": 300, "beyond-blur-preference": 252, "beyond-blur-detection": 294}
FEW = {"beyond-blur-task": 20, "beyond-blur-preference": 4, "beyond-blur-detection": 12}
SIZE = {"beyond-blur-task": (612, 340)}
LIMIT_S = 3000
WATCHED = [
    pytest.param(name, marks=pytest.mark.full) if name == "beyond-blur-detection" else name
    for name in DECISIONS
]
"""One picture at a time, as in the task: with --full alone."""


@pytest.fixture
def make(start_study, full):
    """Give a function: a shipped study -> the same with pictures of noise, times between stimuli
    shorter, and by default fewer scenes, methods and repeats; stimuli take as long as shipped."""

    def written(name):
        study = start_study(name)
        display = study.folder / "little.toml"
        # From near by, so that rings 25 degrees from the gaze are on the screen.
        display.write_text(
            display.read_text().replace("distance_mm = 600.0", "distance_mm = 100.0")
        )
        width, height = SIZE.get(name, (96, 64))
        values = {
            "display": '"little.toml"', "width_px": str(width), "height_px": str(height),
            "fixation_s": "0.1", "iti_s": "0.05", "break_s": "0.0", "mode": '"none"',
            "dot_over_clips": "false", "dropped_frames_max": "10000",
        }  # fmt: skip
        if not full:
            values |= {"blocks": "2"}
        text = shipped_study(name, values, questions=False)
        if not full:
            dropped = (
                r"^  \{ name = \"(castle|colonnade|tunnel|thicket|notices|blur|energy)[^\n]*\n"
            )
            text = re.sub(dropped, "", text, flags=re.M)
            text = text.replace("[5.0, 10.0, 15.0, 20.0, 25.0]", "[5.0]")
            text = text.replace("draws = 6", "draws = 2").replace("repeats = 6", "repeats = 2")
            text = text.replace('against = "blur"', 'against = "reference"')
        if "gap_s" in text:
            text = text.replace("gap_s = 0.5", "gap_s = 0.1")
        study.path.write_text(text, encoding="utf-8")
        pictures_of_noise(study)
        return study

    return written


def pictures_of_noise(study):
    """Write a picture for every stimulus: blocks of 4 x 4 pixels, no two pictures alike."""
    protocol, display = load_study(study.path, None)
    manifest = virtual_manifest(protocol, display)
    clips = []
    for number, clip in enumerate(manifest.clips):
        rng = np.random.default_rng(number)
        blocks = (-(-clip.height_px // 4), -(-clip.width_px // 4), 3)
        picture = rng.integers(0, 256, blocks, dtype=np.uint8).repeat(4, 0).repeat(4, 1)
        path = study.stimuli / clip.name / "000000.png"
        path.parent.mkdir(parents=True)
        Image.fromarray(picture[: clip.height_px, : clip.width_px]).save(path)
        clips.append(clip.model_copy(update={"frames_sha256": (sha256_file(path),)}))
    write_manifest(
        study.stimuli, manifest.model_copy(update={"clips": tuple(clips), "simulated": False})
    )


def planned(study):
    """The plan of the session, with what each trial shows."""
    return make_plan(study.protocol, study.manifest, "P01", 0).trials


@pytest.mark.timeout(LIMIT_S)
@pytest.mark.parametrize("name", WATCHED)
def test_another_process_sees_every_decision_of_a_whole_session(screen, make, name, full):
    study = make(name)
    decisions = DECISIONS[name] if full else FEW[name]

    seen = screen.watch(study, timeout_s=LIMIT_S)

    trials, attempts = planned(study), study.journal().attempts
    assert len(trials) == decisions
    assert [a.trial for a in attempts] == [trial.id for trial in trials]
    assert {a.outcome for a in attempts} == {"completed"}
    logged, names = study.logged()
    assert compare(logged, seen, names) == []
    shown = {entry.split("/")[0] for entry in logged.values() if entry}
    assert shown == {stimulus for trial in trials for stimulus in trial.stimuli}
    for trial, attempt in zip(trials, attempts, strict=True):
        assert tuple(s.name for s in attempt.stimuli) == trial.stimuli
        assert all(s.frames_shown == 1 for s in attempt.stimuli)


@pytest.mark.timeout(LIMIT_S)
@pytest.mark.parametrize("name", DECISIONS)
def test_killed_and_resumed_a_whole_session_loses_and_doubles_nothing(
    screen, make, wait, name, full
):
    if not full and name != "beyond-blur-preference":
        pytest.skip("one of three by default; the others with --full")
    study = make(name)
    kills = 20 if full else 2
    trials = planned(study)
    rng = np.random.default_rng(len(trials))
    last = len(trials) - (2 if full else 1)
    points = np.unique(np.linspace(1, last, kills).astype(int))

    def attempts():
        path = study.session() / "journal.jsonl"
        return (
            [e for e in read_journal(path).events if isinstance(e, Attempt)]
            if path.exists()
            else []
        )

    process = screen.start(*screen.session("run", study, "--simulate"))
    saved = ()
    for point in points:
        wait(lambda wanted=point: len(attempts()) >= wanted, f"{point} attempts", 600, process)
        time.sleep(float(rng.uniform(0, 0.5)))
        process.send_signal(signal.SIGKILL)
        process.communicate(timeout=30)
        events = study.journal().events
        assert events[: len(saved)] == saved
        saved = events
        if len(attempts()) >= len(trials):
            break
        process = screen.start(*screen.session("resume", study, "--simulate"))
    _, err = process.communicate(timeout=LIMIT_S)
    assert process.returncode in (0, -signal.SIGKILL), err

    journal = study.journal()
    assert journal.events[: len(saved)] == saved
    assert len([e for e in journal.events if isinstance(e, SessionResume)]) >= (15 if full else 1)
    done = [a for a in journal.attempts if a.outcome == "completed"]
    assert [a.trial for a in done] == [trial.id for trial in trials]
    for trial, attempt in zip(trials, done, strict=True):
        assert tuple(s.name for s in attempt.stimuli) == trial.stimuli
    assert [event.n for event in journal.events] == list(range(len(journal.events)))


@pytest.mark.timeout(900)
def test_a_study_on_a_panorama_is_drawn_built_shown_and_reported(screen, start_study):
    """The commands of the documentation, small: a room all around, two views of it as scenes."""
    study = start_study("panorama")
    room = trimesh.creation.box((8, 3, 6)).subdivide().subdivide().subdivide()
    room.invert()
    shades = np.random.default_rng(3).integers(0, 256, (len(room.vertices), 4), dtype=np.uint8)
    shades[:, 3] = 255
    room.visual = trimesh.visual.ColorVisuals(room, vertex_colors=shades)
    room.export(study.folder / "room.glb")
    text = shipped_study("beyond-blur-preference", {}, questions=False)
    text = re.sub(r"^  \{ name = \"(garden|castle|colonnade|tunnel|thicket|notices|blur|energy)"
                  r"[^\n]*\n", "", text, flags=re.M)  # fmt: skip
    views = "".join(
        f'  {{ name = "{name}", file = "room-360.png", view = {{ right_deg = {right} }} }},\n'
        for name, right in (("door", 20), ("corner", 195))
    )
    text = text.replace('  { name = "street", file = "builtin:street" },\n', views)
    for old, new in (
        ('"fhd27-60hz"', '"little.toml"'), ("width_px = 1920", "width_px = 96"),
        ("height_px = 1080", "height_px = 64"), ('mode = "enforce"', 'mode = "none"'),
        ("dot_over_clips = true", "dot_over_clips = false"), ("repeats = 6", "repeats = 2"),
        ("blocks = 4", "blocks = 1"), ('against = "blur"', 'against = "reference"'),
        ("dropped_frames_max = 2", "dropped_frames_max = 10000"),
    ):  # fmt: skip
        assert old in text
        text = text.replace(old, new)
    study.path.write_text(text, encoding="utf-8")
    for words in (
        ("stimuli", "panorama", study.folder / "room.glb", "--out", study.folder / "room-360.png",
         "--height-px", 256, "--view", "view = { position_m = [0, 0, 1], look_at_m = [1, 0, 1] }"),
        ("stimuli", "build", study.path, "--out", study.stimuli),
    ):  # fmt: skip
        screen.run(*words)

    seen = screen.watch(study)
    logged, names = study.logged()
    assert compare(logged, seen, names) == []
    shown = {entry.split("/")[0] for entry in logged.values() if entry}
    assert shown == {
        f"{name}__{how}" for name in ("door", "corner") for how in ("reference", "ours")
    }
    whole = np.asarray(Image.open(study.folder / "room-360.png").convert("RGB"), np.float32) / 255
    order = StillsPlan(study.protocol.stimuli, 600 / 0.3, study.folder)
    for name, right in (("door", 20), ("corner", 195)):
        wanted = flat_view(whole, order.geometry, right_deg=right)
        stored = study.frame(f"{name}__reference", 0) / 255
        np.testing.assert_allclose(stored, wanted, atol=0.51 / 255)
        assert stored.std() > 0.02
    screen.run("analysis", "report", study.sessions, "--protocol", study.path,
                          "--out", study.folder / "report", "--no-figures")  # fmt: skip
