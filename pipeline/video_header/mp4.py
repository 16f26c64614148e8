"""Statements of MP4 and QuickTime files: ISO/IEC 14496-12, -14, Apple's QuickTime File Format."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

from pipeline.statements.check_statements import UPRIGHT, VideoStatement, other
from pipeline.video_header.coding import colour, gamma, laid_out

_LIGHT = {"mdcv", "clli", "amve", "cclv", "SmDm", "CoLL"}
_COPIES = (0, 0x40)  # graphics modes: copy, and copy with dither
_SPHERICAL = bytes.fromhex("ffcc8263f8554a938814587a02521fdd")  # of Spherical Video V1, XML
_TURNS = ((1, 0, 0, 1), (0, 1, -1, 0), (-1, 0, 0, -1), (0, -1, 1, 0))
_MIRRORED = ((-1, 0, 0, 1), (1, 0, 0, -1), (0, 1, 1, 0), (0, -1, -1, 0))
_STEREO = {1: "abl", 2: "sbsl"}
_PROJECTIONS = {b"equi": "equirect", b"cbmp": "c3x2"}

Boxes: TypeAlias = Iterator[tuple[str, bytes]]
Linear: TypeAlias = tuple[float, float, float, float]


def statements(path: Path) -> Iterator[VideoStatement]:
    """Yield the statements of an MP4 or QuickTime file's header, as far as it is whole."""
    tracks: list[str] = []
    for name, movie in _of_file(path):
        if name != "moov":
            yield from other("MP4: the file", "a box", name)
            continue
        matrix, speed = (1.0, 0.0, 0.0, 1.0), 1.0
        for box, data in _boxes(movie):
            yield from other("MP4: the movie", "a box", box)
            if box == "mvhd":
                at = 32 if data[0] else 20
                speed = _fixed(data, at)
                matrix = _linear(data, at + 16)
            elif box == "udta":
                yield from _user(data)
            elif box == "trak":
                kind = next((d[8:12].decode("latin-1") for d in _inside(data, "mdia", "hdlr")), "")
                tracks.append(kind)
                if kind == "vide":
                    yield from _track(data, matrix)
                elif kind != "soun":
                    yield VideoStatement("other tracks", f"a track of kind {kind!r}")
        if speed not in (0, 1):
            yield _speed(speed)
    if tracks.count("vide") > 1:
        yield VideoStatement("several video tracks", f"holds {tracks.count('vide')}")
    if "soun" in tracks:
        yield VideoStatement("sound", "its sound")


def _track(track: bytes, movie: Linear) -> Iterator[VideoStatement]:
    shown, entry, turned = (0.0, 0.0), (0, 0), False
    for box, data in _boxes(track):
        if box == "uuid" and data[:16] == _SPHERICAL:
            yield laid_out("spherical", "equirect", "spherical metadata")
            continue
        yield from other("MP4: the video track", "a box", box)
        if box == "tkhd":
            if not data[3] & 1:
                yield VideoStatement(
                    "track that is switched off", "the video track is switched off"
                )
            at = 52 if data[0] else 40
            shown = _fixed(data, at + 36), _fixed(data, at + 40)
            turn = list(_turn(_linear(data, at), movie, data[at : at + 36]))
            turned = any("90" in said.found for said in turn)
            yield from turn
        elif box == "tapt":
            for name, size in _boxes(data):
                if name == "clef":
                    shown = _fixed(size, 4), _fixed(size, 8)
        elif box == "udta":
            yield from _user(data)
        elif box == "edts":
            for edits in _inside(data, "elst"):
                yield from _edits(edits)
        elif box == "mdia":
            for inner, _ in _boxes(data):
                yield from other("MP4: the video's media", "a box", inner)
            for info in _inside(data, "minf"):
                for inner, mode in _boxes(info):
                    yield from other("MP4: the video's media information", "a box", inner)
                    if inner == "vmhd" and int.from_bytes(mode[4:6]) not in _COPIES:
                        yield VideoStatement(
                            "graphics mode", f"graphics mode {int.from_bytes(mode[4:6])}"
                        )
            for table in _inside(data, "minf", "stbl"):
                for inner, entries in _boxes(table):
                    yield from other("MP4: the video's tables", "a box", inner)
                    if inner == "stsd":
                        for coding, one in _boxes(entries[8:]):
                            entry = struct.unpack(">HH", one[24:28])
                            yield from _entry(coding, one)
    if not (turned and shown == entry[::-1]):
        yield from shown_size(shown, entry, turned=turned)


