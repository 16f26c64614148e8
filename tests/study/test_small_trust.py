"""Small things that let data or a terminal down: signals, seeds, characters."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from analysis.csv_table import read_table
from protocols.errors import StudyError
from protocols.journal_file import read_journal
from protocols.load import load_display, load_protocol, shipped
from study_app import run
from study_app.simulate import Simulation, simulate_sitting

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
def test_a_simulated_sitting_goes_on_with_the_observer_it_began_with(tmp_path, change):
    began = Simulation(DEMO, DISPLAY, seed=1)
    simulate_sitting(began, tmp_path, "S001")
    path = tmp_path / "demo" / "S001" / "journal.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    whole = read_journal(path)
    path.write_bytes(b"".join(lines[:15]))

    with pytest.raises(StudyError, match="must go on with the observer it began with"):
        simulate_sitting(Simulation(DEMO, DISPLAY, **({"seed": 1} | change)), tmp_path, "S001")
    assert path.read_bytes() == b"".join(lines[:15])
    simulate_sitting(began, tmp_path, "S001")
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
        read_table(path)
