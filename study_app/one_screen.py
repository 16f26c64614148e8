"""One window per desktop: two would take keyboard and refreshes from each other."""

from __future__ import annotations

import errno
import hashlib
import os
import socket

from protocols.errors import StudyError


def claim_screen() -> socket.socket:
    """Hold this desktop's screens until the socket is closed, or the program dies.

    The name is one of Linux's abstract sockets: there is no file that a killed program leaves.

    Raises
    ------
    StudyError
        If another program of ours holds them.
    """
    screens = "|".join(os.environ.get(name, "") for name in ("WAYLAND_DISPLAY", "DISPLAY"))
    key = hashlib.sha256(screens.encode("utf-8", "surrogateescape")).hexdigest()[:16]
    held = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        held.bind(f"\0metamerlab-screen-{key}")
    except OSError as error:
        held.close()
        if error.errno == errno.EADDRINUSE:
            raise StudyError(
                "only one window of metamerlab may be open on a desktop (a session or a check of"
                " the display is open there): its participant would lose the keyboard; end it first"
            ) from None
        raise
    return held
