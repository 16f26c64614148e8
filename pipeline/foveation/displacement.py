"""Metamers by displacement: the picture looked up a random, smooth way off.

Eidolons (Koenderink, Valsecchi, van Doorn, Wagemans and Gegenfurtner 2017, Journal of Vision
17(2)) look a picture up at ``x + D(x)``. Here D is noise pooled with a share of the eye's pooling
deviation, times another share of it: as smooth, and as wide, as the eye pools. What the look-up
does to the pooled moments of bands is mended by one match: `matched`.

D hangs on the picture, not on the screen, and on a gaze of its own: see steady_gaze.py.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.features.reference import check_levels, fitted_kernels
from pipeline.foveation.chain import chain_length, chain_of, enlarge, select
from pipeline.foveation.geometry import Geometry, pixel_centres
from pipeline.foveation.pooled_moments import SMALLEST_VARIANCE, band_variances
from pipeline.foveation.pooling import Pooling, Pools, lod_of
from pipeline.foveation.reference import finished, twice
from pipeline.foveation.sphere import displaced_rays
from pipeline.frame import Floats
from pipeline.noise.tile import Stream, key_of, white_noise

LEAST_SMOOTHNESS_PX = 0.5  # deviation of the field's own pools at least
REACH = 3.0  # deviations from a border, within which what crosses it fades out
LEAST_MATCH, MOST_MATCH = 0.5, 2.0
CUBIC = -0.5
"""Keys' parameter: Catmull and Rom's spline."""


@dataclass(frozen=True)
class DisplacementSettings:
    """Switches of `eidolon` and `warped-metamer`.

    Parameters
    ----------
    pooling : Pooling
        How widely the eye pools.
    reach : float
        Deviation of the displacement over that of the pools, from 0 to 2.
    smoothness : float
        Deviation of the displacement's own pools over the eye's, above 0, at most 4.
    levels : int
        Of the pyramid whose moments are matched, from 1 to 6.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    pooling: Pooling = field(default_factory=Pooling)
    reach: float = 0.35
    smoothness: float = 0.5
    levels: int = 5

    def __post_init__(self) -> None:
        if not 0 <= self.reach <= 2:
            raise InputError(f"reach must lie in 0..2 (got {self.reach})")
        if not 0 < self.smoothness <= 4:
            raise InputError(
                f"smoothness must lie above 0 and at most at 4 (got {self.smoothness})"
            )
        check_levels(self.levels)


def eidolon(
    picture: NDArray[np.floating],
    pools: Pools,
    settings: DisplacementSettings,
    seed: int,
    *,
    field_pools: Pools | None = None,
    shift_px: NDArray[np.floating] | None = None,
) -> NDArray[np.float32]:
    """Displace what lies in the periphery.

    Parameters
    ----------
    field_pools : Pools, optional
        Of the gaze that the field follows; by default `pools`.
    shift_px : ndarray of shape (H, W, 2), optional
        How far what each pixel shows has moved since the field was laid on it.
    """
    return finished(
        picture, displaced(picture, field_pools or pools, settings, seed, shift_px), pools
    )


def warped_metamer(
    picture: NDArray[np.floating],
    pools: Pools,
    settings: DisplacementSettings,
    seed: int,
    *,
    field_pools: Pools | None = None,
    shift_px: NDArray[np.floating] | None = None,
) -> NDArray[np.float32]:
    """Displace, then give every pool the band energies that it had; see `eidolon`."""
    warped = displaced(picture, field_pools or pools, settings, seed, shift_px)
    return finished(picture, matched(warped, picture, pools, settings.levels), pools)


def displaced(
    picture: NDArray[np.floating],
    pools: Pools,
    settings: DisplacementSettings,
    seed: int,
    shift_px: NDArray[np.floating] | None = None,
) -> Floats:
    """Look the picture up at ``x + D(x)``: (H, W, 3)."""
    geometry = pools.geometry
    offset = displacement_px(pools, settings, seed, shift_px)
    x, y = np.meshgrid(np.arange(geometry.width_px) + 0.5, np.arange(geometry.height_px) + 0.5)
    return look_up_cubic(
        picture.astype(np.float64), x + offset[..., 0], y + offset[..., 1], wraps=geometry.wraps
    )


