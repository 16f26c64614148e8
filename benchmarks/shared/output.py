"""Output of benchmarks, with the machine's conditions; what cannot be stored is refused before."""

from __future__ import annotations

import json
import os
import platform
from argparse import ArgumentTypeError
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, TypeAlias

from protocols.revision import code_revision

Record: TypeAlias = dict[str, Any]
"""Results of a benchmark, as JSON holds them."""


def file_to_write(name: str) -> Path:
    """Type of an argument: a file that can be made, or replaced.

    Raises
    ------
    ArgumentTypeError
        If its folder does not exist, or it is a folder itself.
    """
    path = Path(name)
    if path.is_dir() or not path.parent.is_dir():
        raise ArgumentTypeError(f"must be a file in a folder that exists (got {name})")
    return path


def write_record(path: Path, record: object) -> None:
    """Write what was measured as JSON: six digits, and what holds no further list on one line."""
    path.write_text(_record(record, "\n") + "\n", encoding="utf-8")


def _record(value: object, line: str) -> str:
    if isinstance(value, float):
        return json.dumps(float(f"{value:.6g}"))
    if not isinstance(value, dict | list | tuple) or not value:
        return json.dumps(value)
    inner = value.values() if isinstance(value, dict) else value
    deep = any(isinstance(one, dict | list | tuple) and one for one in inner)
    below = line + " " if deep else line
    items = [_record(one, below) for one in inner]
    if isinstance(value, dict):
        items = [f"{json.dumps(str(k))}: {v}" for k, v in zip(value, items, strict=True)]
    text = f",{below}".join(items) if deep else ", ".join(items)
    start, end = "{}" if isinstance(value, dict) else "[]"
    return f"{start}{below}{text}{line}{end}" if deep else f"{start}{text}{end}"


@dataclass(frozen=True)
class PagePart:
    """A part of a page that a benchmark replaces, between two lines that name it."""

    name: str

    @property
    def begin(self) -> str:
        """The line before it."""
        return f"<!-- {self.name}: begin -->"

    @property
    def end(self) -> str:
        """The line behind it."""
        return f"<!-- {self.name}: end -->"

    def page(self, name: str) -> Path:
        """Type of an argument: a page that has such a part.

        Raises
        ------
        ArgumentTypeError
            If there is no such page, or it lacks one of the lines.
        """
        path = Path(name)
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
        if self.end not in text.partition(self.begin)[2]:
            raise ArgumentTypeError(
                f"must be a page with the lines {self.begin} and {self.end} (got {name})"
            )
        return path

    def replace(self, page: Path, text: str) -> None:
        """Put `text` there."""
        before, _, rest = page.read_text(encoding="utf-8").partition(self.begin)
        after = rest.partition(self.end)[2]
        page.write_text(f"{before}{self.begin}\n{text}\n{self.end}{after}", encoding="utf-8")


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
