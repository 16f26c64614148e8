"""Questions to drivers that may crash: each is asked in a process of its own.

`ask` starts that process, which calls `answer`; a crash is reported as an
answer too.
"""

from __future__ import annotations

import itertools
import json
import os
import re
import signal
import statistics
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterable
from typing import Any

import psutil

from pipeline.errors import GLUnavailableError

Answer = dict[str, Any]  # JSON; "error" holds the reason where there is no answer

SWAPS = 40  # frames timed by `display`: 0.7 s at 60 Hz


def ask(name: str, *, timeout_s: float = 60.0) -> Answer:
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


def gl() -> Answer:
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


def display() -> Answer:
    """Monitors, and whether buffer swaps keep time with one of them."""
    import glfw

    from study_app.desktop.monitor import plain_text, window_system
    from study_app.desktop.x11 import XServer

    warnings.simplefilter("ignore", glfw.GLFWError)
    if not glfw.init():
        _, reason = glfw.get_error()
        return {"error": plain_text(reason) or "no display"}
    monitors = glfw.get_monitors()
    found: Answer = {
        "platform": window_system(),
        "monitors": [_monitor(glfw, monitor) for monitor in monitors],
        "disturbers": disturbers(process.name() for process in psutil.process_iter(["name"])),
    }
    if found["platform"] == "X11":
        try:
            with XServer() as server:
                found["compositor"] = server.has_compositor()
        except OSError as error:
            found["unasked"] = str(error)
    found["window"] = _time_swaps(glfw) if monitors else {"error": "no monitor"}
    glfw.terminate()
    return found


def _monitor(glfw: Any, monitor: Any) -> Answer:
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


def _time_swaps(glfw: Any) -> Answer:
    from study_app.desktop.monitor import plain_text

    for hint, value in (
        (glfw.CONTEXT_VERSION_MAJOR, 3),
        (glfw.CONTEXT_VERSION_MINOR, 3),
        (glfw.OPENGL_PROFILE, glfw.OPENGL_CORE_PROFILE),
    ):
        glfw.window_hint(hint, value)
    window = glfw.create_window(64, 64, "metamerlab doctor", None, None)
    if not window:
        _, reason = glfw.get_error()
        return {"error": plain_text(reason) or "no window with OpenGL 3.3"}
    glfw.make_context_current(window)
    glfw.swap_interval(1)

    import moderngl

    ctx = moderngl.create_context()
    times_s = []
    for _ in range(SWAPS):
        ctx.clear()
        glfw.swap_buffers(window)
        ctx.finish()
        times_s.append(time.perf_counter())
        glfw.poll_events()
    # The first swaps fill the driver's queue and return early.
    intervals_s = [late - early for early, late in itertools.pairwise(times_s[8:])]
    return {
        "renderer": str(ctx.info["GL_RENDERER"]),
        "version": str(ctx.info["GL_VERSION"]),
        "swap_median_s": statistics.median(intervals_s),
        "swap_max_s": max(intervals_s),
    }


PROBES: dict[str, Callable[[], Answer]] = {"gl": gl, "display": display}


def answer(name: str) -> None:
    """Ask the probe `name`, print its answer as one line of JSON, and end the process."""
    print(json.dumps(PROBES[name]()), flush=True)
    os._exit(0)  # a driver that crashes while it is unloaded has already answered