def shown_size(
    shown: tuple[float, float], stored: tuple[int, int], *, turned: bool = False
) -> Iterator[VideoStatement]:
    """Yield the meaning of another size than the stored one: a display size, or another shape."""
    apart = max(abs(one - other) for one, other in zip(shown, stored, strict=True))
    if min(*shown, *stored) <= 0 or apart < 1:
        return
    words = f"to be shown as {shown[0]:g} x {shown[1]:g} px, stored as {stored[0]} x {stored[1]}"
    aspect = shown[0] * stored[1] / (shown[1] * stored[0])
    if abs(aspect - 1) * min(stored) < 1:
        yield VideoStatement("display size", words)
    else:
        yield VideoStatement(
            "pixel aspect", words, {"aspect": f"{1 / aspect if turned else aspect:.6g}"}
        )


def _turn(track: Linear, movie: Linear, whole: bytes) -> Iterator[VideoStatement]:
    a, b, c, d = track
    e, f, g, h = movie
    both = (a * e + b * g, a * f + b * h, c * e + d * g, c * f + d * h)
    words = f"its matrix is {', '.join(f'{value:g}' for value in both)}"
    scale = max(map(abs, both)) or 1.0
    turn = tuple(round(value / scale, 4) for value in both)
    if any(whole[8:12] + whole[20:24]) or (turn not in _TURNS and turn not in _MIRRORED):
        if both[0] > 0 < both[3] and not both[1] and not both[2]:
            yield VideoStatement("pixel aspect", words, {"aspect": f"{both[0] / both[3]:.6g}"})
        else:
            yield VideoStatement("mirror image, other turn", words, {"cure": UPRIGHT})
    elif turn in _MIRRORED:
        yield VideoStatement("mirror image, other turn", words)
    elif turn != _TURNS[0]:
        degrees = 90 * _TURNS.index(turn)
        yield VideoStatement(
            "turn by 90, 180 or 270 degrees", f"{180 if degrees == 180 else 90} degrees"
        )
    if scale != 1:
        yield VideoStatement("display size", words)


