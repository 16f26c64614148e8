"""Gazepoint's XML over TCP: calibration, blinks, loss, a connection that breaks, and death."""

from __future__ import annotations

import math
import socket
import time
from contextlib import suppress
from functools import partial

import pytest
from gazepoint_server import EPOCH_S, GazepointServer
from tracker_session import FHD, FOREVER, MIDDLE_PX, VIEWING, Eye, pumped, sit

from protocols.disk.side_files import check_side_files
from protocols.errors import StudyError
from protocols.journal import Calibration, Note, SessionEnd
from study_app.gaze.gazepoint import GazepointGaze
from study_app.gaze.open_source import open_gaze
from study_app.gaze.source import TrackerContext
from study_app.gaze.validation import nine_points_px
from study_app.virtual import VirtualClock


@pytest.fixture
def server_of():
    made = []

    def make(eye, **options):
        made.append(GazepointServer(eye, **options))
        return made[-1]

    yield make
    for server in made:
        server.close()


def session(folder, server_of, plan=(), **options):
    eye, clock = Eye(plan), VirtualClock()
    server = server_of(eye)
    adapter = pumped(GazepointGaze, server, eye, clock)
    make = partial(adapter, f"127.0.0.1:{server.port}")
    return sit(folder, make, eye, clock, **options), server


def notes_of(sat) -> list[str]:
    return [event.text for event in sat.journal.events if isinstance(event, Note)]


def test_a_session_with_all_that_a_tracker_does_is_whole_and_says_so(tmp_path, server_of):
    plan = ("blink", "loss", "break", "", "death")
    sat, server = session(tmp_path, server_of, plan)

    assert sat.journal.damaged == ()
    reasons = [attempt.void_reason for attempt in sat.journal.attempts]
    assert reasons == [None, "data-loss", "data-loss", None, "data-loss"]
    assert sat.journal.attempts[0].gaze.blinks == 1
    last = sat.journal.events[-1]
    assert isinstance(last, SessionEnd)
    assert last.reason == "tracker-lost"
    told = notes_of(sat)
    where = f"Gazepoint Control at 127.0.0.1:{server.port}"
    assert sum(f"the connection to {where} broke (it was closed)" in text for text in told) == 2
    (back,) = [text for text in told if "is connected again" in text]
    assert 0.3 < float(back.split("after ")[1].split(" s")[0]) < 5
    # Every byte from the calibration on is kept, hashed, in order.
    files = [event.file for event in sat.journal.events if isinstance(event, Note) and event.file]
    found = check_side_files(sat.journal)
    assert (found.checked, found.wrong) == (2 * 5 + len(files), ())
    assert [file.file for file in files[:5]] == [f"tracker/{n:04d}.xml" for n in range(5)]
    folder = sat.journal.path.parent
    kept = b"".join((folder / file.file).read_bytes() for file in files)
    assert server.sent.endswith(kept)
    assert b'ID="CALIB_START_PT"' in kept


def test_the_tracker_is_calibrated_at_our_targets_before_gaze_is_validated(tmp_path, server_of):
    sat, server = session(tmp_path, server_of, ("death",))

    points = nine_points_px(VIEWING)
    asked = [line for line in server.commands if "CALIBRATE" in line]
    assert asked[:2] == ['<SET ID="CALIBRATE_SHOW" STATE="0" />', '<SET ID="CALIBRATE_CLEAR" />']
    assert sum("ADDPOINT" in line for line in asked) == 9
    assert [pytest.approx(place, abs=0.1) for place in points] == sat.shown_px[1:]
    events = [event.kind for event in sat.journal.events]
    assert events.index("calibration") > events.index("note")
    # .01 of the width is 19.2 px: 0.86 deg in the middle, less at the sides.
    (own,) = [text for text in notes_of(sat) if "own calibration" in text]
    assert own.endswith("deg at 9 valid points")
    assert 0.4 < float(own.split(": ")[2].split(" deg")[0]) < 0.9
    (check,) = [event for event in sat.journal.events if isinstance(event, Calibration)]
    assert check.lost_share == 0
    assert check.sd_deg < 0.01


def test_nothing_is_kept_where_the_study_keeps_no_gaze(tmp_path, server_of):
    sat, _ = session(tmp_path, server_of, ("death",), privacy={"store_gaze": False})

    assert all(event.file is None for event in sat.journal.events if isinstance(event, Note))
    assert not (sat.journal.path.parent / "tracker").exists()


