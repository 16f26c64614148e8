"""Statements of a coded stream itself: fields, colours, alpha and depth.

`colour` and `gamma` are the meaning of numbers of ITU-T H.273, wherever they stand.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Final

from pipeline.statements.check_statements import NO_CURE, UPRIGHT, VideoStatement

UNSAID: Final = 2
MATRICES: Final = {
    0: "gbr", 1: "bt709", 4: "fcc", 5: "bt470bg", 6: "smpte170m", 7: "smpte240m", 9: "bt2020nc",
}  # fmt: skip
"""Matrices that OpenCV's FFmpeg follows, by FFmpeg's names."""
_ENCODED: Final = {
    1: "709", 2: "iec61966-2-1", 6: "601", 13: "iec61966-2-1", 14: "2020_10", 15: "2020_12",
}  # fmt: skip
"""Transfers whose values are shown as they are, by the names of FFmpeg's zscale."""
_NAMED = {4: "gamma 2.2", 5: "gamma 2.8", 7: "SMPTE 240M", 11: "xvYCC", 12: "BT.1361"}
_MAPPED = {16: "PQ", 18: "HLG"}
_LIGHT = {8: "linear", 9: "log100", 10: "log316"}
_NEAR = {5: "BT.470 BG", 6: "BT.601", 7: "SMPTE 240M"}
_WIDE = {4: "470m", 8: "film", 9: "2020", 10: "smpte428", 11: "smpte431", 12: "smpte432"}
_LEAST_GAMMA, _LARGEST_GAMMA = 1.7, 2.8
_CODED = (8, 10, 12, 13)
_ANEW = "export it anew, in sRGB"


def colour(primaries: int, transfer: int, matrix: int) -> Iterator[VideoStatement]:
    """Yield the statements of three codes of H.273, without those of the default."""
    kept = _ENCODED.get(transfer, _ENCODED[UNSAID])
    own = _WIDE.get(primaries, "709")
    values: Mapping[str, str]
    yield VideoStatement("colour matrix and range", "", {"matrix": matrix})
    if matrix not in MATRICES and matrix != UNSAID:
        values = {"primaries": own, "transfer": _LIGHT.get(transfer, kept)}
        cure = values if matrix in _CODED else {"cure": _ANEW}
        yield VideoStatement("other colour matrix", f"its matrix is number {matrix} of H.273", cure)
    if transfer in _MAPPED:
        yield VideoStatement("PQ, HLG", f"its transfer is {_MAPPED[transfer]}")
        return
    if transfer in _NAMED:
        name = "gamma 2.2, gamma 2.8, SMPTE 240M, xvYCC, BT.1361"
        yield VideoStatement(name, f"its transfer is {_NAMED[transfer]}")
    elif transfer not in _ENCODED:
        values = {"primaries": own, "transfer": _LIGHT.get(transfer, kept), "to": kept}
        cure = values if transfer in _LIGHT else {"cure": _ANEW}
        yield VideoStatement("other transfer", f"its transfer is number {transfer} of H.273", cure)
    if primaries in _NEAR:
        name = "primaries of BT.470 BG, BT.601, SMPTE 240M"
        yield VideoStatement(name, f"its primaries are those of {_NEAR[primaries]}")
    elif primaries not in (1, UNSAID):
        values = {"primaries": own, "transfer": kept, "to": kept}
        cure = values if primaries in _WIDE else {"cure": _ANEW}
        yield VideoStatement(
            "other primaries", f"its primaries are number {primaries} of H.273", cure
        )


def gamma(value: float) -> VideoStatement:
    """Return the meaning of a gamma: near a display's own noted, as of linear light refused."""
    words = f"its gamma is {value:g}"
    if _LEAST_GAMMA <= value <= _LARGEST_GAMMA:
        return VideoStatement("gamma value", words)
    linear = {"primaries": "709", "transfer": "linear", "to": _ENCODED[UNSAID]}
    return VideoStatement("other transfer", words, linear if value == 1 else {"cure": _ANEW})


def laid_out(statement: str, name: str | None, words: str) -> VideoStatement:
    """Return the meaning of two views or a panorama, with FFmpeg's name for their layout."""
    return VideoStatement(statement, words, {"name": name} if name else {"cure": NO_CURE})


