"""Locks on files and folders, which the system lets go of when a program ends."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import portalocker
from portalocker import LockFlags

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
