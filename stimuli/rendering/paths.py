"""Camera paths: where the camera is in each frame, at any extent of the path.

Axes are the camera's own: x right, y down, z forward. A path is given for an extent of 1 and
scaled: the extent is a circle's radius, a line's length, the way along a stereo baseline, and
the distance of the farthest key frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.camera import Camera
from pipeline.errors import InputError
from protocols.recipes.warped_clips import (
    CameraPath,
    CirclePath,
    KeyframesPath,
    LinePath,
    StereoPath,
    UpsamplingPath,
)


@dataclass(frozen=True, eq=False)
class Pose:
    """One frame's camera relative to the path's own.

    Parameters
    ----------
    offset : ndarray of float64, shape (3,)
        Right, down, forward, in extents.
    rotation : ndarray of float64, shape (3, 3)
        Own axes from turned axes.
    """

    offset: NDArray[np.float64]
    rotation: NDArray[np.float64]

    def applied_to(self, camera: Camera, extent_m: float) -> Camera:
        """Return `camera` moved and turned."""
        moved = camera.moved(extent_m * self.offset)
        pose = moved.world_from_camera.copy()
        pose[:3, :3] = pose[:3, :3] @ self.rotation
        return replace(moved, world_from_camera=pose)


STILL = Pose(np.zeros(3), np.eye(3))


@dataclass(frozen=True, eq=False)
class Path:
    """The camera of every frame, and of the picture that each frame is warped from.

    Parameters
    ----------
    poses : list of Pose
        One per frame.
    source_frames : list of int, optional
        With temporal up-sampling, the real frame that each frame is warped from; left out: all
        frames are warped from the camera at the path's centre.
    second_frames : list of int or None, optional
        The real frame that holes are completed from, for the frames that have one.
    """

    poses: list[Pose]
    source_frames: list[int] | None = None
    second_frames: list[int | None] | None = None

    def source(self, frame: int) -> int:
        """The frame that is seen where the picture of `frame` is taken, -1 for the centre."""
        return -1 if self.source_frames is None else self.source_frames[frame]

    def second(self, frame: int) -> int | None:
        """The same of the picture that completes it; None where there is none."""
        return None if self.second_frames is None else self.second_frames[frame]

    def pose_of(self, source: int) -> Pose:
        """Return the pose of a picture that frames are warped from."""
        return STILL if source < 0 else self.poses[source]


def make_path(path: CameraPath, frames: int, fps: float) -> Path:
    """Work out a path of a protocol for `frames` frames.

    Raises
    ------
    InputError
        If a key-framed path never leaves its place, or has frames outside the clip.
    """
    if isinstance(path, UpsamplingPath):
        poses = [STILL] * frames if path.along is None else make_path(path.along, frames, fps).poses
        every = path.real_every
        before = [k - k % every for k in range(frames)]
        if not path.second_source:
            return Path(poses, before)
        after = [k + every if k + every < frames else None for k in before]
        is_real = [k % every == 0 for k in range(frames)]
        second = [None if real else key for real, key in zip(is_real, after, strict=True)]
        return Path(poses, before, second)
    if isinstance(path, CirclePath):
        return Path(_circle(path, frames))
    if isinstance(path, LinePath):
        return Path(_line(path, frames))
    if isinstance(path, KeyframesPath):
        return Path(_keyframes(path, frames, fps))
    assert isinstance(path, StereoPath)
    share = np.linspace(0, 1, frames) if frames > 1 else np.ones(1)
    return Path([_shifted(s) for s in share])


def _shifted(right: float, down: float = 0.0) -> Pose:
    return Pose(np.array([right, down, 0.0]), np.eye(3))


def _circle(path: CirclePath, frames: int) -> list[Pose]:
    turn = np.radians(path.start_deg) + 2 * np.pi * path.turns * np.arange(frames) / frames
    # Counter-clockwise as seen by the camera: down is minus up.
    return [_shifted(float(np.cos(a)), float(-np.sin(a))) for a in turn]


def _line(path: LinePath, frames: int) -> list[Pose]:
    length = float(np.linalg.norm(path.direction))
    if not length > 0:
        raise InputError(f"a line's direction must not be zero (got {path.direction})")
    way = np.asarray(path.direction, np.float64) / length
    if path.there_and_back:
        place = -0.5 * np.cos(2 * np.pi * np.arange(frames) / frames)
    else:
        place = np.linspace(-0.5, 0.5, frames) if frames > 1 else np.array([0.5])
    return [Pose(s * way, np.eye(3)) for s in place]


def _keyframes(path: KeyframesPath, frames: int, fps: float) -> list[Pose]:
    # Slow to import, and few paths need them.
    from scipy.interpolate import PchipInterpolator
    from scipy.spatial.transform import Rotation, Slerp

    stamps = np.array([keyframe.t_s for keyframe in path.keyframes], np.float64)
    places = np.array([keyframe.position_m for keyframe in path.keyframes], np.float64)
    farthest = float(np.linalg.norm(places, axis=1).max())
    if not farthest > 0:
        raise InputError(
            "key frames must leave the scene's camera somewhere (every position_m is 0):"
            " turning alone uncovers nothing"
        )
    # Right about the axis that points down, up about the one to the right, clockwise ahead.
    angles = [(k.yaw_deg, k.pitch_deg, k.roll_deg) for k in path.keyframes]
    rotations = Rotation.from_euler("YXZ", angles, degrees=True)
    at = np.clip(np.arange(frames) / fps, stamps[0], stamps[-1])
    positions = PchipInterpolator(stamps, places / farthest)(at)
    turned = Slerp(stamps, rotations)(at).as_matrix()
    return [Pose(p, r) for p, r in zip(positions, turned, strict=True)]
