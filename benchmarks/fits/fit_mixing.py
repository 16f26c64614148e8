"""Fit how noise bands are mixed and write `mixing.json` with the measured errors.

    script/bench fit_mixing

Bands overlap: of a band that passes its filters again, softened, neighbouring ones measure a part.
Bands of white noise, weighed by the deviations ``s`` of another texture, therefore measure
other deviations than ``s``. Mixing the weights first, ``v = T s``, cures it: with ``C_b`` the
covariance that band `b` measures between all bands of unit noise, it measures
``sqrt(v' C_b v)``. T is the least-squares answer to ``sqrt(v' C_b v) = s_b`` for

- amplitudes 1 / f^e, with e from 0 (white) to 2, sharp and blurred, without and with a
  direction;
- all of it lacking, or what a base leaves to the noise in the middle of a hole;
- deviations that vary together over the hole, and less so, as on photographs;
- and each of these with its bands jittered, so that no odd spectrum is amplified.

T couples neighbouring levels only, treats x and y alike, and is held to the identity. The
noise is linear in its weights, so T is absorbed into the tile (tile.py). What T leaves, the
gains of `gains.spectral_gains` correct place by place, so that ``s`` above is what they make
of it: T is fitted with them. `mixing.json` also holds the covariances, for those gains, and how
unit bands correlate, for the variance of their sum.

Mixed bands interpolate differently, too. `lag_correlation` is the answer to: whatever the
sub-pixel offset, the variance of the mixed sum stays, for the same textures.
"""

import argparse
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pipeline.features.reference import MAX_LEVELS, fitted_kernels
from pipeline.noise import tile
from pipeline.noise.gains import (
    LAGS,
    LEAST_GAIN,
    MOST_GAIN,
    measured_variances,
    overlaps,
    packed,
    unpacked,
)
from pipeline.noise.tile import TEXELS_PER_PX

TARGET = Path(tile.__file__).with_name("mixing.json")
EDGE = 256  # of the noise that is measured, pixels
SEEDS = 16
# Exponent e of an amplitude 1 / f^e, and the deviation of a Gaussian blur in pixels.
SPECTRA = (
    *((exponent, 0.0) for exponent in (0.0, 0.5, 1.0, 1.5, 2.0)),
    *((0.0, blur_px) for blur_px in (0.6, 1.0, 2.0)),
    *((1.0, blur_px) for blur_px in (1.0, 2.0)),
)
ANISOTROPIES = (0.0, 0.5)  # of power along x; T treats y the same
LOWEST_FREQUENCY = 1 / 32  # cycles per pixel; below, spectra are flat
# What share of a level's variance a base holds already, of the oriented bands: none; in natural
# textures; in white. Measured with `noise` 0 behind discs (tests/helpers/stationary_textures.py).
SHARES = (
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (0.02, 0.05, 0.08, 0.16, 0.20, 0.25),
    (0.02, 0.06, 0.13, 0.33, 0.40, 0.40),
)
HIGH_SHARE = 0.15  # of the high band: a base is smooth, and holds so much of that share
TOGETHER = (1.0, 0.97, 0.88)  # correlation of two bands' energies from place to place, per step
JITTERS, JITTER, JITTER_WEIGHT = 3, 0.3, 0.1  # how many, deviation of log, weight
MOST_STEPS = 100  # of the fit of T: what gains leave to it is flat
RIDGE_MATRIX, RIDGE_LAG = 0.05, 0.1
SMALLEST = 1e-12  # variance whose root or logarithm is taken
OFFSETS = (0.0, 0.15, 0.3, 0.5, 0.7, 0.85)  # texels, along each axis

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@lru_cache(maxsize=1)
def responses(levels: int) -> Complex:
    """Frequency response of every band, (3 * levels, EDGE, EDGE), before any halving."""
    kernels = fitted_kernels()
    frequency = np.asarray(2 * np.pi * np.fft.fftfreq(EDGE), np.float64)
    low = np.ones((EDGE, EDGE), np.complex128)
    found = []
    for level in range(levels):
        scaled = frequency * (1 << level)
        found += [low * _response(kernel, scaled) for kernel in kernels.bands()]
        low = low * _response(kernels.low, scaled)
    return np.array(found)


def _response(kernel: Array, frequency: Array) -> Complex:
    """Response of a correlation kernel whose first tap lies at -1, as those of all bands do."""
    shift = np.exp(1j * np.multiply.outer(frequency, np.arange(len(kernel)) - 1))
    return np.asarray(shift @ kernel @ shift.T)


