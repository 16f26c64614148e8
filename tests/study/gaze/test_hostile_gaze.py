"""Gaze of any tracker is judged by finite numbers, and what is stored reads back."""

import math
import re
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from protocols.display import Viewing
from protocols.journal import Note, SessionEnd
from protocols.journal_file import read_journal
from protocols.load import load_display, load_protocol
from protocols.study_file.schema import StudyProtocol
from study_app.attempt import _gaze_csv
from study_app.conduct import conduct
from study_app.desktop.desktop_watch import SleepWatch
from study_app.gaze.fixation import FixationMonitor
from study_app.gaze.source import GazeSample, SourceInfo
from study_app.gaze.trusted import AHEAD_S, TrustedGaze
from study_app.observers import ArtificialObserver, PreferenceModel
from study_app.opening import begin
from study_app.simulate import SimulatedStudy
from study_app.trial import GazeVerdict
from study_app.virtual import VirtualClock, VirtualStage

FHD = load_display("fhd27-60hz")
DEMO = load_protocol(Path("demo"))
VIEWING = Viewing.of(FHD)


class Tracker:
    """Sends what it is told to, sample by sample."""

    def __init__(self, send) -> None:
        self._send = send

    def open(self):
        pass

    def info(self):
        return SourceInfo("hostile", "", 60.0)

    def poll(self):
        return self._send()

    def mark(self, text):
        pass

    def calibrate(self, _points_px):
        return None

    def close(self):
        pass


def trusted(samples, now_s=10.0) -> tuple[list[GazeSample], TrustedGaze]:
    source = TrustedGaze(Tracker(lambda: samples), lambda: now_s)
    return list(source.poll()), source


def test_stamps_that_fall_lie_ahead_or_are_none_are_left_out_and_counted():
    good = [GazeSample(9.0, 9.0, 1, 1), GazeSample(9.1, 9.1, 1, 1), GazeSample(9.1, 9.1, 1, 1)]
    bad = [
        *(GazeSample(stamp, 1, 1, 1) for stamp in (math.nan, math.inf, -math.inf)),
        GazeSample(9.05, 1, 1, 1), GazeSample(10.0 + 2 * AHEAD_S, 1, 1, 1),
        GazeSample(9.2, math.nan, 1, 1),
    ]  # fmt: skip
    kept, source = trusted([*good, *bad, GazeSample(10.0, 10, 1, 1)])

    assert kept == [*good, GazeSample(10.0, 10, 1, 1)]
    assert source.left_out == len(bad)


def test_a_clock_may_be_measured_anew_between_attempts():
    sent = iter(([GazeSample(9.5, 9.5, 1, 1)], [GazeSample(9.498, 9.5, 1, 1)]))
    source = TrustedGaze(Tracker(lambda: next(sent)), lambda: 10.0)
    source.poll()
    source.mark("main-0001 attempt 1")

    assert list(source.poll()) == [GazeSample(9.498, 9.5, 1, 1)]
    assert source.left_out == 0


@pytest.mark.parametrize("place", [math.inf, -math.inf, 1e300, -1e7, math.nan])
def test_gaze_beyond_the_world_is_a_lost_eye(place):
    for x, y in ((place, 5.0), (5.0, place)):
        (sample,), source = trusted([GazeSample(9.0, 9.0, x, y)])
        assert (sample.valid, source.left_out) == (False, 0)


any_float = st.floats(allow_nan=True, allow_infinity=True) | st.floats(8, 11)
any_sample = st.builds(GazeSample, any_float, any_float, any_float, any_float)


@given(st.lists(any_sample, max_size=40))
@example([GazeSample(-math.inf, 0.0, 0.0, 0.0)])
def test_whatever_is_sent_is_judged_by_finite_numbers_and_reads_back(samples):
    kept, _ = trusted(samples)
    monitor = FixationMonitor(DEMO.gaze, VIEWING, (0.0, 0.0), 60.0)
    monitor.watch(8.0, 1.0)
    monitor.feed(kept)
    quality = monitor.quality(10.0).model_dump()
    assert all(math.isfinite(value) for value in quality.values() if value is not None)
    assert monitor.verdict(10.0) in GazeVerdict

    data = _gaze_csv(kept, 0.0)
    rows = [line.split(",") for line in data.decode().splitlines()[1:]]
    stamps = [float(row[0]) for row in rows]
    assert stamps == sorted(stamps)
    assert all(math.isfinite(float(cell)) for row in rows for cell in row if cell)


