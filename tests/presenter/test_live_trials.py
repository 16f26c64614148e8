"""Trials with pictures that follow the gaze, in a real window on a virtual screen."""

import csv
import re
import signal
import time

import pytest
from PIL import Image
from study_texts import shipped_study

from protocols.journal import Attempt, Note, SessionResume
from study_app.desktop.strip import read_both_strips

pytestmark = pytest.mark.slow


@pytest.fixture
def live(start_study, screen):
    """Give a function: a shipped live study, small, with few conditions, its stimuli built."""

    def made(name):
        study = start_study(name)
        values = {
            "display": '"little.toml"', "width_px": 160, "height_px": 96, "blocks": 1,
            "fixation_s": 0.1, "iti_s": 0.05, "stimulus_s": 0.2, "dropped_frames_max": 9999,
            "loss_max_share": 1.0, "blink_s": 9.0,
        }  # fmt: skip
        text = shipped_study(name, values, questions=False)
        dropped = r"^  \{ name = \"(street|castle|colonnade|tunnel|thicket|notices|ref)[^\n]*\n"
        text = re.sub(dropped, "", text, flags=re.M)
        text = text.replace("draws = 6", "draws = 1").replace("repeats = 6", "repeats = 2")
        text = text.replace("gap_s = 0.5", "gap_s = 0.1")
        text = text.replace('scene_order = "balanced"', 'scene_order = "random"')
        study.path.write_text(text, encoding="utf-8")
        screen.run("stimuli", "build", study.path, "--out", study.stimuli)
        return study

    return made


def verify(screen, study, *more):
    return screen.run(
        "session", "verify", study.sessions, "--protocol", study.path, "--render",
        "--stimuli", study.stimuli, *more, status=None
    )  # fmt: skip


def check_refused_without_compute_shaders(screen, study):
    """Refuse a live study in a window of OpenGL 3.3, before anything is written."""
    with pytest.MonkeyPatch.context() as older:
        older.setenv("MESA_GL_VERSION_OVERRIDE", "3.3FC")
        older.setenv("MESA_GLSL_VERSION_OVERRIDE", "330")
        done = screen.run(
            *screen.session("run", study, "--simulate", "--skip-validation"), status=2
        )
    (message,) = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert "what is drawn at this moment needs OpenGL 4.3 (found: " in message
    assert "3.3 (Core Profile)" in message
    assert not (study.sessions / study.name).exists()


def test_a_killed_session_is_drawn_again_with_captures_and_a_changed_capture_is_found(
    live, screen, wait
):
    study = live("live-detection")
    check_refused_without_compute_shaders(screen, study)
    captures = study.folder / "captures"
    captures.mkdir()
    command = ("--simulate", "--strip", "--skip-validation")
    process = screen.start(*screen.session("run", study, *command))

    def attempts():
        there = (study.session() / "journal.jsonl").exists()
        return len(study.journal().attempts) if there else 0

    wait(lambda: attempts() >= 1, "an attempt", process=process)
    time.sleep(0.15)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=30)
    assert verify(screen, study).returncode == 0

    process = screen.start(*screen.session("resume", study, *command))
    seen = {}
    while process.poll() is None:
        picture = screen.picture().copy()
        number = read_both_strips(picture[..., 1])
        if number is not None and number == read_both_strips(screen.picture()[..., 1]):
            seen[number] = picture
    assert process.returncode == 0, process.communicate()
    journal = study.journal()
    assert any(isinstance(event, SessionResume) for event in journal.events)
    assert any("live frames: the dearest" in e.text for e in journal.events if isinstance(e, Note))
    kept = [row for row in study.flips() if row["pixels_sha256"]]
    assert len(kept) == len(journal.attempts)
    resumed = next(i for i, e in enumerate(journal.events) if isinstance(e, SessionResume))
    before = sum(isinstance(event, Attempt) for event in journal.events[:resumed])
    attempts_then = journal.attempts[before:]
    shown = set()
    for attempt in attempts_then:
        with (study.session() / attempt.flips_file.file).open() as file:
            shown |= {int(row["flip"]) for row in csv.DictReader(file) if row["drawn_sha256"]}
    shown &= set(seen)
    assert shown, "no live frame was captured whole"
    for number in shown:
        Image.fromarray(seen[number]).save(captures / f"{number}.png")

    done = verify(screen, study, "--captured", captures)

    assert done.returncode == 0, done.stdout + done.stderr
    count = f"{len(kept)} drawn again: {len(kept)} bit-equal"
    assert count in done.stdout
    assert f"{len(shown)} of {len(shown)} capture" in done.stdout

    changed = seen[max(shown)]
    changed[240, 320] ^= 8
    Image.fromarray(changed).save(captures / f"{max(shown)}.png")
    done = verify(screen, study, "--captured", captures)
    assert done.returncode == 2
    assert f"{max(shown)}.png: flip {max(shown)}: must show what gaze" in done.stdout
