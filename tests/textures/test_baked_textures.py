"""Baked textures: moments known by hand, streaming, the file, damage."""

import struct
import zlib

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.features.reference import fitted_kernels
from pipeline.foveation.chain import chain_of
from pipeline.foveation.pooled_moments import moment_chain
from pipeline.textures import bake as bake_module
from pipeline.textures.bake import MOMENTS, BakedTexture, Layout, bake, strips
from pipeline.textures.baked_file import head_bytes, read_baked, write_baked

HALF = 2.0**-11  # rounding of a half float


def grey(plane):
    return np.repeat(np.rint(255 * plane).astype(np.uint8)[..., None], 3, axis=2)


def all_planes(baked):
    yield from baked.colour
    for mips in baked.moments:
        yield from mips


def write(path, texture, *, wraps=False):
    layout = Layout(texture.shape[1], texture.shape[0], wraps)
    with path.open("w+b") as file:
        write_baked(file, layout, strips(texture))
    return layout


def bake_whole(texture: np.ndarray, *, wraps: bool) -> BakedTexture:
    """The definition: each plane from the whole of the one before."""
    height, width = texture.shape[:2]
    layout = Layout(width, height, wraps)
    count = layout.halvings
    lows = chain_of(texture.astype(np.float64) / 255, count, wraps=wraps)
    chains = [moment_chain(lows[k], count - k, wraps=wraps) for k in range(count)]
    return BakedTexture(
        layout,
        tuple(np.rint(255 * low.clip(0, 1)).astype(np.uint8) for low in lows),
        tuple(
            tuple(found[..., :MOMENTS].astype(np.float16) for found in chain) for chain in chains
        ),
    )


@pytest.mark.parametrize("strip_texels", [1, 700, 1 << 18])
@pytest.mark.parametrize(
    ("size", "wraps"),
    [((97, 131), False), ((64, 128), True), ((1, 1), False), ((3, 200), False), ((90, 32), False)],
)
def test_rows_that_flow_through_give_what_the_whole_texture_gives(
    rng, monkeypatch, size, wraps, strip_texels
):
    """Bit for bit, whatever comes at a time: nothing is seen of where strips end."""
    monkeypatch.setattr(bake_module, "STRIP_TEXELS", strip_texels)
    texture = rng.integers(0, 256, (*size, 3), dtype=np.uint8)

    streamed, whole = bake(texture, wraps=wraps), bake_whole(texture, wraps=wraps)

    for found, wanted in zip(all_planes(streamed), all_planes(whole), strict=True):
        np.testing.assert_array_equal(found, wanted)


def test_never_more_rows_are_held_than_operators_reach(rng):
    """That is what bounds memory: strips of two rows leave at most six rows anywhere."""
    layout = Layout(16, 512)
    cascade = bake_module.Cascade(layout, lambda *_: None)
    stages = [*cascade._lows, *cascade._firsts, *(s for row in cascade._moments for s in row)]
    for start in range(0, 512, 2):
        cascade.feed(rng.integers(0, 256, (2, 16, 3), dtype=np.uint8), last=start == 510)
        assert max(sum(map(len, stage._held)) for stage in stages) <= 6


def test_a_constant_has_no_moments():
    baked = bake(np.full((40, 24, 3), (200, 80, 30), np.uint8))

    assert all((colour == (200, 80, 30)).all() for colour in baked.colour)
    assert all((mip == 0).all() for mips in baked.moments for mip in mips)


def test_moments_of_a_checkerboard_are_those_of_its_kernels():
    """By hand: every coefficient is +-s, s the kernel weighed by the board's signs and contrast.

    So E[b^2] = s^2 and E[b] = 0 at every resolution, and halvings are grey.
    """
    y, x = np.mgrid[:64, :64]
    baked = bake(grey((51 + 153 * ((y + x) % 2)) / 255))
    signs = (-1.0) ** np.add.outer(np.arange(3), np.arange(3))
    amplitude = 0.5 * 153 / 255
    wanted = [(amplitude * (signs * kernel).sum()) ** 2 for kernel in fitted_kernels().bands()]

    for mip in baked.moments[0]:
        inner = mip[2:-2, 2:-2] if len(mip) > 8 else mip[2:-2, 2:-2][:0]
        square, mean = inner[..., :3].astype(float), inner[..., 3:6].astype(float)
        np.testing.assert_allclose(
            square, np.broadcast_to(wanted, square.shape), rtol=4 * HALF, atol=2.0**-24
        )
        np.testing.assert_allclose(mean, 0, atol=1e-6)
    low = fitted_kernels().low
    left = amplitude * abs((low * np.resize([[1, -1], [-1, 1]], low.shape)).sum())
    inner = baked.colour[1][4:-4, 4:-4].astype(float)
    assert abs(inner - 127.5).max() <= 255 * left + 0.5 + 1e-9


