"""One clip: survey its path, make its frames, write and hash them.

A survey solves a path's extent, finds the margin, and stores the hole mask of every frame; it
serves all methods of one scene and size. A clip then goes frame by frame: warp, fill, rescale,
encode, write. Both leave what they finished behind when they are killed, and skip it when run
again.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Protocol

import moderngl
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.errors import InputError
from pipeline.foveation.two_rates import TwoRates
from pipeline.frame import WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.methods.method import CleanPlate, Method, PlateMethod, TexturePlate
from pipeline.methods.on_gpu import filled_colour
from pipeline.methods.registry import create_method
from pipeline.pictures.colour_file import save_colour
from protocols.disk.hashing import sha256_bytes
from protocols.disk.whole_file import write_whole
from protocols.recipes.warped_clips import ClipName, Periphery
from stimuli.batch.batch_folder import SURVEY_NAME
from stimuli.batch.build_plan import BuildPlan
from stimuli.batch.footage import CameraShot, Footage
from stimuli.media.png import decode_png, encode_frame, encode_mask, is_whole_png
from stimuli.rendering.paths import make_path
from stimuli.rendering.scenery import Scenery
from stimuli.rendering.solve import solve_extent


class Views(Protocol):
    """Views of `Footage` that a fill needs."""

    def warped(self, frame: int) -> WarpedFrame:
        """Warp the source to `frame`."""
        ...

    def warped_textures(self, frame: int) -> FrameTextures:
        """The same, on the GPU."""
        ...

    def source_key(self, frame: int) -> int:
        """Return the key of the source that `frame` is warped from."""
        ...


class Fills:
    """Fill frames of one clip by one method: frame k alone is frame k in a row.

    A method with a plate (`PlateMethod`) gets the frames of each source in their order, from the
    first one on. So a frame asked for alone costs the fills of those before it.
    """

    def __init__(self, method: Method, views: Views, seed: int) -> None:
        self._method = method
        self._views = views
        self._seed = seed
        self._plate: CleanPlate | TexturePlate | None = None
        self._source: int | None = None
        self._next = 0  # the first frame that the plate has not seen

    def frame(self, frame: int) -> NDArray[np.float32]:
        """Return the filled frame, (H, W, 3)."""
        if not isinstance(self._method, PlateMethod):
            return self._filled(frame, None)
        source = self._views.source_key(frame)
        if self._plate is None or source != self._source or frame < self._next:
            self.release()
            self._plate, self._source, self._next = _checked(self._method.new_plate()), source, 0
        result: NDArray[np.float32] | None = None
        for k in range(self._next, frame + 1):
            if self._views.source_key(k) == source:
                result = self._filled(k, self._plate)
        self._next = frame + 1
        assert result is not None  # the last k is the frame itself
        return result

    def release(self) -> None:
        """Free the plate, if it lies on the GPU."""
        if isinstance(self._plate, TexturePlate):
            self._plate.release()
        self._plate = None

    def _filled(self, frame: int, plate: CleanPlate | TexturePlate | None) -> NDArray[np.float32]:
        """Fill one frame, from a plate where there is one."""
        filler = self._method if plate is None else plate
        if isinstance(filler, TexturePlate):  # or a method on the GPU, which has what a plate has
            textures = self._views.warped_textures(frame)
            filler.fill_textures(textures, self._seed)
            return filled_colour(textures)
        return filler.fill(self._views.warped(frame), self._seed)


def _checked(plate: CleanPlate | TexturePlate) -> CleanPlate | TexturePlate:
    """Require a plate that fills; a plug-in's may not."""
    if not isinstance(plate, CleanPlate | TexturePlate):
        old = [name for name in ("settle", "settle_textures") if hasattr(plate, name)]
        has = f", which has {old[0]}" if old else ""
        cure = "; fill takes the frame with its holes, where settle took the finished fill"
        raise InputError(
            "a plate must have fill, or fill_textures and release (got"
            f" {type(plate).__name__}{has}); mend the method that makes it{cure if old else ''}"
        )
    return plate


