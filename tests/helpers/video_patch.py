"""Small videos, and changes to their headers: boxes of MP4, elements of Matroska, chunks of AVI."""

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

Change = Callable[[bytes], bytes]

SIZE = (64, 48)
MP4_ENTRY = ("moov", "trak", "mdia", "minf", "stbl", "stsd", "mp4v")
SEGMENT, TRACKS, TRACK, VIDEO = 0x18538067, 0x1654AE6B, 0xAE, 0xE0
_BEFORE = {"stsd": 8, "mp4v": 78}  # bytes before the boxes inside


def picture(number: int = 0, size: tuple[int, int] = SIZE) -> np.ndarray:
    """Blocks of 16 px whose colours tell frames, places and mirror images apart."""
    y, x = np.mgrid[: size[1], : size[0]] // 16
    colours = np.random.default_rng(5).integers(40, 216, (64, 3))
    return colours[(7 * y + x + 3 * number) % 64].astype(np.uint8)


def write(path: Path, frames: Sequence[np.ndarray], codec: str, fps: float = 30.0) -> Path:
    """Write RGB frames by OpenCV."""
    height, width = frames[0].shape[:2]
    writer = cv2.VideoWriter(
        str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*codec), fps, (width, height)
    )
    assert writer.isOpened()
    for frame in frames:
        writer.write(np.ascontiguousarray(frame[..., ::-1]))
    writer.release()
    return path


def box(name: str, data: bytes = b"") -> bytes:
    """A box of MP4."""
    return (8 + len(data)).to_bytes(4) + name.encode("latin-1") + data


def in_mp4(data: bytes, place: Sequence[str], change: Change) -> bytes:
    """Change the contents of every box at `place`; what holds it grows along."""
    done, at = b"", 0
    while at + 8 <= len(data):
        size, name = int.from_bytes(data[at : at + 4]), data[at + 4 : at + 8].decode("latin-1")
        inner = data[at + 8 : at + size]
        if place and name == place[0]:
            kept = _BEFORE.get(name, 0) if len(place) > 1 else 0
            inner = change(inner) if len(place) == 1 else (
                inner[:kept] + in_mp4(inner[kept:], place[1:], change)
            )  # fmt: skip
        done, at = done + box(name, inner), at + size
    return done


def element(name: int, data: bytes | int = b"") -> bytes:
    """An element of Matroska; its size takes eight bytes."""
    content = data.to_bytes(4) if isinstance(data, int) else data
    named = name.to_bytes((name.bit_length() + 7) // 8)
    return named + b"\1" + len(content).to_bytes(7) + content


def _head(data: bytes, at: int) -> tuple[int, int, int]:
    long = 9 - data[at].bit_length()
    wide = 9 - data[at + long].bit_length()
    size = int.from_bytes(data[at + long : at + long + wide]) & ((1 << 7 * wide) - 1)
    return int.from_bytes(data[at : at + long]), size, long + wide


def in_matroska(data: bytes, place: Sequence[int], change: Change) -> bytes:
    """Change the contents of every element at `place`; what holds it grows along."""
    done, at = b"", 0
    while at < len(data):
        name, size, head = _head(data, at)
        inner = data[at + head : at + head + size]
        if name == place[0]:
            inner = change(inner) if len(place) == 1 else in_matroska(inner, place[1:], change)
        done, at = done + element(name, inner), at + head + size
    return done


def without(data: bytes, name: int) -> bytes:
    """Elements in a row without those of one name."""
    done, at = b"", 0
    while at < len(data):
        found, size, head = _head(data, at)
        done += b"" if found == name else data[at : at + head + size]
        at += head + size
    return done


def chunk(name: str, data: bytes) -> bytes:
    """A chunk of AVI."""
    return name.encode() + len(data).to_bytes(4, "little") + data + b"\0" * (len(data) % 2)


def in_avi(data: bytes, place: Sequence[str], change: Change) -> bytes:
    """Change the contents of every chunk at `place`, lists by their own name."""
    done, at = b"", 0
    while at + 8 <= len(data):
        name, size = data[at : at + 4].decode(), int.from_bytes(data[at + 4 : at + 8], "little")
        inner, kind = data[at + 8 : at + 8 + size], b""
        listed = name in ("RIFF", "LIST")
        if listed:
            kind, inner = inner[:4], inner[4:]
        if place and (kind.decode() if listed else name) == place[0]:
            inner = change(inner) if len(place) == 1 else in_avi(inner, place[1:], change)
        done, at = done + chunk(name, kind + inner), at + 8 + size + size % 2
    return done


def patched(path: Path, place: Sequence[str] | Sequence[int], change: Change) -> Path:
    """Change a file of any of the three kinds, in place."""
    by = {".mp4": in_mp4, ".mov": in_mp4, ".avi": in_avi}.get(path.suffix, in_matroska)
    path.write_bytes(by(path.read_bytes(), place, change))  # type: ignore[operator]
    return path
