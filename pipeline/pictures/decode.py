"""Pixels of image files, as stored, through OpenImageIO, Pillow and a reader of Netpbm.

AVIF goes through Pillow; HEIC is named, which neither it nor OpenImageIO reads. What the numbers
mean is for `pipeline.pictures.colour_file` and `pipeline.pictures.depth_and_flow` to say.

A PGM or PPM file states the largest number that it may hold, a PFM file a scale whose sign is the
order of the bytes. Its amount is ignored, as Middlebury's own reader does: writers put anything
there (pfmLib of its author, 1/255).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813  its own documentation calls it so
from numpy.typing import NDArray
from PIL import Image

from pipeline.errors import InputError, note
from pipeline.frame import AnyArray
from pipeline.pictures.channels import Planes, check_opaque
from pipeline.pictures.header import (
    UPRIGHT_EXIF,
    WALKERS,
    check_fits,
    check_flat,
    check_statements,
    count_pictures,
    forget_error,
    opened_avif,
    read_statements,
)
from pipeline.pictures.size_limits import check_values
from pipeline.statements.check_statements import refusal
from pipeline.statements.row import Use
from protocols.outside import reading, visible_line

_NATIVE = ("uint8", "uint16", "int8", "int16", "int", "uint", "double")
"""Types that OpenImageIO hands out as stored when asked for them; asked for another, it stretches
integers to shares of the largest one."""
_WINDOWED = ("openexr", "rla")
_LAYERED = ("openexr", "psd")  # further pictures are parts of the first, or layers
_EXACT = ("png", "tiff", "openexr", "pnm", "bmp")
_LOSSY = ("jpeg", "jpeg2000", "jpegxl", "webp", "heif", "avif")
_ORIENTATION = 274  # its number in Exif
_PNG_BITS = 24  # where its header has the bits of a number, and then the kind of colour
_PNG_PALETTE = 3


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

    data: AnyArray
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
        return pixels_of(path, stretched)


def pixels_of(path: Path, stretched: bool = True, *, ours: bool = False) -> StoredPixels:
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
        plain = read_netpbm(path, stretched) if name == "pnm" else None
    except Exception:
        source.close()
        raise
    if plain is not None:
        source.close()
        return StoredPixels(plain, tuple(spec.channelnames), {}, name)
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
    forget_error()
    with image:
        check_values(path, image.width, image.height, len(image.getbands()))
        said: dict[str, Any] = {"Orientation": image.getexif().get(_ORIENTATION, UPRIGHT_EXIF)}
        if "icc_profile" in image.info:
            said["ICCProfile"] = np.frombuffer(image.info["icc_profile"], np.uint8)
        data = np.asarray(image)
        return StoredPixels(data.reshape(*data.shape[:2], -1), image.getbands(), said, "avif")


def in_display_window(path: Path, spec: oiio.ImageSpec, kind: str, data: AnyArray) -> AnyArray:
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


def _narrow(data: AnyArray, bits: int | None) -> AnyArray:
    """Undo the stretch of a few bits to 8 or 16."""
    if bits is None or bits >= 8 * data.dtype.itemsize:
        return data
    factor = np.iinfo(data.dtype).max / (2**bits - 1)
    return np.asarray(np.rint(data / factor), data.dtype)


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
        _check_header(path, pixels, "colour", handled, encoded=encoded)


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
    _check_header(path, pixels, "numbers")
    tags = read_statements(path, "tiff")[0] if pixels.kind == "tiff" else {}
    try:
        return float(tags["tag 42113"].strip(b"\0 ")) if "tag 42113" in tags else None
    except ValueError:
        said = tags["tag 42113"][:40]
        raise InputError(
            f"{path}: GDAL_NODATA must be a number (it says {said!r}); write it again"
        ) from None


def _check_header(
    path: Path, pixels: StoredPixels, use: Use, handled: Sequence[str] = (), **how: bool
) -> None:
    found = dict(pixels.attributes)
    if pixels.kind not in WALKERS and pixels.data.dtype.kind == "u":
        found["colour space"] = pixels.attributes.get("oiio:ColorSpace", "")
    if pixels.kind not in _LAYERED:
        found["several pictures"] = count_pictures(path)
    check_statements(path, pixels.kind, found, (use,), handled=handled, **how)


def three_channels(path: Path, pixels: StoredPixels, *, encoded: bool = False) -> AnyArray:
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
        check_opaque(path, data[..., -1], np.iinfo(data.dtype).max if data.dtype.kind == "u" else 1)
        data, names = data[..., :-1], names[:-1]
    if len(names) == 1 and names[0] in ("Y", "L"):
        return np.repeat(data, 3, axis=-1)
    if set(names) != {"R", "G", "B"}:
        raise InputError(
            f"{path}: must have the channels R, G, B (has {', '.join(pixels.channels)}); save it"
            " as a PNG in colour"
        )
    return data[..., [names.index(name) for name in "RGB"]]


def read_integers(path: Path) -> NDArray[np.float32]:
    """Read encoded colour of a file of integers, shape (H, W, 3), in [0, 1].

    Raises
    ------
    FileNotFoundError, InputError
        If it is not there, is no whole picture, or holds floats.
    """
    pixels = read_pixels(path)
    if pixels.data.dtype.kind != "u":
        raise InputError(f"{path}: must hold integers, such as a PNG of 8 or 16 bits")
    return from_integers(three_channels(path, pixels))


def from_integers(data: NDArray[np.unsignedinteger[Any]]) -> NDArray[np.float32]:
    """Return stored integers as [0, 1], the largest one that fits as 1."""
    # Rounded as by way of float64: twice 24 bits and two more are fewer than its 53.
    largest = np.float32(np.iinfo(data.dtype).max)
    shown: NDArray[np.float32] = np.divide(data, largest, dtype=np.float32)
    return shown


_GAP = rb"(?:\s|#[^\n]*\n)+"
_HEADER = re.compile(
    rb"(P[2356fF])" + _GAP + rb"(\d{1,9})" + _GAP + rb"(\d{1,9})" + _GAP + rb"([-+.\deE]+)"
)
_HEADER_BYTES = 4096
_CHANNELS = {"P3": 3, "P6": 3, "PF": 3}


def read_netpbm(path: Path, stretched: bool) -> AnyArray | None:
    """Return the numbers of a PGM, PPM or PFM file; None where it is none, or a bitmap.

    Shape (H, W, C), the upper row first. Integers are as stored, or `stretched`: in shares of the
    type's largest number, rounded down.

    Raises
    ------
    InputError
        If it is cut short, or its numbers exceed the maximum that it states.
    """
    with path.open("rb") as file:
        match = _HEADER.match(file.read(_HEADER_BYTES))
        if match is None:
            return None
        kind, width, height = match[1].decode(), int(match[2]), int(match[3])
        shape = height, width, _CHANNELS.get(kind, 1)
        check_values(path, *shape)
        file.seek(match.end())
        body = file.read()
    is_float = kind in ("Pf", "PF")
    if not is_float and not match[4].isdigit():
        return None
    try:
        largest = float(match[4])
    except ValueError:
        return None
    floats, integers = "<f4" if largest < 0 else ">f4", ">u2" if largest > 255 else "u1"
    dtype = np.dtype(floats if is_float else integers)
    if kind in ("P2", "P3"):
        words = re.sub(rb"#[^\n]*", b"", body).split()
        if odd := [word for word in words if not word.isdigit()]:
            said = odd[0][:20].decode("latin-1")
            raise InputError(
                f"{path}: must hold whole numbers of 0 and more (one is {said!r}); write it again,"
                " as PFM if they are fractions or negative"
            )
        wanted, there = int(np.prod(shape)), len(words)
        found = np.array([min(int(word), 65535) for word in words], np.uint16)
    else:
        wanted = dtype.itemsize * int(np.prod(shape))
        # One white space ends the header; some programs write a line end of two.
        body = body[2 if body[:2] == b"\r\n" and len(body) == wanted + 2 else 1 :]
        there = len(body)
        found = np.frombuffer(body[: dtype.itemsize * (len(body) // dtype.itemsize)], dtype)
    if there > wanted:
        raise InputError(
            f"{path}: must end with its last number (it says {width} x {height} px, {wanted}"
            f" {'numbers' if kind in ('P2', 'P3') else 'bytes'}, and {there} follow its header:"
            " where they begin is not known); make it again, as one picture"
        )
    if found.size < np.prod(shape):
        raise InputError(
            f"{path}: must be a whole image (it says {width} x {height} px, and ends before); the"
            " file is damaged or was cut short: copy or make it again"
        )
    if not is_float and found.max() > largest:
        raise InputError(
            f"{path}: must hold numbers up to {largest:g}, as its header says (holds"
            f" {found.max()}); make it again"
        )
    data = found[: np.prod(shape)].reshape(shape).astype(dtype.newbyteorder("="))
    if is_float:
        return np.ascontiguousarray(data[::-1])
    if not stretched:
        return data
    most = np.iinfo(data.dtype).max
    return (data.astype(np.uint32) * most // int(largest)).astype(data.dtype)


@dataclass(frozen=True)
class ExrParts:
    """Every channel of a file by name, half and float alike, and its first part's header.

    A channel of a part may be called by its own name or by ``PART.CHANNEL``; where several parts
    have a channel of that name, only by the second.
    """

    planes: Planes
    attributes: Mapping[str, Any]


def read_parts(path: Path, *, encoded: bool = False, judged: bool = False) -> ExrParts:
    """Read an OpenEXR file; all its parts count as one picture.

    Parameters
    ----------
    path : Path
    encoded : bool
        It was said to hold encoded colour.
    judged : bool
        What its header says has been looked at.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    InputError
        If it is not a whole image, its parts differ in size, or its header says what no reader
        honours (`pipeline.statements`).
    """
    if not path.is_file():
        raise FileNotFoundError(2, "No such file", str(path))
    with reading(path, "a whole image", InputError):  # names in its header may be no UTF-8
        check_fits(path, "read")
        file, kind = _read_parts(path)
        if not judged:
            check_statements(path, kind, file.attributes, ("colour", "numbers"), encoded=encoded)
        return file


def _read_parts(path: Path) -> tuple[ExrParts, str]:
    source = oiio.ImageInput.open(str(path))
    if source is None:
        reason = visible_line(oiio.geterror())
        raise InputError(f"{path}: must be an image in OpenEXR format ({reason})")
    stored: list[tuple[str, str, NDArray[np.float32]]] = []  # of each channel: part, name, numbers
    attributes: dict[str, Any] = {}
    try:
        kind = source.format_name()
        part = values = 0
        while source.seek_subimage(part, 0):
            spec = source.spec()
            values += spec.width * spec.height * spec.nchannels
            check_values(path, values)
            check_flat(path, spec)
            label = spec.get_string_attribute("oiio:subimagename") or spec.get_string_attribute(
                "name"
            )
            attributes = attributes or {item.name: item.value for item in spec.extra_attribs}
            data = in_display_window(path, spec, kind, _part(path, source, spec, part))
            if stored and data.shape[:2] != stored[0][2].shape:
                height, width = stored[0][2].shape
                raise InputError(
                    f"{path}: its parts must have one size (got {width}x{height} and"
                    f" {data.shape[1]}x{data.shape[0]})"
                )
            taken = {entry[0] for entry in stored}
            label = label if label and label not in taken else f"part{part}"
            stored += [
                (label, name, np.ascontiguousarray(data[..., index]))
                for index, name in enumerate(spec.channelnames)
            ]
            part += 1
    finally:
        source.close()
    return ExrParts(_planes_of(stored), attributes), kind


def _part(path: Path, source: Any, spec: oiio.ImageSpec, part: int) -> NDArray[np.float32]:
    """Numbers of a part, shape (H, W, C); those of whole numbers as they are, not as shares."""
    data: Any = source.read_image(part, 0, 0, spec.nchannels, "float")
    whole = [
        index
        for index in range(spec.nchannels)
        if str(spec.channelformats[index] if spec.channelformats else spec.format) == "uint"
    ]
    plain = [source.read_image(part, 0, index, index + 1, "uint") for index in whole]
    if data is None or source.geterror() or any(plane is None for plane in plain):
        raise InputError(
            f"{path}: must be a whole image; the file is damaged or was cut short: copy or make it"
            " again"
        )
    data = np.asarray(data, np.float32).reshape(spec.height, spec.width, spec.nchannels)
    for index, plane in zip(whole, plain, strict=True):
        data[..., index] = np.asarray(plane).reshape(spec.height, spec.width)
    return np.asarray(data, np.float32)


def _planes_of(stored: list[tuple[str, str, NDArray[np.float32]]]) -> Planes:
    names = [name for _, name, _ in stored]
    several = len({part for part, _, _ in stored}) > 1
    planes = Planes()
    for part, name, plane in stored:
        full = f"{part}.{name}"
        key = full if names.count(name) > 1 else name
        planes[key] = planes.aliases[full] = plane
        if several:
            planes.parts[key] = part
    return planes


def as_floats(picture: NDArray[np.float32] | NDArray[np.uint8]) -> NDArray[np.float32]:
    """A picture that is checked, in [0, 1]."""
    if picture.dtype == np.uint8:
        return from_integers(np.asarray(picture, np.uint8))
    return np.asarray(picture, np.float32)
