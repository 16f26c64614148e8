"""Fills the loop's `LiveRenderer` with the conditions of foveation."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.foveation.conditions import Foveator, check_live
from pipeline.foveation.geometry import Equirectangular, Flat, FlatGeometry
from pipeline.foveation.gpu import OPAQUE
from pipeline.foveation.panorama_gpu import ViewPass
from pipeline.foveation.picture_pass import CutPass
from pipeline.foveation.steady_gaze import SteadyGaze
from pipeline.frame import check_seed
from pipeline.gl.texture import create_texture, texture_bytes, upload
from pipeline.named_classes import Choice
from pipeline.pictures.colour_file import PictureReading, read_any
from protocols.limits import check_within
from protocols.recipes.base import Cut
from stimuli.media.frames_folder import frames_in
from stimuli.scenes.builtin_pictures import builtin_picture, check_picture_name
from study_app.live.renderer import GazePlace, GazeState, LiveView, RendererDescription

BUILTIN = "builtin:"
REFERENCE = "reference"


@dataclass(frozen=True, eq=False)
class LiveSource:
    """Pictures of one size in memory: one, the frames of a clip, or a panorama.

    Attributes
    ----------
    frames : list of ndarray of uint8 or float32, shape (H, W, 4)
        Encoded, opaque.
    sha256 : str
        Of all pixels; of a scene of ours, which every renderer draws in its own way, of its name.
    """

    frames: list[NDArray[Any]]
    sha256: str
    panorama: bool
    notes: tuple[str, ...]

    @property
    def size(self) -> tuple[int, int]:
        """Height and width."""
        height, width, _ = self.frames[0].shape
        return height, width


def read_source(path: Path, reading: PictureReading, *, panorama: bool) -> LiveSource:
    """Read a picture, or a folder of frames.

    Raises
    ------
    InputError, StudyError
        If one is not what it must be, or they are too many for the memory.
    """
    paths = frames_in(path) if path.is_dir() else [path]
    if panorama and len(paths) > 1:
        raise InputError(f"{path}: --panorama takes one picture (this is a folder of frames)")
    frames: list[NDArray[Any]] = []
    notes: tuple[str, ...] = ()
    digest = hashlib.sha256()
    for one in paths:
        opened = read_any(one, reading, "foveate")
        frame = np.pad(
            opened.stored, ((0, 0), (0, 0), (0, 1)),
            constant_values=OPAQUE["rgba8" if opened.stored.dtype == np.uint8 else "rgba32f"],
        )  # fmt: skip
        if frames and (frame.shape, frame.dtype) != (frames[0].shape, frames[0].dtype):
            (high, wide, _), (height, width, _) = frames[0].shape, frame.shape
            raise InputError(
                f"{one}: must be {wide} x {high} px, {frames[0].dtype}, as the first frame"
                f" (is {width} x {height} px, {frame.dtype})"
            )
        check_within("values", frame.size * len(paths), InputError, path, "numbers in its frames")
        digest.update(f"{frame.shape} {frame.dtype}".encode() + frame.data)
        if panorama:
            Equirectangular().of(*opened.size[::-1])
        notes = notes or opened.notes
        frames.append(frame)
    return LiveSource(frames, digest.hexdigest(), panorama, notes)


def draw_source(name: str, geometry: FlatGeometry, ctx: moderngl.Context) -> LiveSource:
    """Draw a picture of ours, ``builtin:NAME``, as large as a view.

    Raises
    ------
    InputError
        If there is no such picture.
    """
    check_picture_name(name.removeprefix(BUILTIN))
    colour = builtin_picture(name.removeprefix(BUILTIN), geometry, ctx)
    frame = np.pad(colour, ((0, 0), (0, 0), (0, 1)), constant_values=OPAQUE["rgba32f"])
    said = hashlib.sha256(f"{name} {geometry}".encode()).hexdigest()
    return LiveSource([frame], said, panorama=False, notes=())


class FoveatingRenderer:
    """One source in a context, shown by one condition at a time; see `LiveRenderer`.

    Parameters
    ----------
    geometry : FlatGeometry
        Of what is shown: the picture, or the view of a panorama.
    choice : Choice
        The condition to begin with.
    """

    def __init__(
        self, ctx: moderngl.Context, source: LiveSource, geometry: FlatGeometry, choice: Choice
    ) -> None:
        if not source.panorama and source.size != (geometry.height_px, geometry.width_px):
            height, width = source.size
            raise InputError(
                f"what is shown must be as large as its source ({width} x {height} px; got"
                f" {geometry.width_px} x {geometry.height_px} px)"
            )
        self._ctx, self.source, self.geometry = ctx, source, geometry
        self._view: LiveView | None = None
        self._cut: Cut | None = None
        self._cutting: tuple[CutPass, moderngl.Texture] | None = None
        self._foveator: Foveator | None = None
        self.choice = choice
        self.choose(choice)
        height, width = source.size
        kind = "rgba8" if source.frames[0].dtype == np.uint8 else "rgba32f"
        self._picture = create_texture(ctx, (width, height), kind)
        self._turned: tuple[ViewPass, moderngl.Texture, moderngl.Texture] | None = None
        size = geometry.width_px, geometry.height_px
        if source.panorama:
            self._turned = (
                ViewPass(ctx, (width, height), geometry),
                create_texture(ctx, size, "rgba32f"),
                create_texture(ctx, size, "rg32f"),
            )
        self._target = create_texture(ctx, size, "rgba32f")
        self._frame = -1  # of the source that is uploaded
        self._steady: SteadyGaze | None = None

    def choose(self, choice: Choice) -> None:
        """Take another condition; the one before is freed.

        Raises
        ------
        InputError
            If there is no such condition, or the GPU cannot draw it; the one before stays.
        """
        geometry, foveator = self.geometry, None
        check_live(choice.name, choice.parameters)
        if choice.name != REFERENCE:
            viewing = Flat(distance_px=geometry.distance_px, centre_px=geometry.centre_px)
            size = geometry.height_px, geometry.width_px
            foveator = Foveator(
                size, viewing=viewing, method=choice.name, ctx=self._ctx, **choice.parameters
            )
        elif choice.parameters:
            raise InputError(f"{REFERENCE} has no parameters (got {choice.label})")
        if self._foveator is not None:
            self._foveator.release()
        self._foveator, self.choice, self._view = foveator, choice, None

    def load(self, source: LiveSource, cut: Cut | None) -> None:
        """Take another source of the same size and kind, with a cut; no gaze was seen yet."""
        self.source, self._cut = source, cut
        self._view, self._frame, self._steady = None, -1, None
        if cut is not None and self._cutting is None:
            size = self.geometry.width_px, self.geometry.height_px
            target = create_texture(self._ctx, size, "rgba32f")
            self._cutting = CutPass(self._ctx, self.geometry), target

    def hold(self, view: LiveView) -> None:
        """Upload the frame, turn the panorama, and analyse what is seen."""
        if view == self._view:
            return
        if not view.frame < len(self.source.frames):
            raise InputError(
                f"the source must have frame {view.frame} (it has {len(self.source.frames)})"
            )
        if view.frame != self._frame:
            upload(self._picture, self.source.frames[view.frame])
            self._frame = view.frame
        if self._turned is not None:
            turn, seen, shift = self._turned
            turn(self._picture, seen, shift, right_deg=view.right_deg, down_deg=view.down_deg)
        if self._foveator is not None and self._foveator.passes is not None:
            self._foveator.passes.hold(self._seen)
        self._view = view

    def prepare(self, seed: int) -> None:
        """Make the noise or the displacements of a seed."""
        check_seed(seed)
        if self._foveator is not None and self._foveator.passes is not None:
            self._foveator.passes.set_seed(seed, carried=self._shift_px is not None)

    def follow(self, eye_px: GazePlace, elapsed_s: float) -> tuple[GazePlace, GazePlace]:
        """Let the field follow as `SteadyGaze` does."""
        if self._steady is None:
            self._steady = SteadyGaze(self.geometry, eye_px)
        else:
            self._steady = self._steady.after(eye_px, elapsed_s)
        return self._steady.eye_px, self._steady.field_px or self._steady.eye_px

    def draw(self, gaze_state: GazeState) -> moderngl.Texture:
        """Show what is held."""
        if self._foveator is None or self._foveator.passes is None:
            return self._seen
        self._foveator.passes.show(
            self._target, gaze_state.gaze_px, seed=gaze_state.seed,
            field_gaze_px=gaze_state.field_px, noise_shift_px=self._shift_px,
        )  # fmt: skip
        if self._cut is None or self._cutting is None:
            return self._target
        cut, target = self._cutting
        cut(
            self._target, self._seen, target, gaze_state.gaze_px,
            angle_deg=self._cut.angle_deg, ramp_deg=self._cut.ramp_deg,
        )  # fmt: skip
        return target

    def describe(self) -> RendererDescription:
        """Source, geometry, condition and parameters."""
        geometry = self.geometry
        return RendererDescription(
            source_sha256=self.source.sha256,
            panorama=self.source.panorama,
            size_px=(geometry.width_px, geometry.height_px),
            centre_px=geometry.centre_px,
            distance_px=geometry.distance_px,
            method=self.choice.name,
            parameters=dict(self.choice.parameters),
            cut=self._cut,
        )

    @property
    def held_bytes(self) -> int:
        """Memory on the GPU for what is held and drawn."""
        passes = self._foveator.passes if self._foveator is not None else None
        made = (self._picture, self._target, *(self._turned or ())[1:], *(self._cutting or ())[1:])
        return sum(map(texture_bytes, made)) + (0 if passes is None else passes.held_bytes)

    def release(self) -> None:
        """Free all that was made."""
        if self._foveator is not None:
            self._foveator.release()
        for made in (self._picture, self._target, *(self._turned or ()), *(self._cutting or ())):
            made.release()

    @property
    def _shift_px(self) -> moderngl.Texture | None:
        """Shift of noise that lies on directions of a panorama; displacements lie on the screen."""
        passes = self._foveator.passes if self._foveator is not None else None
        if self._turned is None or passes is None or not passes.carries_noise:
            return None
        return self._turned[2]

    @property
    def _seen(self) -> moderngl.Texture:
        return self._picture if self._turned is None else self._turned[1]


class FoveatingStudio:
    """Draws the live stimuli of trials; see `Studio`. Passes are kept, by place and condition."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._made: dict[str, FoveatingRenderer] = {}

    def __call__(
        self, place: int, said: RendererDescription, pixels: NDArray[np.uint8]
    ) -> FoveatingRenderer:
        """Return the renderer of a picture."""
        source = LiveSource([pixels], said.source_sha256, said.panorama, ())
        geometry = FlatGeometry(*said.size_px, said.distance_px, said.centre_px)
        choice = Choice(said.method, said.parameters)
        key = f"{place} {geometry} {choice}"
        if key not in self._made:
            self._made[key] = FoveatingRenderer(self._ctx, source, geometry, choice)
        self._made[key].load(source, said.cut)
        return self._made[key]

    def release(self) -> None:
        """Free all passes."""
        for renderer in self._made.values():
            renderer.release()
        self._made.clear()
