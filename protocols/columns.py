"""A column of a tidy table: name, type, unit and meaning, for table and data dictionary alike."""

from __future__ import annotations

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


COMMON_COLUMNS = (
    "session", "participant", "simulated", "trial", "kind", "attempt", "position", "order",
    "attempts", "block", "repeat", "outcome", "void_reason", "key_place", "rt_s", "dropped",
    "gaze_lost_share", "at", "warned", "frames_shown", "frames_planned", "gaze_samples",
    "gaze_blinks", "gaze_violations", "gaze_mean_deg", "gaze_max_deg", "included", "exclusion",
)  # fmt: skip
"""Names that the tables of every task have: no column of the stimuli may take one."""
