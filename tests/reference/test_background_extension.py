"""Background extension against hand-worked rows and against a plain walk, pixel by pixel."""

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame
from pipeline.methods.background_extension import BackgroundExtension, parallax_direction

NEAR_M, FAR_M = 2.0, 4.0


def row_frame(values, nearer, hole, near_flow, far_flow=(0.0, 0.0)) -> WarpedFrame:
    """One row of grey values; `nearer` tells which pixels are foreground."""
    nearer, hole = np.asarray(nearer, bool), np.asarray(hole, bool)
    colour = np.repeat(np.asarray(values, np.float32)[None, :, None], 3, axis=-1)
    depth_m = np.where(nearer, NEAR_M, FAR_M).astype(np.float32)[None]
    flow_px = np.where(nearer[None, :, None], near_flow, far_flow).astype(np.float32)
    return WarpedFrame(colour, depth_m, hole[None], flow_px)


VALUES = [0.9, 0.9, 0, 0, 0, 0.1, 0.2, 0.3, 0.4]
HOLE = [0, 0, 1, 1, 1, 0, 0, 0, 0]
LEFT_IS_NEAR = [1, 1, 0, 0, 0, 0, 0, 0, 0]
MOVED_LEFT = (-3.0, 0.0)


def fill_row(frame: WarpedFrame, inset_px=0, **parameters) -> list[float]:
    return (
        BackgroundExtension(inset_px=inset_px, **parameters)
        .fill(frame, 0)[0, :, 0]
        .round(6)
        .tolist()
    )


def test_a_row_takes_the_colour_of_its_end_on_the_background():
    """The foreground on the left moved to the left: the background is on the right."""
    frame = row_frame(VALUES, LEFT_IS_NEAR, HOLE, MOVED_LEFT)

    assert fill_row(frame) == pytest.approx([0.9, 0.9, 0.1, 0.1, 0.1, 0.1, 0.2, 0.3, 0.4])


def test_an_inset_walks_further_into_the_background():
    frame = row_frame(VALUES, LEFT_IS_NEAR, HOLE, MOVED_LEFT)

    assert fill_row(frame, inset_px=2)[2:5] == pytest.approx([0.3, 0.3, 0.3])


def test_a_mirrored_row_runs_back_from_its_end():
    """The pixel beside the known ones takes the first of them, and so on outwards."""
    frame = row_frame(VALUES, LEFT_IS_NEAR, HOLE, MOVED_LEFT)

    assert fill_row(frame, continuation="mirror")[2:5] == pytest.approx([0.3, 0.2, 0.1])


def test_a_mirror_stops_where_the_background_ends():
    """Only two background pixels lie before the next foreground: the second is repeated."""
    nearer = [1, 1, 0, 0, 0, 0, 0, 1, 1]
    frame = row_frame(VALUES, nearer, HOLE, MOVED_LEFT)

    assert fill_row(frame, continuation="mirror")[2:5] == pytest.approx([0.2, 0.2, 0.1])


def test_a_motion_of_the_whole_view_changes_nothing():
    """Only the motion relative to the background counts (a turning camera moves both)."""
    frame = row_frame(VALUES, LEFT_IS_NEAR, HOLE, (17.0, 5.0), (20.0, 5.0))

    assert fill_row(frame)[2:5] == pytest.approx([0.1, 0.1, 0.1])


def test_foreground_on_the_background_side_is_passed_over_for_the_farther_end():
    """Motion points right, but there a second foreground ends the hole: the left end counts."""
    nearer = [0, 0, 0, 0, 0, 1, 1, 1, 1]
    frame = row_frame(VALUES, nearer, HOLE, (3.0, 0.0))
    wrong_side = WarpedFrame(frame.colour, frame.depth_m, frame.hole, -frame.flow_px)

    assert fill_row(frame)[2:5] == pytest.approx([0.9, 0.9, 0.9])
    assert fill_row(wrong_side)[2:5] == pytest.approx([0.9, 0.9, 0.9])


def test_content_that_enters_at_the_border_continues_the_nearest_known_pixel():
    frame = row_frame([0.5, 0.6, 0.7, 0, 0], [0] * 5, [0, 0, 0, 1, 1], (0.0, 0.0))

    assert fill_row(frame) == pytest.approx([0.5, 0.6, 0.7, 0.7, 0.7])


