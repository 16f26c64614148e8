"""OpenEXR pictures and sequences with depth and motion: `stimuli.channels` names the channels."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.camera import UPRIGHT, Camera
from pipeline.colour import encode_srgb
from pipeline.errors import InputError
from pipeline.frame import SourceFrame, WarpedFrame, check_depth, check_flow
from protocols.recipes.warped_clips import ExrScene, StereoPath, UpsamplingPath
from stimuli.channels import Motion, Planes, find_motion, need, need_motion
from stimuli.exr_parts import frame_files, read_parts
from stimuli.paths import Pose
from stimuli.scenes.follow import followed
from stimuli.scenes.photo import PhotoScenery, fitted, nearest_plane

ASSUMED_FOCAL = 1.0  # image widths, where the protocol does not say
KEPT_PICTURES = 3  # of a sequence at a time


@dataclass(frozen=True)
class Picture:
    """One file: encoded colour, depth, and motion where there is one."""

    frame: SourceFrame
    motion: Motion | None


class SequenceScenery:
    """A sequence for temporal up-sampling: every file is a true frame, and tells its motion."""

    def __init__(self, scene: ExrScene, files: list[Path]) -> None:
        self._scene, self._files = scene, files
        self._kept: dict[int, Picture] = {}

    def source(
        self, size_px: tuple[int, int], margin_px: int, pose: Pose, extent_m: float, frame: int
    ) -> tuple[SourceFrame, Camera]:
        """Return the real frame `frame`, cut to size."""
        del pose, extent_m
        cut, scale = fitted(self._picture(frame).frame, size_px, margin_px)
        height, width = cut.size
        focal = (self._scene.focal_px or ASSUMED_FOCAL * width / scale) * scale
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
        del pose, extent_m
        cut, _ = fitted(self._picture(warped.frame_index).frame, size_px, margin_px)
        height, width = cut.size
        inside = slice(margin_px, height - margin_px), slice(margin_px, width - margin_px)
        return np.ascontiguousarray(cut.colour[inside])

    def motion(
        self, size_px: tuple[int, int], margin_px: int, source: int, frame: int
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Follow every pixel of `source` from file to file."""
        first = self._picture(source).frame
        flow = followed(source, frame, lambda step: self._picture(step).frame, self._motion)
        _, scale = fitted(first, size_px, margin_px)
        planes = [nearest_plane(flow[..., c], size_px, margin_px) * scale for c in range(2)]
        depth = nearest_plane(first.depth_m, size_px, margin_px)
        return np.stack(planes, axis=-1).astype(np.float32), depth

    @property
    def typical_depth_m(self) -> float:
        """Near depth of the first file."""
        depth = self._picture(0).frame.depth_m
        return float(np.percentile(depth[np.isfinite(depth)], 5))

    @property
    def largest_extent_m(self) -> float:
        """The files' own motion is what there is: no extent changes it."""
        return float("inf")

    @property
    def rim_px(self) -> int:
        """As the protocol says."""
        return self._scene.rim_px

    def release(self) -> None:
        """Hold nothing on the GPU."""

    def _picture(self, frame: int) -> Picture:
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
        return motion or motion_of(file, read_parts(file).planes, self._scene)


def open_sequence(scene: ExrScene, folder: Path) -> PhotoScenery | SequenceScenery:
    """Open a sequence; on other paths than up-sampling its middle file is the one picture.

    Raises
    ------
    InputError, OSError
        If there is no file, or one lacks colour or depth.
    """
    if isinstance(scene.camera, StereoPath):
        raise InputError(f"{scene.name}: the stereo path needs a stereo pair")
    files = frame_files(scene.file, folder)
    if isinstance(scene.camera, UpsamplingPath):
        return SequenceScenery(scene, files)
    picture = load_picture(files[len(files) // 2], scene)
    focal = scene.focal_px or ASSUMED_FOCAL * picture.frame.size[1]
    return PhotoScenery(scene.name, picture.frame, focal, rim_px=scene.rim_px)


def load_picture(path: Path, scene: ExrScene) -> Picture:
    """Read one file.

    Raises
    ------
    InputError
        If it is damaged, lacks colour or depth, or a value breaks the rules of
        `pipeline.frame`.
    """
    planes = read_parts(path).planes
    given: dict[str, str] = {str(key): value for key, value in scene.channels.items()}

    def plane(key: str) -> NDArray[np.float32]:
        cure = f'; name it in the protocol: channels = {{ {key} = "..." }}'
        return need(path, planes, key, given.get(key), cure=cure)

    light = np.stack([plane(key) for key in "rgb"], axis=-1)
    if not np.isfinite(light).all():
        row, column = np.argwhere(~np.isfinite(light).all(axis=-1))[0]
        raise InputError(
            f"{path}: colour must be finite (found {light[row, column]} at row {row},"
            f" column {column}); render it again, or mend these pixels"
        )
    depth = _distance(plane("depth"), scene)
    check_depth(depth, f"{path}: depth")
    motion = None
    if find_motion(planes, _motion_names(scene), style=scene.motion) is not None:
        motion = motion_of(path, planes, scene)
    return Picture(
        SourceFrame(_encoded(light.clip(0, 1).astype(np.float64), scene.transfer), depth), motion
    )


def motion_of(path: Path, planes: Planes, scene: ExrScene) -> Motion:
    """Return a file's motion, as the scene says it is to be read.

    Raises
    ------
    InputError
        If there is none, or it is not finite.
    """
    cure = '; name both in the protocol: channels = { motion_x = "...", motion_y = "..." }'
    motion = need_motion(path, planes, _motion_names(scene), style=scene.motion, cure=cure)
    flow_px = (motion.flow_px * np.float32(scene.motion_scale)).astype(np.float32)
    check_flow(flow_px, f"{path}: motion")
    return Motion(flow_px, motion.to_previous)


def _motion_names(scene: ExrScene) -> tuple[str | None, str | None]:
    return scene.channels.get("motion_x"), scene.channels.get("motion_y")


def _distance(stored: NDArray[np.float32], scene: ExrScene) -> NDArray[np.float32]:
    """Metres along the optical axis, inf where there is nothing."""
    if scene.depth_is == "inverse":  # 0 is nothing there; what is no number stays none
        with np.errstate(divide="ignore"):
            return (np.float32(scene.depth_scale) / stored).astype(np.float32)
    return (stored * np.float32(scene.depth_scale)).astype(np.float32)


def _encoded(light: NDArray[np.float64], transfer: str) -> NDArray[np.float32]:
    if transfer == "srgb":
        return encode_srgb(light).astype(np.float32)
    if transfer == "rec709":
        curve = np.where(light < 0.018, 4.5 * light, 1.099 * light**0.45 - 0.099)
        return curve.clip(0, 1).astype(np.float32)
    return light.astype(np.float32)
