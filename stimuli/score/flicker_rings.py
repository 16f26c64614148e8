"""Flicker by eccentricity: change from frame to frame that the reference does not have, in rings.

Each step of the clip less that of the reference, its size averaged over colours, frames and the
pixels of a ring around the gaze of the later frame. The one number is the mean of the rings.
"""

from __future__ import annotations

import numpy as np

from pipeline.foveation.geometry import eccentricity_deg, pixel_centres
from stimuli.score.band_ratios import LEAST_COUNT
from stimuli.score.measured import PairScores, mean_of
from stimuli.score.metrics import FRAME, RING_DEG, RINGS
from stimuli.score.pair import ScoredPair
from stimuli.score.viewing_conditions import ViewerGaze, ViewingConditions


def measure(pair: ScoredPair, viewing: ViewingConditions, gaze: ViewerGaze) -> PairScores:
    """Measure a clip, in steps of 1/255."""
    geometry = viewing.before(pair.width_px, pair.height_px)
    sums, counts = np.zeros((2, len(RINGS)))
    last = None
    for index, test, truth, _ in pair.walk():
        error = test - truth
        if last is not None:
            at = gaze.at(index, pair.width_px, pair.height_px)
            ring = eccentricity_deg(geometry, at, *pixel_centres(geometry)) // RING_DEG
            step = 255 * np.abs(error - last).mean(axis=2, dtype=np.float64)
            for sum_to, weights in ((sums, step), (counts, np.ones_like(step))):
                sum_to += np.bincount(ring.astype(int).ravel(), weights.ravel(), len(RINGS))
        last = error
    found = {
        ring: float(total / count)
        for ring, total, count in zip(RINGS, sums, counts, strict=True)
        if count >= LEAST_COUNT
    }
    whole = mean_of(list(found.values()))
    return PairScores(
        {("flicker-rings", place): value for place, value in {**found, FRAME: whole}.items()}
    )
