"""Holds the files beside a journal to the hashes that the journal has of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from protocols.disk.hashing import sha256_file
from protocols.errors import StudyError
from protocols.journal import Attempt, DisplayReport, Note, SessionResume, SessionStart, SideFile
from protocols.journal_file import Journal


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
            for side in (event.gaze_file, event.flips_file):
                if side is not None:
                    yield beside, side
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
