"""Statements of a video's header: honoured, refused with a cure that works, or noted."""

import shlex
import shutil
import struct
import subprocess
from collections.abc import Callable
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
from pipeline.pictures.stored_frames import read_frames, stated
from pipeline.statements.rows import ROWS as TABLE
from pipeline.video_file import VideoFrames
from pipeline.video_header.coding import of_pixel_format, of_stream
from stimuli.media.video import unpacked_video

FRAMES = [picture(number) for number in range(6)]
CODECS = {".mp4": "mp4v", ".mov": "MJPG", ".mkv": "FFV1", ".avi": "FFV1", ".webm": "VP80"}
ENTRY, TRAK = MP4_ENTRY, ("moov", "trak")
HEAD, JPEG = (*TRAK, "tkhd"), (*MP4_ENTRY[:-1], "jpeg")
COLOUR, PROJECTION = 0x55B0, 0x7670
MKV_VIDEO, MKV_TRACK = (SEGMENT, TRACKS, TRACK, VIDEO), (SEGMENT, TRACKS, TRACK)
STREAM = ("AVI ", "hdrl", "strl")
ROWS = {row.names: row for row in TABLE if row.of.startswith("video")}
HEVC = (
    "0101600000009000000000001ef000fcfdf8f800000f04200001001840010c01ffff016000000300900000030000"
    "03001e959809210001002c42010101600000030090000003000003001ea024839c9265959ae4caf0{}"
)
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
    """True if FFmpeg can make it good."""


def add(data: bytes) -> Callable[[bytes], bytes]:
    return lambda inner: inner + data


def after(at: int, data: bytes) -> Callable[[bytes], bytes]:
    return lambda inner: inner[:at] + data


def put(name: int, data: bytes | int) -> Callable[[bytes], bytes]:
    return lambda inner: without(inner, name) + element(name, data)


def bytes_at(at: int, data: bytes) -> Callable[[bytes], bytes]:
    return lambda inner: inner[:at] + data + inner[at + len(data) :]


