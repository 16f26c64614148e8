"""The files that a mesh consists of: which they are, and whether their pictures can be read.

What a clip is known by is hashed before anything is loaded. So its loader is given these files
and no others: one that it asks for besides is an error, and never a picture of unknown content.
"""

from __future__ import annotations

import base64
import io
import os.path
import re
import struct
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from PIL import Image
from trimesh.resolvers import Resolver

from pipeline.errors import InputError
from pipeline.limits import check_memory, check_values, check_vertices
from protocols.outside import bounded_bytes, check_within, parsed_json, visible_line

ENDINGS = (".glb", ".gltf", ".obj")
KNOWN_EXTENSIONS = {"KHR_materials_unlit", "KHR_texture_transform", "KHR_mesh_quantization",
                    "KHR_materials_pbrSpecularGlossiness", "KHR_lights_punctual"}  # fmt: skip
_MOST_CORNERS = 1000
_GROUPS_AT_ONCE = 40
_DEEPEST = 256
_VERTEX_BYTES, _INDEX_BYTES, _NUMBER_BYTES, _SHOWN = 1000, 30, 8, 2
_TEXEL_BYTES, _LARGEST_TEXEL_BYTES = 12, 40
"""What parts of a mesh take in memory, measured: a vertex twice as much each time that it is shown,
a texture more while it is unpacked."""
_PARTS = {"VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
"""Numbers of an entry by its type."""
_BASE_COLOUR = (
    ("pbrMetallicRoughness", "baseColorTexture"),
    ("extensions", "KHR_materials_pbrSpecularGlossiness", "diffuseTexture"),
)
_UNMOVED = {"offset": [0, 0], "rotation": 0, "scale": [1, 1], "texCoord": 0}


class OnlyThese(Resolver):
    """Hands a loader the files of a mesh, and notes what else it asks for."""

    def __init__(self, path: Path) -> None:
        self.folder = path.parent
        self.listed = {os.path.normpath(file) for file in files_of(path)}
        self.file_name = path.name
        self.refused: list[str] = []

    def get(self, name: str) -> bytes:
        """Return a file's bytes; `FileNotFoundError` if it is none of the mesh's."""
        place = place_of(self.folder, name)
        if os.path.normpath(place) not in self.listed:
            self.refused.append(name)
            raise FileNotFoundError(name)
        return place.read_bytes()

    def write(self, name: str, data: str | bytes) -> None:  # noqa: ARG002
        """Refuse: nothing is written beside a mesh."""
        raise PermissionError(name)

    def namespaced(self, namespace: str) -> Resolver:
        """Refuse: the files of a mesh have one folder."""
        raise FileNotFoundError(namespace)

    def keys(self) -> Iterator[str]:
        """Yield the files by their names relative to the mesh."""
        yield from (os.path.relpath(file, self.folder) for file in sorted(self.listed))


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
        for library in words_after(path, "mtllib"):
            found.append(_named(path, path, library, "material library"))
            found += [_named(path, found[-1], image, "texture") for image in _images_of(found[-1])]
    else:
        read = document(path)
        needed = set(read.get("extensionsRequired", [])) - KNOWN_EXTENSIONS
        if needed:
            raise InputError(
                f"{path}: needs glTF extensions that are not supported"
                f" ({', '.join(sorted(needed))}); export it without compression and without them"
            )
        for kind, what in (("buffers", "buffer"), ("images", "texture")):
            for entry in read.get(kind, []):
                uri = entry.get("uri")
                if isinstance(uri, str) and not uri.startswith("data:"):
                    found.append(_named(path, path, uri, what))
    return list(dict.fromkeys(found))


def place_of(folder: Path, name: str) -> Path:
    """Return the file that a mesh means by a name: options before it and %20 are read over."""
    plain = name.strip()
    for text in (plain, unquote(plain), plain.replace("\\", "/"), *plain.split()[-1:]):
        if text and _is_file(folder / text):
            return folder / text
    return folder / unquote(plain)


def check_textures(path: Path) -> None:
    """Decode every picture that gives a surface its colour; loaders leave out what they cannot.

    Raises
    ------
    InputError
        Naming the picture that cannot be read, or the material that no library has.
    """
    if path.suffix.lower() == ".obj":
        libraries = [place_of(path.parent, name) for name in words_after(path, "mtllib")]
        defined = {name for file in libraries for name in words_after(file, "newmtl")}
        lost = sorted(set(words_after(path, "usemtl")) - defined)
        if libraries and lost:
            raise InputError(
                f"{path}: must use materials that its libraries have"
                f" ({', '.join(file.name for file in libraries)} lack {lost[0][:200]!r}); export it"
                " again, with its materials"
            )
        for file in libraries:
            for image in _images_of(file):
                picture = place_of(path.parent, image)
                _decode(picture.read_bytes(), str(picture), f"which {file.name} names")
        return
    read = document(path)
    for number, material in enumerate(read.get("materials", [])):
        for keys in _BASE_COLOUR:
            entry: Any = material
            for key in keys:
                entry = entry.get(key) if isinstance(entry, dict) else None
            if isinstance(entry, dict):
                _check_texture(path, read, entry, str(material.get("name", number)))


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
    if path.suffix.lower() == ".obj":
        _check_obj(path)
        libraries = [place_of(path.parent, name) for name in words_after(path, "mtllib")]
        images = (name for library in libraries for name in _images_of(library))
        _check_pictures(path, [(name, place_of(path.parent, name)) for name in images], packed)
        return
    read = document(path)
    try:
        _check_gltf(path, read, packed)
        _check_pictures(path, _pictures(path, read), packed)
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, struct.error) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"{path}: must be a whole glTF 2.0 file ({visible_line(repr(error))}); export it again"
        ) from None


