"""One picture through any condition: the choice, the sheet of many, and what each shows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.conditions import (
    CONDITIONS,
    Foveator,
    condition_parameters,
    create_condition,
)
from pipeline.foveation.energy import EnergyMetamer
from pipeline.foveation.geometry import Viewing
from pipeline.foveation.picture_fixation import PictureFixation, as_floats, check_held
from pipeline.foveation.pooling import Pooling
from pipeline.named_classes import Choice
from protocols.disk.whole_file import remove
from stimuli import pictures
from stimuli.foveated.rings import draw_gaze, draw_pools
from stimuli.pictures import Picture

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
    pooling: Pooling | None = None,
) -> Picture:
    """Lay the picture with its pools, and every condition, out on one labelled sheet."""
    law = pooling or Pooling()
    geometry = viewing.of(colour.shape[1], colour.shape[0])
    pooled, eccentricities = draw_pools(pictures.of_colour(colour), geometry, gaze_px, law)
    radius_px = max(4.0, min(colour.shape[:2]) / 80)
    pooled = draw_gaze(pooled, gaze_px, radius_px)
    rings = ", ".join(f"{value:.3g}" for value in eccentricities)
    tiles = [(f"picture; pools at {rings} degrees ({law})", pooled)]
    first_the_picture = sorted(seen, key=lambda one: one.choice.name != "reference")
    tiles += [(_named(one.choice), pictures.of_colour(one.colour)) for one in first_the_picture]
    longest = max(colour.shape[:2])
    if longest > TILE_PX:
        share = TILE_PX / longest
        size = tuple(max(1, round(share * edge)) for edge in colour.shape[:2])
        tiles = [(label, pictures.fitted(tile, (size[0], size[1]))) for label, tile in tiles]
    return pictures.sheet(tiles)


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
