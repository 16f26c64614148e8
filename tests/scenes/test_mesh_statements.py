"""Statements of glTF files: drawn right, refused or noted, each beside a control."""

import base64
import copy
import io
import json
import re
import struct
import zlib
from urllib.parse import quote

import numpy as np
import pytest
from built_study import box_document, write_small_study
from PIL import Image
from typer.testing import CliRunner

from pipeline.errors import InputError
from pipeline.statements.row import table
from stimuli.recipes.bring_in import bring_scene
from stimuli.rendering import triangle_batches
from stimuli.rendering.render import WorldRenderer
from stimuli.rendering.world import Viewpoint
from stimuli.scenes import mesh_surface
from stimuli.scenes.mesh_features import INSIDE, ROWS
from stimuli.scenes.mesh_file import load_world
from stimuli.scenes.mesh_inputs import data_of_uri, file_of_name, files_of
from study_app.cli import app as whole_app
from study_app.cli.stimuli_commands import app as typer_app


def features(of):
    """Rows by every name that they have."""
    return {name: row for row in ROWS if row.of == of for name in row.names.split("|")}


OTHERS = {"extension", "objects"}
KINDS_OF_OBJECTS = {row.of[5:] for row in ROWS if row.of.startswith("glTF ")} - OTHERS
GLTF = {kind: features(f"glTF {kind}") for kind in KINDS_OF_OBJECTS if "numbers of" not in kind}
GLTF_EXTENSIONS = features("glTF extension")
FALLBACKS = [name for name, row in GLTF_EXTENSIONS.items() if row.verdict == "refused"]
TURNED = (b"eXIf", b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0")
VIEW = Viewpoint((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), 60.0)
BYTE, UBYTE, SHORT, USHORT, UINT, FLOAT = 5120, 5121, 5122, 5123, 5125, 5126
KINDS = {BYTE: "i1", UBYTE: "u1", SHORT: "<i2", USHORT: "<u2", UINT: "<u4", FLOAT: "<f4"}
QUAD = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], float)
FACES = np.array([0, 1, 2, 0, 2, 3])
COLOURS = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], float)


def marked(alpha=(255, 255)):
    """Left top red, right top green, left bottom blue, right bottom white; alpha above, below."""
    pixels = np.zeros((32, 32, 4), np.uint8)
    pixels[:16, :16], pixels[:16, 16:] = (220, 30, 30, 0), (30, 200, 30, 0)
    pixels[16:, :16], pixels[16:, 16:] = (40, 60, 220, 0), (240, 240, 240, 0)
    pixels[:16, :, 3], pixels[16:, :, 3] = alpha
    return pixels


def encoded(pixels, kind="PNG", **options):
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, kind, **options)
    return file.getvalue()


class Gltf:
    """A document in the making: one square with one material, unless told otherwise."""

    def __init__(self, **material):
        self.bin = b""
        asset = {"version": "2.0", "minVersion": "2.0", "generator": "a", "copyright": "b"}
        self.doc = {"asset": asset, "bufferViews": [], "accessors": []}
        self.doc["materials"] = [{"doubleSided": True, **material}]
        self.part = {"attributes": {"POSITION": self.add(QUAD)}, "material": 0}
        self.part["indices"] = self.add(FACES, USHORT, "SCALAR")
        self.doc["meshes"] = [{"primitives": [self.part]}]
        self.doc["nodes"] = [{"mesh": 0}]
        self.doc["scenes"] = [{"nodes": [0]}]
        self.doc["scene"] = 0
        self.doc["buffers"] = [{}]

    @property
    def attributes(self):
        return self.part["attributes"]

    @property
    def material(self):
        return self.doc["materials"][0]

    @property
    def node(self):
        return self.doc["nodes"][0]

    def view(self, data, **more):
        self.bin += b"\0" * (-len(self.bin) % 4)
        entry = {"buffer": 0, "byteOffset": len(self.bin), "byteLength": len(data), **more}
        self.doc["bufferViews"].append(entry)
        self.bin += data
        return len(self.doc["bufferViews"]) - 1

    def add(self, values, component=FLOAT, kind=None, *, shares=False, view=True):
        values = np.asarray(values, float)
        if shares:
            values = np.rint(values * np.iinfo(KINDS[component]).max)
        kind = kind or f"VEC{values.shape[1]}"
        rows = values.astype(KINDS[component]).reshape(len(values), -1)
        width = rows.itemsize * rows.shape[1]
        step = width + -width % 4 if kind != "SCALAR" else width
        raw = np.zeros((len(rows), step), np.uint8)
        raw[:, :width] = np.ascontiguousarray(rows).view(np.uint8).reshape(len(rows), width)
        entry = {"componentType": component, "count": len(values), "type": kind}
        if view:
            entry["bufferView"] = self.view(
                raw.tobytes(), **({"byteStride": step} if step != width else {})
            )
            entry["byteOffset"] = 0
        if shares:
            entry["normalized"] = True
        self.doc["accessors"].append(entry)
        return len(self.doc["accessors"]) - 1

    def sparse(self, accessor, rows, values):
        entry = self.doc["accessors"][accessor]
        raw = np.asarray(values, KINDS[entry["componentType"]])
        entry["sparse"] = {
            "count": len(rows),
            "indices": {"bufferView": self.view(np.asarray(rows, "u1").tobytes()),
                        "byteOffset": 0, "componentType": UBYTE},
            "values": {"bufferView": self.view(raw.tobytes()), "byteOffset": 0},
        }  # fmt: skip
        return accessor

    def picture(self, pixels, mime="image/png", data=None, **texture):
        image = {"bufferView": self.view(data or encoded(pixels)), "mimeType": mime}
        self.doc.setdefault("images", []).append(image)
        texture.setdefault("source", len(self.doc["images"]) - 1)
        self.doc.setdefault("textures", []).append(texture)
        return {"index": len(self.doc["textures"]) - 1}

    def painted(self, pixels=None, uv=UV, **texture):
        """Give the square a picture."""
        pbr = self.material.setdefault("pbrMetallicRoughness", {})
        pbr["baseColorTexture"] = self.picture(marked() if pixels is None else pixels, **texture)
        self.attributes["TEXCOORD_0"] = self.add(uv)
        return self

    def sampled(self, wrap_s, wrap_t):
        self.doc["samplers"] = [{"wrapS": wrap_s, "wrapT": wrap_t}]
        self.doc["textures"][0]["sampler"] = 0
        return self

    def extended(self, where, name, content, *, required=False):
        where.setdefault("extensions", {})[name] = content
        self.doc["extensionsUsed"] = [name]
        if required:
            self.doc["extensionsRequired"] = [name]
        return self

    def save(self, path):
        self.bin += b"\0" * (-len(self.bin) % 4)
        self.doc["buffers"][0]["byteLength"] = len(self.bin)
        text = json.dumps(self.doc).encode()
        text += b" " * (-len(text) % 4)
        head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(self.bin))
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        path.write_bytes(head + chunks + struct.pack("<I4s", len(self.bin), b"BIN\0") + self.bin)
        return path


