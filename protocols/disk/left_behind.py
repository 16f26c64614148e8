"""Files that killed programs left half-written, and whether they may go."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from pathlib import Path

import psutil

from protocols.disk.locks import held
from protocols.disk.whole_file import remove

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


def clear_folders(folder: Path, endings: tuple[str, ...]) -> None:
    """Remove what killed programs left in a folder: ``.PID.part`` with files of these endings."""
    for entry in list(folder.iterdir()) if folder.is_dir() else ():
        found = re.fullmatch(r"\.([0-9]+)\.part", entry.name)
        if found and not entry.is_symlink() and is_gone(int(found[1])):
            with suppress(OSError), held(entry) as stale:  # gone meanwhile, or no folder
                if stale:
                    remove_files(entry, endings)


def remove_files(folder: Path, endings: tuple[str, ...]) -> None:
    """Remove files with these endings from a folder, and the folder where it held no other."""
    for entry in list(folder.iterdir()):
        if entry.suffix in endings and entry.is_file() and not entry.is_symlink():
            remove(entry)
    with suppress(OSError):  # not empty
        folder.rmdir()
