"""Sample to flip, counted on a virtual clock from streams whose delays are known."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from virtual_screen import VirtualScreen

from study_app.cli.pictures.live import _Showing
from study_app.gaze.lsl import LslGaze, LslSpec
from study_app.gaze.source import GazeSample
from study_app.gaze.trusted import AHEAD_S, TrustedGaze
from study_app.live.loop import SILENT_S, SPARE_SHARE, Latency, LiveLoop, measure_latency
from study_app.live.renderer import LiveView
from study_app.virtual import VirtualClock

HZ, COST_S, SECONDS = 60.0, 0.004, 4.0
FAR_S = 1234.5
"""Lead of the tracker's clock over ours."""


class Still:
    """A renderer of nothing."""

    hold = prepare = draw = lambda *_: None

    def follow(self, eye_px, elapsed_s):  # noqa: ARG002
        return eye_px, eye_px


class Inlet:
    """A stream that gives each sample once it has arrived on the virtual clock."""

    def __init__(self, clock, stamps_s, arrivals_s):
        order = np.argsort(arrivals_s, kind="stable")
        self._clock, self._next = clock, 0
        self.stamps, self.arrivals = np.array(stamps_s)[order], np.array(arrivals_s)[order]

    def pull_chunk(self, **_):
        until = int(np.searchsorted(self.arrivals, self._clock(), side="right"))
        stamps = [float(stamp) + FAR_S for stamp in self.stamps[self._next : until]]
        self._next = until
        return [[100.0 + stamp - FAR_S, 50.0] for stamp in stamps], stamps


def test_the_programs_own_share_is_a_frames_cost_what_is_spared_and_at_most_a_sample():
    """By hand: 4 ms of cost and .15 of 16.7 ms before each flip; a sample is up to 1 ms old."""
    clock = VirtualClock()
    found = measure_latency(VirtualScreen(clock, HZ, COST_S), Still(), frames=120)

    assert (found.frames, found.lost, found.silent, found.ahead) == (120, 0, 0, 0)
    assert 6.4 <= found.median_ms <= found.max_ms <= 7.6


def shown(stamps_s, arrivals_s, seconds=SECONDS):
    """Show frames to an LSL stream; return the flips, and what was counted."""
    clock = VirtualClock()
    source = LslGaze(LslSpec(), SimpleNamespace(width_px=640, height_px=480), clock)
    source._inlet, source._offset_s = Inlet(clock, stamps_s, arrivals_s), -FAR_S
    source._pylsl = SimpleNamespace(util=SimpleNamespace(LostError=OSError))
    loop = LiveLoop(
        VirtualScreen(clock, HZ, COST_S), TrustedGaze(source, clock), (0, 0), polled=False
    )
    flips = []
    while clock() < seconds:
        flips.append(loop.step(Still(), LiveView(), 0)[0])
    return flips, loop.latency.summary()


def stream(rate_hz, rng):
    """Stamps of a stream, and when each arrives: 3 to 9 ms later."""
    stamps = np.arange(0, SECONDS, 1 / rate_hz)
    return stamps, stamps + rng.uniform(0.003, 0.009, len(stamps))


def true_age(flip, stamps, arrivals):
    """Age at a flip of the newest sample that had arrived when gaze was asked for."""
    there = np.asarray(stamps)[np.asarray(arrivals) <= flip.poll_s]
    return flip.t_s - there.max() if len(there) else math.nan


@pytest.mark.parametrize("rate_hz", [60, 250, 1000])
@pytest.mark.parametrize(
    "fault", ["none", "gap", "late burst", "duplicates", "jump back", "jump ahead"]
)
def test_latency_is_that_of_the_newest_sample_that_had_arrived(rate_hz, fault, rng):
    stamps, arrivals = stream(rate_hz, rng)
    odd = (stamps > 1.0) & (stamps < 1.4)
    match fault:
        case "gap":
            stamps, arrivals = stamps[~odd], arrivals[~odd]
        case "late burst":
            arrivals = np.where(odd, np.maximum(arrivals, 1.4), arrivals)
        case "duplicates":
            stamps, arrivals = np.repeat(stamps, 3), np.repeat(arrivals, 3)
        case "jump back":  # sent once more, much later, with the stamps that they had
            stamps = np.concatenate([stamps, stamps[odd]])
            arrivals = np.concatenate([arrivals, arrivals[odd] + 0.7])

        case "jump ahead":  # cannot be: left out
            flips, counted = shown(np.where(odd, stamps + 0.5, stamps), arrivals)
            stamps, arrivals = stamps[~odd], arrivals[~odd]
    if fault != "jump ahead":
        flips, counted = shown(stamps, arrivals)

    ages, silent = [], 0
    for flip in flips:
        age = true_age(flip, stamps, arrivals)
        if math.isnan(age):
            assert flip.eye == "none"
            continue
        # The place says which sample is shown: x is its stamp.
        assert flip.age_s == pytest.approx(age, abs=1e-3)
        assert flip.gaze_state.gaze_px[0] - 100 == pytest.approx(flip.t_s - age, abs=1 / 16)
        old = flip.poll_s - (flip.t_s - age) > SILENT_S
        assert flip.eye == ("silent" if old else "found")
        silent += old
        if not old:
            ages.append(age)
    assert (counted.frames, counted.silent) == (len(ages), silent)
    assert (silent > 10) == (fault in ("gap", "late burst", "jump ahead"))
    assert counted.median_ms == pytest.approx(1e3 * np.median(ages), abs=1)
    assert counted.p95_ms == pytest.approx(1e3 * np.quantile(ages, 0.95), abs=1)
    assert counted.max_ms == pytest.approx(1e3 * max(ages), abs=1)


