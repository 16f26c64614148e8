"""Renderer as the loop asks for it. The front door fills it, so that a session knows no method.

A frame is decided by what `LiveRenderer.describe` says, a `LiveView` and a `GazeState`, and by
nothing else: whoever draws these again gets it again, bit for bit on the same renderer.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple, Protocol, TypeAlias

from pydantic import Field

from protocols.recipes.base import Cut
from protocols.units import ExtendedModel, Pixels, Sha256

if TYPE_CHECKING:  # who describes a picture needs no graphics
    import moderngl
    import numpy as np
    from numpy.typing import NDArray

GazePlace: TypeAlias = tuple[float, float]
Parameter: TypeAlias = bool | int | float | str

STEPS_PER_PX = 16
"""Gaze is rounded to this part of a pixel before it is used: what is logged is what was used."""


class LiveView(NamedTuple):
    """View of a source: a frame of a clip, or a direction in a panorama."""

    frame: int = 0
    """Number in a clip, from 0."""
    right_deg: float = 0.0
    """Direction of the view's middle from that of a panorama."""
    down_deg: float = 0.0


class GazeState(NamedTuple):
    """Gaze and seed that a view is drawn for; places are pixels of the picture."""

    gaze_px: GazePlace
    field_px: GazePlace
    """The gaze that displacements follow."""
    seed: int


class RendererDescription(ExtendedModel):
    """All that decides pixels beside view and look."""

    source_sha256: Sha256
    """Hash of the source's pixels."""
    panorama: bool
    size_px: tuple[Pixels, Pixels]
    """Width and height of what is shown."""
    centre_px: tuple[float, float]
    """Point where the normal through the eye meets it."""
    distance_px: Annotated[float, Field(gt=0)]
    """Distance of the eye."""
    method: str
    parameters: dict[str, Parameter | tuple[Parameter, ...] | None]
    cut: Cut | None = None
    """Left out where the method draws the whole picture."""

    added_later: ClassVar[tuple[str, ...]] = ("cut",)


class Follower(Protocol):
    """Picture for each gaze: all that the loop asks for."""

    def hold(self, view: LiveView) -> None:
        """Analyse what is looked at, unless it is what is held."""

    def follow(self, eye_px: GazePlace, elapsed_s: float) -> tuple[GazePlace, GazePlace]:
        """Return the gaze, and that of the field, for an eye so long after the last call.

        Not a number: the eye is lost, and both hold; the middle until it was ever found.
        """

    def draw(self, gaze_state: GazeState) -> moderngl.Texture:
        """Show what is held, in a texture that stays the renderer's: rgba32f or rgba8."""


class LiveRenderer(Follower, Protocol):
    """Draws one source by one method, and says how, so that its frames can be drawn again."""

    def prepare(self, seed: int) -> None:
        """Make what a seed decides, unless it is at hand; this may take longer than a frame."""

    def describe(self) -> RendererDescription:
        """Return all else that decides pixels."""


class Studio(Protocol):
    """Source of renderers for the live stimuli of trials."""

    def __call__(
        self, place: int, said: RendererDescription, pixels: NDArray[np.uint8]
    ) -> LiveRenderer:
        """Return the renderer of a picture as `said`: it holds the picture, and no gaze yet.

        Parameters
        ----------
        place : int
            Which of a trial's stimuli it is: each has a renderer, and a texture, of its own.
        pixels : ndarray of shape (H, W, 4)
            Of the picture, opaque.
        """

    def release(self) -> None:
        """Free all that was made."""


def on_grid(place_px: GazePlace) -> GazePlace:
    """Return a place on the grid of gazes; what is not a number stays so."""
    x, y = (
        round(STEPS_PER_PX * value) / STEPS_PER_PX if math.isfinite(value) else math.nan
        for value in place_px
    )
    return x, y
