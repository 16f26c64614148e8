"""Fit the steerable pyramid's kernels and write `kernels.json` with their measured errors.

    script/bench fit_kernels

The pyramid splits every level into an isotropic high band, two oriented bands and a low
band that is halved into the next level (see reference.py). The kernels are not copied
from anywhere. They are the least-squares answer to:

- flat power, ``H^2 + A_x^2 + A_y^2 + L^2 = 1``, weighted by the 1/f amplitude of natural
  images: the split then inverts itself;
- no aliasing in the halving, ``L(w) L(w + pi) = 0``, weighted likewise;
- steerability: the oriented pair is one radial profile times cos and sin of the angle,
  as in the Fourier-domain steerable pyramid (Simoncelli and Freeman 1995);
- H, A of zero DC and L of unit DC, exactly, by construction.
"""

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from skimage import data

from pipeline.features import reference
from pipeline.features.reference import Kernels, analyse, synthesise

TARGET = Path(reference.__file__).with_name("kernels.json")
GRID = 48  # frequencies per axis in one quadrant; symmetry gives the rest
RESTARTS = 6
WEIGHT_POWER, WEIGHT_FLAT, WEIGHT_ALIAS, WEIGHT_STEER = 1.0, 0.1, 0.5, 0.3
HIGH_SIZE, ORIENTED_SIZE, LOW_SIZE = 3, 3, 4
ALIASES = ((np.pi, 0.0), (0.0, np.pi), (np.pi, np.pi))

Array = NDArray[np.float64]
Response = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Orbit:
    """Taps of one kernel that symmetry makes equal (or opposite), and their response."""

    taps: tuple[tuple[float, float, int], ...]  # x, y, sign

    def even(self, x: Array, y: Array) -> Array:
        return np.asarray(sum(s * np.cos(x * tx + y * ty) for tx, ty, s in self.taps))

    def odd(self, x: Array, y: Array) -> Array:
        return np.asarray(sum(s * np.sin(x * tx + y * ty) for tx, ty, s in self.taps))


def even_orbits(size: int) -> list[Orbit]:
    """Orbits of a kernel symmetric under all turns and flips of the square."""
    offsets = _half(size)
    return [
        Orbit(tuple((x, y, 1) for x, y in sorted(_mirrored(a, b) | _mirrored(b, a))))
        for a in offsets
        for b in offsets
        if b <= a
    ]


def odd_orbits(size: int) -> list[Orbit]:
    """Orbits of a kernel odd in x and even in y."""
    offsets = _half(size)
    return [
        Orbit(tuple((x, y, 1 if x > 0 else -1) for x, y in sorted(_mirrored(a, b))))
        for a in offsets[1:]
        for b in offsets
    ]