@pytest.fixture
def draw(gl_context, tmp_path, monkeypatch):
    """Draw with one filter: an anisotropic one takes other texels as coordinates are rounded."""

    def run(made, view=VIEW, anisotropy=1.0, **options):
        monkeypatch.setattr(triangle_batches, "ANISOTROPY", anisotropy)
        path = made.save(tmp_path / "s.glb") if isinstance(made, Gltf) else made
        renderer = WorldRenderer(gl_context, load_world(path, **options).seen_from(view))
        try:
            return np.rint(renderer.render(view.camera(64, 64)).colour * 255).astype(int)
        finally:
            renderer.release()

    return run


# Each feature with the control that says the same in plain numbers.


def moved(**node):
    made = Gltf().painted()
    made.node.update(node)
    return made


def changed(made, place, **entries):
    place(made).update(entries)
    return made


def at(corners, uv=UV, **material):
    made = Gltf(**material).painted(uv=uv)
    made.attributes["POSITION"] = made.add(corners)
    return made


def typed(semantic, values, component, shares):
    made = Gltf().painted()
    made.attributes[semantic] = made.add(values, component, shares=shares)
    return made


def in_mode(mode, order):
    made = Gltf().painted()
    made.part["mode"], made.part["indices"] = mode, made.add(order, UBYTE, "SCALAR")
    return made


def indexed(component):
    made = Gltf().painted()
    made.part["indices"] = made.add(FACES, component, "SCALAR")
    return made


def without_indices():
    made = at(QUAD[FACES], UV[FACES])
    del made.part["indices"]
    return made


def panel(sparse):
    wide = QUAD * [1.0, 1, 1]
    wide[1:3, 0] += 0.4
    made = Gltf().painted()
    made.attributes["POSITION"] = made.add(QUAD if sparse else wide)
    if sparse:
        made.sparse(made.attributes["POSITION"], [1, 2], wide[1:3])
    return made


def of_zeros(view, sparse=False):
    """Coordinates without a bufferView are zero: the whole square shows the picture's corner."""
    made = Gltf().painted(uv=UV if sparse and view else np.zeros((4, 2)))
    made.attributes["TEXCOORD_0"] = made.add(UV if sparse and view else np.zeros((4, 2)), view=view)
    if sparse and not view:
        made.sparse(made.attributes["TEXCOORD_0"], [0, 1, 2, 3], UV)
    return made


def transformed(uv, **transform):
    made = Gltf().painted(uv=uv)
    if transform:
        texture = made.material["pbrMetallicRoughness"]["baseColorTexture"]
        made.extended(texture, "KHR_texture_transform", transform)
    return made


def second_set(where):
    made = Gltf().painted(uv=UV[::-1])
    made.attributes["TEXCOORD_1"] = made.add(UV)
    texture = made.material["pbrMetallicRoughness"]["baseColorTexture"]
    if where == "texCoord":
        texture["texCoord"] = 1
    else:
        made.extended(texture, "KHR_texture_transform", {"texCoord": 1})
    return made


def coloured(width, component=FLOAT, shares=False, values=COLOURS):
    made = Gltf()
    values = np.hstack([values, np.full((4, 1), 0.5)])[:, :width]
    made.attributes["COLOR_0"] = made.add(values, component, shares=shares)
    return made


def filled(colour, picture=None, **material):
    material["pbrMetallicRoughness"] = {"baseColorFactor": colour}
    made = Gltf(**material)
    return made.painted(picture) if picture is not None else made


def glowing(emission, base, picture=None, strength=None, **material):
    made = filled([*base, 1], emissiveFactor=emission, **material)
    made.extended(made.material, "KHR_materials_unlit", {})
    del made.material["extensions"]
    del made.doc["extensionsUsed"]
    made.attributes["COLOR_0"] = made.add(np.ones((4, 3)))  # colours of its own: shown unlit
    if picture is not None:
        made.material["emissiveTexture"] = made.picture(picture)
        made.attributes["TEXCOORD_0"] = made.add(UV)
    if strength is not None:
        made.extended(
            made.material, "KHR_materials_emissive_strength", {"emissiveStrength": strength}
        )
    return made


def standing(places, extra=()):
    """Small squares at places (x, y, scale)."""
    made = Gltf().painted()
    made.doc["nodes"] = [
        {"mesh": 0, "translation": [x, y, 0], "scale": [s, s, s]} for x, y, s in places
    ]
    made.doc["nodes"] += extra
    made.doc["scenes"] = [{"nodes": list(range(len(made.doc["nodes"])))}]
    return made


PLACES = [(-0.6, 0.5, 0.3), (0.6, 0.5, 0.4), (0.0, -0.6, 0.35)]


def instanced(component=FLOAT, shares=False):
    made = Gltf().painted()
    turns = np.tile([0, 0, 0, 1.0], (3, 1))
    attributes = {
        "TRANSLATION": made.add([[x, y, 0] for x, y, _ in PLACES]),
        "ROTATION": made.add(turns, component, shares=shares),
        "SCALE": made.add([[s, s, s] for *_, s in PLACES]),
    }
    return made.extended(made.node, "EXT_mesh_gpu_instancing", {"attributes": attributes})


def pictured(**options):
    """A picture of a kind that may hold several."""
    made = Gltf().painted()
    data = encoded(marked()[..., :3].copy(), "GIF", **options)
    made.doc["images"][0] = {"bufferView": made.view(data), "mimeType": "image/gif"}
    return made


def morphed(where, three=False, **targets):
    made = Gltf().painted()
    made.attributes["COLOR_0"] = made.add(np.full((4, 3), 0.5))
    made.part["targets"] = [
        {key: made.add(values) for key, values in targets.items()},
        {"POSITION": made.add(np.full((4, 3), 9.0))},
    ]
    where(made)["weights"] = [0.5, 0.0] + [0.0] * three
    return made


def plain_morph():
    made = at(np.add(QUAD, [0.3, 0.2, 0]), np.roll(UV, 1, axis=0))
    made.attributes["COLOR_0"] = made.add(COLOURS)
    return made


CHANGES = {
    "POSITION": np.tile([0.6, 0.4, 0], (4, 1)),
    "TEXCOORD_0": 2 * (np.roll(UV, 1, axis=0) - UV),
    "COLOR_0": 2 * (COLOURS - 0.5),
}


