"""`metamerlab doctor` tells the truth about this machine, and about machines made up here."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from study_app.desktop.x11 import XServer
from study_app.doctor import Finding, Job, Status, python_speed, worst
from study_app.doctor.graphics import check_gl, check_screen
from study_app.doctor.machine import (
    check_clip_memory,
    check_disk,
    check_packages,
    check_python,
    check_texts,
    examine,
    judge_space,
)
from study_app.doctor.probes import PROBES, ask_probe, disturbers
from study_app.text_image import _font_for, find_fonts, missing_characters

GPU = {"renderer": "NVIDIA RTX 4000", "version": "4.6", "software": False}


def display(refresh_hz=60, **window):
    """Answer of the probe on a machine with one full-HD monitor."""
    monitor = {
        "name": "DP-1",
        "width_px": 1920,
        "height_px": 1080,
        "refresh_hz": refresh_hz,
        "scale": 1.0,
    }
    measured = {"renderer": "NVIDIA", "evidence": "fence", "measured": "59.951 Hz", "late": ""}
    return {"platform": "X11", "monitors": [monitor], "window": measured | window, "disturbers": []}


def named(findings: list[Finding], check: str) -> Finding:
    (finding,) = [finding for finding in findings if finding.check.startswith(check)]
    return finding


def test_a_mac_without_compute_shaders_is_fit_for_photographs(monkeypatch):
    assert check_gl({"error": "no OpenGL 4.3"}).status is Status.FAIL
    monkeypatch.setattr(sys, "platform", "darwin")

    said = check_gl({"error": "no OpenGL 4.3"})

    assert said.status is Status.WARN
    assert "numpy works on photographs" in said.found


ALONE = {"/opt/venv/bin/python": 20}


def test_a_python_that_is_a_quarter_faster_is_named_with_the_cure():
    faster = ALONE | {"/usr/bin/python3": 10, "/opt/python3": 12}

    (finding,) = check_python(faster)

    assert finding.status is Status.WARN
    assert "(/opt/venv/bin/python); /usr/bin/python3 is 2.0 times as fast" in finding.found
    assert "PYTHON=/usr/bin/python3 script/setup" in finding.cure
    for others in ({}, {"/usr/bin/python3": 16}, {"/usr/bin/python3": 50}):
        assert check_python(ALONE | others) == []
    assert check_python({"error": "gave no answer"}) == []


def test_the_loop_is_timed_by_each_other_python_once(monkeypatch, tmp_path):
    other = tmp_path / "python3.12"
    other.write_text('#!/bin/sh\nexec "$REAL" "$@"\n')
    other.chmod(0o755)
    monkeypatch.setenv("REAL", sys.executable)
    (tmp_path / "python3.13").symlink_to(other)
    monkeypatch.setattr(python_speed, "NAMES", ("python3.12", "python3.13", "python3.7"))
    monkeypatch.setenv("PATH", str(tmp_path))

    found = python_speed.loops_ms()

    assert list(found) == [sys.executable, str(other)]
    assert all(ms > 0 for ms in found.values())


def test_a_good_machine_passes_every_question(tmp_path):
    findings = examine(
        tmp_path, probe={"gl": GPU, "display": display(), "python": ALONE}.__getitem__
    )

    ours = {"packages", "fonts", "text shaping", "disk space", "disk speed", "memory"}
    assert {f.check for f in findings if f.status is not Status.PASS} <= ours
    assert all(finding.jobs for finding in findings)


def test_no_window_is_opened_for_a_machine_that_shows_nothing(tmp_path):
    asked = []

    def probe(name):
        asked.append(name)
        return {"gl": GPU, "python": ALONE}[name]

    findings = examine(tmp_path, jobs={Job.STIMULI, Job.ANALYSIS}, probe=probe)

    assert asked == ["python", "gl"]
    assert all(finding.jobs & {Job.STIMULI, Job.ANALYSIS} for finding in findings)
    assert "OpenGL off-screen" in {finding.check for finding in findings}


NO_VSYNC = "every swap must wait (found 1191 swaps per second); turn vertical synchronisation on"
NO_WINDOW = "a window must open; install a driver with OpenGL 3.3, or run 'metamerlab doctor'"


@pytest.mark.parametrize(
    ("answer", "status", "said", "cure"),
    [
        (display(), Status.PASS, "59.951 Hz, fence", ""),
        (display() | {"window": None}, Status.FAIL, "virtual", "run sessions on the machine"),
        (display(error=NO_VSYNC), Status.FAIL, "1191 swaps", "turn vertical synchronisation on"),
        (display(error=NO_WINDOW), Status.FAIL, "window", "install a driver with OpenGL 3.3"),
        (display(late="it cannot keep up; close"), Status.FAIL, "cannot keep up", "close"),
        (display(evidence="unverified"), Status.WARN, "unverified", "close other programs"),
    ],
)
def test_timing_is_what_the_sessions_own_check_says(answer, status, said, cure):
    timing = named(check_screen(answer, {}), "timing")

    assert timing.status is status
    assert said in timing.found
    assert timing.cure.startswith(cure)
    assert not timing.cure.endswith("doctor'")


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ({"error": "no DISPLAY"}, "no DISPLAY"),
        ({"platform": "X11", "monitors": []}, "no monitor is connected"),
    ],
)
def test_a_machine_without_a_monitor_is_not_fit_for_sessions(answer, said):
    (finding,) = check_screen(answer, {})

    assert (finding.status, finding.found) == (Status.FAIL, said)
    assert "desktop session" in finding.cure


def test_a_software_renderer_is_a_warning_for_sessions():
    window = named(check_screen(display(renderer="llvmpipe"), {}), "window")

    assert window.status is Status.WARN
    assert Job.SESSIONS in window.jobs


def test_a_desktop_that_may_cover_or_delay_frames_is_named():
    quiet = [finding.check for finding in check_screen(display(), {})]
    assert quiet == ["display", "monitors", "window", "timing"]
    second = {**display(refresh_hz=240)["monitors"][0], "name": "DP-2", "scale": 2.0}
    answer = display()
    answer |= {"compositor": True, "disturbers": ["dunst", "xscreensaver"]}
    answer["monitors"].append(second)

    findings = check_screen(answer, {})

    differ = "DP-1 1920 x 1080 px, 60 Hz at scale 1; DP-2 1920 x 1080 px, 240 Hz at scale 2"
    assert named(findings, "monitors").found == f"they differ: {differ}"
    assert "dunst, xscreensaver" in named(findings, "notices").found
    for check in ("compositor", "notices", "monitors"):
        assert named(findings, check).status is Status.WARN
        assert named(findings, check).cure


@pytest.mark.parametrize(
    ("running", "found"),
    [
        (["bash", "python3", "Xorg", "openbox"], []),
        (["xfce4-screensaver", "xfce4-notifyd", "bash"], ["xfce4-notifyd", "xfce4-screensaver"]),
        (["gnome-shell", "gnome-shell"], ["gnome-shell"]),
    ],
)
def test_programs_that_put_windows_over_others_are_known(running, found):
    assert disturbers(running) == found


@pytest.mark.parametrize("system", ["Windows", "macOS"])
def test_a_system_that_no_session_ran_on_is_a_warning(system):
    said = named(check_screen({**display(), "platform": system}, {}), "display")

    assert said.status is Status.WARN
    assert "never run" in said.cure


def test_wayland_is_a_warning_even_behind_x11():
    for answer, environment in (
        ({**display(), "platform": "Wayland"}, {}),
        (display(), {"WAYLAND_DISPLAY": "wayland-0"}),
    ):
        assert named(check_screen(answer, environment), "display").status is Status.WARN


@pytest.mark.parametrize(
    ("answer", "environment", "found", "cure"),
    [
        ({"unasked": "there is no libxcb; install it"}, {}, "libxcb", "install it"),
        ({"platform": "Wayland"}, {}, "are not noticed on Wayland", "X11 session"),
        ({}, {"WAYLAND_DISPLAY": "wayland-0"}, "may go unnoticed on Wayland", "X11 session"),
        ({"platform": "Windows"}, {}, "are not noticed on Windows", "do not disturb"),
    ],
)
def test_what_may_cover_the_screen_unnoticed_is_a_warning(answer, environment, found, cure):
    said = named(check_screen(display() | answer, environment), "what covers")

    assert said.status is Status.WARN
    assert found in said.found
    assert cure in said.cure
    assert not [each for each in check_screen(display(), {}) if each.check == "what covers"]


def test_a_machine_without_libxcb_says_which_package_brings_it(monkeypatch):
    def missing(name: str) -> None:
        raise OSError(f"{name}: cannot open shared object file: No such file or directory")

    monkeypatch.setattr("ctypes.CDLL", missing)
    with pytest.raises(OSError, match="apt-get install libxcb1"):
        XServer()


def test_opengl_is_judged_by_presence_and_hardware():
    assert check_gl(GPU).status is Status.PASS
    assert check_gl({**GPU, "software": True}).status is Status.WARN
    assert check_gl({"error": "no driver"}).status is Status.FAIL


def test_missing_and_old_packages_are_told():
    def status(requirement: str) -> tuple[Status, str]:
        finding = check_packages([Requirement(requirement)])
        return finding.status, finding.found

    assert status("numpy>=2")[0] is Status.PASS
    assert status("numpy>=900") == (Status.FAIL, status("numpy>=900")[1])
    assert "is not >=900" in status("numpy>=900")[1]
    assert status("no-such-package>=1") == (Status.FAIL, "no-such-package is missing")
    assert check_packages([]).status is Status.WARN  # not installed: nothing is known


def test_memory_is_judged_by_what_a_trial_takes():
    statuses = [check_clip_memory(gb).status for gb in (8.0, 3.9, 0.9)]

    assert statuses == [Status.PASS, Status.WARN, Status.FAIL]


def test_disk_test_leaves_nothing_behind_and_wants_room(tmp_path):
    check_disk(tmp_path)

    assert list(tmp_path.iterdir()) == []
    assert judge_space(tmp_path, 0.9).status in (Status.FAIL, Status.WARN)  # WARN: it is in memory


def test_a_folder_that_cannot_be_written_to_fails(tmp_path):
    (finding,) = check_disk(tmp_path / "nowhere")

    assert finding.status is Status.FAIL
    assert "no such file" in finding.found


def test_a_probe_that_crashes_hangs_or_babbles_is_an_answer(monkeypatch):
    def answer_of(code: str, timeout_s: float = 20.0) -> str:
        real = subprocess.run

        def run(command, **options):
            return real([*command[:-1], code], **options)

        monkeypatch.setattr("study_app.doctor.probes.subprocess.run", run)
        answer = ask_probe("gl", timeout_s=timeout_s)
        monkeypatch.undo()
        return str(answer.get("error"))

    assert "crashed (SIGSEGV)" in answer_of("import os; os.kill(os.getpid(), 11)")
    assert "no answer within" in answer_of("import time; time.sleep(60)", timeout_s=0.5)
    assert answer_of("raise SystemExit('broken driver')") == "broken driver"
    assert answer_of("print('not JSON')") == "ended with status 0"


def test_the_worst_finding_decides():
    good, bad = (Finding("a", status, "") for status in (Status.PASS, Status.FAIL))

    assert worst([good, bad, good]) is Status.FAIL
    assert worst([]) is Status.PASS


def test_a_font_is_known_to_write_latin_and_not_to_write_an_unassigned_character():
    latin = next((path for path in find_fonts() if not missing_characters(path, "Latin")), None)
    if latin is None:
        pytest.skip("no font on this machine writes Latin text")

    assert missing_characters(latin, "Press a key") == ""
    assert missing_characters(latin, "a\U0010fffe") == "\U0010fffe"


def test_a_machine_without_fonts_is_told_to_install_one(monkeypatch):
    monkeypatch.setattr("study_app.text_image.find_fonts", list)
    _font_for.cache_clear()

    latin, shaped = check_texts()

    assert (latin.status, shaped.status) == (Status.FAIL, Status.WARN)
    assert "install a font" in latin.cure


# --- the command, on this very machine ---------------------------------------------------


def run_doctor(
    *arguments: str, env: dict[str, str], wrapper: tuple[str, ...] = ()
) -> subprocess.CompletedProcess[str]:
    code = "from study_app.cli import main; main()"
    command = [*wrapper, sys.executable, "-c", code, "doctor", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, env=env)


def without_display() -> dict[str, str]:
    return {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}


def test_doctor_works_without_any_display(tmp_path: Path):
    done = run_doctor("--json", "--folder", str(tmp_path), env=without_display())
    report = json.loads(done.stdout)
    statuses = {finding["check"]: finding["status"] for finding in report["findings"]}

    assert done.returncode == 0, done.stderr  # stimuli and analysis can be done here
    assert statuses["display"] == "FAIL"
    assert report["jobs"]["sessions"] == "FAIL"
    assert report["metamerlab"]
    for finding in report["findings"]:
        assert finding["status"] == "PASS" or finding["cure"], finding


def test_doctor_ends_with_1_where_a_job_that_is_named_cannot_be_done(tmp_path: Path):
    done = run_doctor("--for", "sessions", "--folder", str(tmp_path), env=without_display())

    assert done.returncode == 1
    assert "not fit because of: display" in done.stdout


def test_doctor_for_analysis_does_not_ask_for_a_display(tmp_path: Path):
    done = run_doctor("--for", "analysis", "--folder", str(tmp_path), env=without_display())

    assert "timing" not in done.stdout
    assert "for analysis" in done.stdout
    assert done.returncode == (1 if "FAIL" in done.stdout else 0), done.stdout


def test_timing_fails_on_xvfb_and_nothing_crashes(tmp_path: Path):
    if shutil.which("xvfb-run") is None:
        if os.environ.get("REQUIRE_GL") == "1":
            pytest.fail("xvfb-run is needed (apt-get install xvfb xauth)")
        pytest.skip("xvfb-run is not installed (apt-get install xvfb xauth)")
    xvfb = ("xvfb-run", "-a", "-s", "-screen 0 800x600x24 -noreset")
    done = run_doctor("--json", "--folder", str(tmp_path), env=without_display(), wrapper=xvfb)
    findings = {finding["check"]: finding for finding in json.loads(done.stdout)["findings"]}

    assert done.returncode == 0
    assert findings["display"]["status"] == "PASS"
    assert "800 x 600 px" in findings["monitors"]["found"]
    assert findings["timing"]["status"] == "FAIL"
    assert "virtual" in findings["timing"]["found"]


COMPOSITOR = """
import ctypes
from study_app.desktop.x11 import XServer
ask = XServer()
print(ask.has_compositor())
x11 = ctypes.CDLL("libX11.so.6")
x11.XOpenDisplay.restype = ctypes.c_void_p
server = ctypes.c_void_p(x11.XOpenDisplay(None))
x11.XDefaultRootWindow.restype = x11.XInternAtom.restype = ctypes.c_ulong
root = ctypes.c_ulong(x11.XDefaultRootWindow(server))
x11.XCreateSimpleWindow.restype = ctypes.c_ulong
mine = ctypes.c_ulong(x11.XCreateSimpleWindow(server, root, 0, 0, 1, 1, 0, 0, 0))
name = ctypes.c_ulong(x11.XInternAtom(server, b"_NET_WM_CM_S0", 0))
x11.XSetSelectionOwner(server, name, mine, 0)
x11.XSync(server, 0)
print(ask.has_compositor())
"""


def test_a_compositor_is_known_by_the_selection_that_it_owns():
    if shutil.which("xvfb-run") is None:
        if os.environ.get("REQUIRE_GL") == "1":
            pytest.fail("xvfb-run is needed (apt-get install xvfb xauth)")
        pytest.skip("xvfb-run is not installed (apt-get install xvfb xauth)")
    # A server that resets itself when its last client goes may refuse the next one meanwhile.
    done = subprocess.run(
        ["xvfb-run", "-a", "-s", "-noreset", sys.executable, "-c", COMPOSITOR],
        capture_output=True, text=True, timeout=60, env=without_display(),
    )  # fmt: skip

    assert done.stdout.split() == ["False", "True"], done.stderr


@pytest.mark.parametrize("name", sorted(PROBES))
def test_every_probe_answers_from_a_process_of_its_own(name):
    answer = ask_probe(name)

    assert answer
    assert "Traceback" not in str(answer.get("error"))
