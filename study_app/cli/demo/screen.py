"""A screen without a monitor: Xvfb, whose picture lies in a file, and a window manager."""

from __future__ import annotations

import mmap
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from protocols.display import Display
from protocols.errors import StudyError

PROGRAMS = ("Xvfb", "openbox")
_START_S = 20.0


@dataclass(frozen=True)
class VirtualScreen:
    """A running X server and its picture."""

    name: str
    """For the variable DISPLAY."""
    pixels: NDArray[np.uint8]
    """What stands on the screen now, shape (height, width, 4), blue first; shared, read-only."""

    @property
    def env(self) -> dict[str, str]:
        """The environment of a program that shall open its window there."""
        return {**os.environ, "DISPLAY": self.name, "LIBGL_ALWAYS_SOFTWARE": "1"}


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
def virtual_screen(display: Display) -> Iterator[VirtualScreen]:
    """Start an X server of the display's size; it ends with the context.

    Raises
    ------
    StudyError
        If the programs are missing or the server does not start.
    """
    require_screen()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="metamerlab-screen-")))
        reading, writing = os.pipe()
        command = [
            "Xvfb", "-displayfd", str(writing), "-screen", "0",
            f"{display.width_px}x{display.height_px}x24", "-fbdir", str(folder),
            "-nolisten", "tcp",
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
        screen = VirtualScreen(f":{number}", _pixels(folder / "Xvfb_screen0"))
        manager = subprocess.Popen(
            ["openbox"], env=screen.env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        stack.callback(_end, manager)
        yield screen


def _pixels(path: Path) -> NDArray[np.uint8]:
    """Map the frame buffer file, an X window dump: big-endian header, colours, pixels."""
    until_s = time.monotonic() + _START_S
    while not path.exists() or path.stat().st_size < 100:
        if time.monotonic() > until_s:
            raise StudyError("Xvfb must write its picture into a file (it wrote none)")
        time.sleep(0.05)
    with path.open("rb") as file:
        memory = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    header = np.frombuffer(memory, ">u4", 25)
    width, height, bits, line = (int(header[place]) for place in (4, 5, 11, 12))
    if bits != 32 or line != 4 * width:
        raise StudyError(f"Xvfb must keep 32 bits per pixel (got {bits})")
    start = int(header[0]) + 12 * int(header[19])
    return np.frombuffer(memory, np.uint8, 4 * width * height, start).reshape(height, width, 4)


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(timeout=10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stderr:
        process.stderr.close()
