"""Ratios of band deviations by eccentricity: what a foveated picture kept of each frequency.

At each level of the pyramid (`pipeline.features`), and in rings around the gaze, the root of the
energy of luma's three bands in the picture over that in the reference. 1 is right; a blur falls
towards 0 where pools are wide, noise that is too strong rises above. Energies are added over
bands, places and frames before they are divided, so that no single place decides.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pipeline.colour import ycbcr_from_rgb
from pipeline.features.reference import analyse
from pipeline.foveation.geometry import Geometry, eccentricity_deg, pixel_centres
from stimuli.score.measured import PairScores, RatioCurve
from stimuli.score.metrics import FRAME
from stimuli.score.pair import Image, ScoredPair
from stimuli.score.viewing_conditions import ViewerGaze, ViewingConditions

Floats = NDArray[np.float64]

LEVELS = 4
EDGES_DEG = (0.0, 1.0, 2.0, 3.5, 5.0, 7.5, 10.0, 15.0, 20.0, 30.0, 45.0, 65.0, 90.0, 180.0)
FOVEA_DEG = 1.0
"""Inside nothing changes: it is drawn, and left out of the one number."""
LEAST_COUNT = 32
"""Fewer coefficients in a ring are no statistic."""
LEAST_DEVIATION = 0.5 / 255
"""Least deviation of the reference's band: below half a step of 255 no ratio means anything."""


def measure(pair: ScoredPair, viewing: ViewingConditions, gaze: ViewerGaze) -> PairScores:
    """Measure a clip or picture with its gaze, frame by frame."""
    rings = RingEnergies(viewing.before(pair.width_px, pair.height_px))
    for index, test, truth, _ in pair.walk():
        rings.add(test, truth, gaze.at(index, pair.width_px, pair.height_px))
    curves = rings.curves()
    return PairScores({("band-ratio", FRAME): rings.mean_ratio()}, curves=curves)


class RingEnergies:
    """Energies of bands by level and ring, added over frames."""

    def __init__(self, geometry: Geometry) -> None:
        self.geometry = geometry
        self._sums = np.zeros((LEVELS, len(EDGES_DEG) - 1, 3))  # test, truth, coefficients

    def add(self, test: Image, truth: Image, gaze_px: tuple[float, float]) -> None:
        """Add one frame: encoded R'G'B', shape (H, W, 3)."""
        ours, true = (
            analyse(ycbcr_from_rgb(image.astype(np.float64))[..., :1], LEVELS).bands
            for image in (test, truth)
        )
        for level in range(LEVELS):
            away = eccentricity_deg(self.geometry, gaze_px, *pixel_centres(self.geometry, level))
            ring = np.clip(np.digitize(away, EDGES_DEG) - 1, 0, len(EDGES_DEG) - 2)
            energies = [(bands[level] ** 2).sum(axis=(2, 3)) for bands in (ours, true)]
            for column, values in enumerate([*energies, np.ones(ring.shape)]):
                self._sums[level, :, column] += np.bincount(
                    ring.ravel(), values.ravel(), minlength=len(EDGES_DEG) - 1
                )

    def ratios(self) -> Floats:
        """Ratio of each level (rows) in each ring; NaN where there is nothing to measure."""
        test, truth, count = np.moveaxis(self._sums, 2, 0)
        enough = (count >= LEAST_COUNT) & (truth >= count * LEAST_DEVIATION**2)
        ratio = np.sqrt(test / np.where(enough, truth, 1.0))
        return np.where(enough, ratio, np.nan)

    def curves(self) -> dict[str, RatioCurve]:
        """A curve per level: middles of the rings in degrees, ratios there."""
        middles = [math.sqrt(max(low, 0.5) * high) for low, high in pairwise(EDGES_DEG)]
        found = {}
        for level, row in enumerate(self.ratios()):
            there = [(x, float(y)) for x, y in zip(middles, row, strict=True) if not np.isnan(y)]
            found[f"level {level}"] = tuple(there)
        return found

    def mean_ratio(self) -> float | None:
        """Geometric mean over levels and rings beyond the fovea; None where nothing is."""
        beyond = np.array(EDGES_DEG[:-1]) >= FOVEA_DEG
        there = self.ratios()[:, beyond]
        there = there[~np.isnan(there)]
        if there.size == 0:
            return None
        return float(np.exp(np.log(np.maximum(there, 1e-6)).mean()))