_DEEP: Final = {b"RGB0": 48, b"BGR0": 48, b"RBA@": 64, b"BRA@": 64}
_ALPHA: Final = (b"RGBA", b"ARGB", b"ABGR", b"RBA@", b"BRA@")
_HIGH_PROFILES: Final = (100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135)
_OF_JFIF: Final = 5
_FRAME_PACKING, _ORIENTATION = 45, 47  # kinds of supplemental information
_PACKINGS: Final = {3: "sbsl", 4: "abl"}
_HEVC_SET: Final = re.compile(rb"(?:[\xa1\x21]\x00\x01..|\x00\x00\x01)\x42\x01", re.DOTALL)
_VP9_START: Final = 0x498342
_VP9_MATRICES: Final = {1: 6, 2: 1, 3: 6, 4: 7, 5: 9, 7: 0}  # those of H.273
_HEADERS: Final = 4096  # bytes that hold every header read here


def of_pixel_format(tag: bytes) -> Iterator[VideoStatement]:
    """Yield the statements of FFmpeg's four characters of a pixel format on alpha and depth.

    Of BGRA the reader sees each frame's alpha, and judges that.
    """
    planes = tag if tag[1:2].isdigit() else tag[::-1]  # backwards: with the high byte first
    # Y4, then how chroma is thinned, then bits; Y42B and Y41B are letters alone.
    named = planes[:1] in (b"Y", b"G") and planes[1] in b"1234" and planes[2] < 32
    if tag in _ALPHA or (named and planes[1] in b"24"):
        yield VideoStatement("alpha", "its pixels may be transparent")
    bits = planes[3] if named else 16 if tag in _DEEP else 8
    if 8 < bits <= 32:
        yield VideoStatement("more than 8 bits", f"{bits} bits a channel")


def of_stream(codec: bytes, header: bytes, packet: bytes, matrix: int) -> Iterator[VideoStatement]:
    """Yield the statements of the stream.

    Parameters
    ----------
    codec : bytes
        Its four characters, as OpenCV gives them.
    header, packet : bytes
        Its headers, and its first packet; either may be empty.
    matrix : int
        The container's colour matrix, a number of H.273.
    """
    name, own, fields = codec.lower(), matrix, False
    if name in (b"h264", b"avc1"):
        colours, fields, left = _h264(header)
        yield from _cut_off(left)
        yield from colour(*colours)
        yield from _enhancements(packet, 1)
        own = matrix if colours[2] == UNSAID else colours[2]
    elif name in (b"hevc", b"hev1", b"hvc1"):
        # Flags of progressive and of interlaced source, in the record or the parameter set.
        colours, left = _hevc(header)
        yield from _cut_off(left)
        yield from colour(*colours)
        own = matrix if colours[2] == UNSAID else colours[2]
        yield from _enhancements(packet, 2)
        at = 6 if header[:1] == b"\1" else header.find(b"\0\0\1\x40\1") + 14
        fields = header[at : at + 1] != b"" and header[at] & 0xC0 == 0x40
    elif name in (b"vp90", b"vp09"):
        own = _vp9(packet)
        yield from colour(UNSAID, UNSAID, own)
        own = matrix if own == UNSAID else own
    elif name == b"av01" and matrix == UNSAID:
        yield VideoStatement("colours of AV1", "its container does not say its colours")
    elif name in (b"mpg2", b"mpeg"):
        at = header.find(b"\0\0\1\xb5\x14")  # the sequence's extension
        at = at if at >= 0 else header.find(b"\0\0\1\xb5\x12")
        fields = at >= 0 and not int.from_bytes(header[at + 5 : at + 6]) & 8
    elif name in (b"fmp4", b"mp4v", b"xvid", b"divx", b"dx50"):
        fields = _mpeg4_has_fields(header)
    elif name[:2] == b"dv":
        fields = True
    elif packet[4:8] == b"icpf" and len(packet) > 25:  # ProRes
        own, fields = packet[24], bool(packet[20] & 0x0C)
    elif name == b"mjpg":
        own = _OF_JFIF
    if fields:
        yield VideoStatement("interlacing", "its coding allows for frames of two fields")
    if UNSAID != matrix != own and {own, matrix} != {5, 6} and matrix in MATRICES:
        words = f"number {matrix} of H.273 in the container, {own} in the frames"
        yield VideoStatement("colour matrix twice", words, {"name": MATRICES[matrix]})


