"""Saccades found as they happen: in movements that are known, and in recorded gaze."""

import gzip
import math
import re

import numpy as np
import pytest

from study_app.gaze.recording import load_recording
from study_app.gaze.saccades import SUPPRESSED_AFTER_S, SaccadeWatch
from study_app.gaze.source import GazeSample

PX_PER_DEG = 35.0


def moved(rate_hz, jumps, rng, seconds=6.0, noise_px=0.4):
    """Samples of an eye that rests, but for (onset, duration, pixels) along x."""
    t = np.arange(0, seconds, 1 / rate_hz)
    x = 400 + rng.normal(0, noise_px, len(t))
    for onset, duration, px in jumps:
        way = np.clip((t - onset) / duration, 0, 1)
        x = x + px * (3 * way**2 - 2 * way**3)
    y = 300 + rng.normal(0, noise_px, len(t))
    return [GazeSample(*one) for one in zip(t, t, x, y, strict=True)]


def found(samples):
    """All saccades, fed one sample at a time."""
    watch = SaccadeWatch(PX_PER_DEG)
    return [one for sample in samples for one in watch.take([sample])]


@pytest.mark.parametrize("rate_hz", [250, 500, 1000])
def test_saccades_are_found_where_the_eye_moves_and_nowhere_else(rate_hz, rng):
    jumps = [(3.0, 0.04, 200.0), (3.5, 0.06, -300.0), (5.0, 0.03, 100.0)]

    saccades = found(moved(rate_hz, jumps, rng))

    assert len(saccades) == len(jumps)
    for saccade, (onset, duration, _) in zip(saccades, jumps, strict=True):
        assert saccade.over
        assert saccade.onset_s == pytest.approx(onset, abs=0.012)
        assert saccade.offset_s == pytest.approx(onset + duration, abs=0.012)


def test_it_is_known_while_the_eye_still_moves(rng):
    watch, known = SaccadeWatch(PX_PER_DEG), []
    for sample in moved(1000, [(3.0, 0.05, 300.0)], rng):
        watch.take([sample])
        if watch.under_way:
            known.append(sample.t_s)

    assert known[0] == pytest.approx(3.01, abs=0.006)
    assert known[-1] == pytest.approx(3.05, abs=0.006)


def test_slow_movements_and_a_lost_sample_are_none(rng):
    pursuit = [
        sample._replace(x_px=sample.x_px + 10 * PX_PER_DEG * sample.t_s)
        for sample in moved(500, [], rng)
    ]
    assert found(pursuit) == []
    spiked = moved(250, [], rng)
    spiked[900] = spiked[900]._replace(x_px=math.nan, y_px=math.nan)
    assert found(spiked) == []
    # Of a quiet tracker the deviation alone would make a saccade of every drift.
    assert found(moved(500, [(3.0, 0.1, 20.0)], rng, noise_px=0.01)) == []


def test_blinks_gaps_and_duplicates_neither_make_nor_lengthen_a_saccade(rng):
    samples = moved(500, [(3.0, 0.04, 200.0)], rng)
    twice = [one for sample in samples for one in (sample, sample)]
    assert found(twice) == found(samples)
    blink = [s._replace(x_px=math.nan) if 3.05 < s.t_s < 3.2 else s for s in samples]
    watch, again = SaccadeWatch(PX_PER_DEG), []
    for first in range(0, len(blink), 100):  # each burst is handed on by two
        again += watch.take(blink[first : first + 100]) + watch.take(blink[first : first + 100])
    assert len(again) == 1
    assert again == found(blink)
    # The eye comes back elsewhere: nobody saw how.
    jump = moved(500, [(4.1, 0.01, 200.0)], rng)
    assert found([s for s in jump if not 4.09 < s.t_s < 4.15]) == []
    assert found([s._replace(x_px=math.nan) if 4.09 < s.t_s < 4.12 else s for s in jump]) == []
    cut = [s if s.t_s < 3.02 else s._replace(x_px=math.nan) for s in samples if s.t_s < 3.5]
    (saccade,) = found(cut)
    assert saccade.offset_s < 3.02


def test_little_is_seen_from_onset_until_a_while_after_the_end(rng):
    (saccade,) = found(moved(500, [(3.0, 0.04, 200.0)], rng))
    assert not saccade.suppresses(saccade.onset_s - 0.001)
    assert saccade.suppresses(saccade.onset_s)
    assert saccade.suppresses(saccade.offset_s + SUPPRESSED_AFTER_S)
    assert not saccade.suppresses(saccade.offset_s + SUPPRESSED_AFTER_S + 0.001)


@pytest.mark.parametrize("name", ["mono250", "mono500", "mono1000"])
def test_recorded_saccades_are_those_that_the_tracker_found(shared_data, name):
    path = shared_data / "gaze" / f"eyelink_{name}.asc.gz"
    tape = load_recording(path)
    watch = SaccadeWatch(PX_PER_DEG)
    mine = []
    for t_s, raw_t, x, y in zip(tape.t_s, tape.raw_t, tape.x_px, tape.y_px, strict=True):
        mine += watch.take([GazeSample(float(t_s), float(raw_t), float(x), float(y))])
    start = float(tape.raw_t[0]) / 1000 - float(tape.t_s[0])
    text = gzip.decompress(path.read_bytes()).decode(errors="replace")
    theirs = [
        (int(a) / 1000 - start, int(b) / 1000 - start, float(amplitude))
        for a, b, amplitude in re.findall(
            r"^ESACC\s+\w\s+(\d+)\s+(\d+)\s+\d+(?:\s+[\d.-]+){4}\s+([\d.]+)", text, re.M
        )
    ]
    wide = [one for one in theirs if one[2] >= 2 and one[0] > 0.6]
    assert wide
    for onset, offset, _ in wide:
        assert any(s.onset_s < offset and onset < s.offset_s for s in mine), onset
