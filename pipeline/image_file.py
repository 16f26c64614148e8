"""Pixels to and from files, through OpenImageIO; what they mean is for `stimuli.exr` to say.

AVIF goes through Pillow; HEIC is named, which neither it nor OpenImageIO reads.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import OpenImageIO as oiio  # noqa: N813  its own documentation calls it so
from numpy.typing import NDArray
from PIL import Image, features

from pipeline.errors import InputError, note
from pipeline.image_header import WALKERS, read_statements
from pipeline.netpbm import read_netpbm
from pipeline.picture_limits import check_need, check_values
from pipeline.statements.check_statements import check_statements, refusal
from pipeline.statements.row import Use
from protocols.disk.whole_file import whole_path
from protocols.outside import reading, visible_line

_NATIVE = ("uint8", "uint16", "int8", "int16", "int", "uint", "double")
"""Types that OpenImageIO hands out as stored when asked for them; asked for another, it stretches
integers to shares of the largest one."""
# OpenEXR files carry the time of writing, unless told one: same pixels, same bytes.
_NO_TIME = "1970:01:01 00:00:00"
_WINDOWED = ("openexr", "rla")
_LAYERED = ("openexr", "psd")  # further pictures are parts of the first, or layers
_EXACT = ("png", "tiff", "openexr", "pnm", "bmp")
_LOSSY = ("jpeg", "jpeg2000", "jpegxl", "webp", "heif", "avif")
_NEEDS_ROOM = ("jpeg", "webp")
"""Formats whose libraries end the process, or never return, when the disk is full."""
_HEAD = 2**16  # bytes that hold all of such a file but its pixels
_ORIENTATION = 274  # its number in Exif
_UPRIGHT = 1  # of Exif's orientations
_FIRST_ON_ITS_SIDE = 5  # of the eight orientations of Exif
_PNG_BITS = 24  # where its header has the bits of a number, and then the kind of colour
_PNG_PALETTE = 3
_ENDS = {".png": b"IEND\xaeB`\x82", ".tga": b"TRUEVISION-XFILE.\0"}


@dataclass(frozen=True)
class StoredPixels:
    """The content of an image file, as stored.

    Parameters
    ----------
    data : ndarray, shape (H, W, C)
        Integers and double as stored; half and float as float32.
    channels : tuple of str
        C names, such as ``R``, ``Z`` or ``flow.x``.
    attributes : mapping
        The file's header, as OpenImageIO gives it.
    kind : str
        OpenImageIO's name of the format.
    """

    data: NDArray[Any]
    channels: tuple[str, ...]
    attributes: Mapping[str, Any] = field(default_factory=dict)
    kind: str = ""


def read_pixels(path: Path, *, stretched: bool = True) -> StoredPixels:
    """Read an image file of any format that OpenImageIO knows.

    Parameters
    ----------
    path : Path
    stretched : bool
        Integers of a format with another maximum than the type's (PGM of 1000, PNG of 4 bits) are
        brought to the type's range, as colour needs it; else they stay the numbers that they are.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    InputError
        If it is not an image, or its end is missing.
    """
    if not path.exists():
        raise FileNotFoundError(2, "No such file", str(path))
    with reading(
        path, "a whole image", InputError
    ):  # names and texts in its header may be no UTF-8
        return _read_pixels(path, stretched)


def _read_pixels(path: Path, stretched: bool = True, *, ours: bool = False) -> StoredPixels:
    config = oiio.ImageSpec()  # without one, PFM files come out upside down
    config.attribute("oiio:UnassociatedAlpha", 1)  # colour as stored, not multiplied by alpha
    source = oiio.ImageInput.open(str(path), config) if path.is_file() else None
    if source is None and path.is_file() and (avif := opened_avif(path)) is not None:
        return _avif_pixels(path, avif)
    if source is None:
        if path.is_dir():
            raise InputError(f"{path}: must be an image (it is a folder); name a file in it")
        reason = visible_line(oiio.geterror()) if path.is_file() else "it is no regular file"
        raise InputError(
            f"{path}: must be an image ({reason}); is it damaged? If not, save it as PNG, TIFF or"
            " OpenEXR"
        )
    try:
        spec = source.spec()
        if not ours:
            check_values(path, spec.width, spec.height, spec.nchannels)
        check_flat(path, spec)
        name = source.format_name()
        plain = read_netpbm(path) if name == "pnm" else None
    except Exception:
        source.close()
        raise
    if plain is not None:
        source.close()
        numbers = plain.stretched() if stretched else plain.data
        return StoredPixels(numbers, tuple(spec.channelnames), {}, name)
    stored = str(spec.format) if not spec.channelformats else "float"
    kind = stored if stored in _NATIVE else "float"
    data = source.read_image(0, 0, 0, spec.nchannels, kind)
    error = source.geterror()
    source.close()
    if data is None or error:
        raise InputError(
            f"{path}: must be a whole image ({visible_line(error)});"
            " the file is damaged or was cut short: copy or make it again"
        )
    data = np.asarray(data).reshape(spec.height, spec.width, spec.nchannels)
    attributes = {item.name: item.value for item in spec.extra_attribs}
    if not stretched and data.dtype.kind == "u":
        data = _narrow(data, _bits(path, name, attributes))
    data = in_display_window(path, spec, name, data)
    return StoredPixels(data, tuple(spec.channelnames), attributes, name)


def _avif_pixels(path: Path, image: Image.Image) -> StoredPixels:
    oiio.geterror()
    with image:
        check_values(path, image.width, image.height, len(image.getbands()))
        said: dict[str, Any] = {"Orientation": image.getexif().get(_ORIENTATION, _UPRIGHT)}
        if "icc_profile" in image.info:
            said["ICCProfile"] = np.frombuffer(image.info["icc_profile"], np.uint8)
        data = np.asarray(image)
        return StoredPixels(data.reshape(*data.shape[:2], -1), image.getbands(), said, "avif")


def check_flat(path: Path, spec: oiio.ImageSpec) -> None:
    """Refuse deep pixels, of which OpenImageIO returns what was in memory.

    Raises
    ------
    InputError
        If a pixel may hold any number of samples.
    """
    if spec.deep:
        raise refusal(path, "deep pixels", "it is deep: any number of samples")


def in_display_window(
    path: Path, spec: oiio.ImageSpec, kind: str, data: NDArray[Any]
) -> NDArray[Any]:
    """Cut what lies around a picture's display window, which is the picture by OpenEXR's word.

    Raises
    ------
    InputError
        If a part of the display window is not stored.
    """
    if kind not in _WINDOWED:
        return data
    left, top = spec.full_x - spec.x, spec.full_y - spec.y
    width, height = spec.full_width, spec.full_height
    whole = f"{width} x {height} px"
    if min(left, top) < 0 or left + width > spec.width or top + height > spec.height:
        found = f"of {whole}, its data window has {spec.width} x {spec.height} px from column"
        raise refusal(path, "small data window", f"{found} {-left}, row {-top}")
    if (spec.width, spec.height) == (width, height):
        return data
    note(path, f"cropped from {spec.width} x {spec.height} px to its display window, {whole}")
    return np.ascontiguousarray(data[top : top + height, left : left + width])


def _bits(path: Path, name: str, attributes: Mapping[str, Any]) -> int | None:
    """Number of bits in which a format stores a number; None where it does not say."""
    if name == "png":
        with path.open("rb") as file:
            bits, colour = file.read(_PNG_BITS + 2)[_PNG_BITS:]
        return None if colour == _PNG_PALETTE else bits
    said = attributes.get("oiio:BitsPerSample")
    return None if said is None else int(said)


def _narrow(data: NDArray[Any], bits: int | None) -> NDArray[Any]:
    """Undo the stretch of a few bits to 8 or 16."""
    if bits is None or bits >= 8 * data.dtype.itemsize:
        return data
    factor = np.iinfo(data.dtype).max / (2**bits - 1)
    return np.asarray(np.rint(data / factor), data.dtype)


def stated_size_px(path: Path, *, upright: bool = False) -> tuple[int, int] | None:
    """Return width and height as an image file's header has them; None where it is no image.

    With `upright`, as it is seen once turned by its Exif orientation.
    """
    source = oiio.ImageInput.open(str(path)) if path.is_file() else None
    if source is None:
        oiio.geterror()
        avif = opened_avif(path) if path.is_file() else None
        if avif is None:
            return None
        with avif:
            return avif.size
    spec = source.spec()
    source.close()
    size_px = int(spec.width), int(spec.height)
    turned = upright and spec.get_int_attribute("Orientation", _UPRIGHT) >= _FIRST_ON_ITS_SIDE
    return size_px[::-1] if turned else size_px


def check_fits(path: Path, command: str) -> None:
    """Refuse by its header a picture for which a command of `NEEDS` takes too much memory.

    Raises
    ------
    InputError
        As `pipeline.picture_limits.check_need`. What is no picture, its reader refuses.
    """
    size_px = stated_size_px(path)
    if size_px is not None:
        check_need(path, command, *size_px)


def check_picture(
    path: Path, pixels: StoredPixels, handled: Sequence[str] = (), *, encoded: bool = False
) -> None:
    """Refuse or note what a header says of its colour and no reader honours.

    Parameters
    ----------
    handled : sequence of str
        Statements that the caller deals with; see `pipeline.statements`.
    encoded : bool
        Floats were said to hold encoded colour.

    Raises
    ------
    InputError
        If a statement is refused, or the numbers are integers with a sign or of 32 bits.
    """
    dtype = pixels.data.dtype
    if dtype.kind in "iu" and dtype not in (np.uint8, np.uint16):
        raise InputError(
            f"{path}: a picture must hold 8 or 16 bits without a sign, or floats (holds {dtype}"
            " numbers, of which no one knows what white is); save it as PNG"
        )
    if pixels.kind:  # there is a file
        _check(path, pixels, "colour", handled, encoded=encoded)


def check_numbers(path: Path, pixels: StoredPixels) -> float | None:
    """Refuse or note what a header says of its numbers; return the one that stands for "unknown".

    Raises
    ------
    InputError
        If a statement is refused, or the format changes numbers.
    """
    if pixels.kind in _LOSSY:
        raise InputError(
            f"{path}: must hold exact numbers ({pixels.kind} changes them, most at edges, where"
            " they matter); save it anew as PNG, TIFF or OpenEXR from what it was made of"
        )
    if pixels.kind not in _EXACT:
        raise InputError(
            f"{path}: numbers are read from PNG, TIFF, OpenEXR, PGM and PFM (this is"
            f" {pixels.kind}); save them as one of these"
        )
    _check(path, pixels, "numbers")
    tags = read_statements(path, "tiff")[0] if pixels.kind == "tiff" else {}
    try:
        return float(tags["tag 42113"].strip(b"\0 ")) if "tag 42113" in tags else None
    except ValueError:
        said = tags["tag 42113"][:40]
        raise InputError(
            f"{path}: GDAL_NODATA must be a number (it says {said!r}); write it again"
        ) from None


def _check(
    path: Path, pixels: StoredPixels, use: Use, handled: Sequence[str] = (), **how: bool
) -> None:
    found = dict(pixels.attributes)
    if pixels.kind not in WALKERS and pixels.data.dtype.kind == "u":
        found["colour space"] = pixels.attributes.get("oiio:ColorSpace", "")
    if pixels.kind not in _LAYERED:
        found["several pictures"] = count_pictures(path)
    check_statements(path, pixels.kind, found, (use,), handled=handled, **how)


def count_pictures(path: Path) -> int:
    """Return the number of pictures in an image file: pages of a TIFF, frames of a GIF, ..."""
    for part in read_statements(path, "png"):
        if len(frames := part.get("acTL", b"")) >= 4:  # of which OpenImageIO knows nothing
            beside = [name for name in part if name in ("fcTL", "IDAT")] == ["IDAT", "fcTL"]
            return int.from_bytes(frames[:4], "big") + beside
    source, count = oiio.ImageInput.open(str(path)), 0
    while source is not None and source.seek_subimage(count, 0):
        count += 1
    oiio.geterror()
    if source is not None:
        source.geterror()
        source.close()
    return count


def three_channels(path: Path, pixels: StoredPixels, *, encoded: bool = False) -> NDArray[Any]:
    """Return `pixels` as red, green, blue of shape (H, W, 3), as stored; grey becomes three.

    Raises
    ------
    InputError
        If there are other channels, an alpha channel that is not 1 everywhere, or `check_picture`
        refuses what the file says.
    """
    check_picture(path, pixels, encoded=encoded)
    data, names = pixels.data, pixels.channels
    if data.dtype == np.float64:
        data = data.astype(np.float32)
    if names[-1:] == ("A",):
        opaque = np.iinfo(data.dtype).max if data.dtype.kind == "u" else 1
        if not (data[..., -1] == opaque).all():
            raise InputError(
                f"{path}: must be opaque (its alpha channel is not 1 everywhere);"
                " put it on a background first"
            )
        data, names = data[..., :-1], names[:-1]
    if len(names) == 1 and names[0] in ("Y", "L"):
        return np.repeat(data, 3, axis=-1)
    if set(names) != {"R", "G", "B"}:
        raise InputError(
            f"{path}: must have the channels R, G, B (has {', '.join(pixels.channels)}); save it"
            " as a PNG in colour"
        )
    return data[..., [names.index(name) for name in "RGB"]]


def from_integers(data: NDArray[np.unsignedinteger[Any]]) -> NDArray[np.float32]:
    """Return stored integers as [0, 1], the largest one that fits as 1."""
    # Rounded as by way of float64: twice 24 bits and two more are fewer than its 53.
    largest = np.float32(np.iinfo(data.dtype).max)
    shown: NDArray[np.float32] = np.divide(data, largest, dtype=np.float32)
    return shown


FREE_SPACE: Final = "free some space on this disk, or choose another one"


def write_pixels(
    path: Path,
    data: NDArray[Any],
    channels: Sequence[str],
    *,
    types: Sequence[str] = (),
    attributes: Mapping[str, str | int | float] | None = None,
) -> None:
    """Write an image file whole or not at all: under a temporary name, synced, then renamed.

    Parameters
    ----------
    path : Path
        The extension chooses the format.
    data : ndarray of shape (H, W, C)
    channels : sequence of str
        C names.
    types : sequence of str, optional
        What to store each channel as, ``"half"`` or ``"float"``; by default as `data`.
    attributes : mapping, optional
        For the header.

    Raises
    ------
    OSError
        If the folder is missing or cannot be written to, or the disk is full.
    InputError
        If the format is unknown or cannot hold the data.
    """
    height, width, count = data.shape
    with whole_path(path, path.suffix) as temporary:
        target = oiio.ImageOutput.create(str(temporary))
        if target is None:
            oiio.geterror()  # it names the temporary file
            raise InputError(f"{path}: must end as an image format does, such as .png or .exr")
        if target.format_name() in _NEEDS_ROOM:  # OpenImageIO would not say what stands against it
            temporary.write_bytes(bytes(2 * data.nbytes + _HEAD))
        spec = oiio.ImageSpec(width, height, count, _oiio_type(data.dtype))
        spec.channelnames = tuple(channels)
        spec.attribute("oiio:UnassociatedAlpha", 1)
        if types:
            spec.channelformats = tuple(types)
        if path.suffix.lower() == ".exr":
            spec.attribute("DateTime", _NO_TIME)
        for name, value in (attributes or {}).items():
            spec.attribute(name, value)
        done = target.open(str(temporary), spec) and target.write_image(np.ascontiguousarray(data))
        if not (target.close() and done):
            raise write_error(path, visible_line(target.geterror()))
        _check_whole(path, temporary, data.shape)


def _check_whole(path: Path, temporary: Path, shape: tuple[int, ...]) -> None:
    """Read the file back: on a full disk OpenImageIO writes half of it and reports success."""
    try:
        whole = _read_pixels(temporary, ours=True).data.shape == shape
    except InputError:
        whole = False
    if whole:
        whole = temporary.read_bytes().endswith(_ENDS.get(path.suffix.lower(), b""))
    if not whole:
        raise write_error(path, f"the file came out incomplete; {FREE_SPACE}")


def write_error(path: Path, reason: str) -> Exception:
    """Return the exception for a file that a library did not write whole; its reason is named."""
    if shutil.disk_usage(path.parent).free == 0:
        return OSError(28, "No space left on device", str(path))
    return InputError(f"{path}: cannot be written ({reason})")


def _oiio_type(dtype: np.dtype[Any]) -> str:
    names = {"uint8": "uint8", "uint16": "uint16", "float16": "half", "float32": "float"}
    if dtype.name not in names:
        raise InputError(f"pixels must be one of {', '.join(names)} (got {dtype.name})")
    return names[dtype.name]


_HEAD = 1 << 16
_HEIC = (b"heic", b"heix", b"hevc", b"heim", b"heis", b"mif1", b"msf1")
_SHOWN = (1, 2, 6, 13, 14, 15)  # transfers that are shown as sRGB, or not said
_PRIMARIES = (1, 2)
_CURE = "save it as PNG or JPEG"


def opened_avif(path: Path) -> Image.Image | None:
    """Open an AVIF picture of 8 bits; None where a file is none.

    Raises
    ------
    InputError
        If it is HEIC, is damaged, holds several pictures, has more bits or another range of
        colour, or Pillow has no decoder.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD)
    brands = head[8 : min(int.from_bytes(head[:4]), 256)] if head[4:8] == b"ftyp" else b""
    if not {b"avif", b"avis"} & {brands[at : at + 4] for at in range(0, len(brands), 4)}:
        if brands.startswith(_HEIC):
            raise InputError(f"{path}: is HEIC, which is not read; {_CURE}")
        return None
    if not features.check("avif"):
        raise InputError(f"{path}: is AVIF, which this Pillow does not read; {_CURE}")
    depths = re.findall(rb"pixi.{5}(.)", head, re.DOTALL)
    colours = re.findall(rb"colrnclx(..)(..)", head, re.DOTALL)
    if any(depth[0] > 8 for depth in depths) or any(
        int.from_bytes(first) not in _PRIMARIES or int.from_bytes(curve) not in _SHOWN
        for first, curve in colours
    ):
        raise InputError(
            f"{path}: an AVIF picture must have 8 bits and the colours of sRGB (has more); {_CURE}"
        )
    with reading(path, "a whole AVIF picture", InputError):
        image = Image.open(path, formats=["AVIF"])
    if (pictures := getattr(image, "n_frames", 1)) > 1:
        image.close()
        raise InputError(f"{path}: must hold one picture (holds {pictures}); {_CURE}")
    return image
