"""The parts of `shift-map` against values worked by hand and plain loops."""

import dataclasses

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame
from pipeline.inpaint.reference import Level, guide_from_depth
from pipeline.methods.registry import create_method
from pipeline.shiftmap.base import (
    Ways,
    across,
    find_ways,
    lowpass,
    nearer_around,
    smooth_base,
)
from pipeline.shiftmap.reference import lacking, shift_map_fill
from pipeline.shiftmap.settings import (
    COST_SCALE,
    DISAGREEMENT_COST,
    DISAGREEMENT_PX,
    ENCODED_STEPS,
    FARTHER_COST,
    GUIDE_STEPS,
    LEAST_COMPARED,
    LENGTHS,
    NEARER_SHARE,
    NOT_KNOWN_COST,
    SQUARE_STEPS,
    STEPS_PX,
    SUBPIXELS,
    TILE_PX,
    WAY_REACH_PX,
    WIDE_PX,
    WINDOW_PX,
    WINDOW_STEP_PX,
    ShiftMapSettings,
)
from pipeline.shiftmap.tiles import (
    NEIGHBOURS,
    Blend,
    Planes,
    Search,
    Source,
    blend_of,
    cut_tiles,
    disagreement,
    grid_subpixels,
    planes_of,
    rounded,
    shifted,
    table_size,
)

THRESHOLD = 0.04
Z_NEAR_M = 2.0
PERIOD_PX = 24


def beside_foreground(colour, width_px, left_px=8) -> WarpedFrame:
    """A foreground at 2 m on the left that moved away to the left, over a plane at 5 m."""
    height, width, _ = colour.shape
    nearer = np.zeros((height, width), bool)
    nearer[:, :left_px] = True
    hole = np.zeros((height, width), bool)
    hole[:, left_px : left_px + width_px] = True
    depth_m = np.where(nearer, 2.0, 5.0).astype(np.float32)
    flow_px = np.where(nearer[..., None], (-float(width_px), 0.0), 0.0).astype(np.float32)
    return WarpedFrame(colour.astype(np.float32), depth_m, hole, flow_px)


def guide_of(frame: WarpedFrame):
    return guide_from_depth(frame.depth_m, Z_NEAR_M)


def ways_of(frame: WarpedFrame) -> Ways:
    return find_ways(frame, guide_of(frame), THRESHOLD)


def fill(frame: WarpedFrame, **settings):
    return shift_map_fill(frame, ShiftMapSettings(**settings), z_near_m=Z_NEAR_M)


@pytest.fixture(scope="module")
def repeating():
    """Noise that repeats every `PERIOD_PX` columns, behind a hole 20 px wide; and its fill."""
    rng = np.random.default_rng(3)
    colour = np.tile(rng.uniform(0.2, 0.8, (40, PERIOD_PX, 3)), (1, 5, 1))
    frame = beside_foreground(colour, 20)
    return frame, fill(frame)


# --- ways and base --------------------------------------------------------------------------


def test_ways_lead_to_the_background_and_know_how_wide_the_hole_is():
    """Hole columns 8 to 12: the first known one on the right is 13, its colour taken from 14."""
    ways = ways_of(beside_foreground(np.zeros((3, 24, 3)), 5))

    row = ways.pixel[:, 0] == 1
    assert ways.pixel[row, 1].tolist() == [8, 9, 10, 11, 12]
    assert ways.steps[row].tolist() == [5, 4, 3, 2, 1]
    assert ways.end[row].tolist() == [[1, 14]] * 5
    assert (ways.across_px == 5).all()
    assert (ways.step == (0, 1)).all()


def test_a_hole_is_as_wide_as_its_ways_and_what_comes_behind_them():
    """Open behind, where the frame ends, it counts as `WIDE_PX` wider; at most the reach counts."""

    def widths(colour, **where):
        ways = ways_of(beside_foreground(colour, **where))
        return set(ways.across_px[ways.pixel[:, 0] == 1].tolist())

    assert widths(np.zeros((3, 60, 3)), width_px=40) == {40}
    assert widths(np.zeros((3, 60, 3)), width_px=40, left_px=0) == {40 + WIDE_PX}
    assert widths(np.zeros((3, 300, 3)), width_px=WAY_REACH_PX, left_px=0) == {WAY_REACH_PX}


