"""Disk and memory."""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from pathlib import Path

import psutil

from study_app.doctor.findings import FOR_BOTH, Finding, Needs, Status


def check_disk(folder: Path, needs: Needs) -> list[Finding]:
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
    append_s = statistics.median(appends_s)
    return [
        _judge_space(folder, free_gb, needs),
        _judge_speed(folder, write_mb_s, append_s, max(appends_s), needs),
    ]


def _judge_space(folder: Path, free_gb: float, needs: Needs) -> Finding:
    kind = _filesystem(folder)
    found = f"{free_gb:.1f} GB free in {folder.resolve()} ({kind})"
    details = {"free_gb": free_gb, "filesystem": kind}
    if kind in ("tmpfs", "ramfs"):
        cure = "choose a folder on a disk: this one is in memory and is lost when power goes"
        return Finding("disk space", Status.WARN, found, cure, details=details)
    for status, least in (
        (Status.FAIL, needs.free_disk_fail_gb),
        (Status.WARN, needs.free_disk_warn_gb),
    ):
        if free_gb < least:
            cure = f"make room for at least {least:g} GB, or choose another disk with --folder"
            return Finding("disk space", status, found, cure, details=details)
    return Finding("disk space", Status.PASS, found, details=details)


def _judge_speed(
    folder: Path, write_mb_s: float, append_s: float, longest_s: float, needs: Needs
) -> Finding:
    found = (
        f"{write_mb_s:.0f} MB/s written and synced; one line is safe after {1e3 * append_s:.1f} ms"
        f" (longest {1e3 * longest_s:.1f})"
    )
    details = {"write_mb_s": write_mb_s, "append_s": append_s, "append_longest_s": longest_s}
    if write_mb_s < needs.write_warn_mb_s or longest_s > needs.append_warn_s:
        cure = f"{folder} is slow: record to a local disk, not to a network drive or a USB stick"
        return Finding("disk speed", Status.WARN, found, cure, FOR_BOTH, details)
    return Finding("disk speed", Status.PASS, found, "", FOR_BOTH, details)


def _filesystem(folder: Path) -> str:
    target = folder.resolve()
    mounts = {Path(part.mountpoint): part.fstype for part in psutil.disk_partitions(all=True)}
    for place in (target, *target.parents):
        if place in mounts:
            return mounts[place]
    return "unknown"


def check_memory(free_gb: float, needs: Needs) -> Finding:
    """Room for the two clips of a trial and the next pair."""
    found, details = f"{free_gb:.1f} GB free", {"free_gb": free_gb}
    for status, least in (
        (Status.FAIL, needs.free_memory_fail_gb),
        (Status.WARN, needs.free_memory_warn_gb),
    ):
        if free_gb < least:
            cure = f"close other programs; {least:g} GB are needed for 3 s clips of 1080 x 1080 px"
            return Finding("memory", status, found, cure, FOR_BOTH, details)
    return Finding("memory", Status.PASS, found, "", FOR_BOTH, details)