def matrix(*numbers: float) -> bytes:
    """The linear part of a track's matrix, as its header has it."""
    a, b, c, d = (round(number * 65536) for number in numbers)
    return struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30)


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
    Case(
        "pixel aspect",
        ".mp4",
        HEAD,
        bytes_at(76, struct.pack(">II", 128 << 16, 48 << 16)),
        "128 x 48",
    ),
    Case("pixel aspect", ".mp4", HEAD, bytes_at(40, matrix(2, 0, 0, 1)), "2, 0, 0, 1"),
    Case(
        "pixel aspect",
        ".mov",
        TRAK,
        add(box("tapt", box("clef", struct.pack(">3I", 0, 32 << 16, 48 << 16)))),
        "32 x 48",
    ),
    Case(
        "pixel aspect",
        ".mkv",
        MKV_VIDEO,
        lambda d: put(0x54B0, 16)(put(0x54BA, 9)(put(0x54B2, 3)(d))),
        "4:3",
    ),
    Case(
        "pixel aspect",
        ".webm",
        MKV_VIDEO,
        lambda d: put(0x54B0, 128)(put(0x54B2, 0)(d)),
        "128 x 48",
    ),
    Case("pixel aspect", ".avi", STREAM, vprp(8, 3), "128 x 48"),
    Case(
        "mirror image, other turn", ".mp4", HEAD, bytes_at(40, matrix(-1, 0, 0, 1)), "-1, 0, 0, 1"
    ),
    Case(
        "mirror image, other turn", ".mp4", HEAD, bytes_at(40, matrix(1, 0, 0, -1)), "1, 0, 0, -1"
    ),
    Case("mirror image, other turn", ".mp4", HEAD, bytes_at(40, matrix(0, 1, 1, 0)), "0, 1, 1, 0"),
    Case(
        "mirror image, other turn",
        ".mp4",
        HEAD,
        bytes_at(40, matrix(0.8, 0.6, -0.6, 0.8)),
        "0.8",
        mends=False,
    ),
    Case(
        "mirror image, other turn",
        ".mkv",
        MKV_VIDEO,
        add(element(PROJECTION, element(0x7675, floats(30.0)))),
        "30 degrees",
        mends=False,
    ),
    Case(
        "clean aperture, crop",
        ".mp4",
        ENTRY,
        add(clap(48, 32, 0, -4)),
        "48 x 32 of 64 x 48 px, from 8, 4",
    ),
    Case(
        "clean aperture, crop",
        ".mkv",
        MKV_VIDEO,
        add(element(0x54CC, 8) + element(0x54BB, 16)),
        "56 x 32 of 64 x 48 px, from 8, 16",
    ),
    Case("clean aperture, crop", ".avi", STREAM, vprp(4, 3, crop=16), "48 x 48"),
    Case("interlacing", ".mov", JPEG, after(78, box("fiel", b"\2\x09")), "two fields"),
    Case("interlacing", ".mkv", MKV_VIDEO, put(0x9A, 1), "two fields"),
    Case("interlacing", ".mkv", MKV_TRACK, add(element(0x234E7A, 16683333)), "fields"),
    Case("interlacing", ".avi", STREAM, vprp(4, 3, fields=2), "2 fields"),
    Case("interlacing", ".mkv", MKV_VIDEO, lambda d: put(0x9D, 1)(put(0x9A, 0)(d)), "the order 1"),
    Case("other colour matrix", ".mp4", ENTRY, add(nclx(1, 1, 8)), "number 8"),
    Case(
        "other colour matrix",
        ".mkv",
        MKV_VIDEO,
        add(element(COLOUR, element(0x55B1, 11))),
        "number 11",
        mends=False,
    ),
    Case("colour matrix twice", ".mov", JPEG, after(78, nclx(1, 1, 1)), "number 1"),
    Case("other transfer", ".mp4", ENTRY, add(nclx(1, 8, 1)), "number 8"),
    Case("other transfer", ".mkv", MKV_VIDEO, add(element(COLOUR, element(0x55BA, 9))), "number 9"),
    Case("other transfer", ".mp4", ENTRY, add(nclx(1, 17, 1)), "number 17", mends=False),
    Case("other transfer", ".mkv", MKV_VIDEO, add(element(0x2FB523, floats(1.0))), "gamma is 1"),
    Case("other primaries", ".mp4", ENTRY, add(nclx(12, 13, 1)), "number 12"),
    Case(
        "other primaries", ".mkv", MKV_VIDEO, add(element(COLOUR, element(0x55BB, 9))), "number 9"
    ),
    Case(
        "other primaries",
        ".mkv",
        MKV_VIDEO,
        add(element(COLOUR, element(0x55BB, 22))),
        "number 22",
        mends=False,
    ),
    Case(
        "Dolby Vision without a base layer", ".mp4", ENTRY, add(dolby(0)), "profile 5", mends=False
    ),
    Case("alpha", ".webm", MKV_VIDEO, add(element(0x53C0, 1)), "transparency"),
    Case(
        "frame times",
        ".mp4",
        TRAK,
        edits((100, 0, 1), (200, -1, 1), (100, 3, 1)),
        "no frames",
        mends=False,
    ),
    Case("frame times", ".mkv", MKV_TRACK, put(0x23E383, 50_000_000), "at 20 a second"),
    Case("playback speed", ".mp4", TRAK, edits((400, 0, 0.5)), "speed is 0.5"),
    Case("playback speed", ".mp4", TRAK, edits((200, 0, 0)), "speed is 0", mends=False),
    Case(
        "playback speed",
        ".mp4",
        ("moov", "mvhd"),
        bytes_at(20, struct.pack(">I", 2 << 16)),
        "speed is 2",
    ),
    Case("several video tracks", ".mp4", ("moov",), other_track(b"vide"), "holds 2", mends=False),
    Case(
        "several video tracks",
        ".mkv",
        (SEGMENT, TRACKS),
        mkv_track(1, b"V_VP8", element(VIDEO, element(0xB0, 64) + element(0xBA, 48))),
        "holds 2",
    ),
    Case("stereo", ".mp4", ENTRY, add(box("st3d", b"\0\0\0\0\2")), "stereo mode 2"),
    Case("stereo", ".mp4", ENTRY, add(EYES), "two eyes"),
    Case("stereo", ".mkv", MKV_VIDEO, add(element(0x53B8, 3)), "stereo mode 3"),
    Case("stereo", ".mkv", MKV_VIDEO, add(element(0x53B9, 1)), "old stereo mode 1", mends=False),
    Case("stereo", ".mkv", MKV_VIDEO, add(element(0x53B8, 15)), "stereo mode 15", mends=False),
    Case("spherical", ".mp4", ENTRY, add(SPHERE), "sv3d"),
    Case(
        "spherical",
        ".mp4",
        TRAK,
        add(box("uuid", SPHERICAL_V1 + b"<rdf:SphericalVideo/>")),
        "spherical",
    ),
    Case(
        "spherical",
        ".mkv",
        MKV_VIDEO,
        add(element(PROJECTION, element(0x7671, 2) + element(0x7672, bytes(12)))),
        "projection 2",
    ),
    Case(
        "encryption",
        ".mkv",
        MKV_TRACK,
        add(element(0x6D80, element(0x6240, element(0x5035, element(0x47E1, 5))))),
        "encrypted",
        mends=False,
    ),
    Case("encryption", ".mp4", ENTRY, add(box("sinf")), "encrypted", mends=False),
)

