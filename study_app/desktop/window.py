"""The window: full screen on the named monitor, its flips with their stamps, keys, gamepad.

GLFW's events carry no time stamps: a key is stamped when it is polled, and it is polled at least
once per refresh.
"""

from __future__ import annotations

import errno
import hashlib
import math
import os
import socket
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO, NamedTuple

import glfw
import moderngl

from pipeline.errors import GLUnavailableError
from pipeline.gl.context import adopt_context
from protocols.disk.locks import lock
from protocols.display import Display
from protocols.errors import StudyError
from protocols.study_file.session_schema import POINTER
from study_app.desktop.desktop_watch import DesktopWatch, SleepWatch, unnoticed
from study_app.desktop.keys import Gamepad, key_name
from study_app.desktop.monitor import (
    check_mode,
    choose_monitor,
    enlargement,
    plain_text,
    start_glfw,
    window_system,
)
from study_app.desktop.vsync import Evidence, SyncValues
from study_app.pacing import Pacing
from study_app.stage import KeyPress

_NO_KEYBOARD = "another window took the keyboard"
_SETTLE_S = 5.0
"""Longest time that a window manager may take to make the window cover the screen."""


class FlipStamp(NamedTuple):
    """Time of a flip, and the evidence for it."""

    t_s: float
    evidence: Evidence