def skinned(inverse=True):
    """Two joints: the right half follows one that lies 1 up; the mesh's own node counts not."""
    made = Gltf().painted()
    joints = np.tile([0, 1, 0, 0], (4, 1))
    right = np.array([0, 1, 1, 0.0])
    weights = np.stack([1 - right, right, 0 * right, 0 * right], axis=1)
    made.attributes["JOINTS_0"] = made.add(joints, UBYTE)
    made.attributes["WEIGHTS_0"] = made.add(weights, UBYTE, shares=True)
    made.doc["nodes"] = [
        {"mesh": 0, "skin": 0, "translation": [5, 5, 5]},
        {"children": [2]},
        {"translation": [0.5, 0.3, 0]},
    ]
    made.doc["scenes"] = [{"nodes": [0, 1]}]
    made.doc["skins"] = [{"joints": [1, 2], "skeleton": 1}]
    if inverse:
        bind = np.tile(np.eye(4).T.ravel(), (2, 1))
        bind[1, 12] = -0.5  # a column-major translation of -0.5 in x
        made.doc["skins"][0]["inverseBindMatrices"] = made.add(bind, FLOAT, "MAT4")
    return made


def bent(by):
    return at(np.add(QUAD, [[0, 0, 0], by, by, [0, 0, 0]]))


def stored(kind):
    made = Gltf().painted()
    image = made.doc["images"][0]
    if kind == "uri":
        image.clear()
        image["uri"] = "data:image/png;base64," + base64.b64encode(encoded(marked())).decode()
    elif kind == "webp":
        extra = made.picture(None, "image/webp", encoded(marked(), "WEBP", lossless=True))
        made.doc["textures"] = [{"extensions": {"EXT_texture_webp": {"source": extra["index"]}}}]
        made.doc["extensionsUsed"] = ["EXT_texture_webp"]
    return made


def grey(bits):
    levels = np.linspace(0, 65535, 32).astype(np.uint16) * np.ones((32, 1), np.uint16)
    pixels = levels if bits == 16 else np.rint(levels / 257).astype(np.uint8)
    return Gltf().painted(pixels)


def glossy():
    made = Gltf(pbrMetallicRoughness={"baseColorFactor": [1, 0, 0, 1]})
    made.attributes["TEXCOORD_0"] = made.add(UV)
    content = {"diffuseFactor": [0.5, 1, 1, 1], "diffuseTexture": made.picture(marked())}
    return made.extended(made.material, "KHR_materials_pbrSpecularGlossiness", content)


def several_scenes(chosen):
    made = standing(PLACES)
    made.doc["scenes"] = [{"nodes": [0]}, {"nodes": [1, 2]}]
    made.doc["scene"] = chosen
    return made


def hidden():
    extra = [{"extensions": {"KHR_node_visibility": {"visible": False}}, "children": [4]},
             {"mesh": 0, "scale": [0.2, 0.2, 0.2]}]  # fmt: skip
    made = standing(PLACES, extra)
    made.doc["scenes"][0]["nodes"] = [0, 1, 2, 3]
    made.doc["extensionsUsed"] = ["KHR_node_visibility"]
    return made


def behind(double_sided, turned=True):
    return at(QUAD[::-1] if turned else QUAD, doubleSided=double_sided)


def nothing():
    made = Gltf()
    made.doc["nodes"].append({"mesh": 0, "translation": [0, 0, 90]})
    made.doc["scenes"] = [{"nodes": [1]}]
    return made.painted()


def around(wrap_s, wrap_t):
    """A picture seen with its surroundings: coordinates from -0.5 to 1.5."""
    return Gltf().painted(uv=2 * UV - 0.5).sampled(wrap_s, wrap_t)


def padded(along_u, along_v):
    pixels = np.pad(marked(), ((0, 0), (32, 32), (0, 0)), along_u)
    pixels = np.pad(pixels, ((32, 32), (0, 0), (0, 0)), along_v)
    return Gltf().painted(pixels, uv=(2 * UV + 0.5) / 3)


def enlarged(picture):
    made = Gltf().painted(picture).sampled(33071, 33071)
    made.doc["samplers"][0]["magFilter"] = 9728
    return made


