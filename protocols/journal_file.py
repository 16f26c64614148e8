"""Reads journals: strictly for a session that goes on, leniently for an analysis; checks hashes.

Each line vouches for itself and for all lines before it. Its checksum is the SHA-256 of the line
before's checksum, followed by the line as it reads with ``null`` in the checksum's place, without
its line feed. Before the first line that has one stands the SHA-256 of all bytes before it, which
are none in a journal begun since format 2 has checksums. It finds accidents and careless edits; who
computes all checksums anew is not found.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from pydantic import ValidationError

from protocols.disk.hashing import sha256_bytes, sha256_file
from protocols.disk.whole_file import read_bytes
from protocols.errors import StudyError, refuse_format_1
from protocols.journal import (
    EVENT,
    AnyEvent,
    Attempt,
    DisplayReport,
    Note,
    SessionResume,
    SessionStart,
    SideFile,
    Withdrawal,
    event_line,
)
from protocols.limits import check_within
from protocols.study_file.problems import in_words

_NONE = b'"chain":null'
_FIELD = re.compile(rb'"chain":"([0-9a-f]{64})"')
# In canonical JSON the first match is the field of the event itself: within a text, quotes are
# escaped, and no key that sorts before "chain" holds an object.


def first_link(before: bytes) -> str:
    """Return the text in place of the checksum before the first line that has one.

    Parameters
    ----------
    before : bytes
        All of the journal before that line.
    """
    return sha256_bytes(before)


def sealed(event: AnyEvent, before: str) -> tuple[AnyEvent, bytes]:
    """Return an event with its checksum, and its journal line with its line feed.

    Parameters
    ----------
    event : AnyEvent
        Its own checksum, if any, is replaced.
    before : str
        Checksum of the line before, or `first_link`.
    """
    chain, line = sealed_line(event_line(event.model_copy(update={"chain": None})), before)
    return event.model_copy(update={"chain": chain}), line


def sealed_line(bare: bytes, before: str) -> tuple[str, bytes]:
    """Return the checksum of a line that has ``null`` in its place, and the line with it."""
    chain = due(bare[:-1], before)
    return chain, bare.replace(_NONE, b'"chain":"%b"' % chain.encode(), 1)


def line_sum(line: bytes) -> str | None:
    """Return the checksum that a line states; None where it states none."""
    found = _FIELD.search(line)
    return found[1].decode() if found else None


def due(line: bytes, before: str) -> str:
    """Return the checksum that a line must state, after a line with checksum `before`."""
    bare = _FIELD.sub(_NONE, line, count=1)
    return hashlib.sha256(before.encode() + bare).hexdigest()


JOURNAL_NAME = "journal.jsonl"


@dataclass(frozen=True)
class DamagedLine:
    """A line that is no event."""

    line: int
    """Number from 1, as editors count."""
    reason: str


@dataclass(frozen=True)
class Journal:
    """Content of a journal file."""

    path: Path
    events: tuple[AnyEvent, ...]
    torn: bytes
    """The unfinished last line; empty where the file ends as it should."""
    ends_open: bool
    """True where the last event is whole but lacks its line feed."""
    damaged: tuple[DamagedLine, ...]
    unchecked: int = 0
    """Lines without a checksum, as older versions wrote them."""

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
        """True if any line was ever finished."""
        return bool(self.events or self.damaged)

    @property
    def withdrawn(self) -> bool:
        """True if the participant withdrew and only the stone is left."""
        return any(isinstance(event, Withdrawal) for event in self.events)

    @property
    def attempts(self) -> tuple[Attempt, ...]:
        """Every attempt, in order."""
        return tuple(event for event in self.events if isinstance(event, Attempt))

    @property
    def rate_changes(self) -> tuple[str, ...]:
        """Refresh rates at which the session went on, each with its first attempt, from 1."""
        attempts, found = 0, []
        for event in self.events:
            attempts += isinstance(event, Attempt)
            if isinstance(event, SessionResume) and event.refresh_hz is not None:
                found.append(f"{event.refresh_hz:g} Hz from attempt {attempts + 1}")
        return tuple(found)

    @property
    def time_off_s(self) -> float | None:
        """Largest difference of a time from the study's, in a browser; None at a desk."""
        if self.start.remote is None:
            return None
        later = [e.deviations_s for e in self.events if isinstance(e, SessionResume)]
        of_rates = [self.start.remote.deviations_s, *filter(None, later)]
        return max((abs(off_s) for of in of_rates for off_s in of.values()), default=0.0)


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
        If the file cannot be read, has format 1 or, unless `lenient`, a line is damaged or missing.
    """
    try:
        data = read_bytes(path, "the journal", "table")
        check_within("events", data.count(b"\n"), StudyError, path, "lines")
    except StudyError as error:
        if lenient and path.exists():  # one session's, and not the study's end
            return Journal(path, (), b"", False, (DamagedLine(1, str(error)),))
        raise
    *lines, tail = data.split(b"\n")
    _refuse_format_1(path, lines[0] if lines else tail)
    ends_open = False
    if tail.startswith(b"{") and _holds_an_object(tail):  # a torn line is the beginning of one
        lines, tail, ends_open = [*lines, tail], b"", True
    events: list[AnyEvent] = []
    damaged: list[DamagedLine] = []
    checksums = _Checksums(data)
    lost = 0  # numbers that damaged lines stand for
    for number, line in enumerate(lines, start=1):
        event, wrong = _parse(line), checksums.problem(line)
        if isinstance(event, str):
            damaged.append(DamagedLine(number, event))
            lost += 1
            continue
        if event.chain is not None and line_sum(line) is None:
            wrong = "must be as it was written: its checksum stands in another form"
        expected = events[-1].n + 1 if events else 0
        if not expected <= event.n <= expected + lost:
            damaged.append(
                DamagedLine(number, f"n must be {expected} (got {event.n}): a line is missing")
            )
        elif wrong:
            damaged.append(DamagedLine(number, wrong))
        elif events and not lost and _falls(events[-1], event):
            before_s = events[-1].t_s
            damaged.append(
                DamagedLine(number, f"t_s must not fall (got {event.t_s:g} after {before_s:g})")
            )
        if wrong and checksums.certain:
            lost += 1
            continue
        lost = 0
        events.append(event)
    if damaged and not lenient:
        first = damaged[0]
        raise StudyError(
            f"{path}: line {first.line}: {first.reason}; the journal was changed after it was"
            " written: restore it from a copy (an analysis reads past the damage and says so)"
        )
    return Journal(path, tuple(events), tail, ends_open, tuple(damaged), checksums.lacking)


def _refuse_format_1(path: Path, line: bytes) -> None:
    """Refuse a journal whose header has format 1, which knew no checksums."""
    with suppress(ValueError, RecursionError):
        raw = json.loads(line)
        if isinstance(raw, dict) and raw.get("kind") == "session-start" and line_sum(line) is None:
            refuse_format_1(path, raw, "go on with the session there, or report it there")


def header_of(data: bytes) -> SessionStart | None:
    """Return the header of a journal's bytes without reading on; None where line 1 is none."""
    line, end, _ = data.partition(b"\n")
    event = _parse(line)
    whole = end and _Checksums(data).problem(line) is None
    return event if whole and isinstance(event, SessionStart) else None


