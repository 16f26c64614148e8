"""Desktops that people have: a compositor, two monitors, savers and notices; doctor names each."""

import csv
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from attack.captured_flips import compare

from protocols.display import Display
from protocols.errors import StudyError
from protocols.journal import Note
from study_app.desktop.monitor import check_mode

SHORT = {"pairings": '[["metameric", "push-pull"]]', "repeats": "1"}
XORG = Path("/usr/lib/xorg/Xorg")
XORG_CONF = """
Section "ServerFlags"
  Option "AutoAddDevices" "false"
EndSection
Section "Device"
  Identifier "virtual"
  Driver "dummy"
  Option "Monitor-DUMMY0" "fast"
EndSection
Section "Monitor"
  Identifier "fast"
  HorizSync 5.0-1000.0
  VertRefresh 5.0-1000.0
EndSection
Section "Screen"
  Identifier "screen"
  Device "virtual"
  Monitor "fast"
  DefaultDepth 24
EndSection
"""
MODES = {
    "DUMMY0": ("fast", "110", "640 680 744 848 480 483 487 540", "0x0"),
    "DUMMY1": ("slow", "27.5", "640 680 744 848 480 483 487 540", "640x0"),
}


def findings(screen, study):
    """Findings of doctor, by the name of the check."""
    done = screen.run(
        "doctor", "--json", "--for", "sessions", "--folder", study.folder, status=None
    )
    return {each["check"]: each for each in json.loads(done.stdout)["findings"]}


@contextmanager
def running(screen, *command):
    """Let a program of the desktop run."""
    process = subprocess.Popen(
        command, env=screen.env, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=10)


@pytest.fixture
def composited(screen, wait):
    """Let a real compositor draw the screen."""
    if shutil.which("xcompmgr") is None:
        pytest.skip("xcompmgr is not installed (apt-get install xcompmgr)")
    ask = "from study_app.desktop.x11 import XServer; print(XServer().has_compositor())"
    with running(screen, "xcompmgr"):
        wait(lambda: screen.script(ask).stdout.strip() == "True", "the compositor")
        yield screen


@pytest.mark.slow
def test_a_compositor_shows_what_was_logged_and_is_named(composited, make_study):
    study = make_study(SHORT)

    seen = composited.watch(study)

    logged, names = study.logged()
    assert sum(entry is not None for entry in logged.values()) >= 10
    assert compare(logged, seen, names) == []
    assert findings(composited, study)["compositor"]["status"] == "WARN"