NOTES = (
    Case(
        "display size",
        ".mp4",
        HEAD,
        bytes_at(76, struct.pack(">II", 128 << 16, 96 << 16)),
        "128 x 96",
    ),
    Case("display size", ".mp4", HEAD, bytes_at(40, matrix(2, 0, 0, 2)), "2, 0, 0, 2"),
    Case(
        "display size",
        ".mkv",
        MKV_VIDEO,
        lambda d: put(0x54B0, 32)(put(0x54BA, 24)(put(0x54B2, 0)(d))),
        "32 x 24",
    ),
    Case(
        "gamma 2.2, gamma 2.8, SMPTE 240M, xvYCC, BT.1361",
        ".mp4",
        ENTRY,
        add(nclx(1, 5, 5)),
        "gamma 2.8",
    ),
    Case(
        "PQ, HLG",
        ".webm",
        MKV_VIDEO,
        add(element(COLOUR, element(0x55BA, 18) + element(0x55BB, 9))),
        "HLG",
    ),
    Case("primaries of BT.470 BG, BT.601, SMPTE 240M", ".mp4", ENTRY, add(nclx(6, 6, 6)), "BT.601"),
    Case("ICC profile", ".mov", JPEG, after(78, box("colr", b"profICC")), "profile"),
    Case(
        "gamma value",
        ".mov",
        JPEG,
        after(78, box("gama", struct.pack(">I", round(2.2 * 65536)))),
        "2.2",
    ),
    Case(
        "light levels of the mastering display", ".mp4", ENTRY, add(box("mdcv", b"\0" * 24)), "mdcv"
    ),
    Case(
        "light levels of the mastering display",
        ".mkv",
        MKV_VIDEO,
        add(element(COLOUR, element(0x55BC, 1000))),
        "light levels",
    ),
    Case("Dolby Vision", ".mp4", ENTRY, add(dolby(1)), "profile 5"),
    Case(
        "chroma siting",
        ".mkv",
        MKV_VIDEO,
        add(element(COLOUR, element(0x55B7, 2) + element(0x55B8, 2))),
        "2, 2",
    ),
    Case("late start", ".mp4", TRAK, edits((500, -1, 1), (200, 0, 1)), "at its start"),
    Case("late start", ".avi", (*STREAM, "strh"), bytes_at(28, struct.pack("<I", 3)), "0.1 s"),
    Case(
        "two frame rates",
        ".avi",
        ("AVI ", "hdrl", "avih"),
        bytes_at(0, struct.pack("<I", 50_000)),
        "20 a second",
    ),
    Case("track that is switched off", ".mp4", HEAD, bytes_at(0, b"\0\0\0\2"), "switched off"),
    Case("track that is switched off", ".mkv", MKV_TRACK, put(0xB9, 0), "switched off"),
    Case(
        "track that is switched off", ".avi", (*STREAM, "strh"), bytes_at(8, b"\1"), "switched off"
    ),
    Case("sound", ".mkv", (SEGMENT, TRACKS), mkv_track(2, b"A_PCM/INT/LIT"), "sound"),
    Case("sound", ".mp4", ("moov",), other_track(b"soun"), "sound"),
    Case("other tracks", ".mkv", (SEGMENT, TRACKS), mkv_track(17, b"S_TEXT/UTF8"), "kind 17"),
    Case("other tracks", ".mp4", ("moov",), other_track(b"tmcd"), "tmcd"),
    Case(
        "ordered chapters",
        ".mkv",
        (SEGMENT,),
        add(element(0x1043A770, element(0x45B9, element(0x45DD, 1)))),
        "ordered",
    ),
    Case("graphics mode", ".mp4", (*TRAK, "mdia", "minf", "vmhd"), bytes_at(4, b"\0\x24"), "36"),
    # No file of any kind says these: a statement on no list is not passed over.
    Case("whatever else", ".mp4", ENTRY, add(box("zzzz")), "'zzzz' in the video's coding"),
    Case("whatever else", ".mp4", TRAK, add(box("zzzz")), "'zzzz' in the video track"),
    Case("whatever else", ".mp4", (*TRAK, "mdia", "minf", "stbl"), add(box("zzzz")), "'zzzz'"),
    Case(
        "whatever else", ".mp4", ("moov",), add(box("udta", box("LOOP"))), "'LOOP' in the user data"
    ),
    Case("whatever else", ".mp4", (), add(box("zzzz")), "'zzzz' in the file"),
    Case(
        "whatever else",
        ".mkv",
        MKV_VIDEO,
        add(element(0x4FFE, 1)),
        "'4FFE' in the video's settings",
    ),
    Case("whatever else", ".mkv", MKV_TRACK, add(element(0x4FFE, 1)), "'4FFE' in the video track"),
    Case("whatever else", ".mkv", MKV_VIDEO, add(element(COLOUR, element(0x55FE, 1))), "55FE"),
    Case(
        "whatever else", ".mkv", (SEGMENT,), add(element(0x1FFFFFFE, 1)), "'1FFFFFFE' in the file"
    ),
    Case("whatever else", ".avi", STREAM, add(chunk("zzzz", b"ab")), "'zzzz' in the video stream"),
    Case(
        "whatever else",
        ".avi",
        (*STREAM, "strh"),
        bytes_at(48, struct.pack("<4h", 0, 0, 32, 48)),
        "32 x 48 px",
    ),
    Case("whatever else", ".avi", ("AVI ",), add(chunk("zzzz", b"ab")), "'zzzz' in the file"),
)


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


