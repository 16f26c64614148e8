"""A garden: picket fence and flowers before a lawn, a path, trees, and an old brick wall."""

from __future__ import annotations

import numpy as np

from stimuli.rendering.world import Light, Material, Mesh, MeshPart, Viewpoint, World
from stimuli.scenes import shapes, textures

RED_BRICK = [(128, 70, 52), (150, 84, 60), (164, 102, 74), (138, 78, 64)]


def build(rng: np.random.Generator) -> World:
    """Return the scene."""
    foliage = shapes.Foliage.grow(rng)
    light_leaf = Material(
        textures.leaves(rng, 150, (60, 110), [(96, 122, 44), (122, 142, 60), (142, 152, 76)]),
        cutout=True, translucency=0.6,
    )  # fmt: skip
    hedge = shapes.Foliage(foliage.bark, light_leaf, foliage.tuft)
    parts = [
        MeshPart(
            shapes.ground((-22, -30), (22, 4), 0.3, 2.2, _rolling), Material(textures.lawn(rng))
        ),
        MeshPart(_path(), Material(textures.pebbles(rng))),
        MeshPart(
            shapes.wall((-22, -15), (22, -15), -0.3, 2.6, 2.4),
            Material(textures.masonry(rng, 16, 6, RED_BRICK)),
        ),
        MeshPart(shapes.box((0, 2.68, -15), (44, 0.16, 0.55), 1.6), Material(textures.stone(rng))),
    ]
    parts += _fence(rng)
    for x, z, height in ((-6.0, -12.5, 6.5), (5.6, -11.5, 5.6), (-1.6, -19.0, 9.5),
                         (9.5, -20.0, 10.0), (-11.0, -21.0, 11.0), (3.8, -24.0, 11.0)):  # fmt: skip
        parts += shapes.tree(rng, foliage, (x, 0, z), height, cards=170)
    for x, z, radius in ((-3.6, -14.0, 0.95), (-2.0, -14.2, 0.7), (1.4, -14.0, 0.9),
                         (2.9, -14.2, 0.75), (7.6, -13.6, 1.1), (-8.6, -13.8, 1.2)):  # fmt: skip
        parts += shapes.bush(rng, hedge, (x, 0, z), radius)
    for colour, count in (((226, 222, 214), 20), ((214, 92, 110), 16), ((232, 186, 60), 14)):
        flowers = Material(textures.blades(rng, 34, heads=colour), cutout=True, translucency=0.5)
        bed = shapes.scattered(rng, count, (-5.0, -5.6), (5.0, -4.5))
        bed = bed[np.abs(bed[:, 0] - 0.9) > 0.8]
        parts.append(shapes.tufts(rng, flowers, bed, (0.45, 0.85)))
    verge = shapes.scattered(rng, 130, (-8, -13.0), (8, -5.0))
    verge = verge[np.abs(verge[:, 0] - 0.9) > 0.9]
    parts.append(shapes.tufts(rng, foliage.tuft, verge, (0.15, 0.32)))
    near = shapes.scattered(rng, 26, (-3.4, -3.4), (3.4, -2.9))
    parts.append(shapes.tufts(rng, foliage.tuft, near, (0.3, 0.6)))
    return World(
        tuple(parts),
        Viewpoint((0.0, 1.45, 0.0), (0.25, 1.02, -6.0), 42.0),
        Light((0.55, 0.75, 0.42), haze=(0.78, 0.83, 0.88), haze_m=170.0, exposure=1.15),
        textures.panorama(rng),
    )


def _rolling(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.asarray(0.06 * np.sin(0.6 * x + 0.4) * np.cos(0.5 * z) - 0.03)


def _path() -> Mesh:
    t = np.linspace(0, 1, 40)[:, None]
    z = 1.0 - 15.6 * t
    middle = 0.9 + 0.5 * np.sin(3.2 * t)
    side = np.linspace(-0.65, 0.65, 5)[None, :]
    x = middle + side
    crown = 0.07 - 0.16 * side**2 + 0 * t
    position = np.stack([x, crown, np.broadcast_to(z, x.shape)], -1)
    return shapes.surface(position, np.stack([x, np.broadcast_to(z, x.shape)], -1) / 1.1)


def _fence(rng: np.random.Generator) -> list[MeshPart]:
    wood = Material(textures.planks(rng, 5, (196, 188, 172)))
    parts = []
    for index in range(64):
        x = -4.8 + 0.152 * index
        if 0.35 < x < 1.5:  # the gate stands open
            continue
        turn, height = rng.normal(0, 1.5), 0.92 + rng.normal(0, 0.012)
        picket = shapes.box(
            (x, height / 2, -3.9), (0.085, height, 0.025), 0.9,
            offset=(rng.uniform(), rng.uniform()), turn_deg=turn,
        )  # fmt: skip
        tip = _tip(x, height)
        tone = rng.uniform(0.85, 1.1)
        parts += [picket.tinted((tone,) * 3), tip.tinted((tone,) * 3)]
    for low, high in ((-4.9, 0.33), (1.52, 4.9)):
        for y in (0.28, 0.72):
            parts.append(
                shapes.box(
                    ((low + high) / 2, y, -3.94), (high - low, 0.07, 0.04), 0.9,
                    offset=(0.3, rng.uniform()),
                )
            )  # fmt: skip
    for x in (0.33, 1.52):
        parts.append(shapes.box((x, 0.55, -3.95), (0.11, 1.1, 0.11), 0.9))
    return [MeshPart(Mesh.joined(parts), wood)]


def _tip(x: float, height: float) -> Mesh:
    z = -3.9
    half = 0.0425
    position = np.array(
        [
            [[x - half, height, z], [x + half, height, z]],
            [[x - 0.004, height + 0.07, z], [x + 0.004, height + 0.07, z]],
        ]
    )
    mesh = shapes.surface(position, np.array([[[0.0, 0.0], [0.1, 0.0]], [[0.0, 0.1], [0.1, 0.1]]]))
    normal = np.tile(np.array([[0.0, 0.0, 1.0]], np.float32), (4, 1))
    return Mesh(mesh.position_m, normal, mesh.uv, mesh.colour, mesh.triangles)
