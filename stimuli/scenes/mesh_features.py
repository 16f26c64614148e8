"""Statements that a mesh file may make: each is honoured, refused or noted.

The reader (`gltf`) draws what is honoured here and nothing else; `docs/stimuli.md` shows the rows.
What is in no row is noted, or refused where it must change the picture: an extension that a file
requires.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from pipeline.errors import InputError
from pipeline.statements.row import Row, but, rows_about
from protocols.outside import visible_line

_DRAWN, _MATTE, _FILTERED = "drawn", "surfaces are matte", "pictures are filtered linearly"
_CAMERA, _LIGHT = "the camera is the study's", "light is the study's: see its key lighting"
_REST, _PLAIN = "the pose at rest is drawn", "points and lines are not drawn"
_ITS_OWN, _FIRST = "its meaning is its program's own", "colours are those of COLOR_0"
_CUT = "drawn as a cut at one half; half transparent: refused"
_NEEDS = "must not need glTF extensions that are not supported; "

NUMBERS: Final = {
    5120: "byte", 5121: "unsigned byte", 5122: "short", 5123: "unsigned short",
    5125: "unsigned int", 5126: "float",
}  # fmt: skip
"""Component types of accessors."""
_SHARES = ("unsigned byte normalized", "unsigned short normalized")
_SIGNED = ("byte normalized", "short normalized")
_ANY = ("float", *_SHARES, *_SIGNED, "byte", "unsigned byte", "short", "unsigned short")


def _numbers(semantic: str, shape: str, *types: str) -> Row:
    names = "|".join(f"{shape} of {kind}" for kind in types)
    return Row(f"glTF numbers of {semantic}", names, "honoured", "drawn; others: refused")


ROWS: Final = (
    Row("glTF objects", "name|extras|extensions", "honoured", "they do not change the picture"),
    Row("glTF document", "asset|extensionsUsed|extensionsRequired|scene|scenes|nodes|meshes|skins"
        "|materials|textures|images|samplers|accessors|bufferViews|buffers", "honoured", _DRAWN),
    Row("glTF document", "cameras", "noted", _CAMERA, but("", [])),
    Row("glTF document", "animations", "noted", _REST, but("", [])),
    Row("glTF asset", "version|minVersion|generator|copyright", "honoured", "2.0 and later 2.x"),
    Row("glTF scene", "nodes", "honoured", _DRAWN),
    Row("glTF node", "children|mesh|skin|weights|matrix|translation|rotation|scale", "honoured",
        _DRAWN),
    Row("glTF node", "camera", "noted", _CAMERA),
    Row("glTF mesh", "primitives|weights", "honoured", _DRAWN),
    Row("glTF primitive", "attributes|targets|indices|material", "honoured", _DRAWN),
    Row("glTF primitive", "mode", "noted", _PLAIN, but("", None, 4, 5, 6)),
    Row("glTF attribute", r"POSITION|NORMAL|TEXCOORD_\d+|COLOR_0|JOINTS_\d+|WEIGHTS_\d+",
        "honoured", _DRAWN),
    Row("glTF target", r"POSITION|NORMAL|TEXCOORD_\d+|COLOR_0", "honoured", _DRAWN),
    *(row for kind in ("glTF attribute", "glTF target") for row in (
        Row(kind, "TANGENT", "noted", _MATTE),
        Row(kind, r"COLOR_\d+", "noted", _FIRST),
        Row(kind, "_.*", "noted", _ITS_OWN))),
    Row("glTF skin", "inverseBindMatrices|skeleton|joints", "honoured", _DRAWN),
    Row("glTF material", "pbrMetallicRoughness|emissiveTexture|emissiveFactor|alphaCutoff"
        "|doubleSided", "honoured", _DRAWN),
    Row("glTF material", "alphaMode", "honoured", f"BLEND {_CUT}"),
    Row("glTF material", "normalTexture|occlusionTexture", "noted", _MATTE),
    Row("glTF pbrMetallicRoughness", "baseColorTexture|baseColorFactor", "honoured", _DRAWN),
    Row("glTF pbrMetallicRoughness", "metallicFactor", "noted", _MATTE, but("", 0)),
    Row("glTF pbrMetallicRoughness", "roughnessFactor", "noted", _MATTE, but("", 1)),
    Row("glTF pbrMetallicRoughness", "metallicRoughnessTexture", "noted", _MATTE),
    Row("glTF textureInfo", "index|texCoord", "honoured", _DRAWN),
    Row("glTF texture", "source|sampler", "honoured", _DRAWN),
    Row("glTF image", "uri|mimeType|bufferView", "honoured", _DRAWN),
    Row("glTF sampler", "wrapS|wrapT", "honoured", "10497, 33071, 33648; others: refused"),
    Row("glTF sampler", "magFilter", "honoured", _DRAWN),
    Row("glTF sampler", "minFilter", "noted", _FILTERED, but("", None, 9729, 9985, 9986, 9987)),
    Row("glTF accessor", "bufferView|byteOffset|componentType|normalized|count|type|max|min|sparse",
        "honoured", _DRAWN),
    Row("glTF sparse", "count|indices|values", "honoured", _DRAWN),
    Row("glTF sparse indices", "bufferView|byteOffset|componentType", "honoured", _DRAWN),
    Row("glTF sparse values", "bufferView|byteOffset", "honoured", _DRAWN),
    Row("glTF bufferView", "buffer|byteOffset|byteLength|byteStride|target", "honoured", _DRAWN),
    Row("glTF buffer", "uri|byteLength", "honoured", _DRAWN),
    Row("glTF KHR_texture_transform", "offset|rotation|scale|texCoord", "honoured", _DRAWN),
    Row("glTF KHR_materials_emissive_strength", "emissiveStrength", "honoured", _DRAWN),
    Row("glTF KHR_materials_pbrSpecularGlossiness", "diffuseTexture|diffuseFactor", "honoured",
        _DRAWN),
    Row("glTF KHR_materials_pbrSpecularGlossiness", "specularFactor|glossinessFactor"
        "|specularGlossinessTexture", "noted", _MATTE),
    Row("glTF KHR_materials_transmission", "transmissionFactor", "refused",
        "must let no light through, because a pixel of a warp has one depth; set its transmission"
        " to 0, or delete the surface", but("", 0)),
    Row("glTF KHR_materials_transmission", "transmissionTexture", "noted", _MATTE),
    Row("glTF EXT_mesh_gpu_instancing", "attributes", "honoured", _DRAWN),
    Row("glTF instance attribute", "TRANSLATION|ROTATION|SCALE", "honoured", _DRAWN),
    Row("glTF instance attribute", "_.*", "noted", _ITS_OWN),
    Row("glTF KHR_node_visibility", "visible", "honoured", _DRAWN),
    Row("glTF EXT_texture_webp", "source", "honoured", _DRAWN),
    _numbers("POSITION", "VEC3", *_ANY),
    _numbers("NORMAL", "VEC3", "float", *_SIGNED),
    _numbers("TEXCOORD_n", "VEC2", *_ANY),
    _numbers("COLOR_n", "VEC3", "float", *_SHARES, *_SIGNED),  # signed: of morph targets
    _numbers("COLOR_n", "VEC4", "float", *_SHARES, *_SIGNED),
    _numbers("JOINTS_n", "VEC4", "unsigned byte", "unsigned short"),
    _numbers("WEIGHTS_n", "VEC4", "float", *_SHARES),
    _numbers("indices", "SCALAR", "unsigned byte", "unsigned short", "unsigned int"),
    _numbers("inverseBindMatrices", "MAT4", "float"),
    _numbers("TRANSLATION", "VEC3", "float"),
    _numbers("ROTATION", "VEC4", "float", *_SIGNED),
    _numbers("SCALE", "VEC3", "float"),
    Row("glTF extension", "KHR_texture_transform|KHR_mesh_quantization|KHR_materials_unlit"
        "|KHR_materials_emissive_strength|KHR_materials_pbrSpecularGlossiness"
        "|EXT_mesh_gpu_instancing|KHR_node_visibility|EXT_texture_webp", "honoured", _DRAWN),
    Row("glTF extension", "KHR_materials_transmission", "honoured", "if it is 0"),
    Row("glTF extension", "KHR_draco_mesh_compression|EXT_meshopt_compression"
        "|KHR_meshopt_compression", "refused", f"{_NEEDS}export it without compression of meshes"),
    Row("glTF extension", "KHR_texture_basisu|EXT_texture_avif|MSFT_texture_dds", "refused",
        f"{_NEEDS}export its pictures as PNG or JPEG"),
    Row("glTF extension", "KHR_materials_clearcoat|KHR_materials_sheen|KHR_materials_specular"
        "|KHR_materials_ior|KHR_materials_iridescence|KHR_materials_anisotropy"
        "|KHR_materials_dispersion|KHR_materials_volume|KHR_materials_diffuse_transmission",
        "noted", _MATTE),
    Row("glTF extension", "KHR_materials_variants", "noted", "the material that has no variant is"
        " drawn"),
    Row("glTF extension", "KHR_lights_punctual|EXT_lights_image_based|EXT_lights_ies", "noted",
        _LIGHT),
    Row("glTF extension", "KHR_animation_pointer", "noted", _REST),
    Row("glTF extension", "MSFT_lod", "noted", "the finest level is drawn"),
    Row("glTF extension", "CESIUM_primitive_outline", "noted", _PLAIN),
    Row("glTF extension", "KHR_xmp|KHR_xmp_json_ld|EXT_mesh_manifold|EXT_mesh_features"
        "|EXT_instance_features|EXT_structural_metadata|FB_ngon_encoding", "noted",
        "it does not change the picture"),
)  # fmt: skip
"""The table of meshes."""

INSIDE: Final = {
    "document": {
        "asset": "asset", "scenes": "scene", "nodes": "node", "meshes": "mesh", "skins": "skin",
        "materials": "material", "textures": "texture", "images": "image", "samplers": "sampler",
        "accessors": "accessor", "bufferViews": "bufferView", "buffers": "buffer",
    },
    "mesh": {"primitives": "primitive"},
    "primitive": {"attributes": "attribute", "targets": "target"},
    "material": {
        "pbrMetallicRoughness": "pbrMetallicRoughness", "emissiveTexture": "textureInfo",
    },
    "pbrMetallicRoughness": {"baseColorTexture": "textureInfo"},
    "accessor": {"sparse": "sparse"},
    "sparse": {"indices": "sparse indices", "values": "sparse values"},
    "KHR_materials_pbrSpecularGlossiness": {"diffuseTexture": "textureInfo"},
    "EXT_mesh_gpu_instancing": {"attributes": "instance attribute"},
}  # fmt: skip
"""Keys of glTF objects that hold objects."""
_AT: Final = {
    "KHR_texture_transform": "textureInfo", "KHR_materials_unlit": "material",
    "KHR_materials_emissive_strength": "material", "KHR_materials_transmission": "material",
    "KHR_materials_pbrSpecularGlossiness": "material", "EXT_mesh_gpu_instancing": "node",
    "KHR_node_visibility": "node", "EXT_texture_webp": "texture",
}  # fmt: skip
"""Place where an extension has a meaning; elsewhere it is noted."""


@dataclass
class Notes:
    """Statements of a file that are not drawn, collected to be said once.

    Parameters
    ----------
    path : Path
        The file.
    """

    path: Path
    _left_out: dict[str, set[str]] = field(default_factory=dict)
    _said: dict[str, None] = field(default_factory=dict)

    def left_out(self, what: str, why: str) -> None:
        """Note something that is not drawn."""
        self._left_out.setdefault(why, set()).add(what)

    def say(self, sentence: str) -> None:
        """Note anything else, once."""
        self._said.setdefault(sentence)

    def lines(self) -> tuple[str, ...]:
        """Return one line for each reason."""
        left = []
        for why, what in sorted(self._left_out.items()):
            names = [visible_line(name)[:90] for name in sorted(what)]
            more = f" and {len(names) - 12} more" if len(names) > 12 else ""
            left.append(f"left out {', '.join(names[:12])}{more}: {why}")
        return tuple(f"{self.path}: {sentence}" for sentence in (*left, *self._said))

    def judge(self, row: Row, what: str, value: object) -> None:
        """Note a statement as its row says.

        Raises
        ------
        InputError
            If the row refuses it.
        """
        plain = row.judge is not None and row.judge(value, {}) is None
        if row.verdict == "refused" and not plain:
            raise row.error(self.path, f"{what} is {value!r}")
        if row.verdict == "noted" and not plain:
            self.left_out(what, row.words)


UNKNOWN: Final = "it is not known"


@lru_cache(4096)
def row_of(of: str, name: str) -> Row | None:
    """Return the row about a statement, the first of several; None if it is not known."""
    return next(iter(rows_about(ROWS, of, name)), None)


def check_gltf(notes: Notes, document: dict[str, Any]) -> None:
    """Hold a whole glTF document against the table.

    Raises
    ------
    InputError
        Naming what is refused, with the cure.
    """
    for key in ("version", "minVersion"):
        version = str(document["asset"].get(key, "2.0"))
        if not re.fullmatch(r"2\.\d+" if key == "version" else r"2\.0", version):
            raise InputError(
                f"{notes.path}: must be of glTF 2.0 (its {key} is {version[:40]!r}); export it as"
                " glTF 2.0"
            )
    for name in map(str, document.get("extensionsRequired", [])):
        row = row_of("glTF extension", name)
        if row is None or row.verdict == "refused":
            raise unsupported(notes.path, name)
    for name in document.get("extensionsUsed", []):
        _extension(notes, str(name), None, "")
    _check_object(notes, document, "document")


def unsupported(path: Path, name: str) -> InputError:
    """Return the error of an extension without which a file cannot be drawn."""
    row = row_of("glTF extension", name)
    other = Row("", "", "refused", f"{_NEEDS}export it without compression and without them")
    return (row or other).error(path, name)


def _check_object(notes: Notes, found: object, kind: str, unlit: bool = False) -> None:
    for entry in found if isinstance(found, list) else [found]:
        if not isinstance(entry, dict):
            raise InputError(
                f"{notes.path}: must be a whole glTF 2.0 file (a {kind} is no object); export it"
                " again"
            )
        # What an unlit material says of light is for readers that do not know it.
        muted = unlit or "KHR_materials_unlit" in (entry.get("extensions") or {})
        for key, value in entry.items():
            row = row_of(f"glTF {kind}", key) or row_of("glTF objects", key)
            if key == "extensions" and isinstance(value, dict):
                for name, content in value.items():
                    _extension(notes, name, content, kind)
            elif row is None:
                notes.left_out(f"{kind}.{key}", UNKNOWN)
            elif key in INSIDE.get(kind, {}):
                _check_object(notes, value, INSIDE[kind][key], muted and kind == "material")
            elif not (muted and row.words == _MATTE):
                notes.judge(row, f"{kind}.{key}", value)


def _extension(notes: Notes, name: str, content: object, kind: str) -> None:
    row = row_of("glTF extension", name)
    if row is None:
        notes.left_out(name, UNKNOWN)
    elif kind and kind != _AT.get(name, kind):
        notes.left_out(f"{name} of a {kind}", UNKNOWN)
    elif kind and name in _AT:
        _check_object(notes, content, name)
    elif row.verdict == "refused":  # where it is used, and nothing stands in its place
        notes.left_out(name, "what the file holds in its place is drawn")
    elif row.verdict == "noted":
        notes.left_out(name, row.words)