def test_half_a_pixel_less_is_no_crop(tmp_path):
    path = write(tmp_path / "v.mp4", FRAMES, "mp4v")
    half = box("clap", struct.pack(">8I", 127, 2, 48, 1, 0, 1, 0, 1))
    assert VideoFrames(patched(path, ENTRY, add(half))).notes == []


@pytest.mark.parametrize("case", REFUSALS, ids=name)
def test_what_changes_the_picture_is_refused_with_what_to_do(made, case):
    row = ROWS[case.statement]
    path = made(case)
    with pytest.raises(InputError) as refused:
        len(VideoFrames(path))
    message = str(refused.value)
    assert message.startswith(f"{path}: {row.words.partition('; ')[0]} (")
    assert case.said in message
    assert ("this makes such a file: ffmpeg" in message) == (
        case.mends or case.statement == "several video tracks"
    )


@pytest.mark.parametrize("case", NOTES, ids=name)
def test_what_is_not_followed_is_noted_and_the_frames_stay(made, case):
    row = ROWS[case.statement]
    video = VideoFrames(made(case))
    (note,) = [note for note in video.notes if row.words in note]
    assert case.said in note
    if case.statement != "PQ, HLG":  # OpenCV takes seconds for each frame of these
        assert len(list(video)) == 6


@pytest.mark.slow
@pytest.mark.skipif(FFMPEG is None, reason="no ffmpeg here")
@pytest.mark.parametrize("case", [case for case in REFUSALS if case.mends], ids=name)
def test_the_cure_of_each_refusal_makes_a_video_that_is_taken(made, case):
    mended, frames = follow(made(case))
    assert 3 <= len(frames) <= 12
    assert VideoFrames(mended).fps == 30


def test_the_cure_of_uneven_frames_has_the_rate_of_the_study(made):
    """Frames come at 30 a second, the header and the study say 20."""
    (case,) = [one for one in REFUSALS if one.statement == "frame times" and one.ending == ".mkv"]
    path = made(case)
    size_px = VideoFrames(path).size_px
    with pytest.raises(InputError, match="fps=20") as refused:
        list(read_frames(path, size_px, 4, 20.0))
    if FFMPEG is not None:
        command = str(refused.value).partition("this makes such a file: ")[2]
        words = shlex.split(command.replace("ffmpeg", "ffmpeg -v error -nostdin", 1))
        subprocess.run(words, check=True)
        assert len(list(read_frames(Path(words[-1]), size_px, 4, 20.0))) == 4


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


def test_colours_that_only_the_stream_of_av1_says_are_noted():
    assert [one.statement for one in of_stream(b"AV01", b"", b"", 2)] == ["colours of AV1"]
    assert list(of_stream(b"AV01", b"", b"", 1)) == []


