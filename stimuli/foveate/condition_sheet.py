"""One picture through any condition: the choice, the sheet of many, and what each shows.

The eye's pools are drawn over a picture: circles around the gaze, and pools on them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import moderngl
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from pipeline.errors import InputError
from pipeline.foveation.conditions import (
    CONDITIONS,
    Foveator,
    condition_parameters,
    create_condition,
)
from pipeline.foveation.energy import EnergyMetamer
from pipeline.foveation.geometry import Geometry, Viewing, pixel_centres
from pipeline.foveation.picture_fixation import PictureFixation, check_held
from pipeline.foveation.pooling import FWHM, Pooling
from pipeline.named_classes import Choice
from pipeline.pictures import drawing
from pipeline.pictures.decode import as_floats
from pipeline.pictures.drawing import Picture
from protocols.disk.whole_file import remove

ECCENTRICITIES_DEG = (2.0, 5.0, 10.0, 20.0, 40.0, 80.0)
POOLS_ON_A_RING = 8
_RING = np.array([255, 214, 0], np.float64)  # told from photographs, and from its dark outline


def ring_eccentricities(geometry: Geometry, gaze_px: tuple[float, float]) -> tuple[float, ...]:
    """The widest four of `ECCENTRICITIES_DEG` on the picture; else half the farthest corner's."""
    away = _angles_deg(_rays(geometry), gaze_ray(geometry, gaze_px))
    nearest, farthest = float(away.min()), float(away.max())
    inside = tuple(e for e in ECCENTRICITIES_DEG if nearest < e <= 0.8 * farthest)
    return inside[-4:] or ((nearest + farthest) / 2,)


def draw_pools(
    picture: Picture, geometry: Geometry, gaze_px: tuple[float, float], pooling: Pooling
) -> tuple[Picture, tuple[float, ...]]:
    """Draw circles of equal eccentricity, and on each the width of pools.

    A pool is drawn with the full width at half maximum of its Gaussian. Both are circles on the
    sphere of directions, and become what the picture's projection makes of them.

    Returns
    -------
    picture, eccentricities_deg
    """
    shown = ring_eccentricities(geometry, gaze_px)
    rays, gaze = _rays(geometry), gaze_ray(geometry, gaze_px)
    density = geometry.px_per_deg(*pixel_centres(geometry))
    line_px = max(1.0, min(picture.shape[:2]) / 500)
    away = _angles_deg(rays, gaze)
    distances = [np.abs(away - eccentricity) * density * 2 for eccentricity in shown]  # thinner
    across, down = _axes(gaze)
    for eccentricity in shown:
        radius = float(pooling.sigma_deg(np.array(eccentricity))) * FWHM / 2
        for index in range(POOLS_ON_A_RING):
            turn = 2 * math.pi * index / POOLS_ON_A_RING
            aside = math.cos(turn) * across + math.sin(turn) * down
            angle = math.radians(eccentricity)
            centre = math.cos(angle) * gaze + math.sin(angle) * aside
            distances.append(np.abs(_angles_deg(rays, centre) - radius) * density)
    nearest = np.minimum.reduce(distances)
    light = np.clip(line_px + 0.5 - nearest, 0, 1)[..., None]
    dark = 0.6 * np.clip(2 * line_px + 0.5 - nearest, 0, 1)[..., None]
    drawn = picture * (1 - dark)
    drawn = drawn * (1 - light) + _RING * light
    return _labelled(np.rint(drawn).astype(np.uint8), geometry, gaze_px, shown, line_px), shown


def draw_gaze(picture: Picture, gaze_px: tuple[float, float], radius_px: float) -> Picture:
    """Mark a gaze by a ring that light and dark pictures both show."""
    canvas = Image.fromarray(picture)
    draw = ImageDraw.Draw(canvas)
    x, y = gaze_px
    for grow, colour in ((1.5, (0, 0, 0)), (0.0, (255, 255, 255))):
        reach = radius_px + grow
        draw.ellipse(
            (x - reach, y - reach, x + reach, y + reach), outline=colour, width=round(2 + 2 * grow)
        )
    draw.ellipse((x - 1.5, y - 1.5, x + 1.5, y + 1.5), fill=(255, 255, 255), outline=(0, 0, 0))
    return np.asarray(canvas)


def gaze_ray(geometry: Geometry, gaze_px: tuple[float, float]) -> NDArray[np.float64]:
    """The direction of the gaze, a unit vector."""
    return geometry.directions(np.array(gaze_px[0]), np.array(gaze_px[1]))


def _labelled(
    picture: Picture,
    geometry: Geometry,
    gaze_px: tuple[float, float],
    shown: tuple[float, ...],
    line_px: float,
) -> Picture:
    """Write each ring's eccentricity on it, between two pools."""
    rays, gaze = _rays(geometry), gaze_ray(geometry, gaze_px)
    across, down = _axes(gaze)
    canvas = Image.fromarray(picture)
    draw = ImageDraw.Draw(canvas)
    font = ImageFont.load_default(size=max(14, round(17 * line_px)))
    for eccentricity in shown:
        angle = math.radians(eccentricity)
        best: tuple[float, tuple[int, int]] = (-2.0, (0, 0))
        for index in range(POOLS_ON_A_RING):  # the first place that is on the picture
            turn = 2 * math.pi * (index + 0.5) / POOLS_ON_A_RING
            aside = math.cos(turn) * across + math.sin(turn) * down
            alike = rays @ (math.cos(angle) * gaze + math.sin(angle) * aside)
            row, column = divmod(int(alike.argmax()), geometry.width_px)
            if float(alike.max()) > best[0] + 1e-4:
                best = float(alike.max()), (column, row)
        draw.text(
            best[1], f"{eccentricity:.3g}°", fill=(255, 214, 0), font=font, anchor="mm",
            stroke_width=1, stroke_fill=(0, 0, 0),
        )  # fmt: skip
    return np.asarray(canvas)


