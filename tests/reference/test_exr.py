"""Meaning of image files: transfer functions, channel names, units, and what is refused."""

import numpy as np
import pytest
from number_files import load_plane

from pipeline.colour import encode_srgb
from pipeline.errors import FileNote, InputError
from pipeline.frame import SourceFrame
from pipeline.pictures.channels import Channels
from pipeline.pictures.colour_file import Transfer, load_colour, read_any, save_colour
from pipeline.pictures.decode import read_pixels
from pipeline.pictures.warp_input import WarpInput, load_warp_input, save_warp_input
from pipeline.pictures.write import write_pixels

# Stored as float32, relative rounding 2^-24; the encoding's slope times the value is at most
# 0.5; the result is rounded once more.
ENCODED_ATOL = 2 * 2.0**-24
# half rounds to 2^-11; the smallest values, below 2^-14, to 2^-25 absolute, times the slope 13.
HALF_ATOL = 0.5 * 2.0**-11 + ENCODED_ATOL

NAMES = ("R", "G", "B", "Z", "flow.x", "flow.y")


@pytest.fixture
def frame(rng) -> WarpInput:
    depth_m = rng.uniform(1, 9, (6, 8)).astype(np.float32)
    depth_m[0, 0] = np.inf
    flow_px = rng.normal(0, 3, (6, 8, 2)).astype(np.float32)
    return WarpInput(SourceFrame(rng.random((6, 8, 3), dtype=np.float32), depth_m), flow_px)


def save_planes(path, rng, changes=(), names=NAMES, attributes=None) -> None:
    """Write a good file but for the changes, each (row, column, channel, value)."""
    data = rng.uniform(0.1, 0.9, (6, 8, len(names))).astype(np.float32)
    for row, column, channel, value in changes:
        data[row, column, names.index(channel)] = value
    write_pixels(path, data, names, attributes=attributes)


@pytest.mark.parametrize(("bits", "atol"), [(8, 0.5 / 255), (16, 0.5 / 65535)])
def test_png_keeps_encoded_colour_to_half_a_step(tmp_path, rng, bits, atol):
    colour = rng.random((5, 7, 3), dtype=np.float32)

    save_colour(tmp_path / "a.png", colour, bits=bits)

    np.testing.assert_allclose(load_colour(tmp_path / "a.png"), colour, atol=atol + 2**-24)


@pytest.mark.parametrize(("bits", "atol"), [(32, ENCODED_ATOL), (16, HALF_ATOL)])
def test_exr_holds_linear_light_and_comes_back_encoded(tmp_path, rng, bits, atol):
    colour = rng.random((5, 7, 3), dtype=np.float32)

    save_colour(tmp_path / "a.exr", colour, bits=bits)

    stored = read_pixels(tmp_path / "a.exr").data
    np.testing.assert_allclose(encode_srgb(stored), colour, atol=atol)
    np.testing.assert_allclose(load_colour(tmp_path / "a.exr"), colour, atol=atol)


def test_exr_of_encoded_values_is_taken_as_it_is_when_told_so(tmp_path):
    """By hand: linear 0.5 is 0.7354 encoded by the sRGB curve."""
    write_pixels(tmp_path / "a.exr", np.full((2, 2, 3), 0.5, np.float32), "RGB")

    assert load_colour(tmp_path / "a.exr")[0, 0, 0] == pytest.approx(0.73536, abs=1e-5)
    assert load_colour(tmp_path / "a.exr", transfer=Transfer.ENCODED)[0, 0, 0] == 0.5


def test_bits_that_a_format_has_not_are_refused(tmp_path):
    colour = np.zeros((2, 2, 3), np.float32)

    for name, bits in (("a.png", 32), ("a.exr", 8)):
        with pytest.raises(InputError, match="bits"):
            save_colour(tmp_path / name, colour, bits=bits)


def test_warp_input_comes_back(tmp_path, frame):
    save_warp_input(tmp_path / "a.exr", frame)
    back = load_warp_input(tmp_path / "a.exr")

    np.testing.assert_allclose(back.source.colour, frame.source.colour, atol=ENCODED_ATOL)
    np.testing.assert_array_equal(back.source.depth_m, frame.source.depth_m)
    np.testing.assert_array_equal(back.flow_px, frame.flow_px)
    assert back.target_depth_m is None


def test_what_lies_in_the_target_view_comes_back(tmp_path, frame):
    target_m = frame.source.depth_m * np.float32(1.1)
    moved = WarpInput(frame.source, frame.flow_px, target_m)
    save_warp_input(tmp_path / "a.exr", moved)
    back = load_warp_input(tmp_path / "a.exr")

    np.testing.assert_array_equal(back.source.depth_m, frame.source.depth_m)
    np.testing.assert_array_equal(back.flow_px, frame.flow_px)
    np.testing.assert_array_equal(back.target_depth_m, target_m)
    np.testing.assert_allclose(back.source.colour, frame.source.colour, atol=ENCODED_ATOL)


