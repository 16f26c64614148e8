"""The warp's definition against values worked by hand, and against what must always hold."""

import numpy as np
import pytest
from cameras import wide_camera
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import ndimage

from pipeline.camera import flow_between
from pipeline.errors import InputError
from pipeline.frame import SourceFrame, TargetWindow
from pipeline.warp.reference import coverage, inside, moved_mesh, torn_quads, warp
from pipeline.warp.settings import SUBPIXELS, WarpSettings

Flow = NDArray[np.float32]
FLOAT32 = 2.0**-24  # roundoff: the reference computes in double and returns float32


def grey(values: object, depth_m: object) -> SourceFrame:
    """Make a grey frame."""
    plane = np.asarray(values, np.float32)
    depth = np.broadcast_to(np.asarray(depth_m, np.float32), plane.shape).copy()
    return SourceFrame(np.repeat(plane[..., None], 3, axis=2), depth)


def noise(rng: np.random.Generator, height: int, width: int, depth_m: float = 3.0) -> SourceFrame:
    """Make a frame of random colours at one depth."""
    return SourceFrame(
        rng.random((height, width, 3), np.float32), np.full((height, width), depth_m, np.float32)
    )


def still(frame: SourceFrame) -> Flow:
    """Give no motion."""
    return np.zeros((*frame.size, 2), np.float32)


def parallax(frame: SourceFrame, x: float, y: float = 0.0) -> Flow:
    """Give the motion under a move of the camera parallel to its image: (x, y) px at 1 m."""
    inverse = 1 / frame.depth_m.astype(np.float64)
    return np.stack([x * inverse, y * inverse], axis=-1).astype(np.float32)


def similarity(height: int, width: int, zoom: float, turn_rad: float) -> Flow:
    """Give the motion of a zoom and a turn about the image's centre."""
    y, x = np.mgrid[:height, :width] + 0.5 - np.array([height, width])[:, None, None] / 2
    cosine, sine = zoom * np.cos(turn_rad), zoom * np.sin(turn_rad)
    moved = np.stack([cosine * x - sine * y - x, sine * x + cosine * y - y], axis=-1)
    return moved.astype(np.float32)


# ---- rest and translation


@pytest.mark.parametrize("size", [(1, 1), (1, 6), (6, 1), (2, 2), (13, 17)])
def test_no_motion_returns_the_frame_bit_by_bit(rng, size):
    frame = noise(rng, *size)
    frame.depth_m[...] = rng.uniform(1, 1.001, size)

    warped = warp(frame, still(frame))

    assert not warped.hole.any()
    np.testing.assert_array_equal(warped.colour, frame.colour)
    np.testing.assert_array_equal(warped.depth_m, frame.depth_m)
    np.testing.assert_array_equal(warped.flow_px, 0)


@pytest.mark.parametrize(("dx", "dy"), [(3, 0), (-4, 0), (0, 5), (2, -3)])
def test_whole_pixel_translation_moves_every_bit(rng, dx, dy):
    frame = noise(rng, 12, 15)
    flow = np.broadcast_to(np.float32((dx, dy)), (12, 15, 2)).copy()

    warped = warp(frame, flow)

    source = np.pad(frame.colour, ((8, 8), (8, 8), (0, 0)), constant_values=-1)
    expected = source[8 - dy : 20 - dy, 8 - dx : 23 - dx]
    hole = (expected < 0).any(axis=-1)
    np.testing.assert_array_equal(warped.hole, hole)
    np.testing.assert_array_equal(warped.colour[~hole], expected[~hole])
    np.testing.assert_array_equal(warped.depth_m, 3)  # also in border holes
    np.testing.assert_array_equal(warped.flow_px, flow)


