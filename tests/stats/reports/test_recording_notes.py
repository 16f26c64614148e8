"""A report says what is weak about how its sessions were recorded."""

import pandas as pd
import pytest
from command_line import metamerlab
from undrawn_reports import undrawn

from analysis.report.report_source import recording_notes, recording_sentence


def sessions(*rows: tuple[str, int, str, int]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=["session", "simulated", "timing_evidence", "dropped"])


def test_sound_sessions_get_no_note():
    assert recording_notes(sessions(("A", 0, "glXGetSyncValuesOML", 0), ("B", 0, "fence", 0))) == ()


@pytest.mark.parametrize(
    ("row", "said"),
    [
        (("B", 0, "software timer", 0), "In 1 session (B) a timer stood in for the display's"),
        (("B", 0, "unverified", 0), "In 1 session (B) the driver did not vouch for the flips"),
        (("B", 0, "fence", 3), "(3 in all, at most 3 in one session)"),
        (("B", 1, "virtual", 0), "1 of 2 sessions are simulated"),
    ],
)
def test_each_weakness_is_named_with_its_sessions(row, said):
    (note,) = recording_notes(sessions(("A", 0, "fence", 0), row))
    assert said in note


def test_many_sessions_are_counted_and_few_are_named():
    (note,) = recording_notes(sessions(*((f"P{n}", 0, "fence", 1) for n in range(9))))
    assert "In 9 sessions (P0, P1, P2, P3, P4, ...)" in note
    assert "(9 in all, at most 1 in one session)" in note


def test_the_page_and_the_terminal_say_that_data_are_simulated(sample_sessions, tmp_path):
    words = ["analysis", "report", str(sample_sessions), "--protocol", "demo", "--out",
             str(tmp_path / "report")]  # fmt: skip
    with undrawn():
        done = metamerlab(*words, catch_exceptions=False)
    assert "SIMULATED data. " in done.stdout
    page = (tmp_path / "report/report.html").read_text()
    assert "When not to trust these data" in page
    assert "All sessions are simulated: they show what the analysis does" in page


def test_methods_say_what_was_shown_and_where_gaze_was_of_sessions_that_are_kept():
    columns = ["excluded", "refresh_hz", "timing_evidence", "attempts", "void", "dropped"]
    gaze = ["gaze_mode", "gaze_violations", "gaze_mean_deg", "gaze_lost_share"]
    rows = [
        ("", 120.0, "fence", 30, 6, 1, "enforce", 2, 0.4, 0.01),
        ("", 59.951, "fence", 24, 0, 0, "enforce", 1, 0.6, 0.03),
        ("a rule", 60.0, "unverified", 24, 9, 9, "enforce", 9, 9.0, 0.9),
    ]
    table = pd.DataFrame(rows, columns=columns + gaze)

    assert recording_sentence(table) == (
        "Stimuli were shown at 60, 120 Hz (time stamps: fence). Of 54 attempts at main trials 6"
        " were void. Refreshes missed in trials that count: 1. Gaze was"
        " watched in 2 sessions: it left the place that was asked for 3 times (such attempts are"
        " void), lay 0.50 deg from it on average, and was lost for 2.0 % of the time."
    )
    warned = table.assign(gaze_mode="warn", gaze_mean_deg=[0.4, None, None])
    assert "in 1 session: it left the place that was asked for 2 times, lay 0.40" in (
        recording_sentence(warned)
    )
    assert recording_sentence(table[2:]) == ""
