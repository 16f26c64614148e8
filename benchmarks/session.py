"""Time of a whole simulated session: `script/bench session`.

The 72 decisions of the inpainting paper's study go through the real session, trial machine, gaze
rules and recorder, on a virtual display; only drawing is missing.
"""

from __future__ import annotations

import argparse
import os
import platform
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.shared.output import conditions, file_to_write, write_record
from protocols.journal_file import read_journal
from protocols.load import load_display, load_protocol
from protocols.revision import code_revision
from study_app.simulate import SimulatedStudy, simulate_study


@dataclass(frozen=True)
class SessionTiming:
    """One session's cost."""

    gaze_hz: float
    decisions: int
    attempts: int
    flips: int
    shown_s: float
    """Duration on the virtual clock."""
    wall_s: float
    cpu_s: float
    mib: float
    """Size of what it left on the disk, MiB."""

    @property
    def us_per_flip(self) -> float:
        """Processor time of one pass through the loop: poll, judge, advance, log."""
        return 1e6 * self.cpu_s / self.flips


def time_session(gaze_hz: float) -> SessionTiming:
    """Run one session of `inpainting-2afc` and time it."""
    study = load_protocol(Path("inpainting-2afc"))
    display = load_display(study.display.display)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        (outcome,) = simulate_study(
            SimulatedStudy(study, display, gaze_rate_hz=gaze_hz), root, 1
        ).values()
        wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
        journal = read_journal(next(root.rglob("journal.jsonl")))
        flips = [
            len((journal.path.parent / attempt.flips_file.file).read_bytes().splitlines()) - 1
            for attempt in journal.attempts
            if attempt.flips_file
        ]
        size = sum(path.stat().st_size for path in root.rglob("*") if path.is_file())
    return SessionTiming(
        gaze_hz=gaze_hz,
        decisions=outcome.main_done,
        attempts=len(journal.attempts),
        flips=sum(flips),
        shown_s=journal.events[-1].t_s,
        wall_s=wall_s,
        cpu_s=cpu_s,
        mib=size / 2**20,
    )


def main(argv: list[str]) -> int:
    """Print a table; with ``--json FILE`` also write it."""
    parser = argparse.ArgumentParser(prog="benchmarks.session", description=__doc__)
    parser.add_argument("--json", type=file_to_write, help="file to write the numbers to")
    arguments = parser.parse_args(argv)
    sessions = [time_session(gaze_hz) for gaze_hz in (60.0, 250.0, 1000.0)]
    print(f"{platform.platform()}, {os.cpu_count()} cores, revision {code_revision()}")
    print("gaze Hz  decisions  attempts   flips  shown s  wall s   CPU s  us/flip    MiB")
    for entry in sessions:
        print(
            f"{entry.gaze_hz:7.0f} {entry.decisions:10d} {entry.attempts:9d} {entry.flips:7d}"
            f" {entry.shown_s:8.0f} {entry.wall_s:7.2f} {entry.cpu_s:7.2f}"
            f" {entry.us_per_flip:8.0f} {entry.mib:6.1f}"
        )
    if arguments.json:
        told = [asdict(entry) for entry in sessions]
        write_record(arguments.json, conditions() | {"sessions": told})
    return 0
