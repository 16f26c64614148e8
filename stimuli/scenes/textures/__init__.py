"""Surfaces for the built-in scenes: photographs that come with scikit-image, and noise.

Every texture repeats without a seam, is uint8 of shape (N, N, 4) in encoded R'G'B' with
coverage, and is a pure function of the generator it is given.
"""

from stimuli.scenes.textures.foliage import blades, earth, lawn, leaves, panorama, pebbles
from stimuli.scenes.textures.surface_noise_and_photographs import (
    SIZE_PX,
    ByteTexture,
    Rgb,
    finish,
    fractal,
    photograph,
    ramp,
)
from stimuli.scenes.textures.walls import bark, iron, masonry, planks, plaster, roof_tiles, stone

__all__ = [
    "SIZE_PX",
    "ByteTexture",
    "Rgb",
    "bark",
    "blades",
    "earth",
    "finish",
    "fractal",
    "iron",
    "lawn",
    "leaves",
    "masonry",
    "panorama",
    "pebbles",
    "photograph",
    "planks",
    "plaster",
    "ramp",
    "roof_tiles",
    "stone",
]
