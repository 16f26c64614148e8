"""Shares and displacements that the pictures of a panorama have in common: see panorama.py.

They are mixed between two latitudes. What is displaced has to be displaced alike in both, or the
mixture would show it twice: so displacements are of directions. Other noise differs between
them, and is made stronger by as much as the mixture takes from it.

A displacement's noise is random vectors on the points of a cubic lattice in space, blended by a
quadratic B-spline, and read at the direction's point of the unit sphere. A lattice of spacing d is
as smooth as white noise pooled with the deviation d / 2. Spacings are powers of two of a radian;
between two of them the noise of both is mixed.
"""

from __future__ import annotations

import itertools

import numpy as np

from pipeline.frame import Floats
from pipeline.noise.tile import Bits, pcg3d

BELT_DEG, CAP_DEG = 45.0, 55.0
"""Up to the first latitude a panorama is itself, from the second on the picture of its pole."""
FINEST = -14  # power of two of the finest lattice's spacing, radians: 13 arcsec


def cap_shares(rays: Floats) -> Floats:
    """Share of the cap in directions (..., 3): (...), 0 to 1."""
    start, end = (np.sin(np.radians(angle)) for angle in (BELT_DEG, CAP_DEG))
    share = np.clip((np.abs(rays[..., 1]) - start) / (end - start), 0, 1)
    return np.asarray(share * share * (3 - 2 * share))


def noise_strength(rays: Floats) -> Floats:
    """Factor by which noise that is mixed with other noise must be stronger: (...), at least 1."""
    share = cap_shares(rays)
    return np.asarray(1 / np.hypot(share, 1 - share))


def displaced_rays(
    rays: Floats,
    sigma_rad: Floats,
    *,
    reach: float,
    smoothness: float,
    key: tuple[int, int, int],
    laid_on: Floats | None = None,
) -> Floats:
    """Move directions (..., 3) at random.

    Parameters
    ----------
    sigma_rad : ndarray of shape (...)
        Deviation of the pools there.
    reach, smoothness : float
        Deviations of the displacement, and of its own pools, over the eye's.
    key : three whole numbers of 32 bits
    laid_on : ndarray of shape (..., 3), optional
        Where the noise of each direction was laid down, by default there.
    """
    origin = rays if laid_on is None else laid_on
    noise = unit_noise(origin, smoothness * sigma_rad, key)
    noise = noise - (noise * origin).sum(axis=-1, keepdims=True) * origin
    if laid_on is not None:  # turned as the origin is, the short way, to the direction
        both = origin + rays
        share = (noise * rays).sum(axis=-1) / np.maximum(1 + (origin * rays).sum(axis=-1), 1e-9)
        noise = noise - share[..., None] * both
    moved = rays + (reach * sigma_rad)[..., None] * noise
    return np.asarray(moved / np.linalg.norm(moved, axis=-1, keepdims=True))


def unit_noise(rays: Floats, smooth_rad: Floats, key: tuple[int, int, int]) -> Floats:
    """Vectors as smooth as pools of the deviation `smooth_rad`, of unit variance: (..., 3)."""
    power = np.log2(np.maximum(2 * smooth_rad, 2.0**FINEST))
    level = np.floor(power)
    turn = 0.5 * np.pi * (power - level)[..., None]
    fine, coarse = (lattice_noise(rays, level + up, key) for up in (0, 1))
    return np.asarray(np.cos(turn) * fine + np.sin(turn) * coarse)


def lattice_noise(rays: Floats, level: Floats, key: tuple[int, int, int]) -> Floats:
    """Blend the vectors of the 27 nearest points of lattices of spacing ``2^level``: (..., 3)."""
    place = rays * 2.0 ** -level[..., None]
    nearest = np.floor(place + 0.5)
    aside = place - nearest
    weights = 0.5 * (0.5 - aside) ** 2, 0.75 - aside**2, 0.5 * (0.5 + aside) ** 2
    total = np.zeros(rays.shape)
    stream = level.astype(np.int64).astype(np.uint32) * np.uint32(0x9E3779B9)
    for steps in itertools.product(range(3), repeat=3):
        point = [nearest[..., axis] + steps[axis] - 1 for axis in range(3)]
        weight = np.prod([weights[steps[axis]][..., axis] for axis in range(3)], axis=0)
        bits = [
            at.astype(np.int64).astype(np.uint32) ^ np.uint32(part)
            for at, part in zip(point, key, strict=True)
        ]
        bits[2] ^= stream
        total += weight[..., None] * np.stack([_uniform(part) for part in pcg3d(*bits)], axis=-1)
    energy = np.prod(sum(weight**2 for weight in weights), axis=-1)
    return np.asarray(total / np.sqrt(energy)[..., None])


def _uniform(bits: Bits) -> Floats:
    """Uniform numbers of unit variance around 0; of 24 bits, as many as a float32 holds."""
    return np.asarray(((bits >> np.uint32(8)) * 2.0**-24 - 0.5) * np.sqrt(12.0))
