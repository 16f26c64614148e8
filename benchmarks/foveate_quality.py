"""Quality of each condition on pictures: `script/bench foveate_quality --help`.

Per picture and condition: the least and greatest ratio of a band's luma deviation to the picture's,
the statistics distance (`stimuli.score.statistics`), the difference between two seeds and the
change when the gaze moves by a pixel, both beyond 5 degrees in steps of 255, and the share of
samples clipped. FovVideoVDP, foveated, beside them where the extra `metrics` is installed.

`--hard` takes pictures on which some methods lose: a portrait, a page of text and a night.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from skimage import data

from benchmarks.shared.output import file_to_write, write_record
from pipeline.colour import ycbcr_from_rgb
from pipeline.features.reference import analyse
from pipeline.foveation.conditions import Foveator
from pipeline.foveation.geometry import Flat
from pipeline.foveation.pooling import Pools, make_pooling
from pipeline.pictures.decode import from_integers, read_pixels, three_channels
from stimuli.score.statistics import statistics_distance

Picture = NDArray[np.float32]
Colour = tuple[int, int, int]

WORDS = ["the", "mean", "colour", "of", "a", "page", "of", "print", "is", "nearly", "that", "of",
         "its", "paper", "and", "not", "grey"]  # fmt: skip


def text_page(
    edge: int,
    ink: Colour = (0, 0, 0),
    paper: Colour = (255, 255, 255),
    *,
    line_px: int = 13,
    stroke_px: int = 1,
) -> Picture:
    """A page of print, black on white unless told otherwise."""
    rng, page = np.random.default_rng(1), np.full((edge, edge, 3), paper, np.uint8)
    for line in range(line_px - 1, edge - 4, line_px):
        words = " ".join(rng.choice(WORDS, edge // 30))
        face = cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(page, words, (6, line), face, 0.33, ink, stroke_px, cv2.LINE_AA)
    return as_floats(page)


def night(edge: int) -> Picture:
    """Lamps and stars before a dark sky."""
    rng = np.random.default_rng(4)
    picture = rng.uniform(2, 12, (edge, edge, 1)).repeat(3, axis=2).astype(np.uint8)
    for _ in range(edge // 2):
        place, colour = rng.integers(0, edge, 2).tolist(), rng.uniform(120, 255, 3).tolist()
        cv2.circle(picture, place, int(rng.integers(0, 3)), colour, -1, cv2.LINE_AA)
    return as_floats(picture)


def as_floats(picture: NDArray[np.uint8]) -> Picture:
    """Eight bits in [0, 1]."""
    return np.asarray(picture, np.float32) / np.float32(255)


CONDITIONS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("blur", {}),
    ("metamer", {}),
    ("metamer", {"chroma": "full"}),
    ("metamer", {"residual": "pooled"}),
    ("noise-enhanced", {}),
    ("contrast-enhanced", {}),
    ("eidolon", {}),
    ("warped-metamer", {}),
)
LEVELS = 4
LEAST_POOL, MOST_POOL = 1.0, 64.0  # deviations, coefficients, at which ratios are measured
PERIPHERY_DEG = 5.0
DISTANCE_M = 0.6  # of the eye, for FovVideoVDP
METRES_PER_INCH = 0.0254


@dataclass(frozen=True)
class Result:
    """One condition on one picture."""

    picture: str
    condition: str
    parameters: dict[str, object]
    law: str
    least_ratio: float
    greatest_ratio: float
    distance: float
    seeds_apart: float  # of 255
    gaze_moved: float  # of 255, by 1 px; displacements follow the gaze at once
    gaze_moved_tamed: float  # the same, the field resting as `SteadyGaze` lets it
    from_picture: float  # of 255
    jod: float | None


def pictures(folder: Path | None, edge: int) -> Iterator[tuple[str, Picture]]:
    """Photographs of a folder, else what scikit-image ships, cut to a square in the middle."""
    if folder is None:
        shipped = {
            "astronaut": data.astronaut(),
            "coffee": data.coffee(),
            "chelsea": data.chelsea(),
        }
        shipped["rocket"] = data.rocket()
        for name, image in shipped.items():
            yield name, cut(image.astype(np.float32) / 255, edge)
        return
    for file in sorted(folder.iterdir()):
        if file.suffix.lower() in (".png", ".jpg", ".jpeg"):
            yield file.stem, cut(from_integers(three_channels(file, read_pixels(file))), edge)


def hard_pictures(edge: int) -> Iterator[tuple[str, Picture]]:
    """A portrait, a page of text and a night, `edge` x `edge` px."""
    yield "portrait", cut(data.astronaut().astype(np.float32) / 255, edge)
    yield "text", text_page(edge)
    yield "night", night(edge)


def cut(image: NDArray[np.float32], edge: int) -> Picture:
    """The middle `edge` x `edge` pixels, or less."""
    height, width = image.shape[:2]
    top, left = max(0, (height - edge) // 2), max(0, (width - edge) // 2)
    return np.ascontiguousarray(image[top : top + edge, left : left + edge], np.float32)


def band_ratios(test: Picture, truth: Picture, pools: Pools) -> NDArray[np.float64]:
    """Deviation of luma in each band over the picture's, where pools are of a size: (levels, 3).

    NaN where fewer than 64 coefficients have such pools.
    """
    ours, true = (
        analyse(ycbcr_from_rgb(image.astype(np.float64)), LEVELS).bands for image in (test, truth)
    )
    found = np.full((LEVELS, 3), np.nan)
    for level in range(LEVELS):
        sigma = pools.sigma_px(level) / 2**level
        inside = (sigma >= LEAST_POOL) & (sigma <= MOST_POOL)
        if inside.sum() >= 64:
            for band in range(3):
                energy = [(b[level][inside][:, band, 0] ** 2).mean() for b in (ours, true)]
                found[level, band] = np.sqrt(energy[0] / max(energy[1], 1e-12))
    return found


def judge(
    name: str,
    shown: Picture,
    condition: str,
    parameters: dict[str, Any],
    law: str,
    width_deg: float,
) -> Result:
    """Measure one condition on one picture."""
    height, width = shown.shape[:2]
    viewing, gaze = Flat(width_deg), (width / 2, height / 2)
    pools = Pools(viewing.of(width, height), gaze, make_pooling(law))
    given = dict(parameters)
    if condition not in ("reference", "noise-enhanced", "contrast-enhanced"):
        given["law"] = law
    foveator = Foveator((height, width), viewing=viewing, method=condition, **given)
    first, second = (foveator(shown, gaze, seed=seed) for seed in (1, 2))
    moved_gaze = (gaze[0] + 1, gaze[1])
    moved = foveator(shown, moved_gaze, seed=1)
    tamed = foveator(shown, moved_gaze, seed=1, field_gaze_px=gaze)
    far = pools.eccentricity_deg() > PERIPHERY_DEG

    def apart(a: Picture, b: Picture) -> float:
        return float(255 * np.abs(a - b)[far].mean())

    ratios = band_ratios(first, shown, pools)
    return Result(
        name,
        condition,
        parameters,
        law,
        float(np.nanmin(ratios)),
        float(np.nanmax(ratios)),
        statistics_distance(first, shown),
        apart(first, second),
        apart(first, moved),
        apart(first, tamed),
        apart(first, shown),
        jod_of(first, shown, width_deg),
    )


def jod_of(test: Picture, truth: Picture, width_deg: float) -> float | None:
    """FovVideoVDP of a still, foveated, gaze in the middle; None without the extra `metrics`."""
    if importlib.util.find_spec("pyfvvdp") is None:
        return None
    import pyfvvdp
    import torch

    height, width = truth.shape[:2]
    width_m = 2 * DISTANCE_M * math.tan(math.radians(width_deg / 2))
    geometry = pyfvvdp.fvvdp_display_geometry(
        (width, height),
        distance_m=DISTANCE_M,
        diagonal_size_inches=width_m * math.hypot(1, height / width) / METRES_PER_INCH,
    )
    metric = pyfvvdp.fvvdp(
        display_name="standard_fhd", display_geometry=geometry, foveated=True, quiet=True
    )
    gaze_px = torch.tensor([width / 2, height / 2])
    jod, _ = metric.predict(test, truth, dim_order="HWC", fixation_point=gaze_px)
    return float(jod)


def mean_over_pictures(results: list[Result]) -> list[Result]:
    """One line a condition: means, and the extreme ratios."""
    groups: dict[tuple[str, str, str], list[Result]] = {}
    for result in results:
        key = (result.condition, json.dumps(result.parameters), result.law)
        groups.setdefault(key, []).append(result)
    lines = []
    for found in groups.values():
        jods = [result.jod for result in found if result.jod is not None]

        def mean(name: str, found: list[Result] = found) -> float:
            return float(np.mean([getattr(result, name) for result in found]))

        lines.append(
            Result(
                "mean",
                found[0].condition,
                found[0].parameters,
                found[0].law,
                min(result.least_ratio for result in found),
                max(result.greatest_ratio for result in found),
                mean("distance"),
                mean("seeds_apart"),
                mean("gaze_moved"),
                mean("gaze_moved_tamed"),
                mean("from_picture"),
                float(np.mean(jods)) if jods else None,
            )
        )
    return lines


def show(results: list[Result], console: Console) -> None:
    """Print a table."""
    table = Table()
    for name in ("picture", "condition", "law"):
        table.add_column(name)
    for name in ("ratios", "distance", "seeds", "gaze 1 px", "tamed", "picture", "JOD"):
        table.add_column(name, justify="right")
    for result in results:
        switches = " ".join(f"{key} {value}" for key, value in result.parameters.items())
        table.add_row(
            result.picture,
            f"{result.condition} {switches}".strip(),
            result.law,
            f"{result.least_ratio:.2f} to {result.greatest_ratio:.2f}",
            f"{result.distance:.3f}",
            f"{result.seeds_apart:.1f}",
            f"{result.gaze_moved:.2f}",
            f"{result.gaze_moved_tamed:.2f}",
            f"{result.from_picture:.1f}",
            "" if result.jod is None else f"{result.jod:.2f}",
        )
    console.print(table)


def main(argv: list[str]) -> int:
    """Judge every condition on every picture, and print or store a table."""
    parser = argparse.ArgumentParser(prog="script/bench foveate_quality", description=__doc__)
    parser.add_argument("--pictures", type=Path, help="folder; default: what scikit-image ships")
    parser.add_argument("--only", nargs="+", help="names of pictures, without extension")
    parser.add_argument("--edge", type=int, default=512, help="cut to so many pixels (512)")
    parser.add_argument("--width-deg", type=float, default=40.0, help="of the picture (40)")
    parser.add_argument("--law", nargs="+", default=["v1"], help="presets (v1)")
    parser.add_argument("--condition", nargs="+", help="of these alone")
    parser.add_argument("--hard", action="store_true", help="a portrait, text and a night instead")
    parser.add_argument("--out", type=file_to_write, help="JSON file to write")
    arguments = parser.parse_args(argv)
    console = Console()
    console.width = max(console.width, 140)  # a table with many columns
    record: dict[str, object] = {"width_deg": arguments.width_deg, "edge_px": arguments.edge}
    conditions: list[tuple[str, dict[str, object]]] = [(name, dict(p)) for name, p in CONDITIONS]
    edge = arguments.edge
    shown_ones = hard_pictures(edge) if arguments.hard else pictures(arguments.pictures, edge)
    results = [
        judge(name, shown, condition, parameters, law, arguments.width_deg)
        for name, shown in shown_ones
        if not arguments.only or name in arguments.only
        for law in arguments.law
        for condition, parameters in conditions
        if not arguments.condition or condition in arguments.condition
    ]
    if not results:
        parser.error("no picture and condition was chosen")
    show(results + mean_over_pictures(results), console)
    known = [
        {key: None if value != value else value for key, value in asdict(result).items()}
        for result in results
    ]
    if arguments.out is not None:
        write_record(arguments.out, record | {"results": known})
    return 0
