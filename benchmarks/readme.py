"""The README's table of measurements, from `benchmarks/results/`: `script/bench readme`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.output import PagePart

PART = PagePart("measured")
ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks/results"
EDGE_PX, MASK = 1024, "thin"


def main(argv: list[str]) -> int:
    """Put the table into the README."""
    parser = argparse.ArgumentParser(prog="script/bench readme", description=__doc__)
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--readme", type=PART.page, default=ROOT / "README.md")
    arguments = parser.parse_args(argv)
    text = table(arguments.results)
    PART.replace(arguments.readme, text)
    print(text)
    return 0


def table(results: Path) -> str:
    """Return the table in Markdown; every number comes from a JSON of `results`.

    Raises
    ------
    OSError, KeyError, StopIteration
        If a file or a number is missing: run the benchmark that the table names.
    """
    data = _Results(results)
    lines = ["| what | measured | `script/bench` | revision |", "| --- | --- | --- | --- |"]
    for what, name, measured in ROWS:
        lines.append(f"| {what} | {measured(data)} | `{name}` | {data.revision(name)} |")
    return "\n".join(lines)


class _Results:
    """The results by benchmark."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._read: dict[str, dict[str, Any]] = {}

    def __getitem__(self, name: str) -> dict[str, Any]:
        if name not in self._read:
            text = (self._folder / f"{name}.json").read_text(encoding="utf-8")
            self._read[name] = json.loads(text)
        return self._read[name]

    def revision(self, name: str) -> str:
        """Of the code that was measured."""
        return str(self[name]["revision"])

    def fill(self, method: str) -> dict[str, Any]:
        """A method's timing at `EDGE_PX` with the mask `MASK`."""
        return next(
            entry
            for entry in self["fill"]["timings"]
            if (entry["method"], entry["edge_px"], entry["mask"]) == (method, EDGE_PX, MASK)
        )


def _ours(data: _Results) -> str:
    shown = [f"{data.fill('push-pull')['median_ms']:.0f} ms"]
    for name in ("push-pull-depth", "metameric"):
        entry = data.fill(name)
        shown.append(f"{entry['median_ms']:.0f} ms ({entry['to_push_pull']:.2f} times)")
    return " / ".join(shown)


def _others(data: _Results) -> str:
    return " / ".join(
        f"{data.fill(name)['median_ms']:.0f} ms ({data.fill(name)['to_push_pull']:.2f} times)"
        for name in ("telea", "oiio-push-pull")
    )


def _clips(data: _Results) -> str:
    stimuli = data["stimuli"]
    speeds = {entry["method"]: entry["build_fps"] for entry in stimuli["speeds"]}
    width = stimuli["width_px"]
    return (
        f"{width} x {width * 3 // 4} px: {speeds['metameric']:.0f} frames/s; two processes"
        f" {stimuli['two_processes_over_one']['median']:.2f} times one"
    )


def _session(data: _Results) -> str:
    entry = next(one for one in data["session"]["sessions"] if one["gaze_hz"] == 250)
    return f"{entry['wall_s']:.1f} s, for {entry['shown_s']:.0f} s of trials"


def _bootstrap(data: _Results) -> str:
    entry = next(one for one in data["analysis"]["timings"] if "JOD" in one["name"])
    return f"{entry['median_ms']:.0f} ms"


def _false_positives(data: _Results) -> str:
    entry = next(
        one
        for one in data["analysis"]["test_rates"]
        if (one["participant_sd"], one["scene_sd"]) == (0.5, 0.5)
    )
    return f"{100 * entry['pooled']:.1f} % / {100 * entry['two_way']:.1f} %"


ROWS: tuple[tuple[str, str, Callable[[_Results], str]], ...] = (
    (f"fill {EDGE_PX}², 5 % thin holes: push-pull / push-pull-depth / metameric", "fill", _ours),
    ("the same: OpenCV's Telea / OpenImageIO's push-pull, on the CPU", "fill", _others),
    ("clips of `metameric`, built and hashed", "stimuli", _clips),
    ("a simulated session, 72 decisions, gaze at 250 Hz", "session", _session),
    ("1,000 bootstraps of a JOD scale, 6 conditions x 11 observers", "analysis", _bootstrap),
    (
        "false positives at .05, people and scenes differ by .5 logits: pooled test / ours",
        "analysis",
        _false_positives,
    ),
)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
