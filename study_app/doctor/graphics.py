"""OpenGL, monitors and the time of buffer swaps, judged from what the probes answered."""

from __future__ import annotations

import sys
from collections.abc import Mapping

from study_app.desktop.desktop_watch import DO_NOT_DISTURB, unnoticed
from study_app.doctor.findings import FOR_SESSIONS, FOR_STIMULI, Finding, Needs, Status
from study_app.doctor.probes import Answer

_GUESSED_DPI = 96.0
_CURE_GL = (
    "install the graphics card's driver, or Mesa's software renderer"
    " (Debian, Ubuntu: apt-get install libegl1 libgl1)"
)


def check_gl(answer: Answer, needs: Needs) -> Finding:
    """OpenGL 4.3 without a window, as stimuli are made."""
    name, jobs = "OpenGL off-screen", FOR_STIMULI
    if "error" in answer:
        # What the pipeline says ends with its own cure; a crash has none.
        found, install, cure = answer["error"].partition("; install")
        cure = f"install{cure}" if install else _CURE_GL
        if sys.platform == "darwin":  # it never had compute shaders
            found += (
                "; numpy works on photographs, scenes cannot be drawn, and no picture of a session"
                " can follow the gaze"
            )
            return Finding(name, Status.WARN, found, cure, jobs, answer)
        return Finding(name, Status.FAIL, found, cure, jobs, answer)
    found = f"{answer['renderer']}, OpenGL {answer['version']}"
    limits = answer["limits"]
    small = [
        f"{limit} is {limits[limit]}, {least} is needed for full-size clips"
        for limit, least in (
            ("GL_MAX_TEXTURE_SIZE", needs.texture_px),
            ("GL_MAX_ARRAY_TEXTURE_LAYERS", needs.texture_layers),
        )
        if limits.get(limit, least) < least
    ]
    if small:
        cure = "use a newer driver or graphics card"
        return Finding(name, Status.WARN, f"{found}; {'; '.join(small)}", cure, jobs, answer)
    if answer["software"]:
        cure = "results are the same, only slower; for large batches use a machine with a GPU"
        return Finding(name, Status.WARN, f"{found} (software)", cure, jobs, answer)
    return Finding(name, Status.PASS, found, "", jobs, answer)


def check_egl(answer: Answer) -> Finding:
    """The devices that EGL offers, of which the first with a hardware renderer is used."""
    name, jobs = "EGL devices", FOR_STIMULI
    devices = answer.get("devices", [])
    found = "; ".join(
        f"{index}: {device.get('renderer') or device['error']}"
        for index, device in enumerate(devices)
    )
    if not any("renderer" in device for device in devices):
        cure = "install libegl1 and the graphics card's driver"
        return Finding(name, Status.FAIL, answer.get("error") or found or "none", cure, jobs)
    return Finding(name, Status.PASS, found, "", jobs, answer)


def check_display(answer: Answer, environment: Mapping[str, str]) -> list[Finding]:
    """Window system, monitors, the renderer in a window, and whether swaps keep time."""
    no_timing = "cannot be tested without a display; stimulus durations are not under control"
    if "error" in answer or not answer["monitors"]:
        reason = answer.get("error") or "no monitor is connected"
        cure = "start from a desktop session of the machine that shows the study"
        return [
            Finding("display", Status.FAIL, reason, cure, FOR_SESSIONS, answer),
            Finding("timing", Status.FAIL, no_timing, cure, FOR_SESSIONS),
        ]
    findings = [
        _judge_platform(answer["platform"], environment),
        *_judge_desktop(answer, environment),
    ]
    findings += [_judge_monitor(monitor) for monitor in answer["monitors"]]
    window = answer["window"]
    if "error" in window:
        cure = "install the graphics card's driver with OpenGL 3.3 or newer"
        lost = Finding("window", Status.FAIL, window["error"], cure, FOR_SESSIONS)
        return [*findings, lost, Finding("timing", Status.FAIL, no_timing, cure, FOR_SESSIONS)]
    return [*findings, _judge_window(window), _judge_timing(window, answer["monitors"])]


def _judge_platform(system: str, environment: Mapping[str, str]) -> Finding:
    if system == "X11" and not environment.get("WAYLAND_DISPLAY"):
        return Finding("display", Status.PASS, "X11", "", FOR_SESSIONS)
    if system in ("Windows", "macOS"):
        cure = "prove its timing with a photodiode: sessions were never run on this system"
        return Finding("display", Status.WARN, system, cure, FOR_SESSIONS)
    found = "X11 through Wayland (Xwayland)" if system == "X11" else system
    cure = "log in to an X11 session: a compositor may delay or drop frames unseen"
    return Finding("display", Status.WARN, found, cure, FOR_SESSIONS)


