"""Statistics that do not cross an edge of colour, as they do not cross one of depth: tried.

A part of `benchmarks.ablation`, in numpy alone. When moments are pulled, a texel counts the less
the more its colour in the filled picture differs from that of the texel it goes into. Colours may
be those of a coarser resolution, which texture does not reach. A push that keeps to colours as well
changes nothing that is measured.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import zoom

from pipeline.inpaint.reference import GuidedLevel, pull, push
from pipeline.statistics import reference as statistics

Array = NDArray[np.float64]

SPREAD = 0.1  # of colours that count as alike, R'G'B'


def alike(one: Array, other: Array, spread: float) -> Array:
    """From 1, the same colour, to 0: a Gaussian of their distance in R'G'B'."""
    return np.asarray(np.exp(-((one - other) ** 2).sum(axis=-1) / (2 * spread**2)))


def pull_push_by_colour(
    level: GuidedLevel, colours: Sequence[Array], gamma: float, threshold: float, spread: float
) -> list[GuidedLevel]:
    """`pull_push` whose pulls are guided by the colours of its resolutions too, down to 1x1."""
    levels = [level]
    for here, above in pairwise(colours):
        height, width = here.shape[:2]
        parent = above.repeat(2, axis=0).repeat(2, axis=1)[:height, :width]
        last = levels[-1]
        weighed = last.validity * np.where(last.validity > 0, alike(here, parent, spread), 1.0)
        levels.append(pull(GuidedLevel(last.values, weighed, last.guide), threshold))
    for index in reversed(range(len(levels) - 1)):
        levels[index] = push(levels[index], levels[index + 1], gamma, threshold)
    return levels


def coarser(colours: Sequence[Array], resolutions: int) -> list[Array]:
    """Of every resolution the colours of a coarser one, interpolated."""
    found = []
    for k, here in enumerate(colours):
        source = min(k + resolutions, len(colours) - 1)
        height, width = here.shape[:2]
        scale = 1 << (source - k)
        larger = zoom(colours[source], (scale, scale, 1), order=1, mode="nearest", grid_mode=True)
        found.append(larger[:height, :width])
    return found


def inpainted_statistics(
    base: Array,
    hole: NDArray[np.bool_],
    base_levels: list[GuidedLevel],
    *,
    resolutions: int = 0,
    **settings: Any,
) -> tuple[list[GuidedLevel], list[GuidedLevel]]:
    """As `pipeline.statistics.reference.inpainted_statistics`, but keeping to a colour.

    `resolutions`: by how many the colours that guide are coarser.
    """
    colours = coarser([base, *(level.values for level in base_levels[1:])], resolutions)

    def pulled_and_pushed(level: GuidedLevel, gamma: float, threshold: float) -> list[GuidedLevel]:
        first = next(k for k, c in enumerate(colours) if c.shape[:2] == level.guide.shape)
        return pull_push_by_colour(level, colours[first:], gamma, threshold, SPREAD)

    plain = statistics.inpainted_statistics
    with mock.patch.object(statistics, "pull_push", pulled_and_pushed):
        return plain(base, hole, base_levels, **settings)
