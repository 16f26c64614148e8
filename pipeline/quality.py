"""Closeness of a fill to the truth, inside a mask.

Every measure first sets all pixels outside the mask to the truth, so that only the fill
counts, as in Kuffner dos Anjos et al. 2022, section 5.1.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pipeline.colour import YCBCR_FROM_RGB, ycbcr_from_rgb
from pipeline.errors import InputError
from pipeline.features.reference import analyse
from pipeline.frame import Bools, Floats, check_colour, check_hole, check_same_size

SSIM_SIGMA_PX = 1.5
SSIM_LEAST_PX = 11  # the window of Wang et al. 2004
HIGH_PASS_SIGMA_PX = 2.0
ROUNDING = 1e-12  # a blur of a flat picture differs from it by up to 1e-15, machine by machine
BAND_LEVELS = 4
BAND_POOLING = 4.0  # standard deviation of the pooling window, coefficients of the level


@dataclass(frozen=True)
class Quality:
    """All measures of one fill.

    Attributes
    ----------
    psnr_db : float
        Higher is better; inf for a perfect fill.
    ssim : float
        At most 1, which is perfect.
    high_frequency_ratio : float
        1 is right; below is blur, above is noise or false edges.
    band_error : float
        0 is right; 1 is what bands without any content would score.
    """

    psnr_db: float
    ssim: float
    high_frequency_ratio: float
    band_error: float


class KnownTruth:
    """The truth, and what measures of fills ask of it: computed once for all fills of a hole.

    Parameters
    ----------
    colour : ndarray of float32, shape (H, W, 3)
        Encoded R'G'B' in [0, 1].
    """

    def __init__(self, colour: NDArray[np.float32]) -> None:
        self.colour = colour
        self._moments: dict[bytes, list[Floats]] = {}

    @cached_property
    def _bands(self) -> tuple[Floats, ...]:
        return analyse(ycbcr_from_rgb(self.colour.astype(np.float64)), BAND_LEVELS).bands

    def moments(self, mask: Bools) -> list[Floats]:
        """Pooled moments of each level's bands inside `mask`."""
        key = mask.tobytes()
        if key not in self._moments:
            self._moments[key] = _pooled_moments(self._bands, mask)
        return self._moments[key]


def interior(hole: Bools) -> Bools:
    """Keep the holes, (H, W), that do not touch the frame's border, not even by a corner.

    What enters at the border lies beside what no view saw, and says more about the framing than
    about the fill.
    """
    labels, _ = ndimage.label(hole, np.ones((3, 3)))
    at_border = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    return hole & ~np.isin(labels, at_border)


def evaluate(
    filled: NDArray[np.float32], truth: KnownTruth | NDArray[np.float32], mask: Bools
) -> Quality:
    """Measure `filled` against `truth` inside `mask`.

    Parameters
    ----------
    filled : ndarray of float32, shape (H, W, 3)
        Encoded R'G'B' in [0, 1].
    truth : KnownTruth, or ndarray like `filled`
    mask : ndarray of bool, shape (H, W)
        At least one pixel.

    Raises
    ------
    InputError
        If an array breaks these rules, or the image is too small for SSIM.
    """
    if not isinstance(truth, KnownTruth):
        truth = KnownTruth(truth)
    return Quality(
        psnr_db=psnr_db(filled, truth.colour, mask),
        ssim=ssim(filled, truth.colour, mask),
        high_frequency_ratio=high_frequency_ratio(filled, truth.colour, mask),
        band_error=band_error(filled, truth, mask),
    )


def psnr_db(filled: NDArray[np.float32], truth: NDArray[np.float32], mask: Bools) -> float:
    """Peak signal-to-noise ratio of the three channels, peak 1, in decibels."""
    inside = _composite(filled, truth, mask)[mask] - truth[mask].astype(np.float64)
    mean_square = float(np.mean(inside**2))
    return float("inf") if mean_square == 0 else -10.0 * float(np.log10(mean_square))


def ssim(filled: NDArray[np.float32], truth: NDArray[np.float32], mask: Bools) -> float:
    """Structural similarity (Wang et al. 2004), its map averaged over the mask and channels.

    Gaussian window of 1.5 px, population covariances, range 1, as the paper has it; windows
    at the mask's border see the truth around it.
    """
    from skimage.metrics import structural_similarity

    composite = _composite(filled, truth, mask)
    if min(mask.shape) < SSIM_LEAST_PX:
        raise InputError(
            f"SSIM needs at least {SSIM_LEAST_PX}x{SSIM_LEAST_PX} px"
            f" (got {mask.shape[0]}x{mask.shape[1]})"
        )
    _, similarity = structural_similarity(
        composite,
        truth.astype(np.float64),
        data_range=1.0,
        channel_axis=-1,
        gaussian_weights=True,
        sigma=SSIM_SIGMA_PX,
        use_sample_covariance=False,
        full=True,
    )
    return float(np.mean(similarity[mask]))


