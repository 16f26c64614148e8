"""Textures of ground and sky."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from stimuli.scenes.textures.foliage import scatter
from stimuli.scenes.textures.surface_noise_and_photographs import (
    SIZE_PX,
    Colour,
    Texture,
    finish,
    fractal,
    photograph,
    ramp,
    shaded,
)


def lawn(rng: np.random.Generator, dry: float = 0.0) -> Texture:
    """Short grass seen from above; `dry` in [0, 1] turns it yellow."""
    blades = photograph("grass")
    patches = fractal(rng, slope=1.6)
    value = np.clip(0.46 + 0.17 * blades + 0.05 * patches, 0, 1)
    green = ramp(value, [(22, 32, 10), (62, 84, 28), (104, 128, 48), (160, 172, 92)])
    straw = ramp(value, [(42, 34, 16), (112, 98, 48), (164, 148, 84), (214, 202, 150)])
    share = np.clip(dry + 0.22 * patches + 0.08 * fractal(rng, slope=0.8), 0, 1)[..., None]
    return finish(green * (1 - share) + straw * share)


def pebbles(rng: np.random.Generator, colours: Sequence[Colour] | None = None) -> Texture:
    """Gravel."""
    stones = photograph("gravel")
    value = np.clip(0.45 + 0.19 * stones + 0.04 * fractal(rng), 0, 1)
    base = ramp(value, colours or [(28, 24, 20), (98, 90, 80), (150, 141, 128), (226, 220, 210)])
    return finish(base + shaded((1.0, 0.3, -0.8), 9 * fractal(rng, slope=0.9)))


def earth(rng: np.random.Generator) -> Texture:
    """Forest floor: soil, needles, and dead leaves."""
    fine = photograph("grass") * 0.6 + fractal(rng, slope=0.7) * 0.6
    value = np.clip(0.42 + 0.17 * fine, 0, 1)
    colour = ramp(value, [(20, 14, 8), (66, 48, 30), (108, 82, 52), (160, 132, 90)])
    litter, mask = scatter(
        rng, SIZE_PX, 900, (14, 26), [(128, 82, 40), (150, 104, 54), (96, 62, 32), (168, 130, 72)]
    )
    colour = np.where(mask[..., None] > 0.5, litter, colour)
    moss = 0.6 * np.clip(fractal(rng, slope=1.5) - 0.7, 0, 1)
    return finish(colour * (1 - moss)[..., None] + shaded((64.0, 84.0, 30.0), moss))


def panorama(
    rng: np.random.Generator,
    zenith: Colour = (82, 128, 190),
    horizon: Colour = (196, 212, 226),
    cloud: Colour = (246, 246, 244),
    cover: float = 0.45,
) -> NDArray[np.uint8]:
    """A sky with clouds, longitude x latitude, shape (1024, 2048, 3)."""
    height, width = 1024, 2048
    y = (np.arange(height) + 0.5) / height
    up = np.clip(np.cos(np.pi * y), 0, 1)
    clear = np.asarray(horizon) + np.subtract(zenith, horizon) * up[:, None] ** 0.55
    sky = np.repeat(np.rint(clear.clip(0, 255)).astype(np.uint8)[:, None], width, axis=1)
    # Clouds lie on a level sheet: they crowd towards the horizon, and end above it.
    up = up[up > 0.07, None]
    turn = 2 * np.pi * (np.arange(width) + 0.5)[None, :] / width
    reach = np.sqrt(1 - up**2) / up
    sheet = fractal(rng, 1024, 1.55)
    place = [(reach * np.sin(turn)) * 110 % 1024, (reach * np.cos(turn)) * 110 % 1024]
    dense = ndimage.map_coordinates(sheet, place, order=1, mode="grid-wrap")
    thick = np.clip((dense + 2.2 * cover - 1.0) / 1.1, 0, 1) ** 0.8
    thick *= np.clip((up - 0.07) * 7, 0, 1)
    shade = thick * np.clip(1.02 - 0.16 * thick + 0.05 * dense, 0, 1.05)
    for channel, tone in enumerate(cloud):
        colour = clear[: len(up), None, channel] * (1 - thick) + tone * shade
        sky[: len(up), :, channel] = np.rint(colour.clip(0, 255))
    return sky