def test_stamps_and_places_come_through_unchanged(server_of):
    """And lost eyes, rows of nonsense and halves of lines are none."""
    recorded = [(k / 150, 0.25 + k / 1000, 0.75 - k / 1000) for k in range(120)]
    lines = [
        f'<REC TIME="{EPOCH_S + t:.5f}" BPOGX="{x:.5f}" BPOGY="{y:.5f}" BPOGV="{k % 7 != 3:d}" />'
        for k, (t, x, y) in enumerate(recorded)
    ]
    lines.insert(60, '<REC TIME="abc" BPOGX="1" />')
    eye, clock = Eye(), VirtualClock()
    server = server_of(eye, lines=lines)
    adapter = pumped(GazepointGaze, server, eye, clock)
    got = []

    class Kept(adapter):
        def poll(self):
            samples = super().poll()
            got.extend(samples)
            return samples

    source = Kept(f"127.0.0.1:{server.port}", desk(clock))
    source.open()
    before = len(got)
    while len(got) < len(lines):
        clock.move_to(clock() + 1 / 60)
        source.poll()
    source.close()

    assert math.isnan(got.pop(60).raw_t)
    for k, (sample, (t, x, y)) in enumerate(zip(got, recorded, strict=False)):
        assert sample.raw_t == pytest.approx(EPOCH_S + t, abs=1e-5)
        assert sample.valid == (k % 7 != 3)
        if sample.valid:
            assert (sample.x_px, sample.y_px) == pytest.approx((x * 1920, y * 1080), abs=0.01)
        if k >= before:
            assert sample.t_s - sample.raw_t == pytest.approx(source.info().clock_offset_s)


def desk(clock) -> TrackerContext:
    return TrackerContext(FHD, clock, lambda: MIDDLE_PX, 60.0)


def test_what_is_not_there_or_says_nothing_is_told_with_a_cure(server_of):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    clock = VirtualClock()
    with pytest.raises(StudyError, match=r"must be reachable .*start Gazepoint Control"):
        open_gaze(f"gazepoint:127.0.0.1:{port}", desk(clock))
    silent = server_of(Eye())
    with pytest.raises(StudyError, match="must send samples"):
        GazepointGaze(f"127.0.0.1:{silent.port}", desk(clock), wait_s=0.2).open()
    for odd in ("host:x", "host:0", "host:70000", "a:b:c"):
        with pytest.raises(StudyError, match="must read gazepoint:HOST"):
            open_gaze(f"gazepoint:{odd}", desk(clock))


def test_a_flood_without_lines_breaks_the_connection_and_is_said(server_of):
    eye, clock = Eye(), VirtualClock()
    server = server_of(eye, screen=(1280, 1024))
    source = pumped(GazepointGaze, server, eye, clock)(f"127.0.0.1:{server.port}", desk(clock))
    source.open()
    assert "1280 x 1024" in source.info().notes[0]
    server._send("x" * 200_000)
    until = 200
    while until and not (told := [text for text in source.news() if "no lines" in text]):
        clock.move_to(clock() + 1 / 60)
        GazepointGaze.poll(source)
        time.sleep(0.01)
        until -= 1
    source.close()

    assert "was not understood" in told[0]


@pytest.mark.parametrize("place", ["nan", "1e300", "-5", "", "abc"])
def test_a_calibration_point_off_the_screen_is_never_drawn(server_of, place):
    eye, clock = Eye(), VirtualClock()
    server, drawn = server_of(eye), []

    def look_at(target, *_):
        drawn.append(target)
        clock.move_to(clock() + 1.0)
        return True

    source = pumped(GazepointGaze, server, eye, clock)(
        f"127.0.0.1:{server.port}", TrackerContext(FHD, clock, lambda: MIDDLE_PX, 60.0, look_at)
    )
    source.open()
    server._send(f'<CAL ID="CALIB_START_PT" PT="1" CALX="{place}" CALY="0.5" />')
    server._calibration = lambda _now_s: []  # nothing else comes, and no end
    with suppress(StudyError):
        source.calibrate([])
    source.close()

    assert set(drawn) == {None}


@pytest.mark.parametrize("broken", ["before", "meanwhile", "for a moment"])
def test_a_calibration_without_its_connection_says_so_and_not_that_it_did_not_end(
    server_of, broken
):
    eye, clock = Eye(), VirtualClock()
    server = server_of(eye)

    def breaks():
        first, back = source._wire.connection, broken == "for a moment"
        eye.gone = range(0 if back else FOREVER)
        server.drop()
        if back:
            server.listen()
        while source._wire.connection is first or (back and not source._wire.connection):
            time.sleep(0.001)

    def look_at(target, *_):
        if target is not None and broken != "before":
            breaks()
        clock.move_to(clock() + 1 / 60)
        return True

    source = pumped(GazepointGaze, server, eye, clock)(
        f"127.0.0.1:{server.port}", TrackerContext(FHD, clock, lambda: MIDDLE_PX, 60.0, look_at)
    )
    source.open()
    if broken == "before":
        breaks()
    now = "it broke, and is there again" if broken == "for a moment" else "there is none now"
    with pytest.raises(StudyError, match=rf"must last \({now}\); see that .*session resume"):
        source.calibrate(nine_points_px(VIEWING))
    source.close()