def _fold(spectrum: Complex, level: int) -> Complex:
    """Spectrum of every 2^level-th sample along both axes."""
    step, edge = 1 << level, EDGE >> level
    shape = (*spectrum.shape[:-2], step, edge, step, edge)
    return np.asarray(spectrum.reshape(shape).mean(axis=(-4, -2)))


def noise_statistics(levels: int) -> tuple[Array, Array]:
    """Measure unit noise bands against each other, as `tile.split` makes them.

    Returns
    -------
    covariances : ndarray, shape (B, B, B)
        ``[b, i, j]``: of what analysis finds in band b of noise bands i and j; B = 3 * levels.
    lagged : ndarray, shape (1 + len(LAGS), B, B)
        Covariance of noise bands i and j at lag 0 and `LAGS`, in texels of the tile.
    """
    filters = responses(levels)
    count = len(filters)
    frequency = np.asarray(2 * np.pi * np.fft.fftfreq(EDGE), np.float64)
    per_texel = frequency / TEXELS_PER_PX
    passed = [np.ones((EDGE, EDGE))]  # by as many levels; see tile.softening
    for level in range(levels):
        low = _response(fitted_kernels().low, frequency * (1 << level))
        passed.append(passed[-1] * np.abs(low) ** 2)
    turns = [np.cos(per_texel[:, None] * y + per_texel * x).ravel() for y, x in ((0, 0), *LAGS)]
    covariances, lagged = np.zeros((count,) * 3), np.zeros((len(turns), count, count))
    for seed in range(SEEDS):
        white = np.fft.fft2(np.random.default_rng(seed).standard_normal((EDGE, EDGE)))
        noise = np.empty_like(filters)
        for index, response in enumerate(filters):
            level = index // 3
            band = np.tile(_fold(response * white, level), (1 << level,) * 2)
            noise[index] = response.conj() * band * passed[level + (index % 3 > 0)]
            noise[index] *= EDGE**2 / np.linalg.norm(noise[index])
        for index, response in enumerate(filters):
            level = index // 3
            band = _fold(response * noise, level).reshape(count, -1)
            covariances[index] += (band.conj() @ band.T).real / (EDGE >> level) ** 4 / SEEDS
        flat = noise.reshape(count, -1)
        for index, turn in enumerate(turns):
            lagged[index] += ((flat * turn).conj() @ flat.T).real / EDGE**4 / SEEDS
    return _alike(covariances, levels, own=True), _alike(lagged, levels, own=False)


def _alike(found: Array, levels: int, *, own: bool) -> Array:
    """Average with x and y exchanged."""
    turned = np.arange(3 * levels).reshape(levels, 3)[:, [0, 2, 1]].ravel()
    first = turned if own else np.array([0, 2, 1, 3, 4])
    return np.asarray(0.5 * (found + found[first][:, turned][:, :, turned]))


@lru_cache(maxsize=1)
def _power(levels: int) -> Array:
    return np.asarray(np.abs(responses(levels)) ** 2)


def deviations_of(
    levels: int, exponent: float, anisotropy: float = 0.0, blur_px: float = 0.0
) -> Array:
    """Deviation of every band in a texture of amplitude 1 / f^exponent, (3 * levels).

    In parts of the largest.
    """
    axis = np.fft.fftfreq(EDGE)
    y, x = axis[:, None], axis
    radius = np.maximum(np.hypot(x, y), LOWEST_FREQUENCY)
    power = radius ** (-2 * exponent) * (1 + anisotropy * np.cos(2 * np.arctan2(y, x)))
    power = power * np.exp(-4 * (np.pi * blur_px * np.hypot(x, y)) ** 2)
    deviations = np.sqrt((_power(levels) * power).mean(axis=(1, 2)))
    return np.asarray(deviations / deviations.max())


def _textures(levels: int) -> Iterator[Array]:
    """Deviations that noise is asked for."""
    for exponent, blur_px in SPECTRA:
        for anisotropy in ANISOTROPIES:
            whole = deviations_of(levels, exponent, anisotropy, blur_px)
            for share in SHARES:
                held = np.outer(share[:levels], (HIGH_SHARE, 1.0, 1.0)).ravel()
                yield whole * np.sqrt(1 - held)


def _together(levels: int, correlation: float) -> Array:
    """Correlation of all bands' deviations from place to place."""
    band, level = np.arange(3 * levels) % 3, np.arange(3 * levels) // 3
    steps = np.abs(level[:, None] - level) + (band[:, None] != band)
    return np.asarray(correlation**steps)