def test_half_a_pixel_is_the_mean_of_two_neighbours():
    """By hand. The border pixel's footprint covers the column it half leaves."""
    frame = grey([[0.2, 0.4, 0.8, 0.8]], 2)

    warped = warp(frame, np.full((1, 4, 2), (0.5, 0), np.float32))

    np.testing.assert_array_equal(warped.hole, [[False, False, False, False]])
    np.testing.assert_allclose(warped.colour[0, :, 0], [0.2, 0.3, 0.6, 0.8], rtol=FLOAT32)


def test_depth_is_interpolated_along_the_surface():
    """By hand: halfway between 1 m and 3 m on the image lies 1.5 m, since 1/z is linear."""
    frame = grey([[0.0, 1.0]], [[1, 3]])

    warped = warp(frame, np.full((1, 2, 2), (0.5, 0), np.float32))

    assert warped.depth_m[0, 1] == pytest.approx(1.5, rel=FLOAT32)
    assert warped.colour[0, 1, 0] == pytest.approx(0.5, rel=FLOAT32)


# ---- Fig. 5


def test_holes_behind_a_disc_have_exactly_the_background_depth(disc_over_plane):
    warped = warp(disc_over_plane, parallax(disc_over_plane, 60, 15))

    disc = warped.colour[..., 0] > 1.5 * warped.colour[..., 1]
    assert warped.hole[:, 20:].sum() > 500
    np.testing.assert_array_equal(warped.depth_m[warped.hole], 5)
    np.testing.assert_array_equal(warped.flow_px[warped.hole], [(12, 3)] * warped.hole.sum())
    np.testing.assert_array_equal(warped.depth_m[disc], 2)
    np.testing.assert_array_equal(warped.depth_m[~disc], 5)


def test_no_pixel_mixes_foreground_and_background(disc_over_plane):
    """Both move by whole pixels here, so every known pixel is one that the source had."""
    warped = warp(disc_over_plane, parallax(disc_over_plane, 60, 20))

    known = warped.colour[~warped.hole]
    source = disc_over_plane.colour.reshape(-1, 3)
    assert np.isin(known.view("V12"), np.ascontiguousarray(source).view("V12")).all()


def test_a_torn_block_keeps_its_size():
    """By hand: all its pixels but the last corner, whose centre no whole quad's strip covers."""
    colour, depth = np.full((20, 24), 0.2), np.full((20, 24), 5.0)
    colour[4:10, 5:11], depth[4:10, 5:11] = 0.8, 1
    frame = grey(colour, depth)
    flow = still(frame)
    flow[4:10, 5:11] = (9, 6)

    warped = warp(frame, flow)

    block = np.zeros((20, 24), np.bool_)
    block[10:16, 14:20] = True
    block[15, 19] = False
    np.testing.assert_array_equal(warped.depth_m == 1, block)
    np.testing.assert_array_equal(warped.colour[block], np.float32(0.8))
    left = np.zeros((20, 24), np.bool_)
    left[4:10, 5:11] = True
    np.testing.assert_array_equal(warped.hole, left)


def test_a_step_along_the_motion_opens_no_crack():
    """Two halves slide past each other: nothing is uncovered between them."""
    depth = np.repeat(np.float32([[1], [1], [1], [4], [4], [4]]), 40, axis=1)
    frame = grey(np.full((6, 40), 0.5), depth)

    warped = warp(frame, parallax(frame, 12))

    assert not warped.hole[:, 12:].any()
    np.testing.assert_array_equal(warped.depth_m[:, 12:], depth[:, 12:])


@pytest.mark.parametrize("thickness_px", [1, 2, 3])
def test_thin_things_keep_their_width(thickness_px):
    depth = np.full((1, 40), 5.0)
    depth[0, 8 : 8 + thickness_px] = 1
    frame = grey(np.full((1, 40), 0.5), depth)

    warped = warp(frame, parallax(frame, 15))

    assert (~warped.hole & (warped.depth_m == 1)).sum() == thickness_px


