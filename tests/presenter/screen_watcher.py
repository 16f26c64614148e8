"""A process of its own that reads the screen: every new frame strip, and the clip's pixels.

Arguments: frame buffer file or DISPLAY, the monitor's left edge, x, y, width and height of the
clip, and the file in which it says which number it read last. Prints "number hash" for every
picture that appears whole, until its standard input closes.
"""

import hashlib
import mmap
import select
import struct
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import ImageGrab

from study_app.desktop.strip import read_both_strips

SCREEN_WIDTH, SCREEN_HEIGHT = 640, 480


def screen_of(source: str, left: int) -> Callable[[], NDArray[np.uint8]]:
    """Give a function that returns the monitor's pixels, (height, width, 3)."""
    if source.startswith(":"):
        box = left, 0, left + SCREEN_WIDTH, SCREEN_HEIGHT
        return lambda: np.asarray(ImageGrab.grab(box, xdisplay=source))
    with Path(source).open("rb") as file:
        memory = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    start = int.from_bytes(memory[:4], "big") + 12 * int.from_bytes(memory[76:80], "big")
    pixels = np.frombuffer(memory, np.uint8, SCREEN_WIDTH * SCREEN_HEIGHT * 4, start)
    screen = pixels.reshape(SCREEN_HEIGHT, SCREEN_WIDTH, 4)[..., 2::-1]
    return lambda: screen


def main() -> None:
    look = screen_of(sys.argv[1], int(sys.argv[2]))
    x, y, width, height = map(int, sys.argv[3:7])
    with Path(sys.argv[7]).open("r+b") as file:
        done = mmap.mmap(file.fileno(), 8)
    print("ready", flush=True)
    last = None
    seen: list[tuple[int, str]] = []
    polls = 0
    while True:
        polls += 1
        if polls % 50 == 0 and select.select([sys.stdin], [], [], 0)[0]:
            break
        screen = look()
        number = read_both_strips(screen[..., 1])
        if number is None or number == last:
            time.sleep(0.001)
            continue
        content = screen[y : y + height, x : x + width].tobytes()
        if read_both_strips(screen[..., 1]) != number:
            continue
        last = number
        done[:8] = struct.pack("<q", number)
        seen.append((number, hashlib.sha256(content).hexdigest()))
    for entry in seen:
        print(*entry)


if __name__ == "__main__":
    main()
