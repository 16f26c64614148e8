"""The quality of gaze at a target is what ETDQualitizer computes."""

import json
import math
from pathlib import Path

import pytest

from protocols.display import Viewing
from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.journal import Calibration, Note, SideFile, event_line
from protocols.load import load_display, load_protocol
from study_app.gaze.gaze_check import GazeCheck, Targets
from study_app.gaze.source import GazeSample
from study_app.gaze.trusted import TrustedGaze
from study_app.gaze.validation import PointQuality, point_quality, summarise_targets
from study_app.recorder import Recorder
from study_app.session_setup import SessionSetup
from study_app.stage import PageResult

ORACLE = json.loads((Path(__file__).parents[1] / "oracles" / "gaze_quality.json").read_text())
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
    result = summarise_targets(points)

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


def setup_of(study):
    display = load_display("fhd27-60hz")
    return SessionSetup(study, display, virtual_manifest(study, display), Path(), "P01")


class Asking:
    """A tracker whose calibration shows one target."""

    def __init__(self, show) -> None:
        self.show, self.calibrated = show, 0

    def open(self):
        pass

    def info(self):
        pass

    def poll(self):
        return []

    def mark(self, text):
        pass

    def calibrate(self, points_px):
        self.calibrated += 1
        self.show(points_px[0], 0.0, lambda: None, lambda _: None)

    def check_drift(self, point_px):
        self.show(point_px, 0.0, lambda: None, lambda _: None)

    def raw(self, *, over):
        pass

    def news(self):
        return []

    def close(self):
        pass


def test_a_quit_key_during_the_trackers_own_routine_stops_the_block_and_asks_anew_later():
    targets, going = Targets(lambda *_: going[0]), [False]
    tracker = Asking(targets)
    check = GazeCheck(tracker, setup_of(load_protocol(Path("demo"))), None, None, targets)

    assert not check._calibrate()
    going[0] = True
    assert check._calibrate()
    assert tracker.calibrated == 2
    check._fit = True  # validated: from here on only drift is checked
    assert check._calibrate()
    going[0] = False
    assert not check._calibrate()
    assert tracker.calibrated == 2


def test_calibration_is_offered_again_where_the_eye_is_not_seen():
    study, told, pages = load_protocol(Path("demo")), [], []
    unseen = PointQuality(960.0, 540.0, 0, math.nan, math.nan)
    seen = PointQuality(960.0, 540.0, 50, 0.2, 0.05)

    class Told:
        def stamps(self):
            return {"n": 1, "t_s": 0.0, "at": "2026-01-01T00:00:00Z"}

        def append(self, event):
            told.append(event)

        note = Recorder.note

    class Asked:
        def page(self, page):
            pages.append(page)
            return PageResult(study.response.continue_keys[0], "", 0.0)

    tries = [unseen, seen]
    check = GazeCheck(None, setup_of(study), Asked(), Told(), Targets())
    check._validate = lambda: summarise_targets([tries.pop(0)])
    assert check.passed(0)
    assert [event.kind for event in told] == ["note", "calibration"]
    assert "the eye must be seen at every target (not at (960, 540) px)" in pages[0].text
    tries[:] = [unseen] * 3
    with pytest.raises(StudyError, match="seat the participant in the tracker's view"):
        check.passed(1)
    assert not tries


def test_a_source_of_six_methods_needs_no_more():
    """As plug-ins of older versions have them."""

    class Old:
        open = info = poll = mark = calibrate = close = lambda *_: None

    source = TrustedGaze(Old(), lambda: 0.0)

    assert source.check_drift((0.0, 0.0)) is None
    assert source.raw(over=True) is None
    assert source.news() == []
