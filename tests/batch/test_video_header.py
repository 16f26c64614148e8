"""What a video's header says is honoured, refused with a cure that works, or noted."""

from __future__ import annotations

import shlex
import shutil
import struct
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from video_patch import (
    MP4_ENTRY,
    SEGMENT,
    SIZE,
    TRACK,
    TRACKS,
    VIDEO,
    box,
    chunk,
    element,
    in_mp4,
    patched,
    picture,
    without,
    write,
)

from pipeline.errors import InputError
from pipeline.methods.frames import FramesOnDisk
from pipeline.video_file import VideoFrames
from pipeline.video_header.coding import of_pixel_format, of_stream
from pipeline.video_header.statements import HONOURED, NOTED, REFUSED, ROWS
from stimuli.read_file import read_frames, stated
from stimuli.video import unpacked_video

FRAMES = [picture(number) for number in range(6)]
CODECS = {".mp4": "mp4v", ".mov": "MJPG", ".mkv": "FFV1", ".avi": "FFV1", ".webm": "VP80"}
ENTRY, TRAK = MP4_ENTRY, ("moov", "trak")
MKV_VIDEO, MKV_TRACK = (SEGMENT, TRACKS, TRACK, VIDEO), (SEGMENT, TRACKS, TRACK)
STREAM = ("AVI ", "hdrl", "strl")
DECISIONS = {row.statement: row.decision for row in ROWS}
FFMPEG = shutil.which("ffmpeg")


@dataclass(frozen=True)
class Case:
    """A statement, how a file is made to say it, and a part of the message."""

    statement: str
    ending: str
    place: tuple[str, ...] | tuple[int, ...]
    change: Callable[[bytes], bytes]
    said: str
    mends: bool = True
    """Whether FFmpeg can make it good."""


def add(data: bytes) -> Callable[[bytes], bytes]:
    return lambda inner: inner + data


def put(name: int, data: bytes | int) -> Callable[[bytes], bytes]:
    return lambda inner: without(inner, name) + element(name, data)


def bytes_at(at: int, data: bytes) -> Callable[[bytes], bytes]:
    return lambda inner: inner[:at] + data + inner[at + len(data) :]


def matrix(*numbers: float) -> bytes:
    """The linear part of a track's matrix, as its header has it."""
    a, b, c, d = (round(number * 65536) for number in numbers)
    return struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30)


def turned(*numbers: float) -> Case:
    quarter = 0 in numbers[:1] or numbers == (-1, 0, 0, -1)
    name = "turn by 90, 180 or 270 degrees" if quarter else "mirror image, other turn"
    return Case(name, ".mp4", (*TRAK, "tkhd"), bytes_at(40, matrix(*numbers)), "its matrix")


def nclx(*codes: int) -> bytes:
    return box("colr", b"nclx" + struct.pack(">3HB", *codes, 0))


def clap(*numbers: int) -> bytes:
    pairs = [value for number in numbers for value in (number, 1)]
    return box("clap", struct.pack(">4I", *pairs[:4]) + struct.pack(">iIiI", *pairs[4:]))


def edits(*entries: tuple[int, int, float]) -> Callable[[bytes], bytes]:
    """An edit list of (length in ms, first frame or -1, speed)."""
    rows = [
        struct.pack(">Iii", length, start if start < 0 else start * 512, round(speed * 65536))
        for length, start, speed in entries
    ]
    new = box("edts", box("elst", struct.pack(">II", 0, len(rows)) + b"".join(rows)))
    return lambda inner: new + in_mp4(inner, ("edts",), lambda _: b"").replace(box("edts"), b"")


def other_track(kind: bytes, rest: bytes = b"") -> Callable[[bytes], bytes]:
    """Add an MP4 track of another kind, without frames."""
    media = box("hdlr", b"\0" * 8 + kind + b"\0" * 13) + rest
    return add(box("trak", box("mdia", media)))