def test_a_hole_that_only_something_nearer_borders_has_no_ways():
    frame = beside_foreground(np.zeros((3, 24, 3)), 5)
    depth_m = np.where(frame.hole, 5.0, 2.0).astype(np.float32)

    ways = ways_of(WarpedFrame(frame.colour, depth_m, frame.hole, frame.flow_px))

    assert not ways.steps.any()
    assert not ways.step.any()
    assert not ways.across_px.any()


def window_in_a_frame(width_px=10, behind_m=5.0, motion_px=-4.0) -> WarpedFrame:
    """A hole 20 px high in a red frame of 2 px at 2 m, which moved along stripes at 5 m."""
    near, hole = np.zeros((2, 48, 64), bool)
    near[12:36, 18 : 22 + width_px] = True
    hole[14:34, 20 : 20 + width_px] = True
    near &= ~hole
    stripes = 0.5 + 0.3 * np.sin(np.arange(48))[:, None, None]
    colour = np.where(near[..., None], (1.0, 0.0, 0.0), stripes)
    depth_m = np.where(hole, 5.0, np.where(near, 2.0, behind_m))
    flow_px = np.where(near[..., None], (motion_px, 0.0), 0.0).astype(np.float32)
    return WarpedFrame(colour.astype(np.float32), depth_m.astype(np.float32), hole, flow_px)


def test_an_enclosed_hole_is_looked_out_of_through_what_stands_before_it():
    """Its columns are 20 to 29, and the frame's 18, 19, 30 and 31: background again from 32 on.

    In the middle both are as far: to the right, where the parallax points, comes first.
    """
    ways = ways_of(window_in_a_frame())

    row = ways.pixel[:, 0] == 24
    assert ways.steps[row].tolist() == [3, 4, 5, 6, 7, 7, 6, 5, 4, 3]
    assert ways.step[row].tolist() == [[0, -1]] * 5 + [[0, 1]] * 5
    assert ways.end[row].tolist() == [[24, 16]] * 5 + [[24, 33]] * 5
    assert set(ways.across_px) == {WIDE_PX}
    middle = ways_of(window_in_a_frame(width_px=11))
    assert middle.step[(middle.pixel == (24, 25)).all(axis=1)].tolist() == [[0, 1]]


def test_it_is_not_where_it_is_thin_or_its_surface_is_nowhere_else():
    assert not ways_of(window_in_a_frame(motion_px=0.0)).steps.any()
    assert not ways_of(window_in_a_frame(width_px=WIDE_PX - 1)).steps.any()
    assert not ways_of(window_in_a_frame(behind_m=3.0)).steps.any()
    assert not ways_of(window_in_a_frame(behind_m=9.0)).steps.any()


def test_an_enclosed_hole_goes_on_as_the_stripes_outside():
    """And no colour of what encloses it comes in."""
    frame = window_in_a_frame()
    found = fill(frame)

    inside = np.s_[18:30, 23:27]
    stripes = np.broadcast_to(frame.colour[:, :1], frame.colour.shape)
    assert np.abs(found.colour[inside] - stripes[inside]).max() < 0.15
    assert np.abs(found.base.colour[inside] - stripes[inside]).max() > 0.2
    grey = found.colour[frame.hole]
    np.testing.assert_allclose(grey, grey[:, :1].repeat(3, axis=1), atol=1e-9)


def test_a_lowpass_of_means_is_their_bilinear_interpolation():
    """A ramp of means stays a ramp: by hand, pixel p lies at (p - 1.5) / 4 of the means."""
    quarters = Level(np.arange(4.0) * np.ones((4, 1)), np.ones((4, 4)), np.zeros((4, 4)))
    quarters = Level(quarters.values[..., None], quarters.validity, quarters.guide)

    whole = lowpass(quarters, np.zeros((16, 16)), 0, THRESHOLD)[..., 0]
    halves = lowpass(quarters, np.zeros((8, 8)), 1, THRESHOLD)[..., 0]

    np.testing.assert_allclose(whole, ((np.arange(16) - 1.5) / 4).clip(0, 3) * np.ones((16, 1)))
    np.testing.assert_allclose(halves, ((np.arange(8) - 0.5) / 2).clip(0, 3) * np.ones((8, 1)))


