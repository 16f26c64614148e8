"""Every statement of a picture's header is honoured, refused or noted; its default is silent."""

import io
import re
import struct
import warnings
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import odd_pictures as odd
import OpenImageIO as oiio  # noqa: N813
import pytest
from number_files import load_plane
from PIL import Image, ImageCms, ImageOps

from pipeline.errors import FileNote, InputError
from pipeline.methods.frames import FramesOnDisk
from pipeline.pictures.colour_file import load_colour, read_any
from pipeline.pictures.decode import read_parts, read_pixels, three_channels
from pipeline.pictures.stored_frames import read_picture
from pipeline.statements.row import Row, table
from pipeline.statements.rows import ROWS

REC709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
ACES = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
P3_CHROMATICITIES = struct.pack(">8I", 31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000)
SRGB_CHROMATICITIES = struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)
GDAL = '<GDALMetadata><Item name="S" sample="0" role="scale">{}</Item></GDALMetadata>'
SHORTS = [round(65535 * (k / 255) ** 2.2) for k in range(256)]
Make = Callable[[Path], Any]


def png(name: bytes, data: bytes, **more: Any) -> Make:
    return lambda path: odd.png(path, (name, data), **more)


def tiff(tags: dict[int, Any], **more: Any) -> Make:
    return lambda path: odd.tiff(path, tags, **more)


def exr(name: str, kind: str, value: bytes) -> Make:
    return lambda path: odd.exr(path, (name, kind, value))


SRGB_PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def grey_8(path: Path) -> None:
    odd.png(path, picture=odd.RGB[..., 0])


def grey_png(path: Path) -> None:
    odd.png(path, picture=odd.GREY)


def palette(grey: bool) -> Make:
    def make(path: Path) -> None:
        picture = Image.fromarray(odd.RGB[..., 0])
        picture.putpalette([k if grey or part == 0 else 0 for k in range(256) for part in range(3)])
        picture.save(path)

    return make


def retagged(changes: dict[int, int], picture: Any = odd.RGB) -> Make:
    def make(path: Path) -> None:
        odd.tiff(path, {}, picture)
        odd.retagged(path, changes)

    return make


def paged(pages: int) -> Make:
    def make(path: Path) -> None:
        shown = Image.fromarray(odd.RGB)
        shown.save(path, "TIFF", save_all=True, append_images=[shown] * (pages - 1))

    return make


def exif(orientation: int) -> bytes:
    return b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0%c\0\0\0\0\0\0\0" % orientation


def late(name: bytes, data: bytes) -> Make:
    """A chunk behind the pixels of a PNG."""

    def make(path: Path) -> None:
        odd.png(path)
        raw = path.read_bytes()
        path.write_bytes(raw[:-12] + odd.chunk(name, data) + raw[-12:])

    return make


def xmp(said: str) -> bytes:
    return f"<rdf:Description {said}/>".encode()


def xmp_of_png(said: str) -> Make:
    return png(b"iTXt", b"XML:com.adobe.xmp\0\0\0\0\0" + xmp(said))


def xmp_of_jpeg(said: str) -> Make:
    return lambda path: odd.jpeg(path, (1, b"http://ns.adobe.com/xap/1.0/\0" + xmp(said)))


def moving_png(frames: int) -> Make:
    return png(b"acTL", struct.pack(">II", frames, 0))


def floats(values: Any) -> bytes:
    return struct.pack(f"<{len(values)}f", *values)