HONOURED = {
    "texels with edges": (lambda: enlarged(marked()[8::16, 8::16]), lambda: enlarged(marked())),
    "coordinates in 2 bytes": (lambda: typed("TEXCOORD_0", UV, USHORT, True), moved),
    "coordinates in a byte": (lambda: typed("TEXCOORD_0", UV, UBYTE, True), moved),
    "coordinates signed": (lambda: typed("TEXCOORD_0", UV, BYTE, True), moved),
    "coordinates signed in 2 bytes": (lambda: typed("TEXCOORD_0", UV, SHORT, True), moved),
    "coordinates as integers": (lambda: typed("TEXCOORD_0", UV, USHORT, False), moved),
    "places in a byte": (lambda: typed("POSITION", QUAD, BYTE, True), moved),
    "places in 2 bytes": (lambda: typed("POSITION", QUAD, SHORT, True), moved),
    "places as integers": (lambda: typed("POSITION", QUAD, SHORT, False), moved),
    "places unsigned": (
        lambda: typed("POSITION", QUAD.clip(0), UBYTE, True), lambda: at(QUAD.clip(0))),
    "a strip": (lambda: in_mode(5, [3, 0, 2, 1]), moved),
    "a fan": (lambda: in_mode(6, [0, 1, 2, 3]), moved),
    "a list": (lambda: in_mode(4, FACES), moved),
    "indices of a byte": (lambda: indexed(UBYTE), moved),
    "indices of 4 bytes": (lambda: indexed(UINT), moved),
    "no indices": (without_indices, moved),
    "sparse": (lambda: panel(True), lambda: panel(False)),
    "no bufferView": (lambda: of_zeros(False), lambda: of_zeros(True)),
    "sparse without bufferView": (lambda: of_zeros(False, True), lambda: of_zeros(True, True)),
    "repeat": (lambda: around(10497, 10497), lambda: padded("wrap", "wrap")),
    "clamp": (lambda: around(33071, 33071), lambda: padded("edge", "edge")),
    "mirror": (lambda: around(33648, 33648), lambda: padded("symmetric", "symmetric")),
    "clamp along u": (lambda: around(33071, 10497), lambda: padded("edge", "wrap")),
    "mirror along v": (lambda: around(10497, 33648), lambda: padded("wrap", "symmetric")),
    "clamp at one place": (
        lambda: Gltf().painted(uv=np.tile([1.7, -0.2], (4, 1))).sampled(33071, 33071),
        lambda: Gltf().painted(uv=np.tile([0.9, 0.1], (4, 1)))),
    "transform offset": (
        lambda: transformed(UV, offset=[0.5, 0.25]), lambda: transformed(np.add(UV, [0.5, 0.25]))),
    "transform scale": (lambda: transformed(UV, scale=[2, 3]), lambda: transformed(UV * [2, 3])),
    "transform turn": (
        lambda: transformed(UV, rotation=np.pi / 2, scale=[2, 1], offset=[0, 0.5]),
        lambda: transformed(UV[:, ::-1] * [1, -2] + [0, 0.5])),
    "coordinates of set 1": (lambda: second_set("texCoord"), moved),
    "coordinates of set 1 by transform": (lambda: second_set("transform"), moved),
    "colours in a byte": (lambda: coloured(3, UBYTE, True), lambda: coloured(3)),
    "colours in 2 bytes": (lambda: coloured(3, USHORT, True), lambda: coloured(3)),
    "colours with alpha, opaque": (lambda: coloured(4, UBYTE, True), lambda: coloured(3)),
    "colour factor": (
        lambda: filled([1, 0.5, 0, 1], marked()[:1, :1]),
        lambda: Gltf().painted(np.full((1, 1, 3), (220, 21, 0), np.uint8))),
    "opaque whatever its alpha": (lambda: Gltf().painted(marked((0, 90))), moved),
    "mask": (
        lambda: Gltf(alphaMode="MASK").painted(marked((255, 0))),
        lambda: at(QUAD.clip([-1, 0, 0], 1), UV.clip(0, [1, 0.5]))),
    "mask by cutoff": (
        lambda: Gltf(alphaMode="MASK", alphaCutoff=0.2).painted(marked((70, 40))),
        lambda: Gltf(alphaMode="MASK").painted(marked((255, 0)))),
    "mask by factor": (
        lambda: filled([1, 1, 1, 0.6], marked((255, 110)), alphaMode="MASK"),
        lambda: Gltf(alphaMode="MASK").painted(marked((255, 0)))),
    "mask of nothing": (
        lambda: filled([1, 1, 1, 0.4], marked((255, 0)), alphaMode="MASK", alphaCutoff=0), moved),
    "blend of all or nothing": (
        lambda: Gltf(alphaMode="BLEND").painted(marked((255, 0))),
        lambda: Gltf(alphaMode="MASK").painted(marked((255, 0)))),
    "blend of an opaque picture": (lambda: Gltf(alphaMode="BLEND").painted(), moved),
    "emission": (
        lambda: glowing([0, 0.5, 1], [0.2, 0.1, 0]), lambda: glowing([0, 0, 0], [0.2, 0.6, 1])),
    "emission by a picture": (
        lambda: glowing([1, 1, 1], [0, 0, 0], marked()), moved),
    "emission by strength": (
        lambda: glowing([0, 0.1, 0.2], [0, 0, 0], strength=3),
        lambda: glowing([0, 0.3, 0.6], [0, 0, 0])),
    "seen from behind": (lambda: behind(True), lambda: at(QUAD[::-1])),
    "not seen from behind": (lambda: behind(False), nothing),
    "one side seen": (lambda: behind(False, turned=False), moved),
    "one side, mirrored": (
        lambda: changed(behind(False, turned=False), lambda m: m.node, scale=[-1, 1, 1]),
        lambda: at(QUAD * [-1, 1, 1])),
    "instances": (instanced, lambda: standing(PLACES)),
    "instances turned by bytes": (lambda: instanced(BYTE, True), lambda: standing(PLACES)),
    "morph by its mesh": (lambda: morphed(lambda m: m.doc["meshes"][0], **CHANGES), plain_morph),
    "morph by its node": (lambda: morphed(lambda m: m.node, **CHANGES), plain_morph),
    "skin": (skinned, lambda: bent([0, 0.3, 0])),
    "skin without matrices": (lambda: skinned(False), lambda: bent([0.5, 0.3, 0])),
    "a picture in its name": (lambda: stored("uri"), moved),
    "a picture as WebP": (lambda: stored("webp"), moved),
    "16 bits of grey": (lambda: grey(16), lambda: grey(8)),
    "specular and gloss": (glossy, lambda: filled([0.5, 1, 1, 1], marked())),
    "a matrix": (
        lambda: moved(matrix=[0.5, 0, 0, 0, 0, 0.25, 0, 0, 0, 0, 1, 0, 0.2, 0.1, 0, 1]),
        lambda: at(QUAD * [0.5, 0.25, 1] + [0.2, 0.1, 0])),
    "turn, then shift": (
        lambda: moved(translation=[0.2, 0.1, 0], rotation=[0, 0, 0.5**0.5, 0.5**0.5],
                      scale=[0.5, 0.25, 1]),
        lambda: at((QUAD * [0.5, 0.25, 1])[:, [1, 0, 2]] * [-1, 1, 1] + [0.2, 0.1, 0])),
    "pressed flat": (lambda: moved(scale=[1, 1, 0]), moved),
    "scene 1 of 2": (lambda: several_scenes(1), lambda: standing(PLACES[1:])),
    "a node that is hidden": (hidden, lambda: standing(PLACES)),
}  # fmt: skip
ALONG_A_CUT = {"mask": 64}
"""Pixels that may differ: along a cut the picture is filtered, and along an edge it is not."""


def differing(shown, control):
    return int((np.abs(shown - control) > 2).any(axis=-1).sum())


@pytest.mark.parametrize("feature", HONOURED)
def test_what_gltf_says_is_drawn_as_the_plain_control(draw, feature):
    made, control = HONOURED[feature]
    assert differing(draw(made()), draw(control())) <= ALONG_A_CUT.get(feature, 0)


def test_texels_with_edges_have_them_where_others_are_filtered_anisotropically(draw):
    made, control = HONOURED["texels with edges"]
    assert differing(draw(made(), anisotropy=4.0), draw(control(), anisotropy=4.0)) == 0


def objects(found, kind):
    """Yield every object of a document with the list that it is held against."""
    for entry in found if isinstance(found, list) else [found]:
        yield kind, entry
        for key, value in entry.items():
            if key in INSIDE.get(kind, {}):
                yield from objects(value, INSIDE[kind][key])
        for name, content in entry.get("extensions", {}).items():
            if name in GLTF:
                yield from objects(content, name)


def generic(key):
    return key if key == "COLOR_0" else re.sub(r"_\d+$", r"_\\d+", key)


