"""A tracker is calibrated at targets in the session's own window."""

import fake_pylink
import pytest

from protocols.journal import Calibration, Note
from protocols.journal_file import check_side_files

HASTY = f"""
import sys, time
sys.path.append({str(fake_pylink.__file__.rpartition("/")[0])!r})
import fake_pylink

class Staring:
    now = lambda self, _t_s: ""
    place = lambda self, _t_s: (320.0, 240.0)

began_s = time.monotonic()
host = fake_pylink.FakePylink(Staring(), lambda: time.monotonic() - began_s)

class Sending(fake_pylink.Tracker):
    def startRecording(self, *what):
        host.advance(host.clock())
        return super().startRecording(*what)

    def getNextData(self):
        host.advance(host.clock())
        return super().getNextData()

fake_pylink.Tracker = Sending
fake_pylink.SETUP_TARGETS_PX[:] = [(320, 240), (64, 48)]
sys.modules["pylink"] = host

from study_app.gaze import validation
validation.SETTLE_S = validation.HOLD_S = 0.1
from study_app.cli import main
main()
"""


@pytest.mark.slow
def test_a_session_in_the_window_calibrates_validates_and_keeps_what_was_recorded(
    screen, make_study
):
    study = make_study({
        "pairings": '[["metameric", "push-pull"]]', "repeats": "1", "duration_s": "0.4",
        "fixation_s": "0.2", "mode": '"enforce"', "window_deg": "60.0\naccuracy_max_deg = 60.0",
    })  # fmt: skip
    screen.run(*screen.session("run", study, "--simulate", "--gaze", "eyelink"), code=HASTY)

    journal = study.journal()
    assert journal.start.gaze.source == "eyelink"
    assert journal.start.gaze.rate_hz == pytest.approx(fake_pylink.RATE_HZ, rel=0.05)
    notes = [event for event in journal.events if isinstance(event, Note)]
    assert any("own calibration" in note.text for note in notes)
    assert any(note.file for note in notes)
    assert any(isinstance(event, Calibration) for event in journal.events)
    assert check_side_files(journal).wrong == ()