class _Bits:
    """Bits of a header in their order; behind its end all are 0."""

    def __init__(self, data: bytes) -> None:
        self._value, self._left = int.from_bytes(data), 8 * len(data)

    def take(self, count: int) -> int:
        """Return the next bits as a number."""
        self._left -= count
        shifted = self._value >> self._left if self._left >= 0 else 0
        return shifted & ((1 << count) - 1)

    def golomb(self) -> int:
        """Return the next Exp-Golomb code, unsigned."""
        zeros = 0
        while zeros < 32 and not self.take(1):
            zeros += 1
        return (1 << zeros) - 1 + self.take(zeros)


def _cut_off(left_px: int) -> Iterator[VideoStatement]:
    """Yield columns that FFmpeg's decoders leave, so that OpenCV presses the picture together."""
    if left_px:
        values = {"cure": "-vf null", "reader": "-flags unaligned"}
        yield VideoStatement(
            "clean aperture, crop", f"its coding cuts {left_px} px off its left", values
        )


def _vp9(packet: bytes) -> int:
    """Return the colour matrix that VP9's first frame says."""
    bits = _Bits(packet[:16])
    bits.take(2)
    profile = bits.take(1) + 2 * bits.take(1)
    bits.take(profile == 3)
    if bits.take(4) & 12 or bits.take(24) != _VP9_START:  # shown again, or no key frame
        return UNSAID
    bits.take(profile >= 2)
    return _VP9_MATRICES.get(bits.take(3), UNSAID)


def _h264(header: bytes) -> tuple[tuple[int, int, int], bool, int]:
    """Return primaries, transfer and matrix of H.264, whether it has fields, and what is cut off.

    The last are pixels at the left.
    """
    if header[:1] == b"\1":
        data = header[8:]
    else:
        at = header.find(b"\0\0\1\x67")
        data = header[at + 3 :] if at >= 0 else b""
    bits = _Bits(data[1:_HEADERS].replace(b"\0\0\3", b"\0\0"))
    profile, chroma = bits.take(8), 1
    bits.take(16)
    bits.golomb()
    if profile in _HIGH_PROFILES:
        chroma = bits.golomb()
        bits.take(chroma == 3)
        bits.golomb(), bits.golomb(), bits.take(1)
        if bits.take(1):
            for number in range(12 if chroma == 3 else 8):
                _skip_scaling(bits, 16 if number < 6 else 64)
    bits.golomb()
    order = bits.golomb()
    if order == 0:
        bits.golomb()
    elif order == 1:
        bits.take(1), bits.golomb(), bits.golomb()
        for _ in range(min(bits.golomb(), 255)):
            bits.golomb()
    bits.golomb(), bits.take(1), bits.golomb(), bits.golomb()
    fields = bool(data) and not bits.take(1)
    bits.take(1 + fields)
    left = _left(bits, chroma)
    return _colours(bits), fields, left


def _left(bits: _Bits, chroma: int) -> int:
    """Read what is cut off of each side; return pixels at the left."""
    sides = [bits.golomb() for _ in range(4)] if bits.take(1) else [0]
    return sides[0] * (2 if chroma in (1, 2) else 1)


def _colours(bits: _Bits) -> tuple[int, int, int]:
    """Return primaries, transfer and matrix of the usability information of H.264 and HEVC."""
    if bits.take(1):
        if bits.take(1) and bits.take(8) == 255:
            bits.take(32)
        if bits.take(1):
            bits.take(1)
        if bits.take(1) and bits.take(5) & 1:
            return bits.take(8), bits.take(8), bits.take(8)
    return UNSAID, UNSAID, UNSAID


