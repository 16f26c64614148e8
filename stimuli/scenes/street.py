"""A street in a small town: shops and houses on both sides, signs, kerbs, lamps, trees and cars.

It goes on behind the eye and is closed at both ends, so it may be looked at in every direction.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from stimuli.rendering.world import Light, Material, Mesh, MeshPart, Viewpoint, World
from stimuli.scenes import shapes, textures

HALF_ROAD_M, HALF_STREET_M = 2.7, 5.4
AHEAD_M, BEHIND_M = -27.0, 15.0  # z of the facades that close the street
STOREY_M, GROUND_M = 2.9, 3.3
DEEP_M = 7.0  # of a house
_SYLLABLES = [first + second for first in "bdfghklmnprstvw" for second in "aeio"]
_BRICKS = (
    [(138, 74, 56), (158, 92, 66), (146, 82, 68), (124, 66, 54)],
    [(186, 160, 118), (200, 176, 134), (172, 146, 108), (208, 186, 150)],
)
_PLASTERS = ((214, 198, 168), (196, 176, 152), (170, 186, 192), (222, 206, 196), (190, 196, 168))
_PAINTS = ((56, 82, 70), (110, 42, 44), (48, 60, 92), (132, 104, 52), (70, 70, 72))


@dataclass
class _Built:
    """Meshes gathered by material, so that the world has few parts."""

    meshes: dict[int, tuple[Material, list[Mesh]]] = field(default_factory=dict)

    def add(self, material: Material, meshes: Mesh | Iterable[Mesh]) -> None:
        """Take meshes in."""
        kept = self.meshes.setdefault(id(material), (material, []))[1]
        kept += [meshes] if isinstance(meshes, Mesh) else list(meshes)

    def take(self, other: _Built, x_m: float, z_m: float, turn_deg: float) -> None:
        """Take in what was built elsewhere, turned and moved to its place."""
        for material, meshes in other.meshes.values():
            self.add(material, Mesh.joined(meshes).moved(x_m, 0, z_m, turn_deg=turn_deg))

    def parts(self) -> list[MeshPart]:
        """Return a part for each material."""
        return [
            MeshPart(Mesh.joined(meshes), material) for material, meshes in self.meshes.values()
        ]


@dataclass(frozen=True)
class _Kit:
    """Materials that houses share."""

    walls: tuple[Material, ...]
    panes: tuple[Material, ...]
    goods: tuple[Material, ...]
    stone: Material
    wood: Material
    white: Material
    tiles: Material
    iron: Material
    windscreen: Material

    @classmethod
    def of(cls, rng: np.random.Generator) -> _Kit:
        bricks = [Material(textures.masonry(rng, 22, 7, tones)) for tones in _BRICKS]
        plasters = [Material(textures.plaster(rng, tone)) for tone in _PLASTERS]
        return cls(
            (*bricks, *plasters),
            tuple(Material(_pane(rng)) for _ in range(3)),
            tuple(Material(_goods(rng)) for _ in range(3)),
            Material(textures.stone(rng, (184, 176, 162))),
            Material(textures.planks(rng, 4, (110, 84, 60))),
            Material(textures.plaster(rng, (226, 222, 212))),
            Material(textures.roof_tiles(rng)),
            Material(textures.iron(rng)),
            Material(_pane(rng, curtains=False)),
        )


def build(rng: np.random.Generator) -> World:
    """Return the scene."""
    kit = _Kit.of(rng)
    town = _Built()
    _lay_ground(rng, town, kit)
    _put_houses(rng, town, kit)
    _furnish(rng, town, kit)
    return World(
        (*town.parts(), *_trees(rng)),
        Viewpoint((1.1, 1.62, 5.2), (-0.45, 2.05, -6.0), 48.0),
        Light(
            (0.33, 0.8, 0.42), sun=(2.5, 2.2, 1.8), sky=(0.8, 0.88, 1.0), ground=(0.34, 0.31, 0.27),
            haze=(0.8, 0.84, 0.88), haze_m=420.0, exposure=1.12,
        ),
        textures.panorama(rng, cover=0.5),
    )  # fmt: skip


# --- ground ------------------------------------------------------------------------------


def _lay_ground(rng: np.random.Generator, town: _Built, kit: _Kit) -> None:
    """Lay road, gutters, kerbs, pavements and what is painted on them."""
    asphalt = Material(
        textures.pebbles(rng, [(34, 34, 36), (66, 66, 68), (88, 87, 86), (128, 126, 120)])
    )
    slabs = Material(
        textures.masonry(
            rng, 4, 3, [(150, 146, 138), (164, 160, 150), (140, 136, 130)], (96, 92, 86), joint=0.02
        )
    )
    setts = Material(
        textures.masonry(rng, 10, 8, [(104, 100, 96), (120, 114, 108), (92, 88, 86)], (62, 58, 54))
    )
    low, high = AHEAD_M - 0.5, BEHIND_M + 0.5
    town.add(asphalt, shapes.ground((-HALF_ROAD_M, low), (HALF_ROAD_M, high), 0.5, 1.3, _camber))
    for side in (-1, 1):
        inner, kerb, outer = (side * edge for edge in (HALF_ROAD_M - 0.32, HALF_ROAD_M,
                                                       HALF_STREET_M + 0.3))  # fmt: skip
        town.add(setts, _flat(sorted((inner, kerb)), (low, high), 0.022, 0.9))
        pavement = sorted((kerb + side * 0.16, outer))
        town.add(slabs, _flat(pavement, (low, high), 0.13, 2.0))
        stones = np.arange(low, high, 0.92)
        town.add(
            kit.stone,
            [
                shapes.box(
                    (kerb + side * 0.08, 0.05 + rng.normal(0, 0.003), z + 0.45), (0.17, 0.17, 0.9),
                    1.6, offset=(rng.uniform(), rng.uniform()),
                ).tinted((rng.uniform(0.82, 1.05),) * 3)
                for z in stones
            ],
        )  # fmt: skip
        gullies = [shapes.box((inner, 0.02, z), (0.3, 0.03, 0.42), 0.5) for z in (-12.3, -1.7, 9)]
        town.add(kit.iron, gullies)
    lines = [((-0.06, 0.06), (z, z + 1.5)) for z in np.arange(-26, 14, 3.4)
             if not -10.8 < z < -6.3]  # fmt: skip
    lines += [((x, x + 0.42), (-9.6, -7.0)) for x in np.arange(-2.36, 2.2, 0.86)]
    town.add(kit.white, [_painted(*line) for line in lines])
    for x, z in ((0.9, 1.2), (-1.1, -13.5)):
        town.add(kit.iron, shapes.lathe([(0.0, 0.056), (0.31, 0.056), (0.33, 0.02)], 0.5)
                 .moved(x, 0, z))  # fmt: skip


def _camber(x: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.asarray(0.055 - 0.0055 * x**2 + 0.004 * np.sin(1.7 * z + 0.6 * x))


def _painted(across: tuple[float, float], along: tuple[float, float]) -> Mesh:
    """A line on the road, just above it."""
    low, high = (across[0], along[0]), (across[1], along[1])
    return shapes.ground(low, high, 0.2, 1.0, lambda x, z: _camber(x, z) + 0.012)


def _flat(
    across: Sequence[float], along: tuple[float, float], height_m: float, texture_m: float
) -> Mesh:
    """A level strip between x `across` and z `along`."""
    return shapes.ground(
        (across[0], along[0]), (across[1], along[1]), 0.5, texture_m,
        lambda x, _z: np.full_like(x, height_m),
    )  # fmt: skip


# --- houses ------------------------------------------------------------------------------


def _put_houses(rng: np.random.Generator, town: _Built, kit: _Kit) -> None:
    """Fill both sides and both ends with houses that stand wall to wall."""
    order = rng.permutation(len(kit.walls))
    number = 0
    long_m = BEHIND_M - AHEAD_M
    for turn, length in ((90.0, long_m), (-90.0, long_m), (0.0, 2 * HALF_STREET_M),
                         (180.0, 2 * HALF_STREET_M)):  # fmt: skip
        count = round(length / 6.4)
        widths = rng.uniform(0.8, 1.2, count)
        widths *= length / widths.sum()
        ends = np.concatenate([[0], np.cumsum(widths)])
        for first, last in pairwise(ends):
            wall = kit.walls[order[number % len(order)]]
            high = 2 + int(rng.integers(0, 2))
            made = _house(rng, kit, wall, last - first, high, shop=number % 3 != 2)
            number += 1
            if turn == 90:  # facades look to +x, and u runs towards -z
                town.take(made, -HALF_STREET_M, BEHIND_M - first, turn)
            elif turn == -90:
                town.take(made, HALF_STREET_M, AHEAD_M + first, turn)
            elif turn == 0:
                town.take(made, -HALF_STREET_M + first, AHEAD_M, turn)
            else:
                town.take(made, HALF_STREET_M - first, BEHIND_M, turn)


def _house(
    rng: np.random.Generator, kit: _Kit, wall: Material, width: float, upper: int, *, shop: bool
) -> _Built:
    """A house whose facade stands on z = 0 from x = 0 to `width`, and looks to +z."""
    made = _Built()
    top = GROUND_M + upper * STOREY_M + 0.25
    trim = kit.stone if rng.random() < 0.6 else kit.white
    frame = kit.white if rng.random() < 0.7 else kit.wood
    paint = np.asarray(_PAINTS[int(rng.integers(len(_PAINTS)))]) / 110.0
    bays = max(2, round(width / 2.3))
    pitch = width / bays
    half = 0.5 * min(1.15, 0.5 * pitch)
    middles: NDArray[np.float64] = pitch * (np.arange(bays, dtype=np.float64) + 0.5)
    openings: list[tuple[float, float, float, float]] = []
    for storey in range(upper):
        sill = GROUND_M + storey * STOREY_M + 0.75
        tall = 1.75 if storey == 0 else 1.5
        for middle in middles:
            place = (middle - half, middle + half, sill, sill + tall)
            openings.append(place)
            _window(rng, made, place, frame, trim, kit.panes[int(rng.integers(len(kit.panes)))])
    openings += _shop(rng, made, kit, width, paint) if shop else _front_door(
        rng, made, kit, middles, half, frame, trim, paint)  # fmt: skip
    made.add(wall, _pierced(width, top, openings, 2.3))
    for y in (GROUND_M + 0.1, top - 0.05):
        made.add(trim, shapes.box((width / 2, y, 0.04), (width, 0.16, 0.16), 1.5))
    made.add(trim, shapes.box((width / 2, top + 0.08, 0.1), (width, 0.14, 0.3), 1.5))
    _roof(rng, made, kit, wall, width, top)
    pipe_x = 0.12 + 0.5 * (pitch - 2 * half) * 0.4
    made.add(
        kit.iron,
        shapes.tube([(pipe_x, y, 0.1) for y in np.linspace(0.1, top, 9)], 0.045, (0.3, 0.9),
                    sides=8),
    )  # fmt: skip
    return made


def _pierced(
    width: float,
    top: float,
    openings: Sequence[tuple[float, float, float, float]],
    texture_m: float,
) -> Iterable[Mesh]:
    """The wall between openings (x0, x1, y0, y1), its texture unbroken; and their reveals."""
    xs = sorted({0.0, width, *(edge for one in openings for edge in one[:2])})
    ys = sorted({0.0, top, *(edge for one in openings for edge in one[2:])})
    for x0, x1 in pairwise(xs):
        for y0, y1 in pairwise(ys):
            x, y = (x0 + x1) / 2, (y0 + y1) / 2
            if not any(a < x < b and c < y < d for a, b, c, d in openings):
                yield _sheet((x0, x1), (y0, y1), 0.0, texture_m)
    for x0, x1, y0, y1 in openings:
        for x in (x0, x1):
            yield shapes.wall((x, 0), (x, -0.22), y0, y1, texture_m)
        for y in (y0, y1):
            yield _flat((x0, x1), (-0.22, 0.0), y, texture_m)


def _sheet(
    across: tuple[float, float], up: tuple[float, float], z: float, texture_m: float
) -> Mesh:
    """An upright sheet that looks to +z; its texture lies in the wall's own metres."""
    x = np.linspace(*across, max(2, round((across[1] - across[0]) / 0.5) + 1))
    y = np.linspace(*up, max(2, round((up[1] - up[0]) / 0.5) + 1))
    xx, yy = np.meshgrid(x, y)
    return shapes.surface(
        np.stack([xx, yy, np.full_like(xx, z)], -1), np.stack([xx, yy], -1) / texture_m
    )


