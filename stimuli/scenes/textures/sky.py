"""Skies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from stimuli.scenes.textures.surface_noise_and_photographs import (
    Colour,
    fractal,
)


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
