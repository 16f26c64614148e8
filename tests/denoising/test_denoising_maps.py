"""Moment maps: by hand, as metamers of clean pictures, GPU against numpy."""

import numpy as np
import pytest
from skimage import data

from pipeline.denoising.gpu import DenoisePass, map_layers
from pipeline.denoising.maps import MOST_SLOPE, MomentMaps, Sampling, maps_of, metamer_of
from pipeline.errors import InputError
from pipeline.foveation import reference
from pipeline.foveation.geometry import Flat
from pipeline.foveation.pooling import MetamerSettings, Pooling, Pools
from pipeline.foveation.reference import metamer

HEIGHT, WIDTH = 75, 101


@pytest.fixture(scope="module")
def picture():
    return (data.astronaut()[60 : 60 + HEIGHT, 120 : 120 + WIDTH] / np.float32(255)).astype(
        np.float32
    )


def pools_at(gaze_px, height=HEIGHT, width=WIDTH):
    return Pools(Flat(40).of(width, height), gaze_px, Pooling())


@pytest.mark.parametrize(
    "wrong", [{"halvings": 11}, {"near_deg": 5, "far_deg": 5}, {"far_deg": float("nan")}]
)
def test_impossible_samplings_are_refused(wrong):
    with pytest.raises(InputError):
        Sampling(**wrong)


@pytest.mark.parametrize("gaze_px", [(40.0, 30.0), (0.0, 0.0), (-60.0, 20.0)])
def test_moments_of_a_clean_picture_make_its_metamer(picture, gaze_px, monkeypatch):
    """Gaze on the picture, in a corner, and off it. The maps have no shape of colours.

    Where the change fades in, maps hold the faded base: noise is bound a little otherwise.
    """
    monkeypatch.setattr(reference, "reach_of", lambda *_: (np.full(3, 9.0), np.full(3, 9.0)))
    pools = pools_at(gaze_px)
    maps = maps_of(picture, pools)

    assert np.abs(maps.slopes).max() < MOST_SLOPE
    expected, found = metamer(picture, pools, MetamerSettings(), 3), metamer_of(maps, pools, 3)
    np.testing.assert_allclose(found, expected, atol=1e-3)
    whole = pools.fade() == 1
    assert np.abs(found - expected)[whole].max() < 1e-6
    again = MomentMaps.unpacked(maps.base.astype(np.float32), maps.packed().astype(np.float32))
    assert np.abs(metamer_of(again, pools, 3) - found).max() < 1e-4


def test_the_fovea_of_the_maps_is_the_picture_and_loses_nothing(picture):
    pools = pools_at((40.0, 30.0))
    maps = maps_of(picture, pools)
    fovea = pools.fade() == 0

    assert (maps.base[fovea] == picture[fovea]).all()
    blocks = pools.eccentricity_deg(2) < 1
    assert blocks.any()
    assert (maps.deviations[blocks] == 0).all()


def test_a_grey_picture_has_no_moments():
    maps = maps_of(np.full((40, 48, 3), 0.4, np.float32), pools_at((0, 0), 40, 48))

    assert np.abs(maps.base - 0.4).max() < 1e-6
    assert maps.deviations.max() < 1e-6
    assert np.abs(maps.packed()).max() < 1e-5


def test_what_no_picture_can_have_is_brought_into_range():
    values = np.zeros((2, 2, 5))
    values[..., :3], values[..., 3:] = -1.0, 9.0

    maps = MomentMaps.unpacked(np.full((8, 8, 3), 1.5), values)

    assert (maps.base == 1).all()
    assert (maps.deviations == 0).all()
    assert (maps.slopes == MOST_SLOPE).all()


def test_layers_hold_bands_and_both_slopes(rng):
    maps = MomentMaps(
        np.zeros((8, 12, 3)), rng.uniform(0, 1, (2, 3, 18)), rng.uniform(-1, 1, (2, 3, 6, 2))
    )
    layers = map_layers(maps)

    assert layers.shape == (6 + 2, 2, 3, 4)
    assert np.allclose(layers[5, ..., :3], maps.deviations[..., 15:])
    assert np.allclose(layers[5, ..., 3], maps.slopes[:, :, 5, 0])
    assert np.allclose(layers[6, ..., 2], maps.slopes[:, :, 2, 1])
    assert np.allclose(layers[7, ..., 1], maps.slopes[:, :, 5, 1])


@pytest.mark.parametrize("gaze_px", [(40.0, 30.0), (0.0, 75.0)])
def test_passes_make_the_metamer_that_numpy_makes(gl_context, picture, gaze_px):
    pools = pools_at(gaze_px)
    maps = maps_of(picture, pools)
    passes = DenoisePass(gl_context, pools.geometry, pools.pooling, maps.levels)
    found = [passes.apply(maps, gaze_px, seed=seed) for seed in (3, 4)]
    passes.release()

    for seed, shown in zip((3, 4), found, strict=True):
        # Weights are half floats, noise is the same: half a step of 255.
        assert np.abs(shown - metamer_of(maps, pools, seed)).max() < 0.5 / 255
    assert np.abs(found[0] - found[1]).max() > 0.02


def test_passes_refuse_maps_of_another_size(gl_context, picture):
    pools = pools_at((40.0, 30.0))
    maps = maps_of(picture, pools)
    passes = DenoisePass(gl_context, Flat(40).of(64, 64), pools.pooling, maps.levels)
    with pytest.raises(ValueError, match="one size"):
        passes.load(maps)
    passes.release()