def test_every_key_that_is_honoured_is_in_a_file_with_a_control():
    tried = {
        (kind, generic(key))
        for made, _ in HONOURED.values()
        for kind, entry in objects(made().doc, "document")
        for key in entry
    }
    anywhere = {"extras", "name", "extensions", "max", "min", "target"}  # change no picture
    honoured = {
        (kind, key)
        for kind, features in GLTF.items()
        for key, feature in features.items()
        if feature.verdict == "honoured" and key not in anywhere
    }
    # Transmission is refused unless it is 0; the others are in tests of their own.
    alone = {("document", "extensionsRequired"), ("attribute", "NORMAL"), ("target", "NORMAL"),
             ("document", "buffers"), ("buffer", "uri"), ("buffer", "byteLength")}  # fmt: skip
    assert honoured - tried - alone == set()
    used = {name for made, _ in HONOURED.values() for name in made().doc.get("extensionsUsed", [])}
    said = {name for name, feature in GLTF_EXTENSIONS.items() if feature.verdict == "honoured"}
    assert said - used == {
        "KHR_mesh_quantization",  # a promise about types, which are read in any case
        "KHR_materials_unlit",  # below
        "KHR_materials_transmission",
    }


def everything():
    """A document that has an object of every kind, and how to reach each."""
    made = skinned()
    made.attributes["COLOR_0"] = made.add(np.ones((4, 3)))
    made.part["targets"] = [{"POSITION": made.sparse(made.add(0 * QUAD), [0], [[0, 0, 0]])}]
    made.sampled(10497, 10497)
    texture = made.material["pbrMetallicRoughness"]["baseColorTexture"]
    texture["extensions"] = {"KHR_texture_transform": {}}
    made.material["extensions"] = {
        "KHR_materials_emissive_strength": {},
        "KHR_materials_transmission": {},
    }
    made.doc["nodes"][1]["extensions"] = {"KHR_node_visibility": {}, "EXT_mesh_gpu_instancing":
                                          {"attributes": {}}}  # fmt: skip
    made.doc["textures"][0]["extensions"] = {"EXT_texture_webp": {}}
    made.doc["materials"].append({"extensions": {"KHR_materials_pbrSpecularGlossiness": {}}})
    return made


NOTED = [
    (kind, key)
    for kind, features in GLTF.items()
    for key, feature in features.items()
    if feature.verdict == "noted"
] + [(kind, "wibble") for kind in GLTF]
VALUES = {"mode": 1, "cameras": [{}], "animations": [{}], "minFilter": 9728,
          r"COLOR_\d+": "COLOR_0", "_.*": "COLOR_0", "TANGENT": "COLOR_0"}  # fmt: skip


def test_what_is_noted_and_what_is_on_no_list_is_said_and_changes_nothing(draw, tmp_path):
    control = draw(everything())
    for kind, key in NOTED:
        made = everything()
        place = next(entry for of, entry in objects(made.doc, "document") if of == kind)
        name = {r"COLOR_\d+": "COLOR_1", "_.*": "_TEMPERATURE"}.get(key, key)
        if key == "mode":  # lines beside the triangles, which stay
            place = copy.deepcopy(place)
            made.doc["meshes"][0]["primitives"].append(place)
        value = VALUES.get(key, 7)
        place[name] = made.attributes[value] if value == "COLOR_0" else value
        world = load_world(made.save(tmp_path / "n.glb"))
        said = [note for note in world.notes if f"{kind}.{name}" in note]
        assert len(said) == 1, (kind, key, world.notes)
        assert (GLTF[kind][key].words if key != "wibble" else "not known") in said[0]
    assert (draw(made) == control).all()
    assert load_world(everything().save(tmp_path / "n.glb")).notes == ()


HARMLESS = [n for n, f in GLTF_EXTENSIONS.items() if f.verdict == "noted"] + ["ACME_wibble"]


@pytest.mark.parametrize("declared", [True, False])
def test_extensions_that_are_noted_or_unknown_are_said_and_change_nothing(tmp_path, declared):
    for name in HARMLESS:
        made = moved()
        made.extended(made.material, name, {"any": 1})
        if not declared:
            del made.doc["extensionsUsed"]
        (note,) = load_world(made.save(tmp_path / "n.glb")).notes
        assert name in note
    made = moved()
    made.extended(made.node, "KHR_materials_unlit", {})  # where it has no meaning
    (note,) = load_world(made.save(tmp_path / "n.glb")).notes
    assert "KHR_materials_unlit of a node" in note


def test_an_invented_chunk_is_said_and_changes_nothing(draw, tmp_path):
    path = moved().save(tmp_path / "s.glb")
    data = path.read_bytes() + struct.pack("<I4s", 4, b"WIBL") + b"abcd"
    path.write_bytes(data[:8] + struct.pack("<I", len(data)) + data[12:])
    (note,) = load_world(path).notes
    assert "left out chunk WIBL: it is not known" in note
    shown = draw(path)
    assert (shown == draw(moved())).all()


def test_points_and_lines_are_not_drawn_and_a_file_of_them_alone_is_refused(tmp_path):
    for mode in range(4):
        with pytest.raises(InputError, match="at least one triangle"):
            load_world(in_mode(mode, [0, 1, 2, 3]).save(tmp_path / "n.glb"))


def compressed(name):
    """Data that only the extension can unpack."""
    made = moved()
    if "draco" in name:
        made.extended(made.part, name, {"bufferView": 0, "attributes": {}})
        del made.doc["accessors"][0]["bufferView"]
        return made
    made.extended(made.doc["bufferViews"][0], name, {"buffer": 0})
    made.doc["bufferViews"][0]["buffer"] = 1
    made.doc["buffers"] = [{}, {"byteLength": 48, "extensions": {name: {"fallback": True}}}]
    return made


def only_as(name):
    made = moved()
    made.doc["textures"] = [{"extensions": {name: {"source": 0}}}]
    made.doc["extensionsUsed"] = [name]
    return made


def required(name):
    made = moved()
    made.doc["extensionsRequired"] = [name]
    return made


def lit_elsewhere():
    made = glowing([1, 1, 1], [1, 1, 1], marked()).painted()
    made.material["emissiveTexture"]["texCoord"] = 1
    made.attributes["TEXCOORD_1"] = made.add(UV)
    return made


def varying():
    made = Gltf(alphaMode="MASK").painted()
    made.attributes["COLOR_0"] = made.add(np.hstack([COLOURS, np.linspace(0, 1, 4)[:, None]]))
    return made


def unwrapped():
    made = moved()
    del made.attributes["TEXCOORD_0"]
    return made


def transmitting(factor):
    made = moved()
    content = {"transmissionFactor": factor}
    return made.extended(made.material, "KHR_materials_transmission", content)


