"""Fixation, violation, blink, loss and silence, from planted events and real recordings."""

import math
from pathlib import Path

import numpy as np
import pytest
from gaze_persistence import persistence_s

from protocols.display import Viewing
from protocols.errors import StudyError
from protocols.load import load_display
from protocols.study_file.session_schema import Gaze
from study_app.gaze.fixation import FixationMonitor
from study_app.gaze.open_source import ReplaySource, recorded
from study_app.gaze.recording import load_recording
from study_app.gaze.simulated import HUMAN, GazeBehaviour, GazeEvent, SimulatedGaze
from study_app.gaze.source import GazeSample
from study_app.trial import GazeVerdict
from study_app.virtual import VirtualClock

RULES = Gaze(mode="enforce")
VIEWING = Viewing.of(load_display("fhd27-60hz"))
RATES_HZ = [60.0, 250.0, 500.0, 1000.0]
LATE_S = 1e-6  # rounding of stamps


class Watching:
    """A simulated eye under the rules, looked at once per frame of a 60 Hz display."""

    def __init__(self, rate_hz, events=(), seed=0, frame_hz=60.0, behaviour=None):
        self.clock = VirtualClock()
        self.gaze = SimulatedGaze(
            self.clock, VIEWING, (0.0, 0.0), rate_hz=rate_hz,
            behaviour=behaviour or GazeBehaviour(),
        )  # fmt: skip
        self.gaze.restart(seed, None if behaviour else events)
        self.monitor = FixationMonitor(RULES, VIEWING, (0.0, 0.0), rate_hz)
        self.frame_s = 1 / frame_hz

    def until(self, end_s, planned_s=7.0):
        """Return (time, verdict) of every frame from 0.5 s on, when watching begins."""
        verdicts, watching = [], False
        for frame in range(math.ceil(end_s / self.frame_s)):
            self.clock.move_to(frame * self.frame_s)
            self.monitor.feed(self.gaze.poll())
            if not watching and self.clock() >= 0.5:
                self.monitor.watch(self.clock(), planned_s)
                watching = True
            if watching:
                verdicts.append((self.clock(), self.monitor.verdict(self.clock())))
        return verdicts


def first(verdicts, verdict):
    return next((t_s for t_s, seen in verdicts if seen is verdict), None)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("seed", range(12))
def test_a_look_away_is_decided_within_a_frame_and_a_sample_after_the_rule(rate_hz, seed):
    at_s = 1.0 + np.random.default_rng(seed).uniform(0, 1)
    watching = Watching(rate_hz, [GazeEvent("away", at_s)], seed)
    decided_s = first(watching.until(4.0), GazeVerdict.VIOLATION)

    rule_s = persistence_s(RULES, rate_hz)
    assert decided_s is not None
    assert at_s + rule_s <= decided_s + LATE_S
    assert decided_s <= at_s + rule_s + 1 / 60 + 1 / rate_hz + LATE_S


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("seed", range(6))
def test_blinks_up_to_the_limit_never_void(rate_hz, seed):
    """A blink of 30 to 150 ms every second, with the lid's drag before and after."""
    chance = np.random.default_rng(seed)
    blinks = [GazeEvent("blink", 0.8 + k, chance.uniform(0.03, 0.149)) for k in range(7)]
    watching = Watching(rate_hz, blinks, seed)

    verdicts = {seen for _, seen in watching.until(8.0)}
    quality = watching.monitor.quality(watching.clock())

    assert verdicts <= {GazeVerdict.HELD, GazeVerdict.AWAY}
    assert quality.violations == 0
    # The shortest may fall between two samples of a slow tracker.
    assert 7 - (rate_hz < 100) * 3 <= quality.blinks <= 7


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("seed", range(6))
def test_a_loss_longer_than_a_blink_is_decided_within_a_frame_and_a_sample(rate_hz, seed):
    at_s = 1.0 + np.random.default_rng(seed).uniform(0, 1)
    watching = Watching(rate_hz, [GazeEvent("loss", at_s, 1.0)], seed)
    decided_s = first(watching.until(4.0), GazeVerdict.LOSS)

    # Losing is sure with the first lost sample more than blink_s after the first.
    rule_s = (math.floor(RULES.blink_s * rate_hz + 1e-9) + 1) / rate_hz
    assert decided_s is not None
    assert at_s + RULES.blink_s < decided_s + LATE_S
    assert decided_s <= at_s + rule_s + 1 / 60 + 1 / rate_hz + LATE_S


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("seed", range(6))
def test_a_dead_tracker_is_loss_and_never_fixation(rate_hz, seed):
    at_s = 1.0 + np.random.default_rng(seed).uniform(0, 1)
    verdicts = Watching(rate_hz, [GazeEvent("death", at_s)], seed).until(4.0)
    decided_s = first(verdicts, GazeVerdict.LOSS)

    assert decided_s is not None
    # Silence counts from the last sample, which is up to one sample older than the death.
    assert at_s + RULES.silence_s - 1 / rate_hz <= decided_s + LATE_S
    assert decided_s <= at_s + RULES.silence_s + 1 / 60 + LATE_S
    assert all(seen is GazeVerdict.LOSS for t_s, seen in verdicts if t_s >= decided_s)


