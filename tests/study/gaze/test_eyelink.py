"""An EyeLink by a stand-in for SR Research's pylink, and by pylink's dummy mode where it is."""

from dataclasses import replace

import pytest
from fake_pylink import EDF, SETUP_TARGETS_PX, FakePylink
from tracker_session import FHD, MIDDLE_PX, Eye, pumped, sit

from protocols.errors import StudyError
from protocols.journal import Note, SessionEnd
from protocols.journal_file import check_side_files
from study_app.gaze.eyelink import EyelinkGaze, graphics
from study_app.gaze.open_source import open_gaze
from study_app.gaze.source import TrackerContext
from study_app.virtual import VirtualClock


def session(folder, plan, host=None, **options):
    eye, clock = Eye(plan), VirtualClock()
    fake = FakePylink(eye, clock)
    for key, value in (host or {}).items():
        setattr(fake, key, value)
    adapter = pumped(EyelinkGaze, fake, eye, clock)
    return sit(folder, lambda desk: adapter("", desk, fake), eye, clock, **options), fake


def notes_of(sat) -> list[str]:
    return [event.text for event in sat.journal.events if isinstance(event, Note)]


def files_of(sat):
    return [event.file for event in sat.journal.events if isinstance(event, Note) and event.file]


def test_a_whole_session_calibrates_corrects_drift_and_fetches_its_recording(tmp_path):
    sat, host = session(tmp_path, ("blink", "loss"))

    reasons = [attempt.void_reason for attempt in sat.journal.attempts]
    assert reasons[:3] == [None, "data-loss", None]
    assert set(reasons[2:]) == {None}
    assert sat.journal.attempts[0].gaze.blinks == 1
    assert sat.journal.events[-1].reason == "completed"
    # Calibrated once, drift corrected before each later block; targets in our window.
    done = [call[0] for call in host.calls]
    assert (done.count("doTrackerSetup"), done.count("doDriftCorrect")) == (1, 2)
    shown = [place for place in sat.shown_px if place]
    assert shown[:3] == SETUP_TARGETS_PX
    told = notes_of(sat)
    assert "gaze: the tracker's own calibration: 0.42 deg at 9 valid points" in told
    assert "gaze: the tracker's drift check found 0.31 deg" in told
    assert any("says of its drift correction: drift correction: 0.31 deg" in text for text in told)
    messages = [call[1] for call in host.calls if call[0] == "sendMessage"]
    assert messages[0] == "DISPLAY_COORDS 0 0 1919 1079"
    assert sum(text.endswith("attempt 1") for text in messages) > 3
    (file,) = files_of(sat)
    assert file.file == "tracker/end.edf"
    assert (sat.journal.path.parent / file.file).read_bytes() == EDF
    assert check_side_files(sat.journal).wrong == ()


def test_a_link_that_breaks_leaves_a_whole_journal_that_names_the_file_on_the_host(tmp_path):
    sat, host = session(tmp_path, ("", "death"))

    last = sat.journal.events[-1]
    assert isinstance(last, SessionEnd)
    assert last.reason == "tracker-lost"
    assert sat.journal.damaged == ()
    assert [attempt.void_reason for attempt in sat.journal.attempts] == [None, "data-loss"]
    told = notes_of(sat)
    assert any("the link to the EyeLink broke" in text for text in told)
    assert any("could not be connected again (Link terminated)" in text for text in told)
    (name,) = host.files
    assert any(f"lies on the EyeLink's Host PC as {name}" in text for text in told)


def test_a_link_that_comes_back_goes_on_in_a_further_file_and_both_are_kept(tmp_path):
    sat, host = session(tmp_path, ("blink", "loss", "break", "", "blink"))

    reasons = [attempt.void_reason for attempt in sat.journal.attempts]
    assert reasons[:5] == [None, "data-loss", "data-loss", None, None]
    assert set(reasons[5:]) == {None}
    assert sat.journal.events[-1].reason == "completed"
    assert sat.journal.damaged == ()
    told = notes_of(sat)
    _, second = host.files
    assert sum("the link to the EyeLink broke" in text for text in told) == 1
    assert f"gaze: the EyeLink is connected again, and records {second}" in told
    assert [file.file for file in files_of(sat)] == ["tracker/end.edf", "tracker/end-2.edf"]
    assert check_side_files(sat.journal).wrong == ()
    assert [call[0] for call in host.calls].count("EyeLink") == 2