def _rays(geometry: Geometry) -> NDArray[np.float64]:
    return geometry.directions(*pixel_centres(geometry))


def _angles_deg(rays: NDArray[np.float64], ray: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.degrees(np.arccos(np.clip(rays @ ray, -1, 1))))


def _axes(gaze: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two directions across the gaze: level, and down from there."""
    level = np.cross(np.array([0.0, 1.0, 0.0]), gaze)
    if np.linalg.norm(level) < 1e-9:  # straight up or down
        level = np.array([1.0, 0.0, 0.0])
    level = level / np.linalg.norm(level)
    return level, np.cross(gaze, level)


SLOW = ("energy-metamer",)
"""Conditions that take minutes: on sheets only where they are asked for by name."""
TILE_PX = 1024
"""Larger pictures are shrunk on a sheet."""


@dataclass(frozen=True, eq=False)
class ConditionPicture:
    """Picture that a condition made, and whether the GPU did."""

    choice: Choice
    colour: NDArray[np.float32]
    on_gpu: bool


def usual_choices() -> list[Choice]:
    """Every condition that needs no folder and no minutes."""
    return [
        Choice(entry.name)
        for entry in CONDITIONS
        if not entry.takes_path and entry.name not in SLOW
    ]


def look_through(
    colour: NDArray[np.float32] | NDArray[np.uint8],
    gaze_px: tuple[float, float],
    viewing: Viewing,
    choices: Sequence[Choice],
    *,
    seed: int = 0,
    ctx: moderngl.Context | None = None,
    state: Path | None = None,
    report: Callable[[str], None] | None = None,
) -> list[ConditionPicture]:
    """Show one picture by every choice.

    Parameters
    ----------
    state : Path, optional
        Where the first choice keeps its state, if it works in steps (energy-metamer): begun again,
        it goes on there. The file is deleted at the end.
    report : callable, optional
        Called with what is going on.

    Raises
    ------
    InputError
        As `pipeline.foveation.conditions.foveate`.
    """
    say = report or (lambda _: None)
    seen = []
    size = (colour.shape[0], colour.shape[1])
    for choice in choices:
        say(choice.label)
        foveator = Foveator(
            size, viewing=viewing, method=choice.name, seed=seed, ctx=ctx, **choice.parameters
        )
        try:
            on_gpu = foveator.passes is not None
            if isinstance(foveator.condition, EnergyMetamer):
                kept = state if choice is choices[0] else None
                shown = foveator.condition.descend(
                    as_floats(check_held(colour)),
                    PictureFixation(foveator.geometry, gaze_px, seed),
                    state=kept,
                    progress=lambda done, total, loss: say(
                        f"energy-metamer: step {done} of {total}, loss {loss:.3f} of the blur's"
                    ),
                )
                if kept is not None:
                    remove(kept)
            else:
                foveator.hold(colour)
                shown = foveator.show(gaze_px, seed=seed, last=True)
            seen.append(ConditionPicture(choice, shown, on_gpu))
        finally:
            foveator.release()
    return seen


def sheet_of(
    colour: NDArray[np.float32],
    gaze_px: tuple[float, float],
    viewing: Viewing,
    seen: Sequence[ConditionPicture],
) -> Picture:
    """Lay the picture with its pools, and every condition, out on one labelled sheet."""
    law = Pooling()
    geometry = viewing.of(colour.shape[1], colour.shape[0])
    pooled, eccentricities = draw_pools(drawing.of_colour(colour), geometry, gaze_px, law)
    radius_px = max(4.0, min(colour.shape[:2]) / 80)
    pooled = draw_gaze(pooled, gaze_px, radius_px)
    rings = ", ".join(f"{value:.3g}" for value in eccentricities)
    tiles = [(f"picture; pools at {rings} degrees ({law})", pooled)]
    first_the_picture = sorted(seen, key=lambda one: one.choice.name != "reference")
    tiles += [(_named(one.choice), drawing.of_colour(one.colour)) for one in first_the_picture]
    longest = max(colour.shape[:2])
    if longest > TILE_PX:
        share = TILE_PX / longest
        size = tuple(max(1, round(share * edge)) for edge in colour.shape[:2])
        tiles = [(label, drawing.fitted(tile, (size[0], size[1]))) for label, tile in tiles]
    return drawing.sheet(tiles)


def _named(choice: Choice) -> str:
    """A choice and its pools: blurs of one name may be many times as wide."""
    if "fovea_deg" not in condition_parameters(choice.name):
        return choice.label
    return f"{choice.label}\n{pooling_of(choice)}"


def pooling_of(choice: Choice) -> Pooling:
    """The pools of a choice; those of the default law where it has none."""
    return create_condition(choice.name, choice.parameters).pooling or Pooling()


def check_choices(choices: Sequence[Choice]) -> None:
    """Make every condition once, so that mistakes are told before any work."""
    for choice in choices:
        try:
            pooling_of(choice)
        except InputError as error:
            raise error if len(choices) == 1 else InputError(f"{choice.name}: {error}") from error