@pytest.mark.parametrize(
    ("packet", "matrix"),
    [("a24983424000fe00", 1), ("a24983422000fe00", 6), ("a2498342e007f005", 0),
     ("924983420003f802", 2), ("86004000", 2), ("", 2)],
)  # fmt: skip
def test_the_colour_matrix_of_vp9s_first_frame_is_known(packet, matrix):
    """Heads of frames from libvpx: BT.709, BT.601, RGB, 10 bits of nothing; of no key frame."""
    said = [one.values.get("matrix") for one in of_stream(b"VP90", b"", bytes.fromhex(packet), 2)]
    assert said == [matrix]
    twice = [one.statement for one in of_stream(b"VP90", b"", bytes.fromhex(packet), 9)]
    assert ("colour matrix twice" in twice) == (matrix != 2)


@pytest.mark.parametrize(
    ("codec", "header", "cut_px"),
    [
        (b"h264", "01f4000affe1001967f4000a919b2841b847c2000003000200000300641e244b2c0100", 16),
        (b"h264", "0164000affe100186764000aacd9420dc4f840000003004000000c83c48965800100", 16),
        (b"hevc", "2100010029420101016000000300900000030000" "03001ea010206197e5959a4932b9a020"
                  "0000030020000003032122", 8),
        (b"h264", "0164000affe100186764000aacd9447b0110000003001000000303c0f122596001", 0),
    ],
)  # fmt: skip
def test_columns_that_the_coding_cuts_off_at_the_left_are_told(codec, header, cut_px):
    """Decoders leave them, and OpenCV would press the picture into the width without them."""
    said = [one for one in of_stream(codec, bytes.fromhex(header), b"", 2) if "left" in one.found]
    assert [one.found for one in said] == [f"its coding cuts {cut_px} px off its left"] * (
        cut_px > 0
    )


@pytest.mark.slow
@pytest.mark.skipif(FFMPEG is None, reason="no ffmpeg here")
def test_the_cure_of_columns_cut_off_at_the_left_shows_the_others(tmp_path):
    whole, cut = tmp_path / "whole.mkv", tmp_path / "cut.mkv"
    words = ["-f", "lavfi", "-i", "testsrc=size=128x96:rate=30:duration=0.2", "-c:v", "libx264"]
    for path, more in ((whole, []), (cut, ["-bsf:v", "h264_metadata=crop_left=16"])):
        subprocess.run([FFMPEG, "-v", "error", *words, "-crf", "1", *more, path], check=True)
    _, mended = follow(cut)
    right = [frame[:, 16:].astype(int) for frame in VideoFrames(whole)]
    assert all(np.abs(a - b).mean() < 1 for a, b in zip(right, mended, strict=True))


@pytest.mark.slow
@pytest.mark.skipif(FFMPEG is None, reason="no ffmpeg here")
def test_one_command_mends_all_that_a_header_says(tmp_path):
    """As of DV: fields of pixels that are not square."""
    path = write(tmp_path / "v.mkv", FRAMES, "FFV1")
    for change in (put(0x9A, 1), lambda d: put(0x54B0, 128)(put(0x54B2, 0)(d))):
        patched(path, MKV_VIDEO, change)
    message = _refusal(path)
    assert "must hold whole frames, not fields (its frames are two fields), and must " in message
    assert ", and must have square pixels (to be shown as 128 x 48" in message
    mended, frames = follow(path)
    assert [frame.shape for frame in frames] == [(48, 128, 3)] * len(FRAMES)
    assert VideoFrames(mended).notes == []


def test_a_codec_that_is_not_known_is_told_with_what_to_do(tmp_path):
    path = write(tmp_path / "v.mkv", FRAMES, "FFV1")
    patched(path, (*MKV_TRACK, 0x86), lambda _: b"V_WIBBLE")
    with pytest.raises(InputError, match=r"not known.; export it anew, in a common codec"):
        len(VideoFrames(path))
    path = write(tmp_path / "v.mp4", FRAMES, "mp4v")
    patched(path, ("mdat",), lambda data: bytes(len(data)))  # a codec without its decoder
    with pytest.raises(InputError, match=r"must have frames that can be .*such a file: ffmpeg"):
        len(VideoFrames(path))


