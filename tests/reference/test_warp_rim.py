"""The rim of mixed pixels along holes: by hand, against its rule in plain loops, and in a warp."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.errors import InputError
from pipeline.frame import SourceFrame, TargetWindow, WarpedFrame
from pipeline.warp.reference import warp
from pipeline.warp.settings import WarpSettings
from pipeline.warp.speckle import without_rim

FAR, NEAR = 5.0, 2.0
ALIKE_PX = 2.0


def seen(hole, depth_m=FAR) -> WarpedFrame:
    """Make a warped frame with these holes; colours differ, motion is 20 m px / depth."""
    mask = np.zeros((12, 12), np.bool_)
    mask[hole] = True
    rng = np.random.default_rng(1)
    colour = rng.uniform(0.1, 1, (12, 12, 3)).astype(np.float32)
    colour[mask] = 0
    depth = np.broadcast_to(np.asarray(depth_m, np.float32), (12, 12)).copy()
    flow = np.stack([20 / depth, -20 / depth], axis=-1)
    return WarpedFrame(colour, depth, mask, flow)


def rim(warped: WarpedFrame, rim_px: int) -> set[tuple[int, int]]:
    """Give row and column of each pixel that became hole."""
    grown = without_rim(warped, rim_px, ALIKE_PX).hole
    assert (grown >= warped.hole).all()
    return {(int(row), int(column)) for row, column in np.argwhere(grown & ~warped.hole)}


def columns(*which: int) -> set[tuple[int, int]]:
    """Give all pixels of these columns."""
    return {(row, column) for row in range(12) for column in which}


def beside_a_post() -> np.ndarray:
    """Give depths: a post in columns 0 to 3, and what is behind it."""
    return np.where(np.arange(12) < 4, NEAR, FAR)[None]


@pytest.mark.parametrize(("rim_px", "taken"), [(0, ()), (1, (7,)), (2, (7, 8)), (4, (7, 8, 9, 10))])
def test_the_backgrounds_side_is_taken_and_the_foregrounds_is_not(rim_px, taken):
    """By hand: the post moved left and uncovered columns 4 to 6."""
    assert rim(seen(np.s_[:, 4:7], beside_a_post()), rim_px) == columns(*taken)


def test_both_sides_are_taken_where_both_are_background():
    assert rim(seen(np.s_[:, 4:7]), 1) == columns(3, 7)


@pytest.mark.parametrize("rim_px", [1, 2, 4])
def test_a_gap_of_two_pixels_has_no_rim(rim_px):
    """Rounding leaves such gaps in slanted surfaces."""
    assert rim(seen(np.s_[:, 4:6]), rim_px) == set()


def test_a_hole_is_as_deep_as_it_is_in_that_direction():
    """By hand: two pixels wide, six high: only its ends have three hole pixels before them."""
    assert rim(seen(np.s_[3:9, 4:6]), 1) == {(2, 4), (2, 5), (9, 4), (9, 5)}


def test_diagonals_count():
    """By hand: 3 by 3 pixels have a rim all round, corners too."""
    ring = {(row, column) for row in range(3, 8) for column in range(3, 8)}
    ring -= {(row, column) for row in range(4, 7) for column in range(4, 7)}
    assert rim(seen(np.s_[4:7, 4:7]), 1) == ring


def test_each_line_is_judged_by_itself():
    """By hand: 3 by 3 pixels but the last corner. Two rows, two columns, one diagonal are whole."""
    frame = seen(([4, 4, 4, 5, 5, 5, 6, 6], [4, 5, 6, 4, 5, 6, 4, 5]))
    sides = {(4, 3), (4, 7), (5, 3), (5, 7), (3, 4), (7, 4), (3, 5), (7, 5)}
    assert rim(frame, 1) == sides | {(3, 7), (7, 3)}


def test_what_lies_beyond_the_edge_is_known():
    assert rim(seen(np.s_[:, :3]), 1) == columns(3)
    assert rim(seen(np.s_[:, :2]), 4) == set()
    assert rim(seen(np.s_[:3, :]), 2) == {(row, c) for row in (3, 4) for c in range(12)}
    assert rim(seen(np.s_[:, 9:]), 1) == columns(8)
    assert rim(seen(np.s_[10:, :]), 1) == set()


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(
    ("off_px", "taken"), [(0, True), (2, True), (-2, True), (2.01, False), (-2.01, False)]
)
def test_what_moves_as_the_hole_does_is_its_background(off_px, axis, taken):
    """By hand, to 2 px along either axis."""
    warped = seen(np.s_[:, 4:7])
    warped.flow_px[~warped.hole, axis] += np.float32(off_px)
    assert rim(warped, 1) == (columns(3, 7) if taken else set())


def test_what_is_a_little_nearer_and_uncovered_the_hole_is_not_taken():
    """By hand: at 4.8 % nearer, a shift of 104 px by disparity leaves a hole of 4 px."""
    depth = np.where(np.arange(12) < 4, 1 / 104, 1 / 99)[None]
    warped = seen(np.s_[:, 4:8], depth)
    warped.flow_px[..., 0] = -1 / warped.depth_m
    warped.flow_px[..., 1] = 0
    assert rim(warped, 2) == columns(8, 9)


def test_the_nearest_hole_pixel_says_how_the_background_moves():
    """By hand: a hole of 9, 3 and 3 m between two walls at 3 m has a rim at the right alone."""
    depth = np.full((1, 12), 3.0)
    depth[0, 4] = 9.0
    assert rim(seen(np.s_[:, 4:7], depth), 1) == columns(7)
    # Seen from two pixels off it is the same hole pixel that counts.
    assert rim(seen(np.s_[:, 4:7], depth), 2) == columns(7, 8)


def test_a_rim_has_no_rim():
    """By hand: column 7 becomes hole, and the gap in columns 8 and 9 is then three deep.

    Seen from column 10 it was two hole pixels and a known one, and that counts.
    """
    hole = np.zeros((12, 12), np.bool_)
    hole[:, 4:7] = hole[:, 8:10] = True
    assert rim(seen(hole, beside_a_post()), 1) == columns(7)


def test_the_rim_loses_its_colour_and_keeps_depth_and_motion():
    warped = seen(np.s_[:, 4:7], beside_a_post())
    grown = without_rim(warped, 2, ALIKE_PX)
    taken = grown.hole & ~warped.hole
    np.testing.assert_array_equal(grown.colour[taken], 0)
    np.testing.assert_array_equal(grown.colour[~taken], warped.colour[~taken])
    np.testing.assert_array_equal(grown.depth_m, warped.depth_m)
    np.testing.assert_array_equal(grown.flow_px, warped.flow_px)
    assert warped.hole.sum() == 36  # the one given is left alone


def by_the_rule(warped: WarpedFrame, rim_px: int, alike_px: float) -> np.ndarray:
    """Judge pixel by pixel."""
    height, width = warped.size
    grown = warped.hole.copy()

    def is_hole(y: int, x: int) -> bool:
        return 0 <= y < height and 0 <= x < width and bool(warped.hole[y, x])

    for y, x in np.argwhere(~warped.hole):
        for dy, dx in [(-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)]:
            first = next((k for k in range(1, rim_px + 1) if is_hole(y + k * dy, x + k * dx)), None)
            if first is None:
                continue
            line = [(y + k * dy, x + k * dx) for k in range(first, first + 3)]
            off_px = abs(warped.flow_px[y, x] - warped.flow_px[line[0]])
            if all(is_hole(*place) for place in line) and np.max(off_px) <= alike_px:
                grown[y, x] = True
    return grown


draws = st.integers(0, 2**32 - 1).map(np.random.default_rng)


@given(rng=draws, share=st.sampled_from([0.2, 0.6, 0.9]), rim_px=st.integers(1, 4))
@settings(max_examples=60)
def test_any_holes_are_judged_by_the_rule(rng, share, rim_px):
    height, width = (int(edge) for edge in rng.integers(1, 13, 2))
    hole = rng.random((height, width)) < share
    flow = rng.choice([0, 1.9, 2, 2.1], (height, width, 2)).astype(np.float32)
    colour, depth = np.ones((height, width, 3), np.float32), np.ones((height, width), np.float32)
    warped = WarpedFrame(colour, depth, hole, flow)
    np.testing.assert_array_equal(
        without_rim(warped, rim_px, ALIKE_PX).hole, by_the_rule(warped, rim_px, ALIKE_PX)
    )


# ---- in a warp


@given(rng=draws, scale=st.sampled_from([1.0, 4.0, 15.0]), rim_px=st.integers(1, 4))
@settings(max_examples=20)
def test_a_warp_with_a_rim_only_loses_known_pixels(rng, scale, rim_px):
    frame = SourceFrame(
        rng.uniform(0.25, 0.75, (14, 17, 3)).astype(np.float32),
        rng.uniform(1, 9, (14, 17)).astype(np.float32),
    )
    flow = (scale * rng.standard_normal((14, 17, 2))).astype(np.float32)

    bare = warp(frame, flow)
    grown = warp(frame, flow, settings=WarpSettings(rim_px=rim_px))

    # Sides of 2 px, 1 px longer than at rest, are torn in so small a window.
    np.testing.assert_array_equal(grown.hole, by_the_rule(bare, rim_px, 1.0))
    np.testing.assert_array_equal(grown.depth_m, bare.depth_m)
    np.testing.assert_array_equal(grown.flow_px, bare.flow_px)
    np.testing.assert_array_equal(grown.colour[~grown.hole], bare.colour[~grown.hole])
    np.testing.assert_array_equal(grown.colour[grown.hole], 0)


def test_no_rim_is_the_default_and_changes_no_bit(disc_over_plane):
    flow = np.stack([60 / disc_over_plane.depth_m, 17 / disc_over_plane.depth_m], axis=-1)
    bare, none = (
        warp(disc_over_plane, flow, settings=s) for s in (WarpSettings(), WarpSettings(rim_px=0))
    )
    for name in ("colour", "depth_m", "hole", "flow_px"):
        np.testing.assert_array_equal(getattr(bare, name), getattr(none, name))
    assert without_rim(bare, 0, ALIKE_PX) is bare


@pytest.mark.parametrize("rim_px", [1, 2, 4])
def test_a_disc_keeps_every_pixel_and_leaves_no_ghost(disc_over_plane, rim_px):
    """[MI] Fig. 5's scene as a camera sees it: the disc's outline is half disc, half wall.

    The mixed pixels have the wall's depth, so they stay where the disc was.
    """
    disc = disc_over_plane.depth_m == 2
    outside = ~disc & (
        np.roll(disc, 1, 0) | np.roll(disc, -1, 0) | np.roll(disc, 1, 1) | np.roll(disc, -1, 1)
    )
    colour = disc_over_plane.colour.copy()
    colour[outside] = (0, 1, 0)  # no other pixel is green
    frame = SourceFrame(colour, disc_over_plane.depth_m)
    flow = np.stack([60 / frame.depth_m, 15 / frame.depth_m], axis=-1).astype(np.float32)

    bare = warp(frame, flow)
    grown = warp(frame, flow, settings=WarpSettings(rim_px=rim_px))

    front = bare.depth_m == 2
    np.testing.assert_array_equal(grown.hole[front], bare.hole[front])
    inner = np.s_[:, 20:]  # right of what enters at the border
    taken = (grown.hole & ~bare.hole)[inner]
    np.testing.assert_array_equal(bare.depth_m[inner][taken], 5)
    ghost = ((bare.colour[..., 1] > 0.9) & ~front)[inner]
    assert ghost.sum() > 40
    left = ghost & ~grown.hole[inner]
    # What stays lies where the hole is less than three pixels deep.
    assert left.sum() < 0.2 * ghost.sum()


# ---- bad input


@pytest.mark.parametrize("value", [-1, 5, 1.0, 0.5, True, False, "1", None, float("nan")])
def test_a_rim_is_a_whole_number_of_pixels(value):
    with pytest.raises(InputError, match=r"rim_px must be a whole number from 0 to 4 \(got "):
        WarpSettings(rim_px=value)


def test_motions_are_alike_if_they_tear_no_neighbours_apart():
    """By hand: 0.005 of 1000 px is 5 px, of which 1 is the side at rest; at least 2."""
    assert WarpSettings().alike_px(TargetWindow(0, 0, 1000, 10)) == 4
    assert WarpSettings().alike_px(TargetWindow(0, 0, 100, 10)) == 1
    assert WarpSettings(stretch_px=3.5).alike_px(TargetWindow(0, 0, 100, 10)) == 2.5


@pytest.mark.parametrize("variant", ["smear", "remove"])
def test_a_rim_needs_the_depth_of_holes(variant):
    with pytest.raises(InputError, match=f"rim_px must be 0 for variant {variant}.*got 2"):
        WarpSettings(variant, rim_px=2)
    assert WarpSettings(variant, rim_px=0).variant == variant
