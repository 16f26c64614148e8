"""glTF 2.0 documents as shapes: accessors, primitives, nodes and materials, in plain numpy.

A reader of our own, because one that leaves out silently what it does not know (trimesh: sparse
accessors, fans, normalized numbers, wrap modes) cannot say so. Section numbers are those of the
glTF 2.0 specification.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import AnyArray
from stimuli.scenes.mesh_features import NUMBERS, Notes, row_of, unsupported
from stimuli.scenes.mesh_inputs import bytes_of_buffer, data_of_uri, file_of_name, is_data
from stimuli.scenes.mesh_surface import PixelBytes, Shape, Surface, Wrap, decoded, shares

Array = NDArray[np.float64]

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_WRAPS: dict[int, Wrap] = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
_REST: dict[str, tuple[float, ...]] = {
    "translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0),
}  # fmt: skip
"""Place of a node of which nothing is said, in the order in which it is applied last to first."""
_AGAIN = "export it again"
_SHORTEST = 0.1  # of quaternions, which rounding leaves near 1
_SUMS_APART = 0.05  # of a corner's weights, from 1


@dataclass(frozen=True)
class _Placed:
    """Place of a texture on a mesh."""

    texcoord: int = 0
    offset: tuple[float, ...] = (0.0, 0.0)
    turn: float = 0.0
    scale: tuple[float, ...] = (1.0, 1.0)
    wrap: tuple[Wrap, Wrap] = ("repeat", "repeat")
    nearest: bool = False

    def moved(self, uv: Array) -> Array:
        """Return coordinates as KHR_texture_transform moves them, with v upwards."""
        cosine, sine = np.cos(self.turn), np.sin(self.turn)
        turned = np.array([[cosine, sine], [-sine, cosine]])
        u, v = ((uv * self.scale) @ turned.T + self.offset).T
        return np.stack([u, 1.0 - v], axis=1)


def _fallback(name: str) -> bool:
    """True if an extension stands for what it does not say itself: it may have a fallback."""
    row = row_of("glTF extension", name)
    return row is not None and row.verdict == "refused"


class Document:
    """A glTF document and what its numbers and pictures are.

    Parameters
    ----------
    path : Path
    read : dict
        Its JSON, held against the lists before (`mesh_features.check_gltf`).
    notes : Notes
        Is told what is not drawn.
    """

    def __init__(self, path: Path, read: dict[str, Any], notes: Notes) -> None:
        self.path, self.read, self.notes = path, read, notes
        self._buffers = [self._buffer(number) for number in range(len(read.get("buffers", [])))]
        self._pictures: dict[int, PixelBytes] = {}
        self._surfaces: dict[int, tuple[Surface, _Placed]] = {}

    def shapes(self) -> Iterator[Shape]:
        """Yield the shapes of the document's scene.

        Raises
        ------
        InputError
            If it shows what cannot be drawn.
        """
        for number, places in self._drawn():
            node = self._node(number)
            mesh = self._entry("meshes", node["mesh"])
            weights = node.get("weights", mesh.get("weights", []))
            joints = self._joints(node["skin"]) if "skin" in node else None
            for part in mesh["primitives"]:
                shape = self._primitive(part, weights, joints)
                if shape is not None:
                    # A skin's joints place it, and its own node does not (3.7.3.3).
                    yield shape if "skin" in node else replace(shape, places=places)

    def _entry(self, kind: str, index: object, picture: str = "") -> dict[str, Any]:
        entries = self.read.get(kind, [])
        if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(entries):
            lost = f"{kind} has no entry {str(index)[:40]}"
            if picture:
                raise InputError(
                    f"{self.path}: {picture} must lead to a picture (it does not: {lost}); {_AGAIN}"
                )
            raise self._wrong(lost)
        found: dict[str, Any] = entries[index]
        return found

    def _wrong(self, what: str, cure: str = _AGAIN) -> InputError:
        return InputError(f"{self.path}: must be a whole glTF 2.0 file ({what}); {cure}")

    def _node(self, number: object) -> dict[str, Any]:
        return self._entry("nodes", number)

    # Nodes

    def _roots(self) -> list[int]:
        scenes = self.read.get("scenes", [])
        if not scenes:
            nodes = self.read.get("nodes", [])
            return sorted(
                set(range(len(nodes))) - {c for n in nodes for c in n.get("children", [])}
            )
        chosen = self.read.get("scene", 0)
        if len(scenes) > 1:
            self.notes.say(f"scene {chosen} of {len(scenes)} is drawn")
        return list(self._entry("scenes", chosen).get("nodes", []))

    @cached_property
    def _worlds(self) -> dict[int, Array]:
        """World matrices of the scene's nodes, parents first."""
        found: dict[int, Array] = {}
        waiting = [(root, np.eye(4)) for root in reversed(self._roots())]
        while waiting:
            number, above = waiting.pop()
            node = self._node(number)
            if number in found:
                raise self._wrong(f"node {number} has two parents, or is its own")
            found[number] = above @ self._matrix(node)
            children = node.get("children", [])
            waiting += [(child, found[number]) for child in reversed(children)]
        return found

    def _matrix(self, node: dict[str, Any]) -> Array:
        if "matrix" in node:
            matrix = self._numbers(node["matrix"], 16, "matrix").reshape(4, 4).T
            if not np.array_equal(matrix[3], (0, 0, 0, 1)):
                raise self._wrong("a matrix is no turn, scale and shift")
            if {"translation", "rotation", "scale"} & node.keys():
                raise self._wrong("a node has a matrix, and a shift, turn or scale beside it")
            return matrix
        return self._placed(
            *(self._numbers(node.get(key, rest), len(rest), key) for key, rest in _REST.items())
        )

    def _placed(self, translation: Array, rotation: Array, scale: Array) -> Array:
        """Return the matrix T R S of a translation, a quaternion (x, y, z, w), and a scale."""
        length = float(np.linalg.norm(rotation))
        if length < _SHORTEST:
            raise self._wrong(f"the length of a rotation's quaternion is {length:.2g}, not 1")
        x, y, z, w = rotation / length
        matrix = np.eye(4)
        matrix[:3, :3] = scale * np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        matrix[:3, 3] = translation
        return matrix

    def _numbers(self, values: object, count: int, what: str) -> Array:
        found = np.asarray(values, np.float64)
        if found.shape != (count,) or not np.isfinite(found).all():
            raise self._wrong(f"{what} must be {count} finite numbers, not {str(values)[:80]}")
        return found

    def _drawn(self) -> Iterator[tuple[int, tuple[Array, ...]]]:
        """Yield the nodes with visible meshes, and where each stands."""
        hidden: set[int] = set()
        for number, world in self._worlds.items():  # parents come first
            node = self._node(number)
            extensions = node.get("extensions", {})
            if number in hidden or not extensions.get("KHR_node_visibility", {}).get("visible", 1):
                hidden |= {number, *node.get("children", [])}
            elif "mesh" in node:
                instances = extensions.get("EXT_mesh_gpu_instancing")
                yield number, (world,) if instances is None else self._instances(world, instances)

    def _instances(self, world: Array, instances: dict[str, Any]) -> tuple[Array, ...]:
        attributes = instances["attributes"]
        given = {
            key: self._accessor(attributes[key.upper()], key.upper())
            for key in _REST
            if key.upper() in attributes
        }
        counts = {len(values) for values in given.values()}
        if len(counts) != 1:
            raise self._wrong(f"instances must have lists of one length, not {sorted(counts)}")
        (count,) = counts
        rows = [given.get(key, np.tile(rest, (count, 1))) for key, rest in _REST.items()]
        return tuple(world @ self._placed(*row) for row in zip(*rows, strict=True))

    def _joints(self, index: int) -> Array:
        """Matrices of a skin's joints, shape (J, 4, 4)."""
        skin = self._entry("skins", index)
        joints = skin["joints"]
        lost = [joint for joint in joints if joint not in self._worlds]
        if lost:
            raise self._wrong(f"joint {str(lost[0])[:40]} of a skin must be a node of the scene")
        matrices = np.array([self._worlds[joint] for joint in joints])
        if "inverseBindMatrices" in skin:
            inverse = self._accessor(skin["inverseBindMatrices"], "inverseBindMatrices")
            if len(inverse) < len(joints):
                raise self._wrong(f"a skin of {len(joints)} joints has {len(inverse)} matrices")
            matrices = matrices @ inverse[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)
        return matrices

    # Primitives

    def _primitive(
        self, part: dict[str, Any], weights: list[float], joints: Array | None
    ) -> Shape | None:
        attributes = part["attributes"]
        mode = part.get("mode", 4)
        if mode not in range(7):
            raise self._wrong(f"a primitive's mode must be 0 to 6, not {str(mode)[:40]}")
        if "POSITION" not in attributes:
            self.notes.left_out("a primitive without POSITION", "it is nowhere")
        if mode < 4 or "POSITION" not in attributes:
            return None
        lists = [*attributes.values(), *([part["indices"]] if "indices" in part else [])]
        for name in filter(_fallback, part.get("extensions", {})):
            if any("bufferView" not in self._entry("accessors", index) for index in lists):
                raise unsupported(self.path, name)
        surface, where = self._surface(part.get("material"))
        wanted = {"POSITION": "position", "NORMAL": "normal", "COLOR_0": "colour"}
        if surface.picture is not None or surface.glow is not None:
            wanted[f"TEXCOORD_{where.texcoord}"] = "uv"
        given: dict[str, Array] = {}
        for semantic, name in wanted.items():
            if semantic in attributes:
                given[name] = self._accessor(attributes[semantic], semantic)
                if name == "colour":
                    given[name] = shares(self.path, semantic, given[name])
                targets = part.get("targets", [])
                if weights and len(weights) != len(targets):
                    raise self._wrong(f"{len(weights)} weights are for {len(targets)} targets")
                for weight, target in zip(weights, targets, strict=False):
                    if weight and semantic in target:
                        change = self._accessor(target[semantic], semantic)
                        given[name] = given[name] + weight * self._like(change, given[name])
            elif name == "uv":
                raise self._wrong(
                    f"material {surface.name!r} has a picture, and a mesh of its has no {semantic}",
                    "unwrap the mesh, or take the picture away, and export it again",
                )
        position = given["position"]
        for name in given:
            self._like(given[name], position, wide=True)
        if joints is not None:
            self._bend(given, attributes, joints)
            position = given["position"]
        if "colour" in given:
            given["colour"] = given["colour"].clip(0, 1)
        if "uv" in given:
            given["uv"] = where.moved(given["uv"])
        corners = (
            np.arange(len(position))
            if "indices" not in part
            else self._accessor(part["indices"], "indices")[:, 0].astype(np.int64)
        )
        if len(corners) and corners.max() >= len(position):
            raise self._wrong(f"an index names vertex {corners.max()} of {len(position)}")
        triangles = self._triangles(corners, mode)
        return Shape(
            surface, position, triangles, given.get("normal"), given.get("uv"), given.get("colour")
        )

    def _like(self, values: Array, others: AnyArray, *, wide: bool = False) -> Array:
        if len(values) != len(others) or not (wide or values.shape == others.shape):
            raise self._wrong(
                f"lists of one mesh must be of one length, not {len(values)} and {len(others)}"
            )
        return values

    def _triangles(self, corners: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
        """Triangles by a primitive's mode (3.7.2.1): a list, a strip, or a fan."""
        if mode == 4:
            if len(corners) % 3:
                raise self._wrong(f"triangles must have three corners each, not {len(corners)}")
            return corners.reshape(-1, 3)
        if mode == 6:
            first = np.full(max(len(corners) - 2, 0), corners[0] if len(corners) else 0)
            return np.stack([corners[1:-1], corners[2:], first], axis=1)
        odd = np.arange(max(len(corners) - 2, 0)) % 2
        index = np.arange(len(odd))
        return np.stack(
            [corners[index], corners[index + 1 + odd], corners[index + 2 - odd]], axis=1
        )

    def _bend(self, given: dict[str, Array], attributes: dict[str, int], joints: Array) -> None:
        """Move a mesh by its skin, in place; normals by the cofactors of the blended matrices."""
        sets = [key.partition("_")[2] for key in attributes if key.startswith("JOINTS_")]
        if not sets:
            raise self._wrong("a mesh with a skin has no JOINTS_0")
        blended, total = np.zeros((len(given["position"]), 4, 4)), 0.0
        for number in sets:
            which = self._accessor(attributes[f"JOINTS_{number}"], "JOINTS_0").astype(np.int64)
            share = self._accessor(attributes[f"WEIGHTS_{number}"], "WEIGHTS_0")
            self._like(share, given["position"], wide=True)
            self._like(share, which)
            if which.max(initial=0) >= len(joints):
                raise self._wrong(f"a vertex names joint {which.max()} of {len(joints)}")
            for corner in range(4):
                blended += share[:, corner, None, None] * joints[which[:, corner]]
            total = total + share.sum(axis=1)
        if np.abs(total - 1).max(initial=0) > _SUMS_APART:
            self.notes.say("weights of joints are brought to a sum of 1")
        blended /= np.maximum(total, 1e-12)[:, None, None]
        linear = blended[:, :3, :3]
        given["position"] = (linear @ given["position"][:, :, None])[..., 0] + blended[:, :3, 3]
        if "normal" in given:
            x, y, z = linear.transpose(1, 0, 2)
            cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)
            normal = (cofactors @ given["normal"][:, :, None])[..., 0]
            length = np.linalg.norm(normal, axis=1, keepdims=True)
            given["normal"] = normal / np.maximum(length, 1e-30)

    # Numbers

    def _accessor(self, index: object, semantic: str) -> Array:
        """Numbers of an accessor, shape (count, width), as 3.6.2 defines them."""
        entry = self._entry("accessors", index)
        component, shares = entry["componentType"], bool(entry.get("normalized", False))
        name = NUMBERS.get(component, f"type {str(component)[:20]}")
        stored = f"{str(entry['type'])[:20]} of {name}{' normalized' if shares else ''}"
        if row_of("glTF numbers of " + re.sub(r"_\d+$", "_n", semantic), stored) is None:
            raise self._wrong(
                f"{semantic} must not be {stored}", "export it again, as float numbers"
            )
        width, count = _WIDTHS[entry["type"]], entry["count"]
        if not isinstance(count, int) or count < 0:
            raise self._wrong(f"an accessor's count is {str(count)[:40]}")
        kind = np.dtype(_TYPES[component])
        if "bufferView" in entry:
            values = self._stored(entry, kind, count, width).astype(np.float64)
        else:
            values = np.zeros((count, width))
        if "sparse" in entry and entry["sparse"]["count"]:
            sparse = entry["sparse"]
            rows, number = sparse["indices"], sparse["count"]
            if rows["componentType"] not in (5121, 5123, 5125):
                raise self._wrong(f"sparse indices are of type {str(rows['componentType'])[:20]}")
            which = self._stored(rows, np.dtype(_TYPES[rows["componentType"]]), number, 1)[:, 0]
            if which.max() >= count:
                raise self._wrong(f"a sparse accessor names entry {which.max()} of {count}")
            values[which] = self._stored(sparse["values"], kind, number, width)
        if shares:
            values = np.maximum(values / np.iinfo(kind).max, -1.0)
        if not np.isfinite(values).all():
            name = "positions" if semantic == "POSITION" else semantic
            raise InputError(
                f"{self.path}: {name} must be finite (some of {count} are not); {_AGAIN}"
            )
        return values

    def _stored(
        self, entry: dict[str, Any], kind: np.dtype[Any], count: int, width: int
    ) -> AnyArray:
        data, first = self._view(entry["bufferView"]), entry.get("byteOffset", 0)
        size = kind.itemsize * width
        step = self._entry("bufferViews", entry["bufferView"]).get("byteStride", size)
        end = first + step * (count - 1) + size if count else 0
        if step < size or first < 0 or end > len(data):
            raise self._wrong(f"a list ends at byte {end} of a bufferView of {len(data)}")
        rows = np.lib.stride_tricks.as_strided(
            np.frombuffer(data, np.uint8)[first:], (count, size), (step, 1), writeable=False
        )
        return np.ascontiguousarray(rows).view(kind).reshape(count, width)

    def _buffer(self, number: int) -> bytes | None:
        """Bytes of a buffer; None for one that stands for what only an extension can unpack."""
        buffer = self._entry("buffers", number)
        if "uri" not in buffer and (number or self.path.suffix.lower() != ".glb"):
            return None
        data = bytes_of_buffer(self.path, buffer)
        if len(data) < buffer["byteLength"]:
            raise self._wrong(f"buffer {number} has {len(data)} bytes of {buffer['byteLength']}")
        return data

    def _view(self, number: int) -> memoryview:
        view = self._entry("bufferViews", number)
        self._entry("buffers", view["buffer"])
        data = self._buffers[view["buffer"]]
        if data is None:
            for name in filter(_fallback, view.get("extensions", {})):
                raise unsupported(self.path, name)
            raise self._wrong(f"buffer {view['buffer']} has no bytes")
        first, length = view.get("byteOffset", 0), view["byteLength"]
        if not 0 <= first <= first + length <= len(data):
            raise self._wrong(f"bufferView {number} ends beyond its buffer of {len(data)} bytes")
        return memoryview(data)[first : first + length]

    # Materials

    def _surface(self, index: int | None) -> tuple[Surface, _Placed]:
        key = -1 if index is None else index
        if key not in self._surfaces:
            entry: dict[str, Any] = {} if index is None else self._entry("materials", index)
            self._surfaces[key] = self._described(entry, str(entry.get("name", key)))
        return self._surfaces[key]

    def _described(self, entry: dict[str, Any], name: str) -> tuple[Surface, _Placed]:
        extensions = entry.get("extensions", {})
        pbr, unlit = entry.get("pbrMetallicRoughness", {}), "KHR_materials_unlit" in extensions
        colour, texture = pbr.get("baseColorFactor", [1, 1, 1, 1]), pbr.get("baseColorTexture")
        glossy = extensions.get("KHR_materials_pbrSpecularGlossiness")
        if glossy is not None and not unlit:
            colour = glossy.get("diffuseFactor", [1, 1, 1, 1])
            texture = glossy.get("diffuseTexture")
        mode = entry.get("alphaMode", "OPAQUE")
        if mode not in ("OPAQUE", "MASK", "BLEND"):
            raise self._wrong(f"an alphaMode is {str(mode)[:40]}")
        colour = self._numbers(colour, 4, "a colour")
        colour = shares(self.path, f"the colour of material {name!r}", colour)
        red, green, blue, alpha = map(float, colour)
        strength = extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1)
        emission = tuple(
            self._numbers([strength], 1, "a strength")
            * self._numbers(entry.get("emissiveFactor", [0, 0, 0]), 3, "a colour")
        )
        glow = entry.get("emissiveTexture") if any(emission) and not unlit else None
        picture, where = self._texture(texture, f"the colour of material {name!r}")
        shine, beside = self._texture(glow, f"the light of material {name!r}")
        if picture is None:
            where = beside
        elif shine is not None and where != beside:
            raise InputError(
                f"{self.path}: the light of material {name!r} must lie as its colour does"
                " (texCoord, KHR_texture_transform and sampler differ); bake one of them to the"
                " coordinates of the other"
            )
        surface = Surface(
            name=name,
            colour=(red, green, blue),
            alpha=alpha,
            picture=picture,
            glow=shine,
            emission=(0.0, 0.0, 0.0) if unlit else (emission[0], emission[1], emission[2]),
            mode=mode,
            cutoff=float(self._numbers([entry.get("alphaCutoff", 0.5)], 1, "alphaCutoff")[0]),
            wrap=where.wrap,
            nearest=where.nearest,
            double_sided=bool(entry.get("doubleSided", False)),
            unlit=unlit,
        )
        return surface, where

    def _texture(self, info: dict[str, Any] | None, what: str) -> tuple[PixelBytes | None, _Placed]:
        if info is None:
            return None, _Placed()
        texture = self._entry("textures", info["index"], what)
        others = texture.get("extensions", {})
        source = texture.get("source", others.get("EXT_texture_webp", {}).get("source"))
        if source is None:
            raise InputError(
                f"{self.path}: {what} must be a picture in PNG, JPEG or another common format"
                f" (its texture has {', '.join(others) or 'no source'}); export it so"
            )
        image = self._entry("images", source, what)
        if source not in self._pictures:
            uri = image.get("uri")
            if uri is not None and "bufferView" in image:
                raise self._wrong(f"picture {source} has a uri and a bufferView", "leave one out")
            if isinstance(uri, str) and not is_data(uri):
                place = file_of_name(self.path, uri)
                data: bytes | memoryview = place.read_bytes()
                name = str(place)
            else:
                name = f"{self.path}: picture {image.get('name', source)!r}"
                data = (
                    data_of_uri(self.path, uri)
                    if uri is not None
                    else self._view(image["bufferView"])
                )
            self._pictures[source] = decoded(data, name, what)
        moved = info.get("extensions") or {}
        moved = moved.get("KHR_texture_transform", {}) if isinstance(moved, dict) else {}
        sampler = self._entry("samplers", texture["sampler"]) if "sampler" in texture else {}
        return self._pictures[source], _Placed(
            texcoord=moved.get("texCoord", info.get("texCoord", 0)),
            offset=tuple(self._numbers(moved.get("offset", (0, 0)), 2, "an offset")),
            turn=float(self._numbers([moved.get("rotation", 0)], 1, "a rotation")[0]),
            scale=tuple(self._numbers(moved.get("scale", (1, 1)), 2, "a scale")),
            wrap=self._wraps(sampler),
            nearest=sampler.get("magFilter") == 9728,
        )

    def _wraps(self, sampler: dict[str, Any]) -> tuple[Wrap, Wrap]:
        found = [sampler.get(key, 10497) for key in ("wrapS", "wrapT")]
        if not set(found) <= set(_WRAPS):
            raise self._wrong(f"wrap modes must be among {[*_WRAPS]}, not {str(found)[:40]}")
        return _WRAPS[found[0]], _WRAPS[found[1]]
