"""Every intermediate of one foveated picture, as pictures to look at.

They come from the numpy references, whose arrays have names; what is shown at the end is what the
command wrote, by the GPU where there is one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.foveation import displacement, reference
from pipeline.foveation.catalogue import (
    Blur,
    Condition,
    ContrastEnhanced,
    Eidolon,
    Metamer,
    NoiseEnhanced,
    WarpedMetamer,
)
from pipeline.foveation.chain import enlarge
from pipeline.foveation.conditions import create_condition
from pipeline.foveation.geometry import Viewing
from pipeline.foveation.pooled_moments import BLOCK_HALVINGS
from pipeline.foveation.pooling import Pools
from pipeline.pictures import drawing
from stimuli.foveate.condition_sheet import ConditionPicture, draw_gaze, draw_pools, pooling_of
from stimuli.media.frames_folder import DrawnStep, save_steps


def write_foveation_steps(
    folder: Path,
    colour: NDArray[np.float32],
    gaze_px: tuple[float, float],
    viewing: Viewing,
    seen: Sequence[ConditionPicture],
    *,
    seed: int,
) -> list[Path]:
    """Write every step as `save_steps` does, and return what it returns."""
    geometry = viewing.of(colour.shape[1], colour.shape[0])
    steps: list[DrawnStep] = []
    for one in seen:
        pools = Pools(geometry, gaze_px, pooling_of(one.choice))
        if not steps:
            steps += _pool_steps(colour, pools)
        condition = create_condition(one.choice.name, one.choice.parameters)
        steps += [
            (f"{one.choice.file_name}-{name}", f"{one.choice.name}: {label}", picture)
            for name, label, picture in condition_steps(condition, colour, pools, seed)
        ]
        name, label = one.choice.file_name, one.choice.label
        change = one.colour.astype(np.float64) - colour
        steps.append(_changes(f"{name}-change", f"{label}: what has changed", change))
        steps.append((f"{name}-shown", label, drawing.of_colour(one.colour)))
    return save_steps(folder, steps, (colour.shape[0], colour.shape[1]))


def _changes(name: str, label: str, change: NDArray[np.floating]) -> DrawnStep:
    """Draw what is added to a picture, on grey."""
    largest = max(1 / 255, float(np.percentile(np.abs(change), 99.5)))
    return name, f"{label} (white +{largest:.2f})", drawing.of_colour(0.5 + 0.5 * change / largest)


def _pool_steps(colour: NDArray[np.float32], pools: Pools) -> Iterator[DrawnStep]:
    yield "picture", "picture", drawing.of_colour(colour)
    radius_px = max(4.0, min(colour.shape[:2]) / 80)
    rings, _ = draw_pools(drawing.of_colour(colour), pools.geometry, pools.gaze_px, pools.pooling)
    yield (
        "pools",
        f"pools, their width at half maximum ({pools.pooling})",
        draw_gaze(rings, pools.gaze_px, radius_px),
    )
    away = pools.eccentricity_deg()
    yield (
        "eccentricity",
        f"eccentricity (white {away.max():.3g} degrees)",
        drawing.of_magnitude(away, float(away.max())),
    )
    sigma = pools.sigma_px()
    yield (
        "pool-width",
        f"deviation of the pools (white {sigma.max():.3g} px)",
        drawing.of_magnitude(sigma, float(sigma.max())),
    )
    lod = pools.lod()
    yield (
        "lod",
        f"level of detail (white {lod.max():.2f}; a step of grey per whole level)",
        drawing.of_magnitude(np.floor(lod) / max(1.0, np.floor(lod.max()))),
    )
    yield "fade", "share of the change: black is the fovea", drawing.of_magnitude(pools.fade(), 1)


def condition_steps(
    condition: Condition, colour: NDArray[np.float32], pools: Pools, seed: int
) -> Iterator[DrawnStep]:
    """The steps inside one condition; none where it has none."""
    if isinstance(condition, Metamer):
        yield from _metamer_steps(condition, colour, pools, seed)
    elif isinstance(condition, Eidolon | WarpedMetamer):
        yield from _displaced_steps(condition, colour, pools, seed)
    elif isinstance(condition, Blur | NoiseEnhanced | ContrastEnhanced):
        base = reference.blurred(colour, pools)
        yield "base", f"means of all pools ({pools.pooling})", drawing.of_colour(base)


def _metamer_steps(
    condition: Metamer, colour: NDArray[np.float32], pools: Pools, seed: int
) -> Iterator[DrawnStep]:
    settings = condition.settings
    parts = reference.metamer_parts(colour, pools, settings, seed)
    yield "base", "what pools keep: their means, and the residual", drawing.of_colour(parts.base)
    levels = parts.wanted.slopes.shape[2]
    size = (colour.shape[0], colour.shape[1])
    wide = enlarge(
        np.sqrt(parts.wanted.variances), size, BLOCK_HALVINGS, wraps=pools.geometry.wraps
    )
    for level in range(levels):
        bands = wide[..., 3 * level : 3 * level + 3]
        largest = float(np.percentile(bands, 99.5))
        yield (
            f"level{level}-deviation",
            f"deviations that noise gives to level {level}: high red, along x green, along y blue"
            f" (brightest {largest:.3f})",
            drawing.of_colour(bands / largest if largest > 0 else bands),
        )
    yield _changes("noise", "noise that is added", parts.noise)


def _displaced_steps(
    condition: Eidolon | WarpedMetamer, colour: NDArray[np.float32], pools: Pools, seed: int
) -> Iterator[DrawnStep]:
    settings = condition.settings
    offset = displacement.displacement_px(pools, settings, seed)
    longest = float(np.linalg.norm(offset, axis=-1).max())
    yield (
        "displacement",
        f"displacement (hue: direction; brightest {longest:.1f} px)",
        drawing.of_flow(offset, longest),
    )
    moved = displacement.displaced(colour, pools, settings, seed)
    yield "displaced", "looked up there", drawing.of_colour(moved)
    if isinstance(condition, WarpedMetamer):
        matched = displacement.matched(moved, colour, pools, settings.levels)
        yield _changes("match", "what the match of moments changes", matched - moved)
