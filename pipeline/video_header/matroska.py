"""Statements of Matroska and WebM files: RFC 9559."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final, TypeAlias

from pipeline.statements.check_statements import UPRIGHT, VideoStatement, other
from pipeline.video_header.coding import UNSAID, colour, gamma, laid_out
from pipeline.video_header.mp4 import cropped, dolby_vision, shown_size

_SEGMENT, _INFO, _TRACKS, _CHAPTERS = 0x18538067, 0x1549A966, 0x1654AE6B, 0x1043A770
_CROPS = (0x54CC, 0x54BB, 0x54DD, 0x54AA)  # left, top, right, bottom
_LIGHT = {0x55BC, 0x55BD, 0x55D0}
_STEREO: Final = {
    1: "sbsl", 2: "abr", 3: "abl", 6: "irr", 7: "irl", 8: "icr", 9: "icl", 11: "sbsr", 13: "al",
    14: "ar",
}  # fmt: skip
"""Stereo modes with FFmpeg's names, as far as its filter takes them apart."""
_ALPHA: Final = {b"V_VP8": "libvpx", b"V_VP9": "libvpx-vp9"}
"""Decoders of FFmpeg that give the transparency, which its own do not."""
_PROJECTIONS = {1: "equirect", 2: "c3x2"}

Elements: TypeAlias = Iterator[tuple[int, bytes]]


def statements(path: Path) -> Iterator[VideoStatement]:
    """Yield the statements of a Matroska or WebM file's header, as far as it is whole."""
    kinds: list[int] = []
    for name, data in _of_file(path):
        if name == _INFO:
            for element, _ in _elements(data):
                yield from _other("the segment's information", element)
        elif name == _CHAPTERS:
            for edition in _all(data, 0x45B9):
                if any(map(_number, _all(edition, 0x45DD))):
                    yield VideoStatement("ordered chapters", "ordered chapters")
        elif name == _TRACKS:
            for track in _all(data, 0xAE):
                kinds += map(_number, _all(track, 0x83))
                if kinds[-1:] == [1]:
                    yield from _track(track)
        else:
            yield from _other("the file", name)
    if kinds.count(1) > 1:
        yield VideoStatement("several video tracks", f"holds {kinds.count(1)}")
    if 2 in kinds:
        yield VideoStatement("sound", "its sound")
    for kind in sorted(set(kinds) - {1, 2}):
        yield VideoStatement("other tracks", f"a track of kind {kind}")


def _track(track: bytes) -> Iterator[VideoStatement]:
    for element, data in _elements(track):
        match element:
            case 0xB9:
                if not _number(data):
                    yield VideoStatement(
                        "track that is switched off", "the video track is switched off"
                    )
            case 0x234E7A:
                yield VideoStatement("interlacing", "it gives a duration of fields")
            case 0xE0:
                yield from _video(data, next(_all(track, 0x86), b""))
            case 0x6D80:
                for encoding in _all(data, 0x6240):
                    if any(True for _ in _all(encoding, 0x5035)):
                        yield VideoStatement("encryption", "its frames are encrypted")
            case 0x41E4:
                names = [d.to_bytes(4) for d in map(_number, _all(data, 0x41E7)) if d < 1 << 32]
                for record in _all(data, 0x41ED):
                    if names and names[0] in (b"dvcC", b"dvvC", b"dvwC"):
                        yield dolby_vision(record)
                if not names or names[0] not in (b"dvcC", b"dvvC", b"dvwC"):
                    yield VideoStatement("whatever else", f"additions to its blocks, {names}")
            case _:
                yield from _other("the video track", element)


