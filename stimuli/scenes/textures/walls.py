"""Masonry, wood, plaster, stone, tiles and iron."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from stimuli.scenes.textures.base import (
    SIZE_PX,
    Colour,
    Texture,
    finish,
    fractal,
    ramp,
    stretched,
)


def masonry(
    rng: np.random.Generator,
    rows: int,
    columns: int,
    colours: Sequence[Colour],
    mortar: Colour = (150, 142, 130),
    *,
    joint: float = 0.06,
    rough: float = 1.0,
    size: int = SIZE_PX,
) -> Texture:
    """Courses of blocks in running bond: brick for many rows, ashlar for few."""
    y, x = np.mgrid[:size, :size] / size
    wobble = 0.006 * rough
    y = y + wobble * fractal(rng, size, 1.4) * 0.5
    x = x + wobble * fractal(rng, size, 1.4) * 0.5
    row = np.floor(y * rows).astype(int) % rows
    offset = 0.5 * (row % 2) + 0.12 * rough * rng.uniform(-1, 1, rows)[row]
    across = x * columns + offset
    column = np.floor(across).astype(int) % columns
    down, along = y * rows % 1.0, across % 1.0
    block_ratio = rows / columns
    edge = np.minimum(np.minimum(down, 1 - down), np.minimum(along, 1 - along) * block_ratio)
    edge = edge + 0.012 * rough * fractal(rng, size, 0.9)
    inside = np.clip((edge - joint) / (0.35 * joint), 0, 1)
    tone = rng.uniform(0, 1, (rows, columns))[row, column]
    dark = rng.normal(0, 1, (rows, columns))[row, column]
    grain = fractal(rng, size, 0.75, 8)
    stain = fractal(rng, size, 1.5)
    colour = (
        ramp(tone, colours) * (1 + 0.07 * dark + 0.09 * rough * grain + 0.05 * stain)[..., None]
    )
    rim = np.clip((edge - joint) / (3 * joint), 0, 1)
    colour *= (0.86 + 0.14 * rim)[..., None]
    filler = np.asarray(mortar) * (1 + 0.10 * grain + 0.05 * stain)[..., None]
    return finish(inside[..., None] * colour + (1 - inside[..., None]) * filler)


def planks(rng: np.random.Generator, boards: int = 6, tone: Colour = (128, 98, 68)) -> Texture:
    """Weathered boards, upright (along v)."""
    size = SIZE_PX
    y, x = np.mgrid[:size, :size] / size
    board = np.floor(x * boards).astype(int)
    within = x * boards % 1.0
    shift = rng.uniform(0, 1, boards)[board]
    bend = ndimage.map_coordinates(
        fractal(rng, size, 1.6),
        [(0.25 * y + shift) % 1.0 * size, (0.5 * x) * size],
        order=1,
        mode="grid-wrap",
    )
    rings = np.sin(2 * np.pi * (9 * within + 1.2 * bend + 3 * shift))
    fibres = stretched(rng, size, 40)
    value = 1 + 0.10 * rings + 0.13 * fibres + 0.14 * rng.normal(0, 1, boards)[board]
    grey = np.clip(0.35 + 0.2 * stretched(rng, size, 12), 0, 1)[..., None]
    colour = np.asarray(tone) * (1 - grey) + np.array([138.0, 132.0, 122.0]) * grey
    colour = colour * value[..., None]
    gap = np.minimum(within, 1 - within)
    colour *= np.clip(0.18 + (gap - 0.012) / 0.03, 0.18, 1)[..., None]
    for _ in range(2 * boards):  # knots and nail heads
        cx, cy, radius = rng.uniform(0, 1), rng.uniform(0, 1), rng.uniform(0.006, 0.016)
        far = np.hypot((x - cx + 0.5) % 1 - 0.5, ((y - cy + 0.5) % 1 - 0.5) * 0.6) / radius
        colour *= (1 - 0.55 * np.exp(-(far**2)))[..., None]
    return finish(colour)


def bark(rng: np.random.Generator, tone: Colour = (92, 74, 58)) -> Texture:
    """Furrowed bark, upright (along v)."""
    plates = stretched(rng, SIZE_PX, 7) + 0.35 * stretched(rng, SIZE_PX, 3)
    furrow = np.exp(-((plates / 0.35) ** 2))
    fine = fractal(rng, slope=0.7, coarsest=12)
    value = 1.05 - 0.62 * furrow + 0.16 * fine + 0.08 * fractal(rng, slope=1.5)
    colour = np.asarray(tone) * value[..., None]
    lichen = np.clip(fractal(rng, slope=1.2) - 1.1, 0, 1)[..., None]
    return finish(colour * (1 - 0.5 * lichen) + 0.5 * lichen * np.array([128.0, 136.0, 104.0]))


def plaster(rng: np.random.Generator, tone: Colour = (206, 190, 164)) -> Texture:
    """Rendered wall with stains and fine cracks."""
    cracks = np.exp(-((fractal(rng, slope=1.3) / 0.018) ** 2))
    value = 1 + 0.045 * fractal(rng, slope=0.8) + 0.07 * fractal(rng, slope=1.5) - 0.18 * cracks
    return finish(np.asarray(tone) * value[..., None])


def stone(rng: np.random.Generator, tone: Colour = (176, 166, 148)) -> Texture:
    """Smooth cut stone with veins, pits and rain marks."""
    veins = np.exp(-((fractal(rng, slope=1.4) / 0.06) ** 2))
    pits = np.clip(fractal(rng, slope=0.5, coarsest=20) - 1.6, 0, 1)
    rain = stretched(rng, SIZE_PX, 18)
    value = 1 + 0.06 * fractal(rng, slope=0.9) - 0.10 * veins - 0.28 * pits + 0.05 * rain
    hue = 4 * fractal(rng, slope=1.3)[..., None] * np.array([1.0, 0.4, -0.6])
    return finish(np.asarray(tone) * value[..., None] + hue)


def roof_tiles(rng: np.random.Generator) -> Texture:
    """Clay tiles in rows, each lapping over the next."""
    rows, columns, size = 8, 12, SIZE_PX
    y, x = np.mgrid[:size, :size] / size
    row = np.floor(y * rows).astype(int)
    across = x * columns + 0.5 * (row % 2)
    column = np.floor(across).astype(int) % columns
    down, along = y * rows % 1.0, across % 1.0
    bulge = np.sin(np.pi * along)
    tone = rng.normal(0, 1, (rows, columns))[row, column]
    value = (0.55 + 0.5 * bulge) * (0.5 + 0.5 * np.clip(down / 0.22, 0, 1))
    value *= 1 + 0.10 * tone + 0.10 * fractal(rng, slope=0.8)
    return finish(np.array([168.0, 92.0, 64.0]) * value[..., None])


def iron(rng: np.random.Generator) -> Texture:
    """Dark painted iron with rust."""
    rust = np.clip(0.3 + 0.5 * fractal(rng, slope=1.1), 0, 1)[..., None]
    colour = (1 - rust) * np.array([44.0, 46.0, 48.0]) + rust * np.array([104.0, 62.0, 38.0])
    return finish(colour * (1 + 0.12 * fractal(rng, slope=0.6))[..., None])
