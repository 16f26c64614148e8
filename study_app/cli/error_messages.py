"""A user's mistake becomes one message and exit status 2, never a traceback."""

from __future__ import annotations

import errno
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import typer

from protocols.errors import UserError
from protocols.plugins import culprit
from study_app.cli.terminal import say

EXIT_USER_ERROR = 2
_LINE_MOST, _LINES_MOST = 1500, 200
"""Characters and lines of a message: no file makes it longer than a screen or two."""

_CURES = {
    errno.ENOENT: "check the path",
    errno.ENOTDIR: "a part of this path is a file, not a folder",
    errno.EISDIR: "a file is needed here, not a folder",
    errno.EACCES: "change its permissions, or choose another place",
    errno.EPERM: "change its permissions, or choose another place",
    errno.EBUSY: "close it there, or change its permissions, and run this again",
    errno.EROFS: "choose a place that can be written to",
    errno.EEXIST: "choose another name, or remove it first",
    errno.ENOTEMPTY: "choose another folder, or empty it first",
    errno.ELOOP: "its symbolic links lead in a circle; name the file itself",
    errno.ENAMETOOLONG: "choose a shorter name",
    errno.ENOSPC: "free some space on this disk, or choose another one",
    errno.EDQUOT: "your quota on this disk is used up; free some space, or choose another one",
    errno.EFBIG: "this disk cannot hold files of this size; choose another one",
    errno.EIO: "the disk failed; check its cable and its health before you continue",
}


@contextmanager
def user_errors() -> Iterator[None]:
    """Turn what the user can mend into one message on stderr and exit status 2.

    That is: every `UserError`, an `OSError` about a file or a disk of the user's, memory that is
    used up, and whatever a plug-in raises.
    Anything else is a bug of ours and keeps its traceback.
    """
    try:
        yield
    except UserError as error:
        message = str(error)
    except OSError as error:
        # A full or failing disk says so on write, where no name is at hand.
        nameless = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
        if error.errno not in (nameless if error.filename is None else _CURES):
            raise
        where = "" if error.filename is None else f"{error.filename}: "
        message = f"{where}{(error.strerror or 'failed').lower()}; {_CURES[error.errno or 0]}"
    except MemoryError as error:
        message = (
            f"this must fit into the machine's memory ({error or 'there is none left'}); use"
            " smaller pictures or fewer rows, close other programs, or take a machine that has more"
        )
    except BaseException as error:
        said = None if isinstance(error, KeyboardInterrupt) else culprit(error)
        if said is None:
            raise
        message = said
    else:
        return
    # Outside the handlers, so that no chain of exceptions hangs on the exit.
    say("error: " + shortened_message(message).replace("\n", "\n       "), file=sys.stderr)
    raise typer.Exit(EXIT_USER_ERROR)


def shortened_message(message: str) -> str:
    """Return a message without the middles of endless lines, and without endless lists."""
    lines = [_shortened(line) for line in message.split("\n")]
    if len(lines) > _LINES_MOST:
        lines[_LINES_MOST:] = [f"... and {len(lines) - _LINES_MOST} more"]
    return "\n".join(lines)


def _shortened(line: str) -> str:
    """Leave the middle of a very long line out: a cell of a file may hold a megabyte."""
    left_out = len(line) - _LINE_MOST
    if left_out <= 0:
        return line
    half = _LINE_MOST // 2
    return f"{line[:half]} [{left_out} more characters] {line[-half:]}"