class Window:
    """A full-screen window with a context of OpenGL 3.3 or newer, current in this thread.

    Parameters
    ----------
    display : Display
        What must be there: resolution, rate and, where it names one, the monitor.
    pacing : {"vsync", "software"}
        `vsync`: the swap waits for the display. `software`: a timer stands in for a display
        without vertical synchronisation; for rehearsals and tests, and recorded as such.

    Raises
    ------
    StudyError
        If there is no screen, no such monitor, the mode is another one, or no OpenGL 3.3.
    """

    def __init__(self, display: Display, *, pacing: Pacing = "vsync") -> None:
        self.display, self.pacing = display, pacing
        self._presses: list[KeyPress] = []
        self._typed: list[str] = []
        self._closing, self._is_open = False, False
        self._focused, self._disturbance = False, ""
        self._sleep = SleepWatch()
        self._desktop: DesktopWatch | None = None
        self._line_s = -math.inf  # software pacing: the grid line of the flip before
        self._last_s = -math.inf
        self._claim = claim_screen()
        try:
            start_glfw()
            self._open(display)
        except BaseException:
            glfw.terminate()
            self._claim.close()
            raise

    def _open(self, display: Display) -> None:
        monitor = choose_monitor(display)
        mode = glfw.get_video_mode(monitor)
        check_mode(
            display,
            mode.size.width,
            mode.size.height,
            float(mode.refresh_rate),
            enlargement(monitor),
        )
        self.monitor_name = plain_text(glfw.get_monitor_name(monitor))
        self.monitor_mm: tuple[int, int] = glfw.get_monitor_physical_size(monitor)
        self.mode_hz = float(mode.refresh_rate)
        x, y = glfw.get_monitor_pos(monitor)
        self._begins = int(x), int(y)
        self._hint(mode.refresh_rate)
        self._handle = glfw.create_window(*self.size, "metamerlab", monitor, None)
        if not self._handle:
            reason = plain_text(glfw.get_error()[1]) or "no reason given"
            raise StudyError(
                f"a window with OpenGL 3.3 must open (found: {reason}); install a driver"
                " with OpenGL 3.3, or run 'metamerlab doctor'"
            )
        self._is_open = True
        glfw.make_context_current(self._handle)
        glfw.swap_interval(1 if self.pacing == "vsync" else 0)
        try:
            self.ctx: moderngl.Context = adopt_context()
        except GLUnavailableError as error:
            raise StudyError(str(error)) from error
        self._await_full_screen()
        self.ctx.screen.use()
        self._sync = SyncValues.of_window(glfw, self._handle) if self.pacing == "vsync" else None
        self._listen()
        glfw.set_input_mode(self._handle, glfw.CURSOR, glfw.CURSOR_HIDDEN)
        self._cursor_shown = False
        self._cursor_kept: bool | None = None
        self._gamepad = Gamepad(glfw)
        self.take_focus()
        self._await_full_screen()  # what came with the focus may have resized it once more
        self._size, self._place = self.size, self._begins
        unasked = ""
        try:
            self._desktop = DesktopWatch.of_window(glfw, self._handle)
        except OSError as error:
            unasked = str(error)
        self.unnoticed = unnoticed(window_system(), os.environ, unasked)
        """Events of a desktop that nothing tells, and the cure; empty: all are told."""

    def _hint(self, refresh_hz: int) -> None:
        """Ask for the properties of the next window."""
        for hint, value in (
            (glfw.CONTEXT_VERSION_MAJOR, 3),  # at least: drivers give the newest they have
            (glfw.CONTEXT_VERSION_MINOR, 3),
            (glfw.OPENGL_PROFILE, glfw.OPENGL_CORE_PROFILE),
            (glfw.OPENGL_FORWARD_COMPAT, True),
            (glfw.DOUBLEBUFFER, True),
            (glfw.RED_BITS, 8),
            (glfw.GREEN_BITS, 8),
            (glfw.BLUE_BITS, 8),
            (glfw.SAMPLES, 0),
            (glfw.SRGB_CAPABLE, False),
            (glfw.AUTO_ICONIFY, False),
            (glfw.REFRESH_RATE, refresh_hz or glfw.DONT_CARE),
            # Some window managers cover the monitor that the window lies on, not the one asked for.
            (glfw.POSITION_X, self._begins[0]),
            (glfw.POSITION_Y, self._begins[1]),
        ):
            glfw.window_hint(hint, value)

    def _listen(self) -> None:
        glfw.set_key_callback(self._handle, self._on_key)
        glfw.set_char_callback(self._handle, self._on_char)
        glfw.set_window_focus_callback(self._handle, self._on_focus)
        glfw.set_window_close_callback(self._handle, self._on_close)
        glfw.set_framebuffer_size_callback(self._handle, self._on_size)
        glfw.set_window_pos_callback(self._handle, self._on_place)
        glfw.set_mouse_button_callback(self._handle, self._on_button)

    def __enter__(self) -> Window:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the window; safe to call twice."""
        if self._is_open:
            self._is_open = False
            if self._desktop:
                self._desktop.close()
            glfw.destroy_window(self._handle)
            glfw.terminate()
            self._claim.close()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.display.width_px, self.display.height_px

    @property
    def evidence(self) -> Evidence:
        """Evidence for flip stamps, as far as is known before any was measured."""
        if self.pacing == "software":
            return "software timer"
        return "glXGetSyncValuesOML" if self._sync else "fence"

    def now(self) -> float:
        """Return the session's clock: monotonic, in seconds."""
        return time.monotonic()

    def flip(self) -> FlipStamp:
        """Swap, wait until it happened, and return its stamp."""
        if self.pacing == "software":
            self._wait_for_line()
        glfw.swap_buffers(self._handle)
        stamp = FlipStamp(0.0, self.evidence)
        exact_s = self._sync.last_swap_s() if self._sync else None
        self.ctx.finish()
        if exact_s is not None and abs(self.now() - exact_s) < 1.0:
            stamp = FlipStamp(exact_s, "glXGetSyncValuesOML")
        elif self.pacing == "vsync":
            stamp = FlipStamp(self.now(), "fence")
        else:
            stamp = FlipStamp(self.now(), "software timer")
        # Two clocks never run backwards against each other in one log.
        self._last_s = max(stamp.t_s, self._last_s)
        self.poll()
        return FlipStamp(self._last_s, stamp.evidence)

    def pump_until(self, t_s: float) -> None:
        """Take events as they come, until the clock reads `t_s`."""
        while (left_s := t_s - self.now()) > 0:
            glfw.wait_events_timeout(left_s)
            self._gamepad.poll(self.press)

    def poll(self) -> None:
        """Take what events there are."""
        glfw.poll_events()
        self._gamepad.poll(self.press)
        if self._desktop and (between := self._desktop.poll()):
            self._disturbance = between
        if (slept_s := self._sleep.slept_s()) > 0:
            self._disturbance = f"the machine slept for {slept_s:.0f} s"

    def key_presses(self) -> Sequence[KeyPress]:
        """Return the keys that went down since the last call, oldest first."""
        presses, self._presses = self._presses, []
        return presses

    def typed(self) -> str:
        """Return the characters typed since the last call; a backspace is ``\\b``."""
        text, self._typed = "".join(self._typed), []
        return text

    def press(self, key: str) -> None:
        """Let a key go down now, as an artificial observer or a signal does too."""
        self._presses.append(KeyPress(key, self.now()))

    def closing(self) -> bool:
        """Return, once, whether someone asked the window to close."""
        asked, self._closing = self._closing, False
        return asked

    def disturbed(self) -> str:
        """Return the disturbance between participant and window, now or since the last call.

        Empty: nothing. Another window has the keyboard or lies over ours, the screen is blank, the
        machine slept, the monitor is gone.
        """
        before, self._disturbance = self._disturbance, ""
        return self._display_lost() or before or ("" if self._focused else _NO_KEYBOARD)

    def lies_under(self) -> str:
        """Return the names of windows that lay over ours when it opened; they disturb nothing."""
        return self._desktop.accepted() if self._desktop else ""

    def require_display(self) -> None:
        """Refuse to go on where nobody sees the whole window any more.

        Raises
        ------
        StudyError
            If the monitor is gone, or the window has another size.
        """
        if lost := self._display_lost():
            raise StudyError(
                f"display {self.display.name!r}: {lost}; everything up to here is saved. Put the"
                " display in order, then run 'metamerlab session resume'"
            )

    def _display_lost(self) -> str:
        if not glfw.get_window_monitor(self._handle):  # GLFW takes it from a window with it
            return "the monitor was disconnected"
        if self._size != self.size:
            return f"the window has {self._size[0]}x{self._size[1]} pixels now"
        if self._place != self._begins:
            return f"the window lies at {self._place[0]}, {self._place[1]} of the desktop now"
        return ""

    def cursor_px(self) -> tuple[float, float]:
        """Return the mouse, from the upper left corner of the screen."""
        x, y = glfw.get_cursor_pos(self._handle)
        return float(x), float(y)

    def held_down(self) -> bool:
        """Return True if the left button of the mouse is down."""
        return bool(glfw.get_mouse_button(self._handle, glfw.MOUSE_BUTTON_LEFT) == glfw.PRESS)

    def show_cursor(self, shown: bool, *, stays: bool = False) -> None:
        """Show the mouse or hide it; it `stays` so, whatever is asked later.

        It stays in sight where it stands in for an eye, and hidden where a tracker sees one.
        """
        if stays:
            self._cursor_kept = shown
        if self._cursor_kept is not None:
            shown = self._cursor_kept
        if shown != self._cursor_shown:
            mode = glfw.CURSOR_NORMAL if shown else glfw.CURSOR_HIDDEN
            glfw.set_input_mode(self._handle, glfw.CURSOR, mode)
            self._cursor_shown = shown

    def _await_full_screen(self) -> None:
        """Let the window manager make the window cover the screen; it may show a frame before."""
        wanted, name = self.size, f"display {self.display.name!r}"
        until_s = self.now() + _SETTLE_S
        while (size := glfw.get_framebuffer_size(self._handle)) != wanted or not self._is_there():
            if self.now() < until_s:
                glfw.wait_events_timeout(0.02)
            elif size != wanted:
                raise StudyError(
                    f"{name}: the window must have {wanted[0]}x{wanted[1]} pixels (got {size[0]}x"
                    f"{size[1]}); turn desktop scaling off"
                )
            else:
                raise StudyError(
                    f"{name}: the window must cover the monitor {self.monitor_name} (the window"
                    " manager put it elsewhere); switch the other monitors off, or use another"
                    " window manager"
                )

    def _is_there(self) -> bool:
        """Return True if the window begins where its monitor does; only X11 is asked."""
        if glfw.get_platform() != glfw.PLATFORM_X11:
            return True
        return tuple(glfw.get_window_pos(self._handle)) == self._begins

    def take_focus(self) -> None:
        """Ask for the keyboard again."""
        glfw.focus_window(self._handle)
        until_s = self.now() + 2.0
        while not glfw.get_window_attrib(self._handle, glfw.FOCUSED) and self.now() < until_s:
            glfw.wait_events_timeout(0.02)
        self._focused = bool(glfw.get_window_attrib(self._handle, glfw.FOCUSED))
        self._disturbance = ""

    def _wait_for_line(self) -> None:
        period_s = 1.0 / self.display.refresh_hz
        now_s = self.now()
        if now_s - self._line_s > 100 * period_s:  # after a pause the grid starts anew
            self._line_s = now_s
            return
        late = math.ceil((now_s - self._line_s) / period_s)
        self._line_s += max(1, late) * period_s
        self.pump_until(self._line_s)

    def _on_key(self, _window: object, key: int, scancode: int, action: int, _mods: int) -> None:
        if key == glfw.KEY_BACKSPACE and action != glfw.RELEASE:
            self._typed.append("\b")  # in its place among the characters
        if action == glfw.PRESS and (name := key_name(glfw, key, scancode)):
            self.press(name)

    def _on_button(self, _window: object, button: int, action: int, _mods: int) -> None:
        if action == glfw.PRESS and button == glfw.MOUSE_BUTTON_LEFT:
            at = self.cursor_px()[0] / self.display.width_px
            self._presses.append(KeyPress(POINTER, self.now(), at))

    def _on_char(self, _window: object, codepoint: int) -> None:
        self._typed.append(chr(codepoint))

    def _on_focus(self, _window: object, focused: int) -> None:
        self._focused = bool(focused)
        if not focused:
            self._disturbance = self._disturbance or _NO_KEYBOARD

    def _on_size(self, _window: object, width: int, height: int) -> None:
        self._size = width, height

    def _on_place(self, _window: object, x: int, y: int) -> None:
        self._place = x, y

    def _on_close(self, _window: object) -> None:
        glfw.set_window_should_close(self._handle, False)
        self._closing = True


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
