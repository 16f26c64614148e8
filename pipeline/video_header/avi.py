"""Statements of AVI files: Microsoft's AVI RIFF reference, and OpenDML's extensions."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

from pipeline.statements.check_statements import VideoStatement, other
from pipeline.video_header.mp4 import cropped, shown_size

_RATE_SHARE = 0.01  # how far two rates may differ by rounding
_SWITCHED_OFF = 1


def statements(path: Path) -> Iterator[VideoStatement]:
    """Yield the statements of an AVI file's header, as far as it is whole."""
    kinds: list[bytes] = []
    with path.open("rb") as file:
        file.seek(12)
        at = 12
        while len(head := file.read(12)) >= 8:
            size = int.from_bytes(head[4:8], "little")
            is_list = head[:4] in (b"LIST", b"RIFF")
            name = head[8:12] if is_list else head[:4]
            if head[:4] != b"RIFF":  # more of the same, of OpenDML
                yield from other("AVI: the file", "a chunk", name.decode("latin-1"))
            if name == b"hdrl":
                yield from _header(file.read(max(size - 4, 0)), kinds)
            at += 8 + size + size % 2
            file.seek(at)
    if kinds.count(b"vids") > 1:
        yield VideoStatement("several video tracks", f"holds {kinds.count(b'vids')}")
    if {b"auds", b"iavs"} & set(kinds):
        yield VideoStatement("sound", "its sound")
    for kind in sorted(set(kinds) - {b"vids", b"auds", b"iavs"}):
        yield VideoStatement("other tracks", f"a track of kind {kind.decode('latin-1')!r}")


def _header(header: bytes, kinds: list[bytes]) -> Iterator[VideoStatement]:
    frame_us = 0
    for chunk, data in _chunks(header):
        yield from other("AVI: the header", "a chunk", chunk)
        if chunk == "avih":
            frame_us = int.from_bytes(data[:4], "little")
        elif chunk == "strl":
            found = dict(_chunks(data))
            head = found.get("strh", b"")
            kinds.append(head[:4])
            if head[:4] == b"vids":
                yield from _stream(found, frame_us)


def _stream(found: dict[str, bytes], frame_us: int) -> Iterator[VideoStatement]:
    flags, scale, rate, start = struct.unpack("<8xI8xIII", found["strh"][:32])
    size = tuple(abs(edge) for edge in struct.unpack("<4xii", found["strf"][:12]))
    if flags & _SWITCHED_OFF:
        yield VideoStatement("track that is switched off", "the video track is switched off")
    if scale and rate and frame_us:
        fps, average = rate / scale, 1e6 / frame_us
        if abs(average / fps - 1) > _RATE_SHARE:
            yield VideoStatement(
                "two frame rates", f"{average:g} a second, and {fps:g} for the stream"
            )
    left, top, right, bottom = struct.unpack("<4h", found["strh"][48:56].ljust(8, b"\0"))
    if (right - left, bottom - top) not in ((0, 0), size):
        words = f"a frame of {right - left} x {bottom - top} px in the video stream"
        yield VideoStatement("whatever else", words)
    if start:
        yield VideoStatement(
            "late start", f"the video starts at {start * scale / max(rate, 1):g} s"
        )
    for chunk, data in found.items():
        yield from other("AVI: the video stream", "a chunk", chunk)
        if chunk == "vprp" and len(data) >= 36:
            down, across, width, height, fields = struct.unpack("<20xHHIII", data[:36])
            if fields > 1:
                yield VideoStatement("interlacing", f"its frames are {fields} fields")
            if len(data) >= 60 and fields == 1:
                values = struct.unpack("<6I", data[36:60])
                full, part, place = values[1::-1], values[3:1:-1], values[4:6]
                if all(full) and all(part):
                    yield from cropped(full, (*place, *part))
            if down and across and width and height:
                shown = (height * across / down, float(height))
                if abs(shown[0] - width) >= 1:
                    yield from shown_size(shown, (size[0], size[1]))


def _chunks(data: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield names and contents of chunks in a row; of lists, by the list's own name."""
    at = 0
    while at + 8 <= len(data):
        name, size = data[at : at + 4], int.from_bytes(data[at + 4 : at + 8], "little")
        first = at + 8
        if first + size > len(data):
            return
        if name == b"LIST":
            name, first = data[at + 8 : at + 12], first + 4
        yield name.decode("latin-1"), data[first : at + 8 + size]
        at += 8 + size + size % 2
