"""Who uses a folder at this moment: locks that the system lets go of when a program ends."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from protocols.errors import StudyError


@contextmanager
def held(folder: Path, *, shared: bool = False) -> Iterator[bool | None]:
    """Hold a folder for the block, alone or together with all who hold it `shared`.

    Nothing is written and nothing waits: the lock is on the folder itself, which may be
    read-only. A program that is killed lets go of it.

    Yields
    ------
    bool or None
        True: it is held. False: it is not, since another program holds it. None: its file
        system has no locks, and nobody can tell.

    Raises
    ------
    OSError
        If it is no folder, or cannot be read.
    """
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield _lock(handle, fcntl.LOCK_SH if shared else fcntl.LOCK_EX)
    finally:
        os.close(handle)


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
            with held(clips, shared=True) as beside_sittings:
                pass  # builds share with nobody
            raise StudyError(
                f"{clips}: must not change while a session shows its clips (one is running);"
                " build after it ends, or choose another --out"
                if beside_sittings
                else f"{clips}: another build is at work in this folder; wait for it to end, or"
                " choose another --out"
            )
        yield


@contextmanager
def kept_for_sitting(clips: Path) -> Iterator[None]:
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


def _lock(handle: int, kind: int) -> bool | None:
    try:
        fcntl.flock(handle, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True
