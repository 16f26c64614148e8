"""A page that shows a metamer to the mouse, or to a finger: one file, which asks nobody."""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.conditions import create_condition
from pipeline.foveation.geometry import Flat, Viewing
from pipeline.foveation.page_passes import check_condition, page_passes
from pipeline.named_classes import Choice
from protocols.blocks import html_page
from protocols.disk.whole_file import write_whole
from stimuli.media.gaze_and_display import width_deg
from stimuli.media.moving import shrunk

LONGEST_PX = 512
"""Longer edge of the picture, unless another is asked for."""
MOST_PX = LONGEST_PX**2
"""So a page has 6 MB at most."""
MANTISSA_BITS = 14
"""Bits of what is baked but `WHOLE`: a metamer changes by a tenth of 1/255 at most."""
WHOLE = "powers"
"""Texture with 24 bits: where a pool has two colours its third and fourth moments nearly cancel."""


def check_page(viewing: Viewing, choice: Choice) -> None:
    """Require what a page can show: a flat picture, by the method metamer.

    Raises
    ------
    InputError
        Of a panorama, or another method.
    """
    check_condition(create_condition(choice.name, choice.parameters), choice.name)
    if not isinstance(viewing, Flat):
        raise InputError(
            "a page shows a flat picture (got a panorama); leave --panorama out, or give --animate"
        )


def write_page(
    path: Path,
    name: str,
    colour: NDArray[np.float32],
    viewing: Viewing,
    choice: Choice,
    *,
    seed: int,
    longest_px: int = LONGEST_PX,
) -> tuple[int, int, int]:
    """Write the page of a picture of 8 bits, scaled down to `longest_px` and `MOST_PX`.

    Parameters
    ----------
    name : str
        What the page is called.
    colour : ndarray of shape (H, W, 3)
        Encoded R'G'B' in [0, 1].

    Returns
    -------
    width, height, bytes
        Of its picture, and of the file.

    Raises
    ------
    InputError
        If a page cannot show it: see `check_page`.
    """
    check_page(viewing, choice)
    condition = check_condition(create_condition(choice.name, choice.parameters), choice.name)
    high, wide = sorted(colour.shape[:2])
    small, seen = shrunk(colour, viewing, min(longest_px, math.isqrt(MOST_PX * wide // high)))
    assert isinstance(seen, Flat)
    height, width = small.shape[:2]
    geometry = seen.of(width, height)
    passes = page_passes(np.rint(255 * small).astype(np.uint8), geometry, condition, seed)
    told = {
        "width": width,
        "height": height,
        "centre": geometry.centre_px,
        "distance": geometry.distance_px,
        "textures": passes.textures,
        "pulled": {key: one.shape[2::-1] for key, one in passes.pulled.items()},
        "programs": passes.programs,
        "once": passes.once,
        "always": passes.always,
    }
    words = json.dumps(told, separators=(",", ":")).encode()
    parts = (words, passes.source.tobytes(), *_planes(passes.pulled))
    packed = [base64.b64encode(zlib.compress(part, 9)).decode("ascii") for part in parts]
    text = html_page(
        f"{name}: a metamer that follows the mouse", "stimuli/foveate/metamer_page.html",
        heading=name, width=width, height=height, label=choice.label, seed=seed,
        wide_deg=width_deg(geometry),
        parts=packed,
    )  # fmt: skip
    data = text.encode()
    write_whole(path, data)
    return width, height, len(data)


def _planes(pulled: Mapping[str, NDArray[np.float32]]) -> list[bytes]:
    """The bytes of all numbers, the highest ones first: what is alike lies side by side."""
    cut = np.uint32(23 - MANTISSA_BITS)
    every = []
    for name, numbers in pulled.items():
        bits = numbers.ravel().view(np.uint32)
        if not name.startswith(WHOLE):
            bits = (bits + (np.uint32(1) << (cut - np.uint32(1)))) >> cut << cut
        every.append(bits)
    all_bits = np.concatenate(every)
    return [(all_bits >> np.uint32(shift)).astype(np.uint8).tobytes() for shift in (24, 16, 8, 0)]
