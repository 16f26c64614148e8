"""The data dictionary: every column of the tidy tables, with its unit and meaning.

Common columns come first, then those of the task's condition and answer.
"""

from collections.abc import Mapping

import pandas as pd

from protocols.columns import IDENTITY_COLUMNS, Column, attempted, decided
from protocols.study_file.schema import StudyProtocol

SESSION_COLUMNS = (
    *IDENTITY_COLUMNS,
    Column("slot", "integer", "", "Counterbalancing slot"),
    Column("simulated", "0/1", "", "1: an artificial observer answered"),
    Column("remote", "0/1", "", "1: the session ran in the participant's own browser"),
    Column("status", "text", "", "completed, unfinished, or why the session ended"),
    Column("planned", "integer", "trials", "Main trials planned"),
    Column("decided", "integer", "trials", "Main trials decided"),
    Column("attempts", "integer", "", "Attempts at main trials, void ones included"),
    Column("void", "integer", "", "Void attempts at main trials"),
    Column("catch_correct", "share", "", "Share of right answers in catch trials; empty: none"),
    Column("dropped", "integer", "refreshes", "Missed refreshes in decided main trials"),
    Column("gaze_lost_share", "share", "", "Mean share of watched time without gaze data"),
    Column("gaze_violations", "integer", "", "Gaze violations in main attempts"),
    Column("gaze_mean_deg", "number", "deg", "Mean angle between gaze and dot in main attempts"),
    Column("accuracy_deg", "number", "deg", "Worst accuracy of the session's calibrations"),
    Column("resumed", "integer", "", "Number of times that the session was resumed"),
    Column(
        "damaged_lines",
        "integer",
        "",
        "Journal lines that could not be read, do not fit their checksum, or contradict the plan",
    ),
    Column("unchecked_lines", "integer", "", "Journal lines without a checksum"),
    Column("wrong_files", "integer", "", "Files beside the journal that are missing or changed"),
    Column("torn", "0/1", "", "1: the last line was unfinished"),
    Column("refresh_hz", "number", "Hz", "Refresh rate of the display, at the session's beginning"),
    Column("refresh_changes", "text", "", "Later refresh rates in a browser; empty: none"),
    Column("time_off_s", "number", "s", "Largest difference of a time from the study's; browsers"),
    Column("headset", "text", "", "Kind of the headset's controllers; empty: a screen"),
    Column("head_turn_deg", "number", "deg", "Largest turn of the head in decided main trials"),
    Column("gaze_mode", "text", "", "enforce, warn, monitor or none"),
    Column("timing_evidence", "text", "", "Evidence for the time stamps"),
    Column("protocol_sha256", "text", "", "Hash of the protocol"),
    Column("stimuli_sha256", "text", "", "Hash of what decides the pixels"),
    Column("manifest_sha256", "text", "", "Hash of the clips' manifest"),
    Column("plan_sha256", "text", "", "Hash of the session's trial list"),
    Column("journal_sha256", "text", "", "Hash of the journal file"),
    Column("revision", "text", "", "Version and git revision that recorded the session"),
    Column("excluded", "text", "", "Rule that leaves the session out; empty: kept"),
)


def attempt_columns(study: StudyProtocol) -> tuple[Column, ...]:
    """Return the columns of the table of attempts."""
    return attempted(study.task.condition_columns(study.pool), study.task.all_answer_columns())


def decision_columns(study: StudyProtocol) -> tuple[Column, ...]:
    """Return the columns of the table of decisions."""
    return decided(study.task.condition_columns(study.pool), study.task.all_answer_columns())


def frame(rows: list[dict[str, object]], columns: tuple[Column, ...]) -> pd.DataFrame:
    """Return a table with exactly the columns of the dictionary, in its order."""
    table = pd.DataFrame(rows, columns=[column.name for column in columns])
    for column in columns:
        if column.kind == "text":
            values = table[column.name].astype(object)
            table[column.name] = values.where(values.notna(), "").astype(str)
        elif column.kind in ("number", "share"):
            table[column.name] = pd.to_numeric(table[column.name]).astype("float64")
        elif column.kind in ("integer", "0/1"):
            table[column.name] = pd.to_numeric(table[column.name]).astype("Int64")
        else:  # a value of a condition: numbers where all are
            values = table[column.name].astype(object)
            numbers = pd.to_numeric(values, errors="coerce")
            texts = values.map(lambda value: isinstance(value, str))
            if len(table) and not texts.any() and numbers.notna().all():
                table[column.name] = numbers.astype("float64")
            else:
                table[column.name] = values.where(values.notna(), "").astype(str)
    return table


def tables_of(study: StudyProtocol) -> dict[str, tuple[Column, ...]]:
    """Return the columns of every table of a study, by table."""
    return {
        "sessions": SESSION_COLUMNS,
        "attempts": attempt_columns(study),
        "decisions": decision_columns(study),
    }


def dictionary(tables: Mapping[str, tuple[Column, ...]]) -> pd.DataFrame:
    """Return the data dictionary of tables as a table."""
    return pd.DataFrame(
        [
            {"table": table, "column": c.name, "type": c.kind, "unit": c.unit, "meaning": c.meaning}
            for table, columns in tables.items()
            for c in columns
        ]
    )
