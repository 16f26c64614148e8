"""Compressed pictures: the round trip, what statistics give back, files of a size, the GPU."""

import numpy as np
import pytest
from skimage import data

from benchmarks.compress import Result, markdown
from benchmarks.shared.dispatches import dispatches_of
from pipeline.colour import ycbcr_from_rgb
from pipeline.compression import compressed_file, image_codecs
from pipeline.compression.codec import (
    LEAST_QUALITY,
    CompressionSettings,
    compress,
    decoded_base,
    decompress,
)
from pipeline.compression.compressed_file import atlas_shape, pack, unpack
from pipeline.compression.gpu import DecompressPass
from pipeline.compression.grid import PolarGrid
from pipeline.compression.lost import LostMap, lost_maps, map_grids, wanted_of
from pipeline.errors import InputError
from pipeline.features.reference import analyse

SMALL = CompressionSettings(angles=96)
# Odd sizes; gaze inside, at a corner, at an edge and outside.
VIEWS = [((96, 120), (50.0, 40.0)), ((75, 61), (0.0, 0.0)), ((64, 90), (90.0, 30.0)),
         ((81, 64), (-40.0, 120.5)), ((33, 17), (8.0, 8.0)), ((1, 1), (0.5, 0.5))]  # fmt: skip
# Weights are half floats, as in tests of foveated metamers.
TOLERANCE = 2 * 4 * 0.25 * 2.0**-11


def photograph(size):
    picture = data.astronaut().astype(np.float32) / 255
    return np.ascontiguousarray(picture[60 : 60 + size[0], 120 : 120 + size[1]])


def noise_picture(rng, size, deviation=0.12):
    values = 0.5 + deviation * rng.standard_normal((*size, 1))
    return np.repeat(np.clip(values, 0, 1), 3, axis=2).astype(np.float32)


@pytest.mark.parametrize(("size", "gaze_px"), VIEWS)
def test_a_file_says_all_that_is_needed(size, gaze_px):
    made = compress([photograph(size)], gaze_px, SMALL)
    read = compressed_file.from_bytes(compressed_file.to_bytes(made))
    shown = decompress(read, seed=3)
    assert shown.shape == (*size, 3)
    assert shown.dtype == np.float32
    assert ((shown >= 0) & (shown <= 1)).all()
    np.testing.assert_array_equal(shown, decompress(made, seed=3))


@pytest.mark.parametrize(("size", "gaze_px"), VIEWS)
def test_the_gpu_makes_the_same_picture(gl_context, size, gaze_px):
    made = compress([photograph(size)], gaze_px, SMALL)
    work = DecompressPass(gl_context, made)
    found = work.apply(made, seed=3)
    assert len(dispatches_of(lambda: work.apply(made, seed=3))) == (3 if made.levels else 1)
    work.release()
    np.testing.assert_allclose(found, decompress(made, seed=3), atol=TOLERANCE)


@pytest.mark.parametrize("codec", image_codecs.CODECS)
def test_statistics_give_the_periphery_its_bands_back(rng, codec):
    picture, gaze_px = noise_picture(rng, (160, 160)), (80.0, 80.0)
    made = compress([picture], gaze_px, CompressionSettings(codec=codec, angles=64, quality=90))
    base = decoded_base(made.bases[0], made.grid, codec)
    shown = decompress(made, seed=1)
    y, x = np.mgrid[:160, :160] + 0.5
    far = np.hypot(x - 80, y - 80) > 30

    def energy(image):
        finest = analyse(ycbcr_from_rgb(image.astype(np.float64)), 2).bands[0][..., 0]
        return np.square(finest)[far].mean()

    assert energy(base) < 0.2 * energy(picture)
    assert energy(shown) == pytest.approx(energy(picture), rel=0.2)


def test_near_the_gaze_no_noise_is_added(rng):
    picture, gaze_px = noise_picture(rng, (128, 128)), (64.0, 64.0)
    made = compress([picture], gaze_px, CompressionSettings(angles=200, quality=95))
    knee_px = made.grid.density.knee_px
    y, x = np.mgrid[:128, :128] + 0.5
    near = np.hypot(x - 64, y - 64) < knee_px - 4
    base = decoded_base(made.bases[0], made.grid, "jpeg")
    np.testing.assert_allclose(decompress(made)[near], base[near], atol=1e-6)