# Each is one pixel thin; the last is joined by its sides, the one before by corners only.
LINES = {
    "down": [(row, 20) for row in range(48)],
    "across": [(24, column) for column in range(48)],
    "diagonal": [(row, row) for row in range(48)],
    "steep": [(row, 10 + row // 3) for row in range(48)],
    "staircase": [(row, row + extra) for row in range(47) for extra in (0, 1)],
}


def line_before_a_plane(
    pixels: list[tuple[int, int]], shift: tuple[float, float]
) -> tuple[SourceFrame, Flow, NDArray[np.bool_]]:
    """Move a line of `pixels` by `shift` (x, y) before a plane at rest; and where it was."""
    line = np.zeros((48, 48), np.bool_)
    line[tuple(np.transpose(pixels))] = True
    frame = grey(np.where(line, 0.9, 0.2), np.where(line, 1, 5))
    return frame, np.where(line[..., None], np.float32(shift), np.float32(0)), line


@pytest.mark.parametrize("shift", [(7, 0), (-6, 5), (5.25, -6.5), (0.5, 8.5), (-7.9, 0.3)])
@pytest.mark.parametrize("name", LINES)
def test_a_line_of_one_pixel_stays_the_same_line_under_any_shift(name, shift):
    """Each of its pixels covers one centre of the target's, so it moves to the nearest whole."""
    frame, flow, line = line_before_a_plane(LINES[name], shift)

    warped = warp(frame, flow, window=TargetWindow(-16, -16, 80, 80))

    # A centre where two footprints meet belongs to the one below or right of it.
    right, down = (int(np.ceil(along - 0.5)) for along in shift)
    expected = np.zeros((80, 80), np.bool_)
    expected[16 + down : 64 + down, 16 + right : 64 + right] = line
    found = ~warped.hole & (warped.depth_m == 1)
    inside = slice(24, 56)  # whole lines: their ends lie outside, and go on beyond the border
    np.testing.assert_array_equal(found[inside, inside], expected[inside, inside])
    np.testing.assert_array_equal(warped.colour[found], np.float32(0.9))


def test_a_line_leaves_a_hole_exactly_where_it_was():
    frame, flow, line = line_before_a_plane(LINES["down"], (7, 0))
    warped = warp(frame, flow)
    np.testing.assert_array_equal(warped.hole, line)
    np.testing.assert_array_equal(warped.depth_m[line], 5)


def test_a_slit_of_one_pixel_shows_what_lies_behind_it():
    """By hand: two near walls part, and the background seen between them stays."""
    depth = np.full((9, 40), 1.0)
    depth[:, 20] = 5
    frame = grey(np.where(depth == 5, 0.9, 0.2), depth)
    flow = still(frame)
    flow[:, :20, 0], flow[:, 21:, 0] = -8, 8

    warped = warp(frame, flow)

    slit = ~warped.hole & (warped.depth_m == 5)
    np.testing.assert_array_equal(np.argwhere(slit), [(row, 20) for row in range(9)])
    np.testing.assert_array_equal(warped.colour[slit], np.float32(0.9))
    frame.depth_m[:, 20] = 1  # as near as the walls: a step of motion, blurred over one pixel
    assert warp(frame, flow).hole[:, 20].all()


def test_the_nearer_of_two_crossing_lines_is_in_front():
    depth = np.full((48, 48), 9.0)
    depth[24, :] = 2
    depth[:, 20] = 1
    frame = grey(np.choose((depth < 9) + (depth < 2), [0.1, 0.5, 0.9]), depth)

    warped = warp(frame, parallax(frame, 10))

    assert warped.depth_m[24, 30] == 1
    row = warped.depth_m[24]
    np.testing.assert_array_equal(row[[28, 29, 31, 32]], 2)


def test_a_thin_line_is_magnified_without_gaps():
    """Three times as large, it is three pixels wide and whole."""
    frame, _, _ = line_before_a_plane(LINES["down"], (0, 0))
    near = frame.depth_m == 1
    flow = similarity(48, 48, 3.0, 0.0) + np.where(near[..., None], np.float32((20, 0)), 0)

    warped = warp(frame, flow.astype(np.float32))

    assert ((~warped.hole & (warped.depth_m == 1)).sum(axis=1) == 3).all()


def test_a_thin_line_that_turns_stays_connected():
    frame, _, line = line_before_a_plane(LINES["down"], (0, 0))
    turned = similarity(48, 48, 1.2, np.radians(35)) + np.float32((60, 4))
    flow = np.where(line[..., None], turned, np.float32(0)).astype(np.float32)

    found = warp(frame, flow, window=TargetWindow(0, -16, 160, 80))

    shown = ~found.hole & (found.depth_m == 1)
    _, pieces = ndimage.label(shown, np.ones((3, 3)))
    assert pieces == 1
    assert 48 <= shown.sum() <= 100


def test_a_lone_pixel_shows_one_pixel():
    depth = np.full((20, 30), 5.0)
    depth[10, 8] = 1
    frame = grey(np.where(depth == 1, 0.9, 0.2), depth)
    for x in (15, 15.5, 15.9):
        warped = warp(frame, parallax(frame, x))
        assert (~warped.hole & (warped.depth_m == 1)).sum() == 1


@pytest.mark.parametrize("angle_deg", [0, 30, 45, 80])
def test_nothing_stands_alone_in_the_hole_of_a_slanting_blurred_step(angle_deg):
    """Depth maps that were resampled step over two or three pixels, in every direction."""
    y, x = np.mgrid[:64, :64] + 0.5
    along = np.cos(np.radians(angle_deg)) * (x - 32) + np.sin(np.radians(angle_deg)) * (y - 32)
    depth = 1 / np.interp(along, [-1.3, 1.3], [1, 0.2])
    frame = grey(np.full((64, 64), 0.5), depth)
    towards = -30 * np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])

    warped = warp(frame, parallax(frame, *towards), window=TargetWindow.inside_margin((64, 64), 12))

    assert warped.hole.sum() > 300
    moved_px = 30 / warped.depth_m[~warped.hole]
    assert ((moved_px > 29) | (moved_px < 7)).all()  # 1 px more than what lies behind: one surface