def _check_obj(path: Path) -> None:
    found: Counter[bytes] = Counter({b"v": 0})
    groups: set[bytes] = set()
    corners = longest = 0
    with path.open("rb") as file:
        for line in file:
            word = line[:2].strip()
            found[word] += 1
            # A line that ends in a backslash goes on: with its next ones it is one.
            corners = line.count(b" ") + line.count(b"\t") + (corners if corners else 0)
            longest = max(longest, corners)
            if not line.rstrip(b"\r\n").endswith(b"\\"):
                corners = 0
            if line.startswith((b"usemtl", b"o ", b"g ")):
                groups.add(line)
    if longest > _MOST_CORNERS:
        raise InputError(
            f"{path}: a face must have at most {_MOST_CORNERS:,} corners (a line has"
            f" {longest:,} parts); cut its faces into triangles"
        )
    check_vertices(path, max(found.values()))
    check_within("nodes", len(groups), InputError, path, "groups and materials")
    # Each group is cut out of the whole list.
    check_vertices(path, found[b"v"] * max(len(groups), 1) // _GROUPS_AT_ONCE)


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
    without = sum(
        n for entry, n in zip(accessors, numbers, strict=True) if "bufferView" not in entry
    )
    if without > packed:
        raise InputError(
            f"{path}: lists of a mesh must lie in its buffers (lists of {without:,} numbers have no"
            f" bufferView, in files of {packed:,} bytes); export it again"
        )
    taken = sum(int(view["byteLength"]) for view in views) + _NUMBER_BYTES * sum(numbers)
    each = [_bytes_of(mesh, counts) for mesh in read.get("meshes", [])]
    taken += sum(each)
    shown = Counter(node["mesh"] for node in nodes if "mesh" in node)
    taken += _SHOWN * sum(each[mesh] * times for mesh, times in shown.items())
    check_memory(path, taken, "its lists, each as often as it is used,", packed)
    _check_tree(path, nodes)


def _bytes_of(mesh: dict[str, Any], counts: list[int]) -> int:
    """Return what a mesh takes in memory."""
    return sum(
        _VERTEX_BYTES * counts[part["attributes"]["POSITION"]]
        + _INDEX_BYTES * (counts[part["indices"]] if "indices" in part else 0)
        for part in mesh["primitives"]
        if "POSITION" in part["attributes"]
    )


def _check_tree(path: Path, nodes: list[dict[str, Any]]) -> None:
    """Refuse nodes that are no tree, as glTF 2.0 (3.5.2) asks for, or lie too deep."""
    parents: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.get("children", []):
            if parents.setdefault(child, number) != number or not 0 <= child < len(nodes):
                raise InputError(
                    f"{path}: a node must be the child of one other (node {child} is of two, or"
                    " there is none of this number); export it again"
                )
    depths: dict[int, int] = {}
    for number in range(len(nodes)):
        above: list[int] = []
        place = number
        while place in parents and place not in depths and len(above) <= _DEEPEST:
            above.append(place)
            place = parents[place]
        depth = depths.get(place, 0)
        for place in reversed(above):
            depth += 1
            depths[place] = depth
        if depth > _DEEPEST:
            raise InputError(
                f"{path}: nodes must lie at most {_DEEPEST} deep in each other (some lie deeper, or"
                " in a circle); export it with transforms applied"
            )


def _pictures(path: Path, read: dict[str, Any]) -> Iterator[tuple[str, Path | bytes]]:
    """Yield every picture of a glTF file with its name, once more for each material that has it."""
    textures = read.get("textures", [])
    used: Counter[object] = Counter()
    for material in read.get("materials", []):
        for keys in _BASE_COLOUR:
            entry: Any = material
            for key in keys:
                entry = entry.get(key) if isinstance(entry, dict) else None
            with suppress(KeyError, IndexError, TypeError):  # refused where it is used
                used[textures[entry["index"]].get("source")] += 1
    for number, image in enumerate(read.get("images", [])):
        uri, name = image.get("uri"), f"picture {number}"
        source: Path | bytes = b""
        if isinstance(uri, str):
            data = uri.startswith("data:")
            source = _of_data_uri(uri) if data else place_of(path.parent, uri)
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


def _check_texture(path: Path, read: dict[str, Any], entry: dict[str, Any], material: str) -> None:
    """Decode the picture of a glTF texture, and refuse coordinates that its loader leaves out."""
    found = entry.get("extensions")
    moved = found.get("KHR_texture_transform") if isinstance(found, dict) else None
    placed = [entry, moved if isinstance(moved, dict) else {}]
    if any(by.get(key, own) != own for by in placed for key, own in _UNMOVED.items()):
        raise InputError(
            f"{path}: the colour of material {material!r} must lie by the first texture coordinates"
            " (it has others, or KHR_texture_transform moves it); bake them and export it again"
        )
    try:
        texture = read["textures"][entry["index"]]
        source = texture.get("source")
        if source is None:
            kinds = ", ".join(texture.get("extensions", {})) or "no source"
            raise InputError(
                f"{path}: the colour of material {material!r} must be a picture in PNG, JPEG or"
                f" another common format (its texture has {kinds}); export it so"
            )
        image = read["images"][source]
        uri = image.get("uri")
        if isinstance(uri, str) and not uri.startswith("data:"):
            place = place_of(path.parent, uri)
            _decode(place.read_bytes(), str(place), f"the colour of material {material!r}")
            return
        name = f"{path}: picture {image.get('name', source)!r}"
        data = _of_data_uri(uri) if isinstance(uri, str) else _of_view(path, read, image)
    except InputError:
        raise
    except (KeyError, IndexError, TypeError, ValueError, struct.error) as error:
        raise InputError(
            f"{path}: the texture of material {material!r} must lead to a picture"
            f" (it does not: {error!r}); export it again"
        ) from None
    _decode(data, name, f"the colour of material {material!r}")


def _of_data_uri(uri: str) -> bytes:
    head, _, data = uri.partition(",")
    return base64.b64decode(data) if head.endswith(";base64") else unquote(data).encode("latin-1")


def _of_view(path: Path, read: dict[str, Any], image: dict[str, Any]) -> bytes:
    view = read["bufferViews"][image["bufferView"]]
    uri = read["buffers"][view["buffer"]].get("uri")
    if uri is None:
        data = path.read_bytes()
        (json_length,) = struct.unpack_from("<I", data, 12)
        whole = data[20 + json_length + 8 :]
    elif uri.startswith("data:"):
        whole = _of_data_uri(uri)
    else:
        whole = place_of(path.parent, uri).read_bytes()
    first = int(view.get("byteOffset", 0))
    return whole[first : first + int(view["byteLength"])]


def _decode(data: bytes, name: str, what: str) -> None:
    try:
        with Image.open(io.BytesIO(data)) as picture:
            check_values(Path(name), *picture.size, len(picture.getbands()))
            picture.load()
    except InputError:
        raise
    except Exception as error:  # Pillow's formats raise what they meet
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(
            f"{name}: {what}, must be a picture that can be read ({reason}); save it as PNG"
        ) from None


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


def words_after(path: Path, key: str) -> list[str]:
    """Return what follows a keyword at the beginning of a line, in any case."""
    check_within("text", path.stat().st_size, InputError, path, "bytes")
    pattern = re.compile(rf"\s*{re.escape(key)}\s+(.*)", re.IGNORECASE)
    with path.open(encoding="utf-8", errors="replace") as file:
        found = [pattern.match(line) for line in file]
    return [match[1].strip() for match in found if match and match[1].strip()]


def _is_file(path: Path) -> bool:
    """Whether it is a file; a name that is too long for one is none."""
    try:
        return path.is_file()
    except OSError:
        return False


def _images_of(library: Path) -> list[str]:
    return words_after(library, "map_Kd")


def _named(mesh: Path, named_in: Path, name: str, what: str) -> Path:
    """Return the file of a name, which must be there and not leave the mesh's folder."""
    place = place_of(mesh.parent, name)
    inside = os.path.normpath(mesh.parent.absolute())
    if os.path.commonpath([inside, os.path.normpath(place.absolute())]) != inside:
        raise InputError(
            f"{named_in}: must name files in its own folder ({name!r} lies outside); put the"
            f" {what} there, or export the scene as one .glb file"
        )
    if not _is_file(place):
        raise InputError(
            f"{named_in}: names a {what} that is missing ({str(place)[:300]}); put it"
            " there, or export the scene as one .glb file"
        )
    return place