def _hevc(header: bytes) -> tuple[tuple[int, int, int], int]:
    """Return primaries, transfer and matrix of HEVC, and pixels that are cut off at the left."""
    found = _HEVC_SET.search(header)  # the sequence's parameter set
    if found is None:
        return (UNSAID, UNSAID, UNSAID), 0
    bits = _Bits(header[found.end() : _HEADERS].replace(b"\0\0\3", b"\0\0"))
    bits.take(4)
    layers = bits.take(3)
    bits.take(1 + 96)
    present = [(bits.take(1), bits.take(1)) for _ in range(8 if layers else 0)][:layers]
    for profile, level in present:
        bits.take(88 * profile + 8 * level)
    bits.golomb()
    chroma = bits.golomb()
    bits.take(chroma == 3)
    bits.golomb(), bits.golomb()
    left = _left(bits, chroma)
    bits.golomb(), bits.golomb()
    order = bits.golomb() + 4
    for _ in range(3 * (layers + 1 if bits.take(1) else 1) + 6):
        bits.golomb()
    if bits.take(1) and bits.take(1):
        for size in range(4):
            for _ in range(2 if size == 3 else 6):
                coded = bits.take(1)
                for _ in range((min(64, 16 << 2 * size) + (size > 1)) if coded else 1):
                    bits.golomb()
    bits.take(2)
    if bits.take(1):
        bits.take(8), bits.golomb(), bits.golomb(), bits.take(1)
    places: list[int] = []
    for number in range(min(bits.golomb(), 64)):
        places = _reference_pictures(bits, places, number)
    if bits.take(1):
        for _ in range(min(bits.golomb(), 32)):
            bits.take(order + 1)
    bits.take(2)
    return _colours(bits), left


def _reference_pictures(bits: _Bits, before: list[int], number: int) -> list[int]:
    """Read a set of reference pictures; return their places, the nearest past one first."""
    if number and bits.take(1):
        step = (-1 if bits.take(1) else 1) * (bits.golomb() + 1)
        shifted = [place + step for place in [*before, 0] if bits.take(1) or bits.take(1)]
        past = sorted((place for place in shifted if place < 0), reverse=True)
        return past + sorted(place for place in shifted if place > 0)
    counts = min(bits.golomb(), 16), min(bits.golomb(), 16)
    places = []
    for count, sign in zip(counts, (-1, 1), strict=True):
        place = 0
        for _ in range(count):
            place += sign * (bits.golomb() + 1)
            bits.take(1)
            places.append(place)
    return places


def _enhancements(packet: bytes, head: int) -> Iterator[VideoStatement]:
    """Yield the statements of H.264's or HEVC's supplemental information on the first picture.

    OpenCV gives packets with start codes; heads of units have `head` bytes.
    """
    for unit in filter(None, packet.split(b"\0\0\1")):
        kind = unit[0] & 31 if head == 1 else unit[0] >> 1 & 63
        if kind != (6 if head == 1 else 39):
            continue
        data = unit[head:_HEADERS].replace(b"\0\0\3", b"\0\0")
        while len(data) > 2:  # what is left, down to the stop bit
            kind, data = _in_bytes_of_255(data)
            size, data = _in_bytes_of_255(data)
            bits, data = _Bits(data[:size]), data[size:]
            if kind == _FRAME_PACKING and bits.golomb() >= 0 and not bits.take(1):
                packing = bits.take(7)
                yield laid_out("stereo", _PACKINGS.get(packing), f"frame packing {packing}")
            elif kind == _ORIENTATION and not bits.take(1) and bits.take(18):
                values = {"cure": UPRIGHT}
                yield VideoStatement(
                    "mirror image, other turn", "its frames are said to be turned", values
                )


def _in_bytes_of_255(data: bytes) -> tuple[int, bytes]:
    """Return a number that is the sum of bytes up to the first below 255, and what follows."""
    full = len(data) - len(data.lstrip(b"\xff"))
    return 255 * full + int.from_bytes(data[full : full + 1]), data[full + 1 :]


def _skip_scaling(bits: _Bits, size: int) -> None:
    last = following = 8
    if not bits.take(1):
        return
    for _ in range(size):
        if following:
            code = bits.golomb()
            following = (last + (-(code // 2) if code % 2 == 0 else code // 2 + 1)) % 256
        last = following or last


def _mpeg4_has_fields(header: bytes) -> bool:
    """True if a video object layer of MPEG-4 Part 2 says that its frames are fields."""
    at = header.find(b"\0\0\1\x20")
    if at < 0:
        return False
    bits = _Bits(header[at + 4 : at + 4 + _HEADERS])
    bits.take(9)
    version = 1
    if bits.take(1):
        version = bits.take(4)
        bits.take(3)
    if bits.take(4) == 15:
        bits.take(16)
    if bits.take(1):
        bits.take(3)
        if bits.take(1):
            bits.take(79)
    if bits.take(2) == 3 and version != 1:
        bits.take(4)
    bits.take(1)
    resolution = bits.take(16)
    bits.take(1)
    if bits.take(1):
        bits.take(max(1, (resolution - 1).bit_length()))
    bits.take(29)
    return bool(bits.take(1))
