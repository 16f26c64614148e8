"""A colonnade: two rows of fluted columns carry a beam; behind them a wall with niches."""

from __future__ import annotations

import numpy as np

from stimuli.rendering.world import Light, Material, Mesh, MeshPart, Viewpoint, World
from stimuli.scenes import shapes, textures

PALE = [(196, 182, 154), (208, 196, 170), (184, 170, 146), (200, 190, 168)]
OCHRE = [(182, 150, 108), (198, 166, 122), (170, 140, 104), (188, 160, 124)]


def build(rng: np.random.Generator) -> World:
    """Return the scene."""
    stone = Material(textures.stone(rng, (204, 194, 172)))
    floor = Material(textures.masonry(rng, 6, 4, PALE, (120, 112, 98), joint=0.03, rough=0.6))
    ashlar = Material(textures.masonry(rng, 7, 4, OCHRE, (150, 134, 110), joint=0.03, rough=0.9))
    parts = [
        MeshPart(shapes.ground((-14, -16), (14, 3), 0.3, 2.6), floor),
        MeshPart(shapes.wall((-14, -11), (14, -11), 0, 6.2, 2.8), ashlar),
        MeshPart(shapes.wall((-14, 3), (-14, -11), 0, 6.2, 2.8), ashlar),
        MeshPart(shapes.box((0, 0.12, -5.6), (28, 0.24, 1.5), 2.0), stone),
    ]
    parts += _row(rng, stone, -5.6, 2.3, 0.34, 4.3, shift=0.5)
    parts += _row(rng, stone, -2.9, 3.1, 0.24, 4.3, shift=-0.15, beam=False)
    parts.append(MeshPart(shapes.box((0, 4.95, -5.6), (28, 0.75, 1.1), 2.2), stone))
    for x in (-6.9, -2.3, 2.3, 6.9):
        parts += _niche(rng, x)
    pot = Material(textures.plaster(rng, (176, 104, 72)))
    foliage = shapes.Foliage.grow(
        rng, count=150, length_px=(60, 110), colours=[(58, 86, 36), (80, 108, 46), (104, 128, 62)]
    )
    profile = [(0.0, 0.0), (0.2, 0.0), (0.27, 0.2), (0.31, 0.45), (0.36, 0.5), (0.35, 0.56),
               (0.27, 0.54)]  # fmt: skip
    for x, z, scale in (
        (-1.55, -4.3, 1.0),
        (1.25, -7.6, 1.25),
        (4.3, -4.4, 1.0),
        (-4.6, -8.2, 1.3),
    ):
        body = shapes.lathe(np.asarray(profile) * scale, 1.0)
        parts.append(MeshPart(body.moved(x, 0, z), pot))
        parts += shapes.bush(rng, foliage, (x, 0.45 * scale, z), 0.5 * scale, cards=80)
    return World(
        tuple(parts),
        Viewpoint((0.0, 1.6, 0.6), (0.35, 1.75, -6.0), 46.0),
        Light(
            (-0.5, 0.78, 0.62), sun=(2.5, 2.2, 1.75), sky=(0.62, 0.72, 0.9),
            ground=(0.5, 0.44, 0.35), exposure=0.95,
        ),
        textures.panorama(rng, cover=0.3),
    )  # fmt: skip


def _row(
    rng: np.random.Generator, stone: Material, z: float, gap: float, radius: float, height: float,
    *, shift: float, beam: bool = True,
) -> list[MeshPart]:  # fmt: skip
    foot = 0.24 if beam else 0.0
    bodies = []
    for index in range(-5, 6):
        x = gap * index + shift
        y = np.linspace(foot + 0.32, height - 0.1, 16)
        swell = radius * (1 - 0.16 * ((y - y[0]) / (y[-1] - y[0])) ** 1.6)
        line = np.stack([np.full(16, x), y, np.full(16, z)], -1)
        shaft = shapes.tube(line, swell, (1.1, 1.4), sides=96, flutes=20, flute_depth=0.09)
        base = [(1.45, 0), (1.45, 0.1), (1.3, 0.12), (1.34, 0.2), (1.15, 0.24), (1.02, 0.34)]
        capital = [(0.84, 0), (0.9, 0.05), (0.86, 0.09), (1.25, 0.24), (1.3, 0.3)]
        bodies += [
            shaft,
            shapes.lathe([(r * radius, h) for r, h in base], 1.2, sides=40).moved(x, foot, z),
            shapes.lathe([(r * radius, h) for r, h in capital], 1.2, sides=40).moved(
                x, height - 0.12, z
            ),
            shapes.box((x, height + 0.27, z), (2.75 * radius, 0.18, 2.75 * radius), 1.2),
            shapes.box((x, foot + 0.05, z), (3.1 * radius, 0.1, 3.1 * radius), 1.2),
        ]
        tone = rng.uniform(0.93, 1.05)
        bodies[-5] = bodies[-5].tinted((tone,) * 3)
    if not beam:
        bodies.append(shapes.box((0, height + 0.6, z), (30, 0.5, 0.7), 2.0))
    return [MeshPart(Mesh.joined(bodies), stone)]


def _niche(rng: np.random.Generator, x: float) -> list[MeshPart]:
    """A blind arch with a frame, on the wall."""
    dark = Material(textures.plaster(rng, (150, 104, 82)))
    frame = Material(textures.stone(rng, (214, 206, 188)))
    z, half, spring = -10.94, 0.85, 2.5
    turn = np.linspace(0, np.pi, 25)
    outline = np.stack([half * np.cos(turn), spring + half * np.sin(turn)], -1)
    rows = np.linspace(0, 1, 12)[:, None]
    low = np.stack([outline[:, 0], np.full(25, 0.35)], -1)
    xy = low[None] + rows[..., None] * (outline - low)[None]
    position = np.concatenate([np.add(xy, (x, 0)), np.full((12, 25, 1), z)], -1)
    panel = shapes.surface(position, xy / 1.8)
    normal = np.tile(np.array([[0.0, 0.0, 1.0]], np.float32), (len(panel.normal), 1))
    panel = Mesh(panel.position_m, normal, panel.uv, panel.colour, panel.triangles)
    line = np.concatenate([[[half, 0.35]], outline, [[-half, 0.35]]])
    path = np.concatenate([np.add(line, (x, 0)), np.full((len(line), 1), z + 0.05)], -1)
    rim = shapes.tube(path, 0.12, (0.8, 0.8), sides=10)
    return [MeshPart(panel, dark), MeshPart(rim, frame)]
