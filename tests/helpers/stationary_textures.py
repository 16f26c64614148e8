"""Band statistics of stationary textures in holes behind a disc.

A plane of amplitudes 1 / f^e, blurred or not, and a disc in front that has moved right. What the
fill's bands measure in the uncovered hole is compared with what the plane's own measure there,
over many seeds of texture and noise, at the levels that `metameric` has by default. One seed's
textures are all filtered from one white noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.features.reference import analyse, spoiled_levels
from pipeline.frame import WarpedFrame
from pipeline.synthesis.settings import MetamericSettings

LEVELS = MetamericSettings.levels
FRONT_M, BACK_M = 2.0, 5.0
FRONT_COLOUR = np.array((0.8, 0.1, 0.1), np.float32)

Mask = NDArray[np.bool_]
Numbers = NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """A disc in a square frame, in pixels; the edge is a multiple of the coarsest coefficient."""

    edge_px: int
    radius_px: int
    shift_px: int

    def __post_init__(self) -> None:
        if self.edge_px % (1 << (LEVELS - 1)):
            raise ValueError(
                f"edge_px must be a multiple of {1 << (LEVELS - 1)} (got {self.edge_px})"
            )

    def masks(self) -> tuple[Mask, Mask]:
        """The disc, and what of its old place it has uncovered, each (edge, edge)."""
        middle = self.edge_px / 2
        rows, columns = np.mgrid[: self.edge_px, : self.edge_px] + 0.5
        front, before = (
            np.hypot(columns - x, rows - middle) < self.radius_px
            for x in (middle + self.shift_px / 2, middle - self.shift_px / 2)
        )
        return front, before & ~front


@dataclass(frozen=True)
class Texture:
    """Grey, of amplitude 1 / f^exponent, then blurred by a Gaussian of deviation `blur_px`."""

    exponent: float
    blur_px: float = 0.0

    def picture(self, edge_px: int, seed: int) -> NDArray[np.float32]:
        """Make it periodic, mean 0.5, deviation 0.12: (edge, edge, 1)."""
        axis = np.fft.fftfreq(edge_px)
        frequency = np.hypot(axis[:, None], axis)
        white = np.random.default_rng(seed).standard_normal((edge_px, edge_px))
        amplitude = np.maximum(frequency, 1 / 32) ** -self.exponent
        amplitude = amplitude * np.exp(-2 * (np.pi * self.blur_px * frequency) ** 2)
        texture = np.fft.ifft2(np.fft.fft2(white) * amplitude).real
        shown = (0.5 + 0.12 * texture[..., None] / texture.std()).clip(0, 1)
        return np.asarray(shown, np.float32)


class Fills(Protocol):
    """A fill method."""

    def fill(self, frame: WarpedFrame, *, seed: int) -> NDArray[np.float32]:
        """Return the frame with its holes filled."""


def whole_coefficients(front: Mask, uncovered: Mask, levels: int) -> list[Mask]:
    """Tell which coefficients lie in the hole and never see the disc in front."""
    clean = [~mask for mask in spoiled_levels(front, levels)]
    inside = [uncovered]
    for _ in range(1, levels):
        half = len(inside[-1]) // 2
        inside.append(np.asarray(inside[-1].reshape(half, 2, half, 2).all(axis=(1, 3))))
    return [a & b for a, b in zip(inside, clean, strict=True)]


@dataclass(frozen=True, eq=False)
class Bands:
    """Bands of the fill against the plane's, each (textures, levels, 3)."""

    ratio: Numbers  # of deviations
    offset: Numbers  # of means, in the plane's deviations


def measure(
    method: Fills, scene: Scene, textures: Sequence[Texture], seeds: Sequence[int]
) -> Bands:
    """Fill behind the disc, once per texture and seed, of plane and noise alike."""
    front, uncovered = scene.masks()
    places = whole_coefficients(front, uncovered, LEVELS)
    # Fill, plane; first or second moment.
    sums = np.zeros((2, 2, len(textures), LEVELS, 3))
    for seed in seeds:
        for which, texture in enumerate(textures):
            plane = texture.picture(scene.edge_px, seed)
            frame = WarpedFrame(
                np.where(front[..., None], FRONT_COLOUR, plane),
                np.where(front, FRONT_M, BACK_M).astype(np.float32),
                uncovered,
                np.zeros((*front.shape, 2), np.float32),
            )
            shown = (method.fill(frame, seed=seed)[..., 1:2], plane)
            for image, total in zip(shown, sums, strict=True):
                for level, bands in enumerate(analyse(image.astype(np.float64), LEVELS).bands):
                    values = bands[places[level]][..., 0]
                    total[0, which, level] += values.mean(axis=0) / len(seeds)
                    total[1, which, level] += (values**2).mean(axis=0) / len(seeds)
    mean = sums[:, 0]
    deviation = np.sqrt(sums[:, 1] - mean**2)
    ratio = deviation / deviation[1]
    offset = np.abs(mean - mean[1]) / deviation[1]
    return Bands(ratio[0], offset[0])