def test_nothing_stands_alone_in_the_hole_of_a_blurred_step():
    depth = 1 / np.interp(np.arange(60), [20, 25], [1, 0.2])[None]  # 1 m, then 5 m
    frame = grey(np.full((1, 60), 0.5), depth)
    flow = -parallax(frame, 30)

    warped = warp(frame, flow)

    assert warped.hole[0, :50].sum() > 15
    assert set(warped.depth_m[0, :50][~warped.hole[0, :50]].round(4)) <= {1.0, 5.0}


def test_smear_draws_the_trail_that_the_method_avoids(disc_over_plane):
    flow = parallax(disc_over_plane, 60, 15)

    full = warp(disc_over_plane, flow)
    smear = warp(disc_over_plane, flow, settings=WarpSettings("smear"))

    trail = full.hole & ~smear.hole
    assert trail.sum() > 500
    between = (smear.depth_m[trail] > 2.01) & (smear.depth_m[trail] < 4.99)
    assert between.mean() > 0.9


def test_remove_leaves_the_same_holes_without_depth(disc_over_plane):
    flow = parallax(disc_over_plane, 60, 15)

    full = warp(disc_over_plane, flow)
    remove = warp(disc_over_plane, flow, settings=WarpSettings("remove"))

    np.testing.assert_array_equal(remove.hole, full.hole)
    np.testing.assert_array_equal(remove.colour, full.colour)
    assert np.isinf(remove.depth_m[remove.hole]).all()


# ---- who wins


def test_nearest_surface_wins():
    """By hand: the near half moves right over the far half."""
    frame = grey([[0.9] * 10 + [0.1] * 10], [[1] * 10 + [4] * 10])

    warped = warp(frame, parallax(frame, 4))

    # A surface reaches from its first pixel's centre to its last one's, this one left out.
    np.testing.assert_array_equal(warped.depth_m[0], [1] * 13 + [4] * 7)
    np.testing.assert_allclose(warped.colour[0, 4:13, 0], 0.9, rtol=2 * FLOAT32)


