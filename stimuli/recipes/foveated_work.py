"""The work on stills of `foveated-images`, as it is done here, in processes and on clusters.

The symbol is drawn into the picture first; the condition is worked out for the very picture that
holds it. A process has one maker: its context, where there is OpenGL, and every condition's
passes, built once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.conditions import Foveator
from pipeline.foveation.drawn import before_background, bisected, direction_at, draw_ring
from pipeline.foveation.energy import EnergyMetamer
from pipeline.foveation.geometry import Flat, FlatGeometry
from pipeline.foveation.picture_fixation import PictureFixation
from pipeline.foveation.view import flat_view
from pipeline.gl.context import release_context
from pipeline.pictures.colour_file import read_any
from protocols.disk.whole_file import remove
from protocols.recipes.foveated_images import (
    BUILTIN,
    REFERENCE,
    FoveatedImages,
    FoveatedStimulus,
    PanoramaView,
    ScenePicture,
    ShownMethod,
)
from stimuli.media.gaze_and_display import read_gaze
from stimuli.media.png import encode_frame
from stimuli.scenes.builtin_pictures import builtin_picture
from stimuli.worker import GpuThread, RendererInfo, context_or_numpy

Colour = NDArray[np.float32]


@dataclass(frozen=True)
class StillsPlan:
    """Stills to make; small, and the same on every machine that reads the same files.

    Parameters
    ----------
    distance_px : float
        Of the eye from the display.
    folder : Path
        What file names in the recipe are relative to.
    """

    recipe: FoveatedImages
    distance_px: float
    folder: Path

    @cached_property
    def geometry(self) -> FlatGeometry:
        """The picture in the middle of the display, pixel for pixel."""
        viewing = Flat(distance_px=self.distance_px)
        return viewing.of(self.recipe.width_px, self.recipe.height_px)

    def gaze_px(self, entry: FoveatedStimulus) -> tuple[float, float]:
        """Gaze in a still, pixels."""
        return read_gaze(f"{entry.gaze.x_deg}deg,{entry.gaze.y_deg}deg", self.geometry)

    def condition(self, shown: ShownMethod) -> str:
        """The condition's name, a folder in it made relative to `folder`."""
        kind, colon, path = shown.condition.partition(":")
        return f"{kind}:{self.folder / path}" if colon and path else shown.condition

    def number(self, entry: FoveatedStimulus) -> int:
        """Index of its picture made elsewhere: pictures in order, gazes in order within each."""
        recipe = self.recipe
        return recipe.pictures.index(entry.picture) * len(recipe.gazes) + recipe.gazes.index(
            entry.gaze
        )

    def picture(self, picture: ScenePicture, ctx: moderngl.Context | None = None) -> Colour:
        """Return a scene in the size of the stills: (H, W, 3).

        Parameters
        ----------
        ctx : moderngl.Context, optional
            Draws built-in scenes.

        Raises
        ------
        InputError
            If it has another size and the recipe says so, or is no panorama where one is looked at.
        """
        if picture.file.startswith(BUILTIN):
            view = PanoramaView() if picture.view is None else picture.view
            return builtin_picture(
                picture.file.removeprefix(BUILTIN), self.geometry, ctx,
                right_deg=view.right_deg, down_deg=view.down_deg,
            )  # fmt: skip
        path = self.folder / picture.file
        colour = read_any(path).colour
        if picture.view is not None:
            try:
                return flat_view(
                    colour, self.geometry,
                    right_deg=picture.view.right_deg, down_deg=picture.view.down_deg,
                )  # fmt: skip
            except InputError as error:
                raise InputError(f"{path}: {error}") from None
        height, width = self.recipe.height_px, self.recipe.width_px
        if colour.shape[:2] == (height, width):
            return colour
        if self.recipe.fit == "exact":
            got = colour.shape[1], colour.shape[0]
            raise InputError(f"{path}: {wrong_picture_size((width, height), got)}")
        return _covering(colour, (height, width), self.recipe.kept(picture))


def wrong_picture_size(wanted: tuple[int, int], got: tuple[int, int]) -> str:
    """Say that a picture is (width, height) `got` px where the study has `wanted`."""
    return (
        f"must be {wanted[0]} x {wanted[1]} px, as the study says (is {got[0]} x {got[1]}); cut it,"
        ' or write fit = "cover"'
    )


def _covering(colour: Colour, size: tuple[int, int], kept: tuple[float, float]) -> Colour:
    """Scale a picture to cover (height, width), and cut out what lies around the point `kept`.

    The point, (x, y) in shares of the picture, lies in the middle as far as the picture has room.
    """
    height, width = size
    share = max(height / colour.shape[0], width / colour.shape[1])
    across, down = (round(share * edge) for edge in colour.shape[1::-1])
    larger = max(width, across), max(height, down)
    how = cv2.INTER_AREA if share < 1 else cv2.INTER_CUBIC
    scaled = np.clip(np.asarray(cv2.resize(colour, larger, interpolation=how)), 0, 1)
    left, top = (
        min(max(math.floor(share * whole - shown / 2), 0), whole - shown)
        for share, whole, shown in zip(kept, larger, (width, height), strict=True)
    )
    return np.ascontiguousarray(scaled[top : top + height, left : left + width], np.float32)