def test_every_row_of_the_table_is_tried():
    tried = {case.statement for case in (*REFUSALS, *NOTES)}
    by_frames = {"more than 8 bits", "length", "no colour matrix", "colours of AV1", "no frames"}
    wanted = {name for name, row in ROWS.items() if row.verdict != "honoured"}
    assert wanted - tried == by_frames
    for cases, verdict in ((REFUSALS, "refused"), (NOTES, "noted")):
        assert {ROWS[case.statement].verdict for case in cases} == {verdict}


@pytest.mark.parametrize(
    ("numbers", "turns"), [((0, 1, -1, 0), 3), ((-1, 0, 0, -1), 2), ((0, -1, 1, 0), 1)]
)
@pytest.mark.parametrize("box_name", ["tkhd", "mvhd"])
def test_quarter_turns_are_followed(tmp_path, numbers, turns, box_name):
    plain = list(VideoFrames(write(tmp_path / "plain.mp4", FRAMES, "mp4v")))
    place, at = (("moov", "mvhd"), 36) if box_name == "mvhd" else (HEAD, 40)
    path = write(tmp_path / "turned.mp4", FRAMES, "mp4v")
    video = VideoFrames(patched(path, place, bytes_at(at, matrix(*numbers))))
    assert video.notes == []
    assert all(np.array_equal(np.rot90(a, turns), b) for a, b in zip(plain, video, strict=True))


def test_a_roll_of_matroska_is_followed(tmp_path):
    path = write(tmp_path / "v.mkv", FRAMES, "FFV1")
    roll = element(PROJECTION, element(0x7675, floats(90.0)))
    frames = list(VideoFrames(patched(path, MKV_VIDEO, add(roll))))
    assert all(np.array_equal(np.rot90(a), b) for a, b in zip(FRAMES, frames, strict=True))


@pytest.mark.parametrize(
    ("entries", "kept"),
    [
        ([(200, 0, 1)], [0, 1, 2, 3, 4, 5]),
        ([(100, 3, 1)], [3, 4, 5]),
        ([(100, 0, 1), (34, 5, 1)], [0, 1, 2, 5]),
    ],
)
def test_edits_are_followed(tmp_path, entries, kept):
    plain = list(VideoFrames(write(tmp_path / "plain.mp4", FRAMES, "mp4v")))
    path = write(tmp_path / "v.mp4", FRAMES, "mp4v")
    video = VideoFrames(patched(path, TRAK, edits(*entries)))
    assert video.notes == []
    assert all(map(np.array_equal, [plain[number] for number in kept], video))
    assert len(video) == len(kept)


@pytest.mark.parametrize(
    ("code", "red", "blue"), [(1, 0.2126, 0.0722), (6, 0.299, 0.114), (9, 0.2627, 0.0593)]
)
@pytest.mark.parametrize("full", [False, True])
def test_the_colour_matrix_and_range_of_the_container_are_followed(tmp_path, code, red, blue, full):
    """By hand: OpenCV writes Y'CbCr of BT.601, limited; other words for it give other colours."""
    flat = np.full((48, 64, 3), (180, 90, 60), np.uint8)
    path = write(tmp_path / "v.mp4", [flat] * 3, "mp4v")
    tag = box("colr", b"nclx" + struct.pack(">3HB", 1, 13, code, 128 * full))
    frame = VideoFrames(patched(path, ENTRY, add(tag))).read(1)

    r, g, b = flat[0, 0] / 255
    luma = 0.299 * r + 0.587 * g + 0.114 * b
    stored = [16 + 219 * luma, 128 + 224 * (b - luma) / 1.772, 128 + 224 * (r - luma) / 1.402]
    y, cb, cr = np.round(stored)
    if full:
        y, cb, cr = y / 255, (cb - 128) / 255, (cr - 128) / 255
    else:
        y, cb, cr = (y - 16) / 219, (cb - 128) / 224, (cr - 128) / 224
    r, b = y + 2 * (1 - red) * cr, y + 2 * (1 - blue) * cb
    g = (y - red * r - blue * b) / (1 - red - blue)
    np.testing.assert_allclose(frame[24, 32] / 255, (r, g, b), rtol=0, atol=4 / 255)


def test_alpha_that_is_full_everywhere_is_no_transparency(tmp_path):
    """OpenCV's own FFV1 in AVI has an alpha channel; half of it, and the file is refused."""
    path = write(tmp_path / "v.avi", FRAMES, "FFV1")
    assert len(list(VideoFrames(path))) == 6
    assert list(of_pixel_format(b"BGRA")) == []