def test_a_dead_tracker_does_not_hold_the_gate():
    watching = Watching(250.0, [GazeEvent("death", 0.2)])
    watching.clock.move_to(0.29)
    watching.monitor.feed(watching.gaze.poll())
    assert watching.monitor.verdict(0.29) is GazeVerdict.HELD
    assert watching.monitor.verdict(0.31) is GazeVerdict.AWAY


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_short_losses_add_up_to_loss(rate_hz):
    """100 ms lost in every 200 ms: each is a blink, together they pass 20 % of 7 s at 2.8 s."""
    losses = [GazeEvent("loss", 0.5 + 0.2 * k, 0.1) for k in range(40)]
    decided_s = first(Watching(rate_hz, losses).until(8.0), GazeVerdict.LOSS)

    # 14 losses are needed; each may catch one sample more than its 100 ms.
    assert decided_s == pytest.approx(0.5 + 2.8, abs=0.15 + 14 / rate_hz)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_a_steady_eye_is_never_void(rate_hz):
    watching = Watching(rate_hz, seed=3)

    assert {seen for _, seen in watching.until(8.0)} == {GazeVerdict.HELD}
    quality = watching.monitor.quality(watching.clock())
    assert quality.lost_share == 0.0
    assert quality.mean_deg is not None
    assert quality.mean_deg < 0.4


def test_jumps_of_one_sample_are_noise_not_violation():
    monitor = FixationMonitor(RULES, VIEWING, (0.0, 0.0), 1000.0)
    monitor.watch(0.0, 7.0)
    for k in range(1000):
        x_px = 1400.0 if k % 10 == 0 else 960.0
        monitor.feed([GazeSample(k / 1000, k, x_px, 540.0)])
        assert monitor.verdict(k / 1000) in (GazeVerdict.HELD, GazeVerdict.AWAY)


def test_the_window_is_an_angle_off_the_centre_too():
    """A dot 15 deg to the right: 1.4 deg away is inside, 1.6 deg is outside, on each side."""
    monitor = FixationMonitor(RULES, VIEWING, (15.0, 0.0), 250.0)
    for offset, inside in ((-1.4, True), (1.4, True), (-1.6, False), (1.6, False)):
        monitor.feed([GazeSample(0.0, 0.0, *VIEWING.to_px(15.0 + offset, 0.0))])
        assert (monitor.verdict(0.0) is GazeVerdict.HELD) == inside


def test_the_simulated_tracker_describes_and_calibrates_itself():
    watching = Watching(500.0)
    watching.gaze.open()
    result = watching.gaze.calibrate([(960.0, 540.0), (100.0, 100.0)])

    assert watching.gaze.info().source == "simulated"
    assert watching.gaze.info().rate_hz == 500.0
    assert result.points == 2
    assert 0 < result.precision_deg < result.accuracy_deg < 1.0
    watching.gaze.mark("start")
    watching.gaze.close()


def test_gaze_of_a_seed_is_the_same_however_often_it_is_polled():
    def samples(steps):
        watching = Watching(250.0, seed=5, behaviour=HUMAN)
        taken = []
        for t_s in np.linspace(0, 6, steps):
            watching.clock.move_to(float(t_s))
            taken += watching.gaze.poll()
        return [tuple(sample) for sample in taken]

    often, seldom = samples(500), samples(7)

    np.testing.assert_array_equal(np.array(often), np.array(seldom))
    assert len(often) == 6 * 250 + 1


