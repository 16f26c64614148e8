"""Desktops that people have: a compositor draws them, and doctor names it."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess

import pytest

from study_app.strip import compare


@pytest.fixture
def composited(screen, wait):
    """Let a real compositor draw the screen."""
    if shutil.which("xcompmgr") is None:
        pytest.skip("xcompmgr is not installed (apt-get install xcompmgr)")
    compositor = subprocess.Popen(["xcompmgr"], env=screen.env, stderr=subprocess.DEVNULL)
    ask = "from study_app.doctor.probes import has_compositor; print(has_compositor())"
    try:
        wait(lambda: screen.script(ask).stdout.strip() == "True", "the compositor")
        yield screen
    finally:
        compositor.send_signal(signal.SIGTERM)
        compositor.wait(timeout=10)


@pytest.mark.slow
def test_a_compositor_shows_what_was_logged_and_is_named(composited, make_study):
    study = make_study({"pairings": '[["metameric", "push-pull"]]', "repeats": "1"})

    seen = composited.watch(study)

    logged, names = study.logged()
    assert sum(entry is not None for entry in logged.values()) >= 10
    assert compare(logged, seen, names) == []
    report = json.loads(composited.run("doctor", "--json", "--folder", study.folder).stdout)
    found = {finding["check"]: finding["status"] for finding in report["findings"]}
    assert found["compositor"] == "WARN"
