"""CPU time that `metamerlab --help` takes: `python -m benchmarks.front_door`."""

from __future__ import annotations

import os
import platform
import statistics
import subprocess
import sys

RUNS = 20


def help_cpu_s() -> float:
    """Run `metamerlab --help` once and return the user and system time it took."""
    command = [sys.executable, "-c", "from study_app.cli import main; main()", "--help"]
    before = os.times()
    subprocess.run(command, check=True, capture_output=True)
    after = os.times()
    return (after.children_user - before.children_user) + (
        after.children_system - before.children_system
    )


def main(argv: list[str]) -> int:  # noqa: ARG001  every benchmark takes its arguments
    """Print the median and the longest of `RUNS` runs."""
    help_cpu_s()  # fills the disk cache and writes the byte code
    times_s = [help_cpu_s() for _ in range(RUNS)]
    print(
        f"metamerlab --help: median {statistics.median(times_s):.2f} s CPU,"
        f" longest {max(times_s):.2f} s, {RUNS} runs,"
        f" Python {platform.python_version()}, {platform.processor() or platform.machine()}"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
