"""Statistics of the background's bands, carried into the holes.

Kuffner dos Anjos et al. 2022, 3.3: how strong every band of the pyramid is, of what is known near a
hole, pulled and pushed like colour. The paper carries means and squares, and here it is magnitudes.

Twin: gpu.py and moments.glsl. Change both or neither.
"""

from collections.abc import Sequence

import numpy as np

from pipeline.features.reference import range_below, spoiled_levels
from pipeline.frame import Bools, Floats
from pipeline.inpaint.reference import GuidedLevel, near_a_hole, pull_push
from pipeline.inpaint.regions import STATISTICS_RINGS
from pipeline.statistics.moments import known_background, moments, noise_variances


def inpainted_statistics(
    bands: Sequence[Floats],
    hole: Bools,
    base_levels: list[GuidedLevel],
    *,
    cross: bool,
    gamma: float,
    threshold: float,
    skip_depth_edges: bool,
    parts: Sequence[Floats] | None = None,
) -> tuple[list[GuidedLevel], list[GuidedLevel]]:
    """Measure the bands around the holes and say how much noise each hole pixel lacks.

    `bands` are those of the filled frame. `parts` tell level by level how much each of them counts,
    from 0 to 1; None: all do.
    """
    levels, last = len(bands), len(base_levels) - 1  # past 1x1 nothing changes
    guides = [base_levels[min(level, last)].guide for level in range(levels)]
    spoiled = spoiled_levels(hole, levels)
    outlined = [np.zeros_like(mask) for mask in spoiled]
    if skip_depth_edges:
        outlined = outlined_levels(guides, levels, threshold)
    statistics, lacking = [], []
    for level in range(levels):
        near = near_a_hole(hole, level, STATISTICS_RINGS, level + 1)[:: 1 << level, :: 1 << level]
        valid = (near & ~spoiled[level] & ~outlined[level]).astype(np.float64)
        inpainted = band_statistics(
            bands[level],
            valid if parts is None else valid * parts[level],
            guides[level],
            cross=cross,
            gamma=gamma,
            threshold=threshold,
        )
        variances = noise_variances(
            inpainted.values,
            bands[level],
            outlined[level],
            known_background(base_levels[min(level + 1, last)], threshold),
            cross=cross,
        )
        statistics.append(inpainted)
        lacking.append(GuidedLevel(variances, inpainted.validity, inpainted.guide))
    return statistics, lacking


def band_statistics(
    bands: Floats,
    valid: Bools | Floats,
    guide: Floats,
    *,
    cross: bool,
    gamma: float,
    threshold: float,
) -> GuidedLevel:
    """Carry one level's band moments into its holes; the result has half its size.

    Inside a hole moments vary slowly, so nothing finer than the first pull is kept.

    Parameters
    ----------
    bands : (H, W, bands, channels)
        Coefficients of Y', Cb, Cr.
    valid : (H, W)
        How much each of them counts: near a hole, not reaching it (`spoiled_levels`), and not
        across the outline of something nearer (`outlined_levels`).
    guide : (H, W)
    cross : bool
        As in `moments`.

    Returns
    -------
    GuidedLevel
        Of (ceil(H / 2), ceil(W / 2)) texels; its values are as those of `moments`.
    """
    level = GuidedLevel(moments(bands, cross=cross), valid.astype(np.float64), guide)
    return pull_push(level, gamma, threshold)[1]


def outlined_levels(guides: Sequence[Floats], levels: int, threshold: float) -> list[Bools]:
    """Tell, level by level, which coefficients lie across a jump of depth.

    They measure an outline, not the background's texture.

    Parameters
    ----------
    guides : sequence of (H_k, W_k)
        Finest first, to 1x1 or at least `levels` of them.
    """
    # A low band across a jump mixes both sides, and its own guide no longer tells.
    mixed = range_below(guides[0]) > threshold
    found = spoiled_levels(np.zeros(guides[0].shape, np.bool_), levels, mixed)
    for level in range(levels):
        guide = guides[min(level, len(guides) - 1)]  # past 1x1 nothing changes
        found[level] = found[level] | straddles(guide, threshold)
    return found


def straddles(guide: Floats, threshold: float) -> Bools:
    """Return True where a 3x3 neighbourhood holds a jump of depth from its centre."""
    padded = np.pad(guide, 1, mode="edge")
    height, width = guide.shape
    shifts = [padded[i : i + height, j : j + width] for i in range(3) for j in range(3)]
    return np.asarray(np.abs(np.stack(shifts) - guide).max(axis=0) > threshold)
