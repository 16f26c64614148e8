"""What is made of each statement in the header of an image file: one table for every reader.

A statement is *honoured* by the reader of the pixels, *silent* where it changes nothing, *noted* or
*refused*. The last two happen only where it differs from its default, which a row's function finds:
it returns what is wrong, or None. What is in no row is noted. `docs/images.md` shows the table.
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from PIL import Image, ImageCms

from pipeline.errors import InputError, note
from pipeline.image_header import WALKERS, Statements, read_statements

Decision = Literal["honoured", "refused", "noted", "silent"]
Use = Literal["colour", "numbers"]
Judge = Callable[[Any, Statements], str | None]

_REC709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06)
_D65 = (0.3127, 0.329)
_PRIMARIES_APART = 0.005  # of a coordinate; writers round to three or four digits
_GAMMA = 1 / 2.2
_VIDEO_GAMMA = 0.50994  # what FFmpeg writes for the transfer of BT.709
_VIDEO_CODES = tuple((1, transfer, 0, 1) for transfer in (1, 6, 14, 15))  # shown as in videos
_MOST_OF_PROFILE = 1 << 24  # bytes
_GAMMA_APART = 0.02  # of it
_ASPECT_APART = 0.01
_SRGB_APART = 2  # of 255, between a profile's colours and sRGB's
_TONE_APART = 12  # of 255, between a profile's greys and sRGB's; of a gamma of 2.2: 9, of 1.8: 19
_CURVE_APART = 0.05  # of light, at half of the code
_PALETTE = "must hold numbers (they are places in a palette of colours); write the numbers anew"
_WHITE_IS_0 = "must store 0 as black (it says that 0 is white); write it again as MinIsBlack"
_LISTED = 6  # names that a message lists


@dataclass(frozen=True)
class Row:
    """A line of the table.

    Parameters
    ----------
    kind : str
        OpenImageIO's name of the format; ``"any"`` for what it reads from several.
    names : str
        Pattern of whole names of statements.
    decision : Decision
        What is done where it is not at its default.
    words : str
        What it says, for the page of docs.
    judge : optional
        From a value and all statements to what differs from the default; without one, all does.
    of : sequence of Use
        What the file is read for, where this row is about it.
    """

    kind: str
    names: str
    decision: Decision
    words: str
    judge: Judge | None = None
    of: Sequence[Use] = ("colour", "numbers")

    def found(self, value: Any, statements: Statements) -> str | None:
        """What differs from the default; None if nothing does."""
        return self.words if self.judge is None else self.judge(value, statements)


# ---- judges: what differs from the default, in words that follow "it says"


def _aspect(value: Any, _all: Statements) -> str | None:
    ratio = float(value)
    if ratio <= 0 or abs(ratio - 1) <= _ASPECT_APART:
        return None
    return f"pixels must be square (its header says {ratio:g} to 1); resample it to square ones"


def _orientation(value: Any, _all: Statements) -> str | None:
    if int(value) in (0, 1):
        return None
    return (
        f"must be stored upright (its Exif orientation is {int(value)}); turn it and save it again"
    )


def _several(value: Any, _all: Statements) -> str | None:
    if int(value) <= 1:
        return None
    return f"must hold one picture (it holds several, {value}); save the one that is meant"


def _primaries(values: Sequence[float], white: Sequence[float]) -> str | None:
    wanted = (*_REC709[: len(values)], *_D65[: len(white)])
    apart = max(abs(a - b) for a, b in zip((*values, *white), wanted, strict=False))
    if apart <= _PRIMARIES_APART:
        return None
    listed = ", ".join(f"{number:.4g}" for number in (*values, *white))
    return (
        f"must have the primaries and white of Rec.709 and sRGB (its header says {listed}); convert"
        " it to Rec.709 primaries, and save it as that"
    )


def _not_srgb(found: str) -> str:
    return f"must hold sRGB colour ({found}); convert it to sRGB, and save it as that"


def _overridden(everything: Statements) -> bool:
    """PNG: what says more of its colour counts instead."""
    profile = everything.get("iCCP")
    usable = profile is not None and _png_profile(profile, everything) is None
    return usable or "sRGB" in everything or "cICP" in everything


def _png_profile(value: bytes, everything: Statements) -> str | None:
    """A profile that libpng leaves out: no whole one, or not of the picture's kind of colour."""
    _, _, packed = value.partition(b"\0")
    try:
        profile = zlib.decompressobj().decompress(packed[1:], _MOST_OF_PROFILE)
    except zlib.error:
        profile = b""
    grey = everything.get("IHDR", b"")[9:10] in (b"\0", b"\4")
    kind = b"GRAY" if grey else b"RGB "
    whole = 132 <= int.from_bytes(profile[:4]) <= len(profile)
    if whole and (profile[16:20], profile[36:40]) == (kind, b"acsp"):
        return None
    return "its colour profile is damaged or of another kind of colour, and left out"


