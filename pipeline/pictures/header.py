"""Headers of image files: statements one by one, size, and number of pictures.

Statements are read where OpenImageIO drops them, too. What is refused and what is noted says
the table in `pipeline.statements.rows`.
"""

from __future__ import annotations

import contextlib
import re
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Final

import OpenImageIO as oiio  # noqa: N813  its own documentation calls it so
from PIL import Image, features

from pipeline.errors import InputError, note
from pipeline.pictures.size_limits import check_need
from pipeline.statements.check_statements import refusal
from pipeline.statements.row import Use, rows_about
from pipeline.statements.rows import COLOUR_SPACES, ROWS
from protocols.outside import reading, visible_line

_MOST_BYTES = 1 << 22  # of one statement; a longer one is known by name alone
_MOST = 100_000  # statements of a file
_TIFF_TYPES = {1: "B", 2: "c", 3: "H", 4: "I", 5: "II", 6: "b", 7: "c", 8: "h", 9: "i", 10: "ii",
               11: "f", 12: "d", 13: "I", 16: "Q", 17: "q", 18: "Q"}  # fmt: skip
_BARE_SEGMENTS = {0x01, *range(0xD0, 0xD8)}  # of JPEG: no length follows
_SCAN = 0xDA
_XMP_OF_PNG = b"XML:com.adobe.xmp\0\0"
_XMP_OF_JPEG = b"http://ns.adobe.com/xap/1.0/"
_PNG_START = b"\x89PNG\r\n\x1a\n"
Statements = Mapping[str, Any]
Chunks = Iterator[tuple[int, str, Any]]
"""Part, key and value of each statement, in the order of the file."""


def read_statements(path: Path, kind: str) -> list[Statements]:
    """Return the statements of each part of a file's header; most kinds have one part.

    Parameters
    ----------
    path : Path
    kind : str
        OpenImageIO's name of the format. Of formats that are not among `WALKERS`, there is no part.

    Notes
    -----
    Damaged headers end early: whether a file is whole is for the reader of its pixels to say.
    """
    walker = WALKERS.get(kind)
    if walker is None:
        return []
    parts: list[dict[str, Any]] = []
    with path.open("rb") as file:
        try:
            for number, (part, name, value) in enumerate(walker(file)):
                while len(parts) <= part:
                    parts.append({})
                parts[part].setdefault(name, value)
                if number > _MOST:
                    break
        except (struct.error, ValueError, IndexError, OverflowError):
            pass
    return list(parts)


def _png(file: BinaryIO) -> Chunks:
    """Chunks by name."""
    if file.read(8) != _PNG_START:
        return
    pixels = False
    while len(head := file.read(8)) == 8:
        length, name = struct.unpack(">I4s", head)
        data = _taken(file, length)
        pixels |= name == b"IDAT"
        yield 0, "late eXIf" if pixels and name == b"eXIf" else name.decode("latin-1"), data
        if name == b"iTXt" and data.startswith(_XMP_OF_PNG):
            yield 0, "XMP", data
        file.seek(4, 1)
        if name == b"IEND":
            return


def _jpeg(file: BinaryIO) -> Chunks:
    """Segments: of applications by number and by what they begin with."""
    file.seek(2)
    while len(head := file.read(2)) == 2 and head[0] == 0xFF:
        code = head[1]
        if code == _SCAN:
            return
        if code in _BARE_SEGMENTS or code == 0xFF:
            file.seek(-1 if code == 0xFF else 0, 1)
            continue
        (length,) = struct.unpack(">H", file.read(2))
        data = _taken(file, length - 2)
        if 0xE0 <= code <= 0xEF:
            word = re.match(rb"[\x20-\x7e]*", data)
            yield 0, f"APP{code - 0xE0} {(word[0] if word else b'')[:32].decode()}".strip(), data
            if data.startswith(_XMP_OF_JPEG):
                yield 0, "XMP", data
        elif code == 0xFE:
            yield 0, "COM", data


