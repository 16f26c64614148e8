"""A brick tunnel with rails, iron props and cables; daylight comes from its end and shafts."""

from __future__ import annotations

import numpy as np

from stimuli.rendering.world import Light, Material, Mesh, MeshPart, Viewpoint, World
from stimuli.scenes import shapes, textures

SOOTY = [(104, 66, 52), (124, 78, 58), (92, 62, 54), (136, 90, 68)]
HALF_M = 2.3
SPRING_M = 1.7
LENGTH_M = 17.0


def build(rng: np.random.Generator) -> World:
    """Return the scene."""
    brick = Material(textures.masonry(rng, 20, 8, SOOTY, (120, 112, 102)))
    metal = Material(textures.iron(rng))
    wood = Material(textures.planks(rng, 4, (88, 66, 46)))
    ballast = Material(
        textures.pebbles(rng, [(22, 20, 18), (78, 72, 66), (124, 116, 106), (190, 182, 170)])
    )
    foliage = shapes.Foliage.grow(rng)
    parts = [
        MeshPart(shapes.ground((-2.6, -LENGTH_M), (2.6, 3), 0.25, 1.1), ballast),
        MeshPart(_vault(), brick),
        MeshPart(
            shapes.ground((-30, -60), (30, -LENGTH_M), 1.0, 2.2, _valley),
            Material(textures.lawn(rng, dry=0.1)),
        ),
    ]
    parts += _rails(metal, wood)
    parts += _props(rng, metal)
    parts += _clutter(rng, metal, wood)
    for x, z, height in ((-5.2, -24.0, 8.0), (5.6, -26, 9.0), (-1.8, -38, 11.0), (2.6, -44, 12.0),
                         (-9.0, -40, 12.0), (10.0, -42, 12.0)):  # fmt: skip
        parts += shapes.tree(rng, foliage, (x, _rise(x), z), height, cards=150)
    for side, z, radius in ((-2.3, -18.6, 0.9), (2.7, -19.5, 1.0), (-3.4, -22, 1.2)):
        parts += shapes.bush(rng, foliage, (side, _rise(side), z), radius)
    return World(
        tuple(parts),
        Viewpoint((-0.25, 1.55, 1.0), (0.1, 1.45, -6.0), 46.0),
        Light(
            (-0.42, 0.7, 0.9), sun=(2.6, 2.3, 1.8), sky=(1.15, 1.2, 1.3), ground=(0.42, 0.38, 0.33),
            haze=(0.8, 0.83, 0.84), haze_m=120.0, exposure=1.25,
        ),
        textures.panorama(rng, cover=0.6),
    )  # fmt: skip


def _rise(x: float) -> float:
    return float(0.09 * max(abs(x) - 2.0, 0.0) ** 1.5)


def _valley(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.asarray(0.09 * np.maximum(np.abs(x) - 2.0, 0) ** 1.5 + 0.05 * np.sin(0.5 * z) - 0.05)


def _vault() -> Mesh:
    """Walls and barrel vault, with openings to the sky every few metres."""
    turn = np.linspace(0, np.pi, 31)
    arch = np.stack([HALF_M * np.cos(turn), SPRING_M + HALF_M * np.sin(turn)], -1)
    side = np.linspace(-0.1, SPRING_M, 7)[:-1]
    outline = np.concatenate(
        [
            np.stack([np.full(6, HALF_M), side], -1),
            arch,
            np.stack([np.full(6, -HALF_M), side[::-1]], -1),
        ]
    )
    along = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(outline, axis=0).T))])
    z = np.linspace(3.0, -LENGTH_M, 81)
    position = np.stack(
        [np.broadcast_to(outline[:, 0], (81, len(outline))),
         np.broadcast_to(outline[:, 1], (81, len(outline))),
         np.broadcast_to(z[:, None], (81, len(outline)))], -1,
    )  # fmt: skip
    # Bricks lie along the tunnel: courses follow the arch.
    uv = np.stack(np.broadcast_arrays(z[:, None] / 2.0, along[None, :] / 2.0), -1)
    mesh = shapes.surface(position, uv)
    middle = np.array([0.0, SPRING_M, 0.0])
    inward = (middle - mesh.position_m) * np.array([1.0, 1.0, 0.0])
    flip = np.sum(mesh.normal * inward, axis=1, keepdims=True) < 0
    centre = mesh.position_m[mesh.triangles.reshape(-1, 6)].mean(axis=1)  # of each quad
    shaft = (centre[:, 1] > SPRING_M + 1.35) & (
        np.abs((centre[:, 2] + 4.2 + 2.6) % 5.2 - 2.6) < 0.65
    )
    return Mesh(
        mesh.position_m, np.where(flip, -mesh.normal, mesh.normal), mesh.uv, mesh.colour,
        mesh.triangles[np.repeat(~shaft, 2)],
    )  # fmt: skip