@pytest.fixture
def two_monitors(screen, tmp_path):
    """Yield two monitors of one desktop, (640, 480) each: one at 240 Hz, one at 60 Hz."""
    if not XORG.exists() or not list(XORG.parent.glob("modules/drivers/dummy_drv.so")):
        pytest.skip(
            "no virtual monitors (apt-get install xserver-xorg-core xserver-xorg-video-dummy)"
        )
    (tmp_path / "xorg.conf").write_text(XORG_CONF)
    reading, writing = os.pipe()
    server = subprocess.Popen(
        [
            XORG, "-displayfd", str(writing), "-config", tmp_path / "xorg.conf", "-noreset",
            "-novtswitch", "-keeptty", "-nolisten", "tcp", "-logfile", tmp_path / "xorg.log",
        ],
        pass_fds=(writing,),
        stderr=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(writing)
    with os.fdopen(reading) as pipe:
        number = pipe.readline().strip()
    if not number:
        server.wait(timeout=10)
        pytest.skip("Xorg does not start here (it may need root)")
    both = type(screen)(f":{number}"), type(screen)(f":{number}", left=640)
    try:
        for output, (name, clock, timing, place) in MODES.items():
            for words in (
                ("--newmode", name, clock, *timing.split()),
                ("--addmode", output, name),
                ("--output", output, "--mode", name, "--pos", place),
            ):
                subprocess.run(["xrandr", *words], env=both[0].env, check=True)
        # Asks again which are connected.
        subprocess.run(["xrandr"], env=both[0].env, check=True, stdout=subprocess.DEVNULL)
        with running(both[0], "openbox"):
            time.sleep(0.5)
            yield dict(zip(MODES, both, strict=True))
    finally:
        server.send_signal(signal.SIGTERM)
        server.wait(timeout=10)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_of_two_monitors_each_shows_what_was_logged_at_its_own_rate(two_monitors, make_study):
    study = make_study(SHORT)
    file = study.folder / "little.toml"
    little = file.read_text()
    for code, (name, monitor) in zip(("P01", "P02"), two_monitors.items(), strict=True):
        rate = "240.0" if name == "DUMMY0" else "60.0"
        file.write_text(
            little.replace("refresh_hz = 60.0", f'refresh_hz = {rate}\nmonitor = "{name}"')
        )

        seen = monitor.watch(study, code=code)

        logged, names = study.logged(code)
        assert sum(entry is not None for entry in logged.values()) >= 10
        assert compare(logged, seen, names) == [], name
    # The file still names the slow monitor, and asks for the fast one's rate.
    file.write_text(file.read_text().replace("60.0\nmon", "240.0\nmon"))
    wrong = monitor.run(*monitor.session("run", study, "--simulate", code="P03"))
    assert wrong.returncode == 2
    assert "must run at 640x480, 240 Hz" in wrong.stderr
    assert "(found 640x480 at 60 Hz)" in wrong.stderr

    found = findings(monitor, study)
    differ = "DUMMY0 640 x 480 px, 240 Hz at scale 1; DUMMY1 640 x 480 px, 60 Hz at scale 1"
    assert differ in found["monitors"]["found"]
    assert found["monitors"]["status"] == "WARN"


NOTICE = """
import struct, time
from study_app.desktop.x11 import XServer

server = XServer()
mine = server._xcb.xcb_generate_id(server._server)
at = struct.pack("=hhHH", *{place})
looks = struct.pack("=HHIIII", 0, 1, 0, 0x202, 0xFFFFFF, 1)
server.tell(1, 0, struct.pack("=II", mine, server.root) + at + looks)
server.tell(18, 0, struct.pack("=IIIBxxxI", mine, 67, 31, 8, 14) + b"notice\\0Notice\\0")
server.tell(8, 0, struct.pack("=I", mine))
print("there", flush=True)
time.sleep(60)
"""
MIDDLE, CORNER = (250, 150, 140, 90), (600, 440, 20, 20)
# What covers the screen, and what the journal calls it.
LAY_OVER = "a window lay over the participant's: "
COVERS = {
    "python3": (
        f"exec {shlex.quote(sys.executable)} -c {shlex.quote(NOTICE.format(place=MIDDLE))}",
        LAY_OVER + "notice",
    ),
    "xset": ("xset s activate; exec sleep 60", "the screen saver was on"),
    "dunst": (
        "exec dbus-run-session -- sh -c 'dunst & sleep 1; notify-send -t 60000 notice; wait'",
        LAY_OVER + "Dunst",
    ),
    "xscreensaver": (
        "xscreensaver -no-splash & sleep 1; xscreensaver-command -activate; wait", LAY_OVER,
    ),
}  # fmt: skip
# In the midst of each attempt the next of them comes; on the page after it it goes.
COVERED = """
import os, signal, subprocess
from study_app import presenter

show, page, left, over = presenter.Presenter.show, presenter.Presenter.page, {commands!r}, []
def until(self, there):
    until_s = time.monotonic() + 30
    while bool(self._window._desktop.poll()) != there and time.monotonic() < until_s:
        time.sleep(0.01)
def shown(self, picture):
    if picture.phase.name == "second" and picture.refreshes == 3 and left and not over:
        over.append(subprocess.Popen(left.pop(0), shell=True, start_new_session=True))
        until(self, True)
    return show(self, picture)
def paged(self, asked):
    if asked.name == "paused":
        os.killpg(over.pop().pid, signal.SIGTERM)
        until(self, False)
    return page(self, asked)
presenter.Presenter.show, presenter.Presenter.page = shown, paged
"""


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_what_covers_the_screen_voids_its_attempt_and_is_named(screen, make_study):
    covers = {name: cover for name, cover in COVERS.items() if shutil.which(name)}
    study = make_study(SHORT | {"max_attempts": str(len(covers) + 1)})

    with running(screen, sys.executable, "-c", NOTICE.format(place=CORNER)) as notice:
        assert notice.stdout.readline() == b"there\n"
        commands = [each for each, _ in covers.values()]
        seen = screen.watch(study, also=COVERED.format(commands=commands))

    journal = study.journal()
    voided = [each for each in journal.attempts if each.outcome != "completed"]
    assert [each.void_reason for each in voided] == ["focus-lost"] * len(covers)
    before, *notes = [event.text for event in journal.events if isinstance(event, Note)]
    assert before == "over the window before the session began, and not held against it: notice"
    assert len(notes) == len(covers)
    for note, (_, named) in zip(notes, covers.values(), strict=True):
        assert note.startswith(named)
    completed = [each.trial for each in journal.attempts if each.outcome == "completed"]
    assert len(completed) == len(set(completed)) == journal.start.trials
    # Where the screen was not what was logged, the attempt is void.
    logged, names = study.logged()
    in_void = set()
    for each in voided:
        with (study.session() / each.flips_file.file).open() as file:
            in_void |= {int(row["flip"]) for row in csv.DictReader(file)}
    differ = {each.number for each in compare(logged, seen, names)}
    assert differ
    assert differ <= in_void


def test_a_monitor_that_the_desktop_scales_is_refused():
    display = Display(
        name="fine", width_px=640, height_px=480, width_mm=169, height_mm=127, distance_mm=600,
        refresh_hz=60,
    )  # fmt: skip
    check_mode(display, 640, 480, 60.0, 1.0)
    with pytest.raises(StudyError, match=r"not scaled \(found 640x480 at 60 Hz, scaled by 2\)"):
        check_mode(display, 640, 480, 60.0, 2.0)
