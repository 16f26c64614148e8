"""The cut through the gaze on the GPU against its twin."""

import numpy as np
import pytest

from pipeline.foveation.drawn import bisected, cut_shares
from pipeline.foveation.geometry import Flat
from pipeline.foveation.picture_pass import CutPass
from pipeline.gl.texture import create_texture, read_back, texture_from

GEOMETRY = Flat(width_deg=40).of(96, 64)


@pytest.mark.parametrize(("angle_deg", "gaze_px"), [(0.0, (48.0, 32.0)), (217.0, (12.5, 60.25))])
def test_a_cut_is_its_twin_and_each_side_its_picture_bit_for_bit(gl_context, angle_deg, gaze_px):
    rng = np.random.default_rng(1)
    first, second = (rng.random((64, 96, 4), np.float32) for _ in range(2))
    textures = [texture_from(gl_context, one, "rgba32f") for one in (first, second)]
    target = create_texture(gl_context, (96, 64), "rgba32f")
    cut = CutPass(gl_context, GEOMETRY)

    cut(*textures, target, gaze_px, angle_deg=angle_deg, ramp_deg=2.0)
    found = np.asarray(read_back(target))
    for made in (cut, target, *textures):
        made.release()

    wanted = bisected(first, second, GEOMETRY, gaze_px, angle_deg=angle_deg, ramp_deg=2.0)
    np.testing.assert_allclose(found, wanted, atol=2e-4)
    share = cut_shares(GEOMETRY, gaze_px, angle_deg, 2.01)
    np.testing.assert_array_equal(found[share >= 1], first[share >= 1])
    np.testing.assert_array_equal(found[share <= 0], second[share <= 0])
    assert min((share >= 1).mean(), (share <= 0).mean()) > 0.05