@pytest.mark.parametrize("left_m", [5, 8])
def test_farthest_stretched_quad_wins(left_m):
    """By hand. Two blocks leave to the right, and both torn quads lie over x = 8 to 16."""
    depth = [[left_m] * 4 + [1] * 4 + [6] * 4 + [2] * 4]
    frame = grey(np.full((1, 16), 0.5), depth)
    flow = np.zeros((1, 16, 2), np.float32)
    flow[0, :, 0] = [0] * 4 + [14] * 4 + [-4] * 4 + [10] * 4

    warped = warp(frame, flow)

    np.testing.assert_array_equal(warped.hole[0].nonzero()[0], np.arange(8, 16))
    np.testing.assert_array_equal(warped.depth_m[0, 4:8], 6)
    np.testing.assert_array_equal(warped.depth_m[0, 8:], max(left_m, 6))
    np.testing.assert_array_equal(warped.flow_px[0, 8:, 0], 0 if left_m > 6 else -4)


def test_target_depth_decides_who_is_in_front(rng):
    frame = noise(rng, 1, 20, depth_m=2)
    flow = np.zeros((1, 20, 2), np.float32)
    flow[0, :10, 0] = 6
    target = np.float32([[5] * 10 + [3] * 10])

    left_behind = warp(frame, flow, target_depth_m=target)
    left_before = warp(frame, flow, target_depth_m=8 - target)

    np.testing.assert_array_equal(left_behind.depth_m[0, 11:], 3)
    np.testing.assert_array_equal(left_behind.colour[0, 11:], frame.colour[0, 11:])
    np.testing.assert_array_equal(left_before.depth_m[0, 6:15], 3)
    np.testing.assert_array_equal(left_before.colour[0, 6:15], frame.colour[0, :9])


def test_sky_stays_behind_everything_and_fills_its_holes():
    depth = np.full((24, 32), np.inf, np.float32)
    depth[8:16, 8:16] = 2
    frame = grey(np.where(np.isinf(depth), 0.2, 0.7), depth)

    warped = warp(frame, parallax(frame, 20))

    assert warped.hole.sum() > 30
    assert np.isinf(warped.depth_m[warped.hole]).all()
    np.testing.assert_array_equal(warped.flow_px[warped.hole], 0)
    np.testing.assert_array_equal(warped.depth_m[8:15, 18:25], 2)


def test_sky_hides_a_torn_quad_that_is_as_far():
    """Both of eq. 1's halves end at infinity: the surface comes first."""
    depth = np.full((1, 12), np.inf, np.float32)
    depth[0, 4:6] = 1
    frame = grey(np.full((1, 12), 0.5), depth)
    flow = np.zeros((1, 12, 2), np.float32)
    flow[0, 4:6, 0] = 20

    warped = warp(frame, flow)

    np.testing.assert_array_equal(warped.hole[0].nonzero()[0], [4, 5])


# ---- what is torn


def torn(flow: Flow, stretch_px: float = 4, surface_px: int = 8) -> NDArray[np.bool_]:
    """Give the torn quads between pixels, shape (H - 1, W - 1)."""
    height, width, _ = flow.shape
    quads = torn_quads(flow, round(stretch_px * SUBPIXELS), surface_px)
    return quads.reshape(height + 3, width + 3)[2:-2, 2:-2]


def horizontal(displacement: object) -> Flow:
    """Give three rows of the same motion along x."""
    row = np.asarray(displacement, np.float32)
    return np.stack([np.tile(row, (3, 1)), np.zeros((3, len(row)), np.float32)], axis=-1)


def test_a_step_longer_than_the_threshold_is_torn():
    column = torn(horizontal([0] * 10 + [3.25] * 10))
    np.testing.assert_array_equal(np.flatnonzero(column[0]), [9])
    assert not torn(horizontal([0] * 10 + [3] * 10)).any()  # 4 px long: not longer