class StillMaker:
    """Makes stills of one order; use it from one thread, which its context belongs to."""

    def __init__(self, order: StillsPlan) -> None:
        self.order = order
        self._ctx, self.renderer = context_or_numpy()
        self._foveators: dict[str, Foveator] = {}
        self._picture: tuple[str, Colour] | None = None
        self._last: tuple[tuple[str, str, str, int], Colour] | None = None

    def colour(self, entry: FoveatedStimulus, state: Path | None = None) -> Colour:
        """Return a still: encoded R'G'B', shape (H, W, 3).

        Parameters
        ----------
        state : Path, optional
            Where a condition that works for minutes keeps how far it is.
        """
        order = self.order
        gaze_px = order.gaze_px(entry)
        scene = self._scene(entry.picture)
        plain = self._with_ring(scene, entry)
        if entry.shown.condition == REFERENCE or order.recipe.live:
            return plain  # what follows the gaze is drawn in the session
        shown = self._shown(plain, entry, state)
        rings, cuts = order.recipe.rings, order.recipe.cuts
        if entry.cut_deg is not None and cuts is not None:
            return bisected(
                shown, plain, order.geometry, gaze_px,
                angle_deg=entry.cut_deg, ramp_deg=cuts.ramp_deg,
            )  # fmt: skip
        if rings is not None and rings.background == "undistorted":
            assert entry.eccentricity_deg is not None
            assert entry.polar_deg is not None
            centre = direction_at(order.geometry, gaze_px, entry.eccentricity_deg, entry.polar_deg)
            return before_background(
                shown, scene, order.geometry, centre,
                radius_deg=rings.height_deg / 2 + rings.rim_deg, ramp_deg=rings.rim_deg,
            )  # fmt: skip
        return shown

    def release(self) -> None:
        """Free the GPU."""
        for foveator in self._foveators.values():
            foveator.release()
        self._foveators.clear()
        if self._ctx is not None:
            release_context(self._ctx)
            self._ctx = None

    def _scene(self, picture: ScenePicture) -> Colour:
        if self._picture is None or self._picture[0] != picture.name:
            self._picture = picture.name, self.order.picture(picture, self._ctx)  # scene by scene
        return self._picture[1]

    def _with_ring(self, picture: Colour, entry: FoveatedStimulus) -> Colour:
        rings = self.order.recipe.rings
        if rings is None or entry.eccentricity_deg is None or entry.polar_deg is None:
            return picture
        return draw_ring(
            picture, self.order.geometry, self.order.gaze_px(entry),
            eccentricity_deg=entry.eccentricity_deg, polar_deg=entry.polar_deg,
            height_deg=rings.height_deg, gap_deg=entry.gap_deg, grey=rings.grey,
        )  # fmt: skip

    def _shown(self, plain: Colour, entry: FoveatedStimulus, state: Path | None) -> Colour:
        """Foveate a picture; once for all that cut the same one, which come in a row."""
        if entry.eccentricity_deg is not None:
            return self._foveated(plain, entry, state)
        asked = (entry.picture.name, entry.shown.name, entry.gaze.name, entry.seed)
        if self._last is None or self._last[0] != asked:
            self._last = asked, self._foveated(plain, entry, state)
        return self._last[1]

    def _foveated(self, picture: Colour, entry: FoveatedStimulus, state: Path | None) -> Colour:
        foveator = self._foveator(entry.shown)
        gaze_px = self.order.gaze_px(entry)
        condition = foveator.condition
        if isinstance(condition, EnergyMetamer):
            fixation = PictureFixation(self.order.geometry, gaze_px, entry.seed)
            made = condition.descend(picture, fixation, state=state)
            if state is not None:
                remove(state)
            return made
        return foveator(picture, gaze_px, seed=entry.seed, frame=self.order.number(entry))

    def _foveator(self, shown: ShownMethod) -> Foveator:
        if shown.name not in self._foveators:
            self._foveators[shown.name] = Foveator(
                (self.order.recipe.height_px, self.order.recipe.width_px),
                viewing=Flat(distance_px=self.order.distance_px),
                method=self.order.condition(shown),
                ctx=self._ctx,
                **dict[str, Any](shown.parameters),
            )
        return self._foveators[shown.name]


STILLS = GpuThread(StillMaker)


def describe_job(order: StillsPlan) -> RendererInfo:
    """Name what draws in this worker."""
    return STILLS.do(order, lambda maker: maker.renderer)


def colour_job(order: StillsPlan, entry: FoveatedStimulus) -> Colour:
    """Make a still and keep it in memory."""
    return STILLS.do(order, lambda maker: maker.colour(entry))


def still_job(
    order: StillsPlan, entry: FoveatedStimulus, state: Path | None
) -> tuple[list[bytes | str], RendererInfo]:
    """Make a still; return it as a PNG file, and what drew it.

    Parameters
    ----------
    state : Path or None
        See `StillMaker.colour`.
    """

    def job(maker: StillMaker) -> tuple[list[bytes | str], RendererInfo]:
        return [encode_frame(maker.colour(entry, state), 8)], maker.renderer

    return STILLS.do(order, job)
