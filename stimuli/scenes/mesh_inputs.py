"""The files that a mesh consists of, and what their text says.

What a clip is known by is hashed before anything is loaded. The readers open these files and no
others.
"""

from __future__ import annotations

import base64
import json
import math
import re
import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from pipeline.errors import InputError
from pipeline.limits import check_vertices
from protocols.outside import visible_line
from stimuli.scenes.mesh_features import MTL_OPTIONS

ENDINGS = (".glb", ".gltf", ".obj")
PICTURES = ("map_Kd", "map_d", "map_Ke")
"""Statements of .mtl files whose pictures are drawn."""
_VALUES_OF = {"-s": (1, 3), "-o": (1, 3), "-t": (1, 3), "-mm": (2, 2)}


class MissingPartError(InputError, FileNotFoundError):
    """A file that a mesh names is not there."""


def files_of(path: Path) -> list[Path]:
    """Return `path` and every file that it names: buffers, images, material libraries.

    Raises
    ------
    FileNotFoundError
        If the file itself is missing.
    InputError
        If one that it names is missing or lies outside its folder, its own text cannot be read,
        or its kind is unknown.
    """
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"{path}: must end in {', '.join(ENDINGS)}")
    if not path.is_file():
        raise FileNotFoundError(2, "No such file", str(path))
    found = [path]
    if path.suffix.lower() == ".obj":
        for library in libraries_of(path):
            found.append(_named(path, path, library, "material library"))
            found += [_named(path, found[-1], image, "texture") for image in _images_of(found[-1])]
    else:
        read = document(path)
        for kind, what in (("buffers", "buffer"), ("images", "texture")):
            for entry in read.get(kind, []):
                uri = entry.get("uri")
                if isinstance(uri, str) and not uri.startswith("data:"):
                    found.append(_named(path, path, uri, what))
    return list(dict.fromkeys(found))


def libraries_of(path: Path) -> list[str]:
    """Return the material libraries that an .obj file names; a line may name several."""
    found: list[str] = []
    for text in words_after(path, "mtllib"):
        whole = _is_file(place_of(path.parent, text))
        found += [text] if whole else re.split(r"(?<=\.mtl)\s+", text, flags=re.IGNORECASE)
    return found


def place_of(folder: Path, name: str) -> Path:
    """Return the file that a mesh means by a name, which may be written with %20 or backslashes."""
    plain = name.strip()
    for text in (plain, unquote(plain), plain.replace("\\", "/")):
        if text and _is_file(folder / text):
            return folder / text
    return folder / unquote(plain)


def name_and_options(library: Path, text: str) -> tuple[str, list[tuple[str, list[str]]]]:
    """Return the file that a ``map_`` statement of an .mtl file names, and its options.

    Raises
    ------
    InputError
        If an option is not known, or lacks its values.
    """
    words, options = text.split(), []
    while words and words[0].startswith("-") and not _is_file(place_of(library.parent, text)):
        option = words.pop(0).lower()
        if option not in MTL_OPTIONS:
            raise InputError(
                f"{library}: must have options that are known (got {option[:40]!r}, in"
                f" {text[:80]!r}); leave it out, or export it again"
            )
        least, most = _VALUES_OF.get(option, (1, 1))
        numbers = most > 1
        count = 0
        while count < min(most, len(words) - 1) and (not numbers or _is_number(words[count])):
            count += 1
        if count < least:
            raise InputError(
                f"{library}: {option} must have {least} values before the picture's name (got"
                f" {text[:80]!r}); write them, or leave it out"
            )
        options.append((option, words[:count]))
        words = words[count:]
        text = text.split(None, 1 + count)[-1]
    return text, options


def check_lists(path: Path) -> None:
    """Refuse a mesh whose lists are too long to be made: a few bytes can state any length.

    Raises
    ------
    InputError
        With the length and the limit, or if a length is no whole number.
    """
    if path.suffix.lower() == ".obj":
        check_vertices(path, max(_lines_of(path).values()))
        return
    accessors = document(path).get("accessors", [])
    counts = [entry.get("count", 0) for entry in accessors if isinstance(entry, dict)]
    if not all(isinstance(count, int) and count >= 0 for count in counts):
        raise InputError(
            f"{path}: must be a whole glTF 2.0 file (the length of a list is no whole number);"
            " export it again"
        )
    check_vertices(path, max(counts, default=0))


def _lines_of(path: Path) -> Counter[bytes]:
    """Return how many lines of an .obj file begin with which of its words."""
    found: Counter[bytes] = Counter({b"v": 0})
    with path.open("rb") as file:
        for line in file:
            found[line[:2].strip()] += 1
    return found


