"""The benchmark of metameric's switches: its measure of flicker."""

from __future__ import annotations

import numpy as np

from benchmarks.variants import CLIP_STEP_PX, VARIANTS, Clip, flicker
from pipeline.frame import WarpedFrame
from pipeline.synthesis.settings import MetamericSettings


def frame(colour, hole):
    size = hole.shape
    return WarpedFrame(
        colour.astype(np.float32),
        np.full(size, 5, np.float32),
        hole,
        np.zeros((*size, 2), np.float32),
    )


def wave(index, *, still):
    """A smooth texture that moves with the background, or stays on the screen."""
    x = np.arange(64) - (0 if still else CLIP_STEP_PX * index)
    return np.broadcast_to(0.5 + 0.3 * np.sin(x / 2)[None, :, None], (64, 64, 3)).astype(np.float32)


def test_flicker_is_nought_where_texture_moves_with_the_background_only():
    hole = np.zeros((64, 64), bool)
    hole[16:48, 16:48] = True
    clip = Clip([frame(wave(k, still=False), hole) for k in range(4)], [])

    assert flicker([wave(k, still=False) for k in range(4)], clip) < 1e-3
    assert flicker([wave(k, still=True) for k in range(4)], clip) > 0.05  # the screen door


def test_every_variant_has_a_name_of_its_own_and_the_first_is_the_default():
    labels = [variant.label for variant in VARIANTS]

    assert len(set(labels)) == len(labels)
    assert VARIANTS[0].settings == MetamericSettings()
