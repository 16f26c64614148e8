"""A screen without a monitor: Xvfb, and a window manager."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from subprocess import DEVNULL, PIPE, Popen

from protocols.display import Display
from protocols.errors import StudyError

PROGRAMS = ("Xvfb", "openbox")


def require_screen() -> None:
    """Refuse, with the cure, where no screen can be made.

    Raises
    ------
    StudyError
        Naming the missing programs.
    """
    missing = [name for name in PROGRAMS if shutil.which(name) is None]
    if missing:
        raise StudyError(
            f"--all needs a window, and with it {' and '.join(PROGRAMS)} (missing:"
            f" {', '.join(missing)}); install them ('apt-get install xvfb openbox'), or show the"
            " window on your own screen (--display FILE), or do without it (leave out --all)"
        )


@contextmanager
def virtual_screen(display: Display) -> Iterator[dict[str, str]]:
    """Start an X server of the display's size; it ends with the context.

    Yields
    ------
    dict of str to str
        What the environment of a program has that shall open its window there.

    Raises
    ------
    StudyError
        If the server does not start.
    """
    with ExitStack() as stack:
        reading, writing = os.pipe()
        command = [
            "Xvfb", "-displayfd", str(writing), "-screen", "0",
            f"{display.width_px}x{display.height_px}x24", "-nolisten", "tcp",
        ]  # fmt: skip
        server = stack.enter_context(
            Popen(command, pass_fds=(writing,), stdout=DEVNULL, stderr=PIPE, text=True)
        )
        stack.callback(server.terminate)
        os.close(writing)
        with os.fdopen(reading) as pipe:
            number = pipe.readline().strip()
        if not number:
            said = server.stderr.read() if server.stderr else ""
            raise StudyError(
                f"Xvfb must start (it said: {said.strip() or 'nothing'}); mend that, or leave out"
                " --all, which wants a window"
            )
        env = {"DISPLAY": f":{number}", "LIBGL_ALWAYS_SOFTWARE": "1"}
        manager = Popen(["openbox"], env=os.environ | env, stdout=DEVNULL, stderr=DEVNULL)
        stack.enter_context(manager)
        stack.callback(manager.terminate)
        yield env
