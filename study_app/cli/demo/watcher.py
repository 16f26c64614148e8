"""Reads a screen while a session runs on it: which flip it shows, and the pixels."""

from __future__ import annotations

import hashlib
import threading
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from study_app.strip import BLOCK_PX, Seen, read_both_strips

POLL_S = 0.002
Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Place:
    """A rectangle of the screen, in pixels."""

    left: int
    top: int
    width: int
    height: int


@dataclass
class _Kept:
    """Pictures of the flips since the last trial; what looks the same is stored once."""

    picture_of: dict[int, str] = field(default_factory=dict)
    pictures: dict[str, Image] = field(default_factory=dict)


class Watcher:
    """A thread that looks at the screen about five hundred times a second.

    Parameters
    ----------
    pixels : ndarray of uint8, shape (height, width, 4)
        The screen's memory, blue first. It carries frame strips at both edges.
    clip : Place
        Where clips are shown.
    """

    def __init__(self, pixels: Image, clip: Place) -> None:
        self._pixels, self._clip = pixels, clip
        self._seen: list[Seen] = []
        self._kept = _Kept()
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="screen watcher", daemon=True)

    def __enter__(self) -> Watcher:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    @property
    def seen(self) -> list[Seen]:
        """Every flip that was seen whole, with the SHA-256 of the clip's place."""
        with self._lock:
            return list(self._seen)

    def take(self, flips: Iterable[int]) -> dict[int, Image]:
        """Return the pictures, (height, width, 3), of these flips, and forget all that came before.

        Flips that were not seen are left out.
        """
        with self._lock:
            kept = self._kept
            wanted = list(flips)
            found = {
                flip: kept.pictures[kept.picture_of[flip]]
                for flip in wanted
                if flip in kept.picture_of
            }
            last = max(wanted, default=-1)
            later = {flip: name for flip, name in kept.picture_of.items() if flip > last}
            self._kept = _Kept(later, {name: kept.pictures[name] for name in later.values()})
        return found

    def _run(self) -> None:
        last: int | None = None
        while not self._stop.wait(POLL_S):
            number = read_both_strips(self._pixels[..., 1])
            if number is None or number == last:
                continue
            picture = self._pixels[..., 2::-1].copy()
            if read_both_strips(self._pixels[..., 1]) != number:
                continue
            last = number
            self._keep(number, picture)

    def _keep(self, number: int, picture: Image) -> None:
        place = self._clip
        inside = picture[place.top : place.top + place.height, place.left :][:, : place.width]
        content = hashlib.sha256(inside.tobytes()).hexdigest()
        picture[:BLOCK_PX] = picture[-BLOCK_PX:] = picture[BLOCK_PX, 0]  # without the strips
        name = f"{content} {zlib.crc32(picture.tobytes())}"
        with self._lock:
            self._seen.append(Seen(number, content))
            self._kept.picture_of[number] = name
            self._kept.pictures.setdefault(name, picture)
