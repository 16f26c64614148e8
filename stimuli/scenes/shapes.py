"""Solids, surfaces and plants that the built-in scenes are made of, in metres, with texture places.

`uv` counts textures: `texture_m` is how much of the world one copy of a texture covers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stimuli.rendering.world import Material, Mesh, MeshPart
from stimuli.scenes import textures

WHOLE_TEXTURE = np.array([[[0.0, 0.0], [1.0, 0.0]], [[0.0, 1.0], [1.0, 1.0]]])
"""Places in its texture of the corners of a sheet of two rows and two columns."""

Height = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]


def surface(
    position: NDArray[np.float64],
    uv: NDArray[np.float64],
    *,
    closed: bool = False,
    normal: ArrayLike | None = None,
) -> Mesh:
    """A grid of points (rows, columns, 3) as triangles with smooth normals.

    `closed` says that the last column lies on the first (a tube). A flat sheet may give the
    one `normal` (3,) that all of it has.
    """
    rows, columns, _ = position.shape
    count = rows * columns
    if normal is None:
        normals = _smooth_normals(position, closed).reshape(count, 3)
    else:
        normals = np.broadcast_to(np.asarray(normal, np.float64), (count, 3))
    return Mesh(
        position.reshape(count, 3).astype(np.float32),
        normals.astype(np.float32),
        uv.reshape(count, 2).astype(np.float32),
        np.ones((count, 3), np.float32),
        _grid_triangles(rows, columns),
    )


def _smooth_normals(position: NDArray[np.float64], closed: bool) -> NDArray[np.float64]:
    along_rows = _steps(position) if len(position) > 1 else np.zeros_like(position)
    if closed:
        ring = np.concatenate([position[:, -2:-1], position, position[:, 1:2]], axis=1)
        along_columns = (ring[:, 2:] - ring[:, :-2]) / 2
    else:
        along_columns = _steps(position.swapaxes(0, 1)).swapaxes(0, 1)
    normal = _crossed(along_rows, along_columns)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.where(length > 1e-12, normal / np.maximum(length, 1e-12), (0.0, 1.0, 0.0))


def _steps(position: NDArray[np.float64]) -> NDArray[np.float64]:
    """`np.gradient` along the first axis; for grids this small, much of its time is overhead."""
    result = np.empty_like(position)
    result[1:-1] = (position[2:] - position[:-2]) / 2
    result[0], result[-1] = position[1] - position[0], position[-1] - position[-2]
    return result


def _crossed(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """`np.cross` of the last axis, without its overhead."""
    return a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]


@lru_cache(maxsize=1024)
def _grid_triangles(rows: int, columns: int) -> NDArray[np.uint32]:
    index = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    triangles = np.stack([a, c, b, b, c, d], axis=-1).reshape(-1, 3)
    triangles.setflags(write=False)  # meshes share it
    return triangles


def ground(
    low: tuple[float, float],
    high: tuple[float, float],
    step_m: float,
    texture_m: float,
    height: Height | None = None,
) -> Mesh:
    """Ground from corner `low` to `high` in (x, z), at y = `height` (x, z)."""
    x = np.linspace(low[0], high[0], max(2, round((high[0] - low[0]) / step_m)))
    z = np.linspace(low[1], high[1], max(2, round((high[1] - low[1]) / step_m)))
    xx, zz = np.meshgrid(x, z)
    yy = np.zeros_like(xx) if height is None else height(xx, zz)
    return surface(np.stack([xx, yy, zz], -1), np.stack([xx, zz], -1) / texture_m)


def wall(
    start: tuple[float, float],
    end: tuple[float, float],
    low_m: float,
    high_m: float,
    texture_m: float,
    step_m: float = 0.4,
) -> Mesh:
    """An upright sheet over the line `start` to `end` in (x, z)."""
    length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
    columns = max(2, round(length / step_m) + 1)
    rows = max(2, round((high_m - low_m) / step_m) + 1)
    t, y = np.meshgrid(np.linspace(0, 1, columns), np.linspace(low_m, high_m, rows))
    x, z = start[0] + t * (end[0] - start[0]), start[1] + t * (end[1] - start[1])
    return surface(np.stack([x, y, z], -1), np.stack([t * length, y], -1) / texture_m)


def box(
    centre: ArrayLike, size: ArrayLike, texture_m: float, *, step_m: float = 0.5,
    turn_deg: float = 0.0, offset: tuple[float, float] = (0.0, 0.0),
) -> Mesh:  # fmt: skip
    """A block; `offset` shifts its texture, so that neighbours differ."""
    half = np.asarray(size, np.float64) / 2
    faces = []
    for axis in range(3):
        u_axis, v_axis = ((2, 1), (0, 2), (0, 1))[axis]
        counts = [max(2, round(2 * half[a] / step_m) + 1) for a in (u_axis, v_axis)]
        uv = np.empty((counts[1], counts[0], 2))
        uv[..., 0] = np.linspace(-half[u_axis], half[u_axis], counts[0])
        uv[..., 1] = np.linspace(-half[v_axis], half[v_axis], counts[1])[:, None]
        place = uv / texture_m + (np.asarray(offset) + 0.37 * axis)
        for sign in (-1.0, 1.0):
            position = np.empty((*uv.shape[:2], 3))
            position[..., axis] = sign * half[axis]
            position[..., u_axis], position[..., v_axis] = uv[..., 0], uv[..., 1]
            faces.append(surface(position, place, normal=sign * np.eye(3)[axis]))
    x, y, z = np.asarray(centre, np.float64)
    return Mesh.joined(faces).moved(float(x), float(y), float(z), turn_deg=turn_deg)


def tube(
    path: ArrayLike,
    radius_m: ArrayLike,
    texture_m: tuple[float, float],
    *,
    sides: int = 12,
    flutes: int = 0,
    flute_depth: float = 0.0,
) -> Mesh:
    """A round body along `path` (N, 3) with a radius at each point: trunks, branches, columns.

    `texture_m` is (around, along).
    """
    line = np.asarray(path, np.float64)
    radius = np.broadcast_to(np.asarray(radius_m, np.float64), (len(line),))
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    reference = np.array([1.0, 0.0, 0.0]) if abs(tangent[:, 0]).max() < 0.9 else np.array([0, 0, 1])
    side = np.cross(tangent, reference)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(tangent, side)
    turn = np.linspace(0, 2 * np.pi, sides + 1)
    profile = (
        1 - flute_depth * (0.5 + 0.5 * np.cos(flutes * turn)) if flutes else np.ones_like(turn)
    )
    reach = radius[:, None] * profile[None, :]
    position = (
        line[:, None]
        + (reach * np.cos(turn))[..., None] * side[:, None]
        + (reach * np.sin(turn))[..., None] * other[:, None]
    )
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    around = 2 * np.pi * radius.max() / texture_m[0]
    copies = max(1, round(around))
    u, v = np.meshgrid(turn / (2 * np.pi) * copies, along / texture_m[1])
    mesh = surface(position, np.stack([u, v], -1), closed=True)
    return _facing(mesh, (position - line[:, None]).reshape(-1, 3))


def lathe(profile: ArrayLike, texture_m: float, *, sides: int = 24) -> Mesh:
    """A body turned about the vertical; `profile` (N, 2) is (radius, height)."""
    outline = np.asarray(profile, np.float64)
    turn = np.linspace(0, 2 * np.pi, sides + 1)
    radius, height = outline[:, 0, None], outline[:, 1, None]
    position = np.stack(
        [radius * np.cos(turn), np.broadcast_to(height, (len(outline), sides + 1)),
         radius * np.sin(turn)], axis=-1,
    )  # fmt: skip
    along = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(outline, axis=0).T))])
    copies = max(1, round(2 * np.pi * outline[:, 0].max() / texture_m))
    u, v = np.meshgrid(turn / (2 * np.pi) * copies, along / texture_m)
    mesh = surface(position, np.stack([u, v], -1), closed=True)
    middle = np.stack([np.zeros(1), [outline[:, 1].mean()], np.zeros(1)], -1)
    return _facing(mesh, mesh.position_m - middle)


def boulder(rng: np.random.Generator, radius_m: float, texture_m: float) -> Mesh:
    """A rounded rock, flattened a little."""
    rows, columns = 14, 22
    polar = np.linspace(0, np.pi, rows)[:, None]
    turn = np.linspace(0, 2 * np.pi, columns + 1)[None, :]
    unit = np.stack(
        [np.sin(polar) * np.cos(turn), np.cos(polar) + 0 * turn, np.sin(polar) * np.sin(turn)], -1
    )
    lumps = np.zeros(unit.shape[:2])
    for scale in (1.0, 2.0, 4.0):
        for _ in range(5):
            way, phase = rng.normal(size=3), rng.uniform(0, 2 * np.pi)
            lumps += np.sin(scale * (unit @ way) * 1.4 + phase) / scale / 5
    position = unit * (radius_m * (1 + 0.25 * lumps))[..., None] * (1.0, 0.72, 1.0)
    copies = max(1, round(2 * np.pi * radius_m / texture_m))
    uv = np.stack(
        [copies * turn / (2 * np.pi) + 0 * polar, polar / np.pi * max(1, copies // 2) + 0 * turn],
        -1,
    )
    return _facing(surface(position, uv, closed=True), unit.reshape(-1, 3))


def _facing(mesh: Mesh, outward: NDArray[np.float64]) -> Mesh:
    """The mesh with all of its normals outwards."""
    flip = np.sum(mesh.normal * outward, axis=1, keepdims=True) < 0
    return replace(mesh, normal=np.where(flip, -mesh.normal, mesh.normal))


def card(
    foot: ArrayLike, width_m: float, height_m: float, turn_deg: float, *, lean: float = 0.0
) -> Mesh:
    """An upright picture that stands at `foot`, all of its texture on it; lit like the ground."""
    sine, cosine = np.sin(np.radians(turn_deg)), np.cos(np.radians(turn_deg))
    across = np.array([cosine, 0.0, -sine]) * width_m / 2
    up = np.array([lean * sine, 1.0, lean * cosine]) * height_m
    base = np.asarray(foot, np.float64)
    position = np.array([[base - across, base + across], [base - across + up, base + across + up]])
    return surface(position, WHOLE_TEXTURE, normal=(0.0, 1.0, 0.0))


def crown(
    rng: np.random.Generator,
    centre: ArrayLike,
    radius_m: tuple[float, float, float],
    cards: int,
    card_m: float,
    *,
    shell: float = 0.55,
) -> Mesh:
    """Leaf cards that fill an ellipsoid, denser outside; normals point away from its middle."""
    drawn = [
        (rng.normal(size=3), rng.uniform(shell, 1.0), rng.normal(size=3), rng.normal(size=3),
         rng.uniform(0.75, 1.25), rng.uniform(0.75, 1.15))
        for _ in range(cards)
    ]  # fmt: skip
    way, out, a, b, wide, tone = (np.array(column) for column in zip(*drawn, strict=True))
    way = _unit(way)
    place = np.asarray(centre, np.float64) + way * np.asarray(radius_m) * out[:, None] ** 0.7
    a = _unit(a - 0.35 * way * np.sum(a * way, axis=1, keepdims=True))
    b = _unit(_crossed(a, b))
    half = (card_m * wide / 2)[:, None]
    a, b = half * a, half * b
    corners = np.stack([place - a - b, place + a - b, place - a + b, place + a + b], axis=1)
    bent = (way * 0.75 + np.array([0, 0.45, 0])).astype(np.float32)
    bent /= np.linalg.norm(bent, axis=1, keepdims=True)
    starts = np.arange(0, 4 * cards, 4, dtype=np.uint32)
    return Mesh(
        corners.reshape(-1, 3).astype(np.float32),
        np.repeat(bent, 4, axis=0),
        np.tile(WHOLE_TEXTURE.reshape(4, 2), (cards, 1)).astype(np.float32),
        np.repeat(tone, 12).reshape(-1, 3).astype(np.float32),
        (starts[:, None, None] + _grid_triangles(2, 2)).reshape(-1, 3),
    )


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def branch_path(
    rng: np.random.Generator, start: ArrayLike, direction: ArrayLike, length_m: float,
    *, points: int = 9, wander: float = 0.12, droop: float = 0.0,
) -> NDArray[np.float64]:  # fmt: skip
    """A crooked line for a trunk or branch."""
    heading = np.asarray(direction, np.float64)
    heading = heading / np.linalg.norm(heading)
    step = length_m / (points - 1)
    line = [np.asarray(start, np.float64)]
    for _ in range(points - 1):
        heading = heading + wander * rng.normal(size=3) + np.array([0.0, -droop, 0.0])
        heading /= np.linalg.norm(heading)
        line.append(line[-1] + step * heading)
    return np.array(line)


BRANCHES = 9


@dataclass(frozen=True, eq=False)
class Foliage:
    """Materials of what grows here."""

    bark: Material
    leaf: Material
    tuft: Material

    @classmethod
    def grow(cls, rng: np.random.Generator, **leaf_options: Any) -> Foliage:
        """Make bark, leaves and tufts."""
        return cls(
            Material(textures.bark(rng)),
            Material(textures.leaves(rng, **leaf_options), cutout=True, translucency=0.6),
            Material(textures.blades(rng), cutout=True, translucency=0.6),
        )


def tree(
    rng: np.random.Generator,
    foliage: Foliage,
    foot: ArrayLike,
    height_m: float,
    *,
    trunk_m: float | None = None,
    crown_share: float = 0.6,
    cards: int = 150,
    card_m: float | None = None,
) -> list[MeshPart]:
    """A broad-leaved tree; `trunk_m` is the radius at its foot."""
    base = np.asarray(foot, np.float64)
    radius = trunk_m or 0.028 * height_m
    stem = branch_path(rng, base - [0, 0.2, 0], (0, 1, 0), 0.8 * height_m, wander=0.05)
    taper = np.linspace(1.0, 0.28, len(stem))
    taper[0] = 1.5
    wood = [tube(stem, radius * taper, (0.7, 1.4), sides=14)]
    spread = 0.32 * height_m
    middle = stem[-1] + (0, -0.06 * height_m, 0)
    for index in range(BRANCHES):
        share = rng.uniform(1 - crown_share, 0.95)
        start = stem[int(share * (len(stem) - 1))]
        turn = 2 * np.pi * (index + rng.uniform(-0.3, 0.3)) / BRANCHES
        way = (np.cos(turn), rng.uniform(0.35, 0.9), np.sin(turn))
        length = spread * rng.uniform(0.8, 1.2)
        path = branch_path(rng, start, way, length, wander=0.16)
        thick = radius * 0.42 * (1.1 - 0.6 * share)
        wood.append(tube(path, np.linspace(thick, 0.15 * thick, len(path)), (0.5, 1.0), sides=7))
    size = card_m or 0.16 * height_m
    leaves = crown(rng, middle, (spread, 0.5 * crown_share * height_m, spread), cards, size)
    return [MeshPart(Mesh.joined(wood), foliage.bark), MeshPart(leaves, foliage.leaf)]


def bush(
    rng: np.random.Generator, foliage: Foliage, foot: ArrayLike, radius_m: float, *, cards: int = 70
) -> list[MeshPart]:
    """A round bush that sits on the ground."""
    centre = np.add(foot, (0, 0.7 * radius_m, 0))
    leaves = crown(
        rng, centre, (radius_m, 0.75 * radius_m, radius_m), cards, 0.7 * radius_m, shell=0.3
    )
    return [MeshPart(leaves, foliage.leaf)]


def tufts(
    rng: np.random.Generator,
    material: Material,
    places: ArrayLike,
    height_m: tuple[float, float],
) -> MeshPart:
    """Tufts at `places` (N, 3), each of two crossed cards."""
    cards = []
    for place in np.asarray(places, np.float64):
        height = rng.uniform(*height_m)
        turn = rng.uniform(0, 180)
        tone = rng.uniform(0.8, 1.15)
        for index in range(2):
            lean = rng.normal(0, 0.08)
            made = card(place, height, height, turn + 90 * index, lean=lean)
            cards.append(made.tinted((tone, tone, tone)))
    return MeshPart(Mesh.joined(cards), material)


def scattered(
    rng: np.random.Generator, count: int, low: ArrayLike, high: ArrayLike
) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Places on flat ground between the corners `low` and `high` in (x, z)."""
    xz = rng.uniform(np.asarray(low, np.float64), np.asarray(high, np.float64), (count, 2))
    return np.stack([xz[:, 0], np.zeros(count), xz[:, 1]], axis=-1)
