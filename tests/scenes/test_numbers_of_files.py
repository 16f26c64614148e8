"""Numbers of depth and disparity come as they are stored, and what stands for unknown is known."""

import re
import struct
import warnings
import zlib

import cv2
import numpy as np
import odd_pictures as odd
import OpenImageIO as oiio  # noqa: N813
import pytest
from number_files import load_plane
from PIL import Image

from pipeline.errors import FileNote, InputError
from pipeline.pictures.colour_file import load_colour
from pipeline.pictures.decode import read_parts, read_pixels
from pipeline.pictures.depth_and_flow import along_axis, load_depth, read_flow
from pipeline.pictures.warp_input import load_warp_input
from protocols.recipes.warped_clips import CirclePath, ExrScene, RgbdScene, StereoScene
from stimuli.scenes.pair_check import judge_pair
from stimuli.scenes.photo import open_rgbd, read_pair
from stimuli.scenes.sequence import load_picture
from stimuli.scenes.stereo import load_pair

HEIGHT, WIDTH = 40, 64
CIRCLE = CirclePath(kind="circle")


@pytest.fixture
def truth_px():
    """A square in front of a slope, all whole sixteenths of a pixel."""
    disparity = np.tile(np.linspace(2, 5, WIDTH), (HEIGHT, 1))
    disparity[10:30, 20:40] = 12
    return np.rint(16 * disparity) / 16


@pytest.fixture
def left(tmp_path, rng):
    Image.fromarray(rng.integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8)).save(tmp_path / "left.png")
    return tmp_path / "left.png"


