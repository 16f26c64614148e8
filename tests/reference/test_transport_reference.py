"""Coherence transport against values worked by hand, and what it must keep, whatever the scene."""

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame
from pipeline.methods.registry import create_method
from pipeline.transport.reference import (
    LEFT_OUT,
    UNREACHED,
    TransportSettings,
    across_px,
    coherence,
    near_around,
    shells,
    structure_tensors,
    texture_parts,
    transport_fill,
    transported,
)
from pipeline.warp.reference import warp

THRESHOLD = 0.04
Z_NEAR_M = 2.0


def fill(frame, **settings):
    return transport_fill(frame, TransportSettings(**settings), z_near_m=Z_NEAR_M)


def frame_of(colour, hole, depth_m=5.0) -> WarpedFrame:
    size = hole.shape
    depth = np.broadcast_to(np.float32(depth_m), size).astype(np.float32)
    shown = np.where(hole[..., None], 0, colour).astype(np.float32)
    return WarpedFrame(shown, depth, hole, np.zeros((*size, 2), np.float32))


def test_shells_count_from_background_and_not_from_what_is_nearer_or_farther():
    """By hand: at guide .5 only the left end is of the hole's surface; one pixel is of another."""
    hole = np.array([[0, 1, 1, 1, 1, 0]], bool)
    guide = np.array([[0.5, 0.5, 0.52, 0.5, 0.9, 0.2]])

    assert shells(hole, guide, THRESHOLD).tolist() == [[0, 1, 2, 3, UNREACHED, 0]]


def test_no_shell_comes_to_what_is_far_from_the_gaze_nor_over_it():
    hole = np.array([[0, 1, 1, 1, 1]], bool)
    worked = np.array([[1, 1, 0, 1, 1]], bool)

    found = shells(hole, np.ones((1, 5)), THRESHOLD, worked)

    assert found.tolist() == [[0, 1, LEFT_OUT, UNREACHED, UNREACHED]]


def test_shells_are_octagons():
    """From one known pixel: eight neighbours, then along rows and columns, then all ways."""
    hole = np.ones((9, 9), bool)
    hole[4, 4] = False

    found = shells(hole, np.ones((9, 9)), THRESHOLD)

    assert found[4].tolist() == [4, 3, 2, 1, 0, 1, 2, 3, 4]
    assert [found[4 + k, 4 + k] for k in range(5)] == [0, 1, 3, 4, 5]


def test_the_tensor_of_a_ramp_is_the_square_of_its_slope():
    """Rows rise by .02 a column and .01 a row in each of three colours."""
    y, x = np.mgrid[:15, :20]
    colour = np.repeat((0.02 * x + 0.01 * y)[..., None], 3, axis=-1)
    hole = np.zeros((15, 20), bool)
    hole[7, 10] = True

    found = structure_tensors(colour, hole, np.ones((15, 20)), THRESHOLD)

    np.testing.assert_allclose(found[7, 9], 3 * np.array([4e-4, 2e-4, 1e-4]), rtol=1e-12)
    assert (found[7, 10] == 0).all()


def test_gradients_across_an_edge_of_depth_do_not_count():
    colour = np.zeros((9, 16, 3))
    colour[:, 8:] = 1
    guide = np.where(np.arange(16) < 8, 0.3, 0.6) * np.ones((9, 1))

    assert (structure_tensors(colour, np.zeros((9, 16), bool), guide, THRESHOLD) == 0).all()


def test_coherence_is_long_along_a_clear_structure_and_none_where_there_is_no_direction():
    """By hand: eigenvalues .1 and 0 across x; a tensor alike in all directions; a faint one."""
    clear, round_, faint = coherence(np.array([[0.1, 0, 0], [0.1, 0, 0.1], [1e-4, 0, 0]]))

    np.testing.assert_allclose(clear, [1 + 10 * np.exp(-((4e-4 / 0.1) ** 2)), 0], rtol=1e-4)
    assert (round_ == 0).all()
    np.testing.assert_allclose(faint, [1 + 10 * np.exp(-16), 0], rtol=0.011)


