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

from pipeline.foveation.bounded import added
from pipeline.foveation.chain import chain_length, chain_of, enlarge, halve_box, select
from pipeline.foveation.geometry import pixel_centres
from pipeline.foveation.lod import Pools
from pipeline.foveation.moments import SMALLEST_VARIANCE, Wanted, wanted_by_blocks
from pipeline.foveation.noise_plane import noise_plane
from pipeline.foveation.settings import MetamerSettings
from pipeline.foveation.sphere import noise_strength
from pipeline.noise.gains import spectral_gains
from pipeline.noise.mixing import fitted_mixing

Floats = NDArray[np.float64]

AIM = 1.0
"""Of the noise's deviation over the one that was pooled; fills ask for more, see mixing.AIM."""
MOST_BEND = 0.5
"""See `bent`: of noise of unit variance, whose shorter side then ends at its deviation."""
FIRST_SMOOTH = 3
"""Pixels of 2x2 share what weighs finer levels' noise; noise from this level on is so smooth that
shared weights would show as a comb."""


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise that is shaped: `ycc` (H, W, 3), and the deviation of its luma, (H, W)."""

    ycc: Floats
    deviation: Floats

    def times(self, strength: float | Floats) -> Noise:
        """As much stronger, everywhere or by pixel (H, W)."""
        factor = np.asarray(strength, np.float64)
        return Noise(factor[..., None] * self.ycc, factor * self.deviation)


@dataclass(frozen=True, eq=False)
class Parts:
    """A metamer on its way. `base`, `noise` (H, W, 3): R'G'B'; `wanted`: by blocks."""

    base: Floats
    noise: Floats
    wanted: Wanted


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
) -> Parts:
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
    noise = shaped_noise(wanted, plane, levels, settings.chroma, wraps=geometry.wraps)
    noise = noise.times(settings.noise)
    if geometry.on_sphere:
        noise = noise.times(noise_strength(geometry.directions(*pixel_centres(geometry))))
    return Parts(base, added(base, noise.ycc, noise.deviation) - base, wanted)


def blurred(picture: NDArray[np.floating], pools: Pools) -> Floats:
    """The blur before it is faded in: what all bands' means and the residual's add up to."""
    geometry = pools.geometry
    count = chain_length(geometry.width_px, geometry.height_px)
    chain = chain_of(picture.astype(np.float64), count, wraps=geometry.wraps)
    return select(chain, pools.lod, wraps=geometry.wraps)


def shaped_noise(wanted: Wanted, plane: Floats, levels: int, chroma: str, *, wraps: bool) -> Noise:
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
    deviation = at_pixels(deviation_of_all(wanted.variances))[..., 0]
    if chroma == "luma":
        return Noise(ycc, deviation)
    slopes = at_pixels(wanted.slopes.reshape(*wanted.slopes.shape[:2], -1))
    slopes = slopes.reshape(*size, levels, 2)
    ycc[..., 1:] = (by_level[..., None] * slopes).sum(axis=2)
    squares = (weights**2).reshape(*size, levels, 3).sum(axis=3)
    variance = (squares[..., None] * slopes**2).sum(axis=2)
    if chroma == "full":
        for channel in (1, 2):
            remainder = deviations(wanted.remainders[..., channel - 1])
            own = at_pixels(remainder)
            ycc[..., channel] += weighed(plane[:, :, channel], remainder, own).sum(axis=2)
            variance[..., channel - 1] += (own**2).sum(axis=2)
    if wanted.shape is not None:
        shape = at_pixels(wanted.shape)
        ycc[..., 1:] = bent(ycc[..., 1:], shape[..., :2], shape[..., 2:], variance)
    return Noise(ycc, deviation)


def bent(noise: Floats, skewness: Floats, tightness: Floats, variance: Floats) -> Floats:
    """Give normal noise of zero mean and this variance the shape that chroma has in its pool.

    Of unit variance it is ``n + bend (n^2 - 1)``, held where it would turn back, over what that
    adds to its deviation: the first terms of Cornish and Fisher (1938). Then it is held within the
    ends of the beta distribution of the pool's moments: of two colours, at these.

    Parameters
    ----------
    skewness, tightness : ndarray
        See `chroma_shape`; a sixth of the skewness. `bend` is that, up to `MOST_BEND`.
    """
    deviation = np.sqrt(variance + SMALLEST_VARIANCE)
    bend = np.clip(skewness, -MOST_BEND, MOST_BEND)
    turned = noise * bend / deviation
    held = np.divide(-0.25 * deviation, bend, out=np.zeros_like(bend), where=bend != 0)
    bowed = np.where(turned > -0.5, noise * (1 + turned), held) - bend * deviation
    lean = 1.5 * skewness * (1 + tightness)
    root = np.sqrt(lean**2 + tightness)
    reach = deviation / tightness
    return np.clip(bowed / np.sqrt(1 + 2 * bend**2), reach * (lean - root), reach * (lean + root))


def twice(image: Floats, size: tuple[int, int]) -> Floats:
    """Give each of 2x2 pixels the same value."""
    return image.repeat(2, axis=0).repeat(2, axis=1)[: size[0], : size[1]]


def finished(picture: NDArray[np.floating], changed: Floats, pools: Pools) -> NDArray[np.float32]:
    """Fade what has changed in beyond the fovea, clip it, and copy the fovea bit for bit."""
    fade = pools.fade()[..., None]
    result = np.clip(picture + fade * (changed - picture), 0, 1).astype(np.float32)
    return np.where(fade > 0, result, picture.astype(np.float32))
