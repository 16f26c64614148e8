"""Notices what an X11 desktop puts over a window, holds its screen saver off, and notices sleep."""

from __future__ import annotations

import ctypes
import struct
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

from study_app.desktop.x11 import XServer

DO_NOT_DISTURB = (
    "turn on 'do not disturb', and screen saver and lock off, for the time of a session"
)
_HOLD_OFF_S = 5.0
"""Time between two calls that tell the desktop that somebody is there."""
_ASK_BLANK_S = 0.2
_SUBSTRUCTURE = 0x80000  # events of what lies below the root window
_WM_CLASS, _ANY = 67, 0  # predefined atoms
_VIEWABLE, _DRAWN = 2, 1
_BLANK = 1
_LEAST_SLEEP_S = 0.5

if sys.platform == "win32":

    def _behind_s() -> float:
        """Time for which one clock stood still and the other did not, and a constant."""
        hundred_ns = ctypes.c_ulonglong()
        ctypes.windll.kernel32.QueryUnbiasedInterruptTime(ctypes.byref(hundred_ns))
        return time.monotonic() - hundred_ns.value / 1e7

else:

    def _behind_s() -> float:
        """Time for which one clock stood still and the other did not, and a constant."""
        if sys.platform == "darwin":
            return time.clock_gettime(time.CLOCK_MONOTONIC) - time.monotonic()
        return time.clock_gettime(time.CLOCK_BOOTTIME) - time.monotonic()


def unnoticed(system: str, environment: Mapping[str, str], unasked: str = "") -> str:
    """Return the events of a desktop that nothing tells, and the cure; empty: all is told.

    Parameters
    ----------
    system : str
        As `window_system` returns it.
    environment : mapping
        Of this program.
    unasked : str
        Reason why an X server cannot be asked, and the cure; empty: it can.
    """
    what = "windows over the participant's and a blank screen"
    if unasked:
        return f"{what} are not noticed, nor a desktop that scales: {unasked}"
    if system == "Wayland" or environment.get("WAYLAND_DISPLAY"):
        how = "are not noticed" if system == "Wayland" else "may go unnoticed"
        return f"{what} {how} on Wayland; log in to an X11 session"
    return "" if system == "X11" else f"{what} are not noticed on {system}; {DO_NOT_DISTURB}"


class DesktopWatch:
    """Watch for windows over one of ours, and for a blank screen.

    Windows that lie there from the beginning are `accepted`: a program that lays a clear one over
    everything must not stop all sessions. Those that a desktop draws into its own picture are not
    seen: so GNOME shows its notices.

    Parameters
    ----------
    server : XServer
        Asked from here alone.
    window : int
        Ours, as the server numbers it.
    """

    def __init__(self, server: XServer, window: int) -> None:
        self._server, self._window = server, window
        self._saver = server.extension("MIT-SCREEN-SAVER")
        self._held_off_s = self._asked_s = -_HOLD_OFF_S
        server.tell(2, 0, struct.pack("=III", server.root, 0x800, _SUBSTRUCTURE))
        self._over = self._accepted = self._windows_over()
        self._blank = False

    @classmethod
    def of_window(cls, glfw: Any, window: Any) -> DesktopWatch | None:
        """Return the watch of a GLFW window; None where no X server shows it.

        Raises
        ------
        OSError
            If one does, and cannot be asked: why, and the cure.
        """
        if glfw.get_platform() != glfw.PLATFORM_X11:
            return None
        return cls(XServer(), int(glfw.get_x11_window(window)))

    def close(self) -> None:
        """Close the connection."""
        self._server.close()

    def accepted(self) -> str:
        """Return the names of windows that lay over ours from the beginning."""
        return ", ".join(sorted(set(self._accepted.values())))

    def poll(self) -> str:
        """Return the disturbance between participant and window now; empty: none."""
        now_s = time.monotonic()
        if self._saver and now_s - self._asked_s >= _ASK_BLANK_S:
            self._asked_s = now_s
            root = struct.pack("=I", self._server.root)
            self._blank = self._server.ask(self._saver, 1, root)[1:2] == bytes([_BLANK])
        if self._blank or now_s - self._held_off_s >= _HOLD_OFF_S:
            self._held_off_s = now_s
            self._server.tell(115, 0)  # ForceScreenSaver, reset: every idle clock starts anew
        if self._server.events():
            self._over = self._windows_over()
            self._accepted = {n: self._over[n] for n in self._accepted if n in self._over}
        if self._blank:
            return "the screen saver was on"
        names = {name for number, name in self._over.items() if number not in self._accepted}
        return f"a window lay over the participant's: {', '.join(sorted(names))}" if names else ""

    def _windows_over(self) -> dict[int, str]:
        """Return the windows that lie over ours, with their names."""
        top, (parent, children) = self._window, self._tree(self._window)
        while parent not in (0, self._server.root):  # window managers put frames around windows
            top, (parent, _) = parent, self._tree(parent)
        _, children = self._tree(self._server.root)
        if top not in children:
            return {}
        left, up, right, down = self._box(top)
        over = {}
        for other in children[children.index(top) + 1 :]:
            x0, y0, x1, y1 = self._box(other)
            if x0 < right and left < x1 and y0 < down and up < y1 and self._is_drawn(other):
                over[other] = self._name(other)
        return over

    def _tree(self, window: int) -> tuple[int, tuple[int, ...]]:
        """Return a window's parent and its children, lowest first; 0 and none: it is gone."""
        reply = self._server.ask(15, 0, struct.pack("=I", window))
        if not reply:
            return 0, ()
        parent, count = struct.unpack_from("=IH", reply, 12)
        return parent, struct.unpack_from(f"={count}I", reply, 32)

    def _box(self, window: int) -> tuple[int, int, int, int]:
        """Return left, top, right and bottom of a window below the root; none: it is gone."""
        reply = self._server.ask(14, 0, struct.pack("=I", window))
        if not reply:
            return 0, 0, 0, 0
        x, y, width, height, border = struct.unpack_from("=hhHHH", reply, 12)
        return x, y, x + width + 2 * border, y + height + 2 * border

    def _is_drawn(self, window: int) -> bool:
        """Return True if a window can be seen, but for the layer that a compositor draws in."""
        reply = self._server.ask(3, 0, struct.pack("=I", window))
        return bool(reply) and reply[26] == _VIEWABLE and reply[12:14] == struct.pack("=H", _DRAWN)

    def _name(self, window: int) -> str:
        """Return the name of the program that a window belongs to, as it says itself."""
        _, children = self._tree(window)
        for each in (window, *children):
            reply = self._server.ask(20, 0, struct.pack("=IIIII", each, _WM_CLASS, _ANY, 0, 64))
            if reply and (length := struct.unpack_from("=I", reply, 16)[0]):
                return reply[32 : 32 + length].split(b"\0")[0].decode("latin-1")
        return "one without a name"


class SleepWatch:
    """Compares two clocks that part only while the machine sleeps.

    Neither is the wall clock: setting that one is no sleep.
    """

    def __init__(self, behind_s: Callable[[], float] = _behind_s) -> None:
        self._behind_s, self._apart_s = behind_s, behind_s()

    def slept_s(self) -> float:
        """Return for how long the machine slept since the last call; 0: it did not."""
        apart_s = self._behind_s()
        slept_s = apart_s - self._apart_s
        if slept_s < _LEAST_SLEEP_S:
            return 0.0
        self._apart_s = apart_s
        return slept_s