def _half(size: int) -> list[float]:
    return [i + (0.0 if size % 2 else 0.5) for i in range((size + 1) // 2)]


def _mirrored(x: float, y: float) -> set[tuple[float, float]]:
    return {(x, y), (-x, y), (x, -y), (-x, -y)}


class Fit:
    """The least-squares problem on a grid of frequencies."""

    def __init__(self) -> None:
        axis = (np.arange(GRID) + 0.5) / GRID * np.pi
        self.x, self.y = np.meshgrid(axis, axis)
        self.radius = np.hypot(self.x, self.y)
        self.angle = np.arctan2(self.y, self.x)
        amplitude = 1 / np.sqrt(self.radius**2 + 0.05)
        self.amplitude = amplitude / np.sqrt(np.mean(amplitude**2))
        self.high = even_orbits(HIGH_SIZE)
        self.low = even_orbits(LOW_SIZE)
        self.oriented = odd_orbits(ORIENTED_SIZE)
        self.free = len(self.high) - 1 + len(self.low) - 1 + len(self.oriented)

    def coefficients(self, free: Array) -> tuple[Array, Array, Array]:
        """Complete the free parameters: the first tap of H and L sets the DC gain."""
        split = np.cumsum([len(self.high) - 1, len(self.low) - 1])
        high, low, oriented = np.split(free, split)
        return _with_dc(self.high, high, 0.0), oriented, _with_dc(self.low, low, 1.0)

    def responses(self, free: Array) -> tuple[Array, Array, Array, Response]:
        high, oriented, low = self.coefficients(free)

        def low_at(x: Array, y: Array) -> Array:
            return _response([o.even for o in self.low], low, x, y)

        odd = [o.odd for o in self.oriented]
        return (
            _response([o.even for o in self.high], high, self.x, self.y),
            _response(odd, oriented, self.x, self.y),
            _response(odd, oriented, self.y, self.x),
            low_at,
        )

    def power(self, free: Array) -> Array:
        high, along_x, along_y, low_at = self.responses(free)
        return np.asarray(high**2 + along_x**2 + along_y**2 + low_at(self.x, self.y) ** 2)

    def steering_error(self, free: Array) -> Array:
        _, along_x, along_y, _ = self.responses(free)
        return np.asarray(along_x * np.sin(self.angle) - along_y * np.cos(self.angle))

    def residuals(self, free: Array) -> Array:
        low_at = self.responses(free)[3]
        low = low_at(self.x, self.y)
        flat = self.power(free) - 1
        terms = [WEIGHT_POWER * self.amplitude * flat, WEIGHT_FLAT * flat]
        terms += [
            WEIGHT_ALIAS * self.amplitude * low * low_at(self.x - dx, self.y - dy)
            for dx, dy in ALIASES
        ]
        # Steering cannot hold near the corner, where a square grid has no circle left.
        terms.append(WEIGHT_STEER * self.steering_error(free) * np.exp(-((self.radius / 2.2) ** 4)))
        return np.concatenate([term.ravel() for term in terms])

    def solve(self) -> Array:
        rng = np.random.default_rng(0)
        starts = [rng.normal(0, 0.1, self.free) for _ in range(RESTARTS)]
        answers = [least_squares(self.residuals, start, xtol=1e-12) for start in starts]
        return np.asarray(min(answers, key=lambda answer: float(answer.cost)).x)

    def kernels(self, free: Array) -> Kernels:
        high, oriented, low = self.coefficients(free)
        along_x = _taps(ORIENTED_SIZE, self.oriented, oriented)
        centre_right = along_x[ORIENTED_SIZE // 2, ORIENTED_SIZE // 2 + 1]
        return Kernels(
            high=_taps(HIGH_SIZE, self.high, high),
            oriented=along_x * np.sign(centre_right),
            low=_taps(LOW_SIZE, self.low, low),
        )


def _with_dc(orbits: list[Orbit], rest: Array, dc: float) -> Array:
    counts = np.array([len(orbit.taps) for orbit in orbits])
    return np.concatenate([[(dc - counts[1:] @ rest) / counts[0]], rest])


def _response(basis: Sequence[Response], weights: Array, x: Array, y: Array) -> Array:
    return np.asarray(sum(w * b(x, y) for w, b in zip(weights, basis, strict=True)))


def _taps(size: int, orbits: list[Orbit], weights: Array) -> Array:
    kernel = np.zeros((size, size))
    for weight, orbit in zip(weights, orbits, strict=True):
        for x, y, sign in orbit.taps:
            kernel[round(y + (size - 1) / 2), round(x + (size - 1) / 2)] = weight * sign
    return kernel


def round_trip_psnr_db(image: Array, kernels: Kernels, levels: int) -> float:
    """PSNR of synthesise(analyse(image)) against `image`, peak 1."""
    error = synthesise(analyse(image, levels, kernels), kernels) - image
    return float(-10 * np.log10(np.mean(error**2)))


def main(argv: Sequence[str] | None = None) -> None:
    """Fit, write, and print the errors."""
    argparse.ArgumentParser(prog="script/bench fit_kernels", description=__doc__).parse_args(argv)
    fit = Fit()
    free = fit.solve()
    kernels = fit.kernels(free)
    power = fit.power(free)
    steering = np.abs(fit.steering_error(free))[fit.radius < 1.8]
    photographs = {
        name: getattr(data, name)() / 255.0 for name in ("astronaut", "camera", "coffee", "gravel")
    }
    errors = {
        "power_min": float(power.min()),
        "power_max": float(power.max()),
        "steering_error_max": float(steering.max()),
        "round_trip_psnr_db_5_levels": {
            name: round(
                round_trip_psnr_db(image if image.ndim == 3 else image[..., None], kernels, 5), 2
            )
            for name, image in photographs.items()
        },
    }
    record = {
        "high": kernels.high.tolist(),
        "oriented": kernels.oriented.tolist(),
        "low": kernels.low.tolist(),
        "errors": errors,
    }
    TARGET.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(errors, indent=1))