def _png_video(value: bytes, everything: Statements) -> str | None:
    """The encoding of video, in a gAMA or a cICP chunk of four bytes."""
    near = abs(int.from_bytes(value) / 1e5 - _VIDEO_GAMMA) <= 1e-3
    if tuple(value) not in _VIDEO_CODES and (not near or _overridden(everything)):
        return None
    return "taken as shown, as video is, though it says that it is encoded as video (BT.709)"


def _png_gamma(value: bytes, everything: Statements) -> str | None:
    (stored,) = struct.unpack(">I", value)
    if _overridden(everything) or abs(stored / 1e5 / _GAMMA - 1) <= _GAMMA_APART:
        return None
    if abs(stored / 1e5 - _VIDEO_GAMMA) <= 1e-3:
        return None
    kind = "linear light" if stored == 100_000 else f"light to the power {stored / 1e5:g}"
    return _not_srgb(f"its gAMA chunk says {kind}")


def _png_primaries(value: bytes, everything: Statements) -> str | None:
    numbers = [number / 1e5 for number in struct.unpack(">8I", value)]
    return None if _overridden(everything) else _primaries(numbers[2:], numbers[:2])


def _code_points(value: Sequence[int], _all: Statements) -> str | None:
    if tuple(value[:4]) in ((1, 13, 0, 1), *_VIDEO_CODES):
        return None
    return _not_srgb(f"its header says code points {', '.join(map(str, value[:4]))}")


def _png_offset(value: bytes, _all: Statements) -> str | None:
    place = struct.unpack_from(">ii", value)
    return f"it lies at {place[0]}, {place[1]} of a page" if any(place) else None


def _png_palette(value: bytes, everything: Statements) -> str | None:
    indexed = everything.get("IHDR", b"")[9:10] == b"\3"
    return _PALETTE if indexed and not value[::3] == value[1::3] == value[2::3] else None


def _tiff_palette(value: Any, everything: Statements) -> str | None:
    if value[0] == 3:
        entries = everything.get("320", ())
        third = len(entries) // 3
        grey = entries[:third] == entries[third : 2 * third] == entries[2 * third :]
        return None if grey else _PALETTE
    return _WHITE_IS_0 if value[0] == 0 else None


def _tiff_kind(value: Any, everything: Statements) -> str | None:
    if value[0] == 0 and everything.get("258", (1,))[0] > 8:
        return _WHITE_IS_0  # OpenImageIO turns 8 bits and fewer alone
    if value[0] in (0, 1, 2, 3, 5, 6):
        return None
    return f"must hold grey, RGB, CMYK or YCbCr (its photometric kind is {value[0]}); convert it"


def _tiff_sample_format(value: Any, _all: Statements) -> str | None:
    if value[0] in (1, 2, 3, 4):
        return None
    return "must hold real numbers (they are complex); write one real number a pixel"


def _tiff_bits(value: Any, _all: Statements) -> str | None:
    if value[0] != 24:
        return None
    return "must store numbers of 8, 16 or 32 bits (has 24, which are not read right); save it anew"


def _tiff_white(value: Any, _all: Statements) -> str | None:
    return _primaries((), value[:2])


def _tiff_primaries(value: Any, _all: Statements) -> str | None:
    return _primaries(value[:6], ())


