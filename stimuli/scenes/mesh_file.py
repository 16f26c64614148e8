"""Scenes from glTF 2.0 (.glb, .gltf) and Wavefront (.obj) files, read by trimesh.

Base colour, vertex colours, coverage (alphaMode MASK and BLEND) and transforms are taken. Light
is either what the textures hold (unlit: most scenes made for games have it baked in), or one
sun with shadows and the sky's light. Other material properties, lights, cameras, skins and
animations are left out.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.visual.material import PBRMaterial

from pipeline.errors import InputError
from protocols.outside import LIMITS_VARIABLE, limit, reading
from stimuli.scenes.mesh_inputs import (
    OnlyThese,
    check_lists,
    check_textures,
    document,
    words_after,
)
from stimuli.world import Light, Material, Mesh, Part, Vector, Viewpoint, World

LARGEST_TEXTURE_PX = 8192
SUN = Light(
    sun_direction=(-0.65, 0.7, 0.35),
    sun=(1.45, 1.36, 1.2),
    sky=(0.3, 0.34, 0.42),
    ground=(0.14, 0.12, 0.1),
    exposure=0.9,
)
"""A surface that faces the sun comes out about as bright as its colour, and shade is half that."""
_WHITE = np.full((1, 1, 4), 255, np.uint8)


def load_world(
    path: Path,
    *,
    scale: float = 1.0,
    lighting: Literal["unlit", "sun"] | None = None,
    sun_direction: Vector | None = None,
) -> World:
    """Read a scene.

    Parameters
    ----------
    scale : float
        Metres per unit of the file.
    lighting : optional
        ``unlit`` shows colours as they are, ``sun`` lights them; left out, a file with textures
        or vertex colours is unlit, since those bring their light, and one of plain colours
        alone is lit, since it would show no form.
    sun_direction : (x, y, z), optional
        From the scene towards the sun; asks for ``sun``.

    The viewpoint is outside, towards the middle: a protocol's `view` replaces it.

    Raises
    ------
    FileNotFoundError
        If the file, or one that it names, is missing.
    InputError
        If it is damaged, empty, too large, or needs an extension that is not supported.
    """
    files = OnlyThese(path)
    check_lists(path)
    try:
        scene = trimesh.load_scene(path, process=False, resolver=files)
    except MemoryError:
        raise InputError(f"{path}: is too large for this machine's memory") from None
    except Exception as error:  # trimesh raises whatever its parsers meet
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(
            f"{path}: must be a whole {path.suffix} file (its reader says: {reason});"
            " export it again"
        ) from error
    if files.refused:
        raise InputError(
            f"{path}: must name its files so that they are found and hashed (its reader asked for"
            f" {files.refused[0]!r}); export it as one .glb file"
        )
    check_textures(path)
    if lighting is None:
        bare = sun_direction is None and _brings_light(scene)
        lighting = "unlit" if bare else "sun"
    lit = lighting == "sun"
    facets = lit and not _brings_normals(path)
    parts, triangles = [], 0
    materials: dict[int, Material] = {}
    with reading(path, f"a whole {path.suffix} file", InputError):  # names may be no text
        placed = [scene.graph[node] for node in scene.graph.nodes_geometry]
    for transform, name in placed:
        geometry = scene.geometry[name]
        if not isinstance(geometry, trimesh.Trimesh) or not len(geometry.faces):
            continue
        triangles += len(geometry.faces)
        if triangles > (most := limit("triangles", InputError)):
            raise InputError(
                f"{path}: must have at most {most:,} triangles (has more); simplify it, cut away"
                f" what the camera does not see, or raise the limit with"
                f" {LIMITS_VARIABLE}=triangles=NUMBER"
            )
        matrix = np.asarray(transform, np.float64).copy()
        matrix[:3] *= scale
        if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix[:3, :3])) < 1e-30:
            continue  # scaled to nothing: it cannot be seen
        with reading(path, f"a whole {path.suffix} file", InputError):
            part = _part(path, geometry, matrix, materials, lit)
        parts.append(Part(part.mesh.faceted(), part.material) if facets else part)
    if not parts:
        raise InputError(f"{path}: must hold at least one triangle (it holds none)")
    light = replace(SUN, sun_direction=sun_direction or SUN.sun_direction) if lit else None
    return World(tuple(parts), _outside(parts), light)


def _part(
    path: Path,
    geometry: trimesh.Trimesh,
    matrix: NDArray[np.float64],
    materials: dict[int, Material],
    lit: bool,
) -> Part:
    position = np.asarray(geometry.vertices, np.float64)
    if not np.isfinite(position).all():
        raise InputError(f"{path}: positions must be finite (some of {len(position)} are not)")
    count = len(position)
    visual: Any = geometry.visual
    uv = getattr(visual, "uv", None)
    source = getattr(visual, "material", None)
    if uv is None or len(uv) != count or not np.isfinite(uv).all():
        uv = np.zeros((count, 2))
    colour = _vertex_colours(visual, count)
    if source is not None:
        colour = colour * _factor(source)
    key = id(source)
    if key not in materials:
        materials[key] = _material(source, lit)
    mesh = Mesh(
        position.astype(np.float32),
        np.asarray(geometry.vertex_normals, np.float32),
        np.asarray(uv, np.float32),
        colour.astype(np.float32),
        np.asarray(geometry.faces, np.uint32),
    )
    return Part(mesh.transformed(matrix), materials[key])


def _brings_light(scene: Any) -> bool:
    """Whether any surface has a texture or colours of its own at its vertices."""
    for geometry in scene.geometry.values():
        visual = getattr(geometry, "visual", None)
        if _stored_colours(visual) is not None or _image(getattr(visual, "material", None)):
            return True
    return False


def _brings_normals(path: Path) -> bool:
    """Without normals, both formats mean flat triangles."""
    if path.suffix.lower() == ".obj":
        return bool(words_after(path, "vn"))
    meshes = document(path).get("meshes", [])
    return any("NORMAL" in part["attributes"] for mesh in meshes for part in mesh["primitives"])


def _stored_colours(visual: Any) -> Any:
    attributes = getattr(visual, "vertex_attributes", None) or {}
    stored = attributes.get("color")
    if stored is None and getattr(visual, "kind", None) == "vertex":
        stored = visual.vertex_colors
    return stored


def _vertex_colours(visual: Any, count: int) -> NDArray[np.float64]:
    """COLOR_0 is linear; other files' vertex colours are encoded."""
    stored = _stored_colours(visual)
    if stored is None or len(stored) != count:
        return np.ones((count, 3))
    values = np.asarray(stored)
    scale = np.iinfo(values.dtype).max if values.dtype.kind == "u" else 1.0
    return np.asarray(values[:, :3] / scale, np.float64).clip(0, 1)