def _judge_desktop(answer: Answer, environment: Mapping[str, str]) -> list[Finding]:
    """Name what may delay frames, or cover the screen in the middle of a trial."""
    findings = []
    if answer.get("compositor"):
        cure = "turn the compositor off, or see that it steps aside for a full-screen window"
        found = "a compositor draws this desktop: frames may come a refresh later than is logged"
        findings.append(Finding("compositor", Status.WARN, found, cure, FOR_SESSIONS))
    if blind := unnoticed(answer["platform"], environment, answer.get("unasked", "")):
        found, _, cure = blind.partition("; ")
        findings.append(Finding("what covers", Status.WARN, found, cure, FOR_SESSIONS))
    if covering := answer.get("disturbers"):
        found = f"{', '.join(covering)} may cover the screen with a saver, a lock or a notice"
        findings.append(Finding("notices", Status.WARN, found, DO_NOT_DISTURB, FOR_SESSIONS))
    if seconds := answer.get("blank_after_s"):
        found = f"it begins after {seconds} s without a key; sessions hold it off"
        findings.append(Finding("screen saver", Status.PASS, found, "", FOR_SESSIONS))
    kinds = {(one["refresh_hz"], one["scale"]) for one in answer["monitors"]}
    if len(kinds) > 1:
        shown = "; ".join(
            f"{one['name']} {one['refresh_hz']} Hz at scale {one['scale']:g}"
            for one in answer["monitors"]
        )
        found = f"they differ: {shown}"
        cure = (
            "name the participant's one in the display file (monitor =), scale it by 1, and switch"
            " the others off or to its rate: a desktop may wait for the slowest"
        )
        findings.append(Finding("monitors", Status.WARN, found, cure, FOR_SESSIONS))
    return findings


def _judge_monitor(monitor: Answer) -> Finding:
    width_px, width_mm = monitor["width_px"], monitor["width_mm"]
    refresh = f"{monitor['refresh_hz']} Hz" if monitor["refresh_hz"] else "unknown refresh rate"
    if monitor["fastest_hz"] > monitor["refresh_hz"] > 0:
        refresh += f" (it also has {monitor['fastest_hz']} Hz)"
    found = (
        f"{width_px} x {monitor['height_px']} px, {refresh}, {width_mm} x {monitor['height_mm']} mm"
    )
    name = f"monitor {monitor['name']}"
    cure = "measure the picture with a ruler and write its size into the display file"
    if width_mm <= 0 or monitor["height_mm"] <= 0:
        found = f"{found}: the size is not known"
        return Finding(name, Status.WARN, found, cure, FOR_SESSIONS, monitor)
    if abs(25.4 * width_px / width_mm - _GUESSED_DPI) < 0.75:
        found = f"{found}: the size looks like the system's guess of 96 dpi"
        return Finding(name, Status.WARN, found, cure, FOR_SESSIONS, monitor)
    return Finding(name, Status.PASS, found, "", FOR_SESSIONS, monitor)


def _judge_window(window: Answer) -> Finding:
    from pipeline.gl.context import SOFTWARE_RENDERERS

    found = f"{window['renderer']}, OpenGL {window['version']}"
    if any(word in window["renderer"].lower() for word in SOFTWARE_RENDERERS):
        cure = "install the graphics card's driver: drawing on the CPU misses frames"
        return Finding("window", Status.WARN, f"{found} (software)", cure, FOR_SESSIONS, window)
    return Finding("window", Status.PASS, found, "", FOR_SESSIONS, window)


def _judge_timing(window: Answer, monitors: list[Answer]) -> Finding:
    median_ms = 1e3 * window["swap_median_s"]
    longest_ms = 1e3 * window["swap_max_s"]
    found = f"swaps every {median_ms:.2f} ms (longest {longest_ms:.2f})"
    rates = sorted({monitor["refresh_hz"] for monitor in monitors if monitor["refresh_hz"] > 0})
    if not rates:
        return Finding(
            "timing",
            Status.FAIL,
            f"{found}, but no monitor has a refresh rate: a virtual or remote display"
            " (Xvfb, VNC) shows nothing at a known time",
            "run sessions on the machine that the monitor is connected to",
            FOR_SESSIONS,
            window,
        )
    nearest_ms = min((1e3 / rate for rate in rates), key=lambda ms: abs(ms - median_ms))
    expected = f"{found}, the monitor's frame lasts {nearest_ms:.2f} ms"
    if median_ms < 0.9 * nearest_ms:
        cure = "turn on vertical synchronisation (vsync) in the driver's settings"
        return Finding("timing", Status.FAIL, f"{expected}: no vsync", cure, FOR_SESSIONS, window)
    if median_ms > 1.1 * nearest_ms:
        cure = "close other programs, turn off the compositor, use a faster graphics card"
        return Finding(
            "timing", Status.FAIL, f"{expected}: frames are missed", cure, FOR_SESSIONS, window
        )
    if longest_ms > 1.5 * nearest_ms:
        cure = "close other programs and turn off the compositor"
        found = f"{expected}: a frame was missed"
        return Finding("timing", Status.WARN, found, cure, FOR_SESSIONS, window)
    return Finding("timing", Status.PASS, expected, "", FOR_SESSIONS, window)
