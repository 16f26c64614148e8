"""The quality of gaze at a target is what ETDQualitizer computes."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from protocols.journal import Calibration, Note, SideFile, event_line
from protocols.viewing import Viewing
from study_app.gaze.source import GazeSample
from study_app.validation import point_quality, summarise

ORACLE = json.loads(Path(__file__).with_name("oracles").joinpath("gaze_quality.json").read_text())
SCREEN = ORACLE["screen"]
VIEWING = Viewing(
    SCREEN["width_px"],
    SCREEN["height_px"],
    SCREEN["width_mm"] / SCREEN["width_px"],
    SCREEN["height_mm"] / SCREEN["height_px"],
    SCREEN["distance_mm"],
)


def samples_of(case) -> list[GazeSample]:
    places = [place or (math.nan, math.nan) for place in case["gaze_px"]]
    return [GazeSample(i / 150, i / 150, *place) for i, place in enumerate(places)]


@pytest.mark.parametrize("case", ORACLE["cases"], ids=lambda case: case["name"])
def test_quality_at_a_target_is_that_of_etdqualitizer(case):
    found = point_quality(VIEWING, tuple(case["target_px"]), samples_of(case))

    for ours, theirs in (
        (found.accuracy_deg, case["accuracy_deg"]),
        (found.precision_deg, case["rms_s2s_deg"]),
        (found.sd_deg, case["std_deg"]),
        (100 * found.lost_share, case["loss_percent"]),
    ):
        if theirs is None:
            assert math.isnan(ours)
        else:
            assert ours == pytest.approx(theirs, abs=1e-8)


def test_a_validation_keeps_the_mean_of_all_four_over_its_targets():
    points = [
        point_quality(VIEWING, tuple(case["target_px"]), samples_of(case))
        for case in ORACLE["cases"]
        if case["rms_s2s_deg"] is not None
    ]
    result = summarise(points)

    for name in ("accuracy_deg", "precision_deg", "sd_deg", "lost_share"):
        mean = sum(getattr(point, name) for point in points) / len(points)
        assert getattr(result, name) == pytest.approx(mean)


def test_lines_without_what_came_later_are_the_bytes_that_they_were():
    stamps = {"n": 3, "t_s": 1.5, "at": "2026-01-31T12:00:00Z"}
    old = Calibration(**stamps, accuracy_deg=0.5, precision_deg=0.1, points=9)
    note = Note(**stamps, text="a remark")
    kept = Note(**stamps, text="a remark", file=SideFile(file="tracker/0001.xml", sha256="0" * 64))

    assert b"sd_deg" not in event_line(old)
    assert b"lost_share" not in event_line(old)
    assert b"file" not in event_line(note)
    assert b"tracker/0001.xml" in event_line(kept)