@dataclass(frozen=True, eq=False)
class MatrixFit:
    """Least squares for T, by the blocks between neighbouring levels."""

    levels: int
    covariances: Array

    def blocks(self) -> list[tuple[int, int]]:
        """Return (to, from) of every pair of levels that T couples."""
        return [
            (to, start)
            for to in range(self.levels)
            for start in range(max(0, to - 1), min(self.levels, to + 2))
        ]

    def matrix(self, free: Array) -> Array:
        """Return T, (3 * levels, 3 * levels); x and y are exchangeable."""
        mixing = np.zeros((3 * self.levels,) * 2)
        for (to, start), block in zip(self.blocks(), free.reshape(-1, 5), strict=True):
            high, to_high, from_high, same, cross = block
            mixing[3 * to : 3 * to + 3, 3 * start : 3 * start + 3] = [
                [high, to_high, to_high],
                [from_high, same, cross],
                [from_high, cross, same],
            ]
        return mixing

    def measured(self, mixing: Array, wanted: Array) -> Array:
        """Deviation of every band for wanted second moments (n, B, B) of weights: (n, B)."""
        weights = mixing @ wanted @ mixing.T
        flat = self.covariances.reshape(len(mixing), -1)
        return np.sqrt(np.maximum(weights.reshape(len(wanted), -1) @ flat.T, SMALLEST))

    def corrected(self, mixing: Array, wanted: Array) -> Array:
        """Deviations with their gains, without aim: (n, B) to (n, B)."""
        measured = measured_variances(wanted, overlaps(self.covariances, mixing))
        gain = wanted / np.sqrt(np.maximum(measured, SMALLEST))
        return wanted * np.clip(gain, LEAST_GAIN, MOST_GAIN)

    def solve(self) -> Array:
        rng = np.random.default_rng(0)
        together, targets, weight = [], [], []
        for texture in _textures(self.levels):
            for correlation in TOGETHER:
                jitter = np.exp(rng.normal(0, JITTER, (JITTERS, len(texture))))
                for target in (texture, *(texture * jitter)):
                    together.append(_together(self.levels, correlation))
                    targets.append(target)
                weight += [1.0] + [JITTER_WEIGHT] * JITTERS
        correlations, target, weights = np.array(together), np.array(targets), np.array(weight)
        identity = np.array([(1.0, 0, 0, 1.0, 0) if a == b else (0,) * 5 for a, b in self.blocks()])
        start = identity.ravel()
        ridge = RIDGE_MATRIX * np.sqrt((weights**2).sum() * target.shape[1] / len(start))

        def residuals(free: Array) -> Array:
            mixing = self.matrix(free)
            given = self.corrected(mixing, target)
            moments = correlations * given[:, :, None] * given[:, None, :]
            off = np.log(self.measured(mixing, moments) / target)
            return np.concatenate([(weights[:, None] * off).ravel(), ridge * (free - start)])

        found = least_squares(residuals, start, max_nfev=MOST_STEPS)
        return self.levelled(self.matrix(found.x))

    def levelled(self, mixing: Array) -> Array:
        """Scaled so that without gains the planes measure what they are asked for on average."""
        planes = np.array([deviations_of(self.levels, e, blur_px=px) for e, px in SPECTRA])
        found = self.measured(mixing, planes[:, :, None] * planes[:, None, :])
        return np.asarray(mixing / np.exp(np.log(found / planes).mean()))

    def ratios(
        self, mixing: Array, exponent: float, blur_px: float, *, with_gains: bool = True
    ) -> Array:
        """Deviation measured over deviation wanted, (levels, 3), on an endless plane.

        Gains are without AIM.
        """
        wanted = deviations_of(self.levels, exponent, blur_px=blur_px)
        given = self.corrected(mixing, wanted[None])[0] if with_gains else wanted
        found = self.measured(mixing, np.outer(given, given)[None])[0]
        return np.asarray((found / wanted).reshape(self.levels, 3))


