"""Table of what pictures and videos may say, with the judges of their statements.

A judge finds words for what a value says, or None where it is at its default.
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from PIL import Image, ImageCms

from pipeline.statements.row import Judge, Row, Use, but

Statements = Mapping[str, Any]

_REC709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06)
_D65 = (0.3127, 0.329)
_RADIANCE = (0.64, 0.33, 0.29, 0.6, 0.15, 0.06, 0.333, 0.333)
_PRIMARIES_APART = 0.005  # of a coordinate; writers round to three or four digits
_GAMMA = 1 / 2.2
_GAMMA_APART = 0.02  # of it
_VIDEO_GAMMA = 0.50994  # what FFmpeg writes for the transfer of BT.709
_VIDEO_CODES = tuple((1, transfer, 0, 1) for transfer in (1, 6, 14, 15))  # shown as in videos
_MOST_OF_PROFILE = 1 << 24  # bytes
_ASPECT_APART = 0.01
_SRGB_APART = 2  # of 255, between a profile's colours and sRGB's
_TONE_APART = 12  # of 255, between a profile's greys and sRGB's; of a gamma of 2.2: 9, of 1.8: 19
_CURVE_APART = 0.05  # of light, at half of the code
_LINEAR = re.compile(r"(scene_)?lin(ear)?\b.*|lin_(rec709|srgb).*|scene[-_ ]?linear.*", re.I)
_WIDE = re.compile(r"aces|ap0|ap1|p3|2020|xyz|adobe|prophoto|log", re.I)
_ENCODED = re.compile(r"srgb|rec[-_. ]?709", re.I)


def _named(words: str, names: Mapping[object, str]) -> Judge:
    """Return the judge of a value that says nothing but these."""
    return lambda value, _all: words.format(names[value]) if value in names else None


def _aspect(value: Any, _all: Statements) -> str | None:
    ratio = float(value)
    near = ratio <= 0 or abs(ratio - 1) <= _ASPECT_APART
    return None if near else f"its header says {ratio:g} to 1"


def _primaries(values: Sequence[float], white: Sequence[float]) -> str | None:
    wanted = (*_REC709[: len(values)], *_D65[: len(white)])
    apart = max(abs(a - b) for a, b in zip((*values, *white), wanted, strict=False))
    if apart <= _PRIMARIES_APART:
        return None
    return f"its header says {', '.join(f'{number:.4g}' for number in (*values, *white))}"


# ---- PNG


def _overridden(everything: Statements) -> bool:
    """True if a statement that says more of the colour counts instead."""
    profile = everything.get("iCCP")
    usable = profile is not None and _png_profile(profile, everything) is None
    return usable or "sRGB" in everything or "cICP" in everything


def _png_profile(value: bytes, everything: Statements) -> str | None:
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
    return "its colour profile is damaged or of another kind of colour"


def _png_video(value: bytes, everything: Statements) -> str | None:
    near = abs(int.from_bytes(value) / 1e5 - _VIDEO_GAMMA) <= 1e-3
    said = tuple(value) in _VIDEO_CODES or (near and not _overridden(everything))
    return "it says that it is encoded as video (BT.709)" if said else None


def _png_gamma(value: bytes, everything: Statements) -> str | None:
    gamma = struct.unpack(">I", value)[0] / 1e5
    if _overridden(everything) or abs(gamma / _GAMMA - 1) <= _GAMMA_APART:
        return None
    if abs(gamma - _VIDEO_GAMMA) <= 1e-3:
        return None
    kind = "linear light" if gamma == 1 else f"light to the power {gamma:g}"
    return f"its gAMA chunk says {kind}"


def _png_primaries(value: bytes, everything: Statements) -> str | None:
    numbers = [number / 1e5 for number in struct.unpack(">8I", value)]
    return None if _overridden(everything) else _primaries(numbers[2:], numbers[:2])


def _code_points(value: Sequence[int], _all: Statements) -> str | None:
    known = tuple(value[:4]) in ((1, 13, 0, 1), *_VIDEO_CODES)
    return None if known else f"its header says code points {', '.join(map(str, value[:4]))}"


def _png_offset(value: bytes, _all: Statements) -> str | None:
    place = struct.unpack_from(">ii", value)
    return f"it lies at {place[0]}, {place[1]}" if any(place) else None


def _png_palette(value: bytes, everything: Statements) -> str | None:
    indexed = everything.get("IHDR", b"")[9:10] == b"\3"
    grey = value[::3] == value[1::3] == value[2::3]
    return "they are places in a palette of colours" if indexed and not grey else None


def _late_exif(value: bytes, _all: Statements) -> str | None:
    said = Image.Exif()
    said.load(value)
    return but("its Exif orientation is {}", 0, 1)(said.get(274, 1), {})


# ---- TIFF


def _bits(everything: Statements) -> int:
    return int(everything.get("tag 258", (1,))[0])


def _tiff_subfile(value: Any, _all: Statements) -> str | None:
    kinds = [word for bit, word in ((1, "a reduced copy"), (4, "a mask")) if value[0] & bit]
    return f"it says that it is {' and '.join(kinds)} of another one" if kinds else None


def _tiff_range(value: Any, everything: Statements) -> str | None:
    ends = {0, 2 ** _bits(everything) - 1}
    numbers = all(isinstance(number, int) for number in value)
    return f"its header says {value[0]}" if numbers and not set(value) <= ends else None


def _tiff_black_and_white(value: Any, everything: Statements) -> str | None:
    followed = everything.get("tag 262", (0,))[0] == 6  # by libtiff
    plain = followed or value[:6] == (0, 255) * 3
    return None if plain else f"its header says {', '.join(f'{number:g}' for number in value[:6])}"


def _tiff_palette(value: Any, everything: Statements) -> str | None:
    entries = everything.get("tag 320", ())
    third = len(entries) // 3
    grey = entries[:third] == entries[third : 2 * third] == entries[2 * third :]
    return "they are places in a palette of colours" if value[0] == 3 and not grey else None


def _tiff_deep_white(value: Any, everything: Statements) -> str | None:
    said = value[0] == 0 and _bits(everything) > 8
    return "it says that 0 is white" if said else None


def _tiff_curve(value: Any, everything: Statements) -> str | None:
    half = value[min(2 ** _bits(everything) // 2, len(value) - 1)] / 65535
    if abs(half - 0.2159) <= _CURVE_APART:
        return None
    return f"its transfer function shows half of the code as {half:.2f} of the light"


def _tiff_scale(value: bytes, _all: Statements) -> str | None:
    text = value.decode("utf-8", "replace")
    found = dict(re.findall(r'role="(scale|offset)"[^>]*>\s*([-+.\deE]+)', text))
    if float(found.get("scale", 1)) == 1 and float(found.get("offset", 0)) == 0:
        return None
    return f"its header says {', '.join(f'{name} {number}' for name, number in found.items())}"


# ---- OpenEXR, Radiance and others


def _exr_views(value: Any, _all: Statements) -> str | None:
    if isinstance(value, bytes):  # of each its length, then its name
        value = [word for word in re.split(r"[\x00-\x1f]+", value.decode("latin-1")) if word]
    return f"it holds the views {', '.join(value)}" if len(value) > 1 else None


def _encoded_space(value: Any, _all: Statements) -> str | None:
    text = str(value)
    return None if _linear(text) or not _ENCODED.search(text) else f"it says {text[:40]!r}"


def _wide_space(value: Any, _all: Statements) -> str | None:
    text = str(value)
    return None if _linear(text) or _ENCODED.search(text) else f"it says {text[:40]!r}"


def _linear(text: str) -> bool:
    return bool(_LINEAR.fullmatch(text)) and not _WIDE.search(text)


def _other_space(value: Any, _all: Statements) -> str | None:
    known = re.search(r"srgb|rec\.?709|^$", str(value), re.I) and not _WIDE.search(str(value))
    return None if known else f"its colour space is {str(value)[:40]!r}"


def _hdr_factor(value: Any, _all: Statements) -> str | None:
    plain = all(float(word) == 1 for word in str(value).split())
    return None if plain else f"its exposure or colour correction is {value}"


def _hdr_primaries(value: Any, _all: Statements) -> str | None:
    numbers = [float(word) for word in str(value).split()]
    own = len(numbers) == 8 and np.allclose(numbers, _RADIANCE, rtol=0, atol=_PRIMARIES_APART)
    return None if own else _primaries(numbers[:6], numbers[6:8])


def _bmp_aspect(value: Any, everything: Statements) -> str | None:
    across, down = value
    return _aspect(across / down, everything) if across > 0 and down > 0 else None


# ---- colour profiles


def _exif_space(value: Any, everything: Statements) -> str | None:
    plain = int(value) == 1 or "ICCProfile" in everything
    return None if plain else "its Exif says another colour space (Adobe RGB?)"


def _in_xmp(value: bytes, name: bytes) -> str:
    """Text of one name in XMP, as an attribute or an element; empty where it says nothing."""
    found = re.search(name + rb"(?:\s*=\s*[\"']|>\s*)([\w-]+)", value)
    return "" if found is None else found[1].decode("latin-1")


def _xmp_orientation(value: bytes, everything: Statements) -> str | None:
    said = _in_xmp(value, b"tiff:Orientation")
    plain = said in ("", "0", "1", str(everything.get("Orientation", 1)))
    return None if plain else f"its XMP says the orientation {said}"


def _xmp_panorama(value: bytes, _all: Statements) -> str | None:
    said = _in_xmp(value, b"GPano:ProjectionType")
    return f"its XMP says the projection {said}" if said else None


def _profile(value: Any, _all: Statements) -> str | None:
    name, tone, colour = _apart_from_srgb(bytes(value))
    if colour is None:
        return None if "sRGB" in name else f"its colour profile says {name!r}"
    if max(tone or 0, colour) <= _SRGB_APART:
        return None
    return f"its colour profile says {name!r} (up to {colour} of 255 off)"


def _profile_greys(value: Any, _all: Statements) -> str | None:
    name, tone, _ = _apart_from_srgb(bytes(value))
    if tone is None or tone <= _TONE_APART:
        return None
    return f"its colour profile {name!r} shows greys up to {tone} of 255 off"


def _apart_from_srgb(data: bytes) -> tuple[str, int | None, int | None]:
    """A profile's name, and how far its greys and all its colours are from sRGB's, of 255."""
    name = "which cannot be read"
    try:
        opened = ImageCms.ImageCmsProfile(io.BytesIO(data))
        name = ImageCms.getProfileDescription(opened).strip()
        mode = {"RGB": "RGB", "GRAY": "L"}[opened.profile.xcolor_space.strip()]
        steps = np.linspace(0, 255, 17).round().astype(np.uint8)
        grey = np.repeat(steps[:, None], 3, axis=-1)
        every = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
        asked = np.concatenate([grey, every] if mode == "RGB" else [grey])
        given = Image.fromarray(asked[None] if mode == "RGB" else asked[None, :, 0])
        relative = ImageCms.Intent.RELATIVE_COLORIMETRIC
        srgb = ImageCms.createProfile("sRGB")
        change = ImageCms.buildTransform(opened, srgb, mode, "RGB", renderingIntent=relative)
        shown = np.asarray(ImageCms.applyTransform(given, change), np.int64)[0]
    except (ImageCms.PyCMSError, OSError, ValueError, KeyError):
        return name, None, None
    apart = np.abs(shown - asked)
    return name, int(apart[: len(grey)].max()), int(apart.max())


# ---- the table

_SQUARE = "must have square pixels; resample it to square ones"
_SRGB = "must hold sRGB colour; convert it to sRGB, and save it as that"
_PRIMARIES = (
    "must have the primaries and white of Rec.709 and sRGB; convert it to Rec.709 primaries, and"
    " save it as that"
)
_PALETTE = "must hold numbers; write the numbers anew"
_BLACK_IS_0 = "must store 0 as black; write it again as MinIsBlack"
_COLOUR: Sequence[Use] = ("colour",)
_NUMBERS: Sequence[Use] = ("numbers",)
_LAYOUT = (
    "25[679]|26[36]|269|27[0-3]|27[7-9]|28[2-9]|29[67]|305|306|31[5-7]|32[0-5]|33[0-46]"
    "|347|51[2-9]|52[0-1]|529|53[0-1]|700|33432|33550|33723|33922|34264|34377|3473[5-7]|34853|34665"
    "|37724|50341|4027[0-9]|270|271|272|274|34675"
)
_REMARKS = (
    "channels|lineOrder|screenWindow(Center|Width)|tiles|type|name|version|chunkCount|preview|owner"
    "|maxSamplesPerPixel|comments|capDate|utcOffset|longitude|latitude|altitude|focus|expTime|iso.*"
    "|aperture|framesPerSecond|imageCounter|reelName|timeCode|keyCode|wrapmodes|dwaCompressionLevel"
    "|originalDataWindow|worldTo(Camera|NDC|clip)|sensor.*|camera.*|lens.*|shutter.*|nominal.*|Scene"
    "|(effective|pin|entrance).*|capture.*|software.*|Software|HostComputer|DateTime|Exif:.*|File"
    "|Copyright|Artist|ImageDescription|Date|Time|Frame|FrameRange|Camera|RenderTime|Note|Marker"
    "|Memory|Hostname|Strip|SequencerStrip|BlenderMultiChannel|rgbCompat|ID|openexr:.*|metamerlab:.*"
    "|Make|Model|Keywords|DocumentName|fovcot|textureformat|XResolution|YResolution|ResolutionUnit"
    "|(nuke|unreal|arnold|cryptomatte|exr|input|rman|render|vray|houdini|maya|blender|smpte|cycles"
    "|karma|redshift|octane|corona|mitsuba|pbrt)\\w*([/.:].*)?|dataWindow|displayWindow|view"
    "|(oiio|jpeg|tiff|pnm|png|dpx|IPTC|GPS|XMP|xmp|photoshop|ICCProfile):.*|pixelAspectRatio"
    "|deepImageState"
)
COLOUR_SPACES: Final = ("oiio:ColorSpace", "colorInteropID", "colorSpace")
"""Statements of floats; they say what `pipeline.pictures.colour_file.Transfer` says."""

_PICTURES = (
    Row("any", "Orientation", "refused", "must be stored upright; turn it and save it again",
        but("its Exif orientation is {}", 0, 1)),
    Row("any", "PixelAspectRatio", "refused", _SQUARE, _aspect),
    Row("any", "ICCProfile greys", "refused", _SRGB, _profile_greys, _COLOUR),
    Row("any", "ICCProfile", "noted", "a profile other than sRGB's; taken as sRGB", _profile,
        _COLOUR),
    Row("any", "Exif:ColorSpace", "noted", "Adobe RGB; taken as sRGB", _exif_space, _COLOUR),
    Row("any", "several pictures", "refused", "must hold one picture; save the one that is meant",
        lambda count, _: f"it holds several, {count}" if count > 1 else None),
    Row("any", "CICP", "refused", _SRGB, _code_points, _COLOUR),
    Row("any", "colour space", "refused", _SRGB, _other_space, _COLOUR),
    Row("any", "deep pixels", "refused", "must hold one value a pixel; flatten it"),
    Row("any", "small data window", "refused", "must store its whole display window; render or save"
        " it whole, without a crop or a render region"),
    Row("any", "large data window", "noted", "what lies around the display window is cut off"),
    Row("any", "XMP", "noted", "an orientation that only XMP says: not turned", _xmp_orientation),
    Row("any", "XMP", "noted", "a panorama; taken for a flat picture", _xmp_panorama, _COLOUR),
    Row("png", "IHDR|IDAT|IEND", "honoured", "size, bits, interlacing"),
    Row("png", "PLTE", "honoured", "a palette", None, _COLOUR),
    Row("png", "PLTE", "refused", _PALETTE, _png_palette, _NUMBERS),
    Row("png", "tRNS", "honoured", "transparency"),
    Row("png", "gAMA", "refused", _SRGB, _png_gamma, _COLOUR),
    Row("png", "cHRM", "refused", _PRIMARIES, _png_primaries, _COLOUR),
    Row("png", "cICP", "refused", _SRGB, _code_points, _COLOUR),
    Row("png", "cICP|gAMA", "noted", "the encoding of video, BT.709; taken as shown, as video is",
        _png_video, _COLOUR),
    Row("png", "iCCP", "noted", "a damaged profile, or one of another kind of colour; it is left"
        " out, and what it would override counts", _png_profile, _COLOUR),
    Row("png", "vpAg|caNv|iDOT|dSIG|prVW|mk(BF|BS|BT|TS)|sRGB|pHYs|eXIf|sBIT|bKGD|hIST|tIME|sPLT"
        "|iTXt|zTXt|tEXt", "honoured"),
    Row("png", "late eXIf", "refused", "must be stored upright; turn it and save it again",
        _late_exif),
    Row("png", "mDCV|mDCv|cLLI|cLLi", "noted", "how bright its mastering display was: not used"),
    Row("png", "oFFs", "noted", "a place on a page: not used", _png_offset),
    Row("png", "pCAL", "noted", "a calibration of its numbers: not applied"),
    Row("png", "sTER", "refused", "must hold one view; cut it in two"),
    Row("png", "sCAL", "noted", "a physical size of its pixels: not used"),
    Row("png", "acTL|fcTL|fdAT", "honoured", "an animation, counted as pictures"),
    Row("jpeg", r"APP0 JF(IF|XX)|APP1 (Exif|http.*)|APP12 (Ducky|PictureInfo).*|APP2 ICC_PROFILE"
        r"|APP13 (Photoshop|Adobe).*|APP14 Adobe.*|COM", "honoured"),
    Row("jpeg", "APP2 MPF", "noted", "further pictures, or a gain map: left out"),
    Row("tiff", "tag 254", "refused", "must hold the picture itself; save the picture that it"
        " belongs to", _tiff_subfile),
    Row("tiff", "tag 255", "refused", "must hold the picture itself; save the picture that it"
        " belongs to", _named("it says that it is {}", {(2,): "a reduced one"})),
    Row("tiff", "tag 280|tag 281|tag 340|tag 341", "noted", "its least and largest number: white is"
        " the largest one of its type all the same", _tiff_range, _COLOUR),
    Row("tiff", "tag 262", "refused", "must hold grey, RGB, CMYK or YCbCr; convert it",
        but("its photometric kind is {[0]}", (0,), (1,), (2,), (3,), (5,), (6,)), _COLOUR),
    Row("tiff", "tag 262", "refused", _BLACK_IS_0, _tiff_deep_white, _COLOUR),
    Row("tiff", "tag 262", "refused", _BLACK_IS_0,
        lambda kind, _: "it says that 0 is white" if kind[0] == 0 else None, _NUMBERS),
    Row("tiff", "tag 262", "refused", _PALETTE, _tiff_palette, _NUMBERS),
    Row("tiff", "tag 339", "refused", "must hold real numbers; write one real number a pixel",
        lambda kind, _: None if kind[0] in (1, 2, 3, 4) else "they are complex"),
    Row("tiff", "tag 258", "refused", "must store numbers of 8, 16 or 32 bits; save it anew",
        lambda bits, _: "has 24, which are not read right" if bits[0] == 24 else None),
    Row("tiff", "tag 338", "honoured", "alpha, associated or not"),
    Row("tiff", "tag 318", "refused", _PRIMARIES, lambda value, _: _primaries((), value[:2]),
        _COLOUR),
    Row("tiff", "tag 319", "refused", _PRIMARIES, lambda value, _: _primaries(value[:6], ()),
        _COLOUR),
    Row("tiff", "tag 301", "refused", _SRGB, _tiff_curve, _COLOUR),
    Row("tiff", "tag 290|tag 291", "noted", "a curve of greys: not applied"),
    Row("tiff", "tag 532", "noted", "black and white of other numbers, but of YCbCr: not applied",
        _tiff_black_and_white, _COLOUR),
    Row("tiff", "tag 42112", "noted", "GDAL's scale and offset; the options of the units apply one",
        _tiff_scale, _NUMBERS),
    Row("tiff", "tag 42113", "honoured", "GDAL's number for unknown", None, _NUMBERS),
    Row("tiff", "tag 50706", "refused", "must be a developed picture; develop it"),
    Row("tiff", f"tag ({_LAYOUT})", "honoured"),
    Row("openexr", "chromaticities", "refused", _PRIMARIES,
        lambda value, _: _primaries(value[:6], value[6:8]), _COLOUR),
    Row("openexr", "|".join(COLOUR_SPACES), "refused", "must hold light; save it as PNG, or say"
        " that it is encoded: --encoded of warp and foveate, transfer = 'linear' in a study",
        _encoded_space, _COLOUR),
    Row("openexr", "|".join(COLOUR_SPACES), "refused", _PRIMARIES, _wide_space, _COLOUR),
    Row("openexr", "acesImageContainerFlag", "refused", _PRIMARIES,
        but("it says that it is an ACES container", (0,)), _COLOUR),
    Row("openexr", "whiteLuminance|adoptedNeutral|lookModTransform|renderingTransform", "noted",
        "luminance of white, a look: not applied"),
    Row("openexr", "multiView", "noted", "several views; the first is taken", _exr_views),
    Row("openexr", "envmap", "noted", "an environment map; taken for a flat picture"),
    Row("openexr", "compression", "noted", "a compression that may have changed numbers",
        _named("its compression is {}", {5: "pxr24", 6: "b44", 7: "b44a", 8: "dwaa", 9: "dwab"}),
        _NUMBERS),
    Row("openexr", _REMARKS, "honoured"),
    Row("hdr", "FORMAT", "refused", "must hold RGB; convert it",
        lambda kind, _: None if "rgbe" in kind else f"its format is {kind[:40]}"),
    Row("hdr", "EXPOSURE|COLORCORR", "noted", "exposure and colour correction: not applied",
        _hdr_factor),
    Row("hdr", "GAMMA", "refused", "must hold light; convert it",
        lambda gamma, _: None if float(gamma) == 1 else f"its gamma is {gamma}"),
    Row("hdr", "PRIMARIES", "refused", _PRIMARIES, _hdr_primaries, _COLOUR),
    Row("hdr", "PIXASPECT", "refused", _SQUARE, lambda value, _: _aspect(value.split()[0], {})),
    Row("hdr", "size", "refused", "must run by rows from the top; save it again like that",
        but("its size line says {}", "-Y +X")),
    Row("hdr", "SOFTWARE|VIEW|CAPDATE|GMT|OWNER|CREATOR|DATE", "honoured"),
    Row("webp", "VP8|VP8L|VP8X|ALPH|ICCP|EXIF|ANIM|ANMF", "honoured"),
    Row("bmp", "bV4CSType", "noted", "a colour space of its own; taken as sRGB",
        but("its colour space is {!r}", b"sRGB", b"Win ", bytes(4)), _COLOUR),
    Row("bmp", "pixels per metre", "refused", _SQUARE, _bmp_aspect),
    Row("gif", "pixel aspect", "refused", _SQUARE,
        lambda value, _: _aspect((value + 15) / 64, {}) if value else None),
)  # fmt: skip

_MP4, _MKV = "video (MP4, MOV)", "video (Matroska, WebM)"
_BOTH = "video (MP4, MOV, Matroska, WebM)"
_TO_SRGB = (
    "-vf format=gbrp16,zscale=primariesin={primaries}:transferin={transfer}:primaries=709"
    ":transfer={to}"
)
_PADDING = "free|skip|wide"
# Of videos, a cure that begins with - is options of FFmpeg, none where reading it is enough.
_VIDEOS = (
    Row("video", "pixel aspect", "refused", "must have square pixels; -vf"
        " scale=trunc(iw*{aspect}/2+0.5)*2:ih,setsar=1"),
    Row("video", "turn by 90, 180 or 270 degrees", "honoured", "frames are turned upright"),
    Row(_BOTH, "mirror image, other turn", "refused", "must be stored upright, or be turned by 90,"
        " 180 or 270 degrees"),
    Row("video", "clean aperture, crop", "refused", "must show all of its stored picture; -vf"
        " crop={width}:{height}:if(gt(iw\\,{width})\\,{x}\\,0):if(gt(ih\\,{height})\\,{y}\\,0)"),
    Row(_BOTH, "display size", "noted", "a size other than the stored one, of the same shape:"
        " frames keep their stored size"),
    Row("video", "interlacing", "refused", "must hold whole frames, not fields; -vf"
        " bwdif=mode=send_frame:deint=interlaced,setfield=prog"),
    Row("video", "colour matrix and range", "honoured", "BT.709, BT.601, FCC, SMPTE 240M, BT.2020,"
        " RGB; limited or full. Where nothing is said: BT.601, limited"),
    Row("video", "no colour matrix", "noted", "above 576 lines, by H.264 and MPEG-4: BT.601 is"
        " taken, though some players take BT.709"),
    Row("video", "colours of AV1", "noted", "colours that the stream itself says are not read"),
    Row(_BOTH, "other colour matrix", "refused", "must have a colour matrix that is read right:"
        " BT.709, BT.601, BT.2020 or RGB; -vf zscale=primariesin={primaries}:primaries={primaries}"
        ":transferin={transfer}:transfer={transfer}:matrix=gbr:range=full,format=gbrp"),
    Row(_BOTH, "colour matrix twice", "refused", "must say one colour matrix; -vf"
        " setparams=colorspace={name}"),
    Row(_BOTH, "transfer of a display", "honoured", "BT.709, BT.601, BT.2020 and sRGB: values are"
        " shown as they are"),
    Row(_BOTH, "gamma 2.2, gamma 2.8, SMPTE 240M, xvYCC, BT.1361", "noted",
        "values are shown as they are"),
    Row(_BOTH, "PQ, HLG", "noted", "light is mapped to what a display of sRGB shows"),
    Row(_BOTH, "other transfer", "refused", f"must be encoded for a display; {_TO_SRGB}"),
    Row(_BOTH, "primaries of BT.470 BG, BT.601, SMPTE 240M", "noted", "taken as those of sRGB"),
    Row(_BOTH, "other primaries", "refused",
        f"must have the primaries of BT.709 and sRGB; {_TO_SRGB}"),
    Row(_MP4, "ICC profile", "noted", "not applied"),
    Row(_BOTH, "gamma value", "noted", "from 1.7 to 2.8: values are shown as they are; any other is"
        " refused as another transfer"),
    Row(_BOTH, "light levels of the mastering display", "noted", "not used"),
    Row(_BOTH, "Dolby Vision", "noted", "only the base layer is shown"),
    Row(_BOTH, "Dolby Vision without a base layer", "refused", "must hold colours that can be shown"
        " without Dolby Vision; export it as HDR10 or SDR"),
    Row("video", "alpha", "refused", "must be opaque; -vf format=gbrap,premultiply=inplace=1"),
    Row("video", "more than 8 bits", "noted", "frames are rounded to 8 bits"),
    Row(_BOTH, "chroma siting", "noted", "chroma is taken to lie on the left, as in MPEG-2"),
    Row("video", "frame times", "refused", "must show its frames at one rate; -vf fps={rate}"),
    Row(_MP4, "edit list", "honoured", "frames outside the edits are left out"),
    Row("video", "late start", "noted", "shown from its first frame on"),
    Row(_MP4, "playback speed", "refused", "must play at its own speed; -vf"
        " setpts=PTS/{speed},fps=source_fps"),
    Row("video (AVI)", "two frame rates", "noted", "that of the stream is taken"),
    Row("video", "no frames", "refused", "must have frames that can be decoded"),
    Row("video", "length", "noted", "more frames promised than can be read"),
    Row("video", "several video tracks", "refused", "must hold one video track"),
    Row("video", "track that is switched off", "noted", "shown all the same"),
    Row(_BOTH, "stereo", "refused", "must hold one view; -vf stereo3d={name}:ml -metadata:s:v"
        " stereo_mode=mono"),
    Row(_BOTH, "spherical", "refused", "must be a flat picture, not a panorama; -vf"
        " v360=input={name}:output=flat:h_fov=90:v_fov=60"),
    Row("video", "sound", "noted", "not played"),
    Row(_BOTH, "other tracks", "noted", "subtitles, time codes, data: not used"),
    Row(_BOTH, "encryption", "refused", "must not be encrypted; decrypt it first"),
    Row(_MKV, "ordered chapters", "noted", "frames come in the order of the file"),
    Row(_MP4, "graphics mode", "noted", "the picture replaces what lies behind it"),
    Row("video", "titles, dates, authors, cover pictures", "honoured", "they do not change frames"),
    Row("video", "whatever else", "noted", "not known here, so nothing is done about it"),
    # Boxes, elements and chunks that say nothing of the picture, or what FFmpeg follows.
    Row("MP4: the file", f"ftyp|mdat|moov|moof|mfra|sidx|ssix|styp|prft|emsg|pdin|meta|{_PADDING}",
        "honoured"),
    Row("MP4: the movie", f"mvhd|trak|udta|meta|mvex|iods|{_PADDING}", "honoured"),
    Row("MP4: the video track", f"tkhd|mdia|edts|udta|meta|tref|load|tapt|{_PADDING}", "honoured"),
    Row("MP4: the video's media", f"mdhd|hdlr|minf|elng|udta|meta|{_PADDING}", "honoured"),
    Row("MP4: the video's media information", f"vmhd|hdlr|dinf|stbl|gmhd|{_PADDING}", "honoured"),
    Row("MP4: the video's tables", "stsd|stts|ctts|stss|stsc|stsz|stz2|stco|co64|sdtp|sbgp|sgpd"
        f"|cslg|stsh|subs|padb|stdp|stps|saiz|saio|{_PADDING}", "honoured"),
    Row("MP4: the video's coding", "avcC|hvcC|vvcC|av1C|vpcC|esds|d263|glbl|dvc1|jp2h|APRG|ARES"
        f"|ACLR|AORD|btrt|strf|{_PADDING}", "honoured"),
    Row("MP4: the user data", "\xa9.*|meta|name|kywd|cprt|titl|auth|dscp|perf|gnre|albm|yrrc|rtng"
        f"|clsf|loci|hnti|hinf|tsel|tagc|date|chpl|XMP_|{_PADDING}", "honoured"),
    Row("Matroska: the file", "1A45DFA3|18538067|114D9B74|1549A966|1654AE6B|1F43B675|1C53BB6B"
        "|1941A469|1043A770|1254C367|EC|BF", "honoured"),
    Row("Matroska: the segment's information", "2AD7B1|4489|7BA9|4D80|5741|4461|73A4|7384|4444|6924"
        "|EC|BF", "honoured"),
    Row("Matroska: the video track", "D7|73C5|83|88|55A[A-F]|9C|6DE7|23314F|6DF8|23E383|55EE|536E"
        "|22B59C|22B59D|86|63A2|258688|7446|AA|56AA|56BB|6624|EC|BF", "honoured"),
    Row("Matroska: the video's settings", "B0|BA|54B[0234A]|2EB524|2383E3|54CC|54BB|54DD"
        "|54AA|EC|BF", "honoured"),
    Row("Matroska: the video's colour", "55B[1-9AB]|EC|BF", "honoured"),
    Row("AVI: the file", "hdrl|movi|idx1|JUNK|INFO|junk", "honoured"),
    Row("AVI: the header", "avih|strl|odml|JUNK|junk", "honoured"),
    Row("AVI: the video stream", "strh|strf|strd|strn|indx|vprp|JUNK|junk", "honoured"),
)  # fmt: skip

ROWS: Final = (*_PICTURES, *_VIDEOS)
"""The table of pictures and videos; docs/formats/headers.md shows it."""