ENCODERS = 2
IN_FLIGHT = 4  # frames between pipeline and disk: memory does not grow with the clip


@dataclass(frozen=True)
class Survey:
    """Measures of a scene at a size before anything is filled."""

    key: str
    extent_m: float
    margin_px: int
    hole_share: float
    """Mean over the frames."""
    hole_share_least: float
    hole_share_most: float
    masks_sha256: tuple[str, ...]

    @property
    def masks_hash(self) -> str:
        """One hash of all masks."""
        return sha256_bytes("".join(self.masks_sha256).encode())


def take_survey(
    ctx: moderngl.Context | None, scenery: Scenery, plan: BuildPlan, clip: ClipName, folder: Path
) -> Survey:
    """Solve the path of `clip`'s scene and size and write its hole masks into `folder`."""
    key = plan.survey_key(clip)
    known = read_survey(folder, key)
    if known is not None:
        return known
    folder.mkdir(parents=True, exist_ok=True)
    size = plan.size(clip)
    shot = shot_of(plan, clip, 0.0)
    if plan.scene(clip).has_own_path:
        extent_m = 0.0  # its files tell all motion
    elif size.extent_m is not None:
        extent_m = size.extent_m
        if extent_m > scenery.largest_extent_m * (1 + 1e-9):
            raise InputError(
                f"{clip.scene}: extent_m must be at most {scenery.largest_extent_m:.4g} m, as far"
                f" as this scene's path goes (got {extent_m:g} m)"
            )
    else:
        assert size.hole_share is not None
        extent_m = solve_extent(ctx, scenery, shot, size.hole_share, f"{clip.scene}, {clip.size}")
    footage = Footage(ctx, scenery, shot_of(plan, clip, extent_m), holes_only=True)
    try:
        hashes, shares = [], []
        for frame in range(shot.frames):
            mask = footage.holes(frame)
            data = encode_mask(mask)
            write_whole(folder / f"{frame:06d}.png", data)
            hashes.append(sha256_bytes(data))
            shares.append(float(mask.mean()))
    finally:
        footage.release()
    survey = Survey(
        key=key,
        extent_m=extent_m,
        margin_px=footage.margin_px,
        hole_share=float(f"{np.mean(shares):.6g}"),
        hole_share_least=float(f"{min(shares):.6g}"),
        hole_share_most=float(f"{max(shares):.6g}"),
        masks_sha256=tuple(hashes),
    )
    write_whole(folder / SURVEY_NAME, json.dumps(asdict(survey), sort_keys=True).encode())
    return survey


def read_survey(folder: Path, key: str) -> Survey | None:
    """Return a finished survey, if `folder` holds the one of `key`, with all its masks."""
    try:
        raw = json.loads((folder / SURVEY_NAME).read_bytes())
        survey = Survey(**(raw | {"masks_sha256": tuple(raw["masks_sha256"])}))
        if survey.key != key:
            return None
        for index, wanted in enumerate(survey.masks_sha256):
            if sha256_bytes((folder / f"{index:06d}.png").read_bytes()) != wanted:
                return None
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return None
    return survey


def make_frames(
    ctx: moderngl.Context | None,
    scenery: Scenery,
    plan: BuildPlan,
    clip: ClipName,
    survey: Survey,
    folder: Path,
) -> list[str]:
    """Write every frame of `clip` into `folder` that is not there; return all their hashes."""
    folder.mkdir(parents=True, exist_ok=True)
    clips = plan.study.warped.clips
    hashes: dict[int, str] = {}
    missing = []
    for frame in range(clips.frames):
        known = _hash_if_whole(folder / f"{frame:06d}.png")
        if known is not None and (not clips.exr or (folder / f"{frame:06d}.exr").exists()):
            hashes[frame] = known
        else:
            missing.append(frame)
    waiting: deque[tuple[int, Future[str]]] = deque()
    with ThreadPoolExecutor(ENCODERS) as encoders:
        try:
            for frame, colour in _frames(ctx, scenery, plan, clip, survey, missing):
                path = folder / f"{frame:06d}.png"
                job = encoders.submit(_store, path, colour, clips.bit_depth, clips.exr)
                waiting.append((frame, job))
                if len(waiting) >= IN_FLIGHT:
                    done, future = waiting.popleft()
                    hashes[done] = future.result()
            while waiting:
                done, future = waiting.popleft()
                hashes[done] = future.result()
        finally:
            for _, future in waiting:
                future.cancel()
    return [hashes[frame] for frame in range(clips.frames)]


