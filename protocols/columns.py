"""Columns of tidy tables: name, type, unit and meaning, for table and data dictionary alike.

Here are those that the tables of every task have; a task adds its own in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

ColumnKind = Literal["text", "number", "share", "integer", "0/1", "value"]


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str
    kind: ColumnKind
    """`value`: a number where all are numbers, else text."""
    unit: str
    meaning: str
    aliases: tuple[str, ...] = ()
    """Names in other programs, small and with ``_`` between words."""
    required: bool = False
    """A table of another program must have it."""


IDENTITY_COLUMNS = (
    Column("session", "text", "", "Folder of the journal, relative to the folder analysed"),
    Column(
        "participant",
        "text",
        "",
        "Pseudonymous code",
        ("subject", "subj", "observer", "person", "sub", "vpn", "subject_id", "participant_id"),
        required=True,
    ),
)
_TRIAL = (
    *IDENTITY_COLUMNS,
    Column("simulated", "0/1", "", "1: an artificial observer answered"),
    Column("remote", "0/1", "", "1: in the participant's own browser"),
    Column("trial", "text", "", "Trial of the plan"),
    Column("kind", "text", "", "main, catch or practice"),
)
_REPEAT = (
    Column("block", "integer", "", "Block; 0 is practice"),
    Column("repeat", "integer", "", "Repeat of the condition, from 0"),
)
_ANSWERED = (
    Column("key_place", "integer", "", "Answer key pressed, counted from the left, from 0"),
    Column(
        "rt_s",
        "number",
        "s",
        "Time from the onset of the answer phase to the key press",
        (
            "rt",
            "rt_ms",
            "rt_sec",
            "response_time",
            "reaction_time",
            "latency",
            "responsetime",
            "reactiontime",
        ),
    ),
    Column("dropped", "integer", "refreshes", "Missed refreshes from the first stimulus to answer"),
    Column("gaze_lost_share", "share", "", "Share of watched time without gaze data"),
)


def attempted(condition: Sequence[Column], answer: Sequence[Column]) -> tuple[Column, ...]:
    """Return the columns of a table of attempts with these columns of condition and answer."""
    return (
        *_TRIAL,
        Column("attempt", "integer", "", "1 for the first attempt at this trial"),
        Column("position", "integer", "", "Number of this attempt in the session, from 0"),
        *_REPEAT,
        *condition,
        Column("outcome", "text", "", "completed or void"),
        Column("void_reason", "text", "", "Reason for which the attempt was void"),
        *answer,
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


def decided(condition: Sequence[Column], answer: Sequence[Column]) -> tuple[Column, ...]:
    """Return the columns of a table of decisions with these columns of condition and answer."""
    return (
        *_TRIAL,
        Column("order", "integer", "", "Place among the session's decided main trials, from 1"),
        Column("attempts", "integer", "", "Attempts until decided"),
        *_REPEAT,
        *condition,
        *answer,
        *_ANSWERED,
        Column("included", "0/1", "", "1: used in the analysis"),
        Column("exclusion", "text", "", "Reason why the decision is not used; empty: it is"),
    )


COMMON_COLUMNS = tuple({c.name: c for c in (*attempted((), ()), *decided((), ()))})
"""Names that the tables of every task have: no column of the stimuli may take one."""
