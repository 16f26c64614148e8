"""Harms files: at any byte, and inside what packs or seals them, so that a checksum is no shelter.

Everything follows from the generator that is handed in.
"""

import gzip
import io
import json
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from random import Random
from typing import Any

from protocols.disk.hashing import canonical_json
from protocols.journal_file import due, first_link

Change = Callable[[Random, bytes, Sequence[bytes]], bytes]

NUMBERS = (
    "0", "-0", "-1", "1", "nan", "inf", "-inf", "1e999", "-1e308", "1e-320", "0x10", "1_000",
    "2147483648", "-9223372036854775809", "18446744073709551616", "9" * 400, "9" * 5000, "",
    "0.1.2", "1e", "\u0663", "1,5",
)  # fmt: skip
WORDS = (
    "", "\0", "\x1b[31m", "../../x", "/etc/passwd", "=1+1", "[bold]", "\u202e", "\ud800", "\ufeff",
    "a" * 70_000, "[" * 3000, "{" * 3000, "'", '"', "\\", "%s%n", "null", "true", "\r", "\n",
    "1979-05-27", "<script>",
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**31, -(2**63), 2**70, 10**400, 0.5, -0.5, 1e308, float("nan"),
    float("inf"), "", "x", "../x", "\0", "\ud800", "9" * 5000, [], {}, [[]], [None], {"": 0},
    [0] * 5000,
)  # fmt: skip
WORDS_OF_32_BITS = (
    0, 1, 2**31 - 1, 2**31, 2**32 - 1, 2**16, 2**24, 0x7F800000, 0xFF800000, 0x7FC00000,
)  # fmt: skip


@dataclass(frozen=True)
class Shape:
    """Ways inside a kind of file and out again."""

    changes: tuple[Change, ...]
    """Changes that harm its inside."""
    inside: Callable[[bytes], bytes] = bytes
    outside: Callable[[bytes, bytes], bytes] = lambda _whole, inner: inner
    """From the whole file as it was, and the harmed inside."""


def mutated(rng: Random, data: bytes, shape: Shape, donors: Sequence[bytes] = ()) -> bytes:
    """Return a file that was harmed once or several times, inside or as it is."""
    for _ in range(1 + int(rng.expovariate(0.8))):
        if rng.random() < 0.3:
            data = rng.choice(BYTES)(rng, data, donors)
            continue
        try:
            inner = shape.inside(data)
            data = shape.outside(data, rng.choice(shape.changes)(rng, inner, donors))
        except (ValueError, KeyError, IndexError, RecursionError, struct.error, zlib.error,
                OSError, EOFError, zipfile.BadZipFile, NotImplementedError):  # fmt: skip
            data = rng.choice(BYTES)(rng, data, donors)  # harmed before: no inside any more
    return data


def _span(rng: Random, data: bytes) -> tuple[int, int]:
    first = rng.randrange(len(data) + 1)
    return first, min(len(data), first + int(rng.expovariate(1 / 20)) + 1)