@pytest.mark.parametrize("ramp_px", [1, 2, 4, 6])
def test_a_soft_step_is_torn_too(ramp_px):
    """Depth maps that were resampled or estimated blur their steps over a few pixels."""
    ramp = np.interp(np.arange(30), [12, 12 + ramp_px], [0, 60])
    np.testing.assert_array_equal(
        np.flatnonzero(torn(horizontal(ramp))[0]), np.arange(12, 12 + ramp_px)
    )


def test_sides_that_differ_by_half_are_one_surface():
    """By hand: sides of 8 and 4 px in turn; the 4 px are not longer than the threshold."""
    displacement = np.cumsum(np.r_[0, np.tile([7, 3], 8)])
    assert not torn(horizontal(displacement)).any()
    displacement = np.cumsum(np.r_[0, np.tile([7, 2.75], 8)])
    np.testing.assert_array_equal(torn(horizontal(displacement))[0], [True, False] * 8)


@pytest.mark.parametrize("width", [7, 8])
def test_eight_sides_in_line_are_a_surface(width):
    """A patch magnified by six, `width` sides wide, between others at rest."""
    displacement = np.interp(np.arange(30), [10, 10 + width], [0, 5 * width])
    np.testing.assert_array_equal(torn(horizontal(displacement))[0].any(), width < 8)


def zoomed_plane(step: bool) -> tuple[SourceFrame, Flow, NDArray[np.float32]]:
    """Approach a slanted plane until it appears 7 to 10 times as large; maybe a step in it."""
    source = wide_camera(64, 48, 50)
    x = np.arange(64) + 0.5
    depth = np.tile(1 / (0.1 + 0.00008 * x), (48, 1))
    if step:
        depth[:, 48:] *= 0.97
    frame = grey(np.full((48, 64), 0.5), depth)
    target = source.moved(np.array([0, 0, 8.5]))
    return frame, *flow_between(source, target, frame.depth_m)


def test_a_slanted_surface_under_a_strong_zoom_is_not_torn():
    frame, flow, target_depth = zoomed_plane(step=False)
    sides = np.abs(np.diff(flow[..., 0], axis=1) + 1)
    assert sides.min() > 5  # every side is far longer than the threshold

    warped = warp(frame, flow, target_depth_m=target_depth)

    assert not warped.hole.any()
    by_length_alone = warp(
        frame, flow, target_depth_m=target_depth, settings=WarpSettings(surface_px=10**6)
    )
    assert by_length_alone.hole.mean() > 0.9  # what the rule is for


def test_a_step_in_depth_is_torn_under_the_same_zoom():
    _, flow, _ = zoomed_plane(step=True)
    np.testing.assert_array_equal(torn(flow), np.arange(63) == np.full((47, 1), 47))


def test_a_zoom_of_the_lens_tears_nothing(disc_over_plane):
    """No parallax, no disocclusion: depth edges under a pure zoom stay closed."""
    warped = warp(disc_over_plane, similarity(96, 128, 6.0, 0.0))
    assert not warped.hole.any()


# ---- coverage


@pytest.mark.parametrize(
    ("zoom", "turn_deg"), [(1, 0), (1, 30), (0.7, 90), (1.37, -17), (2, 45), (3.3, 180)]
)
def test_every_pixel_is_covered_exactly_once(zoom, turn_deg):
    depth = np.ones((20, 24))
    flow = similarity(20, 24, zoom, np.radians(turn_deg))
    window = TargetWindow(0, 0, 24, 20)
    mesh = moved_mesh(depth, flow, window)

    hits = coverage(mesh, ~mesh.ring_0, window)

    count = np.bincount(hits.pixel, minlength=480)
    assert count.max() == 1
    assert count.reshape(20, 24)[8:12, 8:16].all()
    if zoom >= 1 and turn_deg in (0, 180):
        assert count.all()


