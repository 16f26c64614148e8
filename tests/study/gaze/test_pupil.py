"""Pupil Labs' glasses: REST and RTSP, a map onto the screen, loss, a broken connection, death."""

from __future__ import annotations

import struct
import time
from functools import partial

import numpy as np
import pytest
from pupil_phone import EPOCH_S, PupilPhone, in_camera
from tracker_session import FHD, FOREVER, MIDDLE_PX, VIEWING, Eye, pumped, sit

from protocols.disk.side_files import check_side_files
from protocols.errors import StudyError
from protocols.journal import Calibration, Note, SessionEnd
from study_app.gaze.open_source import open_gaze
from study_app.gaze.pupil import PupilGaze, homography, on_screen
from study_app.gaze.source import TrackerContext
from study_app.gaze.validation import nine_points_px
from study_app.virtual import VirtualClock


@pytest.fixture
def phone_of():
    made = []

    def make(eye, **options):
        made.append(PupilPhone(eye, **options))
        return made[-1]

    yield make
    for phone in made:
        phone.close()


def desk(clock) -> TrackerContext:
    return TrackerContext(FHD, clock, lambda: MIDDLE_PX, 60.0)


def test_a_session_calibrates_at_our_targets_and_survives_loss_break_and_death(tmp_path, phone_of):
    eye, clock = Eye(("blink", "loss", "break", "", "death")), VirtualClock()
    phone = phone_of(eye)
    adapter = pumped(PupilGaze, phone, eye, clock)
    sat = sit(tmp_path, partial(adapter, f"127.0.0.1:{phone.port}"), eye, clock)

    reasons = [attempt.void_reason for attempt in sat.journal.attempts]
    assert reasons == [None, "data-loss", "data-loss", None, "data-loss"]
    assert sat.journal.attempts[0].gaze.blinks == 1
    last = sat.journal.events[-1]
    assert isinstance(last, SessionEnd)
    assert last.reason == "tracker-lost"
    notes = [event for event in sat.journal.events if isinstance(event, Note)]
    told = [note.text for note in notes]
    assert "gaze: the tracker's own calibration: 0.00 deg at 9 valid points" in told
    assert any("is connected again" in text for text in told)
    assert sum("broke (it was closed)" in text for text in told) == 2
    assert any("the phone makes the recording 7f3a" in text for text in told)
    # The eye's own offset went into the map, so that the validation finds none.
    (check, *_) = [event for event in sat.journal.events if isinstance(event, Calibration)]
    assert check.accuracy_deg < 0.01
    assert [path for path, _ in phone.asked[:2]] == ["/api/recording:start", "/api/event"]
    assert phone.asked[-1][0] == "/api/recording:stop_and_save"
    files = [note.file for note in notes if note.file]
    assert check_side_files(sat.journal).wrong == ()
    folder = sat.journal.path.parent
    kept = b"".join((folder / file.file).read_bytes() for file in files)
    packets = []
    while kept:
        (length,) = struct.unpack("!I", kept[:4])
        packets.append(kept[4 : 4 + length])
        kept = kept[4 + length :]
    first = phone.sent.index(packets[0])
    assert sorted(packets) == sorted(phone.sent[first:])  # two ports: neighbours may swap


def test_stamps_and_places_come_through_and_lost_packets_are_said(phone_of):
    eye, clock = Eye(), VirtualClock()
    phone = phone_of(eye)
    source = pumped(PupilGaze, phone, eye, clock)(f"127.0.0.1:{phone.port}", desk(clock))
    source.open()
    points = nine_points_px(VIEWING)
    source._map = homography([in_camera(point) for point in points], points)
    phone.skips = 3
    got = []
    for _ in range(240):  # the stamps' 32 bits begin anew meanwhile
        clock.move_to(clock() + 1 / 60)
        got += source.poll()
    told = source.news()
    source.close()

    assert told == ["3 packets of gaze were lost on the way"]
    stamps = np.array([sample.raw_t for sample in got]) - EPOCH_S
    assert np.diff(stamps) == pytest.approx(1 / 200, abs=2e-5)
    for sample in got:
        assert sample.t_s - sample.raw_t == pytest.approx(source.info().clock_offset_s)
        assert (sample.x_px, sample.y_px) == pytest.approx((966.0, 536.0), abs=0.01)