def mkv_track(kind: int, codec: bytes, rest: bytes = b"") -> Callable[[bytes], bytes]:
    parts = element(0xD7, 2) + element(0x73C5, 2) + element(0x83, kind) + element(0x86, codec)
    return add(element(TRACK, parts + rest))


def floats(value: float) -> bytes:
    return struct.pack(">f", value)


def vprp(across: int, down: int, fields: int = 1, crop: int = 0) -> Callable[[bytes], bytes]:
    head = struct.pack("<5IHHIII", 0, 0, 60, 64, 48, down, across, 64, 48, fields)
    rect = struct.pack("<8I", 48, 64, 48, 64 - crop, 0, 0, 0, 0)
    return lambda inner: in_avi_without(inner) + chunk("vprp", head + rect * fields)


def in_avi_without(inner: bytes) -> bytes:
    at = inner.find(b"vprp")
    return (
        inner
        if at < 0
        else inner[:at] + inner[at + 8 + int.from_bytes(inner[at + 4 : at + 8], "little") :]
    )


def dolby(compatible: int) -> bytes:
    return box("dvcC", bytes([1, 0, 5 << 1, 0, compatible << 4]) + b"\0" * 19)


SPHERICAL_V1 = bytes.fromhex("ffcc8263f8554a938814587a02521fdd")
EYES = box("vexu", box("eyes", box("stri", b"\0\0\0\0\3")))
SPHERE = box("sv3d", box("proj", box("equi", b"\0" * 20)))

