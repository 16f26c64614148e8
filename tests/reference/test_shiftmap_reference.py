"""The parts of `shift-map` against values worked by hand and plain loops."""

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame
from pipeline.inpaint.reference import guide_from_depth
from pipeline.shiftmap.base import Ways, across, find_ways, wideness
from pipeline.shiftmap.lowpass import surface_lowpass
from pipeline.shiftmap.reference import shift_map_fill, soft_noise
from pipeline.shiftmap.settings import (
    COST_SCALE,
    DISAGREEMENT_COST,
    DISAGREEMENT_PX,
    FARTHER_COST,
    NOT_KNOWN_COST,
    TILE_PX,
    WINDOW_PX,
    WINDOW_STEP_PX,
    ShiftMapSettings,
)
from pipeline.shiftmap.tiles import Search, cut_tiles, random_steps, shifted

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


def fill(frame: WarpedFrame, seed=1, **settings):
    return shift_map_fill(frame, ShiftMapSettings(**settings), seed=seed, z_near_m=Z_NEAR_M)


@pytest.fixture(scope="module")
def repeating():
    """Noise that repeats every `PERIOD_PX` columns, behind a hole 20 px wide; and its fill."""
    rng = np.random.default_rng(3)
    colour = np.tile(rng.uniform(0.2, 0.8, (40, PERIOD_PX, 3)), (1, 5, 1))
    frame = beside_foreground(colour, 20)
    return frame, fill(frame)


# --- the low-pass ---------------------------------------------------------------------------


def test_a_lowpass_is_the_gaussian_mean_of_what_is_inside():
    """By hand: 1 pixel aside weighs exp(-1/2), the middle one is outside the mask."""
    row = np.array([1.0, 100.0, 3.0])[None, :, None]
    inside = np.array([[True, False, True]])

    found = surface_lowpass(row, inside, np.zeros((1, 3)), 1.0, THRESHOLD)[0, :, 0]

    aside, two = np.exp(-0.5), np.exp(-2.0)
    assert found[0] == pytest.approx((1 + 3 * two) / (1 + two))
    assert found[1] == pytest.approx((1 * aside + 3 * aside) / (2 * aside))


def test_a_lowpass_does_not_cross_a_jump_of_depth(rng):
    guide = np.zeros((20, 20))
    guide[:, 10:] = 0.5
    values = np.where(guide > 0, 1.0, 0.25)[..., None]

    found = surface_lowpass(values, rng.random((20, 20)) < 0.7, guide, 2.0, THRESHOLD)

    np.testing.assert_allclose(found, values, atol=1e-12)


def test_a_lowpass_is_zero_where_nothing_is_inside():
    nothing = np.zeros((4, 4), bool)

    assert not surface_lowpass(np.ones((4, 4, 1)), nothing, np.zeros((4, 4)), 2.0, 0.1).any()


# --- ways and base --------------------------------------------------------------------------


def test_ways_lead_to_the_background_and_know_how_wide_the_hole_is():
    """Hole columns 8 to 12: the first known one on the right is 13, its colour taken from 14."""
    frame = beside_foreground(np.zeros((3, 24, 3)), 5)

    ways = find_ways(frame, THRESHOLD)

    row = ways.pixel[:, 0] == 1
    assert ways.pixel[row, 1].tolist() == [8, 9, 10, 11, 12]
    assert ways.steps[row].tolist() == [5, 4, 3, 2, 1]
    assert ways.end[row].tolist() == [[1, 14]] * 5
    assert ways.across_px.tolist() == [5.0] * 15
    np.testing.assert_allclose(ways.step, [[0.0, 1.0]] * 15, atol=1e-12)


@pytest.mark.parametrize(
    ("width_px", "share"), [(1, 0.0), (2, 0.0), (3, 0.25), (5, 0.75), (6, 1.0), (9, 1.0)]
)
def test_holes_are_thin_up_to_two_pixels_and_not_from_six(width_px, share):
    frame = beside_foreground(np.zeros((8, 40, 3)), width_px)

    found = wideness(frame.hole, find_ways(frame, THRESHOLD), guide_of(frame), THRESHOLD)

    np.testing.assert_allclose(found[frame.hole], share, atol=1e-12)
    assert not found[~frame.hole].any()