def test_before_a_calibration_no_eye_is_on_the_screen(phone_of):
    eye, clock = Eye(), VirtualClock()
    phone = phone_of(eye)
    source = pumped(PupilGaze, phone, eye, clock)(f"127.0.0.1:{phone.port}", desk(clock))
    source.open()
    clock.move_to(clock() + 0.1)
    samples = source.poll()
    source.close()

    assert samples
    assert not any(sample.valid for sample in samples)
    assert "holds while head and screen stay" in source.info().notes[0]


def test_a_map_of_noisy_places_is_near_the_truth(rng):
    points = nine_points_px(VIEWING)
    places = [tuple(np.add(in_camera(point), rng.normal(0, 0.5, 2))) for point in points]
    fit = homography(places, points)

    for point in points:
        assert on_screen(fit, *in_camera(point)) == pytest.approx(point, abs=5)


def test_what_is_not_there_is_told_with_a_cure(phone_of):
    clock = VirtualClock()
    with pytest.raises(StudyError, match=r"must be reachable .*Companion app"):
        open_gaze("pupil:127.0.0.1:1", desk(clock))
    bare = phone_of(Eye(), glasses=False)
    with pytest.raises(StudyError, match="must see its glasses"):
        open_gaze(f"pupil:127.0.0.1:{bare.port}", desk(clock))
    for host in ("a" * 70 + ".b", "no where"):
        with pytest.raises(StudyError, match=r"must be reachable|was not understood"):
            open_gaze(f"pupil:{host}", desk(clock))
    silent = phone_of(Eye())
    with pytest.raises(StudyError, match=r"must send gaze.*firewall"):
        PupilGaze(f"127.0.0.1:{silent.port}", desk(clock), wait_s=0.2).open()


def test_packets_that_make_no_sense_are_left_out(phone_of):
    eye, clock = Eye(), VirtualClock()
    phone = phone_of(eye)
    source = pumped(PupilGaze, phone, eye, clock)(f"127.0.0.1:{phone.port}", desk(clock))
    source.open()
    for data in (b"", b"\x80", bytes(12), b"\x8f" + bytes(30), struct.pack("!ffB", 1, 1, 255)):
        for channel in (0, 1):
            phone._send(data, channel)
    clock.move_to(clock() + 0.1)
    due = phone.advance(clock())
    samples = []
    for _ in range(100):
        samples += PupilGaze.poll(source)
        time.sleep(0.002)
    source.close()

    assert len(samples) == due


@pytest.mark.parametrize("gone", ["the connection", "the packets"])
def test_a_calibration_that_got_no_gaze_says_so_and_not_that_no_eye_was_seen(phone_of, gone):
    eye, clock = Eye(), VirtualClock()
    phone = phone_of(eye)

    def look_at(_target, duration_s, poll, _on_key):
        clock.move_to(clock() + duration_s)
        poll()
        return True

    where = TrackerContext(FHD, clock, lambda: MIDDLE_PX, 60.0, look_at)
    source = pumped(PupilGaze, phone, eye, clock)(f"127.0.0.1:{phone.port}", where)
    source.open()
    if gone == "the connection":
        eye.gone = range(FOREVER)
        phone.drop()
        while source._wire.connection:
            time.sleep(0.001)
        said = r"phone at .* must last \(there is none now\)"
    else:
        phone.skips = 10**6
        said = r"phone must send gaze \(none came at 9 of 9 targets\)"
    with pytest.raises(StudyError, match=rf"{said}; see .*session resume"):
        source.calibrate(nine_points_px(VIEWING))
    source.close()
