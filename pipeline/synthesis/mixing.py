"""How noise bands are mixed before they are weighed: what fit_mixing.py found."""

import json
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from pipeline.features.reference import BANDS, check_levels

LAGS = ((0, 1), (1, 0), (1, 1), (1, -1))  # (row, column)


@dataclass(frozen=True, eq=False)
class Mixing:
    """For one number of levels; bands of all levels in one row, B = 3 * levels.

    `matrix` (B, B): weights to give the unit bands are ``matrix @ deviations``.
    `lag_correlation` (levels, 3, len(LAGS)): of mixed bands, see `reference.look_up`.
    """

    matrix: NDArray[np.float64]
    lag_correlation: NDArray[np.float32]


@lru_cache(maxsize=6)
def fitted_mixing(levels: int) -> Mixing:
    """The mixing that fit_mixing.py wrote.

    Raises
    ------
    InputError
        If `levels` is not in 1..6.
    """
    check_levels(levels)
    text = resources.files("pipeline.synthesis").joinpath("mixing.json").read_text("utf-8")
    record = json.loads(text)[str(levels)]
    lags = np.array(record["lag_correlation"], np.float32)
    return Mixing(np.array(record["matrix"]), lags.reshape(levels, len(BANDS), len(LAGS)))