def _factor(source: Any) -> NDArray[np.float64]:
    factor = getattr(source, "baseColorFactor", None)
    if factor is None:
        # An .obj's diffuse colour: a texture replaces it, as in most viewers.
        factor = getattr(source, "diffuse", None) if _image(source) is None else None
    if factor is None:
        return np.ones(3)
    values = np.asarray(factor, np.float64)[:3]
    return values / 255.0 if np.asarray(factor).dtype.kind in "ui" else values


def _image(source: Any) -> Image.Image | None:
    name = "baseColorTexture" if isinstance(source, PBRMaterial) else "image"
    picture = getattr(source, name, None)
    return picture if isinstance(picture, Image.Image) else None


def _material(source: Any, lit: bool) -> Material:
    picture = None if source is None else _image(source)
    if picture is None:
        return Material(_WHITE, lit=lit)
    mode = getattr(source, "alphaMode", None)
    largest = max(picture.size)
    if largest > LARGEST_TEXTURE_PX:
        share = LARGEST_TEXTURE_PX / largest
        width, height = (max(1, round(share * edge)) for edge in picture.size)
        picture = picture.resize((width, height))
    pixels = np.asarray(picture.convert("RGBA"), np.uint8)
    cutout = mode in ("MASK", "BLEND") or (mode is None and bool((pixels[..., 3] < 128).any()))
    if cutout:
        from stimuli.scenes.textures import finish

        cutoff = getattr(source, "alphaCutoff", None) or 0.5
        coverage = np.clip(pixels[..., 3] / 255 * 0.5 / float(cutoff), 0, 1)
        pixels = finish(pixels[..., :3].astype(np.float64), coverage)
    else:
        pixels = np.concatenate([pixels[..., :3], np.full_like(pixels[..., :1], 255)], axis=-1)
    # trimesh counts v upwards from the picture's last row.
    return Material(np.ascontiguousarray(pixels[::-1]), cutout=cutout, lit=lit)


def _outside(parts: list[Part]) -> Viewpoint:
    low = np.min([part.mesh.position_m.min(axis=0) for part in parts], axis=0).astype(float)
    high = np.max([part.mesh.position_m.max(axis=0) for part in parts], axis=0).astype(float)
    centre, radius = (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 1e-6)
    place = centre + radius * np.array([0.9, 0.7, 1.6])
    return Viewpoint(
        (float(place[0]), float(place[1]), float(place[2])),
        (float(centre[0]), float(centre[1]), float(centre[2])),
    )
