"""Band statistics of stationary textures in holes behind a disc: `script/bench stationary --help`.

A plane of amplitudes 1 / f^e, blurred or not, and a disc in front that has moved right. What the
fill's bands measure in the uncovered hole is compared with what the plane's own measure there,
over many seeds of texture and noise, from 1000 on; the tests and all fitting use those from 0 on.
A guard against breakage: within a quarter, at the levels that `metameric` has by default, but for
white noise.
One seed's textures are all filtered from one white noise.

The control is the plane of another seed in place of the fill. A fill shares its surroundings with
the plane it is compared with, the control shares nothing: it says how far apart two samples of
one texture lie, not the error of the fill's numbers.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.shared.output import PagePart, file_to_write, write_record
from pipeline.features.reference import analyse, spoiled_levels
from pipeline.frame import WarpedFrame
from pipeline.gl.context import create_context, describe, release_context
from pipeline.methods.registry import create_method
from pipeline.synthesis.settings import MetamericSettings
from protocols.revision import code_revision, package_version

LEVELS = MetamericSettings.levels
Z_NEAR_M, FRONT_M, BACK_M = 1.0, 2.0, 5.0
FRONT_COLOUR = np.array((0.8, 0.1, 0.1), np.float32)
FIRST_SEED = 1000
PART = PagePart("stationary table")

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

    @property
    def label(self) -> str:
        """The hole's width and height, and the frame's edge."""
        return f"{self.shift_px} by {2 * self.radius_px} px, in {self.edge_px} px"

    def masks(self) -> tuple[Mask, Mask]:
        """The disc, and what of its old place it has uncovered, each (edge, edge)."""
        middle = self.edge_px / 2
        rows, columns = np.mgrid[: self.edge_px, : self.edge_px] + 0.5
        front, before = (
            np.hypot(columns - x, rows - middle) < self.radius_px
            for x in (middle + self.shift_px / 2, middle - self.shift_px / 2)
        )
        return front, before & ~front


SCENES = (
    Scene(320, 40, 56),
    Scene(256, 64, 110),
    Scene(192, 64, 44),
    Scene(192, 56, 36),
)


@dataclass(frozen=True)
class Texture:
    """Grey, of amplitude 1 / f^exponent, then blurred by a Gaussian of deviation `blur_px`."""

    exponent: float
    blur_px: float = 0.0

    @property
    def label(self) -> str:
        """For a column's head."""
        return f"e = {self.exponent:g}" + (f", blur {self.blur_px:g} px" if self.blur_px else "")

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


TEXTURES = (Texture(0.0), Texture(1.0), Texture(2.0), Texture(0.0, 1.0), Texture(1.0, 1.0))


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
    control_ratio: Numbers  # of deviations; planes of other seeds in place of the fills
    control_offset: Numbers


def measure(
    method: Fills, scene: Scene, textures: Sequence[Texture], seeds: Sequence[int]
) -> Bands:
    """Fill behind the disc, once per texture and seed, of plane and noise alike."""
    front, uncovered = scene.masks()
    places = whole_coefficients(front, uncovered, LEVELS)
    apart = max(seeds) + 1 - min(seeds)
    # Fill, plane, other plane; first or second moment.
    sums = np.zeros((3, 2, len(textures), LEVELS, 3))
    for seed in seeds:
        for which, texture in enumerate(textures):
            plane = texture.picture(scene.edge_px, seed)
            frame = WarpedFrame(
                np.where(front[..., None], FRONT_COLOUR, plane),
                np.where(front, FRONT_M, BACK_M).astype(np.float32),
                uncovered,
                np.zeros((*front.shape, 2), np.float32),
            )
            other = texture.picture(scene.edge_px, seed + apart)
            shown = (method.fill(frame, seed=seed)[..., 1:2], plane, other)
            for image, total in zip(shown, sums, strict=True):
                for level, bands in enumerate(analyse(image.astype(np.float64), LEVELS).bands):
                    values = bands[places[level]][..., 0]
                    total[0, which, level] += values.mean(axis=0) / len(seeds)
                    total[1, which, level] += (values**2).mean(axis=0) / len(seeds)
    mean = sums[:, 0]
    deviation = np.sqrt(sums[:, 1] - mean**2)
    ratio = deviation / deviation[1]
    offset = np.abs(mean - mean[1]) / deviation[1]
    return Bands(ratio[0], offset[0], ratio[2], offset[2])


def row(scene: Scene, found: Bands) -> str:
    """One line of the table.

    Of the coarsest level: how many whole coefficients of the hole lie side by side, and how many
    in all do not see the disc and are measured.
    """
    front, uncovered = scene.masks()
    spanned = whole_coefficients(np.zeros_like(front), uncovered, LEVELS)[-1]
    measured = whole_coefficients(front, uncovered, LEVELS)[-1]
    ranges = [f"{ratio.min():.2f} to {ratio.max():.2f}" for ratio in found.ratio]
    control = f"{found.control_ratio.min():.2f} to {found.control_ratio.max():.2f}"
    counts = [str(spanned.sum(axis=1).max()), str(measured.sum())]
    cells = [scene.label, *counts, *ranges, f"{found.offset.max():.2f}"]
    return f"| {' | '.join([*cells, control, f'{found.control_offset.max():.2f}'])} |"


def header(textures: Sequence[Texture]) -> str:
    """Head of the table."""
    columns = [
        "hole",
        f"level {LEVELS - 1}: side by side",
        "measured",
        *(texture.label for texture in textures),
    ]
    columns += ["mean off", "control", "control's mean off"]
    rule = "| --- |" + " ---: |" * (len(columns) - 1)
    return f"| {' | '.join(columns)} |\n{rule}"


def main(argv: list[str]) -> int:
    """Measure, print, and store with what the numbers depend on."""
    parser = argparse.ArgumentParser(prog="script/bench stationary", description=__doc__)
    parser.add_argument("--seeds", type=int, default=32, help="number of seeds for each texture")
    parser.add_argument("--docs", type=PART.page, help="document whose table is replaced")
    parser.add_argument("--json", type=file_to_write, help="file to store the numbers in")
    arguments = parser.parse_args(argv)
    if arguments.seeds < 1:
        parser.error(f"--seeds must be at least 1 (got {arguments.seeds})")
    seeds = range(FIRST_SEED, FIRST_SEED + arguments.seeds)
    lines, record = [header(TEXTURES)], []
    print(lines[0])
    ctx = create_context()
    try:
        renderer = str(describe(ctx))
        method = create_method("metameric", ctx, {"z_near_m": Z_NEAR_M})
        try:
            for scene in SCENES:
                found = measure(method, scene, TEXTURES, seeds)
                lines.append(row(scene, found))
                print(lines[-1], flush=True)
                numbers = {name: value.tolist() for name, value in vars(found).items()}
                record.append({**asdict(scene), **numbers})
        finally:
            method.release()
    finally:
        release_context(ctx)
    if arguments.json is not None:
        numbers = {
            "version": package_version(),
            "revision": code_revision(),
            "renderer": renderer,
            "first_seed": seeds.start,
            "seeds": len(seeds),
            "textures": [asdict(texture) for texture in TEXTURES],
            "scenes": record,
        }
        write_record(arguments.json, numbers)
    if arguments.docs is not None:
        PART.replace(arguments.docs, "\n".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
