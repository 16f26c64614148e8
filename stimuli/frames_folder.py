"""A folder that a command fills with the frames of one clip: all of them, or none."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.errors import InputError
from stimuli.whole_file import PART


@contextmanager
def frames_folder(out: Path) -> Iterator[Path]:
    """Give a folder within `out` to write to; when all went well, its frames appear in `out`.

    Whatever is raised within, nothing is left behind.

    Raises
    ------
    InputError
        If `out` is a file, or holds anything: old frames among new ones look like one clip.
    """
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: must be a folder, as the frames lie in one (it is a file)")
    held = min(out.iterdir(), default=None) if out.exists() else None
    if held is not None:
        left = ", of a command that was stopped or still runs" if held.suffix == PART else ""
        raise InputError(
            f"{out}: must be empty or new, as it is to hold the frames of one clip (it holds"
            f" {held.name}{left}); choose another folder, or empty it"
        )
    is_new = not out.exists()
    part = out / f".{os.getpid()}{PART}"
    part.mkdir(parents=True)
    try:
        yield part
        for frame in sorted(part.iterdir()):
            frame.rename(out / frame.name)
        part.rmdir()
    except BaseException:
        shutil.rmtree(out if is_new else part, ignore_errors=True)
        raise
