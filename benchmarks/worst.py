"""The worst places of every fill method, to look at: `script/bench worst --out FOLDER`.

Over stereo pairs and built-in scenes, a sheet per method: the crops whose local statistics are
farthest from the truth's, each as filled, as it should be, and with its holes marked.

The local measure compares mean and deviation of Y'CbCr in a Gaussian window, truth's and fill's, in
the mask. It is blind to where a texture stands, and sees what is too bright, too smooth or
too busy.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import moderngl
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from benchmarks.paper import SEED, Colour, View, photographs, rendered
from pipeline.colour import ycbcr_from_rgb
from pipeline.gl.context import create_context, describe, release_context
from pipeline.methods.registry import METHODS, create_method
from stimuli import pictures
from stimuli.scenes.builtin_scenes import scene_names

WINDOW_PX = 3.0  # standard deviation
CROP_PX = 64
SHOWN = 10
A_VIEW = 3  # crops of one view at most


@dataclass(frozen=True, eq=False)
class Crop:
    """One place of one fill."""

    where: str
    distance: float
    fill: pictures.Picture
    truth: pictures.Picture
    holes: pictures.Picture


def local_distance(fill: Colour, truth: Colour, mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Distance of local means and deviations, (H, W); 0 outside the mask."""
    one = _moments(np.where(mask[..., None], fill, truth))
    other = _moments(truth)
    distance = np.sqrt(((one - other) ** 2).sum(axis=-1))
    return np.asarray(np.where(mask, distance, 0.0))


def _moments(colour: Colour) -> NDArray[np.float64]:
    planes = ycbcr_from_rgb(colour.astype(np.float64))
    mean = gaussian_filter(planes, (WINDOW_PX, WINDOW_PX, 0))
    square = gaussian_filter(planes**2, (WINDOW_PX, WINDOW_PX, 0))
    return np.concatenate([mean, np.sqrt(np.maximum(square - mean**2, 0.0))], axis=-1)


def worst_places(
    distance: NDArray[np.float64], count: int, edge_px: int = CROP_PX
) -> Iterator[tuple[float, tuple[slice, slice]]]:
    """Yield the sum and place of the squares with the largest sums, none of which overlap."""
    left = distance.copy()
    height, width = left.shape
    rows, columns = min(edge_px, height), min(edge_px, width)
    for _ in range(count):
        total = np.pad(left, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
        sums = total[rows:, columns:] - total[:-rows, columns:]
        sums = sums - total[rows:, :-columns] + total[:-rows, :-columns]
        row, column = np.unravel_index(sums.argmax(), sums.shape)
        place = slice(int(row), int(row) + rows), slice(int(column), int(column) + columns)
        if left[place].sum() <= 0:
            return
        yield float(distance[place].sum()), place
        # What overlaps it counts no more.
        top, start = max(0, int(row) - rows + 1), max(0, int(column) - columns + 1)
        left[top : place[0].stop, start : place[1].stop] = 0


def crops_of(name: str, view: View, fill: Colour) -> Iterator[Crop]:
    """The worst places of one fill."""
    for distance, place in worst_places(local_distance(fill, view.truth, view.mask), A_VIEW):
        row, column = (part.start for part in place)
        yield Crop(
            f"{name} {column},{row}",
            distance,
            pictures.of_colour(fill[place]),
            pictures.of_colour(view.truth[place]),
            pictures.of_holes(view.warped.colour[place], view.warped.hole[place]),
        )


def sheet_of(crops: Sequence[Crop]) -> pictures.Picture:
    """Two crops a row, each as filled, as it should be, and its holes."""
    tiles = []
    for crop in crops:
        tiles += [
            (f"{crop.where}: {crop.distance:.0f}", crop.fill),
            ("truth", crop.truth),
            ("holes", crop.holes),
        ]
    return pictures.sheet(tiles, columns=6)


def worst_of(
    ctx: moderngl.Context, scenes: Sequence[tuple[str, list[View]]], name: str
) -> list[Crop]:
    """The worst crops of a method over all views, the worst first."""
    method = create_method(name, ctx, {})
    try:
        found = [
            crop
            for scene, views in scenes
            for number, view in enumerate(views)
            for crop in crops_of(f"{scene} {number}", view, method.fill(view.warped, SEED))
        ]
    finally:
        method.release()
    return sorted(found, key=lambda crop: -crop.distance)[:SHOWN]


def main(argv: list[str]) -> int:
    """Draw a sheet per method."""
    parser = argparse.ArgumentParser(prog="script/bench worst", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the sheets")
    parser.add_argument("--pairs", type=Path, help="folder of further pairs (Middlebury)")
    parser.add_argument("--scenes", nargs="*", choices=scene_names(), default=scene_names())
    every = [entry.name for entry in METHODS if not entry.takes_path]
    parser.add_argument("--methods", nargs="+", choices=every, default=every)
    parser.add_argument("--size", type=int, nargs=2, default=(320, 240), metavar=("W", "H"))
    parser.add_argument("--extent", type=float, default=0.04, help="in near depths (0.04)")
    arguments = parser.parse_args(argv)
    ctx = create_context()
    try:
        print(describe(ctx))
        size_px = (arguments.size[0], arguments.size[1])
        both = (
            photographs(ctx, arguments.pairs),
            rendered(ctx, arguments.scenes, size_px, arguments.extent),
        )
        scenes = list(chain.from_iterable(both))
        arguments.out.mkdir(parents=True, exist_ok=True)
        for name in arguments.methods:
            worst = worst_of(ctx, scenes, name)
            pictures.save_picture(arguments.out / f"{name}.png", sheet_of(worst))
            print(f"{name}: {', '.join(crop.where for crop in worst)}")
    finally:
        release_context(ctx)
    return 0
