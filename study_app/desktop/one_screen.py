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
    if sys.platform == "linux":
        held = socket.socket(socket.AF_UNIX)
        try:
            held.bind(f"\0{name}")  # abstract: a killed program leaves no file
            return held
        except OSError as error:
            held.close()
            if error.errno != errno.EADDRINUSE:
                raise
    else:  # a file of this user, which stays; a program that is killed lets go of it
        file = (Path(tempfile.gettempdir()) / f"{name}.lock").open("ab")
        if lock(file.fileno()) is not False:
            return file
        file.close()
    raise StudyError(
        "only one window of metamerlab may be open on a desktop (a session or a check of"
        " the display is open there): its participant would lose the keyboard; end it first"
    )
