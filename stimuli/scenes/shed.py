"""A yard: a wooden shed with a tiled roof, barrels, a ladder, and a rope fence in front."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from stimuli.rendering.world import Light, Material, Mesh, MeshPart, Viewpoint, World
from stimuli.scenes import shapes, textures

FIELD_STONE = [(128, 120, 108), (150, 140, 124), (110, 104, 96), (162, 152, 134)]


def build(rng: np.random.Generator) -> World:
    """Return the scene."""
    foliage = shapes.Foliage.grow(rng)
    boards = Material(textures.planks(rng, 7, (122, 92, 64)))
    beams = Material(textures.planks(rng, 3, (92, 70, 50)))
    parts = [
        MeshPart(shapes.ground((-14, -14), (14, 3), 0.3, 1.5), Material(textures.pebbles(rng))),
        MeshPart(
            shapes.ground((-60, -70), (60, -11.0), 1.5, 2.4, _meadow),
            Material(textures.lawn(rng, dry=0.15)),
        ),
        MeshPart(
            Mesh.joined([shapes.box((x, 0.45, -11.2), (9, 1.0, 0.6), 1.9) for x in (-9.5, 9.6)]),
            Material(textures.masonry(rng, 8, 5, FIELD_STONE, (104, 98, 88), rough=2.0)),
        ),
    ]
    parts += _shed(rng, boards, beams)
    parts += _barrels(rng)
    parts += _ladder(beams)
    parts += _rope_fence(rng, beams)
    for x, z, height in ((-7.2, -12.5, 7.5), (8.2, -13.5, 8.5), (3.0, -24, 12.0), (-13, -26, 13.0),
                         (16, -30, 14.0), (-4, -32, 13.0)):  # fmt: skip
        parts += shapes.tree(rng, foliage, (x, 0, z), height, cards=160)
    weeds = shapes.scattered(rng, 60, (-6.5, -9.5), (6.5, -4.5))
    weeds = weeds[(np.abs(weeds[:, 0] - 0.6) > 2.6) | (weeds[:, 2] > -5.2)]
    parts.append(shapes.tufts(rng, foliage.tuft, weeds, (0.18, 0.45)))
    near = shapes.scattered(rng, 14, (-3, -3.3), (3, -2.6))
    parts.append(shapes.tufts(rng, foliage.tuft, near, (0.25, 0.5)))
    return World(
        tuple(parts),
        Viewpoint((-0.4, 1.55, 0.3), (0.2, 1.35, -6.0), 44.0),
        Light((-0.62, 0.62, 0.55), sun=(2.4, 2.05, 1.6), haze_m=140.0, exposure=1.1),
        textures.panorama(rng, cover=0.55),
    )


def _meadow(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.asarray(0.045 * (-11.0 - z) + 0.5 * np.sin(0.11 * x) * np.clip((-11 - z) / 30, 0, 1))


def _shed(rng: np.random.Generator, boards: Material, beams: Material) -> list[MeshPart]:
    x0, x1, front, back, eaves = -1.9, 3.1, -6.4, -9.4, 2.35
    walls = [
        shapes.wall((x0, front), (x1, front), 0, eaves, 1.5),
        shapes.wall((x0, back), (x0, front), 0, eaves, 1.5),
        shapes.wall((x1, front), (x1, back), 0, eaves, 1.5),
    ]
    posts = [
        shapes.box((x, eaves / 2, front + 0.03), (0.16, eaves, 0.14), 1.4, offset=(x, 0.2))
        for x in (x0, x1)
    ]
    posts.append(shapes.box(((x0 + x1) / 2, eaves, front + 0.04), (x1 - x0 + 0.2, 0.16, 0.14), 1.4))
    door = shapes.wall((1.2, front + 0.05), (2.3, front + 0.05), 0.02, 2.02, 0.9)
    bars = [
        shapes.box((1.75, y, front + 0.07), (1.0, 0.06, 0.03), 1.2, offset=(0.2, y))
        for y in (0.4, 1.6)
    ]
    frame = [
        shapes.box((x, 1.42, front + 0.06), (0.08, 1.0, 0.1), 1.2) for x in (-1.15, -0.6, -0.05)
    ] + [shapes.box((-0.6, y, front + 0.06), (1.2, 0.08, 0.1), 1.2) for y in (0.92, 1.42, 1.92)]
    pane = Material(textures.plaster(rng, (46, 52, 58)))
    glass = shapes.wall((-1.15, front + 0.03), (-0.05, front + 0.03), 0.95, 1.9, 2.5)
    ridge, over = 3.75, 0.45
    middle = (front + back) / 2
    slope = np.array(
        [[[x0 - over, eaves - 0.2, front + over], [x1 + over, eaves - 0.2, front + over]],
         [[x0 - over, ridge, middle], [x1 + over, ridge, middle]]]
    )  # fmt: skip
    t, s = np.meshgrid(np.linspace(0, 1, 16), np.linspace(0, 1, 8))
    low = slope[0, 0] * (1 - t[..., None]) + slope[0, 1] * t[..., None]
    high = slope[1, 0] * (1 - t[..., None]) + slope[1, 1] * t[..., None]
    position = low * (1 - s[..., None]) + high * s[..., None]
    length = float(np.linalg.norm(slope[1, 0] - slope[0, 0]))
    roof = shapes.surface(position, np.stack([t * (x1 - x0 + 0.9), -s * length], -1) / 2.2)
    gutter = shapes.tube(
        [(x, eaves - 0.26, front + over + 0.03) for x in np.linspace(x0 - over, x1 + over, 12)],
        0.055, (0.5, 1.0), sides=10,
    )  # fmt: skip
    metal = Material(textures.iron(rng))
    return [
        MeshPart(Mesh.joined(walls), boards),
        MeshPart(Mesh.joined([*posts, *frame]), beams),
        MeshPart(Mesh.joined(bars).tinted((2.0, 1.9, 1.8)), metal),
        MeshPart(door.tinted((0.8, 0.9, 0.85)), boards),
        MeshPart(glass, pane),
        MeshPart(roof, Material(textures.roof_tiles(rng))),
        MeshPart(gutter, metal),
    ]


def _barrels(rng: np.random.Generator) -> list[MeshPart]:
    staves = Material(textures.planks(rng, 8, (134, 96, 60)))
    metal = Material(textures.iron(rng))
    y = np.linspace(0, 0.92, 15)
    radius = 0.29 + 0.075 * np.sin(np.pi * y / 0.92)
    profile = [(0.0, 0.0), *zip(radius, y, strict=True), (0.27, 0.9), (0.0, 0.9)]
    parts = []
    for x, z in ((-2.6, -5.6), (-3.3, -6.1), (-1.0, -3.4), (3.9, -5.7)):
        parts.append(MeshPart(shapes.lathe(profile, 0.55).moved(x, 0, z), staves))
        for height in (0.1, 0.26, 0.66, 0.82):
            r = 0.29 + 0.075 * np.sin(np.pi * height / 0.92) + 0.006
            ring = shapes.lathe([(r, height - 0.02), (r, height + 0.02)], 0.4, sides=32)
            parts.append(MeshPart(ring.moved(x, 0, z), metal))
    stack = Material(textures.bark(rng, (112, 86, 62)))
    ends = []
    for row in range(4):
        for index in range(7 - row):
            x = 4.2 + 0.26 * index + 0.13 * row
            line = [
                (x, 0.13 + 0.225 * row, z) for z in (-8.6, -8.0, -7.4 + rng.uniform(-0.06, 0.06))
            ]
            ends.append(shapes.tube(line, 0.125, (0.6, 1.2), sides=10))
    parts.append(MeshPart(Mesh.joined(ends), stack))
    return parts


def _ladder(beams: Material) -> list[MeshPart]:
    foot, top = np.array([0.35, 0.0, -5.3]), np.array([0.35, 2.9, -6.0])
    rails = [
        shapes.tube(np.add(np.linspace(foot, top, 8), (dx, 0, 0)), 0.035, (0.4, 1.2), sides=8)
        for dx in (-0.22, 0.22)
    ]
    rungs = []
    for share in np.linspace(0.1, 0.93, 9):
        middle = foot + share * (top - foot)
        rungs.append(
            shapes.tube(
                [np.add(middle, (dx, 0, 0)) for dx in (-0.22, 0, 0.22)], 0.022, (0.3, 0.8), sides=7
            )
        )
    return [MeshPart(Mesh.joined(rails + rungs), beams)]


def _rope_fence(rng: np.random.Generator, beams: Material) -> list[MeshPart]:
    posts, ropes = [], []
    xs = np.array([-3.4, -1.95, -0.35, 1.2, 2.7])
    z = -2.75
    for x in xs:
        lean = rng.normal(0, 0.02)
        posts.append(
            shapes.tube([(x, -0.1, z), (x + lean, 0.5, z), (x + 2 * lean, 1.02, z)],
                        [0.06, 0.055, 0.05], (0.5, 1.3), sides=10)
        )  # fmt: skip
    for x0, x1 in pairwise(xs):
        for height in (0.45, 0.88):
            t = np.linspace(0, 1, 12)
            sag = height - 0.1 * 4 * t * (1 - t)
            line = np.stack([x0 + t * (x1 - x0), sag, np.full(12, z)], -1)
            ropes.append(shapes.tube(line, 0.014, (0.1, 0.25), sides=6))
    cord = Material(textures.bark(rng, (170, 146, 108)))
    return [MeshPart(Mesh.joined(posts), beams), MeshPart(Mesh.joined(ropes), cord)]