def data_of_uri(uri: str) -> bytes:
    """Return what a data URI holds."""
    head, _, data = uri.partition(",")
    return base64.b64decode(data) if head.endswith(";base64") else unquote(data).encode("latin-1")


def other_chunks(path: Path) -> list[str]:
    """Return the chunks of a .glb file that are neither its JSON nor its first buffer."""
    data = memoryview(path.read_bytes()) if path.suffix.lower() == ".glb" else memoryview(b"")
    found, place = [], 12
    while place + 8 <= len(data):
        length, kind = struct.unpack_from("<I4s", data, place)
        found.append(kind.decode("latin-1").strip("\0"))
        place += 8 + length
    return [kind for kind in found[1:] if kind != "BIN"]


def bytes_of_buffer(path: Path, buffer: dict[str, Any]) -> bytes:
    """Return the bytes of a glTF buffer; without a name, they lie in the .glb file itself."""
    uri = buffer.get("uri")
    if uri is None:
        data = path.read_bytes()
        (json_length,) = struct.unpack_from("<I", data, 12)
        (length,) = struct.unpack_from("<I", data, 20 + json_length)
        first = 20 + json_length + 8
        return data[first : first + length]
    return data_of_uri(uri) if uri.startswith("data:") else place_of(path.parent, uri).read_bytes()


def document(path: Path) -> dict[str, Any]:
    """Return the JSON of a glTF file.

    Raises
    ------
    InputError
        If it is none.
    """
    data = path.read_bytes()
    try:
        if path.suffix.lower() == ".glb":
            magic, version, _, length, kind = struct.unpack_from("<4sIII4s", data)
            if magic != b"glTF" or version != 2 or kind != b"JSON":
                raise ValueError("it is not a binary glTF 2.0 file")
            data = data[20 : 20 + length]
        read = json.loads(data)
        if b"\\u" in data:  # half a character, which no message could show
            json.dumps(read, ensure_ascii=False).encode()
        if not isinstance(read, dict) or "asset" not in read:
            raise ValueError("it has no asset entry")
        for kind in (
            "buffers",
            "images",
            "textures",
            "materials",
            "bufferViews",
            "meshes",
            "accessors",
        ):
            entries = read.get(kind, [])
            if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
                raise ValueError(f"its {kind} are no list of objects")
    except (ValueError, struct.error, RecursionError) as error:
        raise InputError(
            f"{path}: must be a whole glTF 2.0 file ({error}); export it again"
        ) from error
    return read


def statements(path: Path) -> Iterator[tuple[int, str, str]]:
    """Yield number, first word in small letters, and rest of the lines that are no remarks.

    A line that ends in a backslash goes on in the next one.
    """
    kept, start = "", 0
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            if not kept and line.lstrip().startswith("#"):
                continue
            start = start if kept else number
            if "\\" in line and line.rstrip().endswith("\\"):
                kept += line.rstrip()[:-1] + " "
                continue
            words, kept = (kept + line).split(None, 1), ""
            if words:
                yield start, words[0].lower(), words[1].rstrip() if len(words) > 1 else ""
    if words := kept.split(None, 1):
        yield start, words[0].lower(), words[1].rstrip() if len(words) > 1 else ""


def words_after(path: Path, key: str) -> list[str]:
    """Return what follows a keyword at the beginning of a line, in any case."""
    return [rest for _, word, rest in statements(path) if word == key.lower() and rest]


def _is_file(path: Path) -> bool:
    """Whether it is a file; a name that is too long for one is none."""
    try:
        return path.is_file()
    except OSError:
        return False


def _leads_out(folder: Path, place: Path) -> bool:
    """Whether a file lies outside a folder: a symbolic link leads out as well as ".." does."""
    try:
        return not place.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # links in a circle, names that cannot be
        return False


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False


def _images_of(library: Path) -> list[str]:
    found = [text for key in PICTURES for text in words_after(library, key)]
    return [name_and_options(library, text)[0] for text in found]


def _named(mesh: Path, named_in: Path, name: str, what: str) -> Path:
    """Return the file of a name, which must be there and not leave the mesh's folder."""
    place = place_of(mesh.parent, name)
    if _leads_out(mesh.parent, place):
        raise InputError(
            f"{named_in}: must name files in its own folder ({name!r} lies outside); put the"
            f" {what} itself there, or export the scene as one .glb file"
        )
    if not _is_file(place):
        raise MissingPartError(
            f"{named_in}: names a {what} that is missing ({visible_line(str(place))}); put it"
            " there, or export the scene as one .glb file"
        )
    return place