def test_transport_is_the_weighted_mean_of_what_is_seen():
    """By hand, without structure: 1 / distance of the pixels to the left; then the first fill."""
    shell = np.array([[0, 0, 1, 2]])
    colour = np.array([[0.2, 0.8, 0, 0]])[..., None] * np.ones(3)

    found = transported(colour, np.zeros((1, 4, 3)), shell, np.ones((1, 4)), THRESHOLD)[0, :, 0]

    first = (0.8 + 0.2 / 2) / (1 + 1 / 2)
    second = (first + 0.8 / 2 + 0.2 / 3) / (1 + 1 / 2 + 1 / 3)
    np.testing.assert_allclose(found, [0.2, 0.8, first, second], rtol=1e-12)


def test_pixels_of_one_shell_do_not_see_each_other():
    shell = np.array([[0, 1, 1, 0]])
    colour = np.array([[0.2, 9, 9, 0.6]])[..., None] * np.ones(3)

    found = transported(colour, np.zeros((1, 4, 3)), shell, np.ones((1, 4)), THRESHOLD)[0, :, 0]

    np.testing.assert_allclose(found[1], (0.2 + 0.6 / 2) / 1.5, rtol=1e-12)


@pytest.mark.parametrize("turn_deg", [0, 30, 45, 70])
def test_an_edge_goes_on_through_a_hole(turn_deg):
    """Half is .2 and half is .8, and push-pull makes fog of it over a hole of 24 px."""
    y, x = np.mgrid[:64, :64] - 31.5
    angle = np.deg2rad(turn_deg)
    truth = np.where(x * np.cos(angle) + y * np.sin(angle) < 0, 0.2, 0.8)[..., None] * np.ones(3)
    hole = np.abs(x * np.sin(angle) - y * np.cos(angle)) < 12

    found = fill(frame_of(truth, hole), share=1.0)

    off, fog = (np.abs(one - truth)[hole].mean() for one in (found.colour, found.base))
    assert off < 0.03
    assert off < fog / 2


def test_a_fill_stays_between_what_is_known(rng):
    hole = rng.random((30, 40)) < 0.6
    depth = np.where(rng.random((30, 40)) < 0.5, 3, 8)
    frame = frame_of(rng.uniform(0.3, 0.6, (30, 40, 3)), hole, depth)

    found = fill(frame).colour[hole]

    assert found.min() > 0.2999
    assert found.max() < 0.6001


def test_the_lesser_of_row_and_column_is_how_wide_a_hole_is():
    """By hand: a strip of three rows, one pixel alone, and what ends at the frame's edge."""
    hole = np.zeros((12, 12), bool)
    hole[2:5] = True
    hole[8, 3] = True
    hole[8:, 7:] = True

    pixels = np.array([(2, 6), (3, 0), (8, 3), (8, 7), (11, 11)])

    assert across_px(hole, pixels).tolist() == [3, 3, 1, 4, 4]


def test_what_is_near_counts_by_its_distance_and_less_in_wide_holes():
    """By hand: 1 and 1/4 of the greys beside and next; a quarter, and half of it at 4 px across."""
    colour = np.array([[0.4, 0.8, 0, 0.8, 0.4]])[..., None] * np.ones(3)
    thin = np.array([[0, 0, 1, 0, 0]], bool)
    wide = np.zeros((8, 8), bool)
    wide[2:6, 2:6] = True

    grey, share = near_around(colour, thin, np.array([[0, 2]]))

    np.testing.assert_allclose(grey[0], (0.8 + 0.4 / 4) / (1 + 1 / 4))
    assert share.tolist() == [0.25]
    assert near_around(np.zeros((8, 8, 3)), wide, np.array([[3, 3]]))[1].tolist() == [0.125]


def test_only_a_hole_that_sees_no_background_takes_what_is_near():
    """A gap of two columns in a red leaf: behind it at 9 m nothing is known, or the sky beside."""
    colour = np.zeros((20, 20, 3))
    colour[..., 0] = 0.8
    hole = np.zeros((20, 20), bool)
    hole[:, 9:11] = True
    depth = np.where(hole, 9.0, 2.5)

    enclosed = fill(frame_of(colour, hole, depth))
    depth[:5], colour[:5] = 9.0, 0.5
    open_ = fill(frame_of(colour, hole, depth))

    assert (enclosed.shell[hole] == UNREACHED).all()
    np.testing.assert_allclose(enclosed.colour[hole], [[0.8, 0, 0]] * hole.sum(), atol=1e-9)
    assert (open_.shell[hole] < UNREACHED).all()
    np.testing.assert_allclose(open_.colour[hole], 0.5, atol=1e-9)


