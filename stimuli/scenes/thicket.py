"""A thicket: twigs and leaves close to the eye, trunks behind, and the forest floor."""

from __future__ import annotations

import numpy as np

from stimuli.rendering.world import Light, Material, Mesh, MeshPart, Viewpoint, World
from stimuli.scenes import shapes, textures


def build(rng: np.random.Generator) -> World:
    """Return the scene."""
    foliage = shapes.Foliage.grow(rng)
    sprays = Material(
        textures.leaves(rng, 26, (150, 240), [(92, 122, 40), (116, 142, 54), (140, 156, 70)]),
        cutout=True, translucency=0.7,
    )  # fmt: skip
    ferns = Material(
        textures.blades(rng, 70, [(58, 90, 34), (82, 116, 44), (104, 132, 56)]),
        cutout=True, translucency=0.6,
    )  # fmt: skip
    parts = [
        MeshPart(
            shapes.ground((-30, -44), (30, 3), 0.45, 2.0, _floor), Material(textures.earth(rng))
        ),
    ]
    parts += _trunks(rng, foliage)
    parts += _twigs(rng, foliage.bark, sprays)
    parts += _fallen(rng, foliage.bark)
    rock = Material(textures.stone(rng, (122, 122, 108)))
    rocks = []
    for _ in range(10):
        x, z, radius = rng.uniform(-7, 7), rng.uniform(-15, -5), rng.uniform(0.2, 0.65)
        height = float(_floor(np.array(x), np.array(z)))
        rocks.append(shapes.boulder(rng, radius, 1.1).moved(x, height + 0.15 * radius, z))
    parts.append(MeshPart(Mesh.joined(rocks), rock))
    places = shapes.scattered(rng, 170, (-9, -20), (9, -3.4))
    places[:, 1] = _floor(places[:, 0], places[:, 2]) - 0.03
    parts.append(shapes.tufts(rng, ferns, places, (0.3, 0.8)))
    for _ in range(26):
        x, z = rng.uniform(-16, 16), rng.uniform(-34, -13)
        height = float(_floor(np.array(x), np.array(z)))
        parts += shapes.bush(rng, foliage, (x, height, z), rng.uniform(0.7, 1.7), cards=40)
    return World(
        tuple(parts),
        Viewpoint((0.0, 1.5, 0.6), (0.1, 1.45, -6.0), 46.0),
        Light(
            (0.45, 0.8, -0.28), sun=(2.9, 2.5, 1.8), sky=(0.7, 0.86, 0.78), ground=(0.3, 0.3, 0.2),
            haze=(0.74, 0.82, 0.78), haze_m=38.0, exposure=1.35,
        ),
        textures.panorama(rng, (150, 182, 190), (206, 220, 206), cover=0.7),
    )  # fmt: skip


def _floor(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    bumps = 0.12 * np.sin(0.8 * x + 0.3 * z) + 0.1 * np.sin(0.5 * z - 0.4 * x + 1.0)
    return np.asarray(bumps + 0.045 * np.clip(-z - 6, 0, None))


def _trunks(rng: np.random.Generator, foliage: shapes.Foliage) -> list[MeshPart]:
    parts: list[MeshPart] = []
    near = ((-1.9, -5.2, 0.15), (2.1, -6.2, 0.19), (0.75, -8.6, 0.13), (-3.6, -9.0, 0.22),
            (4.3, -10.0, 0.2), (-0.9, -11.5, 0.16))  # fmt: skip
    wood, crowns = [], []
    far = [(rng.uniform(-18, 18), rng.uniform(-38, -13), rng.uniform(0.12, 0.3)) for _ in range(46)]
    for x, z, radius in (*near, *far):
        height = rng.uniform(7, 11)
        foot = np.array([x, float(_floor(np.array(x), np.array(z))) - 0.2, z])
        stem = shapes.branch_path(rng, foot, (rng.normal(0, 0.05), 1, rng.normal(0, 0.05)), height,
                                  points=14, wander=0.035)  # fmt: skip
        taper = np.linspace(1.0, 0.4, len(stem))
        taper[0] = 1.7
        wood.append(shapes.tube(stem, radius * taper, (0.7, 1.4), sides=14))
        for _ in range(5):
            start = stem[rng.integers(4, 12)]
            way = (rng.normal(), rng.uniform(0.2, 0.8), rng.normal())
            path = shapes.branch_path(rng, start, way, rng.uniform(1.0, 2.4), wander=0.18)
            wood.append(shapes.tube(path, np.linspace(0.3 * radius, 0.012, len(path)), (0.4, 0.9),
                                    sides=7))  # fmt: skip
            crowns.append(shapes.crown(rng, path[-2], (0.9, 0.6, 0.9), 9, 0.95, shell=0.2))
    parts.append(MeshPart(Mesh.joined(wood), foliage.bark))
    parts.append(MeshPart(Mesh.joined(crowns), foliage.leaf))
    return parts


def _twigs(rng: np.random.Generator, bark: Material, sprays: Material) -> list[MeshPart]:
    """Thin branches that cross the picture near the eye."""
    wood, leaves = [], []
    starts = [
        ((-2.6, 0.1, -3.2), (0.35, 1, 0.0)),
        ((2.3, 0.0, -3.0), (-0.3, 1, 0.05)),
        ((-0.7, 0.0, -3.6), (0.12, 1, -0.02)),
        ((1.0, -0.1, -4.2), (0.1, 1, 0.05)),
        ((-2.4, 2.7, -2.8), (1, -0.22, 0.0)),
        ((2.5, 2.4, -3.3), (-1, 0.02, 0.1)),
    ]
    for start, way in starts:
        stem = shapes.branch_path(rng, start, way, 3.4, points=16, wander=0.09)
        wood.append(shapes.tube(stem, np.linspace(0.04, 0.014, 16), (0.3, 0.7), sides=9))
        for index in range(3, 15):
            side = rng.normal(size=3) * (1, 0.8, 0.45)
            twig = shapes.branch_path(rng, stem[index], side, rng.uniform(0.35, 0.8), points=7,
                                      wander=0.2, droop=0.05)  # fmt: skip
            wood.append(shapes.tube(twig, np.linspace(0.012, 0.004, 7), (0.2, 0.4), sides=6))
            leaves += [
                shapes.crown(rng, point, (0.06, 0.06, 0.06), 1, 0.34, shell=0.1)
                for point in twig[3::3]
            ]
    return [MeshPart(Mesh.joined(wood), bark), MeshPart(Mesh.joined(leaves), sprays)]


def _fallen(rng: np.random.Generator, bark: Material) -> list[MeshPart]:
    """A trunk on the ground, with stubs."""
    line = np.stack(
        [np.linspace(-3.4, 2.2, 14), 0.3 + 0.04 * np.sin(np.linspace(0, 5, 14)),
         np.linspace(-5.2, -7.6, 14)], -1,
    )  # fmt: skip
    body = [shapes.tube(line, np.linspace(0.3, 0.2, 14), (0.8, 1.5), sides=18)]
    for index in (3, 6, 10):
        way = (rng.normal(0, 0.4), 1, rng.normal(0, 0.4))
        path = shapes.branch_path(rng, line[index], way, 0.7, points=6)
        body.append(shapes.tube(path, np.linspace(0.06, 0.03, 6), (0.4, 0.8), sides=8))
    return [MeshPart(Mesh.joined(body), bark)]
