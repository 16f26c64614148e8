"""The data dictionary: every column of the tidy tables, with its unit and meaning.

Common columns come first, then those of the task's condition and answer.
"""

from collections.abc import Mapping

import pandas as pd

from protocols.columns import Column
from protocols.schema import StudyProtocol
from protocols.tasks.pairs import CHOICE_COLUMNS, PAIR_COLUMNS, SCENE_COLUMNS

SESSION_COLUMNS = (
    Column("session", "text", "", "Folder of the journal, relative to the folder analysed"),
    Column("participant", "text", "", "Pseudonymous code"),
    Column("slot", "integer", "", "Counterbalancing slot"),
    Column("simulated", "0/1", "", "1: an artificial observer answered"),
    Column("status", "text", "", "completed, unfinished, or why the sitting ended"),
    Column("planned", "integer", "trials", "Main trials planned"),
    Column("decided", "integer", "trials", "Main trials decided"),
    Column("attempts", "integer", "", "Attempts at main trials, void ones included"),
    Column("void", "integer", "", "Void attempts at main trials"),
    Column("catch_correct", "share", "", "Share of right answers in catch trials; empty: none"),
    Column("dropped", "integer", "refreshes", "Missed refreshes in decided main trials"),
    Column("gaze_lost_share", "share", "", "Mean share of watched time without gaze data"),
    Column("gaze_violations", "integer", "", "Gaze violations in main attempts"),
    Column("gaze_mean_deg", "number", "deg", "Mean angle between gaze and dot in main attempts"),
    Column("accuracy_deg", "number", "deg", "Worst accuracy of the sitting's calibrations"),
    Column("resumed", "integer", "", "How often the sitting was resumed"),
    Column(
        "damaged_lines",
        "integer",
        "",
        "Journal lines that could not be read, do not fit their checksum, or contradict the plan",
    ),
    Column("unchecked_lines", "integer", "", "Journal lines without a checksum"),
    Column("wrong_files", "integer", "", "Files beside the journal that are missing or changed"),
    Column("torn", "0/1", "", "1: the last line was unfinished"),
    Column("refresh_hz", "number", "Hz", "Refresh rate of the display"),
    Column("gaze_mode", "text", "", "enforce, warn, monitor or none"),
    Column("timing_evidence", "text", "", "What vouches for the time stamps"),
    Column("protocol_sha256", "text", "", "Hash of the protocol"),
    Column("stimuli_sha256", "text", "", "Hash of what decides the pixels"),
    Column("manifest_sha256", "text", "", "Hash of the clips' manifest"),
    Column("plan_sha256", "text", "", "Hash of the sitting's trial list"),
    Column("journal_sha256", "text", "", "Hash of the journal file"),
    Column("revision", "text", "", "Version and git revision that recorded the sitting"),
    Column("excluded", "text", "", "Rule that leaves the sitting out; empty: kept"),
)

_TRIAL = (
    Column("session", "text", "", "Folder of the journal, relative to the folder analysed"),
    Column("participant", "text", "", "Pseudonymous code"),
    Column("simulated", "0/1", "", "1: an artificial observer answered"),
    Column("trial", "text", "", "Trial of the plan"),
    Column("kind", "text", "", "main, catch or practice"),
)
_REPEAT = (
    Column("block", "integer", "", "Block; 0 is practice"),
    Column("repeat", "integer", "", "Repeat of the condition, from 0"),
)
_ANSWERED = (
    Column("key_place", "integer", "", "Answer key pressed, counted from the left, from 0"),
    Column("rt_s", "number", "s", "From the onset of the answer phase to the key press"),
    Column("dropped", "integer", "refreshes", "Missed refreshes from the first stimulus to answer"),
    Column("gaze_lost_share", "share", "", "Share of watched time without gaze data"),
)


def attempt_columns(study: StudyProtocol) -> tuple[Column, ...]:
    """Return the columns of the table of attempts."""
    return (
        *_TRIAL,
        Column("attempt", "integer", "", "1 for the first attempt at this trial"),
        Column("position", "integer", "", "Number of this attempt in the sitting, from 0"),
        *_REPEAT,
        *study.task.condition_columns(study),
        Column("outcome", "text", "", "completed or void"),
        Column("void_reason", "text", "", "Why the attempt was void"),
        *study.task.answer_columns(),
        *_ANSWERED,
        Column("at", "text", "UTC", "Wall clock at the end of the attempt"),
        Column("warned", "0/1", "", "1: told that gaze had left the dot"),
        Column("frames_shown", "integer", "frames", "Frames of the stimuli that were displayed"),
        Column("frames_planned", "integer", "frames", "Frames of the stimuli"),
        Column("gaze_samples", "integer", "", "Gaze samples watched"),
        Column("gaze_blinks", "integer", "", "Losses short enough to be pardoned"),
        Column("gaze_violations", "integer", "", "Times gaze was outside for long enough"),
        Column("gaze_mean_deg", "number", "deg", "Mean angle between gaze and dot"),
        Column("gaze_max_deg", "number", "deg", "Largest angle between gaze and dot"),
    )


def decision_columns(study: StudyProtocol) -> tuple[Column, ...]:
    """Return the columns of the table of decisions."""
    return decided(study.task.condition_columns(study), study.task.answer_columns())


def decided(condition: tuple[Column, ...], answer: tuple[Column, ...]) -> tuple[Column, ...]:
    """Return the columns of a table of decisions with these columns of condition and answer."""
    return (
        *_TRIAL,
        Column("order", "integer", "", "Place among the sitting's decided main trials, from 1"),
        Column("attempts", "integer", "", "Attempts until decided"),
        *_REPEAT,
        *condition,
        *answer,
        *_ANSWERED,
        Column("included", "0/1", "", "1: used in the analysis"),
        Column("exclusion", "text", "", "Why the decision is not used; empty: it is"),
    )


PREFERENCE_COLUMNS = decided((*SCENE_COLUMNS, *PAIR_COLUMNS), CHOICE_COLUMNS)
"""Of a table of preferences that no protocol belongs to."""


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