def test_ends_side_by_side_are_averaged_by_the_way_to_them():
    """By hand: 4 steps from the end the deviation is 1 px and the reach 2, in rows above and below.

    One row is 1, all others 0: it gets 1 / (1 + 2 e^-1/2 + 2 e^-2), the next e^-1/2 of that.
    """
    colour = np.zeros((9, 32, 3))
    colour[4] = 1.0
    frame = beside_foreground(colour, 4)
    ways = find_ways(frame, THRESHOLD)

    found = across(colour, frame.hole, ways, guide_of(frame), THRESHOLD)

    deepest = found[ways.pixel[:, 1] == 8, 0]
    whole = 1 + 2 * np.exp(-0.5) + 2 * np.exp(-2.0)
    shares = np.array([0, 0, np.exp(-2.0), np.exp(-0.5), 1, np.exp(-0.5), np.exp(-2.0), 0, 0])
    np.testing.assert_allclose(deepest[2:-2], shares[2:-2] / whole)
    assert deepest[0] == deepest[-1] == 0


def test_ends_of_another_surface_are_not_averaged():
    """The upper half of the background lies at 20 m: its colour stays above."""
    colour = np.zeros((16, 48, 3))
    colour[:8] = 1.0
    frame = beside_foreground(colour, 16)
    depth_m = frame.depth_m.copy()
    depth_m[:8, 8:] = 20.0
    frame = WarpedFrame(frame.colour, depth_m, frame.hole, frame.flow_px)
    ways = find_ways(frame, THRESHOLD)

    found = across(colour, frame.hole, ways, guide_of(frame), THRESHOLD)

    np.testing.assert_allclose(found[:, 0], ways.pixel[:, 0] < 8, atol=1e-12)


def test_thin_holes_are_filled_as_by_push_pull_and_get_no_detail(rng, gl_context):
    from pipeline.methods.registry import create_method

    frame = beside_foreground(rng.random((32, 48, 3)), 2)
    method = create_method("push-pull-depth", gl_context, {"z_near_m": Z_NEAR_M})

    found = fill(frame)

    assert len(found.tiles.place) == 0
    assert not found.gain.any()
    # The twin of push-pull-depth agrees within its own tolerance: rounding, per resolution.
    np.testing.assert_allclose(found.colour, method.fill(frame, 1), atol=36 * 7 * 2.0**-24)
    method.release()


# --- tiles and their cost -------------------------------------------------------------------


def random_search(rng, size=(36, 44)):
    """A random scene of two surfaces with ragged holes, cut into tiles."""
    hole = rng.random(size) < 0.3
    hole[10:24, 12:30] = True
    guide = np.where(np.arange(size[1]) < 20, 0.3, 0.6) + rng.uniform(0, 0.05, size)
    flow_px = np.full((*size, 2), (2.3, -1.6), np.float32)
    pixels = np.argwhere(hole)
    step = np.tile((0.0, 1.0), (len(pixels), 1))
    ways = Ways(pixels, step, rng.integers(1, 9, len(pixels)), pixels, np.ones(len(pixels)))
    tiles = cut_tiles(hole, guide, flow_px, ways)
    colour, base, low = rng.random((3, *size, 3))
    return Search(tiles, hole, guide, colour, base, low, THRESHOLD), hole, guide, colour, base, low


