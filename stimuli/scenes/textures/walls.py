"""Masonry, wood, plaster, stone, tiles and iron."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from stimuli.scenes.textures.surface_noise_and_photographs import (
    SIZE_PX,
    ByteTexture,
    Plane,
    Rgb,
    finish,
    fractal,
    ramp,
    shaded,
    stretched,
)


def masonry(
    rng: np.random.Generator,
    rows: int,
    columns: int,
    colours: Sequence[Rgb],
    mortar: Rgb = (150, 142, 130),
    *,
    joint: float = 0.06,
    rough: float = 1.0,
) -> ByteTexture:
    """Courses of blocks in running bond: brick for many rows, ashlar for few."""
    y, x = _texels(SIZE_PX)
    wobble = 0.006 * rough
    row, down = _counted((y + wobble * fractal(rng, SIZE_PX, 1.4) * 0.5) * rows, rows)
    x = x + wobble * fractal(rng, SIZE_PX, 1.4) * 0.5
    shift = 0.5 * (np.arange(rows) % 2) + 0.12 * rough * rng.uniform(-1, 1, rows)
    column, along = _counted(x * columns + shift[row], columns)
    block = row * columns + column
    block_ratio = rows / columns
    edge = np.minimum(np.minimum(down, 1 - down), np.minimum(along, 1 - along) * block_ratio)
    edge = edge + 0.012 * rough * fractal(rng, SIZE_PX, 0.9)
    inside = np.clip((edge - joint) / (0.35 * joint), 0, 1)
    tones = ramp(rng.uniform(0, 1, rows * columns), colours)
    dark = rng.normal(0, 1, rows * columns)
    grain = fractal(rng, SIZE_PX, 0.75, 8)
    stain = fractal(rng, SIZE_PX, 1.5)
    value = 1 + 0.07 * dark[block] + 0.09 * rough * grain + 0.05 * stain
    rim = np.clip((edge - joint) / (3 * joint), 0, 1)
    value *= inside * (0.86 + 0.14 * rim)
    filler = shaded(mortar, (1 - inside) * (1 + 0.10 * grain + 0.05 * stain))
    colour = np.moveaxis(tones.T[:, block], 0, -1)
    return finish(colour * value[..., None] + filler)


def planks(rng: np.random.Generator, boards: int = 6, tone: Rgb = (128, 98, 68)) -> ByteTexture:
    """Weathered boards, upright (along v)."""
    size = SIZE_PX
    y, x = _texels(size)
    board, within = _counted(x * boards, boards)
    shift = rng.uniform(0, 1, boards)[board]
    bend = ndimage.map_coordinates(
        fractal(rng, size, 1.6),
        np.broadcast_arrays((0.25 * y + shift) % 1.0 * size, (0.5 * x) * size),
        order=1,
        mode="grid-wrap",
    )
    rings = np.sin(2 * np.pi * (9 * within + 1.2 * bend + 3 * shift))
    fibres = stretched(rng, size, 40)
    value = 1 + 0.10 * rings + 0.13 * fibres + 0.14 * rng.normal(0, 1, boards)[board]
    grey = np.clip(0.35 + 0.2 * stretched(rng, size, 12), 0, 1)
    colour = shaded(tone, 1 - grey) + shaded((138.0, 132.0, 122.0), grey)
    gap = np.minimum(within, 1 - within)
    value *= np.clip(0.18 + (gap - 0.012) / 0.03, 0.18, 1)
    for _ in range(2 * boards):  # knots and nail heads
        cx, cy, radius = rng.uniform(0, 1), rng.uniform(0, 1), rng.uniform(0.006, 0.016)
        column, across = _around(cx, 7 * radius, size)
        row, down = _around(cy, 7 * radius / 0.6, size)
        far = np.hypot(across[None, :], 0.6 * down[:, None]) / radius
        value[np.ix_(row, column)] *= 1 - 0.55 * np.exp(-(far**2))
    return finish(colour * value[..., None])


def _texels(size: int) -> tuple[Plane, Plane]:
    """Places of texels, in textures: a column of places and a row of them."""
    place = np.arange(size) / size
    return place[:, None], place[None, :]


def _counted(place: Plane, count: int) -> tuple[NDArray[np.int32], Plane]:
    """Index, among `count` that repeat, of the piece that `place` lies in, and how far into it."""
    whole = np.floor(place)
    return whole.astype(np.int32) % count, place - whole


def _around(place: float, reach: float, size: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Texels within `reach` of `place`, both in textures, and how far from it they are."""
    texel = np.arange(np.floor((place - reach) * size), np.ceil((place + reach) * size) + 1)
    return texel.astype(np.int64) % size, texel / size - place


