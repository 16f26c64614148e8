"""A report says what is weak about how its sessions were recorded."""

import pandas as pd
import pytest
from command_line import metamerlab
from undrawn_reports import undrawn

from analysis.report.report_source import recording_notes


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