REFUSED = {
    "KHR_draco_mesh_compression": (lambda: compressed("KHR_draco_mesh_compression"), moved),
    "EXT_meshopt_compression": (lambda: compressed("EXT_meshopt_compression"), moved),
    "KHR_meshopt_compression": (lambda: compressed("KHR_meshopt_compression"), moved),
    **{name: (lambda name=name: only_as(name), moved)
       for name in ("KHR_texture_basisu", "EXT_texture_avif", "MSFT_texture_dds")},
    "ACME_wibble": (lambda: required("ACME_wibble"), moved),
    "KHR_draco_mesh_compression)": (lambda: required("KHR_draco_mesh_compression"), moved),
    "transmission to 0": (lambda: transmitting(0.9), lambda: transmitting(0)),
    "a pixel of a warp has one depth": (
        lambda: Gltf(alphaMode="BLEND").painted(marked((255, 128))),
        lambda: Gltf(alphaMode="MASK").painted(marked((255, 128)))),
    "(it blends with what is behind it, throughout)": (
        lambda: filled([1, 1, 1, 0.15], alphaMode="BLEND"),
        lambda: filled([1, 1, 1, 0.15], alphaMode="OPAQUE")),
    "one alpha at all vertices": (varying, lambda: changed(varying(), lambda m: m.material,
                                                           alphaMode="OPAQUE")),
    "must lie as its colour does": (lit_elsewhere, lambda: changed(
        lit_elsewhere(), lambda m: m.material["emissiveTexture"], texCoord=0)),
    "has a picture, and a mesh of its has no TEXCOORD_0": (unwrapped, moved),
    "a primitive's mode must be 0 to 6": (lambda: in_mode(7, FACES), lambda: in_mode(4, FACES)),
    "an alphaMode is WIBBLE": (lambda: Gltf(alphaMode="WIBBLE"), Gltf),
    "wrap modes must be": (lambda: moved().sampled(1, 10497), moved),
    "TEXCOORD_0 must not be VEC2 of unsigned int normalized": (
        lambda: typed("TEXCOORD_0", UV, UINT, True), moved),
    "COLOR_0 must not be VEC3 of unsigned byte": (
        lambda: coloured(3, UBYTE, False), lambda: coloured(3, UBYTE, True)),
    "a matrix is no turn": (
        lambda: moved(matrix=[1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]), moved),
    "a node has a matrix, and a shift": (
        lambda: moved(matrix=np.eye(4).ravel().tolist(), scale=[1, 2, 1]), moved),
    "the length of a rotation's quaternion is 0": (
        lambda: moved(rotation=[0, 0, 0, 0]), lambda: moved(rotation=[0, 0, 0, 1])),
    "3 weights are for 2 targets": (
        lambda: morphed(lambda m: m.node, three=True, **CHANGES),
        lambda: morphed(lambda m: m.node, **CHANGES)),
    "it holds several pictures": (
        lambda: pictured(save_all=True, append_images=[Image.new("L", (32, 32))]), pictured),
    "an index names vertex 9 of 4": (lambda: in_mode(4, [0, 1, 9]), moved),
    "two parents": (lambda: standing(PLACES, [{"children": [0]}]), lambda: standing(PLACES)),
    "ends at byte": (lambda: changed(moved(), lambda m: m.doc["accessors"][0], count=400), moved),
    "its version is '1.0'": (
        lambda: changed(moved(), lambda m: m.doc["asset"], version="1.0"), moved),
    "its minVersion is '2.1'": (
        lambda: changed(moved(), lambda m: m.doc["asset"], minVersion="2.1"), moved),
    "has a uri and a bufferView": (
        lambda: changed(moved(), lambda m: m.doc["images"][0], uri="data:,"), moved),
    "positions must be finite": (lambda: at(QUAD * [np.nan, 1, 1]), moved),
}  # fmt: skip


@pytest.mark.parametrize("said", REFUSED)
def test_what_cannot_be_drawn_is_refused_and_its_cure_works(tmp_path, said):
    made, cured = REFUSED[said]
    with pytest.raises(InputError) as found:
        load_world(made().save(tmp_path / "r.glb"))
    assert said.split(")")[0] in str(found.value)
    assert "; " in str(found.value) or "must be finite" in said
    load_world(cured().save(tmp_path / "r.glb"))


@pytest.mark.parametrize("name", FALLBACKS)
def test_compressed_data_beside_plain_ones_change_nothing(draw, tmp_path, name):
    made = moved()
    if "texture" in name:
        made.doc["textures"][0]["extensions"] = {name: {"source": 0}}
    elif "draco" in name:
        made.part["extensions"] = {name: {"bufferView": 0, "attributes": {}}}
    else:
        made.doc["bufferViews"][0]["extensions"] = {name: {"buffer": 0}}
    made.doc["extensionsUsed"] = [name]
    assert (draw(made) == draw(moved())).all()
    (note,) = load_world(made.save(tmp_path / "s.glb")).notes
    assert name in note


def test_unlit_materials_are_shown_unlit_and_glow_not(draw):
    made = filled([0.2, 0.6, 1, 1], emissiveFactor=[1, 1, 1], normalTexture={"index": 0})
    made.extended(made.material, "KHR_materials_unlit", {})
    assert (draw(made) == draw(glowing([0, 0, 0], [0.2, 0.6, 1]))).all()


def test_weights_of_joints_that_do_not_add_up_are_noted(draw, tmp_path):
    made = skinned()
    right = np.array([0, 2, 2, 0.0])
    weights = np.stack([2 - right, right, 0 * right, 0 * right], axis=1)
    made.attributes["WEIGHTS_0"] = made.add(weights)
    assert (draw(made) == draw(skinned())).all()
    (note,) = load_world(made.save(tmp_path / "s.glb")).notes
    assert "weights of joints are brought to a sum of 1" in note
    assert load_world(skinned().save(tmp_path / "s.glb")).notes == ()


def test_a_mirrored_or_pressed_node_is_lit_as_its_plain_control(draw):
    for scale, corners in (([-1, 1, 1], QUAD * [-1, 1, 1]), ([1, 1, 0], QUAD)):
        made, control = Gltf(), Gltf()
        made.node["scale"] = scale
        control.attributes["POSITION"] = control.add(corners)
        shown = draw(made, lighting="sun")
        assert differing(shown, draw(control, lighting="sun")) == 0
        assert shown[32, 32].sum() > 100