def _tiff(file: BinaryIO) -> Chunks:
    """Tags of the first page by number."""
    head = file.read(16)
    order = "<" if head[:2] == b"II" else ">"
    big = struct.unpack(order + "H", head[2:4])[0] == 43
    word, counted, size = ("Q", "Q", 8) if big else ("I", "H", 4)
    file.seek(struct.unpack_from(order + word, head, 8 if big else 4)[0])
    (count,) = struct.unpack(order + counted, file.read(8 if big else 2))
    entries = file.read((12 + 2 * (size - 4)) * min(count, 65535))
    step = 12 + 2 * (size - 4)
    for start in range(0, len(entries), step):
        tag, kind, number = struct.unpack_from(order + "HH" + word, entries, start)
        form = _TIFF_TYPES.get(kind, "B")
        length = struct.calcsize(order + form) * number
        data = entries[start + 4 + size : start + step]
        if length > size:
            file.seek(struct.unpack(order + word, data)[0])
            data = _taken(file, length)
        value = _tiff_value(order, kind, form, number, data[:length])
        yield 0, f"tag {tag}", value
        if tag == 700 and isinstance(value, bytes):
            yield 0, "XMP", value


def _tiff_value(order: str, kind: int, form: str, number: int, data: bytes) -> Any:
    if kind in (2, 7) or form == "B":
        return data[:number]
    values = struct.unpack_from(f"{order}{number * len(form)}{form[0]}", data)
    if len(form) == 2:  # of a numerator and a denominator
        return tuple(
            top / bottom if bottom else 0.0
            for top, bottom in zip(values[::2], values[1::2], strict=True)
        )
    return values


def _openexr(file: BinaryIO) -> Chunks:
    """Attributes of each part by name."""
    (flags,) = struct.unpack("<4xI", file.read(8))
    part = 0
    while True:
        name = _word(file)
        if not name:
            part += 1
            if not flags & 0x1000 or not _peek(file):
                return
            continue
        kind = _word(file)
        (length,) = struct.unpack("<i", file.read(4))
        if length < 0:
            return
        yield part, name, _exr_value(kind, _taken(file, length))


def _exr_value(kind: str, data: bytes) -> Any:
    match kind:
        case "string":
            return data.decode("utf-8", "replace")
        case "float" | "chromaticities" | "v2f" | "v3f":
            return struct.unpack(f"<{len(data) // 4}f", data)
        case "int" | "box2i":
            return struct.unpack(f"<{len(data) // 4}i", data)
        case "compression" | "envmap" | "lineOrder" | "deepImageState":
            return data[0]
    return data


def _hdr(file: BinaryIO) -> Chunks:
    """Lines NAME=VALUE, and the line of the size."""
    for _ in range(_MOST):
        line = file.readline(4096).decode("latin-1").strip()
        name, equals, value = line.partition("=")
        if not line:
            break
        if equals and not line.startswith("#"):
            yield 0, name.strip(), value.strip()
    yield 0, "size", " ".join(re.findall(r"[-+][XY]", file.readline(4096).decode("latin-1")))


def _webp(file: BinaryIO) -> Chunks:
    """Chunks by name."""
    file.seek(12)
    while len(head := file.read(8)) == 8:
        name, length = struct.unpack("<4sI", head)
        yield 0, name.decode("latin-1").strip(), _taken(file, length)
        file.seek(length % 2, 1)


def _bmp(file: BinaryIO) -> Chunks:
    """The colour space of a header of version 4 or 5."""
    head = file.read(74)
    (size,) = struct.unpack_from("<I", head, 14)
    if size >= 108:
        yield 0, "bV4CSType", struct.unpack_from("<I", head, 70)[0].to_bytes(4, "big")
    across, down = struct.unpack_from("<ii", head, 38)
    yield 0, "pixels per metre", (across, down)


def _gif(file: BinaryIO) -> Chunks:
    yield 0, "pixel aspect", file.read(13)[12]


def _pnm(_file: BinaryIO) -> Chunks:
    """Nothing beside the pixels."""
    yield from ()


