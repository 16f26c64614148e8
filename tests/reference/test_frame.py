"""Arrays are checked once at the border, and the refusal says what, where and why."""

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.frame import SourceFrame, WarpedFrame, check_some_known

HEIGHT, WIDTH = 4, 6


def source_arrays():
    return {
        "colour": np.full((HEIGHT, WIDTH, 3), 0.5, np.float32),
        "depth_m": np.full((HEIGHT, WIDTH), 2.0, np.float32),
    }


def warped_arrays():
    return source_arrays() | {
        "hole": np.zeros((HEIGHT, WIDTH), bool),
        "flow_px": np.zeros((HEIGHT, WIDTH, 2), np.float32),
    }


def test_good_frames_keep_the_arrays_themselves():
    arrays = warped_arrays()

    frame = WarpedFrame(**arrays)

    assert frame.size == (HEIGHT, WIDTH)
    assert all(getattr(frame, name) is array for name, array in arrays.items())
    assert SourceFrame(**source_arrays()).size == (HEIGHT, WIDTH)


def test_the_ends_of_every_range_are_allowed():
    arrays = warped_arrays()
    arrays["colour"][0, 0] = (0, 1, 1)
    arrays["depth_m"][0, 0] = np.inf
    arrays["depth_m"][0, 1] = np.nextafter(np.float32(0), np.float32(1))
    arrays["flow_px"][0, 0] = (-1e6, 1e6)
    arrays["hole"][:] = True

    WarpedFrame(**arrays)


@pytest.mark.parametrize(
    ("name", "value", "rule"),
    [
        ("colour", np.nan, r"finite and in \[0, 1\]"),
        ("colour", np.inf, r"finite and in \[0, 1\]"),
        ("colour", -1e-6, r"finite and in \[0, 1\]"),
        ("colour", np.nextafter(np.float32(1), np.float32(2)), r"finite and in \[0, 1\]"),
        ("depth_m", 0.0, "greater than 0"),
        ("depth_m", -1.0, "greater than 0"),
        ("depth_m", np.nan, "greater than 0"),
        ("flow_px", np.nan, "finite"),
        ("flow_px", -np.inf, "finite"),
    ],
)
def test_a_bad_value_is_refused_by_name_rule_and_place(name, value, rule):
    arrays = warped_arrays()
    arrays[name][2, 3, ...] = 0.25
    arrays[name][2, 3].flat[-1:] = value  # one channel is enough
    if arrays[name].ndim == 2:
        arrays[name][2, 3] = value

    with pytest.raises(InputError, match=rf"^{name} must be {rule}.*row 2, column 3\)$"):
        WarpedFrame(**arrays)


def test_further_bad_pixels_are_counted():
    arrays = source_arrays()
    arrays["depth_m"][1:3, 1] = 0

    with pytest.raises(InputError, match="row 1, column 1, and 1 more such pixels"):
        SourceFrame(**arrays)


@pytest.mark.parametrize(
    ("name", "wrong", "found"),
    [
        ("colour", np.zeros((HEIGHT, WIDTH, 4), np.float32), r"float32 of shape \(4, 6, 4\)"),
        ("colour", np.zeros((HEIGHT, WIDTH), np.float32), r"float32 of shape \(4, 6\)"),
        ("colour", np.zeros((HEIGHT, WIDTH, 3), np.uint8), r"uint8 of shape \(4, 6, 3\)"),
        ("colour", np.zeros((HEIGHT, WIDTH, 3), np.float64), r"float64 of shape"),
        ("depth_m", np.ones((HEIGHT, WIDTH, 1), np.float32), r"float32 of shape \(4, 6, 1\)"),
        ("hole", np.zeros((HEIGHT, WIDTH), np.uint8), "uint8 of shape"),
        ("flow_px", np.zeros((2, HEIGHT, WIDTH), np.float32), r"float32 of shape \(2, 4, 6\)"),
        ("colour", np.zeros((0, WIDTH, 3), np.float32), r"got shape \(0, 6, 3\)"),
        ("colour", [[[0.5, 0.5, 0.5]]], r"numpy array \(got list\)"),
    ],
)
def test_a_wrong_shape_or_type_is_refused_with_what_was_found(name, wrong, found):
    with pytest.raises(InputError, match=rf"^{name} must .*{found}"):
        WarpedFrame(**warped_arrays() | {name: wrong})


@pytest.mark.parametrize("name", ["colour", "depth_m", "hole", "flow_px"])
def test_arrays_of_two_sizes_are_refused_with_every_size(name):
    arrays = warped_arrays()
    arrays[name] = arrays[name][:, :-1]

    with pytest.raises(InputError, match=rf"one height and width \(got .*{name} 4x5"):
        WarpedFrame(**arrays)


def test_frames_can_be_compared_and_kept_in_a_set():
    one, other = SourceFrame(**source_arrays()), SourceFrame(**source_arrays())

    assert one == one
    assert {one, other, one} == {other, one}


def test_a_frame_of_holes_alone_is_refused():
    hole = np.ones((HEIGHT, WIDTH), bool)
    with pytest.raises(InputError, match="all 24 pixels are holes"):
        check_some_known(hole)

    hole[3, 5] = False
    check_some_known(hole)