def find_journals(folder: Path) -> tuple[Path, ...]:
    """Return every journal below a folder, in the order of their paths.

    Raises
    ------
    StudyError
        If there is no such folder.
    """
    if not folder.is_dir():
        raise StudyError(
            f"{folder}: must be a folder of sessions (there is no such folder); check the path"
        )
    return tuple(sorted(folder.rglob(JOURNAL_NAME)))


class _Checksums:
    """Follows the checksums of a journal's bytes from line to line."""

    def __init__(self, data: bytes) -> None:
        self.lacking = 0
        """Lines that have none."""
        self.certain = True
        """True if the last line that was found wrong must itself have been changed: what stands
        before it was as written, or says what it said."""
        self._before: list[str] = []  # what the next line may build on
        self._begun = False
        self._data, self._unsealed = data, 0  # bytes before the first checksum

    def problem(self, line: bytes) -> str | None:
        """Take the next line; return what is wrong with its checksum."""
        said = line_sum(line)
        if said is None:
            if not self._begun:
                self.lacking += 1
                self._unsealed += len(line) + 1
                return None
            self.certain, self._before = bool(self._before), []
            return "must have a checksum, as the lines before it have"
        if not self._begun:
            self._begun, self._before = True, [first_link(self._data[: self._unsealed])]
        found = [due(line, link) for link in self._before]
        self.certain = bool(self._before)
        if said in found:
            self._before = [said]
            return None
        self._before = [said, *found[:1]]  # the line was changed, or its checksum was
        if self.certain:
            return "must be as it was written: its checksum does not fit"
        return "its checksum cannot be checked, since the line before it has none"


