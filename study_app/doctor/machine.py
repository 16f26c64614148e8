"""Our packages, fonts and text, disk and memory; and every question of this machine."""

from __future__ import annotations

import importlib.metadata
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Set
from pathlib import Path

import psutil
from packaging.requirements import Requirement

from study_app.doctor import EVERY_JOB, FOR_BOTH, FOR_SESSIONS, Finding, Job, Status
from study_app.doctor.graphics import check_gl, check_screen
from study_app.doctor.probes import ProbeAnswer, ask_probe
from study_app.text_image import UnwritableError, typeface_for

DISK_FAIL_GB, DISK_WARN_GB = 1.0, 10.0
MEMORY_FAIL_GB, MEMORY_WARN_GB = 1.0, 4.0
"""A clip of 3 s of 1080 x 1080 px at 60 Hz takes 0.84 GB, and a trial holds the two it compares."""
_WRITE_WARN_MB_S = 30.0
_APPEND_WARN_S = 0.1  # between two trials nobody notices less


def check_packages(needed: Iterable[Requirement]) -> Finding:
    """Everything that metamerlab needs, in a version that it accepts.

    Parameters
    ----------
    needed : iterable of Requirement
        As `requirements` returns them; those of the optional parts are left out.
    """
    wrong, count = [], 0
    for requirement in needed:
        if requirement.marker and not requirement.marker.evaluate({"extra": ""}):
            continue
        name, count = requirement.name, count + 1
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            wrong.append(f"{name} is missing")
            continue
        if not requirement.specifier.contains(version, prereleases=True):
            wrong.append(f"{name} {version} is not {requirement.specifier}")
    if wrong:
        cure = "install metamerlab again: script/setup in a checkout, pip install -U metamerlab"
        return Finding("packages", Status.FAIL, "; ".join(wrong), cure)
    if not count:
        cure = "install it (script/setup) to know which packages it needs"
        return Finding("packages", Status.WARN, "metamerlab is not installed", cure)
    return Finding("packages", Status.PASS, f"all {count} present")


def requirements() -> list[Requirement]:
    """Return the requirements of the installed metamerlab; none where it is not installed."""
    try:
        return [Requirement(line) for line in importlib.metadata.requires("metamerlab") or []]
    except importlib.metadata.PackageNotFoundError:
        return []


def check_python(loops_ms: ProbeAnswer) -> list[Finding]:
    """Another Python of this machine that would do all of it faster; nothing if none would.

    Parameters
    ----------
    loops_ms : mapping
        Of a fixed loop, by Python; this one's comes first.
    """
    if "error" in loops_ms:
        return []
    mine, best = next(iter(loops_ms)), min(loops_ms, key=loops_ms.__getitem__)
    if 4 * loops_ms[mine] <= 5 * loops_ms[best]:  # as script/lib.sh chooses
        return []
    version = ".".join(map(str, sys.version_info[:3]))
    faster = loops_ms[mine] / loops_ms[best]
    found = f"{version} ({mine}); {best} is {faster:.1f} times as fast"
    cure = f"make the environment with it; in a checkout: PYTHON={best} script/setup"
    return [Finding("Python", Status.WARN, found, cure)]


def check_texts() -> list[Finding]:
    """Texts of instructions, by what draws them: Latin letters, and a script that is shaped."""
    findings = []
    for check, text, status in (
        ("fonts", "aéßŁő", Status.FAIL),
        ("text shaping", "ابت", Status.WARN),
    ):
        try:
            found = typeface_for([text], 32).path.name
            findings.append(Finding(check, Status.PASS, found, "", FOR_SESSIONS))
        except UnwritableError as error:
            found, _, cure = str(error).removeprefix("text: ").partition("; ")
            findings.append(Finding(check, status, found, cure, FOR_SESSIONS))
    return findings