def _rails(metal: Material, wood: Material) -> list[MeshPart]:
    rails, sleepers = [], []
    for x in (-0.72, 0.72):
        rails.append(shapes.box((x, 0.17, -14), (0.07, 0.14, 34), 0.8, step_m=0.6))
        rails.append(shapes.box((x, 0.09, -14), (0.14, 0.02, 34), 0.8, step_m=0.6))
    for index in range(40):
        z = 1.6 - 0.72 * index
        sleepers.append(
            shapes.box(
                (0, 0.045, z), (0.24, 0.11, 2.3), 1.1, turn_deg=90.0,
                offset=(0.31 * index, 0.17 * index),
            )
        )  # fmt: skip
    return [MeshPart(Mesh.joined(rails).tinted((1.5, 1.5, 1.55)), metal),
            MeshPart(Mesh.joined(sleepers), wood)]  # fmt: skip


def _props(rng: np.random.Generator, metal: Material) -> list[MeshPart]:
    """Frames of posts and a beam, some near the eye."""
    pieces = []
    for z in (-2.2, -6.8, -11.4):
        for x in (-1.65, 1.75):
            lean = rng.normal(0, 0.01)
            line = [(x + lean * k, 0.0 + 0.62 * k, z) for k in range(6)]
            pieces.append(shapes.tube(line, 0.075, (0.5, 1.0), sides=16))
            pieces.append(shapes.box((x, 0.04, z), (0.36, 0.08, 0.36), 0.7))
        pieces.append(shapes.box((0.05, 3.12, z), (3.9, 0.2, 0.16), 1.0))
        for x, way in ((-1.65, 1.0), (1.75, -1.0)):
            line = [(x + way * 0.7 * k / 4, 2.45 + 0.6 * k / 4, z) for k in range(5)]
            pieces.append(shapes.tube(line, 0.035, (0.3, 0.6), sides=8))
    pieces.append(
        shapes.tube([(0.62, y, -3.1) for y in np.linspace(0, 3.7, 8)], 0.05, (0.4, 0.9), sides=14)
    )
    return [MeshPart(Mesh.joined(pieces).tinted((1.6, 1.5, 1.4)), metal)]


def _clutter(rng: np.random.Generator, metal: Material, wood: Material) -> list[MeshPart]:
    crates = [
        shapes.box((-1.5, 0.3, -5.2), (0.6, 0.6, 0.6), 0.75, turn_deg=12),
        shapes.box((-1.42, 0.84, -5.25), (0.46, 0.46, 0.46), 0.75, turn_deg=31, offset=(0.4, 0.2)),
        shapes.box((1.5, 0.26, -9.0), (0.55, 0.52, 0.55), 0.75, turn_deg=-16, offset=(0.1, 0.6)),
    ]
    cables = []
    for height, sag in ((2.05, 0.1), (2.2, 0.16)):
        z = np.linspace(2.5, -16, 60)
        drop = sag * np.abs(np.sin(np.pi * (z + 2.2) / 4.6))
        for side in (-1, 1):
            line = np.stack([np.full(60, side * (HALF_M - 0.1)), height - drop, z], -1)
            cables.append(shapes.tube(line, 0.025, (0.2, 0.5), sides=7))
    profile = [(0.0, 0.0), (0.27, 0.0), (0.28, 0.3), (0.28, 0.6), (0.27, 0.85), (0.0, 0.85)]
    drum = shapes.lathe(profile, 0.9, sides=28).moved(1.55, 0, -4.6)
    tilted = [shapes.box((-1.75, 0.75, -8.0), (0.1, 1.5, 0.14), 1.1),
              shapes.box((-1.9, 0.8, -8.2), (0.1, 1.6, 0.14), 1.1, offset=(0.4, 0))]  # fmt: skip
    del rng
    return [
        MeshPart(Mesh.joined(crates + tilted), wood),
        MeshPart(Mesh.joined(cables), metal),
        MeshPart(drum.tinted((1.3, 1.9, 2.4)), metal),
    ]
