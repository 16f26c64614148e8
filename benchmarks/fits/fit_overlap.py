"""Measure what bands of the pyramid find of a texture's noise, and write `overlap.json`.

    script/bench fit_overlap

Independent noise in one band of one level is drawn at a fine resolution, halved, and analysed.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.features.reference import analyse
from pipeline.textures import bake as layout
from pipeline.textures.bake import Layout
from pipeline.textures.surface_noise import REACH, STAGES, surface_noise

TARGET = Path(layout.__file__).with_name("overlap.json")
EDGE_PX = 256  # of the picture that is analysed
LEVEL = REACH + 2  # of the texture: an inner one
SEEDS = 4


def measured() -> NDArray[np.float64]:
    """The overlap, as `surface_noise.fitted_overlap` gives it."""
    y, x = np.mgrid[:EDGE_PX, :EDGE_PX] + 0.5
    place = np.stack([x, y], axis=-1)
    found = np.zeros((STAGES, 2 * REACH + 1, 3, 3))
    for seed in range(SEEDS):
        noise = surface_noise(seed, Layout(2048, 2048))
        for stage in range(STAGES):
            for d in range(-REACH, REACH + 1):
                drawn = noise.at(LEVEL + d, place * 2 ** (LEVEL - stage))
                bands = analyse(drawn, stage + 1).bands[stage]
                found[stage, REACH + d] += (bands**2).mean(axis=(0, 1)) / SEEDS
    # Rows and columns are alike.
    turned = [0, 2, 1]
    return np.asarray(0.5 * (found + found[:, :, turned][..., turned]))


def main(argv: Sequence[str] | None = None) -> None:
    """Measure, write and print."""
    argparse.ArgumentParser(prog="script/bench fit_overlap", description=__doc__).parse_args(argv)
    overlap = measured().round(4)
    rows = ",\n".join(f" {json.dumps(stage)}" for stage in overlap.tolist())
    TARGET.write_text(f'{{"overlap": [\n{rows}\n]}}\n', encoding="utf-8")
    print(overlap)