def test_a_lowpass_does_not_cross_a_jump_of_depth():
    guide = np.where(np.arange(4) < 2, 0.0, 0.5) * np.ones((4, 1))
    quarters = Level(np.where(guide > 0, 1.0, 0.25)[..., None], np.ones((4, 4)), guide)
    fine = guide.repeat(4, axis=0).repeat(4, axis=1)

    found = lowpass(quarters, fine, 0, THRESHOLD)[..., 0]

    np.testing.assert_allclose(found, np.where(fine > 0, 1.0, 0.25))


@pytest.mark.parametrize(
    ("width_px", "share"), [(1, 0.0), (2, 0.0), (3, 0.25), (5, 0.75), (6, 1.0), (9, 1.0)]
)
def test_holes_are_thin_up_to_two_pixels_and_not_from_six(width_px, share):
    frame = beside_foreground(np.zeros((8, 40, 3)), width_px)

    found = smooth_base(frame, guide_of(frame), ways_of(frame), THRESHOLD).wide

    np.testing.assert_allclose(found[frame.hole], share, atol=1e-12)
    assert not found[~frame.hole].any()


def test_ways_side_by_side_are_averaged_by_their_length():
    """By hand: 4 steps from the end the reach is 2, and the tent 1, 2, 3, 2, 1 of 9."""
    frame = beside_foreground(np.zeros((9, 32, 3)), 4)
    ways = ways_of(frame)
    values = (ways.pixel[:, :1] == 4).astype(np.float64)

    found = across(values, frame.hole, ways, guide_of(frame), THRESHOLD)

    deepest = found[ways.pixel[:, 1] == 8, 0]
    np.testing.assert_allclose(deepest[2:-2], np.array([1, 2, 3, 2, 1]) / 9)
    assert deepest[0] == deepest[-1] == 0
    beside = found[ways.pixel[:, 1] == 11, 0]
    np.testing.assert_allclose(beside, np.arange(9) == 4)


def test_ways_to_another_surface_are_not_averaged():
    """The upper half of the background lies at 20 m: its colour stays above."""
    frame = beside_foreground(np.zeros((16, 48, 3)), 16)
    depth_m = frame.depth_m.copy()
    depth_m[:8, 8:] = 20.0
    frame = WarpedFrame(frame.colour, depth_m, frame.hole, frame.flow_px)
    ways = ways_of(frame)
    upper = (ways.pixel[:, :1] < 8).astype(np.float64)

    found = across(upper, frame.hole, ways, guide_of(frame), THRESHOLD)

    np.testing.assert_allclose(found, upper, atol=1e-12)


def test_half_the_base_of_a_wide_hole_is_the_edge_continued():
    """A white post to the right of a wide hole, grey beyond: push-pull gets grey from above."""
    colour = np.full((64, 80, 3), 0.5)
    colour[16:48, 48:] = 1.0
    frame = beside_foreground(colour, 40)
    ways = ways_of(frame)
    found = smooth_base(frame, guide_of(frame), ways, THRESHOLD)

    end = found.low[32, 49, 0]
    beside = ways.pixel.tolist().index([32, 47])  # one step: no way aside counts
    pushed = 2 * found.colour[32, 47, 0] - end
    assert ways.end[beside].tolist() == [32, 49]
    assert found.wide[frame.hole].min() == 1
    assert 0.95 < end <= 1.0 + 1e-9
    assert 0.5 <= pushed <= 1.0 + 1e-9
    # Deep in the hole, in rows of the post, the edge has come along by half.
    assert found.colour[32, 12, 0] > 0.75


def test_thin_holes_are_filled_as_by_push_pull_and_get_no_detail(rng, gl_context):
    frame = beside_foreground(rng.random((32, 48, 3)), 2)
    method = create_method("push-pull-depth", gl_context, {"z_near_m": Z_NEAR_M})

    found = fill(frame)

    assert len(found.tiles.count) == 0
    assert not found.gain.any()
    # The twin of push-pull-depth agrees within its own tolerance: rounding, per resolution.
    np.testing.assert_allclose(found.colour, method.fill(frame, 1), atol=36 * 7 * 2.0**-24)
    method.release()


# --- what is nearer -------------------------------------------------------------------------