def _tiff_curve(value: Any, everything: Statements) -> str | None:
    bits = everything.get("258", (8,))[0]
    half = value[min(2**bits // 2, len(value) - 1)] / 65535
    if abs(half - 0.2159) <= _CURVE_APART:
        return None
    return _not_srgb(f"its transfer function shows half of the code as {half:.2f} of the light")


def _tiff_scale(value: bytes, _all: Statements) -> str | None:
    text = value.decode("utf-8", "replace")
    found = dict(re.findall(r'role="(scale|offset)"[^>]*>\s*([-+.\deE]+)', text))
    if float(found.get("scale", 1)) == 1 and float(found.get("offset", 0)) == 0:
        return None
    listed = ", ".join(f"{name} {number}" for name, number in found.items())
    return f"its header says {listed}, which is not applied: the options of the units do that"


def _views(value: Any, _all: Statements) -> str | None:
    if isinstance(value, bytes):  # of each its length, then its name
        value = [word for word in re.split(r"[\x00-\x1f]+", value.decode("latin-1")) if word]
    return f"it holds the views {', '.join(value)}: the first is taken" if len(value) > 1 else None


def _exr_primaries(value: Any, _all: Statements) -> str | None:
    return _primaries(value[:6], value[6:8])


_LINEAR = re.compile(r"(scene_)?lin(ear)?\b.*|lin_(rec709|srgb).*|scene[-_ ]?linear.*", re.I)
_WIDE = re.compile(r"aces|ap0|ap1|p3|2020|xyz|adobe|prophoto|log", re.I)


def _colour_space(value: Any, _all: Statements) -> str | None:
    text = str(value)
    if _LINEAR.fullmatch(text) and not _WIDE.search(text):
        return None
    if re.search(r"srgb|rec[-_. ]?709", text, re.I):
        return (
            f"must hold light (it says {text[:40]!r}); save it as PNG, or say that it is encoded:"
            " --encoded of warp and foveate, transfer = 'linear' in a study"
        )
    return (
        f"must hold light with Rec.709 primaries (it says {text[:40]!r}); convert it, and save it"
        " as that"
    )


def _other_space(value: Any, _all: Statements) -> str | None:
    if re.search(r"srgb|rec\.?709|^$", str(value), re.I) and not _WIDE.search(str(value)):
        return None
    return _not_srgb(f"its colour space is {str(value)[:40]!r}")


def _exr_lossy(value: Any, _all: Statements) -> str | None:
    name = {5: "pxr24", 6: "b44", 7: "b44a", 8: "dwaa", 9: "dwab"}.get(value)
    return None if name is None else f"its compression ({name}) may have changed numbers"


def _exr_environment(value: Any, _all: Statements) -> str | None:
    kind = {0: "latitude and longitude", 1: "a cube"}.get(value, "an unknown kind")
    return f"it is an environment map ({kind}), taken for a flat picture"


def _hdr_format(value: Any, _all: Statements) -> str | None:
    if "rgbe" in str(value):
        return None
    return f"must hold RGB (its format is {str(value)[:40]}); convert it"


def _hdr_factor(value: Any, _all: Statements) -> str | None:
    given = [float(word) for word in str(value).split()]
    if all(number == 1 for number in given):
        return None
    return f"its exposure or colour correction ({value}) is not applied"


def _hdr_gamma(value: Any, _all: Statements) -> str | None:
    return None if float(value) == 1 else f"must hold light (its gamma is {value}); convert it"


def _hdr_primaries(value: Any, _all: Statements) -> str | None:
    numbers = [float(word) for word in str(value).split()]
    radiance = (0.64, 0.33, 0.29, 0.6, 0.15, 0.06, 0.333, 0.333)
    if len(numbers) == 8 and max(abs(a - b) for a, b in zip(numbers, radiance, strict=True)) < 5e-3:
        return None
    return _primaries(numbers[:6], numbers[6:8])


def _hdr_size(value: Any, _all: Statements) -> str | None:
    if value == "-Y +X":
        return None
    return f"must run by rows from the top (its size line says {value}); save it again like that"


def _hdr_aspect(value: Any, everything: Statements) -> str | None:
    return _aspect(str(value).split()[0], everything)


def _bmp_space(value: Any, _all: Statements) -> str | None:
    return None if value in (b"sRGB", b"Win ", bytes(4)) else "it has a colour space of its own"


def _bmp_aspect(value: Any, everything: Statements) -> str | None:
    across, down = value
    return _aspect(across / down, everything) if across > 0 and down > 0 else None


def _gif_aspect(value: Any, everything: Statements) -> str | None:
    return _aspect((value + 15) / 64, everything) if value else None


def _jpeg_exif_space(value: Any, everything: Statements) -> str | None:
    if int(value) == 1 or "ICCProfile" in everything:
        return None
    return "taken as sRGB, though its Exif says another colour space (Adobe RGB?)"


def _profile(value: Any, _all: Statements) -> str | None:
    name, tone, colour = _apart_from_srgb(bytes(value))
    if colour is not None and max(tone or 0, colour) <= _SRGB_APART:
        return None
    if "sRGB" in name and colour is None:
        return None
    off = "" if colour is None else f" (up to {colour} of 255 off)"
    return f"taken as sRGB, though its colour profile says {name!r}{off}"


def _profile_tone(value: Any, _all: Statements) -> str | None:
    name, tone, _ = _apart_from_srgb(bytes(value))
    if tone is None or tone <= _TONE_APART:
        return None
    return _not_srgb(f"its colour profile {name!r} shows greys up to {tone} of 255 off")


def _apart_from_srgb(profile: bytes) -> tuple[str, int | None, int | None]:
    """A profile's name, and how far its greys and all its colours are from sRGB's, of 255."""
    try:
        opened = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        name = ImageCms.getProfileDescription(opened).strip()
    except (ImageCms.PyCMSError, OSError, ValueError):
        return "which cannot be read", None, None
    steps = np.linspace(0, 255, 17).round().astype(np.uint8)
    grey = np.repeat(steps[None, :, None], 3, axis=-1)
    every = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(1, -1, 3)
    mode = {"RGB": "RGB", "GRAY": "L"}.get(opened.profile.xcolor_space.strip())
    if mode is None:
        return name, None, None
    try:
        change = ImageCms.buildTransform(
            opened,
            ImageCms.createProfile("sRGB"),
            mode,
            "RGB",
            renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
        )
        apart = []
        for asked in (grey, every if mode == "RGB" else grey):
            given = Image.fromarray(asked if mode == "RGB" else asked[..., 0])
            shown = np.asarray(ImageCms.applyTransform(given, change), np.int64)
            apart.append(int(np.abs(shown - asked).max()))
    except (ImageCms.PyCMSError, OSError, ValueError):
        return name, None, None
    return name, apart[0], apart[1]


_TIFF_SILENT = (
    "25[4-79]|26[36]|269|27[0-3]|27[7-9]|28[0-5]|289|29[67]|305|306|31[5-7]|32[0-5]|33[0-46]|34[0-1]"
    "|347|51[2-9]|52[0-1]|529|53[0-1]|700|33432|33550|33723|33922|34264|34377|3473[5-7]|34853|34665"
    "|37724|50341|4027[0-9]|270|271|272|274"
)
_EXR_SILENT = (
    "channels|lineOrder|screenWindow(Center|Width)|tiles|type|name|version|chunkCount|preview|owner"
    "|maxSamplesPerPixel|comments|capDate|utcOffset|longitude|latitude|altitude|focus|expTime|iso.*"
    "|aperture|framesPerSecond|imageCounter|reelName|timeCode|keyCode|wrapmodes|dwaCompressionLevel"
    "|originalDataWindow|worldTo(Camera|NDC|clip)|sensor.*|camera.*|lens.*|shutter.*|nominal.*|Scene"
    "|(effective|pin|entrance).*|capture.*|software.*|Software|HostComputer|DateTime|Exif:.*|File"
    "|Copyright|Artist|ImageDescription|Date|Time|Frame|FrameRange|Camera|RenderTime|Note|Marker"
    "|Memory|Hostname|Strip|SequencerStrip|BlenderMultiChannel|rgbCompat|ID|openexr:.*|metamerlab:.*"
    "|Make|Model|Keywords|DocumentName|fovcot|textureformat|XResolution|YResolution|ResolutionUnit"
    "|(nuke|unreal|arnold|cryptomatte|exr|input|rman|render|vray|houdini|maya|blender|smpte|cycles"
    "|karma|redshift|octane|corona|mitsuba|pbrt)\\w*([/.:].*)?"
    "|(oiio|jpeg|tiff|pnm|png|dpx|IPTC|GPS|XMP|xmp|photoshop|ICCProfile):.*"
)
COLOUR_SPACES: Final = ("oiio:ColorSpace", "colorInteropID", "colorSpace")
"""Of floats; they say what `Transfer` says."""

ROWS: Final[tuple[Row, ...]] = (
    Row("any", "Orientation", "refused", "Exif orientation other than upright", _orientation),
    Row("any", "PixelAspectRatio", "refused", "pixels that are not square", _aspect),
    Row("any", "ICCProfile tone", "refused", "a colour profile whose greys are not sRGB's",
        _profile_tone, ("colour",)),
    Row("any", "ICCProfile", "noted", "a colour profile other than sRGB", _profile, ("colour",)),
    Row("any", "ICCProfile( tone)?", "silent", "colour profile", None, ("numbers",)),
    Row("any", "Exif:ColorSpace", "noted", "Adobe RGB by Exif", _jpeg_exif_space, ("colour",)),
    Row("any", "pictures", "refused", "several pictures: pages, frames, an animation",
        _several),
    Row("any", "CICP", "refused", "code points other than sRGB's", _code_points, ("colour",)),
    Row("any", "colour space", "refused", "a colour space other than sRGB or linear Rec.709, of a"
        " format that is not below", _other_space, ("colour",)),
    Row("any", "CICP|colour space", "silent", "colour", None, ("numbers",)),
    Row("any", "deep", "refused", "deep pixels"),
    Row("any", "windows", "refused", "a data window smaller than the display window"),
    Row("any", "overscan", "noted", "a data window larger than the display window: cropped to it"),
    Row("png", "IHDR|IDAT|IEND", "honoured", "size, bits, interlacing"),
    Row("png", "PLTE", "honoured", "palette", None, ("colour",)),
    Row("png", "PLTE", "refused", "a palette of colours", _png_palette, ("numbers",)),
    Row("png", "tRNS", "honoured", "transparency"),
    Row("png", "gAMA", "refused",
        "a gamma other than 1/2.2 and video's, without sRGB, iCCP or cICP", _png_gamma,
        ("colour",)),
    Row("png", "cHRM", "refused", "other primaries than Rec.709's, without sRGB, iCCP or cICP",
        _png_primaries, ("colour",)),
    Row("png", "cICP", "refused", "code points other than sRGB's and video's (PQ, HLG, P3, ...)",
        _code_points, ("colour",)),
    Row("png", "cICP|gAMA", "noted", "the encoding of video (BT.709): taken as shown", _png_video,
        ("colour",)),
    Row("png", "iCCP", "noted", "a profile that is damaged, or not of its kind of colour: left out,"
        " and what it would override counts", _png_profile, ("colour",)),
    Row("png", "gAMA|cHRM|cICP|iCCP", "silent", "gamma, primaries, code points, profile", None,
        ("numbers",)),
    Row("png", "vpAg|caNv|iDOT|dSIG|prVW|mk(BF|BS|BT|TS)", "silent", "remarks of programs"),
    Row("png", "mDC[Vv]|cLL[Ii]", "noted", "how bright its mastering display was"),
    Row("png", "oFFs", "noted", "a place on a page", _png_offset),
    Row("png", "pCAL", "noted", "a calibration of its numbers, which is not applied"),
    Row("png", "sTER", "refused", "both views of a stereo pair side by side", lambda *_: "must"
        " hold one view (it says that it holds both of a stereo pair); cut it in two"),
    Row("png", "sCAL", "noted", "a physical size of its pixels"),
    Row("png", "acTL|fcTL|fdAT", "honoured", "animation (counted as pictures)"),
    Row("png", "sRGB|pHYs|eXIf|sBIT|bKGD|hIST|tIME|sPLT|iTXt|zTXt|tEXt",
        "silent", "sRGB, pHYs, eXIf (see any), significant bits, background, texts, time"),
    Row("jpeg", r"APP0 JF(IF|XX)|APP1 (Exif|http.*)|APP12 (Ducky|PictureInfo).*"
        r"|APP13 (Photoshop|Adobe).*|APP14 Adobe.*|COM",
        "silent", "density, Exif, XMP (see any), Adobe's transform, comments"),
    Row("jpeg", "APP2 ICC_PROFILE", "silent", "colour profile (see any)"),
    Row("jpeg", "APP2 MPF", "noted", "further pictures, or a gain map: left out"),
    Row("tiff", "262", "refused", "colour of kinds other than grey, RGB, palette, CMYK, YCbCr;"
        " 0 as white in more than 8 bits",
        _tiff_kind, ("colour",)),
    Row("tiff", "262", "refused", "a palette of colours; 0 as white", _tiff_palette, ("numbers",)),
    Row("tiff", "339", "refused", "complex numbers", _tiff_sample_format),
    Row("tiff", "258", "refused", "numbers of 24 bits", _tiff_bits),
    Row("tiff", "338", "honoured", "alpha, associated or not"),
    Row("tiff", "318", "refused", "a white point other than D65", _tiff_white, ("colour",)),
    Row("tiff", "319", "refused", "primaries other than Rec.709's", _tiff_primaries, ("colour",)),
    Row("tiff", "301", "refused", "a transfer function unlike sRGB's", _tiff_curve, ("colour",)),
    Row("tiff", "318|319|301", "silent", "white point, primaries, transfer", None, ("numbers",)),
    Row("tiff", "28[67]", "silent", "a place on a page"),
    Row("tiff", "29[01]|532", "noted", "a curve of greys, reference black and white"),
    Row("tiff", "42112", "noted", "GDAL's scale and offset", _tiff_scale, ("numbers",)),
    Row("tiff", "42112|42113", "silent", "GDAL's remarks", None, ("colour",)),
    Row("tiff", "42113", "honoured", "GDAL's number for unknown", None, ("numbers",)),
    Row("tiff", "34675", "silent", "colour profile (see any)"),
    Row("tiff", "50706", "refused", "a camera's raw file (DNG)", lambda *_: "must be a developed"
        " picture (it says that it is a camera's raw file); develop it"),
    Row("tiff", _TIFF_SILENT, "silent", "layout, resolution, texts, Exif, geographic tags"),
    Row("openexr", "dataWindow|displayWindow|pixelAspectRatio", "silent", "see any"),
    Row("openexr", "chromaticities", "refused", "chromaticities other than Rec.709's",
        _exr_primaries, ("colour",)),
    Row("openexr", "chromaticities|oiio:ColorSpace|colorInteropID", "silent", "colour", None,
        ("numbers",)),
    Row("openexr", "oiio:ColorSpace|colorInteropID|colorSpace", "refused",
        "a colour space other than linear Rec.709", _colour_space, ("colour",)),
    Row("openexr", "whiteLuminance|adoptedNeutral|lookModTransform|renderingTransform"
        "|acesImageContainerFlag", "noted", "luminance of white, a look: not applied"),
    Row("openexr", "multiView", "noted", "several views: the first is taken", _views),
    Row("openexr", "view|deepImageState", "silent", "names of views, order of deep samples"),
    Row("openexr", "envmap", "noted", "an environment map", _exr_environment),
    Row("openexr", "compression", "noted", "a compression that may change numbers", _exr_lossy,
        ("numbers",)),
    Row("openexr", "compression", "silent", "compression", None, ("colour",)),
    Row("openexr", _EXR_SILENT, "silent", "layout, camera, time, remarks of programs"),
    Row("hdr", "FORMAT", "refused", "XYZ in place of RGB", _hdr_format),
    Row("hdr", "EXPOSURE|COLORCORR", "noted", "exposure and colour correction: not applied",
        _hdr_factor),
    Row("hdr", "GAMMA", "refused", "a gamma other than 1", _hdr_gamma),
    Row("hdr", "PRIMARIES", "refused", "primaries other than Radiance's or Rec.709's",
        _hdr_primaries, ("colour",)),
    Row("hdr", "PRIMARIES", "silent", "primaries", None, ("numbers",)),
    Row("hdr", "PIXASPECT", "refused", "pixels that are not square", _hdr_aspect),
    Row("hdr", "size", "refused", "lines in another order", _hdr_size),
    Row("hdr", "SOFTWARE|VIEW|CAPDATE|GMT|OWNER|CREATOR|DATE", "silent", "remarks"),
    Row("webp", "VP8|VP8L|VP8X|ALPH|ICCP|EXIF|XMP|ANIM|ANMF", "silent",
        "pixels, alpha, profile, Exif, frames (see any)"),
    Row("bmp", "bV4CSType", "noted", "a colour space of its own", _bmp_space, ("colour",)),
    Row("bmp", "bV4CSType", "silent", "colour space", None, ("numbers",)),
    Row("bmp", "pixels per metre", "refused", "pixels that are not square", _bmp_aspect),
    Row("gif", "pixel aspect", "refused", "pixels that are not square", _gif_aspect),
)  # fmt: skip


def check_statements(
    path: Path,
    kind: str,
    general: Mapping[str, Any],
    use: Sequence[Use],
    *,
    handled: Sequence[str] = (),
) -> None:
    """Refuse or note what a header says and no reader honours.

    Parameters
    ----------
    path : Path
    kind : str
        OpenImageIO's name of the format.
    general : mapping
        What OpenImageIO itself reads: the rows of ``"any"``.
    use : sequence of Use
        What the file is read for.
    handled : sequence of str
        Statements that the caller deals with.

    Raises
    ------
    InputError
        If a statement is refused.
    """
    noted: dict[str, None] = {}
    unknown: list[str] = []
    for where, statements in (("any", general), *((kind, s) for s in read_statements(path, kind))):
        for name, value in statements.items():
            if name in handled:
                continue
            rows = [row for row in _rows(where, name) if set(row.of) & set(use)]
            if not rows:
                unknown.append(f"tag {name}" if where == "tiff" else name)
            for row in rows:
                _judge(path, row, value, statements, noted)
    if kind not in WALKERS:
        noted[f"what files of {kind} say beside their pixels is not looked at"] = None
    if unknown:
        listed = ", ".join(dict.fromkeys(unknown[:_LISTED]))
        more = f" and {len(unknown) - _LISTED} more" if len(unknown) > _LISTED else ""
        noted[f"not known, and left out: {listed}{more}"] = None
    for text in noted:
        note(path, text)


def _rows(kind: str, name: str) -> list[Row]:
    """The rows about a statement; a general one stands before the ones that catch many."""
    return [row for row in ROWS if row.kind == kind and re.fullmatch(row.names, name)]


def _judge(
    path: Path, row: Row, value: Any, statements: Statements, noted: dict[str, None]
) -> None:
    if row.decision in ("honoured", "silent"):
        return
    try:
        found = row.found(value, statements)
    except (struct.error, ValueError, IndexError, TypeError, ZeroDivisionError):
        found = f"not understood, and left out: {row.words}"
        noted[found] = None
        return
    if found is None:
        return
    if row.decision == "refused":
        raise InputError(f"{path}: {found}")
    noted[found] = None


def table() -> str:
    """The rows that are not silent as a table in Markdown, for the page of docs."""
    lines = ["| format | statement | read as | is |", "| --- | --- | --- | --- |"]
    for row in ROWS:
        if row.decision == "silent":
            continue
        use = "both" if len(row.of) > 1 else row.of[0]
        names = "" if row.kind == "any" else _listed(row) + ": "
        lines.append(f"| {row.kind} | {names}{row.words} | {use} | {row.decision} |")
    return "\n".join(lines)


def _listed(row: Row) -> str:
    """A row's names as people write them."""
    plain = row.names.replace("mDC[Vv]|cLL[Ii]", "mDCV|cLLI").replace("29[01]", "290|291")
    tag = "tag " if row.kind == "tiff" else ""
    return ", ".join(f"`{tag}{name}`" for name in plain.split("|"))