def _picture(across: tuple[float, float], up: tuple[float, float], z: float) -> Mesh:
    """An upright sheet that shows its texture once."""
    mesh = _sheet(across, up, z, 1.0)
    uv = (mesh.uv - (across[0], up[0])) / (across[1] - across[0], up[1] - up[0])
    return Mesh(mesh.position_m, mesh.normal, uv, mesh.colour, mesh.triangles)


def _window(
    rng: np.random.Generator, made: _Built, place: tuple[float, float, float, float],
    frame: Material, trim: Material, pane: Material,
) -> None:  # fmt: skip
    """A sash window in its opening, with sill and lintel."""
    x0, x1, y0, y1 = place
    middle = (x0 + x1) / 2
    made.add(pane, _picture((x0, x1), (y0, y1), -0.2).tinted((rng.uniform(0.8, 1.15),) * 3))
    bars = [((x, (y0 + y1) / 2), (0.07, y1 - y0)) for x in (x0 + 0.03, x1 - 0.03)]
    bars += [((middle, y), (x1 - x0, 0.07)) for y in (y0 + 0.03, (y0 + y1) / 2, y1 - 0.03)]
    bars.append(((middle, (y0 + y1) / 2), (0.04, y1 - y0)))
    made.add(frame, [shapes.box((*at, -0.16), (*size, 0.07), 1.1) for at, size in bars])
    made.add(trim, shapes.box((middle, y0 - 0.06, 0.06), (x1 - x0 + 0.24, 0.12, 0.22), 1.3))
    made.add(
        trim,
        shapes.box((middle, y1 + 0.11, 0.02), (x1 - x0 + 0.3, 0.22, 0.08), 1.3,
                   offset=(rng.uniform(), 0)),
    )  # fmt: skip