def enforced() -> StudyProtocol:
    plain = DEMO.model_dump()
    plain["gaze"] |= {"mode": "enforce"}
    plain["design"] |= {"repeats": 1}
    return StudyProtocol.model_validate(plain)


def steady(clock: VirtualClock):
    x_px, y_px = VIEWING.to_px(0.0, 0.0)
    return lambda: [GazeSample(clock(), clock(), x_px, y_px)]


def sit(folder: Path, send_of):
    """Conduct a session with a tracker; return its journal."""
    study, clock = enforced(), VirtualClock()
    observer = ArtificialObserver(PreferenceModel(), study.response, 0, "S001")
    stage = VirtualStage(clock, 60.0, observer)
    gaze = TrustedGaze(Tracker(send_of(clock)), clock)
    setup = SimulatedStudy(study, FHD).setup(folder, clock, "S001")
    recorder, plan = begin(setup, stage, gaze)
    with recorder:
        conduct(setup, plan, recorder, stage, gaze)
    return read_journal(recorder.path)


def test_a_clock_that_jumps_ahead_does_not_hold_the_dot_for_a_dead_tracker(tmp_path):
    """Before, one stamp of tomorrow was never old: gaze counted as held for ever."""

    def send_of(clock):
        sent = steady(clock)

        def send():
            if clock() < 20.0:
                return sent()
            return [GazeSample(clock() + 86_400, clock(), *sent()[0][2:])] if clock() < 20.5 else []

        return send

    journal = sit(tmp_path, send_of)

    last = journal.events[-1]
    assert isinstance(last, SessionEnd)
    assert last.reason == "tracker-lost"
    assert journal.attempts[-1].void_reason in ("data-loss", "no-fixation")
    notes = [event.text for event in journal.events if isinstance(event, Note)]
    assert any("samples were left out" in text for text in notes)


def test_sleep_is_told_once_and_setting_the_wall_clock_is_none():
    awake, boot = [100.0], [250.0]
    watch = SleepWatch(lambda: boot[0] - awake[0])
    awake[0], boot[0] = 160.0, 310.0
    assert watch.slept_s() == 0.0
    boot[0] += 3600
    assert watch.slept_s() == pytest.approx(3600)
    assert watch.slept_s() == 0.0


def test_a_machine_that_stands_still_for_seconds_voids_the_attempt(tmp_path):
    """A stopped process, a paused virtual machine: the clock went on, and no refresh had a flip."""
    from study_app.virtual import Fault

    plain = DEMO.model_dump()
    plain["gaze"] |= {"mode": "none"}
    study = StudyProtocol.model_validate(plain)
    clock, planted = VirtualClock(), []

    def faults(trial, attempt):
        planted.append((trial.id, attempt))
        return {90: Fault("missed", 300.0)} if len(planted) == 1 else {}

    observer = ArtificialObserver(PreferenceModel(), study.response, 0, "S001")
    stage = VirtualStage(clock, 60.0, observer, on_prepare=faults)
    setup = SimulatedStudy(study, FHD).setup(tmp_path, clock, "S001")
    recorder, plan = begin(setup, stage, None)
    with recorder:
        conduct(setup, plan, recorder, stage, None)
    attempts = read_journal(recorder.path).attempts

    assert attempts[0].void_reason == "dropped-frames"
    assert {a.outcome for a in attempts if a.trial == attempts[0].trial} == {"void", "completed"}


# --- over the lab streaming layer ------------------------------------------------------------