def test_a_recording_that_cannot_be_fetched_costs_no_session(tmp_path):
    host = {"file_is_lost": True}
    sat, _ = session(tmp_path, (), host=host)

    assert sat.journal.events[-1].reason == "completed"
    assert files_of(sat) == []
    assert any("the EDF file must be fetched (Link terminated)" in t for t in notes_of(sat))


@pytest.mark.parametrize("host", [{"drift_refuses": True}, {"drift_error": "1.70"}])
def test_drift_that_is_too_large_or_never_ends_has_the_tracker_calibrated_again(tmp_path, host):
    _, fake = session(tmp_path, (), host=host)

    done = [call[0] for call in fake.calls if call[0].startswith("do")]
    assert done == ["doTrackerSetup"] + 2 * ["doDriftCorrect", "doTrackerSetup"]


def test_no_recording_is_made_where_the_study_keeps_no_gaze(tmp_path):
    sat, host = session(tmp_path, ("death",), privacy={"store_gaze": False})

    assert host.files == {}
    assert not host.into_file
    assert files_of(sat) == []


def test_the_quit_key_ends_the_setup_and_other_keys_reach_the_tracker():
    clock = VirtualClock()
    fake = FakePylink(Eye(), clock)
    keys, going = ["enter", "c", "up", "f1"], [True]

    def look_at(_place, _duration_s, _poll, on_key):
        for key in keys:
            on_key(key)
        return going[0]

    drawn = graphics(fake, TrackerContext(FHD, clock, lambda: MIDDLE_PX, 60.0, look_at))
    assert [key.code for key in drawn.get_input_key()] == [13, ord("c"), fake.CURS_UP]
    going[0] = False
    assert [key.code for key in drawn.get_input_key()] == [fake.TERMINATE_KEY]


def opened(rest, fake, clock):
    source = pumped(EyelinkGaze, fake, fake.eye, clock)(
        rest, TrackerContext(FHD, clock, lambda: MIDDLE_PX, 60.0), fake
    )
    source.open()
    return source


def test_what_is_not_there_is_told_with_a_cure(monkeypatch):
    clock = VirtualClock()
    fake = FakePylink(Eye(), clock)
    fake.refuses = True
    with pytest.raises(StudyError, match=r"Host PC must be reachable at 100\.1\.1\.1 .*cable"):
        opened("", fake, clock)
    with pytest.raises(StudyError, match="must read eyelink:HOST,eye=left"):
        EyelinkGaze("host,eye=both", TrackerContext(FHD, clock, lambda: MIDDLE_PX, 60.0), fake)
    monkeypatch.setitem(__import__("sys").modules, "pylink", None)
    with pytest.raises(StudyError, match=r"pip install 'metamerlab\[eyelink\]'"):
        open_gaze("eyelink", TrackerContext(FHD, clock, lambda: MIDDLE_PX, 60.0))


def test_samples_that_the_link_lost_are_said():
    clock = VirtualClock()
    fake = FakePylink(Eye(), clock)
    source = opened("", fake, clock)
    fake.queue.append((fake.LOSTDATAEVENT, None))
    EyelinkGaze.poll(source)

    assert any("lost samples" in text for text in source.news())


def test_pylinks_own_dummy_mode_takes_every_command_and_sends_nothing(monkeypatch):
    pytest.importorskip("pylink", reason="SR Research's pylink is not installed (extra eyelink)")
    monkeypatch.setattr("study_app.gaze.eyelink.WAIT_S", 0.1)
    source = EyelinkGaze("dummy", TrackerContext(FHD, VirtualClock(), lambda: MIDDLE_PX, 60.0))
    with pytest.raises(StudyError, match="must send samples"):
        source.open()
    source.close()


@pytest.mark.parametrize("step", ["startRecording", "openDataFile", "getCalibrationMessage"])
def test_a_step_that_fails_over_a_link_that_broke_is_told_as_that(monkeypatch, step):
    clock = VirtualClock()
    fake = FakePylink(Eye(), clock)
    source = opened("", fake, clock)
    source._desk = replace(source._desk, look_at=lambda *_: True)

    def broken(*_):
        fake.connected = False
        if step == "getCalibrationMessage":
            raise RuntimeError("Link terminated")
        return -1

    monkeypatch.setattr(type(source._tracker), step, broken)
    said = r"the EyeLink must be connected \(its link broke\)|link to the EyeLink broke"
    with pytest.raises(StudyError, match=rf"({said}).*; see its cable and its Host PC, then run"):
        source.calibrate([])
