"""Monitor that a display file names, and check of the mode that the file states."""

from __future__ import annotations

import ctypes
import os
from contextlib import closing, suppress
from typing import TypeAlias

import glfw

from protocols.display import COMMON_PITCH_MM, Display
from protocols.errors import StudyError
from study_app.desktop.x11 import XServer

Monitor: TypeAlias = "ctypes._Pointer[glfw._GLFWmonitor]"
DISTANCE_MM = 600.0
"""Distance of an eye of which nothing is said."""
LEAST_PITCH_MM, MOST_PITCH_MM = 0.05, 2.0
RATE_SLACK_HZ = 1.0
"""Video modes name whole hertz: 59.94 Hz is called 59 or 60."""


def start_glfw() -> None:
    """Reach the desktop.

    Raises
    ------
    StudyError
        If there is none.
    """
    glfw.ERROR_REPORTING = "ignore"
    if not glfw.init():
        raise StudyError(
            f"the window needs a screen (found none: DISPLAY={os.environ.get('DISPLAY', '')!r});"
            " start it from the desktop of the machine that the display is connected to"
        )


def window_system() -> str:
    """Return the system that shows GLFW's windows, once GLFW is started."""
    return {
        glfw.PLATFORM_X11: "X11",
        glfw.PLATFORM_WAYLAND: "Wayland",
        glfw.PLATFORM_WIN32: "Windows",
        glfw.PLATFORM_COCOA: "macOS",
    }.get(glfw.get_platform(), "an unknown system")


def monitor_display() -> Display:
    """Return the primary monitor in the mode that it is in, from `DISTANCE_MM`.

    Its millimetres are what it states, or those of a common screen where that cannot be.
    """
    start_glfw()
    try:
        if (monitor := glfw.get_primary_monitor()) is None:
            raise StudyError("a monitor must be connected (found none)")
        mode, stated_mm = glfw.get_video_mode(monitor), glfw.get_monitor_physical_size(monitor)
    finally:
        glfw.terminate()
    width, height = mode.size.width, mode.size.height
    pitches = stated_mm[0] / width, stated_mm[1] / height
    fits = all(LEAST_PITCH_MM <= pitch <= MOST_PITCH_MM for pitch in pitches)
    across, down = pitches if fits else (COMMON_PITCH_MM, COMMON_PITCH_MM)
    return Display(
        name="monitor" if fits else "common-monitor", width_px=width, height_px=height,
        width_mm=across * width, height_mm=down * height, distance_mm=DISTANCE_MM,
        refresh_hz=mode.refresh_rate or 60.0,
    )  # fmt: skip


def choose_monitor(display: Display) -> Monitor:
    """Return the monitor a display file names, or the primary one.

    Raises
    ------
    StudyError
        If no monitor has that name; it lists those that are there.
    """
    monitors = glfw.get_monitors()
    names = [plain_text(glfw.get_monitor_name(monitor)) for monitor in monitors]
    if not monitors:
        raise StudyError("a monitor must be connected (found none)")
    if not display.monitor:
        return glfw.get_primary_monitor()
    if display.monitor not in names:
        raise StudyError(
            f"display {display.name!r}: monitor {display.monitor!r} must be connected (found"
            f" {', '.join(names)}); connect it, or correct 'monitor' in the display file"
        )
    return monitors[names.index(display.monitor)]


def enlargement(monitor: Monitor) -> float:
    """Return the desktop's pixels that an X server draws on one of the monitor; 1: no scaling.

    GLFW does not say it.
    """
    place, mode = glfw.get_monitor_pos(monitor), glfw.get_video_mode(monitor)
    if glfw.get_platform() == glfw.PLATFORM_X11:
        with suppress(OSError), closing(XServer()) as server:
            for x, y, width, _ in server.monitors():
                if (x, y) == tuple(place):
                    return float(width / mode.size.width)
    return 1.0


def check_mode(
    display: Display, width_px: int, height_px: int, rate_hz: float, scale: float = 1.0
) -> None:
    """Refuse a video mode other than the display file's; a rate of 0 is not stated.

    A desktop that scales the monitor filters every pixel.

    Raises
    ------
    StudyError
        Saying both modes and the cure.
    """
    size_fits = (width_px, height_px) == (display.width_px, display.height_px)
    rate_fits = rate_hz == 0 or abs(rate_hz - display.refresh_hz) <= RATE_SLACK_HZ
    if not (size_fits and rate_fits and scale == 1):
        found = f"{width_px}x{height_px}" + (f" at {rate_hz:g} Hz" if rate_hz else "")
        found += f", scaled by {scale:g}" if scale != 1 else ""
        raise StudyError(
            f"display {display.name!r}: the monitor must run at {display.width_px}x"
            f"{display.height_px}, {display.refresh_hz:g} Hz, not scaled (found {found}); set that"
            " mode in the desktop's settings, or name the display that is there with --display"
        )


def plain_text(value: bytes | str | None) -> str:
    """Return the text of GLFW's bytes; empty: nothing."""
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value or ""
