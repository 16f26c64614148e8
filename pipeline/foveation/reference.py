"""Metamers of the periphery in numpy, and the blur of equal pooling.

Walton, Kuffner dos Anjos, Friston, Swapp, Akşit, Steed and Ritschel 2021, "Beyond Blur: Real-time
Ventral Metamers for Foveated Rendering", sections 3.1 to 3.4; what they leave open is settled as
docs/foveation.md says. Arrays are (row, column, channel), encoded R'G'B'.

Twin: gpu.py and the shaders beside it. Change both or neither.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.colour import RGB_FROM_YCBCR, rgb_from_ycbcr
from pipeline.foveation.chain import chain_length, chain_of, enlarge, halve_box, select
from pipeline.foveation.geometry import pixel_centres
from pipeline.foveation.noise_plane import noise_plane
from pipeline.foveation.pooled_moments import (
    SMALLEST_VARIANCE,
    WantedMoments,
    added,
    along_luma,
    along_pool,
    wanted_by_blocks,
)
from pipeline.foveation.pooling import MetamerSettings, Pools
from pipeline.foveation.sphere import noise_strength
from pipeline.frame import Floats
from pipeline.noise.gains import fitted_mixing, spectral_gains

AIM = 1.0
"""Ratio of the noise's deviation to the pooled one; fills ask for more, see mixing.AIM."""
COLOURED = 0.5
"""Chroma's variance over luma's from which on noise keeps to its pool's colours. Grey noise has all
of the display: bound to few greys, it would lose statistics."""
ROOMY = 1.15
"""Room for noise over its pool's, for pools of single pixels differ."""
FIRST_SMOOTH = 3
"""Pixels of 2x2 share what weighs finer levels' noise; noise from this level on is so smooth that
shared weights would show as a comb."""


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of R'G'B', its deviation, how far it may lead, and with luma: see `added`.

    Arrays (H, W, 3).
    """

    normal: Floats
    deviation: Floats
    below: Floats | None = None
    above: Floats | None = None
    along: Floats | None = None

    def on(self, base: Floats, strength: float | Floats = 1.0) -> Floats:
        """Add it to R'G'B' (H, W, 3), as much stronger everywhere or by pixel (H, W)."""
        by = np.asarray(strength, np.float64)[..., None]
        return added(
            base, by * self.normal, by * self.deviation, self.below, self.above, self.along
        )


@dataclass(frozen=True, eq=False)
class MetamerParts:
    """A metamer on its way. `base`, `noise` (H, W, 3): R'G'B'; `wanted`: by blocks."""

    base: Floats
    noise: Floats
    wanted: WantedMoments


def blur(picture: NDArray[np.floating], pools: Pools) -> NDArray[np.float32]:
    """Average every pixel's pool: the blur of a pooling law, the fovea untouched.

    Parameters
    ----------
    picture : ndarray of shape (H, W, 3)
        Encoded R'G'B' in [0, 1].
    pools : Pools
        Of a geometry of this size.
    """
    return finished(picture, blurred(picture, pools), pools)


def metamer(
    picture: NDArray[np.floating],
    pools: Pools,
    settings: MetamerSettings,
    seed: int,
    *,
    noise_shift_px: NDArray[np.floating] | None = None,
) -> NDArray[np.float32]:
    """Replace what pools average away by noise of the same statistics.

    Parameters
    ----------
    picture : ndarray of shape (H, W, 3)
        Encoded R'G'B' in [0, 1].
    pools : Pools
        Of a geometry of this size.
    noise_shift_px : ndarray of shape (H, W, 2), optional
        Where surfaces have moved since noise was laid on them; by default it lies on the screen.

    Returns
    -------
    ndarray of float32, shape (H, W, 3)
        In [0, 1]; in the fovea bit for bit the picture.
    """
    parts = metamer_parts(picture, pools, settings, seed, noise_shift_px=noise_shift_px)
    return finished(picture, parts.base + parts.noise, pools)


def metamer_parts(
    picture: NDArray[np.floating],
    pools: Pools,
    settings: MetamerSettings,
    seed: int,
    *,
    noise_shift_px: NDArray[np.floating] | None = None,
) -> MetamerParts:
    """Base and noise, before they are added, faded and clipped."""
    geometry = pools.geometry
    count = chain_length(geometry.width_px, geometry.height_px)
    levels = min(settings.levels, count)
    lows = chain_of(picture.astype(np.float64), count, wraps=geometry.wraps)
    deepest = levels if settings.residual == "kept" else count
    base = select(lows[: deepest + 1], pools.lod, wraps=geometry.wraps)
    wanted = wanted_by_blocks(lows, pools, levels)
    channels = 3 if settings.chroma == "full" else 1
    plane = noise_plane(
        picture.shape[:2], seed, levels, channels, wraps=geometry.wraps, shift_px=noise_shift_px
    )
    noise = lost_noise(wanted, plane, levels, settings.chroma, wraps=geometry.wraps)
    strength: float | Floats = settings.noise
    if geometry.on_sphere:
        strength = strength * noise_strength(geometry.directions(*pixel_centres(geometry)))
    return MetamerParts(base, noise.on(base, strength) - base, wanted)


def blurred(picture: NDArray[np.floating], pools: Pools) -> Floats:
    """The blur before it is faded in: what all bands' means and the residual's add up to."""
    geometry = pools.geometry
    count = chain_length(geometry.width_px, geometry.height_px)
    chain = chain_of(picture.astype(np.float64), count, wraps=geometry.wraps)
    return select(chain, pools.lod, wraps=geometry.wraps)