def _front_door(
    rng: np.random.Generator, made: _Built, kit: _Kit, middles: NDArray[np.float64], half: float,
    frame: Material, trim: Material, paint: NDArray[np.float64],
) -> list[tuple[float, float, float, float]]:  # fmt: skip
    """A ground floor that is lived in: a painted door, and windows."""
    at = int(rng.integers(len(middles)))
    openings = []
    for index, middle in enumerate(middles):
        if index == at:
            place = (middle - 0.5, middle + 0.5, 0.13, 2.35)
            made.add(kit.wood, _sheet(place[:2], place[2:], -0.18, 0.9).tinted(paint))
            panels = [
                shapes.box((middle + dx, y, -0.16), (0.34, tall, 0.04), 0.8)
                for dx in (-0.22, 0.22) for y, tall in ((0.65, 0.7), (1.6, 0.85))
            ]  # fmt: skip
            made.add(kit.wood, [panel.tinted(0.8 * paint) for panel in panels])
            made.add(
                trim,
                [shapes.box((middle + dx, 1.25, 0.04), (0.18, 2.4, 0.14), 1.4)
                 for dx in (-0.6, 0.6)]
                + [shapes.box((middle, 2.5, 0.07), (1.5, 0.22, 0.24), 1.4),
                   shapes.box((middle, 0.16, 0.2), (1.3, 0.16, 0.5), 1.4)],
            )  # fmt: skip
        else:
            place = (middle - half, middle + half, 1.0, 2.6)
            pane = kit.panes[int(rng.integers(len(kit.panes)))]
            _window(rng, made, place, frame, trim, pane)
        openings.append(place)
    return openings