def _bit(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    if not data:
        return b"\0"
    place = rng.randrange(len(data))
    return data[:place] + bytes([data[place] ^ 1 << rng.randrange(8)]) + data[place + 1 :]


def _byte(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    place = rng.randrange(len(data) + 1)
    return data[:place] + bytes([rng.randrange(256)]) + data[place + 1 :]


def _word(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """Write a number that readers trip over, in any width and order, where a number may stand."""
    value, place = rng.choice(WORDS_OF_32_BITS), rng.randrange(len(data) + 1)
    form = rng.choice(["<I", ">I", "<Q", ">Q", "<H", ">H", "B"])
    packed = struct.pack(form, value % 2 ** (8 * struct.calcsize(form)))
    return data[:place] + packed + data[place + len(packed) :]


def _gone(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    first, last = _span(rng, data)
    return data[:first] + data[last:]


def _doubled(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    first, last = _span(rng, data)
    return data[:first] + data[first:last] * rng.choice((2, 3, 200)) + data[last:]


def _cut(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _zeros(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    first, last = _span(rng, data)
    return data[:first] + bytes([rng.choice((0, 255))]) * (last - first) + data[last:]


def _spliced(rng: Random, data: bytes, donors: Sequence[bytes]) -> bytes:
    other = rng.choice(donors) if donors else data
    return data[: rng.randrange(len(data) + 1)] + other[rng.randrange(len(other) + 1) :]


BYTES: tuple[Change, ...] = (
    _bit,
    _bit,
    _byte,
    _word,
    _word,
    _gone,
    _doubled,
    _cut,
    _zeros,
    _spliced,
)


def _replaced(pattern: str, with_: Sequence[str]) -> Change:
    found = re.compile(pattern)

    def change(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
        text = data.decode("utf-8", "surrogateescape")
        places = list(found.finditer(text))
        if not places:
            return data
        place = rng.choice(places)
        new = text[: place.start()] + rng.choice(with_) + text[place.end() :]
        return new.encode("utf-8", "surrogatepass" if "\ud800" in new else "surrogateescape")

    return change


def _lines(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    lines = data.split(b"\n")
    one, two = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(4):
        case 0:
            lines[one], lines[two] = lines[two], lines[one]
        case 1:
            del lines[one]
        case 2:
            lines.insert(two, lines[one])
        case _:
            lines[one:one] = [lines[one]] * rng.choice((2, 500))
    return b"\n".join(lines)


_NUMBER = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
TEXT: tuple[Change, ...] = (
    _replaced(_NUMBER, NUMBERS),
    _replaced(_NUMBER, NUMBERS),
    _replaced(r"[A-Za-z_]+", WORDS),
    _replaced(r"[,;\t= ]", ("", ",", "\t", " ", ",,", "\n")),
    _lines,
)
TOML: tuple[Change, ...] = (
    *TEXT,
    _replaced(
        r"(?<== ).+",
        ("-1", "0", "nan", "inf", "1e308", "9223372036854775807", "true", '""', "[]", "{}", '"x"',
         "[[1]]", '["a", 1]', "1979-05-27T07:32:00Z", '"\\u0000"', "0.5", "1_000_000_000"),
    ),
)  # fmt: skip


def _json(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """Put an unlikely value at any place of a tree, take one out, or double one."""
    tree = json.loads(data)
    places = list(_places(tree))
    if not places:
        return data
    owner, key = rng.choice(places)
    match rng.randrange(4):
        case 0:
            del owner[key]
        case 1 if isinstance(owner, list):
            owner.extend([owner[key]] * rng.choice((1, 300)))
        case 1:
            owner["x"] = owner[key]
        case _:
            owner[key] = rng.choice(VALUES)
    return json.dumps(tree, separators=(",", ":")).encode("utf-8", "surrogatepass")


def _places(tree: Any) -> Any:
    if isinstance(tree, dict | list):
        for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
            yield tree, key
            yield from _places(value)


def _of_one_line(rng: Random, data: bytes, donors: Sequence[bytes]) -> bytes:
    lines = data.split(b"\n")
    place = rng.randrange(len(lines))
    lines[place] = _json(rng, lines[place], donors)
    return b"\n".join(lines)


def _gunzipped(data: bytes) -> bytes:
    return zlib.decompress(data, wbits=31)


def _unzipped(data: bytes) -> bytes:
    """Return the first file of a zip archive."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return archive.read(archive.namelist()[0])


def _zipped(data: bytes, inner: bytes) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(made, "w") as new:
        first, *rest = old.namelist()
        new.writestr(first, inner)
        for name in rest:
            new.writestr(name, old.read(name))
    return made.getvalue()


def _with_png_sums(_: bytes, data: bytes) -> bytes:
    """Compute the checksum of every chunk of a PNG file anew."""
    made, place = data[:8], 8
    while place + 12 <= len(data):
        length = int.from_bytes(data[place : place + 4], "big")
        body = data[place + 4 : place + 8 + length]
        made += data[place : place + 4] + body + zlib.crc32(body).to_bytes(4, "big")
        place += 12 + length
    return made


def _glb_json(data: bytes) -> bytes:
    length = int.from_bytes(data[12:16], "little")
    if data[:4] != b"glTF" or len(data) < 20 + length:
        raise ValueError("no glb")
    return data[20 : 20 + length]


def _glb_with(data: bytes, inner: bytes) -> bytes:
    rest = data[20 + int.from_bytes(data[12:16], "little") :]
    inner += b" " * (-len(inner) % 4)
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(inner) + len(rest), len(inner), b"JSON")
    return head + inner + rest


def resealed(_: bytes, data: bytes) -> bytes:
    """Compute a journal's checksums anew."""
    before, lines = first_link(b""), []
    for line in data.split(b"\n"):
        try:
            event = json.loads(line)
            if "chain" in event:
                bare = canonical_json(event | {"chain": None})
                before = due(bare, before)
                line = canonical_json(event | {"chain": before})
        except (ValueError, TypeError, RecursionError, OverflowError):
            pass
        lines.append(line)
    return b"\n".join(lines)


RAW = Shape(BYTES)
PLAIN = Shape(TEXT)
STUDY = Shape(TOML)
TREE = Shape((_json, _json, *TEXT))
PACKED = Shape((*BYTES, *TEXT), _gunzipped, lambda _, inner: gzip.compress(inner, 1))
ZIPPED = Shape(BYTES, _unzipped, _zipped)
PNG = Shape(BYTES, bytes, _with_png_sums)
GLB = Shape((_json, _json, *TEXT), _glb_json, _glb_with)
JOURNAL = Shape((_of_one_line, _of_one_line, *TEXT), bytes, resealed)