motions = st.integers(0, 2**32 - 1).map(np.random.default_rng)


@given(rng=motions, scale=st.sampled_from([0.3, 1.0, 4.0, 30.0]), whole=st.booleans())
@settings(max_examples=40)
def test_folds_cancel_and_leave_no_gap(rng, scale, whole):
    """Any motion: at each pixel one more triangle faces the view than is turned over.

    Whole and half pixels put many corners exactly onto pixel centres.
    """
    height, width = rng.integers(1, 9, 2)
    flow = (scale * rng.standard_normal((height, width, 2))).astype(np.float32)
    if whole:
        flow = np.round(2 * flow) / 2
    window = TargetWindow(*rng.integers(-2, 3, 2), *rng.integers(1, 9, 2))
    mesh = moved_mesh(np.ones((height, width)), flow, window)
    x, y = np.meshgrid(np.arange(window.width_px), np.arange(window.height_px))
    centre = np.stack([x, y], axis=-1).reshape(-1, 1, 1, 2) * SUBPIXELS + SUBPIXELS // 2

    surplus = np.zeros(window.width_px * window.height_px, np.int64)
    for triangle in ((0, 1, 2), (0, 2, 3)):
        corner = mesh.at[None, :, triangle] - centre
        for turned, sign in ((corner, 1), (corner[:, :, ::-1], -1)):
            found, _ = inside(turned.reshape(-1, 3, 2))
            surplus += sign * found.reshape(len(surplus), -1).sum(axis=1)

    np.testing.assert_array_equal(surplus, 1)
    hits = coverage(mesh, mesh.drawable, window)
    assert np.isin(np.arange(len(surplus)), hits.pixel).all()


@given(rng=motions, scale=st.sampled_from([0.5, 3.0, 20.0]))
@settings(max_examples=25)
def test_every_pixel_gets_a_depth_that_the_source_has_and_colours_in_range(rng, scale):
    frame = SourceFrame(
        rng.uniform(0.25, 0.75, (9, 11, 3)).astype(np.float32),
        rng.uniform(1, 9, (9, 11)).astype(np.float32),
    )
    flow = (scale * rng.standard_normal((9, 11, 2))).astype(np.float32)

    warped = warp(frame, flow)

    assert np.isin(warped.depth_m[warped.hole], frame.depth_m).all()
    assert ((warped.depth_m >= frame.depth_m.min()) & (warped.depth_m <= frame.depth_m.max())).all()
    known = warped.colour[~warped.hole]
    assert ((known >= 0.25) & (known <= 0.75)).all()


@given(rng=motions)
@settings(max_examples=15)
def test_a_constant_frame_stays_constant(rng):
    frame = grey(np.full((8, 8), 0.3), 2.7)
    warped = warp(frame, (6 * rng.standard_normal((8, 8, 2))).astype(np.float32))
    np.testing.assert_allclose(warped.colour[~warped.hole], np.float32(0.3), rtol=2 * FLOAT32)
    np.testing.assert_allclose(warped.depth_m, np.float32(2.7), rtol=2 * FLOAT32)


# ---- beyond the border, behind the camera


def test_border_holes_continue_the_border():
    """By hand: what enters at the left goes on from column 0, row by row."""
    depth = np.repeat(np.float32([[2], [2], [2], [4], [4], [4]]), 12, axis=1)
    frame = grey(np.full((6, 12), 0.5), depth)

    warped = warp(frame, parallax(frame, 8))  # 4 px, and 2 px

    np.testing.assert_array_equal(warped.hole.sum(axis=1)[[0, 1, 4, 5]], [4, 4, 2, 2])
    np.testing.assert_array_equal(warped.depth_m[[0, 1], 0], 2)
    np.testing.assert_array_equal(warped.depth_m[[4, 5], 0], 4)
    np.testing.assert_array_equal(warped.flow_px[5, 0], (2, 0))