@pytest.mark.parametrize(
    ("channels", "rate_hz", "form", "said"),
    [
        (3000, 60.0, "float32", "at most 256 channels"),
        (2, 60.0, "string", "must send numbers"),
        (2, 1e6, "float32", "at most 20000 Hz"),
        (2, 1000.0, "float32", "must send at the rate that it says"),
        (1, 60.0, "float32", "two channels or more"),
    ],
)
def test_a_stream_that_cannot_be_gaze_is_refused_with_a_reason(channels, rate_hz, form, said):
    pylsl = pytest.importorskip("pylsl", reason="pylsl is not installed (extra lsl)")
    import threading

    from protocols.errors import StudyError
    from study_app.gaze.lsl import LslGaze, LslSpec

    name = f"hostile-{channels}-{rate_hz}-{form}"
    outlet = pylsl.StreamOutlet(pylsl.StreamInfo(name, "Gaze", channels, rate_hz, form, name))
    stop = threading.Event()

    def send() -> None:  # 50 Hz, whatever it says
        while not stop.wait(0.02):
            outlet.push_sample(["x"] * channels if form == "string" else [1.0] * channels)

    sender = threading.Thread(target=send)
    sender.start()
    source = LslGaze(LslSpec(name), FHD)
    try:
        with pytest.raises(StudyError, match=said):
            source.open()
    finally:
        source.close()
        stop.set()
        sender.join()


def channels(labels: list[str], count: int, spec: str = "") -> tuple[int, int]:
    """Return which channels of a stream with these labels are taken for gaze."""
    from study_app.gaze.lsl import LslGaze, LslSpec

    source = LslGaze(LslSpec.parse(spec), FHD)
    source._choose_channels(labels, [""] * len(labels), count)
    return source._channels


@pytest.mark.parametrize(
    ("labels", "count", "spec", "said"),
    [
        (["t", "a", "b", "x", "y"], 3, "", "one label per channel, or none (got 5 for 3 channels"),
        (["x", "y"], 3, "", "one label per channel, or none (got 2 for 3 channels: x, y)"),
        (["x", "y", "z"], 2, "eye,x=z,y=y", "one label per channel, or none (got 3"),
        (["a", "x", "y"], 3, "eye,x=z", "channel 'z' must be one of the stream's (3 channels: a"),
        (["pupil", "left_a", "left_b"], 3, "", "channel 'x' must be one of the stream's"),
        (["x", "pupil"], 2, "", "channel 'y' must be one of the stream's"),
        (["x", "X", "y"], 3, "", "channel 'x' must be one of the stream's (3 channels: x, X, y)"),
        (["y", "x"], 2, "eye,x=0", "x and y must be two channels of the stream (got channel 0"),
        ([], 2, "eye,x=7,y=0", "channel '7' must be one of the stream's (2 channels: without"),
        ([], 4, "eye,x=2,y=2", "x and y must be two channels"),
        (["x\x1b[2J", "y"], 2, "", "channel 'x' must be one of the stream's (2 channels: x\\x1b"),
    ],
)
def test_labels_that_do_not_name_two_channels_are_told_with_a_cure(labels, count, spec, said):
    """Before, a label beyond the channels broke the session, and lacking ones were guessed."""
    from protocols.errors import StudyError

    with pytest.raises(StudyError) as caught:
        channels(labels, count, spec)

    assert said in str(caught.value)
    assert "--gaze lsl:NAME,x=" in str(caught.value)
    numbers = channels(labels, count, "eye,x=1,y=0")  # the cure that the message names
    assert numbers == (1, 0)


@pytest.mark.parametrize(
    ("labels", "count", "spec", "taken"),
    [
        ([], 3, "", (0, 1)),
        (["", "", ""], 3, "", (0, 1)),
        (["t", "Gaze_X", "Gaze_Y"], 3, "", (1, 2)),
        (["a", "b", "x"], 3, "eye,x=b,y=x", (1, 2)),
        (["x", "y", "z"], 2, "eye,x=0,y=1", (0, 1)),
    ],
)
def test_labels_that_name_two_channels_are_taken(labels, count, spec, taken):
    assert channels(labels, count, spec) == taken