RECORDINGS = [
    ("eyelink_mono250.asc.gz", 250, (1024, 768), 0),
    ("eyelink_mono500.asc.gz", 500, (1024, 768), 0),
    ("eyelink_mono1000.asc.gz", 1000, (1024, 768), 0),
    ("eyelink_bino500.asc.gz", 500, (1024, 768), 0),
    ("eyelink_monoRemote500.asc.gz", 500, (1024, 768), 3),
    ("eyeris_memory_1000hz.asc.gz", 1000, (1920, 1080), 1),
]


@pytest.mark.parametrize(("name", "rate_hz", "screen", "blinks"), RECORDINGS)
def test_a_real_eyelink_recording_is_read_whole(shared_data, name, rate_hz, screen, blinks):
    recording = load_recording(shared_data / "gaze" / name)

    assert recording.rate_hz == rate_hz
    assert recording.screen_px == screen
    assert len(recording.blinks_s) == blinks
    assert (np.diff(recording.t_s) >= 0).all()
    if name.startswith("eyelink_monoRemote"):
        assert len(recording.t_s) == 41_582  # as counted when the file was taken over
    seen = np.isfinite(recording.x_px)
    assert seen.mean() > 0.9
    for start_s, end_s in recording.blinks_s:
        middle = (recording.t_s > start_s) & (recording.t_s < end_s)
        assert not np.isfinite(recording.x_px[middle]).any()


@pytest.mark.parametrize("name", ["eyelink_monoRemote500.asc.gz", "eyeris_memory_1000hz.asc.gz"])
def test_real_blinks_are_pardoned(shared_data, name):
    """Watched around each blink, with the dot where gaze rests, no real blink voids."""
    recording = load_recording(shared_data / "gaze" / name)
    width, height = recording.screen_px
    viewing = Viewing(width, height, 400 / width, 300 / height, 600.0)
    for start_s, end_s in recording.blinks_s:
        before = (recording.t_s > start_s - 0.3) & (recording.t_s < start_s - 0.05)
        dot = viewing.to_deg(
            float(np.nanmedian(recording.x_px[before])), float(np.nanmedian(recording.y_px[before]))
        )
        clock = VirtualClock()
        source = ReplaySource(recording, clock)
        source.open()
        monitor = FixationMonitor(
            RULES.model_copy(update={"window_deg": 3.0}), viewing, dot, recording.rate_hz
        )
        clock.move_to(start_s - 0.1)
        monitor.feed(source.poll()[-1:])
        monitor.watch(clock(), 7.0)
        seen = set()
        while clock() < end_s + 0.04:
            clock.move_to(clock() + 1 / 60)
            monitor.feed(source.poll())
            seen.add(monitor.verdict(clock()))
        assert GazeVerdict.LOSS not in seen
        assert monitor.quality(clock()).blinks >= 1


def oracle(recording, dot_px, viewing, rules, start_s, end_s):
    """Time of violation or loss by the rules, computed over whole arrays, without any state."""
    inside = (recording.t_s >= start_s) & (recording.t_s <= end_s)
    t_s, x, y = recording.t_s[inside], recording.x_px[inside], recording.y_px[inside]
    sights = np.stack(
        [(x - viewing.width_px / 2) * viewing.pitch_x_mm,
         (y - viewing.height_px / 2) * viewing.pitch_y_mm,
         np.full_like(x, viewing.distance_mm)]
    )  # fmt: skip
    dot = np.array(viewing.sight(*dot_px))
    cosine = (sights * dot[:, None]).sum(0) / np.linalg.norm(sights, axis=0) / np.linalg.norm(dot)
    lost = ~np.isfinite(x)
    outside = ~lost & (np.degrees(np.arccos(np.clip(cosine, -1, 1))) > rules.window_deg)
    ends = np.flatnonzero(lost[:-1] & ~lost[1:]) + 1
    for end in ends:
        outside &= ~((t_s >= t_s[end]) & (t_s <= t_s[end] + rules.blink_margin_s + 1e-9))

    def first_run(mask, least_s, least_samples, strict):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            for i in range(begin, end):
                ran_s = t_s[i] - t_s[begin]
                enough = ran_s > least_s + 1e-9 if strict else ran_s >= least_s - 1e-9
                if enough and i - begin + 1 >= least_samples:
                    return t_s[i]
        return math.inf

    violation = first_run(outside, rules.violation_s, rules.violation_samples, strict=False)
    loss = first_run(lost, rules.blink_s, 1, strict=True)
    gaps = np.flatnonzero(np.diff([*t_s, end_s]) > rules.silence_s)
    silence = t_s[gaps[0]] + rules.silence_s if len(gaps) else math.inf
    return violation, min(loss, silence)