def _edits(data: bytes) -> Iterator[VideoStatement]:
    form, size = (">Qqi", 20) if data[0] else (">Iii", 12)
    count = min(int.from_bytes(data[4:8]), (len(data) - 8) // size)
    for number in range(count):
        _, start, speed = struct.unpack_from(form, data, 8 + number * size)
        if start == -1 and number == 0:
            yield VideoStatement("late start", "an edit of no frames at its start")
        elif start == -1:  # FFmpeg goes wrong here
            values = {"cure": "export it anew, without an edit of no frames"}
            yield VideoStatement("frame times", "an edit of no frames between others", values)
        elif speed != 1 << 16:
            yield _speed(speed / (1 << 16))


def _speed(speed: float) -> VideoStatement:
    values = {"speed": speed} if speed > 0 else {"cure": "export it anew at its own speed"}
    return VideoStatement("playback speed", f"its speed is {speed:g}", values)


def _entry(coding: str, data: bytes) -> Iterator[VideoStatement]:
    if coding == "encv":
        yield VideoStatement("encryption", "its frames are encrypted")
    width, height = struct.unpack(">HH", data[24:28])
    dolby: list[VideoStatement] = []
    for box, inner in _boxes(data[78:]):
        match box:
            case "colr" if inner[:4] in (b"nclx", b"nclc"):
                yield from colour(*struct.unpack(">HHH", inner[4:10]))
            case "colr":
                yield VideoStatement("ICC profile", "its colour profile")
            case "gama":
                yield gamma(_fixed(inner, 0))
            case "pasp":
                across, down = struct.unpack(">II", inner[:8])
                if across != down and across and down:
                    yield VideoStatement("pixel aspect", f"its pixels are {across}:{down}")
            case "clap":
                yield from _aperture(inner, width, height)
            case "fiel":
                if inner[0] == 2:
                    yield VideoStatement("interlacing", "its frames are two fields")
            case "st3d":
                if inner[4]:
                    yield laid_out(
                        "stereo", _STEREO.get(inner[4]), f"stereo mode {inner[4]} of 'st3d'"
                    )
            case "vexu":  # decoders show the view of the base layer
                yield VideoStatement("stereo", "views for two eyes, 'vexu'", {"cure": ""})
            case "sv3d":
                names = [name for kind, name in _PROJECTIONS.items() if kind in inner]
                yield laid_out("spherical", names[0] if names else None, "a projection, 'sv3d'")
            case "sinf":
                yield VideoStatement("encryption", "its frames are encrypted")
            case "chrm":
                if inner[:2] not in (b"\0\0", b"\1\1"):
                    yield VideoStatement("chroma siting", f"chroma siting {inner[0]}, {inner[1]}")
            case "dvcC" | "dvvC" | "dvwC":
                dolby.append(dolby_vision(inner))
            case _ if box in _LIGHT:
                yield VideoStatement("light levels of the mastering display", f"{box!r}")
            case _:
                yield from other("MP4: the video's coding", "a box", box)
    yield from dolby


def dolby_vision(record: bytes) -> VideoStatement:
    """Return the meaning of a Dolby Vision configuration record."""
    profile = record[2] >> 1
    if record[4] >> 4:
        return VideoStatement("Dolby Vision", f"Dolby Vision, profile {profile}")
    return VideoStatement("Dolby Vision without a base layer", f"Dolby Vision, profile {profile}")


def _aperture(data: bytes, width: int, height: int) -> Iterator[VideoStatement]:
    numbers = struct.unpack(">IIIIiIiI", data[:32])
    if not all(numbers[1::2]):
        return
    across, down, right, below = (n / d for n, d in zip(numbers[::2], numbers[1::2], strict=True))
    left, top = (width - across) / 2 + right, (height - down) / 2 + below
    yield from cropped((width, height), (left, top, across, down))


def cropped(
    stored: tuple[int, int], shown: tuple[float, float, float, float]
) -> Iterator[VideoStatement]:
    """Yield the meaning of a shown part (left, top, width, height) of the stored picture."""
    x, y, width, height = map(round, shown)
    if (x, y, width, height) == (0, 0, *stored):
        return
    words = f"to be shown: {width} x {height} of {stored[0]} x {stored[1]} px, from {x}, {y}"
    values = {"x": x, "y": y, "width": width, "height": height}
    yield VideoStatement("clean aperture, crop", words, values)


def _user(data: bytes) -> Iterator[VideoStatement]:
    for box, _ in _boxes(data):
        yield from other("MP4: the user data", "a box", box)


def _inside(data: bytes, *names: str) -> Iterator[bytes]:
    """Yield the contents of the boxes at a path of names."""
    for name, inner in _boxes(data):
        if name == names[0]:
            yield from _inside(inner, *names[1:]) if names[1:] else iter([inner])


def _boxes(data: bytes) -> Boxes:
    """Yield names and contents of boxes in a row, up to the first that is not whole."""
    at = 0
    while at + 8 <= len(data):
        size, head = int.from_bytes(data[at : at + 4]), 8
        if size == 1:
            size, head = int.from_bytes(data[at + 8 : at + 16]), 16
        size = size or len(data) - at
        if size < head or at + size > len(data):
            return
        yield data[at + 4 : at + 8].decode("latin-1"), data[at + head : at + size]
        at += size


def _of_file(path: Path) -> Boxes:
    """Yield names of a file's own boxes, and the contents of the movie's."""
    end = path.stat().st_size
    with path.open("rb") as file:
        at = 0
        while len(head := file.read(16)) >= 8:
            size, name, first = int.from_bytes(head[:4]), head[4:8].decode("latin-1"), 8
            if size == 1:
                size, first = int.from_bytes(head[8:]), 16
            size = size or end - at
            if size < first or (at + size > end and name == "moov"):
                return
            file.seek(at + first)
            yield name, file.read(size - first) if name == "moov" else b""
            at += size
            file.seek(at)


def _fixed(data: bytes, at: int) -> float:
    return int.from_bytes(data[at : at + 4], signed=True) / (1 << 16)


def _linear(data: bytes, at: int) -> Linear:
    a, b, c, d = (_fixed(data, at + offset) for offset in (0, 4, 12, 16))
    return a, b, c, d
