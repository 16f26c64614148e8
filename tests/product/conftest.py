"""A small study whose sessions ended in every way that sessions end."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import pytest
from command_line import result_of
from study_texts import shipped_study

from protocols.load import load_display, load_protocol
from protocols.study_file.schema import StudyProtocol
from study_app.gaze.simulated import STEADY
from study_app.session_folders import withdraw
from study_app.simulate import SimulatedStudy, simulate_study

DISPLAY = """
name = "desk"
width_px = 640
height_px = 480
width_mm = 192.0
height_mm = 144.0
distance_mm = 600.0
refresh_hz = 60.0
"""


@dataclass(frozen=True)
class Recorded:
    """A protocol file, its display, and a folder of sessions."""

    folder: Path

    @property
    def path(self) -> Path:
        return self.folder / "study.toml"

    @property
    def sessions(self) -> Path:
        return self.folder / "sessions"

    @property
    def protocol(self) -> StudyProtocol:
        return load_protocol(self.path)

    def session(self, code: str) -> Path:
        return self.sessions / "demo" / code

    def copy(self, folder: Path) -> Recorded:
        shutil.copytree(self.folder, folder)
        return Recorded(folder)


@pytest.fixture
def metamerlab():
    """Give a function that runs a command as a user types it."""
    return result_of(terminal_width=100)


@pytest.fixture(scope="session")
def recorded_once(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Return five sessions: S001 whole, S002 killed and resumed, S003 cut short while a line was
    written, S004 withdrawn, S005 whole. Nobody may change them; `recorded` gives a copy."""
    study = Recorded(tmp_path_factory.mktemp("recorded"))
    values = {
        "display": '"desk.toml"', "width_deg": 2.75, "height_deg": 1.9, "duration_s": 0.2,
        "repeats": 1, "mode": '"enforce"',
    }  # fmt: skip
    study.path.write_text(shipped_study("demo", values), encoding="utf-8")
    (study.folder / "desk.toml").write_text(DISPLAY, encoding="utf-8")
    display = load_display("desk.toml", beside=study.path)
    simulation = SimulatedStudy(study.protocol, display, gaze=STEADY, gaze_rate_hz=120.0)
    simulate_study(simulation, study.sessions, 2)
    cut(study.session("S002"), attempts=5)
    simulate_study(simulation, study.sessions, 5)
    cut(study.session("S003"), attempts=4)
    withdraw(study.sessions, "S004", lambda: "2026-01-31T12:00:00Z")
    return study


@pytest.fixture
def recorded(recorded_once: Recorded, tmp_path: Path) -> Recorded:
    """Return a copy of the sessions that a test may change."""
    return recorded_once.copy(tmp_path / "recorded")


def cut(session: Path, attempts: int) -> None:
    """Leave a journal as a power cut does: some attempts, and half of the next one's line."""
    journal = session / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    at = [index for index, line in enumerate(lines) if b'"kind":"attempt"' in line][attempts]
    journal.write_bytes(b"".join(lines[:at]) + lines[at][: len(lines[at]) // 2])
