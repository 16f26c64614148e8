"""One window per desktop: two would take keyboard and refreshes from each other."""

from __future__ import annotations

import errno
import hashlib
import os
import socket
import sys
import tempfile
from pathlib import Path
from typing import IO

from protocols.disk.locks import lock
from protocols.errors import StudyError


def claim_screen() -> socket.socket | IO[bytes]:
    """Hold this desktop's screens until the claim is closed, or the program dies.

    Raises
    ------
    StudyError
        If another program of ours holds them.
    """
    screens = "|".join(os.environ.get(name, "") for name in ("WAYLAND_DISPLAY", "DISPLAY"))
    key = hashlib.sha256(screens.encode("utf-8", "surrogateescape")).hexdigest()[:16]
    name = f"metamerlab-screen-{key}"
    claim: socket.socket | IO[bytes] | None
    if sys.platform == "linux":
        claim = _bound(socket.AF_UNIX, f"\0{name}")  # abstract: a killed program leaves no file
    else:
        claim = _locked(Path(tempfile.gettempdir()) / f"{name}.lock")
    if claim is None:
        raise StudyError(
            "only one window of metamerlab may be open on a desktop (a session or a check of"
            " the display is open there): its participant would lose the keyboard; end it first"
        )
    return claim


def _bound(family: int, address: str) -> socket.socket | None:
    held = socket.socket(family, socket.SOCK_STREAM)
    try:
        held.bind(address)
    except OSError as error:
        held.close()
        if error.errno == errno.EADDRINUSE:
            return None
        raise
    return held


def _locked(path: Path) -> IO[bytes] | None:
    """Lock a file of this user, which stays; a program that is killed lets go of it."""
    file = path.open("ab")
    if lock(file.fileno()) is False:
        file.close()
        return None
    return file
