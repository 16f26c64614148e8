"""Tables in the form of BIDS, and the rows of its events files.

Cells are separated by tabs, `n/a` where nothing is. An event has onset and kind of what happened in
one run of the program.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from analysis.export.export_content import Run
from protocols.columns import Column
from protocols.disk.hashing import Json
from protocols.journal import (
    AnyEvent,
    Attempt,
    BlockEnd,
    BlockStart,
    Break,
    Calibration,
    Note,
    Pause,
    SessionEnd,
)
from protocols.outside import page_bytes
from protocols.tasks.confidence_question import CONFIDENCE

NOTHING = "n/a"
NO_LEVELS: Mapping[str, Mapping[str, str]] = {}


def told(name: str, meaning: str) -> Column:
    """Return a column without a unit."""
    return Column(name, "value", "", meaning)


def column_docs(
    columns: Sequence[Column], levels: Mapping[str, Mapping[str, str]] = NO_LEVELS
) -> dict[str, Json]:
    """Return the sidecar entries of columns; units are for numbers, BIDS takes them so.

    `levels` explain values of a column, by its name.
    """
    found: dict[str, Json] = {}
    for one in columns:
        text = one.kind == "text"
        own: dict[str, Json] = {
            "Description": one.meaning + f" ({one.unit})" * (text and bool(one.unit))
        }
        if one.unit and not text:
            own["Units"] = one.unit
        if one.name in levels:
            own["Levels"] = dict(levels[one.name])
        found[one.name] = own
    return found


def write_tsv(path: Path, table: pd.DataFrame, columns: Sequence[Column]) -> None:
    """Write those of `columns` that the table has; cells lose tabs and line ends."""
    names = [column.name for column in columns if column.name in table]
    rows = ("\t".join(map(cell, row)) for row in table[names].itertuples(index=False))
    lines = ["\t".join(names), *rows]
    path.write_bytes(page_bytes("\n".join(lines) + "\n"))


def cell(value: object) -> str:
    """Return one cell: `n/a` for what is missing or empty."""
    if value is None or value is pd.NA or value != value:
        return NOTHING
    return " ".join(str(value).split()) or NOTHING


_KINDS = (
    ("session-start", "The program was started for this session"),
    ("session-resume", "The program was started again for this session"),
    ("session-end", "The program ended"),
    ("block-start", "A block begins; block 0 is practice"),
    ("block-end", "Every trial of a block was decided or given up"),
    ("break", "Break between blocks"),
    ("pause", "The session rested because the participant asked"),
    ("validation", "The gaze source was validated"),
    ("note", "Something the operator or the program wanted remembered"),
    ("fixate", "The dot waits for gaze"),
    ("respond", "The answer is awaited"),
    (CONFIDENCE, "The confidence in the answer is asked"),
    ("feedback", "Practice says whether the answer was right"),
)
EVENT_COLUMNS = (
    Column("onset", "number", "s", "Seconds since the program opened the journal in this run"),
    Column("duration", "number", "s", "Duration; n/a for a moment"),
    told("trial_type", "Kind of event"),
    Column("response_time", "number", "s", "Time from the onset of a question to the key press"),
    told("trial", "Trial of the plan"),
    told("attempt", "1 for the first attempt at this trial"),
    told("position", "Number of this attempt in the session, from 0"),
    told("block", "Block; 0 is practice"),
    told("stimulus", "Stimulus shown, see stimuli/clips.tsv; several are joined by spaces"),
    told("stimulus_sha256", "SHA-256 over the hashes of its frames"),
    told("refreshes", "Refreshes of the display that it lasted"),
    told("planned_refreshes", "Refreshes planned; n/a where the participant decides"),
    told("dropped", "Refreshes at which nothing new could be shown"),
    Column("accuracy_deg", "number", "deg", "Validations: mean angle between target and gaze"),
    Column("precision_deg", "number", "deg", "Validations: angle from sample to sample, as RMS"),
    told("outcome", "End of the attempt, or of the run of the program"),
    told("note", "Text of a note"),
)


def event_kinds(run: Run) -> dict[str, str]:
    """Return the meaning of kinds of events, phases of the run's task among them."""
    said = dict(_KINDS)
    for attempt in run.attempts:
        for phase in attempt.phases:
            numbers = " and ".join(str(index + 1) for index in phase.stimuli)
            said.setdefault(
                phase.phase, f"Shows stimulus {numbers} of the trial" if numbers else "Blank"
            )
    return said


def event_rows(
    run: Run, *, public: bool, left_out: frozenset[str] = frozenset()
) -> list[dict[str, object]]:
    """Return the rows of a run, by onset; in public without notes. All rows have all columns."""
    rows: list[dict[str, object]] = []
    for event in run.events:
        if isinstance(event, Attempt):
            rows += _attempt(event)
        elif row := _moment(event, public=public):
            rows.append(row)
    rows.sort(key=lambda row: float(str(row["onset"])))
    left_out |= {"note"} if public else set()
    names = [column.name for column in EVENT_COLUMNS if column.name not in left_out]
    return [{name: row.get(name) for name in names} for row in rows]


def _attempt(attempt: Attempt) -> list[dict[str, object]]:
    rows = []
    for phase in attempt.phases:
        row: dict[str, object] = {
            "onset": phase.onset_s,
            "duration": round(phase.offset_s - phase.onset_s, 6),
            "trial_type": phase.phase,
            "trial": attempt.trial,
            "attempt": attempt.attempt,
            "position": attempt.position,
            "block": attempt.block,
            "refreshes": phase.refreshes,
            "planned_refreshes": phase.planned,
            "dropped": phase.dropped,
            "outcome": attempt.void_reason or attempt.outcome,
        }
        shown = [attempt.stimuli[index] for index in phase.stimuli]
        if shown:
            row |= {
                "stimulus": " ".join(stimulus.name for stimulus in shown),
                "stimulus_sha256": " ".join(stimulus.sha256 for stimulus in shown),
            }
        if phase.phase == "respond":
            row["response_time"] = attempt.rt_s
        for given in attempt.further:
            if given.question == phase.phase:
                row["response_time"] = given.rt_s
        rows.append(row)
    return rows


def _moment(event: AnyEvent, *, public: bool) -> dict[str, object] | None:
    row: dict[str, object] = {"onset": event.t_s, "trial_type": event.kind}
    match event:
        case BlockStart() | BlockEnd():
            return row | {"block": event.block}
        case Break() | Pause():  # written when they end
            began_s = max(0.0, round(event.t_s - event.duration_s, 6))
            return row | {"onset": began_s, "duration": event.duration_s}
        case Calibration():
            return row | {
                "trial_type": "validation",
                "accuracy_deg": event.accuracy_deg,
                "precision_deg": event.precision_deg,
            }
        case SessionEnd():
            return row | {"outcome": event.reason, "note": event.message}
        case Note():
            return None if public else row | {"note": event.text}
    return row if event.kind in ("session-start", "session-resume") else None
