"""The noise of a seed on the GPU is the twin's, number by number."""

import numpy as np
import pytest

from pipeline.foveation.chain import chain_of
from pipeline.foveation.displacement import DisplacementSettings, field_noise
from pipeline.foveation.displacement_gpu import DisplacementPass
from pipeline.foveation.geometry import Flat
from pipeline.foveation.noise_plane import GRAIN, noise_tile, panorama_noise
from pipeline.foveation.picture_pass import screen_noise
from pipeline.gl.texture import read_back

SEED = 2**62 + 5  # both halves of it count


def steps_of(noise, levels):
    """Values of the texture, as layer, row, column, band, row, column: (H, W, 3 * levels)."""
    texture = noise.texture
    found = np.frombuffer(texture.read(), np.int8)
    found = found.reshape(texture.layers, texture.height, texture.width, 4, 2, 2)
    pixels = found.transpose(1, 4, 2, 5, 0, 3)
    return pixels.reshape(2 * texture.height, 2 * texture.width, -1)[..., : 3 * levels]


@pytest.mark.parametrize(("edge", "levels"), [(256, 1), (256, 4), (256, 6), (512, 5)])
def test_a_tile_is_the_twins_number_by_number(gl_context, edge, levels):
    noise = screen_noise(gl_context, (edge, edge // 2), levels, wraps=False)
    for seed in (SEED, 1):
        noise.set_seed(seed)
        expected = noise_tile(seed, levels, 1, edge)[:, :, 0] / GRAIN
        np.testing.assert_array_equal(steps_of(noise, levels), expected)
    noise.release()


@pytest.mark.parametrize("height", [64, 61, 90])
def test_a_panoramas_noise_is_the_twins_also_where_levels_do_not_divide_it(gl_context, height):
    noise = screen_noise(gl_context, (2 * height, height), 3, wraps=True)
    noise.set_seed(SEED)
    expected = panorama_noise(SEED, 3, 1, height)[:, :, 0] / GRAIN
    np.testing.assert_array_equal(steps_of(noise, 3)[:height], expected)
    noise.release()


def test_what_noise_is_worked_out_in_is_freed(gl_context):
    noise = screen_noise(gl_context, (256, 256), 5, wraps=False)
    held = noise.held_bytes
    noise.set_seed(SEED)
    assert noise.held_bytes == held == 256 * 256 * 16
    noise.release()


def test_a_fields_noise_and_its_halvings_are_the_twins(gl_context):
    size = 75, 50
    geometry = Flat(40).of(*size)
    passes = DisplacementPass(gl_context, geometry, DisplacementSettings(), match=False, seed=SEED)
    white = field_noise(size[::-1], SEED)
    textures = passes._field._noise
    for texture, expected in zip(
        textures, chain_of(white, len(textures) - 1, wraps=False), strict=True
    ):
        np.testing.assert_allclose(read_back(texture), expected, rtol=0, atol=1e-6)
    passes.release()