def _shop(
    rng: np.random.Generator, made: _Built, kit: _Kit, width: float, paint: NDArray[np.float64]
) -> list[tuple[float, float, float, float]]:
    """A shop's ground floor: window with goods, door, painted posts, sign, often an awning."""
    door_first = rng.random() < 0.5
    low, high = 0.35, width - 0.35
    door = (low, low + 1.05) if door_first else (high - 1.05, high)
    window = (low + 1.3, high) if door_first else (low, high - 1.3)
    places = [(*door, 0.13, 2.45), (*window, 0.6, 2.45)]
    goods = kit.goods[int(rng.integers(len(kit.goods)))]
    made.add(goods, _picture(window, (0.6, 2.45), -0.2))
    made.add(kit.panes[0], _picture(door, (0.9, 2.4), -0.19))
    made.add(kit.wood, _sheet(door, (0.13, 0.9), -0.18, 0.9).tinted(paint))
    posts = [0.16, width - 0.16, *door, *window]
    upright = [shapes.box((x, 1.3, 0.02), (0.13, 2.4, 0.14), 0.9) for x in posts]
    mullions = np.linspace(*window, max(2, round((window[1] - window[0]) / 1.2)) + 1)[1:-1]
    upright += [shapes.box((x, 1.5, -0.15), (0.06, 1.9, 0.06), 0.9) for x in mullions]
    level = [
        shapes.box((sum(window) / 2, y, 0.0), (window[1] - window[0], 0.1, 0.16), 0.9)
        for y in (0.62, 2.1)
    ]
    made.add(kit.wood, [one.tinted(paint) for one in (*upright, *level)])
    board = (0.1, width - 0.1), (2.5, 3.1)
    lettered = Material(_sign(rng, 110 * paint, (board[0][1] - board[0][0]) / 0.6))
    made.add(lettered, _picture(*board, 0.17))
    made.add(kit.wood, shapes.box((width / 2, 2.8, 0.08), (width - 0.16, 0.66, 0.15), 0.9)
             .tinted(0.8 * paint))  # fmt: skip
    if rng.random() < 0.6:
        stripes = Material(_stripes(rng))
        made.add(stripes, _awning(window, 2.55, 1.1))
    else:
        hung = Material(_sign(rng, np.asarray(_PLASTERS[int(rng.integers(5))], float), 1.3))
        x = door[0] + 0.5
        faces = [_picture((0.15, 0.85), (2.95, 3.5), 0.0).moved(x + side, 0, 0, turn_deg=-90)
                 for side in (-0.02, 0.02)]  # fmt: skip
        made.add(hung, faces)
        made.add(kit.iron, shapes.tube([(x, 3.56, z) for z in (0.0, 0.5, 0.95)], 0.02, (0.2, 0.4)))
    return places