def test_normals_of_every_type_and_bent_by_skins_and_morphs_light_as_floats(draw):
    def made(component=FLOAT, shares=False, slant=0.6):
        built = Gltf()
        built.node["scale"] = [0.6, 1, 1]
        slanted = np.tile([slant, 0.0, 0.8], (4, 1))
        built.attributes["NORMAL"] = built.add(slanted, component, shares=shares)
        return built

    def lit(built):
        return draw(built, lighting="sun")

    control = lit(made())
    assert differing(lit(made(SHORT, True)), control) == 0
    assert differing(lit(made(BYTE, True)), control) == 0
    assert differing(control, lit(made(slant=0))) > 500
    by_skin = made()
    by_skin.attributes["JOINTS_0"] = by_skin.add(np.zeros((4, 4)), UBYTE)
    by_skin.attributes["WEIGHTS_0"] = by_skin.add(np.tile([1, 0, 0, 0], (4, 1)))
    by_skin.doc["nodes"] = [{"mesh": 0, "skin": 0}, by_skin.node]
    by_skin.doc["nodes"][1].pop("mesh")
    by_skin.doc["scenes"] = [{"nodes": [0, 1]}]
    by_skin.doc["skins"] = [{"joints": [1]}]
    assert differing(lit(by_skin), control) == 0
    by_morph = made(slant=0)
    by_morph.part["targets"] = [{"NORMAL": by_morph.add(np.tile([1.2, 0, 0], (4, 1)))}]
    by_morph.doc["meshes"][0]["weights"] = [0.5]
    assert differing(lit(by_morph), control) == 0


def test_a_part_that_is_not_here_is_no_mistake_of_a_study(tmp_path):
    """Built clips are enough to run sessions."""
    study = write_small_study(tmp_path)
    (tmp_path / "wall.png").unlink()
    result = CliRunner().invoke(whole_app, ["protocol", "check", str(study)])
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize("link", ["wall.png", "sub"])
def test_a_link_inside_the_folder_does_not_lead_out_of_it(tmp_path, link):
    folder, path = tmp_path / "scene", tmp_path / "scene" / "box.gltf"
    folder.mkdir()
    write_small_study(folder)
    if link == "sub":
        path.write_text(path.read_text().replace("wall.png", "sub/wall.png"))
    outside = tmp_path / "outside"
    outside.mkdir()
    if link == "sub":
        (folder / "wall.png").rename(outside / "wall.png")
        (folder / "sub").symlink_to(outside)
    else:
        (folder / link).rename(outside / link)
        (folder / link).symlink_to(outside / link)
    with pytest.raises(InputError, match=r"in its own folder \(.* lies outside\)"):
        load_world(path)
    # The cure: the file itself.
    if link == "sub":
        (folder / "sub").unlink()
        outside.rename(folder / "sub")
    else:
        (folder / link).unlink()
        (outside / link).rename(folder / link)
    assert load_world(path).parts


@pytest.mark.parametrize(
    "name",
    [
        *(r"C:\Users\me\wall.png", "D:/scans/wall.png", "file:" + "///home/me/wall.png"),
        *(r"\\server\share\wall.png", "../textures/wall.png", "/elsewhere/wall.png"),
        "C:%5CUsers%5Cwall.png",
    ],
)
def test_a_place_on_another_machine_means_the_file_beside_the_mesh(tmp_path, name):
    path = tmp_path / "scene" / "box.gltf"
    path.parent.mkdir()
    write_small_study(path.parent)
    read = json.loads(path.read_text())
    read["images"][0]["uri"] = name
    path.write_text(json.dumps(read))
    picture = (path.parent / "wall.png").rename(tmp_path / "apart.png")
    with pytest.raises(InputError, match=r"put .*there, or export the scene as one \.glb"):
        load_world(path)
    picture.rename(path.parent / "wall.png")  # the cure
    assert load_world(path).parts
    assert path.parent / "wall.png" in files_of(path)


# Situations that people reported to other programs, with the right values


def seen(shown, x, y):
    """Colour at a place of the plane z = 0."""
    scale = 32 / (3 * np.tan(np.radians(30)))
    return tuple(shown[int(32 - y * scale), int(32 + x * scale)])


RED, GREEN, BLUE, WHITE = (220, 30, 30), (30, 200, 30), (40, 60, 220), (240, 240, 240)


@pytest.mark.parametrize("component", [USHORT, UBYTE])
def test_coordinates_of_integers_show_four_squares(draw, component):
    shown = draw(typed("TEXCOORD_0", UV, component, True))
    corners = [seen(shown, x, y) for x, y in ((-0.5, 0.5), (0.5, 0.5), (-0.5, -0.5), (0.5, -0.5))]
    assert corners == [RED, GREEN, BLUE, WHITE]


def test_a_fan_before_a_wall_is_there(draw):
    made = moved()
    turn = np.arange(7) * np.pi / 3
    rim = np.stack([0.6 * np.cos(turn), 0.6 * np.sin(turn), np.full(7, 0.1)], axis=1)
    made.doc["materials"].append({"pbrMetallicRoughness": {"baseColorFactor": [1, 0.6, 0, 1]}})
    disc = {"attributes": {"POSITION": made.add(np.vstack([[0, 0, 0.1], rim]))}, "mode": 6}
    made.doc["meshes"][0]["primitives"].append(disc | {"material": 1})
    shown = draw(made)
    assert seen(shown, 0.1, 0.1) == seen(shown, -0.4, -0.2) == (255, 203, 0)
    assert seen(shown, 0.8, 0.8) == GREEN


def test_a_sparse_panel_is_as_wide_as_its_substitutes_say(tmp_path):
    low, high = load_world(panel(True).save(tmp_path / "p.glb")).bounds_m
    np.testing.assert_allclose(high - low, [2.4, 2, 0])


def many_targets(sparse):
    """A square among 504 corners, and 52 targets of which one counts."""
    made = at(np.vstack([QUAD, np.zeros((500, 3))]), uv=np.vstack([UV, np.zeros((500, 2))]))
    change = np.zeros((504, 3))
    change[1:3] = [0.8, 0.0, 0.0]
    whole = [number == 51 and not sparse for number in range(52)]
    made.part["targets"] = [{"POSITION": made.add(change * own, view=own)} for own in whole]
    if sparse:
        for target in made.part["targets"]:
            made.sparse(target["POSITION"], [1, 2], change[1:3])
    made.doc["meshes"][0]["weights"] = [0.0] * 51 + [0.5]
    return made


def test_sparse_targets_need_no_bufferview_of_their_own(draw):
    shown = draw(many_targets(sparse=True))
    assert differing(shown, draw(many_targets(sparse=False))) == 0
    assert differing(shown, draw(bent([0.4, 0, 0]))) == 0


@pytest.mark.parametrize(
    "written",
    [
        lambda data: "data:image/png;base64," + quote(base64.b64encode(data), safe=""),
        lambda data: "Data:image/png;BASE64," + base64.b64encode(data).decode(),
        lambda data: "data:image/png," + quote(data),
        lambda data: "data:image/png;base64," + base64.encodebytes(data).decode(),
    ],
)
def test_a_data_uri_holds_its_bytes_however_it_is_written(tmp_path, written):
    data = b"\xfb\xef\xbe\xff%+ \n" * 10 + b"\0"
    assert "+" in base64.b64encode(data).decode()
    assert data_of_uri(tmp_path, written(data)) == data


