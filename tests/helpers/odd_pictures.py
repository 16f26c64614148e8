"""Small image files whose headers say one thing more than their pixels, byte by byte."""

import io
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from PIL import Image, ImageCms
from PIL.TiffImagePlugin import ImageFileDirectory_v2

RGB = np.random.default_rng(3).integers(30, 220, (6, 8, 3), np.uint8)
LIGHT = (RGB / 255).astype(np.float32)
GREY = RGB[..., 0].astype(np.uint16) * 7
_SRGB_XYZ = ((0.4361, 0.2225, 0.0139), (0.3851, 0.7169, 0.0971), (0.1431, 0.0606, 0.7141))
_ADOBE_XYZ = ((0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457))


def chunk(name: bytes, data: bytes) -> bytes:
    """A chunk of a PNG file."""
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def png(path: Path, *chunks: tuple[bytes, bytes], picture: Any = RGB) -> None:
    """Write a PNG with further chunks behind its header."""
    made = io.BytesIO()
    Image.fromarray(picture).save(made, "PNG")
    raw = made.getvalue()
    path.write_bytes(raw[:33] + b"".join(chunk(*one) for one in chunks) + raw[33:])


def tiff(path: Path, tags: dict[int, Any] | None = None, picture: Any = RGB, **how: Any) -> None:
    """Write a TIFF with further tags."""
    entries = ImageFileDirectory_v2()
    for number, value in (tags or {}).items():
        entries[number] = value
    shown = picture if isinstance(picture, Image.Image) else Image.fromarray(picture)
    shown.save(path, "TIFF", tiffinfo=entries, **how)


def raw_tiff(path: Path, bits: int, kind: int, data: bytes, size: tuple[int, int]) -> None:
    """Write a TIFF of one channel byte by byte; `size` is width and height."""
    tags = {256: size[0], 257: size[1], 258: bits, 259: 1, 262: 1, 273: 8, 277: 1, 278: size[1],
            279: len(data), 339: kind}  # fmt: skip
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags.items())
    head = b"II*\0" + struct.pack("<I", 8 + len(data))
    path.write_bytes(head + data + struct.pack("<H", len(tags)) + entries + bytes(4))


def retagged(path: Path, changes: dict[int, int]) -> None:
    """Change short tags of a TIFF in place."""
    raw = bytearray(path.read_bytes())
    start = struct.unpack_from("<I", raw, 4)[0]
    for entry in range(struct.unpack_from("<H", raw, start)[0]):
        place = start + 2 + 12 * entry
        tag = struct.unpack_from("<H", raw, place)[0]
        if tag in changes:
            struct.pack_into("<H", raw, place + 8, changes[tag])
    path.write_bytes(raw)


def jpeg(path: Path, *segments: tuple[int, bytes], exif: dict[int, int] | None = None) -> None:
    """Write a JPEG with further segments of applications behind its beginning."""
    made, tags = io.BytesIO(), Image.Exif()
    for number, value in (exif or {}).items():
        if number == 40961:
            tags.get_ifd(0x8769)[number] = value
        else:
            tags[number] = value
    Image.fromarray(RGB).save(made, "JPEG", exif=tags)
    raw = made.getvalue()
    added = b"".join(
        struct.pack(">BBH", 0xFF, 0xE0 + number, 2 + len(data)) + data for number, data in segments
    )
    path.write_bytes(raw[:2] + added + raw[2:])


def exr(path: Path, *attributes: tuple[str, str, bytes], **spec: Any) -> None:
    """Write linear R, G, B with further attributes: name, type and bytes of each."""
    write_exr(path, {name: LIGHT[..., k] for k, name in enumerate("RGB")}, **spec)
    raw = path.read_bytes()
    added = b"".join(
        f"{name}\0{kind}\0".encode() + struct.pack("<i", len(value)) + value
        for name, kind, value in attributes
    )
    end = _end_of_exr_header(raw)
    blocks = (struct.unpack_from("<Q", raw, end)[0] - end) // 8
    offsets = struct.unpack_from(f"<{blocks}Q", raw, end)
    moved = struct.pack(f"<{blocks}Q", *(offset + len(added) for offset in offsets))
    path.write_bytes(raw[:8] + added + raw[8:end] + moved + raw[end + 8 * blocks :])


def _end_of_exr_header(raw: bytes) -> int:
    place = 8
    while raw[place]:
        for _ in range(2):
            place = raw.index(b"\0", place) + 1
        place += 4 + struct.unpack_from("<i", raw, place)[0]
    return place + 1


def write_exr(
    path: Path,
    planes: dict[str, Any],
    *,
    window: tuple[int, int, int, int] | None = None,
    data_at: tuple[int, int] = (0, 0),
    kind: str = "float",
    **attributes: Any,
) -> None:
    """Write planes; `window` is the display window, x, y, width and height."""
    height, width = next(iter(planes.values())).shape
    spec = oiio.ImageSpec(width, height, len(planes), kind)
    spec.channelnames = tuple(planes)
    spec.x, spec.y = data_at
    if window is not None:
        spec.full_x, spec.full_y, spec.full_width, spec.full_height = window
    for name, value in attributes.items():
        spec.attribute(name, value)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec), out.geterror()
    stored = np.stack(list(planes.values()), -1)
    assert out.write_image(np.ascontiguousarray(stored)), out.geterror()
    out.close()