def disc_frame(rng, direction: tuple[float, float], size=72) -> WarpedFrame:
    """A disc of radius 14 at 2 m that moved by 12 px along `direction` (x, y) over a plane."""
    along = np.array(direction) / np.hypot(*direction)
    row, column = np.indices((size, size)) + 0.5
    centre = size / 2
    at = np.stack([column - centre, row - centre], axis=-1)
    disc = np.linalg.norm(at - 6 * along, axis=-1) <= 14
    before = np.linalg.norm(at + 6 * along, axis=-1) <= 14
    colour = rng.uniform(0.3, 0.5, (size, size, 3)).astype(np.float32)
    colour[disc] = (1.0, 0.0, 0.0)
    depth_m = np.where(disc, NEAR_M, FAR_M).astype(np.float32)
    flow_px = np.where(disc[..., None], 12 * along, 0).astype(np.float32)
    return WarpedFrame(colour, depth_m, before & ~disc, flow_px)


# No walk along these meets a tie when it rounds to pixels.
DIRECTIONS = [(1, 0), (-1, 0), (0, 1), (4, 7), (-5, 2)]


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_the_direction_is_that_of_the_parallax_reversed(rng, direction):
    frame = disc_frame(rng, direction)
    wanted = -np.array(direction)[::-1] / np.hypot(*direction)

    found = parallax_direction(frame)[frame.hole]

    np.testing.assert_allclose(found, np.broadcast_to(wanted, found.shape), atol=1e-6)


@pytest.mark.parametrize("continuation", ["repeat", "mirror"])
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_foreground_never_bleeds_into_the_hole(rng, direction, continuation):
    frame = disc_frame(rng, direction)
    filled = BackgroundExtension(continuation=continuation).fill(frame, 0)

    inside = filled[frame.hole]
    assert frame.hole.sum() > 200
    assert inside.max() <= 0.5
    assert inside.min() >= 0.3


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_fill_equals_a_plain_walk_pixel_by_pixel(rng, direction):
    frame = disc_frame(rng, direction)
    step = -np.array(direction)[::-1] / np.abs(direction).max()
    expected = frame.colour.copy()
    for pixel in np.argwhere(frame.hole):
        count = 1
        while frame.hole[tuple(np.rint(pixel + count * step).astype(int))]:
            count += 1
        expected[tuple(pixel)] = frame.colour[tuple(np.rint(pixel + count * step).astype(int))]

    np.testing.assert_array_equal(BackgroundExtension(inset_px=0).fill(frame, 0), expected)


def test_a_zoom_continues_each_side_along_its_own_ray(rng):
    """The camera moves forward: a square grows by a quarter around the image's centre.

    It uncovers nothing behind it, but moving back does: the hole is a ring around the
    shrunken square, and each of its pixels walks straight outwards.
    """
    size, centre = 65, 32.5
    row, column = np.indices((size, size)) + 0.5
    at = np.stack([column - centre, row - centre], axis=-1)
    after, before = np.abs(at).max(axis=-1) <= 16, np.abs(at).max(axis=-1) <= 20
    colour = np.where(after[..., None], (1.0, 0, 0), rng.uniform(0.3, 0.5, (size, size, 3)))
    depth_m = np.where(after, NEAR_M, FAR_M).astype(np.float32)
    flow_px = np.where(after[..., None], -0.25 * at, 0).astype(np.float32)
    frame = WarpedFrame(colour.astype(np.float32), depth_m, before & ~after, flow_px)

    direction = parallax_direction(frame)[frame.hole]
    outward = at[frame.hole][:, ::-1] / np.linalg.norm(at[frame.hole], axis=-1, keepdims=True)

    assert (np.sum(direction * outward, axis=-1) > 0.99).all()
    assert BackgroundExtension().fill(frame, 0)[frame.hole].max() <= 0.5


def test_infinite_depth_counts_as_background():
    frame = row_frame(VALUES, LEFT_IS_NEAR, HOLE, MOVED_LEFT)
    sky = np.where(frame.depth_m == FAR_M, np.inf, frame.depth_m).astype(np.float32)

    assert fill_row(WarpedFrame(frame.colour, sky, frame.hole, frame.flow_px))[2:5] == (
        pytest.approx([0.1, 0.1, 0.1])
    )


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"continuation": "stretch"}, "repeat, mirror"),
        ({"inset_px": -1}, "inset_px must lie in"),
        ({"depth_threshold": 0.0}, "depth_threshold must lie in"),
    ],
)
def test_parameters_out_of_range_are_refused(parameters, said):
    with pytest.raises(InputError, match=said):
        BackgroundExtension(**parameters)
