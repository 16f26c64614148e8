"""A castle on a rise: round towers and battlements, seen past pines and a parapet."""

from __future__ import annotations

import numpy as np

from stimuli.rendering.world import Light, Material, Mesh, MeshPart, Viewpoint, World
from stimuli.scenes import shapes, textures

GREY = [(148, 140, 126), (166, 156, 138), (132, 126, 116), (178, 168, 148)]


def build(rng: np.random.Generator) -> World:
    """Return the scene."""
    blocks = Material(textures.masonry(rng, 12, 7, GREY, (124, 116, 104), rough=1.4, joint=0.04))
    foliage = shapes.Foliage.grow(
        rng, count=260, length_px=(60, 110), slender=0.2,
        colours=[(34, 56, 30), (48, 72, 36), (62, 86, 44), (78, 98, 54)],
    )  # fmt: skip
    parts = [
        MeshPart(
            shapes.ground((-60, -80), (60, 2), 0.9, 2.6, _hill),
            Material(textures.lawn(rng, dry=0.3)),
        ),
        MeshPart(_road(), Material(textures.pebbles(rng))),
    ]
    parts += _castle(rng, blocks)
    parts += _parapet(blocks)
    for x, z, height in ((-3.9, -7.0, 8.5), (4.4, -8.5, 9.5), (-8.5, -14.0, 9.0),
                         (9.5, -15.0, 8.5), (13.5, -20.0, 9.0), (-13.0, -20.0, 9.5)):  # fmt: skip
        parts += _pine(rng, foliage, (x, float(_hill(np.array(x), np.array(z))), z), height)
    rock = Material(textures.stone(rng, (138, 132, 122)))
    rocks = []
    for _ in range(16):
        x, z = rng.uniform(-10, 10), rng.uniform(-18, -5)
        if abs(x - 0.5) > 1.6:
            radius = rng.uniform(0.2, 0.6)
            height = float(_hill(np.array(x), np.array(z)))
            rocks.append(shapes.boulder(rng, radius, 1.2).moved(x, height + 0.1 * radius, z))
    parts.append(MeshPart(Mesh.joined(rocks), rock))
    places = shapes.scattered(rng, 150, (-9, -16), (9, -3.2))
    places = places[np.abs(places[:, 0] - 0.6) > 1.5]
    places[:, 1] = _hill(places[:, 0], places[:, 2]) - 0.02
    parts.append(shapes.tufts(rng, foliage.tuft, places, (0.25, 0.6)))
    return World(
        tuple(parts),
        Viewpoint((0.0, 1.75, 0.5), (0.3, 2.75, -10.0), 46.0),
        Light(
            (0.7, 0.55, 0.45), sun=(2.5, 2.05, 1.5), haze=(0.77, 0.82, 0.88), haze_m=110.0,
            exposure=1.05,
        ),
        textures.panorama(rng, zenith=(70, 118, 184), cover=0.5),
    )  # fmt: skip