def test_other_programs_channel_names_are_known_or_can_be_told(tmp_path, rng):
    nuke = ("R", "G", "B", "depth.Z", "forward.u", "forward.v")
    save_planes(tmp_path / "nuke.exr", rng, names=nuke)
    own = ("R", "G", "B", "far", "forward.u", "forward.v")
    save_planes(tmp_path / "own.exr", rng, names=own)

    assert load_warp_input(tmp_path / "nuke.exr").flow_px.shape == (6, 8, 2)
    with pytest.raises(InputError, match=r"must have a channel Z or depth\.Z .*has R, G, B, far"):
        load_warp_input(tmp_path / "own.exr")
    told = load_warp_input(tmp_path / "own.exr", channels=Channels(depth=("far",)))
    assert told.source.depth_m.shape == (6, 8)


def test_blender_s_empty_depth_means_nothing_there(tmp_path, rng):
    save_planes(tmp_path / "a.exr", rng, [(2, 3, "Z", 1e10)])

    depth_m = load_warp_input(tmp_path / "a.exr").source.depth_m

    assert np.argwhere(np.isinf(depth_m)).tolist() == [[2, 3]]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ((2, 3, "R", np.nan), "colour must be finite .* at row 2, column 3"),
        ((2, 3, "G", np.inf), "colour must be finite .* at row 2, column 3"),
        ((2, 3, "B", 1.5), r"colour must lie in \[0, 1\] .* at row 2, column 3"),
        ((2, 3, "Z", 0.0), "depth must be greater than 0 .* at row 2, column 3"),
        ((2, 3, "Z", -1.0), "depth must be greater than 0 .* at row 2, column 3"),
        ((2, 3, "Z", np.nan), "depth must be greater than 0 .* at row 2, column 3"),
        ((2, 3, "flow.x", np.nan), "flow must be finite .* at row 2, column 3"),
        ((2, 3, "flow.y", np.inf), "flow must be finite .* at row 2, column 3"),
    ],
)
def test_a_bad_value_is_told_with_file_rule_and_place(tmp_path, rng, change, said):
    save_planes(tmp_path / "a.exr", rng, [change])

    with pytest.raises(InputError, match=rf"a\.exr: {said}"):
        load_warp_input(tmp_path / "a.exr")


def test_bright_light_is_clipped_only_when_allowed(tmp_path, rng):
    save_planes(tmp_path / "a.exr", rng, [(0, 0, "R", 7.0), (1, 1, "G", -0.1)])

    colour = load_warp_input(tmp_path / "a.exr", clip=True).source.colour

    assert colour[0, 0, 0] == 1.0
    assert colour[1, 1, 1] == 0.0


def test_what_rounding_leaves_outside_is_clipped_with_a_note(tmp_path, rng):
    save_planes(tmp_path / "a.exr", rng, [(0, 0, "R", 1.003), (1, 1, "G", -1.6e-6)])
    with pytest.warns(FileNote, match=r"2 pixels lie up to 0\.003 outside \[0, 1\]: clipped"):
        colour = load_warp_input(tmp_path / "a.exr").source.colour
    assert colour[0, 0, 0] == 1.0
    assert colour[1, 1, 1] == 0.0
    assert "clipped to what a display shows" in read_any(tmp_path / "a.exr").notes[-1]


def test_light_below_0_is_not_told_to_be_less(tmp_path, rng):
    save_planes(tmp_path / "a.exr", rng, [(1, 1, "G", -0.1)])
    with pytest.raises(InputError, match=r"more such pixels\); allow clipping"):
        load_warp_input(tmp_path / "a.exr")
    opened = read_any(tmp_path / "a.exr")
    assert any("below 0, to -0.1: 0" in note for note in opened.notes)
    assert opened.colour[1, 1, 1] == 0


@pytest.mark.parametrize("missing", NAMES)
def test_a_missing_channel_is_told(tmp_path, rng, missing):
    save_planes(tmp_path / "a.exr", rng, names=tuple(n for n in NAMES if n != missing))

    with pytest.raises(InputError, match=f"must have a channel {missing}.*; name it by --channel"):
        load_warp_input(tmp_path / "a.exr")


def test_depth_in_another_unit_is_refused(tmp_path, rng):
    save_planes(tmp_path / "a.exr", rng, attributes={"metamerlab:depth_unit": "mm"})

    with pytest.raises(InputError, match=r"depth must be in metres .*'mm'"):
        load_warp_input(tmp_path / "a.exr")


def test_a_plane_is_read_as_stored(tmp_path):
    grey = np.arange(12, dtype=np.uint16).reshape(3, 4, 1)
    write_pixels(tmp_path / "a.png", grey, "Y")
    write_pixels(tmp_path / "b.png", np.repeat(grey, 3, axis=-1), "RGB")
    write_pixels(tmp_path / "c.png", np.arange(12, dtype=np.uint8).reshape(2, 2, 3), "RGB")

    for name in ("a.png", "b.png"):
        plane, integer = load_plane(tmp_path / name)
        assert integer
        np.testing.assert_array_equal(plane, grey[..., 0])
    with pytest.raises(InputError, match="must have one channel"):
        load_plane(tmp_path / "c.png")
