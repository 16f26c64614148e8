"""Mixing of noise bands, and spectral gains, which correct for what mixed bands measure.

The mixing is what `benchmarks/fits/fit_mixing.py` found. One matrix suits no two spectra alike, so
weights are corrected for what mixed bands measure of each other.

Foveated pictures, which hold every spectrum side by side, weigh noise with them. Fills do without:
mixing alone serves their holes as well (docs/decisions/0065).

Twin: spectral_gains.glsl. Change both or neither.
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
    gains of `spectral_gains`.
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
# Of the fixed-point iteration. After one, the coarse bands of soft textures (amplitude 1 / f^1.5)
# measure up to a third too much on a plane: each takes its neighbours for as strong as they are
# asked to be, though they are weakened too. After two a tenth is left.
STEPS = 2


def spectral_gains(
    variances: Floats,
    overlap: Floats,
    *,
    aim: float = AIM,
) -> Floats:
    """Factors on deviations, so that mixed bands measure what they are asked for.

    A fixed-point iteration of `STEPS`: each multiplies by the deviation asked for over the one
    that the gains so far would measure on a plane where every place asks for the same. Where
    neither is seen it goes to 1.

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
    wanted, gain = np.sqrt(variances), np.ones(variances.shape)
    for _ in range(STEPS):
        given = wanted * gain
        measured = measured_variances(given, overlap)
        if len(overlap) > 3:
            measured[..., 3] += UNEVEN * (given[..., 4:6] ** 2).mean(axis=-1)
        gain *= np.sqrt((variances + UNSEEN_VARIANCE) / (measured + UNSEEN_VARIANCE))
        gain = np.clip(gain, LEAST_GAIN, MOST_GAIN)
    return np.asarray(aim * gain)


def gain_constants(levels: int, *, aim: float) -> dict[str, int | float | tuple[float, ...]]:
    """Constants that spectral_gains.glsl is compiled with."""
    mixing = fitted_mixing(levels)
    return {
        "LEVELS": levels,
        "LEAST_GAIN": LEAST_GAIN,
        "MOST_GAIN": MOST_GAIN,
        "AIM": aim,
        "UNSEEN_VARIANCE": UNSEEN_VARIANCE,
        "UNEVEN": UNEVEN,
        "STEPS": STEPS,
        "OVERLAP": tuple(overlap_by_levels(mixing.overlap).ravel().tolist()),
        "TOGETHER": tuple(together_by_levels(mixing.together).ravel().tolist()),
    }


# Deviations from the high band's, and the sum and difference of the oriented ones: 2 x = u + v.
_PARTS = np.array([[1, 0, 0], [0, 0.5, 0.5], [0, 0.5, -0.5]])


def overlap_by_levels(overlap: Floats) -> NDArray[np.float32]:
    """`Mixing.overlap` as spectral_gains.glsl reads it: by high bands, sums and differences of
    oriented ones.

    What bands measure does not change when rows and columns change places. So the high band's
    variance, and half the sum of the oriented ones', take no product of one difference, and half
    their difference takes no other: that halves the sums.

    Returns
    -------
    ndarray of shape (levels, pairs, 4, 4)
        Of a level: for each two levels i <= j four rows. The first three are of products, a
        number for the high band and one for half the oriented bands' sum: of the high band of i
        with that and the sum of j, of the sum of i with the same two, of differences; two zeros.
        The last is for half the oriented bands' difference: high with difference, difference with
        high, sum with difference, difference with sum.
    """
    levels = len(overlap) // 3
    forms = overlap.reshape(levels, 3, levels, 3, levels, 3)
    forms = np.einsum("bc,kcipjq,pr,qs->kbirjs", _PARTS, forms, _PARTS, _PARTS)
    high, total, difference = 0, 1, 2
    even, odd = (high, total), difference
    rows = []
    for i, j in in_pairs(levels):
        # (level, own, of i, of j)
        form = (1 if i == j else 2) * forms[:, :, i, :, j]
        both = form[:, even].transpose(0, 2, 3, 1)  # (level, of i, of j, own)
        crossed = [(high, odd), (odd, high), (total, odd), (odd, total)]
        rows.append(
            np.stack(
                [
                    both[:, high, even].reshape(levels, 4),
                    both[:, total, even].reshape(levels, 4),
                    np.pad(both[:, odd, odd], ((0, 0), (0, 2))),
                    np.stack([form[:, odd, p, q] for p, q in crossed], axis=-1),
                ],
                axis=1,
            )
        )
    return np.stack(rows, axis=1).astype(np.float32)


def together_by_levels(together: Floats) -> NDArray[np.float32]:
    """`Mixing.together` as spectral_gains.glsl reads it: (pairs, 5).

    For each two levels i <= j a number for products of the high bands, of the high band of i and
    the sum of j, of the sum of i and the high band of j, of the sums, and of the differences.
    """
    levels = len(together) // 3
    form = together.reshape(levels, 3, levels, 3)
    form = np.einsum("ipjq,pr,qs->irjs", form, _PARTS, _PARTS)
    both = [(0, 0), (0, 1), (1, 0), (1, 1), (2, 2)]
    rows = [[(1 if i == j else 2) * form[i, p, j, q] for p, q in both] for i, j in in_pairs(levels)]
    return np.array(rows, np.float32)


def in_pairs(levels: int) -> list[tuple[int, int]]:
    """Each two levels, and each with itself, as the shader goes through them."""
    return [(i, j) for i in range(levels) for j in range(i, levels)]