@pytest.mark.parametrize("name", [entry[0] for entry in RECORDINGS])
def test_real_gaze_is_judged_as_an_independent_computation_judges_it(shared_data, name):
    """Twenty stretches of 2 s of each recording, the dot where gaze was at their start."""
    recording = load_recording(shared_data / "gaze" / name)
    width, height = recording.screen_px
    viewing = Viewing(width, height, 400 / width, 300 / height, 600.0)
    decided = 0
    for start_s in np.linspace(0.3, recording.t_s[-1] - 2.5, 20):
        before = (recording.t_s > start_s - 0.1) & (recording.t_s < start_s)
        place = np.nanmedian(
            np.stack([recording.x_px[before], recording.y_px[before]]), axis=1
        ) if np.isfinite(recording.x_px[before]).any() else None  # fmt: skip
        if place is None:
            continue
        dot_px = (float(place[0]), float(place[1]))
        clock = VirtualClock()
        source = ReplaySource(recording, clock)
        source.open()
        monitor = FixationMonitor(RULES, viewing, viewing.to_deg(*dot_px), recording.rate_hz)
        clock.move_to(start_s)
        if recording.t_s[recording.t_s <= start_s][-1] < start_s - 0.05:
            continue  # between two trials of the recording
        monitor.feed(source.poll()[-1:])
        monitor.watch(start_s, 1000.0)  # so that the share of loss plays no part
        judged_s, verdict = math.inf, None
        while clock() < start_s + 2.0:
            clock.move_to(clock() + 1 / 60)
            monitor.feed(source.poll())
            verdict = monitor.verdict(clock())
            if verdict in (GazeVerdict.VIOLATION, GazeVerdict.LOSS):
                judged_s = clock()
                break
        violation_s, loss_s = oracle(
            recording, dot_px, viewing, RULES, recording.t_s[recording.t_s <= start_s][-1],
            start_s + 2.0,
        )  # fmt: skip
        due_s = min(violation_s, loss_s)
        if due_s > start_s + 2.0 - 1 / 60:
            assert judged_s >= due_s - 1 / 60
            continue
        decided += 1
        assert due_s - 1e-6 <= judged_s <= due_s + 1 / 60 + 1 / recording.rate_hz + 1e-6
        if abs(violation_s - loss_s) > 1 / 60:
            assert verdict is (GazeVerdict.VIOLATION if violation_s < loss_s else GazeVerdict.LOSS)
    assert decided >= 1


def test_replay_gives_every_sample_once_with_raw_stamps(shared_data):
    recording = load_recording(shared_data / "gaze" / "eyelink_mono250.asc.gz")
    clock = VirtualClock(100.0)
    source = ReplaySource(recording, clock)
    source.open()
    samples = list(source.poll())
    while clock() < 100.0 + recording.t_s[-1]:
        clock.move_to(clock() + 1 / 60)
        samples += source.poll()

    assert [sample.raw_t for sample in samples] == list(recording.raw_t)
    assert samples[0].t_s == 100.0
    assert not source.poll()