def displacement_px(
    pools: Pools,
    settings: DisplacementSettings,
    seed: int,
    shift_px: NDArray[np.floating] | None = None,
) -> Floats:
    """D: unit noise, as smooth as asked, times `reach` times the pools' deviation: (H, W, 2)."""
    geometry = pools.geometry
    if geometry.on_sphere:
        return _on_sphere_px(pools, settings, seed, shift_px)
    field = unit_field(pools, settings.smoothness, seed)
    if shift_px is not None:
        x, y = np.meshgrid(*(np.arange(n) + 0.5 for n in field.shape[1::-1]))
        field = look_up_cubic(field, x - shift_px[..., 0], y - shift_px[..., 1], wraps=False)
    return _within_frame(geometry, settings.reach * pools.sigma_px(), field)


def _on_sphere_px(
    pools: Pools,
    settings: DisplacementSettings,
    seed: int,
    shift_px: NDArray[np.floating] | None,
) -> Floats:
    """D of a panorama, or of a part of it: no frame stands in its way."""
    geometry = pools.geometry
    x, y = np.broadcast_arrays(*pixel_centres(geometry))
    rays = geometry.directions(x, y)
    laid_on = None
    if shift_px is not None:
        laid_on = geometry.directions(x - shift_px[..., 0], y - shift_px[..., 1])
    moved = displaced_rays(
        rays,
        np.radians(pools.pooling.sigma_deg(pools.eccentricity_deg())),
        reach=settings.reach,
        smoothness=settings.smoothness,
        key=key_of(seed, Stream.LATTICE),
        laid_on=laid_on,
    )
    found: Floats = np.stack(geometry.positions(moved), axis=-1) - np.stack([x, y], axis=-1)
    if geometry.wraps:  # the short way round
        half = geometry.width_px / 2
        found[..., 0] = (found[..., 0] + half) % geometry.width_px - half
    return found


def _within_frame(geometry: Geometry, deviation_px: Floats, field: Floats) -> Floats:
    """`field` times a deviation, (H, W, 2), so that all of it leads into the frame.

    Outside nothing is known. So x fades towards the left and the right border, y towards the upper
    and the lower one, and smoothly: lines beside a border stay where they are, and as wide. Along a
    border D is free. What would still lead far towards one is held back: d of `room` pixels becomes
    ``d / (1 + d / room)``.
    """
    found = deviation_px[..., None] * field
    lengths = geometry.width_px, geometry.height_px
    for axis, places in enumerate(pixel_centres(geometry)):
        left = np.broadcast_to(places, deviation_px.shape)
        right = lengths[axis] - left
        share = np.clip(np.minimum(left, right) / np.maximum(REACH * deviation_px, 1e-9), 0, 1)
        away = share * share * (3 - 2 * share) * found[..., axis]
        found[..., axis] = away / (1 + np.abs(away) / np.where(away > 0, right, left))
    return found


def unit_field(pools: Pools, smoothness: float, seed: int) -> Floats:
    """Noise pooled with `smoothness` times a flat picture's pools, of variance 1: (H, W, 2)."""
    geometry = pools.geometry
    count = chain_length(geometry.width_px, geometry.height_px)

    def lod_at(halvings: int) -> Floats:
        sigma_px = np.maximum(smoothness * pools.sigma_px(halvings), LEAST_SMOOTHNESS_PX)
        return np.minimum(lod_of(sigma_px), count)

    white = field_noise((geometry.height_px, geometry.width_px), seed)
    chosen = select(chain_of(white, count, wraps=False), lod_at, wraps=False)
    return chosen / np.sqrt(pooled_white_variance(lod_at(0)))[..., None]


def field_noise(size: tuple[int, int], seed: int) -> Floats:
    """White vectors of unit variance, the same on every platform: (H, W, 2)."""
    return white_noise(seed, size, 2, Stream.FIELD)


