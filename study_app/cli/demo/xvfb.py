"""A screen without a monitor: Xvfb, and a window manager."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

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
            f"one observer needs a window, and with it {' and '.join(PROGRAMS)} (missing:"
            f" {', '.join(missing)}); install them ('apt-get install xvfb openbox'), or show the"
            " window on your own screen (--display FILE), or do without it (--no-window)"
        )


@contextmanager
def virtual_screen(display: Display) -> Iterator[dict[str, str]]:
    """Start an X server of the display's size; it ends with the context.

    Yields
    ------
    dict of str to str
        The environment of a program that shall open its window there.

    Raises
    ------
    StudyError
        If the programs are missing or the server does not start.
    """
    require_screen()
    with ExitStack() as stack:
        reading, writing = os.pipe()
        command = [
            "Xvfb", "-displayfd", str(writing), "-screen", "0",
            f"{display.width_px}x{display.height_px}x24", "-nolisten", "tcp",
        ]  # fmt: skip
        server = subprocess.Popen(
            command, pass_fds=(writing,), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )
        stack.callback(_end, server)
        os.close(writing)
        with os.fdopen(reading) as pipe:
            number = pipe.readline().strip()
        if not number:
            said = server.stderr.read().decode("utf-8", "replace") if server.stderr else ""
            raise StudyError(
                f"Xvfb must start (it said: {said.strip() or 'nothing'}); mend that, or leave the"
                " window out with --no-window"
            )
        env = {**os.environ, "DISPLAY": f":{number}", "LIBGL_ALWAYS_SOFTWARE": "1"}
        manager = subprocess.Popen(
            ["openbox"], env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        stack.callback(_end, manager)
        yield env


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(timeout=10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stderr:
        process.stderr.close()
