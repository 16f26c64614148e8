"""Trees, bushes and tufts, put together from shapes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stimuli.rendering.world import Material, Mesh, MeshPart
from stimuli.scenes import shapes, textures

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
    stem = shapes.branch_path(rng, base - [0, 0.2, 0], (0, 1, 0), 0.8 * height_m, wander=0.05)
    taper = np.linspace(1.0, 0.28, len(stem))
    taper[0] = 1.5
    wood = [shapes.tube(stem, radius * taper, (0.7, 1.4), sides=14)]
    spread = 0.32 * height_m
    middle = stem[-1] + (0, -0.06 * height_m, 0)
    for index in range(BRANCHES):
        share = rng.uniform(1 - crown_share, 0.95)
        start = stem[int(share * (len(stem) - 1))]
        turn = 2 * np.pi * (index + rng.uniform(-0.3, 0.3)) / BRANCHES
        way = (np.cos(turn), rng.uniform(0.35, 0.9), np.sin(turn))
        length = spread * rng.uniform(0.8, 1.2)
        path = shapes.branch_path(rng, start, way, length, wander=0.16)
        thick = radius * 0.42 * (1.1 - 0.6 * share)
        wood.append(shapes.tube(path, np.linspace(thick, 0.15 * thick, len(path)), (0.5, 1.0),
                                sides=7))  # fmt: skip
    size = card_m or 0.16 * height_m
    crown = shapes.crown(rng, middle, (spread, 0.5 * crown_share * height_m, spread), cards, size)
    return [MeshPart(Mesh.joined(wood), foliage.bark), MeshPart(crown, foliage.leaf)]


def bush(
    rng: np.random.Generator, foliage: Foliage, foot: ArrayLike, radius_m: float, *, cards: int = 70
) -> list[MeshPart]:
    """A round bush that sits on the ground."""
    centre = np.add(foot, (0, 0.7 * radius_m, 0))
    leaves = shapes.crown(
        rng, centre, (radius_m, 0.75 * radius_m, radius_m), cards, 0.7 * radius_m, shell=0.3
    )
    return [MeshPart(leaves, foliage.leaf)]


def tufts(
    rng: np.random.Generator,
    material: Material,
    places: ArrayLike,
    height_m: tuple[float, float],
    *,
    crossed: int = 2,
) -> MeshPart:
    """Tufts at `places` (N, 3), each of `crossed` cards."""
    cards = []
    for place in np.asarray(places, np.float64):
        height = rng.uniform(*height_m)
        turn = rng.uniform(0, 180)
        tone = rng.uniform(0.8, 1.15)
        for index in range(crossed):
            card = shapes.card(
                place, height, height, turn + 180 * index / crossed, lean=rng.normal(0, 0.08)
            )
            cards.append(card.tinted((tone, tone, tone)))
    return MeshPart(Mesh.joined(cards), material)


def scattered(
    rng: np.random.Generator, count: int, low: ArrayLike, high: ArrayLike
) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Places on flat ground between the corners `low` and `high` in (x, z)."""
    xz = rng.uniform(np.asarray(low, np.float64), np.asarray(high, np.float64), (count, 2))
    return np.stack([xz[:, 0], np.zeros(count), xz[:, 1]], axis=-1)