REFUSALS = (
    Case("pixel aspect", ".mp4", ENTRY, add(box("pasp", struct.pack(">II", 2, 1))), "2:1"),
    Case("pixel aspect", ".mp4", (*TRAK, "tkhd"), bytes_at(76, struct.pack(">II", 128 << 16, 48 << 16)),
         "128 x 48"),
    Case("pixel aspect", ".mp4", (*TRAK, "tkhd"), bytes_at(40, matrix(2, 0, 0, 1)), "2, 0, 0, 1"),
    Case("pixel aspect", ".mov", TRAK, add(box("tapt", box("clef", struct.pack(">3I", 0, 32 << 16, 48 << 16)))),
         "32 x 48"),
    Case("pixel aspect", ".mkv", MKV_VIDEO, lambda d: put(0x54B0, 16)(put(0x54BA, 9)(put(0x54B2, 3)(d))),
         "4:3"),
    Case("pixel aspect", ".webm", MKV_VIDEO, lambda d: put(0x54B0, 128)(put(0x54B2, 0)(d)), "128 x 48"),
    Case("pixel aspect", ".avi", STREAM, vprp(8, 3), "128 x 48"),
    turned(-1, 0, 0, 1),
    turned(1, 0, 0, -1),
    Case("mirror image, other turn", ".mp4", (*TRAK, "tkhd"), bytes_at(40, matrix(0, 1, 1, 0)), "0, 1, 1, 0"),
    Case("mirror image, other turn", ".mp4", (*TRAK, "tkhd"), bytes_at(40, matrix(0.8, 0.6, -0.6, 0.8)),
         "0.8", mends=False),
    Case("mirror image, other turn", ".mkv", MKV_VIDEO, add(element(0x7670, element(0x7675, floats(30.0)))),
         "30 degrees", mends=False),
    Case("clean aperture, crop", ".mp4", ENTRY, add(clap(48, 32, 0, -4)), "48 x 32 of 64 x 48 px, from 8, 4"),
    Case("clean aperture, crop", ".mkv", MKV_VIDEO, add(element(0x54CC, 8) + element(0x54BB, 16)),
         "56 x 32 of 64 x 48 px, from 8, 16"),
    Case("clean aperture, crop", ".avi", STREAM, vprp(4, 3, crop=16), "48 x 48"),
    Case("interlacing", ".mov", (*ENTRY[:-1], "jpeg"), lambda d: d[:78] + box("fiel", b"\2\x09"), "two fields"),
    Case("interlacing", ".mkv", MKV_VIDEO, put(0x9A, 1), "two fields"),
    Case("interlacing", ".mkv", MKV_TRACK, add(element(0x234E7A, 16683333)), "fields"),
    Case("interlacing", ".avi", STREAM, vprp(4, 3, fields=2), "2 fields"),
    Case("other colour matrix", ".mp4", ENTRY, add(nclx(1, 1, 8)), "number 8"),
    Case("other colour matrix", ".mkv", MKV_VIDEO, add(element(0x55B0, element(0x55B1, 11))), "number 11",
         mends=False),
    Case("colour matrix twice", ".mov", (*ENTRY[:-1], "jpeg"), lambda d: d[:78] + nclx(1, 1, 1), "number 1"),
    Case("other transfer", ".mp4", ENTRY, add(nclx(1, 8, 1)), "number 8"),
    Case("other transfer", ".mkv", MKV_VIDEO, add(element(0x55B0, element(0x55BA, 9))), "number 9"),
    Case("other transfer", ".mp4", ENTRY, add(nclx(1, 17, 1)), "number 17", mends=False),
    Case("other transfer", ".mkv", MKV_VIDEO, add(element(0x2FB523, floats(1.0))), "gamma is 1"),
    Case("other primaries", ".mp4", ENTRY, add(nclx(12, 13, 1)), "number 12"),
    Case("other primaries", ".mkv", MKV_VIDEO, add(element(0x55B0, element(0x55BB, 9))), "number 9"),
    Case("other primaries", ".mkv", MKV_VIDEO, add(element(0x55B0, element(0x55BB, 22))), "number 22",
         mends=False),
    Case("Dolby Vision without a base layer", ".mp4", ENTRY, add(dolby(0)), "profile 5", mends=False),
    Case("alpha", ".webm", MKV_VIDEO, add(element(0x53C0, 1)), "transparency"),
    Case("frame times", ".mp4", TRAK, edits((100, 0, 1), (200, -1, 1), (100, 3, 1)), "no frames", mends=False),
    Case("frame times", ".mkv", MKV_TRACK, put(0x23E383, 50_000_000), "at 20 a second"),
    Case("playback speed", ".mp4", TRAK, edits((400, 0, 0.5)), "speed is 0.5"),
    Case("playback speed", ".mp4", TRAK, edits((200, 0, 0)), "speed is 0", mends=False),
    Case("playback speed", ".mp4", ("moov", "mvhd"), bytes_at(20, struct.pack(">I", 2 << 16)), "speed is 2"),
    Case("several video tracks", ".mp4", ("moov",), other_track(b"vide"), "holds 2", mends=False),
    Case("several video tracks", ".mkv", (SEGMENT, TRACKS),
         mkv_track(1, b"V_VP8", element(VIDEO, element(0xB0, 64) + element(0xBA, 48))), "holds 2"),
    Case("stereo", ".mp4", ENTRY, add(box("st3d", b"\0\0\0\0\2")), "stereo mode 2"),
    Case("stereo", ".mp4", ENTRY, add(EYES), "two eyes"),
    Case("stereo", ".mkv", MKV_VIDEO, add(element(0x53B8, 3)), "stereo mode 3"),
    Case("stereo", ".mkv", MKV_VIDEO, add(element(0x53B8, 15)), "stereo mode 15", mends=False),
    Case("spherical", ".mp4", ENTRY, add(SPHERE), "sv3d"),
    Case("spherical", ".mp4", TRAK, add(box("uuid", SPHERICAL_V1 + b"<rdf:SphericalVideo/>")), "spherical"),
    Case("spherical", ".mkv", MKV_VIDEO, add(element(0x7670, element(0x7671, 2) + element(0x7672, bytes(12)))), "projection 2"),
    Case("encryption", ".mkv", MKV_TRACK,
         add(element(0x6D80, element(0x6240, element(0x5035, element(0x47E1, 5))))), "encrypted", mends=False),
    Case("encryption", ".mp4", ENTRY, add(box("sinf")), "encrypted", mends=False),
)  # fmt: skip

