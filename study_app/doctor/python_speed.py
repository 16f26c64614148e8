"""Speed of a Python: builds of one version differ by a factor of two.

Run as a file it prints the milliseconds of its own loop: by any Python from 3.11 on, without a
package. `script/lib.sh` chooses one by it.
"""

import shutil
import subprocess
import sys
import time
from pathlib import Path

NAMES = ("python3", "/usr/bin/python3", "python3.14", "python3.13", "python3.12", "python3.11")


def loop_ms() -> int:
    """Return the milliseconds of a fixed loop here, the least of three."""

    def once() -> float:
        start_s, total = time.process_time(), 0
        for number in range(300_000):
            total += number * number
        return time.process_time() - start_s

    return round(1000 * min(once() for _ in range(3)))


def loops_ms() -> dict[str, int]:
    """Return the loop's time of this Python, which comes first, and of others beside it."""
    mine = Path(sys.executable)
    found, known = {str(mine): loop_ms()}, {mine.resolve()}
    for name in NAMES:
        place = shutil.which(name)
        if place is None or Path(place).resolve() in known:
            continue
        known.add(Path(place).resolve())
        done = subprocess.run([place, "-I", __file__], capture_output=True, text=True, check=False)
        if done.returncode == 0:
            found[place] = int(done.stdout)
    return found


if __name__ == "__main__":
    if sys.version_info < (3, 11):  # noqa: UP036  # any Python of the machine runs this
        sys.exit(1)
    print(loop_ms())