@dataclass(frozen=True, eq=False)
class LagFit:
    """Least squares for the lag correlations of mixed bands; see `tile.look_up`."""

    levels: int
    mixed: Array  # (1 + len(LAGS), B, B): covariance of mixed bands at lag 0 and LAGS
    textures: Array  # (n, B), with their gains

    def pairs(self) -> Array:
        """Summed products of bilinear weights, (offsets, 1 + len(LAGS))."""
        y, x = (a.ravel()[1:] for a in np.meshgrid(OFFSETS, OFFSETS, indexing="ij"))
        a, b, c, d = (1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y
        squares = a * a + b * b + c * c + d * d
        lags = (2 * (a * b + c * d), 2 * (a * c + b * d), 2 * a * d, 2 * b * c)
        return np.stack([squares, *lags], axis=1)

    def correlations(self, free: Array) -> Array:
        """Correlations of all bands, (levels, 3, len(LAGS)); x and y are exchangeable."""
        high, corner, along, across, oriented_corner = free.reshape(-1, 5).T
        rows = [
            (high, high, corner, corner),
            (along, across, oriented_corner, oriented_corner),
            (across, along, oriented_corner, oriented_corner),
        ]
        return np.moveaxis(np.array(rows), 2, 0)

    def own(self) -> Array:
        """Each band's correlation with itself."""
        itself = np.diagonal(self.mixed, axis1=1, axis2=2)
        lags = np.moveaxis(itself[1:] / itself[0], 0, 1).reshape(self.levels, 3, len(LAGS))
        places = ((0, 0), (0, 2), (1, 0), (1, 1), (1, 2))
        return np.stack([lags[:, band, lag] for band, lag in places], axis=1).ravel()

    def variance(self, free: Array) -> Array:
        """Variance between texels over that at texels, (textures, offsets)."""
        pairs = self.pairs()
        interpolated = np.tensordot(pairs, self.mixed, (1, 0))
        lags = self.correlations(free).reshape(-1, len(LAGS))
        gain = 1 / np.sqrt(np.maximum(pairs[:, :1] + pairs[:, 1:] @ lags.T, 0.02))
        scaled = gain[:, :, None] * interpolated * gain[:, None, :]
        return np.asarray(
            np.einsum("ni,oij,nj->no", self.textures, scaled, self.textures, optimize=True)
            / np.einsum("ni,ij,nj->n", self.textures, self.mixed[0], self.textures)[:, None]
        )

    def solve(self) -> Array:
        start = self.own()
        ridge = RIDGE_LAG * np.sqrt(self.variance(start).size / len(start))

        def residuals(free: Array) -> Array:
            off = np.log(self.variance(free))
            return np.concatenate([off.ravel(), ridge * (free - start)])

        # Above 1 no correlation goes.
        bounds = (-np.inf, np.maximum(1.0, start))
        return np.asarray(least_squares(residuals, start, bounds=bounds).x)


def fit(levels: int, covariances: Array, lagged: Array) -> dict[str, object]:
    """Fit for so many levels; what `mixing.json` holds of them."""
    count = 3 * levels
    matrix_fit = MatrixFit(levels, covariances[:count, :count, :count])
    mixing = matrix_fit.solve().round(5)
    mixed = overlaps(lagged[:, :count, :count], mixing)
    given = matrix_fit.corrected(mixing, np.array(list(_textures(levels))))
    lag_fit = LagFit(levels, mixed, given)
    lags = lag_fit.solve()
    variance = lag_fit.variance(lags)
    errors = {
        f"exponent {exponent}" + (f", blur {blur_px} px" if blur_px else ""): {
            name: matrix_fit.ratios(matrix, exponent, blur_px, with_gains=gains).round(3).tolist()
            for name, matrix, gains in (
                ("mixed, with gains", mixing, True),
                ("mixed", mixing, False),
                ("unmixed", np.eye(count), False),
            )
        }
        for exponent, blur_px in SPECTRA
    }
    return {
        "matrix": mixing.tolist(),
        "lag_correlation": lag_fit.correlations(lags).round(5).reshape(count, -1).tolist(),
        "deviation ratios on a plane": errors,
        "variance between texels": [round(float(v), 3) for v in (variance.min(), variance.max())],
    }


def main(argv: Sequence[str] | None = None) -> None:
    """Fit for every number of levels, write, and print the errors."""
    argparse.ArgumentParser(prog="script/bench fit_mixing", description=__doc__).parse_args(argv)
    covariances, lagged = noise_statistics(MAX_LEVELS)
    covariances = unpacked(packed(covariances).round(5))
    record = {str(levels): fit(levels, covariances, lagged) for levels in range(1, MAX_LEVELS + 1)}
    shared = {
        "covariances": packed(covariances).tolist(),
        "correlations": lagged[0].round(5).tolist(),
    }
    lines = json.dumps(shared | record, indent=1)
    TARGET.write_text(_rows_in_lines(lines) + "\n", encoding="utf-8")
    for levels, found in record.items():
        print(levels, json.dumps(found["deviation ratios on a plane"]))
        print(levels, "variance between texels", found["variance between texels"])


def _rows_in_lines(text: str) -> str:
    """Bring each list of numbers to one line."""
    return re.sub(r"\[[^][{}]*\]", lambda match: " ".join(match[0].split()), text)
