"""A tracker is calibrated at targets in the session's own window."""

from __future__ import annotations

import threading
import time

import pytest
from gazepoint_server import GazepointServer

from protocols.disk.side_files import check_side_files
from protocols.journal import Calibration, Note

HASTY = """
from study_app.gaze import validation
validation.SETTLE_S = validation.HOLD_S = 0.1
from study_app.cli import main
main()
"""


class Staring:
    """An eye that looks at the middle whatever is shown."""

    def now(self, _t_s):
        return ""

    def place(self, _t_s):
        return 320.0 * 1920 / 640, 240.0 * 1080 / 480


@pytest.mark.slow
def test_a_session_in_the_window_calibrates_validates_and_keeps_what_was_sent(
    screen, make_study, monkeypatch
):
    monkeypatch.setattr("gazepoint_server.POINT_S", 0.1)
    study = make_study({
        "pairings": '[["metameric", "push-pull"]]', "repeats": "1", "duration_s": "0.4",
        "fixation_s": "0.2", "mode": '"enforce"', "window_deg": "60.0\naccuracy_max_deg = 60.0",
    })  # fmt: skip
    server, stop, began_s = GazepointServer(Staring()), threading.Event(), time.monotonic()

    def send():
        while not stop.wait(0.01):
            if server._wants.is_set():
                try:
                    server.advance(time.monotonic() - began_s)
                except OSError:
                    return

    sender = threading.Thread(target=send)
    sender.start()
    try:
        gaze = f"gazepoint:127.0.0.1:{server.port}"
        done = screen.run(*screen.session("run", study, "--simulate", "--gaze", gaze), code=HASTY)
    finally:
        stop.set()
        sender.join()
        server.close()

    assert done.returncode == 0, done.stdout + done.stderr
    journal = study.journal()
    assert journal.start.gaze.source == "gazepoint"
    assert journal.start.gaze.rate_hz == pytest.approx(150, rel=0.05)
    notes = [event for event in journal.events if isinstance(event, Note)]
    assert any("own calibration" in note.text for note in notes)
    assert any(note.file for note in notes)
    assert any(isinstance(event, Calibration) for event in journal.events)
    assert check_side_files(journal).wrong == ()
