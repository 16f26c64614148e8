"""check-display, withdraw and watch, as an operator uses them."""

import json
import shutil

import pytest
from command_line import metamerlab

from protocols.disk.hashing import sha256_file


def test_a_display_is_measured_and_the_report_says_how(screen, make_study):
    study = make_study()
    done = screen.run(
        "session", "check-display", study.folder / "little.toml", "--software-pacing",
        "--flips", "60", "--out", study.sessions,
    )  # fmt: skip

    reports = study.sessions / "display-reports"
    (report,) = reports.glob("*.json")
    measured = json.loads(report.read_text())
    assert measured["evidence"] == "software timer"
    assert len(measured["every_interval_s"]) == 59
    assert str(report) in done.stdout
    assert measured["gaze_to_flip"]["frames"] == 240
    assert "sample to flip: median" in done.stdout


def test_a_photometers_readings_are_typed_into_the_display_file():
    words = ["session", "check-display", "my-display.toml", "--luminance"]
    done = metamerlab(*words, status=2)

    said = " ".join(done.stderr.split())
    assert "session check-display --luminance was removed: type peak_cd_m2" in said


def test_a_window_without_opengl_3_3_is_refused_before_anything_is_shown(
    screen, make_study, monkeypatch
):
    study = make_study()
    monkeypatch.setenv("MESA_GL_VERSION_OVERRIDE", "3.1")

    done = screen.run(
        "session", "check-display", study.folder / "little.toml", "--software-pacing", status=2
    )

    assert "a window with OpenGL 3.3 must open" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_header_points_to_the_measurement_of_the_display(screen, make_study):
    study = make_study({"pairings": '[["metameric", "push-pull"]]', "repeats": "1"})
    screen.run(*screen.session("run", study, "--simulate"))

    pointer = study.journal().start.display_report

    assert sha256_file(study.sessions / pointer.file) == pointer.sha256
    shown = screen.run(
        "session", "watch", study.sessions / "demo" / "P01", "--once", status=None
    ).stdout
    assert "1 of 1" in shown
    assert "software timer" in shown


def test_withdraw_asks_deletes_and_frees_the_code_for_nobody(screen, sample_sessions, tmp_path):
    root = tmp_path / "sessions"
    shutil.copytree(sample_sessions, root)

    done = screen.run("session", "withdraw", "S001", "--out", root, "--yes")

    assert "one line stays that says so" in done.stdout
    assert [p.name for p in (root / "demo" / "S001").iterdir()] == ["journal.jsonl"]
    again = screen.run("session", "withdraw", "S001", "--out", root, "--yes", status=2)
    assert "withdrew before" in again.stderr


# Each target stands for half its time: the eye that looks is there at once. Its blinks take less.
QUICK = """
from study_app.gaze import validation
from study_app.cli import main
validation.SETTLE_S, validation.HOLD_S = 0.1, 0.5
main()
"""


@pytest.mark.slow
def test_gaze_is_validated_before_a_block_and_a_window_too_small_is_refused(screen, make_study):
    values = {"pairings": '[["metameric", "push-pull"]]', "repeats": "1", "mode": '"monitor"'}
    study = make_study(values)
    screen.run(*screen.session("run", study, "--simulate"), code=QUICK)
    kinds = [event.kind for event in study.journal().events]
    assert kinds.index("calibration") < kinds.index("block-start")
    (check,) = [event for event in study.journal().events if event.kind == "calibration"]
    assert check.points == 9
    assert 0.02 < check.accuracy_deg < 1.0

    narrow = make_study(values | {"window_deg": "0.05"}, name="narrow")
    done = screen.run(*screen.session("run", narrow, "--simulate"), code=QUICK, status=2)
    assert "window_deg = 0.05 must be at least the mean error and twice the noise" in done.stderr
    last = narrow.journal().events[-1]
    assert (last.kind, last.reason) == ("session-end", "error")
    assert not narrow.journal().attempts