def tell(read, *arguments, **options):
    """Result of a reader, and the notes."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = read(*arguments, **options)
    assert all(issubclass(one.category, FileNote) for one in caught), [str(c) for c in caught]
    return found, [str(one.message) for one in caught]


def pfm(path, plane, scale, order):
    head = f"{'PF' if plane.ndim == 3 else 'Pf'}\n{plane.shape[1]} {plane.shape[0]}\n{scale}\n"
    path.write_bytes(head.encode() + plane[::-1].astype(f"{order}f4").tobytes())


# ---- read as stored


@pytest.mark.parametrize("dtype", ["int8", "int16", "int32", "uint32", "float32", "float64"])
def test_every_type_of_tiff_is_read_as_it_is_stored(tmp_path, dtype):
    stored = np.arange(1, 13).reshape(3, 4).astype(dtype)
    cv2.imwrite(str(tmp_path / "a.tiff"), stored)

    plane, integer = load_plane(tmp_path / "a.tiff")

    assert plane.dtype == stored.dtype
    assert integer == (stored.dtype.kind in "iu")
    np.testing.assert_array_equal(plane, stored)


@pytest.mark.parametrize(
    ("scale", "order"), [("-1.0", "<"), ("-0.003922", "<"), ("1", ">"), ("255.0", ">")]
)
def test_a_pfms_scale_is_its_byte_order_and_no_factor(tmp_path, scale, order):
    stored = np.arange(12, dtype=np.float32).reshape(3, 4) / 3
    pfm(tmp_path / "a.pfm", stored, scale, order)
    pfm(tmp_path / "c.pfm", np.dstack([stored, stored / 2, stored / 4]), scale, order)

    np.testing.assert_array_equal(load_plane(tmp_path / "a.pfm")[0], stored)
    np.testing.assert_array_equal(read_pixels(tmp_path / "c.pfm").data[..., 1], stored / 2)


@pytest.mark.parametrize("largest", [9, 100, 200, 1000, 40_000, 65_535])
@pytest.mark.parametrize("kind", ["P2", "P5"])
def test_a_pgms_largest_number_is_no_factor_of_depth_and_white_of_a_picture(
    tmp_path, largest, kind
):
    stored = np.array([[0, 1, largest // 2, largest]])
    head = f"{kind}\n# by hand\n4 1\n{largest}\n".encode()
    body = stored.astype("u1" if largest < 256 else ">u2").tobytes()
    text = " ".join(map(str, stored[0])).encode()
    (tmp_path / "a.pgm").write_bytes(head + (text if kind == "P2" else body))

    np.testing.assert_array_equal(load_plane(tmp_path / "a.pgm")[0], stored)
    assert load_colour(tmp_path / "a.pgm")[0, 3, 0] == 1


@pytest.mark.parametrize("kind", ["P5", "P6", "Pf", "PF"])
def test_a_line_end_of_two_bytes_shifts_no_numbers_and_other_surplus_is_refused(tmp_path, kind):
    channels = 3 if kind in ("P6", "PF") else 1
    stored = np.arange(12 * channels).reshape(3, 4, channels).astype("u1")
    scale, data = ("255", stored) if kind < "Pa" and kind != "PF" else ("-1", stored[::-1])
    body = data.astype("u1" if scale == "255" else "<f4").tobytes()
    head = f"{kind}\r\n4 3\r\n{scale}\r\n".encode()
    path = tmp_path / ("a.ppm" if scale == "255" else "a.pfm")
    path.write_bytes(head + body)

    for stretched in (True, False):
        np.testing.assert_array_equal(read_pixels(path, stretched=stretched).data, stored)
    for bad in (head + body + b"\n", head[:-2] + b"\n\n" + body):
        path.write_bytes(bad)
        with pytest.raises(InputError, match="must end with its last number"):
            read_pixels(path)


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ("1 2 3 4 5 6 7", "must end with its last number .*6 numbers, and 7 follow"),
        ("1 2 3 -4 5 6", "must hold whole numbers of 0 and more .one is '-4'.*as PFM"),
        ("1 2 3 4.5 5 6", "must hold whole numbers of 0 and more .one is '4.5'"),
        ("1 2 3 4 5", "must be a whole image"),
        ("1 2 3 4 5 99999", "must hold numbers up to 255"),
    ],
)
def test_text_of_a_pgm_must_be_the_numbers_that_its_header_says(tmp_path, numbers, said):
    for whole, text in ((True, "1 2 3 4 5 6 # the end"), (False, numbers)):
        (tmp_path / "a.pgm").write_text(f"P2\n3 2\n255\n{text}\n")
        if whole:
            assert load_plane(tmp_path / "a.pgm")[0].tolist() == [[1, 2, 3], [4, 5, 6]]
            continue
        with pytest.raises(InputError, match=said):
            load_plane(tmp_path / "a.pgm")


def test_a_distance_far_nearer_than_all_others_is_asked_about(tmp_path):
    depth = np.linspace(2, 9, 200, dtype=np.float32).reshape(10, 20)
    depth[:2] = 0.01
    np.save(tmp_path / "a.npy", depth)
    with pytest.raises(InputError, match=r"40 pixels hold 0\.01, far from all others.*--unknown"):
        load_depth(tmp_path / "a.npy", 1.0)[0]
    filled = load_depth(tmp_path / "a.npy", 1.0, unknown=[0.01])[0]
    np.testing.assert_allclose(filled[:2], filled[[2, 2]], rtol=1e-6)
    assert (load_depth(tmp_path / "a.npy", 1.0, unknown=[])[0][:2] == np.float32(0.01)).all()
    depth[:2] = 0.1
    np.save(tmp_path / "a.npy", depth)
    assert (load_depth(tmp_path / "a.npy", 1.0)[0][:2] == np.float32(0.1)).all()


def test_numbers_of_few_bits_stay_what_they_are(tmp_path):
    stored = np.arange(16, dtype=np.uint8).reshape(4, 4)
    rows = b"".join(b"\0" + bytes([row[0] << 4 | row[1], row[2] << 4 | row[3]]) for row in stored)
    (tmp_path / "a.png").write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + odd.chunk(b"IHDR", struct.pack(">IIBBBBB", 4, 4, 4, 0, 0, 0, 0))
        + odd.chunk(b"IDAT", zlib.compress(rows))
        + odd.chunk(b"IEND", b"")
    )
    spec = oiio.ImageSpec(4, 4, 1, "uint16")
    spec.attribute("oiio:BitsPerSample", 12)
    out = oiio.ImageOutput.create(str(tmp_path / "a.tif"))
    assert out.open(str(tmp_path / "a.tif"), spec)
    out.write_image((stored.astype(np.uint16) * 273)[..., None])
    out.close()

    np.testing.assert_array_equal(load_plane(tmp_path / "a.png")[0], stored)
    assert load_colour(tmp_path / "a.png")[3, 3, 0] == 1
    twelve = load_plane(tmp_path / "a.tif")[0]
    assert int(twelve[3, 3]) in (15 * 273 >> 4, (15 * 273 >> 4) + 1)


def test_whole_numbers_of_openexr_are_no_shares(tmp_path):
    stored = np.arange(1, 13, dtype=np.uint32).reshape(3, 4)
    odd.write_exr(tmp_path / "a.exr", {"Z": stored}, kind="uint")

    np.testing.assert_array_equal(load_plane(tmp_path / "a.exr")[0], stored)
    np.testing.assert_array_equal(read_parts(tmp_path / "a.exr").planes["Z"], stored)


@pytest.mark.parametrize("dtype", ["int16", "int32", "uint32"])
def test_integers_that_have_no_white_are_no_picture(tmp_path, dtype):
    cv2.imwrite(str(tmp_path / "a.tiff"), np.ones((3, 4), dtype))

    with pytest.raises(InputError, match="a picture must hold 8 or 16 bits"):
        load_colour(tmp_path / "a.tiff")


@pytest.mark.parametrize("name", ["a.npy", "a.npz", "a.pfm", "a.tiff", "a.png"])
def test_depth_takes_what_disparity_takes(tmp_path, left, truth_px, name):
    stored = np.rint(100 * truth_px).astype(np.uint16)
    if name == "a.npy":
        np.save(tmp_path / name, stored)
    elif name == "a.npz":
        np.savez(tmp_path / name, depth=stored)
    elif name == "a.pfm":
        pfm(tmp_path / name, stored.astype(np.float32), "-1", "<")
    else:
        cv2.imwrite(str(tmp_path / name), stored)

    depth = load_depth(tmp_path / name, 0.01)[0]
    pair = load_pair(left, tmp_path / name, units_per_px=100)

    np.testing.assert_allclose(depth, stored / 100, rtol=1e-6)
    np.testing.assert_allclose(pair.disparity_px, stored / 100, rtol=1e-6)


# ---- unknown


@pytest.mark.parametrize(
    ("stored_as", "units", "stands"),
    [("int16", 16, -16), ("int32", 1, -1), ("float32", 1, -1.0), ("float32", 1, np.inf),
     ("float64", 16, -16.0), ("uint16", 16, 0), ("float32", 1, np.nan), ("float32", 1, 1e30)],
)  # fmt: skip
def test_what_can_only_stand_for_unknown_is_taken_for_it(
    tmp_path, left, truth_px, stored_as, units, stands
):
    """The same unknown pixels told as NaN are the control."""
    control = truth_px.copy()
    stored = units * truth_px if units > 1 else np.rint(truth_px)
    control = stored / units
    control[:, :8] = np.nan
    stored = stored.astype(stored_as)
    stored[:, :8] = stands
    np.save(tmp_path / "control.npy", control)
    np.save(tmp_path / "a.npy", stored)
    wanted = load_pair(left, tmp_path / "control.npy")

    found, notes = tell(load_pair, left, tmp_path / "a.npy", units_per_px=units)

    np.testing.assert_array_equal(found.known, wanted.known)
    np.testing.assert_array_equal(found.disparity_px, wanted.disparity_px)
    assert len(notes) == (stands in (-1, -16))
    assert all(f"{stands:g}, at {8 * HEIGHT} pixels, is taken for unknown" in n for n in notes)


@pytest.mark.parametrize(
    ("stored_as", "units", "offset", "stands"),
    [("uint16", 256, 0, 65535), ("uint16", 64, 0, 65520), ("uint16", 16, 0, 65520),
     ("int16", 512, 0, 32767), ("uint8", 4, 0, 255), ("uint8", 4, 0, 240), ("int16", 16, 30, -16),
     ("int16", 16, 0, -32), ("float32", 1, 0, -5.0), ("float32", 1200, 0, 65504.0)],
)  # fmt: skip
def test_what_may_stand_for_unknown_is_asked_about_and_each_answer_is_taken(
    tmp_path, left, truth_px, stored_as, units, offset, stands
):
    stored = np.rint(units * truth_px).astype(stored_as)
    control = (stored / units).astype(np.float32)
    control[:, :8] = np.nan
    stored[:, :8] = stands
    np.save(tmp_path / "control.npy", control)
    np.save(tmp_path / "a.npy", stored)
    wanted = load_pair(left, tmp_path / "control.npy", offset_px=offset)
    how = {"units_per_px": units, "offset_px": offset}

    with pytest.raises(InputError, match=rf"--unknown {re.escape(f'{stands:g}')}"):
        load_pair(left, tmp_path / "a.npy", **how)
    found = load_pair(left, tmp_path / "a.npy", **how, unknown=(stands,))

    np.testing.assert_array_equal(found.known, wanted.known)
    np.testing.assert_array_equal(found.disparity_px, wanted.disparity_px)
    if 0 < stands / units < WIDTH:  # it may be a number like others
        assert load_pair(left, tmp_path / "a.npy", **how, unknown=()).known.all()


@pytest.mark.parametrize(
    ("stored_as", "stands"),
    [("int32", 2147483647), ("uint32", 4294967295), ("float32", -1 / 3), ("float64", -1 / 3),
     ("float32", 1234567), ("float16", -0.1)],
)  # fmt: skip
def test_the_number_that_a_message_names_is_the_number_stored(
    tmp_path, left, truth_px, stored_as, stands
):
    stored = np.rint(truth_px).astype(stored_as)
    stored[:, :8] = stands
    np.save(tmp_path / "a.npy", stored)

    with pytest.raises(InputError, match="--unknown") as told:
        load_pair(left, tmp_path / "a.npy")
    named = float(re.search(r"--unknown (\S+?)[;,]? ", str(told.value))[1])

    found = load_pair(left, tmp_path / "a.npy", unknown=(named,))
    assert not found.known[:, :8].any()
    assert found.known[:, 8:].all()
    values = {"kind": "stereo", "name": "s", "left": "l", "right": "r", "disparity": "a.npy",
              "focal_px": 64, "baseline_m": 0.1, "camera": {"kind": "stereo"}}  # fmt: skip
    assert StereoScene(**values, unknown=[named]).unknown == [named]


@pytest.mark.parametrize(("stored_as", "units"), [("float32", 1), ("int16", 16)])
def test_a_disparity_of_the_other_sign_is_told_as_one_and_turned_it_is_read(
    tmp_path, left, truth_px, stored_as, units
):
    stored = (-units * truth_px).astype(stored_as)
    stored[0, 0] = units
    np.save(tmp_path / "a.npy", stored)
    np.save(tmp_path / "b.npy", np.abs(stored))
    total = HEIGHT * WIDTH

    for told in (None, (777,)):
        with pytest.raises(InputError, match=rf"a\.npy: .*{total - 1} of {total} known") as found:
            load_pair(left, tmp_path / "a.npy", units_per_px=units, unknown=told)
        assert "its sign turned" in str(found.value)
        assert "offset" not in str(found.value)
    assert load_pair(left, tmp_path / "b.npy", units_per_px=units).known.all()


@pytest.mark.parametrize(
    ("kind", "stands"),
    [("distance", (-1, 0)), ("distance", (0, -9999, -1)), ("inverse", (-1, np.inf)),
     ("disparity", (-1, -2))],
)  # fmt: skip
def test_stand_ins_of_several_numbers_are_named_and_the_cure_takes_them(
    tmp_path, left, truth_px, kind, stands
):
    stored = truth_px.astype(np.float32)
    for number, stand in enumerate(stands):
        stored[:, number] = stand
    np.save(tmp_path / "d.npy", stored)

    def read(unknown=None):
        if kind == "disparity":
            return load_pair(left, tmp_path / "d.npy", unknown=unknown).disparity_px
        return load_depth(tmp_path / "d.npy", 1.0, is_a=kind, unknown=unknown)[0]

    with pytest.raises(InputError, match=f"at {HEIGHT} pixels") as told:
        read()
    named = [float(word) for word in re.findall(r"--unknown ([^\s;]+)", str(told.value))]

    assert sorted(named) == sorted(stands)
    assert (read(named) > 0).all()


def test_inverse_depth_of_infinity_is_noted_as_unknown(tmp_path):
    stored = np.full((6, 8), 0.5, np.float32)
    stored[:, :2] = np.inf
    np.save(tmp_path / "d.npy", stored)

    (depth, _), notes = tell(load_depth, tmp_path / "d.npy", 1.0, is_a="inverse")

    assert (depth == 2).all()
    assert "inf, at 12 pixels, is taken for unknown" in notes[0]


def test_depth_of_zero_in_a_file_of_colour_and_motion_says_what_to_store(tmp_path):
    light = np.full((4, 6), 0.5, np.float32)
    planes = {**dict.fromkeys("RGB", light), "Z": light.copy(), "flow.x": light, "flow.y": light}
    for value in (0, np.inf):  # the second is the cure
        planes["Z"][1, 2] = value
        odd.write_exr(tmp_path / "a.exr", planes)
        if value:
            assert load_warp_input(tmp_path / "a.exr").source.depth_m[1, 2] == np.inf
            continue
        with pytest.raises(InputError, match=r"got 0\.0 at row 1, column 2\); store inf there"):
            load_warp_input(tmp_path / "a.exr")


def test_numbers_that_are_not_apart_are_numbers(tmp_path, left):
    """A map that reaches its largest number without a gap."""
    smooth = np.tile(np.linspace(1000, 65535, WIDTH).astype(np.uint16), (HEIGHT, 1))
    cv2.imwrite(str(tmp_path / "a.png"), smooth)

    assert load_pair(left, tmp_path / "a.png", units_per_px=1100).known.all()


@pytest.mark.parametrize(
    ("stored_as", "stands", "noted"),
    [("float32", 0, True), ("float32", -1, True), ("float64", -9999, True), ("int16", 0, False),
     ("int32", -1, True), ("float32", np.nan, False), ("float32", -np.inf, True)],
)  # fmt: skip
def test_unknown_depth_takes_the_farther_side_whatever_stands_for_it(
    tmp_path, stored_as, stands, noted
):
    stored = np.full((6, 8), 2).astype(stored_as)
    stored[:, 4:] = 5
    stored[:, 3:5] = stands
    np.save(tmp_path / "d.npy", stored)

    (depth, _), notes = tell(load_depth, tmp_path / "d.npy", 1.0)

    np.testing.assert_allclose(depth, np.tile([2.0, 2, 2, 5, 5, 5, 5, 5], (6, 1)), rtol=1e-6)
    assert bool(notes) == noted


def test_depth_of_nothing_is_infinite(tmp_path):
    np.save(tmp_path / "d.npy", np.array([[1.0, 1e10, np.inf, 3.4e38]], np.float32))

    np.testing.assert_array_equal(load_depth(tmp_path / "d.npy", 0.5)[0], [[0.5, *[np.inf] * 3]])


@pytest.mark.parametrize("stored_as", ["int32", "uint32", "int64"])
def test_the_largest_number_of_16_bits_is_asked_about_in_wider_ones(tmp_path, stored_as):
    stored = np.full((30, 40), 2000, stored_as)
    stored[:10, :10], stored[0, 0] = 65535, 900
    np.save(tmp_path / "d.npy", stored)

    with pytest.raises(InputError, match=r"unknown = \[65535\] in a study, or --unknown 65535"):
        load_depth(tmp_path / "d.npy", 0.001)[0]
    assert load_depth(tmp_path / "d.npy", 0.001, unknown=(65535,))[0].max() == 2
    stored[:5, :5] = 99_000
    np.save(tmp_path / "d.npy", stored)
    assert load_depth(tmp_path / "d.npy", 0.001)[0].max() == 99


def test_a_largest_number_of_depth_far_from_others_is_asked_about(tmp_path):
    stored = np.full((30, 40), 2000, np.uint16)
    stored[:10, :10], stored[0, 0] = 65535, 900
    cv2.imwrite(str(tmp_path / "d.png"), stored)

    with pytest.raises(InputError, match=r"unknown = \[65535\] in a study, or --unknown 65535"):
        load_depth(tmp_path / "d.png", 0.001)[0]
    assert load_depth(tmp_path / "d.png", 0.001, unknown=(65535,))[0].max() == 2
    assert load_depth(tmp_path / "d.png", 0.001, unknown=())[0].max() == np.float32(65.535)


def test_gdals_number_for_unknown_is_honoured(tmp_path, left, truth_px):
    stored = np.rint(16 * truth_px).astype(np.uint16)
    stored[:, :8] = 777
    odd.tiff(tmp_path / "a.tif", {42113: "777"}, stored)
    odd.tiff(tmp_path / "b.tif", {42113: "nothing"}, stored)

    found = load_pair(left, tmp_path / "a.tif", units_per_px=16)

    assert not found.known[:, :8].any()
    assert found.known[:, 8:].all()
    with pytest.raises(InputError, match="GDAL_NODATA must be a number"):
        load_pair(left, tmp_path / "b.tif", units_per_px=16)


def test_impossible_numbers_that_are_not_one_are_refused(tmp_path, left, truth_px):
    truth_px[0, :4] = -1, -2, -3, -4
    np.save(tmp_path / "a.npy", truth_px)

    with pytest.raises(InputError, match="is the offset right"):
        load_pair(left, tmp_path / "a.npy")


# ---- what no picture can have


def test_a_single_disparity_far_beyond_the_picture_is_asked_about(tmp_path, left, truth_px):
    truth_px[:, :3] = 999
    np.save(tmp_path / "a.npy", truth_px)

    with pytest.raises(InputError, match=r"got 999 px.* --unknown 999; else, is units_per_px"):
        load_pair(left, tmp_path / "a.npy")
    assert not load_pair(left, tmp_path / "a.npy", unknown=(999,)).known[:, :3].any()


def test_a_plane_of_one_number_is_no_plane_of_unknown(tmp_path, left):
    for value in (7.0, 999.0, -5.0, 65535.0):
        np.save(tmp_path / "a.npy", np.full((HEIGHT, WIDTH), value))
        if value == 7:
            assert load_pair(left, tmp_path / "a.npy").known.all()
            continue
        with pytest.raises(InputError, match="disparity must be"):
            load_pair(left, tmp_path / "a.npy")


def test_a_disparity_wider_than_the_picture_is_refused(tmp_path, left, truth_px):
    np.save(tmp_path / "a.npy", (16 * truth_px).astype(np.int16))

    with pytest.raises(InputError, match=r"less than the picture's width, 64 px .*units_per_px"):
        load_pair(left, tmp_path / "a.npy")
    assert load_pair(left, tmp_path / "a.npy", units_per_px=16).known.all()  # the cure


def test_it_is_refused_also_where_the_other_photograph_says_nothing(tmp_path, truth_px):
    Image.fromarray(np.full((HEIGHT, WIDTH, 3), 90, np.uint8)).save(tmp_path / "flat.png")
    Image.fromarray(np.full((HEIGHT, WIDTH, 3), 91, np.uint8)).save(tmp_path / "flat2.png")
    truth_px[3, 3] = 2 * WIDTH
    np.save(tmp_path / "a.npy", truth_px)

    pair = load_pair(tmp_path / "flat.png", tmp_path / "a.npy", tmp_path / "flat2.png")
    verdict = judge_pair(pair)

    assert verdict.refused
    assert "less than the picture's width, 64 px (got 128 px at row 3, column 3" in str(verdict)


@pytest.mark.parametrize("stored_as", [">f4", ">f8", ">i2", ">u2"])
def test_a_wrong_byte_order_is_told_without_a_warning(tmp_path, left, stored_as, rng):
    slope = np.tile(np.linspace(300, 3000, WIDTH), (HEIGHT, 1)) + rng.uniform(0, 9, (HEIGHT, WIDTH))
    right_order = slope.astype(stored_as)
    wrong = right_order.view(right_order.dtype.newbyteorder("<"))
    np.save(tmp_path / "a.npy", wrong)
    np.save(tmp_path / "right.npy", right_order)

    for read in (lambda: load_pair(left, tmp_path / "a.npy"), lambda: load_depth(
        tmp_path / "a.npy", 0.001)):  # fmt: skip
        with pytest.raises(InputError, match="byte order that it states"):
            read()
    np.testing.assert_allclose(
        load_depth(tmp_path / "right.npy", 0.001)[0], 0.001 * right_order.astype(float), rtol=1e-6
    )


def test_motion_in_the_other_byte_order_is_no_standstill(tmp_path, rng):
    flow = rng.uniform(-9, 9, (6, 8, 2)).astype(np.float32)
    head = np.float32(202021.25).tobytes() + np.array([8, 6], "<i4").tobytes()
    for order in "<>":
        (tmp_path / "a.flo").write_bytes(head + flow.astype(f"{order}f4").tobytes())
        if order == "<":
            np.testing.assert_array_equal(read_flow(tmp_path / "a.flo")[0], flow)
            continue
        with pytest.raises(InputError, match="byte order that it states"):
            read_flow(tmp_path / "a.flo")


def test_numbers_of_another_size_are_told_with_both_files_and_sizes(tmp_path, left, truth_px):
    np.save(tmp_path / "half.npy", truth_px[::2, ::2])
    found = r"half\.npy: must be as large as .*left\.png, 64 x 40 px \(is 32 x 20 px\)"

    with pytest.raises(InputError, match=found):
        load_pair(left, tmp_path / "half.npy")
    Image.open(left).resize((32, 20)).save(left)  # the cure
    assert load_pair(left, tmp_path / "half.npy").known.all()


def test_a_depth_of_another_unit_is_refused_until_the_unit_is_told(tmp_path):
    plane = np.full((4, 6), 2000, np.float32)
    odd.write_exr(tmp_path / "a.exr", {"Z": plane}, **{"metamerlab:depth_unit": "mm"})

    with pytest.raises(InputError, match=r"in metres \(the header says 'mm'\); .*--depth-scale"):
        load_depth(tmp_path / "a.exr", 1.0)[0]
    assert load_depth(tmp_path / "a.exr", 0.001)[0][0, 0] == 2


# ---- a picture of numbers


def test_a_colour_map_is_told_as_one_and_the_numbers_are_asked_for(tmp_path, left, truth_px):
    mapped = cv2.applyColorMap((8 * truth_px).astype(np.uint8), cv2.COLORMAP_INFERNO)
    cv2.imwrite(str(tmp_path / "a.png"), mapped)

    with pytest.raises(InputError, match=r"numbers themselves .*ask whoever made it") as told:
        load_pair(left, tmp_path / "a.png")
    assert "save it as a grey" not in str(told.value)
    np.save(tmp_path / "a.npy", truth_px)  # the cure
    assert load_pair(left, tmp_path / "a.npy").known.all()


def test_an_opaque_alpha_changes_nothing_and_a_format_that_changes_numbers_is_refused(tmp_path):
    stored = np.arange(1, 13, dtype=np.uint8).reshape(3, 4)
    opaque = np.full_like(stored, 255)
    Image.fromarray(np.dstack([stored, opaque])).save(tmp_path / "a.png")
    Image.fromarray(np.dstack([stored, stored])).save(tmp_path / "b.png")
    Image.fromarray(stored).save(tmp_path / "a.gif")

    np.testing.assert_array_equal(load_plane(tmp_path / "a.png")[0], stored)
    with pytest.raises(InputError, match=r"one channel \(has Y, A\); write the one that is meant"):
        load_plane(tmp_path / "b.png")
    with pytest.raises(InputError, match=r"read from PNG, TIFF, OpenEXR, PGM and PFM .*gif"):
        load_plane(tmp_path / "a.gif")


@pytest.mark.parametrize("name", ["Z", "Y", "Depth.V"])
def test_the_one_plane_among_the_parts_of_a_file_is_taken(tmp_path, left, truth_px, name):
    """Wherever its part stands; of several that differ none is taken."""
    plane = truth_px.astype(np.float32)
    colour = dict.fromkeys("RGB", plane / 50)
    path = tmp_path / "a.exr"
    same = {"far": {name: plane}, "again": {name: plane}}
    for parts in ({"rgb": colour, "far": {name: plane}}, {"far": {name: plane}, "rgb": colour},
                  same):  # fmt: skip
        odd.write_parts(path, parts)

        np.testing.assert_array_equal(load_pair(left, path).disparity_px, plane)
        np.testing.assert_array_equal(load_plane(path)[0], plane)

    odd.write_parts(path, {"a": {name: plane}, "b": {name: 9 * plane}})
    for read in (lambda: load_pair(left, path), lambda: load_depth(path, 1.0)[0]):
        with pytest.raises(InputError, match=rf"fit: a\.{name}, b\.{name}\); save .* alone"):
            read()
    odd.write_parts(path, {"a": colour, "b": {k: 2 * v for k, v in colour.items()}})
    with pytest.raises(InputError, match=r"has a\.R, .*, b\.B\); write the one that is meant"):
        load_plane(path)


# ---- what depth is


def test_depth_along_the_ray_becomes_depth_along_the_axis():
    """By hand: a wall at 2 m, and a pixel 3 to the right and 4 down at a focal length of 5."""
    x, y = np.meshgrid(np.arange(9) - 4, np.arange(9) - 4)
    along_ray = 2 * np.sqrt(1 + (x / 5) ** 2 + (y / 5) ** 2)

    found = along_axis(along_ray.astype(np.float32), (5, 5, 4, 4))

    np.testing.assert_allclose(found, 2, rtol=1e-6)
    assert along_ray[8, 7] == pytest.approx(2 * np.sqrt(2))


@pytest.mark.parametrize("kind", ["rgbd", "exr"])
def test_a_scene_may_hold_depth_along_the_ray_or_its_inverse(tmp_path, kind):
    height, width, focal = 30, 40, 25.0
    x, y = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
    ray = (3 * np.sqrt(1 + (x / focal) ** 2 + (y / focal) ** 2)).astype(np.float32)
    Image.fromarray(np.full((height, width, 3), 90, np.uint8)).save(tmp_path / "c.png")
    np.save(tmp_path / "ray.npy", ray)
    np.save(tmp_path / "inverse.npy", np.float32(0.3) / np.full_like(ray, 3))
    light = np.full_like(ray, 0.25)
    odd.write_exr(tmp_path / "ray.exr", {"R": light, "G": light, "B": light, "Z": ray})

    def depth_m(name, depth_is, scale):
        shared = {"kind": kind, "name": "s", "camera": CIRCLE, "focal_px": focal,
                  "depth_is": depth_is, "depth_scale": scale}  # fmt: skip
        if kind == "exr":
            return load_picture(tmp_path / "ray.exr", ExrScene(file="-", **shared)).frame.depth_m
        scene = RgbdScene(rgb="c.png", depth=name, **shared)
        return open_rgbd(scene, tmp_path)._frame.depth_m

    np.testing.assert_allclose(depth_m("ray.npy", "ray", 1.0), 3, rtol=1e-6)
    if kind == "rgbd":
        np.testing.assert_allclose(depth_m("inverse.npy", "inverse", 0.3), 3, rtol=1e-6)


def test_a_study_says_what_stands_for_unknown(tmp_path, left, truth_px):
    stored = np.rint(256 * truth_px).astype(np.uint16)
    stored[:, :8] = 65535
    np.save(tmp_path / "a.npy", stored)
    Image.open(left).transpose(Image.Transpose.FLIP_LEFT_RIGHT).save(tmp_path / "right.png")
    values = {"kind": "stereo", "name": "s", "left": "left.png", "right": "right.png",
              "disparity": "a.npy", "units_per_px": 256, "focal_px": 64, "baseline_m": 0.1,
              "camera": {"kind": "stereo"}}  # fmt: skip

    with pytest.raises(InputError, match=r"unknown = \[65535\] in a study"):
        read_pair(StereoScene(**values), tmp_path)
    assert not read_pair(StereoScene(**values, unknown=[65535]), tmp_path).known[:, :8].any()
    assert "unknown" not in StereoScene(**values).model_dump_json()  # hashes stay as they were
