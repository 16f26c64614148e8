"""A process of its own that reads the screen: every new frame strip, and the clip's pixels.

Arguments: frame buffer file, x, y, width and height of the clip, and the file in which it says
which number it read last. Prints "number hash" for every picture that appears whole, until its
standard input closes.
"""

from __future__ import annotations

import hashlib
import mmap
import select
import struct
import sys
import time
from pathlib import Path

import numpy as np

from study_app.strip import read_both_strips

SCREEN_WIDTH, SCREEN_HEIGHT = 640, 480


def main() -> None:
    x, y, width, height = map(int, sys.argv[2:6])
    with Path(sys.argv[1]).open("rb") as file:
        memory = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    with Path(sys.argv[6]).open("r+b") as file:
        done = mmap.mmap(file.fileno(), 8)
    start = int.from_bytes(memory[:4], "big") + 12 * int.from_bytes(memory[76:80], "big")
    pixels = np.frombuffer(memory, np.uint8, SCREEN_WIDTH * SCREEN_HEIGHT * 4, start)
    screen = pixels.reshape(SCREEN_HEIGHT, SCREEN_WIDTH, 4)
    clip = screen[y : y + height, x : x + width, 2::-1]
    print("ready", flush=True)
    last = None
    seen: list[tuple[int, str]] = []
    polls = 0
    while True:
        polls += 1
        if polls % 50 == 0 and select.select([sys.stdin], [], [], 0)[0]:
            break
        number = read_both_strips(screen[..., 1])
        if number is None or number == last:
            time.sleep(0.001)
            continue
        content = clip.tobytes()
        if read_both_strips(screen[..., 1]) != number:
            continue
        last = number
        done[:8] = struct.pack("<q", number)
        seen.append((number, hashlib.sha256(content).hexdigest()))
    for entry in seen:
        print(*entry)


if __name__ == "__main__":
    main()