def high_frequency_ratio(
    filled: NDArray[np.float32], truth: NDArray[np.float32], mask: Bools
) -> float:
    """Root-mean-square of the fill's fine detail over that of the truth's.

    Fine detail is luma less its Gaussian blur of 2 px.

    Raises
    ------
    InputError
        If the truth has no fine detail inside the mask: then no ratio exists.
    """
    ours, theirs = (
        float(np.sqrt(np.mean(_fine_detail(image)[mask] ** 2)))
        for image in (_composite(filled, truth, mask), truth.astype(np.float64))
    )
    if theirs < ROUNDING:
        raise InputError("the truth must have some detail inside the mask (it is flat there)")
    return ours / theirs


def band_error(filled: NDArray[np.float32], truth: KnownTruth, mask: Bools) -> float:
    """Distance of the local statistics of the fill's bands from the truth's.

    Mean and deviation of every band of the steerable pyramid in Y'CbCr, pooled over the
    mask's coefficients in a Gaussian window of 4: what two metamers share. Per level the
    error is
    ``sqrt(sum (mu - mu')^2 + (sigma - sigma')^2) / sqrt(sum mu'^2 + sigma'^2)``, summed over
    the mask, the bands and the channels; the levels are averaged.

    Raises
    ------
    InputError
        If the truth has no detail inside the mask on some level.
    """
    composite = _composite(filled, truth.colour, mask)
    ours = _pooled_moments(analyse(ycbcr_from_rgb(composite), BAND_LEVELS).bands, mask)
    errors = []
    for level, (pooled, true) in enumerate(zip(ours, truth.moments(mask), strict=True)):
        reference = float(np.sum(true**2))
        if reference < ROUNDING**2:
            raise InputError(
                f"the truth must have some detail inside the mask on level {level} (it is flat)"
            )
        errors.append(np.sqrt(np.sum((pooled - true) ** 2) / reference))
    return float(np.mean(errors))


def _pooled_moments(bands: tuple[Floats, ...], mask: Bools) -> list[Floats]:
    """Local mean and deviation of each level, inside `mask`: shape (2, inside, ...)."""

    def pool(values: Floats, mask: Bools) -> Floats:
        sigma = (BAND_POOLING, BAND_POOLING) + (0.0,) * (values.ndim - 2)
        return np.asarray(ndimage.gaussian_filter(values, sigma, mode="constant")[mask])

    moments = []
    for band in bands:
        (box,) = ndimage.find_objects(mask.astype(np.uint8))  # outside, nothing is pooled
        inside, within = band[box], mask[box]
        share = within.reshape(within.shape + (1,) * (band.ndim - 2)).astype(np.float64)
        weight = pool(share, within)
        mean = pool(share * inside, within) / weight
        square = pool(share * inside**2, within) / weight
        moments.append(np.stack([mean, np.sqrt(np.maximum(square - mean**2, 0.0))]))
        mask = _halve_mask(mask)
    return moments


def _halve_mask(mask: Bools) -> Bools:
    height, width = mask.shape
    padded = np.pad(mask, ((0, height % 2), (0, width % 2)))
    return np.asarray(
        padded.reshape((height + 1) // 2, 2, (width + 1) // 2, 2).any(axis=(1, 3)), dtype=np.bool_
    )


def _fine_detail(image: Floats) -> Floats:
    luma = image @ YCBCR_FROM_RGB[0]
    return np.asarray(luma - ndimage.gaussian_filter(luma, HIGH_PASS_SIGMA_PX, mode="nearest"))


def _composite(filled: NDArray[np.float32], truth: NDArray[np.float32], mask: Bools) -> Floats:
    check_colour(filled, "filled")
    check_colour(truth, "truth")
    check_hole(mask, "mask")
    check_same_size(filled=filled, truth=truth, mask=mask)
    if not mask.any():
        raise InputError("mask must hold at least one pixel (it is empty)")
    return np.where(mask[..., None], filled, truth).astype(np.float64)
