"""A Tobii by a stand-in for TittaPy: calibration, blinks, loss, a break, death."""

from __future__ import annotations

import math

import pytest
from fake_titta import EPOCH_US, FakeTitta
from tracker_session import FHD, MIDDLE_PX, VIEWING, Eye, pumped, sit

from protocols.disk.side_files import check_side_files
from protocols.errors import StudyError
from protocols.journal import Note
from study_app.gaze.open_source import open_gaze
from study_app.gaze.source import TrackerContext
from study_app.gaze.tobii import TobiiGaze
from study_app.gaze.validation import nine_points_px
from study_app.virtual import VirtualClock


def session(folder, plan, **fake):
    eye, clock = Eye(plan), VirtualClock()
    titta = FakeTitta(eye, clock)
    for key, value in fake.items():
        setattr(titta, key, value)
    adapter = pumped(TobiiGaze, titta, eye, clock)
    return sit(folder, lambda desk: adapter("", desk, titta), eye, clock), titta


def test_a_session_with_all_that_a_tracker_does_is_whole_and_says_so(tmp_path):
    sat, titta = session(tmp_path, ("blink", "loss", "break", "", "death"))

    reasons = [attempt.void_reason for attempt in sat.journal.attempts]
    assert reasons == [None, "data-loss", "data-loss", None, "data-loss"]
    assert sat.journal.attempts[0].gaze.blinks == 1
    assert sat.journal.events[-1].reason == "tracker-lost"
    notes = [event for event in sat.journal.events if isinstance(event, Note)]
    told = [note.text for note in notes]
    assert told.count("gaze: the Tobii says connection_lost") == 2
    assert told.count("gaze: the Tobii says connection_restored") == 1
    (own,) = [text for text in told if "own calibration" in text]
    assert own.endswith("deg at 9 valid points")
    assert 0.4 < float(own.split(": ")[2].split(" deg")[0]) < 0.9
    assert [titta.calls.count((name,)) for name in ("enter", "collect", "compute", "leave")] == [
        1, 9, 1, 1,
    ]  # fmt: skip
    assert [place for place in sat.shown_px if place][:9] == nine_points_px(VIEWING)
    assert check_side_files(sat.journal).wrong == ()
    files = [note.file.file for note in notes if note.file]
    assert files[:5] == [f"tracker/{n:04d}.csv" for n in range(5)]
    table = (sat.journal.path.parent / files[0]).read_text().splitlines()
    assert table[0].startswith("device_time_stamp,system_time_stamp,left_gaze_point_on")
    assert all(line.count(",") == table[0].count(",") for line in table)


@pytest.mark.parametrize("step", ["enter", "collect", "compute"])
def test_a_calibration_that_fails_ends_the_run_with_a_cure_and_leaves_that_mode(step):
    eye, clock = Eye(), VirtualClock()
    titta = FakeTitta(eye, clock)
    titta.fails = step

    def look_at(*_):
        clock.move_to(clock() + 1 / 60)
        return True

    source = TobiiGaze("", TrackerContext(FHD, clock, lambda: MIDDLE_PX, 60.0, look_at), titta)
    source._tracker = titta
    with pytest.raises(StudyError, match=f"must succeed .*{step} failed"):
        source.calibrate(nine_points_px(VIEWING))
    assert titta.calls[-1] == ("leave",)


def test_stamps_and_places_come_through_and_eyes_are_averaged():
    eye, clock = Eye(), VirtualClock()
    titta = FakeTitta(eye, clock)
    source = pumped(TobiiGaze, titta, eye, clock)(
        "", TrackerContext(FHD, clock, lambda: MIDDLE_PX, 60.0), titta
    )
    source.open()
    clock.move_to(clock() + 0.5)
    samples = source.poll()

    assert len(samples) == pytest.approx(60, abs=1)
    for sample in samples:
        number = round((sample.raw_t - EPOCH_US / 1e6) * 120)
        assert sample.t_s == pytest.approx(number / 120, abs=1e-5)
        assert (sample.x_px, sample.y_px) == pytest.approx((966.0, 536.0))
    assert not any(math.isnan(sample.x_px) for sample in samples)


def test_what_is_not_there_is_told_with_a_cure(monkeypatch):
    clock = VirtualClock()
    desk = TrackerContext(FHD, clock, lambda: MIDDLE_PX, 60.0)
    for trackers, said in ((0, "found none"), (2, "found tet-tcp://0, tet-tcp://1")):
        with pytest.raises(StudyError, match=f"one Tobii must be found .{said}"):
            TobiiGaze("", desk, FakeTitta(Eye(), clock, trackers)).open()
    monkeypatch.setitem(__import__("sys").modules, "TittaPy_v2", None)
    with pytest.raises(StudyError, match=r"pip install 'metamerlab\[tobii\]'"):
        open_gaze("tobii", desk)


def test_a_calibration_whose_tracker_is_gone_says_so_and_asks_nobody_to_sit_better():
    eye, clock = Eye(), VirtualClock()
    titta = FakeTitta(eye, clock)
    titta._answers = lambda: None  # it takes commands, and none of them ends

    def look_at(*_):
        clock.move_to(clock() + 1 / 60)
        titta.said = ["connection_lost"]
        titta.results.clear()
        return True

    source = TobiiGaze("", TrackerContext(FHD, clock, lambda: MIDDLE_PX, 60.0, look_at), titta)
    source._tracker = titta
    cure = r"must be connected .*it says connection_lost\); see its cable"
    with pytest.raises(StudyError, match=cure):
        source.calibrate(nine_points_px(VIEWING))
    assert source.news()[-1] == "the Tobii says connection_lost"