def _awning(across: tuple[float, float], top: float, out: float) -> list[Mesh]:
    """Cloth that slopes out over a shop's window, and hangs over at its edge."""
    x = np.linspace(across[0] - 0.1, across[1] + 0.1, 14)
    rows = [(top, 0.2), (top - 0.16, 0.2 + out / 2), (top - 0.42, 0.2 + out),
            (top - 0.64, 0.21 + out)]  # fmt: skip
    position = np.array([[(at, y, z) for at in x] for y, z in rows])
    uv = np.array([[(at / 0.8, row / 3) for at in x] for row in range(len(rows))])
    return [shapes.surface(position[:3], uv[:3]), shapes.surface(position[2:], uv[2:])]


def _roof(
    rng: np.random.Generator, made: _Built, kit: _Kit, wall: Material, width: float, top: float
) -> None:
    """Two slopes of tiles, gables, a gutter and a chimney."""
    rise = rng.uniform(1.9, 2.8)
    back = -DEEP_M
    for near, far in ((0.35, back / 2), (back - 0.35, back / 2)):
        x, share = np.meshgrid(np.linspace(0, width, 14), np.linspace(0, 1, 9))
        low = top + 0.1 - 0.35 * 2 * rise / DEEP_M
        ridge = top + 0.1 + rise
        slope = np.hypot(far - near, ridge - low)
        position = np.stack([x, low + share * (ridge - low), near + share * (far - near)], -1)
        made.add(kit.tiles, shapes.surface(position, np.stack([x, -share * slope], -1) / 2.2))
    z = np.linspace(0, back, 9)
    lift = top + rise * (1 - abs(z - back / 2) / (-back / 2))
    for side in (0.0, width):
        made.add(wall, shapes.wall((side, 0), (side, back), 0, top, 2.3))
        edges = [np.stack([side + 0 * z, y, z], -1) for y in (top + 0 * z, lift)]
        gable = np.stack(edges)
        made.add(wall, shapes.surface(gable, gable[..., [2, 1]] / 2.3))
    made.add(wall, _sheet((0, width), (0, top), back, 2.3))
    made.add(
        kit.iron,
        shapes.tube([(x, top + 0.12, 0.36) for x in np.linspace(0, width, 8)], 0.065, (0.4, 0.9),
                    sides=8),
    )  # fmt: skip
    stack = rng.uniform(0.5, width - 0.5)
    middle = back / 2 + 0.4
    made.add(kit.walls[0], shapes.box((stack, top + rise + 0.4, middle), (0.9, 1.9, 0.6), 2.3))
    pot = [(0.12, 0.0), (0.1, 0.35), (0.13, 0.42)]
    made.add(
        kit.tiles,
        [shapes.lathe(pot, 0.8, sides=10).moved(stack + dx, top + rise + 1.34, middle)
         for dx in (-0.25, 0.25)],
    )  # fmt: skip


# --- what stands in the street -----------------------------------------------------------