def _taken(file: BinaryIO, length: int) -> bytes:
    """The bytes of a statement, or none of a long one."""
    if length > _MOST_BYTES:
        file.seek(length, 1)
        return b""
    return file.read(length)


def _peek(file: BinaryIO) -> bool:
    """True if another part follows in a header of several."""
    there = file.read(1)
    file.seek(-len(there), 1)
    return there not in (b"", b"\0")


def _word(file: BinaryIO) -> str:
    """Text up to a zero."""
    found = b""
    while (letter := file.read(1)) not in (b"", b"\0"):
        found += letter
        if len(found) > 255:
            raise ValueError("a name that never ends")
    return found.decode("utf-8", "replace")


WALKERS: Final[Mapping[str, Callable[[BinaryIO], Chunks]]] = {
    "png": _png,
    "jpeg": _jpeg,
    "tiff": _tiff,
    "openexr": _openexr,
    "hdr": _hdr,
    "webp": _webp,
    "bmp": _bmp,
    "gif": _gif,
    "pnm": _pnm,
}
_LISTED = 6  # names that a message lists


def check_statements(
    path: Path,
    kind: str,
    attributes: Mapping[str, Any],
    use: Sequence[Use],
    *,
    handled: Sequence[str] = (),
    encoded: bool = False,
) -> None:
    """Refuse or note what a picture's header says and no reader honours.

    Parameters
    ----------
    path : Path
    kind : str
        OpenImageIO's name of the format.
    attributes : mapping
        What OpenImageIO itself reads; those in rows of ``"any"`` count.
    use : sequence of Use
        What the file is read for.
    handled : sequence of str
        Statements that the caller deals with.
    encoded : bool
        Floats were said to hold encoded colour.

    Raises
    ------
    InputError
        If a statement is refused.
    """
    general = {name: attributes[name] for name in attributes if rows_about(ROWS, "any", name)}
    if "ICCProfile" in general:
        general["ICCProfile greys"] = general["ICCProfile"]
    handled = (*handled, *COLOUR_SPACES) if encoded else handled
    noted: dict[str, None] = {}
    unknown: dict[str, None] = {}
    for of, statements in (("any", general), *((kind, s) for s in read_statements(path, kind))):
        for name, value in statements.items():
            rows = [row for kind in {of: 0, "any": 0} for row in rows_about(ROWS, kind, name)]
            if not rows:
                unknown[name] = None
            for row in rows:
                counts = row.words and row.verdict != "honoured" and set(row.use) & set(use)
                if not counts or name in handled:
                    continue
                try:
                    found = f"its header has {name}" if row.judge is None else row.judge(
                        value, {**general, **statements}
                    )  # fmt: skip
                except Exception:  # of what no program should have written
                    noted[f"{name} is not understood, and left out"] = None
                    continue
                if found is not None:
                    noted[row.said(path, found)] = None
    if kind not in WALKERS:
        noted[f"what files of {kind} say beside their pixels is not looked at"] = None
    if unknown:
        listed = ", ".join([*unknown][:_LISTED])
        more = f" and {len(unknown) - _LISTED} more" if len(unknown) > _LISTED else ""
        noted[f"not known, and left out: {listed}{more}"] = None
    for text in noted:
        note(path, text)


UPRIGHT_EXIF = 1  # of Exif's orientations
_FIRST_ON_ITS_SIDE = 5  # of the eight orientations of Exif


def check_flat(path: Path, spec: oiio.ImageSpec) -> None:
    """Refuse deep pixels, of which OpenImageIO returns what was in memory.

    Raises
    ------
    InputError
        If a pixel may hold any number of samples.
    """
    if spec.deep:
        raise refusal(path, "deep pixels", "it is deep: any number of samples")


def forget_error(source: Any = oiio) -> None:
    """Forget what OpenImageIO would say of a file: bytes of it, which may be no text."""
    with contextlib.suppress(UnicodeDecodeError):
        source.geterror()


