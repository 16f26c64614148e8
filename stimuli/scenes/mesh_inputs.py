"""The files that a mesh consists of, and what their text says.

What a clip is known by is hashed before anything is loaded. The readers open these files and no
others.
"""

from __future__ import annotations

import base64
import io
import json
import re
import struct
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

from PIL import Image

from pipeline.errors import InputError
from pipeline.pictures.size_limits import check_memory, check_vertices
from protocols.errors import did_you_mean
from protocols.gone import gone
from protocols.limits import check_within
from protocols.outside import bounded_bytes, parsed_json, visible_line
from stimuli.scenes.builtin_scenes import scene_names

ENDINGS = (".glb", ".gltf")
_MOST_BYTES = 1 << 60
"""Largest count of bytes: what is longer is as much too long, and this fits a float."""
_VERTEX_BYTES, _INDEX_BYTES, _NUMBER_BYTES, _SHOWN = 1000, 30, 8, 2
_TEXEL_BYTES, _LARGEST_TEXEL_BYTES = 12, 40
"""Memory of parts of a mesh, measured, in bytes: a vertex takes twice as much each time that it is
shown, a texture more while it is unpacked."""
_CORNERS_OF_A_VERTEX = 48
"""Indices for each vertex, by which a large mesh is one: a closed surface has 6, one that is there
from both sides 12."""
_PARTS = {"VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
"""Numbers of an entry by its type."""
_DRAWN = (
    ("pbrMetallicRoughness", "baseColorTexture"),
    ("extensions", "KHR_materials_pbrSpecularGlossiness", "diffuseTexture"),
    ("emissiveTexture",),
)
"""Places where a material names pictures that are drawn."""
_ELSEWHERE = re.compile(r"[a-z]:[/\\]|file:|\\\\", re.IGNORECASE)
"""Begins a place on some other machine."""
_INSTANCES = "EXT_mesh_gpu_instancing"


class MissingPartError(InputError, FileNotFoundError):
    """A file that a mesh names is not there."""


def files_of(path: Path) -> list[Path]:
    """Return `path` and every file that it names: buffers and images.

    Raises
    ------
    FileNotFoundError
        If the file itself is missing.
    InputError
        If one that it names is missing or lies outside its folder, its own text cannot be read,
        or its kind is unknown.
    """
    if path.suffix.lower() not in ENDINGS:
        ending = path.suffix.lower()
        why = (
            f"; {ending} {gone(ending)}" if gone(ending) else did_you_mean(str(path), scene_names())
        )
        raise InputError(f"{path}: must end in {', '.join(ENDINGS)}{why}")
    if not path.is_file():
        raise FileNotFoundError(2, "No such file", str(path))
    found = [path]
    read = document(path)
    for kind, what in (("buffers", "buffer"), ("images", "texture")):
        named = (entry.get("uri") for entry in read.get(kind, []))
        uris = dict.fromkeys(uri for uri in named if isinstance(uri, str))
        check_within("nodes", len(uris), InputError, path, f"{kind} that differ")
        found += [_named(path, uri, what) for uri in uris if not is_data(uri)]
    return list(dict.fromkeys(found))


def file_of_name(mesh: Path, name: str) -> Path:
    """Return the file that a mesh means by a name: with %20, backslashes or quotation marks.

    A place outside the mesh's folder, such as ``C:\\...\\wood.png`` on the machine that exported
    it, means the file of that name beside the mesh.
    """
    plain = name.strip()
    bare = plain.strip('"')
    texts = (unquote(plain), plain, bare, unquote(bare), bare.replace("\\", "/"))
    beside = mesh.parent / re.split(r"[/\\]", unquote(bare))[-1]
    if _ELSEWHERE.match(unquote(bare)):
        return beside
    places = (mesh.parent / text for text in texts if text)
    found = next(filter(_is_file, places), mesh.parent / unquote(bare))
    return beside if _leads_out(mesh.parent, found) and _is_file(beside) else found


def check_lists(path: Path) -> None:
    """Refuse a mesh that is more than its files can hold, by its document alone.

    A few bytes can state lists of any length, use one list a thousand times, and unpack to
    pictures of any size.

    Raises
    ------
    InputError
        With the count and the limit, or if a length is no whole number.
    """
    files = files_of(path)
    packed = sum(file.stat().st_size for file in files)
    read = document(path)
    try:
        _check_gltf(path, read, packed)
        _check_pictures(path, _pictures(path, read), packed)
    except InputError:
        raise
    except (
        LookupError,
        TypeError,
        ValueError,
        ArithmeticError,
        AttributeError,
        struct.error,
    ) as error:
        raise InputError(
            f"{path}: must be a whole glTF 2.0 file ({visible_line(repr(error))}); export it again"
        ) from None


def _check_gltf(path: Path, read: dict[str, Any], packed: int) -> None:
    accessors, views, nodes = (read.get(k, []) for k in ("accessors", "bufferViews", "nodes"))
    counts = [entry.get("count", 0) for entry in accessors]
    if not all(isinstance(count, int) and count >= 0 for count in counts):
        raise InputError(
            f"{path}: must be a whole glTF 2.0 file (the length of a list is no whole number);"
            " export it again"
        )
    check_vertices(path, max(counts, default=0))
    primitives = [part for mesh in read.get("meshes", []) for part in mesh["primitives"]]
    kinds = ("meshes", "nodes", "materials", "textures", "images", "buffers")
    longest = max(len(primitives), *(len(read.get(kind, [])) for kind in kinds))
    check_within("nodes", longest, InputError, path, "meshes, nodes, materials, ... each")
    numbers = [n * _PARTS.get(entry["type"], 1) for entry, n in zip(accessors, counts, strict=True)]
    taken = sum(min(int(view["byteLength"]), _MOST_BYTES) for view in views)
    taken += _NUMBER_BYTES * sum(numbers)
    each = [_bytes_of(mesh, counts) for mesh in read.get("meshes", [])]
    taken += sum(each)
    shown: Counter[int] = Counter()
    for node in nodes:
        if "mesh" in node:
            many = node.get("extensions", {}).get(_INSTANCES, {}).get("attributes", {})
            shown[node["mesh"]] += max((counts[entry] for entry in many.values()), default=1)
    taken += _SHOWN * sum(each[mesh] * times for mesh, times in shown.items())
    placed = [part for part in primitives if "POSITION" in part["attributes"]]
    corners = sum(counts[part["indices"]] for part in placed if "indices" in part)
    vertices = sum(counts[part["attributes"]["POSITION"]] for part in placed)
    counted = packed if corners <= _CORNERS_OF_A_VERTEX * vertices else 0
    check_memory(path, taken, "its lists, each as often as it is used,", packed, counted)
    _check_tree(path, nodes)


def _bytes_of(mesh: dict[str, Any], counts: list[int]) -> int:
    """Return the memory that a mesh takes."""
    return sum(
        _VERTEX_BYTES * counts[part["attributes"]["POSITION"]]
        + _INDEX_BYTES * (counts[part["indices"]] if "indices" in part else 0)
        for part in mesh["primitives"]
        if "POSITION" in part["attributes"]
    )


def _check_tree(path: Path, nodes: list[dict[str, Any]]) -> None:
    """Refuse nodes that are children of two, which glTF 2.0 (3.5.2) forbids."""
    parents: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.get("children", []):
            if parents.setdefault(child, number) != number or not 0 <= child < len(nodes):
                raise InputError(
                    f"{path}: a node must be the child of one other (node {child} is of two, or"
                    " there is none of this number); export it again"
                )


def _pictures(path: Path, read: dict[str, Any]) -> Iterator[tuple[str, Path | bytes]]:
    """Yield every picture of a glTF file with its name, once more for each material that has it."""
    textures = read.get("textures", [])
    used: Counter[object] = Counter()
    for material in read.get("materials", []):
        for keys in _DRAWN:
            entry: Any = material
            for key in keys:
                entry = entry.get(key) if isinstance(entry, dict) else None
            with suppress(KeyError, IndexError, TypeError):  # refused where it is used
                used[textures[entry["index"]].get("source")] += 1
    for number, image in enumerate(read.get("images", [])):
        uri, name = image.get("uri"), f"picture {number}"
        source: Path | bytes = b""
        if isinstance(uri, str):
            source = data_of_uri(path, uri) if is_data(uri) else file_of_name(path, uri)
        elif "bufferView" in image:
            source = _of_view(path, read, image)
        yield from [(name, source)] * (1 + used[number])


def _check_pictures(path: Path, found: Iterable[tuple[str, Path | bytes]], packed: int) -> None:
    """Refuse pictures that together take too much; what is none is refused where it is used."""
    pixels, largest = 0, 0
    known: dict[str, int] = {}
    for name, source in found:
        if name not in known:
            known[name] = 0
            data = io.BytesIO(source) if isinstance(source, bytes) else source
            with suppress(Exception), Image.open(data) as picture:
                known[name] = picture.width * picture.height
        pixels, largest = pixels + known[name], max(largest, known[name])
    need = _TEXEL_BYTES * pixels + _LARGEST_TEXEL_BYTES * largest
    check_memory(path, need, "its pictures, each as often as it is used,", packed)


def is_data(uri: str) -> bool:
    """True if a uri holds its data itself."""
    return uri[:5].lower() == "data:"


def data_of_uri(path: Path, uri: str) -> bytes:
    """Return the bytes of a data URI of a glTF file.

    Raises
    ------
    InputError
        If it is not whole.
    """
    head, comma, data = uri.partition(",")
    if comma and not head.lower().endswith(";base64"):
        return unquote_to_bytes(data)
    try:
        return base64.b64decode("".join(unquote(data if comma else "-").split()), validate=True)
    except ValueError as error:
        raise InputError(
            f"{path}: a data URI must hold whole base64 ({visible_line(str(error))}); export it"
            " again"
        ) from None


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
    return data_of_uri(path, uri) if is_data(uri) else file_of_name(path, uri).read_bytes()


def _of_view(path: Path, read: dict[str, Any], image: dict[str, Any]) -> bytes:
    view = read["bufferViews"][image["bufferView"]]
    whole = bytes_of_buffer(path, read["buffers"][view["buffer"]])
    first = int(view.get("byteOffset", 0))
    return whole[first : first + int(view["byteLength"])]


def document(path: Path) -> dict[str, Any]:
    """Return the JSON of a glTF file.

    Raises
    ------
    InputError
        If it is none.
    """
    try:
        if path.suffix.lower() == ".glb":
            with path.open("rb") as file:
                head = file.read(20)
                magic, version, _, length, kind = struct.unpack("<4sIII4s", head)
                if magic != b"glTF" or version != 2 or kind != b"JSON":
                    raise ValueError("it is not a binary glTF 2.0 file")
                check_within("text", length, InputError, path, "bytes of JSON")
                data = file.read(length)
        else:
            data = bounded_bytes(path, InputError)
        read = parsed_json(path, data, "a whole glTF 2.0 file", InputError, "export it again")
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
            "nodes",
        ):
            entries = read.get(kind, [])
            if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
                raise ValueError(f"its {kind} are no list of objects")
    except InputError:
        raise
    except (ValueError, struct.error) as error:
        raise InputError(
            f"{path}: must be a whole glTF 2.0 file ({error}); export it again"
        ) from error
    return read


def _is_file(path: Path) -> bool:
    """True if it is a file; a name that is too long for one is none."""
    try:
        return path.is_file()
    except OSError:
        return False


def _leads_out(folder: Path, place: Path) -> bool:
    """True if a file lies outside a folder: a symbolic link leads out as well as ".." does."""
    try:
        return not place.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # links in a circle, names that cannot be
        return False


def _named(mesh: Path, name: str, what: str) -> Path:
    """Return the file of a name, which must be there and not leave the mesh's folder."""
    place = file_of_name(mesh, name)
    if _leads_out(mesh.parent, place):
        raise InputError(
            f"{mesh}: must name files in its own folder ({name!r} lies outside); put the"
            f" {what} itself there, or export the scene as one .glb file"
        )
    if not _is_file(place):
        raise MissingPartError(
            f"{mesh}: names a {what} that is missing ({visible_line(str(place))}); put it"
            " there, or export the scene as one .glb file"
        )
    return place
