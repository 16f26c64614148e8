"""Distance of two pictures by what the eye keeps of them: local statistics of bands.

Beyond Blur (Walton et al. 2021, section 5) hopes for a metric made of its own activations:
two pictures whose steerable bands have equal means and deviations, pooled over regions that
grow with the distance from the gaze, are metamers, however their pixels differ. Here:

1. Both pictures become Y'Cb'Cr' and steerable bands (`pipeline.features`), `LEVELS` of them.
2. The mean and the deviation of every band are pooled by a Gaussian. Its full width at half
   maximum is `POOLING_SHARE` of the eccentricity, and its deviation never falls below
   `LEAST_POOL` coefficients of the band's level: fewer are no statistic. Wide Gaussians come
   from a pyramid of halved moments, interpolated within and between its levels, as in
   section 3.2. Eccentricity and width are lengths on the screen (small angles), so that no
   display has to be known. What lies below the last level (its mean and deviation) counts as
   one level more.
3. At every place and level the distance is
   ``sqrt(sum (m - m')^2 + (s - s')^2) / sqrt(sum m'^2 + s'^2 + NOISE_FLOOR^2)``
   over bands and channels, with the reference's moments primed; means of the last, lowest
   level are not divided by themselves but by the deviations of all levels (no picture is
   entitled to a larger error because it is bright).
4. Levels are averaged, then places (inside the holes, weighed by how much of a place is hole),
   then frames.

0 is a metamer; 1 is about as far as a flat grey of the right brightness is from texture.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.colour import ycbcr_from_rgb
from pipeline.features.reference import analyse
from stimuli.score.measured import PairScores, mean_of
from stimuli.score.metrics import FRAME, HOLES
from stimuli.score.pair import Image, Mask, ScoredPair, composed_region
from stimuli.score.viewing_conditions import ViewerGaze, ViewingConditions

Floats = NDArray[np.float64]

LEVELS = 4
POOLING_SHARE = 0.46
"""Width of a pooling region over its eccentricity: V2 in Freeman and Simoncelli 2011."""
LEAST_POOL = 4.0
"""Least deviation of a pool, coefficients of its level; as `pipeline.quality` pools."""
NOISE_FLOOR = 0.01
"""Deviation, of encoded colour in [0, 1], below which a band is not seen."""
_FWHM = 2.354820045  # of a Gaussian, in deviations
_FIRST = 2  # halvings before moments are looked at: their Gaussian is narrower than any pool


def measure(pair: ScoredPair, viewing: ViewingConditions, gaze: ViewerGaze) -> PairScores:  # noqa: ARG001
    """Measure every frame; where the gaze is unknown, it rests on the middle."""
    per_frame: dict[tuple[str, str], list[float | None]] = {
        ("statistics", region): [] for region in pair.regions
    }
    for index, test, truth, hole in pair.walk():
        at = gaze.at(index, pair.width_px, pair.height_px)
        true = pooled_moments(truth, at)
        for region in pair.regions:
            value = None
            if region == FRAME or hole.any():
                ours = pooled_moments(composed_region(test, truth, hole, region), at)
                value = _distance(ours, true, hole if region == HOLES else None)
            per_frame["statistics", region].append(value)
    return PairScores({key: mean_of(found) for key, found in per_frame.items()}, per_frame)


def statistics_distance(
    test: Image,
    truth: Image,
    *,
    gaze_px: tuple[float, float] | None = None,
    mask: Mask | None = None,
) -> float:
    """Return the distance of the statistics of `test` from those of `truth`.

    Parameters
    ----------
    test, truth : ndarray of float32, shape (H, W, 3)
        Encoded R'G'B' in [0, 1]; at least 32 px high and wide.
    gaze_px : (x, y), optional
        By default the middle.
    mask : ndarray of bool, shape (H, W), optional
        Places to average; by default all.
    """
    height, width = truth.shape[:2]
    at = gaze_px or (width / 2, height / 2)
    ours, true = (pooled_moments(image, at) for image in (test, truth))
    return _distance(ours, true, mask)


def pooled_moments(image: Image, gaze_px: tuple[float, float]) -> list[Floats]:
    """Return means and deviations per level, shape (2, h, w, bands x channels).

    Places lie 4 coefficients of the level apart. The last entry is what lies below the bands.
    """
    pyramid = analyse(ycbcr_from_rgb(image.astype(np.float64)), LEVELS)
    flat = [band.reshape(*band.shape[:2], -1) for band in pyramid.bands] + [pyramid.residual]
    return [_pool(values, level, gaze_px) for level, values in enumerate(flat)]


def _pool(values: Floats, level: int, gaze_px: tuple[float, float]) -> Floats:
    """Moments of one level at every place, from the two nearest of a pyramid of halvings."""
    scale = 2.0**level
    both = np.concatenate([values, values**2], axis=2)
    halved = [both]
    while min(halved[-1].shape[:2]) > 2 and len(halved) < 9:
        halved.append(_halve(halved[-1]))
    first = min(_FIRST, len(halved) - 1)
    places = halved[first].shape[0], halved[first].shape[1]
    y, x = ((np.arange(count) + 0.5) * scale * 2**first for count in places)
    away_px = np.hypot(x[None, :] - gaze_px[0], y[:, None] - gaze_px[1])
    sigma_px = POOLING_SHARE * away_px / _FWHM
    sigma = np.maximum(sigma_px / scale, LEAST_POOL)
    wanted = np.clip(np.log2(np.sqrt(3.0 * sigma**2 + 1.0)), first, len(halved) - 1)
    moments = np.zeros((*places, both.shape[2]))
    for index in range(first, len(halved)):
        weight = np.clip(1.0 - np.abs(wanted - index), 0.0, None)
        if weight.any():
            moments += weight[..., None] * _enlarge(halved[index], places)
    mean, square = np.split(moments, 2, axis=2)
    return np.stack([mean, np.sqrt(np.maximum(square - mean**2, 0.0))])


def _distance(ours: list[Floats], true: list[Floats], mask: Mask | None) -> float:
    energy_below = [np.mean(level[1] ** 2) * level.shape[-1] for level in true]
    total = 0.0
    for index, (mine, theirs) in enumerate(zip(ours, true, strict=True)):
        difference = ((mine - theirs) ** 2).sum(axis=(0, 3))
        lowest = index == len(true) - 1
        energy = (theirs[1:] if lowest else theirs) ** 2
        norm = energy.sum(axis=(0, 3)) + NOISE_FLOOR**2
        if lowest:
            norm = norm + sum(energy_below[:-1])
        total += _average(np.sqrt(difference / norm), mask)
    return total / len(true)


def _average(places: Floats, mask: Mask | None) -> float:
    if mask is None:
        return float(places.mean())
    share = cv2.resize(mask.astype(np.float64), places.shape[::-1], interpolation=cv2.INTER_AREA)
    return float((places * share).sum() / share.sum())


def _halve(image: Floats) -> Floats:
    """Low-pass by (1 4 6 4 1) / 16 both ways and keep every second place."""
    return _shaped(cv2.pyrDown(image), image)


def _enlarge(image: Floats, places: tuple[int, int]) -> Floats:
    if image.shape[:2] == places:
        return image
    return _shaped(cv2.resize(image, places[::-1], interpolation=cv2.INTER_LINEAR), image)


def _shaped(image: Any, like: Floats) -> Floats:
    """OpenCV drops a last axis of length 1, and its types say too much."""
    return np.asarray(image, np.float64).reshape(*image.shape[:2], like.shape[2])