def test_white_noise_has_the_variance_that_its_kernels_let_through(rng):
    """Of a kernel k, sum k^2 times the noise's; at level 1 after the low-pass, and no mean."""
    deviation = 0.1
    plane = 0.5 + deviation * np.sqrt(12) * (rng.random((256, 256)) - 0.5)
    baked = bake(grey(plane))
    top = baked.moments[0][-1].astype(float).mean(axis=(0, 1))

    wanted = [deviation**2 * (kernel**2).sum() for kernel in fitted_kernels().bands()]
    np.testing.assert_allclose(top[:3], wanted, rtol=0.05)
    np.testing.assert_allclose(top[3:6], 0, atol=0.02 * deviation)


def test_products_with_chroma_tell_the_colour_of_detail(rng):
    """Red alone varies: Cr goes with luma as 0.5 : 0.2126, and Cb against it."""
    texture = np.full((64, 64, 3), 128, np.uint8)
    texture[..., 0] = rng.integers(60, 200, (64, 64))
    top = bake(texture).moments[0][-1].astype(float).mean(axis=(0, 1))

    slope = top[6:8] / top[:3].sum()

    np.testing.assert_allclose(slope, (-1 / 1.8556, 0.5 / 0.2126), rtol=0.01)


def test_a_file_holds_what_was_baked(rng, tmp_path):
    texture = rng.integers(0, 256, (45, 64, 3), dtype=np.uint8)
    write(tmp_path / "t.moments", texture, wraps=True)

    read = read_baked(tmp_path / "t.moments")

    assert read.layout == Layout(64, 45, True)
    for found, wanted in zip(all_planes(read), all_planes(bake(texture, wraps=True)), strict=True):
        np.testing.assert_array_equal(found, wanted)


def test_every_changed_byte_and_every_cut_is_found(rng, tmp_path):
    path = tmp_path / "t.moments"
    write(path, rng.integers(0, 256, (33, 20, 3), dtype=np.uint8))
    whole = path.read_bytes()
    for at in [*range(12), *rng.integers(0, len(whole), 120)]:
        damaged = bytearray(whole)
        damaged[at] ^= int(rng.integers(1, 256))
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=str(path)):
            read_baked(path)
    for cut in (0, 3, 15, 40, len(whole) - 1):
        path.write_bytes(whole[:cut])
        with pytest.raises(InputError):
            read_baked(path)
    path.write_bytes(whole + b"\0")
    with pytest.raises(InputError, match="must have"):
        read_baked(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (struct.pack("<4sBB2xII", b"MMLT", 1, 0, 2**31, 2**31), "edges of 1 to 16384"),
        (struct.pack("<4sBB2xII", b"MMLT", 1, 0, 0, 20), "edges of 1 to 16384"),
        (struct.pack("<4sBB2xII", b"MMLT", 1, 0, 16384, 16384), "must have"),
        (struct.pack("<4sBB2xII", b"MMLT", 1, 1, 33, 20), "multiple of"),
        (struct.pack("<4sBB2xII", b"MMLT", 2, 0, 20, 33), "version"),
        (struct.pack("<4sBB2xII", b"MMLC", 1, 0, 20, 33), "baked texture"),
    ],
)
def test_a_hostile_header_gets_one_message(tmp_path, change, message):
    path = tmp_path / "t.moments"
    write(path, np.zeros((33, 20, 3), np.uint8))
    whole = path.read_bytes()
    path.write_bytes(change + whole[len(change) :])

    with pytest.raises(InputError, match=message):
        read_baked(path)


def test_moments_that_are_no_numbers_are_refused_though_their_checksums_hold(tmp_path):
    path = tmp_path / "t.moments"
    layout = write(path, np.zeros((33, 20, 3), np.uint8))
    data = bytearray(path.read_bytes())
    planes = layout.planes()
    index = next(i for i, plane in enumerate(planes) if plane.level == 0)
    start = head_bytes(layout)
    at = start + planes[index].at
    data[at : at + 2] = np.float16(np.nan).tobytes()
    part = data[at : at + planes[index].nbytes]
    struct.pack_into("<I", data, 16 + 4 * index, zlib.crc32(part))
    struct.pack_into("<I", data, start - 4, zlib.crc32(data[: start - 4]))
    path.write_bytes(data)

    with pytest.raises(InputError, match="finite"):
        read_baked(path)


def test_a_texture_that_cannot_go_round_is_told_a_width_that_can():
    with pytest.raises(InputError, match=r"multiple of 16 px wide.*resize it to 96 px"):
        Layout(100, 50, wraps=True)
