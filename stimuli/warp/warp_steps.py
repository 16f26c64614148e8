"""Every intermediate of one warped and filled frame, as pictures to look at.

The pictures come from the numpy reference of the method, whose arrays have names; it takes
some seconds per megapixel, and its fill is the GPU's within the twins' tolerance.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.colour import ycbcr_from_rgb
from pipeline.features.reference import BANDS, analyse, spoiled_levels
from pipeline.frame import WarpedFrame
from pipeline.inpaint.reference import nearest_depth_m
from pipeline.noise.tile import look_up, noise_bands
from pipeline.pictures import drawing
from pipeline.pictures.drawing import Picture
from pipeline.pictures.warp_input import WarpInput
from pipeline.statistics.moments import luma_moments
from pipeline.synthesis.reference import metameric_fill
from pipeline.synthesis.settings import MetamericSettings
from stimuli.media.frames_folder import DrawnStep, save_steps
from stimuli.warp.one_frame import FillResult

METAMERIC = "metameric"


def write_warp_steps(
    folder: Path,
    frame: WarpInput,
    warped: WarpedFrame,
    fills: Sequence[FillResult],
    *,
    seed: int,
    truth: NDArray[np.float32] | None = None,
) -> list[Path]:
    """Write every step as `save_steps` does, and return what it returns.

    A metameric fill among `fills` adds the steps inside it: base, bands, moments, noise.
    """
    steps = list(_warp_steps(frame, warped))
    for filled in fills:
        if filled.choice.name == METAMERIC and warped.hole.any():
            steps += metameric_steps(warped, filled.choice.parameters, seed)
    for filled in fills:
        name = "".join(c if c.isalnum() or c in "-." else "_" for c in filled.choice.label)
        label = f"filled: {filled.choice.label}"
        steps.append((f"filled-{name}", label, drawing.of_colour(filled.colour)))
    if truth is not None:
        steps.append(("true-view", "true view", drawing.of_colour(truth)))
    return save_steps(folder, steps, warped.size)


def _warp_steps(frame: WarpInput, warped: WarpedFrame) -> Iterator[DrawnStep]:
    near_m = min(nearest_depth_m(depth) for depth in (frame.source.depth_m, warped.depth_m))
    longest_px = float(np.linalg.norm(frame.flow_px, axis=-1).max())
    yield "source", "source", drawing.of_colour(frame.source.colour)
    yield (
        "source-depth",
        f"source depth (white {near_m:.3g} m, black infinite)",
        drawing.of_depth(frame.source.depth_m, near_m),
    )
    yield (
        "source-flow",
        f"flow (hue: direction; brightest {longest_px:.1f} px)",
        drawing.of_flow(frame.flow_px, longest_px),
    )
    holes = drawing.of_holes(warped.colour, warped.hole)
    yield "warped", f"warped, holes {100 * warped.hole.mean():.1f} %", holes
    yield "hole", "hole mask", drawing.of_mask(warped.hole)
    yield (
        "warped-depth",
        "warped depth, background in holes",
        drawing.of_depth(warped.depth_m, near_m),
    )
    yield (
        "warped-flow",
        "warped motion, background's in holes",
        drawing.of_flow(warped.flow_px, longest_px),
    )


def metameric_steps(
    warped: WarpedFrame, parameters: Mapping[str, Any], seed: int
) -> Iterator[DrawnStep]:
    """The steps inside a metameric fill with these parameters of the method."""
    known = {name: parameters[name] for name in MetamericSettings.names() if name in parameters}
    settings = MetamericSettings(**known)
    z_near_m = float(parameters.get("z_near_m") or nearest_depth_m(warped.depth_m))
    fill = metameric_fill(warped, settings, seed=seed, z_near_m=z_near_m)
    cross = settings.channels == "correlated"
    yield "base", "base: depth-guided colour", drawing.of_colour(fill.base)
    bands = analyse(ycbcr_from_rgb(fill.base), settings.levels).bands
    spoiled = spoiled_levels(warped.hole, settings.levels)
    noise = noise_bands(seed, settings.levels, 1 if cross else 3)
    for level in range(settings.levels):
        luma = bands[level][..., 0]
        largest = float(np.percentile(np.abs(luma), 99.5))
        across = f"level {level}: {', '.join(BANDS)}"
        yield f"level{level}-bands", f"bands, {across}", _three(luma, largest, signed=True)
        mask = drawing.of_mask(~spoiled[level])
        yield f"level{level}-valid", f"coefficients free of holes, level {level}", mask
        mean, variance = luma_moments(fill.statistics[level].values)
        deviation = np.sqrt(variance)
        yield f"level{level}-mean", f"mean, {across}", _three(mean, largest, signed=True)
        widest = float(np.percentile(deviation, 99.5))
        yield f"level{level}-deviation", f"deviation, {across}", _three(deviation, widest)
        lacking = np.sqrt(fill.lacking[level].values[..., :9:3])
        yield (
            f"level{level}-amplitude",
            f"deviation that the base lacks, {across}",
            _three(lacking, widest),
        )
        texel = look_up(noise, level, fill.anchor_px)[..., 0]
        yield (
            f"level{level}-noise",
            f"noise before shaping, {across}",
            _three(texel, 3, signed=True),
        )
    added = (fill.colour - fill.base) * warped.hole[..., None]
    contrast = float(np.percentile(np.abs(added[warped.hole]), 99.5))
    yield (
        "noise",
        f"noise added (white +{contrast:.2f})",
        drawing.of_colour(0.5 + 0.5 * added / contrast if contrast > 0 else added + 0.5),
    )


def _three(values: NDArray[np.float64], largest: float, *, signed: bool = False) -> Picture:
    """The three bands of (H, W, 3) on one scale: two above, one below."""
    draw = drawing.of_signed if signed else drawing.of_magnitude
    first, second, third = (draw(values[..., band], largest) for band in range(3))
    above = np.concatenate([first, second], axis=1)
    below = np.concatenate([third, np.zeros_like(third)], axis=1)
    return np.concatenate([above, below], axis=0)