def test_seeds_differ_and_colour_stays():
    made = compress([photograph((120, 160))], (60.0, 60.0), SMALL)
    one, other = decompress(made, seed=1), decompress(made, seed=2)
    assert np.abs(one - other).mean() > 0.01
    plain = CompressionSettings(angles=96, statistics=False)
    blurred = compress([photograph((120, 160))], (60.0, 60.0), plain)
    assert blurred.levels == 0
    assert not blurred.statistics
    np.testing.assert_array_equal(decompress(blurred, seed=1), decompress(blurred, seed=2))


def test_maps_start_where_cells_lose_their_level():
    grids = map_grids(PolarGrid((1024, 1024), (512, 512), 384))
    knee = 384 / (2 * np.pi)
    starts = [grid.density.start_px for grid in grids]
    np.testing.assert_allclose(starts, [knee, knee, 2 * knee, 4 * knee, 8 * knee])
    # A picture that cells hold whole has no maps.
    assert map_grids(PolarGrid((64, 64), (32, 32), 384)) == []


def test_what_was_lost_is_the_difference_of_mean_squares(rng):
    picture, grid = noise_picture(rng, (128, 128)), PolarGrid((128, 128), (64, 64), 48)
    grids = map_grids(grid, 1)
    (all_of_it,) = lost_maps(picture, np.full_like(picture, 0.5), grids)
    (nothing,) = lost_maps(picture, picture, grids)
    assert not nothing.variance.any()
    bands = analyse(ycbcr_from_rgb(picture.astype(np.float64)), 1).bands[0][..., 0]
    whole = all_of_it.variance[:, 1:3].mean(axis=(0, 1))
    np.testing.assert_allclose(whole, np.square(bands).mean(axis=(0, 1)), rtol=0.1)
    # Grey noise has no colour to go with it.
    assert np.abs(all_of_it.slope).max() < 1e-6


def test_an_atlas_keeps_deviations_to_half_a_step(rng):
    grids = map_grids(PolarGrid((256, 200), (100, 90), 64))
    maps = [
        LostMap(grid, rng.random((*grid.shape, 3)), rng.uniform(-1, 1, (*grid.shape, 2)))
        for grid in grids
    ]
    atlas, scales = pack(maps)
    assert atlas.shape == atlas_shape(grids)
    for one, back, scale in zip(maps, unpack(atlas, scales, grids), scales, strict=True):
        off = np.abs(np.sqrt(one.variance) - np.sqrt(back.variance))
        assert (off <= scale * (0.5 / 255 + 1e-6)).all()
        assert np.abs(one.slope - back.slope).max() <= 1 / 255 + 1e-9


def test_maps_are_read_at_blocks():
    grids = map_grids(PolarGrid((64, 48), (20, 20), 32), 2)
    maps = [LostMap(g, np.full((*g.shape, 3), 0.5), np.full((*g.shape, 2), 0.1)) for g in grids]
    wanted = wanted_of(maps)
    assert wanted.variances.shape == (12, 16, 6)
    assert wanted.variances[-1, -1] == pytest.approx(0.5)
    assert wanted.variances[5, 5] == pytest.approx(0)  # at the gaze
    assert wanted.slopes[-1, -1] == pytest.approx(0.1)


@pytest.mark.parametrize("size_bytes", [2000, 3000])
@pytest.mark.parametrize("statistics", [True, False])
def test_a_file_is_as_large_as_asked_and_no_larger(size_bytes, statistics):
    settings = CompressionSettings(angles=96, size_bytes=size_bytes, statistics=statistics)
    made = compress([photograph((160, 160))], (80.0, 80.0), settings)
    size = len(compressed_file.to_bytes(made))
    assert 0.8 * size_bytes < size <= size_bytes


def test_a_size_that_cannot_be_reached_is_refused():
    with pytest.raises(InputError, match=r"800 bytes are too few.*the least"):
        compress(
            [photograph((160, 160))], (80.0, 80.0), CompressionSettings(angles=512, size_bytes=800)
        )
    with pytest.raises(InputError, match=r"16 angles reach are \d+; ask for a larger file"):
        compress([photograph((160, 160))], (80.0, 80.0), CompressionSettings(size_bytes=100))


