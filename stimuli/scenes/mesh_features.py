"""What a mesh file may say: every statement is honoured, refused or noted.

The lists are data. The readers (`gltf`, `wavefront`) draw what is honoured here and nothing else;
`docs/stimuli.md` shows the lists as a table. What is on no list is noted, or refused where it must
change the picture: an extension that a file requires, a statement of an .obj or .mtl file.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

from pipeline.errors import InputError
from protocols.outside import visible_line

Verdict = Literal["honoured", "refused", "noted"]


@dataclass(frozen=True)
class Feature:
    """One thing that a file may say.

    Parameters
    ----------
    verdict : str
        Honoured: drawn as the format defines it. Noted: left out, and said. Refused: no picture.
    says : str
        Why it is left out, or what to do; of what is honoured, how far.
    harmless : tuple
        Values that change nothing, for what is noted or refused.
    of : str
        The list that its content is held against, in glTF.
    at : tuple of str
        The objects at which an extension has a meaning; elsewhere it is noted.
    fallback : bool
        Refused only where it is required, or nothing stands in its place.
    """

    verdict: Verdict
    says: str = ""
    harmless: tuple[object, ...] = ()
    of: str = ""
    at: tuple[str, ...] = ()
    fallback: bool = False


def _all(names: str, feature: Feature) -> dict[str, Feature]:
    return dict.fromkeys(names.split(), feature)


def _of(kind: str) -> Feature:
    return Feature("honoured", of=kind)


_DRAWN = Feature("honoured")
_MATTE = "surfaces are matte"
_LIGHTS = "light is the study's: see its key lighting"
_UNCOMPRESSED = "export it without compression of meshes"
_PNG = "export its pictures as PNG or JPEG"
_KEPT = _all("name extras extensions", _DRAWN)

GLTF: Final[dict[str, dict[str, Feature]]] = {
    "document": {
        "asset": _of("asset"),
        **_all("extensionsUsed extensionsRequired scene extras extensions", _DRAWN),
        "scenes": _of("scene"),
        "nodes": _of("node"),
        "meshes": _of("mesh"),
        "skins": _of("skin"),
        "materials": _of("material"),
        "textures": _of("texture"),
        "images": _of("image"),
        "samplers": _of("sampler"),
        "accessors": _of("accessor"),
        "bufferViews": _of("bufferView"),
        "buffers": _of("buffer"),
        "cameras": Feature("noted", "the camera is the study's", ([],)),
        "animations": Feature("noted", "the pose at rest is drawn", ([],)),
    },
    "asset": _all("version minVersion generator copyright extras extensions", _DRAWN),
    "scene": {"nodes": _DRAWN, **_KEPT},
    "node": {
        **_all("children mesh skin weights matrix translation rotation scale", _DRAWN),
        "camera": Feature("noted", "the camera is the study's"),
        **_KEPT,
    },
    "mesh": {"primitives": _of("primitive"), "weights": _DRAWN, **_KEPT},
    "primitive": {
        "attributes": _of("attribute"),
        "targets": _of("target"),
        **_all("indices material extras extensions", _DRAWN),
        "mode": Feature("noted", "points and lines are not drawn", (None, 4, 5, 6)),
    },
    "attribute": {
        **_all("POSITION NORMAL TEXCOORD_n COLOR_0 JOINTS_n WEIGHTS_n", _DRAWN),
        "TANGENT": Feature("noted", _MATTE),
        "COLOR_n": Feature("noted", "colours are those of COLOR_0"),
        "_*": Feature("noted", "its meaning is its program's own"),
    },
    "target": {
        **_all("POSITION NORMAL TEXCOORD_n COLOR_0", _DRAWN),
        "TANGENT": Feature("noted", _MATTE),
        "COLOR_n": Feature("noted", "colours are those of COLOR_0"),
        "_*": Feature("noted", "its meaning is its program's own"),
    },
    "skin": {**_all("inverseBindMatrices skeleton joints", _DRAWN), **_KEPT},
    "material": {
        "pbrMetallicRoughness": _of("pbrMetallicRoughness"),
        "emissiveTexture": _of("textureInfo"),
        "alphaMode": Feature("honoured", "BLEND as a cut at one half; half transparent: refused"),
        **_all("emissiveFactor alphaCutoff doubleSided", _DRAWN),
        **_all("normalTexture occlusionTexture", Feature("noted", _MATTE)),
        **_KEPT,
    },
    "pbrMetallicRoughness": {
        "baseColorTexture": _of("textureInfo"),
        "baseColorFactor": _DRAWN,
        "metallicFactor": Feature("noted", _MATTE, (0,)),
        "roughnessFactor": Feature("noted", _MATTE, (1,)),
        "metallicRoughnessTexture": Feature("noted", _MATTE),
        **_all("extras extensions", _DRAWN),
    },
    "textureInfo": _all("index texCoord extras extensions", _DRAWN),
    "texture": {**_all("source sampler", _DRAWN), **_KEPT},
    "image": {**_all("uri mimeType bufferView", _DRAWN), **_KEPT},
    "sampler": {
        **_all("wrapS wrapT", Feature("honoured", "10497, 33071, 33648; others: refused")),
        "magFilter": _DRAWN,
        "minFilter": Feature(
            "noted", "pictures are filtered linearly", (None, 9729, 9985, 9986, 9987)
        ),
        **_KEPT,
    },
    "accessor": {
        **_all("bufferView byteOffset componentType normalized count type max min", _DRAWN),
        "sparse": _of("sparse"),
        **_KEPT,
    },
    "sparse": {
        **_all("count extras extensions", _DRAWN),
        "indices": _of("sparse indices"),
        "values": _of("sparse values"),
    },
    "sparse indices": _all("bufferView byteOffset componentType extras extensions", _DRAWN),
    "sparse values": _all("bufferView byteOffset extras extensions", _DRAWN),
    "bufferView": {**_all("buffer byteOffset byteLength byteStride target", _DRAWN), **_KEPT},
    "buffer": {**_all("uri byteLength", _DRAWN), **_KEPT},
    "KHR_texture_transform": _all("offset rotation scale texCoord extras extensions", _DRAWN),
    "KHR_materials_emissive_strength": _all("emissiveStrength extras", _DRAWN),
    "KHR_materials_pbrSpecularGlossiness": {
        "diffuseTexture": _of("textureInfo"),
        "diffuseFactor": _DRAWN,
        **_all(
            "specularFactor glossinessFactor specularGlossinessTexture", Feature("noted", _MATTE)
        ),
        **_all("extras extensions", _DRAWN),
    },
    "KHR_materials_transmission": {
        "transmissionFactor": Feature(
            "refused",
            "a pixel of a warp has one depth: set its transmission to 0, or delete the surface",
            (0,),
        ),
        "transmissionTexture": Feature("noted", _MATTE),
        "extras": _DRAWN,
    },
    "EXT_mesh_gpu_instancing": {"attributes": _of("instance attribute"), "extras": _DRAWN},
    "instance attribute": {
        **_all("TRANSLATION ROTATION SCALE", _DRAWN),
        "_*": Feature("noted", "its meaning is its program's own"),
    },
    "KHR_node_visibility": _all("visible extras", _DRAWN),
    "EXT_texture_webp": _all("source extras", _DRAWN),
}
"""Keys of glTF 2.0 objects. ``TEXCOORD_n`` stands for any number, ``_*`` for any name."""

GLTF_EXTENSIONS: Final[dict[str, Feature]] = {
    "KHR_texture_transform": Feature("honoured", of="KHR_texture_transform", at=("textureInfo",)),
    "KHR_mesh_quantization": _DRAWN,
    "KHR_materials_unlit": Feature("honoured", at=("material",)),
    "KHR_materials_emissive_strength": Feature(
        "honoured", of="KHR_materials_emissive_strength", at=("material",)
    ),
    "KHR_materials_pbrSpecularGlossiness": Feature(
        "honoured", of="KHR_materials_pbrSpecularGlossiness", at=("material",)
    ),
    "EXT_mesh_gpu_instancing": Feature("honoured", of="EXT_mesh_gpu_instancing", at=("node",)),
    "KHR_node_visibility": Feature("honoured", of="KHR_node_visibility", at=("node",)),
    "EXT_texture_webp": Feature("honoured", of="EXT_texture_webp", at=("texture",)),
    "KHR_materials_transmission": Feature(
        "honoured", "if it is 0", of="KHR_materials_transmission", at=("material",)
    ),
    **_all(
        "KHR_draco_mesh_compression EXT_meshopt_compression KHR_meshopt_compression",
        Feature("refused", _UNCOMPRESSED, fallback=True),
    ),
    **_all(
        "KHR_texture_basisu EXT_texture_avif MSFT_texture_dds",
        Feature("refused", _PNG, fallback=True),
    ),
    **_all(
        "KHR_materials_clearcoat KHR_materials_sheen KHR_materials_specular KHR_materials_ior"
        " KHR_materials_iridescence KHR_materials_anisotropy KHR_materials_dispersion"
        " KHR_materials_volume KHR_materials_diffuse_transmission",
        Feature("noted", _MATTE),
    ),
    "KHR_materials_variants": Feature("noted", "the material that has no variant is drawn"),
    **_all("KHR_lights_punctual EXT_lights_image_based EXT_lights_ies", Feature("noted", _LIGHTS)),
    "KHR_animation_pointer": Feature("noted", "the pose at rest is drawn"),
    "MSFT_lod": Feature("noted", "the finest level is drawn"),
    "CESIUM_primitive_outline": Feature("noted", "points and lines are not drawn"),
    **_all(
        "KHR_xmp KHR_xmp_json_ld EXT_mesh_manifold EXT_mesh_features EXT_instance_features"
        " EXT_structural_metadata FB_ngon_encoding",
        Feature("noted", "it does not change the picture"),
    ),
}

_FLOAT, _BYTE, _UBYTE, _SHORT, _USHORT = 5126, 5120, 5121, 5122, 5123
_SHARES = ((_UBYTE, True), (_USHORT, True))
_SIGNED = ((_BYTE, True), (_SHORT, True))
_COUNTS = tuple((kind, False) for kind in (_BYTE, _UBYTE, _SHORT, _USHORT))
_ANY = (*_SHARES, *_SIGNED, *_COUNTS)
COMPONENTS: Final[dict[str, tuple[tuple[str, ...], tuple[tuple[int, bool], ...]]]] = {
    "POSITION": (("VEC3",), ((_FLOAT, False), *_ANY)),
    "NORMAL": (("VEC3",), ((_FLOAT, False), *_SIGNED)),
    "TEXCOORD_n": (("VEC2",), ((_FLOAT, False), *_ANY)),
    "COLOR_0": (("VEC3", "VEC4"), ((_FLOAT, False), *_SHARES, *_SIGNED)),
    "JOINTS_n": (("VEC4",), ((_UBYTE, False), (_USHORT, False))),
    "WEIGHTS_n": (("VEC4",), ((_FLOAT, False), *_SHARES)),
    "indices": (("SCALAR",), ((_UBYTE, False), (_USHORT, False), (5125, False))),
    "inverseBindMatrices": (("MAT4",), ((_FLOAT, False),)),
    "TRANSLATION": (("VEC3",), ((_FLOAT, False),)),
    "ROTATION": (("VEC4",), ((_FLOAT, False), *_SIGNED)),
    "SCALE": (("VEC3",), ((_FLOAT, False),)),
}
"""Types of numbers by what they are for: component type and whether normalized. Those of
KHR_mesh_quantization count among them; signed colours are differences of morph targets."""

_FREE_FORM = Feature("refused", "free-form surfaces are not drawn: export it as polygons")
_SHOWN_OTHERWISE = Feature("noted", "it says how other programs show the mesh")
OBJ: Final[dict[str, Feature]] = {
    **_all("v vt vn f fo o g s usemtl mtllib", _DRAWN),
    **_all("p l", Feature("noted", "points and lines are not drawn")),
    **_all("vp mg lod bevel c_interp d_interp shadow_obj trace_obj", _SHOWN_OTHERWISE),
    **_all(
        "cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con ctech stech"
        " bsp bzp cdc cdp res scmp",
        _FREE_FORM,
    ),
    **_all("usemap maplib", Feature("refused", "use map_Kd of an .mtl file in its place")),
    **_all("call csh", Feature("refused", "put what it brings into this file")),
}
"""Statements of .obj files."""

_MASKED = "a pixel of a warp has one depth"
MTL: Final[dict[str, Feature]] = {
    **_all("newmtl kd map_kd ke map_ke", _DRAWN),
    **_all("d tr map_d", Feature("honoured", "as a cut at one half; half transparent: refused")),
    **_all(
        "ka ks ns ni tf illum sharpness pr pm ps pc pcr aniso anisor map_ka map_ks map_ns map_bump"
        " bump norm map_norm refl map_refl map_pr map_pm map_ps map_pc map_pcr map_rma map_orm",
        Feature("noted", _MATTE),
    ),
    "map_aat": Feature("noted", "edges are not smoothed"),
    "decal": Feature("refused", "put it into the picture of map_Kd"),
    "disp": Feature("refused", "move the surface itself before it is exported"),
    "map_disp": Feature("refused", "move the surface itself before it is exported"),
    "map_tr": Feature("refused", "use map_d, in which white is opaque"),
    "map_opacity": Feature("refused", "use map_d, in which white is opaque"),
}
"""Statements of .mtl files, in small letters: writers differ in theirs."""

MTL_OPTIONS: Final[dict[str, Feature]] = {
    **_all("-s -o -clamp -imfchan", _DRAWN),
    "-mm": Feature("refused", "change the picture itself, and leave -mm out", ((0.0, 1.0),)),
    "-t": Feature("refused", "leave -t out", ((0.0, 0.0, 0.0), (0.0, 0.0), (0.0,))),
    "-cc": Feature("refused", "change the picture itself, and leave -cc out", ("off",)),
    **_all("-blendu -blendv", Feature("noted", "pictures are filtered linearly", ("on",))),
    **_all("-boost -texres", Feature("noted", "pictures are filtered linearly")),
    **_all("-bm -type", Feature("noted", _MATTE)),
}
"""Options of an .mtl file's ``map_`` statements, as far as the statement itself is honoured."""


