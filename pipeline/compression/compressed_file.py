"""The file of a compressed picture or clip: docs/formats/compressed-picture.md.

Every number is bounded, and every length compared with the file's, before anything is unpacked.

All maps of what was lost are one grey picture of 8 bits. Beyond Blur, section 5.1.3, remaps each
channel of each map linearly to 0..255. Variances span decades, so their roots, deviations, are
stored: one scale per level and band. Maps of a level stand below one another, levels beside one
another.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.compression.grid import PolarGrid
from pipeline.compression.image_codecs import CODECS
from pipeline.compression.lost import MOST_LEVELS, VALUES, LostMap, map_grids
from pipeline.errors import InputError
from protocols.limits import FIXED

Bytes = NDArray[np.uint8]
Scales = NDArray[np.float32]


def atlas_shape(grids: Sequence[PolarGrid]) -> tuple[int, int]:
    """Rows and columns of the atlas of these maps."""
    return VALUES * grids[0].shape[0], sum(grid.shape[1] for grid in grids)


def pack(maps: Sequence[LostMap]) -> tuple[Bytes, Scales]:
    """Store maps in 8 bits.

    Returns
    -------
    atlas : ndarray of uint8, shape `atlas_shape`
    scales : ndarray of float32, shape (levels, 3)
        The largest deviation of each level and band.
    """
    scales = np.array([np.sqrt(one.variance.max(axis=(0, 1))) for one in maps], np.float32)
    parts = []
    for one, scale in zip(maps, scales, strict=True):
        deviation = np.sqrt(one.variance) / np.where(scale > 0, scale, 1)
        values = np.concatenate([deviation, (one.slope + 1) / 2], axis=2)
        parts.append(np.concatenate(list(np.moveaxis(values, 2, 0)), axis=0))
    return rounded(np.concatenate(parts, axis=1)), scales


def unpack(atlas: Bytes, scales: Scales, grids: Sequence[PolarGrid]) -> list[LostMap]:
    """Undo `pack`."""
    ends = np.cumsum([grid.shape[1] for grid in grids])[:-1]
    maps = []
    for grid, scale, part in zip(grids, scales, np.split(atlas / 255, ends, axis=1), strict=True):
        values = np.stack(np.split(part, VALUES, axis=0), axis=-1)
        deviation = values[..., :3] * scale.astype(np.float64)
        maps.append(LostMap(grid, deviation**2, 2 * values[..., 3:] - 1))
    return maps


def rounded(values: NDArray[np.floating]) -> Bytes:
    """Round from [0, 1] to 0..255; what lies beyond is clipped."""
    return np.asarray(np.clip(np.rint(255 * values), 0, 255), np.uint8)


MAGIC = b"MMLC"
VERSION = 1
MOST_EDGE_PX = FIXED["frame_edge"].most
MOST_PX = FIXED["compressed"].most
LEAST_ANGLES, MOST_ANGLES = 16, 4096
FARTHEST = 4
"""Edges of the picture that a gaze may lie away from it."""
MOST_FRAMES = FIXED["compressed_frames"].most
LARGEST_SCALE = 4.0
"""Largest deviation: coefficients of colour in [0, 1] have less."""

# width, height, gaze x, gaze y, angles, codec, quality, levels, frames, held frames
_HEADER = struct.Struct("<4sB3x II dd HBBB x IH")
_CHECK = struct.Struct("<I")
_LENGTH = struct.Struct("<I")


@dataclass(frozen=True, eq=False)
class Statistics:
    """Coded maps of what was lost: an atlas, and scales (levels, 3) in float32."""

    atlas: bytes
    scales: Scales


@dataclass(frozen=True, eq=False)
class CompressedPicture:
    """A picture or clip for one gaze.

    Parameters
    ----------
    grid : PolarGrid
        Of the base.
    codec : str
        One of `image_codecs.CODECS`, of bases and atlases.
    quality : int
        Of the codec, for bases: what it was asked for.
    levels : int
        Maps of statistics; 0: a foveated picture without any.
    bases : tuple of bytes
        A coded picture in cells for each frame.
    statistics : tuple of Statistics
        For each `hold` frames one; none without levels.
    hold : int
        Frames that share statistics, at least 1.
    """

    grid: PolarGrid
    codec: str
    quality: int
    levels: int
    bases: tuple[bytes, ...]
    statistics: tuple[Statistics, ...]
    hold: int = 1

    def map_grids(self) -> list[PolarGrid]:
        """Grids of the maps."""
        return map_grids(self.grid, self.levels)


def check_request(size: tuple[int, int], gaze_px: tuple[float, float], angles: int) -> None:
    """Require what the format can hold.

    Raises
    ------
    InputError
        Naming the number, its bounds and the cure.
    """
    width, height = size
    if not (1 <= width <= MOST_EDGE_PX and 1 <= height <= MOST_EDGE_PX):
        raise InputError(
            f"a picture must have edges of 1 to {MOST_EDGE_PX} px (has {width} x {height})"
        )
    if width * height > MOST_PX:
        raise InputError(f"a picture must have at most {MOST_PX:,} px (has {width * height:,})")
    if not LEAST_ANGLES <= angles <= MOST_ANGLES:
        raise InputError(f"angles must lie in {LEAST_ANGLES}..{MOST_ANGLES} (got {angles})")
    for name, value, edge in zip("xy", gaze_px, size, strict=True):
        away = FARTHEST * max(size)
        if not (math.isfinite(value) and -away <= value <= edge + away):
            raise InputError(
                f"the gaze must lie within {FARTHEST} picture edges of the picture:"
                f" {name} from {-away} to {edge + away} px (got {value})"
            )


def to_bytes(compressed: CompressedPicture) -> bytes:
    """Write the format."""
    grid = compressed.grid
    header = _HEADER.pack(
        MAGIC,
        VERSION,
        *grid.size,
        *grid.gaze_px,
        grid.rows_per_turn,
        CODECS.index(compressed.codec),
        compressed.quality,
        compressed.levels,
        len(compressed.bases),
        compressed.hold,
    )
    parts = [header]
    for one in compressed.statistics:
        parts += [one.scales.astype("<f4").tobytes(), _LENGTH.pack(len(one.atlas)), one.atlas]
    for base in compressed.bases:
        parts += [_LENGTH.pack(len(base)), base]
    body = b"".join(parts)
    return body + _CHECK.pack(zlib.crc32(body))


def from_bytes(data: bytes, name: str = "the file") -> CompressedPicture:
    """Read the format.

    Raises
    ------
    InputError
        Naming what does not hold; nothing large was allocated by then.
    """
    body = data[: -_CHECK.size]
    if len(data) < _HEADER.size + _CHECK.size or not data.startswith(MAGIC):
        raise InputError(
            f"{name}: must be a compressed picture of metamerlab, which begins with MMLC;"
            " metamerlab compress makes one"
        )
    (version,) = data[4:5]
    if version != VERSION:
        raise InputError(
            f"{name}: must be of version {VERSION} (is of version {version});"
            " a newer metamerlab reads it"
        )
    if zlib.crc32(body) != _CHECK.unpack(data[-_CHECK.size :])[0]:
        raise InputError(f"{name}: its checksum does not hold: it was damaged; copy it again")
    try:
        return _parsed(body)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def _parsed(body: bytes) -> CompressedPicture:
    (_, _, width, height, x, y, angles, codec, quality, levels, frames, hold) = _HEADER.unpack_from(
        body
    )
    check_request((width, height), (x, y), angles)
    if codec >= len(CODECS):
        raise InputError(f"its codec must be one of 0..{len(CODECS) - 1} (is {codec})")
    if not 1 <= frames <= MOST_FRAMES:
        raise InputError(f"it must hold 1..{MOST_FRAMES} frames (says {frames})")
    if hold < 1:
        raise InputError("statistics must be held for at least 1 frame (says 0)")
    grid = PolarGrid((width, height), (x, y), angles)
    if levels > MOST_LEVELS or len(map_grids(grid, levels)) != levels:
        raise InputError(f"it cannot have {levels} levels of statistics")
    rest = _Rest(body, _HEADER.size)
    groups = -(-frames // hold) if levels else 0
    statistics = tuple(rest.statistics(levels) for _ in range(groups))
    bases = tuple(rest.block() for _ in range(frames))
    rest.end()
    return CompressedPicture(grid, CODECS[codec], quality, levels, bases, statistics, hold)


class _Rest:
    """Rest of a file's body, read block by block."""

    def __init__(self, body: bytes, at: int) -> None:
        self._body, self._at = body, at

    def take(self, count: int) -> bytes:
        if count > len(self._body) - self._at:
            raise InputError("it ends before what it says it holds")
        self._at += count
        return self._body[self._at - count : self._at]

    def block(self) -> bytes:
        return self.take(_LENGTH.unpack(self.take(_LENGTH.size))[0])

    def statistics(self, levels: int) -> Statistics:
        scales = np.frombuffer(self.take(12 * levels), "<f4").reshape(levels, 3)
        if not (np.isfinite(scales) & (scales >= 0) & (scales <= LARGEST_SCALE)).all():
            raise InputError(f"deviations must lie in 0..{LARGEST_SCALE:g}")
        return Statistics(self.block(), scales.astype(np.float32))

    def end(self) -> None:
        if self._at != len(self._body):
            raise InputError(f"{len(self._body) - self._at} bytes more than it says it holds")


def read_compressed(path: Path) -> CompressedPicture:
    """Read a file.

    Raises
    ------
    FileNotFoundError
        If there is none.
    InputError
        As `from_bytes`.
    """
    return from_bytes(path.read_bytes(), str(path))