def gap_in_foreground(width_px) -> WarpedFrame:
    """A gap 16 px high through a foreground at 2 m, black on its left and white on its right."""
    hole = np.zeros((32, 48), bool)
    hole[8:24, 16 : 16 + width_px] = True
    white = np.broadcast_to(np.arange(48) >= 16 + width_px, hole.shape)
    colour = np.repeat(white[..., None], 3, axis=-1).astype(np.float32)
    depth_m = np.where(hole, 5.0, 2.0).astype(np.float32)
    return WarpedFrame(colour, depth_m, hole, np.zeros((32, 48, 2), np.float32))


def test_what_is_nearer_is_the_mean_of_eight_ends_by_their_distance():
    """By hand: one pixel; its sides weigh 1 and its corners one over the root of 2."""
    rng = np.random.default_rng(1)
    colour = rng.random((3, 3, 3)).astype(np.float32)
    hole = np.zeros((3, 3), bool)
    hole[1, 1] = True
    depth_m = np.where(hole, 5.0, 2.0).astype(np.float32)
    frame = WarpedFrame(colour, depth_m, hole, np.zeros((3, 3, 2), np.float32))

    found, share = nearer_around(frame, np.array([[1, 1]]))

    weight = np.full((3, 3, 1), 2**-0.5)
    weight[1], weight[:, 1], weight[1, 1] = 1, 1, 0
    np.testing.assert_allclose(found[0], (weight * colour).sum(axis=(0, 1)) / (4 + 4 * 2**-0.5))
    assert share.tolist() == [NEARER_SHARE]


@pytest.mark.parametrize(
    ("width_px", "of_it"), [(1, 1.0), (2, 1.0), (3, 0.75), (5, 0.25), (6, 0.0), (9, 0.0)]
)
def test_a_narrow_gap_whose_background_is_out_of_sight_takes_some_of_what_is_nearer(
    width_px, of_it
):
    """In its corners as elsewhere."""
    ways = ways_of(gap_in_foreground(width_px))

    _, share = nearer_around(gap_in_foreground(width_px), ways.pixel)

    assert not ways.steps.any()
    np.testing.assert_allclose(share, of_it * NEARER_SHARE)


def test_the_base_of_a_narrow_gap_is_mixed_with_what_is_nearer(gl_context):
    frame = gap_in_foreground(2)
    method = create_method("push-pull-depth", gl_context, {"z_near_m": Z_NEAR_M})
    pushed = method.fill(frame, 1)[frame.hole]
    method.release()
    nearer, share = nearer_around(frame, np.argwhere(frame.hole))

    found = smooth_base(frame, guide_of(frame), ways_of(frame), THRESHOLD).colour[frame.hole]

    wanted = (1 - share[:, None]) * pushed + share[:, None] * nearer
    np.testing.assert_allclose(found, wanted, atol=36 * 7 * 2.0**-24)
    assert np.abs(found - pushed).max() > 0.01


def test_nothing_nearer_comes_in_where_one_ray_meets_the_background():
    """The gap's upper end is open to the background: the column of rays that goes up meets it."""
    frame = gap_in_foreground(1)
    depth_m, colour = frame.depth_m.copy(), frame.colour.copy()
    depth_m[7, 16], colour[7, 16] = 5.0, 0.5
    frame = WarpedFrame(colour, depth_m, frame.hole, frame.flow_px)

    found = smooth_base(frame, guide_of(frame), ways_of(frame), THRESHOLD).colour[frame.hole]

    np.testing.assert_allclose(found, 0.5)


# --- tiles and their cost -------------------------------------------------------------------


def ways_to_the_right(pixels, steps) -> Ways:
    step = np.tile((0, 1), (len(pixels), 1))
    return Ways(pixels, step, steps, pixels, steps)


@pytest.mark.parametrize(
    ("total", "count", "wanted"), [(7, 2, 4), (-7, 2, -3), (5, 3, 2), (-5, 3, -2), (0, 9, 0)]
)
def test_quotients_go_to_the_nearest_whole_number_and_halves_up(total, count, wanted):
    assert rounded(np.array(total), np.array(count)) == wanted


