"""Bytes of a baked texture that a picture touches.

A mask has a bit for every texel of every plane. A look-up touches the texels that it weighs by more
than nothing: up to four at a resolution, at two resolutions. What is counted are distinct texels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.frame import Bools
from pipeline.textures.bake import Layout
from pipeline.textures.reference import Fragments

PlaneKey = tuple[int | None, int]
"""Level (None: colour) and halvings of a plane."""

COLOUR_BYTES = 4
"""Bytes of a texel, as GPUs keep it."""
_CHUNK = 1 << 21  # fragments at a time


@dataclass(frozen=True, eq=False)
class TextureFootprint:
    """Texels that a picture reads: a mask (h, w) for each plane of which it reads anything."""

    masks: Mapping[PlaneKey, Bools]

    def bytes_of_texels(self, moment_bytes: int) -> int:
        """Bytes read, with so many bytes of moments a level and texel."""
        return sum(
            int(mask.sum()) * _texel_bytes(key, moment_bytes) for key, mask in self.masks.items()
        )


def touched(layout: Layout, fragments: Fragments, *, noise: bool) -> TextureFootprint:
    """Mark what is read for `fragments`; of moments nothing without `noise`.

    A fragment reads moments where it reads colour, of every level that it has lost: those from its
    pixel's on that are finer than the resolution read. So fragments are sorted by that first level.
    """
    place = fragments.place_px.reshape(-1, 2)
    rho, eta = fragments.rho.ravel(), fragments.eta.ravel()
    by_first: dict[int, dict[int, Bools]] = {}
    for start in range(0, len(rho), _CHUNK):
        part = slice(start, start + _CHUNK)
        lod = np.clip(rho[part] + eta[part], 0, layout.halvings)
        first = np.clip(np.floor(rho[part]), 0, layout.halvings).astype(int)
        first[lod <= rho[part]] = layout.halvings  # nothing is lost
        for value in np.unique(first).tolist():
            chosen = first == value
            _mark(by_first.setdefault(value, {}), layout, place[part][chosen], lod[chosen])
    masks: dict[PlaneKey, Bools] = {}
    for value, found in by_first.items():
        for r, mask in found.items():
            levels = range(value, r) if noise else ()
            for key in ((None, r), *((level, r) for level in levels)):
                masks[key] = masks[key] | mask if key in masks else mask
    return TextureFootprint(masks)


def saved(foveated: int, unfoveated: int) -> float:
    """Share of the bytes that foveation saves; below 0 where it needs more."""
    return 1 - foveated / unfoveated


def _mark(
    masks: dict[int, Bools],
    layout: Layout,
    place: NDArray[np.floating],
    lod: NDArray[np.floating],
) -> None:
    """Mark texels by resolution."""
    for r in range(layout.halvings + 1):
        here = np.abs(lod - r) < 1
        if not here.any():
            continue
        height, width = layout.size(r)
        # A frame of one texel more around it takes what lies beyond the border, until `_folded`.
        framed = np.zeros((height + 2, width + 2), bool)
        at = place[here] * np.float32(0.5**r) - np.float32(0.5)
        corner = np.floor(at)
        x, y = (at > corner).T
        first = corner.clip(-1, (width, height)).astype(np.int64) + 1
        first[:, 0] = np.minimum(first[:, 0], width)
        first[:, 1] = np.minimum(first[:, 1], height)
        index = first[:, 1] * (width + 2) + first[:, 0]
        flat = framed.reshape(-1)
        flat[index] = True
        flat[index[x] + 1] = True
        flat[index[y] + width + 2] = True
        flat[index[x & y] + width + 3] = True
        folded = _folded(framed, wraps=layout.wraps)
        masks[r] = masks[r] | folded if r in masks else folded


def _folded(framed: Bools, *, wraps: bool) -> Bools:
    """Look-ups beyond the border read the texels at it, or at the other side."""
    left, right = (-2, 1) if wraps else (1, -2)
    framed[:, left] |= framed[:, 0]
    framed[:, right] |= framed[:, -1]
    framed[1] |= framed[0]
    framed[-2] |= framed[-1]
    return framed[1:-1, 1:-1]


def _texel_bytes(key: PlaneKey, moment_bytes: int) -> int:
    return COLOUR_BYTES if key[0] is None else moment_bytes
