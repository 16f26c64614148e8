"""Locks, which the system lets go of when a program ends, and files that killed ones left."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import portalocker
import psutil
from portalocker import LockFlags

from protocols.disk.whole_file import remove
from protocols.errors import StudyError

_LOCKS_LET_READ = os.name == "posix"  # elsewhere what is locked cannot be read, nor a folder locked


@contextmanager
def held(path: Path, *, shared: bool = False) -> Iterator[bool | None]:
    """Hold a file or folder for the block, alone or together with all who hold it `shared`.

    Nothing waits. Linux and macOS lock it itself, and nothing is written: a folder may be
    read-only. Windows locks an empty file beside it, ``.NAME.lock``, which goes with the lock.
    A program that is killed lets go of it.

    Yields
    ------
    bool or None
        True: it is held. False: it is not, since another program holds it. None: its file
        system has no locks, and nobody can tell.

    Raises
    ------
    OSError
        If it does not exist, or cannot be opened.
    """
    if _LOCKS_LET_READ:
        handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
        beside = None
    else:
        place = path.resolve(strict=True)
        beside = place.with_name(lock_name(place.name))
        handle = os.open(beside, os.O_CREAT | os.O_RDWR, 0o644)
    taken = None
    try:
        taken = lock(handle, shared=shared)
        yield taken
    finally:
        os.close(handle)
        if beside is not None and taken:
            with suppress(OSError):  # another program has it open
                beside.unlink()


def lock_name(name: str) -> str:
    """Return the name of the file that stands for a lock where files cannot be locked to write."""
    return f".{name}.lock"


def lock(handle: int, *, shared: bool = False, waits: bool = False) -> bool | None:
    """Lock an open file or folder until it is closed; as `held` says, unless it `waits`."""
    kind = LockFlags.SHARED if shared else LockFlags.EXCLUSIVE
    try:
        portalocker.lock(handle, kind if waits else kind | LockFlags.NON_BLOCKING)
    except portalocker.AlreadyLocked:
        return False
    except portalocker.LockException:
        return None
    return True


@contextmanager
def only_build(clips: Path) -> Iterator[None]:
    """Hold a folder of clips for one build.

    Raises
    ------
    StudyError
        If another build is at work in it, or sessions show its clips.
    """
    with held(clips) as alone:
        if alone is False:
            with held(clips, shared=True) as beside_sessions:
                pass  # builds share with nobody
            raise StudyError(
                f"{clips}: must not change while a session shows its clips (one is running);"
                " build after it ends, or choose another --out"
                if beside_sessions
                else f"{clips}: another build is at work in this folder; wait for it to end, or"
                " choose another --out"
            )
        yield


@contextmanager
def kept_for_session(clips: Path) -> Iterator[None]:
    """Keep builds out of a folder of clips; any number of sessions may do so at once.

    Raises
    ------
    StudyError
        If a build is at work in it.
    """
    if not clips.is_dir():  # told by who reads its manifest
        yield
        return
    with held(clips, shared=True) as kept:
        if kept is False:
            raise StudyError(
                f"{clips}: must be finished before a session shows its clips (a build is at work in"
                " this folder); wait for it to end"
            )
        yield


_WRITING = re.compile(
    r"\.(?P<name>.+)\.(?P<process>[0-9]+)\.part"
    r"|\.(?P<stem>.+)\.(?P<other>[0-9]+)\.(?:tmp|part)(?P<ending>\.[a-z]+)"
)


def written(name: str) -> tuple[str, int] | None:
    """Return the file that is written under a name, and by which process; None: no such name.

    Files are written as ``.NAME.PID.part`` or, by a library that goes by endings, as
    ``.STEM.PID.tmp.png``.
    """
    found = _WRITING.fullmatch(name)
    if found is None:
        return None
    file = found["name"] or found["stem"] + found["ending"]
    return file, int(found["process"] or found["other"])


def is_gone(process: int) -> bool:
    """Return True if no other process here has this number."""
    # Who asks has not begun to write.
    return process == os.getpid() or not psutil.pid_exists(process)


def clear_files(path: Path) -> None:
    """Remove what killed programs left of one file, which is about to be written again."""
    for entry in list(path.parent.iterdir()) if path.parent.is_dir() else ():
        file, process = written(entry.name) or ("", 0)
        if file == path.name and entry.is_file() and not entry.is_symlink() and is_gone(process):
            remove(entry)