def bark(rng: np.random.Generator, tone: Rgb = (92, 74, 58)) -> ByteTexture:
    """Furrowed bark, upright (along v)."""
    plates = stretched(rng, SIZE_PX, 7) + 0.35 * stretched(rng, SIZE_PX, 3)
    furrow = np.exp(-((plates / 0.35) ** 2))
    fine = fractal(rng, slope=0.7, coarsest=12)
    value = 1.05 - 0.62 * furrow + 0.16 * fine + 0.08 * fractal(rng, slope=1.5)
    lichen = 0.5 * np.clip(fractal(rng, slope=1.2) - 1.1, 0, 1)
    return finish(shaded(tone, value * (1 - lichen)) + shaded((128.0, 136.0, 104.0), lichen))


def plaster(rng: np.random.Generator, tone: Rgb = (206, 190, 164)) -> ByteTexture:
    """Rendered wall with stains and fine cracks."""
    cracks = np.exp(-((fractal(rng, slope=1.3) / 0.018) ** 2))
    value = 1 + 0.045 * fractal(rng, slope=0.8) + 0.07 * fractal(rng, slope=1.5) - 0.18 * cracks
    return finish(shaded(tone, value))


def stone(rng: np.random.Generator, tone: Rgb = (176, 166, 148)) -> ByteTexture:
    """Smooth cut stone with veins, pits and rain marks."""
    veins = np.exp(-((fractal(rng, slope=1.4) / 0.06) ** 2))
    pits = np.clip(fractal(rng, slope=0.5, coarsest=20) - 1.6, 0, 1)
    rain = stretched(rng, SIZE_PX, 18)
    value = 1 + 0.06 * fractal(rng, slope=0.9) - 0.10 * veins - 0.28 * pits + 0.05 * rain
    hue = 4 * fractal(rng, slope=1.3)
    return finish(shaded(tone, value) + shaded((1.0, 0.4, -0.6), hue))


def roof_tiles(rng: np.random.Generator) -> ByteTexture:
    """Clay tiles in rows, each lapping over the next."""
    rows, columns, size = 8, 12, SIZE_PX
    y, x = _texels(size)
    row, down = _counted(y * rows, rows)
    column, along = _counted(x * columns + 0.5 * (row % 2), columns)
    bulge = np.sin(np.pi * along)
    tone = rng.normal(0, 1, (rows, columns))[row, column]
    value = (0.55 + 0.5 * bulge) * (0.5 + 0.5 * np.clip(down / 0.22, 0, 1))
    value *= 1 + 0.10 * tone + 0.10 * fractal(rng, slope=0.8)
    return finish(shaded((168.0, 92.0, 64.0), value))


def iron(rng: np.random.Generator) -> ByteTexture:
    """Dark painted iron with rust."""
    rust = np.clip(0.3 + 0.5 * fractal(rng, slope=1.1), 0, 1)
    colour = shaded((44.0, 46.0, 48.0), 1 - rust) + shaded((104.0, 62.0, 38.0), rust)
    return finish(colour * (1 + 0.12 * fractal(rng, slope=0.6))[..., None])