def head(labels: list[str], count: int, row: list[float], unit: str = "") -> tuple[float, float]:
    """Return where a head looks by a sample of a stream with these labels."""
    from study_app.gaze.lsl import LslHead

    source = LslHead("")
    source._choose_channels(labels, [unit] * len(labels), count)
    return source._place(row)


def turned(axis: str, angle_deg: float, length: float = 1.0) -> list[float]:
    """Return the quaternion w, x, y, z of a turn to the left (y), up (x) or of roll (z)."""
    half = math.radians(angle_deg) / 2
    found = [math.cos(half), 0.0, 0.0, 0.0]
    found["wxyz".index(axis)] = math.sin(half)
    return [length * part for part in found]


@pytest.mark.parametrize(
    ("labels", "row", "right_deg", "down_deg"),
    [
        ([], [30.0, 10.0, 5.0], 30, -10),
        (["Roll", "Pitch", "Yaw"], [5.0, 10.0, 30.0], 30, -10),
        (["yaw", "pitch"], [30.0, 10.0], 30, -10),
        ([], turned("y", 40), -40, 0),
        ([], turned("y", -170, 2.0), 170, 0),
        ([], turned("x", 25), 0, -25),
        ([], turned("z", 25), 0, 0),
        (["qx", "qy", "qz", "qw", "t"], [*turned("x", -25)[1:], turned("x", -25)[0], 9], 0, 25),
        ([], [0.0] * 4, math.nan, math.nan),
    ],
)
def test_a_heads_pose_looks_where_its_angles_or_its_quaternion_say(
    labels, row, right_deg, down_deg
):
    assert head(labels, len(row), row) == pytest.approx((right_deg, down_deg), nan_ok=True)


@pytest.mark.parametrize(
    ("labels", "count", "unit", "said"),
    [
        ([], 2, "", "or 3 or 4 without labels (got 2 channels: without labels)"),
        ([], 6, "", "or 3 or 4 without labels (got 6 channels: without labels)"),
        (["a", "b", "c"], 3, "", "by their labels, or 3 or 4 without labels (got 3 channels: a, b"),
        (["yaw", "pitch"], 3, "", "(got 3 channels: yaw, pitch)"),
        (["yaw", "yaw", "pitch"], 3, "", "(got 3 channels: yaw, yaw, pitch)"),
        (["yaw", "pitch", "roll"], 3, "radians", "must give degrees (its channels say 'radians')"),
    ],
)
def test_a_stream_that_is_no_pose_is_refused_with_a_reason(labels, count, unit, said):
    from protocols.errors import StudyError

    with pytest.raises(StudyError, match=re.escape(said)):
        head(labels, count, [0.0] * count, unit)


def test_a_heads_pose_comes_over_lsl_on_our_clock_and_no_stream_is_one_message():
    pylsl = pytest.importorskip("pylsl", reason="pylsl is not installed (extra lsl)")
    import threading
    import time

    from protocols.errors import StudyError
    from study_app.gaze.lsl import LslHead, open_head

    with pytest.raises(StudyError, match="head: a stream with name 'no-head' must be on the"):
        LslHead("no-head", wait_s=0.2).open()
    outlet = pylsl.StreamOutlet(pylsl.StreamInfo("head-57", "Mocap", 3, 0, "float32", "head-57"))
    stop, far_s = threading.Event(), 1234.5

    def send() -> None:
        while not stop.wait(0.01):
            outlet.push_sample([30.0, 10.0, 0.0])

    def clock() -> float:
        return time.monotonic() + far_s

    sender = threading.Thread(target=send)
    sender.start()
    source = open_head("lsl:head-57", clock)
    try:
        time.sleep(0.1)
        *_, pose = source.poll()
        assert (pose.x_px, pose.y_px) == (30, -10)
        assert abs(clock() - pose.t_s) < 5  # on our clock, however busy the machine is
        assert source.left_out == 0
    finally:
        source.close()
        stop.set()
        sender.join()
