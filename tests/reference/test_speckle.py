"""Measured depth: which outliers and silhouettes are mended, how, and what thin things stay."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from pipeline.frame import SourceFrame
from pipeline.warp.gpu import warp_frame
from pipeline.warp.reference import warp
from pipeline.warp.settings import WarpSettings
from pipeline.warp.speckle import mends, taken

SIZE = 40, 50
WALL_M, NEAR_M = 5.0, 2.0


def wall(depth_m=WALL_M) -> np.ndarray:
    return np.full(SIZE, depth_m, np.float32)


def mended(depth_m, colour=0.5) -> np.ndarray:
    frame = SourceFrame(np.full((*depth_m.shape, 3), colour, np.float32), depth_m)
    return taken(depth_m, *mends(frame))


@pytest.mark.parametrize("size_px", [(1, 1), (2, 2), (3, 3), (1, 3)])
@pytest.mark.parametrize("outlier_m", [0.01, NEAR_M, 30.0, np.inf])
def test_clumps_that_nothing_bears_out_take_the_depth_around_them(size_px, outlier_m):
    depth = wall()
    corner = [(0, 0), (38, 48)] if max(size_px) < 3 else []
    for row, column in [(15, 20), (30, 7), *corner]:
        depth[row : row + size_px[0], column : column + size_px[1]] = outlier_m

    np.testing.assert_array_equal(mended(depth), wall())


def spokes():
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    depth = wall()
    for slope in (-2.3, -0.5, 0.0, 0.4, 1.0):
        depth[np.abs(y - 20 - slope * (x - 25)) <= 0.5 * max(1, abs(slope))] = NEAR_M
    depth[:, 40] = NEAR_M
    return depth


def dash():
    depth = wall()
    depth[20, 10:15] = NEAR_M
    return depth


def leaves():
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    depth = wall()
    for row, column in ((8, 9), (9, 30), (28, 14), (30, 40)):
        depth[((x - column) / 5.0) ** 2 + ((y - row) / 2.2) ** 2 < 1] = NEAR_M
    return depth


def test_a_pixel_is_not_borne_out_by_its_colour_alone(rng):
    depth = wall()
    depth[15, 20] = depth[30, 7] = NEAR_M

    np.testing.assert_array_equal(mended(depth, rng.random((*SIZE, 3))), wall())


@pytest.mark.parametrize("depth", [wall(1.5 + 0.05 * np.arange(50)), wall()[:1, :1], wall(np.inf)])
def test_receding_ground_a_single_pixel_and_the_sky_stay(depth):
    np.testing.assert_array_equal(mended(depth), depth)


def test_by_hand_the_weighted_median_of_what_is_around_is_taken():
    """Beside an edge the outlier takes the side of which more is within 6 px."""
    depth = wall()
    depth[:, :25] = NEAR_M
    depth[20, 24] = depth[5, 25] = 40.0
    exact = wall()
    exact[:, :25] = NEAR_M

    np.testing.assert_array_equal(mended(depth), exact)


BRIGHT, DARK = np.float32([0.8, 0.7, 0.6]), np.float32([0.3, 0.3, 0.4])


def block(near) -> SourceFrame:
    """A bright near thing before a dark wall, with depth as exact as its colour."""
    return SourceFrame(
        np.where(near[..., None], BRIGHT, DARK), np.where(near, np.float32(NEAR_M), wall())
    )


def test_a_combed_silhouette_follows_the_colours(rng):
    near = np.zeros(SIZE, np.bool_)
    near[8:32, 15:35] = True
    right = block(near)
    depth = right.depth_m.copy()
    for row in range(SIZE[0]):  # each row of the outline is off by up to 2 px, to either side
        depth[row] = np.roll(depth[row], rng.integers(-2, 3))
    combed = replace(right, depth_m=depth)

    np.testing.assert_array_equal(taken(depth, *mends(combed)), right.depth_m)
    flat = replace(combed, colour=np.full_like(right.colour, 0.5))
    assert (taken(depth, *mends(flat)) != right.depth_m).any()  # colour is what tells


def test_what_was_not_measured_follows_what_was():
    near = np.zeros(SIZE, np.bool_)
    near[8:32, 15:35] = True
    right = block(near)
    depth, measured = right.depth_m.copy(), np.ones(SIZE, np.bool_)
    measured[10:30, 29:35] = False  # more of the near thing's side than half of what is seen of it
    depth[~measured] = WALL_M

    kept = taken(depth, *mends(replace(right, depth_m=depth)))
    found = taken(depth, *mends(replace(right, depth_m=depth, measured=measured)))

    assert (found[~measured] == NEAR_M).mean() > 0.6 > (kept[~measured] == NEAR_M).mean()
    np.testing.assert_array_equal(found[measured], right.depth_m[measured])


def test_a_pixel_like_none_of_a_surface_keeps_its_depth():
    near = np.zeros(SIZE, np.bool_)
    near[8:32, 15:35] = True
    right = block(near)
    colour, depth = right.colour.copy(), right.depth_m.copy()
    colour[20, 34], depth[20, 34] = (0.1, 0.9, 0.1), WALL_M

    assert taken(depth, *mends(SourceFrame(colour, depth)))[20, 34] == WALL_M


@pytest.mark.parametrize("thing", [spokes, dash, leaves], ids=["spokes", "dash", "leaves"])
def test_thin_things_whose_colour_differs_keep_their_outline(thing):
    assert len(mends(block(thing() == NEAR_M))[0]) == 0


def source(rng) -> tuple[SourceFrame, np.ndarray, np.ndarray]:
    """A near block that moves by 9 px before a wall; one outlier beside it moves otherwise."""
    clean = wall()
    clean[10:30, 15:30] = NEAR_M
    depth = clean.copy()
    depth[20, 13] = 60.0
    flow = np.zeros((*SIZE, 2), np.float32)
    flow[..., 0] = np.where(clean == NEAR_M, 9, 0)
    flow[20, 13] = (-7, 0)
    colour = rng.random((*SIZE, 3), np.float32)
    return SourceFrame(colour, depth), flow, clean


def test_both_twins_warp_as_if_the_outlier_were_none(gl_context, rng):
    frame, flow, clean = source(rng)
    right = flow.copy()
    right[20, 13] = 0
    for twin in (warp, partial(warp_frame, ctx=gl_context)):
        wanted = twin(SourceFrame(frame.colour, clean), right)
        found = twin(frame, flow, settings=WarpSettings(depth_speckle=True))
        bare = twin(frame, flow)
        for name in ("colour", "depth_m", "hole", "flow_px"):
            np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name))
        assert (bare.depth_m != wanted.depth_m).any()


def test_depth_in_the_target_is_mended_with_the_source(rng):
    frame, flow, clean = source(rng)
    flow[20, 13] = 0

    found = warp(
        frame, flow, target_depth_m=frame.depth_m / 2, settings=WarpSettings(depth_speckle=True)
    )

    wanted = warp(SourceFrame(frame.colour, clean), flow, target_depth_m=clean / 2)
    np.testing.assert_array_equal(found.depth_m, wanted.depth_m)