def write_parts(path: Path, parts: dict[str, dict[str, Any]]) -> None:
    """Write parts by name, each with its planes."""
    specs = []
    for label, planes in parts.items():
        height, width = next(iter(planes.values())).shape
        spec = oiio.ImageSpec(width, height, len(planes), "float")
        spec.channelnames = tuple(planes)
        spec.attribute("oiio:subimagename", label)
        specs.append(spec)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), tuple(specs))
    for number, planes in enumerate(parts.values()):
        if number:
            assert out.open(str(path), specs[number], "AppendSubimage")
        stored = np.stack(list(planes.values()), -1).astype(np.float32)
        assert out.write_image(np.ascontiguousarray(stored))
    out.close()


def deep_exr(path: Path) -> None:
    """Write a deep file without samples."""
    spec = oiio.ImageSpec(8, 6, 3, "float")
    spec.channelnames, spec.deep = ("R", "G", "B"), True
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec)
    samples = oiio.DeepData()
    samples.init(spec)
    assert out.write_deep_image(samples)
    out.close()


def hdr(path: Path, *lines: str, size: str = "-Y 6 +X 8", kind: str = "32-bit_rle_rgbe") -> None:
    """Write a Radiance picture without compression, every pixel half of white."""
    head = "\n".join(["#?RADIANCE", *lines, f"FORMAT={kind}", "", size, ""])
    path.write_bytes(head.encode() + bytes([128, 128, 128, 128]) * 48)


def webp(path: Path, *chunks: tuple[bytes, bytes]) -> None:
    """Write a WebP with further chunks at its end."""
    made = io.BytesIO()
    Image.fromarray(RGB).save(made, "WEBP", lossless=True)
    body = made.getvalue()[8:]
    for name, data in chunks:
        body += name + struct.pack("<I", len(data)) + data + bytes(len(data) % 2)
    path.write_bytes(b"RIFF" + struct.pack("<I", len(body)) + body)


def bmp(path: Path, *, space: bytes = b"sRGB", per_metre: tuple[int, int] = (2835, 2835)) -> None:
    """Write a BMP with a header of version 5."""
    rows = b"".join(row[::-1].tobytes() for row in RGB[::-1])  # blue first, from the bottom
    head = struct.pack(
        "<IiiHHIIiiII", 124, 8, 6, 1, 24, 0, len(rows), *per_metre, 0, 0
    ) + struct.pack("<4I4s", 0, 0, 0, 0, space[::-1])
    head = head.ljust(124, b"\0")
    path.write_bytes(struct.pack("<2sIHHI", b"BM", 138 + len(rows), 0, 0, 138) + head + rows)


def gif(path: Path, aspect: int = 0, frames: int = 1) -> None:
    """Write a GIF that says its aspect: (aspect + 15) / 64."""
    made = io.BytesIO()
    first, *rest = [Image.fromarray(RGB[..., 0] + number) for number in range(frames)]
    first.save(made, "GIF", save_all=frames > 1, append_images=rest)
    raw = bytearray(made.getvalue())
    raw[12] = aspect
    path.write_bytes(raw)


def profile(gamma: float | None = None, *, adobe: bool = False) -> bytes:
    """A colour profile: sRGB's own, or one of sRGB's or Adobe RGB's primaries with a gamma."""
    if gamma is None:
        return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()

    def fixed(numbers: Any) -> bytes:
        return b"".join(struct.pack(">i", round(65536 * number)) for number in numbers)

    white = (0.9642, 1.0, 0.8249)
    curve = b"curv\0\0\0\0" + struct.pack(">IH", 1, round(256 * gamma)) + b"\0\0"
    text = b"desc\0\0\0\0" + struct.pack(">I", 5) + b"odd1\0" + bytes(78)
    columns = _ADOBE_XYZ if adobe else _SRGB_XYZ
    tags = [(b"desc", text), (b"wtpt", b"XYZ \0\0\0\0" + fixed(white))]
    tags += [
        (name + b"XYZ", b"XYZ \0\0\0\0" + fixed(column))
        for name, column in zip((b"r", b"g", b"b"), columns, strict=True)
    ]
    tags += [(name + b"TRC", curve) for name in (b"r", b"g", b"b")]
    tags.append((b"cprt", b"text\0\0\0\0none\0"))
    start, index, body = 132 + 12 * len(tags), b"", b""
    for name, data in tags:
        index += name + struct.pack(">II", start + len(body), len(data))
        body += data + bytes(-len(data) % 4)
    whole = struct.pack(">I", len(tags)) + index + body
    head = struct.pack(
        ">I4sI4s4s4s", 128 + len(whole), b"lcms", 0x02100000, b"mntr", b"RGB ", b"XYZ "
    )
    head = (head + bytes(12) + b"acsp").ljust(68, b"\0") + fixed(white)
    return head.ljust(128, b"\0") + whole


def icc_chunk(data: bytes) -> tuple[bytes, bytes]:
    """A profile as a chunk of PNG."""
    return b"iCCP", b"odd\0\0" + zlib.compress(data)