@pytest.fixture(scope="module")
def red_scene(disc_over_plane) -> WarpedFrame:
    """A red disc that moved 24 px over grey noise, warped for real."""
    flow = np.where(disc_over_plane.depth_m[..., None] < 3, (24.0, 3.0), (0.0, 0.0))
    return warp(disc_over_plane, flow.astype(np.float32))


def test_a_red_foreground_never_bleeds_into_a_grey_background(red_scene):
    """Red less green is 0.7 on the disc and 0 in every hole; only rounding remains."""
    inside = fill(red_scene).colour[red_scene.hole]

    assert len(inside) > 500
    assert np.abs(inside - inside[:, :1]).max() < 1e-6


def test_known_pixels_keep_their_bits(red_scene):
    known = ~red_scene.hole

    filled = fill(red_scene).colour.astype(np.float32)[known]

    assert filled.tobytes() == red_scene.colour[known].tobytes()


def test_transport_moves_with_the_background(rng):
    """The screen-door test: the view turns by whole pixels, and what is carried turns with it.

    Push-pull's grid does not turn, so transport is compared before it is mixed in.
    """
    height, width, by = 40, 90, (3, 5)
    plane = rng.uniform(0.2, 0.8, (height + 16, width + 16, 3))

    def view(down, right):
        y, x = np.mgrid[:height, :width] - np.array([down, right])[:, None, None]
        hole = (np.abs(x - 45) < 9) & (np.abs(y - 18) < 9)
        colour = plane[8 - down :, 8 - right :][:height, :width]
        return fill(frame_of(colour, hole, np.where(x < 36, 2.0, 5.0)))

    still, moved = view(0, 0), view(*by)

    np.testing.assert_allclose(
        moved.transported[by[0] :, by[1] :], still.transported[: -by[0], : -by[1]], atol=1e-6
    )
    assert still.transported[18, 45].std() > 1e-3


def test_what_has_one_direction_is_no_texture():
    """By hand: a clear edge; a clear corner; between the two; an edge too faint; one half clear.

    The middle of each 4x4 pixels tells; the last block is cut, and told by its last pixel.
    """
    blocks = np.array([(0.1, 0, 0), (0.1, 0, 0.1), (0.1, 0, 0.1 / 3), (2e-4, 0, 0), (6e-4, 0, 0)])
    tensor = np.zeros((2, 18, 3))
    tensor[1, [2, 6, 10, 14, 17]] = blocks

    fine, coarse = texture_parts(tensor, 2)

    parts = [0, 1, 0.5, 1, 0.5]
    np.testing.assert_allclose(fine, [np.repeat(parts, 4)[:18]] * 2, atol=1e-12)
    np.testing.assert_allclose(coarse, [np.repeat(parts, 2)[:9]], atol=1e-12)


def lacking_detail(colour, **settings):
    """Fill a hole of 24 px; the deviations of what detail adds, and of the known colour."""
    hole = np.zeros(colour.shape[:2], bool)
    hole[:, 20:44] = True
    frame = frame_of(colour, hole)
    smooth = fill(frame, detail=0).colour
    found = fill(frame, **settings).colour
    assert (found == smooth)[~hole].all()
    return (found - smooth)[hole].std(), colour[~hole].std()


def test_detail_gives_a_hole_its_grounds_texture_and_edges_give_none(rng):
    """A ground of noise, and one of ramps between two greys, which has edges alone."""
    noise = np.repeat(0.5 + 0.1 * rng.standard_normal((64, 64, 1)), 3, axis=-1)
    edges = np.repeat(0.5 + 0.2 * np.sin(0.5 * np.mgrid[:64, :64][0])[..., None], 3, axis=-1)

    added, there = lacking_detail(noise.clip(0, 1), detail=1)
    assert 0.7 < added / there < 1.4  # bands are taken for a photograph's, see `LAPLACE`
    assert lacking_detail(noise.clip(0, 1))[0] == pytest.approx(added / 2, rel=0.05)
    marble, there = lacking_detail(edges, detail=1)
    assert marble < 0.01 * there


def test_clips_have_detail_only_where_it_is_asked_for():
    assert TransportSettings().noise.noise == 0.5
    assert TransportSettings().in_clips().noise.noise == 0
    assert TransportSettings(detail=1.5).in_clips().noise.noise == 1.5


