"""One picture in files of one size: a plain codec, foveated, and foveated with statistics.

The rows of Beyond Blur's Fig. 11, and what can be measured of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.compression import compressed_file, image_codecs
from pipeline.compression.codec import CompressionSettings, compress, decompress
from pipeline.errors import InputError
from pipeline.foveation.geometry import Geometry, eccentricity_deg, pixel_centres
from pipeline.pictures import drawing
from pipeline.quality import psnr_db
from stimuli.score.statistics import statistics_distance

FOVEA_DEG = 2.0
"""Within it the fovea's error is measured."""


@dataclass(frozen=True, eq=False)
class Rival:
    """A picture that came out of a file.

    Attributes
    ----------
    kind : str
        ``plain_rival``, ``foveated`` or ``metameric``.
    quality : int
        Of the codec: the best that fits.
    shown : ndarray of float32, shape (H, W, 3)
    """

    kind: str
    codec: str
    quality: int
    size_bytes: int
    shown: NDArray[np.float32]

    @property
    def name(self) -> str:
        return f"{self.kind} {self.codec.upper()}"


@dataclass(frozen=True)
class InfeasibleRival:
    """A rival that cannot be so small, and why."""

    name: str
    why: str


@dataclass(frozen=True)
class RivalQuality:
    """Measures of a rival.

    Attributes
    ----------
    distance : float
        Of pooled statistics from the picture's, at the gaze.
    fovea_psnr_db : float
        Within `FOVEA_DEG`; infinite if nothing changed, NaN if none of it is on the picture.
    """

    distance: float
    fovea_psnr_db: float


def rivals(
    picture: NDArray[np.float32],
    gaze_px: tuple[float, float],
    settings: CompressionSettings,
    *,
    kinds: Iterable[str] = ("plain", "foveated", "metameric"),
) -> list[Rival | InfeasibleRival]:
    """Make a picture's files of at most the settings' size, by one codec, as far as they can be."""
    found: list[Rival | InfeasibleRival] = []
    for kind in kinds:
        try:
            found.append(_rival(kind, picture, gaze_px, settings))
        except InputError as error:
            found.append(InfeasibleRival(f"{kind} {settings.codec.upper()}", str(error)))
    return found


def _rival(
    kind: str,
    picture: NDArray[np.float32],
    gaze_px: tuple[float, float],
    asked: CompressionSettings,
) -> Rival:
    if kind == "plain":
        assert asked.size_bytes is not None
        return plain_rival(picture, asked.size_bytes, asked.codec)
    made = compress([picture], gaze_px, replace(asked, statistics=kind == "metameric"))
    size = len(compressed_file.to_bytes(made))
    return Rival(kind, asked.codec, made.quality, size, decompress(made, seed=0))


def plain_rival(picture: NDArray[np.float32], size_bytes: int, codec: str) -> Rival:
    """Code the picture as it is, as well as so many bytes allow, its chroma thinned or not."""
    stored = drawing.of_colour(picture)
    found = [
        rival
        for chroma in (image_codecs.WHOLE_CHROMA, image_codecs.THINNED_CHROMA)
        if (rival := _plain(stored, size_bytes, codec, chroma)) is not None
    ]
    if not found:
        least = len(image_codecs.encode(stored, codec, 1, image_codecs.THINNED_CHROMA))
        raise InputError(f"{size_bytes} bytes are too few for plain {codec}, which needs {least}")
    return min(found, key=lambda rival: float(np.square(rival.shown - picture).mean()))


def _plain(stored: NDArray[np.uint8], size_bytes: int, codec: str, chroma: str) -> Rival | None:
    def coded(quality: int) -> bytes:
        return image_codecs.encode(stored, codec, quality, chroma)

    quality = image_codecs.best_quality(lambda q: len(coded(q)) <= size_bytes)
    if quality == 0:
        return None
    data = coded(quality)
    shown = image_codecs.decode(data, codec, stored.shape, "the picture") / np.float32(255)
    return Rival("plain", codec, quality, len(data), shown.astype(np.float32))


def measured(
    rival: Rival, picture: NDArray[np.float32], geometry: Geometry, gaze_px: tuple[float, float]
) -> RivalQuality:
    """Compare what is shown with the picture."""
    away_deg = eccentricity_deg(geometry, gaze_px, *pixel_centres(geometry))
    near = away_deg <= FOVEA_DEG
    psnr = psnr_db(rival.shown, picture, near) if near.any() else float("nan")
    return RivalQuality(statistics_distance(rival.shown, picture, gaze_px=gaze_px), psnr)


def rival_sheet(
    picture: NDArray[np.float32],
    found: Sequence[Rival | InfeasibleRival],
    measure: Callable[[Rival], RivalQuality],
) -> drawing.Picture:
    """Lay the picture and its rivals out on one labelled sheet; what there is not is grey."""
    tiles = [("picture", drawing.of_colour(picture))]
    for rival in found:
        if isinstance(rival, InfeasibleRival):
            grey = np.full_like(picture, 0.5)
            tiles.append((f"no {rival.name}: {rival.why}", drawing.of_colour(grey)))
            continue
        numbers = measure(rival)
        tiles.append(
            (
                f"{rival.name}, {rival.size_bytes / 1000:.1f} kB: statistics distance"
                f" {numbers.distance:.3f}, fovea {numbers.fovea_psnr_db:.1f} dB",
                drawing.of_colour(rival.shown),
            )
        )
    return drawing.sheet(tiles)