def test_a_data_uri_that_is_not_whole_is_refused_without_its_bytes(tmp_path):
    made = stored("uri")
    image, whole = made.doc["images"][0], made.doc["images"][0]["uri"]
    image["uri"] = whole.replace("data", "DATA", 1)
    load_world(made.save(tmp_path / "s.glb"))
    for bad in (whole + "\x1b%ff", whole[:-1] + "!", whole[:-1], "data:image/png;base64"):
        image["uri"] = bad
        with pytest.raises(InputError, match=r"s\.glb: a data URI must hold whole base64") as found:
            load_world(made.save(tmp_path / "s.glb"))
        assert str(found.value).isprintable()
        assert whole[30:60] not in str(found.value)


@pytest.mark.parametrize("cutoff", [51 / 255, float(np.float32(51 / 255))])
def test_texels_whose_alpha_is_the_cutoff_keep_their_colour(draw, cutoff):
    shown = draw(Gltf(alphaMode="MASK", alphaCutoff=cutoff).painted(marked((255, 51))))
    assert (shown == draw(moved())).all()


def test_a_uri_is_decoded(tmp_path):
    for name in ("a b.png", "a%20b.png"):
        (tmp_path / name).touch()
    assert file_of_name(tmp_path / "s.gltf", "a%20b.png").name == "a b.png"


def colours_of(factor):
    made = Gltf()
    made.attributes["COLOR_0"] = made.add(np.multiply(COLOURS, factor))
    return made


@pytest.mark.parametrize(
    ("made", "cured", "said"),
    [
        (lambda: filled([1, 2, 0, 1]), lambda: filled([1, 1, 0, 1]), "(got 0 to 2)"),
        (lambda: filled([1, 1, 0, -0.5]), lambda: filled([1, 1, 0, 1]), "(got -0.5 to 1)"),
        (lambda: colours_of(255), lambda: colours_of(1), "COLOR_0 must be from 0 to 1 (got 0 to 2"),
    ],
)
def test_colours_of_a_gltf_are_shares(tmp_path, made, cured, said):
    with pytest.raises(InputError) as found:
        load_world(made().save(tmp_path / "s.glb"))
    assert said in str(found.value)
    assert load_world(cured().save(tmp_path / "s.glb")).parts


def test_16_bits_of_grey_keep_their_clear_value():
    levels = np.full((8, 8), 65535, np.uint16)
    levels[:4], levels[0, 0] = 256, 257
    data = encoded(levels)
    chunk = b"tRNS" + struct.pack(">H", 256)
    chunk = struct.pack(">I", 2) + chunk + struct.pack(">I", zlib.crc32(chunk))
    pixels = mesh_surface.decoded(data[:33] + chunk + data[33:], "p.png", "a picture")
    assert pixels[0, 1].tolist() == [1, 1, 1, 0]
    assert pixels[0, 0].tolist() == [1, 1, 1, 255]
    assert pixels[4, 4].tolist() == [255, 255, 255, 255]


def test_alpha_of_a_corner_that_no_triangle_has_counts_not(tmp_path):
    made = at(np.vstack([QUAD, [[9, 9, 9]]]), np.vstack([UV, [[0, 0]]]), alphaMode="MASK")
    made.attributes["COLOR_0"] = made.add([[1, 1, 1, 1]] * 4 + [[1, 1, 1, 0]])
    assert load_world(made.save(tmp_path / "s.glb")).parts


# What is said where


def commands_notes(*arguments):
    result = CliRunner().invoke(typer_app, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return [line for line in result.stdout.splitlines() if line.startswith("note: ")]


@pytest.mark.usefixtures("gl_context")
def test_looking_and_panoramas_say_what_is_left_out(tmp_path):
    made = moved()
    made.doc["cameras"] = [{}]
    path = made.save(tmp_path / "s.glb")
    said = [f"note: {path}: left out document.cameras: the camera is the study's"]
    line = "view = { position_m = [0, 0, 3], look_at_m = [0, 0, 0] }"
    sheet, round_about = tmp_path / "v.png", tmp_path / "p.png"
    assert commands_notes("look", path, "--out", sheet, "--view", line) == said
    assert (
        commands_notes("panorama", path, "--out", round_about, "--view", line, "--height-px", 16)
        == said
    )


def test_a_new_scene_of_a_study_says_what_is_left_out(tmp_path):
    made = moved()
    made.doc["animations"] = [{}]
    path, notes = made.save(tmp_path / "s.glb"), []
    bring_scene(str(path), tmp_path / "study", [], None, note=notes.append)
    assert notes == [f"{path}: left out document.animations: the pose at rest is drawn"]
    transmitting(0.5).save(path)
    with pytest.raises(InputError, match="set its transmission to 0"):
        bring_scene(str(path), tmp_path / "other", [], None)
    assert not (tmp_path / "other").exists()


HALF = {"baseColorFactor": [0.7, 0.1, 0.1, 0.5]}


def test_a_check_of_a_study_says_what_is_left_out_and_refused(tmp_path):
    study = write_small_study(tmp_path)
    box, made = tmp_path / "box.gltf", box_document() | {"cameras": [{}]}
    box.write_text(json.dumps(made))
    result = CliRunner().invoke(whole_app, ["protocol", "check", str(study)])
    assert result.exit_code == 0, result.output
    said = f"{box}: left out document.cameras: the camera is the study's"
    assert f"note: stimuli.scenes[0]: {said}" in result.stdout.splitlines()
    made["materials"][1] |= {"alphaMode": "BLEND", "pbrMetallicRoughness": HALF}
    box.write_text(json.dumps(made))
    result = CliRunner().invoke(whole_app, ["protocol", "check", str(study)])
    assert result.exit_code == 2
    assert f"stimuli.scenes[0]: {box}: material 'box' must be opaque or cut out" in result.stderr


def test_a_picture_that_is_drawn_smaller_is_noted(tmp_path, monkeypatch):
    monkeypatch.setattr(mesh_surface, "LARGEST_TEXTURE_PX", 16)
    world = load_world(moved().save(tmp_path / "s.glb"))
    assert world.parts[0].material.texture.shape == (16, 16, 4)
    assert "is 32 x 32 px and is drawn from 16 x 16" in world.notes[0]


# The page


def test_the_page_shows_the_lists_as_they_are(repository):
    page = (repository / "docs" / "stimuli.md").read_text(encoding="utf-8")
    begin, end = "<!-- mesh features: begin -->\n", "\n<!-- mesh features: end -->"
    assert page.partition(begin)[2].partition(end)[0] == table(ROWS)