@pytest.mark.parametrize("rate_hz", [60, 250, 1000])
def test_gaze_is_asked_for_as_late_as_the_frames_cost_allows(rate_hz):
    stamps = np.arange(0, 1.0, 1 / rate_hz)

    flips, counted = shown(stamps, stamps, seconds=0.9)

    assert {flip.refreshes for flip in flips[1:]} == {1}
    due_s = COST_S + SPARE_SHARE / HZ
    assert flips[-1].t_s - flips[-1].poll_s == pytest.approx(due_s, abs=1e-4)
    assert counted.max_ms / 1e3 <= 1 / HZ + 1 / rate_hz + 1e-3  # one frame and one sample


def test_a_sample_from_the_future_is_counted_apart_and_has_no_latency():
    stamps = np.arange(0, SECONDS, 0.004)
    flips, counted = shown(stamps + AHEAD_S / 2, stamps)

    assert {flip.eye for flip in flips[1:]} == {"ahead"}
    assert counted.frames == 0
    assert counted.ahead == len(flips)
    assert "no frame showed a gaze that was found" in counted.words()


def test_while_the_eye_is_lost_the_last_gaze_is_held_and_none_is_counted_as_fresh():
    clock = VirtualClock()
    lost = math.nan

    class Blink:
        def poll(self):
            t_s = clock()
            x = lost if 0.2 < t_s < 0.4 else 50.0
            return [GazeSample(t_s, t_s, x, x)]

    loop = LiveLoop(VirtualScreen(clock, HZ, COST_S), Blink(), (0, 0), polled=True)
    flips = []
    while clock() < 0.6:
        flips.append(loop.step(Still(), LiveView(), 0)[0])
    held = [flip for flip in flips if flip.eye == "lost"]

    assert len(held) == 12
    assert all(math.isnan(flip.gaze_state.gaze_px[0]) for flip in held)  # the renderer holds
    assert held[-1].age_s == pytest.approx(0.2, abs=0.02)
    assert loop.latency.summary().frames == len(flips) - 12


def test_a_million_frames_take_no_more_memory_than_one():
    counted = Latency()
    counted.add("found", 0.02)
    size = len(counted._bins)
    for k in range(2000):
        counted.add("found", 0.001 * (k % 40))
    counted.add("found", 9.0)  # beyond all bins

    assert len(counted._bins) == size
    assert counted.summary().max_ms == 9000.0
    assert counted.summary().median_ms == pytest.approx(20, abs=1)


def test_dragging_turns_a_panorama_with_the_mouse_and_letting_go_stops_it():
    showing = _Showing.__new__(_Showing)
    mouse = SimpleNamespace(at=(50.0, 50.0), down=False)
    showing._window = SimpleNamespace(cursor_px=lambda: mouse.at, held_down=lambda: mouse.down)
    showing._renderer = SimpleNamespace(
        source=SimpleNamespace(panorama=True), geometry=SimpleNamespace(distance_px=100.0)
    )
    showing._turned, showing._dragged = (0.0, 0.0), None
    showing._head = showing._faced = showing._pose = None

    def turned(at, down):
        mouse.at, mouse.down = at, down
        view = showing._view(None)
        return view.right_deg, view.down_deg

    assert turned((90.0, 50.0), False) == (0.0, 0.0)
    assert turned((50.0, 50.0), True) == (0.0, 0.0)  # where it is taken
    right, down = turned((60.0, 45.0), True)  # 10 px to the right: the view turns to the left
    assert (right, down) == pytest.approx((-math.degrees(0.1), math.degrees(0.05)), abs=1 / 64)
    assert (64 * right, 64 * down) == (round(64 * right), round(64 * down))
    assert turned((200.0, 200.0), False) == (right, down)
    assert turned((0.0, 0.0), True) == (right, down)
    assert turned((0.0, -900.0), True)[1] == 90.0


def test_the_head_turns_a_panorama_from_its_first_pose_on_and_holds_while_none_comes():
    showing = _Showing.__new__(_Showing)
    poses = []
    showing._window = SimpleNamespace(cursor_px=lambda: (0.0, 0.0), held_down=lambda: False)
    showing._renderer = SimpleNamespace(source=SimpleNamespace(panorama=True))
    showing._turned, showing._dragged = (170.0, 0.0), None
    showing._head = SimpleNamespace(poll=lambda: [GazeSample(0, 0, *one) for one in poses])
    showing._faced = showing._pose = None

    def turned(*new):
        poses[:] = new
        view = showing._view(None)
        return view.right_deg, view.down_deg

    assert turned() == (170, 0)
    assert turned((100.0, 20.0)) == (170, 0)
    assert turned((90.0, 20.0), (120.0, 30.0)) == (-170, 10)
    assert turned() == (-170, 10)
    assert turned((math.nan, math.nan)) == (-170, 10)
    assert turned((100.0, 300.0)) == (170, 90)
