"""Pixels survive the way to a file and back, and bad files are told apart."""

import resource

import forked
import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.pictures.decode import StoredPixels, read_pixels, three_channels
from pipeline.pictures.write import write_pixels

RGBZ = ("R", "G", "B", "Z")


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_integers_come_back_exactly(tmp_path, rng, dtype):
    data = rng.integers(0, np.iinfo(dtype).max, (7, 5, 3), dtype=dtype, endpoint=True)

    write_pixels(tmp_path / "a.png", data, "RGB")
    back = read_pixels(tmp_path / "a.png")

    np.testing.assert_array_equal(back.data, data)
    assert (back.data.dtype, back.channels) == (dtype, ("R", "G", "B"))


def test_exr_keeps_names_types_header_and_values_that_are_not_finite(tmp_path, rng):
    data = rng.random((6, 4, 4), dtype=np.float32)
    data[0, 0, 3], data[1, 1, 3] = np.inf, np.nan

    write_pixels(
        tmp_path / "a.exr",
        data,
        RGBZ,
        types=("half",) * 3 + ("float",),
        attributes={"metamerlab:depth_unit": "m"},
    )
    back = read_pixels(tmp_path / "a.exr")

    assert back.channels == RGBZ
    assert back.attributes["metamerlab:depth_unit"] == "m"
    np.testing.assert_array_equal(back.data[..., 3], data[..., 3])
    np.testing.assert_array_equal(back.data[..., :3], data[..., :3].astype(np.float16))


def test_same_pixels_give_the_same_bytes_at_any_time(tmp_path, rng):
    """OpenEXR stamps the time of writing into the header unless told one."""
    data = rng.random((6, 4, 3), dtype=np.float32)
    write_pixels(tmp_path / "a.exr", data, "RGB")

    stamped = read_pixels(tmp_path / "a.exr").attributes["DateTime"]

    assert stamped == "1970:01:01 00:00:00"


def test_pfm_rows_run_from_the_bottom_up(tmp_path):
    """By hand: the format stores the last row first."""
    (tmp_path / "a.pfm").write_bytes(b"Pf\n1 2\n-1.0\n" + np.array([3, 8], "<f4").tobytes())

    assert read_pixels(tmp_path / "a.pfm").data.ravel().tolist() == [8, 3]


def test_transparent_colour_is_stored_as_it_is(tmp_path):
    data = np.full((2, 2, 4), 200, np.uint8)
    data[..., 3] = 100

    write_pixels(tmp_path / "a.png", data, "RGBA")

    np.testing.assert_array_equal(read_pixels(tmp_path / "a.png").data, data)


def whole_png(tmp_path, rng) -> bytes:
    data = rng.integers(0, 255, (64, 64, 3), dtype=np.uint8)
    write_pixels(tmp_path / "whole.png", data, "RGB")
    return (tmp_path / "whole.png").read_bytes()


def test_a_truncated_png_is_told(tmp_path, rng):
    whole = whole_png(tmp_path, rng)
    (tmp_path / "cut.png").write_bytes(whole[: len(whole) // 2])

    with pytest.raises(InputError, match=r"cut\.png: must be a whole image"):
        read_pixels(tmp_path / "cut.png")


@pytest.mark.parametrize("share", [0.05, 0.5, 0.9])
def test_a_truncated_exr_is_told(tmp_path, rng, share):
    write_pixels(tmp_path / "whole.exr", rng.random((64, 64, 3), dtype=np.float32), "RGB")
    whole = (tmp_path / "whole.exr").read_bytes()
    (tmp_path / "cut.exr").write_bytes(whole[: int(share * len(whole))])

    with pytest.raises(InputError, match=r"cut\.exr: must be a(n| whole) image"):
        read_pixels(tmp_path / "cut.exr")


@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.txt", "a"])
def test_what_is_not_an_image_is_told(tmp_path, name):
    (tmp_path / name).write_text("not an image")

    with pytest.raises(InputError, match="must be an image"):
        read_pixels(tmp_path / name)


def test_a_folder_and_a_missing_file_are_told(tmp_path):
    with pytest.raises(InputError, match="it is a folder"):
        read_pixels(tmp_path)
    with pytest.raises(FileNotFoundError):
        read_pixels(tmp_path / "nowhere.png")


@pytest.mark.parametrize(
    ("name", "channels", "error"),
    [
        ("a.unknown", "RGB", InputError),  # no such format
        ("a.pfm", "RG", InputError),  # a format without such channels
        ("missing/a.png", "RGB", FileNotFoundError),
    ],
)
def test_a_failed_write_leaves_nothing_behind(tmp_path, name, channels, error):
    with pytest.raises(error, match="a"):
        write_pixels(tmp_path / name, np.zeros((4, 4, len(channels)), np.float32), channels)

    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_keeps_the_file_that_was_there(tmp_path):
    write_pixels(tmp_path / "a.pfm", np.ones((4, 4, 1), np.float32), "Y")
    before = (tmp_path / "a.pfm").read_bytes()

    with pytest.raises(InputError):
        write_pixels(tmp_path / "a.pfm", np.zeros((4, 4, 2), np.float32), "RG")

    assert (tmp_path / "a.pfm").read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("name", ["a.png", "a.exr"])
def test_a_file_that_came_out_short_is_not_kept(tmp_path, rng, name):
    """As on a full disk: the system takes no more bytes, and OpenImageIO reports success."""
    data = rng.integers(0, 65535, (200, 200, 3), dtype=np.uint16)
    pixels = data if name.endswith("png") else data.astype(np.float32)
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, limit[1]))
    try:
        with pytest.raises(InputError, match=f"{name}: cannot be written"):
            write_pixels(tmp_path / name, pixels, "RGB")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)

    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a.jpg", "a.webp"])
def test_a_full_disk_neither_ends_the_program_nor_holds_it(tmp_path, name):
    """In a process of its own, which may take 20 s: libraries of some formats do that."""
    script = f"""
import resource, numpy as np
from pathlib import Path
from pipeline.pictures.write import write_pixels
noise = np.random.default_rng(0).integers(0, 256, (100, 200, 3), dtype=np.uint8)
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
try:
    write_pixels(Path({str(tmp_path / name)!r}), noise, "RGB")
except OSError as error:
    print(error.filename, error.strerror)
"""
    done = forked.run(code=script, timeout=20)
    assert done.stdout == f"{tmp_path / name} File too large\n", done.stderr
    assert list(tmp_path.iterdir()) == []


def test_three_channels_takes_grey_and_opaque_and_refuses_the_rest(tmp_path):
    def channels(names: str, value: int = 255) -> tuple[int, ...]:
        pixels = StoredPixels(np.full((2, 3, len(names)), value, np.uint8), tuple(names))
        return three_channels(tmp_path, pixels).shape

    assert channels("Y") == channels("RGB") == channels("RGBA") == (2, 3, 3)
    with pytest.raises(InputError, match="must be opaque"):
        channels("RGBA", 254)
    with pytest.raises(InputError, match=r"must have the channels R, G, B \(has R, G\)"):
        channels("RG")


def test_three_channels_sorts_by_name(tmp_path):
    pixels = StoredPixels(np.array([[[1, 2, 3]]], np.uint8), ("B", "G", "R"))

    assert three_channels(tmp_path, pixels).tolist() == [[[3, 2, 1]]]