def _video(video: bytes, codec: bytes) -> Iterator[VideoStatement]:
    found = dict(_elements(video))
    numbers = {element: _number(data) for element, data in found.items() if len(data) <= 8}
    stored = numbers.get(0xB0, 0), numbers.get(0xBA, 0)
    for element, data in found.items():
        value = numbers.get(element, 0)
        match element:
            case 0x9A:
                if value == 1:
                    yield VideoStatement("interlacing", "its frames are two fields")
            case 0x9D:
                if value not in (0, 2) and numbers.get(0x9A) != 2:
                    yield VideoStatement(
                        "interlacing", f"its frames are two fields, in the order {value}"
                    )
            case 0x53B8 | 0x53B9:
                if value:
                    words = f"{'old ' * (element == 0x53B9)}stereo mode {value}"
                    name = _STEREO.get(value) if element == 0x53B8 else None
                    yield laid_out("stereo", name, words)
            case 0x53C0:
                if value:
                    decoder = f"-c:v {_ALPHA[codec]}" if codec in _ALPHA else ""
                    yield VideoStatement("alpha", "its track has transparency", {"reader": decoder})
            case 0x2FB523:
                yield gamma(_float(data))
            case 0x55B0:
                yield from _colour(data)
            case 0x7670:
                yield from _projection(data)
            case _:
                yield from _other("the video's settings", element)
    left, top, right, bottom = (numbers.get(element, 0) for element in _CROPS)
    shown = left, top, stored[0] - left - right, stored[1] - top - bottom
    yield from cropped(stored, shown)
    if numbers.get(0x54B2, 0) == 0:
        size = numbers.get(0x54B0, shown[2]), numbers.get(0x54BA, shown[3])
        yield from shown_size(size, stored)


def _colour(data: bytes) -> Iterator[VideoStatement]:
    numbers = {element: _number(value) for element, value in _elements(data)}
    yield from colour(*(numbers.get(element, UNSAID) for element in (0x55BB, 0x55BA, 0x55B1)))
    siting = numbers.get(0x55B7, 1) or 1, numbers.get(0x55B8, 2) or 2
    if siting != (1, 2):
        yield VideoStatement("chroma siting", f"chroma siting {siting[0]}, {siting[1]}")
    for element in numbers:
        if element in _LIGHT:
            yield VideoStatement("light levels of the mastering display", "its light levels")
        else:
            yield from _other("the video's colour", element)


def _projection(data: bytes) -> Iterator[VideoStatement]:
    found = dict(_elements(data))
    kind = _number(found.get(0x7671, b"\0"))
    if kind:
        yield laid_out("spherical", _PROJECTIONS.get(kind), f"projection {kind}")
    yaw, pitch, roll = (_float(found.get(element, b"")) for element in (0x7673, 0x7674, 0x7675))
    if yaw or pitch or roll % 90:
        words = f"its pose is {yaw:g}, {pitch:g}, {roll:g} degrees"
        yield VideoStatement("mirror image, other turn", words, {"cure": UPRIGHT})
    elif roll:
        yield VideoStatement("turn by 90, 180 or 270 degrees", "")


def _other(where: str, element: int) -> Iterator[VideoStatement]:
    return other(f"Matroska: {where}", "an element", f"{element:X}")


def _all(data: bytes, wanted: int) -> Iterator[bytes]:
    return (inner for element, inner in _elements(data) if element == wanted)


def _elements(data: bytes) -> Elements:
    """Yield names and contents of elements in a row, up to the first that is not whole."""
    at = 0
    while at < len(data):
        name, size, first = _head(data[at : at + 12])
        if first == 0 or size is None or at + first + size > len(data):
            return
        yield name, data[at + first : at + first + size]
        at += first + size


def _of_file(path: Path) -> Elements:
    """Yield elements of a file and of its segment; contents only of those that are read here."""
    with path.open("rb") as file:
        at = 0
        while head := file.read(12):
            name, size, first = _head(head)
            if first == 0 or (size is None and name != _SEGMENT):
                return
            file.seek(at + first)
            yield name, file.read(size or 0) if name in (_INFO, _TRACKS, _CHAPTERS) else b""
            at += first + (0 if name == _SEGMENT else size or 0)
            file.seek(at)


def _head(head: bytes) -> tuple[int, int | None, int]:
    """Return name, size (None: unknown) and length of an element's head; length 0: none."""
    name = 9 - head[0].bit_length() if head else 9
    if name > 4 or len(head) <= name:
        return 0, None, 0
    length = 9 - head[name].bit_length()
    if length > 8 or len(head) < name + length:
        return 0, None, 0
    size = int.from_bytes(head[name : name + length]) & ((1 << 7 * length) - 1)
    unknown = size == (1 << 7 * length) - 1
    return int.from_bytes(head[:name]), None if unknown else size, name + length


def _number(data: bytes) -> int:
    return int.from_bytes(data)


def _float(data: bytes) -> float:
    form = {4: ">f", 8: ">d"}.get(len(data))
    return float(struct.unpack(form, data)[0]) if form else 0.0
