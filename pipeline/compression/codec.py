"""Compress pictures for a gaze, and make them again.

Beyond Blur, section 5.1: what a server sends are colours in cells that grow with the eccentricity,
and statistics of what such cells lose; what a client shows is any picture that has them.

Twin of `decompress`: gpu.py. Change both or neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.compression import compressed_file, image_codecs
from pipeline.compression.compressed_file import (
    LEAST_ANGLES,
    MOST_ANGLES,
    CompressedPicture,
    Statistics,
    atlas_shape,
    pack,
    rounded,
    unpack,
)
from pipeline.compression.grid import PolarGrid, fitted_cells, from_cells
from pipeline.compression.lost import (
    MOST_LEVELS,
    LostMap,
    lost_maps,
    map_grids,
    mean_of_maps,
    with_noise,
)
from pipeline.errors import InputError
from pipeline.foveation.picture_fixation import float_picture
from pipeline.frame import Floats, check_seed

Bytes = NDArray[np.uint8]

DEFAULT_CODEC = "jpeg"
DEFAULT_ANGLES = 512
DEFAULT_QUALITY = 75
LEAST_QUALITY, FINER_QUALITY = 75, 85
"""Lowest qualities of the codec where a size is asked for, of `DEFAULT_ANGLES` and fewer, and of
more: fewer angles are better than less."""
MAP_QUALITY = 50
"""Quality of the atlas: maps are smooth, and half of an error in them is not seen."""
FIRST_SHARE = 0.15
"""Share of a size that is asked for, which maps are taken to need before they are made."""


@dataclass(frozen=True)
class CompressionSettings:
    """Settings of compression.

    Parameters
    ----------
    codec : str
        One of `image_codecs.CODECS`.
    angles : int, optional
        Cells on a circle around the gaze. Cells are pixels up to ``angles / 2 pi`` pixels from it.
        Left out: `DEFAULT_ANGLES`; with a size as many as fit at `LEAST_QUALITY`, to a factor of
        two.
    quality : int
        Of the codec, for colour.
    size_bytes : int, optional
        The largest file instead: the best quality that fits is looked for.
    statistics : bool
        Without them the picture is foveated, and blurred in the periphery.
    hold : int
        Frames of a clip that share statistics.
    """

    codec: str = DEFAULT_CODEC
    angles: int | None = None
    quality: int = DEFAULT_QUALITY
    size_bytes: int | None = None
    statistics: bool = True
    hold: int = 12

    def __post_init__(self) -> None:
        image_codecs.check_codec(self.codec)
        if not 1 <= self.quality <= image_codecs.BEST_QUALITY:
            raise InputError(
                f"quality must lie in 1..{image_codecs.BEST_QUALITY} (got {self.quality})"
            )
        if not 1 <= self.hold <= 65535:
            raise InputError(f"hold must lie in 1..65535 frames (got {self.hold})")
        if self.size_bytes is not None and self.size_bytes < 1:
            raise InputError(f"the size must be positive (got {self.size_bytes} bytes)")


def compress(
    pictures: Sequence[NDArray[np.floating]],
    gaze_px: tuple[float, float],
    settings: CompressionSettings | None = None,
) -> CompressedPicture:
    """Compress a picture, or the frames of a clip.

    Parameters
    ----------
    pictures : sequence of ndarray of shape (H, W, 3)
        Encoded R'G'B' in [0, 1], all of one size.
    gaze_px : (x, y)
        Where the eye looks, also off the picture.

    Raises
    ------
    InputError
        If pictures are of several sizes, a number is out of range, or the size cannot be reached.
    """
    settings = settings or CompressionSettings()
    if not pictures:
        raise InputError("there must be at least one picture to compress (got none)")
    frames = [float_picture(picture) for picture in pictures]
    height, width = frames[0].shape[:2]
    if any(frame.shape != frames[0].shape for frame in frames):
        raise InputError("the frames of a clip must all be of one size")
    angles, size_bytes = settings.angles or DEFAULT_ANGLES, settings.size_bytes
    compressed_file.check_request((width, height), gaze_px, angles)
    place = float(gaze_px[0]), float(gaze_px[1])

    def with_angles(count: int) -> _Work:
        return _Work(PolarGrid((width, height), place, count), frames, settings)

    work = with_angles(angles)
    if size_bytes is None:
        return work.at_quality(settings.quality)
    if settings.angles is not None:
        return work.at_size(size_bytes)
    while angles < MOST_ANGLES and work.fits(size_bytes) and not work.has_every_pixel:
        finer = with_angles(2 * angles)
        if not finer.fits(size_bytes, FINER_QUALITY):
            break
        angles, work = 2 * angles, finer
    while angles > LEAST_ANGLES:
        if work.fits(size_bytes):
            with suppress(InputError):  # maps may take more than was thought
                found = work.at_size(size_bytes)
                if found.quality >= LEAST_QUALITY / 2:
                    return found
        angles //= 2
        work = with_angles(angles)
    return work.at_size(size_bytes)


class _Work:
    """Frames in cells, coded as often as a size needs."""

    def __init__(
        self, grid: PolarGrid, frames: Sequence[NDArray[np.float32]], settings: CompressionSettings
    ) -> None:
        self._grid, self._frames, self._settings = grid, frames, settings
        self._cells = [rounded(fitted_cells(frame.astype(np.float64), grid)) for frame in frames]
        self._maps = map_grids(grid, MOST_LEVELS if settings.statistics else 0)
        self._coded: dict[int, tuple[bytes, ...]] = {}

    def at_quality(self, quality: int) -> CompressedPicture:
        """Code bases at a quality, and maps of what these lack."""
        codec, hold = self._settings.codec, self._settings.hold
        bases = self._bases(quality)
        groups = range(0, len(bases), hold) if self._maps else ()
        statistics = tuple(
            self._statistics(bases[at : at + hold], self._frames[at : at + hold]) for at in groups
        )
        return CompressedPicture(
            self._grid, codec, quality, len(self._maps), bases, statistics, hold
        )

    @property
    def has_every_pixel(self) -> bool:
        """True if no cell is wider than a pixel."""
        return self._grid.density.turn_px >= self._grid.farthest_px

    def fits(self, size_bytes: int, quality: int = LEAST_QUALITY) -> bool:
        """True if so many bytes leave the bases this quality."""
        return self._best_within(self._room(size_bytes)) >= quality

    def _room(self, size_bytes: int) -> float:
        """Bytes that maps leave of a size, before they are made."""
        return size_bytes * (1 - FIRST_SHARE) if self._maps else size_bytes

    def at_size(self, size_bytes: int) -> CompressedPicture:
        """Look for the best quality of the bases with which the whole fits."""
        quality = self._best_within(self._room(size_bytes))
        while True:
            found = self.at_quality(max(quality, 1))
            over = len(compressed_file.to_bytes(found)) - size_bytes
            if over <= 0 or quality <= 1:
                break
            # What maps take hardly depends on the quality of the bases.
            bases = sum(len(base) for base in found.bases)
            quality = min(quality - 1, self._best_within(bases - over))
        if over > 0:
            fewer = "fewer angles, or for " if self._grid.rows_per_turn > LEAST_ANGLES else ""
            raise InputError(
                f"{size_bytes} bytes are too few: the least that {self._settings.codec} and"
                f" {self._grid.rows_per_turn} angles reach are {size_bytes + over};"
                f" ask for {fewer}a larger file"
            )
        return self._raised(found, quality, size_bytes)

    def _raised(self, found: CompressedPicture, quality: int, size_bytes: int) -> CompressedPicture:
        """Use what room is left: maps may have taken less than was thought."""
        left = size_bytes - len(compressed_file.to_bytes(found))
        better = self._best_within(sum(len(base) for base in found.bases) + left)
        if better > quality:
            again = self.at_quality(better)
            if len(compressed_file.to_bytes(again)) <= size_bytes:
                return again
        return found

    def _best_within(self, room: float) -> int:
        """The best quality of bases in so many bytes; 0: none."""
        return image_codecs.best_quality(
            lambda quality: sum(len(base) for base in self._bases(quality)) <= room
        )

    def _bases(self, quality: int) -> tuple[bytes, ...]:
        if quality not in self._coded:
            self._coded[quality] = tuple(
                image_codecs.encode(cells, self._settings.codec, quality) for cells in self._cells
            )
        return self._coded[quality]

    def _statistics(
        self, bases: Sequence[bytes], frames: Sequence[NDArray[np.float32]]
    ) -> Statistics:
        maps = [
            lost_maps(frame, decoded_base(base, self._grid, self._settings.codec), self._maps)
            for base, frame in zip(bases, frames, strict=True)
        ]
        atlas, scales = pack(mean_of_maps(maps))
        return Statistics(image_codecs.encode(atlas, self._settings.codec, MAP_QUALITY), scales)


def decoded_cells(base: bytes, grid: PolarGrid, codec: str) -> Bytes:
    """Colour in cells: uint8, (rows, columns, 3)."""
    return image_codecs.decode(base, codec, (*grid.shape, 3), "the picture in it")


def decoded_base(base: bytes, grid: PolarGrid, codec: str) -> Floats:
    """The picture that a coded base holds, (H, W, 3) in [0, 1]."""
    return np.clip(from_cells(decoded_cells(base, grid, codec) / 255, grid), 0, 1)


def decoded_maps(compressed: CompressedPicture, frame: int = 0) -> list[LostMap]:
    """Return the maps of what was lost in a frame, a level each; none without statistics."""
    grids = compressed.map_grids()
    if not grids:
        return []
    held = compressed.statistics[frame // compressed.hold]
    atlas = image_codecs.decode(held.atlas, compressed.codec, atlas_shape(grids), "the maps in it")
    return unpack(atlas, held.scales, grids)


def decompress(
    compressed: CompressedPicture, *, seed: int = 0, frame: int = 0
) -> NDArray[np.float32]:
    """Make a picture that has the statistics in the file.

    Parameters
    ----------
    seed : int
        Of the noise: from 0 to 2**63 - 1. Frames of a clip share one, so their noise stands still.
    frame : int
        Of a clip.

    Returns
    -------
    ndarray of float32, shape (H, W, 3)
        Encoded R'G'B' in [0, 1].

    Raises
    ------
    InputError
        If the pictures in it are damaged.
    """
    check_seed(seed)
    picture = decoded_base(compressed.bases[frame], compressed.grid, compressed.codec)
    maps = decoded_maps(compressed, frame)
    if maps:
        picture = with_noise(picture, maps, seed)
    return np.clip(picture, 0, 1).astype(np.float32)
