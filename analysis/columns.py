"""The data dictionary: every column of the tidy tables, with its unit and meaning."""

from dataclasses import dataclass

import pandas as pd


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str
    kind: str
    unit: str
    meaning: str


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
    Column("damaged_lines", "integer", "", "Journal lines that could not be read"),
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
_SHOWN = (
    Column("block", "integer", "", "Block; 0 is practice"),
    Column("repeat", "integer", "", "Repeat of pairing x size x scene, from 0"),
    Column("scene", "text", "", "Scene of both clips"),
    Column("size", "text", "", "Size of the disocclusion"),
    Column("first", "text", "", "Method shown in interval 1"),
    Column("second", "text", "", "Method shown in interval 2"),
    Column("expected", "text", "", "Catch trials: the right answer"),
    Column("first_side", "text", "", "Side of the key that stands for interval 1"),
)

ATTEMPT_COLUMNS = (
    *_TRIAL,
    Column("attempt", "integer", "", "1 for the first attempt at this trial"),
    Column("position", "integer", "", "Number of this attempt in the sitting, from 0"),
    *_SHOWN,
    Column("outcome", "text", "", "completed or void"),
    Column("void_reason", "text", "", "Why the attempt was void"),
    Column("choice", "text", "", "Interval picked: first or second"),
    Column("chosen", "text", "", "Method picked"),
    Column("chosen_side", "text", "", "Side whose key was pressed"),
    Column("rt_s", "number", "s", "From the onset of the answer phase to the key press"),
    Column("at", "text", "UTC", "Wall clock at the end of the attempt"),
    Column("dropped", "integer", "refreshes", "Missed refreshes between interval 1 and answer"),
    Column("warned", "0/1", "", "1: told that gaze had left the dot"),
    Column("frames_shown_first", "integer", "frames", "Clip frames that reached the display"),
    Column("frames_shown_second", "integer", "frames", "Clip frames that reached the display"),
    Column("frames_planned", "integer", "frames", "Clip frames planned per interval"),
    Column("gaze_samples", "integer", "", "Gaze samples watched"),
    Column("gaze_lost_share", "share", "", "Share of watched time without gaze data"),
    Column("gaze_blinks", "integer", "", "Losses short enough to be pardoned"),
    Column("gaze_violations", "integer", "", "Times gaze was outside for long enough"),
    Column("gaze_mean_deg", "number", "deg", "Mean angle between gaze and dot"),
    Column("gaze_max_deg", "number", "deg", "Largest angle between gaze and dot"),
)

DECISION_COLUMNS = (
    *_TRIAL,
    Column("order", "integer", "", "Place among the sitting's decided main trials, from 1"),
    Column("attempts", "integer", "", "Attempts until decided"),
    *_SHOWN,
    Column("chosen", "text", "", "Method picked"),
    Column("rejected", "text", "", "Method not picked"),
    Column("chose_first", "0/1", "", "1: interval 1 was picked"),
    Column("chosen_side", "text", "", "Side whose key was pressed"),
    Column("correct", "0/1", "", "Catch trials: 1 if the expected method was picked"),
    Column("rt_s", "number", "s", "From the onset of the answer phase to the key press"),
    Column("dropped", "integer", "refreshes", "Missed refreshes between interval 1 and answer"),
    Column("gaze_lost_share", "share", "", "Share of watched time without gaze data"),
    Column("included", "0/1", "", "1: used in the analysis"),
    Column("exclusion", "text", "", "Why the decision is not used; empty: it is"),
)

TABLES = {
    "sessions": SESSION_COLUMNS,
    "attempts": ATTEMPT_COLUMNS,
    "decisions": DECISION_COLUMNS,
}


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
    return table


def dictionary() -> pd.DataFrame:
    """Return the data dictionary of all tables as a table."""
    return pd.DataFrame(
        [
            {"table": table, "column": c.name, "type": c.kind, "unit": c.unit, "meaning": c.meaning}
            for table, columns in TABLES.items()
            for c in columns
        ]
    )