@pytest.mark.skipif(FFMPEG is None, reason="no ffmpeg here")
def test_alpha_is_seen_in_the_frames_and_the_cure_puts_them_on_black(tmp_path):
    path = write(tmp_path / "v.avi", FRAMES, "FFV1")
    half = tmp_path / "half.mkv"
    words = ["-i", path, "-vf", "colorchannelmixer=aa=0.5", "-c:v", "ffv1", half]
    subprocess.run([FFMPEG, "-v", "error", *words], check=True)
    with pytest.raises(InputError, match=r"must be opaque \(frame 0 is transparent\)"):
        len(list(VideoFrames(half)))
    command = shlex.split(_refusal(half).partition("this makes such a file: ")[2])
    subprocess.run([*command[:1], "-v", "error", *command[1:]], check=True)
    mended = list(VideoFrames(Path(command[-1])))
    assert all(abs(a / 2 - b).max() <= 1.5 for a, b in zip(FRAMES, mended, strict=True))


def _refusal(path: Path) -> str:
    with pytest.raises(InputError) as refused:
        list(VideoFrames(path))
    return str(refused.value)


@pytest.mark.slow
@pytest.mark.skipif(FFMPEG is None, reason="no ffmpeg here")
@pytest.mark.parametrize(
    ("ending", "place", "change", "right"),
    [
        (".mkv", MKV_VIDEO, add(element(0x54CC, 16) + element(0x54BB, 16)), lambda f: f[16:, 16:]),
        (".mkv", MKV_VIDEO, put(0x9A, 1), None),
        (".mkv", MKV_VIDEO, add(element(0x53B8, 1)), lambda f: np.repeat(f[:, :32], 1, axis=1)),
        (".mkv", MKV_VIDEO, add(element(0x53C0, 1)), lambda f: f),
        (".mp4", HEAD, bytes_at(40, matrix(-1, 0, 0, 1)), lambda f: f[:, ::-1]),
        (".mp4", HEAD, bytes_at(40, matrix(1, 0, 0, -1)), lambda f: f[::-1]),
        (".mp4", HEAD, bytes_at(40, matrix(0, 1, 1, 0)), lambda f: f.transpose(1, 0, 2)),
    ],
)
def test_the_cure_shows_what_the_file_meant(tmp_path, ending, place, change, right):
    plain = list(VideoFrames(write(tmp_path / f"plain{ending}", FRAMES, CODECS[ending])))
    path = patched(write(tmp_path / f"v{ending}", FRAMES, CODECS[ending]), place, change)
    _, mended = follow(path)
    if right is None:  # frames that are no fields, but are said to be
        assert all(frame.shape == plain[0].shape for frame in mended)
        return
    assert all(
        np.abs(right(a).astype(int) - b).max() <= 3 for a, b in zip(plain, mended, strict=True)
    )


@pytest.mark.parametrize(
    ("codec", "header", "packet", "statements"),
    [
        # x264: whole frames, fields, Display P3, linear light, and headers without a container.
        (b"h264", "0164000affe100186764000aacd9447b0110000003001000000303c0f122596001", "", []),
        (b"h264", "01f40015ffe1001967f40015919b2889f89c0440000003004000000f07c50a6580010006", "",
         ["interlacing"]),
        (b"h264", "01f4000affe1001b67f4000a919b288f4d43004050000003001000000303c0f1225960", "",
         ["other primaries"]),
        (b"h264", "01f4000affe1001b67f4000a919b288f4d40420050000003001000000303c0f1225960", "",
         ["other transfer"]),
        (b"h264", "0000016764000aacd9447b0110000003001000000303c0f122596000000001", "", []),
        (b"hevc", HEVC.format("26a180202080000003008000000c8422"), "", ["other primaries"]),
        (b"hevc", HEVC.format("16a122012080000003008000000c8422"), "",
         ["PQ, HLG", "colour matrix twice"]),
        (b"hevc", "0000000142010101600000030090000003000003001ea02083165959ae4caf016a121c1208", "",
         ["other primaries", "colour matrix twice"]),
        # Supplemental information: side by side, another packing, a turn.
        (b"h264", "", "00000001062d018103000080", ["stereo"]),
        (b"hevc", "", "000000014e012d018103000080", ["stereo"]),
        (b"h264", "", "00000001062f04100004c080", ["mirror image, other turn"]),
        (b"h264", "", "000001062d01c0800000016588", []),
        # The profile's flags: progressive source, then interlaced source.
        (b"hevc", "0104080000009e08000000001ef000fcfff8f800000f04200001", "", []),
        (b"hevc", "0104080000004e08000000001ef000fcfff8f800000f04200001", "", ["interlacing"]),
        (b"mpg2", "000001b304003025ffffe018000001b5148a00010000", "", []),
        (b"mpg2", "000001b304003025ffffe018000001b5148200010000", "", ["interlacing"]),
        (b"FMP4", "000001b001000001b58913000001000000012000c48d8800f50204061443000001b2", "", []),
        (b"FMP4", "000001b001000001b58913000001000000012000c48d8800f50204061c43000001b2", "",
         ["interlacing"]),
        (b"dvsd", "", "", ["interlacing"]),
        # ProRes: a whole frame, fields, and a frame that says BT.709 itself.
        (b"apch", "", f"000000006963706600940000{'00' * 8}80000202020000",
         ["colour matrix twice"]),
        (b"apch", "", f"000000006963706600940000{'00' * 8}84000101010000", ["interlacing"]),
        (b"MJPG", "", "", ["colour matrix twice"]),
        (b"ffv1", "", "", []),
    ],
)  # fmt: skip
def test_the_coded_stream_itself_is_listened_to(codec, header, packet, statements):
    """The container says BT.709 each time. Headers are those that FFmpeg's encoders wrote."""
    found = of_stream(codec, bytes.fromhex(header), bytes.fromhex(packet), 1)
    said = [one.statement for one in found if ROWS[one.statement].verdict != "honoured"]
    assert said == statements