def lost_noise(
    wanted: WantedMoments, plane: Floats, levels: int, chroma: str, *, wraps: bool
) -> Noise:
    """Weigh each band's noise by the deviation that its pool has lost.

    Weights are found for blocks of 4x4 pixels and interpolated: at 2x2 pixels, which share them;
    those of noise from `FIRST_SMOOTH` on at every pixel.
    """
    mixing = fitted_mixing(levels)
    size = plane.shape[:2]

    def at_pixels(blocks: Floats) -> Floats:
        halves = -(-size[0] // 2), -(-size[1] // 2)
        return twice(enlarge(blocks, halves, 1, wraps=wraps), size)

    def gains_of(means: Floats) -> Floats:
        return spectral_gains(means, mixing.overlap, aim=AIM)

    def deviations(variances: Floats) -> Floats:
        # Gains go on more smoothly than variances: one for 2x2 blocks.
        return np.sqrt(variances) * twice(gains_of(halve_box(variances)), variances.shape[:2])

    def deviation_of_all(variances: Floats) -> Floats:
        means = halve_box(variances)
        given = np.sqrt(means) * gains_of(means)
        together = ((given @ mixing.together) * given).sum(axis=2, keepdims=True)
        return twice(np.sqrt(np.maximum(together, 0)), variances.shape[:2])

    def weighed(noise: Floats, wide: Floats, shared: Floats) -> Floats:
        smooth = 3 * FIRST_SMOOTH
        own = enlarge(wide[..., smooth:], size, 2, wraps=wraps)
        weights: Floats = np.concatenate([shared[..., :smooth], own], axis=2)
        return noise * weights

    lost = deviations(wanted.variances)
    weights = at_pixels(lost)
    bands = weighed(plane[:, :, 0], lost, weights)
    by_level = bands.reshape(*size, levels, 3).sum(axis=3)
    ycc = np.zeros((*size, 3))
    ycc[..., 0] = by_level.sum(axis=2)
    deviation = at_pixels(deviation_of_all(wanted.variances))
    if chroma == "luma":
        luma, deviation = (one.repeat(3, axis=2) for one in (ycc[..., :1], deviation))
        return Noise(luma, deviation, along=np.ones(3))
    slopes = at_pixels(wanted.slopes.reshape(*wanted.slopes.shape[:2], -1))
    slopes = slopes.reshape(*size, levels, 2)
    ycc[..., 1:] = (by_level[..., None] * slopes).sum(axis=2)
    squares = (weights**2).reshape(*size, levels, 3).sum(axis=3)[..., None]
    variance = (squares * slopes**2).sum(axis=2)
    # Of R'G'B', but for bands' overlap.
    shares = (squares * rgb_slopes(slopes) ** 2).sum(axis=2)
    cross = (squares * rgb_slopes(slopes)).sum(axis=2)
    if chroma == "full":
        for channel in (1, 2):
            remainder = deviations(wanted.remainders[..., channel - 1])
            own = at_pixels(remainder)
            ycc[..., channel] += weighed(plane[:, :, channel], remainder, own).sum(axis=2)
            rest = (own**2).sum(axis=2)
            variance[..., channel - 1] += rest
            shares += rest[..., None] * RGB_FROM_YCBCR[:, channel] ** 2
    luma = squares.sum(axis=2)
    deviation = deviation * np.sqrt(np.divide(shares, luma, out=0 * shares, where=luma > 0))
    normal, along = rgb_from_ycbcr(ycc).astype(np.float64), along_luma(cross, shares, luma)
    if wanted.shape is None:
        return Noise(normal, deviation, along=along)
    coloured = variance.sum(axis=2, keepdims=True) / np.maximum(luma, SMALLEST_VARIANCE)
    below, above = reach_of(at_pixels(wanted.shape), deviation, coloured)
    along = along_pool(along, deviation, below, above)
    return Noise(normal, deviation, below, above, along)


def rgb_slopes(slopes: Floats) -> Floats:
    """Slopes of R'G'B' (..., 3) on luma, from those of Cb and Cr (..., 2)."""
    return np.asarray(1 + slopes @ RGB_FROM_YCBCR[:, 1:].T)


def reach_of(shape: Floats, deviation: Floats, coloured: Floats) -> tuple[Floats, Floats]:
    """Distance of a pool's red, green and blue below and above their mean: (..., 3) each.

    As far as the ends of the beta distribution of its moments: of two colours, these.

    Parameters
    ----------
    shape : ndarray of shape (..., 4)
        See `pooled_moments.colour_shape`.
    deviation : ndarray of shape (..., 3)
    coloured : ndarray of shape (..., 1)
        Chroma's variance over luma's. What is grey may lead farther.
    """
    skew, tightness = shape[..., :3], shape[..., 3:]
    lean = 1.5 * skew * (1 + tightness)
    total = abs(lean) + np.sqrt(lean**2 + tightness)
    scale = np.sqrt(deviation**2 + SMALLEST_VARIANCE)
    scale = scale * np.maximum(ROOMY, COLOURED / np.maximum(coloured, SMALLEST_VARIANCE))
    near, far = scale / total, scale * total / tightness
    return np.where(lean < 0, far, near), np.where(lean < 0, near, far)


def twice(image: Floats, size: tuple[int, int]) -> Floats:
    """Give each of 2x2 pixels the same value."""
    return image.repeat(2, axis=0).repeat(2, axis=1)[: size[0], : size[1]]


def finished(picture: NDArray[np.floating], changed: Floats, pools: Pools) -> NDArray[np.float32]:
    """Fade what has changed in beyond the fovea, clip it, and copy the fovea bit for bit."""
    fade = pools.fade()[..., None]
    result = np.clip(picture + fade * (changed - picture), 0, 1).astype(np.float32)
    return np.where(fade > 0, result, picture.astype(np.float32))