NOTES = (
    Case("display size", ".mp4", (*TRAK, "tkhd"), bytes_at(76, struct.pack(">II", 128 << 16, 96 << 16)),
         "128 x 96"),
    Case("display size", ".mp4", (*TRAK, "tkhd"), bytes_at(40, matrix(2, 0, 0, 2)), "2, 0, 0, 2"),
    Case("display size", ".mkv", MKV_VIDEO, lambda d: put(0x54B0, 32)(put(0x54BA, 24)(put(0x54B2, 0)(d))),
         "32 x 24"),
    Case("gamma 2.2, gamma 2.8, SMPTE 240M, xvYCC, BT.1361", ".mp4", ENTRY, add(nclx(1, 5, 5)), "gamma 2.8"),
    Case("PQ, HLG", ".mkv", MKV_VIDEO, add(element(0x55B0, element(0x55BA, 18) + element(0x55BB, 9))), "HLG"),
    Case("primaries of BT.470 BG, BT.601, SMPTE 240M", ".mp4", ENTRY, add(nclx(6, 6, 6)), "BT.601"),
    Case("ICC profile", ".mov", (*ENTRY[:-1], "jpeg"), lambda d: d[:78] + box("colr", b"profICC"), "profile"),
    Case("gamma value", ".mov", (*ENTRY[:-1], "jpeg"),
         lambda d: d[:78] + box("gama", struct.pack(">I", round(2.2 * 65536))), "2.2"),
    Case("light levels of the mastering display", ".mp4", ENTRY, add(box("mdcv", b"\0" * 24)), "mdcv"),
    Case("light levels of the mastering display", ".mkv", MKV_VIDEO,
         add(element(0x55B0, element(0x55BC, 1000))), "light levels"),
    Case("Dolby Vision", ".mp4", ENTRY, add(dolby(1)), "profile 5"),
    Case("chroma siting", ".mkv", MKV_VIDEO,
         add(element(0x55B0, element(0x55B7, 2) + element(0x55B8, 2))), "2, 2"),
    Case("late start", ".mp4", TRAK, edits((500, -1, 1), (200, 0, 1)), "500"),
    Case("late start", ".avi", (*STREAM, "strh"), bytes_at(28, struct.pack("<I", 3)), "0.1 s"),
    Case("two frame rates", ".avi", ("AVI ", "hdrl", "avih"), bytes_at(0, struct.pack("<I", 50_000)), "20 a second"),
    Case("track that is switched off", ".mp4", (*TRAK, "tkhd"), bytes_at(0, b"\0\0\0\2"), "switched off"),
    Case("track that is switched off", ".mkv", MKV_TRACK, put(0xB9, 0), "switched off"),
    Case("track that is switched off", ".avi", (*STREAM, "strh"), bytes_at(8, b"\1"), "switched off"),
    Case("sound", ".mkv", (SEGMENT, TRACKS), mkv_track(2, b"A_PCM/INT/LIT"), "sound"),
    Case("sound", ".mp4", ("moov",), other_track(b"soun"), "sound"),
    Case("other tracks", ".mkv", (SEGMENT, TRACKS), mkv_track(17, b"S_TEXT/UTF8"), "kind 17"),
    Case("other tracks", ".mp4", ("moov",), other_track(b"tmcd"), "tmcd"),
    Case("ordered chapters", ".mkv", (SEGMENT,),
         add(element(0x1043A770, element(0x45B9, element(0x45DD, 1)))), "ordered"),
    Case("graphics mode", ".mp4", (*TRAK, "mdia", "minf", "vmhd"), bytes_at(4, b"\0\x24"), "36"),
    # No file of any kind says these: a statement on no list is not passed over.
    Case("whatever else", ".mp4", ENTRY, add(box("zzzz")), "'zzzz' in the video's coding"),
    Case("whatever else", ".mp4", TRAK, add(box("zzzz")), "'zzzz' in the video track"),
    Case("whatever else", ".mp4", (*TRAK, "mdia", "minf", "stbl"), add(box("zzzz")), "'zzzz'"),
    Case("whatever else", ".mp4", ("moov",), add(box("udta", box("LOOP"))), "'LOOP' in the user data"),
    Case("whatever else", ".mp4", (), add(box("zzzz")), "'zzzz' in the file"),
    Case("whatever else", ".mkv", MKV_VIDEO, add(element(0x4FFE, 1)), "0x4FFE in the video's settings"),
    Case("whatever else", ".mkv", MKV_TRACK, add(element(0x4FFE, 1)), "0x4FFE in the video track"),
    Case("whatever else", ".mkv", MKV_VIDEO, add(element(0x55B0, element(0x55FE, 1))), "0x55FE"),
    Case("whatever else", ".mkv", (SEGMENT,), add(element(0x1FFFFFFE, 1)), "0x1FFFFFFE in the file"),
    Case("whatever else", ".avi", STREAM, add(chunk("zzzz", b"ab")), "'zzzz' in the video stream"),
    Case("whatever else", ".avi", ("AVI ",), add(chunk("zzzz", b"ab")), "'zzzz' in the file"),
)  # fmt: skip


