"""How noise bands are mixed before they are weighed: what fit_mixing.py found.

One matrix suits no two spectra alike. What the mixed bands of given weights measure is known,
though, and weights are corrected by it (docs/decisions/0048).

Fills weigh mixed bands as they are. Foveated pictures, which hold every spectrum side by side, add
the gains. Twin of `spectral_gains`: spectral_gains.glsl. Change both or neither.
"""

import json
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from pipeline.features.reference import BANDS, check_levels

LAGS = ((0, 1), (1, 0), (1, 1), (1, -1))  # (row, column)
# Over what a plane asks for: in holes, variances fall towards the border.
AIM = 1.03
# No band is weakened to less or raised to more: single textures may ask for odd spectra.
LEAST_GAIN, MOST_GAIN = 0.25, 1.5
# Added to the variance asked for and the one measured: a quarter of an 8-bit step, squared. Where
# both are less, nobody sees the difference.
UNSEEN_VARIANCE = 2.0**-20
# Weights that differ from place to place do not cancel out in finer bands as even ones do, and the
# second level's high band leaves most in the finest one: so it is asked for less the softer waves
# are. This share of its oriented bands' variance counts as measured.
UNEVEN = 0.045


@dataclass(frozen=True, eq=False)
class Mixing:
    """For one number of levels; bands of all levels in one row, B = 3 * levels.

    `matrix` (B, B): weights to give the unit bands are ``matrix @ (deviations * gains)``, by the
    gains of `spectral_gains`.
    `overlap` (B, B, B): weighed by deviations s, mixed bands measure the variance
    ``s @ overlap[b] @ s`` in band b, on an endless plane.
    `lag_correlation` (levels, 3, len(LAGS)): of mixed bands, see `reference.look_up`.
    """

    matrix: NDArray[np.float64]
    overlap: NDArray[np.float64]
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
    records = json.loads(text)
    record = records[str(levels)]
    lags = np.array(record["lag_correlation"], np.float32)
    matrix = np.array(record["matrix"])
    covariances = unpacked(np.array(records["covariances"]))[(slice(3 * levels),) * 3]
    return Mixing(
        matrix, overlaps(covariances, matrix), lags.reshape(levels, len(BANDS), len(LAGS))
    )


def overlaps(covariances: NDArray[np.float64], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """What mixed bands measure, from what unit bands do: both (B, B, B)."""
    return np.asarray(matrix.T @ covariances @ matrix)


def packed(covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Upper halves of symmetric matrices: (B, B, B) to (B, B * (B + 1) / 2)."""
    rows, columns = np.triu_indices(len(covariances))
    return np.asarray(covariances[:, rows, columns])


def unpacked(halves: NDArray[np.float64]) -> NDArray[np.float64]:
    """Undo `packed`."""
    count = len(halves)
    rows, columns = np.triu_indices(count)
    whole = np.empty((count,) * 3)
    whole[:, rows, columns] = whole[:, columns, rows] = halves
    return whole


def measured_variances(
    wanted: NDArray[np.float64], overlap: NDArray[np.float64]
) -> NDArray[np.float64]:
    """What mixed bands weighed by deviations `wanted`, (..., B), measure on an endless plane."""
    count = len(overlap)
    rows = wanted.reshape(-1, count)
    measured = np.stack([((rows @ form) * rows).sum(axis=1) for form in overlap], axis=1)
    return np.asarray(np.maximum(measured, 0.0).reshape(wanted.shape))


def spectral_gains(
    variances: NDArray[np.float64],
    overlap: NDArray[np.float64],
    *,
    aim: float = AIM,
) -> NDArray[np.float64]:
    """By what to multiply deviations, so that mixed bands measure what they are asked for.

    The deviation asked for over the one that it would measure on a plane where every place asks
    for the same: one step of a fixed-point iteration. Where neither is seen it goes to 1.

    In the second level's high band `UNEVEN` of the oriented bands' variance counts as measured too.

    Parameters
    ----------
    variances : (..., B)
        Asked for, at least 0.
    overlap : (B, B, B)
        See `Mixing`.
    aim : float, optional
        Deviation to reach over the one asked for.

    Returns
    -------
    ndarray of shape (..., B)
        From `LEAST_GAIN` to `MOST_GAIN`, times `aim`.
    """
    measured = measured_variances(np.sqrt(variances), overlap)
    if len(overlap) > 3:
        measured[..., 3] += UNEVEN * variances[..., 4:6].mean(axis=-1)
    gain = np.sqrt((variances + UNSEEN_VARIANCE) / (measured + UNSEEN_VARIANCE))
    return np.asarray(aim * np.clip(gain, LEAST_GAIN, MOST_GAIN))
