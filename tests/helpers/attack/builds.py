"""Kills builds of clips after any amount of work, and lets them go on to the same bytes."""

import os
import random
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import forked
from forked import Forked

from stimuli.batch.check import check_batch


def build_by_command(study: Path, out: Path) -> subprocess.CompletedProcess[str]:
    """Build in a process of its own, to the end."""
    return forked.run(*_command(study, out), timeout=240)


def _command(study: Path, out: Path) -> list[str]:
    return ["stimuli", "build", str(study), "--out", str(out), "--workers", "2"]


def kill_builds(
    study: Path, whole: Path, out: Path, kills: int, *, seed: int = 11,
    on_kill: Callable[[], None] = lambda: None,
) -> int:  # fmt: skip
    """Kill builds of a study after random amounts of work, then let one come to its end.

    Parameters
    ----------
    whole : Path
        The same clips, built undisturbed.

    Returns
    -------
    int
        Builds that were faster than the kill and had to begin anew.

    Raises
    ------
    AssertionError
        If a manifest vouches for what is not whole, or other bytes come out in the end.
    """
    rng, killed, finished = random.Random(seed), 0, 0
    most = entries(whole)
    while killed < kills:
        process = Forked(*_command(study, out))
        # By what lies on the disk, not by the clock: a busy machine is killed as far on.
        enough = entries(out) + rng.randint(1, most)
        began = time.monotonic()
        while entries(out) < enough and process.poll() is None:
            assert time.monotonic() - began < 240
            time.sleep(0.01)
        time.sleep(rng.uniform(0, 0.1))
        process.send_signal(signal.SIGKILL)
        status = process.wait()
        assert status in (0, -signal.SIGKILL)
        if status != 0:
            killed += 1
            on_kill()
            assert not (out / "manifest.json").exists() or check_batch(out).in_order
        else:  # it was faster: begin anew
            finished += 1
            assert contents(out) == contents(whole)
            shutil.rmtree(out)
    result = build_by_command(study, out)
    assert result.returncode == 0, result.stderr
    assert contents(out) == contents(whole)
    assert not (out / ".build").exists()
    assert not list(out.rglob("*.part"))
    return finished


def contents(folder: Path) -> dict[str, bytes]:
    """Return everything that is promised to repeat: frames, masks and the manifest.

    Not the revision: someone may commit between two builds of one test.
    """
    found = {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.suffix in (".png", ".json")
    }
    if "manifest.json" in found:
        found["manifest.json"] = re.sub(rb'"revision": "[^"]*"', b"", found["manifest.json"])
    return found


def entries(folder: Path) -> int:
    """Count everything in a folder that others are writing in."""
    return sum(len(folders) + len(files) for _, folders, files in os.walk(folder))