def test_a_plate_of_arrays_takes_the_seed_and_the_default_of_clips(rng):
    frame = frame_of(rng.random((24, 40, 3)), rng.random((24, 40)) < 0.4)

    def first(seed, **parameters):
        return create_method("coherence-transport", None, parameters).new_plate().fill(frame, seed)

    alone = create_method("coherence-transport", None, {"detail": 0.0}).fill(frame, 3)
    assert first(3).tobytes() == alone.tobytes()
    assert first(3, detail=1.0).tobytes() != first(4, detail=1.0).tobytes()


@pytest.mark.parametrize("key", ["share", "depth_threshold", "detail"])
def test_a_setting_out_of_range_is_refused(key):
    with pytest.raises(InputError, match=f"{key} must lie in"):
        TransportSettings(**{key: -0.5})


def test_the_gaze_leaves_transport_in_its_fovea_and_none_a_degree_beyond():
    """By hand: a row before an eye at tan(20 deg) of half its width; the gaze is at its end."""
    settings = TransportSettings(fovea_deg=5, gaze_x_deg=-20, width_deg=40)
    x = np.arange(400) + 0.5
    away = 20 + np.degrees(np.arctan((x - 200) / 200 * np.tan(np.radians(20))))

    found = settings.attention((1, 400))[0]

    assert (found[away < 5] == 1).all()
    assert (found[away > 6] == 0).all()
    np.testing.assert_allclose(np.interp(5.5, away, found), 0.5, atol=1e-3)
    assert (TransportSettings().attention((2, 3)) == 1).all()


def test_transport_works_64_px_around_what_the_gaze_leaves_it():
    """By hand: at 10 px a degree near the middle, 3 degrees of fovea and one of fade are 40 px."""
    width_deg = 2 * np.degrees(np.arctan(200 * np.radians(1) / 10))
    settings = TransportSettings(fovea_deg=3, width_deg=width_deg)

    rows, columns = settings.worked((90, 400))

    assert rows == slice(0, 90)
    assert columns == slice(200 - 40 - 64, 200 + 40 + 64)
    assert TransportSettings().worked((90, 400)) == (slice(0, 90), slice(0, 400))
    away = TransportSettings(fovea_deg=3, gaze_y_deg=80).worked((90, 400))
    assert away == (slice(0, 0), slice(0, 0))


def gazed_at(rng):
    """Stripes with a wide hole behind a post, and many pixels missing."""
    y, x = np.mgrid[:48, :96]
    hole = ((x > 30) & (x < 70) & (y > 4)) | (rng.random((48, 96)) < 0.1)
    colour = np.repeat(0.5 + 0.4 * np.sin(0.4 * x + 0.9 * y)[..., None], 3, axis=-1)
    return frame_of(colour, hole, np.where((x < 30) & (x > 20) & ~hole, 2.0, 5.0))


def test_a_fovea_wider_than_the_frame_is_coherence_transport(rng):
    frame = gazed_at(rng)

    assert fill(frame, fovea_deg=90).colour.tobytes() == fill(frame).colour.tobytes()


def test_far_from_the_gaze_the_fill_is_push_pull_depths(rng):
    frame = gazed_at(rng)
    gaze = {"fovea_deg": 6, "gaze_x_deg": -3, "gaze_y_deg": 2, "detail": 0}
    away = TransportSettings(**gaze).attention(frame.size) == 0

    found = fill(frame, **gaze)

    np.testing.assert_array_equal(found.colour[away], found.base[away])
    within = TransportSettings(**gaze).attention(frame.size) == 1
    np.testing.assert_array_equal(found.colour[within], fill(frame, detail=0).colour[within])
    near = frame.hole & ~away
    assert (found.colour != found.base)[near].any(axis=-1).mean() > 0.9
    off = fill(frame, fovea_deg=6, gaze_x_deg=80)
    assert off.colour.tobytes() == off.base.tobytes()
    found = fill(frame, **gaze | {"detail": 1}).colour
    assert (found[away] == off.base[away]).all()
    assert (found != fill(frame, **gaze).colour)[within].any()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("fovea_deg", -1.0),
        ("fovea_deg", float("nan")),
        ("gaze_x_deg", 90.0),
        ("gaze_y_deg", float("nan")),
        ("width_deg", 0.0),
    ],
)
def test_a_gaze_that_is_none_is_refused(name, value):
    with pytest.raises(InputError, match=f"^{name} "):
        TransportSettings(**{name: value})