def plain_cost(search, tile, shift, hole, guide, colour, base, low):
    """The cost of one tile's shift, pixel by pixel."""
    tiles, (height, width) = search.tiles, hole.shape
    whole = lambda image: np.rint(255 * image).astype(int)  # noqa: E731
    of_base, beside = [], []
    pixels = unknown = farther = 0
    top, left = tiles.corner[tile]
    for y in range(max(0, top - WINDOW_PX), min(height, top + TILE_PX + WINDOW_PX)):
        for x in range(max(0, left - WINDOW_PX), min(width, left + TILE_PX + WINDOW_PX)):
            v, u = y + shift[0], x + shift[1]
            is_source = 0 <= v < height and 0 <= u < width and not hole[v, u]
            if tiles.label[y, x] == tile:
                pixels += 1
                if not is_source or guide[y, x] - guide[v, u] > THRESHOLD:
                    unknown += 1
                    continue
                farther += guide[v, u] - guide[y, x] > THRESHOLD
                of_base.append(((whole(base[y, x]) - whole(low[v, u])) ** 2).sum())
            elif not hole[y, x] and abs(guide[y, x] - tiles.guide[tile]) <= THRESHOLD:
                on_lattice = (y - top) % WINDOW_STEP_PX == (x - left) % WINDOW_STEP_PX == 0
                if on_lattice and is_source and tiles.guide[tile] - guide[v, u] <= THRESHOLD:
                    beside.append(((whole(colour[y, x]) - whole(colour[v, u])) ** 2).sum())
    least = (TILE_PX // WINDOW_STEP_PX) ** 2
    return (
        COST_SCALE * sum(of_base) // max(1, len(of_base))
        + COST_SCALE * sum(beside) // max(least, len(beside))
        + COST_SCALE * NOT_KNOWN_COST * unknown // pixels
        + COST_SCALE * FARTHER_COST * farther // pixels
    )


def test_a_cost_is_the_one_that_plain_loops_find(rng):
    search, *planes = random_search(rng)
    every = np.arange(len(search.tiles.place))
    assert len(every) > 20

    for _ in range(4):
        shift = rng.integers(-20, 21, (len(every), 2))
        wanted = [plain_cost(search, tile, shift[tile], *planes) for tile in every]
        assert search.cost(every, shift).tolist() == wanted


def test_tiles_move_with_the_background(rng):
    """In a picture that moved by (3, 5) px, the same tiles take the same shifts and pixels.

    Foreground all around is no source, and so stands for the frame's end, which does not move.
    """
    size = (72, 104)
    background = np.zeros(size, bool)
    background[12:-12, 12:-12] = True
    whole = np.zeros(size, bool)
    whole[20:44, 20:40] = True
    colour, base, low = rng.random((3, *size, 3))

    def found(*by):
        def moved(array):
            return np.roll(array, by, axis=(0, 1))

        hole, guide = moved(whole), moved(np.where(background, 0.6, 0.0))
        flow_px = np.full((*size, 2), by[::-1], np.float32)
        pixels = np.argwhere(hole)
        step = np.tile((0.0, 1.0), (len(pixels), 1))
        ways = Ways(pixels, step, 40 + by[1] - pixels[:, 1], pixels, np.ones(len(pixels)))
        tiles = cut_tiles(hole, guide, flow_px, ways)
        search = Search(tiles, hole, guide, moved(colour), moved(base), moved(low), THRESHOLD)
        shift = search.agree(search.first_shifts(), 1)
        copied, _ = shifted(moved(colour), tiles, shift, hole, guide, flow_px, THRESHOLD)
        return tiles.place, shift, copied[hole]

    for still, moved in zip(found(0, 0), found(3, 5), strict=True):
        np.testing.assert_allclose(moved, still, atol=1e-12)


def test_the_shift_of_a_repeating_texture_is_its_period(repeating):
    """Nothing else matches the known pixels around: by hand, 24 px or 48 px to the right."""
    _, found = repeating

    assert len(found.shift) == 15
    assert (found.shift[:, 0] == 0).all()
    assert (found.shift[:, 1] % PERIOD_PX == 0).all()
    assert (found.shift[:, 1] > 0).all()


def test_the_detail_of_a_repeating_texture_is_the_true_one(repeating):
    """The whole picture's own detail, which the fill has not seen, comes back."""
    frame, found = repeating
    everywhere = np.ones(frame.size, bool)
    flat = np.zeros(frame.size)
    picture = frame.colour.astype(np.float64)
    true = picture - surface_lowpass(picture, everywhere, flat, 2.0, THRESHOLD)

    inner = frame.hole & (np.arange(frame.size[1]) >= 16)
    assert found.copied[inner].all()
    assert np.corrcoef(found.detail[inner].ravel(), true[inner].ravel())[0, 1] > 0.97


# --- sweeps, hashes, blends -----------------------------------------------------------------


def test_disagreement_is_the_mean_distance_from_neighbours_shifts():
    """By hand: one is 3 px off, one farther than counts, six are none."""
    shifts = np.array([[0, 0], [2, 1], [0, 50]])
    none = np.array([-1])
    beside = [np.array([1]), np.array([2]), *[none] * 6]

    found = Search._disagreement(np.array([[0, 0]]), beside, shifts)

    scale = COST_SCALE * DISAGREEMENT_COST
    assert found.tolist() == [scale * (3 + DISAGREEMENT_PX) // (DISAGREEMENT_PX * 2)]


def test_sweeps_never_raise_the_cost_of_all(rng):
    search, *_ = random_search(rng)
    first = search.first_shifts()
    every = np.arange(len(first))

    def whole(shift):
        row, column = (search.tiles.place - search.tiles.first).T
        beside = [
            search.tiles.index[row + i, column + j]
            for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)
        ]  # fmt: skip
        return int((search.cost(every, shift) + search._disagreement(shift, beside, shift)).sum())

    assert whole(search.agree(first, 1)) < whole(first)


@pytest.mark.parametrize("reach_px", [2, 16])
def test_random_steps_use_all_their_reach_and_hang_on_place_and_seed_alone(reach_px):
    place = np.stack(np.meshgrid(np.arange(-40, 40), np.arange(-40, 40)), axis=-1).reshape(-1, 2)

    steps = random_steps(place, 1, 9, 5, reach_px)

    assert steps.min() == -reach_px
    assert steps.max() == reach_px
    assert abs(steps.mean()) < 0.05 * reach_px
    assert (steps[100:200] == random_steps(place[100:200], 1, 9, 5, reach_px)).all()
    for other in (random_steps(place, 1, 9, 6, reach_px), random_steps(place, 2, 9, 5, reach_px)):
        assert (steps != other).any(axis=1).mean() > 0.9


def one_row_of_tiles(hole):
    size = hole.shape
    pixels = np.argwhere(hole)
    ways = Ways(
        pixels, np.tile((0.0, 1.0), (len(pixels), 1)), np.ones(len(pixels), int), pixels,
        np.ones(len(pixels)),
    )  # fmt: skip
    return cut_tiles(hole, np.zeros(size), np.zeros((*size, 2), np.float32), ways)


def test_one_shift_for_all_copies_pixel_by_pixel_and_different_ones_keep_the_variance(rng):
    hole = np.zeros((64, 160), bool)
    hole[:, :64] = True
    source = rng.standard_normal((64, 160, 1))
    tiles = one_row_of_tiles(hole)
    flow_px, guide = np.zeros((64, 160, 2), np.float32), np.zeros((64, 160))
    same = np.full((64, 2), (0, 70))
    many = np.stack([np.zeros(64, int), rng.choice(np.arange(64, 96), 64)], axis=1)

    copied, found = shifted(source, tiles, same, hole, guide, flow_px, THRESHOLD)
    mixed, _ = shifted(source, tiles, many, hole, guide, flow_px, THRESHOLD)

    assert found[hole].all()
    np.testing.assert_allclose(copied[:, :64], source[:, 70:134], atol=1e-12)
    assert mixed[hole].std() == pytest.approx(1.0, abs=0.05)  # 4096 samples: 1.1 % by chance


def test_nothing_nearer_is_ever_copied():
    hole = np.zeros((16, 48), bool)
    hole[:, :16] = True
    guide = np.where(np.arange(48) < 32, 0.6, 0.2) * np.ones((16, 1))
    tiles = one_row_of_tiles(hole)
    shift = np.full((4, 2), (0, 24))  # half onto the nearer surface

    _, found = shifted(np.ones((16, 48, 1)), tiles, shift, hole, guide, np.zeros((16, 48, 2)), 0.04)

    assert found[:, :8].all()
    assert not found[:, 8:].any()


def test_noise_without_a_source_has_unit_variance_and_moves_with_its_place():
    texel = np.stack(np.indices((200, 200)), axis=-1)

    found = soft_noise(texel, 4)

    assert found.std() == pytest.approx(1.0, abs=0.02)
    assert abs(found.mean()) < 0.03
    np.testing.assert_array_equal(soft_noise(texel + np.array((3, -5)), 4)[:-3, 5:], found[3:, :-5])
    assert abs(np.corrcoef(soft_noise(texel, 5).ravel(), found.ravel())[0, 1]) < 0.05


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