# What each row is about: a file that says it, one beside it that says the default, what reads it.
C, N = load_colour, load_plane
SAMPLES: list[tuple[str, str, str, Make, Make, Callable[[Path], Any]]] = [
    ("any", "Orientation", "p.jpg", lambda p: odd.jpeg(p, exif={274: 6}),
     lambda p: odd.jpeg(p, exif={274: 1}), C),
    ("any", "Orientation", "p.tif", tiff({274: 8}), tiff({274: 1}), C),
    ("any", "Orientation", "p.png",
     png(b"eXIf", b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x03\0\0\0\0\0\0\0"),
     png(b"eXIf", b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x01\0\0\0\0\0\0\0"), C),
    ("any", "PixelAspectRatio", "p.png", png(b"pHYs", struct.pack(">IIB", 2000, 1000, 1)),
     png(b"pHYs", struct.pack(">IIB", 2000, 2000, 1)), C),
    ("any", "PixelAspectRatio", "d.png",
     png(b"pHYs", struct.pack(">IIB", 2, 1, 0), picture=odd.GREY), grey_png, N),
    ("any", "PixelAspectRatio", "p.tif", tiff({282: 72.0, 283: 36.0, 296: 2}),
     tiff({282: 72.0, 283: 72.0, 296: 2}), C),
    ("any", "PixelAspectRatio", "p.exr", lambda p: odd.exr(p, PixelAspectRatio=2.0), odd.exr, C),
    ("any", "ICCProfile greys", "p.png", lambda p: odd.png(p, odd.icc_chunk(odd.profile(1.0))),
     lambda p: odd.png(p, odd.icc_chunk(odd.profile())), C),
    ("any", "ICCProfile greys", "p.tif",
     lambda p: odd.tiff(p, icc_profile=odd.profile(1.0)),
     lambda p: odd.tiff(p, icc_profile=odd.profile()), C),
    ("any", "ICCProfile", "p.png",
     lambda p: odd.png(p, odd.icc_chunk(odd.profile(2.2, adobe=True))),
     lambda p: odd.png(p, odd.icc_chunk(odd.profile())), C),
    ("any", "several pictures", "p.tif", paged(2), paged(1), C),
    ("any", "several pictures", "p.gif", lambda p: odd.gif(p, frames=2), odd.gif, C),
    ("any", "several pictures", "p.png", moving_png(3), moving_png(1), C),
    ("any", "deep pixels", "p.exr", odd.deep_exr, odd.exr, C),
    ("any", "deep pixels", "p.exr", odd.deep_exr, odd.exr, read_parts),
    ("any", "small data window", "p.exr",
     lambda p: odd.exr(p, window=(0, 0, 12, 9), data_at=(2, 1)), odd.exr, C),
    ("any", "small data window", "p.exr",
     lambda p: odd.exr(p, window=(0, 0, 8, 6), data_at=(2, 1)), odd.exr, read_parts),
    ("any", "large data window", "p.exr",
     lambda p: odd.exr(p, window=(0, 0, 4, 3), data_at=(-2, -1)),
     lambda p: odd.exr(p, window=(5, 5, 8, 6), data_at=(5, 5)), C),
    ("any", "Exif:ColorSpace", "p.jpg", lambda p: odd.jpeg(p, exif={40961: 65535}),
     lambda p: odd.jpeg(p, exif={40961: 1}), C),
    ("any", "XMP", "p.png", xmp_of_png('tiff:Orientation="6"'), xmp_of_png('tiff:Orientation="1"'),
     C),
    ("any", "XMP", "p.jpg", xmp_of_jpeg('GPano:ProjectionType="equirectangular"'),
     xmp_of_jpeg("GPano:Other='1'"), C),
    ("any", "XMP", "p.tif", tiff({700: xmp("tiff:Orientation='8'")}), tiff({700: xmp("")}), C),
    ("any", "XMP", "p.webp", lambda p: odd.webp(p, (b"XMP ", xmp('tiff:Orientation="3"'))),
     lambda p: odd.webp(p, (b"XMP ", xmp(""))), C),
    ("png", "late eXIf", "p.png", late(b"eXIf", exif(6)), late(b"eXIf", exif(1)), C),
    ("png", "PLTE", "d.png", palette(grey=False), palette(grey=True), N),
    ("png", "gAMA", "p.png", png(b"gAMA", struct.pack(">I", 100_000)),
     png(b"gAMA", struct.pack(">I", 45455)), C),
    ("png", "gAMA", "p.png", png(b"gAMA", struct.pack(">I", 55556)),
     lambda p: odd.png(p, (b"gAMA", struct.pack(">I", 55556)), (b"sRGB", b"\0")), C),
    ("png", "cHRM", "p.png", png(b"cHRM", P3_CHROMATICITIES), png(b"cHRM", SRGB_CHROMATICITIES), C),
    ("png", "cICP", "p.png", png(b"cICP", bytes([9, 16, 0, 1])), png(b"cICP", bytes([1, 13, 0, 1])),
     C),
    ("png", "cICP|gAMA", "p.png", png(b"gAMA", struct.pack(">I", 50994)),
     png(b"gAMA", struct.pack(">I", 45455)), C),
    ("png", "cICP|gAMA", "p.png", png(b"cICP", bytes([1, 1, 0, 1])),
     png(b"cICP", bytes([1, 13, 0, 1])), C),
    ("png", "iCCP", "p.png", png(b"iCCP", b"x\0\0" + zlib.compress(bytes(300))),
     png(b"iCCP", b"x\0\0" + zlib.compress(SRGB_PROFILE)), C),
    ("png", "iCCP", "p.png", png(b"iCCP", b"x\0\0" + zlib.compress(SRGB_PROFILE),
     picture=odd.RGB[..., 0]), grey_8, C),
    ("png", "mDCV|mDCv|cLLI|cLLi", "p.png", png(b"cLLI", bytes(8)), odd.png, C),
    ("png", "oFFs", "p.png", png(b"oFFs", struct.pack(">iiB", 5, 7, 0)),
     png(b"oFFs", struct.pack(">iiB", 0, 0, 0)), C),
    ("png", "pCAL", "d.png", png(b"pCAL", b"to metres\0" + bytes(12), picture=odd.GREY),
     grey_png, N),
    ("png", "sTER", "p.png", png(b"sTER", b"\0"), odd.png, C),
    ("png", "sCAL", "p.png", png(b"sCAL", b"\x011\x002"), odd.png, C),
    ("jpeg", "APP2 MPF", "p.jpg", lambda p: odd.jpeg(p, (2, b"MPF\0II*\0")), odd.jpeg, C),
    ("tiff", "tag 254", "p.tif", tiff({254: 1}), tiff({254: 2}), C),
    ("tiff", "tag 254", "d.tif", tiff({254: 4}, picture=odd.GREY), tiff({254: 0}, picture=odd.GREY),
     N),
    ("tiff", "tag 255", "p.tif", tiff({255: 2}), tiff({255: 1}), C),
    ("tiff", "tag 280|tag 281|tag 340|tag 341", "p.tif", tiff({281: (100, 100, 100)}),
     tiff({281: (255, 255, 255), 280: (0, 0, 0)}), C),
    ("tiff", "tag 262", "p.tif",
     lambda p: odd.tiff(p, picture=Image.fromarray(odd.RGB).convert("LAB")), odd.tiff, C),
    ("tiff", "tag 262", "p.tif", retagged({262: 0}, odd.GREY),
     retagged({262: 0}, odd.RGB[..., 0]), C),
    ("tiff", "tag 262", "p.tif", retagged({262: 0}, odd.LIGHT[..., 0]),
     tiff({}, picture=odd.GREY), C),
    ("tiff", "tag 262", "d.tif", retagged({262: 0}, odd.GREY), tiff({}, picture=odd.GREY), N),
    ("tiff", "tag 262", "d.tif", palette(grey=False), palette(grey=True), N),
    ("tiff", "tag 258", "d.tif", lambda p: odd.raw_tiff(p, 24, 1, bytes(27), (3, 3)),
     lambda p: odd.raw_tiff(p, 32, 1, bytes(36), (3, 3)), N),
    ("tiff", "tag 318", "p.tif", tiff({318: (0.3457, 0.3585)}), tiff({318: (0.3127, 0.329)}), C),
    ("tiff", "tag 319", "p.tif", tiff({319: (0.68, 0.32, 0.265, 0.69, 0.15, 0.06)}),
     tiff({319: REC709[:6]}), C),
    ("tiff", "tag 301", "p.tif", tiff({301: tuple(257 * k for k in range(256))}),
     tiff({301: tuple(SHORTS)}), C),
    ("tiff", "tag 290|tag 291", "p.tif", tiff({290: 2}), odd.tiff, C),
    ("tiff", "tag 532", "p.tif", tiff({532: (16, 235) * 3}), tiff({532: (0, 255) * 3}), C),
    ("tiff", "tag 42112", "d.tif", tiff({42112: GDAL.format(0.01)}, picture=odd.GREY),
     tiff({42112: GDAL.format(1)}, picture=odd.GREY), N),
    ("tiff", "tag 50706", "p.tif", tiff({50706: b"\1\4\0\0"}), odd.tiff, C),
    ("openexr", "chromaticities", "p.exr", exr("chromaticities", "chromaticities", floats(ACES)),
     exr("chromaticities", "chromaticities", floats(REC709)), C),
    ("openexr", "chromaticities", "p.exr", exr("chromaticities", "chromaticities", floats(ACES)),
     exr("chromaticities", "chromaticities", floats(REC709)), read_parts),
    ("openexr", "oiio:ColorSpace|colorInteropID|colorSpace", "p.exr",
     exr("oiio:ColorSpace", "string", b"ACEScg"), exr("oiio:ColorSpace", "string", b"lin_rec709"),
     C),
    ("openexr", "acesImageContainerFlag", "p.exr",
     exr("acesImageContainerFlag", "int", struct.pack("<i", 1)),
     exr("acesImageContainerFlag", "int", struct.pack("<i", 0)), C),
    ("openexr", "whiteLuminance|adoptedNeutral|lookModTransform|renderingTransform", "p.exr",
     exr("whiteLuminance", "float", floats([100.0])), odd.exr, C),
    ("openexr", "multiView", "p.exr",
     exr("multiView", "stringvector", b"\4\0\0\0left\5\0\0\0right"),
     exr("multiView", "stringvector", b"\4\0\0\0left"), C),
    ("openexr", "envmap", "p.exr", exr("envmap", "envmap", b"\0"), odd.exr, C),
    ("openexr", "compression", "d.exr",
     lambda p: odd.write_exr(p, {"Z": odd.LIGHT[..., 0]}, compression="b44"),
     lambda p: odd.write_exr(p, {"Z": odd.LIGHT[..., 0]}, compression="piz"), N),
    ("hdr", "FORMAT", "p.hdr", lambda p: odd.hdr(p, kind="32-bit_rle_xyze"), odd.hdr, C),
    ("hdr", "EXPOSURE|COLORCORR", "p.hdr", lambda p: odd.hdr(p, "EXPOSURE=2.5"),
     lambda p: odd.hdr(p, "EXPOSURE=1"), C),
    ("hdr", "GAMMA", "p.hdr", lambda p: odd.hdr(p, "GAMMA=2.2"), lambda p: odd.hdr(p, "GAMMA=1"),
     C),
    ("hdr", "PRIMARIES", "p.hdr", lambda p: odd.hdr(p, "PRIMARIES=.7 .3 .2 .7 .1 .05 .3127 .329"),
     lambda p: odd.hdr(p, "PRIMARIES=.64 .33 .29 .6 .15 .06 .333 .333"), C),
    ("hdr", "PIXASPECT", "p.hdr", lambda p: odd.hdr(p, "PIXASPECT=2"),
     lambda p: odd.hdr(p, "PIXASPECT=1.0"), C),
    ("hdr", "size", "p.hdr", lambda p: odd.hdr(p, size="+Y 6 +X 8"), odd.hdr, C),
    ("bmp", "bV4CSType", "p.bmp", lambda p: odd.bmp(p, space=b"MBED"), odd.bmp, C),
    ("bmp", "pixels per metre", "p.bmp", lambda p: odd.bmp(p, per_metre=(2000, 1000)), odd.bmp, C),
    ("gif", "pixel aspect", "p.gif", lambda p: odd.gif(p, aspect=113), lambda p: odd.gif(p, 49), C),
]  # fmt: skip
# OpenImageIO opens no complex numbers, and no format that says these and can be written here.
UNREADABLE = {("tiff", "tag 339"), ("any", "CICP"), ("any", "colour space")}


def row_of(kind: str, names: str, reader: Callable[[Path], Any]) -> Row:
    use = "numbers" if reader is load_plane else "colour"
    return next(
        row
        for row in ROWS
        if (row.of, row.names) == (kind, names)
        and use in row.use
        and row.verdict in ("refused", "noted")
    )


def notes_of(read: Callable[[Path], Any], path: Path) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read(path)
    assert all(issubclass(one.category, FileNote) for one in caught)
    return [str(one.message) for one in caught]


@pytest.mark.parametrize(
    ("kind", "names", "file", "odd_one", "control", "read"),
    SAMPLES,
    ids=[f"{kind}-{names}-{file}-{k}" for k, (kind, names, file, *_) in enumerate(SAMPLES)],
)
def test_a_statement_is_treated_as_the_table_says_and_its_default_is_silent(
    tmp_path, kind, names, file, odd_one, control, read
):
    good, bad = tmp_path / f"good-{file}", tmp_path / file
    control(good)
    odd_one(bad)
    row = row_of(kind, names, read)

    assert notes_of(read, good) == []
    if row.verdict == "refused":
        with pytest.raises(InputError, match=rf"{re.escape(file)}: must "):
            read(bad)
    else:
        (note,) = notes_of(read, bad)
        assert note.startswith(f"{bad}: ")


def test_every_row_that_refuses_or_notes_has_a_sample():
    pictures = [row for row in ROWS if not row.of.startswith("video")]
    wanted = {(row.of, row.names) for row in pictures if row.verdict in ("refused", "noted")}

    assert wanted - UNREADABLE == {(kind, names) for kind, names, *_ in SAMPLES}


@pytest.mark.parametrize(
    "make", [late(b"eXIf", b"what?"), png(b"gAMA", b"?"), png(b"cHRM", bytes(7)), png(b"oFFs", b"")]
)
def test_what_is_not_understood_is_noted_once(tmp_path, make):
    make(tmp_path / "p.png")
    (note,) = notes_of(load_colour, tmp_path / "p.png")
    assert "is not understood, and left out" in note


def test_a_picture_beside_its_animation_is_counted(tmp_path):
    """Programs that know animations show one frame; others, the picture that is none of it."""
    frame = (b"fcTL", struct.pack(">5I2H2B", 0, 8, 6, 0, 0, 1, 10, 0, 0))
    odd.png(tmp_path / "a.png", (b"acTL", struct.pack(">II", 1, 0)), frame)
    assert load_colour(tmp_path / "a.png").shape == (6, 8, 3)
    odd.png(tmp_path / "b.png", (b"acTL", struct.pack(">II", 1, 0)))
    raw = (tmp_path / "b.png").read_bytes()
    (tmp_path / "b.png").write_bytes(raw[:-12] + odd.chunk(*frame) + raw[-12:])
    with pytest.raises(InputError, match=r"must hold one picture \(it holds several, 2\)"):
        load_colour(tmp_path / "b.png")


@pytest.mark.parametrize("picture", [odd.RGB, odd.RGB[..., 0]])
def test_a_profile_that_is_left_out_hides_nothing(tmp_path, picture):
    """Zeros are no profile, and one of RGB says nothing of a grey picture."""
    profile = bytes(300) if picture.ndim == 3 else SRGB_PROFILE
    path, packed = tmp_path / "p.png", (b"iCCP", b"x\0\0" + zlib.compress(profile))
    for chunk in ((b"gAMA", struct.pack(">I", 100_000)), (b"cHRM", P3_CHROMATICITIES)):
        odd.png(path, packed, chunk, picture=picture)
        with pytest.raises(InputError, match="must "):
            load_colour(path)

    odd.png(path, (b"iCCP", b"x\0\0" + zlib.compress(SRGB_PROFILE)), chunk)
    assert notes_of(load_colour, path) == []


@pytest.mark.parametrize(
    ("says", "refused"),
    [({}, False), ({"CICP": (1, 13, 0, 1)}, False), ({"CICP": (9, 16, 0, 1)}, True),
     ({"oiio:ColorSpace": "srgb_rec709_scene"}, False), ({"oiio:ColorSpace": "KodakLog"}, True)],
)  # fmt: skip
def test_what_openimageio_says_of_other_formats_counts(tmp_path, says, refused):
    Image.fromarray(odd.RGB).save(tmp_path / "p.tga")
    pixels = replace(read_pixels(tmp_path / "p.tga"), attributes=says)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FileNote)
        if not refused:
            three_channels(tmp_path / "p.tga", pixels)
            return
        with pytest.raises(InputError, match="must hold sRGB colour"):
            three_channels(tmp_path / "p.tga", pixels)


@pytest.mark.parametrize(
    ("file", "make", "said"),
    [
        ("p.png", png(b"inVe", b"what?"), "inVe"),
        ("p.jpg", lambda p: odd.jpeg(p, (7, b"INVENTED\0")), "APP7 INVENTED"),
        ("p.tif", tiff({65000: "what?"}), "tag 65000"),
        ("p.exr", exr("invented", "string", b"what?"), "invented"),
        ("p.exr", exr("invented", "unheard", b"what?"), "invented"),
        ("p.hdr", lambda p: odd.hdr(p, "INVENTED=1"), "INVENTED"),
        ("p.webp", lambda p: odd.webp(p, (b"INVE", b"what")), "INVE"),
        ("p.tga", lambda p: Image.fromarray(odd.RGB).save(p), "files of targa say"),
    ],
)
def test_what_is_on_no_list_is_noted_by_every_reader(tmp_path, file, make, said):
    path = tmp_path / file
    make(path)
    readers = [load_colour, read_any]
    readers += [read_parts] if path.suffix == ".exr" else []
    readers += [] if path.suffix in (".exr", ".hdr") else [read_picture]

    for read in readers:
        (note,) = notes_of(read, path)
        assert note.startswith(f"{path}: ")
        assert said in note


def test_every_reader_of_pictures_refuses_alike(tmp_path):
    path = tmp_path / "000000.png"
    odd.png(path, (b"gAMA", struct.pack(">I", 100_000)))

    for read in (load_colour, read_any, read_picture):
        with pytest.raises(InputError, match="gAMA chunk says linear light"):
            read(path)
    from pipeline.frame import WarpedFrame

    empty = np.zeros((6, 8), np.float32)
    warped = WarpedFrame(
        np.zeros((6, 8, 3), np.float32), empty + 1, empty > 0, np.zeros((6, 8, 2), np.float32)
    )
    with pytest.raises(InputError, match="gAMA chunk says linear light"):
        FramesOnDisk(tmp_path).fill(warped, 0)


def test_light_converted_as_the_message_says_is_read_as_the_picture_it_was(tmp_path):
    """The cure: convert it to sRGB, and save it as that."""
    wanted = np.repeat(np.arange(0, 256, 5, dtype=np.uint8)[None, :, None], 3, axis=-1)
    light = np.where(wanted <= 10, wanted / 255 / 12.92, ((wanted / 255 + 0.055) / 1.055) ** 2.4)
    odd.png(
        tmp_path / "a.png",
        (b"gAMA", struct.pack(">I", 100_000)),
        picture=np.rint(255 * light).astype(np.uint8),
    )
    with pytest.raises(InputError, match="convert it to sRGB, and save it as that"):
        load_colour(tmp_path / "a.png")
    stored = np.asarray(Image.open(tmp_path / "a.png")) / 255
    encoded = np.where(stored <= 0.0031308, 12.92 * stored, 1.055 * stored ** (1 / 2.4) - 0.055)
    Image.fromarray(np.rint(255 * encoded).astype(np.uint8)).save(tmp_path / "b.png")

    found = load_colour(tmp_path / "b.png")

    bright = wanted[0, :, 0] > 60  # darker light of 8 bits has too few steps
    assert np.abs(255 * found - wanted)[:, bright].max() <= 4


def upright(bad: Path, good: Path) -> None:
    ImageOps.exif_transpose(Image.open(bad)).save(good)


def square(bad: Path, good: Path) -> None:
    shown = Image.open(bad)
    shown.resize((2 * shown.width, shown.height)).save(good)


def converted(bad: Path, good: Path) -> None:
    shown = Image.open(bad)
    own = ImageCms.ImageCmsProfile(io.BytesIO(shown.info["icc_profile"]))
    plain = ImageCms.profileToProfile(shown, own, ImageCms.createProfile("sRGB"))
    plain.save(good, icc_profile=odd.profile())


def first_alone(bad: Path, good: Path) -> None:
    with Image.open(bad) as shown:
        shown.convert("RGB").save(good)


def whole(bad: Path, good: Path) -> None:
    stored = read_exr(bad)
    padded = np.pad(stored, ((1, 2), (2, 2), (0, 0)))
    odd.write_exr(good, {name: padded[..., k] for k, name in enumerate("RGB")})


def read_exr(path: Path) -> Any:
    source = oiio.ImageInput.open(str(path))
    return source.read_image("float")


def rec709(bad: Path, good: Path) -> None:
    """ACES AP0 to Rec.709, by the two sets of primaries; white is moved in XYZ, roughly."""
    matrices = []
    for numbers in (ACES, REC709):
        x, y = np.array(numbers[:6:2]), np.array(numbers[1:6:2])
        columns = np.stack([x / y, np.ones(3), (1 - x - y) / y])
        white = np.array([numbers[6] / numbers[7], 1, (1 - sum(numbers[6:])) / numbers[7]])
        matrices.append(columns * np.linalg.solve(columns, white))
    change = np.linalg.solve(matrices[1], matrices[0])
    light = (read_exr(bad) @ change.T).clip(0, 1).astype(np.float32)
    odd.write_exr(good, {name: light[..., k] for k, name in enumerate("RGB")})


@pytest.mark.parametrize(
    ("file", "make", "advice", "cure", "size"),
    [
        ("p.jpg", lambda p: odd.jpeg(p, exif={274: 6}), "turn it and save it again", upright,
         (8, 6)),
        ("p.png", png(b"pHYs", struct.pack(">IIB", 1000, 2000, 1)), "resample it to square ones",
         square, (6, 16)),
        ("p.png", lambda p: odd.png(p, odd.icc_chunk(odd.profile(1.0))), "convert it to sRGB",
         converted, (6, 8)),
        ("p.tif", paged(3), "save the one that is meant", first_alone, (6, 8)),
        ("p.gif", lambda p: odd.gif(p, frames=2), "save the one that is meant", first_alone,
         (6, 8)),
        ("p.exr", lambda p: odd.exr(p, window=(0, 0, 12, 9), data_at=(2, 1)),
         "render or save it whole", whole, (9, 12)),
        ("p.exr", exr("chromaticities", "chromaticities", floats(ACES)),
         "convert it to Rec.709 primaries", rec709, (6, 8)),
    ],
)  # fmt: skip
def test_what_a_message_advises_works_on_the_file_that_caused_it(
    tmp_path, file, make, advice, cure, size
):
    make(tmp_path / file)
    with pytest.raises(InputError, match=re.escape(advice)):
        load_colour(tmp_path / file)

    cure(tmp_path / file, tmp_path / f"good-{file}")

    assert load_colour(tmp_path / f"good-{file}").shape == (*size, 3)


def test_overscan_is_cut_to_the_display_window(tmp_path):
    odd.exr(tmp_path / "a.exr", window=(0, 0, 4, 3), data_at=(-2, -1))
    odd.exr(tmp_path / "whole.exr")

    with pytest.warns(FileNote, match="cropped from 8 x 6 px to its display window, 4 x 3 px"):
        found = read_pixels(tmp_path / "a.exr").data

    np.testing.assert_array_equal(found, read_pixels(tmp_path / "whole.exr").data[1:4, 2:6])
    with pytest.warns(FileNote, match="cropped"):
        planes = read_parts(tmp_path / "a.exr").planes
    np.testing.assert_array_equal(planes["R"], found[..., 0])


def test_encoded_floats_that_say_so_are_read_once_that_is_told(tmp_path):
    from pipeline.pictures.colour_file import Transfer

    odd.exr(tmp_path / "a.exr", ("oiio:ColorSpace", "string", b"sRGB"))
    with pytest.raises(InputError, match="--encoded of warp and foveate"):
        load_colour(tmp_path / "a.exr")

    found = load_colour(tmp_path / "a.exr", transfer=Transfer.ENCODED)

    np.testing.assert_array_equal(found, odd.LIGHT)


def test_the_page_of_pictures_and_videos_has_the_table(repository):
    assert table(ROWS) in (repository / "docs/formats/headers.md").read_text(encoding="utf-8")
