"""Every statement that a video file may make of its pictures, and what is done about it."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final, NamedTuple

from pipeline.errors import InputError
from protocols.outside import visible_line

HONOURED: Final = "honoured"
REFUSED: Final = "refused"
NOTED: Final = "noted"
UPRIGHT: Final = "export it anew, upright"
NO_CURE: Final = "export it anew, as one flat picture for both eyes"


class Row(NamedTuple):
    """A row of the table that this program and its documentation share."""

    formats: str
    statement: str
    decision: str
    happens: str
    """What happens, in words; the default of every statement is silent."""
    must: str = ""
    """For what is refused: what must hold."""
    cure: str = ""
    """For what is refused: options of FFmpeg, none where reading it is enough; or words."""


class Said(NamedTuple):
    """A statement of a file: its row, its value in words, and what the row's cure takes.

    A value `cure` stands for the row's.
    """

    statement: str
    found: str
    values: Mapping[str, object] = {}


_ALL, _MP4, _MKV = "all", "MP4, MOV", "Matroska, WebM"
_BOTH = f"{_MP4}, {_MKV}"
_TO_SRGB = (
    "-vf format=gbrp16,zscale=primariesin={primaries}:transferin={transfer}:primaries=709"
    ":transfer={to}"
)
_TO_RGB = (
    "-vf zscale=primariesin={primaries}:primaries={primaries}:transferin={transfer}"
    ":transfer={transfer}:matrix=gbr:range=full,format=gbrp"
)

ROWS: Final = (
    Row(_ALL, "pixel aspect", REFUSED, "pixels that are not square, also by the track's size",
        "must have square pixels", "-vf \"scale=trunc(iw*{aspect}/2+0.5)*2:ih,setsar=1\""),
    Row(_ALL, "turn by 90, 180 or 270 degrees", HONOURED, "frames are turned upright"),
    Row(_BOTH, "mirror image, other turn", REFUSED, "a matrix or a pose that is no quarter turn",
        "must be stored upright, or be turned by 90, 180 or 270 degrees", ""),
    Row(_ALL, "clean aperture, crop", REFUSED, "less than the stored picture is to be shown",
        "must show all of its stored picture",
        "-vf \"crop={width}:{height}:if(gt(iw\\,{width})\\,{x}\\,0)"
        ":if(gt(ih\\,{height})\\,{y}\\,0)\""),
    Row(_BOTH, "display size", NOTED, "a size other than the stored one, of the same shape: frames"
        " keep their stored size"),
    Row(_ALL, "interlacing", REFUSED, "frames of two fields, also by H.264, HEVC, MPEG-2, MPEG-4,"
        " ProRes and DV themselves", "must hold whole frames, not fields",
        "-vf bwdif=mode=send_frame:deint=interlaced,setfield=prog"),
    Row(_ALL, "colour matrix and range", HONOURED, "BT.709, BT.601, FCC, SMPTE 240M, BT.2020, RGB;"
        " limited or full. Where nothing is said: BT.601, limited"),
    Row(_ALL, "no colour matrix", NOTED, "above 576 lines, by H.264 and MPEG-4: BT.601 is taken,"
        " though some players take BT.709"),
    Row(_ALL, "colours of VP9 or AV1", NOTED, "colours that the stream itself says are not read"),
    Row(_BOTH, "other colour matrix", REFUSED, "YCgCo, ICtCp and others",
        "must have a colour matrix that is read right: BT.709, BT.601, BT.2020 or RGB", _TO_RGB),
    Row(_BOTH, "colour matrix twice", REFUSED, "the container says another one than ProRes or"
        " Motion JPEG, whose own is taken", "must say one colour matrix",
        "-vf setparams=colorspace={name}"),
    Row(_BOTH, "transfer of a display", HONOURED, "BT.709, BT.601, BT.2020 and sRGB: values are"
        " shown as they are"),
    Row(_BOTH, "gamma 2.2, gamma 2.8, SMPTE 240M, xvYCC, BT.1361", NOTED, "values are shown as"
        " they are"),
    Row(_BOTH, "PQ, HLG", NOTED, "light is mapped to what a display of sRGB shows"),
    Row(_BOTH, "other transfer", REFUSED, "linear light, logarithms, SMPTE 428 and others",
        "must be encoded for a display", _TO_SRGB),
    Row(_BOTH, "primaries of BT.470 BG, BT.601, SMPTE 240M", NOTED, "taken as those of sRGB"),
    Row(_BOTH, "other primaries", REFUSED, "BT.2020, Display P3 and others, unless with PQ or HLG",
        "must have the primaries of BT.709 and sRGB", _TO_SRGB),
    Row(_MP4, "ICC profile", NOTED, "not applied"),
    Row(_BOTH, "gamma value", NOTED, "from 1.7 to 2.8: values are shown as they are; any other is"
        " refused as another transfer"),
    Row(_BOTH, "light levels of the mastering display", NOTED, "not used"),
    Row(_BOTH, "Dolby Vision", NOTED, "only the base layer is shown"),
    Row(_BOTH, "Dolby Vision without a base layer", REFUSED, "its colours need the other data",
        "must hold colours that can be shown without Dolby Vision", "export it as HDR10 or SDR"),
    Row(_ALL, "alpha", REFUSED, "transparency, by pixel format or track", "must be opaque",
        "-vf format=gbrap,premultiply=inplace=1"),
    Row(_ALL, "more than 8 bits", NOTED, "frames are rounded to 8 bits"),
    Row(_BOTH, "chroma siting", NOTED, "chroma is taken to lie on the left, as in MPEG-2"),
    Row(_ALL, "frame times", REFUSED, "frames that do not come at the file's rate: variable rates,"
        " gaps, times given twice", "must show its frames at one rate", "-vf fps={rate}"),
    Row(_MP4, "edit list", HONOURED, "frames outside the edits are left out"),
    Row(_ALL, "late start", NOTED, "shown from its first frame on"),
    Row(_MP4, "playback speed", REFUSED, "another speed than 1", "must play at its own speed",
        "-vf setpts=PTS/{speed},fps=source_fps"),
    Row("AVI", "two frame rates", NOTED, "that of the stream is taken"),
    Row(_ALL, "length", NOTED, "more frames promised than can be read"),
    Row(_ALL, "several video tracks", REFUSED, "which one is shown would be chance",
        "must hold one video track", ""),
    Row(_ALL, "track that is switched off", NOTED, "shown all the same"),
    Row(_BOTH, "stereo", REFUSED, "two views in one frame or track", "must hold one view",
        "-vf stereo3d={name}:ml -metadata:s:v stereo_mode=mono"),
    Row(_BOTH, "spherical", REFUSED, "a panorama that is to be projected",
        "must be a flat picture, not a panorama",
        "-vf v360=input={name}:output=flat:h_fov=90:v_fov=60"),
    Row(_ALL, "sound", NOTED, "not played"),
    Row(_BOTH, "other tracks", NOTED, "subtitles, time codes, data: not used"),
    Row(_BOTH, "encryption", REFUSED, "frames that need a key", "must not be encrypted",
        "decrypt it first"),
    Row(_MKV, "ordered chapters", NOTED, "frames come in the order of the file"),
    Row(_MP4, "graphics mode", NOTED, "the picture replaces what lies behind it"),
    Row(_ALL, "titles, dates, authors, cover pictures", HONOURED, "they do not change frames"),
    Row(_ALL, "whatever else", NOTED, "not known here, so nothing is done about it"),
)  # fmt: skip
"""The table; [docs/images.md] shows it."""

_ROWS = {row.statement: row for row in ROWS}


def judged(path: Path, said: Iterable[Said]) -> list[str]:
    """Return notes of what a file says, or refuse it.

    Raises
    ------
    InputError
        At the first statement whose row says so, with a command of FFmpeg that mends the file.
    """
    notes: dict[str, None] = {}
    for statement, found, values in said:
        row, found = _ROWS[statement], visible_line(found)
        if row.decision == REFUSED:
            raise InputError(f"{path}: {row.must} ({found}); {_cure(path, row, values)}")
        if row.decision == NOTED:
            notes[f"{found}: {row.happens}"] = None
    return list(notes)


def _cure(path: Path, row: Row, values: Mapping[str, object]) -> str:
    cure = str(values.get("cure", row.cure))
    if cure and not cure.startswith("-"):
        return cure
    mended = path.with_name(f"{path.stem}-mended.mov")
    words = ["ffmpeg", str(values.get("decoder", "")), "-i", shlex.quote(str(path))]
    words += ["-map 0:v:0 -map_metadata -1", cure.format_map({"aspect": "sar", **values})]
    words += ["-c:v ffv1 -pix_fmt bgr0", shlex.quote(str(mended))]
    return "this makes such a file: " + " ".join(filter(None, words))
