"""Questions to drivers that may crash: each is asked in a process of its own.

`ask_probe` starts that process, which calls `answer`; a crash is reported as an
answer too.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterable
from contextlib import closing
from typing import TYPE_CHECKING, Any

import psutil

from pipeline.errors import GLUnavailableError
from protocols.errors import StudyError
from study_app.doctor.python_speed import loops_ms

if TYPE_CHECKING:  # a driver is asked by the process of a probe alone
    from study_app.desktop.monitor import Monitor

ProbeAnswer = dict[str, Any]  # JSON; "error" holds the reason where there is no answer


def ask_probe(name: str, *, timeout_s: float = 60.0) -> ProbeAnswer:
    """Run the probe `name` in a process of its own.

    Returns
    -------
    dict
        The probe's answer, or ``{"error": reason}``: also where the process
        crashed, hung for `timeout_s` or printed no answer.
    """
    code = f"import metamerlab; from study_app.doctor.probes import answer; answer({name!r})"
    # -P and metamerlab: another package that happens to be called "pipeline" is not imported.
    command = [sys.executable, "-P", "-c", code]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=timeout_s)
    except subprocess.TimeoutExpired:
        return {"error": f"gave no answer within {timeout_s:g} s"}
    if done.returncode < 0:
        return {"error": f"the driver crashed ({signal.Signals(-done.returncode).name})"}
    lines = done.stdout.strip().splitlines()
    try:
        return dict(json.loads(lines[-1]))
    except (IndexError, json.JSONDecodeError):
        said = done.stderr.strip().splitlines()
        return {"error": said[-1] if said else f"ended with status {done.returncode}"}


def gl() -> ProbeAnswer:
    """The renderer that batches will use: off-screen, through EGL."""
    from pipeline.gl.context import create_context, describe

    try:
        renderer = describe(create_context())
    except GLUnavailableError as error:
        return {"error": str(error)}
    return {
        "renderer": renderer.name,
        "version": renderer.version,
        "software": renderer.software,
    }


def display() -> ProbeAnswer:
    """Monitors, and whether buffer swaps keep time with one of them."""
    import glfw

    from study_app.desktop.monitor import plain_text, window_system
    from study_app.desktop.x11 import XServer

    warnings.simplefilter("ignore", glfw.GLFWError)
    if not glfw.init():
        _, reason = glfw.get_error()
        return {"error": plain_text(reason) or "no display"}
    found: ProbeAnswer = {
        "platform": window_system(),
        "monitors": [_monitor(monitor) for monitor in glfw.get_monitors()],
        "disturbers": disturbers(process.name() for process in psutil.process_iter(["name"])),
    }
    if found["platform"] == "X11":
        try:
            with closing(XServer()) as server:
                found["compositor"] = server.has_compositor()
        except OSError as error:
            found["unasked"] = str(error)
    glfw.terminate()
    if any(monitor["refresh_hz"] for monitor in found["monitors"]):
        found["window"] = _window()
    return found


def _monitor(monitor: Monitor) -> ProbeAnswer:
    import glfw

    from study_app.desktop.monitor import enlargement, plain_text

    mode = glfw.get_video_mode(monitor)
    return {
        "name": plain_text(glfw.get_monitor_name(monitor)),
        "width_px": mode.size.width,
        "height_px": mode.size.height,
        "refresh_hz": mode.refresh_rate,
        "scale": glfw.get_monitor_content_scale(monitor)[0] * enlargement(monitor),
    }


def disturbers(running: Iterable[str]) -> list[str]:
    """Programs among those running that may cover the screen: savers, lockers, notices."""
    return sorted({name for name in running if _DISTURBERS.match(name)})


_DISTURBERS = re.compile(
    r"xscreensaver|[a-z0-9]+-screensaver|light-locker|xss-lock|xautolock|swayidle|dunst|mako"
    r"|notify-osd|[a-z0-9]+-notifyd|notification-daemon|gnome-shell|plasmashell"
)


def _window() -> ProbeAnswer:
    """The session's own check of a display, in a window over the primary monitor."""
    from study_app.desktop.display_check import check_display, display_findings, shortfall
    from study_app.desktop.monitor import monitor_display
    from study_app.desktop.window import Window
    from study_app.recorder import utc_now

    try:
        with Window(monitor_display()) as window:
            check = check_display(window, utc_now)
    except StudyError as error:
        return {"error": str(error)}
    return {
        "renderer": check.renderer,
        "evidence": check.evidence,
        "measured": dict(display_findings(check, window.display))["measured"],
        "late": shortfall(check),
    }


PROBES: dict[str, Callable[[], ProbeAnswer]] = {"gl": gl, "display": display, "python": loops_ms}


def answer(name: str) -> None:
    """Ask the probe `name`, print its answer as one line of JSON, and end the process."""
    print(json.dumps(PROBES[name]()), flush=True)
    os._exit(0)  # a driver that crashes while it is unloaded has already answered