@dataclass
class Notes:
    """What a file says and is not drawn, collected to be said once.

    Parameters
    ----------
    path : Path
        The file.
    """

    path: Path
    _left_out: dict[str, set[str]] = field(default_factory=dict)
    _said: dict[str, None] = field(default_factory=dict)
    _beside: list[Notes] = field(default_factory=list)

    def left_out(self, what: str, why: str) -> None:
        """Note something that is not drawn."""
        self._left_out.setdefault(why, set()).add(what)

    def say(self, sentence: str) -> None:
        """Note anything else, once."""
        self._said.setdefault(sentence)

    def beside(self, path: Path) -> Notes:
        """Return the notes of another file of the mesh, which come after these."""
        self._beside.append(Notes(path))
        return self._beside[-1]

    def lines(self) -> tuple[str, ...]:
        """Return one line for each reason."""
        left = []
        for why, what in sorted(self._left_out.items()):
            names = [visible_line(name)[:90] for name in sorted(what)]
            more = f" and {len(names) - 12} more" if len(names) > 12 else ""
            left.append(f"left out {', '.join(names[:12])}{more}: {why}")
        own = [f"{self.path}: {sentence}" for sentence in (*left, *self._said)]
        return (*own, *(line for notes in self._beside for line in notes.lines()))

    def refuse(self, what: str, cure: str) -> InputError:
        """Return the error of something that cannot be drawn."""
        return InputError(f"{self.path}: must not have {what}; {cure}")