def stated_size_px(path: Path, *, upright: bool = False) -> tuple[int, int] | None:
    """Return width and height as an image file's header has them; None where it is no image.

    With `upright`, as it is seen once turned by its Exif orientation.
    """
    source = oiio.ImageInput.open(str(path)) if path.is_file() else None
    if source is None:
        forget_error()
        avif = opened_avif(path) if path.is_file() else None
        if avif is None:
            return None
        with avif:
            return avif.size
    spec = source.spec()
    source.close()
    size_px = int(spec.width), int(spec.height)
    turned = upright and spec.get_int_attribute("Orientation", UPRIGHT_EXIF) >= _FIRST_ON_ITS_SIDE
    return size_px[::-1] if turned else size_px


def check_fits(path: Path, command: str) -> None:
    """Refuse by its header a picture for which a command of `NEEDS` takes too much memory.

    Raises
    ------
    InputError
        As `pipeline.pictures.size_limits.check_need`. What is no picture, its reader refuses.
    """
    size_px = stated_size_px(path)
    if size_px is not None:
        check_need(path, command, *size_px)


def count_pictures(path: Path) -> int:
    """Return the number of pictures in an image file: pages of a TIFF, frames of a GIF, ..."""
    for part in read_statements(path, "png"):
        if len(frames := part.get("acTL", b"")) >= 4:  # of which OpenImageIO knows nothing
            beside = [name for name in part if name in ("fcTL", "IDAT")] == ["IDAT", "fcTL"]
            return int.from_bytes(frames[:4], "big") + beside
    source, count = oiio.ImageInput.open(str(path)), 0
    while source is not None and source.seek_subimage(count, 0):
        count += 1
    forget_error()
    if source is not None:
        forget_error(source)
        source.close()
    return count


_HEAD = 1 << 16
_HEIC = (b"heic", b"heix", b"hevc", b"heim", b"heis", b"mif1", b"msf1")
_SHOWN = (1, 2, 6, 13, 14, 15)  # transfers that are shown as sRGB, or not said
_PRIMARIES = (1, 2)
_CURE = "save it as PNG or JPEG"


def opened_avif(path: Path) -> Image.Image | None:
    """Open an AVIF picture of 8 bits; None where a file is none.

    Raises
    ------
    InputError
        If it is HEIC, is damaged, holds several pictures, has more bits or another range of
        colour, or Pillow has no decoder.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD)
    brands = head[8 : min(int.from_bytes(head[:4]), 256)] if head[4:8] == b"ftyp" else b""
    if not {b"avif", b"avis"} & {brands[at : at + 4] for at in range(0, len(brands), 4)}:
        if brands.startswith(_HEIC):
            raise InputError(f"{path}: is HEIC, which is not read; {_CURE}")
        return None
    if not features.check("avif"):
        raise InputError(f"{path}: is AVIF, which this Pillow does not read; {_CURE}")
    depths = re.findall(rb"pixi.{5}(.)", head, re.DOTALL)
    colours = re.findall(rb"colrnclx(..)(..)", head, re.DOTALL)
    if any(depth[0] > 8 for depth in depths) or any(
        int.from_bytes(first) not in _PRIMARIES or int.from_bytes(curve) not in _SHOWN
        for first, curve in colours
    ):
        raise InputError(
            f"{path}: an AVIF picture must have 8 bits and the colours of sRGB (has more); {_CURE}"
        )
    with reading(path, "a whole AVIF picture", InputError):
        image = Image.open(path, formats=["AVIF"])
    if (pictures := getattr(image, "n_frames", 1)) > 1:
        image.close()
        raise InputError(f"{path}: must hold one picture (holds {pictures}); {_CURE}")
    return image


def display_size(path: Path) -> tuple[int, int]:
    """Width and height of a file's display window, from its header alone.

    Raises
    ------
    InputError
        If it is no image.
    """
    with reading(path, "a whole image", InputError):
        source = oiio.ImageInput.open(str(path))
        if source is None:
            raise InputError(f"{path}: must be an image ({visible_line(oiio.geterror())})")
        spec = source.spec()
        source.close()
        return spec.full_width, spec.full_height