def test_tiles_lie_in_the_source_frame_and_know_their_corner():
    """By hand: moved by 3.25 px, source columns 8 to 15 begin at 11.25 px, at pixel 11."""
    hole = np.zeros((16, 40), bool)
    hole[:8, 11:19] = True
    pixels = np.argwhere(hole)
    flow_px = np.full((16, 40, 2), (3.25, 0.0), np.float32)

    found = cut_tiles(
        hole, np.full((16, 40), 9), flow_px, ways_to_the_right(pixels, 19 - pixels[:, 1])
    )

    rows, columns = table_size((16, 40))
    assert found.index.shape == (rows, columns) == (6, 12)
    # Pixel 11 has its centre at 8.25 px of the source, pixel 18 at 15.25 px: one tile, (0, 1).
    assert found.cell.tolist() == [[0, 1]]
    assert found.corner.tolist() == [[0, 11]]
    assert found.count.tolist() == [64]
    assert found.guide.tolist() == [9]
    assert found.way.tolist() == [[0, 64]]
    assert found.way_px.tolist() == [8]
    assert found.across_px.tolist() == [8]
    assert grid_subpixels(flow_px)[0, 11].tolist() == [SUBPIXELS // 2, 8 * SUBPIXELS + 64]


def random_search(rng, size=(36, 44)):
    """A random scene of two surfaces with ragged holes, cut into tiles."""
    hole = rng.random(size) < 0.3
    hole[10:24, 12:30] = True
    guide = np.where(np.arange(size[1]) < 20, 0.3, 0.6) + rng.uniform(0, 0.05, size)
    halves = rng.random((size[0] // 2, size[1] // 2, 3))
    planes = planes_of(hole, guide, rng.random((*size, 3)), halves)
    flow_px = np.full((*size, 2), (2.3, -1.6), np.float32)
    pixels = np.argwhere(hole)
    ways = ways_to_the_right(pixels, rng.integers(1, 9, len(pixels)))
    return Search(cut_tiles(hole, planes.guide, flow_px, ways), planes, THRESHOLD), planes


def plain_cost(tiles, planes: Planes, tile, shift):
    """The cost of one tile's shift, pixel by pixel."""
    height, width = planes.hole.shape
    threshold = round(GUIDE_STEPS * THRESHOLD)
    of_base, beside = [], []
    pixels = unknown = farther = 0
    top, left = tiles.corner[tile]
    for y in range(top - WINDOW_PX, top + TILE_PX + WINDOW_PX, WINDOW_STEP_PX):
        for x in range(left - WINDOW_PX, left + TILE_PX + WINDOW_PX, WINDOW_STEP_PX):
            if not (0 <= y < height and 0 <= x < width):
                continue
            if abs(planes.guide[y, x] - tiles.guide[tile]) > threshold:
                continue
            v, u = y + shift[0], x + shift[1]
            is_source = 0 <= v < height and 0 <= u < width and not planes.hole[v, u]
            is_source = is_source and tiles.guide[tile] - planes.guide[v, u] <= threshold
            if planes.hole[y, x]:
                pixels += 1
                unknown += not is_source
                if is_source:
                    farther += planes.guide[v, u] - tiles.guide[tile] > threshold
                    of_base.append(((planes.colour[y, x] - planes.low[v, u]) ** 2).sum())
            elif is_source:
                beside.append(((planes.colour[y, x] - planes.colour[v, u]) ** 2).sum())
    return (
        COST_SCALE * sum(of_base) // max(1, len(of_base))
        + COST_SCALE * sum(beside) // max(LEAST_COMPARED, len(beside))
        + COST_SCALE * NOT_KNOWN_COST * unknown // max(1, pixels)
        + COST_SCALE * FARTHER_COST * farther // max(1, pixels)
    )


def test_a_cost_is_the_one_that_plain_loops_find(rng):
    search, planes = random_search(rng)
    every = np.arange(len(search.tiles.count))
    assert len(every) > 20

    for _ in range(3):
        shift = rng.integers(-20, 21, (len(every), 2))
        wanted = [plain_cost(search.tiles, planes, tile, shift[tile]) for tile in every]
        assert search.cost(every, shift).tolist() == wanted


def test_no_cost_outgrows_what_a_key_of_32_bits_holds():
    """A key is a cost and a choice of 6 bits; a sum of errors over a window must fit as well."""
    most_error = 3 * ENCODED_STEPS**2
    disagreeing = COST_SCALE * DISAGREEMENT_COST
    most = COST_SCALE * (2 * most_error + NOT_KNOWN_COST + FARTHER_COST) + disagreeing
    window = ((TILE_PX + 2 * WINDOW_PX) // WINDOW_STEP_PX) ** 2

    assert most < 1 << 24
    assert max(LENGTHS, 1 + len(NEIGHBOURS) + 4) <= 64
    assert COST_SCALE * most_error * window < 1 << 31


def test_no_shift_leads_out_of_what_takes_part_in_a_fill():
    """Three cells of 128 px around a hole's do, and a window and a mean's taps lie around."""
    farthest = WAY_REACH_PX + LENGTHS + sum(STEPS_PX) + TILE_PX + WINDOW_PX + 4

    assert farthest < 3 * 128
    assert len(STEPS_PX) % 2 == 0  # the last sweep writes where the first had read


@pytest.mark.parametrize(
    ("background_px", "wanted"),
    [(100, [33] * 4), (20, [33, 33, 21, 16])],
    ids=["wide background", "narrow background"],
)
def test_first_shifts_are_longer_than_the_hole_is_wide_where_background_lies_there(
    background_px, wanted
):
    """By hand: a hole of 32 px before one colour, which goes on for 20 px in the second case.

    A shift of 33 px leads the tiles' middles to columns 37, 45, 53 and 61: two lie beyond it, and
    their tiles begin at 17 and 9 px. Of equal costs the first counts. Of the third tile's columns
    compared, 8, 11, ... 29, one or more find no source, one alone from 21 px on; of the fourth's,
    16, 19, ... 31, all find one from 16 px on.
    """
    size = (16, 160)
    hole = np.zeros(size, bool)
    hole[:8, :32] = True
    guide = np.where(np.arange(size[1]) < 32 + background_px, 20000, 0) * np.ones(size, int)
    colour = np.zeros((*size, 3), int)
    pixels = np.argwhere(hole)
    steps = 32 - pixels[:, 1]
    ways = dataclasses.replace(ways_to_the_right(pixels, steps), across_px=np.full(len(steps), 32))
    tiles = cut_tiles(hole, guide, np.zeros((*size, 2), np.float32), ways)

    shift = Search(tiles, Planes(hole, guide, colour, colour), THRESHOLD).first_shifts()

    assert shift.tolist() == [[0, px] for px in wanted]


def test_the_shift_of_a_repeating_texture_is_its_period(repeating):
    """Nothing else matches the known pixels around: by hand, 24 px to the right."""
    _, found = repeating

    assert len(found.shift) == 15
    assert (found.shift == (0, PERIOD_PX)).all()


def test_the_detail_of_a_repeating_texture_is_the_true_one(repeating):
    """The whole picture's own, which the fill has not seen, comes back, but for its low-pass."""
    frame, found = repeating
    picture = frame.colour.astype(np.float64)
    true = picture - picture[:, 24:48].mean(axis=(0, 1))

    assert np.corrcoef(found.detail[frame.hole].T.ravel(), true[frame.hole].T.ravel())[0, 1] > 0.9


@pytest.mark.parametrize(
    ("by", "motion_px"),
    [((3, 5), (3, 5)), ((3, 5), (-5, 13)), ((8, 16), (0, 0)), ((9, 3), (1, -5))],
    ids=["view", "view and picture", "picture", "picture and view"],
)
def test_a_shift_of_the_view_or_of_the_picture_by_whole_tiles_shifts_the_fill(rng, by, motion_px):
    """The same tiles take the same shifts: all that moved goes by `by`, the picture by the rest.

    Foreground all around is no source, and so stands for the frame's end, which does not move.
    """
    size = (88, 120)
    background = np.zeros(size, bool)
    background[20:-20, 20:-20] = True
    whole = np.zeros(size, bool)
    whole[28:52, 28:48] = True
    colour, low = (rng.integers(0, 256, (*size, 3)) for _ in range(2))

    def found(by, motion_px):
        def moved(array):
            return np.roll(array, by, axis=(0, 1))

        guide = moved(np.where(background, 20000, 0))
        planes = Planes(moved(whole), guide, moved(colour), moved(low))
        flow_px = np.full((*size, 2), motion_px[::-1], np.float32)
        pixels = np.argwhere(planes.hole)
        ways = ways_to_the_right(pixels, 48 + by[1] - pixels[:, 1])
        tiles = cut_tiles(planes.hole, guide, flow_px, ways)
        search = Search(tiles, planes, THRESHOLD)
        shift = search.agree(search.first_shifts())
        source = Source(moved(colour / 255), planes.hole, guide / GUIDE_STEPS, THRESHOLD)
        return shifted(source, pixels, blend_of(tiles, grid_subpixels(flow_px)[planes.hole]), shift)

    still = found((0, 0), (0, 0))

    np.testing.assert_allclose(found(by, motion_px), still, atol=1e-12)
    assert still.std() > 0.1


# --- sweeps, blends, gain -------------------------------------------------------------------


def test_disagreement_is_the_mean_distance_from_neighbours_shifts():
    """By hand: one is 3 px off, one farther than counts, six are none."""
    shifts = np.array([[0, 0], [2, 1], [0, 50]])
    beside = np.array([[1, 2, *[-1] * 6]])

    found = disagreement(np.array([[0, 0]]), beside, shifts)

    scale = COST_SCALE * DISAGREEMENT_COST
    assert found.tolist() == [scale * (3 + DISAGREEMENT_PX) // (DISAGREEMENT_PX * 2)]


def test_sweeps_lower_the_cost_of_all(rng):
    search, _ = random_search(rng)
    first = search.first_shifts()
    every = np.arange(len(first))
    beside = np.stack([search.tiles.at(search.tiles.cell + n) for n in NEIGHBOURS], axis=1)

    def whole(shift):
        return int((search.cost(every, shift) + disagreement(shift, beside, shift)).sum())

    assert whole(search.agree(first)) < whole(first)


def one_row_of_tiles(hole):
    """Tiles of 8 px at rest, and the blends of all their pixels."""
    pixels, flow_px = np.argwhere(hole), np.zeros((*hole.shape, 2), np.float32)
    ways = ways_to_the_right(pixels, np.ones(len(pixels), int))
    tiles = cut_tiles(hole, np.zeros(hole.shape, int), flow_px, ways)
    return pixels, blend_of(tiles, grid_subpixels(flow_px)[hole])


def test_one_shift_for_all_copies_pixel_by_pixel_and_different_ones_keep_the_variance(rng):
    hole = np.zeros((64, 160), bool)
    hole[:, :64] = True
    values = rng.standard_normal((64, 160, 1))
    source = Source(values, hole, np.zeros(hole.shape), THRESHOLD)
    pixels, blend = one_row_of_tiles(hole)
    same = np.full((64, 2), (0, 70))
    many = np.stack([np.zeros(64, int), rng.choice(np.arange(64, 96), 64)], axis=1)

    copied = shifted(source, pixels, blend, same)
    mixed = shifted(source, pixels, blend, many)

    np.testing.assert_allclose(copied, values[:, 70:134].reshape(-1, 1), atol=1e-12)
    assert mixed.std() == pytest.approx(1.0, abs=0.05)  # 4096 samples: 1.1 % by chance


def test_nothing_nearer_is_ever_copied():
    hole = np.zeros((16, 48), bool)
    hole[:, :16] = True
    guide = np.where(np.arange(48) < 32, 0.6, 0.2) * np.ones((16, 1))
    source = Source(np.ones((16, 48, 1)), hole, guide, THRESHOLD)
    pixels, blend = one_row_of_tiles(hole)

    found = shifted(source, pixels, blend, np.full((4, 2), (0, 24)))  # half of it is nearer

    assert found[pixels[:, 1] < 8].all()
    assert not found[pixels[:, 1] >= 8].any()


def test_the_gain_is_what_the_base_lacks():
    """By hand: a base with a quarter of the variance lacks sqrt(3 / 4); with all of it, nothing."""
    one = np.zeros(4, np.intp)
    blend = Blend(
        one, np.stack([one, one - 1, one - 1, one - 1]), np.eye(4)[0][:, None] * np.ones(4)
    )

    quarter = lacking(np.full(4, 0.1), np.full(4, 0.2), blend, 1)

    np.testing.assert_allclose(quarter, np.sqrt(0.75), atol=1 / (0.04 * SQUARE_STEPS))
    assert not lacking(np.full(4, 0.3), np.full(4, 0.2), blend, 1).any()
    assert not lacking(np.zeros(4), np.zeros(4), blend, 1)[:0].any()


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"gain": -0.1}, "gain must lie in"),
        ({"gain": float("nan")}, "gain must lie in"),
        ({"depth_threshold": 0.0}, "depth_threshold must lie in"),
        ({"depth_threshold": 1.0}, "depth_threshold must lie in"),
    ],
)
def test_settings_out_of_range_are_refused(settings, said):
    with pytest.raises(InputError, match=said):
        ShiftMapSettings(**settings)