@pytest.mark.parametrize(
    ("tag", "said"),
    [
        (b"I420", None), (b"G3\0\x08", None), (b"Y3\x0b\x08", None), (b"Y41B", None),
        (b"Y42B", None), (b"422P", None), (b"444P", None), (b"YV16", None), (b"440P", None),
        (b"Y2\0\x08", "its pixels may be transparent"),
        (b"Y800", None), (b"RGB\x18", None), (b"PAL\x08", None),
        (b"Y3\x0b\x0a", "10 bits a channel"), (b"\x10\x001Y", "16 bits a channel"),
        (b"RGB0", "16 bits a channel"), (b"RGBA", "its pixels may be transparent"),
        (b"Y4\x0b\x08", "its pixels may be transparent"),
        (b"G4\0\x08", "its pixels may be transparent"),
    ],
)  # fmt: skip
def test_pixel_formats_tell_alpha_and_depth(tag, said):
    assert [one.found for one in of_pixel_format(tag)] == ([said] if said else [])


def test_each_reader_of_videos_refuses_alike(made):
    path = made(REFUSALS[0])
    readers: list[Callable[[], object]] = [
        lambda: FramesOnDisk(path),
        lambda: list(read_frames(path, SIZE, 6, 30.0)),
        lambda: stated(path, 30.0),
        lambda: unpacked_video(path).__enter__(),
    ]
    for read in readers:
        with pytest.raises(InputError, match="must have square pixels"):
            read()


def test_two_frames_that_come_at_the_same_moment_are_refused(tmp_path):
    """The table of durations: each frame lasts 512 units, but the third none."""
    path = write(tmp_path / "v.mp4", FRAMES, "mp4v")
    times = struct.pack(">7I", 3, 2, 512, 1, 0, 3, 512)
    patched(path, (*TRAK, "mdia", "minf", "stbl", "stts"), lambda _: b"\0\0\0\0" + times)
    assert "must show its frames at one rate (frame 3 comes" in _refusal(path)


def test_a_rate_without_a_statement_is_that_of_the_frames(tmp_path):
    path = patched(
        write(tmp_path / "v.mkv", FRAMES, "FFV1"), MKV_TRACK, lambda d: without(d, 0x23E383)
    )
    with unpacked_video(path) as found:
        assert (found.frames, found.notes) == (6, [])
        assert found.fps == pytest.approx(30, rel=0.01)


@pytest.mark.parametrize(("lines", "notes"), [(48, 0), (720, 1)])
def test_a_large_video_without_a_colour_matrix_is_noted(tmp_path, lines, notes):
    path = write(tmp_path / "v.mp4", [np.zeros((lines, lines + 16, 3), np.uint8)] * 2, "mp4v")
    assert len(VideoFrames(path).notes) == notes
    assert VideoFrames(patched(path, ENTRY, add(nclx(1, 1, 1)))).notes == []