def test_a_margin_keeps_border_holes_out_of_the_window(rng):
    frame = noise(rng, 40, 48)
    flow = similarity(40, 48, 1.0, 0.1) + np.float32((2.5, -1.25))
    window = TargetWindow.inside_margin((40, 48), 8)

    shown = warp(frame, flow, window=window)

    assert shown.size == (24, 32)
    assert not shown.hole.any()
    whole = warp(frame, flow)
    for name in ("colour", "depth_m", "hole", "flow_px"):
        np.testing.assert_array_equal(getattr(shown, name), getattr(whole, name)[8:32, 8:40])


def test_what_is_behind_the_camera_is_not_shown_and_its_place_is_continued():
    """A post that the camera has passed: its place shows the farther of its two sides."""
    frame = grey(np.full((4, 12), 0.5), 3)
    target = np.float32([[3, 3, 3, 3, 3, 0, 0, 7, 7, 7, 7, 7]] * 4)

    warped = warp(frame, still(frame), target_depth_m=target)

    np.testing.assert_array_equal(warped.hole[0].nonzero()[0], [4, 5, 6])
    np.testing.assert_array_equal(warped.depth_m[:, :5], [[3, 3, 3, 3, 7]] * 4)
    np.testing.assert_array_equal(warped.depth_m[:, 5:], 7)


def test_everything_behind_the_camera_is_one_hole_without_depth():
    frame = grey(np.full((3, 4), 0.5), 3)
    warped = warp(frame, still(frame), target_depth_m=np.zeros((3, 4), np.float32))
    assert warped.hole.all()
    assert np.isinf(warped.depth_m).all()


def test_a_frame_that_left_the_view_is_one_hole_with_its_border_depth(rng):
    frame = noise(rng, 6, 6)
    warped = warp(frame, np.full((6, 6, 2), 300, np.float32))
    assert warped.hole.all()
    np.testing.assert_array_equal(warped.depth_m, 3)


# ---- bad input


def bad(array: NDArray[np.float32], value: float) -> NDArray[np.float32]:
    """Put `value` at row 1, column 2."""
    array[1, 2] = value
    return array


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"flow_px": np.zeros((4, 6, 2), np.float32)}, "one height and width .*4x5.*4x6"),
        ({"flow_px": np.zeros((4, 5, 2))}, "flow_px must be float32"),
        (
            {"flow_px": bad(np.zeros((4, 5, 2), np.float32), np.nan)},
            "flow_px must be finite .*row 1, column 2",
        ),
        ({"flow_px": bad(np.zeros((4, 5, 2), np.float32), np.inf)}, "flow_px must be finite"),
        ({"target_depth_m": np.ones((4, 4), np.float32)}, "one height and width"),
        ({"target_depth_m": np.ones((4, 5))}, "target_depth_m must be float32"),
        (
            {"target_depth_m": bad(np.ones((4, 5), np.float32), np.nan)},
            "target_depth_m must be a number .*row 1, column 2",
        ),
    ],
)
def test_bad_arrays_are_named_with_place_and_rule(rng, arguments, message):
    frame = noise(rng, 4, 5)
    with pytest.raises(InputError, match=message):
        warp(frame, **({"flow_px": still(frame)} | arguments))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: WarpSettings("smeer"), "variant must be one of full, smear, remove"),
        (lambda: WarpSettings(stretch_px=0.5), "stretch_px must be at least 1"),
        (lambda: WarpSettings(stretch_px=float("nan")), "stretch_px must be at least 1"),
        (lambda: WarpSettings(surface_px=1), "surface_px must be at least 2"),
        (lambda: TargetWindow(0, 0, 0, 4), "at least 1x1 px .*0x4"),
        (lambda: TargetWindow.inside_margin((10, 20), 5), "at least 1x1 px .*10x0"),
    ],
)
def test_bad_settings_say_what_must_hold(make, message):
    with pytest.raises(InputError, match=message):
        make()