def _hill(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    rise = 1.9 / (1 + np.exp((z + 15.0) / 2.6))
    return np.asarray(rise + 0.15 * np.sin(0.35 * x) * np.cos(0.3 * z) - 0.05)


def _road() -> Mesh:
    t = np.linspace(0, 1, 70)[:, None]
    z = 0.5 - 23.0 * t
    side = np.linspace(-1.0, 1.0, 7)[None, :]
    x = 0.6 + 1.1 * np.sin(2.6 * t) * t + side * (1 - 0.25 * t)
    y = _hill(x, z + 0 * x) + 0.05 - 0.07 * side**2
    position = np.stack([x, y, np.broadcast_to(z, x.shape)], -1)
    return shapes.surface(position, np.stack([x, np.broadcast_to(z, x.shape)], -1) / 1.3)


def _castle(rng: np.random.Generator, blocks: Material) -> list[MeshPart]:
    z, base = -24.0, 1.5
    roof = Material(textures.roof_tiles(rng))
    dark = Material(textures.plaster(rng, (34, 30, 28)))
    bodies, roofs, slits = [], [], []
    bodies += _wall_with_gate(z, base, 5.2)
    for x in np.arange(-14.4, 15.0, 1.2):
        bodies.append(shapes.box((x, base + 5.55, z), (0.7, 0.7, 0.5), 3.2, offset=(x, 0)))
    for x, radius, height, pointed in ((-9.0, 2.2, 8.2, True), (-2.6, 1.5, 7.0, False),
                                       (3.6, 1.5, 7.0, False), (10.0, 2.4, 8.8, True)):  # fmt: skip
        y = np.linspace(0, height, 18)
        flare = radius * (1.05 - 0.05 * y / height)
        flare = flare + np.where(y > height - 0.9, 0.22, 0)
        tower = shapes.lathe(np.stack([flare, y], -1), 3.2, sides=40)
        bodies.append(tower.moved(x, base - 0.5, z + 0.6))
        top = base - 0.5 + height
        if pointed:
            cone = [(radius + 0.55, top - 0.05), (0.5 * radius, top + 1.9), (0.02, top + 3.4)]
            roofs.append(shapes.lathe(cone, 2.4, sides=40).moved(x, 0, z + 0.6))
        else:
            for index in range(9):
                turn = 2 * np.pi * index / 9
                bodies.append(
                    shapes.box(
                        (x + (radius + 0.08) * np.cos(turn), top + 0.3,
                         z + 0.6 + (radius + 0.08) * np.sin(turn)),
                        (0.3, 0.62, 0.62), 3.2, turn_deg=-float(np.degrees(turn)),
                        offset=(turn, 0),
                    )
                )  # fmt: skip
        slits += [
            shapes.box((x, base + level * height, z + 0.6 + radius * 1.0), (0.22, 0.9, 0.2), 1.0)
            for level in (0.42, 0.72)
        ]
    keep = shapes.box((1.5, base + 5, z - 8), (8.5, 10.5, 6), 3.2)
    bodies.append(keep)
    for x in np.arange(-2.4, 6.0, 1.2):
        bodies.append(shapes.box((x, base + 10.6, z - 5.2), (0.7, 0.8, 0.5), 3.2, offset=(x, 0)))
    slits += [shapes.box((x, base + 8.0, z - 4.98), (0.5, 1.1, 0.1), 1.0) for x in (-0.5, 1.5, 3.5)]
    return [
        MeshPart(Mesh.joined(bodies), blocks),
        MeshPart(Mesh.joined(roofs), roof),
        MeshPart(Mesh.joined(slits), dark),
    ]


def _wall_with_gate(z: float, base: float, height: float) -> list[Mesh]:
    gate, half, spring = 0.5, 1.2, 1.7
    walls = [
        shapes.wall((-16, z), (gate - half, z), base - 1, base + height, 3.2),
        shapes.wall((gate + half, z), (16, z), base - 1, base + height, 3.2),
    ]
    turn = np.linspace(np.pi, 0, 21)
    arch = np.stack([gate + half * np.cos(turn), base + spring + half * np.sin(turn)], -1)
    rows = np.linspace(0, 1, 8)[:, None]
    y = arch[:, 1] + rows * (base + height - arch[:, 1])
    x = np.broadcast_to(arch[:, 0], y.shape)
    position = np.stack([x, y, np.full_like(y, z)], -1)
    walls.append(shapes.surface(position, np.stack([x, y], -1) / 3.2))
    depth = np.linspace(0, 2.5, 6)[:, None]
    outline = np.concatenate([[[gate - half, base - 1]], arch, [[gate + half, base - 1]]])
    inside = np.stack(
        [np.broadcast_to(outline[:, 0], (6, len(outline))),
         np.broadcast_to(outline[:, 1], (6, len(outline))),
         np.broadcast_to(z - depth, (6, len(outline)))], -1,
    )  # fmt: skip
    along = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(outline, axis=0).T))])
    uv = np.stack(np.broadcast_arrays(along[None, :], depth), -1) / 3.2
    walls.append(shapes.surface(inside, uv))
    return walls


def _parapet(blocks: Material) -> list[MeshPart]:
    """The low wall of the bridge one stands on."""
    pieces = []
    for side in (-1.75, 2.05):
        for index in range(4):
            z = -2.6 - 1.15 * index
            pieces.append(
                shapes.box((side, 0.42, z), (0.34, 1.0, 0.62), 2.4, step_m=0.2, offset=(z, 0.1))
            )
        pieces.append(shapes.box((side, 0.1, -4.3), (0.32, 0.5, 4.6), 2.4, step_m=0.3))
    return [MeshPart(Mesh.joined(pieces), blocks)]


def _pine(
    rng: np.random.Generator,
    foliage: shapes.Foliage,
    foot: tuple[float, float, float],
    height: float,
) -> list[MeshPart]:
    base = np.asarray(foot)
    stem = shapes.branch_path(rng, base - [0, 0.3, 0], (0, 1, 0), height, wander=0.02, points=14)
    radius = 0.022 * height * np.linspace(1.25, 0.2, len(stem))
    wood = [shapes.tube(stem, radius, (0.6, 1.2), sides=12)]
    crowns = []
    for level in np.linspace(0.36, 0.97, 9):
        place = stem[int(level * (len(stem) - 1))]
        reach = 0.24 * height * (1.12 - level) + 0.15
        for index in range(5):
            turn = 2 * np.pi * (index + rng.uniform(-0.35, 0.35)) / 5
            way = (np.cos(turn), 0.12, np.sin(turn))
            path = shapes.branch_path(rng, place, way, reach, points=5, wander=0.06, droop=0.03)
            wood.append(shapes.tube(path, np.linspace(0.05, 0.012, 5), (0.3, 0.8), sides=6))
            crowns.append(
                shapes.crown(rng, path[3], (0.5 * reach, 0.22, 0.5 * reach), 5, 0.85, shell=0.2)
            )
    return [MeshPart(Mesh.joined(wood), foliage.bark), MeshPart(Mesh.joined(crowns), foliage.leaf)]
