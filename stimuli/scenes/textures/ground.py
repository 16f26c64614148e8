"""Textures of the ground."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

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
