"""Denoisers on views that no network was trained on: `script/bench denoise --help`.

Views of the scenes that our networks were trained on, from other cameras, and of a scene that they
never saw. Each is path-traced with 32 samples a pixel at the gaze, in the middle, and 1 in the
periphery. Compared with the clean picture are

- the network for moments and synthesis, the network for colour, Open Image Denoise (`pip install
  pyoidn`), the noisy picture;
- metamers of what the last three give: moments of an estimated picture, instead of estimated
  moments;
- the metamer of the clean picture, which no estimate of moments can be better than.

Measured are the statistics distance (`stimuli.score.statistics`), the error of the moments
themselves, the energy of the finest bands beyond 10 degrees over the clean picture's, PSNR within 2
degrees, and FovVideoVDP, foveated, where the extra `metrics` is installed. Mitsuba renders what the
folder --work lacks: the extra `denoise`.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.foveate_quality import jod_of
from benchmarks.shared.machine import conditions
from benchmarks.shared.output import file_to_write
from pipeline.colour import decode_srgb, encode_srgb, ycbcr_from_rgb
from pipeline.denoising.maps import MomentMaps, maps_of, metamer_of
from pipeline.denoising.network import DenoisingNetwork, shipped_network
from pipeline.features.reference import analyse
from pipeline.foveation.lod import Pools
from pipeline.quality import psnr_db
from stimuli import pictures as sheets
from stimuli.denoised.training_pictures import (
    WIDTH_DEG,
    Rendering,
    SceneView,
    TrainingPair,
    pairs_of,
)
from stimuli.score.statistics import statistics_distance

VIEWS = ("colonnade-3", "garden-3", "shed-3", "castle-0", "castle-1")
PERIPHERY_DEG, FAR_DEG, FOVEA_DEG = 5.0, 10.0, 2.0
SHEET_PX = 1500
SHOWN = (
    "noisy", "network for colour", "Open Image Denoise", "network for moments", "metamer of: clean",
)  # fmt: skip

Picture = NDArray[np.float32]


@dataclass(frozen=True)
class Result:
    """One denoiser on one view."""

    view: str
    held_out_scene: bool
    denoiser: str
    distance: float
    far_distance: float  # beyond PERIPHERY_DEG
    moments_error: float | None  # of deviations, over the clean ones, beyond PERIPHERY_DEG
    fine_ratio: float  # beyond FAR_DEG
    fovea_psnr_db: float
    jod: float | None


@dataclass(frozen=True, eq=False)
class Shown:
    """Picture that a denoiser makes, and the moments that it goes by."""

    picture: Picture
    maps: MomentMaps | None


def main(argv: list[str]) -> int:
    """Denoise all views, print means, write JSON and a sheet."""
    parser = argparse.ArgumentParser(
        prog="script/bench denoise",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--work", type=Path, default=Path("out/denoise"), help="rendered views")
    parser.add_argument("--views", nargs="+", default=VIEWS, metavar="SCENE-NUMBER")
    parser.add_argument("--moments", type=Path, default=shipped_network("moments"))
    parser.add_argument("--rgb", type=Path, default=shipped_network("rgb"))
    parser.add_argument("--clean-samples", type=int, default=Rendering().clean_samples)
    parser.add_argument("--seed", type=int, default=0, help="of the synthesis")
    parser.add_argument("--json", type=file_to_write)
    parser.add_argument("--sheet", type=file_to_write)
    parser.add_argument("--sheet-views", nargs="+", metavar="SCENE-NUMBER")
    arguments = parser.parse_args(argv)
    moments, rgb = DenoisingNetwork(arguments.moments), DenoisingNetwork(arguments.rgb)
    trained = moments.facts.made.get("scenes", [])
    rendering = Rendering(moments.facts.edge_px, arguments.clean_samples)
    found: list[Result] = []
    rows: list[tuple[str, sheets.Picture]] = []
    columns = 1
    for name in arguments.views:
        view = _view(name)
        (pair,) = pairs_of([view], rendering, arguments.work)
        pools = _pools(pair, moments)
        shown = dict(_denoised(pair, pools, moments, rgb, arguments.seed))
        held_out = view.scene not in trained
        if view.number < moments.facts.made.get("views", 0) and not held_out:
            print(f"note: the networks were trained on {name}; it says little of them")
        found += [
            _judged(name, held_out, denoiser, one, pair.clean, pools)
            for denoiser, one in shown.items()
        ]
        if name in (arguments.sheet_views or arguments.views):
            labels = [label for label in SHOWN if label in shown]
            rows += [(label, sheets.of_colour(shown[label].picture)) for label in labels]
            rows.append((f"clean: {name}", sheets.of_colour(pair.clean)))
            columns = len(labels) + 1
    console = Console(width=110)
    for held_out, words in (
        (False, "scenes of the training, other views"),
        (True, "another scene"),
    ):
        same = [one for one in found if one.held_out_scene == held_out]
        if same:
            console.print(_table(same, words))
    if arguments.sheet is not None and rows:
        sheet = sheets.sheet(rows, columns=columns)
        shrunk = tuple(round(SHEET_PX / sheet.shape[1] * edge) for edge in sheet.shape[:2])
        sheets.save_picture(arguments.sheet, sheets.fitted(sheet, (shrunk[0], shrunk[1])))
    if arguments.json is not None:
        record = {
            "machine": conditions("numpy", "onnxruntime", "mitsuba", "pyoidn"),
            "moments": dict(moments.facts.made),
            "rgb": dict(rgb.facts.made),
            "clean_samples": arguments.clean_samples,
            "results": [asdict(one) for one in found],
        }
        arguments.json.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    return 0


def open_image_denoise(noisy: Picture) -> Picture | None:
    """Denoise by Intel's library, or None where it is not installed."""
    if importlib.util.find_spec("pyoidn") is None:
        return None
    import pyoidn

    # It takes a picture of 0 to 1 for linear.
    found = np.asarray(pyoidn.denoise(decode_srgb(noisy).astype(np.float32), hdr=False))
    return encode_srgb(np.clip(found, 0, 1)).astype(np.float32)


