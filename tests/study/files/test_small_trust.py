"""Small things that let data or a terminal down: signals, seeds, characters."""

import dataclasses
import json
import os
import signal
from pathlib import Path

import pytest

from analysis.tables.table import Table
from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.journal_file import check_side_files, read_journal
from protocols.load import load_display, load_protocol, shipped
from protocols.manifest import check_manifest, read_manifest, write_manifest
from study_app import conduct, run
from study_app.recorder import Recorder
from study_app.session import RunTrial, next_step
from study_app.simulate import SimulatedStudy, simulate_session

DEMO = load_protocol(Path("demo"))
DISPLAY = load_display(DEMO.display.display)


class Window:
    """Notes which keys it is told were pressed."""

    def __init__(self) -> None:
        self.pressed: list[str] = []

    def press(self, key: str) -> None:
        self.pressed.append(key)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_asks_to_quit_also_when_the_terminal_closed(number):
    window, before = Window(), signal.getsignal(number)
    with run._signals_quit(window, DEMO):
        os.kill(os.getpid(), number)
        assert window.pressed == [DEMO.response.quit_keys[0]]
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)
    assert signal.getsignal(number) == before


@pytest.mark.parametrize("change", [{"seed": 2}, {"missed_per_flip": 0.01}, {"gaze_rate_hz": 60.0}])
def test_a_simulated_session_goes_on_with_the_observer_it_began_with(tmp_path, change):
    began = SimulatedStudy(DEMO, DISPLAY, seed=1)
    simulate_session(began, tmp_path, "S001")
    path = tmp_path / "demo" / "S001" / "journal.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    whole = read_journal(path)
    path.write_bytes(b"".join(lines[:15]))

    with pytest.raises(StudyError, match="must continue with the same observer"):
        simulate_session(SimulatedStudy(DEMO, DISPLAY, **({"seed": 1} | change)), tmp_path, "S001")
    assert path.read_bytes() == b"".join(lines[:15])
    simulate_session(began, tmp_path, "S001")
    assert [a.answer for a in read_journal(path).attempts] == [a.answer for a in whole.attempts]


@pytest.mark.parametrize("character", ["\\u0000", "\\u0008", "\\u001b", "\\u007f"])
def test_a_study_holds_no_control_characters(tmp_path, character):
    text = shipped("studies")["demo"].read_text(encoding="utf-8")
    path = tmp_path / "study.toml"
    path.write_text(text.replace('title = "', f'title = "{character}', 1), encoding="utf-8")

    with pytest.raises(StudyError, match=r"study\.title: must hold no control characters"):
        load_protocol(path)


def test_a_table_holds_no_control_characters(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("a,b\n1,2\n3,x\x1by\n")
    with pytest.raises(StudyError, match=r"line 3: must hold no control characters"):
        Table(path)


def test_only_what_can_be_simulated_anew_does_not_wait_for_the_disk(tmp_path, monkeypatch):
    real, synced = os.fsync, []
    monkeypatch.setattr(os, "fsync", lambda handle: (synced.append(handle), real(handle))[1])
    simulate_session(SimulatedStudy(DEMO, DISPLAY), tmp_path, "S001")
    whole = read_journal(tmp_path / "demo" / "S001" / "journal.jsonl")
    assert len(synced) < 5 < len(whole.attempts)

    synced.clear()
    with Recorder.create(tmp_path / "real", lambda: 0.0, lambda: whole.events[0].at) as recorder:
        before = len(synced)
        recorder.append(whole.events[0])
        recorder.side_file("gaze/0001", ".csv", b"t_s\n")
    assert len(synced) == before + 2


def test_files_of_more_than_9999_attempts_have_names_of_their_own(tmp_path, monkeypatch):
    def later(*arguments):
        step = next_step(*arguments)
        if isinstance(step, RunTrial):
            return dataclasses.replace(step, position=step.position + 9_995)
        return step

    monkeypatch.setattr(conduct, "next_step", later)
    simulate_session(SimulatedStudy(DEMO, DISPLAY), tmp_path, "S001")
    folder = tmp_path / "demo" / "S001"
    journal = read_journal(folder / "journal.jsonl")
    attempts = journal.attempts
    files = [attempt.flips_file.file for attempt in attempts]
    assert {"flips/9999.csv", "flips/10000.csv", "flips/10001.csv"} <= set(files)
    assert len(set(files)) == len(attempts)
    assert not check_side_files(journal).wrong


@pytest.mark.parametrize(
    "change",
    [
        {"fps": 60.0},
        {"bit_depth": 16},
        {"seed": 8},
        {"condition": {"scene": "garden", "size": "large", "method": "push-pull"}},
        {"parameters": {"scene_seed": 2}},
        {"parameters": {"method": "pull-push"}},
        {"parameters": {"path": "line"}},
    ],
)
def test_a_manifest_says_what_its_study_says(change):
    manifest = virtual_manifest(DEMO, DISPLAY)
    check_manifest(DEMO, manifest)
    clip = manifest.clips[0].model_copy(update=change)
    (key,) = {**change, **change.get("parameters", {})}.keys() - {"parameters"}

    with pytest.raises(StudyError, match=rf"^{clip.name}: {key} must be .*as the study has it"):
        check_manifest(DEMO, manifest.model_copy(update={"clips": (clip, *manifest.clips[1:])}))


def test_a_manifest_holds_no_control_characters(tmp_path):
    manifest = virtual_manifest(DEMO, DISPLAY)
    path = write_manifest(tmp_path, manifest)
    raw = json.loads(path.read_text())
    raw["clips"][0]["condition"]["scene"] = "bo\x1bx"
    path.write_text(json.dumps(raw))
    with pytest.raises(StudyError, match="must hold no control characters"):
        read_manifest(tmp_path)
