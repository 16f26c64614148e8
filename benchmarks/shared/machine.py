"""Conditions of a measurement beside the code: the machine, and how busy it was."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path

from protocols.revision import code_revision


def processor() -> str:
    """Return the processor's model name, where the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown"
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else "unknown"


def load_average() -> float:
    """Return the programs that worked or waited for a core over the last minute, ours included."""
    return round(os.getloadavg()[0], 2)


def busy_words(known: Mapping[str, object]) -> str:
    """Say in a sentence what `conditions` found, and how busy the machine is now."""
    return (
        f"{known['processor']}, {known['cores']} cores, load {known['load_average_before']} before"
        f" and {load_average()} after"
    )


def conditions(*packages: str) -> dict[str, object]:
    """Return processor, cores, platform, revision and versions, as results record them.

    Parameters
    ----------
    packages : str
        Whose versions count beside Python's; those that are not installed are left out.
    """
    versions = {}
    for name in packages:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return {
        "processor": processor(),
        "cores": os.cpu_count(),
        "platform": platform.platform(),
        "python": platform.python_version(),
        "libraries": versions,
        "revision": code_revision(),
        "load_average_before": load_average(),
    }