def name(case: Case) -> str:
    return f"{case.statement} {case.ending} {case.said}"


@pytest.fixture
def made(tmp_path: Path) -> Callable[[Case], Path]:
    def make(case: Case) -> Path:
        path = write(tmp_path / f"v{case.ending}", FRAMES, CODECS[case.ending])
        if case.place:
            return patched(path, case.place, case.change)
        path.write_bytes(case.change(path.read_bytes()))
        return path

    return make


@pytest.mark.parametrize("ending", CODECS)
def test_a_video_that_says_nothing_special_is_read_in_silence(tmp_path, ending):
    video = VideoFrames(write(tmp_path / f"v{ending}", FRAMES, CODECS[ending]))
    frames = list(video)
    assert (video.notes, len(frames), video.size_px, video.fps) == ([], 6, SIZE, 30)
    if CODECS[ending] == "FFV1":
        assert all(map(np.array_equal, frames, FRAMES))


@pytest.mark.parametrize("case", REFUSALS, ids=name)
def test_what_changes_the_picture_is_refused_with_what_to_do(made, case):
    row = next(row for row in ROWS if row.statement == case.statement)
    path = made(case)
    with pytest.raises(InputError) as refused:
        len(VideoFrames(path))
    message = str(refused.value)
    assert message.startswith(f"{path}: {row.must} (")
    assert case.said in message
    assert ("this makes such a file: ffmpeg" in message) == (
        case.mends or case.statement == "several video tracks"
    )


@pytest.mark.parametrize("case", NOTES, ids=name)
def test_what_is_not_followed_is_noted_and_the_frames_stay(made, case):
    row = next(row for row in ROWS if row.statement == case.statement)
    video = VideoFrames(made(case))
    (note,) = [note for note in video.notes if row.happens in note]
    assert case.said in note
    assert len(list(video)) == 6


@pytest.mark.skipif(FFMPEG is None, reason="no ffmpeg here")
@pytest.mark.parametrize("case", [case for case in REFUSALS if case.mends], ids=name)
def test_the_cure_of_each_refusal_makes_a_video_that_is_taken(made, case):
    mended, frames = follow(made(case))
    assert 3 <= len(frames) <= 12
    assert VideoFrames(mended).fps == 30


def follow(path: Path) -> tuple[Path, list[np.ndarray]]:
    """Run the command that a refusal names; return what it wrote, read."""
    with pytest.raises(InputError) as refused:
        len(VideoFrames(path))
    command = str(refused.value).partition("this makes such a file: ")[2]
    done = subprocess.run(
        shlex.split(command.replace("ffmpeg", "ffmpeg -v error -nostdin", 1)),
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    mended = Path(shlex.split(command)[-1])
    return mended, list(VideoFrames(mended))