def test_gaze_written_by_a_session_is_read_back(tmp_path):
    path = tmp_path / "gaze.csv"
    path.write_text("t_s,raw_t,x_px,y_px\n1.000,0,960.00,540.00\n1.004,1,,\n1.008,2,961.0,541.0\n")
    recording = load_recording(path)

    assert recording.rate_hz == pytest.approx(250)
    assert np.isnan(recording.x_px[1])


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", b"time,x,y\n1,2,3\n", "must have columns t_s .or t_ms, .*, x_px and y_px"),
        ("a.csv", b"t_s,x_px,y_px\n1,a,3\n", "line 2: must hold numbers"),
        ("a.csv", b"t_s,x_px,y_px\n", "at least two samples .got 0."),
        ("a.csv", b"t_s,x_px,y_px\n2,1,1\n1,1,1\n", "line 3: t_s must not fall .* .got 1 after 2."),
        ("a.csv", b"t_s,x_px,y_px\n1,1,1\nnan,1,1\n", "line 3: t_s must be a finite number"),
        ("a.csv", b"t_s,x_px,y_px\n1,1,1\n1,1,1\n", "samples at different times"),
        ("a.asc", b"MSG 1 DISPLAY_COORDS 0 0 1023 767\n", "samples between START and END"),
        ("a.asc.gz", b"no gzip", "must be a whole gzip file"),
        ("a.edf", b"", "must be an EyeLink .asc or a .csv"),
    ],
)
def test_a_recording_that_is_none_is_told(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(StudyError, match=message):
        load_recording(tmp_path / name)
    with pytest.raises(StudyError, match="no such file"):
        load_recording(Path(tmp_path / "none.csv"))


@pytest.mark.parametrize(
    ("said", "step", "right"),
    [("t_s", 2, "t_ms"), ("t_s", 2000, "t_us"), ("t_s", 2_000_000, "t_ns"), ("t_ms", 0.002, "t_s"),
     ("t_s", 16.667, "t_ms"), ("t_s", 0.5, "t_ms"), ("t_ms", 1000, "t_us")],
)  # fmt: skip
def test_stamps_in_another_unit_are_refused_and_the_named_column_reads_them(
    tmp_path, said, step, right
):
    def write(unit):
        path = tmp_path / f"{unit}.csv"
        rows = [f"{k * step:.9g},{100 + k},50" for k in range(50)]
        path.write_text("\n".join([f"{unit},x_px,y_px", *rows]) + "\n")
        return path

    with pytest.raises(StudyError, match=f"{said} must give a tracker's rate.*{right} ") as told:
        load_recording(write(said))
    assert "Hz" in str(told.value)
    assert 3 <= load_recording(write(right)).rate_hz <= 20_000


@pytest.mark.parametrize("lost", [0, -1, 1e8, -9999, 65535])
@pytest.mark.parametrize("kind", ["csv", "asc"])
def test_a_number_for_a_lost_eye_is_asked_about_and_the_answer_works(tmp_path, lost, kind):
    rows = [(4 * k, 300 + k, 200) if k % 10 else (4 * k, lost, lost) for k in range(200)]
    path = tmp_path / f"g.{kind}"
    if kind == "csv":
        lines = ["t_ms,x_px,y_px", *(f"{t},{x:g},{y:g}" for t, x, y in rows)]
    else:
        lines = ["SAMPLES GAZE LEFT RATE 250", *(f"{t} {x:.0f} {y:.0f} 900" for t, x, y in rows)]
    path.write_text("\n".join([*lines, "END"][: len(lines) + (kind == "asc")]) + "\n")
    with pytest.raises(StudyError, match=r"known or said to be unknown \(20 samples hold") as told:
        recorded(str(path))
    cure = str(told.value).partition("replay:")[2].partition(";")[0]
    assert int(np.isnan(recorded(cure).x_px).sum()) == 20
    if abs(lost) < 1e6:
        assert not np.isnan(recorded(f"{path},unknown=none").x_px).any()
    with pytest.raises(StudyError, match=r"a number as the file stores it, or none"):
        recorded(f"{path},unknown=many")


def test_gaze_that_rests_or_crosses_the_corner_is_not_asked_about(tmp_path):
    path = tmp_path / "g.csv"
    for x, y in ((200, lambda _: 200), (0, lambda k: k), (-100, lambda k: k - 100)):
        rows = [f"{4 * k},{y(k) if x < 0 else x},{y(k)}" for k in range(200)]
        path.write_text("\n".join(["t_ms,x_px,y_px", *rows]) + "\n")
        assert not np.isnan(recorded(str(path)).x_px).any()
