"""Mixing of noise bands before they are weighed: what `benchmarks/fits/fit_mixing.py` found.

One matrix suits no two spectra alike: see gains.py for what corrects the rest.
"""

import json
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from pipeline.features.reference import BANDS, check_levels
from pipeline.frame import Floats

LAGS = ((0, 1), (1, 0), (1, 1), (1, -1))  # (row, column)


@dataclass(frozen=True, eq=False)
class Mixing:
    """Mixing for one number of levels; bands of all levels in one row, B = 3 * levels.

    `matrix` (B, B): weights to give the unit bands are ``matrix @ (deviations * gains)``, by the
    gains of `gains.spectral_gains`.
    `overlap` (B, B, B): weighed by deviations s, mixed bands measure the variance
    ``s @ overlap[b] @ s`` in band b, on an endless plane.
    `together` (B, B): their sum has the variance ``s @ together @ s``.
    `lag_correlation` (levels, 3, len(LAGS)): of mixed bands, see `tile.look_up`.
    """

    matrix: Floats
    overlap: Floats
    together: Floats
    lag_correlation: NDArray[np.float32]


@lru_cache(maxsize=6)
def fitted_mixing(levels: int) -> Mixing:
    """The mixing that `benchmarks/fits/fit_mixing.py` wrote.

    Raises
    ------
    InputError
        If `levels` is not in 1..6.
    """
    check_levels(levels)
    text = resources.files("pipeline.noise").joinpath("mixing.json").read_text("utf-8")
    records = json.loads(text)
    record = records[str(levels)]
    lags = np.array(record["lag_correlation"], np.float32)
    matrix = np.array(record["matrix"])
    first = slice(3 * levels)
    covariances = unpacked(np.array(records["covariances"]))[first, first, first]
    correlations = np.array(records["correlations"])[first, first]
    return Mixing(
        matrix,
        overlaps(covariances, matrix),
        matrix.T @ correlations @ matrix,
        lags.reshape(levels, len(BANDS), len(LAGS)),
    )


def overlaps(covariances: Floats, matrix: Floats) -> Floats:
    """Variances that mixed bands measure, from those of unit bands: both (B, B, B)."""
    return np.asarray(matrix.T @ covariances @ matrix)


def packed(covariances: Floats) -> Floats:
    """Upper halves of symmetric matrices: (B, B, B) to (B, B * (B + 1) / 2)."""
    rows, columns = np.triu_indices(len(covariances))
    return np.asarray(covariances[:, rows, columns])


def unpacked(halves: Floats) -> Floats:
    """Undo `packed`."""
    count = len(halves)
    rows, columns = np.triu_indices(count)
    whole = np.empty((count,) * 3)
    whole[:, rows, columns] = whole[:, columns, rows] = halves
    return whole


def measured_variances(wanted: Floats, overlap: Floats) -> Floats:
    """Variances of mixed bands weighed by deviations `wanted`, (..., B), on an endless plane."""
    count = len(overlap)
    rows = wanted.reshape(-1, count)
    measured = np.stack([((rows @ form) * rows).sum(axis=1) for form in overlap], axis=1)
    return np.asarray(np.maximum(measured, 0.0).reshape(wanted.shape))