def _furnish(rng: np.random.Generator, town: _Built, kit: _Kit) -> None:
    """Put up lamps, bollards, road signs, bunting, benches and parked cars."""
    metal = kit.iron
    light = Material(textures.plaster(rng, (236, 232, 214)))
    for side, z in ((-1, -3.0), (1, -7.5), (-1, -15.5), (1, -19.5), (1, 3.2), (-1, 7.5), (1, 12.0)):
        x = side * (HALF_ROAD_M + 0.55)
        profile = [(0.12, 0.1), (0.12, 0.5), (0.065, 0.62), (0.05, 2.2), (0.042, 3.55), (0.1, 3.6)]
        town.add(metal, shapes.lathe(profile, 0.5, sides=12).moved(x, 0, z))
        lantern = [(0.09, 3.62), (0.19, 4.02)]
        town.add(light, shapes.lathe(lantern, 0.6, sides=6).moved(x, 0, z))
        town.add(metal, shapes.lathe([(0.22, 4.02), (0.12, 4.16), (0.015, 4.3)], 0.5, sides=6)
                 .moved(x, 0, z))  # fmt: skip
    bollard = [(0.075, 0.12), (0.07, 0.85), (0.09, 0.9), (0.06, 0.99), (0.0, 1.02)]
    for side in (-1, 1):
        for z in (*np.arange(-11.5, -5, 1.3), *np.arange(-0.4, 2.4, 1.3)):
            town.add(metal, shapes.lathe(bollard, 0.5, sides=12).moved(side * 3.05, 0, z))
    for x, z, kind in ((3.3, -5.6, 0), (-3.3, -11.0, 1), (-3.3, 4.1, 2)):
        face = Material(_road_sign(kind), cutout=True)
        town.add(metal, shapes.tube([(x, y, z) for y in np.linspace(0.1, 2.6, 7)], 0.03,
                                    (0.3, 0.6), sides=8))  # fmt: skip
        town.add(face, _picture((x - 0.33, x + 0.33), (2.05, 2.71), z + 0.04))
    for x, z in ((4.55, -13.6), (-4.5, 1.0)):
        slats = [(x, 0.56, z + dz) for dz in (-0.16, 0.0, 0.16)]
        back = [(x, y, z - 0.28) for y in (0.75, 0.92)]
        town.add(kit.wood, [shapes.box(at, (1.5, 0.04, 0.12), 0.9) for at in slats]
                 + [shapes.box(at, (1.5, 0.12, 0.04), 0.9) for at in back])  # fmt: skip
        town.add(metal, [shapes.box((x + dx, 0.45, z - 0.06), (0.06, 0.66, 0.46), 0.5)
                         for dx in (-0.65, 0.65)])  # fmt: skip
    _hang_bunting(rng, town, kit)
    for x, z, turn, tone in ((-1.75, -16.4, 0.0, (0.75, 0.2, 0.18)),
                             (1.75, -12.6, 180.0, (0.3, 0.42, 0.62)),
                             (1.78, -21.0, 180.0, (0.72, 0.72, 0.7)),
                             (-1.76, 10.4, 0.0, (0.25, 0.36, 0.3))):  # fmt: skip
        town.take(_car(kit, np.asarray(tone)), x, z, turn)


def _hang_bunting(rng: np.random.Generator, town: _Built, kit: _Kit) -> None:
    """Strings of flags across the street."""
    cloth = [Material(textures.plaster(rng, tone)) for tone in
             ((196, 62, 58), (60, 96, 150), (226, 190, 84), (232, 228, 216))]  # fmt: skip
    for z, high in ((-4.4, 5.3), (-17.5, 5.6), (9.0, 5.4)):
        t = np.linspace(0, 1, 25)
        line = np.stack(
            [HALF_STREET_M * (2 * t - 1), high - 0.9 * 4 * t * (1 - t), z + 0.4 * np.sin(5 * t)], -1
        )
        town.add(kit.iron, shapes.tube(line, 0.008, (0.1, 0.3), sides=5))
        for index, (first, last) in enumerate(pairwise(line)):
            tip = (first + last) / 2 - (0, 0.34, rng.normal(0, 0.06))
            corners = np.array([[first, last], [tip, tip + np.array([0.001, 0, 0])]])
            uv = np.array([[[0.0, 0.3], [0.3, 0.3]], [[0.14, 0.0], [0.15, 0.0]]])
            town.add(cloth[index % 4], shapes.surface(corners, uv + rng.uniform()))


