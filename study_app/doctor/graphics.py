"""OpenGL, the desktop, monitors and a window, judged from what the probes answered."""

from __future__ import annotations

import sys
from collections.abc import Mapping

from study_app.desktop.desktop_watch import DO_NOT_DISTURB, unnoticed
from study_app.doctor import FOR_SESSIONS, FOR_STIMULI, Finding, Status
from study_app.doctor.probes import ProbeAnswer

_CURE_GL = (
    "install the graphics card's driver, or Mesa's software renderer"
    " (Debian, Ubuntu: apt-get install libegl1 libgl1)"
)


def check_gl(answer: ProbeAnswer) -> Finding:
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
            return Finding(name, Status.WARN, found, cure, jobs)
        return Finding(name, Status.FAIL, found, cure, jobs)
    found = f"{answer['renderer']}, OpenGL {answer['version']}"
    if answer["software"]:
        cure = "results are the same, only slower; for large batches use a machine with a GPU"
        return Finding(name, Status.WARN, f"{found} (software)", cure, jobs)
    return Finding(name, Status.PASS, found, "", jobs)


def check_screen(answer: ProbeAnswer, environment: Mapping[str, str]) -> list[Finding]:
    """Window system, what may cover the screen, monitors, and the timing of a window."""
    if "error" in answer or not answer["monitors"]:
        reason = answer.get("error") or "no monitor is connected"
        cure = "start from a desktop session of the machine that shows the study"
        return [_of_sessions("display", Status.FAIL, reason, cure)]
    findings = [_judge_platform(answer["platform"], environment)]
    if answer.get("compositor"):
        cure = "turn the compositor off, or see that it steps aside for a full-screen window"
        found = "a compositor draws this desktop: frames may come a refresh later than is logged"
        findings.append(_of_sessions("compositor", Status.WARN, found, cure))
    if blind := unnoticed(answer["platform"], environment, answer.get("unasked", "")):
        found, _, cure = blind.partition("; ")
        findings.append(_of_sessions("what covers", Status.WARN, found, cure))
    if covering := answer["disturbers"]:
        found = f"{', '.join(covering)} may cover the screen with a saver, a lock or a notice"
        findings.append(_of_sessions("notices", Status.WARN, found, DO_NOT_DISTURB))
    return [*findings, _judge_monitors(answer["monitors"]), *_judge_window(answer.get("window"))]


def _of_sessions(check: str, status: Status, found: str, cure: str = "") -> Finding:
    return Finding(check, status, found, cure, FOR_SESSIONS)


def _judge_platform(system: str, environment: Mapping[str, str]) -> Finding:
    if system == "X11" and not environment.get("WAYLAND_DISPLAY"):
        return _of_sessions("display", Status.PASS, "X11")
    if system in ("Windows", "macOS"):
        cure = "prove its timing with a photodiode: sessions were never run on this system"
        return _of_sessions("display", Status.WARN, system, cure)
    found = "X11 through Wayland (Xwayland)" if system == "X11" else system
    cure = "log in to an X11 session: a compositor may delay or drop frames unseen"
    return _of_sessions("display", Status.WARN, found, cure)


def _judge_monitors(monitors: list[ProbeAnswer]) -> Finding:
    found = "; ".join(
        f"{one['name']} {one['width_px']} x {one['height_px']} px, {one['refresh_hz']} Hz at scale"
        f" {one['scale']:g}"
        for one in monitors
    )
    if len({(one["refresh_hz"], one["scale"]) for one in monitors}) == 1:
        return _of_sessions("monitors", Status.PASS, found)
    cure = (
        "name the participant's one in the display file (monitor =), scale it by 1, and switch"
        " the others off or to its rate: a desktop may wait for the slowest"
    )
    return _of_sessions("monitors", Status.WARN, f"they differ: {found}", cure)


def _judge_window(window: ProbeAnswer | None) -> list[Finding]:
    """Renderer and timing of a window, as a session checks them before it begins."""
    from pipeline.gl.context import SOFTWARE_RENDERERS

    if window is None:
        found = (
            "no monitor has a refresh rate: a virtual or remote display (Xvfb, VNC) shows nothing"
            " at a known time"
        )
        cure = "run sessions on the machine that the monitor is connected to"
        return [_of_sessions("timing", Status.FAIL, found, cure)]
    if failed := window.get("error") or window["late"]:
        found, _, cure = failed.partition(", or run 'metamerlab doctor'")[0].partition("; ")
        return [_of_sessions("timing", Status.FAIL, found, cure)]
    opened = _of_sessions("window", Status.PASS, window["renderer"])
    if any(word in window["renderer"].lower() for word in SOFTWARE_RENDERERS):
        cure = "install the graphics card's driver: drawing on the CPU misses frames"
        opened = _of_sessions("window", Status.WARN, window["renderer"], cure)
    found = f"{window['measured']}, {window['evidence']}"
    if window["evidence"] == "unverified":
        cure = "close other programs and turn off the compositor"
        return [opened, _of_sessions("timing", Status.WARN, found, cure)]
    return [opened, _of_sessions("timing", Status.PASS, found)]