def pooled_white_variance(lod: Floats) -> Floats:
    """Variance of white unit noise chosen at a level of detail; of the same shape."""
    table = np.array(white_energies(int(np.ceil(lod.max())) + 1))
    level = np.floor(lod).astype(np.intp)
    share = lod - level
    both, cross, coarse = (table[level, index] for index in range(3))
    return np.asarray((1 - share) ** 2 * both + 2 * share * (1 - share) * cross + share**2 * coarse)


@lru_cache(maxsize=4)
def white_energies(count: int) -> tuple[tuple[float, float, float], ...]:
    """Variance, covariance, variance of white noise halved n and n + 1 times and doubled back.

    Covariances by lag, averaged over the places between coarse pixels.
    """
    low, up = fitted_kernels().low, np.array([1.0, 3.0, 3.0, 1.0]) / 4
    up2 = np.outer(up, up)
    white = np.zeros((_LAGS, _LAGS))
    white[_LAGS // 2, _LAGS // 2] = 1.0
    levels: list[tuple[float, float, float]] = []
    own = white
    for level in range(count):
        halved = _thinned(_correlated(_correlated(own, low), low[::-1, ::-1]))
        doubled = _spread(halved, _autocorrelation(up2)) / 4
        # Of a level with its halved and doubled self: E[p q], by place averaged.
        kernel = _full(low[::-1, ::-1], up2) / 4
        cross = _correlated(own, kernel)
        triple = [own, cross, doubled]
        for _ in range(level):
            triple = [_spread(part, _autocorrelation(up2)) / 4 for part in triple]
        first, both, second = (float(part[_LAGS // 2, _LAGS // 2]) for part in triple)
        levels.append((first, both, second))
        own = halved
    return tuple(levels)


_LAGS = 33  # kept around 0, along each axis


def _full(a: Floats, b: Floats) -> Floats:
    out = np.zeros((a.shape[0] + b.shape[0] - 1, a.shape[1] + b.shape[1] - 1))
    for (row, column), value in np.ndenumerate(a):
        out[row : row + b.shape[0], column : column + b.shape[1]] += value * b
    return out


def _autocorrelation(kernel: Floats) -> Floats:
    return _full(kernel, kernel[::-1, ::-1])


def _correlated(covariance: Floats, kernel: Floats) -> Floats:
    """Convolve, keeping lag 0 where it is, for kernels of odd edge; even ones come in pairs."""
    whole = _full(covariance, kernel)
    first = (len(kernel) - 1) // 2
    return whole[first : first + _LAGS, first : first + _LAGS]


def _thinned(covariance: Floats) -> Floats:
    """Keep every second lag. Two even kernels before it have moved lag 0 by one."""
    middle = _LAGS // 2 + 1
    out = np.zeros_like(covariance)
    reach = (_LAGS // 2 - 1) // 2
    kept = covariance[middle - 2 * reach : middle + 2 * reach + 1 : 2][
        :, middle - 2 * reach : middle + 2 * reach + 1 : 2
    ]
    at = _LAGS // 2 - reach
    out[at : at + 2 * reach + 1, at : at + 2 * reach + 1] = kept
    return out


def _spread(covariance: Floats, kernel: Floats) -> Floats:
    """Put zeros between lags, and convolve with a kernel of odd edge."""
    middle = _LAGS // 2
    reach = middle // 2
    wide = np.zeros_like(covariance)
    wide[
        middle - 2 * reach : middle + 2 * reach + 1 : 2,
        middle - 2 * reach : middle + 2 * reach + 1 : 2,
    ] = covariance[middle - reach : middle + reach + 1, middle - reach : middle + reach + 1]
    return _correlated(wide, kernel)


def look_up_cubic(image: Floats, x: Floats, y: Floats, *, wraps: bool) -> Floats:
    """Interpolate (H, W, channels) by a cubic spline at positions (h, w); mirrored borders."""
    height, width = image.shape[:2]
    column, row = np.floor(x - 0.5), np.floor(y - 0.5)
    across, down = _cubic(x - 0.5 - column), _cubic(y - 0.5 - row)
    total = np.zeros((*x.shape, image.shape[2]))
    for i in range(4):
        rows = _mirrored(row.astype(np.intp) + i - 1, height)
        for j in range(4):
            at = column.astype(np.intp) + j - 1
            columns = at % width if wraps else _mirrored(at, width)
            total += (down[i] * across[j])[..., None] * image[rows, columns]
    return total


def _cubic(share: Floats) -> list[Floats]:
    """Weights of the four neighbours of a place `share` behind the second (Keys 1981)."""

    def near(t: Floats) -> Floats:
        return ((CUBIC + 2) * t - (CUBIC + 3)) * t * t + 1

    def far(t: Floats) -> Floats:
        return CUBIC * (((t - 5) * t + 8) * t - 4)

    return [far(1 + share), near(share), near(1 - share), far(2 - share)]


def _mirrored(index: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """Reflect indices at the borders, which repeat."""
    index = index % (2 * count)
    return np.asarray(np.where(index < count, index, 2 * count - 1 - index))


def matched(warped: Floats, picture: NDArray[np.floating], pools: Pools, levels: int = 5) -> Floats:
    """Give `warped` the pooled moments of `picture`, once: (H, W, 3).

    What each band adds is multiplied by the root of the variance of luma that its pool should have
    over the one it has, from 1/2 to 2; the mean of each pool, over all levels, is replaced. The
    finest level has one factor for 2x2 pixels: there, more would cost most and give least.
    """
    geometry = pools.geometry
    wraps = geometry.wraps
    count = chain_length(geometry.width_px, geometry.height_px)
    levels = min(levels, count)
    true = chain_of(picture.astype(np.float64), count, wraps=wraps)
    ours = chain_of(warped, count, wraps=wraps)
    change = np.zeros_like(ours[levels])
    for level in reversed(range(levels)):
        size = ours[level].shape[:2]
        wanted, found = (
            band_variances(lows[level:], pools, level, halvings=int(level == 0))
            for lows in (true, ours)
        )
        detail = ours[level] - enlarge(ours[level + 1], size, 1, wraps=wraps)
        change = enlarge(change, size, 1, wraps=wraps)
        if level == 0:
            total = (part.sum(axis=2, keepdims=True) for part in (wanted, found))
            change += (twice(_match(*total), size) - 1) * detail
            continue
        gain = _match(wanted, found) - 1
        oriented = oriented_parts(ours[level], wraps=wraps)
        for index, part in enumerate([detail - sum(oriented), *oriented]):
            change += gain[..., index : index + 1] * part
    difference = [a - b for a, b in zip(true, ours, strict=True)]
    return warped + change + select(difference, pools.lod, wraps=wraps)


def oriented_parts(image: Floats, *, wraps: bool) -> tuple[Floats, Floats]:
    """Parts that the two oriented bands of a level add to it: (h, w, channels) each.

    A band passes its kernel twice, the second time mirrored: together a column's profile times the
    squared differences across it.
    """
    edge, corner = fitted_kernels().oriented[1, 2], fitted_kernels().oriented[0, 2]
    profile = np.convolve((corner, edge, corner), (corner, edge, corner))
    around = np.pad(image, ((0, 0), (2, 2), (0, 0)), mode="wrap" if wraps else "edge")
    around = np.pad(around, ((2, 2), (0, 0), (0, 0)), mode="edge")
    height, width = image.shape[:2]

    def at(down: int, right: int) -> Floats:
        return around[2 + down : 2 + down + height, 2 + right : 2 + right + width]

    along_x, along_y = np.zeros_like(image), np.zeros_like(image)
    for offset, weight in zip(range(-2, 3), profile, strict=True):
        along_x += weight * (2 * at(offset, 0) - at(offset, -2) - at(offset, 2))
        along_y += weight * (2 * at(0, offset) - at(-2, offset) - at(2, offset))
    return along_x, along_y


def _match(wanted: Floats, found: Floats) -> Floats:
    gain = np.sqrt((wanted + SMALLEST_VARIANCE) / (found + SMALLEST_VARIANCE))
    return np.clip(gain, LEAST_MATCH, MOST_MATCH)
