"""Scenes from glTF 2.0 files (.glb, .gltf).

`mesh_features` says what of a file is drawn; what is not is noted or refused. Light is either what
the textures hold (unlit: most scenes made for games have it baked in), or one sun with shadows and
the sky's light.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from protocols.limits import LIMITS_VARIABLE, limit
from protocols.outside import reading
from stimuli.rendering.world import (
    Light,
    Material,
    Mesh,
    MeshPart,
    Vector,
    Viewpoint,
    World,
    vector,
)
from stimuli.scenes.gltf import Document
from stimuli.scenes.mesh_features import UNKNOWN, Notes, check_gltf
from stimuli.scenes.mesh_inputs import check_lists, document, files_of, other_chunks
from stimuli.scenes.mesh_surface import Shape, laid_uv, material_of, with_alpha

SUN = Light(
    sun_direction=(-0.65, 0.7, 0.35),
    sun=(1.45, 1.36, 1.2),
    sky=(0.3, 0.34, 0.42),
    ground=(0.14, 0.12, 0.1),
    exposure=0.9,
)
"""A surface that faces the sun comes out about as bright as its colour, and shade is half that."""


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
        or vertex colours is unlit, since those bring their light, as is one that asks for it
        (KHR_materials_unlit), and one of plain colours alone is lit, since it would show no form.
    sun_direction : (x, y, z), optional
        From the scene towards the sun; asks for ``sun``.

    The viewpoint is outside, towards the middle: a protocol's `view` replaces it. The world's
    notes say what the file says and is not drawn.

    Raises
    ------
    FileNotFoundError
        If the file, or one that it names, is missing.
    InputError
        If it is damaged, empty, too large, or says what cannot be drawn.
    """
    files_of(path)
    check_lists(path)
    notes = Notes(path)
    whole = reading(path, f"a whole {path.suffix} file", InputError, "export it again")
    with whole, np.errstate(all="ignore"):  # what is not finite is refused
        shapes = _within_limits(path, _shapes(path, notes))
        if lighting is None:
            bare = sun_direction is None and any(
                one.surface.picture is not None or one.surface.unlit or one.colour is not None
                for one in shapes
            )
            lighting = "unlit" if bare else "sun"
        lit = lighting == "sun"
        materials: dict[tuple[int, float], Material | None] = {}
        parts = [
            part
            for shape in shapes
            if (material := _material(shape, notes, materials, lit)) is not None
            for part in _parts(path, shape, material, scale)
        ]
    if not parts:
        raise InputError(f"{path}: must hold at least one triangle that is seen (it holds none)")
    light = replace(SUN, sun_direction=sun_direction or SUN.sun_direction) if lit else None
    return World(tuple(parts), _outside(parts), light, notes=notes.lines())


def _shapes(path: Path, notes: Notes) -> Iterator[Shape]:
    read = document(path)
    check_gltf(notes, read)
    for kind in other_chunks(path):
        notes.left_out(f"chunk {kind}", UNKNOWN)
    return Document(path, read, notes).shapes()


def _within_limits(path: Path, shapes: Iterator[Shape]) -> list[Shape]:
    found, triangles = [], 0
    for shape in shapes:
        triangles += len(shape.triangles) * len(shape.places)
        if triangles > (most := limit("triangles")):
            raise InputError(
                f"{path}: must have at most {most:,} triangles (has more); simplify it, cut away"
                f" what the camera does not see, or raise the limit with"
                f" {LIMITS_VARIABLE}=triangles=NUMBER"
            )
        if len(shape.triangles):
            found.append(shape)
    return found


def _material(
    shape: Shape, notes: Notes, known: dict[tuple[int, float], Material | None], lit: bool
) -> Material | None:
    surface = with_alpha(shape, notes)
    key = (id(shape.surface), surface.alpha)
    if key not in known:
        known[key] = material_of(surface, notes, lit)
    return known[key]


def _parts(path: Path, shape: Shape, material: Material, scale: float) -> Iterator[MeshPart]:
    count = len(shape.position)
    uv = np.zeros((count, 2)) if shape.uv is None else laid_uv(shape.surface, shape.uv)
    colour = np.ones((count, 3)) if shape.colour is None else shape.colour[:, :3]
    normal = np.zeros((count, 3)) if shape.normal is None else shape.normal
    flat = material.lit and shape.normal is None
    colour = colour * shape.surface.colour
    try:
        mesh = Mesh(
            shape.position.astype(np.float32),
            normal.astype(np.float32),
            uv.astype(np.float32),
            colour.astype(np.float32),
            shape.triangles.astype(np.uint32),
        )
        for place in shape.places:
            matrix = place.copy()
            matrix[:3] *= scale
            yield MeshPart(_placed(mesh, matrix, flat), material)
    except InputError as error:
        raise InputError(f"{path}: {error}; export it again") from None


def _placed(mesh: Mesh, matrix: NDArray[np.float64], flat: bool) -> Mesh:
    """Return the mesh where it stands; mirrored, its corners still turn as the file means it."""
    volume = np.linalg.det(matrix[:3, :3])
    if volume < 0:
        mesh = replace(mesh, triangles=mesh.triangles[:, ::-1])
    if abs(volume) < 1e-30:  # pressed flat: no normal of it can be turned
        position = (mesh.position_m @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32)
        return replace(mesh, position_m=position).faceted()
    moved = mesh.transformed(matrix)
    return moved.faceted() if flat else moved


def _outside(parts: list[MeshPart]) -> Viewpoint:
    low = np.min([part.mesh.position_m.min(axis=0) for part in parts], axis=0).astype(float)
    high = np.max([part.mesh.position_m.max(axis=0) for part in parts], axis=0).astype(float)
    centre, radius = (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 1e-6)
    place = centre + radius * np.array([0.9, 0.7, 1.6])
    return Viewpoint(vector(place), vector(centre))
