"""Stereo pairs: depth and flow from disparity, unknown disparities, and what is refused."""

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.pictures.colour_file import save_colour
from pipeline.pictures.depth_and_flow import fill_unknown
from pipeline.pictures.write import write_pixels
from stimuli.scenes.stereo import StereoPair, built_in_pair, load_pair

NAN = np.nan


def pair(disparity_px, offset_px=0.0) -> StereoPair:
    disparity = np.asarray(disparity_px, np.float32)
    return StereoPair(
        left=np.zeros((*disparity.shape, 3), np.float32),
        disparity_px=disparity,
        known=np.ones(disparity.shape, bool),
        focal_px=100.0,
        baseline_m=0.2,
        offset_px=offset_px,
    )


def test_depth_is_focal_length_times_baseline_over_disparity():
    """By hand: 100 px x 0.2 m / (8 + 2) px = 2 m."""
    assert pair([[8.0]], offset_px=2.0).depth_m.tolist() == [[2.0]]


def test_a_left_pixel_moves_left_by_its_disparity():
    flow_px = pair([[8.0, 4.0]]).warp_input(0.5).flow_px

    np.testing.assert_array_equal(flow_px, [[[-4, 0], [-2, 0]]])


def test_unknown_disparity_takes_the_farther_neighbour_in_its_row():
    """By hand: between 9 and 3 the farther is 3; at a border only one neighbour is there."""
    filled, known = fill_unknown(
        np.array([[NAN, 9, NAN, np.inf, 3, NAN], [NAN] * 6, [NAN, 5, 7, 7, 7, 7]], np.float32)
    )

    np.testing.assert_array_equal(filled[0], [9, 9, 3, 3, 3, 3])
    np.testing.assert_array_equal(filled[1], filled[0])  # the nearest row with any
    np.testing.assert_array_equal(filled[2], [5, 5, 7, 7, 7, 7])
    assert known.sum() == 7


def test_a_disparity_without_any_known_pixel_is_refused():
    with pytest.raises(InputError, match="at least one pixel"):
        fill_unknown(np.full((2, 2), np.nan, np.float32))


def test_a_disparity_that_puts_a_pixel_behind_the_camera_is_refused():
    with pytest.raises(InputError, match=r"greater than -2 px, .* at row 0, column 1"):
        pair([[4.0, -3.0]], offset_px=2.0)


def test_motorcycle_is_built_in_and_has_metric_depth():
    """The bike's parts and the wall lie between 2 m and 5.1 m (focal length, baseline, offset)."""
    motorcycle = built_in_pair("motorcycle")

    assert motorcycle.left.shape == (500, 741, 3)
    assert motorcycle.right is not None
    assert 2.0 < motorcycle.depth_m.min() < motorcycle.depth_m.max() < 5.1
    assert 0.92 < motorcycle.known.mean() < 0.93


def test_the_disparity_of_motorcycle_maps_left_onto_right():
    """Most left pixels find their colour at x - d; unmoved, they do not."""
    motorcycle = built_in_pair("motorcycle")
    rows, columns = np.nonzero(motorcycle.known)
    moved = np.rint(columns - motorcycle.disparity_px[rows, columns]).astype(int)
    inside = moved >= 0
    rows, columns, moved = rows[inside], columns[inside], moved[inside]

    assert motorcycle.right is not None
    difference = np.abs(motorcycle.left[rows, columns] - motorcycle.right[rows, moved])
    unmoved = np.abs(motorcycle.left[rows, columns] - motorcycle.right[rows, columns])
    assert difference.mean() < 0.5 * unmoved.mean()


def test_an_unknown_built_in_pair_is_refused():
    with pytest.raises(InputError, match="motorcycle"):
        built_in_pair("car")


@pytest.fixture
def files(tmp_path, rng):
    save_colour(tmp_path / "left.png", rng.random((4, 6, 3), dtype=np.float32))
    quarters = np.full((4, 6, 1), 20, np.uint8)
    quarters[1, 2] = 0
    write_pixels(tmp_path / "disparity.png", quarters, "Y")
    return tmp_path


def test_integer_files_are_scaled_and_zero_is_unknown(files):
    loaded = load_pair(files / "left.png", files / "disparity.png", units_per_px=4)

    np.testing.assert_array_equal(loaded.disparity_px, np.full((4, 6), 5.0))
    assert np.argwhere(~loaded.known).tolist() == [[1, 2]]


@pytest.mark.parametrize("name", ["d.npy", "d.npz", "d.pfm", "d.exr"])
def test_float_files_of_every_kind_are_read_as_pixels(files, name):
    values = np.arange(1, 25, dtype=np.float32).reshape(4, 6) / 8
    if name.endswith("npy"):
        np.save(files / name, values)
    elif name.endswith("npz"):
        np.savez(files / name, values)
    else:
        write_pixels(files / name, values[..., None], "Y")

    np.testing.assert_array_equal(load_pair(files / "left.png", files / name).disparity_px, values)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"a": np.ones((2, 2)), "b": np.ones((2, 2))}, "one array"),
        ({"a": np.ones((2, 2, 2))}, r"numbers of shape \(H, W\)"),
        ({"a": np.array([["x"]])}, r"numbers of shape \(H, W\)"),
    ],
)
def test_a_numpy_file_that_is_no_disparity_is_refused(files, content, said):
    np.savez(files / "bad.npz", **content)

    with pytest.raises(InputError, match=said):
        load_pair(files / "left.png", files / "bad.npz")


def test_a_damaged_numpy_file_is_refused(files):
    for name in ("bad.npz", "bad.npy"):
        (files / name).write_bytes(b"not numpy")
        with pytest.raises(InputError, match=f"{name}: must be a numpy file"):
            load_pair(files / "left.png", files / name)


def test_a_disparity_of_another_size_is_refused(files):
    np.save(files / "small.npy", np.ones((2, 2), np.float32))

    with pytest.raises(
        InputError, match=r"small\.npy: must be as large as .*left\.png, 6 x 4 px \(is 2 x 2"
    ):
        load_pair(files / "left.png", files / "small.npy")


@pytest.mark.parametrize(
    ("folder", "left", "disparity", "right", "units_per_px"),
    [
        ("middlebury2003_teddy", "im2.png", "disp2.pgm", "im6.png", 4.0),
        ("middlebury2001_venus", "imL.png", "groundtruth.png", "imR.png", 8.0),
    ],
)
def test_middlebury_pairs_map_left_onto_right(
    shared_data, folder, left, disparity, right, units_per_px
):
    place = shared_data / "stereo" / folder
    loaded = load_pair(place / left, place / disparity, place / right, units_per_px=units_per_px)
    rows, columns = np.nonzero(loaded.known)
    moved = np.rint(columns - loaded.disparity_px[rows, columns]).astype(int)
    inside = moved >= 0

    assert loaded.right is not None
    difference = np.abs(
        loaded.left[rows[inside], columns[inside]] - loaded.right[rows[inside], moved[inside]]
    )
    assert difference.mean() < 10 / 255  # 7.3 and 4.4 grey levels by an independent check
