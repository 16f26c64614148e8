"""Writes a journal: append, flush, sync; never rewrite, never write over anything.

The journal is opened for appending by one program at a time. An event is on the disk when
`append` returns. A last line that a killed program left unfinished is put aside into a file of
its own when the session is resumed.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import TypedDict

from protocols.disk.hashing import sha256_bytes
from protocols.disk.locks import held
from protocols.disk.whole_file import sync_folder, write_new
from protocols.errors import StudyError
from protocols.journal import AnyEvent, Note, SideFile
from protocols.journal_file import JOURNAL_NAME, Journal, first_link, read_journal, sealed

_APPENDING = (
    os.O_RDWR | os.O_APPEND | getattr(os, "O_BINARY", 0)
)  # Windows: no line ends of its own


class Stamps(TypedDict):
    """Fields of every event."""

    n: int
    t_s: float
    at: str


class DiskError(StudyError):
    """The disk refused a write. Everything before it is whole."""


class Recorder:
    """The journal of one session, open for appending.

    Use `create` or `resume`; close it, or use it as a context manager.
    """

    def __init__(
        self,
        folder: Path,
        opened: ExitStack,
        descriptor: int,
        events: list[AnyEvent],
        clock: Callable[[], float],
        wall_clock: Callable[[], str],
    ) -> None:
        self.folder = folder
        self.path = folder / JOURNAL_NAME
        self.events: list[AnyEvent] = events
        self.torn_file: str | None = None
        self.waits_for_disk = True
        """True if an event counts as written once it is on the disk, not when it is handed to the
        system. False is for what can be made anew: then a power cut may cost the last seconds."""
        self._opened, self._descriptor = opened, descriptor
        self._clock, self._wall_clock = clock, wall_clock
        self.start_s = clock()
        """Time at which the journal was opened, on the stage's clock."""
        self._length = os.fstat(descriptor).st_size
        self._chain = events[-1].chain if events else None

    @classmethod
    def create(
        cls, folder: Path, clock: Callable[[], float], wall_clock: Callable[[], str]
    ) -> Recorder:
        """Begin the journal of a new session.

        Raises
        ------
        StudyError
            If the folder has one already, or cannot be written.
        """
        path = folder / JOURNAL_NAME
        with ExitStack() as opening:
            try:
                folder.mkdir(parents=True, exist_ok=True)
                descriptor = _open(path, os.O_CREAT | os.O_EXCL, opening)
                opening.enter_context(journal_held(path))
            except FileExistsError:
                raise StudyError(
                    f"{path}: a journal is never written over; take another participant code, or"
                    " 'metamerlab session resume'"
                ) from None
            except OSError as error:
                raise StudyError(
                    f"{folder}: must be a writable folder ({error.strerror})"
                ) from None
            with _disk_of(folder):
                sync_folder(folder)
            return cls(folder, opening.pop_all(), descriptor, [], clock, wall_clock)

    @classmethod
    def resume(
        cls, folder: Path, clock: Callable[[], float], wall_clock: Callable[[], str]
    ) -> Recorder:
        """Open a journal to go on with it; an unfinished last line is put aside.

        Raises
        ------
        StudyError
            If there is none, it is damaged, or another program has it open.
        """
        path = folder / JOURNAL_NAME
        with ExitStack() as opening:
            try:
                descriptor = _open(path, 0, opening)
                opening.enter_context(journal_held(path))
            except FileNotFoundError:
                raise StudyError(
                    f"{path}: must exist to be resumed (there is no journal)"
                ) from None
            except OSError as error:
                raise StudyError(f"{path}: must be writable ({error.strerror})") from None
            journal = read_journal(path)
            with _disk_of(folder):
                recorder = cls(folder, opening, descriptor, list(journal.events), clock, wall_clock)
                recorder._mend(journal)
            recorder._opened = opening.pop_all()
            return recorder

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the journal; safe to call twice."""
        self._opened.close()

    def stamps(self) -> Stamps:
        """Return the next event's place and time."""
        return {
            "n": len(self.events),
            "t_s": round(self._clock() - self.start_s, 6),
            "at": self._wall_clock(),
        }

    def session_time(self, clock_s: float) -> float:
        """Return a stamp of the stage's clock as seconds since the journal was opened."""
        return round(clock_s - self.start_s, 6)

    def append(self, event: AnyEvent) -> None:
        """Write an event; it is on the disk when this returns.

        Raises
        ------
        DiskError
            If the disk refuses. The journal then ends with the event before.
        """
        if self._chain is None:
            self._chain = first_link(self.path.read_bytes())
        event, line = sealed(event, self._chain)
        try:
            self._write(line)
            if self.waits_for_disk:
                os.fsync(self._descriptor)
        except OSError as error:
            os.ftruncate(self._descriptor, self._length)
            raise self._refused(self.path, error) from None
        self._length += len(line)
        self._chain = event.chain
        self.events.append(event)

    def note(self, text: str, file: SideFile | None = None) -> None:
        """Write down something that no other event says, with the file that holds more of it.

        Raises
        ------
        DiskError
            As `append`.
        """
        self.append(Note(**self.stamps(), text=text, file=file))

    def side_file(self, stem: str, suffix: str, data: bytes) -> SideFile:
        """Write a file beside the journal, whole and synced, under a name not yet taken.

        A killed attempt may have left a file of the same name; both are kept.

        Raises
        ------
        DiskError
            If the disk refuses; no part of the file is left.
        """
        try:
            path = write_numbered(self.folder / stem, suffix, data, waits=self.waits_for_disk)
        except OSError as error:
            raise self._refused(self.folder, error) from None
        relative = path.relative_to(self.folder).as_posix()
        return SideFile(file=relative, sha256=sha256_bytes(data))

    def _refused(self, place: Path, error: OSError) -> DiskError:
        return DiskError(
            f"{place}: the disk refused a write ({error.strerror}); everything up to event"
            f" {len(self.events) - 1} is saved. Make room and 'metamerlab session resume'"
        )

    def _mend(self, journal: Journal) -> None:
        """Put an unfinished last line aside, or finish a whole one that lacks its line feed."""
        if journal.ends_open:
            self._write(b"\n")
            os.fsync(self._descriptor)
            self._length += 1
        elif journal.torn:
            self.torn_file = self.side_file("torn-line", ".txt", journal.torn).file
            self._length -= len(journal.torn)
            os.ftruncate(self._descriptor, self._length)
            os.fsync(self._descriptor)

    def _write(self, data: bytes) -> None:
        left = memoryview(data)
        while left:
            left = left[os.write(self._descriptor, left) :]