def read_mask(folder: Path, frame: int) -> NDArray[np.bool_]:
    """Return the hole mask of one frame of a survey's folder."""
    return np.asarray(decode_png(folder / f"{frame:06d}.png") > 0)


def _frames(
    ctx: moderngl.Context | None,
    scenery: Scenery,
    plan: BuildPlan,
    clip: ClipName,
    survey: Survey,
    wanted: list[int],
) -> Iterator[tuple[int, NDArray[np.float32]]]:
    if not wanted:
        return
    shot = shot_of(plan, clip, survey.extent_m)
    footage = Footage(ctx, scenery, shot, margin_px=survey.margin_px)
    method, fills, rates = None, None, None
    try:
        if not plan.method(clip).is_reference:
            given = plan.parameters(clip)
            method = create_method(plan.registry_name(clip), ctx, given)
            fills = Fills(method, footage, plan.study.warped.clips.seed)
            rates = _two_rates(ctx, plan)
        for frame in wanted:
            colour = footage.truth(frame) if fills is None else fills.frame(frame)
            if rates is not None:
                colour = rates.shown(colour, footage.truth(frame), frame)
            yield frame, _rescaled(colour, plan)
    except InputError as error:
        raise InputError(f"{clip}: {error}") from error
    finally:
        for held in (rates, fills, method, footage):
            if held is not None:
                held.release()


def _two_rates(ctx: moderngl.Context | None, plan: BuildPlan) -> TwoRates | None:
    clips = plan.study.warped.clips
    if (view := clips.true_view) is None:
        return None
    around = clips.periphery or Periphery()
    return TwoRates(
        plan.eye, plan.eye.place_px(view.x_deg, view.y_deg), view.within_deg,
        coarser=around.coarser, condition=around.condition, parameters=around.parameters,
        seed=clips.seed, ctx=ctx,
    )  # fmt: skip


def shot_of(plan: BuildPlan, clip: ClipName, extent_m: float) -> CameraShot:
    """Return the camera and its path at an extent, as a clip is taken."""
    clips = plan.study.warped.clips
    path = make_path(plan.scene(clip).camera, clips.frames, clips.fps)
    return CameraShot(path, plan.render_px, extent_m, clips.margin_share)


def _rescaled(colour: NDArray[np.float32], plan: BuildPlan) -> NDArray[np.float32]:
    shown, filters = plan.shown_px, {"box": Image.Resampling.BOX}
    if plan.study.warped.clips.rescale == "none" or plan.render_px == shown:
        return colour
    chosen = filters.get(plan.study.warped.clips.rescale, Image.Resampling.LANCZOS)
    planes = [
        np.asarray(Image.fromarray(np.ascontiguousarray(colour[..., c])).resize(shown, chosen))
        for c in range(3)
    ]
    return np.stack(planes, axis=-1).clip(0, 1).astype(np.float32)


def _store(path: Path, colour: NDArray[np.float32], bit_depth: int, exr: bool) -> str:
    data = encode_frame(colour, bit_depth)
    if exr:
        save_colour(path.with_suffix(".exr"), colour, bits=32)
    write_whole(path, data)  # last: a frame counts as done by its PNG
    return sha256_bytes(data)


def _hash_if_whole(path: Path) -> str | None:
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return None
    return sha256_bytes(data) if is_whole_png(data) else None
