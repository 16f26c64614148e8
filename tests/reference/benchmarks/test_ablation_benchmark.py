"""Every correction that the ablation switches off is off, alone, and on again afterwards."""

import numpy as np
import pytest

from benchmarks.ablation import CORRECTIONS, DEFAULT, PRINTED, View, cropped, fills, table
from benchmarks.paper import Row
from pipeline.frame import WarpedFrame
from pipeline.inpaint.reference import nearest_depth_m
from pipeline.quality import Quality
from pipeline.synthesis.reference import metameric_fill
from pipeline.synthesis.settings import MetamericSettings


def view(rng) -> View:
    """A wide hole behind a block before a soft texture, at the frame's border too."""
    soft = np.cumsum(np.cumsum(rng.standard_normal((96, 128, 3)), axis=0), axis=1)
    colour = (0.5 + 0.1 * soft / soft.std()).clip(0, 1).astype(np.float32)
    depth = np.full((96, 128), 8.0, np.float32)
    depth[20:80, :40] = 2.0
    hole = np.zeros((96, 128), bool)
    hole[20:80, 40:90] = True
    hole[0:4, 100:] = True
    colour[hole] = 0
    flow = np.zeros((96, 128, 2), np.float32)
    return View(WarpedFrame(colour, depth, hole, flow), colour, hole)


@pytest.mark.slow
def test_each_correction_changes_the_fill_and_leaves_the_default_as_it_was(rng):
    one = view(rng)
    found = dict(fills(one))

    default = metameric_fill(
        one.warped, MetamericSettings(), seed=1, z_near_m=nearest_depth_m(one.warped.depth_m)
    ).colour.astype(np.float32)
    np.testing.assert_array_equal(found[DEFAULT], default)
    for label, filled in found.items():
        assert label == DEFAULT or (filled != default).any(), label
        np.testing.assert_array_equal(filled[~one.mask], one.warped.colour[~one.mask])
    assert {f"without {name}" for name in CORRECTIONS} | {PRINTED} <= set(found)


def test_a_crop_holds_the_most_holes(rng):
    part = cropped(view(rng), (64, 48))
    assert part.mask.shape == (48, 64)
    assert part.mask.mean() > 0.7
    np.testing.assert_array_equal(part.mask, part.warped.hole)


def test_the_table_says_means_and_the_range_of_the_change():
    def row(error: float) -> Row:
        return Row(Quality(20.0, 0.5, 1.0, error), None)

    text = table(
        {"a": {DEFAULT: row(0.2), "x": row(0.3)}, "b": {DEFAULT: row(0.4), "x": row(0.35)}}
    )

    assert "| metameric | 20.00 | 0.500 | 1.00 | 0.3000 |  | +0.0000 to +0.0000 |" in text
    assert "| x | 20.00 | 0.500 | 1.00 | 0.3250 |  | -0.0500 to +0.1000 |" in text