def moments_error(found: MomentMaps, wanted: MomentMaps, pools: Pools) -> float:
    """Root of the squared error of all deviations in the periphery, over theirs."""
    far = pools.eccentricity_deg(2) > PERIPHERY_DEG
    levels = min(found.levels, wanted.levels)
    ours, true = (one.deviations[far][:, : 3 * levels] for one in (found, wanted))
    return float(np.sqrt(((ours - true) ** 2).sum() / (true**2).sum()))


def fine_ratio(test: Picture, truth: Picture, pools: Pools) -> float:
    """Deviation of luma's finest bands far from the gaze, over the clean picture's."""
    far = pools.eccentricity_deg() > FAR_DEG
    ours, true = (
        analyse(ycbcr_from_rgb(image.astype(np.float64))[..., :1], 1).bands[0][far]
        for image in (test, truth)
    )
    return float(np.sqrt((ours**2).sum() / (true**2).sum()))


def _view(name: str) -> SceneView:
    scene, _, number = name.rpartition("-")
    return SceneView(scene, int(number))


def _pools(pair: TrainingPair, network: DenoisingNetwork) -> Pools:
    geometry = pair.geometry
    middle = geometry.width_px / 2, geometry.height_px / 2
    return Pools(geometry, middle, network.facts.pooling)


def _denoised(
    pair: TrainingPair, pools: Pools, moments: DenoisingNetwork, rgb: DenoisingNetwork, seed: int
) -> Iterator[tuple[str, Shown]]:
    noisy = pair.noisy(moments.facts.sampling, pools.gaze_px)
    estimates = {"noisy": noisy, "network for colour": rgb.colour(noisy, pools)}
    library = open_image_denoise(noisy)
    if library is not None:
        estimates["Open Image Denoise"] = library
    for name, picture in estimates.items():
        yield name, Shown(picture, None)
    predicted = moments.moments(noisy, pools)
    yield "network for moments", Shown(metamer_of(predicted, pools, seed), predicted)
    for name, picture in (*estimates.items(), ("clean", pair.clean)):
        maps = maps_of(picture, pools, moments.facts.levels)
        yield f"metamer of: {name}", Shown(metamer_of(maps, pools, seed), maps)


def _judged(
    view: str, held_out: bool, denoiser: str, shown: Shown, clean: Picture, pools: Pools
) -> Result:
    wanted = maps_of(clean, pools)
    away_deg = pools.eccentricity_deg()
    return Result(
        view, held_out, denoiser,
        statistics_distance(shown.picture, clean, gaze_px=pools.gaze_px),
        statistics_distance(
            shown.picture, clean, gaze_px=pools.gaze_px, mask=away_deg > PERIPHERY_DEG
        ),
        None if shown.maps is None else moments_error(shown.maps, wanted, pools),
        fine_ratio(shown.picture, clean, pools),
        psnr_db(shown.picture, clean, away_deg <= FOVEA_DEG),
        jod_of(shown.picture, clean, WIDTH_DEG),
    )  # fmt: skip


def _table(found: list[Result], words: str) -> Table:
    """Means over views."""
    table = Table(
        "denoiser", "distance", "beyond 5 deg", "moments", "fine bands", "fovea, dB", "JOD",
        title=f"{words}: {len({one.view for one in found})} views",
    )  # fmt: skip
    of: dict[str, list[Result]] = defaultdict(list)
    for one in found:
        of[one.denoiser].append(one)
    for denoiser, same in of.items():
        cells = []
        for value, form in (
            ("distance", ".3f"), ("far_distance", ".3f"), ("moments_error", ".2f"),
            ("fine_ratio", ".2f"), ("fovea_psnr_db", ".1f"), ("jod", ".2f"),
        ):  # fmt: skip
            held = [getattr(one, value) for one in same if getattr(one, value) is not None]
            cells.append(format(float(np.mean(held)), form) if held else "-")
        table.add_row(denoiser, *cells)
    return table
