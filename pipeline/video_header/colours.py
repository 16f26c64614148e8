"""Meaning of numbers of ITU-T H.273 for a video's colours, wherever they stand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from pipeline.statements.check_statements import VideoStatement

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