def check_disk(folder: Path) -> list[Finding]:
    """Free space in `folder`, how fast a clip is written, how fast a journal line is safe."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            block = os.urandom(1 << 20)
            start_s = time.perf_counter()
            for _ in range(32):
                file.write(block)
            file.flush()
            os.fsync(file.fileno())
            write_mb_s = 32 * len(block) / 1e6 / (time.perf_counter() - start_s)
            appends_s = []
            for _ in range(20):
                start_s = time.perf_counter()
                file.write(b"x" * 400)  # about one journal line
                file.flush()
                os.fsync(file.fileno())
                appends_s.append(time.perf_counter() - start_s)
        free_gb = psutil.disk_usage(str(folder)).free / 1e9
    except OSError as error:
        cure = "choose another one with --folder, or make room and permission to write in it"
        reason = (error.strerror or "failed").lower()
        return [Finding("disk", Status.FAIL, f"{folder.resolve()}: {reason}", cure)]
    found = (
        f"{write_mb_s:.0f} MB/s written and synced; one line is safe after"
        f" {1e3 * statistics.median(appends_s):.1f} ms (longest {1e3 * max(appends_s):.1f})"
    )
    speed = Finding("disk speed", Status.PASS, found, "", FOR_BOTH)
    if write_mb_s < _WRITE_WARN_MB_S or max(appends_s) > _APPEND_WARN_S:
        cure = f"{folder} is slow: record to a local disk, not to a network drive or a USB stick"
        speed = Finding("disk speed", Status.WARN, found, cure, FOR_BOTH)
    return [judge_space(folder, free_gb), speed]


def judge_space(folder: Path, free_gb: float) -> Finding:
    """Room on the disk of a folder, and whether it is a disk."""
    target = folder.resolve()
    mounts = {Path(part.mountpoint): part.fstype for part in psutil.disk_partitions(all=True)}
    place = next((one for one in (target, *target.parents) if one in mounts), None)
    kind = mounts[place] if place else "unknown"
    found = f"{free_gb:.1f} GB free in {target} ({kind})"
    if kind in ("tmpfs", "ramfs"):
        cure = "choose a folder on a disk: this one is in memory and is lost when power goes"
        return Finding("disk space", Status.WARN, found, cure)
    for status, least in ((Status.FAIL, DISK_FAIL_GB), (Status.WARN, DISK_WARN_GB)):
        if free_gb < least:
            cure = f"make room for at least {least:g} GB, or choose another disk with --folder"
            return Finding("disk space", status, found, cure)
    return Finding("disk space", Status.PASS, found)


def check_clip_memory(free_gb: float) -> Finding:
    """Room for the two clips of a trial and the next pair."""
    for status, least in ((Status.FAIL, MEMORY_FAIL_GB), (Status.WARN, MEMORY_WARN_GB)):
        if free_gb < least:
            cure = f"close other programs; {least:g} GB are needed for 3 s clips of 1080 x 1080 px"
            return Finding("memory", status, f"{free_gb:.1f} GB free", cure, FOR_BOTH)
    return Finding("memory", Status.PASS, f"{free_gb:.1f} GB free", "", FOR_BOTH)


def examine(
    folder: Path, *, jobs: Set[Job] = EVERY_JOB, probe: Callable[[str], ProbeAnswer] = ask_probe
) -> list[Finding]:
    """Ask every question of this machine that bears on `jobs`.

    Parameters
    ----------
    folder : Path
        Where recordings and stimuli will be written; its disk is tested with a
        file of 32 MiB that is removed again.
    jobs : set of Job
        What the machine is for; no window is opened unless sessions are among it.
    probe : callable
        Answers ``"gl"``, ``"display"`` and ``"python"``; the default asks the drivers.
    """
    findings = [
        check_packages(requirements()),
        *check_python(probe("python")),
        check_gl(probe("gl")),
        *(check_screen(probe("display"), os.environ) if Job.SESSIONS in jobs else ()),
        *check_texts(),
        *check_disk(folder),
        check_clip_memory(psutil.virtual_memory().available / 1e9),
    ]
    return [finding for finding in findings if finding.jobs & jobs]
