"""Recorded gaze comes through every adapter unchanged, sample by sample.

The recordings are SR Research's, of the shared data, and one of our own that needs none. Each is
sent by what stands for the tracker, in the tracker's own units.
"""

import gzip
import math
import time
from functools import cache
from itertools import product
from threading import Thread
from typing import NamedTuple

import pytest
from fake_pylink import FakePylink, Sample, Side
from fake_pylsl import EPOCH_S as LSL_EPOCH_S
from fake_pylsl import FakePylsl
from tracker_session import FHD, MIDDLE_PX, Eye, pumped

from study_app.gaze.eyelink import EyelinkGaze
from study_app.gaze.lsl import LslGaze, LslSpec
from study_app.gaze.source import TrackerContext
from study_app.virtual import VirtualClock

ROWS = 400
OUR_OWN = "our own"
RECORDINGS = (
    OUR_OWN, "eyelink_mono250", "eyelink_mono500", "eyelink_mono1000", "eyelink_bino500",
    "eyelink_monoRemote500", "eyeris_memory_1000hz",
)  # fmt: skip
NO_EYE = (math.nan, math.nan, math.nan)


class Row(NamedTuple):
    """One sample of a recording: its stamp, and x, y and pupil of each recorded eye."""

    t_ms: float
    eyes: list[tuple[float, float, float]]


@cache
def of_shared(path) -> list[Row]:
    """Return the part of an ASC file around its first lost sample, else its beginning."""
    wide = 7 if "bino" in path.name else 4
    fields = [
        line.split()[:wide]
        for line in gzip.decompress(path.read_bytes()).decode("latin-1").splitlines()
        if line[:1].isdigit()
    ]
    lost = next((at for at, each in enumerate(fields) if each[1] == "."), 0)
    rows = []
    for each in fields[max(0, lost - ROWS // 2) :][:ROWS]:
        t_ms, *rest = [math.nan if field == "." else float(field) for field in each]
        rows.append(Row(t_ms, [tuple(rest[at : at + 3]) for at in range(0, wide - 1, 3)]))
    return rows


def of_our_own() -> list[Row]:
    """A slow sweep over the screen and beyond it, a blink, and a pause of the recording."""
    rows = []
    for number in range(400):
        t_ms = 5_000_000 + 2 * number + (700 if number >= 250 else 0)
        place = -3.1 + 4.9 * number, 1085.3 - 2.8 * number, 900.0 + number % 30
        rows.append(Row(float(t_ms), [NO_EYE if 90 <= number < 140 else place]))
    return rows


@pytest.fixture
def rows_of(request):
    def read(name: str) -> list[Row]:
        if name == OUR_OWN:
            return of_our_own()
        path = request.getfixturevalue("shared_data") / "gaze" / f"{name}.asc.gz"
        if not path.is_file():
            pytest.skip(f"needs {path.name} of the shared data")
        return of_shared(path)

    return read


class Came(NamedTuple):
    """Samples that came through an adapter."""

    samples: list
    clock_offset_s: float


def polled(adapter, source, count: int) -> list:
    """Return what the adapter gives of the samples that were sent, and no more."""
    samples, until_s = [], time.monotonic() + 20
    while len(samples) < count and time.monotonic() < until_s:
        samples += adapter.poll(source)
        time.sleep(0.001)
    return samples + list(adapter.poll(source))


def desk(clock) -> TrackerContext:
    return TrackerContext(FHD, clock, lambda: MIDDLE_PX, 60.0)


def by_eyelink(rows, _end) -> Came:
    clock = VirtualClock()
    fake = FakePylink(Eye(), clock)
    source = pumped(EyelinkGaze, fake, fake.eye, clock)("", desk(clock), fake)
    source.open()
    source.mark("attempt 1")

    def side(eye):
        lost = fake.MISSING_DATA
        return Side(lost, lost) if math.isnan(eye[0]) else Side(*eye[:2])

    for row in rows:
        sides = [side(eye) for eye in row.eyes]
        fake.queue.append((fake.SAMPLE_TYPE, Sample(row.t_ms, *sides)))
    return Came(polled(EyelinkGaze, source, len(rows)), source._offset_s)


def by_lsl(rows, _end) -> Came:
    clock = VirtualClock()
    fake = FakePylsl(Eye(), clock)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("study_app.gaze.lsl.load_pylsl", lambda: fake)
        source = LslGaze(LslSpec.parse(""), FHD, clock)
        source.open()
    source.poll()
    fake.rows = [(row.t_ms / 1000, list(row.eyes[0])) for row in rows]
    return Came(polled(LslGaze, source, len(rows)), -LSL_EPOCH_S)


def by_lsl_itself(rows, end) -> Came:
    pylsl = pytest.importorskip("pylsl", reason="pylsl is not installed (extra lsl)")
    name = f"recorded-{time.monotonic_ns()}"
    outlet = pylsl.StreamOutlet(pylsl.StreamInfo(name, "Gaze", 3, 0, "double64", name))
    source = LslGaze(LslSpec(name), FHD)
    opener = Thread(target=source.open)
    opener.start()
    while opener.is_alive():  # some samples to open with, of stamps before the recording's
        outlet.push_sample([1.0, 1.0, 1.0], time.monotonic() - 1e9)
        time.sleep(0.005)
    end(source.close)
    outlet.push_chunk([list(row.eyes[0]) for row in rows], [row.t_ms / 1000 for row in rows])
    samples, until_s = [], time.monotonic() + 20
    while len(samples) < len(rows) and time.monotonic() < until_s:
        samples += [sample for sample in source.poll() if sample.raw_t > 0]
        time.sleep(0.001)
    return Came(samples, source._offset_s)


@pytest.fixture
def end():
    ends = []
    yield ends.append
    for each in reversed(ends):
        each()


@pytest.mark.parametrize(
    ("sent", "name"),
    [
        *product((by_eyelink, by_lsl), RECORDINGS),
        (by_lsl_itself, OUR_OWN),
        (by_lsl_itself, "eyelink_monoRemote500"),
    ],
)
def test_every_sample_of_a_recording_comes_through_unchanged(rows_of, end, sent, name):
    rows = rows_of(name)
    came = sent(rows, end)

    assert len(came.samples) == len(rows) > 100
    first_s = came.samples[0].raw_t
    for sample, row in zip(came.samples, rows, strict=True):
        assert sample.raw_t - first_s == pytest.approx((row.t_ms - rows[0].t_ms) / 1000, abs=1e-6)
        assert sample.t_s == pytest.approx(sample.raw_t + came.clock_offset_s, abs=1e-6)
        x_px, y_px, _ = row.eyes[0]
        assert sample.valid == (not math.isnan(x_px))
        if sample.valid:
            assert (sample.x_px, sample.y_px) == pytest.approx((x_px, y_px), rel=1e-12)


def test_of_two_recorded_eyes_the_right_one_comes_through_where_it_is_asked_for(rows_of):
    rows = rows_of("eyelink_bino500")
    clock = VirtualClock()
    fake = FakePylink(Eye(), clock)
    source = pumped(EyelinkGaze, fake, fake.eye, clock)("100.1.1.1,eye=right", desk(clock), fake)
    source.open()
    for row in rows:
        fake.queue.append((fake.SAMPLE_TYPE, Sample(row.t_ms, *(Side(*e[:2]) for e in row.eyes))))
    samples = polled(EyelinkGaze, source, len(rows))

    assert [sample[2:] for sample in samples] == [row.eyes[1][:2] for row in rows]