def _car(kit: _Kit, tone: NDArray[np.float64]) -> _Built:
    """A small parked car along z, its nose to -z."""
    made = _Built()
    z = np.linspace(-1.9, 1.9, 30)
    ends = (1 - abs(z / 1.93) ** 7) ** (1 / 3)
    belt = 0.62 + 0.27 * np.clip((z + 1.9) / 1.3, 0, 1) ** 0.6
    made.add(kit.white, _loft(z, 0.84 * (0.9 + 0.1 * ends), 0.22 + 0 * z, belt + 0.05 * ends, 5.0)
             .tinted(tone))  # fmt: skip
    z = np.linspace(-0.85, 1.7, 24)
    share = (z + 0.85) / 2.55
    roof = 0.86 + 0.56 * (1 - abs(2 * share**0.8 - 1.0) ** 3.2)
    made.add(kit.windscreen, _loft(z, 0.74 - 0.03 * share, 0.8 + 0 * z, roof, 3.4))
    cap = _loft(z[6:-4], 0.66 + 0 * z[6:-4], roof[6:-4] - 0.05, roof[6:-4] + 0.02, 6.0)
    made.add(kit.white, cap.tinted(tone))
    made.add(kit.white, [shapes.box((x, 1.1, 0.45), (0.03, 0.62, 0.07), 1.0).tinted(tone)
                         for x in (-0.72, 0.72)])  # fmt: skip
    rubber = [(0.0, -0.09), (0.2, -0.1), (0.31, -0.08), (0.31, 0.08), (0.2, 0.1), (0.0, 0.09)]
    tip = np.array([[0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], float)
    for x in (-0.76, 0.76):
        for at in (-1.2, 1.2):
            wheel = shapes.lathe(rubber, 0.6, sides=22).transformed(tip).moved(x, 0.33, at)
            made.add(kit.iron, wheel.tinted((0.35,) * 3))
            hub = shapes.lathe([(0.0, 0.0), (0.17, 0.0)], 0.4, sides=18).transformed(tip)
            outer = x + np.sign(x) * 0.105
            made.add(kit.iron, hub.moved(float(outer), 0.33, at).tinted((2.6,) * 3))
    for at, lamp in ((-1.88, (1.05, 1.05, 0.95)), (1.88, (0.7, 0.06, 0.05))):
        made.add(kit.white, [shapes.box((x, 0.62, at), (0.26, 0.13, 0.06), 0.5).tinted(lamp)
                             for x in (-0.56, 0.56)])  # fmt: skip
        made.add(kit.iron, shapes.box((0, 0.36, at), (1.5, 0.14, 0.1), 0.6))
    return made


def _loft(
    z: NDArray[np.float64], half: NDArray[np.float64], low: NDArray[np.float64],
    high: NDArray[np.float64], power: float,
) -> Mesh:  # fmt: skip
    """A body along z whose sections are rounded boxes: superellipses of that power."""
    turn = np.linspace(0, 2 * np.pi, 29)
    c, s = np.cos(turn), np.sin(turn)
    x = np.sign(c) * abs(c) ** (2 / power)
    y = np.sign(s) * abs(s) ** (2 / power)
    middle, tall = (low + high) / 2, (high - low) / 2
    position = np.stack(
        [half[:, None] * x, middle[:, None] + tall[:, None] * y,
         np.broadcast_to(z[:, None], (len(z), len(turn)))], -1,
    )  # fmt: skip
    for end, inwards in ((0, 1), (-1, -1)):  # closed by a flat section
        shut = position[end].copy()
        shut[:, :2] = (0, middle[end])
        position = np.insert(position, 0 if inwards == 1 else len(position), shut, axis=0)
    uv = np.stack(np.broadcast_arrays(turn[None, :] / 2, position[..., 2]), -1)
    return shapes.surface(position, uv, closed=True)


def _trees(rng: np.random.Generator) -> list[MeshPart]:
    """Street trees in the pavement."""
    foliage = shapes.Foliage.grow(rng)
    parts: list[MeshPart] = []
    for x, z, height in ((-3.75, -7.2, 5.2), (3.8, -16.6, 5.8), (-3.8, -21.5, 5.6),
                         (3.75, 9.3, 5.2)):  # fmt: skip
        parts += shapes.tree(
            rng, foliage, (x, 0.1, z), height, trunk_m=0.1, crown_share=0.5, cards=130, card_m=0.75
        )
    return parts


# --- textures ----------------------------------------------------------------------------


def _pane(rng: np.random.Generator, *, curtains: bool = True) -> NDArray[np.uint8]:
    """A dark room behind glass, curtains, and some sky in the glass; v = 0 is the sill."""
    size = 256
    v, u = np.mgrid[:size, :size] / size
    sky = np.clip(0.25 + 0.55 * v + 0.25 * textures.fractal(rng, size, 1.5), 0, 1) ** 2
    colour = np.array([34.0, 36, 40]) + sky[..., None] * np.array([74.0, 88, 104])
    if not curtains:
        return textures.finish(colour)
    reach = rng.uniform(0.12, 0.3)
    folds = 0.8 + 0.2 * np.sin(2 * np.pi * (u * 17 + 0.4 * textures.fractal(rng, size, 2.0)))
    hung = np.clip((reach * (1 + 0.5 * v) - np.minimum(u, 1 - u)) * 30, 0, 1)[..., None]
    cloth = np.asarray(rng.uniform(150, 215, 3))
    return textures.finish(colour * (1 - 0.85 * hung) + 0.85 * hung * folds[..., None] * cloth)


def _goods(rng: np.random.Generator) -> NDArray[np.uint8]:
    """A lit shop window: shelves with wares of many colours."""
    tall, wide = 256, 768
    colour = np.full((tall, wide, 3), (58.0, 50, 42))
    for shelf in range(4):
        floor = 18 + 58 * shelf
        colour[floor - 6 : floor] = (120, 92, 64)
        at = 6.0
        while at < wide - 24:
            broad, high = int(rng.integers(10, 34)), int(rng.integers(16, 46))
            tone = rng.uniform(60, 235, 3)
            left = int(at)
            ware = colour[floor : floor + high, left : left + broad]
            shade = 0.7 + 0.3 * np.sin(np.pi * (np.arange(ware.shape[1]) + 0.5) / broad)
            ware[:] = tone * shade[None, :, None]
            ware[high // 3 : high // 3 + 5, 2:-2] = 255 - tone
            at += broad + rng.uniform(1, 9)
    lit = 1.4 - 0.5 * np.linspace(0, 1, tall)[::-1, None, None] ** 2
    glass = textures.fractal(rng, 1024, 1.6)[:tall, :wide]
    return textures.finish(ndimage.gaussian_filter(colour, (0.7, 0.7, 0)) * lit
                           + 9 * glass[..., None] + 6)  # fmt: skip


def _sign(
    rng: np.random.Generator, ground: NDArray[np.float64], aspect: float
) -> NDArray[np.uint8]:
    """A board with a name that no language has, `aspect` times as wide as high."""
    tall = 192
    wide = max(tall, round(tall * aspect))
    board = np.empty((tall, wide, 3), np.uint8)
    board[:] = np.clip(ground, 0, 255)
    ink = (238, 226, 190) if ground.mean() < 130 else (46, 40, 52)
    cv2.rectangle(board, (9, 9), (wide - 10, tall - 10), ink, 3, cv2.LINE_AA)
    words = ["".join(rng.choice(_SYLLABLES, 2 + k % 2)).capitalize() for k in range(3)]
    font = cv2.FONT_HERSHEY_TRIPLEX if rng.random() < 0.5 else cv2.FONT_HERSHEY_DUPLEX
    for count in (3, 2, 1):
        said = " ".join(words[:count])
        (long, high), _ = cv2.getTextSize(said, font, 1.0, 2)
        scale = min(0.86 * wide / long, 0.5 * tall / high)
        if scale * high > 0.3 * tall or count == 1:
            break
    place = round((wide - scale * long) / 2), round((tall + scale * high) / 2)
    cv2.putText(board, said, place, font, scale, ink, max(1, round(1.6 * scale)), cv2.LINE_AA)
    worn = 1 + 0.05 * textures.fractal(rng, 1024, 1.0)[:tall, :1024]
    worn = np.tile(worn, (1, -(-wide // 1024)))[:, :wide]
    return textures.finish((board * worn[..., None])[::-1].astype(np.float64))


def _stripes(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Awning cloth: two stripes to a texture."""
    tones = ((168, 52, 50), (52, 92, 80), (58, 78, 122), (196, 138, 62))
    size = 256
    u = np.arange(size) / size
    first = np.asarray(tones[int(rng.integers(len(tones)))], float)
    colour = np.where((u < 0.5)[None, :, None], first, (226.0, 220, 204))
    worn = 1 + 0.05 * textures.fractal(rng, size, 0.8) + 0.05 * textures.fractal(rng, size, 1.6)
    return textures.finish(np.broadcast_to(colour, (size, size, 3)) * worn[..., None])


def _road_sign(kind: int) -> NDArray[np.uint8]:
    """A round sign: a limit, a way, or no way, drawn in shapes; nothing around it."""
    size = 256
    face = np.zeros((size, size, 3), np.uint8)
    cover = np.zeros((size, size), np.uint8)
    centre = (size // 2, size // 2)
    cv2.circle(cover, centre, 122, 255, cv2.FILLED, cv2.LINE_AA)
    red, white, blue, black = (190, 34, 36), (240, 238, 232), (30, 84, 160), (26, 26, 28)
    face[:] = white
    if kind == 0:
        cv2.circle(face, centre, 108, red, 30, cv2.LINE_AA)
        cv2.putText(face, "30", (58, 160), cv2.FONT_HERSHEY_DUPLEX, 3.2, black, 9, cv2.LINE_AA)
    elif kind == 1:
        face[:] = blue
        cv2.arrowedLine(face, (128, 206), (128, 52), white, 26, cv2.LINE_AA, tipLength=0.45)
    else:
        face[:] = red
        cv2.rectangle(face, (42, 104), (214, 152), white, cv2.FILLED)
    return textures.finish(face[::-1].astype(np.float64), cover[::-1] / 255.0)