UNKNOWN: Final = "it is not known"


def check_gltf(notes: Notes, document: dict[str, Any]) -> None:
    """Hold a whole glTF document against the lists.

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
    required = [str(name) for name in document.get("extensionsRequired", [])]
    for name in required:
        feature = GLTF_EXTENSIONS.get(name)
        if feature is None:
            raise InputError(
                f"{notes.path}: needs glTF extensions that are not supported"
                f" ({', '.join(n for n in required if n not in GLTF_EXTENSIONS)}); export it"
                " without compression and without them"
            )
        if feature.verdict == "refused":
            raise InputError(
                f"{notes.path}: needs glTF extensions that are not supported ({name});"
                f" {feature.says}"
            )
    for name in document.get("extensionsUsed", []):
        _extension(notes, str(name), None, "")
    _check_object(notes, document, "document")


def _check_object(notes: Notes, found: Any, kind: str, unlit: bool = False) -> None:
    for entry in found if isinstance(found, list) else [found]:
        if not isinstance(entry, dict):
            raise InputError(
                f"{notes.path}: must be a whole glTF 2.0 file (a {kind} is no object); export it"
                " again"
            )
        # What an unlit material says of light is for readers that do not know it.
        muted = unlit or "KHR_materials_unlit" in (entry.get("extensions") or {})
        for key, value in entry.items():
            feature = _listed(GLTF[kind], key)
            if key == "extensions" and isinstance(value, dict):
                for name, content in value.items():
                    _extension(notes, name, content, kind)
            elif feature is None:
                notes.left_out(f"{kind}.{key}", UNKNOWN)
            elif feature.of:
                _check_object(notes, value, feature.of, muted and kind == "material")
            elif not (muted and feature.says == _MATTE):
                _judge(notes, feature, f"{kind}.{key}", value)


def _listed(features: dict[str, Feature], key: str) -> Feature | None:
    found = features.get(key) or features.get(re.sub(r"_\d+$", "_n", key))
    return found or (features.get("_*") if key.startswith("_") else None)


def _extension(notes: Notes, name: str, content: Any, kind: str) -> None:
    feature = GLTF_EXTENSIONS.get(name)
    if feature is None:
        notes.left_out(name, UNKNOWN)
    elif kind and feature.at and kind not in feature.at:
        notes.left_out(f"{name} of a {kind}", UNKNOWN)
    elif kind and feature.of:
        _check_object(notes, content, feature.of)
    elif feature.fallback:  # with nothing in its place, it is refused where it is used
        notes.left_out(name, "what the file holds in its place is drawn")
    else:
        _judge(notes, feature, name, content)


def _judge(notes: Notes, feature: Feature, what: str, value: object) -> None:
    if feature.verdict == "honoured" or value in feature.harmless:
        return
    if feature.verdict == "refused":
        raise notes.refuse(f"{what} {value!r}", feature.says)
    notes.left_out(what, feature.says)


def check_statement(notes: Notes, features: dict[str, Feature], word: str, line: int) -> bool:
    """Whether a statement of an .obj or .mtl file is to be drawn; what is left out is noted.

    Raises
    ------
    InputError
        If it is refused, or on no list.
    """
    feature = features.get(word)
    if feature is None:
        raise InputError(
            f"{notes.path}: line {line}: must begin with a statement that is known (got"
            f" {word[:40]!r}); delete the line, or export it again"
        )
    if feature.verdict == "refused":
        raise InputError(f"{notes.path}: line {line}: must not have {word!r}; {feature.says}")
    if feature.verdict == "noted":
        notes.left_out(word, feature.says)
    return feature.verdict == "honoured"