def utc_now() -> str:
    """Return the wall clock, UTC."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%f") + "Z"


def write_numbered(stem: Path, suffix: str, data: bytes, *, waits: bool = True) -> Path:
    """Write a file under a name that is free, with a number where another has it; return its path.

    `waits` is as in `protocols.disk.whole_file.write_new`.
    """
    stem.parent.mkdir(exist_ok=True)
    number = 1
    while True:
        path = stem.with_name(f"{stem.name}{f'-{number}' if number > 1 else ''}{suffix}")
        with suppress(FileExistsError):
            write_new(path, data, waits=waits)
            return path
        number += 1


@contextmanager
def journal_held(path: Path) -> Iterator[None]:
    """Hold a journal for this program, for the block.

    Raises
    ------
    StudyError
        If another program holds it, or its file system has no locks.
    """
    with held(path) as alone:
        if alone is None:
            raise StudyError(
                f"{path}: must lie where files can be locked (the file system has no locks), so"
                " that two programs never write one journal; name another folder"
            )
        if not alone:
            raise StudyError(f"{path}: another program has this session open; close it first")
        yield


def _open(path: Path, flags: int, until: ExitStack) -> int:
    descriptor = os.open(path, _APPENDING | flags, 0o644)
    until.callback(os.close, descriptor)
    return descriptor


@contextmanager
def _disk_of(folder: Path) -> Iterator[None]:
    """Say of a journal that cannot be opened whole that it is the disk that refuses."""
    try:
        yield
    except OSError as error:
        raise DiskError(
            f"{folder}: the disk refused a write ({error.strerror}); what was recorded before is"
            " saved. Make room, and try again"
        ) from None