@pytest.mark.parametrize(("size_bytes", "angles"), [(1500, 32), (4000, 128), (60_000, 1024)])
def test_a_size_chooses_how_many_angles_fit_well(size_bytes, angles):
    picture = photograph((160, 160))
    made = compress([picture], (80.0, 80.0), CompressionSettings(size_bytes=size_bytes))
    assert len(compressed_file.to_bytes(made)) <= size_bytes
    assert made.grid.rows_per_turn == angles
    assert made.quality >= LEAST_QUALITY / 2  # maps took more than was thought


def error_near_the_gaze(picture, settings):
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]] + 0.5
    shown = decompress(compress([picture], (80.0, 80.0), settings))
    return np.sqrt(np.square(shown - picture)[np.hypot(x - 80, y - 80) < 8].mean())


def test_colours_of_single_pixels_come_back_near_the_gaze(rng):
    picture = rng.random((160, 160, 3)).astype(np.float32)

    assert error_near_the_gaze(picture, CompressionSettings(angles=128, quality=95)) < 0.05


def test_more_bytes_buy_a_better_fovea():
    errors = [
        error_near_the_gaze(photograph((160, 160)), CompressionSettings(size_bytes=size_bytes))
        for size_bytes in (4000, 12_000, 36_000)
    ]

    assert errors[0] > 1.2 * errors[1] > 1.2**2 * errors[2]


def test_frames_of_a_clip_share_statistics():
    frames = [np.roll(photograph((96, 96)), shift, axis=1) for shift in range(5)]
    made = compress(frames, (48.0, 48.0), CompressionSettings(angles=64, hold=2))
    assert len(made.bases) == 5
    assert len(made.statistics) == 3
    read = compressed_file.from_bytes(compressed_file.to_bytes(made))
    shown = [decompress(read, seed=1, frame=index) for index in range(5)]
    noise = [
        image - np.clip(decoded_base(read.bases[i], read.grid, "jpeg"), 0, 1)
        for i, image in enumerate(shown)
    ]
    # Noise of frames that share statistics stands still, but for what is clipped.
    assert np.abs(noise[0] - noise[1]).mean() < 0.1 * np.abs(noise[0]).mean()
    # One frame's file is a part of the clip's.
    alone = compress(frames[:1], (48.0, 48.0), CompressionSettings(angles=64, hold=2))
    assert alone.bases[0] == made.bases[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gaze_px": (1e9, 0.0)}, "gaze must lie within"),
        ({"gaze_px": (float("nan"), 0.0)}, "gaze must lie within"),
        ({"settings": CompressionSettings(angles=8)}, "angles must lie in 16..4096"),
        ({"pictures": []}, "at least one picture"),
        ({"pictures": [np.zeros((8, 8, 3), np.float32), np.zeros((8, 9, 3), np.float32)]},
         "all be of one size"),
        ({"pictures": [np.full((8, 8, 3), 2, np.float32)]}, r"lie in \[0, 1\]"),
    ],
)  # fmt: skip
def test_impossible_requests_are_refused(change, message):
    asked = {"pictures": [np.zeros((8, 8, 3), np.float32)], "gaze_px": (4.0, 4.0)} | change
    with pytest.raises(InputError, match=message):
        compress(**asked)


@pytest.mark.parametrize(
    "change", [{"codec": "png"}, {"quality": 0}, {"quality": 96}, {"hold": 0}, {"size_bytes": 0}]
)
def test_impossible_settings_are_refused(change):
    with pytest.raises(InputError):
        CompressionSettings(**change)


def test_the_benchmarks_table_holds_means_and_a_dash_where_a_picture_has_no_such_file():
    def one(picture, kind, asked_kb, distance):
        return Result(picture, "jpeg", kind, asked_kb, 9.0, 50, distance, 30.0, 8.0)

    found = [one("a", "plain", 9, 0.1), one("b", "plain", 9, 0.3), one("a", "plain", 5, 0.1)]
    assert "| plain JPEG | 9.0 | .200 | 30.0 | 8.00 |" in markdown(found, [9])
    assert "| plain JPEG | - | .200, 30.0, 8.00 |" in markdown(found, [5, 9])
    assert "| metameric JPEG | - | - |" in markdown(found, [5, 9])
