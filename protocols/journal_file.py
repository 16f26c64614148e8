"""Reads journals: strictly for a session that goes on, leniently for an analysis."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from protocols.errors import StudyError
from protocols.format1 import upgraded_attempt
from protocols.journal import EVENT, AnyEvent, Attempt, SessionStart, Withdrawal
from protocols.load import read_bytes

JOURNAL_NAME = "journal.jsonl"


@dataclass(frozen=True)
class DamagedLine:
    """A line that is no event."""

    line: int
    """From 1, as editors count."""
    reason: str


@dataclass(frozen=True)
class Journal:
    """What a journal file holds."""

    path: Path
    events: tuple[AnyEvent, ...]
    torn: bytes
    """The unfinished last line; empty where the file ends as it should."""
    ends_open: bool
    """True where the last event is whole but lacks its line feed."""
    damaged: tuple[DamagedLine, ...]

    @property
    def start(self) -> SessionStart:
        """The header; `StudyError` if the journal has none."""
        if self.events and isinstance(self.events[0], SessionStart):
            return self.events[0]
        raise StudyError(
            f"{self.path}: must begin with a session-start event"
            f" (got {self.events[0].kind if self.events else 'no event'})"
        )

    @property
    def has_lines(self) -> bool:
        """Whether any line was ever finished."""
        return bool(self.events or self.damaged)

    @property
    def withdrawn(self) -> bool:
        """Whether the participant withdrew and only the stone is left."""
        return any(isinstance(event, Withdrawal) for event in self.events)

    @property
    def attempts(self) -> tuple[Attempt, ...]:
        """Every attempt, in order."""
        return tuple(event for event in self.events if isinstance(event, Attempt))


def read_journal(path: Path, *, lenient: bool = False) -> Journal:
    """Read a journal.

    Parameters
    ----------
    path : Path
        ``journal.jsonl``.
    lenient : bool
        Keep going past damaged lines and list them in `Journal.damaged`. A torn last line (the
        program was killed while writing it) is never an error: it is in `Journal.torn`.

    Raises
    ------
    StudyError
        If the file cannot be read or, unless `lenient`, a line is damaged or missing.
    """
    data = read_bytes(path, "the journal")
    *lines, tail = data.split(b"\n")
    ends_open = False
    if tail and not isinstance(_parse(tail), str):
        lines, tail, ends_open = [*lines, tail], b"", True
    events: list[AnyEvent] = []
    damaged: list[DamagedLine] = []
    lost = 0  # numbers that damaged lines stand for
    for number, line in enumerate(lines, start=1):
        event = _parse(line)
        if isinstance(event, str):
            damaged.append(DamagedLine(number, event))
            lost += 1
            continue
        expected = events[-1].n + 1 if events else 0
        if not expected <= event.n <= expected + lost:
            damaged.append(
                DamagedLine(number, f"n must be {expected} (got {event.n}): a line is missing")
            )
        lost = 0
        events.append(event)
    if damaged and not lenient:
        first = damaged[0]
        raise StudyError(
            f"{path}: line {first.line}: {first.reason}; the journal was changed after it was"
            " written: restore it from a copy (an analysis reads past the damage and says so)"
        )
    return Journal(path, tuple(events), tail, ends_open, tuple(damaged))


def find_journals(folder: Path) -> tuple[Path, ...]:
    """Return every journal below a folder, in the order of their paths.

    Raises
    ------
    StudyError
        If there is no such folder.
    """
    if not folder.is_dir():
        raise StudyError(f"{folder}: must be a folder of sessions (there is no such folder)")
    return tuple(sorted(folder.rglob(JOURNAL_NAME)))


def _parse(line: bytes) -> AnyEvent | str:
    """Return the event, or why the line is none."""
    try:
        line.decode("utf-8")
    except UnicodeDecodeError as error:
        return (
            f"must be UTF-8 text (got byte 0x{line[error.start]:02x} at column {error.start + 1})"
        )
    try:
        return EVENT.validate_json(_of_format_2(line), strict=True)
    except _ContradictionError as error:
        return f"attempt: {error}"
    except ValidationError as error:
        try:
            raw = json.loads(line)
        except (ValueError, RecursionError):  # no JSON; a number too long; brackets too deep
            return f"must be one JSON object (got {line[:40]!r})"
        detail = error.errors()[0]
        kind = raw.get("kind") if isinstance(raw, dict) else None
        place = ".".join(map(str, detail["loc"][1:] if kind else detail["loc"]))
        return f"{kind or 'event'}: {place}: {detail['msg']}".replace(": :", ":")


class _ContradictionError(Exception):
    """A line of format 1 that cannot be read as format 2."""


def _of_format_2(line: bytes) -> bytes:
    """Return a line as format 2 has it; only attempts of format 1 change."""
    if b'"trial_kind":"2afc"' not in line:
        return line
    try:
        raw = json.loads(line)
        if not isinstance(raw, dict) or raw.get("trial_kind") != "2afc":
            return line
        return json.dumps(upgraded_attempt(raw)).encode()
    except (json.JSONDecodeError, RecursionError):
        return line
    except KeyError as error:
        raise _ContradictionError(f"{error.args[0]}: Field required") from None
    except (TypeError, ValueError) as error:
        raise _ContradictionError(str(error)) from None
