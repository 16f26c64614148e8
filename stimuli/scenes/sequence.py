"""OpenEXR pictures and sequences with depth and motion, and where a pixel is some frames later.

`pipeline.pictures.channels` names the channels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.camera import UPRIGHT, Camera
from pipeline.colour import encode_srgb
from pipeline.errors import InputError
from pipeline.frame import NO_DEPTH, SourceFrame, WarpedFrame, check_depth, check_flow
from pipeline.pictures.channels import (
    Layer,
    Motion,
    Planes,
    alpha_of,
    check_opaque,
    depth_layer,
    find_motion,
    need,
    need_motion,
)
from pipeline.pictures.colour_file import Transfer, check_finite_light, stored_transfer
from pipeline.pictures.decode import read_parts
from pipeline.pictures.depth_and_flow import along_axis, centred, check_depth_unit
from pipeline.pictures.stored_frames import sequence_files
from pipeline.pictures.warp_input import WarpInput
from pipeline.warp.speckle import mends, taken
from protocols.recipes.warped_clips import ExrScene, StereoPath, UpsamplingPath
from stimuli.rendering.paths import Pose
from stimuli.rendering.scenery import CameraStep, Scenery, near_depth_m
from stimuli.scenes.photo import PhotoScenery
from stimuli.scenes.truth_check import TruthVerdict, flow_readings, judge_truth

DEPTH_TOLERANCE = 0.1
"""Largest difference of a surface from frame to frame, as a share of its nearness."""


def followed(
    first: int,
    last: int,
    frame: Callable[[int], SourceFrame],
    motion: Callable[[int], Motion],
) -> NDArray[np.float32]:
    """Follow every pixel of frame `first` to frame `last`, by the nearest pixel's motion.

    Parameters
    ----------
    frame, motion : callable
        Picture and motion of a frame by its index. Where motion leads to the previous frame,
        the way from one frame to the next is that of the next one, turned round.

    Returns
    -------
    ndarray of float32, shape (H, W, 2)
        Target minus source position in pixels, x then y.
    """
    height, width = frame(first).size
    y, x = np.mgrid[:height, :width].astype(np.float64)
    at_x, at_y = x.copy(), y.copy()
    for step in range(first, last):
        told = motion(step)
        if told.to_previous:
            step_px = turned_round(motion(step + 1).flow_px, frame(step + 1), frame(step))
        else:
            step_px = told.flow_px
        row = np.rint(at_y).astype(int).clip(0, height - 1)
        column = np.rint(at_x).astype(int).clip(0, width - 1)
        at_x, at_y = at_x + step_px[row, column, 0], at_y + step_px[row, column, 1]
    return np.stack([at_x - x, at_y - y], axis=-1).astype(np.float32)


def turned_round(
    back_px: NDArray[np.float32], later: SourceFrame, earlier: SourceFrame
) -> NDArray[np.float32]:
    """Return the motion from `earlier` to `later`, given the one from `later` back.

    Each pixel of `later` names the pixel of `earlier` that it came from; of several, the
    nearest surface counts, and none that differs in depth from what is there. What `later`
    does not see takes the motion of the pixel of nearest depth among the closest ones to its
    left, right, top and bottom.
    """
    height, width = later.size
    y, x = np.mgrid[:height, :width]
    row = np.rint(y + back_px[..., 1].astype(np.float64)).astype(int)
    column = np.rint(x + back_px[..., 0].astype(np.float64)).astype(int)
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    nearness, there = 1.0 / later.depth_m, 1.0 / earlier.depth_m
    seen = there[row.clip(0, height - 1), column.clip(0, width - 1)]
    same = np.abs(nearness - seen) <= DEPTH_TOLERANCE * np.maximum(nearness, seen)
    chosen = np.flatnonzero(inside & same)
    chosen = chosen[np.argsort(nearness.ravel()[chosen], kind="stable")]  # the nearest last
    target = row.ravel()[chosen] * width + column.ravel()[chosen]
    flow = np.zeros((height * width, 2), np.float32)
    known = np.zeros(height * width, bool)
    flow[target], known[target] = -back_px.reshape(-1, 2)[chosen], True
    return _completed(flow.reshape(height, width, 2), known.reshape(height, width), there)


def _completed(
    flow: NDArray[np.float32], known: NDArray[np.bool_], nearness: NDArray[np.float32]
) -> NDArray[np.float32]:
    best = np.full(known.shape, np.inf)
    result = flow.copy()
    for axis in (0, 1):
        for turn in (False, True):
            index = _last_known(np.flip(known, axis) if turn else known, axis)
            if turn:
                index = np.flip(index, axis)
                index = np.where(index >= 0, known.shape[axis] - 1 - index, -1)
            take = index.clip(0)
            near = np.take_along_axis(nearness, take, axis)
            apart = np.where(index >= 0, np.abs(near - nearness), np.inf)
            better = ~known & (apart < best)
            best = np.where(better, apart, best)
            moved = np.take_along_axis(flow, np.repeat(take[..., None], 2, -1), axis)
            result[better] = moved[better]
    return result


def _last_known(known: NDArray[np.bool_], axis: int) -> NDArray[np.int64]:
    """Index along `axis` of the last true entry up to each place, -1 before the first."""
    count = known.shape[axis]
    shape = (count, 1) if axis == 0 else (1, count)
    index = np.where(known, np.arange(count).reshape(shape), -1)
    return np.maximum.accumulate(index, axis=axis)


ASSUMED_FOCAL = 1.0  # image widths, where the protocol does not say
KEPT_PICTURES = 3  # of a sequence at a time


@dataclass(frozen=True)
class SequenceFrame:
    """One file: encoded colour, depth, and motion where there is one."""

    frame: SourceFrame
    motion: Motion | None


class SequenceScenery(Scenery):
    """A sequence for temporal up-sampling: every file is a true frame, and tells its motion."""

    def __init__(self, scene: ExrScene, files: list[Path]) -> None:
        self._scene, self._files, self.rim_px = scene, files, scene.rim_px
        self._kept: dict[int, SequenceFrame] = {}

    def source(
        self, size_px: tuple[int, int], margin_px: int, pose: Pose, extent_m: float, frame: int
    ) -> tuple[SourceFrame, Camera]:
        """Return the real frame `frame`, cut to size."""
        del pose, extent_m
        whole = self._picture(frame).frame
        inside = self._inside(whole.size, size_px, margin_px)
        depth_m = _cut(self._mended(whole.depth_m, whole), inside)
        cut = SourceFrame(_cut(whole.colour, inside), depth_m)
        height, width = cut.size
        focal = self._scene.focal_px or ASSUMED_FOCAL * whole.size[1]
        return cut, Camera(width, height, focal, focal, width / 2, height / 2, UPRIGHT)

    def truth(
        self,
        size_px: tuple[int, int],
        pose: Pose,
        extent_m: float,
        warped: WarpedFrame,
        margin_px: int,
    ) -> NDArray[np.float32]:
        """Return the sequence's own frame."""
        del pose, extent_m, margin_px
        whole = self._picture(warped.frame_index).frame
        return _cut(whole.colour, self._inside(whole.size, size_px, 0))

    def motion(
        self, size_px: tuple[int, int], margin_px: int, step: CameraStep
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Follow every pixel of the source from file to file."""
        first = self._picture(step.source).frame
        flow = followed(
            step.source, step.frame, lambda frame: self._picture(frame).frame, self._motion
        )
        inside = self._inside(first.size, size_px, margin_px)
        flow, depth_m = (self._mended(plane, first) for plane in (flow, first.depth_m))
        return _cut(flow, inside), _cut(depth_m, inside)

    def judged(self, frame: int) -> TruthVerdict:
        """Compare a file, moved by its motion, with the next one."""
        here, there = (self._picture(number).frame for number in (frame, frame + 1))
        flow = followed(frame, frame + 1, lambda step: self._picture(step).frame, self._motion)
        scale = self._scene.motion_scale
        readings = flow_readings(f"motion_scale = {-scale:g}", f"motion_scale = {scale:g} * {{:g}}")
        return judge_truth(WarpInput(here, flow), there.colour, readings)

    def own_margin_px(self, size_px: tuple[int, int]) -> int:
        """Return the margin of the first file around the clip, on its narrowest side."""
        height, width = self._picture(0).frame.size
        margin = min((width - size_px[0]) // 2, (height - size_px[1]) // 2)
        if margin < 0:
            raise InputError(f"{self._files[0]}: {too_small((width, height), size_px)}")
        return margin

    @property
    def typical_depth_m(self) -> float:
        """Near depth of the first file."""
        return near_depth_m(self._picture(0).frame)

    def _mended(self, plane: NDArray[np.float32], frame: SourceFrame) -> NDArray[np.float32]:
        """Give pixels of wrong depth what `plane` has beside them, if the scene says so."""
        return taken(plane, *mends(frame)) if self._scene.depth_speckle else plane

    def _inside(
        self, whole: tuple[int, int], size_px: tuple[int, int], margin_px: int
    ) -> tuple[slice, slice]:
        """The middle of a file, pixel for pixel: rows and columns of the clip and its margin."""
        first = self._picture(0).frame.size
        if whole != first:
            raise InputError(
                f"{self._scene.name}: every file must have the size of the first"
                f" ({first[1]}x{first[0]} px, found {whole[1]}x{whole[0]}); render them anew"
            )
        ends = []
        for length, shown in zip(whole, reversed(size_px), strict=True):
            start = (length - shown) // 2 - margin_px
            ends.append(slice(start, start + shown + 2 * margin_px))
        return ends[0], ends[1]

    def _picture(self, frame: int) -> SequenceFrame:
        if frame >= len(self._files):
            raise InputError(
                f"{self._scene.name}: the clip needs frame {frame}, and the sequence has"
                f" {len(self._files)} files; shorten the clip or render more"
            )
        if frame not in self._kept:
            while len(self._kept) >= KEPT_PICTURES:
                self._kept.pop(next(iter(self._kept)))
            self._kept[frame] = load_picture(self._files[frame], self._scene)
        return self._kept[frame]

    def _motion(self, frame: int) -> Motion:
        file = self._files[frame]
        motion = self._picture(frame).motion
        if motion is not None:
            return motion
        return motion_of(file, read_parts(file).planes, self._scene)


def too_small(file_px: tuple[int, int], clip_px: tuple[int, int]) -> str:
    """Say that files cannot fill a clip, pixel for pixel; sizes are (width, height)."""
    width, height = (2 * (edge // 2) for edge in file_px)
    return (
        "a sequence is shown pixel for pixel, so its files must be at least as large as the clip,"
        f" {clip_px[0]}x{clip_px[1]} px (they are {file_px[0]}x{file_px[1]}); render it larger, or"
        f" set width_px = {width} and height_px = {height} in stimuli.clips"
    )


def open_sequence(scene: ExrScene, folder: Path) -> PhotoScenery | SequenceScenery:
    """Open a sequence; on other paths than up-sampling its middle file is the one picture.

    Raises
    ------
    InputError, OSError
        If there is no file, or one lacks colour or depth.
    """
    if isinstance(scene.camera, StereoPath):
        raise InputError(f"{scene.name}: the stereo path needs a stereo pair")
    files = sequence_files(scene.file, folder)
    if isinstance(scene.camera, UpsamplingPath):
        return SequenceScenery(scene, files)
    picture = load_picture(files[len(files) // 2], scene)
    focal = scene.focal_px or ASSUMED_FOCAL * picture.frame.size[1]
    return PhotoScenery(
        scene.name, picture.frame, focal, rim_px=scene.rim_px, depth_speckle=scene.depth_speckle
    )


def load_picture(path: Path, scene: ExrScene) -> SequenceFrame:
    """Read one file.

    Raises
    ------
    InputError
        If it is damaged, lacks colour or depth, or a value breaks the rules of
        `pipeline.frame`.
    """
    file = read_parts(path, encoded=scene.transfer == "linear")
    planes = file.planes
    if stored_transfer(path, file.attributes) is Transfer.ENCODED and scene.transfer != "linear":
        raise InputError(
            f"{path}: must hold light (its header says that it is encoded); say transfer ="
            ' "linear", which takes it as it is'
        )
    if scene.depth_scale == 1:
        check_depth_unit(path, file.attributes)
    given: dict[str, str] = {str(key): value for key, value in scene.channels.items()}
    layer = depth_layer(path, planes, given.get("depth"))

    def plane(key: str) -> NDArray[np.float32]:
        cure = f'; name it in the protocol: channels = {{ {key} = "..." }}'
        return need(path, planes, key, given.get(key), layer=layer, cure=cure)

    colour = [plane(key) for key in "rgb"]
    check_opaque(path, alpha_of(planes, colour[0]))
    light = np.stack(colour, axis=-1)
    check_finite_light(path, light)
    depth = _distance(plane("depth"), scene)
    check_depth(depth, f"{path}: depth", cure=NO_DEPTH)
    motion = None
    names = _motion_names(scene)
    if find_motion(path, planes, names, style=scene.motion, layer=layer) is not None:
        motion = motion_of(path, planes, scene, layer)
    return SequenceFrame(
        SourceFrame(_encoded(light.clip(0, 1).astype(np.float64), scene.transfer), depth), motion
    )


def motion_of(path: Path, planes: Planes, scene: ExrScene, layer: Layer | None = None) -> Motion:
    """Return a file's motion, as the scene says it is to be read.

    Raises
    ------
    InputError
        If there is none, or it is not finite.
    """
    cure = '; name both in the protocol: channels = { motion_x = "...", motion_y = "..." }'
    names = _motion_names(scene)
    motion = need_motion(path, planes, names, style=scene.motion, layer=layer, cure=cure)
    flow_px = (motion.flow_px * np.float32(scene.motion_scale)).astype(np.float32)
    check_flow(flow_px, f"{path}: motion")
    return Motion(flow_px, motion.to_previous)


def _motion_names(scene: ExrScene) -> tuple[str | None, str | None]:
    return scene.channels.get("motion_x"), scene.channels.get("motion_y")


def _cut(plane: NDArray[np.float32], inside: tuple[slice, slice]) -> NDArray[np.float32]:
    return np.ascontiguousarray(plane[inside])


def _distance(stored: NDArray[np.float32], scene: ExrScene) -> NDArray[np.float32]:
    """Metres along the optical axis, inf where there is nothing."""
    if scene.depth_is == "inverse":  # 0 is nothing there; what is no number stays none
        with np.errstate(divide="ignore"):
            return (np.float32(scene.depth_scale) / stored).astype(np.float32)
    depth_m = (stored * np.float32(scene.depth_scale)).astype(np.float32)
    if scene.depth_is == "ray":
        height, width = depth_m.shape
        focal_px = scene.focal_px or ASSUMED_FOCAL * width
        return along_axis(depth_m, centred(focal_px, width, height))
    return depth_m


def _encoded(light: NDArray[np.float64], transfer: str) -> NDArray[np.float32]:
    if transfer == "srgb":
        return encode_srgb(light).astype(np.float32)
    if transfer == "rec709":
        curve = np.where(light < 0.018, 4.5 * light, 1.099 * light**0.45 - 0.099)
        return curve.clip(0, 1).astype(np.float32)
    return light.astype(np.float32)