def _falls(before: AnyEvent, event: AnyEvent) -> bool:
    """Return True if the clock ran backwards; it begins anew where a session is resumed."""
    return event.t_s < before.t_s and not isinstance(event, SessionResume)


def _holds_an_object(tail: bytes) -> bool:
    """Return True if a last line without a line feed has a whole JSON object at its beginning."""
    try:
        json.JSONDecoder().raw_decode(tail.decode("utf-8", errors="replace"))
    except (ValueError, RecursionError):
        return False
    return True


def _parse(line: bytes) -> AnyEvent | str:
    """Return the event, or why the line is none."""
    try:
        line.decode("utf-8")
    except UnicodeDecodeError as error:
        return (
            f"must be UTF-8 text (got byte 0x{line[error.start]:02x} at column {error.start + 1})"
        )
    try:
        return EVENT.validate_json(line, strict=True)
    except ValidationError as error:
        try:
            raw = json.loads(line)
        except (ValueError, RecursionError):
            return f"must be one JSON object (got {line[:40]!r})"
        detail = error.errors(include_url=False)[0]
        kind = raw.get("kind") if isinstance(raw, dict) else None
        if kind is not None and (not isinstance(kind, str) or kind not in _KINDS):
            return f"event: kind must be one of those that journals have (got {ascii(kind)[:40]})"
        place = ".".join(map(str, detail["loc"][1:] if kind else detail["loc"]))
        said = f"{kind or 'event'}: {place}: {in_words(detail)}".replace(": :", ":")
        return said.encode("ascii", "backslashreplace").decode()[:200]


_KINDS = {kind.model_fields["kind"].default for kind in get_args(get_args(AnyEvent)[0])}


@dataclass(frozen=True)
class WrongFile:
    """A file that is not as it was recorded."""

    file: str
    """Name of the file in the journal."""
    reason: str
    """`is missing`, `was changed`, ..."""


@dataclass(frozen=True)
class SideFiles:
    """Check of the files that a journal names."""

    checked: int
    wrong: tuple[WrongFile, ...]


def check_side_files(journal: Journal) -> SideFiles:
    """Hash every file that a journal names: gaze, flips, what a tracker recorded, and the
    display's report.

    Raises
    ------
    StudyError
        If a file that is there cannot be read.
    """
    wrong, checked = [], 0
    for folder, entry in _named(journal):
        checked += 1
        reason = _reason(folder, entry)
        if reason is not None:
            wrong.append(WrongFile(entry.file, reason))
    return SideFiles(checked, tuple(wrong))


def _named(journal: Journal) -> Iterator[tuple[Path, SideFile | DisplayReport]]:
    """Yield each file that the journal names, with the folder that its name starts from."""
    beside = journal.path.parent
    root = beside.absolute().parent.parent
    for event in journal.events:
        if isinstance(event, Attempt):
            yield from ((beside, side) for side in event.side_files)
        elif isinstance(event, Note) and event.file is not None:
            yield beside, event.file
        elif isinstance(event, SessionStart | SessionResume) and event.display_report is not None:
            yield root, event.display_report


def _reason(folder: Path, entry: SideFile | DisplayReport) -> str | None:
    name = entry.file
    if name.startswith("/") or ".." in name.split("/") or "\0" in name:
        return "lies outside the folder of sessions"
    try:
        found = sha256_file(folder / name)
    except FileNotFoundError:
        return "is missing"
    except OSError as error:
        raise StudyError(f"{folder / name}: must be readable ({error.strerror})") from None
    return None if found == entry.sha256 else "was changed"
